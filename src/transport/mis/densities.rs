//! How densely paths of either kind go on where they scatter, in projected solid angle: the area that they cover
//! at the next vertex then needs no cosines and distances, which cancel between both kinds.

use crate::scene::Surface;
use crate::scene::bsdf::{Bsdf, Lobe, Transport, Vertex};
use glam::Vec3;
use std::f32::consts::FRAC_1_PI;

/// Densities below count as this one: where a path of one kind cannot go, but rounding leaves it a way.
const LEAST: f32 = 1e-9;

/// Roulette at a merging lobe. What depends on a path's throughput counts as certain, for paths of both kinds.
#[derive(Clone, Copy, Debug)]
pub struct Survival {
    /// Whether paths survive by the share that is reflected.
    pub by_albedo: bool,
    /// At most with this probability.
    pub most: f32,
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
    /// Density at a Lambertian surface, in all directions alike.
    #[inline(always)] // part of vector loops
    pub fn lambertian(&self, albedo: f32) -> f32 {
        let survival = if self.by_albedo { albedo.min(self.most) } else { 1.0 };
        (survival * FRAC_1_PI).max(LEAST)
    }

    /// Density of going on toward `wi` from lobes that merge.
    /// theory.md (47a)
    pub fn density(&self, bsdf: &Bsdf, at: &Vertex, wi: Vec3) -> f32 {
        let cos = wi.dot(at.normal);
        if let Some(albedo) = bsdf.diffuse_albedo(at.front) {
            return if cos > 0.0 { self.lambertian(albedo.max_element()) } else { LEAST };
        }
        let density = bsdf.pdf_w(Lobe::Diffuse, at, wi) / cos.abs().max(LEAST);
        let survival = if self.by_albedo {
            // The weight is f/density.
            (self.most * density).min(bsdf.eval_lobe(Lobe::Diffuse, at, wi).max_element())
        } else {
            density
        };
        survival.max(LEAST)
    }
}

impl Directions {
    /// Density of light paths over that of camera paths where `surface` lets both through by a lobe. After a diffuse
    /// vertex, camera paths pass through wherever they can.
    /// theory.md (47a)
    #[inline(never)] // rare
    pub fn light_over_camera(&self, surface: &Surface, lobe: Lobe) -> f32 {
        let bsdf = &surface.bsdf;
        let at_light = surface.seen_from(self.light).vertex(Transport::Flux);
        let at_camera = surface.seen_from(self.camera).vertex(Transport::Radiance);
        let chosen = bsdf.pass_prob(&at_light);
        let ratio = if lobe == Lobe::Delta {
            let refracted = self.light.dot(surface.normal) * self.camera.dot(surface.normal) < 0.0;
            let eta = if refracted { bsdf.relative_index(at_camera.front) } else { 1.0 };
            chosen / (eta * eta)
        } else {
            let density = |at: &Vertex, wi: Vec3| {
                bsdf.pdf_w(Lobe::Rough, at, wi) / wi.dot(at.normal).abs().max(LEAST)
            };
            let light = density(&at_light, self.camera);
            let camera = density(&at_camera, self.light) / bsdf.pass_prob(&at_camera).max(LEAST);
            light.max(LEAST) / camera.max(LEAST)
        };
        ratio.clamp(LEAST, LEAST.recip())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::math::{Rgb, uniform_sphere};
    use crate::base::rng::{Rng, Stream, StreamKey};
    use crate::scene::Material;
    use crate::scene::bsdf::{
        Coated, Conductor, Dielectric, Glossy, LobeSet, Reflectance, RoughDielectric,
        ThinDielectric,
    };
    use crate::scene::diffuse::TriangleSide;
    use crate::settings::{Direct, Roulette, Settings, Strategy};
    use crate::transport::gather::GatherView;
    use crate::transport::mis::Mis;

    fn bsdfs() -> Vec<Bsdf> {
        let metal = Reflectance::Artist { normal: Vec3::new(0.9, 0.8, 0.6) };
        let glossy = |metallic, alpha| {
            Bsdf::Glossy(Glossy::new(Vec3::new(0.7, 0.3, 0.2), metallic, 1.5, alpha))
        };
        vec![
            Bsdf::diffuse(Rgb::new(0.2, 0.7, 0.5)),
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
        }
    }

    fn direction(rng: &mut Rng) -> Vec3 {
        let w = uniform_sphere(rng.next_2d());
        if w.z.abs() < 0.05 { direction(rng) } else { w }
    }

    fn mis(roulette: Roulette) -> Mis {
        let none = Default::default();
        let settings = Settings::resolve(&none, &none, 1.0).unwrap();
        let settings = Settings { strategy: Strategy::Mis, direct: Direct::Connect, ..settings };
        Mis::new(&Settings { camera_roulette: roulette, light_roulette: roulette, ..settings })
            .unwrap()
    }

    #[test]
    fn light_paths_and_camera_paths_compute_the_same_densities() {
        let mut rng = StreamKey::new(6, Stream::Test, 0).rng(0);
        for bsdf in bsdfs() {
            let material = Material::new("some", bsdf);
            for round in 0..2000 {
                let mis = mis([Roulette::Albedo, Roulette::Weight][round % 2]);
                let bent = (Vec3::Z + 0.4 * uniform_sphere(rng.next_2d())).normalize();
                let normal = (round % 3 > 0).then_some(bent);
                let camera = direction(&mut rng);
                // As light paths go on, and, where they pass through in any way, as camera paths do.
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
                    let both = [from_camera, from_light]
                        .map(|surface| ways.light_over_camera(&surface, sample.lobe));
                    assert!((both[0] / both[1] - 1.0).abs() < 1e-4, "{bsdf:?} {both:?}");
                }
                let light = direction(&mut rng);
                if bsdf.merges() && light.z * camera.z > 0.0 {
                    let at_light = surface(&material, light, normal).vertex(Transport::Flux);
                    let own = mis.light.density(&bsdf, &at_light, camera);
                    let interpolated = from_camera.interpolated;
                    let view = GatherView { bsdf, at, interpolated };
                    let seen = view.light_density(&mis, light, from_camera.normal);
                    assert!((own / seen - 1.0).abs() < 1e-4, "{bsdf:?} {own} {seen}");
                }
            }
        }
    }

    #[test]
    fn densities_are_those_of_the_paths() {
        // The mean over sampled directions of 1/density over a part of them is its projected solid angle.
        let mut rng = StreamKey::new(7, Stream::Test, 0).rng(0);
        for bsdf in bsdfs().into_iter().filter(Bsdf::merges) {
            let material = Material::new("some", bsdf);
            let survival = mis(Roulette::Weight).light;
            let at = surface(&material, Vec3::new(0.48, 0.36, 0.8), None).vertex(Transport::Flux);
            let (n, mut sum, mut square) = (100_000, 0.0, 0.0);
            for _ in 0..n {
                let sample = bsdf.sample(&at, Transport::Flux, LobeSet::All, &mut rng);
                let sample = sample.filter(|s| s.lobe == Lobe::Diffuse && s.wi.z > 0.6);
                let one =
                    sample.map_or(0.0, |s| 1.0 / f64::from(survival.density(&bsdf, &at, s.wi)));
                sum += one / f64::from(n);
                square += one * one / f64::from(n);
            }
            let error = ((square - sum * sum) / f64::from(n)).sqrt();
            let expected = std::f64::consts::PI * (1.0 - 0.36);
            assert!((sum - expected).abs() < 4.0 * error, "{bsdf:?}: {sum} +- {error} {expected}");
        }
    }

    #[test]
    fn smooth_interfaces_are_the_limit_of_rough_ones() {
        let mut rng = StreamKey::new(8, Stream::Test, 0).rng(0);
        let smooth = Bsdf::Dielectric(Dielectric::new(1.5));
        let rough = Bsdf::RoughDielectric(RoughDielectric::new(1.5, 0.02));
        let [smooth, rough] = [smooth, rough].map(|bsdf| Material::new("some", bsdf));
        let mut refracted = 0;
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
            let limit = ways.light_over_camera(&surface(&rough, camera, None), Lobe::Rough);
            let ratio = ways.light_over_camera(&from, Lobe::Delta);
            assert!((ratio / limit - 1.0).abs() < 0.02, "{camera} {}: {ratio} {limit}", sample.wi);
            refracted += u32::from(camera.z * sample.wi.z < 0.0);
        }
        assert!(refracted > 300, "{refracted}");
    }
}
