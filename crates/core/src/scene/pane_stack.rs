//! Panes behind each other: what is lost where their polarization is left out.

use super::panes::PanePassage;
use super::{MediumState, Scene};
use crate::accel::{Intersect, Ray};
use crate::scene::bsdf::fresnel;
use glam::Vec3;

/// Maximum number of panes of a stack.
const MAX_PANES: u32 = 32;

/// Panes that a ray crosses one after the other, as if they were parallel, clear and endless: all
/// reflections between them are included. Shares of unpolarized light; theory.md (30e)
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PaneStack {
    /// Number of panes.
    pub panes: u32,
    /// Share that the stack transmits.
    pub exact: f64,
    /// Share if polarization is lost at each face of a slab, and at each sheet: that of paths
    /// through their BSDFs.
    pub by_faces: f64,
    /// Share if polarization is lost at each pane.
    pub by_panes: f64,
    /// Share with the polarization of light that goes straight, without that of light between the
    /// panes.
    pub straight: f64,
}

impl PaneStack {
    /// The stack of panes with these refractive indices and cosines with the normal outside; `true`
    /// for slabs.
    pub fn new(panes: &[(f32, f32, bool)]) -> Self {
        // Reflections over transmittances of panes that absorb nothing add up, since
        // 1/T - 1 of two panes is the sum of those of each.
        let (mut polarized, mut faces, mut sheets) = ([0.0; 2], 0.0, 0.0);
        let (mut straight, mut mean) = ([1.0; 2], 1.0);
        for (index, cos, is_slab) in panes {
            let (reflectances, _) = fresnel::polarized(*cos, *index);
            let reflectances = reflectances.map(|own| f64::from(own).min(1.0 - 1e-9));
            let through = reflectances.map(|own| (1.0 - own) / (1.0 + own));
            let own = 0.5 * (through[0] + through[1]);
            for ((sum, product), through) in polarized.iter_mut().zip(&mut straight).zip(through) {
                *sum += 1.0 / through - 1.0;
                *product *= through;
            }
            let face = 0.5 * (reflectances[0] + reflectances[1]);
            sheets += 1.0 / own - 1.0;
            faces += if *is_slab { 2.0 * face / (1.0 - face) } else { 1.0 / own - 1.0 };
            mean *= own;
        }
        let by_panes = 1.0 / (1.0 + sheets);
        Self {
            panes: panes.len() as u32,
            exact: 0.5 * polarized.iter().map(|sum| 1.0 / (1.0 + sum)).sum::<f64>(),
            by_faces: 1.0 / (1.0 + faces),
            by_panes,
            straight: 0.5 * (straight[0] + straight[1]) + by_panes - mean,
        }
    }
}

impl Scene {
    /// The panes that a ray crosses before it meets another surface, or ends at a distance.
    pub fn pane_stack(
        &self,
        accel: &dyn Intersect,
        from: Vec3,
        direction: Vec3,
        distance: f32,
    ) -> PaneStack {
        let mut panes = Vec::new();
        let (mut ray, mut left) = (Ray::new(from, direction), distance);
        while panes.len() < MAX_PANES as usize {
            let hit = accel.closest_hit(&ray);
            if hit.is_miss() || hit.t >= left {
                break;
            }
            let surface = self.surface(&ray, &hit);
            let pane = self.pane_at(accel, &surface, MediumState::default());
            let Some(PanePassage { start, interface: (index, cos), .. }) = pane else { break };
            panes.push((index, cos, pane.is_some_and(|own| own.is_slab())));
            left -= (start - ray.origin).dot(direction);
            ray = Ray::new(start, direction);
        }
        PaneStack::new(&panes)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Index 1.5: two sheets at 60 degrees transmit .7656, and at 75 degrees .4749.
    #[test]
    fn stacks_have_the_shares_of_closed_forms() {
        for (degrees, exact, faces) in [(60.0f32, 0.7656, 0.7185), (75.0, 0.4749, 0.4246)] {
            let cos = degrees.to_radians().cos();
            let slabs = PaneStack::new(&[(1.5, cos, true); 2]);
            assert!((slabs.exact - exact).abs() < 2e-4, "{slabs:?}");
            assert!((slabs.by_faces - faces).abs() < 3e-4, "{slabs:?}");
            let sheets = PaneStack::new(&[(1.5, cos, false); 2]);
            assert!((sheets.by_faces - sheets.by_panes).abs() < 1e-9, "{sheets:?}");
            let single = PaneStack::new(&[(1.5, cos, false)]);
            for own in [single.by_faces, single.by_panes, single.straight] {
                assert!((own - single.exact).abs() < 1e-9, "{single:?}");
            }
        }
        let none = PaneStack::new(&[]);
        assert!([none.exact, none.by_faces, none.by_panes, none.straight] == [1.0; 4]);
        let normal = PaneStack::new(&[(1.5, 1.0, true); 3]);
        assert!((normal.by_faces - normal.exact).abs() < 1e-6, "{normal:?}");
    }
}
