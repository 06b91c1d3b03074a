//! Connects vertices with points on lights: chooses a light for a receiver, then a point on it.

use super::emitter::Emitter;
use super::environment::Environment;
use super::regions::RegionProbs;
use super::triangle_points::TriangleQueue;
use super::{LightSample, Lights, Receiver};
use crate::base::rng::{Draw, Rng};
use crate::simd::LANES;
use glam::Vec3;

/// A light that was chosen for a receiver, by its index. The environment has the index after the
/// last emitter.
#[derive(Clone, Copy, Debug)]
pub(super) struct ChosenLight {
    pub index: usize,
    /// Probability of the choice.
    pub prob: f32,
    pub at: Receiver,
}

/// Receivers that connect with the environment.
#[derive(Default)]
struct Skies {
    count: usize,
    /// Their lanes among all receivers.
    lanes: [usize; LANES],
    receivers: [Receiver; LANES],
    /// Densities of the choice of the environment and the region; see
    /// [`Environment::connect_each`].
    probs: [f32; LANES],
    numbers: [[f64; 2]; LANES],
}

impl Skies {
    fn add(&mut self, number: usize, prob: f32, at: Receiver) {
        self.lanes[self.count] = number;
        self.receivers[self.count] = at;
        self.probs[self.count] = prob;
        self.count += 1;
    }
}

/// A point on a light to connect with, and the kind of the light.
#[derive(Clone, Copy, Debug)]
pub struct ConnectedLight {
    /// The point, and the irradiance if nothing is in between.
    pub sample: LightSample,
    /// The light has no surface.
    pub is_delta: bool,
    /// The light is at an infinite distance: the environment, or parallel light.
    pub is_parallel: bool,
    /// The light, and the probability of its choice.
    chosen: ChosenLight,
}

impl Lights {
    /// Chooses a point on a light to connect `at` with; `None` if that point cannot light it.
    pub fn connect(&self, at: Receiver, rng: &mut Rng) -> Option<LightSample> {
        let (index, prob) = self.by_estimate.choose(at, rng.next_f64())?;
        self.connect_chosen(ChosenLight { index, prob, at }, rng)
    }

    /// [`Self::connect`] with the kind of the light.
    pub fn connect_light(&self, at: Receiver, rng: &mut Rng) -> Option<ConnectedLight> {
        let (index, prob) = self.by_estimate.choose(at, rng.next_f64())?;
        let chosen = ChosenLight { index, prob, at };
        let sample = self.connect_chosen(chosen, rng)?;
        let emitter = self.emitters.get(index);
        Some(ConnectedLight {
            sample,
            is_delta: emitter.is_some_and(Emitter::is_delta),
            is_parallel: emitter.is_none_or(|own| own.parallel().is_some()),
            chosen,
        })
    }

    /// Connects another position with the same light without a surface; `None` if it does not shine
    /// there.
    pub fn connect_delta_again(
        &self,
        light: &ConnectedLight,
        position: Vec3,
    ) -> Option<LightSample> {
        // Lights without a surface draw no numbers.
        let at = Receiver { position, normal: None };
        self.connect_chosen(ChosenLight { at, ..light.chosen }, &mut Rng::default())
    }

    /// [`Self::connect`] for each of at most [`LANES`] receivers, by its own generator. Together
    /// they wait less for memory than one by one.
    pub fn connect_each<R: Draw>(
        &self,
        receivers: &[Receiver],
        rngs: &mut [R],
        samples: &mut [Option<LightSample>],
    ) {
        let mut chosen = [None; LANES];
        for ((chosen, &at), rng) in chosen.iter_mut().zip(receivers).zip(rngs.iter_mut()) {
            let choice = self.by_estimate.choose(at, rng.next_f64());
            *chosen = choice.map(|(index, prob)| ChosenLight { index, prob, at });
        }
        self.connect_each_chosen(&chosen[..receivers.len()], rngs, samples);
    }

    /// [`Self::connect`] with a light chosen by its power alone: a simple check of choices by
    /// estimate.
    ///
    /// # Panics
    /// If there are no lights.
    pub fn connect_by_power(&self, position: Vec3, rng: &mut Rng) -> Option<LightSample> {
        let (index, prob) = self.by_power.choose(rng.next_f64());
        let at = Receiver { position, normal: None };
        self.connect_chosen(ChosenLight { index, prob, at }, rng)
    }

    #[inline(never)] // point lights do not call it: see `connect_all`
    pub(super) fn connect_chosen(&self, chosen: ChosenLight, rng: &mut Rng) -> Option<LightSample> {
        let mut samples = [None];
        self.connect_each_chosen(&[Some(chosen)], std::slice::from_mut(rng), &mut samples);
        samples[0]
    }

    /// Chooses points on the chosen lights, at most [`LANES`], to connect their receivers with,
    /// each by its own generator; `None` where the point cannot light the receiver.
    pub(super) fn connect_each_chosen<R: Draw>(
        &self,
        chosen: &[Option<ChosenLight>],
        rngs: &mut [R],
        samples: &mut [Option<LightSample>],
    ) {
        let (mut skies, mut triangles) = <(Skies, TriangleQueue)>::default();
        for (number, (chosen, rng)) in chosen.iter().zip(rngs.iter_mut()).enumerate() {
            samples[number] = None;
            let Some(ChosenLight { index, prob, at }) = *chosen else { continue };
            let Some(emitter) = self.emitters.get(index) else {
                skies.add(number, prob, at);
                continue;
            };
            match emitter.lone_triangle() {
                Some(shape) => triangles.add(number, shape, at.position, rng.next_2d()),
                None => samples[number] = emitter.connect(at.position, prob, rng),
            }
        }
        self.connect_triangles(&triangles, chosen, samples);
        self.choose_directions(&mut skies, rngs);
        self.connect_skies(&skies, samples);
        if self.has_weighted_guide() {
            for (sample, chosen) in samples.iter_mut().zip(chosen) {
                if let (Some(sample), Some(chosen)) = (sample, chosen) {
                    let ray = [sample.target, -sample.wi];
                    sample.relative /= self.guide_density(chosen.index, ray);
                }
            }
        }
    }

    /// Chooses the numbers of directions toward the environment.
    fn choose_directions<R: Draw>(&self, skies: &mut Skies, rngs: &mut [R]) {
        let count = skies.count;
        let mut regions = [(0, 1.0); LANES];
        let learned = if count > 0 { self.by_estimate.regions(skies.receivers[0]) } else { None };
        if let Some(first) = learned {
            let (mut probs, mut numbers) = ([first; LANES], [0.0; LANES]);
            for own in 0..count {
                // All have regions if one has.
                probs[own] = self.by_estimate.regions(skies.receivers[own]).unwrap_or(first);
                numbers[own] = rngs[skies.lanes[own]].next_f64();
            }
            RegionProbs::choose_each(&probs[..count], &numbers[..count], &mut regions[..count]);
        }
        for own in 0..count {
            let (region, density) = regions[own];
            let region = learned.map(|_| region);
            skies.probs[own] *= density;
            let rng = &mut rngs[skies.lanes[own]];
            skies.numbers[own] = Environment::connection_numbers(region, rng);
        }
    }

    fn connect_triangles(
        &self,
        triangles: &TriangleQueue,
        chosen: &[Option<ChosenLight>],
        samples: &mut [Option<LightSample>],
    ) {
        if triangles.numbers().is_empty() {
            return;
        }
        let points = triangles.points();
        for (lane, &number) in triangles.numbers().iter().enumerate() {
            let Some(ChosenLight { index, prob, .. }) = chosen[number] else { continue };
            samples[number] = self.emitters[index].connect_point(&points.get(lane), prob);
        }
    }

    fn connect_skies(&self, skies: &Skies, samples: &mut [Option<LightSample>]) {
        let count = skies.count;
        if count == 0 {
            return;
        }
        let mut own = [LightSample::default(); LANES];
        let Skies { numbers, probs, receivers, .. } = skies;
        let map = self.chosen_environment();
        map.connect_each(&numbers[..count], &probs[..count], receivers, &mut own[..count]);
        for (&number, own) in skies.lanes[..count].iter().zip(own) {
            samples[number] = Some(own);
        }
    }
}
