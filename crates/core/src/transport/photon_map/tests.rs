//! Queries compared with a search of all photons.

use super::*;
use crate::base::rng::{Stream, StreamKey};
use crate::transport::photon::PhotonClass;

fn photon(position: Vec3, path: usize) -> Photon {
    Photon::new(position, path as u32, Vec3::ONE, Vec3::Z, PhotonClass::Diffuse)
}

/// Compares every query with a search of all photons by the same distance test.
#[track_caller]
fn assert_exact(photons: &[Photon], queries: &[Vec3], radius: f32) -> usize {
    let mut map = PhotonMap::default();
    // Two slices, as from two batches.
    let (front, back) = photons.split_at(photons.len() / 3);
    map.build_from(&[front, back], radius);
    let mut found_in_all = 0;
    for &query in queries {
        let mut found = Vec::new();
        map.for_each_within(query, |photon, _| found.push(photon.path));
        found.sort_unstable();
        let near = |p: &&Photon| p.position.distance_squared(query) <= radius * radius;
        let expected: Vec<u32> = photons.iter().filter(near).map(|p| p.path).collect();
        assert_eq!(found, expected, "around {query} within {radius}");
        found_in_all += found.len();
    }
    found_in_all
}

/// Points in a box, half of them on its floor.
fn points(count: u64, corner: Vec3, size: Vec3, seed: u64) -> Vec<Vec3> {
    let key = StreamKey::new(seed, Stream::Test, 0);
    let point = |index| {
        let mut rng = key.rng(index);
        let height = if index % 2 == 0 { rng.next_1d() } else { 0.0 };
        corner + size * Vec3::new(rng.next_1d(), rng.next_1d(), height)
    };
    (0..count).map(point).collect()
}

fn photons(positions: &[Vec3]) -> Vec<Photon> {
    positions.iter().enumerate().map(|(path, &position)| photon(position, path)).collect()
}

#[test]
fn queries_match_a_search_of_all_photons() {
    let boxes = [
        (Vec3::ZERO, Vec3::splat(556.0)),
        (Vec3::new(-3.0, 20.0, -7e3), Vec3::new(1e3, 1e-3, 5.0)),
        (Vec3::splat(1e6), Vec3::splat(2.0)),
        (Vec3::splat(-1e-6), Vec3::splat(1e-6)),
    ];
    for (corner, size) in boxes {
        let photons = photons(&points(3000, corner, size, 1));
        // Queries in the box, around it, and on photons.
        let mut queries = points(300, corner, size, 2);
        queries.extend(points(300, corner - 0.5 * size, 2.0 * size, 3));
        queries.extend(photons.iter().step_by(30).map(|p| p.position));
        for share in [1e-9, 1e-5, 1e-3, 0.01, 0.1, 0.5, 1.0, 10.0, 1e6] {
            assert_exact(&photons, &queries, share * size.max_element());
        }
    }
}

/// Photons in a box of size 10, and one photon so far away that an array has wide cells.
fn crowd(count: u64) -> Vec<Photon> {
    let mut positions = points(count, Vec3::ZERO, Vec3::splat(10.0), 4);
    positions.push(Vec3::splat(300.0));
    photons(&positions)
}

fn is_hashed(photons: &[Photon], radius: f32) -> bool {
    let mut map = PhotonMap::default();
    map.build_from(&[photons], radius);
    map.grid.is_hashed()
}

#[test]
fn hashed_grid_finds_each_photon_once() {
    let photons = crowd(20_000);
    let queries: Vec<Vec3> = photons.iter().step_by(50).map(|p| p.position).collect();
    for radius in [0.03, 0.1, 0.3] {
        assert!(is_hashed(&photons, radius), "the grid is hashed");
        assert!(assert_exact(&photons, &queries, radius) >= queries.len());
    }
    // In a table of 1024 buckets some rows of cells lie at both of its ends.
    let few = crowd(250);
    let queries: Vec<Vec3> = few.iter().map(|p| p.position).collect();
    assert!(is_hashed(&few, 0.03), "the grid is hashed");
    assert!(assert_exact(&few, &queries, 0.03) >= few.len());
}

#[test]
fn grid_is_hashed_only_for_crowded_photons() {
    let even = photons(&points(50_000, Vec3::ZERO, Vec3::splat(300.0), 4));
    for radius in [0.03, 0.5] {
        assert!(!is_hashed(&even, radius), "{radius}");
        assert!(is_hashed(&crowd(50_000), radius), "{radius}");
        // Many full cells, none of them very full: 200,000 photons in a corner.
        let mut corner = points(200_000, Vec3::ZERO, Vec3::splat(40.0), 5);
        corner.push(Vec3::splat(300.0));
        assert!(is_hashed(&photons(&corner), radius), "{radius}");
        // One very full cell, in which few of all photons are.
        let spot = points(5000, Vec3::splat(150.0), Vec3::splat(0.1), 6);
        let mut some = points(600_000, Vec3::ZERO, Vec3::splat(300.0), 5);
        assert!(!is_hashed(&photons(&some), radius), "{radius}");
        some.extend(spot);
        assert!(is_hashed(&photons(&some), radius), "{radius}");
    }
    // No room for cells: neither an endless search for their width nor a panic.
    let far = [photon(Vec3::ZERO, 0), photon(Vec3::splat(f32::INFINITY), 1), photon(Vec3::NAN, 2)];
    assert_eq!(assert_exact(&far, &[Vec3::ZERO], 1.0), 1);
    let far = [photon(Vec3::ZERO, 0), photon(Vec3::splat(f32::MAX), 1)];
    assert_eq!(assert_exact(&far, &[Vec3::ZERO], 1.0), 1);
}

#[test]
fn sparse_map_rejects_most_empty_queries_and_no_other() {
    let size = Vec3::splat(100.0);
    // As far from the origin as coordinates are exact enough, on both sides of it, and around it.
    let radius = 0.4;
    let farthest = 131_000.0 * 2.1 * radius;
    for corner in [Vec3::ZERO, -0.5 * size, Vec3::splat(farthest - 100.0), Vec3::splat(-farthest)] {
        let photons = photons(&points(800, corner, size, 7));
        // On photons, and as near to the edge of the radius as coordinates can say.
        let mut queries: Vec<Vec3> = photons.iter().map(|p| p.position).collect();
        for direction in [Vec3::X, -Vec3::Y, Vec3::Z, Vec3::ONE.normalize(), -Vec3::ONE.normalize()]
        {
            queries.extend(photons.iter().map(|p| p.position + direction * radius));
            queries.extend(photons.iter().map(|p| p.position + direction * (radius * 0.999)));
        }
        assert!(assert_exact(&photons, &queries, radius) > 5 * photons.len());

        let mut map = PhotonMap::default();
        map.build_from(&[&photons], radius);
        assert!(map.is_sparse, "the map is sparse");
        let anywhere = points(4096, corner, size, 8);
        let near = |positions: &[Vec3]| {
            let mut packet = Vec3s::default();
            positions.iter().enumerate().for_each(|(lane, &position)| packet.set(lane, position));
            map.near(&packet, &[true; LANES]).count_ones()
        };
        // Up to eight cubes of each photon in half the box, four on its floor, which has 14,000.
        let passed: u32 = anywhere.chunks_exact(LANES).map(near).sum();
        assert!(passed < 4096 / 5, "{passed}");
        assert!(passed > 4096 / 50, "{passed}");
    }
}

#[test]
fn photons_on_borders_of_cells_and_radius_are_found_once() {
    // A lattice at all multiples of half a cell, looked up from all lattice points.
    for radius in [0.5, 1.0 / 3.0] {
        let half = radius * SLACK * 1.01;
        let coordinates = || (0..8).map(|i| i as f32 * half);
        let mut positions = Vec::new();
        for x in coordinates() {
            for y in coordinates() {
                positions.extend(coordinates().map(|z| Vec3::new(x, y, z)));
            }
        }
        assert_exact(&photons(&positions), &positions, radius);
    }
    let edge = [Vec3::ZERO, Vec3::X, Vec3::Y, -Vec3::Z];
    assert_eq!(assert_exact(&photons(&edge), &[Vec3::ZERO], 1.0), 4);
}

#[test]
fn empty_map_finds_nothing_after_a_full_one() {
    let mut map = PhotonMap::default();
    map.for_each_within(Vec3::ZERO, |_, _| panic!("there is no photon"));
    map.build_from(&[&[photon(Vec3::ZERO, 0)]], 1.0);
    assert_eq!(map.len(), 1);
    map.build_from(&[], 1.0);
    assert!(map.is_empty());
    map.for_each_within(Vec3::ZERO, |_, _| panic!("there is no photon"));
}

#[test]
fn photons_at_one_place_are_all_found() {
    let place = Vec3::new(3.0, -2.0, 7.0);
    for count in [1, 2, 63, 64, 65, 300] {
        let positions: Vec<Vec3> =
            (0..count).flat_map(|i| [place, place + Vec3::X * 1e-3 * i as f32]).collect();
        let photons = photons(&positions);
        assert!(assert_exact(&photons, &[place], 1e-4) >= count);
        assert_eq!(assert_exact(&photons, &[place], 10.0), 2 * count);
    }
    let one = photons(&[place]);
    assert_eq!(assert_exact(&one, &[place, place + 0.5, place + 0.6], 0.9), 2);
}

#[test]
fn queries_find_photons_in_one_order_on_any_number_of_threads() {
    let even = photons(&points(60_000, Vec3::ZERO, Vec3::splat(10.0), 5));
    let crowd = crowd(60_000);
    let few = &even[..2000];
    let cases = [(&even[..], 0.3), (&even, 0.05), (&crowd, 0.1), (few, 0.02)];
    let kinds = cases.map(|(photons, radius)| {
        let slices: Vec<&[Photon]> = photons.chunks(700).collect();
        let mut queries = points(200, Vec3::ZERO, Vec3::splat(10.0), 6);
        queries.extend(photons.iter().step_by(100).map(|photon| photon.position));
        let (mut is_hashed, mut is_sparse) = (false, false);
        let found = [1, 2, 4].map(|threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            let mut map = PhotonMap::default();
            pool.install(|| map.build_from(&slices, radius));
            let mut found = Vec::new();
            for &query in &queries {
                map.for_each_within(query, |photon, distance2| found.push((*photon, distance2)));
            }
            (is_hashed, is_sparse) = (map.grid.is_hashed(), map.is_sparse);
            found
        });
        assert!(found[0].len() >= photons.len() / 100, "{}", found[0].len());
        assert!(found[0] == found[1] && found[0] == found[2]);
        (is_hashed, is_sparse)
    });
    assert_eq!(kinds, [(false, false), (false, false), (true, false), (false, true)]);
}

#[test]
fn photons_of_a_cell_keep_their_order() {
    // Few photons are sorted in one pass, many by partitions.
    for count in [100, 50_000] {
        let mut positions = points(count, Vec3::ZERO, Vec3::splat(10.0), 9);
        let place = Vec3::splat(5.0);
        positions.iter_mut().step_by(7).for_each(|position| *position = place);
        let photons = photons(&positions);
        let mut map = PhotonMap::default();
        map.build_from(&photons.chunks(30).collect::<Vec<_>>(), 1e-3);
        let mut found = Vec::new();
        map.for_each_within(place, |photon, _| found.push(photon.path));
        assert!(found.is_sorted() && found.len() as u64 == count.div_ceil(7), "{found:?}");
    }
}

#[test]
fn rebuilt_map_keeps_no_photon() {
    let even = photons(&points(30_000, Vec3::ZERO, Vec3::splat(10.0), 5));
    let crowd = crowd(20_000);
    let queries: Vec<Vec3> = even.iter().step_by(60).map(|p| p.position).collect();
    let mut map = PhotonMap::default();
    let sparse = (&even[..800], 0.01);
    let all =
        [sparse, (&crowd, 0.1), (&even[..1], 1.0), (&even, 0.1), (&even[..2], 0.01), (&[], 1.0)];
    for (photons, radius) in all.into_iter().chain([sparse, (&even, 0.2), sparse]) {
        map.build_from(&photons.chunks(1000).collect::<Vec<_>>(), radius);
        for &query in &queries {
            let mut found = Vec::new();
            map.for_each_within(query, |photon, _| found.push(photon.path));
            found.sort_unstable();
            let near = |p: &&Photon| p.position.distance_squared(query) <= radius * radius;
            let expected: Vec<u32> = photons.iter().filter(near).map(|p| p.path).collect();
            assert_eq!(found, expected, "{} photons within {radius}", photons.len());
        }
    }
}

#[test]
fn photons_keep_their_mis_partials() {
    // Sorted in one pass, and in partitions.
    for count in [300, 40_000] {
        let photons = photons(&points(count, Vec3::ZERO, Vec3::ONE, 9));
        let of_path = |path: u32| [0.5 + path as f32, -3.0 * path as f32];
        let partials: Vec<_> = photons.iter().map(|photon| of_path(photon.path)).collect();
        let (slices, of_slices): (Vec<_>, Vec<_>) =
            photons.chunks(500).zip(partials.chunks(500)).unzip();
        let extent =
            slices.iter().map(|photons| Extent::of(photons)).fold(Extent::default(), Extent::and);
        let mut map = PhotonMap::default();
        let sorted = PhotonSlices { photons: &slices, mis_partials: &of_slices };
        map.build_within(sorted, extent, 0.05);
        let (mut ranges, mut found) = (Ranges::default(), 0);
        for query in points(50, Vec3::ZERO, Vec3::ONE, 10) {
            map.find_ranges(&Vec3s::splat(query), &from_fn(|lane| lane == 0), &mut ranges);
            for ranges in ranges.by_lane() {
                map.for_each_in(ranges, query, |photon, _, partials| {
                    assert_eq!(partials, of_path(photon.path));
                    found += 1;
                });
            }
        }
        assert!(found > 10, "{found}");
        // A map without MIS keeps no partials.
        map.build_from(&slices, 0.05);
        assert!(map.mis_partials.is_empty());
    }
}
