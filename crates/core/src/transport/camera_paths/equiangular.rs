//! Connections from points on camera rays near a light source (equiangular sampling, Kulla and
//! Fajardo 2012).
//!
//! The distances that paths fly seldom end near a small light source, where its light is strongest.
//! A second technique therefore connects a point of the same segment whose distance has a density
//! in proportion to the light of a point source. Both techniques are weighted by the balance
//! heuristic. theory.md, section 9a

use super::{CameraPass, CameraPaths, Connections};
use crate::accel::Ray;
use crate::base::rng::Rng;
use crate::scene::{Medium, Receiver, Scene};
use crate::transport::path_state::PathState;
use std::f32::consts::FRAC_PI_2;

/// Segments after more diffuse vertices have no second technique: their light is spread by then.
const MOST_VERTICES: u32 = 1;

/// Densities of distances along a ray that see equal angles from a point.
#[derive(Clone, Copy, Debug)]
pub(super) struct Equiangular {
    /// Distance of the foot of the perpendicular from the point, scene units.
    foot: f32,
    /// Distance of the point from the ray, scene units.
    height: f32,
    /// Angles of both ends of the segment, from the perpendicular.
    angles: [f32; 2],
}

impl Equiangular {
    /// For a segment of a length that may be infinite, and a point on a light source that is chosen
    /// for its start; `None` if no light source is.
    fn toward_light(scene: &Scene, ray: &Ray, length: f32, rng: &mut Rng) -> Option<Self> {
        let receiver = Receiver { position: ray.origin, normal: None };
        let light = scene.lights().connect(receiver, rng)?;
        let to_light = light.target - ray.origin;
        let foot = to_light.dot(ray.direction);
        let height = (to_light - foot * ray.direction).length();
        // On the ray itself the density would be a peak without width.
        let height = height.max(1e-4 * to_light.length()).max(f32::MIN_POSITIVE);
        let end = if length.is_finite() { ((length - foot) / height).atan() } else { FRAC_PI_2 };
        Some(Self { foot, height, angles: [(-foot / height).atan(), end] })
    }

    /// The distance of a uniform number.
    fn sample(&self, u: f32) -> f32 {
        let [start, end] = self.angles;
        self.foot + self.height * (start + u * (end - start)).tan()
    }

    /// Density of a distance, 1/scene unit.
    /// theory.md (37k)
    pub(super) fn density(&self, distance: f32) -> f32 {
        let [start, end] = self.angles;
        let along = distance - self.foot;
        self.height / ((end - start) * (self.height * self.height + along * along))
    }
}

impl CameraPaths {
    /// Connects a point of a segment that ends at this distance in a medium that scatters. Returns
    /// the densities of the technique, with which a vertex on the same segment is weighted.
    pub(super) fn connect_along(
        &mut self,
        pass: &CameraPass,
        medium: &Medium,
        (ray, length): (&Ray, f32),
        state: &mut PathState,
    ) -> Option<Equiangular> {
        if !pass.connects() || state.history.diffuse() > MOST_VERTICES || !medium.scatters() {
            return None;
        }
        let angles = Equiangular::toward_light(pass.scene, ray, length, &mut state.rng)?;
        let distance = angles.sample(state.rng.next_1d());
        if !(0.0..length).contains(&distance) {
            // Rounding may leave the segment.
            return Some(angles);
        }
        let position = ray.origin + distance * ray.direction;
        let receiver = Receiver { position, normal: None };
        if let Some(light) = pass.scene.lights().connect(receiver, &mut state.rng) {
            let phase = medium.phase(ray.direction, light.wi);
            let both = angles.density(distance) + medium.flight_density(distance, state.weight);
            // theory.md (37l)
            let scattered = medium.scattering * medium.transmittance(distance) / both;
            let mut contribution = state.weight * scattered * light.irradiance * phase;
            contribution *= self.connection_weight_in_medium(phase * light.inverse_pdf_w);
            if self.records_aovs {
                self.record_segment(state);
            }
            let path = Connections::path_in(state.path, state.history.media());
            self.queue_shadow_ray(path, contribution, light.target, position);
        }
        Some(angles)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn distances_have_their_density() {
        let angles = Equiangular { foot: 0.4, height: 0.1, angles: [-1.2, 1.1] };
        let [start, end] = [0.0, 1.0].map(|u| angles.sample(u));
        let steps = 100_000;
        let step = f64::from(end - start) / f64::from(steps);
        let at = |i: u32| start + ((f64::from(i) + 0.5) * step) as f32;
        let sum: f64 = (0..steps).map(|i| f64::from(angles.density(at(i)))).sum();
        assert!((sum * step - 1.0).abs() < 1e-4, "{}", sum * step);
        // The share below a distance is the number that gives it.
        let middle = angles.sample(0.3);
        let below = (0..steps).take_while(|&i| at(i) < middle);
        let share: f64 = below.map(|i| f64::from(angles.density(at(i)))).sum();
        assert!((share * step - 0.3).abs() < 1e-4, "{}", share * step);
    }
}
