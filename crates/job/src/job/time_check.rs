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

/// Light paths that are not halved further.
const LEAST_LIGHT_PATHS: u32 = 2000;

impl RenderJob {
    /// The settings with as many of the paths that may be fewer as let the fewest iterations fit in
    /// the time: camera paths first, then light paths.
    pub(super) fn fitting(
        &self,
        scene: &Arc<Scene>,
        accel: &Arc<dyn Intersect>,
        settings: Settings,
    ) -> Result<Settings> {
        let [fewer_light, fewer_camera] = self.fewer_paths;
        let Some(time) = self.stop.time.filter(|_| fewer_light || fewer_camera) else {
            return Ok(settings);
        };
        let times = time_probe::min_times(scene, accel, &settings)?;
        let fits = |light_paths: u32, camera_paths: u32| {
            let one = times.iteration(light_paths.into(), f64::from(camera_paths));
            self.min_iterations as f64 * MEASURED * one <= time.as_secs_f64()
        };
        let Settings { mut light_paths, mut camera_paths, .. } = settings;
        if fewer_camera {
            let least = LEAST_CAMERA_PATHS.min(camera_paths);
            let fitting = (least..=camera_paths).rev().find(|own| fits(light_paths, *own));
            camera_paths = fitting.unwrap_or(least);
        }
        let allowed = settings.allowed_light_paths(light_paths);
        while fewer_light && light_paths > LEAST_LIGHT_PATHS && !fits(light_paths, camera_paths) {
            // Sets of light paths have a least number.
            let fewer = allowed.at_most(light_paths / 2);
            if fewer == light_paths {
                break;
            }
            light_paths = fewer;
        }
        Ok(Settings { light_paths, camera_paths, ..settings })
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
