//! The media in which paths start: around the camera or the meters, and around the lights.

use super::lights::emitter::Emitter;
use super::{MediumState, Scene, View};
use crate::accel::Intersect;
use glam::Vec3;
use std::sync::Arc;

/// The media around the starts of paths.
#[derive(Debug)]
pub(super) struct StartMedia {
    /// Around the camera, or around each meter.
    eyes: Vec<MediumState>,
    /// Around each emitter. Environments and parallel light come from outside of all objects.
    emitters: Vec<MediumState>,
}

impl Scene {
    /// The scene with the media around its camera, meters and lights, which the boundaries around them tell. Without
    /// this, paths start outside of all objects.
    #[must_use]
    pub fn with_start_media(&self, accel: &dyn Intersect) -> Self {
        let Some(media) = self.media() else { return self.clone() };
        let at = |position: Vec3| media.at(self, accel, position);
        let eyes = match self.meters() {
            None => vec![at(self.camera.position())],
            Some(meters) => meters.list.iter().map(|meter| at(meter.position)).collect(),
        };
        let around = |emitter: &Emitter| emitter.position().map(at).unwrap_or_default();
        let emitters = self.lights().emitters().iter().map(around).collect();
        let start_media = StartMedia { eyes, emitters };
        Self { start_media: Some(Arc::new(start_media)), ..self.clone() }
    }

    /// The media around the camera, or around the meter of a point of the image.
    #[inline]
    pub fn media_at_eye(&self, view: &View, x: f32, y: f32) -> MediumState {
        let Some(StartMedia { eyes, .. }) = self.start_media.as_deref() else {
            return MediumState::default();
        };
        let [column, _] = view.full_image_point(x, y);
        eyes[column as usize % eyes.len()]
    }

    /// The media around the emitter of this index.
    #[inline]
    pub fn media_at_emitter(&self, emitter: u32) -> MediumState {
        let media = self.start_media.as_deref();
        let known = media.and_then(|media| media.emitters.get(emitter as usize));
        known.copied().unwrap_or_default()
    }
}
