//! The pilot: tries all techniques at the radii of the settings, those that are not much worse at
//! large radii, and lets the best race at their best radii.

use super::alternatives::Alternatives;
use super::beam_times::MOST_TIMED;
use super::candidate_cost::{Best, CandidateCost, InMedia};
use super::candidates::SceneTraits;
use super::compared_trials::{disagrees, is_lucky};
use super::model::{ENOUGH_FOUND, ImageScale, LARGEST_SCALE, Model};
use super::race::{Track, race};
use super::seen_surfaces::width_seen;
use super::trial::{Trial, missed_share};
use super::trial_runner::TrialRunner;
use super::{End, FreeParameters, Selection, Technique};
use bdpm_core::base::error::Result;
use bdpm_core::film::radiance::luminance_weights;
use bdpm_core::render::Renderer;
use bdpm_core::settings::{Bias, Direct, Settings};
use bdpm_core::transport::kernel::ByClass;
use bdpm_core::transport::photon::PhotonClass;
use std::array::from_fn;
use std::mem::take;
use std::time::Instant;

/// Shares of the pilot's time for its rounds: all techniques, the better ones at large radii, and
/// the race.
const ROUNDS: [f64; 3] = [0.2, 0.15, 0.5];

/// A technique is dropped if its squared error, at the best radii by one trial, exceeds the
/// smallest by this factor.
const HOPELESS: f64 = 8.0;

/// Techniques that are tried at large radii, even if the time is over.
const MIN_AT_LARGE_RADII: u32 = 2;

/// Radius of the class of photons whose bias a trial does not measure, over that of the settings:
/// the fit of both classes needs trials at different radii.
const SMALLEST_SCALE: f32 = 0.5;

/// Largest size of a scene, over the width that its image shows, that decides about radii.
const SEEN_WIDTHS: f64 = 4.0;

/// Share of the pilot's time for learning where light paths start.
const LEARNING_SHARE: f64 = 0.15;

/// Tries what is open, in about `budget` seconds.
pub fn run(
    renderer: &Renderer,
    open: FreeParameters,
    end: End,
    budget: f64,
    denoises: bool,
) -> Result<(Selection, Alternatives)> {
    let start = Instant::now();
    let own = with_seen_radii(renderer, open);
    let scaled = (own != *renderer.settings()).then(|| renderer.with_settings(own.clone()));
    let scaled = scaled.transpose()?;
    let renderer = scaled.as_ref().unwrap_or(renderer);
    let settings = &Settings { bias: open.bias(&own), ..own };
    let candidates = Technique::candidates(settings, open, SceneTraits::new(renderer, denoises));
    let [screening, large, racing] = ROUNDS.map(|share| share * budget);
    let each = screening / candidates.len() as f64;
    let demand = CandidateCost {
        strategy: settings.strategy,
        end: match end {
            End::Time(time) => End::Time((time - budget) * f64::from(renderer.config().ranks)),
            error => error,
        },
        ranks: renderer.config().ranks,
        max_light_paths: renderer.most_light_paths(),
        light_paths: None,
        open,
        corrects_bias: settings.bias == Bias::Reduce,
        requested: [settings.caustic_radius, settings.radius],
        in_media: InMedia { scale: settings.medium_scale, share: settings.medium_share },
        denoises,
    };
    let mut runner = TrialRunner::new(renderer, each)?;
    let guide = if open.guide { runner.learn_guide(LEARNING_SHARE * budget)? } else { None };
    let (tried, refuted, least_luminance) = (Vec::new(), Vec::new(), 0.0);
    let mut pilot =
        Pilot { settings, demand, runner, start, budget, tried, least_luminance, refuted };
    pilot.screen(candidates, each)?;
    pilot.try_large_radii(large)?;
    let finalists = pilot.finish(racing)?;
    let scored = |own: &Finalist| own.best.scored(own.model.technique);
    let candidates = finalists.iter().map(scored).collect();
    let alternatives = Alternatives::new(finalists, pilot.demand);
    let seconds = start.elapsed().as_secs_f64();
    let (refuted, refuted_trials) = (None, pilot.refuted);
    let selection = Selection { candidates, open, guide, seconds, refuted, refuted_trials };
    Ok((selection, alternatives))
}

/// The settings of a renderer. Where radii are open, they are not larger than those of a scene of
/// [`SEEN_WIDTHS`] times the width that the image shows, or the distance of what meters see: a
/// large ground says nothing about the objects on it.
fn with_seen_radii(renderer: &Renderer, open: FreeParameters) -> Settings {
    let (scene, accel) = renderer.scene_and_accel();
    let mut own = renderer.settings().clone();
    let size = (SEEN_WIDTHS * width_seen(scene, &**accel, &own)) as f32;
    let factor = (size / scene.size()).min(1.0);
    if open.radius {
        own.radius *= factor;
    }
    if open.caustic_radius {
        own.caustic_radius *= factor;
    }
    own
}

pub(super) struct Pilot<'a> {
    pub settings: &'a Settings,
    pub demand: CandidateCost,
    pub runner: TrialRunner<'a>,
    start: Instant,
    /// Seconds.
    budget: f64,
    tried: Vec<Tried>,
    /// Mean luminance that the image has at least, by all trials so far, W/(m^2 sr).
    least_luminance: f64,
    /// Techniques that the trial of path tracing refuted.
    refuted: Vec<Technique>,
}

/// A technique and its trials.
struct Tried {
    technique: Technique,
    trials: Vec<Trial>,
    /// It is kept for an image whose audit refutes all others, although it is much worse.
    is_reserve: bool,
}

/// A technique at its best radii and counts, in the last round.
pub struct Finalist {
    pub model: Model,
    pub best: Best,
    /// It is kept only for an image whose audit refutes all others.
    pub is_reserve: bool,
    /// Share of the light that its first trial lacked beside the others, on the same pixels.
    pub missed: f64,
}

impl Pilot<'_> {
    /// Tries techniques at the radii of the settings, each for `seconds`, and keeps those that are
    /// not much worse than the best.
    fn screen(&mut self, techniques: Vec<Technique>, seconds: f64) -> Result<()> {
        for technique in techniques {
            let settings = technique.with(self.settings, self.radii([1.0; 2]));
            let first = self.trial(&settings, None, seconds)?;
            self.tried.push(Tried { technique, trials: vec![first], is_reserve: false });
        }
        for tried in &mut self.tried {
            tried.trials[0].set_missed_light(self.least_luminance);
        }
        self.refute();
        let weights = self.weights();
        let tried = take(&mut self.tried).into_iter();
        let mut ranked: Vec<_> = tried.map(|own| (self.rank(&own, &weights), own)).collect();
        ranked.sort_by(|one, other| one.0.total_cmp(&other.0));
        // A photon map that few pixels see looks less noisy than it is.
        let is_known = |(_, tried): &&(f64, Tried)| !tried.is_thin(&weights[..]);
        let least = ranked.iter().find(is_known).unwrap_or(&ranked[0]).0;
        // A rank that is not a number is kept, so that at least one technique is left.
        ranked.retain_mut(|(rank, tried)| {
            let is_hopeless = *rank > HOPELESS * least;
            tried.is_reserve = is_hopeless && !tried.technique.merges();
            !is_hopeless || tried.is_reserve
        });
        self.tried = ranked.into_iter().map(|(_, tried)| tried).collect();
        Ok(())
    }

    fn rank(&self, tried: &Tried, weights: &[f64]) -> f64 {
        self.model(tried, weights).best(&self.demand).rank(&self.demand)
    }

    /// Leaves out techniques whose trials disagree with that of path tracing.
    fn refute(&mut self) {
        let Some(path) = self.tried.iter().find(|own| !own.technique.merges()) else { return };
        let merging = self.tried.iter().filter(|own| own.technique.merges());
        let weights = &median_weights(&merging.map(Tried::luminances).collect::<Vec<_>>());
        let brightest = self.runner.brightest();
        let is_refuted = |own: &&Tried| {
            let trial = &own.trials[0];
            let bias2 = self.model(own, weights).bias2_at(trial.radii);
            own.technique != path.technique
                && disagrees(trial, &path.trials[0], weights, (bias2, brightest))
        };
        let refuted = self.tried.iter().filter(is_refuted).map(|own| own.technique);
        self.refuted = refuted.collect();
        self.tried.retain(|own| !self.refuted.contains(&own.technique));
    }

    /// Weights by all trials, but for path tracing that hit a lamp by chance: its own luminance
    /// would make that noise look small.
    fn weights(&self) -> Vec<f64> {
        let known = self.tried.iter().filter(|own| !own.is_reserve && !self.is_lucky(own));
        let trials = known.flat_map(|own| &own.trials);
        common_weights(
            trials.map(|trial| trial.noise.pixels.iter().map(|own| own.luminance).collect()),
        )
    }

    /// Tests whether a technique whose pixels share no light hit a lamp by chance.
    fn is_lucky(&self, own: &Tried) -> bool {
        let shares = |own: &Tried| own.technique.strategy.shares_light();
        let others = self.tried.iter().filter(|own| shares(own)).map(Tried::luminances);
        !shares(own) && is_lucky(&own.luminances(), &others.collect::<Vec<_>>())
    }

    /// Runs a trial, and lets it know the light that all trials so far found at least.
    pub fn trial(
        &mut self,
        settings: &Settings,
        nests: Option<PhotonClass>,
        seconds: f64,
    ) -> Result<Trial> {
        let mut trial = self.runner.trial(settings, nests, seconds)?;
        if nests.is_none() {
            // At large radii light may leak through walls.
            self.least_luminance = self.least_luminance.max(trial.least_luminance());
        }
        trial.set_missed_light(self.least_luminance);
        Ok(trial)
    }

    /// Fits the trials of a technique so far. A bias that none of them measured is that of the
    /// prior.
    fn model(&self, tried: &Tried, weights: &[f64]) -> Model {
        Model::new(tried.technique, &tried.trials, weights, self.scale())
    }

    pub fn scale(&self) -> ImageScale {
        let [width, _] = self.settings.full_resolution();
        ImageScale { width, footprint: self.runner.footprint }
    }

    /// Tries the techniques that are left at large radii, the best first, while there is time.
    fn try_large_radii(&mut self, seconds: f64) -> Result<()> {
        let trials: usize = self.tried.iter().map(|tried| tried.classes().count()).sum();
        let seconds = seconds / trials.max(1) as f64;
        let mut done = 0;
        for mut tried in take(&mut self.tried) {
            let is_over = self.start.elapsed().as_secs_f64() > self.budget;
            if tried.technique.merges() && done >= MIN_AT_LARGE_RADII && is_over {
                // Too little is known of it.
                continue;
            }
            for nests in tried.classes() {
                let radii = self.large_radii(nests, tried.technique.strategy.has_cache());
                let settings = tried.technique.with(self.settings, radii);
                tried.trials.push(self.trial(&settings, Some(nests), seconds)?);
                done += u32::from(Some(nests) == tried.classes().next());
            }
            self.tried.push(tried);
        }
        let weights = self.weights();
        if self.tried.iter().any(|tried| !tried.is_thin(&weights)) {
            self.tried.retain(|tried| !tried.is_thin(&weights));
        }
        Ok(())
    }

    /// Lets the techniques that are left race at their best radii for `racing` seconds. Returns the
    /// best first.
    fn finish(&mut self, racing: f64) -> Result<Vec<Finalist>> {
        self.demand.end = self.end_after_overrun();
        let weights = self.weights();
        let finalist = |tried: &Tried| {
            let model = self.model(tried, &weights);
            let best = model.best(&self.demand);
            let missed = missed_share(tried.trials[0].luminance(), self.least_luminance);
            Finalist { model, best, is_reserve: tried.is_reserve, missed }
        };
        let mut field: Vec<Finalist> = self.tried.iter().map(finalist).collect();
        // Lanes measure at the share of the merges in media that the image would have.
        for Finalist { model, best, .. } in &mut field {
            *best = self.with_beam_times(model, *best, 1)?;
        }
        let track = Track {
            settings: self.settings,
            demand: self.demand,
            scale: self.scale(),
            runner: &mut self.runner,
        };
        let mut finalists = race(field, track, racing)?;
        let first = &mut finalists[0];
        first.best = self.with_beam_times(&first.model, first.best, MOST_TIMED)?;
        Ok(finalists)
    }

    /// The end of the image, if the rest of the pilot takes its share of the time: a pilot of less
    /// than a second takes longer than its budget.
    fn end_after_overrun(&self) -> End {
        let planned = (LEARNING_SHARE + ROUNDS[0] + ROUNDS[1]) * self.budget;
        let late = self.start.elapsed().as_secs_f64() - planned;
        let late = late.max(0.0) * f64::from(self.demand.ranks);
        match self.demand.end {
            End::Time(time) => End::Time((time - late).max(0.25 * time)),
            error => error,
        }
    }

    /// Merge radii of trials by class of photons, scene units: those that are open by a factor.
    fn radii(&self, factors: ByClass<f32>) -> ByClass<f32> {
        let CandidateCost { open, requested: [caustic, radius], .. } = self.demand;
        // Where both are open, both start from the larger radius.
        let start = [if open.caustic_radius { radius } else { caustic }, radius];
        let open = [open.caustic_radius, open.radius];
        from_fn(|class| start[class] * if open[class] { factors[class] } else { 1.0 })
    }

    /// A large radius for one class of photons, whose bias then stands out from the noise. That of
    /// a cache is never chosen.
    fn large_radii(&self, class: PhotonClass, has_cache: bool) -> ByClass<f32> {
        let mut factors = [SMALLEST_SCALE; 2];
        if has_cache {
            factors[PhotonClass::Diffuse as usize] = 1.0;
        }
        factors[class as usize] = LARGEST_SCALE;
        self.radii(factors)
    }
}

impl Tried {
    /// Luminance of each pixel by the first trial, W/(m^2 sr).
    fn luminances(&self) -> Vec<f64> {
        self.trials[0].noise.pixels.iter().map(|pixel| pixel.luminance).collect()
    }

    /// Whether direct light comes from a photon map that few pixels see.
    fn is_thin(&self, weights: &[f64]) -> bool {
        let found = self.trials.iter().map(|trial| trial.lit_pixels(weights));
        self.technique.direct == Direct::PhotonMap && found.fold(0.0, f64::max) < ENOUGH_FOUND
    }

    /// Classes of photons that it merges.
    fn classes(&self) -> impl Iterator<Item = PhotonClass> + use<> {
        let merges = self.technique.merges();
        let has_diffuse = merges && !self.technique.strategy.has_only_caustics();
        let has_caustics = merges && self.trials[0].has_caustic_photons;
        let all = [(PhotonClass::Diffuse, has_diffuse), (PhotonClass::Caustic, has_caustics)];
        all.into_iter().filter(|(_, is_merged)| *is_merged).map(|(class, _)| class)
    }
}

/// Weights of the pixels' squared errors by the median of several luminances of them. Rare hits of
/// path tracing do not change them: the differences at the hits would count for less than those
/// everywhere else, which they balance.
fn median_weights(luminances: &[Vec<f64>]) -> Vec<f64> {
    let pixels = luminances.first().map_or(0, Vec::len);
    let median = |pixel: usize| {
        let mut all: Vec<f64> = luminances.iter().map(|own| own[pixel]).collect();
        all.sort_by(f64::total_cmp);
        all[(all.len() - 1) / 2]
    };
    luminance_weights(&(0..pixels).map(median).collect::<Vec<_>>())
}

/// Weights of the pixels' squared errors by the mean of several luminances of them, so that all
/// techniques have the same weights.
pub fn common_weights(luminances: impl Iterator<Item = Vec<f64>>) -> Vec<f64> {
    let (mut mean, mut count) = (Vec::new(), 0.0);
    for own in luminances {
        mean.resize(own.len(), 0.0);
        mean.iter_mut().zip(own).for_each(|(sum, own)| *sum += own);
        count += 1.0;
    }
    mean.iter_mut().for_each(|sum| *sum /= count);
    luminance_weights(&mean)
}
