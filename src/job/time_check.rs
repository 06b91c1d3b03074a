//! Whether anything can be rendered in the time that is given.

use crate::accel::Intersect;
use crate::adaptive::time_probe;
use crate::base::error::{Error, Result};
use crate::film::counts::Counts;
use crate::scene::Scene;
use crate::settings::Settings;
use std::sync::Arc;
use std::time::Duration;

/// Factor over the given time from which on an iteration is refused.
const FAR_OVER: f64 = 4.0;

/// Factor over the given time from which on there is a warning.
const OVER: f64 = 1.5;

/// Times below this count as this, seconds: a time of 0 asks for the shortest render possible.
const SHORTEST_TIME: f64 = 1.0;

/// Estimates by a short measurement how long the `least` number of iterations at these counts takes. Returns a warning
/// if that is notably longer than `time`.
///
/// # Errors
/// If it is more than 4 times as long, or the measurement fails.
pub fn check_time(
    scene: &Arc<Scene>,
    accel: &Arc<dyn Intersect>,
    settings: &Settings,
    time: Duration,
    (least, counts): (u64, &Counts),
) -> Result<Option<String>> {
    let times = time_probe::least_times(scene, accel, settings)?;
    let (light, camera) = (counts.light_paths, counts.camera_paths.mean());
    let seconds = least as f64 * times.iteration(light.into(), camera);
    let over = seconds / time.as_secs_f64().max(SHORTEST_TIME);
    if over < OVER {
        return Ok(None);
    }
    let (what, take) = match least {
        1 => ("one iteration".into(), "takes"),
        _ => (format!("the first {least} iterations"), "take"),
    };
    let problem = format!(
        "{what} of {light} light paths and {camera} camera paths per pixel {take} about {seconds:.1} s, longer \
         than the time of {:.1} s",
        time.as_secs_f64()
    );
    let advice = "lower the camera paths, the light paths or the resolution, or allow more time; a number of \
                  iterations instead of a time takes as long as it takes";
    if over >= FAR_OVER {
        return Err(Error::new(problem, advice));
    }
    Ok(Some(format!("{problem}\nhelp: {advice}")))
}
