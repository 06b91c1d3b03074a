//! Chooses among local and distant lights by estimates of their contribution.

use super::Receiver;
use super::emitter::Emitter;
use super::environment::Environment;
use super::tree::LightTree;
use crate::base::math::luminance;
use glam::Vec3;

/// A light without a position: parallel light or the environment, which no tree contains.
#[derive(Clone, Copy, Debug)]
struct DistantLight {
    /// Index among the emitters; the environment has the index after the last emitter.
    index: u32,
    /// Luminance of the irradiance of a surface that faces the light, W/m^2; for an environment the mean over all
    /// orientations.
    irradiance: f32,
    /// Unit vector toward the light; `None` for an environment.
    toward: Option<Vec3>,
}

impl DistantLight {
    /// Estimate of the unoccluded irradiance, W/m^2.
    fn estimate(&self, normal: Option<Vec3>) -> f32 {
        let cos = match (self.toward, normal) {
            (Some(toward), Some(normal)) => toward.dot(normal).max(0.0),
            _ => 1.0,
        };
        self.irradiance * cos
    }
}

/// Chooses among a subset of a scene's lights.
#[derive(Clone, Debug, Default)]
pub(super) struct EstimateSampler {
    near: LightTree,
    far: Vec<DistantLight>,
}

impl EstimateSampler {
    /// A sampler of the `wanted` ones among `emitters`.
    pub(super) fn new(emitters: &[Emitter], wanted: impl Fn(&Emitter) -> bool) -> Self {
        let own = || (0..).zip(emitters).filter(|(_, emitter)| wanted(emitter));
        let sun = |(index, emitter): (u32, &Emitter)| match emitter {
            Emitter::Directional(light) => {
                let irradiance = luminance(light.irradiance);
                Some(DistantLight { index, irradiance, toward: Some(-light.direction) })
            }
            _ => None,
        };
        Self { near: LightTree::new(own()), far: own().filter_map(sun).collect() }
    }

    /// Adds or replaces the environment; `emitters` is the number of all emitters.
    pub(super) fn set_environment(&mut self, emitters: usize, environment: Option<&Environment>) {
        self.far.retain(|far| far.toward.is_some());
        self.far.extend(environment.map(|map| {
            // A quarter of the integral over all directions is the mean over all normals.
            // theory.md (18)
            let irradiance = 0.25 * luminance(map.integral());
            DistantLight { index: emitters as u32, irradiance, toward: None }
        }));
    }

    /// Chooses a light for `at` by a uniform number: its index and probability; `None` if no light can light it.
    #[inline(never)] // keeps the loops over vertices short
    pub(super) fn choose(&self, at: Receiver, u: f64) -> Option<(usize, f32)> {
        let (index, prob) = if self.far.is_empty() {
            self.near.choose(at, u)
        } else {
            self.choose_with_far(at, u)
        }?;
        Some((index as usize, prob))
    }

    /// Probability that [`Self::choose`] takes the light with this index.
    #[inline(never)] // keeps the loops over vertices short
    pub(super) fn prob(&self, index: usize, at: Receiver) -> f32 {
        if self.far.is_empty() {
            return self.near.prob(index, at);
        }
        let probs = SelectionProbs::new(self, at);
        match self.far.iter().find(|far| far.index as usize == index) {
            Some(far) => probs.of(far.estimate(at.normal)),
            None => probs.of(probs.near) * self.near.prob(index, at),
        }
    }

    /// Estimates ignore occlusion: by them alone a sun outside would take all choices from the lamps of a room.
    /// Half of the choices therefore go by the estimates, half evenly to all lights whose estimate is not 0.
    fn choose_with_far(&self, at: Receiver, mut u: f64) -> Option<(u32, f32)> {
        let probs = SelectionProbs::new(self, at);
        for light in &self.far {
            let prob = probs.of(light.estimate(at.normal));
            if u < f64::from(prob) {
                return Some((light.index, prob));
            }
            u -= f64::from(prob);
        }
        let prob = probs.of(probs.near);
        if prob <= 0.0 {
            // Rounding left a small rest of the last interval.
            return None;
        }
        let (index, own) = self.near.choose(at, (u / f64::from(prob)).min(1.0))?;
        Some((index, prob * own))
    }
}

/// Probabilities of each distant light, and of the tree of the local ones.
struct SelectionProbs {
    /// Estimate of the tree's irradiance, W/m^2.
    near: f32,
    total: f32,
    /// Number of positive estimates.
    count: usize,
}

impl SelectionProbs {
    fn new(lights: &EstimateSampler, at: Receiver) -> Self {
        let near = lights.near.estimate(at);
        let far = || lights.far.iter().map(|far| far.estimate(at.normal));
        let total = near + far().sum::<f32>();
        let count = std::iter::once(near).chain(far()).filter(|&one| one > 0.0).count();
        Self { near, total, count }
    }

    /// Probability of a light with this estimate; 0 if no light can light the point.
    /// theory.md (18)
    fn of(&self, estimate: f32) -> f32 {
        if !(estimate > 0.0 && self.total.is_finite()) {
            return 0.0;
        }
        0.5 * (estimate / self.total + 1.0 / self.count as f32)
    }
}
