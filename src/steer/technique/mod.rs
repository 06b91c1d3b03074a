//! Which technique renders an image with the least error: strategy, direct light and merge radii.
//!
//! A pilot outside of the image tries each strategy on a sample of the pixels, at a large radius, where the
//! merge bias is plain, and at a smaller one (`trial.rs`). How noise, bias and time depend on the radii is known
//! (`model.rs`), so that a few trials tell about all radii; what looks best is then tried where it would render.
//! theory.md, section 22a.

mod model;
mod trial;

use crate::accel::Intersect;
use crate::base::error::Result;
use crate::image::counts::Counts;
use crate::image::film::luminance_weights;
use crate::render::Renderer;
use crate::scene::Scene;
use crate::settings::policy::*;
use crate::settings::{Direct, Settings, Strategy, shared_by};
use crate::timing::TimeModel;
use crate::transport::kernel::ByClass;
use crate::transport::photon::PhotonClass;
use model::{Best, Demand, Model};
use serde::{Deserialize, Serialize};
use std::array::from_fn;
use std::time::Instant;
use trial::{Site, Trial};

/// How a path is found, whatever the radii and counts.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Technique {
    /// In one way or in all.
    pub strategy: Strategy,
    /// The diffuse vertex at which camera paths are cut.
    pub merge_vertex: u32,
    /// How light is found that comes straight from a light source.
    pub direct: Direct,
}

/// What the choice is free to decide.
#[derive(Clone, Copy, Debug)]
pub struct Open {
    /// Strategy and merge vertex.
    pub strategy: bool,
    /// Direct light.
    pub direct: bool,
    /// The merge radius.
    pub radius: bool,
    /// The radius for photons without a diffuse bounce.
    pub caustic_radius: bool,
}

/// A technique at its best radii and counts.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Scored {
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
pub struct Chosen {
    /// The best first, then the others.
    pub candidates: Vec<Scored>,
    /// What the pilot took, seconds.
    pub seconds: f64,
}

impl Technique {
    /// That of some settings.
    pub fn of(settings: &Settings) -> Self {
        let Settings { strategy, merge_vertex, direct, .. } = *settings;
        Self { strategy, merge_vertex, direct }
    }

    /// In words.
    pub fn describe(&self) -> String {
        let how = match self.strategy {
            Strategy::Mis => "merging at vertices 1 and 2 and connections, weighted".to_owned(),
            Strategy::Single => format!("merging at vertex {}", self.merge_vertex),
        };
        match self.direct {
            Direct::Connect => how,
            Direct::PhotonMap => how + ", direct light from the photon map",
        }
    }

    /// Settings with it at some radii.
    fn with(self, settings: &Settings, radii: ByClass<f32>) -> Settings {
        let Self { strategy, merge_vertex, direct } = self;
        let radius = radii[PhotonClass::LastVertex as usize];
        let caustic_radius = radii[PhotonClass::EveryVertex as usize];
        Settings { strategy, merge_vertex, direct, radius, caustic_radius, ..settings.clone() }
    }

    /// All that may be chosen beside `settings`.
    fn candidates(settings: &Settings, open: Open) -> Vec<Self> {
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

impl Scored {
    /// The settings that render so.
    pub fn apply(&self, settings: &Settings) -> Settings {
        let Self { technique, radius, caustic_radius, light_paths, camera_paths, .. } = *self;
        let Technique { strategy, merge_vertex, direct } = technique;
        let scale = shared_by(camera_paths);
        Settings {
            strategy,
            merge_vertex,
            direct,
            radius,
            caustic_radius,
            light_paths,
            camera_paths,
            mis_light_paths: light_paths,
            mis_c1: scale,
            mis_c2: scale,
            ..settings.clone()
        }
    }

    /// Its counts.
    pub fn counts(&self) -> Counts {
        Counts::uniform(self.light_paths, self.camera_paths)
    }
}

impl Chosen {
    /// The best of all.
    pub fn best(&self) -> &Scored {
        &self.candidates[0]
    }

    /// The best of the other techniques, if there are any.
    pub fn runner_up(&self) -> Option<&Scored> {
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

/// Tries what is open on the threads of the current rayon pool. Where the time is not known, a short pilot tells
/// how much a longer one may take.
///
/// # Errors
/// As [`Renderer::new`].
pub fn choose(
    scene: &Scene,
    accel: &dyn Intersect,
    settings: &Settings,
    (open, end): (Open, End),
) -> Result<Chosen> {
    let pilot = |budget| pilot(scene, accel, settings, (open, end), budget);
    let share = |time: f64| (TECHNIQUE_SHARE * time).min(TECHNIQUE_LONGEST);
    match end {
        End::Time(time) => pilot(share(time)),
        End::Error(_) => {
            let first = pilot(TECHNIQUE_TIME)?;
            let budget = share(first.best().seconds);
            if budget < LONGER_PILOT * TECHNIQUE_TIME {
                return Ok(first);
            }
            let again = pilot(budget)?;
            Ok(Chosen { seconds: first.seconds + again.seconds, ..again })
        }
    }
}

/// Tries all techniques at the radii of the settings, those that are not much worse at large ones, the best at their
/// best ones, in `budget` seconds.
fn pilot(
    scene: &Scene,
    accel: &dyn Intersect,
    settings: &Settings,
    (open, end): (Open, End),
    budget: f64,
) -> Result<Chosen> {
    let start = Instant::now();
    let candidates = Technique::candidates(settings, open);
    let [screening, wide, last] = ROUNDS.map(|share| share * budget);
    let each = screening / candidates.len() as f64;
    let site = Site::new(scene, accel, settings, each);
    let mut demand = Demand {
        end: match end {
            End::Time(time) => End::Time(time - budget),
            error => error,
        },
        most_light_paths: Renderer::most_light_paths_for(scene, settings),
        open,
        wished: [settings.caustic_radius, settings.radius],
        largest: LARGE,
    };
    let at = Radii::new(settings, open);

    let mut tried = Vec::new();
    for technique in candidates {
        let first = site.trial(&technique.with(settings, at.middle()), None, each)?;
        tried.push(Tried { technique, trials: vec![first] });
    }
    let weights = common_weights(&tried);
    keep_the_best(&mut tried, &weights, &demand);

    let trials: usize = tried.iter().map(|tried| tried.classes().count()).sum();
    let seconds = wide / trials as f64;
    // Areas of surfaces are worked out the first time, from triangles whose number goes as the squared radius.
    let first = tried.iter().map(|tried| tried.trials[0].first).fold(0.0, f64::max);
    demand.largest = ((seconds / first).sqrt() as f32).clamp(1.0, LARGE);
    for tried in &mut tried {
        let classes: Vec<_> = tried.classes().collect();
        for nests in classes {
            let settings = tried.technique.with(settings, at.large(nests, demand.largest));
            tried.trials.push(site.trial(&settings, Some(nests), seconds)?);
        }
    }
    let weights = common_weights(&tried);
    let score = |tried: &Tried| {
        let model =
            Model::new(tried.technique, &tried.trials, &weights, (settings.width, site.footprint));
        let best = model.best(&demand);
        (model, best)
    };
    let mut scored: Vec<(Model, Best)> = tried.iter().map(score).collect();
    // What looks best is tried where it does, until the best has been, or the time is over.
    loop {
        scored.sort_by(|one, other| one.1.rank(&demand).total_cmp(&other.1.rank(&demand)));
        if start.elapsed().as_secs_f64() > budget {
            scored.sort_by_key(|(_, best)| !best.tried);
        }
        let (model, best) = &mut scored[0];
        if best.tried {
            break;
        }
        let seconds = last / FINALISTS;
        let trial = site.trial(&best.settings(settings, model.technique), None, seconds)?;
        *best = model.tried_at(&trial, &weights, &demand);
    }
    let candidates = scored.iter().map(|(model, best)| best.scored(model.technique)).collect();
    Ok(Chosen { candidates, seconds: start.elapsed().as_secs_f64() })
}

/// A technique and its trials.
struct Tried {
    technique: Technique,
    trials: Vec<Trial>,
}

/// Merge radii of trials, by class of photons, scene units.
struct Radii {
    settings: ByClass<f32>,
    open: ByClass<bool>,
}

impl Radii {
    fn new(settings: &Settings, open: Open) -> Self {
        let Settings { radius, caustic_radius, .. } = *settings;
        // Where both are open, one ladder serves them.
        let caustic_radius = if open.caustic_radius { radius } else { caustic_radius };
        let mut own = Self { settings: [radius; 2], open: [open.radius; 2] };
        own.settings[PhotonClass::EveryVertex as usize] = caustic_radius;
        own.open[PhotonClass::EveryVertex as usize] = open.caustic_radius;
        own
    }

    fn scaled(&self, scale: ByClass<f32>) -> ByClass<f32> {
        from_fn(|class| self.settings[class] * if self.open[class] { scale[class] } else { 1.0 })
    }

    /// Those of the settings.
    fn middle(&self) -> ByClass<f32> {
        self.settings
    }

    /// Large ones for a class of photons, whose bias then stands out.
    fn large(&self, class: PhotonClass, largest: f32) -> ByClass<f32> {
        let mut scale = [SMALL; 2];
        scale[class as usize] = largest;
        self.scaled(scale)
    }
}

impl Tried {
    /// Classes of photons that it merges.
    fn classes(&self) -> impl Iterator<Item = PhotonClass> + use<> {
        let every = self.trials[0].any_at_every_vertex.then_some(PhotonClass::EveryVertex);
        [PhotonClass::LastVertex].into_iter().chain(every)
    }
}

/// Takes out what has much more noise than the best at the same radii, and, where direct light may be had otherwise,
/// its search in a photon map that is too thin to tell.
fn keep_the_best(tried: &mut Vec<Tried>, weights: &[f64], demand: &Demand) {
    tried.retain(|Tried { technique, trials }| {
        let is_choice = demand.open.direct && technique.direct == Direct::PhotonMap;
        !is_choice || model::found(&trials[0], weights) >= ENOUGH_FOUND
    });
    let noise2 = |tried: &Tried| demand.noise2(&tried.trials[0], weights);
    let least = tried.iter().map(noise2).fold(f64::INFINITY, f64::min);
    tried.retain(|tried| {
        // What is no number stays: one must.
        let is_hopeless = noise2(tried) > HOPELESS * least;
        !is_hopeless
    });
}

/// Weights of the pixels' squared errors, by their mean luminance in all trials: the same for all techniques,
/// whatever noise each has.
fn common_weights(tried: &[Tried]) -> Vec<f64> {
    let (mut luminance, mut count) = (Vec::new(), 0.0);
    for trial in tried.iter().flat_map(|tried| &tried.trials) {
        luminance.resize(trial.noise.pixels.len(), 0.0);
        for (sum, pixel) in luminance.iter_mut().zip(&trial.noise.pixels) {
            *sum += pixel.luminance;
        }
        count += 1.0;
    }
    luminance.iter_mut().for_each(|sum| *sum /= count);
    luminance_weights(&luminance)
}
