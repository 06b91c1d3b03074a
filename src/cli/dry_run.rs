//! `bdpm render --dry-run`: a description of the job, without an image.

use super::render_files::Outputs;
use super::render_report::counts_text;
use super::scene_input::SceneInput;
use super::{human_time, json};
use bdpm::adaptive::stopping::{Stop, Target};
use bdpm::adaptive::technique::{FreeParameters, Technique};
use bdpm::job::JobOutline;
use bdpm::render::MemoryNeed;
use bdpm::settings::Settings;
use serde::Serialize;
use std::path::Path;

/// Bytes of one MiB.
const MIB: f64 = (1u64 << 20) as f64;

/// Description of a render that was not made, as JSON.
#[derive(Serialize)]
struct DryRunReport<'a> {
    scene: &'a str,
    backend: &'a str,
    threads: usize,
    /// Settings, before a pilot chooses some of them.
    settings: &'a Settings,
    /// Names of the settings that a pilot would choose.
    chosen_by_pilot: Vec<&'static str>,
    /// True if the path counts are chosen during the render.
    automatic: bool,
    /// Stop conditions: seconds, number of iterations, relative error, pooled RMS.
    time: Option<f64>,
    iterations: Option<u64>,
    target_error: Option<f64>,
    target_rms: Option<Target>,
    /// Rendering time until the end, if it is known.
    seconds: Option<f64>,
    /// Bytes.
    memory: f64,
    available_memory: Option<f64>,
    exr: String,
    png: String,
}

/// Describes the job as text, or as JSON.
pub fn report(
    outline: &JobOutline,
    input: &SceneInput,
    outputs: &Outputs,
    as_json: bool,
) -> String {
    if !as_json {
        return text(outline, outputs);
    }
    let name = |path: &Path| path.to_string_lossy().into_owned();
    let Stop { time, error, target, .. } = outline.stop;
    json(&DryRunReport {
        scene: &outline.provenance.scene,
        backend: &outline.provenance.backend,
        threads: input.threads.current_num_threads(),
        settings: &outline.provenance.settings,
        chosen_by_pilot: outline.pilot.as_ref().map_or(Vec::new(), chosen),
        automatic: outline.is_automatic,
        time: time.map(|time| time.as_secs_f64()),
        iterations: outline.iterations,
        target_error: error,
        target_rms: target,
        seconds: outline.seconds,
        memory: outline.memory.total(),
        available_memory: outline.available_memory,
        exr: name(&outputs.exr),
        png: name(&outputs.png),
    })
}

/// Names of the settings that a pilot may choose.
fn chosen(free: &FreeParameters) -> Vec<&'static str> {
    let FreeParameters {
        strategy,
        direct,
        radius,
        caustic_radius,
        medium_query,
        medium_scale,
        medium_share,
        guide,
        sobol_set,
        splitting,
        bias,
    } = *free;
    let all = [
        (strategy, "strategy"),
        (direct, "direct"),
        (radius, "radius"),
        (caustic_radius, "caustic radius"),
        (medium_query || medium_scale || medium_share, "merges in media"),
        (guide, "guide"),
        (sobol_set, "Sobol sets"),
        (splitting, "splitting"),
        (bias, "bias"),
    ];
    all.into_iter().filter_map(|(is_free, name)| is_free.then_some(name)).collect()
}

fn text(outline: &JobOutline, outputs: &Outputs) -> String {
    let settings = &outline.provenance.settings;
    let pilot = match &outline.pilot {
        Some(free) => format!("chosen by a pilot: {}", chosen(free).join(", ")),
        None => Technique::of(settings).describe(),
    };
    let counts = match outline.is_automatic {
        true => "chosen during the render".to_owned(),
        false => counts_text(settings, settings.light_paths, &settings.camera_paths.to_string()),
    };
    let lines = [
        ("scene", outline.provenance.scene.clone()),
        ("image", image(settings)),
        ("technique", pilot),
        ("path counts", counts),
        ("stop", stop(outline)),
        ("time", time(outline)),
        ("memory", memory(outline)),
        ("output", output(outputs)),
    ];
    let lines = lines.map(|(name, value)| format!("{:<13}{value}\n", format!("{name}:")));
    lines.concat() + "dry run: nothing was rendered or written\n"
}

/// Size of an image, and its place in the full image.
pub fn image(settings: &Settings) -> String {
    let Settings { width, height, crop, .. } = settings;
    let place = crop.map_or(String::new(), |crop| format!(", {crop}"));
    format!("{width}x{height} pixels{place}")
}

fn output(outputs: &Outputs) -> String {
    let Outputs { exr, png, .. } = outputs;
    let replaced = if exr.exists() { ", in place of an existing image" } else { "" };
    format!("{} and {}{replaced}", exr.display(), png.display())
}

fn stop(outline: &JobOutline) -> String {
    let Stop { time, error, target, .. } = outline.stop;
    let mut ends = Vec::new();
    ends.extend(outline.iterations.map(|n| format!("after {n} iterations")));
    ends.extend(time.map(|time| format!("after {}", human_time(time.as_secs_f64()))));
    ends.extend(error.map(|error| format!("at a relative error of {:.2} %", 100.0 * error)));
    ends.extend(target.map(|target| match target {
        Target::Share(share) => {
            format!("at an RMS of {:.2} % of the mean luminance", 100.0 * share)
        }
        Target::Absolute(rms) => format!("at an RMS of {rms}"),
    }));
    if ends.is_empty() { "never: stop it by Ctrl-C".into() } else { ends.join(", or ") }
}

fn time(outline: &JobOutline) -> String {
    match outline.seconds {
        Some(seconds) if outline.is_automatic || outline.iterations.is_none() => {
            format!("at most about {}", human_time(seconds))
        }
        Some(seconds) => format!("about {} or longer", human_time(seconds)),
        None => "not known before the first iterations".into(),
    }
}

fn memory(outline: &JobOutline) -> String {
    let MemoryNeed { light_paths, image } = outline.memory;
    let mib = |bytes: f64| format!("{:.0} MiB", (bytes / MIB).ceil());
    let settings = &outline.provenance.settings;
    // A pilot may choose photons
    let photons = if settings.has_photons() || outline.pilot.is_some() {
        format!(" and {} for {} light paths", mib(light_paths), settings.light_paths)
    } else {
        String::new()
    };
    let is_open = outline.is_automatic && !photons.is_empty();
    let more = if is_open { ", more if more light paths are chosen" } else { "" };
    let available = outline.available_memory;
    let available = available.map_or(String::new(), |bytes| format!("; {} available", mib(bytes)));
    format!("{} for the image{photons}{more}{available}", mib(image))
}
