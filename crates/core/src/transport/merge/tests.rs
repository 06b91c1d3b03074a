//! Sums and pairs of both orders of queries, compared with each other and with all pairs of photons
//! and points.

use super::*;
use crate::base::math::{disc_area, luminance, uniform_sphere};
use crate::base::rng::{Rng, Stream, StreamKey};
use crate::scene::bsdf::{Bsdf, Vertex};
use crate::scene::diffuse::TriangleSide;
use crate::simd::f32x8::Portable;
use crate::transport::area::admission::THICKNESS;
use crate::transport::gather::GatherView;
use crate::transport::kernel::ByClass;
use crate::transport::photon::Photon;
use glam::Vec3;

/// On the floor of a box a unit wide or anywhere in it, with a normal near the vertical.
fn place(rng: &mut Rng) -> (Vec3, Vec3) {
    let [x, y] = rng.next_2d();
    let z = if rng.next_1d() < 0.5 { 0.0 } else { rng.next_1d() };
    let normal = (Vec3::Z + 1.2 * uniform_sphere(rng.next_2d())).normalize();
    (Vec3::new(x, y, z), normal)
}

fn photons(count: u32) -> Vec<Photon> {
    let photon = |path| {
        let mut rng = StreamKey::new(1, Stream::Test, 0).rng(u64::from(path));
        let (position, normal) = place(&mut rng);
        let late = rng.next_1d() < 0.7;
        let class = if late { PhotonClass::Diffuse } else { PhotonClass::Caustic };
        let flux = Rgb::new(1.0, rng.next_1d(), rng.next_1d());
        let from = (normal + 0.9 * uniform_sphere(rng.next_2d())).normalize();
        Photon::new(position, path, flux, normal, class).coming_from(from)
    };
    (0..count).map(photon).collect()
}

/// Paths with up to three gather points, some of them at a BSDF that depends on directions.
fn camera_paths(count: u32) -> CameraPaths {
    let mut paths = CameraPaths::default();
    let mut rng = StreamKey::new(2, Stream::Test, 0).rng(0);
    for vertex in 1..=3 {
        for path in (0..count).filter(|path| path % 4 != vertex) {
            let (position, normal) = place(&mut rng);
            let weight = Rgb::new(rng.next_1d(), 1.0, rng.next_1d());
            let view = if rng.next_1d() < 0.2 {
                let at = Vertex { normal, wo: normal, front: true, tangent: None };
                paths.views.push(GatherView {
                    bsdf: Bsdf::diffuse(Rgb::splat(0.5)),
                    at,
                    interpolated: None,
                    transmits: false,
                });
                paths.views.len() as u32 - 1
            } else {
                GatherPoint::NO_VIEW
            };
            let point = GatherPoint {
                position,
                path,
                weight,
                vertex,
                wavelength: None,
                normal,
                view,
                facet: TriangleSide::default(),
            };
            paths.gather_points.push(&point);
        }
    }
    paths.direct.resize(count as usize, Rgb::ONE);
    paths
}

#[test]
fn sums_in_either_order_of_queries_match_all_pairs() {
    let all = assert_sums(20_000, [0.05; 2], f32::INFINITY);
    assert!(all > 5000);
    // Ranges of one query share an octet.
    assert!(assert_sums(40, [0.4; 2], f32::INFINITY) > 500);
    for radii in [[0.02, 0.05], [0.06, 0.03]] {
        assert!(assert_sums(20_000, radii, f32::INFINITY) > 1000);
        assert!(assert_sums(20_000, radii, THICKNESS) > 1000);
    }
    // Photons on other planes do not count.
    let flat = assert_sums(20_000, [0.05; 2], THICKNESS);
    assert!(flat > 3000 && flat < all, "{flat} of {all}");
}

#[test]
fn merged_light_does_not_depend_on_the_processor() {
    let (photons, paths) = (photons(20_000), camera_paths(500));
    let mut map = PhotonMap::default();
    let kernel = MergeKernel::discs([0.06, 0.04]);
    map.build_from(&[&photons], kernel.reach());
    let options = MergeOptions { records_annulus: true, ..MergeOptions::default() };
    let mut merge = Merge::new(&map, 3, kernel, options);
    merge.admission.flattening = (127.0 * THICKNESS).powi(-2);
    let found = [false, true].map(|portable| {
        let (mut output, part) = (MergeOutput::default(), 0..500);
        output.clear(part.len(), &options);
        let (merge, paths) = (&merge, &paths);
        let work = MergePart::<true> { merge, paths, part: &part, output: &mut output };
        assert!(if portable { work.run(Portable) } else { by_f32x8(work) });
        output.pairs.order_by_path(part.clone());
        let pairs: Vec<_> = part
            .flat_map(|path| output.pairs.of_path(path))
            .map(|(pairs, nested)| (pairs.to_vec(), nested))
            .collect();
        assert!(pairs.len() > 300, "{}", pairs.len());
        (output.sums, output.annulus, pairs)
    });
    assert!(found[0] == found[1]);
}

/// Compares all sums; photons count up to `thickness` times the radius off their own planes.
fn assert_sums(count: u32, radii: ByClass<f32>, thickness: f32) -> usize {
    let [all, again] =
        [false, true].map(|annulus| assert_sums_of(count, radii, thickness, annulus));
    assert_eq!(all, again);
    all
}

fn assert_sums_of(count: u32, radii: ByClass<f32>, thickness: f32, annulus: bool) -> usize {
    let photons = photons(count);
    let paths = camera_paths(500);
    let mut map = PhotonMap::default();
    let kernel = MergeKernel::discs(radii);
    map.build_from(&[&photons], kernel.reach());
    let options = MergeOptions { records_annulus: annulus, ..MergeOptions::default() };
    let mut merge = Merge::new(&map, 3, kernel, options);
    merge.admission.flattening = (127.0 * thickness).powi(-2);
    let orders = [false, true].map(|by_zone| Merge { by_zone, ..merge });
    let [mut found, mut by_zone] = orders.map(|merge| {
        let found = find(&merge, &paths);
        // Lists of any size have the pairs in the same order.
        for max_pairs in [1, 10, 100, 1000] {
            assert_eq!(find(&Merge { max_pairs, ..merge }, &paths), found);
        }
        let mut output = MergeOutput::default();
        merge.gather(&paths, &mut output);
        assert_eq!(output.sums, found.sums);
        assert_eq!(output.annulus, found.annulus);
        found
    });
    found.sort();
    by_zone.sort();
    assert_eq!(by_zone, found);

    // Every photon with every point.
    let mut total = 0;
    for (path, sum) in found.sums.iter().enumerate() {
        let (mut pairs, mut nested, mut expected) = (Vec::new(), [0.0; 2], Rgb::ZERO);
        let mut annulus = [Rgb::ZERO; 2];
        for point in paths.gather_points.iter().filter(|point| point.path as usize == path) {
            for photon in &photons {
                let from = photon.position - point.position;
                let offset = photon.arrival.normal().dot(from) / 127.0;
                let distance2 = from.length_squared().max((offset / thickness).powi(2));
                let counts = point.vertex == 3 || photon.class() == PhotonClass::Caustic;
                let radius = radii[photon.class() as usize];
                if distance2 <= radius * radius && counts && photon.cosine(point.normal) > 0.0 {
                    let view = paths.views.get(point.view as usize);
                    let value = view.map_or(Rgb::ONE, |view| view.value(photon, &point));
                    let contribution = point.weight * photon.flux * value / disc_area(radius);
                    let luminance = luminance(contribution);
                    pairs.push((photon.path, luminance));
                    // Discs of half and of a quarter of the area.
                    let within =
                        |share: f32| f32::from(u8::from(distance2 <= share * radius * radius));
                    let [inner, core] = [0.5, 0.25].map(|share| within(share) / share);
                    nested[0] += luminance - inner * luminance;
                    nested[1] += inner * luminance - core * luminance;
                    expected += contribution;
                    annulus[photon.class() as usize] += contribution - core * contribution;
                }
            }
        }
        total += pairs.len();
        let close = |one: f32, other: f32, scale: f32| (one - other).abs() <= 1e-5 * scale;
        assert!((expected - *sum).abs().max_element() <= 1e-5 * expected.max_element(), "{path}");
        for (a, nested) in nested.into_iter().enumerate() {
            let sum = found.nested[path].iter().map(|nested| nested[a]).sum();
            assert!(close(sum, nested, 4.0 * luminance(expected)), "{path}");
        }
        for (one, other) in found.annulus.get(path).into_iter().flatten().zip(annulus) {
            let apart = (*one - other).abs().max_element();
            assert!(apart <= 4e-5 * expected.max_element(), "{path}: {one}, not {other}");
        }
        sort(&mut pairs);
        assert_eq!(pairs.len(), found.pairs[path].len());
        for (one, other) in pairs.iter().zip(&found.pairs[path]) {
            assert!(one.0 == other.0 && close(one.1, other.1, one.1), "{path}: {one:?}, {other:?}");
        }
    }
    total
}

/// Merged light of each camera path.
#[derive(Debug, Default, PartialEq)]
struct Found {
    sums: Vec<Rgb>,
    annulus: Vec<ByClass<Rgb>>,
    /// Light path and value of each pair.
    pairs: Vec<Vec<(u32, f32)>>,
    /// Differences between nested radii at each gather point.
    nested: Vec<Vec<[f32; 2]>>,
}

impl Found {
    /// Sorts the pairs of each camera path.
    fn sort(&mut self) {
        self.pairs.iter_mut().for_each(|pairs| sort(pairs));
        self.nested.iter_mut().for_each(|nested| {
            nested.sort_by(|one, other| one.partial_cmp(other).expect("numbers"))
        });
    }
}

fn find(merge: &Merge, paths: &CameraPaths) -> Found {
    let mut found = Found::default();
    merge.gather_pairs(paths, &mut MergeOutput::default(), |output, complete| {
        assert_eq!(complete.start, found.sums.len());
        found.sums.extend(&output.sums[complete.clone()]);
        if merge.options().records_annulus {
            found.annulus.extend(&output.annulus[complete.clone()]);
        }
        for path in complete {
            let (mut pairs, mut nested) = (Vec::new(), Vec::new());
            for (run, more) in output.pairs.of_path(path) {
                pairs.extend(run.iter().map(|pair| (pair.light_path, pair.value)));
                nested.push(more);
            }
            found.pairs.push(pairs);
            found.nested.push(nested);
        }
    });
    found
}

fn sort(pairs: &mut [(u32, f32)]) {
    pairs.sort_by(|one, other| one.partial_cmp(other).expect("numbers"));
}
