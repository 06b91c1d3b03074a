//! Multiple importance sampling: the balance heuristic over all techniques that sample the same path.
//!
//! This page explains the weights once; the derivation is section 12a of `docs/theory.md`, whose equation numbers
//! stand beside the code.
//!
//! # Techniques
//! With `Strategy::Mis` camera paths are cut at their second diffuse vertex `v_2`. A path of the diffuse vertices
//! `v_1, v_2, ...`, counted from the camera, is sampled by up to three techniques: a merge at `v_1`, a merge at `v_2`
//! and a connection from its last vertex. Each contribution is multiplied by the density of its technique over the
//! sum of the densities of all of them. Any weights that add up to 1 leave the mean of the image unchanged. They do
//! so because all techniques compute *the same numbers* for the same path, so the numbers decide about noise only.
//!
//! # Partials
//! As in the recursive evaluation of bidirectional methods, no technique walks along the other subpath. Densities
//! are in projected solid angle, in which distances and cosines cancel (47a). Each subpath carries one number, its
//! *MIS partial*:
//! - a camera path from its first vertex on: `c_1` over the density of going on, (47d);
//! - a photon: the density of the previous technique over the density of going on, (47e).
//!
//! The weights of merges (47f) and connections (47g) follow from the partials and the densities at one vertex.
//!
//! # Where to find it
//! - [`weights`]: the equations, [`Balance`];
//! - [`densities`]: the densities `p_c` and `p_l` of camera and light paths, [`PathKind`](densities::PathKind);
//! - [`photons`]: the partials of light paths and photons;
//! - [`merge_weights`]: the weights of merges, four photons at a time;
//! - `camera_paths::mis`: the partials of camera paths, the weights of connections, and the weights of rough lobes
//!   (47i).
//!
//! The constants of the weights stay the same in all iterations of an image, whatever its counts: the law of the
//! noise holds for fixed weights only. See [`MisScales`](crate::settings::MisScales).

pub mod densities;
pub mod merge_weights;
pub mod photons;
pub mod weights;

use crate::settings::{Direct, Settings, Strategy};
use weights::Balance;

/// Constants of all weights of an iteration.
#[derive(Clone, Copy, Debug)]
pub struct Mis {
    /// The balance heuristic.
    pub balance: Balance,
    /// Light straight from a light source is connected, not merged.
    pub connects: bool,
}

impl Mis {
    /// The constants of these settings; `None` unless their strategy is [`Strategy::Mis`].
    pub fn new(settings: &Settings) -> Option<Self> {
        (settings.strategy == Strategy::Mis).then(|| Self {
            balance: Balance::new(settings),
            connects: settings.direct == Direct::Connect,
        })
    }
}
