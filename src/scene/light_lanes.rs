//! Connections of diffuse vertices with lights, sixteen at a time.

use super::Lights;
use super::emitter::Emitter;
use crate::diffuse::DiffuseVertices;
use crate::lanes::{LANES, Vec3s};

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
        samples.reach_points(&at.position, &points);
        samples
    }
}

/// One of two numbers. Vectors chosen by branches would keep the compiler from vector instructions.
#[inline(always)]
fn either(condition: bool, one: f32, other: f32) -> f32 {
    if condition { one } else { other }
}

impl LightSamples {
    /// Directions to point lights, and the irradiance from them, for vertices at `position`: lanes with a
    /// positive probability, which so far have the intensity. The others stay as they are.
    #[inline(always)]
    fn reach_points(&mut self, position: &Vec3s, probs: &[f32; LANES]) {
        for (lane, &prob) in probs.iter().enumerate() {
            let is_point = prob > 0.0;
            let to_light = self.target.get(lane) - position.get(lane);
            let distance2 = to_light.length_squared();
            // In the very place of a point there is no direction to it.
            let scale = either(distance2 > 0.0, (distance2 * prob).recip(), 0.0);
            let inverse = either(is_point, distance2.sqrt().recip(), 0.0);
            let kept = either(is_point, 0.0, 1.0);
            self.wi.set(lane, to_light * inverse + self.wi.get(lane) * kept);
            let scale = either(is_point, scale, 1.0);
            self.irradiance.set(lane, self.irradiance.get(lane) * scale);
        }
    }
}
