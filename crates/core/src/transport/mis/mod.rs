//! Multiple importance sampling: the balance heuristic over all techniques that sample the same
//! path.
//!
//! This page explains the weights once; the derivation is section 12a of
//! `docs/explanation/theory.md`, whose equation numbers stand beside the code.
//!
//! # Techniques
//! With `Strategy::Mis` a path of the diffuse vertices `v_1, ..., v_m`, counted from the camera, is
//! sampled by up to four techniques: a merge at `v_1`, a merge at `v_2`, a connection from its last
//! vertex to the light source, and a camera path that hits the light source. Each contribution is
//! multiplied by the density of its technique over the sum of the densities of all of them. Any
//! weights that add up to 1 leave the mean of the image unchanged. They do so because all
//! techniques compute *the same numbers* for the same path, so the numbers decide about noise only.
//! Where few photons arrive, the weights of merges vanish, and what remains is a path tracer.
//! `Strategy::CutMis` ends camera paths at `v_2`; `Strategy::Path` traces no light paths.
//!
//! # Partials
//! As in the recursive evaluation of bidirectional methods, no technique walks along the other
//! subpath. Densities are in projected solid angle, in which distances and cosines cancel (47a).
//! Each subpath carries two numbers, its *MIS partial*:
//! - a camera path: densities of merges at its vertices over the density of going on, (47d);
//! - a light path: densities of hits, connections and merges at its vertices over the density of
//!   going on, (47e).
//!
//! The weights of merges (47f), connections (47g) and hits (47i) follow from the partials and the
//! densities at one vertex.
//!
//! # Where to find it
//! - [`weights`]: the equations, [`Balance`];
//! - [`densities`]: the densities of camera and light paths, [`Survival`];
//! - [`photons`]: the partials of light paths and photons;
//! - [`merge_weights`]: the weights of merges, four photons at a time;
//! - `camera_paths::mis`: the partials of camera paths, the weights of connections and hits.
//!
//! The constants of the weights stay the same in all iterations of an image, whatever its counts:
//! the law of the noise holds for fixed weights only. See
//! [`MisScales`](crate::settings::MisScales).

pub mod densities;
pub mod merge_weights;
pub mod photons;
pub mod weights;

use crate::settings::Settings;
use densities::{PassChoice, Survival};
use weights::Balance;

/// Constants of all weights of an iteration.
#[derive(Clone, Copy, Debug)]
pub struct Mis {
    /// The balance heuristic.
    pub balance: Balance,
    /// Light straight from a light source is connected to diffuse vertices, not merged.
    pub connects: bool,
    /// The diffuse vertex at which camera paths are cut; `None` if they go on.
    pub last_vertex: Option<u32>,
}

impl Mis {
    /// The constants of these settings; `None` if their strategy needs no weights.
    pub fn new(settings: &Settings) -> Option<Self> {
        settings.strategy.is_weighted().then(|| Self::with(Balance::new(settings), settings))
    }

    /// The constants without merges, for what camera paths of strategies without weights sample
    /// before their first diffuse vertex: light that they hit, and connections from rough lobes.
    /// No photon has a part in these paths, so that they have the same weights with all strategies.
    pub fn before_diffuse(settings: &Settings) -> Self {
        Self::with(Balance::WITHOUT_MERGES, settings)
    }

    fn with(balance: Balance, settings: &Settings) -> Self {
        let last_vertex = (!settings.strategy.continues()).then_some(settings.merge_vertex);
        Self { balance, connects: settings.connects(), last_vertex }
    }

    /// Camera paths go on after the last diffuse vertex at which photons may be merged.
    #[inline(always)] // part of vector loops, as the next function
    pub fn continues(&self) -> bool {
        self.last_vertex.is_none()
    }

    /// Survival of camera paths at their diffuse vertex of this number, from 1 on.
    #[inline(always)]
    pub fn camera_survival(&self, vertex: u32) -> Survival {
        match vertex {
            1 => Survival::Certain,
            _ if self.continues() => Survival::Reflected,
            _ => Survival::Never,
        }
    }

    /// Lobes from which camera paths choose after this number of diffuse vertices.
    pub fn pass_choice(&self, diffuse: u32) -> PassChoice {
        match self.last_vertex {
            Some(last) if diffuse + 1 >= last => PassChoice::PassOnly,
            _ => PassChoice::Free,
        }
    }
}
