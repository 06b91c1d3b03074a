//! Starts the image again if its first iterations show that the choice of the pilot was poor.

use super::state::RenderState;
use super::status::Status;
use super::step::Step;
use bdpm_auto::adaptive::count_policy::CountPolicy;
use bdpm_auto::adaptive::technique::{Selection, TimeShare};
use bdpm_core::base::error::Result;
use std::sync::{Arc, Mutex};

impl RenderState {
    /// Checks the choice of the pilot if that is due, and starts again with other settings if that
    /// pays. Returns true if it did. After an error the choice stays as it is.
    ///
    /// # Errors
    /// If the memory does not suffice for the new settings. The present image is kept.
    pub(super) fn revise_choice(&mut self) -> Result<bool> {
        let elapsed = self.elapsed().as_secs_f64();
        let done = self.clock.rendering_time();
        let left = self.stop.time.map(|time| (time.as_secs_f64() - elapsed).max(0.0));
        let expected_left = left.or(self.status.forecast.map(|forecast| forecast.seconds));
        let Some(expected_left) = expected_left else { return Ok(false) };
        let Some(mut revision) = self.revision.take() else { return Ok(false) };
        let selection = match &self.selection {
            Some(selection) if revision.is_due(&self.renderer, done, expected_left) => {
                selection.clone()
            }
            _ => {
                self.revision = Some(revision);
                return Ok(false);
            }
        };
        let is_revised = self.attempt(Step::Revision, |state| {
            let (renderer, time) = (&state.renderer, TimeShare { done, left });
            let revised = state.threads.install(|| revision.revise(renderer, &selection, time));
            let Some(selection) = revised else { return Ok(false) };
            state.start_again(selection)?;
            Ok(true)
        })?;
        self.revision = Some(revision);
        Ok(is_revised)
    }

    pub(super) fn start_again(&mut self, selection: Selection) -> Result<()> {
        let settings = selection.apply(&self.provenance.settings);
        let (config, assigned) = (*self.renderer.config(), self.renderer.assigned().clone());
        let threads = Arc::clone(&self.threads);
        let renderer = threads.install(|| self.renderer.with_settings(settings.clone()))?;
        // Rendering has taken some time: an interrupt must not end it without an image.
        self.renderer = renderer.configure(config)?.uninterrupted();
        self.renderer.assign(assigned);
        self.provenance.settings = settings;
        self.stop = self.stop.with_pilot_bias2(selection.best().bias.powi(2));
        if let CountPolicy::Automatic(autopilot) = &mut self.policy {
            **autopilot = autopilot.restarted(selection.best().times, self.stop.bias2);
        }
        self.status = Status::default();
        self.latest = Mutex::default();
        if let Some(denoising) = &mut self.denoising {
            denoising.latest = None; // It is of the image that was discarded.
        }
        self.history.clear();
        self.selection = Some(selection);
        Ok(())
    }
}
