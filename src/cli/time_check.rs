//! Whether anything can be rendered in the time that is given.

use super::loaded_scene::LoadedScene;
use super::{human_time, say};
use bdpm::adaptive::time_probe;
use bdpm::base::error::{Error, Result};
use bdpm::film::counts::Counts;
use std::time::Duration;

/// So many times the time that was given, an iteration is refused.
const FAR_OVER: f64 = 4.0;

/// So many times the time that was given, it is warned of.
const OVER: f64 = 1.5;

/// Shorter times are as good as this, seconds: whoever gives 0 wants the least that there is.
const LEAST_TIME: f64 = 1.0;

impl LoadedScene {
    /// Refuses counts of which the `least` number of iterations would take far longer than the `time`, which
    /// a quick measurement tells, and warns of those that would take somewhat longer.
    pub fn check_time(
        &self,
        time: Duration,
        least: u64,
        counts: &Counts,
        quiet: bool,
    ) -> Result<()> {
        let settings = &self.origin.settings;
        let measure = || time_probe::least_times(&self.scene, &self.accel, settings);
        let (light, camera) = (counts.light_paths, counts.camera_paths.mean());
        let iteration = self.threads.install(measure)?.iteration(light.into(), camera);
        let over = least as f64 * iteration / time.as_secs_f64().max(LEAST_TIME);
        if over < OVER {
            return Ok(());
        }
        let (what, take) = match least {
            1 => ("an iteration".into(), "takes"),
            _ => (format!("the least {least} iterations"), "take"),
        };
        let problem = format!(
            "{what} of {light} light paths and {camera} camera paths per pixel {take} about {}, longer \
             than --time {}",
            human_time(least as f64 * iteration),
            humantime::format_duration(time)
        );
        let advice = "lower --camera-paths, --light-paths or --resolution, or give more --time; \
                      --iterations instead of --time takes as long as it takes";
        if over >= FAR_OVER {
            return Err(Error::new(problem, advice));
        }
        if !quiet {
            say(&format!("warning: {problem}\nhelp: {advice}"));
        }
        Ok(())
    }
}
