//! A choice among local lights and those from afar by an estimate of what they contribute.

use super::emitter::Emitter;
use super::environment::Environment;
use super::tree::LightTree;
use crate::base::math::luminance;
use glam::Vec3;

/// Light from afar: from nowhere in the scene, hence in no tree.
#[derive(Clone, Copy, Debug)]
struct DistantLight {
    /// Index among the emitters; that after the last one is the environment.
    index: u32,
    /// Luminance of the irradiance of a surface that faces it, W/m^2; of an environment the mean
    /// over all surfaces.
    irradiance: f32,
    /// Unit vector toward it; `None` if it is all around.
    toward: Option<Vec3>,
}

impl DistantLight {
    /// The irradiance if nothing is in between, W/m^2.
    fn estimate(&self, normal: Option<Vec3>) -> f32 {
        let cos = match (self.toward, normal) {
            (Some(toward), Some(normal)) => toward.dot(normal).max(0.0),
            _ => 1.0,
        };
        self.irradiance * cos
    }
}

/// Some of a scene's lights.
#[derive(Clone, Debug, Default)]
pub(in crate::scene) struct EstimateSampler {
    near: LightTree,
    far: Vec<DistantLight>,
}

impl EstimateSampler {
    /// Among the `wanted` ones of `emitters`.
    pub(in crate::scene) fn new(emitters: &[Emitter], wanted: impl Fn(&Emitter) -> bool) -> Self {
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

    /// Among these and light from all around, of so many emitters in all.
    pub(in crate::scene) fn set_environment(
        &mut self,
        emitters: usize,
        environment: Option<&Environment>,
    ) {
        self.far.retain(|far| far.toward.is_some());
        self.far.extend(environment.map(|map| {
            // A quarter of the integral over all directions is the mean over all normals.
            // theory.md (18)
            let irradiance = 0.25 * luminance(map.integral());
            DistantLight { index: emitters as u32, irradiance, toward: None }
        }));
    }

    /// Chooses by a uniform number, for a point with this normal (a surface that is lit from one
    /// side): the index among the emitters, or after the last one the environment, and its
    /// probability; `None` where none can light it.
    #[inline(never)] // keeps the loops over vertices short
    pub(in crate::scene) fn choose(
        &self,
        position: Vec3,
        normal: Option<Vec3>,
        u: f64,
    ) -> Option<(usize, f32)> {
        let (index, prob) = if self.far.is_empty() {
            self.near.choose(position, normal, u)
        } else {
            self.choose_with_far(position, normal, u)
        }?;
        Some((index as usize, prob))
    }

    /// Probability that [`Self::choose`] takes the light with this index.
    #[inline(never)] // as above
    pub(in crate::scene) fn prob(&self, index: usize, position: Vec3, normal: Option<Vec3>) -> f32 {
        if self.far.is_empty() {
            return self.near.prob(index, position, normal);
        }
        let shares = SelectionProbs::new(self, position, normal);
        let own = |far: &DistantLight| (far.index as usize == index).then(|| far.estimate(normal));
        match self.far.iter().find_map(own) {
            Some(estimate) => shares.of(estimate),
            None => shares.of(shares.near) * self.near.prob(index, position, normal),
        }
    }

    /// An estimate knows nothing of what is in between: a sun outside would hide the lamps of a
    /// room. Hence half of the choices are by the estimates, half are the same for all that are not 0.
    fn choose_with_far(
        &self,
        position: Vec3,
        normal: Option<Vec3>,
        mut u: f64,
    ) -> Option<(u32, f32)> {
        let shares = SelectionProbs::new(self, position, normal);
        for light in &self.far {
            let prob = shares.of(light.estimate(normal));
            if u < f64::from(prob) {
                return Some((light.index, prob));
            }
            u -= f64::from(prob);
        }
        let prob = shares.of(shares.near);
        if prob <= 0.0 {
            // Rounding has left a little of the last share.
            return None;
        }
        let (index, own) = self.near.choose(position, normal, (u / f64::from(prob)).min(1.0))?;
        Some((index, prob * own))
    }
}

/// How likely the choices are among lights from afar and the tree of the others.
struct SelectionProbs {
    /// Estimate of the tree.
    near: f32,
    total: f32,
    /// How many may contribute.
    count: usize,
}

impl SelectionProbs {
    fn new(lights: &EstimateSampler, position: Vec3, normal: Option<Vec3>) -> Self {
        let near = lights.near.estimate(position, normal);
        let far = || lights.far.iter().map(|far| far.estimate(normal));
        let total = near + far().sum::<f32>();
        let count = std::iter::once(near).chain(far()).filter(|&one| one > 0.0).count();
        Self { near, total, count }
    }

    /// Of one with this estimate; 0 if none can light the point.
    /// theory.md (18)
    fn of(&self, estimate: f32) -> f32 {
        if !(estimate > 0.0 && self.total.is_finite()) {
            return 0.0;
        }
        0.5 * (estimate / self.total + 1.0 / self.count as f32)
    }
}
