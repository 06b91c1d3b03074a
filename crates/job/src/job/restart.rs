//! Starts the image again if its audit refutes the technique of the pilot.

use super::state::RenderState;
use super::status::Status;
use bdpm_auto::adaptive::autopilot::{Autopilot, AutopilotState};
use bdpm_auto::adaptive::count_policy::CountPolicy;
use bdpm_auto::adaptive::technique::Selection;
use bdpm_core::base::error::Result;
use std::sync::{Arc, Mutex};

impl RenderState {
    /// Starts again with another technique.
    ///
    /// # Errors
    /// If the memory does not suffice for the new settings. The present image is kept.
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
            let state = AutopilotState::new(selection.best().times, self.stop.bias2);
            **autopilot = Autopilot::new(state, autopilot.options);
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
