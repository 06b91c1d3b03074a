//! The weights of paths that are merged at the first two diffuse vertices, and connected from both.

use crate::base::math::disc_area;
use crate::settings::Settings;
use crate::transport::kernel::ByClass;
use crate::transport::photon::PhotonClass;

/// What counts as no merges at all: quotients stay finite, and what can be found in one way alone still weighs 1.
const NOTHING: f32 = 1e-12;

/// Constants of the balance heuristic. They do not change within a block, whatever its counts: the law needs that.
#[derive(Clone, Copy, Debug)]
pub struct Balance {
    /// Light paths times the area of a merge, scene units squared.
    /// theory.md (47c), `eta`.
    eta: f32,
    /// Scale of merges at the first vertex.
    first: f32,
    /// The same at the second, by [`PhotonClass`].
    second: ByClass<f32>,
}

/// How else a path could be found that goes on from a light path's diffuse vertex to a photon which is merged at
/// a camera path's first vertex: there, with a camera path that came to that vertex.
#[derive(Clone, Copy, Debug)]
pub enum PreviousTechnique {
    /// In no way.
    Never,
    /// By a connection with the light, `1/l` times as dense as emission hits the vertex.
    /// theory.md (47b)
    Connected {
        /// `1/l`.
        inverse_l: f32,
    },
    /// By a merge with the photon that arrived there, of this class.
    Merged(PhotonClass),
}

impl Balance {
    /// As the settings say.
    pub fn new(settings: &Settings) -> Self {
        let eta = settings.mis_light_paths as f32 * disc_area(settings.radius);
        let [first, second] = [settings.mis_c1, settings.mis_c2].map(|c| c as f32);
        Self::with(eta, [first, second], settings.caustic_radius / settings.radius)
    }

    /// Of the scales at both vertices, where caustics have a radius so many times the other.
    fn with(eta: f32, [first, second]: [f32; 2], caustic: f32) -> Self {
        let mut all = [second.max(NOTHING); 2];
        all[PhotonClass::Caustic as usize] = (second * caustic * caustic).max(NOTHING);
        Self { eta, first: first.max(NOTHING), second: all }
    }

    /// What a photon carries of its path's weight after a diffuse vertex of the density `light` toward it.
    /// theory.md (47e)
    #[inline(always)] // as those below: parts of vector loops
    pub fn photon(&self, otherwise: PreviousTechnique, light: f32) -> f32 {
        let other = match otherwise {
            PreviousTechnique::Never => 0.0,
            PreviousTechnique::Connected { inverse_l } => inverse_l / self.eta,
            PreviousTechnique::Merged(class) => self.second[class as usize],
        };
        other / light
    }

    /// What a merge at the first vertex multiplies a photon's part with, where the camera path's density toward
    /// where the photon came from is `camera`.
    #[inline(always)]
    pub fn at_first(&self, camera: f32) -> f32 {
        camera / self.first
    }

    /// What a camera path carries of its weight from the first vertex on, which it left with the density `camera`.
    /// theory.md (47d)
    #[inline(always)]
    pub fn toward_second(&self, camera: f32) -> f32 {
        self.first / camera
    }

    /// Weights of merges at the second vertex by class, where the camera path's part times the light path's density
    /// back to the first is `earlier`.
    /// theory.md (47f)
    #[inline(always)]
    pub fn second_weights(&self, earlier: f32) -> ByClass<f32> {
        self.second.map(|second| second / (earlier + second))
    }

    /// Weight of a connection from the second vertex.
    /// theory.md (47g)
    #[inline(always)]
    pub fn connection_weight(&self, earlier: f32, l: f32) -> f32 {
        (1.0 + self.eta * l * earlier).recip()
    }
}

/// Weight of a merge at the first vertex of a photon that carries `part`, which the vertex multiplies with `by`.
/// theory.md (47f)
#[inline(always)]
pub fn first_weight(by: f32, part: f32) -> f32 {
    (1.0 + by * part).recip()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::rng::{Rng, Stream, StreamKey};

    /// How the light leaves its source.
    #[derive(Clone, Copy, Debug, PartialEq)]
    enum Last {
        /// Straight, and it can be connected.
        Connected,
        /// Straight, and photons alone find it.
        Straight,
        /// Through other vertices.
        Caustic,
    }

    /// A path of diffuse vertices: densities per area from each to the next (camera) and back (light), with all
    /// that is in between.
    struct Path {
        camera: Vec<f64>,
        light: Vec<f64>,
        emission: f64,
        connection: f64,
    }

    fn anything(rng: &mut Rng) -> f64 {
        (6.0 * f64::from(rng.next_1d()) - 3.0).exp()
    }

    /// Densities of all ways to find a path of `m` vertices: merges at the first and the second, connection.
    fn densities(path: &Path, last: Last, eta: f64, c: [f64; 2], caustic: f64) -> [f64; 3] {
        let m = path.camera.len() + 1;
        let limit = if last == Last::Caustic { m } else { m - 1 };
        let merge = |k: usize| {
            if k > limit.min(2) && !(m == 1 && k == 1 && last == Last::Straight) {
                return 0.0;
            }
            let camera: f64 = path.camera[..k - 1].iter().product();
            let light: f64 = path.light[k - 1..].iter().product();
            let radii = if k == m { caustic * caustic } else { 1.0 };
            camera * path.emission * light * eta * c[k - 1] * radii
        };
        let connected = if last == Last::Connected && m <= 2 {
            path.camera.iter().product::<f64>() * path.connection
        } else {
            0.0
        };
        [merge(1), merge(2), connected]
    }

    /// The same weights as the program finds them, step by step.
    fn weights(balance: &Balance, path: &Path, last: Last) -> [Option<f64>; 3] {
        let m = path.camera.len() + 1;
        let [camera, light] = [&path.camera, &path.light]
            .map(|all| all.iter().map(|&p| p as f32).collect::<Vec<_>>());
        let l = (path.emission / path.connection) as f32;
        // The photon at the first vertex, and at the second.
        let part = (m >= 2).then(|| {
            let otherwise = match (m, last) {
                (2, Last::Connected) => PreviousTechnique::Connected { inverse_l: l.recip() },
                (2, Last::Straight) => PreviousTechnique::Never,
                (2, Last::Caustic) => PreviousTechnique::Merged(PhotonClass::Caustic),
                _ => PreviousTechnique::Merged(PhotonClass::Diffuse),
            };
            balance.photon(otherwise, light[0])
        });
        let by = balance.at_first(camera.first().copied().unwrap_or(1.0));
        let first = (m >= 2 || last != Last::Connected)
            .then(|| f64::from(first_weight(by, part.unwrap_or(0.0))));
        let earlier = (m >= 2).then(|| balance.toward_second(camera[0]) * light[0]);
        let class = if m == 2 { PhotonClass::Caustic } else { PhotonClass::Diffuse };
        let second = (m >= 3 || (m == 2 && last == Last::Caustic))
            .then(|| f64::from(balance.second_weights(earlier.unwrap())[class as usize]));
        let connection = (last == Last::Connected && m <= 2)
            .then(|| f64::from(balance.connection_weight(earlier.unwrap_or(0.0), l)));
        [first, second, connection]
    }

    #[test]
    fn weights_are_the_balance_heuristic_of_all_ways_to_find_a_path() {
        let mut rng = StreamKey::new(1, Stream::Test, 0).rng(0);
        let (mut worst, mut shared) = (0.0, 0);
        for round in 0..3000 {
            let eta = anything(&mut rng);
            let c = [anything(&mut rng), anything(&mut rng)];
            let caustic = anything(&mut rng);
            let balance = Balance::with(eta as f32, c.map(|c| c as f32), caustic as f32);
            for last in [Last::Connected, Last::Straight, Last::Caustic] {
                let m = 1 + round % 6;
                let mut some = |count| (0..count).map(|_| anything(&mut rng)).collect::<Vec<_>>();
                let (camera, light) = (some(m - 1), some(m - 1));
                let [emission, connection] = some(2).try_into().unwrap();
                let path = Path { camera, light, emission, connection };
                let densities = densities(&path, last, eta, c, caustic);
                let total: f64 = densities.iter().sum();
                let weights = weights(&balance, &path, last);
                for (density, weight) in densities.into_iter().zip(weights) {
                    assert_eq!(density > 0.0, weight.is_some(), "{m} {last:?}");
                    worst = f64::max(worst, (weight.unwrap_or(0.0) - density / total).abs());
                }
                shared += u32::from(weights.iter().flatten().count() > 1);
                let sum: f64 = weights.iter().flatten().sum();
                assert!((sum - 1.0).abs() < 2e-6, "{m} {last:?}: {sum}");
            }
        }
        assert!(worst < 1e-6, "{worst}");
        assert!(shared > 4000, "{shared}");
    }

    #[test]
    fn what_is_found_in_one_way_weighs_1_even_where_merges_count_for_nothing() {
        let balance = Balance::with(3.0, [0.0; 2], 1.0);
        let mut rng = StreamKey::new(2, Stream::Test, 0).rng(0);
        let mut path = |m: usize| {
            let mut some = || (1..m).map(|_| anything(&mut rng)).collect();
            Path { camera: some(), light: some(), emission: 0.3, connection: 2.0 }
        };
        let one = |path: &Path, last| weights(&balance, path, last).into_iter().flatten();
        for last in [Last::Connected, Last::Straight, Last::Caustic] {
            assert!(one(&path(1), last).eq([1.0]), "{last:?}");
        }
        assert!(one(&path(2), Last::Straight).eq([1.0]));
        // Connections then have all that they can find.
        let [first, _, connected] = weights(&balance, &path(2), Last::Connected);
        assert!(first.unwrap() < 1e-6 && connected.unwrap() > 1.0 - 1e-6);
    }
}
