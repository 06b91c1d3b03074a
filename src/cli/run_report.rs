//! Fields that the reports of `render` and `analyze` share.

use super::scene_input::SceneInput;
use bdpm::RenderResult;
use bdpm::adaptive::stopping::StoppedBy;
use bdpm::film::radiance::{luminance, total};
use bdpm::job::Totals;
use bdpm::settings::Settings;
use serde::Serialize;
use std::time::Duration;

/// Scene, settings, work and times of a run.
#[derive(Serialize)]
pub struct RunReport<'a> {
    version: &'a str,
    scene: &'a str,
    fingerprint: String,
    backend: &'a str,
    /// Number of threads of each process.
    pub threads: usize,
    /// Number of processes.
    pub ranks: u32,
    /// Bytes that rank 0 received from the others.
    received_bytes: u64,
    pub settings: &'a Settings,
    /// Iterations of the image.
    pub iterations: u64,
    /// Iterations of this run.
    new_iterations: u64,
    pub stopped_by: StoppedBy,
    pub seconds: Seconds,
    /// Rays of this run.
    rays: u64,
    pub rays_per_second: f64,
    photons_per_iteration: f64,
    /// W/(m^2 sr).
    pub mean_luminance: f64,
    non_finite: u64,
}

/// Wall-clock times. `total` is the time from the start of the program to the report, files
/// included. `light`, `camera` and `merge` are busy thread-seconds over the threads of all
/// processes.
#[derive(Default, Serialize)]
pub struct Seconds {
    pub total: f64,
    pub load: f64,
    pub build: f64,
    pub pilot: f64,
    pub light: f64,
    pub camera: f64,
    pub merge: f64,
    pub render: f64,
    /// Choices of path counts, the audit, estimates of noise and bias, and denoising.
    pub choices: f64,
    pub audit: f64,
    pub estimates: f64,
    pub denoising: f64,
    pub write: f64,
    /// Times until the other processes were done, and until their sums were added.
    pub waiting: f64,
    pub adding: f64,
}

/// Mean luminance of the image as it is written: corrected for the merge bias, and denoised if
/// asked for.
fn mean_luminance(result: &RenderResult) -> f64 {
    let image = result.state.image();
    if image.bias_correction().is_none() && result.state.denoising.is_none() {
        return image.mean_luminance();
    }
    let pixels = &result.image;
    total(pixels, |pixel| luminance(pixel.as_dvec3())) / pixels.len() as f64
}

impl<'a> RunReport<'a> {
    /// Reports a run whose files took `write_time`.
    pub fn new(input: &SceneInput, result: &'a RenderResult, write_time: Duration) -> Self {
        let state = &result.state;
        let Totals { iterations: new, rays, photons, non_finite, times, .. } = state.totals;
        let provenance = &state.provenance;
        let threads = input.threads.current_num_threads();
        let busy = |time: Duration| time.as_secs_f64() / threads as f64;
        let (image, spent) = (state.image(), state.spent());
        Self {
            version: &provenance.version,
            scene: &provenance.scene,
            fingerprint: format!("{:016x}", provenance.fingerprint),
            backend: &provenance.backend,
            threads,
            ranks: state.exchanged.ranks,
            received_bytes: state.exchanged.bytes,
            settings: &provenance.settings,
            iterations: image.iterations(),
            new_iterations: new,
            stopped_by: result.stopped_by,
            seconds: Seconds {
                total: state.elapsed().as_secs_f64(),
                load: input.load_time.as_secs_f64(),
                build: state.build_time.as_secs_f64(),
                pilot: state.selection.as_ref().map_or(0.0, |selection| selection.seconds),
                light: busy(times.light),
                camera: busy(times.camera),
                merge: busy(times.merge),
                render: times.wall.as_secs_f64(),
                choices: spent.choices.as_secs_f64(),
                audit: spent.audit.as_secs_f64(),
                estimates: spent.estimates.as_secs_f64(),
                denoising: spent.denoising.as_secs_f64(),
                write: write_time.as_secs_f64(),
                waiting: state.exchanged.waiting.as_secs_f64(),
                adding: state.exchanged.adding.as_secs_f64(),
            },
            rays,
            rays_per_second: state.totals.rays_per_second(),
            photons_per_iteration: photons as f64 / new.max(1) as f64,
            mean_luminance: mean_luminance(result),
            non_finite,
        }
    }
}
