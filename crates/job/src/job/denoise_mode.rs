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

    /// Whether the job renders a picture in a given time: nobody asks for what its samples tell.
    /// Such an image may be denoised, or rendered with fewer pixels.
    pub(super) fn is_timed_picture(&self, scene: &Scene) -> bool {
        let Stop { iterations, time, target, error, .. } = self.stop;
        let is_timed =
            time.is_some() && iterations.is_none() && target.is_none() && error.is_none();
        let is_whole = self.shard.is_none() && matches!(self.start, Start::New);
        is_timed && is_whole && self.is_automatic() && !self.pixel_noise && scene.meters().is_none()
    }
}
