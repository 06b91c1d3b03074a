//! The equations of the balance heuristic over merges at the first two diffuse vertices and connections from both.

use crate::base::math::disc_area;
use crate::settings::{MisScales, Settings};
use crate::transport::kernel::ByClass;
use crate::transport::photon::PhotonClass;

/// Minimum scale of merges. Quotients stay finite, and the only technique of a path still has the weight 1.
const MIN_SCALE: f32 = 1e-12;

/// Constants of the balance heuristic.
#[derive(Clone, Copy, Debug)]
pub struct Balance {
    /// Planned light paths times the area of a merge, scene units squared.
    /// theory.md (47c), `eta`.
    eta: f32,
    /// Scale of merges at the first vertex, `c_1`.
    first: f32,
    /// Scale of merges at the second vertex, `c_2`, by [`PhotonClass`].
    second: ByClass<f32>,
}

/// Technique of a camera path that ends at the previous diffuse vertex of a light path, for a photon that is merged
/// at the camera path's first vertex.
#[derive(Clone, Copy, Debug)]
pub enum PreviousTechnique {
    /// There is none.
    Never,
    /// A connection with the light source, whose density is `1/l` times the density of emission at the vertex.
    /// theory.md (47b)
    Connected {
        /// `1/l`.
        inverse_l: f32,
    },
    /// A merge with the photon of this class that the light path left at the vertex.
    Merged(PhotonClass),
}

impl Balance {
    /// The constants of these settings.
    pub fn new(settings: &Settings) -> Self {
        let MisScales { light_paths, scales } = settings.mis_scales();
        let eta = light_paths as f32 * disc_area(settings.radius);
        Self::with(eta, scales.map(|c| c as f32), settings.caustic_radius / settings.radius)
    }

    /// The constants for scales at both vertices and this quotient of the caustic radius and the radius.
    fn with(eta: f32, [first, second]: [f32; 2], caustic: f32) -> Self {
        let mut by_class = [second.max(MIN_SCALE); 2];
        by_class[PhotonClass::Caustic as usize] = (second * caustic * caustic).max(MIN_SCALE);
        Self { eta, first: first.max(MIN_SCALE), second: by_class }
    }

    /// Partial of a photon after a diffuse vertex, where `light` is the light path's density toward the photon.
    /// theory.md (47e)
    #[inline(always)] // part of vector loops, as the functions below
    pub fn photon(&self, previous: PreviousTechnique, light: f32) -> f32 {
        let other = match previous {
            PreviousTechnique::Never => 0.0,
            PreviousTechnique::Connected { inverse_l } => inverse_l / self.eta,
            PreviousTechnique::Merged(class) => self.second[class as usize],
        };
        other / light
    }

    /// Partial of a gather point at the first vertex, where `camera` is the camera path's density toward the origin of
    /// the photon.
    /// theory.md (47f), `p_c/c_1`.
    #[inline(always)]
    pub fn at_first(&self, camera: f32) -> f32 {
        camera / self.first
    }

    /// Partial of a camera path from the first vertex on, which it left with the density `camera`.
    /// theory.md (47d)
    #[inline(always)]
    pub fn toward_second(&self, camera: f32) -> f32 {
        self.first / camera
    }

    /// Weights of merges at the second vertex by photon class, where `earlier` is the camera path's partial times the
    /// light path's density toward the first vertex.
    /// theory.md (47f)
    #[inline(always)]
    pub fn second_weights(&self, earlier: f32) -> ByClass<f32> {
        self.second.map(|second| second / (earlier + second))
    }

    /// Weight of a connection from the second vertex, where `earlier` is as in [`Self::second_weights`].
    /// theory.md (47g)
    #[inline(always)]
    pub fn connection_weight(&self, earlier: f32, l: f32) -> f32 {
        (1.0 + self.eta * l * earlier).recip()
    }
}

/// Weight of a merge at the first vertex, from the partials of the gather point and of the photon.
/// theory.md (47f)
#[inline(always)]
pub fn first_weight(point_partial: f32, photon_partial: f32) -> f32 {
    (1.0 + point_partial * photon_partial).recip()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::rng::{Rng, Stream, StreamKey};

    /// The end of a path at its light source.
    #[derive(Clone, Copy, Debug, PartialEq)]
    enum Last {
        /// A straight segment that can be connected.
        Connected,
        /// A straight segment that photons alone sample.
        Straight,
        /// Segments through other vertices.
        Caustic,
    }

    /// A path of diffuse vertices: densities per area from each vertex to the next (camera) and back (light), which
    /// include the vertices in between that are not diffuse.
    struct Path {
        camera: Vec<f64>,
        light: Vec<f64>,
        emission: f64,
        connection: f64,
    }

    fn anything(rng: &mut Rng) -> f64 {
        (6.0 * f64::from(rng.next_1d()) - 3.0).exp()
    }

    /// Densities of all techniques for a path: merges at the first and at the second vertex, and connection.
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

    /// Weights of all techniques from partials, step by step as paths are traced.
    fn weights(balance: &Balance, path: &Path, last: Last) -> [Option<f64>; 3] {
        let m = path.camera.len() + 1;
        let [camera, light] = [&path.camera, &path.light]
            .map(|all| all.iter().map(|&p| p as f32).collect::<Vec<_>>());
        let l = (path.emission / path.connection) as f32;
        // The partial of the photon at the first vertex.
        let partial = (m >= 2).then(|| {
            let previous = match (m, last) {
                (2, Last::Connected) => PreviousTechnique::Connected { inverse_l: l.recip() },
                (2, Last::Straight) => PreviousTechnique::Never,
                (2, Last::Caustic) => PreviousTechnique::Merged(PhotonClass::Caustic),
                _ => PreviousTechnique::Merged(PhotonClass::Diffuse),
            };
            balance.photon(previous, light[0])
        });
        let by = balance.at_first(camera.first().copied().unwrap_or(1.0));
        let first = (m >= 2 || last != Last::Connected)
            .then(|| f64::from(first_weight(by, partial.unwrap_or(0.0))));
        let earlier = (m >= 2).then(|| balance.toward_second(camera[0]) * light[0]);
        let class = if m == 2 { PhotonClass::Caustic } else { PhotonClass::Diffuse };
        let second = (m >= 3 || (m == 2 && last == Last::Caustic))
            .then(|| f64::from(balance.second_weights(earlier.unwrap())[class as usize]));
        let connection = (last == Last::Connected && m <= 2)
            .then(|| f64::from(balance.connection_weight(earlier.unwrap_or(0.0), l)));
        [first, second, connection]
    }

    #[test]
    fn weights_match_the_balance_heuristic_of_all_techniques() {
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
    fn only_technique_of_a_path_weighs_1_even_without_merges() {
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
        // Connections then have all of the weight.
        let [first, _, connected] = weights(&balance, &path(2), Last::Connected);
        assert!(first.unwrap() < 1e-6 && connected.unwrap() > 1.0 - 1e-6);
    }
}
