//! Homogeneous media: absorption and scattering between surfaces.
//!
//! A medium absorbs and scatters light along its way. Its coefficients are the shares of the light
//! per scene unit that are absorbed and scattered; they are constant. theory.md, section 9a.

use crate::base::math::{Frame, Rgb};
use crate::base::rng::Rng;
use glam::Vec3;
use serde::Serialize;
use std::f32::consts::{PI, TAU};

/// A homogeneous medium.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Medium {
    /// Name in the scene file.
    #[serde(skip)]
    pub name: String,
    /// Absorption coefficient `sigma_a`, 1/scene unit; not negative.
    pub absorption: Rgb,
    /// Scattering coefficient `sigma_s`, 1/scene unit; not negative.
    pub scattering: Rgb,
    /// Asymmetry parameter `g` of the phase function of Henyey and Greenstein, the mean cosine of
    /// the scattering angle, in (-1, 1).
    pub asymmetry: f32,
    /// Where media overlap, the one of the highest priority fills the space; of those with the same
    /// priority, the smaller one.
    pub priority: i32,
}

/// What happens to a path on its way through a medium.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Flight {
    /// It reaches the end of the segment.
    Arrives {
        /// Transmittance over the probability of this event.
        weight: Rgb,
    },
    /// It scatters before.
    Scatters {
        /// Distance, scene units.
        distance: f32,
        /// Transmittance over the density of the distance, scene units. The scattering coefficient
        /// is not included.
        weight: Rgb,
    },
}

impl Medium {
    /// Empty space inside of an object, where another medium is all around.
    pub fn vacuum() -> Self {
        Self {
            name: "vacuum".into(),
            absorption: Rgb::ZERO,
            scattering: Rgb::ZERO,
            asymmetry: 0.0,
            priority: 0,
        }
    }

    /// A medium that absorbs only, such that white light has this color, in [0, 1], after
    /// `distance` scene units.
    pub fn absorbing(name: &str, color: Rgb, distance: f32) -> Self {
        // Less than a millionth is nothing, and the coefficient stays finite.
        let absorption = -color.max(Rgb::splat(1e-6)).map(f32::ln) / distance;
        Self {
            name: name.to_owned(),
            absorption: absorption.max(Rgb::ZERO),
            scattering: Rgb::ZERO,
            asymmetry: 0.0,
            priority: 0,
        }
    }

    /// Extinction coefficient `sigma_t`, 1/scene unit: the sum of both others.
    pub fn extinction(&self) -> Rgb {
        self.absorption + self.scattering
    }

    /// Returns true if the medium scatters light of any color.
    pub fn scatters(&self) -> bool {
        self.scattering != Rgb::ZERO
    }

    /// Share of the light that is neither absorbed nor scattered over this distance, which may be
    /// infinite. theory.md (37b)
    pub fn transmittance(&self, distance: f32) -> Rgb {
        // Zero times infinity is not a number.
        let channel = |sigma: f32| if sigma > 0.0 { (-sigma * distance).exp() } else { 1.0 };
        self.extinction().map(channel)
    }

    /// Samples how far a path of this weight goes that meets a surface at `distance` scene units,
    /// which may be infinite. The distance is drawn for one color channel, chosen in proportion to
    /// the weight, and weighed by the density over all of them. No random numbers are drawn in a
    /// medium that only absorbs. theory.md (37c), (37d)
    pub fn travel(&self, distance: f32, weight: Rgb, rng: &mut Rng) -> Flight {
        if !self.scatters() {
            return Flight::Arrives { weight: self.transmittance(distance) };
        }
        let extinction = self.extinction();
        let shares = shares(weight);
        let [choice, u] = rng.next_2d();
        let sigma = chosen(extinction, shares, choice);
        // Infinite where the channel meets nothing.
        let flown = -(1.0 - u).ln() / sigma;
        if flown < distance {
            let left = self.transmittance(flown);
            return Flight::Scatters {
                distance: flown,
                weight: left / shares.dot(extinction * left),
            };
        }
        let left = self.transmittance(distance);
        Flight::Arrives { weight: left / shares.dot(left) }
    }

    /// Density with which [`Self::travel`] ends at a distance, for a path of this weight, 1/scene
    /// unit. theory.md (37c)
    pub fn flight_density(&self, distance: f32, weight: Rgb) -> f32 {
        shares(weight).dot(self.extinction() * self.transmittance(distance))
    }

    /// The phase function, 1/sr, for light that flies along `from` and leaves along `to`, both unit
    /// vectors. It is also the density of [`Self::scatter`]. theory.md (37e)
    pub fn phase(&self, from: Vec3, to: Vec3) -> f32 {
        henyey_greenstein(self.asymmetry, from.dot(to))
    }

    /// Samples the direction in which a path goes on that arrives along the unit vector `from`.
    pub fn scatter(&self, from: Vec3, rng: &mut Rng) -> Vec3 {
        let g = self.asymmetry;
        let [u, v] = rng.next_2d();
        let cos = if g.abs() < 1e-3 {
            1.0 - 2.0 * u
        } else {
            let ratio = (1.0 - g * g) / (1.0 + g - 2.0 * g * u);
            ((1.0 + g * g - ratio * ratio) / (2.0 * g)).clamp(-1.0, 1.0)
        };
        let sin = (1.0 - cos * cos).max(0.0).sqrt();
        let (sin_phi, cos_phi) = (TAU * v).sin_cos();
        Frame::new(from).to_world(Vec3::new(sin * cos_phi, sin * sin_phi, cos))
    }
}

/// The phase function of Henyey and Greenstein for the asymmetry parameter `g`, 1/sr, at a cosine
/// of the scattering angle. theory.md (37e)
#[inline]
pub fn henyey_greenstein(g: f32, cos: f32) -> f32 {
    let base = (1.0 + g * g - 2.0 * g * cos).max(f32::MIN_POSITIVE);
    (1.0 - g * g) / (4.0 * PI * base * base.sqrt())
}

/// Probabilities of the channels of a path's weight.
fn shares(weight: Rgb) -> Rgb {
    let size = weight.abs();
    let sum = size.element_sum();
    if sum > 0.0 { size / sum } else { Rgb::splat(1.0 / 3.0) }
}

/// The coefficient of the channel that a uniform number chooses.
fn chosen(coefficients: Rgb, shares: Rgb, choice: f32) -> f32 {
    if choice < shares.x {
        coefficients.x
    } else if choice < shares.x + shares.y {
        coefficients.y
    } else {
        coefficients.z
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::rng::{Stream, StreamKey};

    fn medium(absorption: Rgb, scattering: Rgb, asymmetry: f32) -> Medium {
        Medium { name: "test".into(), absorption, scattering, asymmetry, priority: 0 }
    }

    fn rng() -> Rng {
        StreamKey::new(1, Stream::Test, 0).rng(0)
    }

    #[test]
    fn color_at_a_distance_is_the_transmittance_there() {
        let color = Rgb::new(0.9, 0.5, 0.1);
        let medium = Medium::absorbing("wine", color, 3.0);
        assert!(medium.transmittance(3.0).distance(color) < 1e-6);
        assert!(medium.transmittance(6.0).distance(color * color) < 1e-6);
        assert_eq!(medium.transmittance(0.0), Rgb::ONE);
        let clear = medium_of_no_effect();
        assert_eq!(clear.transmittance(f32::INFINITY), Rgb::ONE);
    }

    fn medium_of_no_effect() -> Medium {
        medium(Rgb::ZERO, Rgb::ZERO, 0.0)
    }

    /// The mean weight of paths that arrive is the transmittance, and the mean of the scattering
    /// coefficient times the weight of the others is the share that scatters, in each channel,
    /// whatever weight chooses the channel.
    #[test]
    fn flights_have_the_means_of_the_exponential_law() {
        let medium = medium(Rgb::new(0.1, 0.5, 0.0), Rgb::new(1.0, 0.2, 0.3), 0.0);
        let distance = 0.8;
        for weight in [Rgb::ONE, Rgb::new(0.2, 5.0, 1.0), Rgb::new(1.0, -0.5, 0.25)] {
            let (mut rng, count) = (rng(), 200_000);
            let mut sums = [[glam::DVec3::ZERO; 2]; 2];
            for _ in 0..count {
                let (which, value) = match medium.travel(distance, weight, &mut rng) {
                    Flight::Arrives { weight } => (0, weight),
                    Flight::Scatters { distance: flown, weight } => {
                        assert!(flown < distance);
                        (1, weight * medium.scattering)
                    }
                };
                sums[which][0] += value.as_dvec3();
                sums[which][1] += value.as_dvec3() * value.as_dvec3();
            }
            let left = medium.transmittance(distance);
            let scattered = medium.scattering / medium.extinction() * (Rgb::ONE - left);
            for ([sum, squares], expected) in sums.into_iter().zip([left, scattered]) {
                let mean = sum / f64::from(count);
                let error =
                    ((squares / f64::from(count) - mean * mean) / f64::from(count)).map(f64::sqrt);
                let deviation = (mean - expected.as_dvec3()).abs() / error;
                assert!(deviation.max_element() < 4.0, "{mean} {expected} {deviation}");
            }
        }
    }

    #[test]
    fn unbounded_flights_end_in_channels_that_meet_something() {
        let medium = medium(Rgb::ZERO, Rgb::new(1.0, 0.0, 0.0), 0.0);
        let mut rng = rng();
        for _ in 0..1000 {
            match medium.travel(f32::INFINITY, Rgb::ONE, &mut rng) {
                Flight::Arrives { weight } => {
                    assert_eq!(weight.x, 0.0);
                    assert!((weight.y - 1.5).abs() < 1e-6, "{weight}");
                }
                Flight::Scatters { weight, .. } => assert!(weight.is_finite(), "{weight}"),
            }
        }
    }

    #[test]
    fn phase_function_is_the_density_of_its_directions() {
        for g in [-0.7, 0.0, 5e-4, 0.3, 0.9] {
            let medium = medium(Rgb::ZERO, Rgb::ONE, g);
            let from = Vec3::new(1.0, 2.0, -0.5).normalize();
            let (mut rng, count) = (rng(), 100_000);
            // The mean cosine is g, and the reciprocal of the density has the mean of the sphere's
            // size.
            let (mut cosines, mut squares, mut sphere, mut sphere2) = (0.0, 0.0, 0.0, 0.0);
            for _ in 0..count {
                let to = medium.scatter(from, &mut rng);
                assert!((to.length() - 1.0).abs() < 1e-5);
                let cos = f64::from(from.dot(to));
                cosines += cos;
                squares += cos * cos;
                let size = 1.0 / f64::from(medium.phase(from, to));
                sphere += size;
                sphere2 += size * size;
            }
            let n = f64::from(count);
            let within = |sum: f64, squares: f64, expected: f64| {
                let mean = sum / n;
                let error = ((squares / n - mean * mean) / n).max(1e-12).sqrt();
                assert!((mean - expected).abs() < 4.0 * error + 1e-4, "{g}: {mean} {expected}");
            };
            within(cosines, squares, f64::from(g));
            within(sphere, sphere2, 4.0 * std::f64::consts::PI);
        }
    }
}
