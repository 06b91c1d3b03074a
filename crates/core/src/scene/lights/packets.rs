//! Starts light paths, and connects diffuse vertices with lights, sixteen at a time.
//!
//! The arithmetic of point lights is vectorized; other lights are processed one by one.

use super::emitter::Emitter;
use super::guide::Guide;
use super::{ChosenLight, Emission, PrimarySample, Receiver};
use crate::base::math::uniform_sphere;
use crate::base::rng::{unit_f32, unit_f64};
use crate::scene::Lights;
use crate::simd::draw::DrawLanes;
use crate::simd::sobol::DIMENSIONS;
use crate::simd::{LANES, Mask, Rngs, Vec3s};
use glam::Vec3;
use std::array::from_fn;
use std::f32::consts::PI;

/// Starts of sixteen light paths; see [`Emission`].
#[derive(Clone, Copy, Debug, Default)]
pub struct Emissions {
    /// Start points.
    pub origin: Vec3s,
    /// Unit directions.
    pub direction: Vec3s,
    /// Flux that each path carries, W.
    pub flux: Vec3s,
    /// Index of each path's emitter; the environment has the index after the last emitter.
    pub emitter: [u32; LANES],
}

/// The numbers that start sixteen light paths: 64 bits for each number of a [`PrimarySample`], the
/// lower half first.
#[derive(Clone, Copy, Debug)]
pub struct PrimarySamples([[[u32; LANES]; 2]; 5]);

/// Numbers of a [`PrimarySample`] by the dimension of the Sobol points that they take. The first
/// dimensions are the most evenly distributed together. Positions and directions come first,
/// because few scenes have many lights.
const SIDES: [usize; DIMENSIONS] = [1, 2, 3, 4, 0];

impl PrimarySamples {
    /// Independent numbers, those of [`primary_sample`](super::primary_sample).
    #[inline(always)] // as those below: parts of the loop over light paths
    pub fn independent(rngs: &mut Rngs) -> Self {
        Self([(); 5].map(|()| rngs.next_bits()))
    }

    /// Numbers whose upper halves are those of Sobol points.
    #[inline(always)]
    pub fn of_points(points: &[[u32; LANES]; DIMENSIONS], rngs: &mut Rngs) -> Self {
        let mut samples = Self::independent(rngs);
        for (side, words) in SIDES.into_iter().zip(points) {
            samples.0[side][1] = *words;
        }
        samples
    }

    /// The numbers of one path.
    #[inline(always)]
    fn get(&self, lane: usize) -> PrimarySample {
        self.0.map(|words| unit_f64(words.map(|word| word[lane])))
    }

    /// One number of each path in single precision.
    #[inline(always)]
    fn singles(&self, side: usize) -> [f32; LANES] {
        self.0[side][1].map(unit_f32)
    }
}

/// Vertices of sixteen paths that connect with lights; see [`Receiver`].
#[derive(Clone, Copy, Debug)]
pub struct Receivers<'a> {
    /// Paths that have a vertex.
    pub active: &'a Mask,
    /// The vertices.
    pub position: &'a Vec3s,
    /// Unit normals of their surfaces on the sides that receive.
    pub normal: &'a Vec3s,
}

/// A point on a light for each vertex; see [`LightSample`](super::LightSample).
#[derive(Clone, Copy, Debug, Default)]
pub struct LightSamples {
    /// Targets of the shadow rays.
    pub target: Vec3s,
    /// Unit vector from the vertex to the light.
    pub wi: Vec3s,
    /// Irradiance on a surface that faces `wi`, W/m^2; black without a connection.
    pub irradiance: Vec3s,
    /// Luminance of the flux of light paths that start at the targets, over that of all lights'
    /// power.
    pub relative: [f32; LANES],
    /// Reciprocals of the densities in solid angle, sr; 0 if no ray can hit the light.
    pub inverse_pdf_w: [f32; LANES],
}

/// Marks lanes without a point light.
const NO_POINT: u32 = u32::MAX;

impl Lights {
    /// [`Self::emit_at`], or [`Self::emit_guided`], for the first `count` lanes.
    ///
    /// # Panics
    /// If there are no lights.
    #[inline(always)] // part of the loop over light paths
    pub fn emit_all(
        &self,
        guide: Option<&Guide>,
        starts: &PrimarySamples,
        count: usize,
    ) -> Emissions {
        let mut emissions = Emissions::default();
        if let Some(guide) = guide {
            self.emit_all_guided(guide, starts, &mut emissions, count);
            return emissions;
        }
        let (u, v) = (starts.singles(1), starts.singles(2));
        for lane in 0..LANES {
            emissions.direction.set(lane, uniform_sphere([u[lane], v[lane]]));
        }
        if let [Emitter::Point { position, intensity }] = self.emitters()
            && self.environment().is_none()
        {
            emissions.origin = Vec3s::splat(*position);
            emissions.flux = Vec3s::splat(*intensity * (4.0 * PI));
            return emissions;
        }
        for lane in 0..count {
            let [choice, numbers @ ..] = starts.get(lane);
            let (index, prob) = self.choose_by_power(choice);
            emissions.emitter[lane] = index as u32;
            if let Some(Emitter::Point { position, intensity }) = self.emitters().get(index) {
                emissions.origin.set(lane, *position);
                emissions.flux.set(lane, *intensity * (4.0 * PI / prob));
            } else {
                emissions.set(lane, &self.emit_chosen(index, prob, numbers));
            }
        }
        emissions
    }

    #[inline(never)] // keeps the other loop short
    fn emit_all_guided(
        &self,
        guide: &Guide,
        starts: &PrimarySamples,
        emissions: &mut Emissions,
        count: usize,
    ) {
        for lane in 0..count {
            let (index, emission) = self.emit_guided(guide, starts.get(lane));
            emissions.emitter[lane] = index as u32;
            emissions.set(lane, &emission);
        }
    }

    /// [`Self::connect`] for each vertex.
    #[inline(always)] // part of the loop over vertices
    pub fn connect_all(&self, at: &Receivers, rngs: &mut impl DrawLanes) -> LightSamples {
        let choices = rngs.next_bits();
        if let [Emitter::Point { position, intensity }] = self.emitters()
            && self.environment().is_none()
        {
            let target = Vec3s::splat(*position);
            let irradiance = Vec3s::splat(*intensity);
            let relative = [1.0; LANES];
            let mut samples = LightSamples { target, irradiance, relative, ..Default::default() };
            samples.reach_points(at.position, &[1.0; LANES]);
            self.guide_points(&[0; LANES], &mut samples);
            return samples;
        }
        let mut samples = LightSamples { relative: [1.0; LANES], ..LightSamples::default() };
        // Index and probability of the choice in lanes with point lights.
        let (mut points, mut probs) = ([NO_POINT; LANES], [1.0; LANES]);
        // Lanes with other lights.
        let mut others = [None; LANES];
        for lane in (0..LANES).filter(|&lane| at.active[lane]) {
            let (position, normal) = (at.position.get(lane), at.normal.get(lane));
            let choice = unit_f64(choices.map(|bits| bits[lane]));
            let receiver = Receiver { position, normal: Some(normal) };
            let chosen = self.by_estimate.choose(receiver, choice);
            let Some((index, prob)) = chosen else { continue };
            if let Some(Emitter::Point { position, intensity }) = self.emitters().get(index) {
                samples.target.set(lane, *position);
                samples.irradiance.set(lane, *intensity);
                (points[lane], probs[lane]) = (index as u32, prob);
            } else {
                others[lane] = Some(ChosenLight { index, prob, at: receiver });
            }
        }
        samples.reach_points(at.position, &probs);
        self.guide_points(&points, &mut samples);
        self.connect_others(&others, rngs, &mut samples);
        samples
    }

    /// Chooses points on the chosen lights.
    #[inline(never)] // keeps the loop over vertices short
    fn connect_others<D: DrawLanes>(
        &self,
        chosen: &[Option<ChosenLight>; LANES],
        rngs: &mut D,
        samples: &mut LightSamples,
    ) {
        let mut own: [D::One; LANES] = from_fn(|lane| rngs.get(lane));
        let mut lights = [None; LANES];
        self.connect_each_chosen(chosen, &mut own, &mut lights);
        for (lane, (light, own)) in lights.iter().zip(own).enumerate() {
            if let Some(light) = light {
                samples.target.set(lane, light.target);
                samples.wi.set(lane, light.wi);
                samples.irradiance.set(lane, light.irradiance);
                samples.relative[lane] = light.relative;
                samples.inverse_pdf_w[lane] = light.inverse_pdf_w;
            }
            rngs.set(lane, own);
        }
    }

    /// Divides the relative flux of light paths from point lights with these indices by their
    /// guide's density.
    #[inline(always)]
    fn guide_points(&self, points: &[u32; LANES], samples: &mut LightSamples) {
        if self.has_weighted_guide() {
            self.divide_by_guide(points, samples);
        }
    }

    #[inline(never)] // keeps the loop over vertices short
    fn divide_by_guide(&self, points: &[u32; LANES], samples: &mut LightSamples) {
        for (lane, &index) in points.iter().enumerate().filter(|(_, index)| **index != NO_POINT) {
            let ray = [samples.target.get(lane), -samples.wi.get(lane)];
            samples.relative[lane] /= self.guide_density(index as usize, ray);
        }
    }
}

impl Emissions {
    #[inline]
    fn set(&mut self, lane: usize, emission: &Emission) {
        let Emission { origin, direction, flux } = *emission;
        self.origin.set(lane, origin);
        self.direction.set(lane, direction);
        self.flux.set(lane, flux);
    }
}

impl LightSamples {
    /// Sets the directions from vertices at `position` to point lights that were chosen with these
    /// probabilities, and turns the lights' intensity into irradiance.
    #[inline(always)] // part of the loop over vertices
    fn reach_points(&mut self, position: &Vec3s, probs: &[f32; LANES]) {
        for (lane, &prob) in probs.iter().enumerate() {
            let to_light = self.target.get(lane) - position.get(lane);
            // At the position of a point light there is no direction to it, and the cosine becomes
            // 0. (An `if` would be a branch, and keep the compiler from vector instructions.)
            let distance2 = to_light.length_squared().max(1e-30);
            self.wi.set(lane, to_light * distance2.sqrt().recip());
            let irradiance = self.irradiance.get(lane) * (distance2 * prob).recip();
            self.irradiance.set(lane, irradiance.min(Vec3::splat(f32::MAX)));
        }
    }
}
