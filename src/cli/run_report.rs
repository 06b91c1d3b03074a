//! Fields that the reports of `render` and `analyze` share.

use super::scene_input::SceneInput;
use bdpm::adaptive::stopping::StoppedBy;
use bdpm::job::{RenderState, Totals};
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

/// Wall-clock times. `light`, `camera` and `merge` are busy thread-seconds over the threads of all processes.
#[derive(Default, Serialize)]
pub struct Seconds {
    pub load: f64,
    pub build: f64,
    pub light: f64,
    pub camera: f64,
    pub merge: f64,
    pub render: f64,
    pub write: f64,
    /// Time from the start of the program, or of the job without one, to the report.
    pub total: f64,
    /// Times until the other processes were done, and until their sums were added.
    pub waiting: f64,
    pub adding: f64,
}

impl<'a> RunReport<'a> {
    /// Reports a run whose files took `write_time`.
    pub fn new(
        input: &SceneInput,
        state: &'a RenderState,
        stopped_by: StoppedBy,
        write_time: Duration,
    ) -> Self {
        let Totals { iterations: new, rays, photons, non_finite, times } = state.totals;
        let provenance = &state.provenance;
        let threads = input.threads.current_num_threads();
        let busy = |time: Duration| time.as_secs_f64() / threads as f64;
        let image = state.image();
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
            stopped_by,
            seconds: Seconds {
                load: input.load_time.as_secs_f64(),
                build: state.build_time.as_secs_f64(),
                light: busy(times.light),
                camera: busy(times.camera),
                merge: busy(times.merge),
                render: times.wall.as_secs_f64(),
                write: write_time.as_secs_f64(),
                total: state.elapsed().as_secs_f64(),
                waiting: state.exchanged.waiting.as_secs_f64(),
                adding: state.exchanged.adding.as_secs_f64(),
            },
            rays,
            rays_per_second: state.totals.rays_per_second(),
            photons_per_iteration: photons as f64 / new.max(1) as f64,
            mean_luminance: image.mean_luminance(),
            non_finite,
        }
    }
}
