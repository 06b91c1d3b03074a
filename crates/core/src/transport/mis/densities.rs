//! Densities in projected solid angle with which camera and light paths go on from a vertex. The
//! area measure at the next vertex then needs no cosines and distances, which cancel between both
//! kinds of paths.

use crate::base::math::Rgb;
use crate::scene::Surface;
use crate::scene::bsdf::{Bsdf, Lobe, LobeValue, Transport, Vertex};
use crate::transport::light_paths::MAX_SURVIVAL;
use glam::Vec3;
use std::f32::consts::FRAC_1_PI;

/// Minimum density: rounding may leave a path of one kind where a path of the other kind cannot go.
pub const MIN_DENSITY: f32 = 1e-9;

/// A ratio of densities where a path passes through, within the bounds of a density.
#[inline(always)] // part of a vector loop
pub fn bounded(ratio: f32) -> f32 {
    ratio.clamp(MIN_DENSITY, MIN_DENSITY.recip())
}

/// Probability that a path goes on from a lobe that merges. It depends on the vertex alone, so that
/// paths of both kinds compute the same number. Roulette that depends on a path's throughput counts
/// as certain survival, for paths of both kinds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Survival {
    /// 1, as for camera paths at their first vertex.
    Certain,
    /// The reflected share, at most `MAX_SURVIVAL`: theory.md (39).
    Reflected,
    /// 0, where camera paths are cut.
    Never,
}

/// Unit vectors to the next vertex of a path toward the camera and toward the light.
#[derive(Clone, Copy, Debug)]
pub struct Directions {
    /// Toward the camera.
    pub camera: Vec3,
    /// Toward the light.
    pub light: Vec3,
}

impl Survival {
    /// Survival of light paths at all vertices.
    pub const LIGHT: Self = Self::Reflected;

    /// Density of going on from a Lambertian surface, the same in all directions.
    #[inline(always)] // part of vector loops
    pub fn lambertian(self, albedo: f32) -> f32 {
        let survival = match self {
            Self::Certain => 1.0,
            Self::Reflected => albedo.min(MAX_SURVIVAL),
            Self::Never => return 0.0,
        };
        (survival * FRAC_1_PI).max(MIN_DENSITY)
    }

    /// Density of going on toward `wi` from lobes that merge.
    /// theory.md (47a)
    pub fn density(self, bsdf: &Bsdf, at: &Vertex, wi: Vec3) -> f32 {
        if self == Self::Never {
            return 0.0;
        }
        let cos = wi.dot(at.normal);
        if let Some(albedo) = bsdf.diffuse_albedo(at.front) {
            return if cos > 0.0 { self.lambertian(albedo.max_element()) } else { MIN_DENSITY };
        }
        let pdf_w = bsdf.pdf_w(Lobe::Wide, at, wi);
        let value = match self {
            Self::Reflected => bsdf.eval_lobe(Lobe::Wide, at, wi),
            _ => Rgb::ZERO,
        };
        self.density_of(&LobeValue { value, pdf_w }, cos)
    }

    /// [`Self::density`] of lobes that are not Lambertian, from their value and density in a
    /// direction of this cosine.
    pub fn density_of(self, lobes: &LobeValue, cos: f32) -> f32 {
        self.density_from(lobes.value.max_element(), lobes.pdf_w, cos)
    }

    /// [`Self::density_of`] lobes by the largest channel of their value.
    #[inline(always)] // part of vector loops
    pub fn density_from(self, value: f32, pdf_w: f32, cos: f32) -> f32 {
        let density = pdf_w / cos.abs().max(MIN_DENSITY);
        let survives = match self {
            Self::Never => return 0.0,
            // The weight of the sample is the BSDF over the density.
            Self::Reflected => (MAX_SURVIVAL * density).min(value),
            Self::Certain => density,
        };
        survives.max(MIN_DENSITY)
    }
}

/// Lobes that camera paths choose from where they pass through a surface that also merges.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PassChoice {
    /// All lobes.
    Free,
    /// Lobes that pass through: paths are cut at the others.
    PassOnly,
}

/// Density of going on toward `wi` from a rough lobe.
/// theory.md (47a)
pub fn rough_density(bsdf: &Bsdf, at: &Vertex, wi: Vec3) -> f32 {
    rough_density_of(bsdf.pdf_w(Lobe::Rough, at, wi), wi.dot(at.normal))
}

/// [`rough_density`] from the density in solid angle of a direction of this cosine.
#[inline(always)] // part of vector loops
pub fn rough_density_of(pdf_w: f32, cos: f32) -> f32 {
    (pdf_w / cos.abs().max(MIN_DENSITY)).max(MIN_DENSITY)
}

impl PassChoice {
    /// [`Directions::camera_rough`] from the density in solid angle of a direction of this cosine.
    pub fn rough_density_of(self, bsdf: &Bsdf, at: &Vertex, pdf_w: f32, cos: f32) -> f32 {
        let density = rough_density_of(pdf_w, cos);
        match self {
            Self::Free => density,
            Self::PassOnly => density / bsdf.pass_prob(at).max(MIN_DENSITY),
        }
    }
}

impl Directions {
    /// Density of light paths over the density of camera paths where both pass through `surface` by
    /// a lobe. theory.md (47a)
    #[inline(never)] // rare
    pub fn light_over_camera(&self, surface: &Surface, lobe: Lobe, choice: PassChoice) -> f32 {
        let bsdf = &surface.bsdf;
        let at_light = surface.vertex_from(self.light, Transport::Flux);
        let at_camera = surface.vertex_from(self.camera, Transport::Radiance);
        let chosen = match choice {
            PassChoice::Free => 1.0,
            PassChoice::PassOnly => bsdf.pass_prob(&at_camera).max(MIN_DENSITY),
        };
        let ratio = if lobe == Lobe::Delta {
            let refracted = self.light.dot(surface.normal) * self.camera.dot(surface.normal) < 0.0;
            let eta = if refracted { bsdf.relative_index(at_camera.front) } else { 1.0 };
            let [light, camera] = [&at_light, &at_camera].map(|at| bsdf.pass_prob(at));
            light * chosen / (camera.max(MIN_DENSITY) * eta * eta)
        } else {
            let light = rough_density(bsdf, &at_light, self.camera);
            light * chosen / rough_density(bsdf, &at_camera, self.light)
        };
        bounded(ratio)
    }

    /// Density with which a camera path goes on toward the light from a rough lobe of `surface`.
    pub fn camera_rough(&self, surface: &Surface, choice: PassChoice) -> f32 {
        let at = surface.vertex_from(self.camera, Transport::Radiance);
        let pdf_w = surface.bsdf.pdf_w(Lobe::Rough, &at, self.light);
        choice.rough_density_of(&surface.bsdf, &at, pdf_w, self.light.dot(at.normal))
    }

    /// Density with which a light path goes on toward the camera from a rough lobe of `surface`.
    pub fn light_rough(&self, surface: &Surface) -> f32 {
        let at = surface.vertex_from(self.light, Transport::Flux);
        rough_density(&surface.bsdf, &at, self.camera)
    }

    /// Density with which a light path goes on toward the camera from a lobe of `surface` that
    /// merges.
    pub fn light_diffuse(&self, surface: &Surface) -> f32 {
        let at = surface.vertex_from(self.light, Transport::Flux);
        Survival::LIGHT.density(&surface.bsdf, &at, self.camera)
    }

    /// Density with which a camera path goes on toward the light from a lobe of `surface` that
    /// merges.
    pub fn camera_diffuse(&self, surface: &Surface, survival: Survival) -> f32 {
        let at = surface.vertex_from(self.camera, Transport::Radiance);
        survival.density(&surface.bsdf, &at, self.light)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::math::uniform_sphere;
    use crate::base::rng::{Rng, Stream, StreamKey};
    use crate::scene::Material;
    use crate::scene::bsdf::{
        Coated, Conductor, Dielectric, DiffuseTransmission, FacetModel, Facets, Glossy, LobeSet,
        Plastic, Principled, PrincipledParameters, Reflectance, RoughDielectric, ThinDielectric,
    };
    use crate::scene::diffuse::TriangleSide;
    use crate::transport::gather::GatherView;

    fn bsdfs() -> Vec<Bsdf> {
        let metal = Reflectance::Artist { normal: Vec3::new(0.9, 0.8, 0.6) };
        let glossy = |metallic, alpha| {
            Bsdf::Glossy(Glossy::new(Vec3::new(0.7, 0.3, 0.2), metallic, 1.5, alpha))
        };
        let plastic = |alpha| {
            let facets = Facets { model: FacetModel::Ggx, alpha };
            Bsdf::Plastic(Plastic::new(Vec3::new(0.7, 0.3, 0.2), 1.5, facets, true))
        };
        let principled = |roughness, spec_trans, clearcoat| {
            Bsdf::Principled(Principled::new(PrincipledParameters {
                base_color: Rgb::new(0.7, 0.3, 0.2),
                roughness,
                anisotropic: 0.5,
                metallic: 0.2,
                spec_trans,
                sheen: 0.5,
                clearcoat,
                ..PrincipledParameters::default()
            }))
        };
        vec![
            principled(0.4, 0.0, 0.0),
            principled(0.7, 0.0, 0.0),
            principled(0.7, 0.0, 1.0),
            principled(0.4, 0.6, 1.0),
            Bsdf::diffuse(Rgb::new(0.2, 0.7, 0.5)),
            Bsdf::DiffuseTransmission(DiffuseTransmission::new(
                Rgb::new(0.2, 0.7, 0.1),
                Rgb::new(0.6, 0.3, 0.5),
            )),
            Bsdf::Mirror { reflectance: Rgb::splat(0.8) },
            Bsdf::Dielectric(Dielectric::new(1.5)),
            Bsdf::ThinDielectric(ThinDielectric::new(1.5)),
            Bsdf::Conductor(Conductor::new(metal, 0.0)),
            Bsdf::Conductor(Conductor::new(metal, 0.15)),
            Bsdf::Conductor(Conductor::new(metal, 0.6)),
            Bsdf::RoughDielectric(RoughDielectric::new(1.5, 0.2)),
            Bsdf::Coated(Coated::new(Vec3::new(0.7, 0.3, 0.2), 1.5)),
            glossy(0.0, 0.0),
            glossy(0.3, 0.15),
            glossy(0.4, 0.5),
            plastic(0.0),
            plastic(0.15),
            plastic(0.5),
        ]
    }

    fn surface<'a>(material: &'a Material, wo: Vec3, normal: Option<Vec3>) -> Surface<'a> {
        let front = wo.z > 0.0;
        let side = if front { 1.0 } else { -1.0 };
        Surface {
            position: Vec3::ZERO,
            facet: TriangleSide::default(),
            normal: Vec3::Z * side,
            interpolated: normal.map(|normal| normal * side),
            off_surface: 1e-4 * Vec3::Z * side,
            wo,
            front,
            material,
            bsdf: material.bsdf,
            uv: None,
            tangent: None,
        }
    }

    fn direction(rng: &mut Rng) -> Vec3 {
        let w = uniform_sphere(rng.next_2d());
        if w.z.abs() < 0.05 { direction(rng) } else { w }
    }

    #[test]
    fn densities_from_both_ends_of_a_path_are_equal() {
        let mut rng = StreamKey::new(6, Stream::Test, 0).rng(0);
        for bsdf in bsdfs() {
            let material = Material::new("some", bsdf);
            for round in 0..2000 {
                let bent = (Vec3::Z + 0.4 * uniform_sphere(rng.next_2d())).normalize();
                let normal = (round % 3 > 0).then_some(bent);
                let camera = direction(&mut rng);
                // Sample as light paths do, and, where surfaces can be passed through, as camera
                // paths do.
                let from_camera = surface(&material, camera, normal);
                let at = from_camera.vertex(Transport::Radiance);
                let wanted =
                    if bsdf.passes_through() { LobeSet::PassThrough } else { LobeSet::All };
                let sample = bsdf.sample(&at, Transport::Radiance, wanted, &mut rng);
                let Some(sample) = sample else { continue };
                if sample.wi.z.abs() < 1e-2 || !from_camera.agrees(&at, sample.wi) {
                    continue;
                }
                if sample.lobe.passes_through() {
                    let ways = Directions { camera, light: sample.wi };
                    let from_light = surface(&material, sample.wi, normal);
                    for choice in [PassChoice::Free, PassChoice::PassOnly] {
                        let both = [from_camera, from_light]
                            .map(|surface| ways.light_over_camera(&surface, sample.lobe, choice));
                        assert!((both[0] / both[1] - 1.0).abs() < 1e-4, "{bsdf:?} {both:?}");
                        // Ratios are bounded.
                        if sample.lobe == Lobe::Rough && (1e-6..1e6).contains(&both[0]) {
                            let densities = [from_camera, from_light]
                                .map(|s| ways.light_rough(&s) / ways.camera_rough(&s, choice));
                            for density in densities {
                                let off = density / both[0] - 1.0;
                                assert!(off.abs() < 1e-3, "{bsdf:?} {densities:?} {both:?}");
                            }
                        }
                    }
                }
                let light = direction(&mut rng);
                let transmits = light.z * camera.z < 0.0;
                if bsdf.merges() && (!transmits || bsdf.transmits_diffusely()) {
                    let from_light = surface(&material, light, normal);
                    let at_light = from_light.vertex(Transport::Flux);
                    let own = Survival::LIGHT.density(&bsdf, &at_light, camera);
                    let interpolated = from_camera.interpolated;
                    let view = GatherView { bsdf, at, interpolated, transmits };
                    let seen = view.light_density(light, from_light.normal);
                    assert!((own / seen - 1.0).abs() < 1e-4, "{bsdf:?} {own} {seen}");
                }
            }
        }
    }

    /// Values of both classes together are those of each, also where both are computed at once.
    #[test]
    fn lobes_have_the_values_and_densities_of_their_classes() {
        let mut rng = StreamKey::new(11, Stream::Test, 0).rng(0);
        let close = |one: f32, other: f32| (one - other).abs() <= 1e-5 * one.abs().max(other.abs());
        for bsdf in bsdfs() {
            let material = Material::new("some", bsdf);
            let mut positive = 0;
            for _ in 0..500 {
                let (camera, wi) = (direction(&mut rng), direction(&mut rng));
                let at = surface(&material, camera, None).vertex(Transport::Radiance);
                for (lobe, both) in [Lobe::Wide, Lobe::Rough].into_iter().zip(bsdf.lobes(&at, wi)) {
                    let (value, pdf_w) = (bsdf.eval_lobe(lobe, &at, wi), bsdf.pdf_w(lobe, &at, wi));
                    assert!(close(pdf_w, both.pdf_w), "{bsdf:?} {lobe:?} {pdf_w} {}", both.pdf_w);
                    for channel in 0..3 {
                        assert!(close(value[channel], both.value[channel]), "{bsdf:?} {lobe:?}");
                    }
                    positive += u32::from(value != Rgb::ZERO);
                }
            }
            assert_eq!(positive > 0, bsdf.merges() || bsdf.has_rough(), "{bsdf:?}");
        }
    }

    #[test]
    fn density_matches_the_samples_of_the_bsdf() {
        // The mean of 1/density over sampled directions within a cap is the projected solid angle
        // of the cap.
        let mut rng = StreamKey::new(7, Stream::Test, 0).rng(0);
        for bsdf in bsdfs().into_iter().filter(Bsdf::merges) {
            let material = Material::new("some", bsdf);
            let at = surface(&material, Vec3::new(0.48, 0.36, 0.8), None).vertex(Transport::Flux);
            let (n, mut sum, mut square) = (100_000, 0.0, 0.0);
            for _ in 0..n {
                let sample = bsdf.sample(&at, Transport::Flux, LobeSet::All, &mut rng);
                let sample = sample.filter(|s| s.lobe == Lobe::Wide && s.wi.z > 0.6);
                let one = sample
                    .map_or(0.0, |s| 1.0 / f64::from(Survival::Certain.density(&bsdf, &at, s.wi)));
                sum += one / f64::from(n);
                square += one * one / f64::from(n);
            }
            let error = ((square - sum * sum) / f64::from(n)).sqrt();
            let expected = std::f64::consts::PI * (1.0 - 0.36);
            assert!((sum - expected).abs() < 4.0 * error, "{bsdf:?}: {sum} +- {error} {expected}");
        }
    }

    #[test]
    fn density_ratio_of_rough_interface_approaches_the_smooth_one() {
        let mut rng = StreamKey::new(8, Stream::Test, 0).rng(0);
        let smooth = Bsdf::Dielectric(Dielectric::new(1.5));
        let rough = Bsdf::RoughDielectric(RoughDielectric::new(1.5, 0.02));
        let [smooth, rough] = [smooth, rough].map(|bsdf| Material::new("some", bsdf));
        let (mut refracted, choice) = (0, PassChoice::Free);
        for _ in 0..1000 {
            let camera = direction(&mut rng);
            let from = surface(&smooth, camera, None);
            let at = from.vertex(Transport::Radiance);
            let sample =
                smooth.bsdf.sample(&at, Transport::Radiance, LobeSet::All, &mut rng).unwrap();
            if sample.wi.z.abs() < 0.2 || camera.z.abs() < 0.2 {
                continue;
            }
            let ways = Directions { camera, light: sample.wi };
            let limit = ways.light_over_camera(&surface(&rough, camera, None), Lobe::Rough, choice);
            let ratio = ways.light_over_camera(&from, Lobe::Delta, choice);
            assert!((ratio / limit - 1.0).abs() < 0.02, "{camera} {}: {ratio} {limit}", sample.wi);
            refracted += u32::from(camera.z * sample.wi.z < 0.0);
        }
        assert!(refracted > 300, "{refracted}");
    }
}
