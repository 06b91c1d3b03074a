//! Which technique renders an image with the least error: strategy, direct light and merge radii.
//!
//! A pilot outside of the image (`pilot.rs`) tries each strategy on a sample of the pixels (`trial.rs`), at a large
//! radius, where the merge bias is plain, and at a smaller one; and what areas of surfaces cost (`census.rs`). How
//! noise, bias and time depend on the radii is known (`model.rs`, `bias.rs`), so that a few trials tell about all radii;
//! what looks best for the time or error (`demand.rs`) is then tried where it would render. theory.md, section 22a.

mod bias;
mod census;
mod candidate_cost;
mod model;
mod pilot;
mod trial;

use crate::base::error::Result;
use crate::render::Renderer;
use crate::settings::policy::*;
use crate::settings::{Bias, Direct, Kernel, Settings, Strategy, shared_by};
use crate::timing::TimeModel;
use crate::transport::kernel::ByClass;
use crate::transport::photon::PhotonClass;
use serde::{Deserialize, Serialize};

/// How a path is found, whatever the radii and counts.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Technique {
    /// In one way or in all.
    pub strategy: Strategy,
    /// The diffuse vertex at which camera paths are cut.
    pub merge_vertex: u32,
    /// How light is found that comes straight from a light source.
    pub direct: Direct,
    /// What flux is divided by.
    pub kernel: Kernel,
}

/// What the choice is free to decide.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct FreeParameters {
    /// Strategy and merge vertex.
    pub strategy: bool,
    /// Direct light.
    pub direct: bool,
    /// Discs instead of areas.
    pub kernel: bool,
    /// The merge radius.
    pub radius: bool,
    /// The radius for photons without a diffuse bounce.
    pub caustic_radius: bool,
    /// Where light paths start.
    pub guide: bool,
    /// Whether bias is taken off.
    pub bias: bool,
}

impl FreeParameters {
    /// All of it.
    pub const ALL: Self = Self::everything(true);

    /// Nothing but counts.
    pub const NONE: Self = Self::everything(false);

    const fn everything(open: bool) -> Self {
        Self {
            strategy: open,
            direct: open,
            kernel: open,
            radius: open,
            caustic_radius: open,
            guide: open,
            bias: open,
        }
    }

    /// Whether anything is but the counts.
    pub fn any(&self) -> bool {
        let Self { strategy, direct, kernel, radius, caustic_radius, guide, .. } = *self;
        strategy || direct || kernel || radius || caustic_radius || guide
    }

    fn any_radius(&self) -> bool {
        self.radius || self.caustic_radius
    }

    /// What becomes of the bias: it is taken off if that is not decided.
    fn bias(&self, settings: &Settings) -> Bias {
        if self.bias { Bias::Reduce } else { settings.bias }
    }
}

/// A technique at its best radii and counts.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Candidate {
    /// The technique.
    #[serde(flatten)]
    pub technique: Technique,
    /// Scene units.
    pub radius: f32,
    /// Scene units.
    pub caustic_radius: f32,
    /// `N_F`.
    pub light_paths: u32,
    /// `N_B`.
    pub camera_paths: u32,
    /// Rendering time to the end, seconds.
    pub seconds: f64,
    /// Relative RMS error of the image then.
    pub error: f64,
    /// The part of that which is noise.
    pub noise: f64,
    /// The part of that which is bias.
    pub bias: f64,
    /// Standard error of the square of `bias`.
    pub bias2_error: f64,
    /// Whether it was tried at these radii, not only at others.
    pub tried: bool,
    /// Times of the image, from a sample of it.
    pub times: TimeModel,
}

/// What a pilot found.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Selection {
    /// The best first, then the others.
    pub candidates: Vec<Candidate>,
    /// What it was free to decide.
    pub open: FreeParameters,
    /// Where light paths start, if that is not in proportion to the lights' power.
    pub guide: Option<Guided>,
    /// What the pilot took, seconds.
    pub seconds: f64,
}

/// A guide of light paths that pays.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Guided {
    /// Iterations in which it was learned, and is again.
    pub iterations: u32,
    /// Second moment of what light paths bring, over that without a guide.
    pub second_moment: f64,
}

impl Guided {
    /// In words.
    pub fn describe(&self) -> String {
        let gain = self.second_moment.recip();
        format!("light paths start where they bring more, for {gain:.2} times less variance")
    }
}

impl Technique {
    /// That of some settings.
    pub fn of(settings: &Settings) -> Self {
        let Settings { strategy, merge_vertex, direct, kernel, .. } = *settings;
        Self { strategy, merge_vertex, direct, kernel }
    }

    /// In words.
    pub fn describe(&self) -> String {
        let how = match self.strategy {
            Strategy::Mis => "merging at vertices 1 and 2 and connections, weighted".to_owned(),
            Strategy::Single => format!("merging at vertex {}", self.merge_vertex),
        };
        let how = match self.direct {
            Direct::Connect => how,
            Direct::PhotonMap => how + ", direct light from the photon map",
        };
        match self.kernel {
            Kernel::Area => how,
            Kernel::Disc => how + ", on discs",
        }
    }

    /// The diffuse vertices of a camera path at which photons are merged.
    fn vertices(&self) -> Vec<u32> {
        match self.strategy {
            Strategy::Single => vec![self.merge_vertex],
            Strategy::Mis => vec![1, 2],
        }
    }

    /// The same on discs, if it is not.
    fn on_discs(&self) -> Option<Self> {
        (self.kernel == Kernel::Area).then_some(Self { kernel: Kernel::Disc, ..*self })
    }

    /// Settings with it at some radii.
    fn with(self, settings: &Settings, radii: ByClass<f32>) -> Settings {
        let Self { strategy, merge_vertex, direct, kernel } = self;
        let radius = radii[PhotonClass::Diffuse as usize];
        let caustic_radius = radii[PhotonClass::Caustic as usize];
        Settings {
            strategy,
            merge_vertex,
            direct,
            kernel,
            radius,
            caustic_radius,
            ..settings.clone()
        }
    }

    /// All that may be chosen beside `settings`.
    fn candidates(settings: &Settings, open: FreeParameters) -> Vec<Self> {
        let own = Self::of(settings);
        let strategies = if open.strategy {
            vec![(Strategy::Single, 1), (Strategy::Single, 2), (Strategy::Mis, 2)]
        } else {
            vec![(own.strategy, own.merge_vertex)]
        };
        let directs = match open.direct {
            true => vec![Direct::Connect, Direct::PhotonMap],
            false => vec![own.direct],
        };
        let all = directs.iter().flat_map(|&direct| {
            strategies.iter().map(move |&(strategy, merge_vertex)| Self {
                strategy,
                merge_vertex,
                direct,
                kernel: own.kernel,
            })
        });
        // Direct light from the map is worth its noise only where all light is merged at the first vertex.
        let sensible = |it: &Self| {
            it.direct == own.direct && !open.direct
                || it.direct == Direct::Connect
                || (it.strategy, it.merge_vertex) == (Strategy::Single, 1)
        };
        all.filter(sensible).collect()
    }
}

impl Candidate {
    /// The settings that render so.
    pub fn apply(&self, settings: &Settings) -> Settings {
        let Self { technique, radius, caustic_radius, light_paths, camera_paths, .. } = *self;
        let mut radii = [radius; 2];
        radii[PhotonClass::Caustic as usize] = caustic_radius;
        let scale = shared_by(camera_paths);
        Settings {
            light_paths,
            camera_paths,
            mis_light_paths: light_paths,
            mis_c1: scale,
            mis_c2: scale,
            ..technique.with(settings, radii)
        }
    }
}

impl Selection {
    /// The settings that render as the best of all.
    pub fn apply(&self, settings: &Settings) -> Settings {
        let guide = self.guide.map_or(settings.guide, |guided| guided.iterations);
        Settings { guide, bias: self.open.bias(settings), ..self.best().apply(settings) }
    }

    /// The best of all.
    pub fn best(&self) -> &Candidate {
        &self.candidates[0]
    }

    /// The best of the other techniques, if there are any.
    pub fn runner_up(&self) -> Option<&Candidate> {
        self.candidates.get(1)
    }
}

/// What rendering is to end with.
#[derive(Clone, Copy, Debug)]
pub enum End {
    /// After so many seconds in all.
    Time(f64),
    /// At this relative error.
    Error(f64),
}

/// Tries what is open beside the settings of a renderer, on the threads of the current rayon pool. Where the time is
/// not known, a short pilot tells how much a longer one may take. The pilot runs in this process alone, whatever the
/// number of [`Renderer::ranks`] that render afterwards.
///
/// # Errors
/// As [`Renderer::new`].
pub fn choose(renderer: &Renderer, open: FreeParameters, end: End) -> Result<Selection> {
    let pilot = |budget| pilot::run(renderer, (open, end), budget);
    let part = if open.any() { 1.0 } else { CLOSED_SHARE };
    let share = |time: f64| {
        let least = LEAST_TECHNIQUE_TIME.min(MOST_TECHNIQUE_SHARE * time);
        part * (TECHNIQUE_SHARE * time).max(least).min(TECHNIQUE_LONGEST)
    };
    match end {
        End::Time(time) => pilot(share(time)),
        End::Error(_) => {
            let first = pilot(TECHNIQUE_TIME)?;
            let budget = share(first.best().seconds / f64::from(renderer.config().ranks));
            if budget < LONGER_PILOT * TECHNIQUE_TIME {
                return Ok(first);
            }
            let again = pilot(budget)?;
            Ok(Selection { seconds: first.seconds + again.seconds, ..again })
        }
    }
}
