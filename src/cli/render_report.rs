//! Report of `bdpm render` at the end, as JSON and as text.

use super::dry_run;
use super::error_text::{error_text, interval_text};
use super::human_time;
use super::progress::Progress;
use super::render::Args;
use super::render_files::Writer;
use super::run_report::{RunReport, Seconds};
use super::scene_input::SceneInput;
use bdpm::RenderResult;
use bdpm::adaptive::autopilot::Promise;
use bdpm::adaptive::stopping::StoppedBy;
use bdpm::adaptive::technique::Selection;
use bdpm::job::{
    AuditReport, DENOISED_DECAY, DenoisedReport, RelativeError, RenderState, TimeForecast, Verdict,
};
use bdpm::render::bias_over_noise::BiasOverNoise;
use bdpm::render::block::{Block, CombinedImage};
use bdpm::render::photon_only_light::has_rare_sunlight;
use bdpm::settings::Settings;
use serde::Serialize;
use std::path::Path;

/// The result of a render, as JSON.
#[derive(Serialize)]
pub struct RenderReport<'a> {
    #[serde(flatten)]
    pub run: RunReport<'a>,
    /// True if the path counts were chosen automatically.
    pub automatic: bool,
    pub blocks: Vec<BlockReport>,
    /// Pooled RMS of the image and its standard error, W/(m^2 sr), and the RMS relative to the mean
    /// luminance.
    pub rms: Option<f64>,
    pub rms_error: Option<f64>,
    pub relative_rms: Option<f64>,
    /// Relative error of the image, if it was minimized.
    pub error: Option<RelativeError>,
    /// The promise that was made at the first choice of path counts.
    pub promise: Option<Promise>,
    /// Error and time of denoising.
    pub denoised: Option<DenoisedReport>,
    /// Mean luminance before denoising, W/(m^2 sr).
    #[serde(skip)]
    pub raw_luminance: f64,
    /// Techniques that were tried, the chosen one first.
    pub technique: Option<&'a Selection>,
    /// Forecast of the rendering time of this run, when half of it had passed.
    pub half_way: Option<TimeForecast>,
    pub merge_bias: Option<&'a BiasOverNoise>,
    /// Light that the scene may have and the image has not seen.
    pub unseen_light: Option<String>,
    /// Light whose beam merges in media blur.
    pub narrow_beam: Option<String>,
    /// Comparison of the image with its audit.
    pub audit: Option<&'a AuditReport>,
    /// Why there is no audit, if the scene is the reason.
    pub without_audit: Option<&'static str>,
    /// Size of the image that was rendered, if the picture in the files is larger.
    pub enlarged_from: Option<[u32; 2]>,
    pub exr: String,
    pub png: String,
    pub noise: Option<String>,
    pub report: Option<String>,
    pub checkpoint: Option<String>,
}

impl<'a> RenderReport<'a> {
    /// Report of a job that has ended and whose files were written.
    pub fn new(args: &Args, input: &SceneInput, result: &'a RenderResult, writer: &Writer) -> Self {
        let state = &result.state;
        let image = state.image();
        let luminance = image.mean_luminance();
        let name = |path: &Path| path.to_string_lossy().into_owned();
        let rms = result.rms.map(|(rms, _)| rms);
        Self {
            run: RunReport::new(input, result, writer.time),
            automatic: state.is_automatic,
            blocks: block_reports(&image, state.renderer.blocks()),
            rms,
            rms_error: result.rms.map(|(_, error)| error).filter(|error| error.is_finite()),
            relative_rms: rms.map(|rms| rms / luminance).filter(|share| share.is_finite()),
            promise: state.promise().copied(),
            error: result.error,
            denoised: result.denoised,
            raw_luminance: luminance,
            technique: result.selection(),
            half_way: state.half_way(),
            merge_bias: result.merge_bias.as_ref(),
            unseen_light: result.unseen_light.as_ref().map(|light| light.describe()),
            narrow_beam: result.narrow_beam.clone(),
            audit: result.audit.as_ref(),
            without_audit: reason_without_audit(result),
            enlarged_from: state.full_size.map(|_| state.provenance.settings.resolution().into()),
            exr: name(&writer.outputs.exr),
            png: name(&writer.outputs.png),
            noise: args.noise.as_deref().map(name),
            report: args.report.as_deref().map(name),
            checkpoint: writer.outputs.checkpoint.as_deref().map(name),
        }
    }
}

/// Why an automatic image with photons has no audit, if the scene is the reason.
fn reason_without_audit(result: &RenderResult) -> Option<&'static str> {
    let RenderState { renderer, is_automatic, .. } = &result.state;
    let may_have = *is_automatic && renderer.settings().has_photons() && result.audit.is_none();
    let (scene, _) = renderer.scene_and_accel();
    (may_have && has_rare_sunlight(scene)).then_some(
        "a small sun shines through clear glass or off mirrors: path tracing is no judge",
    )
}

/// Iterations at equal counts.
#[derive(Serialize)]
pub struct BlockReport {
    pub iterations: u64,
    pub light_paths: u32,
    /// Mean, minimum and maximum of the camera paths per pixel.
    pub camera_paths: f64,
    pub least_camera_paths: u32,
    pub most_camera_paths: u32,
    /// Weight of each iteration in the image.
    pub weight: f64,
    /// Pooled variance of one iteration as sampled, squared luminance.
    pub variance: Option<f64>,
}

/// Path counts and iterations of each block.
pub fn block_reports(image: &CombinedImage, blocks: &[Block]) -> Vec<BlockReport> {
    let report = |(block, &weight): (&Block, &f64)| BlockReport {
        iterations: block.film.iterations,
        light_paths: block.counts.light_paths,
        camera_paths: block.counts.camera_paths.mean(),
        least_camera_paths: block.counts.camera_paths.least(),
        most_camera_paths: block.counts.camera_paths.most(),
        weight,
        variance: block.film.pooled_variance().map(|(variance, _)| variance),
    };
    blocks.iter().zip(image.weights()).map(report).collect()
}

/// Prints the image, its path counts and `more` at the start of a job. `verb` says what the job
/// does.
pub fn announce(progress: &Progress, state: &RenderState, verb: &str, more: &str) {
    let counts = match state.is_automatic {
        true => "path counts chosen automatically".to_owned(),
        false => describe_counts(state.renderer.block(), &state.provenance.settings),
    };
    progress.note(&format!(
        "{verb} {}: {}, {counts}{more}, {} threads, {}",
        state.provenance.scene,
        dry_run::image(&state.provenance.settings),
        state.threads().current_num_threads(),
        state.accel_name,
    ));
}

/// The counts of a block in words.
pub fn describe_counts(block: &Block, settings: &Settings) -> String {
    let camera = &block.counts.camera_paths;
    let (min, max) = (camera.least(), camera.most());
    let camera = match min == max {
        true => min.to_string(),
        false => format!("{:.2} ({min} to {max})", camera.mean()),
    };
    counts_text(settings, block.counts.light_paths, &camera)
}

/// Path counts in words. Path tracing has no light paths, and a cache suffix paths instead.
pub fn counts_text(settings: &Settings, light_paths: u32, camera_paths: &str) -> String {
    let light = match settings.strategy {
        own if own.has_cache() && own.has_photons() => {
            format!("{light_paths} suffix paths and as many light paths, ")
        }
        own if own.has_cache() => format!("{light_paths} suffix paths, "),
        own if own.has_photons() => format!("{light_paths} light paths, "),
        _ => String::new(),
    };
    format!("{light}{camera_paths} camera paths per pixel")
}

/// The pooled RMS of the noise in words: as a luminance, and relative to the mean luminance.
pub fn rms_text(rms: f64, relative: f64) -> String {
    format!("pooled RMS {rms:.4}, {:.2} % of the mean luminance", 100.0 * relative)
}

/// The report: what was rendered, its error, and what would help. With `is_verbose` also how it was
/// rendered.
pub fn text(report: &RenderReport, is_verbose: bool) -> String {
    let run = &report.run;
    let stopped = match run.stopped_by {
        StoppedBy::Interrupt => ", interrupted",
        StoppedBy::Failure => ", ended by an error",
        StoppedBy::Iterations | StoppedBy::Time | StoppedBy::Target => "",
    };
    let iterations = if run.iterations == 1 { "iteration" } else { "iterations" };
    let mut text = format!(
        "{} and {}: {} {iterations} in {}{stopped}{}\n",
        report.exr,
        report.png,
        run.iterations,
        human_time(run.seconds.total),
        report.enlarged_from.map_or(String::new(), |[w, h]| format!(", enlarged from {w}x{h}")),
    );
    text += &error(report);
    text += &report.denoised.as_ref().map_or(String::new(), denoised);
    if report.denoised.is_some() {
        text += &changed_light(report.raw_luminance, run.mean_luminance);
    }
    text += &outlook(report);
    if let Some(unseen) = &report.unseen_light {
        text += &format!(
            "warning: no photon has shown any {unseen}; if there is such light, the image lacks it and \
             its error has no upper bound\n\
             help: render longer without --strategy, --light-paths and --camera-paths\n"
        );
    }
    if let Some(beam) = &report.narrow_beam {
        text += &format!(
            "warning: the beam of `{beam}` is narrower than merges in media, which blur it: the error of \
             the image has no upper bound\n\
             help: lower --medium-scale\n"
        );
    }
    text += &audit(report, is_verbose);
    if let Some(bias) = report.merge_bias
        && bias.share_beyond_noise >= 0.01
    {
        text += &format!(
            "warning: the merge bias exceeds the noise in {:.0} % of the image, up to {:.1} times\n\
             help: lower --radius, which lowers the bias\n",
            100.0 * bias.share_beyond_noise,
            bias.worst_over_noise
        );
    }
    if is_verbose {
        text += &format!(
            "{:.1} Mray/s, mean luminance {:.4}\n",
            run.rays_per_second / 1e6,
            run.mean_luminance
        );
        text += &processes(run);
        text += &report.technique.map_or(String::new(), technique);
        text += &path_counts(report);
    }
    text
}

/// Difference between the mean luminances of the denoised and the raw image from which on a warning
/// tells it.
const NOTABLE_CHANGE: f64 = 0.03;

/// A warning if denoising has changed the mean luminance from `raw` to `shown`, as it does where
/// flashes of few iterations look like light.
fn changed_light(raw: f64, shown: f64) -> String {
    let change = shown / raw - 1.0;
    if !change.is_finite() || change.abs() < NOTABLE_CHANGE {
        return String::new();
    }
    format!(
        "warning: denoising changed the mean luminance by {:+.0} %; that of the raw image is right but \
         for its noise\nhelp: render longer, or use --no-denoise for measurements\n",
        100.0 * change
    )
}

/// The time that would halve the error of an image that a time ended, or state it.
fn outlook(report: &RenderReport) -> String {
    let run = &report.run;
    if run.stopped_by != StoppedBy::Time || !report.automatic {
        return String::new();
    }
    let Seconds { total, render, .. } = run.seconds;
    let time = |factor: f64| human_time((total + (factor - 1.0) * render).ceil());
    let Some(RelativeError { total: error, .. }) = report.error else {
        return match report.relative_rms {
            None => format!("its error would be known after {}\n", time(4.0)),
            Some(_) => String::new(), // Other objectives state their noise.
        };
    };
    let denoised = report.denoised.as_ref().filter(|own| !own.is_raw);
    let (error, factor) = match denoised {
        None => (error, 4.0),
        Some(own) => match own.total_error {
            Some(error) => (error, 4f64.powf(DENOISED_DECAY.recip())),
            None => {
                return format!("the error after denoising would be known after {}\n", time(4.0));
            }
        },
    };
    if error == 0.0 {
        return String::new(); // Noise hides it.
    }
    format!("an error of {:.2} % would take about {}\n", 50.0 * error, time(factor))
}

/// The relative error of the image, or the noise if the relative error is not known.
fn error(report: &RenderReport) -> String {
    let percent = |share: f64| format!("{:.2} %", 100.0 * share);
    let may_blur = report.run.settings.shares_light();
    match (report.error, report.rms.zip(report.relative_rms)) {
        (Some(RelativeError { total, noise, bias, interval }), _) if may_blur => format!(
            "relative error {}: noise {}, {} {}\n",
            error_text(total, interval.as_ref()),
            percent(noise),
            bias_name(report),
            percent(bias)
        ),
        (Some(RelativeError { total, interval, .. }), _) => {
            format!("relative error {}, all of it noise\n", error_text(total, interval.as_ref()))
        }
        (None, Some((rms, relative))) => format!("noise: {}\n", rms_text(rms, relative)),
        (None, None) => String::new(),
    }
}

/// The larger of both systematic parts of the error.
fn bias_name(report: &RenderReport) -> &'static str {
    match report.audit {
        Some(audit) if audit.verdict == Verdict::Differs => "difference from the audit",
        _ => report.run.settings.strategy.bias_name(),
    }
}

/// The result of the audit, and what an earlier image was refuted for. Agreement is told if
/// `is_verbose`.
fn audit(report: &RenderReport, is_verbose: bool) -> String {
    let mut text = String::new();
    if let Some(refuted) = report.technique.and_then(|selection| selection.refuted.as_ref()) {
        text += &format!(
            "started again after {}: the audit refuted {}, whose image differed by {:.1} %\n",
            human_time(refuted.after),
            refuted.instead_of.technique.describe(),
            100.0 * refuted.difference
        );
    }
    if let Some(audit) = report.audit {
        text += &match audit.warning() {
            Some(warning) => format!("warning: {warning}\n"),
            None if is_verbose => format!("{}\n", audit.describe()),
            None => String::new(),
        };
    }
    if let Some(reason) = report.without_audit {
        text += &format!("not audited: {reason}\n");
    }
    text
}

/// Number of processes, and the share of the time that they spent on exchanging sums.
fn processes(run: &RunReport) -> String {
    if run.ranks < 2 {
        return String::new();
    }
    let Seconds { render, adding, waiting, .. } = run.seconds;
    let percent = |seconds: f64| 100.0 * seconds / (render + adding + waiting);
    format!(
        "{} processes of {} threads: {:.1} % of the time for adding their sums, {:.1} % for waiting\n",
        run.ranks,
        run.threads,
        percent(adding),
        percent(waiting)
    )
}

/// The error of the denoised image, and of the raw image.
fn denoised(report: &DenoisedReport) -> String {
    let Some(error) = &report.error else {
        if report.is_interrupted {
            return "not denoised: an interrupt ended the denoiser; denoise the file: bdpm denoise\n"
                .into();
        }
        if report.is_raw {
            return "not denoised: the raw image has a small enough error, so it is the result\n"
                .into();
        }
        return "denoised; the error afterward is not known after so few iterations\n".into();
    };
    let percent = |squared: f64| 100.0 * squared.max(0.0).sqrt();
    let mut text = format!(
        "denoised: relative error {}; {:.2} % of noise before denoising\n",
        error_text(report.total_error.unwrap_or(error.relative()), report.interval.as_ref()),
        percent(error.raw),
    );
    if report.is_raw {
        text += "the raw image has a smaller error than the denoised one, so it is the result\n";
    } else if error.worse >= 0.01 {
        text += &format!(
            "the denoiser alone has a larger error than the raw image in {:.0} % of the image ({:.2} % overall), so {:.0} % of the raw image are mixed in\n",
            100.0 * error.worse,
            percent(error.unmixed),
            100.0 * error.raw_share,
        );
    }
    if let Some(promise) = &report.promise
        && let Some(total) = report.total_error
    {
        text += &format!(
            "promised after {}: an error of {:.2} % when denoised; result: {:.2} %\n",
            human_time(promise.said_after),
            100.0 * promise.error,
            100.0 * total
        );
    }
    text
}

/// The chosen technique, and its advantage over the runner-up. Radii and guide are those of
/// photons, which path tracing does not have.
fn technique(chosen: &Selection) -> String {
    let best = chosen.best();
    let mut text = format!(
        "{} in {}: {}",
        if chosen.open.any() { "chosen" } else { "tried" },
        human_time(chosen.seconds),
        best.technique.describe()
    );
    if best.technique.strategy.has_photons() {
        text += &format!(", radius {:.4}, {:.4} for caustics", best.radius, best.caustic_radius);
        if best.technique.medium_query.is_some() {
            text += &format!(", {:.2} times as much in media", best.medium_scale);
            if best.medium_share < 1.0 {
                text += &format!(", of whose merges a share of {:.3} is done", best.medium_share);
            }
        }
        if let Some(guided) = chosen.used_guide() {
            text += &format!("; {}", guided.describe());
        }
    }
    if !chosen.refuted_trials.is_empty() {
        let names = chosen.refuted_trials.iter().map(|own| own.describe());
        let names = names.collect::<Vec<_>>().join(" and ");
        text += &format!("; the trial of path tracing refuted {names}");
    }
    // The runner-up may look too good if it was not tried at its best radii, so only its
    // disadvantages are shown.
    if let Some(next) = chosen.runner_up() {
        let name = next.technique.describe();
        let (error, seconds) = (next.error / best.error, next.seconds / best.seconds);
        if seconds > 1.005 {
            text += &format!("; the next best, {name}, would take {seconds:.2} times as long");
        } else if error > 1.005 {
            text += &format!("; the next best, {name}, would have {error:.2} times the error");
        }
    }
    text + "\n"
}

/// The chosen path counts, and the promise beside the result.
fn path_counts(report: &RenderReport) -> String {
    let (Some(promise), Some(last)) = (&report.promise, report.blocks.last()) else {
        return String::new();
    };
    let (min, max) = (last.least_camera_paths, last.most_camera_paths);
    let camera = match min == max {
        true => min.to_string(),
        false => format!("{:.2} ({min} to {max})", last.camera_paths),
    };
    let run = &report.run;
    let counts = counts_text(run.settings, last.light_paths, &camera);
    let mut text = format!("chosen: {counts} in each iteration\n");
    if let (Some(error), Some(result)) = (promise.error, report.error) {
        text += &format!(
            "promised after {}: a relative error of {:.2} %{}; result: {:.2} %\n",
            human_time(promise.said_after),
            100.0 * error,
            promise.interval.as_ref().map_or(String::new(), interval_text),
            100.0 * result.total
        );
    } else if let Some(rms) = report.rms {
        text += &format!(
            "promised after {}: a pooled RMS of {:.4} in {}; result: {rms:.4} in {}\n",
            human_time(promise.said_after),
            promise.rms,
            human_time(promise.seconds),
            human_time(run.seconds.total),
        );
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn changes_of_the_light_by_the_denoiser_are_told() {
        assert!(changed_light(1.0, 1.24).contains(" by +24 %;"));
        assert!(changed_light(1.0, 0.92).contains(" by -8 %;"));
        for (raw, shown) in [(1.0, 1.02), (0.0, 0.0), (1.0, 0.98)] {
            assert_eq!(changed_light(raw, shown), "");
        }
    }
}
