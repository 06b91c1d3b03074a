//! The media in which paths start: around the camera or the meters, and around the lights.

use super::lights::emitter::Emitter;
use super::{MediumState, Scene, View};
use crate::accel::Intersect;
use crate::base::math::Bounds;
use glam::Vec3;
use std::sync::Arc;

/// The media around the starts of paths.
#[derive(Debug)]
pub(super) struct StartMedia {
    /// Around the camera, or around each meter.
    eyes: Vec<StartMedium>,
    /// Around each emitter. Environments and parallel light come from outside of all objects.
    emitters: Vec<StartMedium>,
}

/// The media around the origins of some rays.
#[derive(Clone, Copy, Debug)]
enum StartMedium {
    /// All origins are in the same media.
    Same(MediumState),
    /// The surface of an object may lie between the origins, so that each has media of its own.
    Varies,
}

/// Pixels across and down, and samples of the lens across and down, of rays whose origins bound
/// those of a camera.
const EYE_SAMPLES: u32 = 9;

/// Widening of the box around origins, over its longest side: a lens is wider than the samples of
/// it.
const MARGIN: f32 = 0.1;

impl Scene {
    /// The scene with the media around its camera, meters and lights, which the boundaries around
    /// them tell. Without this, paths start outside of all objects.
    #[must_use]
    pub fn with_start_media(&self, accel: &dyn Intersect) -> Self {
        let Some(media) = self.media() else { return self.clone() };
        let at = |position: Vec3| StartMedium::Same(media.at(self, accel, position));
        let boundaries = self.boundary_boxes();
        let varies = |origins: &Bounds| boundaries.iter().any(|own| overlap(own, origins));
        let eyes = match self.meters() {
            None if varies(&self.eye_origins()) => vec![StartMedium::Varies],
            None => vec![at(self.camera.position())],
            Some(meters) => meters.list.iter().map(|meter| at(meter.position)).collect(),
        };
        let around = |emitter: &Emitter| match (emitter.position(), emitter.bounds()) {
            (Some(_), Some(bounds)) if varies(&bounds) => StartMedium::Varies,
            (Some(position), _) => at(position),
            (None, _) => StartMedium::Same(MediumState::default()),
        };
        let emitters = self.lights().emitters().iter().map(around).collect();
        let start_media = StartMedia { eyes, emitters };
        Self { start_media: Some(Arc::new(start_media)), ..self.clone() }
    }

    /// The media around `origin`, from which the camera, or the meter of a point of the image,
    /// sees.
    #[inline]
    pub fn media_at_eye(
        &self,
        accel: &dyn Intersect,
        view: &View,
        [x, y]: [f32; 2],
        origin: Vec3,
    ) -> MediumState {
        let Some(StartMedia { eyes, .. }) = self.start_media.as_deref() else {
            return MediumState::default();
        };
        let [column, _] = view.full_image_point(x, y);
        self.media_around(accel, eyes[column as usize % eyes.len()], origin)
    }

    /// The media around `origin`, from which the emitter of this index shines.
    #[inline]
    pub fn media_at_emitter(
        &self,
        accel: &dyn Intersect,
        emitter: u32,
        origin: Vec3,
    ) -> MediumState {
        let media = self.start_media.as_deref();
        let known = media.and_then(|media| media.emitters.get(emitter as usize));
        known.map_or(MediumState::default(), |own| self.media_around(accel, *own, origin))
    }

    fn media_around(&self, accel: &dyn Intersect, known: StartMedium, origin: Vec3) -> MediumState {
        match (known, self.media()) {
            (StartMedium::Same(state), _) => state,
            (StartMedium::Varies, Some(media)) => media.at(self, accel, origin),
            (StartMedium::Varies, None) => MediumState::default(),
        }
    }

    /// The boxes around all triangles of the boundaries of media.
    fn boundary_boxes(&self) -> Vec<Bounds> {
        let Some(media) = self.media() else { return Vec::new() };
        let boxes = self.placements().iter().zip(0..).flat_map(|(placement, place)| {
            let count = self.mesh(placement).triangles.len() as u32;
            let count = if media.bounds_medium(place) { count } else { 0 };
            (0..count).map(move |triangle| {
                let shape = self.placed_triangle(place, triangle);
                let corners = [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]].map(|uv| shape.point(uv));
                corners.into_iter().fold(Bounds::EMPTY, Bounds::with)
            })
        });
        boxes.collect()
    }

    /// A box around the origins of the camera's rays.
    fn eye_origins(&self) -> Bounds {
        let view = self.camera.view(EYE_SAMPLES, EYE_SAMPLES);
        let steps = || (0..=EYE_SAMPLES).map(|step| step as f32);
        let share = |step: f32| step / EYE_SAMPLES as f32;
        let mut bounds = Bounds::EMPTY.with(self.camera.position());
        for (x, y) in steps().flat_map(|x| steps().map(move |y| (x, y))) {
            // Image and lens in turn, since origins depend on one of them.
            for (at, lens) in [([x, y], [0.5; 2]), ([0.5; 2], [share(x), share(y)])] {
                let (ray, _) = view.ray(at[0] - 0.5, at[1] - 0.5, lens);
                bounds = bounds.with(ray.origin);
            }
        }
        let margin = Vec3::splat(MARGIN * bounds.longest_side());
        Bounds { min: bounds.min - margin, max: bounds.max + margin }
    }
}

fn overlap(a: &Bounds, b: &Bounds) -> bool {
    (a.min.cmple(b.max) & b.min.cmple(a.max)).all()
}
