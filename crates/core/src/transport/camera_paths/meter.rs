//! Connections of meters that measure irradiance with light sources.

use super::{CameraPass, CameraPaths, Connections};
use crate::scene::Receiver;
use crate::transport::path_state::PathStates;

impl CameraPaths {
    /// Connects the meter of a point of the image with a light source, for the path in a lane of
    /// `states`. No other technique contributes light that arrives straight from a source.
    /// theory.md (5a)
    pub(super) fn connect_meter(
        &mut self,
        pass: &CameraPass,
        [x, y]: [f32; 2],
        states: &mut PathStates,
        lane: usize,
    ) {
        let Some(meters) = pass.scene.meters() else { return };
        let meter = meters.at(&pass.view, x, y);
        let receiver = Receiver { position: meter.position, normal: Some(meter.normal) };
        let (ray, mut state) = states.get(lane);
        let light = pass.scene.lights().connect(receiver, &mut state.rng);
        states.set(lane, &ray, &state);
        if let Some(light) = light {
            let contribution = light.irradiance * light.wi.dot(meter.normal).max(0.0);
            let origin = meter.position;
            let media = pass.scene.media_at_eye(pass.accel, &pass.view, [x, y], origin);
            let path = Connections::path_in(state.path, media) | Connections::METER;
            self.queue_shadow_ray(path, contribution, light.target, meter.position);
        }
    }
}
