//! Linear polarization of light that goes straight through panes: Stokes vectors without circular
//! polarization. Light that starts unpolarized has the same share in both directions of travel.

use super::bsdf::fresnel::PolarizedShares;
use crate::base::math::Rgb;
use glam::Vec3;

/// Shares of unpolarized light that arrive after some panes, with their linear polarization.
/// theory.md (30d)
#[derive(Clone, Copy, Debug)]
pub struct PolarizedLight {
    /// Share of the light.
    pub share: Rgb,
    /// Light polarized along `axis` less that across it, and the same in axes that are turned by
    /// 45 degrees.
    linear: [Rgb; 2],
    /// Unit vector across the direction of the light.
    axis: Vec3,
    direction: Vec3,
}

impl PolarizedLight {
    /// Unpolarized light along a unit direction.
    pub fn unpolarized(direction: Vec3) -> Self {
        let axis = direction.any_orthonormal_vector();
        Self { share: Rgb::ONE, linear: [Rgb::ZERO; 2], axis, direction }
    }

    /// Passes a pane with this unit normal.
    pub fn pass(&mut self, normal: Vec3, shares: &PolarizedShares) {
        // Both polarizations are alike if the light arrives along the normal.
        let across = self.direction.cross(normal).try_normalize().unwrap_or(self.axis);
        let cos = self.axis.dot(across);
        let sin = self.axis.cross(across).dot(self.direction);
        let (cos, sin) = (cos * cos - sin * sin, 2.0 * cos * sin);
        let [along, diagonal] = self.linear;
        let along_turned = cos * along + sin * diagonal;
        let diagonal_turned = cos * diagonal - sin * along;
        let PolarizedShares { s, p, between } = *shares;
        let (mean, difference) = (0.5 * (s + p), 0.5 * (s - p));
        let share = self.share;
        self.share = mean * share + difference * along_turned;
        self.linear = [difference * share + mean * along_turned, between * diagonal_turned];
        self.axis = across;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A pane at this angle, of index 1.5, turned around the direction +z.
    fn pane(degrees: f32, turn: f32) -> (Vec3, PolarizedShares) {
        let (sin, cos) = degrees.to_radians().sin_cos();
        let (y, x) = turn.to_radians().sin_cos();
        (Vec3::new(sin * x, sin * y, -cos), PolarizedShares::of_slab(cos, 1.5, Rgb::ONE))
    }

    fn share(panes: &[(Vec3, PolarizedShares)]) -> f32 {
        let mut light = PolarizedLight::unpolarized(Vec3::Z);
        panes.iter().for_each(|(normal, shares)| light.pass(*normal, shares));
        light.share.x
    }

    #[test]
    fn panes_of_one_plane_of_incidence_pass_each_polarization_on_its_own() {
        for degrees in [0.0, 30.0, 60.0, 75.0] {
            let own = pane(degrees, 20.0);
            let PolarizedShares { s, p, .. } = own.1;
            let expected = 0.5 * (s.x * s.x + p.x * p.x);
            assert!((share(&[own, own]) - expected).abs() < 1e-5, "{degrees}");
            assert!((share(&[own, pane(degrees, 200.0)]) - expected).abs() < 1e-5, "{degrees}");
            // Planes of incidence at right angles exchange the polarizations.
            let crossed = share(&[own, pane(degrees, 110.0)]);
            assert!((crossed - s.x * p.x).abs() < 1e-5, "{degrees}");
        }
    }

    /// Malus: a polarizer between two crossed ones, each turned by 45 degrees, passes 1/8.
    #[test]
    fn polarizers_follow_malus() {
        let shares = PolarizedShares { s: Rgb::ONE, p: Rgb::ZERO, between: Rgb::ZERO };
        let at = |turn: f32| (pane(45.0, turn).0, shares);
        assert!(share(&[at(0.0), at(90.0)]).abs() < 1e-6);
        assert!((share(&[at(0.0), at(45.0), at(90.0)]) - 0.125).abs() < 1e-6);
        assert!((share(&[at(10.0), at(40.0)]) - 0.375).abs() < 1e-6);
    }

    #[test]
    fn share_does_not_depend_on_the_direction_of_travel() {
        let panes = [pane(60.0, 0.0), pane(75.0, 35.0), pane(40.0, 80.0)];
        let back = [panes[2], panes[1], panes[0]];
        assert!((share(&panes) - share(&back)).abs() < 1e-6);
    }
}
