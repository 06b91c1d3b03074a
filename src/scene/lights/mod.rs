//! The lights of a scene: light paths start from them in proportion to their power, and vertices
//! connect to them in proportion to an estimate of their contribution.

mod tree_node;
mod sampler;
mod cluster;
mod cutpoints;
pub mod emitter;
pub mod environment;
pub mod guide;
pub(crate) mod packets;
mod solid_angle;
mod tree_build;
pub(crate) mod textured_emitter;
mod tree;
pub mod visibility;

use crate::base::math::{Rgb, luminance};
use crate::base::rng::Rng;
use emitter::Emitter;
use environment::Environment;
use glam::Vec3;
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

/// The random numbers that start a light path, in [0, 1) each: one for the light, two for the point on it, two for
/// the direction. Lights without a surface, or of one direction, leave two unused.
pub type PrimarySample = [f64; 5];

/// A number of [0, 1) in single precision, still less than 1.
fn below_one(u: f64) -> f32 {
    (u as f32).min(1.0f32.next_down())
}

/// A point on a light, as seen from a vertex.
#[derive(Clone, Copy, Debug)]
pub struct LightSample {
    /// Target of the shadow ray, already off the light's surface.
    pub target: Vec3,
    /// Unit vector from the vertex to the light.
    pub wi: Vec3,
    /// Irradiance on a surface that faces `wi` if nothing is in between, divided by the
    /// sample's density, W/m^2.
    /// theory.md, section 7: `E`.
    pub irradiance: Rgb,
    /// Luminance of the flux of a light path that starts at the target, over that of all lights' power.
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
    /// Chooses among the emitters that no ray can hit.
    delta_by_estimate: EstimateSampler,
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
}

impl Lights {
    /// Emitters without power are left out.
    pub fn new(mut emitters: Vec<Emitter>) -> Self {
        emitters.retain(Emitter::has_power);
        let by_power = Arc::new(PowerSampler::new(emitters.iter().map(power_weight)));
        let by_estimate = EstimateSampler::new(&emitters, |_| true);
        let delta_by_estimate = EstimateSampler::new(&emitters, Emitter::is_delta);
        Self {
            emitters: emitters.into(),
            environment: None,
            by_power,
            by_estimate,
            delta_by_estimate,
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
        let (index, prob) = self.choose_by_power(rng.next_f64());
        self.emit_chosen(index, prob, self.numbers(index, rng))
    }

    /// Starts a light path from uniform numbers; also returns the light's index.
    ///
    /// # Panics
    /// If there are no lights.
    pub fn emit_at(&self, [choice, at @ ..]: PrimarySample) -> (usize, Emission) {
        let (index, prob) = self.choose_by_power(choice);
        (index, self.emit_chosen(index, prob, at))
    }

    /// An index for [`Self::emit_chosen`] and its probability.
    #[inline(always)] // part of the loop over light paths
    pub(super) fn choose_by_power(&self, u: f64) -> (usize, f32) {
        self.by_power.choose(u)
    }

    /// Random numbers for [`Self::emit_chosen`]: those that choose among an environment's pixels have 53 bits.
    #[inline]
    pub(super) fn numbers(&self, index: usize, rng: &mut Rng) -> [f64; 4] {
        let is_environment = index == self.emitters.len();
        [(); 4].map(|()| if is_environment { rng.next_f64() } else { rng.next_1d().into() })
    }

    #[inline(never)] // point lights do not call it: see `emit_all`
    pub(super) fn emit_chosen(&self, index: usize, prob: f32, at: [f64; 4]) -> Emission {
        match self.emitters.get(index) {
            Some(emitter) => emitter.emit(prob, at),
            None => self.chosen_environment().emit(prob, at),
        }
    }

    /// Chooses a point on a light to connect `at` with; `None` if that point cannot light it.
    pub fn connect(&self, at: Receiver, rng: &mut Rng) -> Option<LightSample> {
        let (index, prob) = self.by_estimate.choose(at, rng.next_f64())?;
        self.connect_chosen(index, prob, at.position, rng)
    }

    /// Ratio of the density of connections to that of emission, per area, of the light with this index. Both join
    /// `origin`, along the unit vector `direction`, with `at`, where the triangle has the unit normal `normal`.
    ///
    /// If emission carries the flux `Phi_0` and a connection the irradiance `E`, the ratio is `Phi_0/(E cos)`:
    /// both are the light's radiance over a density.
    /// theory.md (47b), `1/l`.
    pub fn connection_over_emission(
        &self,
        index: usize,
        [origin, direction]: [Vec3; 2],
        at: Receiver,
        normal: Vec3,
    ) -> f32 {
        let prob = self.by_estimate.prob(index, at);
        let irradiance = match self.emitters.get(index) {
            Some(emitter) => emitter.irradiance(origin, direction, at.position),
            None => luminance(self.chosen_environment().integral()),
        };
        let cos = direction.dot(normal).abs();
        (prob * self.total_power() / (irradiance * cos).max(f32::MIN_POSITIVE)).min(f32::MAX)
    }

    /// Density in solid angle of connections of `at` with the point `origin` of the emissive triangle with this
    /// index, 1/sr.
    pub fn connection_pdf_w(&self, index: usize, origin: Vec3, at: Receiver) -> f32 {
        let prob = self.by_estimate.prob(index, at);
        let direction = (at.position - origin).normalize();
        let inverse = self.emitters[index].inverse_pdf_w(origin, direction, at.position);
        inverse.map_or(0.0, |inverse| prob / inverse)
    }

    /// Density of emission of the light with this index along `direction`, per area of its surface (or of a disc that
    /// faces the direction of an environment) and per projected solid angle, 1/(m^2 sr): radiance over power, both as
    /// luminance. `None` if no ray can hit the light.
    /// theory.md (47b), `e`.
    pub fn emission_density(&self, index: usize, direction: Vec3) -> Option<f32> {
        let radiance = match self.emitters.get(index) {
            Some(emitter) => emitter.mean_radiance()?,
            None => self.environment_radiance(-direction),
        };
        Some(luminance(radiance) / self.total_power())
    }

    /// Radiance of a ray that hits nothing in a unit direction, W/(m^2 sr), and the density in solid angle of
    /// connections with the environment along it, 1/sr, if the environment is certain to be chosen.
    pub fn environment_sight(&self, direction: Vec3) -> (Rgb, f32) {
        self.environment.as_ref().map_or((Rgb::ZERO, 0.0), |map| map.radiance_and_pdf_w(direction))
    }

    /// Probability of choosing the environment for connections of `at`.
    pub fn environment_prob(&self, at: Receiver) -> f32 {
        self.by_estimate.prob(self.emitters.len(), at)
    }

    /// Luminance of the power of all lights, W: the mean flux of a light path.
    #[inline]
    pub fn total_power(&self) -> f32 {
        self.by_power.total as f32
    }

    /// [`Self::connect`] with lights that no ray can hit; `None` if there are none.
    #[inline(never)] // rare
    pub fn connect_delta(&self, at: Receiver, rng: &mut Rng) -> Option<LightSample> {
        let (index, prob) = self.delta_by_estimate.choose(at, rng.next_f64())?;
        self.connect_chosen(index, prob, at.position, rng)
    }

    /// [`Self::connect`] with a light chosen by its power alone: a simple check of choices by estimate.
    ///
    /// # Panics
    /// If there are no lights.
    pub fn connect_by_power(&self, position: Vec3, rng: &mut Rng) -> Option<LightSample> {
        let (index, prob) = self.by_power.choose(rng.next_f64());
        self.connect_chosen(index, prob, position, rng)
    }

    #[inline(never)] // point lights do not call it: see `connect_all`
    pub(super) fn connect_chosen(
        &self,
        index: usize,
        prob: f32,
        position: Vec3,
        rng: &mut Rng,
    ) -> Option<LightSample> {
        match self.emitters.get(index) {
            Some(emitter) => emitter.connect(position, prob, rng),
            None => Some(self.chosen_environment().connect(position, prob, rng)),
        }
    }

    fn chosen_environment(&self) -> &Environment {
        self.environment.as_deref().expect("chosen, hence present")
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::rng::{Stream, StreamKey};
    use crate::scene::Triangle;
    use std::f32::consts::PI;

    fn point(x: f32, intensity: Rgb) -> Emitter {
        Emitter::Point { position: Vec3::new(x, 0.0, 0.0), intensity }
    }

    fn panel() -> Emitter {
        let shape = Triangle::new([Vec3::ZERO, 2.0 * Vec3::X, 3.0 * Vec3::Y], 0);
        Emitter::Triangle { shape, radiance: Rgb::new(0.5, 1.5, 1.0) }
    }

    #[test]
    fn light_paths_carry_the_power_of_all_lights() {
        let red = point(1.0, Rgb::new(2.0, 0.1, 0.0));
        let lights = Lights::new(vec![red, panel(), point(2.0, Rgb::ZERO)]);
        assert_eq!(lights.emitters().len(), 2, "black lights are left out");
        // 4 pi I of the point, pi A Le of the triangle.
        let expected = 4.0 * PI * Rgb::new(2.0, 0.1, 0.0) + PI * 3.0 * Rgb::new(0.5, 1.5, 1.0);
        assert!((lights.power() - expected).length() < 1e-4);
        let mut rng = StreamKey::new(1, Stream::Test, 0).rng(0);
        let n = 200_000;
        let (mut sum, mut square) = (Rgb::ZERO, Rgb::ZERO);
        for _ in 0..n {
            let flux = lights.emit(&mut rng).flux;
            sum += flux / n as f32;
            square += flux * flux / n as f32;
        }
        let error = ((square - sum * sum) / n as f32).max(Rgb::ZERO).map(f32::sqrt);
        assert!((sum - expected).abs().cmple(4.0 * error + 1e-3).all(), "{sum} {expected} {error}");
    }

    #[test]
    fn connections_to_a_triangle_have_its_form_factor() {
        // Irradiance from a small triangle far above: Le A cos cos' / d^2, to 1/d^2 of its size.
        let lights = Lights::new(vec![panel()]);
        let from = Vec3::new(20.0, 5.0, 60.0);
        let to_light = Vec3::new(2.0 / 3.0, 1.0, 0.0) - from;
        let cos_light = 60.0 / to_light.length();
        let expected = Rgb::new(0.5, 1.5, 1.0) * (3.0 * cos_light / to_light.length_squared());
        let mut rng = StreamKey::new(2, Stream::Test, 0).rng(0);
        let n = 20_000;
        let mut sum = Rgb::ZERO;
        for _ in 0..n {
            let sample = lights.connect(Receiver { position: from, normal: None }, &mut rng);
            sum += sample.expect("in front").irradiance / n as f32;
        }
        assert!((sum / expected - Rgb::ONE).abs().max_element() < 2e-3, "{sum} {expected}");
        let behind = Receiver { position: -from, normal: None };
        assert!(lights.connect(behind, &mut rng).is_none(), "dark from behind");
    }

    /// Lights of every kind.
    fn all_kinds() -> Lights {
        let far = Vec3::new(0.0, 0.0, 5.0);
        let spot = emitter::Spot {
            position: far,
            direction: Vec3::new(0.6, 0.0, -0.8),
            intensity: Rgb::new(9.0, 20.0, 30.0),
            cos_inner: 0.8,
            cos_outer: 0.3,
        };
        let sun = emitter::Directional {
            radius: 8.0,
            ..emitter::Directional::new(Vec3::new(0.0, 0.6, -0.8), Rgb::new(1.0, 0.5, 0.2))
        };
        let texels = (0..64).map(|i| [4 * i, 255 - 3 * i, 40 + i, 255]).collect();
        let texture = std::sync::Arc::new(crate::scene::Texture::new(8, 8, texels));
        let corners =
            [Vec3::new(2.0, 2.0, 4.0), Vec3::new(2.0, 4.0, 4.0), Vec3::new(4.0, 2.0, 4.0)];
        let shape = Triangle::new(corners, 0);
        let uvs = [glam::Vec2::ZERO, glam::Vec2::X, glam::Vec2::Y];
        let picture = textured_emitter::TextureEmission::new(&texture, Rgb::splat(3.0), 1)
            .emitter(shape, uvs);
        let points = [point(1.0, Rgb::ONE), point(-3.0, Rgb::new(2.0, 0.1, 0.0))];
        let mut emitters = vec![panel(), Emitter::Spot(spot), Emitter::Directional(sun), picture];
        emitters.extend(points);
        let mut lights = Lights::new(emitters);
        let pixels = (0..32).map(|i| Rgb::new(0.1 * i as f32, 0.5, 0.2)).collect();
        let mut map = Environment::new(8, 4, pixels, 20.0);
        map.enclose(&crate::base::math::Bounds { min: Vec3::splat(-5.0), max: Vec3::splat(5.0) });
        lights.set_environment(Some(map));
        lights
    }

    #[test]
    fn ratios_of_connection_and_emission_densities_are_reciprocal() {
        let lights = all_kinds();
        let mut rng = StreamKey::new(4, Stream::Test, 0).rng(0);
        let (mut found, mut strayed) = ([0; 7], 0);
        for _ in 0..20_000 {
            let mut somewhere = || 6.0 * rng.next_1d() - 3.0;
            let position = Vec3::new(somewhere(), somewhere(), somewhere());
            let normal = crate::base::math::uniform_sphere(rng.next_2d());
            let at = Receiver { position, normal: Some(normal) };
            let choice = lights.by_estimate.choose(at, rng.next_f64());
            let Some((index, prob)) = choice else { continue };
            let Some(sample) = lights.connect_chosen(index, prob, position, &mut rng) else {
                continue;
            };
            let cos = sample.wi.dot(normal);
            // Grazing light on and from panels loses digits.
            if cos < 1e-2 || sample.relative < 1e-2 {
                continue;
            }
            let l = luminance(sample.irradiance) * cos / (lights.total_power() * sample.relative);
            let emission = [sample.target, -sample.wi];
            let inverse = lights.connection_over_emission(index, emission, at, normal);
            let off = (l * inverse - 1.0).abs();
            assert!(off < 2e-3, "{index} {position} {normal}: {l} {inverse}");
            found[index] += 1;
            // Rays can hit the other lights.
            let pdf_w = match lights.emitters.get(index) {
                None => lights.environment_prob(at) * lights.environment_sight(sample.wi).1,
                Some(emitter) if emitter.is_delta() => {
                    assert_eq!(sample.inverse_pdf_w, 0.0);
                    continue;
                }
                Some(_) => lights.connection_pdf_w(index, sample.target, at),
            };
            let off = (pdf_w * sample.inverse_pdf_w - 1.0).abs();
            // At their edges, directions may belong to the next pixel of the environment.
            strayed += u32::from(off > 2e-3);
        }
        assert!(found.iter().all(|&found| found > 100), "{found:?}");
        assert!(strayed < 5, "{strayed}");
        // All light paths, but those of textures, start with the flux that the ratio assumes.
        for _ in 0..5000 {
            let (index, prob) = lights.choose_by_power(rng.next_f64());
            let flux =
                luminance(lights.emit_chosen(index, prob, lights.numbers(index, &mut rng)).flux);
            let textured = matches!(lights.emitters.get(index), Some(Emitter::Textured(_)));
            assert!(textured || (flux / lights.total_power() - 1.0).abs() < 2e-3, "{index} {flux}");
        }
    }

    #[test]
    fn guided_light_paths_carry_the_power_of_all_lights() {
        // Teach more starts from one side of the environment, from some lights and in some directions.
        let lights = all_kinds();
        let mut rng = StreamKey::new(5, Stream::Test, 0).rng(0);
        let sample = |_| {
            let start = guide::Guide::even().start(&mut rng);
            let place = start.place;
            let square = if place[0] < 0.4 || place[1] * place[2] > 0.7 { 9.0 } else { 0.5 };
            guide::GuideSample { start, square }
        };
        let guide = guide::Guide::learn(&(0..50_000).map(sample).collect::<Vec<_>>());
        assert!(guide.cell_count() > 10);
        let n = 200_000;
        let (mut sum, mut square) = (glam::DVec3::ZERO, glam::DVec3::ZERO);
        let mut toward = [glam::DVec3::ZERO; 2];
        for _ in 0..n {
            let (_, emission) = lights.emit_guided(&guide, &mut rng);
            let flux = emission.flux.as_dvec3();
            sum += flux / f64::from(n);
            square += flux * flux / f64::from(n);
            toward[0] += flux * f64::from(emission.direction.z) / f64::from(n);
            let plain = lights.emit(&mut rng);
            toward[1] += plain.flux.as_dvec3() * f64::from(plain.direction.z) / f64::from(n);
        }
        let error = ((square - sum * sum) / f64::from(n)).map(f64::sqrt);
        let power = lights.power().as_dvec3();
        // A texture's mean is known to a thousandth.
        assert!((sum - power).abs().cmple(4.0 * error + 1e-3 * power).all(), "{sum} {power}");
        let off = (toward[0] - toward[1]).abs();
        assert!(off.cmple(6.0 * error + 1e-3 * power).all(), "{toward:?} {error}");
    }

    #[test]
    fn each_of_many_emitters_is_chosen_with_its_probability() {
        // Powers 1, 2, 3, 1, 2, 3, ...: each third of the choices by residue has 1/6, 2/6, 3/6.
        let count = 300_000;
        let emitter = |i: usize| point(i as f32, Rgb::splat(1.0 + (i % 3) as f32));
        let lights = Lights::new((0..count).map(emitter).collect());
        let mut rng = StreamKey::new(3, Stream::Test, 0).rng(0);
        let mut chosen = [0.0; 3];
        let n = 300_000.0;
        for _ in 0..n as usize {
            let (index, prob) = lights.by_power.choose(rng.next_f64());
            let power = power_weight(&lights.emitters[index]);
            let class = (power / (4.0 * std::f64::consts::PI)).round() as usize - 1;
            chosen[class] += 1.0;
            let share = (class + 1) as f64 / (2.0 * count as f64);
            assert!((f64::from(prob) / share - 1.0).abs() < 1e-5, "{prob} {share}");
        }
        for (class, chosen) in chosen.into_iter().enumerate() {
            let share = (class + 1) as f64 / 6.0;
            let error = (share * (1.0 - share) * n).sqrt();
            assert!((chosen - share * n).abs() < 4.0 * error, "{class}: {chosen}");
        }
    }
}
