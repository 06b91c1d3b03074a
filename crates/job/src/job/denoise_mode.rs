//! Whether an image is denoised.

use super::{RenderJob, Start};
use bdpm_auto::adaptive::stopping::Stop;
use bdpm_core::scene::Scene;

/// Whether the image is denoised.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Denoise {
    Never,
    /// If that is expected to pay.
    IfNoisy,
    Always,
}

impl RenderJob {
    pub(super) fn denoises(&self) -> bool {
        self.denoise != Denoise::Never
    }

    /// Whether an image may be denoised that nobody asked to denoise: what its samples tell is not
    /// asked for, and a time ends the render.
    pub(super) fn may_denoise(&self, scene: &Scene) -> bool {
        let Stop { iterations, time, target, error, .. } = self.stop;
        let is_timed =
            time.is_some() && iterations.is_none() && target.is_none() && error.is_none();
        let is_whole = self.shard.is_none() && matches!(self.start, Start::New);
        is_timed && is_whole && self.is_automatic() && !self.pixel_noise && scene.meters().is_none()
    }
}
