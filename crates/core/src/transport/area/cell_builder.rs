//! Frames of patches and cells, and the triangles in reach of them.

use super::components::SideId;
use super::lit_sides::Sides;
use super::polygon::{Polygon, area, clip_to, rectangle};
use super::solids::{LIFT, Plane};
use super::surfaces::Surfaces;
use super::triangle_index::TriangleIndex;
use glam::{DVec2, DVec3, Vec3};

/// Coordinates of a patch: in its plane and above it, in radii.
#[derive(Clone, Copy, Debug)]
pub struct PatchFrame {
    /// A point of the plane.
    pub origin: DVec3,
    /// Unit vectors; the last points up.
    pub axes: [DVec3; 3],
    radius: f64,
    pub per_radius: f64,
}

impl PatchFrame {
    /// Frame of the side of a triangle to which `up` points. The first axis is along its longest
    /// edge.
    pub fn new(corners: [DVec3; 3], up: Vec3, radius: f64) -> Self {
        let edges = [0, 1, 2].map(|i| corners[(i + 1) % 3] - corners[i]);
        let longest = |a: &DVec3, b: &DVec3| a.length_squared().total_cmp(&b.length_squared());
        let along = edges.into_iter().max_by(longest).expect("three edges").normalize_or(DVec3::X);
        let up = up.as_dvec3();
        let normal = edges[0].cross(edges[1]).normalize_or(up);
        let normal = if normal.dot(up) < 0.0 { -normal } else { normal };
        // The first corner as positions have it.
        let origin = corners[0].as_vec3().as_dvec3();
        Self {
            origin,
            axes: [along, normal.cross(along), normal],
            radius,
            per_radius: radius.recip(),
        }
    }

    /// Coordinates of a point.
    pub fn local(&self, point: DVec3) -> DVec3 {
        let from = (point - self.origin) * self.per_radius;
        DVec3::from_array(self.axes.map(|axis| axis.dot(from)))
    }

    /// This frame with another point of the plane as origin.
    pub fn about(&self, at: DVec2) -> Self {
        let from = self.axes[0] * at.x + self.axes[1] * at.y;
        Self { origin: self.origin + from * self.radius, ..*self }
    }
}

/// A side of a triangle on which points are.
#[derive(Clone, Copy, Debug)]
pub struct GatherFacet {
    /// Index of the place.
    pub place: u32,
    /// Index of the triangle in its mesh.
    pub triangle: u32,
    /// Unit normal of the side.
    pub normal: Vec3,
    /// The side.
    pub side: SideId,
    /// Whether it has holes.
    pub holes: bool,
}

/// A triangle in reach.
#[derive(Clone, Debug)]
pub struct Near {
    pub place: u32,
    pub triangle: u32,
    pub corners: [DVec3; 3],
    /// Unit normal of the side that may send photons.
    pub normal: DVec3,
    pub component: u32,
    /// Tag of the side that may send photons.
    pub tag: u8,
    /// Whether it has holes.
    pub holes: bool,
}

/// Computes cells.
#[derive(Clone, Copy)]
pub struct CellBuilder<'a> {
    /// Surfaces of the scene.
    pub surfaces: &'a dyn Surfaces,
    /// The sides of these surfaces that light reaches.
    pub sides: &'a Sides,
    /// Search structure over their triangles.
    pub reach: &'a TriangleIndex,
    /// Radius of the spheres, scene units.
    pub radius: f64,
    /// How often the radius was halved.
    pub level: u8,
}

/// The points of a cell, in the coordinates of its patch about its middle.
pub struct CellFrame {
    /// Half of the sides of the cell around the origin.
    pub half: DVec2,
    /// The part of the cell in the triangle.
    pub polygon: Polygon,
    /// Distance of its farthest point from the origin.
    pub extent: f64,
    /// Smallest and largest coordinates of its points.
    pub low: DVec3,
    pub high: DVec3,
    /// Points that are closer than this, in radii, are equal.
    pub tolerance: f64,
}

impl CellBuilder<'_> {
    /// The frame of a cell whose middle is the origin of `frame`.
    pub fn cell_frame(&self, frame: &PatchFrame, corners: [DVec3; 3], half: DVec2) -> CellFrame {
        let flat = corners.map(|corner| frame.local(corner).truncate());
        let mut polygon = clip_to(&flat, half);
        if polygon.is_empty() {
            // Rounding may still assign points to this cell.
            polygon = rectangle(half).to_vec();
        }
        let extent = polygon.iter().fold(0.0, |far: f64, corner| far.max(corner.length()));
        let (low, high) =
            polygon.iter().fold((DVec2::INFINITY, DVec2::NEG_INFINITY), |(low, high), &corner| {
                (low.min(corner), high.max(corner))
            });
        let largest = corners.iter().fold(0.0, |far: f64, c| far.max(c.abs().max_element()));
        let tolerance = 1e-5 + 4.0 * largest * f64::from(f32::EPSILON) / self.radius;
        let [low, high] = [low, high].map(|corner| corner.extend(0.0));
        CellFrame { half, polygon, extent, low, high, tolerance: tolerance.min(1e-2) }
    }
}

impl Near {
    /// The part within a rectangle around the patch, if all of that is in its plane.
    pub fn on_ground(&self, half: DVec2) -> Option<Polygon> {
        let mut flat = self.corners.map(DVec3::truncate);
        let is_low = |height: f64| height.abs() <= LIFT;
        let all_low = self.corners.iter().all(|corner| is_low(corner.z));
        if !all_low && self.normal.z < 0.999 {
            return None;
        }
        if area(&flat) < 0.0 {
            flat.reverse();
        }
        let part = clip_to(&flat, half);
        let height = |p: &DVec2| {
            let from = *p - self.corners[0].truncate();
            self.corners[0].z - self.normal.truncate().dot(from) / self.normal.z
        };
        (all_low || part.iter().all(|p| is_low(height(p)))).then_some(part)
    }

    /// Whether its middle is above the plane of the patch.
    pub fn is_above_ground(&self) -> bool {
        self.corners.iter().map(|corner| corner.z).sum::<f64>() > 0.0
    }

    /// Whether another component's triangle lies in the same plane, and takes precedence.
    pub fn is_under(&self, other: &Self, plane: &Plane) -> bool {
        other.component != self.component
            && (other.place, other.triangle) < (self.place, self.triangle)
            && other.holes == self.holes
            && other.normal.dot(self.normal) > 0.999
            && other.corners.iter().all(|&corner| plane.height(corner).abs() <= LIFT)
    }
}

impl CellFrame {
    /// Whether a segment that is not on the border of what was looked at is in reach.
    pub fn reaches(&self, &(p, q): &(DVec2, DVec2), outer: DVec2) -> bool {
        let on_border = |axis: usize| {
            let at = |p: DVec2| p[axis].abs() >= outer[axis] - self.tolerance;
            at(p) && at(q) && (p[axis] > 0.0) == (q[axis] > 0.0)
        };
        let share = (-p.dot(q - p) / (q - p).length_squared()).clamp(0.0, 1.0);
        let distance = (p + (q - p) * share).length();
        !on_border(0) && !on_border(1) && distance < 1.0 + self.extent + self.tolerance
    }

    /// Whether a point is out of reach.
    pub fn is_beyond(&self, p: DVec2, outer: DVec2) -> bool {
        let on_border = p.abs().cmpge(outer - self.tolerance).any();
        on_border || p.length() >= 1.0 + self.extent
    }
}
