//! The pilot: tries all techniques at the radii of the settings, those that are not much worse at
//! large radii, and lets the best race at their best radii.

use super::alternatives::Alternatives;
use super::beam_times::MOST_TIMED;
use super::candidate_cost::{Best, CandidateCost, InMedia};
use super::candidates::SceneTraits;
use super::compared_trials::disagrees;
use super::model::{ENOUGH_FOUND, ImageScale, LARGEST_SCALE, Model};
use super::race::{Track, race};
use super::seen_surfaces::width_seen;
use super::trial::{Trial, missed_share};
use super::trial_runner::TrialRunner;
use super::{End, FreeParameters, Selection, Technique};
use bdpm_core::base::error::Result;
use bdpm_core::film::radiance::luminance_weights;
use bdpm_core::render::NestedPart;
use bdpm_core::render::Renderer;
use bdpm_core::settings::{Bias, Direct, Settings};
use bdpm_core::transport::kernel::ByClass;
use bdpm_core::transport::photon::PhotonClass;
use std::array::from_fn;
use std::time::Instant;

/// Shares of the pilot's time for its rounds: all techniques, the better ones at large radii, the
/// race, and trials of how light paths split and of radii in media.
const ROUNDS: [f64; 4] = [0.2, 0.15, 0.45, 0.05];

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
///
/// # Errors
/// As [`Renderer::new`].
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
    let [screening, large, racing, last] = ROUNDS.map(|share| share * budget);
    let each = screening / candidates.len() as f64;
    let demand = CandidateCost {
        has_cache: false,
        shares_light: true,
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
    let radii = Radii::new(settings, open);
    let (tried, least_luminance) = (Vec::new(), 0.0);
    let mut pilot = Pilot {
        settings,
        demand,
        runner,
        radii,
        start,
        budget,
        tried,
        least_luminance,
        refuted: Vec::new(),
    };
    pilot.screen(candidates, each)?;
    pilot.try_large_radii(large)?;
    let finalists = pilot.finish(racing, last)?;
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
    radii: Radii,
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
            let settings = technique.with(self.settings, self.radii.settings);
            let first = self.trial(&settings, None, seconds)?;
            self.tried.push(Tried { technique, trials: vec![first], is_reserve: false });
        }
        for tried in &mut self.tried {
            tried.trials[0].set_missed_light(self.least_luminance);
        }
        let weights = common_weights(&self.tried);
        self.refute(&weights);
        let rank =
            |tried: &Tried| self.model(tried, &weights).best(&self.demand).rank(&self.demand);
        let ranks: Vec<f64> = self.tried.iter().map(rank).collect();
        let mut ranked: Vec<_> = ranks.into_iter().zip(self.tried.drain(..)).collect();
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

    /// Leaves out techniques whose trials disagree with that of path tracing.
    fn refute(&mut self, weights: &[f64]) {
        let Some(index) = self.tried.iter().position(|own| !own.technique.merges()) else { return };
        let path = self.tried.remove(index);
        let brightest = self.runner.brightest();
        let is_refuted = |own: &Tried| {
            let trial = &own.trials[0];
            let bias2 = self.model(own, weights).bias2_at(trial.radii);
            disagrees(trial, &path.trials[0], weights, (bias2, brightest))
        };
        let refuted: Vec<bool> = self.tried.iter().map(is_refuted).collect();
        let mut refuted = refuted.into_iter();
        let left_out = |own: &mut Tried| {
            let is_refuted = refuted.next().expect("one for each");
            if is_refuted {
                self.refuted.push(own.technique);
            }
            is_refuted
        };
        self.tried.extract_if(.., left_out).for_each(drop);
        self.tried.insert(index.min(self.tried.len()), path);
    }

    /// Runs a trial, and lets it know the light that all trials so far found at least.
    pub fn trial(
        &mut self,
        settings: &Settings,
        nests: Option<NestedPart>,
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
        for mut tried in std::mem::take(&mut self.tried) {
            let is_over = self.start.elapsed().as_secs_f64() > self.budget;
            if tried.technique.merges() && done >= MIN_AT_LARGE_RADII && is_over {
                // Too little is known of it.
                continue;
            }
            for nests in tried.classes() {
                let radii = self.radii.large(nests, tried.technique.strategy.has_cache());
                let settings = tried.technique.with(self.settings, radii);
                tried.trials.push(self.trial(
                    &settings,
                    Some(NestedPart::Class(nests)),
                    seconds,
                )?);
                done += u32::from(Some(nests) == tried.classes().next());
            }
            self.tried.push(tried);
        }
        let weights = common_weights(&self.tried);
        if self.tried.iter().any(|tried| !tried.is_thin(&weights)) {
            self.tried.retain(|tried| !tried.is_thin(&weights));
        }
        Ok(())
    }

    /// Lets the techniques that are left race at their best radii for `racing` seconds. Returns the
    /// best first.
    fn finish(&mut self, racing: f64, last: f64) -> Result<Vec<Finalist>> {
        self.demand.end = self.end_after_overrun();
        let weights = common_weights(&self.tried);
        let finalist = |tried: &Tried| {
            let model = self.model(tried, &weights);
            let best = model.best(&self.demand);
            let missed = missed_share(tried.trials[0].luminance(), self.least_luminance);
            Finalist { model, best, is_reserve: tried.is_reserve, missed }
        };
        let mut field: Vec<Finalist> = self.tried.iter().map(finalist).collect();
        for Finalist { model, best, .. } in &mut field {
            *best = self.with_beam_times((model, model.technique), *best, 1)?;
        }
        let track = Track {
            settings: self.settings,
            demand: self.demand,
            scale: self.scale(),
            runner: &mut self.runner,
        };
        let mut finalists = race(field, track, racing)?;
        let first = &mut finalists[0];
        first.best =
            self.with_beam_times((&first.model, first.model.technique), first.best, MOST_TIMED)?;
        self.try_splitting(first, &weights, last)?;
        self.try_medium_scales(first, &weights, last)?;
        Ok(finalists)
    }
}

impl Pilot<'_> {
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

    /// Tries the best candidate with light paths that split, and keeps the better of both. Other
    /// trials do without splitting: fewer light paths would tell less about rare light, and where
    /// noise is visible, they would draw it as spots.
    fn try_splitting(
        &mut self,
        Finalist { model, best, .. }: &mut Finalist,
        weights: &[f64],
        seconds: f64,
    ) -> Result<()> {
        let Some(technique) = model.technique.split().filter(|_| self.demand.open.splitting) else {
            return Ok(());
        };
        if matches!(self.demand.end, End::Time(_)) && best.is_noise_visible() {
            return Ok(());
        }
        let settings = best.settings(self.settings, technique);
        let mut trial = self.trial(&settings, None, seconds)?;
        // Paths that split take at least as long: this trial alone measures its times badly.
        trial.times = trial.times.at_least(&best.times());
        let split = model.tried_at(&trial, weights, &self.demand);
        let split = self.with_beam_times((model, technique), split, MOST_TIMED)?;
        if split.rank(&self.demand) < best.rank(&self.demand) {
            (*best, model.technique) = (split, technique);
        }
        Ok(())
    }
}

impl Tried {
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

/// Merge radii of trials, by class of photons, scene units.
struct Radii {
    settings: ByClass<f32>,
    open: ByClass<bool>,
}

impl Radii {
    fn new(settings: &Settings, open: FreeParameters) -> Self {
        let Settings { radius, caustic_radius, .. } = *settings;
        // Where both are open, both start from the larger radius.
        let caustic_radius = if open.caustic_radius { radius } else { caustic_radius };
        let mut own = Self { settings: [radius; 2], open: [open.radius; 2] };
        own.settings[PhotonClass::Caustic as usize] = caustic_radius;
        own.open[PhotonClass::Caustic as usize] = open.caustic_radius;
        own
    }

    /// A large radius for one class of photons, whose bias then stands out from the noise. That of
    /// a cache is never chosen.
    fn large(&self, class: PhotonClass, has_cache: bool) -> ByClass<f32> {
        let mut scale = [SMALLEST_SCALE; 2];
        if has_cache {
            scale[PhotonClass::Diffuse as usize] = 1.0;
        }
        scale[class as usize] = LARGEST_SCALE;
        from_fn(|class| self.settings[class] * if self.open[class] { scale[class] } else { 1.0 })
    }
}

/// Weights of the pixels' squared errors, by the mean luminance of all trials, so that all
/// techniques have the same weights.
fn common_weights(tried: &[Tried]) -> Vec<f64> {
    let (mut luminance, mut count) = (Vec::new(), 0.0);
    let used = tried.iter().filter(|own| !own.is_reserve);
    for trial in used.flat_map(|tried| &tried.trials) {
        luminance.resize(trial.noise.pixels.len(), 0.0);
        for (sum, pixel) in luminance.iter_mut().zip(&trial.noise.pixels) {
            *sum += pixel.luminance;
        }
        count += 1.0;
    }
    luminance.iter_mut().for_each(|sum| *sum /= count);
    luminance_weights(&luminance)
}
