//! Chooses among local and distant lights by estimates of their contribution.

use super::Receiver;
use super::emitter::Emitter;
use super::environment::Environment;
use super::regions::RegionProbs;
use super::tree::LightTree;
use super::visibility::{Factors, MOST_DISTANT, Visibility, distant_slot};
use crate::base::math::luminance;
use glam::Vec3;
use std::sync::Arc;

/// A light without a position: parallel light or the environment, which no tree contains.
#[derive(Clone, Copy, Debug)]
struct DistantLight {
    /// Index among the emitters; the environment has the index after the last emitter.
    index: u32,
    /// Luminance of the irradiance of a surface that faces the light, W/m^2; for an environment the
    /// mean over all orientations.
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
    near: Arc<LightTree>,
    far: Vec<DistantLight>,
    /// Learned visibility of clusters of lights; without it nothing is known about occlusion.
    visibility: Option<Arc<Visibility>>,
}

/// Share of choices that goes evenly to the tree and all distant lights.
const EVEN_SHARE: f32 = 0.5;

/// This share with learned visibility.
const EVEN_SHARE_LEARNED: f32 = 0.2;

impl EstimateSampler {
    /// A sampler of all `emitters`.
    pub(super) fn new(emitters: &[Emitter]) -> Self {
        let own = || (0..).zip(emitters);
        let sun = |(index, emitter): (u32, &Emitter)| {
            let light = emitter.parallel()?;
            let irradiance = luminance(light.irradiance);
            Some(DistantLight { index, irradiance, toward: Some(-light.direction) })
        };
        let near = Arc::new(LightTree::new(own()));
        Self { near, far: own().filter_map(sun).collect(), visibility: None }
    }

    /// Sets or removes the visibility that choices take into account.
    pub(super) fn set_visibility(&mut self, visibility: Option<Arc<Visibility>>) {
        self.visibility = visibility;
    }

    /// Index of the environment if there is no other light: it needs no estimates.
    #[inline]
    fn sole_environment(&self) -> Option<usize> {
        match &self.far[..] {
            [DistantLight { index, toward: None, irradiance }] => {
                (self.near.is_empty() && *irradiance > 0.0).then_some(*index as usize)
            }
            _ => None,
        }
    }

    fn factors(&self, at: Receiver) -> Option<&Factors> {
        self.visibility.as_deref().map(|visibility| visibility.factors(at))
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

    /// Chooses a light for `at` by a uniform number: its index and probability; `None` if no light
    /// can light it.
    #[inline(never)] // keeps the loops over vertices short
    pub(super) fn choose(&self, at: Receiver, u: f64) -> Option<(usize, f32)> {
        if let Some(index) = self.sole_environment() {
            return Some((index, 1.0));
        }
        let factors = self.factors(at);
        let (index, prob) = if self.far.is_empty() {
            self.near.choose(at, u, factors)
        } else {
            self.choose_with_far(at, u, factors)
        }?;
        Some((index as usize, prob))
    }

    /// Probability that [`Self::choose`] takes the light with this index.
    #[inline(never)] // keeps the loops over vertices short
    pub(super) fn prob(&self, index: usize, at: Receiver) -> f32 {
        if self.sole_environment() == Some(index) {
            return 1.0;
        }
        let factors = self.factors(at);
        if self.far.is_empty() {
            return self.near.prob(index, at, factors);
        }
        let probs = SelectionProbs::new(self, at, factors);
        let mut far = self.far.iter().zip(self.far_estimates(at, factors));
        match far.find(|(far, _)| far.index as usize == index) {
            Some((_, estimate)) => probs.of(estimate),
            None => probs.of(probs.near) * self.near.prob(index, at, factors),
        }
    }

    /// Estimates of the irradiance from each distant light, W/m^2, times their factors if they were
    /// learned. theory.md (17a)
    fn far_estimates<'a>(
        &'a self,
        at: Receiver,
        factors: Option<&'a Factors>,
    ) -> impl Iterator<Item = f32> + Clone + 'a {
        self.far.iter().enumerate().map(move |(number, far)| {
            let factor = factors.map_or(1.0, |factors| factors.of_distant(number));
            far.estimate(at.normal) * factor
        })
    }

    /// Estimates ignore occlusion: by them alone a sun outside would take all choices from the
    /// lamps of a room. Half of the choices, or fewer if visibility was learned, therefore go
    /// evenly to all lights whose estimate is not 0.
    fn choose_with_far(
        &self,
        at: Receiver,
        mut u: f64,
        factors: Option<&Factors>,
    ) -> Option<(u32, f32)> {
        let probs = SelectionProbs::new(self, at, factors);
        for (light, estimate) in self.far.iter().zip(self.far_estimates(at, factors)) {
            let prob = probs.of(estimate);
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
        let (index, own) = self.near.choose(at, (u / f64::from(prob)).min(1.0), factors)?;
        Some((index, prob * own))
    }

    /// The learned probabilities of regions of the environment at `at`; `None` without learned
    /// visibility.
    pub(super) fn regions(&self, at: Receiver) -> Option<&RegionProbs> {
        self.visibility.as_ref()?.regions(at)
    }

    /// Probability that [`RegionProbs::choose_each`] takes a region, over its share of the power; 1
    /// without learned visibility.
    pub(super) fn region_density(&self, at: Receiver, region: usize) -> f32 {
        self.regions(at).map_or(1.0, |regions| regions.density(region))
    }

    /// Number of the environment among the distant lights.
    pub(super) fn environment_number(&self) -> Option<usize> {
        self.far.iter().position(|far| far.toward.is_none())
    }

    /// Slots whose visibility can be learned: clusters of the tree, and distant lights.
    pub(super) fn slots(&self) -> Vec<u8> {
        let far = (0..self.far.len().min(MOST_DISTANT)).map(distant_slot);
        self.near.slots().chain(far).collect()
    }

    /// Chooses a light of a slot for `at` by a uniform number: its index, and all slots whose
    /// visibility it shows, as a set of bits.
    pub(super) fn choose_in(&self, slot: u8, at: Receiver, u: f64) -> Option<(usize, u64)> {
        let distant = (0..self.far.len().min(MOST_DISTANT)).find(|&far| distant_slot(far) == slot);
        if let Some(number) = distant {
            return Some((self.far[number].index as usize, 1 << slot));
        }
        let index = self.near.choose_in(slot, at, u)?;
        Some((index as usize, self.near.slots_between(slot, index)))
    }
}

/// Probabilities of each distant light, and of the tree of the local ones.
struct SelectionProbs {
    /// Estimate of the tree's irradiance, W/m^2.
    near: f32,
    total: f32,
    /// Number of positive estimates.
    count: usize,
    /// Share of choices that ignores the estimates.
    even: f32,
}

impl SelectionProbs {
    fn new(lights: &EstimateSampler, at: Receiver, factors: Option<&Factors>) -> Self {
        let near = lights.near.estimate(at, factors);
        let far = lights.far_estimates(at, factors);
        let total = near + far.clone().sum::<f32>();
        let count = std::iter::once(near).chain(far).filter(|&one| one > 0.0).count();
        let even = if factors.is_some() { EVEN_SHARE_LEARNED } else { EVEN_SHARE };
        Self { near, total, count, even }
    }

    /// Probability of a light with this estimate; 0 if no light can light the point.
    /// theory.md (18)
    fn of(&self, estimate: f32) -> f32 {
        if !(estimate > 0.0 && self.total.is_finite()) {
            return 0.0;
        }
        (1.0 - self.even) * (estimate / self.total) + self.even / self.count as f32
    }
}
