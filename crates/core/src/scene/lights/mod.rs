//! The lights of a scene: light paths start from them in proportion to their power, and vertices
//! connect to them in proportion to an estimate of their contribution.

mod tree_node;
mod sampler;
mod cluster;
mod connect;
mod cutpoints;
pub mod emitter;
pub mod enclosure;
pub mod environment;
pub mod guide;
pub mod horizon;
pub mod intensity;
pub mod luminaire;
pub(crate) mod packets;
mod regions;
mod solid_angle;
mod spot;
mod triangle_points;
mod tree_build;
pub(crate) mod textured_emitter;
mod tree;
pub mod visibility;

use crate::base::math::{Rgb, luminance};
use crate::base::rng::Rng;
use connect::ChosenLight;
pub use connect::ConnectedLight;
use emitter::Emitter;
use environment::{Environment, Sight};
use glam::Vec3;
use guide::Guide;
use sampler::EstimateSampler;
use std::sync::Arc;
use visibility::Visibility;

/// The start of a light path.
#[derive(Clone, Copy, Debug)]
pub struct Emission {
    /// Start point, already off its surface.
    pub origin: Vec3,
    /// Unit direction.
    pub direction: Vec3,
    /// Flux that the path carries, W: emitted radiance (or intensity) times the cosine, divided by
    /// the path's density. Its mean over paths is the power of all lights.
    /// theory.md (11).
    pub flux: Rgb,
}

/// The random numbers that start a light path, in [0, 1) each: one for the light, two for the point
/// on it, two for the direction. Lights without a surface, or of one direction, leave two unused.
pub type PrimarySample = [f64; 5];

/// Independent numbers for a start.
pub fn primary_sample(rng: &mut Rng) -> PrimarySample {
    [(); 5].map(|()| rng.next_f64())
}

/// A number of [0, 1) in single precision, still less than 1.
fn below_one(u: f64) -> f32 {
    (u as f32).min(1.0f32.next_down())
}

/// A point on a light, as seen from a vertex.
#[derive(Clone, Copy, Debug, Default)]
pub struct LightSample {
    /// Target of the shadow ray, already off the light's surface.
    pub target: Vec3,
    /// Unit vector from the vertex to the light.
    pub wi: Vec3,
    /// Irradiance on a surface that faces `wi` if nothing is in between, divided by the
    /// sample's density, W/m^2.
    /// theory.md, section 7: `E`.
    pub irradiance: Rgb,
    /// Luminance of the flux of a light path that starts at the target, over that of all lights'
    /// power.
    pub relative: f32,
    /// Reciprocal of the sample's density in solid angle, sr; 0 if no ray can hit it.
    pub inverse_pdf_w: f32,
}

impl LightSample {
    /// A point on a light that no ray can hit.
    fn of_delta(target: Vec3, wi: Vec3, irradiance: Rgb) -> Self {
        Self { target, wi, irradiance, relative: 1.0, inverse_pdf_w: 0.0 }
    }
}

/// A point that receives light.
#[derive(Clone, Copy, Debug, Default)]
pub struct Receiver {
    /// Position, scene units.
    pub position: Vec3,
    /// Unit normal of the side that receives light; `None` if both sides do.
    pub normal: Option<Vec3>,
}

/// All emitters of a scene, and its environment. Clones share them.
#[derive(Clone, Debug, Default)]
pub struct Lights {
    emitters: Arc<[Emitter]>,
    environment: Option<Arc<Environment>>,
    /// Chooses among the emitters and, after them, the environment.
    by_power: Arc<PowerSampler>,
    /// Chooses among them for a receiver.
    by_estimate: EstimateSampler,
    /// Density of the starts of light paths, where MIS weights depend on it.
    weighted_guide: Option<Arc<Guide>>,
}

/// Chooses in proportion to the luminance of the power.
#[derive(Clone, Debug, Default)]
struct PowerSampler {
    /// Probability of choosing each emitter.
    prob: Vec<f32>,
    /// Upper end of each emitter's interval of [0, 1], in f64 so that a million emitters have one.
    cumulative: Vec<f64>,
    /// Sum of all weights.
    total: f64,
}

/// Weight of an emitter in choices by power, W.
fn power_weight(emitter: &Emitter) -> f64 {
    f64::from(luminance(emitter.power()))
}

impl PowerSampler {
    /// A sampler in proportion to `weights`.
    fn new(weights: impl Iterator<Item = f64> + Clone) -> Self {
        let total: f64 = weights.clone().sum();
        // theory.md (11)
        let prob = weights.clone().map(|weight| (weight / total) as f32).collect();
        let mut sum = 0.0;
        let cumulative = weights.map(|weight| {
            sum += weight / total;
            sum
        });
        Self { prob, cumulative: cumulative.collect(), total }
    }

    /// The index whose interval contains `u` of [0, 1), and its probability.
    #[inline]
    fn choose(&self, u: f64) -> (usize, f32) {
        let last = self.prob.len() - 1;
        let index = self.cumulative.partition_point(|&end| end <= u).min(last);
        (index, self.prob[index])
    }

    /// The interval of [0, 1] of an index.
    fn interval(&self, index: usize) -> [f64; 2] {
        let begin = index.checked_sub(1).map_or(0.0, |before| self.cumulative[before]);
        [begin, self.cumulative[index]]
    }
}

impl Lights {
    /// Emitters without power are left out.
    pub fn new(mut emitters: Vec<Emitter>) -> Self {
        emitters.retain(Emitter::has_power);
        let by_power = Arc::new(PowerSampler::new(emitters.iter().map(power_weight)));
        let by_estimate = EstimateSampler::new(&emitters);
        Self {
            emitters: emitters.into(),
            environment: None,
            by_power,
            by_estimate,
            weighted_guide: None,
        }
    }

    /// Sets the environment; a black one is left out.
    pub(super) fn set_environment(&mut self, environment: Option<Environment>) {
        let environment = environment.filter(|environment| !environment.is_black());
        let own = environment.iter().map(|e| f64::from(luminance(e.power())));
        let weights = self.emitters.iter().map(power_weight).chain(own);
        self.by_power = Arc::new(PowerSampler::new(weights));
        self.by_estimate.set_environment(self.emitters.len(), environment.as_ref());
        self.environment = environment.map(Arc::new);
    }

    /// Sets or removes the visibility that the choices of lights for connections take into account.
    pub(super) fn set_visibility(&mut self, visibility: Option<Arc<Visibility>>) {
        self.by_estimate.set_visibility(visibility);
    }

    /// Sets or removes the guide of light paths in the densities of emission,
    /// [`Self::emission_density`], [`Self::connection_over_emission`] and
    /// [`LightSample::relative`].
    pub(super) fn set_weighted_guide(&mut self, guide: Option<Arc<Guide>>) {
        self.weighted_guide = guide;
    }

    /// Returns true if the densities of emission depend on a guide.
    #[inline]
    pub fn has_weighted_guide(&self) -> bool {
        self.weighted_guide.is_some()
    }

    /// Returns true if there are no lights.
    pub fn is_empty(&self) -> bool {
        self.emitters.is_empty() && self.environment.is_none()
    }

    /// Light from all directions.
    pub fn environment(&self) -> Option<&Environment> {
        self.environment.as_deref()
    }

    /// Returns true if rays that hit nothing receive light.
    #[inline]
    pub fn has_environment(&self) -> bool {
        self.environment.is_some()
    }

    /// Radiance of a ray that hits nothing in a unit direction, W/(m^2 sr).
    #[inline]
    pub fn environment_radiance(&self, direction: Vec3) -> Rgb {
        self.environment.as_ref().map_or(Rgb::ZERO, |map| map.radiance(direction))
    }

    /// All emitters with power.
    pub fn emitters(&self) -> &[Emitter] {
        &self.emitters
    }

    /// Radiant power of all lights, W.
    pub fn power(&self) -> Rgb {
        let emitters: Rgb = self.emitters.iter().map(Emitter::power).sum();
        emitters + self.environment.as_ref().map_or(Rgb::ZERO, |map| map.power())
    }

    /// Starts a light path.
    ///
    /// # Panics
    /// If there are no lights.
    pub fn emit(&self, rng: &mut Rng) -> Emission {
        self.emit_at(primary_sample(rng)).1
    }

    /// Starts a light path from uniform numbers; also returns the light's index.
    ///
    /// # Panics
    /// If there are no lights.
    pub fn emit_at(&self, [choice, at @ ..]: PrimarySample) -> (usize, Emission) {
        let (index, prob) = self.choose_by_power(choice);
        (index, self.emit_chosen(index, prob, at))
    }

    /// An index for [`Self::emit_chosen`] by a uniform number, and its probability.
    pub fn choose_emitter(&self, u: f64) -> (usize, f32) {
        self.by_power.choose(u)
    }

    /// Probability of the index of [`Self::choose_emitter`].
    pub fn emitter_prob(&self, index: usize) -> f32 {
        self.by_power.prob[index]
    }

    /// An index for [`Self::emit_chosen`] and its probability.
    #[inline(always)] // part of the loop over light paths
    pub(super) fn choose_by_power(&self, u: f64) -> (usize, f32) {
        self.by_power.choose(u)
    }

    /// Starts a light path from the light with this index, which was chosen with this probability,
    /// by uniform numbers.
    #[inline(never)] // point lights do not call it: see `emit_all`
    pub fn emit_chosen(&self, index: usize, prob: f32, at: [f64; 4]) -> Emission {
        match self.emitters.get(index) {
            Some(emitter) => emitter.emit(prob, at),
            None => self.chosen_environment().emit(prob, at),
        }
    }

    /// Ratio of the density of connections to that of emission, per area, of the light with this
    /// index. Both join `origin`, along the unit vector `direction`, with `at`, where the triangle
    /// has the unit normal `normal`.
    ///
    /// If emission carries the flux `Phi_0` and a connection the irradiance `E`, the ratio is
    /// `Phi_0/(E cos)`: both are the light's radiance over a density. theory.md (47b), `1/l`.
    pub fn connection_over_emission(
        &self,
        index: usize,
        [origin, direction]: [Vec3; 2],
        at: Receiver,
        normal: Vec3,
    ) -> f32 {
        let (prob, irradiance) = match self.emitters.get(index) {
            Some(emitter) => {
                let irradiance = emitter.irradiance(origin, direction, at.position);
                (self.by_estimate.prob(index, at), irradiance)
            }
            None => {
                let irradiance = luminance(self.chosen_environment().integral());
                (self.environment_density(at, -direction), irradiance)
            }
        };
        let cos = direction.dot(normal).abs();
        let guided = self.guide_density(index, [origin, direction]);
        let emission = irradiance * cos * guided;
        (prob * self.total_power() / emission.max(f32::MIN_POSITIVE)).min(f32::MAX)
    }

    /// Density in solid angle of connections of `at` with the point `origin` of the surface of the
    /// light with this index, 1/sr.
    pub fn connection_pdf_w(&self, index: usize, origin: Vec3, at: Receiver) -> f32 {
        let prob = self.by_estimate.prob(index, at);
        let direction = (at.position - origin).normalize();
        let inverse = self.emitters[index].inverse_pdf_w(origin, direction, at.position);
        inverse.map_or(0.0, |inverse| prob / inverse)
    }

    /// Density of emission of the light with this index from `origin` along `direction`, per area
    /// of its surface (or of a disc that faces the direction of an environment) and per projected
    /// solid angle, 1/(m^2 sr): radiance over power, both as luminance, times the density of the
    /// guide. `None` if no ray can hit the light. theory.md (47b), `e`.
    pub fn emission_density(&self, index: usize, [origin, direction]: [Vec3; 2]) -> Option<f32> {
        let radiance = match self.emitters.get(index) {
            Some(emitter) => emitter.hit_radiance(direction)?,
            None => self.environment_radiance(-direction),
        };
        Some(self.emission_density_of(radiance, index, [origin, direction]))
    }

    /// [`Self::emission_density`] of a light that emits this radiance along the ray, W/(m^2 sr).
    fn emission_density_of(&self, radiance: Rgb, index: usize, ray: [Vec3; 2]) -> f32 {
        luminance(radiance) / self.total_power() * self.guide_density(index, ray)
    }

    /// Radiance of a ray that hits nothing in a unit direction, W/(m^2 sr), and the density in
    /// solid angle of connections of `at` along it, 1/sr.
    pub fn environment_sight(&self, direction: Vec3, at: Receiver) -> (Rgb, f32) {
        let Some(map) = &self.environment else { return (Rgb::ZERO, 0.0) };
        let Sight { radiance, pdf_w, region } = map.sight(direction);
        let prob = self.by_estimate.prob(self.emitters.len(), at);
        (radiance, pdf_w * prob * self.by_estimate.region_density(at, region))
    }

    /// [`Self::emission_density`] of the environment, whose radiance against `direction` is known,
    /// W/(m^2 sr).
    pub fn environment_emission(&self, radiance: Rgb, ray: [Vec3; 2]) -> f32 {
        self.emission_density_of(radiance, self.emitters.len(), ray)
    }

    /// Density with which connections of `at` choose the environment in a unit direction, over the
    /// density of a choice that is certain and in proportion to the radiance.
    fn environment_density(&self, at: Receiver, direction: Vec3) -> f32 {
        let region = self.chosen_environment().region(direction);
        let prob = self.by_estimate.prob(self.emitters.len(), at);
        prob * self.by_estimate.region_density(at, region)
    }

    /// Luminance of the power of all lights, W: the mean flux of a light path.
    #[inline]
    pub fn total_power(&self) -> f32 {
        self.by_power.total as f32
    }

    fn chosen_environment(&self) -> &Environment {
        self.environment.as_deref().expect("chosen, hence present")
    }
}

#[cfg(test)]
mod tests;
