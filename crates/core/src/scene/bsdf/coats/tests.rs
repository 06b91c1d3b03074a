use super::*;
use crate::base::math::uniform_sphere;
use crate::base::rng::{Rng, Stream, StreamKey};
use crate::scene::bsdf::coated_base::{MetalRow, metal_of};
use crate::scene::bsdf::{
    Bsdf, Coated, Conductor, Glossy, LobeSet, LobeValue, Plastic, Reflectance, Transport, Vertex,
};
use crate::simd::dispatch::{Simd, transpose_rows};
use glam::DVec3;
use std::array::from_fn;

fn bsdfs() -> Vec<Bsdf> {
    let albedo = Rgb::new(0.8, 0.3, 0.1);
    let plastic = |model, alpha, is_nonlinear| {
        let facets = Facets { model, alpha };
        Bsdf::Plastic(Plastic::new(albedo, 1.5, facets, is_nonlinear))
    };
    vec![
        Bsdf::Lambertian { albedo, two_sided: true },
        Bsdf::Lambertian { albedo, two_sided: false },
        plastic(FacetModel::Ggx, 0.0, true),
        plastic(FacetModel::Ggx, 0.1, false),
        plastic(FacetModel::Ggx, 0.4, true),
        plastic(FacetModel::Beckmann, 0.05, true),
        plastic(FacetModel::Beckmann, 0.6, false),
        plastic(FacetModel::Correlated, 0.2, false),
        Bsdf::Plastic(
            Plastic::new(Rgb::ZERO, 1.3, Facets { model: FacetModel::Ggx, alpha: 0.2 }, true)
                .tinted(Rgb::new(0.5, 1.0, 0.2)),
        ),
        Bsdf::Coated(Coated::new(albedo, 1.5)),
        Bsdf::Glossy(Glossy::new(albedo, 0.0, 1.5, 0.0)),
        Bsdf::Glossy(Glossy::new(albedo, 0.0, 1.5, 0.15)),
        Bsdf::Glossy(Glossy::new(albedo, 0.0, 1.3, 0.6)),
    ]
}

/// Surfaces whose facets may be metal, wide and narrow, and one without any.
fn metals() -> Vec<Bsdf> {
    let albedo = Rgb::new(0.8, 0.3, 0.1);
    let metal = |alpha| Conductor::new(Reflectance::Artist { normal: albedo }, alpha);
    let mut all = Vec::new();
    for alpha in [0.0, 0.01, 0.15, 0.6, 1.0] {
        let glossy = |metallic| Bsdf::Glossy(Glossy::new(albedo, metallic, 1.5, alpha));
        all.extend([glossy(0.0), glossy(0.3), glossy(1.0), Bsdf::Conductor(metal(alpha))]);
    }
    all
}

/// Sixteen surfaces of one BSDF, seen from these vertices.
fn seen<const METAL: bool>(bsdf: &Bsdf, vertices: &[Vertex; LANES]) -> SeenCoats<METAL> {
    let rows = [if METAL { CoatedBase::of_metal(bsdf) } else { CoatedBase::of(bsdf) }; LANES];
    assert!(rows[0].flags & CoatedBase::IS_BASE != 0);
    let (mut coats, mut metals) = <(CoatedBases, Metals)>::default();
    transpose_rows(Simd::default(), &rows.each_ref(), &mut coats);
    if METAL {
        let rows = [MetalRow::of(&metal_of(bsdf).expect("a metal")); LANES];
        transpose_rows(Simd::default(), &rows.each_ref(), &mut metals);
    }
    let (mut normal, mut wo) = <(Vec3s, Vec3s)>::default();
    for (lane, vertex) in vertices.iter().enumerate() {
        normal.set(lane, vertex.normal);
        wo.set(lane, vertex.wo);
    }
    let front = vertices.map(|vertex| vertex.front);
    SeenCoats::new((&coats, &metals), &Vec3s::splat(Rgb::ONE), &front, &normal, &wo)
}

/// A vertex that is mostly seen from above.
fn vertex(rng: &mut Rng) -> Vertex {
    let normal = uniform_sphere(rng.next_2d());
    let wo = uniform_sphere(rng.next_2d());
    let below = wo.dot(normal) < 0.0 && rng.next_1d() < 0.9;
    let wo = if below { -wo } else { wo };
    Vertex { normal, wo, front: rng.next_1d() < 0.5, tangent: None }
}

#[track_caller]
fn assert_lobe<const METAL: bool>(found: (Rgb, f32), expected: &LobeValue, what: &Bsdf) {
    // Error functions are in double precision there, and in single precision here. What enters a
    // glossy surface is interpolated linearly there, and fitted here.
    let is_fitted = matches!(what, Bsdf::Glossy(_)) && !METAL;
    let share = if is_fitted { 1e-2 } else { 1e-3 };
    let tolerance = |size: f32| 1e-6 + share * size;
    let off = (found.0 - expected.value).abs().max_element();
    assert!(off <= tolerance(expected.value.max_element()), "{found:?} {expected:?} {what:?}");
    let off = (found.1 - expected.pdf_w).abs();
    assert!(off <= tolerance(expected.pdf_w), "{found:?} {expected:?} {what:?}");
}

#[test]
fn lobes_of_sixteen_are_those_of_one() {
    compare_lobes::<false>(bsdfs());
    compare_lobes::<true>(metals());
}

fn compare_lobes<const METAL: bool>(bsdfs: Vec<Bsdf>) {
    let mut rng = StreamKey::new(3, Stream::Test, 0).rng(0);
    for bsdf in bsdfs {
        for _ in 0..200 {
            let vertices = from_fn(|_| vertex(&mut rng));
            let mut wi = Vec3s::default();
            for (lane, at) in vertices.iter().enumerate() {
                // Half of the directions are near the peak.
                let any = uniform_sphere(rng.next_2d());
                let mirrored = reflect(at.wo, at.normal);
                let near = (mirrored + 0.2 * any).normalize();
                wi.set(lane, if lane % 2 == 0 { any } else { near });
            }
            let (wide, rough) = seen::<METAL>(&bsdf, &vertices).lobes(&wi);
            for (lane, at) in vertices.iter().enumerate() {
                let expected = bsdf.lobes(at, wi.get(lane));
                if at.wo.dot(at.normal).abs().min(wi.get(lane).dot(at.normal).abs()) < 1e-3 {
                    continue; // cosines are rounded
                }
                assert_lobe::<METAL>((wide.value.get(lane), wide.pdf_w[lane]), &expected[0], &bsdf);
                assert_lobe::<METAL>(
                    (rough.value.get(lane), rough.pdf_w[lane]),
                    &expected[1],
                    &bsdf,
                );
            }
        }
    }
}

/// Moments of the light that samples of one vertex carry.
#[derive(Default)]
struct Moments {
    count: f64,
    sum: [DVec3; 3],
    square: [DVec3; 3],
}

impl Moments {
    fn add(&mut self, sample: Option<(Vec3, Rgb, bool)>) {
        let (wi, weight, passes) = sample.unwrap_or_default();
        let passing = if passes { weight } else { Rgb::ZERO };
        let values = [weight, weight.x * wi, passing].map(Vec3::as_dvec3);
        self.count += 1.0;
        for (value, (sum, square)) in
            values.into_iter().zip(self.sum.iter_mut().zip(&mut self.square))
        {
            *sum += value;
            *square += value * value;
        }
    }

    fn mean(&self, of: usize) -> (DVec3, DVec3) {
        let mean = self.sum[of] / self.count;
        (mean, (self.square[of] / self.count - mean * mean).max(DVec3::ZERO) / self.count)
    }
}

#[test]
fn samples_of_sixteen_carry_the_light_of_those_of_one() {
    compare_samples::<false>(bsdfs());
    compare_samples::<true>(metals());
}

fn compare_samples<const METAL: bool>(bsdfs: Vec<Bsdf>) {
    let mut rng = StreamKey::new(4, Stream::Test, 0).rng(0);
    for bsdf in bsdfs {
        for cos in [0.15_f32, 0.7, 1.0] {
            let normal = Vec3::new(0.36, 0.48, 0.8);
            let across = normal.any_orthonormal_vector();
            let wo = (cos * normal + (1.0 - cos * cos).sqrt() * across).normalize();
            let at = Vertex { normal, wo, front: true, tangent: None };
            let seen = seen::<METAL>(&bsdf, &[at; LANES]);
            let [mut together, mut single] = [Moments::default(), Moments::default()];
            for _ in 0..3000 {
                let numbers = from_fn(|_| from_fn(|_| rng.next_1d()));
                let samples = seen.sample(&numbers);
                for lane in 0..LANES {
                    let sample = samples.is_some[lane].then(|| {
                        let (wi, weight) = (samples.wi.get(lane), samples.weight.get(lane));
                        (wi, weight, samples.passes_through[lane])
                    });
                    together.add(sample);
                    let one = bsdf.sample(&at, Transport::Radiance, LobeSet::All, &mut rng);
                    single.add(one.map(|one| (one.wi, one.weight, one.lobe.passes_through())));
                }
            }
            for of in 0..3 {
                let ((one, error), (other, other_error)) = (together.mean(of), single.mean(of));
                let bound = 4.5 * (error + other_error).map(f64::sqrt) + 2e-6;
                let off = (one - other).abs();
                assert!(off.cmple(bound).all(), "{of}: {one} {other} {bound} {bsdf:?}");
            }
        }
    }
}

#[test]
fn samples_have_the_density_of_their_lobes() {
    compare_densities::<false>(bsdfs());
    compare_densities::<true>(metals());
}

fn compare_densities<const METAL: bool>(bsdfs: Vec<Bsdf>) {
    let mut rng = StreamKey::new(5, Stream::Test, 0).rng(0);
    for bsdf in bsdfs {
        let vertices = from_fn(|_| vertex(&mut rng));
        let seen = seen::<METAL>(&bsdf, &vertices);
        for _ in 0..100 {
            let samples = seen.sample(&from_fn(|_| from_fn(|_| rng.next_1d())));
            let (wide, rough) = seen.lobes(&samples.wi);
            for lane in (0..LANES).filter(|&lane| samples.is_some[lane]) {
                let lobes = if samples.passes_through[lane] { &rough } else { &wide };
                if samples.is_delta[lane] {
                    assert_eq!((lobes.pdf_w[lane], samples.pdf_w[lane]), (0.0, 0.0));
                    continue;
                }
                assert_eq!(samples.pdf_w[lane], lobes.pdf_w[lane], "{bsdf:?}");
                let cos = samples.wi.get(lane).dot(vertices[lane].normal);
                let expected = lobes.value.get(lane) * (cos / lobes.pdf_w[lane]);
                let off = (samples.weight.get(lane) - expected).abs().max_element();
                assert!(off < 1e-5 * expected.max_element(), "{bsdf:?}");
            }
        }
    }
}
