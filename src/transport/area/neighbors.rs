//! Finds the surface around a cell.

use super::admission::{self, THICKNESS, admits, packed};
use super::cell_builder::{CellBuilder, CellFrame, GatherFacet, Near, PatchFrame};
use super::components::SideId;
use super::solids::{Wall, Walls};
use super::surfaces::box_around;
use glam::{DAffine3, DVec3, Vec3};

/// The triangles in reach of a cell.
pub struct Surroundings {
    /// Triangles that may send photons.
    pub near: Vec<Near>,
    /// Triangles in front of something solid that may cover any of these.
    pub walls: Walls,
    /// Whether these are of several components.
    pub is_mixed: bool,
}

/// Bound on the work of one cell: numbers of triangles.
///
/// Both numbers follow from the geometry, the cell and the radius of the areas. They do not depend on
/// time, threads or what is already known.
#[derive(Clone, Copy, Debug)]
pub struct WorkBound {
    /// Maximum number of triangles whose boxes meet the box around the cell, extended by the radius.
    pub visited: usize,
    /// Maximum number of these that are in reach and may send photons or be in front of a solid.
    pub kept: usize,
}

/// A mesh at one of its places, in the coordinates of a patch.
#[derive(Clone, Copy)]
struct PlacedMesh {
    place: u32,
    /// From the mesh's space to the patch's.
    to_patch: DAffine3,
    merges: bool,
    holes: bool,
}

/// A triangle in front of something solid.
struct Solid {
    place: u32,
    triangle: u32,
    corners: [DVec3; 3],
    /// Whether light reaches its front and not its back, or the other way around.
    front: bool,
    component: u32,
}

impl CellBuilder<'_> {
    /// The surroundings of a cell; `None` if they exceed `bound`.
    pub fn surroundings(
        &self,
        own: &GatherFacet,
        frame: &PatchFrame,
        cell: &CellFrame,
        bound: WorkBound,
    ) -> Option<Surroundings> {
        let PatchFrame { origin, axes: [u, v, _], .. } = *frame;
        let radius = 1.0 + cell.tolerance;
        let reach = radius + cell.extent;
        let outer = cell.polygon.iter().map(|p| origin + (u * p.x + v * p.y) * self.radius);
        let margin = DVec3::splat(self.radius * (1.0 + cell.tolerance));
        let around = box_around(outer.flat_map(|p| [p - margin, p + margin]));
        let (mut near, mut solids) = (Vec::new(), Vec::new());
        let mut seen = self.seen(frame, own.place);
        let (mut visited, mut kept) = (0, 0);
        let complete = self.reach.find(self.surfaces, &around, |place, triangle, corners| {
            visited += 1;
            if visited > bound.visited {
                return false;
            }
            if place != seen.place {
                seen = self.seen(frame, place);
            }
            let corners = corners.map(|corner| seen.to_patch.transform_point3(corner.as_dvec3()));
            let [low, high] =
                [DVec3::min, DVec3::max].map(|of| of(of(corners[0], corners[1]), corners[2]));
            let gap = (low - cell.high).max(cell.low - high).max(DVec3::ZERO);
            if gap.length_squared() >= radius * radius {
                return true;
            }
            let front = self.sides.of(place, triangle, true);
            let sides = [front, SideId(front.0 ^ 1)];
            let lit = sides.map(|side| self.sides.reached(side));
            let is_solid = lit[0] != lit[1];
            let normal = (corners[1] - corners[0]).cross(corners[2] - corners[0]);
            let may_send = seen.merges
                && (lit[0] || lit[1] || front.component() == own.side.component())
                && may_be_admitted(normal, corners);
            if !(is_solid || may_send)
                || distance2(corners, normal) >= reach * reach
                || self.sides.is_double(place, triangle)
            {
                return true;
            }
            let Some(normal) = normal.try_normalize() else { return true };
            // All points of the cell may be too far from its plane.
            let height = normal.dot(corners[0]).abs() - normal.truncate().length() * cell.extent;
            let may_send = may_send && height < 1.01 * f64::from(THICKNESS);
            if !(is_solid || may_send) {
                return true;
            }
            let sends = may_send.then(|| {
                let given = self.surfaces.normal(place, triangle);
                let may_send = |&side: &usize| {
                    let counts = (lit[side] || sides[side] == own.side)
                        && !admission::is_other_side(sides[side].tag(), own.side.tag());
                    let normal = if side == 0 { given } else { -given };
                    counts && admits(packed(normal), own.normal)
                };
                let side = (0..2).find(may_send)?;
                let front = frame.facing(normal, given);
                Some(if side == 0 { front } else { -front })
            });
            let component = front.component();
            if let Some(normal) = sends.flatten() {
                near.push(Near { place, triangle, corners, normal, component, holes: seen.holes });
            } else if !is_solid {
                return true;
            }
            if is_solid {
                solids.push(Solid { place, triangle, corners, front: lit[0], component });
            }
            kept += 1;
            kept <= bound.kept
        });
        complete.then(|| self.sorted(own, frame, near, solids))
    }

    /// Keeps the solids that may cover some of the triangles that are near.
    fn sorted(
        &self,
        own: &GatherFacet,
        frame: &PatchFrame,
        near: Vec<Near>,
        mut solids: Vec<Solid>,
    ) -> Surroundings {
        let component = own.side.component();
        let is_mixed = near.iter().any(|near| near.component != component);
        if !is_mixed {
            // Nothing is covered by its own component.
            solids.retain(|solid| solid.component != component);
        }
        let wall = |solid: &Solid| {
            let [a, b, c] = solid.corners;
            let given = self.surfaces.normal(solid.place, solid.triangle);
            let front = frame.facing((b - a).cross(c - a).normalize(), given);
            Wall::new(solid.corners, if solid.front { front } else { -front }, solid.component)
        };
        Surroundings { near, walls: Walls::new(solids.iter().map(wall).collect()), is_mixed }
    }

    fn seen(&self, frame: &PatchFrame, place: u32) -> PlacedMesh {
        let to_scene = self.surfaces.places()[place as usize].to_scene;
        let from_scene = frame.scene_to_local();
        PlacedMesh {
            place,
            to_patch: to_scene.map_or(from_scene, |to_scene| from_scene * to_scene),
            merges: self.surfaces.merges(place),
            holes: self.surfaces.has_holes(place),
        }
    }
}

impl PatchFrame {
    /// Map from the scene to these coordinates.
    fn scene_to_local(&self) -> DAffine3 {
        let [u, v, up] = self.axes.map(|axis| axis * self.per_radius);
        let matrix3 = glam::DMat3::from_cols(u, v, up).transpose();
        DAffine3 { matrix3, translation: -(matrix3 * self.origin) }
    }

    /// The normal in these coordinates, or its opposite, that points to the side of one in the scene.
    fn facing(&self, normal: DVec3, side: Vec3) -> DVec3 {
        let side = DVec3::from_array(self.axes.map(|axis| axis.dot(side.as_dvec3())));
        if normal.dot(side) < 0.0 { -normal } else { normal }
    }
}

/// Whether photons of a triangle with this normal, of any length, may be admitted on either side. A
/// coarse test: the packed normals of the photons decide.
fn may_be_admitted(normal: DVec3, [a, b, c]: [DVec3; 3]) -> bool {
    let length2 = normal.length_squared();
    // Normals of slivers have larger rounding errors.
    let is_sliver = length2 < 1e-6 * a.distance_squared(b) * a.distance_squared(c);
    normal.z * normal.z > 0.48 * 0.48 * length2 || is_sliver
}

/// Squared distance of a triangle with this normal, of any length, from the origin.
fn distance2([a, b, c]: [DVec3; 3], normal: DVec3) -> f64 {
    let edges = [(a, b), (b, c), (c, a)];
    if edges.iter().all(|&(p, q)| normal.dot(p.cross(q)) >= 0.0) {
        let height = normal.dot(a);
        return height * height / normal.length_squared().max(f64::MIN_POSITIVE);
    }
    let of_edge = |(p, q): (DVec3, DVec3)| {
        let along = q - p;
        let share = -p.dot(along) / along.length_squared().max(f64::MIN_POSITIVE);
        (p + along * share.clamp(0.0, 1.0)).length_squared()
    };
    edges.into_iter().map(of_edge).fold(f64::INFINITY, f64::min)
}
