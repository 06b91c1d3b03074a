//! Connections of diffuse vertices with lights, sixteen at a time.

use super::Lights;
use super::emitter::Emitter;
use crate::diffuse::DiffuseVertices;
use crate::lanes::{LANES, Vec3s};
use crate::math::Rgb;

/// A point on a light for each vertex; see [`LightSample`](super::LightSample).
#[derive(Clone, Copy, Debug, Default)]
pub struct LightSamples {
    /// Where to aim the shadow ray.
    pub target: Vec3s,
    /// Unit vector from the vertex to the light.
    pub wi: Vec3s,
    /// Irradiance on a surface that faces `wi`, W/m^2; black without a connection.
    pub irradiance: Vec3s,
}

impl Lights {
    /// [`Self::connect`] of each vertex. The arithmetic of point lights is done side by side.
    #[inline(always)] // part of the loop over vertices
    pub fn connect_all(&self, at: &mut DiffuseVertices) -> LightSamples {
        let mut samples = LightSamples::default();
        // Of point lights, at unit distance the intensity: the probability of their choice.
        let mut points = [0.0; LANES];
        let choices = at.rng.next_f64();
        let only = self.by_estimate.only();
        for (lane, _) in at.lanes() {
            let choose = || {
                let (position, normal) = (at.position.get(lane), at.normal.get(lane));
                self.by_estimate.choose(position, Some(normal), choices[lane])
            };
            let Some((index, prob)) = only.map(|index| (index, 1.0)).or_else(choose) else {
                continue;
            };
            if let Some(Emitter::Point { position, intensity }) = self.emitters().get(index) {
                samples.target.set(lane, *position);
                samples.irradiance.set(lane, *intensity);
                points[lane] = prob;
            } else {
                let (position, mut rng) = (at.position.get(lane), at.rng.get(lane));
                if let Some(light) = self.connect_chosen(index, prob, position, &mut rng) {
                    samples.target.set(lane, light.target);
                    samples.wi.set(lane, light.wi);
                    samples.irradiance.set(lane, light.irradiance);
                }
                at.rng.set(lane, rng);
            }
        }
        for (lane, prob) in points.into_iter().enumerate() {
            let to_light = samples.target.get(lane) - at.position.get(lane);
            let distance2 = to_light.length_squared();
            let wi = to_light * distance2.sqrt().recip();
            let irradiance = samples.irradiance.get(lane);
            let at_distance = irradiance * (distance2 * prob).recip();
            // In the very place of a point there is no direction to it.
            let at_distance = if distance2 > 0.0 { at_distance } else { Rgb::ZERO };
            let is_point = prob > 0.0;
            samples.wi.set(lane, if is_point { wi } else { samples.wi.get(lane) });
            samples.irradiance.set(lane, if is_point { at_distance } else { irradiance });
        }
        samples
    }
}
