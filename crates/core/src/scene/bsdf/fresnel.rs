//! Reflection at smooth interfaces (Fresnel), for unpolarized light.

use crate::base::math::Rgb;

/// Reflectances of an interface between dielectrics for both polarizations, across the plane of
/// incidence and within it, and the cosine of the refracted direction (0 for total reflection).
/// `cos_i` is in [0, 1]; `eta` is the index behind the interface over that in front. theory.md
/// (22).
#[inline(always)] // part of vector loops, which have no branches
pub fn polarized(cos_i: f32, eta: f32) -> ([f32; 2], f32) {
    let cos_t2 = 1.0 - (1.0 - cos_i * cos_i) / (eta * eta);
    let cos_t = cos_t2.max(0.0).sqrt();
    let s = (cos_i - eta * cos_t) / (cos_i + eta * cos_t);
    let p = (eta * cos_i - cos_t) / (eta * cos_i + cos_t);
    let is_total = cos_t2 <= 0.0;
    ([if is_total { 1.0 } else { s * s }, if is_total { 1.0 } else { p * p }], cos_t)
}

/// Reflectance of an interface between dielectrics, and the cosine of the refracted direction (0
/// for total reflection). `cos_i` is in [0, 1]; `eta` is the index behind the interface over that
/// in front. theory.md (22).
#[inline(always)]
pub fn dielectric(cos_i: f32, eta: f32) -> (f32, f32) {
    let ([s, p], cos_t) = polarized(cos_i, eta);
    (0.5 * (s + p), cos_t)
}

/// Shares of the light that a slab between parallel faces transmits, by polarization, with all
/// reflections inside.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PolarizedShares {
    /// Polarized across the plane of incidence.
    pub s: Rgb,
    /// Polarized within the plane of incidence.
    pub p: Rgb,
    /// Factor of the polarization at 45 degrees to the plane of incidence.
    pub between: Rgb,
}

impl PolarizedShares {
    /// Shares of a slab; the arguments are those of [`slab`]. theory.md (30a), (30d)
    pub fn of_slab(cos_i: f32, eta: f32, once: Rgb) -> Self {
        let ([s, p], _) = polarized(cos_i, eta);
        let between = match s.max(p) {
            1.0.. => Rgb::ZERO,
            _ => (1.0 - s) * (1.0 - p) * once / (Rgb::ONE - s * p * once * once),
        };
        Self { s: through_slab(s, once), p: through_slab(p, once), between }
    }

    /// Shares of a slab with a factor of all light.
    #[must_use]
    pub fn scaled(self, factor: Rgb) -> Self {
        Self { s: factor * self.s, p: factor * self.p, between: factor * self.between }
    }
}

/// Share that a slab of faces with this reflectance transmits, with all reflections inside.
fn through_slab(face: f32, once: Rgb) -> Rgb {
    match face {
        // Zero over zero if nothing is absorbed.
        1.0.. => Rgb::ZERO,
        _ => (1.0 - face).powi(2) * once / (Rgb::ONE - face * face * once * once),
    }
}

/// Shares of the light that a slab between parallel faces transmits and reflects, with all
/// reflections inside. Both polarizations are reflected on their own. `once` is the transmittance
/// of the medium between the faces. theory.md (30a).
pub fn slab(cos_i: f32, eta: f32, once: Rgb) -> [Rgb; 2] {
    let (reflectances, _) = polarized(cos_i, eta);
    let (mut transmitted, mut reflected) = (Rgb::ZERO, Rgb::ZERO);
    for own in reflectances {
        let through = through_slab(own, once);
        transmitted += 0.5 * through;
        reflected += 0.5 * (Rgb::splat(own) + own * once * through);
    }
    [transmitted, reflected]
}

/// Reflectance of a metal with the complex index `eta - i k`, relative to the medium before it.
/// theory.md (23).
pub fn conductor(cos_i: f32, eta: Rgb, k: Rgb) -> Rgb {
    let cos2 = cos_i * cos_i;
    let sin2 = (1.0 - cos2).max(0.0);
    let difference = eta * eta - k * k - sin2;
    let a2_plus_b2 = (difference * difference + 4.0 * eta * eta * k * k).map(f32::sqrt);
    let a = (0.5 * (a2_plus_b2 + difference)).max(Rgb::ZERO).map(f32::sqrt);
    let (sum, cross) = (a2_plus_b2 + cos2, 2.0 * cos_i * a);
    let s = (sum - cross) / (sum + cross);
    let (sum, cross) = (cos2 * a2_plus_b2 + sin2 * sin2, cross * sin2);
    let p = s * (sum - cross) / (sum + cross);
    0.5 * (s + p)
}

/// Schlick's approximation (1994) from the reflectance at normal incidence, 1 at grazing.
/// theory.md (24).
#[inline]
pub fn schlick(cos_i: f32, normal: Rgb) -> Rgb {
    normal + (Rgb::ONE - normal) * (1.0 - cos_i).max(0.0).powi(5)
}

/// The mean of [`schlick`] over a diffuse illumination.
/// theory.md (24).
#[inline]
pub fn schlick_mean(normal: Rgb) -> Rgb {
    normal + (Rgb::ONE - normal) / 21.0
}

/// `2 * integral of f(cos) cos d(cos)`: the mean of a reflectance over a diffuse illumination.
pub fn diffuse_mean(reflectance: impl Fn(f32) -> Rgb) -> Rgb {
    /// Number of midpoints; exact to 1e-6 for the functions of this module.
    const STEPS: u16 = 1024;
    let mut sum = glam::DVec3::ZERO;
    for i in 0..STEPS {
        let cos = (f32::from(i) + 0.5) / f32::from(STEPS);
        sum += (cos * reflectance(cos)).as_dvec3();
    }
    (sum * (2.0 / f64::from(STEPS))).as_vec3()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn reflectances_match_known_values() {
        // Normal incidence: ((n - 1)/(n + 1))^2, and ((n-1)^2 + k^2)/((n+1)^2 + k^2).
        assert!((dielectric(1.0, 1.5).0 - 0.04).abs() < 1e-6);
        assert!((dielectric(1.0, 1.0 / 1.5).0 - 0.04).abs() < 1e-6);
        let gold = conductor(1.0, Rgb::splat(0.5), Rgb::splat(2.5));
        assert!((gold.x - (0.25 + 6.25) / (2.25 + 6.25)).abs() < 1e-6, "{gold}");
        // Brewster's angle: only s-polarized light is reflected, ((n^2 - 1)/(n^2 + 1))^2 of it.
        let brewster = 1.5_f32.atan().cos();
        let expected = 0.5 * (1.25_f32 / 3.25).powi(2);
        assert!((dielectric(brewster, 1.5).0 - expected).abs() < 1e-6);
        // Without absorption a metal is a dielectric.
        for cos in [0.1, 0.5, 0.9] {
            let metal = conductor(cos, Rgb::splat(1.5), Rgb::ZERO);
            assert!((metal.x - dielectric(cos, 1.5).0).abs() < 1e-5, "{cos}");
        }
        // Grazing light is all reflected; total reflection begins at sin = 1/n.
        assert!(dielectric(1e-4, 1.5).0 > 0.999 && dielectric(0.0, 1.5).0 == 1.0);
        let critical = (1.0_f32 - 1.0 / 2.25).sqrt();
        assert_eq!(dielectric(critical - 1e-3, 1.0 / 1.5), (1.0, 0.0));
        assert!(dielectric(critical + 1e-3, 1.0 / 1.5).0 < 0.9);
    }

    #[test]
    fn slabs_transmit_both_polarizations_on_their_own() {
        // T = (1 - R)/(1 + R) for each polarization, then the mean: index 1.5 at 0, 60 and 75
        // degrees.
        for (degrees, expected) in [(0.0f32, 12.0 / 13.0), (60.0, 0.8478), (75.0, 0.6180)] {
            let [transmitted, reflected] = slab(degrees.to_radians().cos(), 1.5, Rgb::ONE);
            assert!((transmitted.x - expected).abs() < 1e-3, "{degrees}: {transmitted}");
            assert!((transmitted + reflected - Rgb::ONE).abs().max_element() < 1e-6);
        }
        // Half of the light is absorbed on each crossing, at normal incidence.
        let [transmitted, reflected] = slab(1.0, 1.5, Rgb::splat(0.5));
        let through = 0.96 * 0.96 * 0.5 / (1.0 - 0.04 * 0.04 * 0.25);
        assert!((transmitted.x - through).abs() < 1e-5, "{transmitted}");
        assert!((reflected.x - (0.04 + 0.04 * 0.5 * through)).abs() < 1e-5, "{reflected}");
        assert_eq!(slab(0.0, 1.5, Rgb::ONE)[0].x, 0.0);
    }

    #[test]
    fn reflectance_is_equal_from_both_sides() {
        for cos_i in [0.05, 0.3, 0.7, 1.0] {
            let (forth, cos_t) = dielectric(cos_i, 1.33);
            let (back, cos) = dielectric(cos_t, 1.0 / 1.33);
            assert!((forth - back).abs() < 1e-5 && (cos - cos_i).abs() < 1e-4, "{cos_i}");
        }
    }

    #[test]
    fn diffuse_means_match_closed_forms() {
        // Schlick: 2 * integral (F0 + (1 - F0)(1 - x)^5) x dx = F0 + (1 - F0)/21.
        let mean = diffuse_mean(|cos| schlick(cos, Rgb::splat(0.3)));
        assert!((mean - schlick_mean(Rgb::splat(0.3))).length() < 1e-6, "{mean}");
        // Fluxes into glass and out of it are in balance: (1 - F_in) = (1 - F_out)/n^2.
        let outside = diffuse_mean(|cos| Rgb::splat(dielectric(cos, 1.5).0));
        let inside = diffuse_mean(|cos| Rgb::splat(dielectric(cos, 1.0 / 1.5).0));
        assert!(((1.0 - inside.x) * 2.25 - (1.0 - outside.x)).abs() < 1e-4, "{outside} {inside}");
    }
}
