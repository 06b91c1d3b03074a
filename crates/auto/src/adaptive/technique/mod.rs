//! Chooses the technique that renders an image with the least error: strategy, direct light and
//! merge radii.
//!
//! A pilot beside the image (`pilot.rs`) tries each strategy on a sample of the pixels
//! (`trial_runner.rs`): at the radii of the settings, and at a large radius, where the merge bias
//! stands out from the noise. From these trials a model predicts noise, bias and time at all radii
//! (`model.rs`, `bias_law.rs`). The candidates with the lowest costs (`candidate_cost.rs`) then
//! race at the radii and path counts that were chosen for them (`race.rs`). See theory.md, section
//! 22a.

mod alternatives;
mod beam_times;
mod bias_law;
mod candidate_cost;
mod candidates;
mod compared_trials;
mod lane;
mod model;
mod pair_time;
mod pilot;
mod race;
mod seen_noise;
mod seen_surfaces;
mod start_up;
mod trial;
mod trial_runner;

pub use alternatives::{Alternatives, Refuted, TimeShare};
pub use seen_noise::{LEAST_DENOISED_NOISE, VISIBLE_NOISE};

use crate::timing::TimeModel;
use bdpm_core::base::error::Result;
use bdpm_core::render::Renderer;
use bdpm_core::settings::{
    Bias, Direct, Kernel, MAX_LIGHT_PATHS, MIN_SETS, MediumQuery, Settings, Strategy,
};
use bdpm_core::simd::sobol::MAX_POINTS;
use bdpm_core::transport::kernel::ByClass;
use serde::{Deserialize, Serialize};

/// Share of the given time that the pilot takes.
const PILOT_SHARE: f64 = 0.1;

/// Minimum time of the pilot, seconds, unless that exceeds [`MAX_PILOT_SHARE`]. A shorter pilot
/// measures too little.
const MIN_PILOT_TIME: f64 = 0.6;

/// Share of the given time that [`MIN_PILOT_TIME`] may take at most.
const MAX_PILOT_SHARE: f64 = 0.15;

/// Maximum time of the pilot, seconds: a longer one finds no better settings.
const MAX_PILOT_TIME: f64 = 8.0;

/// Factor on the time of the pilot where it chooses nothing but counts.
const COUNTS_ONLY: f64 = 0.5;

/// Time of the first pilot where no time is given, seconds.
const FIRST_PILOT_TIME: f64 = 0.5;

/// A second pilot is worth it if its time exceeds that of the first by this factor.
const LONGER_PILOT: f64 = 2.0;

/// Sampling technique, without radii and counts.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Technique {
    /// Whether each path is sampled by one technique or by several, with weights.
    pub strategy: Strategy,
    /// The diffuse vertex at which camera paths are cut.
    pub merge_vertex: u32,
    /// How direct light is estimated.
    pub direct: Direct,
    /// The area that merged flux is divided by.
    pub kernel: Kernel,
    /// Factor on the continuations of light paths at their first diffuse vertex.
    pub splitting: u32,
    /// Where photons in media that scatter are merged; `None` without such media or photons.
    pub medium_query: Option<MediumQuery>,
}

/// Declares settings that may be free.
macro_rules! free_parameters {
    ($($(#[$doc:meta])* $name:ident,)*) => {
        /// Settings that the pilot may choose.
        #[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
        pub struct FreeParameters {
            $($(#[$doc])* pub $name: bool,)*
        }

        impl FreeParameters {
            /// Everything.
            pub const ALL: Self = Self { $($name: true,)* };

            /// Nothing but the counts.
            pub const NONE: Self = Self { $($name: false,)* };

            /// Whether the setting of this name may be chosen.
            pub fn includes(&self, setting: &str) -> bool {
                match setting {
                    $(stringify!($name) => self.$name,)*
                    "merge_vertex" => self.strategy,
                    "light_visibility" => self.any(),
                    _ => false,
                }
            }
        }
    };
}

free_parameters! {
    /// Strategy and merge vertex.
    strategy,
    /// Direct light.
    direct,
    /// The merge radius.
    radius,
    /// The radius for photons without a diffuse bounce.
    caustic_radius,
    /// Where photons in media are merged.
    medium_query,
    /// The radii in media.
    medium_scale,
    /// The share of the merges in media that are done.
    medium_share,
    /// Where light paths start.
    guide,
    /// The size of the sets of light paths that start from Sobol points.
    sobol_set,
    /// How light paths split.
    splitting,
    /// Whether the merge bias is corrected.
    bias,
}

impl FreeParameters {
    /// Whether the pilot may choose more than the counts.
    pub fn any(&self) -> bool {
        let Self { strategy, direct, radius, caustic_radius, guide, .. } = *self;
        let in_media = self.medium_query || self.medium_scale || self.medium_share;
        strategy || direct || radius || caustic_radius || guide || in_media
    }

    /// Whether to correct the merge bias: yes, unless the settings decide.
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
    /// Merge radius, scene units.
    pub radius: f32,
    /// Merge radius for photons without a diffuse bounce, scene units.
    pub caustic_radius: f32,
    /// Merge radii in media over those at surfaces.
    pub medium_scale: f64,
    /// Share of the merges in media that are done.
    pub medium_share: f64,
    /// Light paths of an iteration, `N_F`.
    pub light_paths: u32,
    /// Camera paths per pixel of an iteration, `N_B`.
    pub camera_paths: u32,
    /// Rendering time until the end, seconds.
    pub seconds: f64,
    /// Predicted relative RMS error of the image at the end; if it is denoised, of what is left.
    pub error: f64,
    /// Noise part of `error`.
    pub noise: f64,
    /// Bias part of `error`.
    pub bias: f64,
    /// Standard error of the square of `bias`.
    pub bias2_error: f64,
    /// Whether a trial measured it at these radii.
    pub tried: bool,
    /// Times of an iteration of the image, from trials on a sample of it.
    pub times: TimeModel,
}

/// Result of a pilot.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Selection {
    /// All candidates, the best first.
    pub candidates: Vec<Candidate>,
    /// Settings that the pilot could choose.
    pub open: FreeParameters,
    /// Guide of light paths; without one they start in proportion to the lights' power.
    pub guide: Option<Guided>,
    /// Time of the pilot, seconds.
    pub seconds: f64,
    /// The latest technique that an audit of the image refuted, if there is one.
    #[serde(default)]
    pub refuted: Option<Refuted>,
    /// Techniques whose trials the trial of path tracing refuted.
    #[serde(default)]
    pub refuted_trials: Vec<Technique>,
}

/// A guide of light paths that pays.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Guided {
    /// Iterations that learned it. The image's own guide is learned in as many.
    pub iterations: u32,
    /// Second moment of the contribution of light paths, over that without a guide.
    pub second_moment: f64,
}

impl Guided {
    /// Describes the guide in words.
    pub fn describe(&self) -> String {
        let gain = self.second_moment.recip();
        format!("guided light paths, which divide the variance by {gain:.2}")
    }
}

impl Technique {
    /// The technique of some settings.
    pub fn of(settings: &Settings) -> Self {
        let Settings { strategy, merge_vertex, direct, kernel, splitting, .. } = *settings;
        Self { strategy, merge_vertex, direct, kernel, splitting, medium_query: None }
    }

    /// Describes the technique in words.
    pub fn describe(&self) -> String {
        let mut how = match self.strategy {
            Strategy::Mis => "merging at vertices 1 and 2 and path tracing, weighted".to_owned(),
            Strategy::CutMis => "merging at vertices 1 and 2 and connections, weighted".to_owned(),
            Strategy::Path => "path tracing without photons".to_owned(),
            Strategy::PathCaustics => "path tracing with photons of caustics".to_owned(),
            Strategy::Single => format!("merging at vertex {}", self.merge_vertex),
            Strategy::Gather => format!("a cache of light at vertex {}", self.merge_vertex),
            Strategy::GatherCaustics => {
                format!("a cache of light at vertex {}, photons of caustics", self.merge_vertex)
            }
        };
        if self.direct == Direct::PhotonMap {
            how += ", direct light from the photon map";
        }
        if self.kernel == Kernel::Disc {
            how += ", on discs";
        }
        how + match self.medium_query {
            None => "",
            Some(MediumQuery::Points) => ", in media around points",
            Some(MediumQuery::Beams) => ", in media along segments",
        }
    }

    /// Settings with this technique at some radii.
    fn with(self, settings: &Settings, radii: ByClass<f32>) -> Settings {
        let Self { strategy, merge_vertex, direct, kernel, splitting, medium_query } = self;
        let medium_query = medium_query.unwrap_or(settings.medium_query);
        let [caustic_radius, radius] = radii;
        Settings {
            strategy,
            merge_vertex,
            direct,
            kernel,
            splitting,
            medium_query,
            radius,
            caustic_radius,
            ..settings.clone()
        }
    }

    /// The technique with light paths that split, if that may pay: where their first hits, which
    /// are only stored for direct light and caustics, leave little light.
    fn split(self) -> Option<Self> {
        let pays = (self.strategy, self.direct) == (Strategy::Single, Direct::Connect);
        pays.then_some(Self { splitting: SPLITTING, ..self })
    }

    /// Tests whether photons are merged, so that radii matter.
    fn merges(self) -> bool {
        self.strategy.has_photons()
    }

    /// What it merges or looks up: photons of caustics, and diffuse photons or a cache.
    fn classes(self) -> ByClass<bool> {
        let only_caustics = self.strategy.has_only_caustics() && !self.strategy.has_cache();
        [self.merges(), self.strategy.shares_light() && !only_caustics]
    }

    /// The largest radius of its merges, scene units; 0 without merges.
    fn reach(self, radii: ByClass<f64>) -> f64 {
        let [caustic, diffuse] = radii;
        match self.strategy.has_only_caustics() {
            true => caustic,
            false if self.merges() => caustic.max(diffuse),
            false => 0.0,
        }
    }
}

/// Factor on the continuations of light paths whose first hits are not merged. In
/// `scenes/cornell-box` the noise falls as one over this factor at least up to 16
/// (docs/measurements/sobol-sets.md), while the first ray of a path is shared.
const SPLITTING: u32 = 8;

/// Sets of light paths in an iteration at the start. Later choices of the number of light paths may
/// halve it.
const FIRST_SETS: u32 = 2 * MIN_SETS;

/// Minimum size of sets of light paths. Smaller ones gain next to nothing.
const LEAST_SOBOL_SET: u32 = 256;

/// The largest size of which an iteration has at least [`FIRST_SETS`] sets. Larger sets never have
/// more noise, but fewer sets measure it less well.
fn largest_sobol_set(light_paths: u32) -> u32 {
    match (light_paths / FIRST_SETS).checked_ilog2() {
        Some(bits) if 1 << bits >= LEAST_SOBOL_SET => MAX_POINTS.min(1 << bits),
        _ => 1,
    }
}

impl Candidate {
    /// Settings that render this candidate.
    pub fn apply(&self, settings: &Settings) -> Settings {
        let Self { technique, radius, caustic_radius, light_paths, camera_paths, .. } = *self;
        let Self { medium_scale, medium_share, .. } = *self;
        let own = technique.with(settings, [caustic_radius, radius]);
        let mis_scales = None;
        Settings { light_paths, camera_paths, medium_scale, medium_share, mis_scales, ..own }
    }
}

impl Selection {
    /// Settings that render the best candidate.
    pub fn apply(&self, settings: &Settings) -> Settings {
        let guide = self.used_guide().map_or(settings.guide, |guided| guided.iterations);
        let bias = self.open.bias(settings);
        let mut own = Settings { guide, bias, ..self.best().apply(settings) };
        if self.open.sobol_set && own.has_photons() {
            own.sobol_set = largest_sobol_set(own.light_paths);
        }
        own.light_paths = own.allowed_light_paths(MAX_LIGHT_PATHS).nearest(own.light_paths);
        own
    }

    /// The guide of light paths, if the best candidate has photons.
    pub fn used_guide(&self) -> Option<&Guided> {
        self.guide.as_ref().filter(|_| self.best().technique.merges())
    }

    /// The best candidate.
    pub fn best(&self) -> &Candidate {
        &self.candidates[0]
    }

    /// The second best candidate, if there is one.
    pub fn runner_up(&self) -> Option<&Candidate> {
        self.candidates.get(1)
    }
}

/// When rendering ends.
#[derive(Clone, Copy, Debug)]
pub enum End {
    /// After a time, seconds, that includes the pilot.
    Time(f64),
    /// At this relative error.
    Error(f64),
}

/// Tries what is open, beside the settings of a renderer, on the threads of the current rayon pool.
///
/// Where no time is given, a short pilot predicts it, and a longer pilot follows if the time is
/// long enough. The pilot runs in this process alone, whatever the number of `RenderConfig::ranks`.
/// Returns the choice, and what may take its place if the audit of the image refutes it.
/// If the image is denoised, what counts is the noise that is left.
///
/// # Errors
/// As [`Renderer::new`].
pub fn choose(
    renderer: &Renderer,
    open: FreeParameters,
    end: End,
    denoises: bool,
) -> Result<(Selection, Alternatives)> {
    let pilot = |budget| pilot::run(renderer, open, end, budget, denoises);
    let part = if open.any() { 1.0 } else { COUNTS_ONLY };
    let share = |time: f64| {
        let least = MIN_PILOT_TIME.min(MAX_PILOT_SHARE * time);
        part * (PILOT_SHARE * time).max(least).min(MAX_PILOT_TIME)
    };
    match end {
        End::Time(time) => pilot(share(time)),
        End::Error(_) => {
            let (first, alternatives) = pilot(FIRST_PILOT_TIME)?;
            let budget = share(first.best().seconds / f64::from(renderer.config().ranks));
            if budget < LONGER_PILOT * FIRST_PILOT_TIME {
                return Ok((first, alternatives));
            }
            let (again, alternatives) = pilot(budget)?;
            Ok((Selection { seconds: first.seconds + again.seconds, ..again }, alternatives))
        }
    }
}
