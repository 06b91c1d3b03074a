//! The result of a job.

use super::audit_report::AuditReport;
use super::denoising::DenoisedReport;
use super::state::RenderState;
use super::step::Step;
use crate::output::denoise;
use crate::output::layers::LayerSelection;
use crate::output::recorded_camera::record;
use crate::output::recorded_error::{RecordedError, record_pooled_rms};
use crate::output::recorded_gamut::record_gamut;
use bdpm_auto::adaptive::error_interval::{ErrorInterval, SquaredPart};
use bdpm_auto::adaptive::plan::Plan;
use bdpm_auto::adaptive::stopping::{Convergence, StoppedBy, importance};
use bdpm_auto::adaptive::technique::Selection;
use bdpm_core::base::error::{Error, Result};
use bdpm_core::base::math::Rgb;
use bdpm_core::image_io::{Image, Layer, Value};
use bdpm_core::noise::Measure;
use bdpm_core::noise::file::{NoiseFile, PHOTONS_PER_LIGHT_PATH};
use bdpm_core::noise::image::NoiseImage;
use bdpm_core::render::bias_over_noise::BiasOverNoise;
use bdpm_core::render::block::Block;
use bdpm_core::render::photon_only_light::CausticLight;
use serde::Serialize;
use std::time::{Duration, Instant};

/// An image with its error and its plan.
pub struct RenderResult {
    /// Width and height, pixels.
    pub resolution: (u32, u32),
    /// Radiance, W/(m^2 sr), row by row from the top left; the denoised one if the job denoises.
    pub image: Vec<Rgb>,
    /// Error of the image relative to each pixel's luminance; `None` for a pooled objective, before
    /// the noise is known, or if the merge bias is not known.
    pub error: Option<RelativeError>,
    /// Error of the denoised image, if the job denoises.
    pub denoised: Option<DenoisedReport>,
    /// RMS of the noise as luminance, W/(m^2 sr), pooled over all pixels, and its standard error.
    pub rms: Option<(f64, f64)>,
    /// Merge bias, estimated from nested radii; `None` if the image is corrected.
    pub merge_bias: Option<BiasOverNoise>,
    /// Light that the scene may have and the image has not seen: its error has no upper bound.
    pub unseen_light: Option<CausticLight>,
    /// Light whose beam merges in media blur: the error of the image has no upper bound.
    pub narrow_beam: Option<String>,
    /// Comparison of the image with its audit, if it was audited.
    pub audit: Option<AuditReport>,
    /// Path counts, number and weight of all iterations. A job with this plan and seed renders the
    /// same image.
    pub plan: Plan,
    /// Reason for the end of the render.
    pub stopped_by: StoppedBy,
    /// Wall-clock time of this run: pilot, iterations, estimates of the error, and denoising.
    pub time: Duration,
    /// Sums, technique, promise, denoiser and history.
    pub state: RenderState,
}

/// Relative RMS error of an image: the root of the mean over pixels of squared errors over squared
/// luminances.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct RelativeError {
    /// Noise and bias together.
    pub total: f64,
    /// Noise alone.
    pub noise: f64,
    /// Merge bias alone: the estimate of the pilot, or of the image if its bias is corrected. If an
    /// audit refuted the image, the difference that it found.
    pub bias: f64,
    /// Range in which the true relative error should lie, if it is known.
    pub interval: Option<ErrorInterval>,
}

impl From<RelativeError> for RecordedError {
    fn from(RelativeError { total, noise, bias, interval }: RelativeError) -> Self {
        Self { total, noise, bias, interval }
    }
}

/// Noise, bias and error of the final image.
#[derive(Default)]
struct Summary {
    error: Option<RelativeError>,
    denoised: Option<DenoisedReport>,
    rms: Option<(f64, f64)>,
    merge_bias: Option<BiasOverNoise>,
}

impl Summary {
    fn new(state: &RenderState) -> Self {
        let image = state.image();
        let rms = image.pooled_variance().map(|(variance, error)| {
            let rms = variance.sqrt();
            (rms, 0.5 * error / rms)
        });
        // A corrected image has no bias left that exceeds the noise.
        let merge_bias = match image.bias_correction() {
            None => BiasOverNoise::new(state.renderer.blocks(), &image),
            Some(_) => None,
        };
        let objective = state.stop.objective;
        let convergence = Convergence::of(image, &importance(state.renderer.blocks(), objective));
        // Renders at given counts that stop at an error state it as well.
        let is_stated = state.is_automatic || state.stop.error.is_some();
        let error = is_stated.then(|| relative_error(state, &convergence)).flatten();
        Self { error, denoised: denoised_report(state, &convergence), rms, merge_bias }
    }
}

impl RenderResult {
    /// The image of a job that has ended. It is there even if the denoiser or an estimate fails.
    pub(super) fn new(mut state: RenderState, stopped_by: StoppedBy) -> Self {
        if let Err(error) = state.denoise() {
            state.failure.get_or_insert(error);
        }
        let audit = state.finish_audit();
        let start = Instant::now();
        let summary = state.attempt(Step::Result, |state| Ok(Summary::new(state)));
        state.clock.spent.estimates += start.elapsed();
        let Summary { error, denoised, rms, merge_bias } = summary.unwrap_or_else(|error| {
            state.failure.get_or_insert(error);
            Summary::default()
        });
        let image = state.image();
        let resolution = image.resolution();
        let plan = Plan::of_blocks(state.renderer.blocks(), image.weights());
        let pixels = match state.denoised() {
            Some(denoised) => denoised.image.clone(),
            None => image.mean(),
        };
        drop(image);
        let time = state.elapsed();
        Self {
            resolution,
            image: pixels,
            error,
            denoised,
            rms,
            merge_bias,
            unseen_light: state.unseen_light(),
            narrow_beam: state.narrow_beam(),
            audit,
            plan,
            stopped_by,
            time,
            state,
        }
    }

    /// The error after the first iteration that left the image with fewer iterations than wanted,
    /// or not denoised, if there was one.
    pub fn failure(&self) -> Option<&Error> {
        self.state.failure.as_ref()
    }

    /// The technique that the pilot chose, and the others that it compared, if it ran.
    pub fn selection(&self) -> Option<&Selection> {
        self.state.selection.as_ref()
    }

    /// Selected layers that the job accumulated, and the denoised image with its error.
    pub fn layers(&self, selection: &LayerSelection) -> Vec<Layer> {
        let image = self.state.image();
        let (shared, rows) = (self.state.renderer.shared(), 0..self.resolution.1);
        let mut layers = selection.layers(shared, &image, rows, &image.mean());
        layers.extend(self.state.denoised().into_iter().flat_map(denoise::layers));
        layers
    }

    /// Content of the image file: the image without denoising, the noise of each pixel (`rms`,
    /// luminance, W/(m^2 sr)) if it is known, the layers of [`Self::layers`], the relative errors
    /// of the image and of its denoised layer if they are known, and the settings and the plan that
    /// repeat the image.
    pub fn to_image_file(&self, selection: &LayerSelection) -> Image {
        let image = self.state.image();
        let pixels = image.mean();
        let mut layers = vec![Layer::rgb("", &pixels)];
        if let Some(rms) = image.rms() {
            layers.push(Layer { name: "rms".into(), channels: vec![("Y".into(), rms)] });
        }
        let (shared, rows) = (self.state.renderer.shared(), 0..self.resolution.1);
        layers.extend(selection.layers(shared, &image, rows, &pixels));
        layers.extend(self.state.denoised().into_iter().flat_map(denoise::layers));
        let mut metadata = self.state.provenance.to_metadata();
        record(self.state.camera(), &mut metadata);
        record_gamut(self.state.renderer.scene_and_accel().0, &mut metadata);
        metadata.insert("iterations".into(), Value::Number(image.iterations() as f64));
        if let Some((rms, _)) = self.rms {
            record_pooled_rms(&mut metadata, rms);
        }
        if let Some(error) = self.error {
            RecordedError::from(error).record(&mut metadata);
        }
        if let Some(error) = self.denoised.and_then(|denoised| denoised.recorded()) {
            error.record(&mut metadata);
        }
        let (width, height) = self.resolution;
        let mut file = Image { width, height, layers, metadata };
        self.plan.write_to(&mut file);
        file
    }

    /// The coefficients `a`, `b` and `f` of each pixel, of the block with the most measured
    /// iterations.
    ///
    /// # Errors
    /// If the job did not keep [`pixel_noise`](super::RenderJob::pixel_noise), or measured fewer
    /// than 2 iterations.
    pub fn noise_image(&self) -> Result<NoiseImage> {
        self.best_measured()?.noise_image()
    }

    /// The coefficients of [`Self::noise_image`], which `estimator` measured, as a file with scene
    /// and settings.
    ///
    /// # Errors
    /// As [`Self::noise_image`].
    pub fn noise_file(&self, estimator: Measure) -> Result<NoiseFile> {
        let block = self.best_measured()?;
        let RenderState { provenance, regions, totals, is_automatic, .. } = &self.state;
        let noise = block.noise_image()?;
        let mut file = NoiseFile::new((provenance, regions), &block.film, noise, estimator);
        if !is_automatic {
            let light_paths = totals.iterations as f64 * f64::from(provenance.settings.light_paths);
            let photons = Value::Number(totals.photons as f64 / light_paths);
            file.facts.insert(PHOTONS_PER_LIGHT_PATH.into(), photons);
        }
        Ok(file)
    }

    fn best_measured(&self) -> Result<&Block> {
        self.state.best_measured().ok_or_else(|| {
            Error::new("too few iterations to estimate the noise", "render more iterations")
        })
    }
}

fn denoised_report(state: &RenderState, convergence: &Convergence) -> Option<DenoisedReport> {
    let denoising = state.denoising.as_ref()?;
    let bias = match denoising.error() {
        Some(_) => convergence.squared_bias(&state.stop),
        None => SquaredPart::default(),
    };
    let report = denoising.report(bias);
    Some(DenoisedReport { interval: state.open_if_unknown(report.interval), ..report })
}

fn relative_error(state: &RenderState, convergence: &Convergence) -> Option<RelativeError> {
    // Where pixels share no light, there is no bias. Otherwise, no estimate means that it is
    // unknown.
    let may_blur = state.provenance.settings.shares_light();
    let has_bias = state.stop.bias2 > 0.0 || state.stop.difference.is_some();
    if may_blur && !has_bias && convergence.bias2.is_none() {
        return None;
    }
    let stop = &convergence.with_measured_bias(&state.stop);
    let total = convergence.error(stop, 1.0)?;
    let noise = convergence.weighted_variance?.sqrt();
    let interval = state.error_interval(convergence);
    Some(RelativeError { total, noise, bias: stop.bias2.sqrt(), interval })
}
