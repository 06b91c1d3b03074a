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
        // Of point lights: the probability of their choice.
        let mut probs = [1.0; LANES];
        // Lanes with other lights: which, and the probability.
        let mut others = [(0, 0, 0.0); LANES];
        let mut other_count = 0;
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
                probs[lane] = prob;
            } else {
                others[other_count] = (lane, index, prob);
                other_count += 1;
            }
        }
        samples.reach_points(&at.position, &probs);
        for &(lane, index, prob) in &others[..other_count] {
            let (position, mut rng) = (at.position.get(lane), at.rng.get(lane));
            if let Some(light) = self.connect_chosen(index, prob, position, &mut rng) {
                samples.target.set(lane, light.target);
                samples.wi.set(lane, light.wi);
                samples.irradiance.set(lane, light.irradiance);
            }
            at.rng.set(lane, rng);
        }
        samples
    }
}

impl LightSamples {
    /// Directions from vertices at `position` to point lights that were chosen with these
    /// probabilities, and the irradiance there; so far it is the intensity.
    #[inline(always)] // as above
    fn reach_points(&mut self, position: &Vec3s, probs: &[f32; LANES]) {
        for (lane, &prob) in probs.iter().enumerate() {
            let to_light = self.target.get(lane) - position.get(lane);
            // In the very place of a point there is no direction to it; a choice would be a branch,
            // and keep the compiler from vector instructions.
            let distance2 = to_light.length_squared().max(1e-30);
            self.wi.set(lane, to_light * distance2.sqrt().recip());
            let irradiance = self.irradiance.get(lane) * (distance2 * prob).recip();
            self.irradiance.set(lane, irradiance);
        }
    }
}
