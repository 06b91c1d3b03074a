//! Every BSDF keeps its promises: reciprocity, energy, and sampling in proportion to its density.

use crate::common::klems::uneven;
use bdpm::base::math::{luminance, uniform_sphere};
use bdpm::base::rng::{Rng, Stream, StreamKey};
use bdpm::scene::bsdf::{
    Bsdf, BsdfSample, Coated, Conductor, Dielectric, DiffuseTransmission, FacetModel, Facets,
    Glossy, Lobe, LobeSet, Plastic, Principled, PrincipledParameters, Reflectance, RoughDielectric,
    ThinDielectric, Transport, Vertex,
};
use glam::Vec3;
use std::f64::consts::{PI, TAU};

/// An oblique normal: no test may rest on an axis.
const NORMAL: Vec3 = Vec3::new(0.48, -0.6, 0.64);

/// A direction off the surface, which only its part along the surface counts of.
const TANGENT: Vec3 = Vec3::new(1.0, 0.4, 0.5);

fn rng(seed: u64) -> Rng {
    StreamKey::new(seed, Stream::Test, 0).rng(0)
}

fn white_metal(alpha: f32) -> Bsdf {
    Bsdf::Conductor(Conductor::new(Reflectance::Artist { normal: Vec3::ONE }, alpha))
}

fn gold(alpha: f32) -> Bsdf {
    Bsdf::Conductor(Conductor::new(Reflectance::named("gold").unwrap(), alpha))
}

const TINT: Vec3 = Vec3::new(1.0, 0.5, 0.9);

/// A white surface with single scattering only, as in Mitsuba.
fn once(model: FacetModel, alpha: f32) -> Bsdf {
    let white = Reflectance::Artist { normal: Vec3::ONE };
    Bsdf::Conductor(Conductor::once(white, Facets { model, alpha }, TINT))
}

fn walter_glass(model: FacetModel, alpha: f32) -> Bsdf {
    Bsdf::RoughDielectric(RoughDielectric::of(1.5, Facets { model, alpha }))
}

fn rough_glass(alpha: f32) -> Bsdf {
    Bsdf::RoughDielectric(RoughDielectric::new(1.5, alpha))
}

fn coated(albedo: f32) -> Bsdf {
    Bsdf::Coated(Coated::new(Vec3::splat(albedo), 1.5))
}

fn glossy(albedo: f32, metallic: f32, alpha: f32) -> Bsdf {
    Bsdf::Glossy(Glossy::new(Vec3::splat(albedo), metallic, 1.5, alpha))
}

fn reflecting(albedo: f32, factor: f32) -> Bsdf {
    Bsdf::Glossy(Glossy::new(Vec3::splat(albedo), 0.2, 1.5, 0.4).reflecting(factor))
}

fn plastic(albedo: f32, model: FacetModel, alpha: f32, is_nonlinear: bool) -> Bsdf {
    let facets = Facets { model, alpha };
    Bsdf::Plastic(Plastic::new(Vec3::splat(albedo), 1.5, facets, is_nonlinear).tinted(TINT))
}

/// Principled surfaces of all lobes; the first two merge by their facets.
fn principled() -> Vec<Bsdf> {
    let base_color = Vec3::new(0.2, 0.5, 0.9);
    let some = PrincipledParameters { base_color, ..PrincipledParameters::default() };
    [
        PrincipledParameters { roughness: 0.7, ..some },
        PrincipledParameters { roughness: 0.8, anisotropic: 0.6, metallic: 1.0, ..some },
        PrincipledParameters { roughness: 0.4, spec_tint: 0.7, flatness: 0.6, ..some },
        PrincipledParameters { sheen: 1.0, sheen_tint: 0.5, metallic: 0.3, ..some },
        PrincipledParameters { roughness: 0.5, clearcoat: 1.0, two_sided: false, ..some },
        PrincipledParameters { roughness: 0.5, anisotropic: 0.5, spec_trans: 0.6, ..some },
        PrincipledParameters {
            roughness: 0.6,
            metallic: 0.2,
            spec_trans: 1.0,
            clearcoat: 0.5,
            sheen: 0.3,
            ..some
        },
        PrincipledParameters { eta: 1.0 / 1.5, roughness: 0.5, spec_tint: 0.5, ..some },
    ]
    .map(|parameters| Bsdf::Principled(Principled::new(parameters)))
    .to_vec()
}

/// A sheet that reflects and transmits diffusely.
fn sheet() -> Bsdf {
    let (reflectance, transmittance) = (Vec3::new(0.2, 0.5, 0.9), Vec3::new(0.7, 0.1, 0.1));
    Bsdf::DiffuseTransmission(DiffuseTransmission::new(reflectance, transmittance))
}

/// All that have lobes of finite density.
fn spread() -> Vec<Bsdf> {
    let albedo = Vec3::new(0.2, 0.5, 1.0);
    let mut all = vec![
        Bsdf::diffuse(albedo),
        Bsdf::Lambertian { albedo, two_sided: false },
        sheet(),
        Bsdf::DiffuseTransmission(DiffuseTransmission::new(Vec3::ZERO, albedo)),
        uneven(0.9, TANGENT),
        white_metal(0.2),
        white_metal(0.8),
        gold(0.4),
        once(FacetModel::Ggx, 0.2),
        once(FacetModel::Beckmann, 0.15),
        once(FacetModel::Beckmann, 0.6),
        walter_glass(FacetModel::Ggx, 0.3),
        walter_glass(FacetModel::Beckmann, 0.3),
        rough_glass(0.2),
        rough_glass(0.7),
        Bsdf::RoughDielectric(RoughDielectric::new(1.5, 0.3).tinted(Vec3::new(1.0, 0.3, 0.6))),
        coated(0.6),
        coated(1.0),
        glossy(0.6, 0.0, 0.0),
        glossy(0.6, 0.0, 0.2),
        glossy(0.6, 0.0, 0.6),
        glossy(0.8, 0.4, 0.2),
        glossy(0.8, 0.4, 0.5),
        glossy(0.8, 1.0, 0.2),
        glossy(0.8, 1.0, 0.5),
        reflecting(0.6, 0.2),
        reflecting(0.6, 3.0),
        plastic(0.6, FacetModel::Ggx, 0.0, true),
        plastic(0.6, FacetModel::Ggx, 0.0, false),
        plastic(0.6, FacetModel::Ggx, 0.15, true),
        plastic(0.6, FacetModel::Beckmann, 0.2, false),
        plastic(1.0, FacetModel::Beckmann, 0.5, true),
    ];
    all.extend(principled());
    all
}

/// Seen at the angle of cosine `cos`, from the front or the back.
fn seen(cos: f32, front: bool) -> Vertex {
    let (tangent, bitangent) = NORMAL.any_orthonormal_pair();
    let sin = (1.0 - cos * cos).sqrt();
    let wo = cos * NORMAL + sin * (0.8 * tangent - 0.6 * bitangent);
    Vertex { normal: NORMAL, wo, front, tangent: Some(TANGENT) }
}

/// Views that differ in everything that matters.
fn views() -> [Vertex; 5] {
    [seen(1.0, true), seen(0.7, true), seen(0.7, false), seen(0.3, false), seen(0.15, true)]
}

#[test]
fn bsdf_values_are_reciprocal() {
    let mut rng = rng(1);
    for bsdf in spread() {
        let mut compared = 0;
        for _ in 0..2000 {
            let [wo, wi] = [0; 2].map(|_| uniform_sphere(rng.next_2d()));
            let vertex = |wo: Vec3| {
                let front = wo.dot(NORMAL) > 0.0;
                let normal = if front { NORMAL } else { -NORMAL };
                Vertex { normal, wo, front, tangent: Some(TANGENT) }
            };
            // f(wo, wi) / n_o^2 is symmetric: n = 1 in front, 1.5 behind where light gets there.
            let behind = if bsdf.transmits_diffusely() { 1.0 } else { 1.5 };
            let index = |w: Vec3| if w.dot(NORMAL) > 0.0 { 1.0 } else { behind };
            let scale =
                if wo.dot(NORMAL) * wi.dot(NORMAL) > 0.0 { 1.0 } else { index(wo) / index(wi) };
            let forth = bsdf.eval(&vertex(wo), wi);
            let back = bsdf.eval(&vertex(wi), wo) * scale * scale;
            // Facets that refract little turn fast with rounding, where hardly any are.
            let size = forth.max_element().max(back.max_element());
            assert!(
                (forth - back).abs().max_element() <= 1e-3 * size + 1e-5,
                "{bsdf:?} {forth} {back}"
            );
            compared += usize::from(size > 0.0);
        }
        assert!(compared > 200, "{bsdf:?}: {compared}");
    }
}

/// Mean weight of sampled directions: the scattered share of the light that arrives from `wo`.
fn scattered(bsdf: &Bsdf, at: &Vertex, rng: &mut Rng) -> (f64, f64) {
    let n = 40_000;
    let (mut sum, mut square) = (0.0, 0.0);
    for _ in 0..n {
        let sample = bsdf.sample(at, Transport::Flux, LobeSet::All, rng);
        let weight = sample.map_or(0.0, |s| f64::from(luminance(s.weight)));
        sum += weight / f64::from(n);
        square += weight * weight / f64::from(n);
    }
    (sum, ((square - sum * sum).max(0.0) / f64::from(n)).sqrt())
}

#[test]
fn white_surfaces_in_a_white_furnace_are_invisible() {
    let mut rng = rng(2);
    let mut lossless = vec![
        Bsdf::diffuse(Vec3::ONE),
        Bsdf::Mirror { reflectance: Vec3::ONE },
        Bsdf::Dielectric(Dielectric::new(1.5)),
        Bsdf::ThinDielectric(ThinDielectric::new(1.5)),
        Bsdf::DiffuseTransmission(DiffuseTransmission::new(Vec3::splat(0.25), Vec3::splat(0.75))),
        coated(1.0),
        reflecting(1.0, 0.2),
        reflecting(1.0, 3.0),
    ];
    for alpha in [0.0, 0.01, 0.1, 0.25, 0.5, 1.0] {
        lossless.push(white_metal(alpha));
        lossless.extend([0.0, 0.4, 1.0].map(|metallic| glossy(1.0, metallic, alpha)));
    }
    for bsdf in lossless {
        for at in views() {
            let (mean, error) = scattered(&bsdf, &at, &mut rng);
            assert!(error < 3e-3, "{bsdf:?}: {error}");
            assert!((mean - 1.0).abs() < 4.0 * error + 5e-3, "{bsdf:?} {at:?}: {mean} +- {error}");
        }
    }
}

#[test]
fn single_scattering_loses_as_much_as_in_mitsuba() {
    // Mitsuba 3.9.1: reflected share of light from the cosine 0.6 at a `roughconductor` of material
    // `none`, means of a million samples, within 4e-4.
    let mut rng = rng(31);
    for (model, alpha, expected) in [
        (FacetModel::Ggx, 0.1, 0.9766),
        (FacetModel::Ggx, 0.25, 0.8705),
        (FacetModel::Ggx, 0.5, 0.6803),
        (FacetModel::Ggx, 1.0, 0.3836),
        (FacetModel::Beckmann, 0.1, 1.0),
        (FacetModel::Beckmann, 0.25, 0.9685),
        (FacetModel::Beckmann, 0.5, 0.8674),
        (FacetModel::Beckmann, 1.0, 0.7076),
    ] {
        let (mean, error) = scattered(&once(model, alpha), &seen(0.6, true), &mut rng);
        let expected = expected * f64::from(luminance(TINT));
        assert!(error < 3e-3, "{model:?} {alpha}: {error}");
        // Mitsuba masks Beckmann's facets by a fit.
        assert!(
            (mean - expected).abs() < 4.0 * error + 4e-3,
            "{model:?} {alpha}: {mean} {expected}"
        );
    }
}

#[test]
fn rough_glass_loses_the_documented_share() {
    // Under diffuse light, from the front: at most this share.
    let mut rng = rng(3);
    for (alpha, most) in [(0.1, 0.009), (0.3, 0.038), (1.0, 0.21)] {
        let n = 200_000;
        let mut kept = 0.0;
        for _ in 0..n {
            let cos = rng.next_1d().sqrt().max(1e-3);
            let sample = rough_glass(alpha).sample(
                &seen(cos, true),
                Transport::Flux,
                LobeSet::All,
                &mut rng,
            );
            kept += sample.map_or(0.0, |s| f64::from(s.weight.x)) / f64::from(n);
        }
        let lost = 1.0 - kept;
        assert!(0.9 * most < lost && lost < most, "{alpha}: loses {lost}");
    }
}

#[test]
fn the_weight_of_a_sample_is_value_times_cosine_over_density() {
    let mut rng = rng(4);
    for bsdf in spread() {
        for at in views() {
            let mut compared = 0;
            for _ in 0..500 {
                let Some(BsdfSample { wi, weight, lobe }) =
                    bsdf.sample(&at, Transport::Radiance, LobeSet::All, &mut rng)
                else {
                    continue;
                };
                if lobe == Lobe::Delta {
                    continue;
                }
                // Not the widest where it has two.
                let other = bsdf.has_rough().then_some(Lobe::Rough);
                assert!([bsdf.spread(), other].contains(&Some(lobe)));
                let cos = wi.dot(NORMAL).abs();
                let expected = bsdf.eval_lobe(lobe, &at, wi) * cos / bsdf.pdf_w(lobe, &at, wi);
                // Grazing facets amplify the rounding of directions.
                let off = (weight - expected).abs().max_element() / expected.max_element();
                assert!(off < 1e-2 || cos < 1e-2, "{bsdf:?} {at:?}: {weight}, not {expected}");
                compared += 1;
            }
            let black = bsdf.eval(&at, NORMAL) == Vec3::ZERO && !bsdf.transmits();
            assert!(compared > 100 || black, "{bsdf:?} {at:?}: {compared}");
        }
    }
}

/// Directions are counted in cells of equal solid angle: rows of `cos`, columns of azimuth.
const ROWS: usize = 24;
const COLUMNS: usize = 16;

fn cell(w: Vec3) -> usize {
    let (tangent, bitangent) = NORMAL.any_orthonormal_pair();
    let row = (f64::from(w.dot(NORMAL)) + 1.0) / 2.0 * ROWS as f64;
    let azimuth = f64::from(w.dot(bitangent)).atan2(f64::from(w.dot(tangent))) / TAU + 0.5;
    let column = ((azimuth * COLUMNS as f64) as usize).min(COLUMNS - 1);
    (row as usize).min(ROWS - 1) * COLUMNS + column
}

/// Integral of the density over each cell, by a fine grid.
fn cell_probabilities(bsdf: &Bsdf, at: &Vertex) -> Vec<f64> {
    const FINE: usize = 24;
    let (tangent, bitangent) = NORMAL.any_orthonormal_pair();
    let mut probabilities = vec![0.0; ROWS * COLUMNS];
    let (rows, columns) = (ROWS * FINE, COLUMNS * FINE);
    let area = 4.0 * PI / (rows * columns) as f64;
    for i in 0..rows {
        let cos = (2.0 * (i as f64 + 0.5) / rows as f64 - 1.0) as f32;
        let sin = (1.0 - cos * cos).sqrt();
        for j in 0..columns {
            let azimuth = TAU * ((j as f64 + 0.5) / columns as f64 - 0.5);
            let (y, x) = azimuth.sin_cos();
            let w = cos * NORMAL + sin * (x as f32 * tangent + y as f32 * bitangent);
            let place = i / FINE * COLUMNS + j / FINE;
            let density = [Lobe::Wide, Lobe::Rough].map(|lobe| bsdf.pdf_w(lobe, at, w));
            probabilities[place] += f64::from(density[0] + density[1]) * area;
        }
    }
    probabilities
}

#[test]
fn directions_come_as_often_as_their_density_says() {
    let mut rng = rng(5);
    for bsdf in spread() {
        for at in [seen(0.8, true), seen(0.4, false)] {
            if bsdf.eval(&at, NORMAL) == Vec3::ZERO && !bsdf.transmits() {
                continue; // the black back
            }
            let n = 100_000;
            let mut counts = vec![0.0; ROWS * COLUMNS];
            let mut spread = 0.0;
            for _ in 0..n {
                if let Some(BsdfSample { wi, lobe, .. }) =
                    bsdf.sample(&at, Transport::Radiance, LobeSet::All, &mut rng)
                    && lobe != Lobe::Delta
                {
                    counts[cell(wi)] += 1.0;
                    spread += 1.0;
                }
            }
            // Cells in which fewer than 20 are expected are pooled.
            let (mut chi2, mut degrees) = (0.0, 0.0);
            let (mut rest, mut rest_expected, mut all) = (0.0, 0.0, 0.0);
            for (count, probability) in counts.iter().zip(cell_probabilities(&bsdf, &at)) {
                let expected = probability * f64::from(n);
                all += expected;
                if expected < 20.0 {
                    rest += count;
                    rest_expected += expected;
                    continue;
                }
                // The fine grid is off by up to 1 % where the density is steep.
                let variance = expected + (0.01 * expected).powi(2);
                chi2 += (count - expected).powi(2) / variance;
                degrees += 1.0;
            }
            assert!(
                (rest - rest_expected).abs()
                    < 4.0 * (rest_expected + 1.0).sqrt() + 0.02 * rest_expected
            );
            assert!(
                (spread - all).abs() < 4.0 * f64::from(n).sqrt() * 0.5 + 2e-3 * all,
                "{spread} {all}"
            );
            // Wilson and Hilferty 1931: the cube root is nearly normal.
            let ninth = 2.0 / (9.0 * degrees);
            let deviation = ((chi2 / degrees).cbrt() - (1.0 - ninth)) / f64::sqrt(ninth);
            assert!(
                deviation < 4.0,
                "{bsdf:?} {at:?}: {chi2} of {degrees}, {deviation} deviations"
            );
            assert!(degrees > 10.0);
        }
    }
}

#[test]
fn delta_lobes_go_where_optics_sends_them() {
    let mut rng = rng(6);
    let at = seen(0.8, true);
    let mirror = 2.0 * at.wo.dot(NORMAL) * NORMAL - at.wo;
    // Snell: sin 0.6 outside is 0.4 inside.
    let tangent = -(at.wo - 0.8 * NORMAL) / 0.6;
    let half = Vec3::splat(0.5);
    let refracted = 0.4 * tangent - (1.0_f32 - 0.16).sqrt() * NORMAL;
    for (bsdf, beyond, scale) in [
        (Bsdf::Dielectric(Dielectric::new(1.5)), refracted, 1.0 / 2.25),
        (Bsdf::ThinDielectric(ThinDielectric::new(1.5)), -at.wo, 1.0),
        (Bsdf::Dielectric(Dielectric { eta: 1.5, transmittance: half }), refracted, 0.5 / 2.25),
        (
            Bsdf::ThinDielectric(ThinDielectric {
                transmittance: half,
                ..ThinDielectric::new(1.5)
            }),
            -at.wo,
            0.5,
        ),
    ] {
        let mut passed = 0;
        for _ in 0..1000 {
            let s = bsdf.sample(&at, Transport::Radiance, LobeSet::PassThrough, &mut rng).unwrap();
            assert_eq!(s.lobe, Lobe::Delta);
            if s.wi.dot(NORMAL) > 0.0 {
                assert!((s.wi - mirror).length() < 1e-5 && s.weight == Vec3::ONE);
            } else {
                assert!((s.wi - beyond).length() < 1e-5, "{} {beyond}", s.wi);
                assert!((s.weight.x - scale).abs() < 1e-6);
                passed += 1;
            }
        }
        assert!((850..1000).contains(&passed), "{passed}");
    }
    // From inside at 0.8 (sin 0.6 * 1.5 = 0.9) light gets out, at 0.7 none does.
    let glass = Bsdf::Dielectric(Dielectric::new(1.5));
    for _ in 0..1000 {
        let sample =
            glass.sample(&seen(0.7, false), Transport::Flux, LobeSet::All, &mut rng).unwrap();
        assert!(sample.wi.dot(NORMAL) > 0.0);
    }
}

#[test]
fn lobe_classes_match_the_paths() {
    let classes = [
        (Bsdf::diffuse(Vec3::ONE), Some(Lobe::Wide), false),
        (Bsdf::Mirror { reflectance: Vec3::ONE }, None, true),
        (white_metal(0.0), None, true),
        (white_metal(0.2), Some(Lobe::Rough), true),
        (white_metal(0.5), Some(Lobe::Wide), false),
        (rough_glass(0.9), Some(Lobe::Rough), true),
        (coated(0.5), Some(Lobe::Wide), true),
        (glossy(0.5, 0.0, 0.0), Some(Lobe::Wide), true),
        (glossy(0.5, 0.0, 0.2), Some(Lobe::Wide), true),
        (glossy(0.5, 0.0, 0.5), Some(Lobe::Wide), false),
        (glossy(0.5, 1.0, 0.2), Some(Lobe::Rough), true),
        (glossy(0.0, 0.0, 0.0), None, true),
    ];
    let mut rng = rng(7);
    for (bsdf, spread, passes) in classes {
        assert_eq!((bsdf.spread(), bsdf.passes_through()), (spread, passes), "{bsdf:?}");
        assert_eq!(bsdf.merges(), spread == Some(Lobe::Wide));
        for _ in 0..200 {
            let sample =
                bsdf.sample(&seen(0.6, true), Transport::Flux, LobeSet::PassThrough, &mut rng);
            assert!(sample.is_none_or(|s| s.lobe.passes_through()), "{bsdf:?}");
            assert!(passes || sample.is_none(), "{bsdf:?}");
        }
    }
}

#[test]
fn the_lobes_of_one_vertex_add_up() {
    let mut rng = rng(8);
    for bsdf in spread() {
        for at in views() {
            for _ in 0..100 {
                let wi = uniform_sphere(rng.next_2d());
                let lobes = [Lobe::Wide, Lobe::Rough].map(|lobe| bsdf.eval_lobe(lobe, &at, wi));
                let (sum, all) = (lobes[0] + lobes[1], bsdf.eval(&at, wi));
                assert!((sum - all).length() <= 1e-5 * all.length(), "{bsdf:?}: {sum} {all}");
                assert_eq!(bsdf.eval_lobe(Lobe::Delta, &at, wi), Vec3::ZERO);
            }
        }
    }
}

#[test]
fn a_glossy_surface_is_a_metal_or_a_base_at_its_ends() {
    let mut rng = rng(9);
    let albedo = Vec3::new(0.9, 0.6, 0.3);
    for _ in 0..1000 {
        let alpha = rng.next_1d().max(0.05);
        let (at, wi) = (seen(rng.next_1d().max(0.05), true), uniform_sphere(rng.next_2d()));
        let metal = Bsdf::Conductor(Conductor::new(Reflectance::Artist { normal: albedo }, alpha));
        let [none, half, full] = [0.0, 0.5, 1.0]
            .map(|metallic| Bsdf::Glossy(Glossy::new(albedo, metallic, 1.5, alpha)).eval(&at, wi));
        assert!((full - metal.eval(&at, wi)).length() <= 1e-4 * full.length(), "{alpha}");
        assert!((half - 0.5 * (none + full)).length() <= 1e-4 * half.length(), "{alpha}");
        // Facets that reflect nothing but at grazing leave the base's color.
        let clear = Bsdf::Glossy(Glossy::new(albedo, 0.0, 1.0, 0.0));
        let up = clear.eval(&seen(1.0, true), NORMAL);
        assert!((up / albedo - up.x / albedo.x).length() < 1e-5);
    }
}
