//! The pilot: all techniques at the radii of the settings, those that are not much worse at large ones, the best at
//! their best ones.

use super::candidate_cost::{Best, CandidateCost};
use super::census::Surfaces;
use super::model::Model;
use super::trial::{Site, Trial};
use super::{End, FreeParameters, Selection, Technique};
use crate::base::error::Result;
use crate::film::radiance::luminance_weights;
use crate::render::Renderer;
use crate::settings::policy::*;
use crate::settings::{Bias, Direct, Settings, Strategy};
use crate::transport::kernel::ByClass;
use crate::transport::photon::PhotonClass;
use std::array::from_fn;
use std::f32::consts::SQRT_2;
use std::time::Instant;

/// Tries what is open, in about `budget` seconds.
///
/// # Errors
/// As [`Renderer::new`].
pub fn run(
    renderer: &Renderer,
    (open, end): (FreeParameters, End),
    budget: f64,
) -> Result<Selection> {
    let start = Instant::now();
    let own = renderer.settings();
    let settings = &Settings { bias: open.bias(own), ..own.clone() };
    let candidates = Technique::candidates(settings, open);
    let [screening, wide, last] = ROUNDS.map(|share| share * budget);
    let each = screening / candidates.len() as f64;
    let demand = CandidateCost {
        end: match end {
            End::Time(time) => End::Time((time - budget) * f64::from(renderer.config().ranks)),
            error => error,
        },
        ranks: renderer.config().ranks,
        most_light_paths: renderer.most_light_paths(),
        open,
        reduces: settings.bias == Bias::Reduce,
        wished: [settings.caustic_radius, settings.radius],
    };
    let mut site = Site::new(renderer, each)?;
    let guide = if open.guide { site.learn_guide(LEARNING_SHARE * budget)? } else { None };
    let at = Radii::new(settings, open);
    let mut pilot = Pilot { settings, demand, site, at, start, budget, tried: Vec::new() };
    pilot.screen(candidates, each)?;
    pilot.add_discs(each)?;
    pilot.widen(wide)?;
    let candidates = pilot.finish(last / FINALISTS)?;
    let candidates = candidates.iter().map(|(model, best)| best.scored(model.technique)).collect();
    Ok(Selection { candidates, open, guide, seconds: start.elapsed().as_secs_f64() })
}

struct Pilot<'a> {
    settings: &'a Settings,
    demand: CandidateCost,
    site: Site<'a>,
    at: Radii,
    start: Instant,
    /// Seconds.
    budget: f64,
    tried: Vec<Tried>,
}

/// A technique and its trials.
struct Tried {
    technique: Technique,
    trials: Vec<Trial>,
    surfaces: Surfaces,
    /// The largest radius of trials over that of the settings.
    largest: f32,
}

impl Pilot<'_> {
    /// Tries techniques at the radii of the settings, each for so many seconds, and keeps those that are not much
    /// worse than the best.
    fn screen(&mut self, techniques: Vec<Technique>, seconds: f64) -> Result<()> {
        for technique in techniques {
            let settings = technique.with(self.settings, self.at.middle());
            let first = self.site.trial(&settings, None, seconds)?;
            let asking = CENSUS_SHARE * self.budget;
            let surfaces = self.site.surfaces(&technique, self.at.reaches(), asking);
            self.tried.push(Tried { technique, trials: vec![first], surfaces, largest: LARGE });
        }
        let weights = common_weights(&self.tried);
        let rank = |tried: &Tried| {
            let best = self.model(tried, &weights).best(&self.demand);
            best.rank(&self.demand) * self.doubt(tried.technique)
        };
        let ranks: Vec<f64> = self.tried.iter().map(rank).collect();
        let mut ranked: Vec<_> = ranks.into_iter().zip(self.tried.drain(..)).collect();
        ranked.sort_by(|one, other| one.0.total_cmp(&other.0));
        // A photon map in which few pixels have found anything looks quiet.
        let is_known = |(_, tried): &&(f64, Tried)| !tried.is_thin(&weights[..]);
        let least = ranked.iter().find(is_known).unwrap_or(&ranked[0]).0;
        // What is no number stays: one must.
        ranked.retain(|(rank, _)| {
            let is_hopeless = *rank > HOPELESS * least;
            !is_hopeless
        });
        self.tried = ranked.into_iter().map(|(_, tried)| tried).collect();
        Ok(())
    }

    /// By how many times its squared error is taken to be more than trials tell.
    fn doubt(&self, technique: Technique) -> f64 {
        let is_rare = technique.strategy == Strategy::Single && self.site.mirrors_lamps_roughly();
        if is_rare { SEEN_BY_CHANCE } else { 1.0 }
    }

    /// What trials tell of a technique so far; its bias is what is typical where no trial tells it.
    fn model(&self, tried: &Tried, weights: &[f64]) -> Model {
        let Tried { technique, trials, surfaces, largest } = tried;
        let across = (self.settings.width, self.site.footprint);
        Model::new((*technique, *largest), trials, weights, across, surfaces)
    }

    /// Tries the best techniques whose areas take much of the time before they are known on discs, too.
    fn add_discs(&mut self, seconds: f64) -> Result<()> {
        // Discs count the opacity of translucent surfaces twice.
        if !self.demand.open.kernel || self.site.is_translucent() {
            return Ok(());
        }
        let (weights, reaches) = (common_weights(&self.tried), self.at.reaches());
        let takes_long = |tried: &&Tried| {
            let share =
                |reach| self.demand.share(&tried.trials[0], &weights, &tried.surfaces, reach);
            reaches.into_iter().any(|reach| share(reach) > DISCS_FROM)
        };
        let costly = self.tried.iter().filter(takes_long);
        let twins: Vec<_> = costly.filter_map(|tried| tried.technique.on_discs()).collect();
        if twins.is_empty() {
            return Ok(());
        }
        self.screen(twins.into_iter().take(MOST_ON_DISCS).collect(), seconds)
    }

    /// Tries what is left at large radii, the best first, as long as there is time.
    fn widen(&mut self, seconds: f64) -> Result<()> {
        let trials: usize = self.tried.iter().map(|tried| tried.classes().count()).sum();
        let seconds = seconds / trials as f64;
        let sampled = self.site.sampled();
        let mut widened = 0;
        for tried in &mut self.tried {
            if widened >= LEAST_WIDENED && self.start.elapsed().as_secs_f64() > self.budget {
                break;
            }
            // Areas that are worked out the first time must not take all of it.
            let [near, _] = self.at.reaches();
            let takes = |scale: f32| {
                let visits = (2 * TRIAL_CAMERA_PATHS).into();
                sampled * tried.surfaces.cost(near * f64::from(scale), visits)
            };
            while tried.largest > 1.0 && takes(tried.largest) > seconds {
                tried.largest = (tried.largest / SQRT_2).max(1.0);
            }
            let classes: Vec<_> = tried.classes().collect();
            for nests in classes {
                let radii = self.at.large(nests, tried.largest);
                let settings = tried.technique.with(self.settings, radii);
                tried.trials.push(self.site.trial(&settings, Some(nests), seconds)?);
            }
            widened += 1;
        }
        // Of the others too little is known.
        self.tried.truncate(widened as usize);
        let weights = common_weights(&self.tried);
        if self.tried.iter().any(|tried| !tried.is_thin(&weights)) {
            self.tried.retain(|tried| !tried.is_thin(&weights));
        }
        Ok(())
    }

    /// Tries what looks best where it does, until the best has been, or the time is over; the best first.
    fn finish(&mut self, seconds: f64) -> Result<Vec<(Model, Best)>> {
        let weights = common_weights(&self.tried);
        let score = |tried: &Tried| {
            let model = self.model(tried, &weights);
            let mut best = model.best(&self.demand);
            // Where no radius is open, all trials were at the very radii.
            best.tried = !self.demand.open.any_radius();
            (model, best, self.doubt(tried.technique))
        };
        let mut scored: Vec<(Model, Best, f64)> = self.tried.iter().map(score).collect();
        let Self { settings, demand, site, .. } = self;
        // By how many times trials have told more than was expected, at the most.
        let mut surprise = 1.0f64;
        loop {
            // One is tried in any case: that tells times, which counts follow, better than any other trial.
            let is_over = self.start.elapsed().as_secs_f64() > self.budget
                && scored.iter().any(|(_, best, _)| best.tried);
            // What was as little known may come out as much worse.
            let untried = if is_over { UNTRIED * surprise } else { 1.0 };
            let rank = |(_, best, doubt): &(Model, Best, f64)| {
                doubt * best.rank(demand) * if best.tried { 1.0 } else { untried }
            };
            scored.sort_by(|one, other| rank(one).total_cmp(&rank(other)));
            if scored[0].1.tried || is_over {
                return Ok(scored.into_iter().map(|(model, best, _)| (model, best)).collect());
            }
            let (model, best, _) = &mut scored[0];
            let settings = best.settings(settings, model.technique);
            let trial = site.trial(&settings, None, seconds)?;
            let expected = best.rank(demand);
            *best = model.tried_at(&trial, &weights, demand);
            surprise = surprise.max(best.rank(demand) / expected);
        }
    }
}

impl Tried {
    /// Whether direct light is looked for in a photon map in which few pixels have found anything.
    fn is_thin(&self, weights: &[f64]) -> bool {
        let found = self.trials.iter().map(|trial| trial.found(weights));
        self.technique.direct == Direct::PhotonMap && found.fold(0.0, f64::max) < ENOUGH_FOUND
    }

    /// Classes of photons that it merges.
    fn classes(&self) -> impl Iterator<Item = PhotonClass> + use<> {
        let every = self.trials[0].has_caustic_photons.then_some(PhotonClass::Caustic);
        [PhotonClass::Diffuse].into_iter().chain(every)
    }
}

/// Merge radii of trials, by class of photons, scene units.
struct Radii {
    settings: ByClass<f32>,
    open: ByClass<bool>,
}

impl Radii {
    fn new(settings: &Settings, open: FreeParameters) -> Self {
        let Settings { radius, caustic_radius, .. } = *settings;
        // Where both are open, one ladder serves them.
        let caustic_radius = if open.caustic_radius { radius } else { caustic_radius };
        let mut own = Self { settings: [radius; 2], open: [open.radius; 2] };
        own.settings[PhotonClass::Caustic as usize] = caustic_radius;
        own.open[PhotonClass::Caustic as usize] = open.caustic_radius;
        own
    }

    fn scaled(&self, scale: ByClass<f32>) -> ByClass<f32> {
        from_fn(|class| self.settings[class] * if self.open[class] { scale[class] } else { 1.0 })
    }

    /// Those of the settings.
    fn middle(&self) -> ByClass<f32> {
        self.settings
    }

    /// What photons are looked up within there, and at the largest, scene units.
    fn reaches(&self) -> [f64; 2] {
        let largest = |radii: ByClass<f32>| f64::from(radii[0].max(radii[1]));
        [largest(self.settings), largest(self.scaled([LARGE; 2]))]
    }

    /// Large ones for a class of photons, whose bias then stands out.
    fn large(&self, class: PhotonClass, largest: f32) -> ByClass<f32> {
        let mut scale = [SMALL; 2];
        scale[class as usize] = largest;
        self.scaled(scale)
    }
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
