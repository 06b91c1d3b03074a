//! Checks that the given time suffices for an iteration.

use super::RenderJob;
use bdpm_auto::adaptive::time_probe;
use bdpm_core::accel::Intersect;
use bdpm_core::base::error::{Error, Result};
use bdpm_core::film::counts::Counts;
use bdpm_core::scene::Scene;
use bdpm_core::settings::Settings;
use std::sync::Arc;
use std::time::Duration;

/// Ratio of the estimated to the given time above which a job is refused.
const MAX_OVER: f64 = 4.0;

/// Ratio of the estimated to the given time above which the job warns.
const WARN_OVER: f64 = 1.5;

/// Minimum time for the comparison, seconds. Shorter times request the shortest possible render.
const MIN_TIME: f64 = 1.0;

/// Time of an iteration that lists all pairs over that of one that measures nothing, and areas that
/// are new: an estimate for the first iterations of large images.
const MEASURED: f64 = 2.5;

/// Minimum number of camera paths of which pairs exist.
const LEAST_CAMERA_PATHS: u32 = 2;

impl RenderJob {
    /// The settings, if they may not have fewer camera paths. Else with as many of them, up to
    /// their own number, as let the fewest iterations fit in the time.
    pub(super) fn fitting(
        &self,
        scene: &Arc<Scene>,
        accel: &Arc<dyn Intersect>,
        settings: Settings,
    ) -> Result<Settings> {
        let Some(time) = self.stop.time.filter(|_| self.fewer_camera_paths) else {
            return Ok(settings);
        };
        let times = time_probe::min_times(scene, accel, &settings)?;
        let fits = |camera_paths: &u32| {
            let one = times.iteration(settings.light_paths.into(), f64::from(*camera_paths));
            self.min_iterations as f64 * MEASURED * one <= time.as_secs_f64()
        };
        let least = LEAST_CAMERA_PATHS.min(settings.camera_paths);
        let camera_paths = (least..=settings.camera_paths).rev().find(fits).unwrap_or(least);
        Ok(Settings { camera_paths, ..settings })
    }
}

/// Estimates by a short measurement the time of `min_iterations` iterations at these path counts.
/// Returns a warning if it is notably longer than `time`.
///
/// # Errors
/// If it is more than 4 times as long, or the measurement fails.
pub fn check_time(
    scene: &Arc<Scene>,
    accel: &Arc<dyn Intersect>,
    settings: &Settings,
    time: Duration,
    (min_iterations, counts): (u64, &Counts),
) -> Result<Option<String>> {
    let times = time_probe::min_times(scene, accel, settings)?;
    let (light, camera) = (counts.light_paths, counts.camera_paths.mean());
    let seconds = min_iterations as f64 * times.iteration(light.into(), camera);
    let over = seconds / time.as_secs_f64().max(MIN_TIME);
    if over < WARN_OVER {
        return Ok(None);
    }
    let (what, take) = match min_iterations {
        1 => ("one iteration".into(), "takes"),
        _ => (format!("the first {min_iterations} iterations"), "take"),
    };
    let problem = format!(
        "{what} of {light} light paths and {camera} camera paths per pixel {take} about {seconds:.1} s, longer \
         than the time of {:.1} s",
        time.as_secs_f64()
    );
    let advice = "use fewer camera paths, fewer light paths or a lower resolution, allow more time, or set a number \
                  of iterations instead";
    if over >= MAX_OVER {
        return Err(Error::new(problem, advice));
    }
    Ok(Some(format!("{problem}\nhelp: {advice}")))
}
