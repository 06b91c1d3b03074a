//! Meters that measure irradiance: connections with light sources, also through panes.

use super::{CameraPass, CameraPaths, Connections};
use crate::accel::Ray;
use crate::base::math::{Rgb, uniform_disc};
use crate::scene::panes::PanePassage;
use crate::scene::{ConnectedLight, MediumState, Meter, Receiver, Surface};
use crate::transport::path_state::{PathState, PathStates};
use glam::Vec3;

/// Largest displacement of a meter in its plane over the distance of a light source.
const BESIDE: f32 = 1e-5;

/// Largest displacement of a meter in its plane for parallel light, over the size of the scene.
const BESIDE_PARALLEL: f32 = 1e-6;

impl CameraPaths {
    /// Connects the meter of a point of the image with a light source, for the path in a lane of
    /// `states`. No other technique contributes light that arrives straight from a source, or
    /// through sheets; nor that of the environment and of lights without a surface through slabs.
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
        let light = pass.scene.lights().connect_light(receiver, &mut state.rng);
        let origin = match &light {
            Some(light) if light.is_delta => beside(pass, meter, light, state.rng.next_2d()),
            _ => meter.position,
        };
        states.set(lane, &ray, &state);
        let Some(light) = light else { return };
        let media = pass.scene.media_at_eye(pass.accel, &pass.view, [x, y], origin);
        let segment = Ray::segment(light.sample.target, origin);
        if meters.may_have_panes && pass.accel.is_occluded(&segment) {
            let arrived = through_panes(pass, (origin, meter.normal), &light, media);
            self.pane_light.extend(arrived.map(|arrived| (state.path, arrived)));
            return;
        }
        let cos = light.sample.wi.dot(meter.normal).max(0.0);
        let path = Connections::path_in(state.path, media) | Connections::METER;
        let contribution = light.sample.irradiance * cos;
        self.queue_shadow_ray(path, contribution, light.sample.target, origin);
    }

    /// Adds the light that meters receive through panes.
    pub(super) fn add_pane_light(&mut self) {
        for (path, light) in self.pane_light.drain(..) {
            self.direct[path as usize] += light;
            if self.records_aovs {
                self.aovs[path as usize].emission += light;
            }
        }
    }
}

/// A point of the plane of a meter next to it. Meshes have holes of the size of rounding errors, at
/// the poles and seams of globes. A ray from the meter itself to a point may meet one of them every
/// time. The light would be connected through the hole, and arrive as photons through the glass.
fn beside(pass: &CameraPass, meter: &Meter, light: &ConnectedLight, numbers: [f32; 2]) -> Vec3 {
    let at = meter.position;
    // The targets of parallel light are at the box around the scene, which may be flat.
    let near = BESIDE * light.sample.target.distance(at);
    let reach = match light.is_parallel {
        true => near.min(BESIDE_PARALLEL * pass.scene.size()),
        false => near,
    };
    let reach = reach.max(4.0 * f32::EPSILON * at.abs().max_element());
    let [x, y] = uniform_disc(numbers);
    let (right, up) = meter.normal.any_orthonormal_pair();
    at + reach * (x * right + y * up)
}

/// Irradiance of a meter by a sample of a light that it sees through panes, W/m^2; `None` if
/// something else blocks it. Camera paths contribute light of surfaces behind slabs.
fn through_panes(
    pass: &CameraPass,
    (from, normal): (Vec3, Vec3),
    light: &ConnectedLight,
    media: MediumState,
) -> Option<Rgb> {
    let (scene, accel) = (pass.scene, pass.accel);
    let sample = &light.sample;
    let sight = if light.is_parallel {
        scene.sight_along(accel, from, sample.wi, media)?
    } else {
        scene.sight_to(accel, from, sample.target, media)?
    };
    let is_displaced = sight.slabs > 0 && !light.is_parallel;
    if is_displaced && !light.is_delta {
        return None;
    }
    // From the light, the meter seems to be beside its place.
    let irradiance = match is_displaced {
        true => scene.lights().connect_delta_again(light, from + sight.shift)?.irradiance,
        false => sample.irradiance,
    };
    let cos = sight.direction.dot(normal).max(0.0);
    Some(irradiance * sight.transmitted * (sight.nearness * cos))
}

/// The pane that a path meets on its straight way from a meter; `None` for other paths and
/// surfaces.
pub(super) fn pane_before_meter(
    pass: &CameraPass,
    surface: &Surface,
    state: &PathState,
) -> Option<PanePassage> {
    let is_wanted = state.history.is_straight() && pass.scene.measures_irradiance();
    is_wanted.then(|| pass.scene.pane_at(pass.accel, surface, state.history.media())).flatten()
}
