//! Lenses of spherical surfaces: prescriptions, and the glass and the black mounts made of them.
//!
//! Millimeters. The axis is +z, along which light goes to the sensor; the first surface's vertex is
//! the origin.

use super::mesh::Mesh;
use super::profile::{ProfilePoint, arc, edges};
use super::shapes::lathe;
use glam::dvec2;

/// A row of a prescription: a spherical surface, or the stop.
#[derive(Clone, Copy, Debug)]
pub struct Surface {
    /// Positive if the center of curvature is behind the surface, toward the sensor; 0 is the stop.
    pub radius: f64,
    /// To the next surface, along the axis; 0 behind the last.
    pub thickness: f64,
    /// Refractive index behind.
    pub index: f64,
    /// Diameter of the part that is ground and polished.
    pub diameter: f64,
}

const fn row(radius: f64, thickness: f64, index: f64, diameter: f64) -> Surface {
    Surface { radius, thickness, index, diameter }
}

/// Double Gauss, f/2, 50 mm: A. W. Tronnier, US patent 2,673,491 (1954), as tabulated by W. J.
/// Smith, Modern Lens Design (1992), p. 312, at half its size. Kolb, Mitchell and Hanrahan (1995)
/// introduced it to rendering.
pub const DOUBLE_GAUSS: [Surface; 11] = [
    row(29.475, 3.76, 1.67, 25.2),
    row(84.83, 0.12, 1.0, 25.2),
    row(19.275, 4.025, 1.67, 23.0),
    row(40.77, 3.275, 1.699, 23.0),
    row(12.75, 5.705, 1.0, 18.0),
    row(0.0, 4.5, 1.0, 17.1),
    row(-14.495, 1.18, 1.603, 17.0),
    row(40.77, 6.065, 1.658, 20.0),
    row(-20.385, 0.19, 1.0, 20.0),
    row(437.065, 3.22, 1.717, 20.0),
    row(-39.73, 0.0, 1.0, 20.0),
];

/// Segments around the axis.
pub const SEGMENTS: usize = 80;
/// Largest distance of the middle of a facet from the sphere along a meridian. Interpolated normals
/// are exact, so rays are displaced by no more than this and bent correctly.
const SAGITTA: f64 = 0.004;

impl Surface {
    /// From its vertex to its rim, along the axis.
    pub fn sag(&self) -> f64 {
        let (r, h) = (self.radius, 0.5 * self.diameter);
        if r == 0.0 { 0.0 } else { r - r.signum() * (r * r - h * h).sqrt() }
    }

    /// The spherical cap, its vertex in the origin, its front toward the scene.
    fn cap(&self) -> Mesh {
        let radius = self.radius.abs();
        let opening = (0.5 * self.diameter / radius).asin();
        let rings = (radius * opening / (8.0 * radius * SAGITTA).sqrt()).ceil();
        // The lathe's axis is +y; there the scene is above.
        let (rim, pole) = (90.0 - opening.to_degrees(), 90.0);
        let sign = self.radius.signum();
        let center = dvec2(0.0, -self.radius);
        along_z(&[arc(center, radius, sign * rim, sign * pole, rings as usize)])
    }
}

/// An interface between two media.
pub struct Interface {
    /// Fronts are outside of the glass; of cemented glasses, toward the scene.
    pub mesh: Mesh,
    /// Refractive indices before and behind its front side.
    pub outside: f64,
    pub inside: f64,
}

/// All surfaces but the stop, with their distances from the first.
pub fn glass(lens: &[Surface]) -> Vec<Interface> {
    let mut before = 1.0;
    let mut interfaces = Vec::new();
    for (surface, depth) in lens.iter().zip(depths(lens)) {
        if surface.radius != 0.0 {
            let mesh = surface.cap().moved(0.0, 0.0, depth);
            let (outside, inside) = (before, surface.index);
            interfaces.push(if inside == 1.0 {
                Interface { mesh: mesh.flipped(), outside: inside, inside: outside }
            } else {
                Interface { mesh, outside, inside }
            });
        }
        before = surface.index;
    }
    interfaces
}

/// The mounts of the glass and the sensor: a tube of the radius `tube`, the stop, and rings between
/// the tube and the rims of the glass. Behind them is a body of the radius `body`, closed at
/// `back`.
pub fn mounts(lens: &[Surface], tube: f64, body: f64, back: f64) -> Mesh {
    // In the lathe's plane of radius and height.
    let wall = |depth: f64| dvec2(tube, -depth);
    let mut outlines = Vec::new();
    let mut outline = Vec::new();
    for (surface, depth) in lens.iter().zip(depths(lens)) {
        let depth = depth + surface.sag();
        if outline.is_empty() {
            outline.push(wall(depth));
        }
        outline.push(dvec2(0.5 * surface.diameter, -depth));
        if surface.index == 1.0 {
            if surface.radius != 0.0 {
                outline.push(wall(depth));
            }
            outlines.push(std::mem::take(&mut outline));
        }
    }
    if let (Some(front), Some(rear)) = (lens.first(), lens.last()) {
        let rear = depths(lens)[lens.len() - 1] + rear.sag();
        let body = [dvec2(body, -rear), dvec2(body, -back), dvec2(0.0, -back)];
        outlines.push([&[wall(front.sag()), wall(rear)][..], &body].concat());
    }
    let mut lines: Vec<_> = outlines.iter().flat_map(|outline| edges(outline)).collect();
    // Black looks the same at any normal.
    lines.iter_mut().flatten().for_each(|point| point.normal = None);
    along_z(&lines)
}

/// Distance of each surface's vertex from the first one's.
pub fn depths(lens: &[Surface]) -> Vec<f64> {
    let before = |i| lens[..i].iter().map(|surface| surface.thickness).sum();
    (0..lens.len()).map(before).collect()
}

/// Surfaces of revolution about the axis of the lens.
fn along_z(profiles: &[Vec<ProfilePoint>]) -> Mesh {
    Mesh::join(profiles.iter().map(|profile| lathe(profile, SEGMENTS))).turned_x(-90.0)
}
