//! Weights beside the balance heuristic over the densities of all techniques.

use super::*;
use crate::base::rng::{Rng, Stream, StreamKey};

/// The end of a path at its light source.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Last {
    /// Segments through other vertices precede the light source.
    chain: bool,
    /// The last of these vertices is rough, so that the light source can be connected from it.
    rough: bool,
    /// Diffuse vertices connect light straight from the light source.
    connects: bool,
    /// Camera paths can hit the light source.
    hittable: bool,
}

/// A path of `m` diffuse vertices. Densities include the vertices in between that are not
/// diffuse.
struct Path {
    /// Density of the camera path from each diffuse vertex to the next one; the last leads
    /// toward the light source.
    camera: Vec<f64>,
    /// Density of the light path from each diffuse vertex but the first to the previous one.
    light: Vec<f64>,
    /// Densities of camera and light path through smooth vertices before the light source.
    smooth: [f64; 2],
    /// Densities of camera and light path at the rough vertex before the light source.
    rough: [f64; 2],
    emission: f64,
    connection: f64,
}

impl Path {
    fn random(m: usize, cut: bool, last: Last, rng: &mut Rng) -> Self {
        let mut some = |count| (0..count).map(|_| anything(rng)).collect::<Vec<_>>();
        let (mut camera, light) = (some(m), some(m.saturating_sub(1)));
        if cut {
            camera.iter_mut().skip(1).for_each(|density| *density = 0.0);
        }
        let one_without = |is_there: bool, values: Vec<f64>| {
            let [camera, light] = values.try_into().unwrap();
            if is_there { [camera, light] } else { [1.0; 2] }
        };
        let smooth = one_without(last.chain, some(2));
        let rough = one_without(last.chain && last.rough, some(2));
        let [emission, connection] = some(2).try_into().unwrap();
        Self { camera, light, smooth, rough, emission, connection }
    }

    fn is_connected(&self, last: Last) -> bool {
        if last.chain { last.rough } else { last.connects && !self.camera.is_empty() }
    }
}

fn anything(rng: &mut Rng) -> f64 {
    (6.0 * f64::from(rng.next_1d()) - 3.0).exp()
}

/// Densities of all techniques: merges at the first and at the second vertex, connection, and
/// hit.
fn densities(path: &Path, last: Last, balance: &Balance) -> [f64; 4] {
    let m = path.camera.len();
    let merge = |k: usize| {
        let straight_at_first = m == 1 && !last.chain && !last.connects;
        let limit = if last.chain || straight_at_first { m } else { m.saturating_sub(1) };
        if k > limit {
            return 0.0;
        }
        let camera: f64 = path.camera[..k - 1].iter().product();
        let light: f64 = path.light[k - 1..].iter().product();
        let arrives = path.emission * path.smooth[1] * path.rough[1];
        // Light paths split at their first diffuse vertex, which is the last one here.
        let class = if k == m { balance.caustic } else { balance.splitting };
        let scale = f64::from(balance.eta * balance.scales[k - 1] * class);
        camera * light * arrives * scale
    };
    let all: f64 = path.camera.iter().product();
    let before: f64 = path.camera[..m.saturating_sub(1)].iter().product();
    let connection = if last.chain { all * path.smooth[0] } else { before } * path.connection;
    let hit = all * path.smooth[0] * path.rough[0];
    [
        merge(1),
        merge(2),
        if path.is_connected(last) { connection } else { 0.0 },
        if last.hittable { hit } else { 0.0 },
    ]
}

/// Weights of all techniques from partials, step by step as paths are traced.
fn weights(balance: &Balance, path: &Path, last: Last) -> [Option<f64>; 4] {
    let m = path.camera.len();
    let [camera, light] =
        [&path.camera, &path.light].map(|all| all.iter().map(|&p| p as f32).collect::<Vec<_>>());
    let [smooth, rough] = [path.smooth, path.rough].map(|both| both.map(|p| p as f32));
    let (emission, connection) = (path.emission as f32, path.connection as f32);
    // The light path, to the first vertex.
    let mut arrived = balance.start(if last.hittable { emission.recip() } else { 0.0 });
    let mut straight = if path.is_connected(last) { connection / emission } else { 0.0 };
    if last.chain {
        if last.rough {
            let techniques = StraightDensities { connection: straight, camera: rough[0] };
            arrived = balance.scatter(&arrived, techniques, None, rough[1]);
        }
        arrived = arrived.pass(smooth[1] / smooth[0]);
        straight = 0.0;
    }
    let mut photons = [None; 2];
    for k in (1..=m).rev() {
        let class = if k == m { PhotonClass::Caustic } else { PhotonClass::Diffuse };
        let stored = if k < m || last.chain {
            Some(balance.photon(&arrived, class))
        } else if !last.connects {
            Some(balance.straight_photon(&arrived))
        } else {
            None
        };
        if k <= 2 {
            photons[k - 1] = stored.map(|photon| (photon, class));
        }
        if k > 1 {
            let techniques = StraightDensities { connection: straight, camera: camera[k - 1] };
            let merges = (k < m || last.chain).then_some(class);
            let light = balance.continuations((m - k) as u32, light[k - 2]);
            arrived = balance.scatter(&arrived, techniques, merges, light);
            straight = 0.0;
        }
    }
    // The camera path, from the first vertex.
    let (mut partial, mut earlier) = (CameraPartial::default(), 0.0);
    let mut merges = [None; 2];
    for k in 1..=m {
        earlier = if k == 1 { 0.0 } else { balance.arrive(&partial, light[k - 2]) };
        if k <= 2
            && let Some((photon, class)) = photons[k - 1]
        {
            let point = balance.gather(k as u32, earlier, camera[k - 1]);
            let factor = balance.earlier_factors()[class as usize];
            merges[k - 1] = Some(f64::from(merge_weight(&point, factor, photon[k - 1])))
                .filter(|weight| *weight > 0.0);
        }
        partial = balance.leave(k as u32, earlier, camera[k - 1]);
    }
    let own = |merges: f32| {
        let goes_on = if last.chain { Some(rough[0]) } else { camera.last().copied() };
        let hit = goes_on.filter(|_| last.hittable).unwrap_or(0.0);
        let weight = balance.connection_weight(merges, emission / connection, hit / connection);
        path.is_connected(last).then(|| f64::from(weight))
    };
    let (connected, merges_at_hit) = if last.chain {
        let partial = partial.pass(smooth[1] / smooth[0]);
        let connected = own(balance.caustic_merges(&partial) * rough[1]);
        (connected, balance.caustic_merges(&partial.pass(rough[1] / rough[0])))
    } else {
        let at_first = m == 1 && !last.connects;
        let merges = match at_first {
            true => balance.caustic_merges(&partial),
            false => balance.before_last(partial.earlier),
        };
        (own(balance.before_last(earlier)), merges)
    };
    let hits_from = if last.chain { rough[0] } else { camera.last().copied().unwrap_or(1.0) };
    let connection = if path.is_connected(last) { connection / hits_from } else { 0.0 };
    let hit = balance.hit_weight(merges_at_hit, emission, connection);
    [merges[0], merges[1], connected, last.hittable.then(|| f64::from(hit))]
}

fn all_lasts() -> Vec<Last> {
    (0..16)
        .map(|bits| {
            let [chain, rough, connects, hittable] = [1, 2, 4, 8].map(|bit| bits & bit > 0);
            Last { chain, rough: rough && chain, connects, hittable }
        })
        .collect()
}

#[test]
fn weights_match_the_balance_heuristic_of_all_techniques() {
    let mut rng = StreamKey::new(1, Stream::Test, 0).rng(0);
    let (mut worst, mut shared) = (0.0, 0);
    for round in 0..3000 {
        let scales = [(); 2].map(|()| anything(&mut rng) as f32);
        let (eta, caustic) = (anything(&mut rng) as f32, anything(&mut rng) as f32);
        let splitting = 1.0 + (round % 3) as f32;
        let balance = Balance { splitting, ..Balance::with(eta, scales, caustic) };
        for last in all_lasts() {
            let (m, cut) = (round % 7, round % 2 == 0);
            let path = Path::random(m, cut, last, &mut rng);
            let densities = densities(&path, last, &balance);
            let total: f64 = densities.iter().sum();
            let weights = weights(&balance, &path, last);
            let sampled = densities.map(|density| density > 0.0);
            let mut sum = 0.0;
            for ((density, weight), sampled) in densities.into_iter().zip(weights).zip(sampled) {
                if sampled {
                    let weight = weight.expect("sampled");
                    worst = f64::max(worst, (weight - density / total).abs());
                    sum += weight;
                }
            }
            shared += u32::from(sampled.into_iter().filter(|&is| is).count() > 1);
            if total > 0.0 {
                assert!((sum - 1.0).abs() < 3e-6, "{m} {cut} {last:?}: {sum}");
            }
        }
    }
    assert!(worst < 2e-6, "{worst}");
    assert!(shared > 20_000, "{shared}");
}

/// Photons of caustics alone are merged at the last diffuse vertex of any number, if vertices
/// that pass light lead from there to the light source.
#[test]
fn photons_of_caustics_share_paths_with_connections_and_hits() {
    let mut rng = StreamKey::new(4, Stream::Test, 0).rng(0);
    let (mut worst, mut shared) = (0.0, 0);
    for round in 0..3000 {
        let eta = anything(&mut rng) as f32;
        let scale = anything(&mut rng) as f32;
        let balance = Balance { of_diffuse: 0.0, ..Balance::with(eta, [scale; 2], 1.0) };
        for last in all_lasts().into_iter().filter(|last| last.connects) {
            let m = 1 + round % 6;
            let path = Path::random(m, false, last, &mut rng);
            let [_, _, connection, hit] = densities(&path, last, &balance);
            let camera: f64 = path.camera[..m - 1].iter().product();
            let light = path.emission * path.smooth[1] * path.rough[1];
            let merge = if last.chain { f64::from(eta * scale) * camera * light } else { 0.0 };
            let total = merge + connection + hit;
            let [_, _, connected, seen] = weights(&balance, &path, last);
            let merged = merge_weight_at(&balance, &path, last);
            let all = [(merge, merged), (connection, connected), (hit, seen)];
            let sampled = all.iter().filter(|(density, _)| *density > 0.0);
            for (density, weight) in sampled.clone() {
                let weight = weight.expect("sampled");
                worst = f64::max(worst, (weight - density / total).abs());
            }
            shared += u32::from(sampled.count() > 1);
        }
    }
    assert!(worst < 2e-6, "{worst}");
    assert!(shared > 10_000, "{shared}");
}

/// Weight of the merge at the last diffuse vertex of a path, from the partials of its photon.
fn merge_weight_at(balance: &Balance, path: &Path, last: Last) -> Option<f64> {
    let m = path.camera.len() as u32;
    let [smooth, rough] = [path.smooth, path.rough].map(|both| both.map(|p| p as f32));
    let (emission, connection) = (path.emission as f32, path.connection as f32);
    let mut arrived = balance.start(if last.hittable { emission.recip() } else { 0.0 });
    if last.rough {
        let connection = connection / emission;
        let techniques = StraightDensities { connection, camera: rough[0] };
        arrived = balance.scatter(&arrived, techniques, None, rough[1]);
    }
    let arrived = arrived.pass(smooth[1] / smooth[0]);
    let photon = balance.photon(&arrived, PhotonClass::Caustic)[partial_index(m)];
    let point = balance.gather(m, 0.0, *path.camera.last()? as f32);
    let factor = balance.earlier_factors()[PhotonClass::Caustic as usize];
    last.chain.then(|| f64::from(merge_weight(&point, factor, photon)))
}

#[test]
fn weights_without_merges_are_those_of_a_path_tracer() {
    let balance = Balance::with(3.0, [0.0; 2], 1.0);
    let mut rng = StreamKey::new(2, Stream::Test, 0).rng(0);
    for m in 1..6 {
        let last = Last { chain: false, rough: false, connects: true, hittable: true };
        let path = Path::random(m, false, last, &mut rng);
        let [first, second, connection, hit] = weights(&balance, &path, last);
        let camera = path.camera.last().unwrap();
        let expected = path.connection / (path.connection + camera);
        assert!((connection.unwrap() - expected).abs() < 1e-6);
        assert!((hit.unwrap() - (1.0 - expected)).abs() < 1e-6);
        assert!(first.unwrap_or(0.0) + second.unwrap_or(0.0) < 1e-6);
    }
}

#[test]
fn only_technique_of_a_path_weighs_1_even_without_merges() {
    let balance = Balance::with(3.0, [0.0; 2], 1.0);
    let mut rng = StreamKey::new(3, Stream::Test, 0).rng(0);
    // A caustic of a light source that cannot be hit.
    let last = Last { chain: true, rough: false, connects: true, hittable: false };
    let path = Path::random(1, false, last, &mut rng);
    assert_eq!(weights(&balance, &path, last)[0], Some(1.0));
}
