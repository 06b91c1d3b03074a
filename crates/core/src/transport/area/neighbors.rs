//! Finds the surface around a cell.

use super::admission::{self, THICKNESS, admits, packed};
use super::cell_builder::{CellBuilder, CellFrame, GatherFacet, Near, PatchFrame};
use super::components::SideId;
use super::polygon::{Line, area, clip, edges, middle};
use super::solids::{Wall, Walls};
use super::surfaces::box_around;
use glam::{DAffine3, DVec2, DVec3, Vec3};

/// The triangles in reach of a cell.
pub struct Surroundings {
    /// Triangles that may send photons.
    pub near: Vec<Near>,
    /// Triangles in front of something solid that may cover any of these.
    pub walls: Walls,
    /// Whether these are of several components.
    pub is_mixed: bool,
    /// Whether these are those of one of several layers: only photons of this layer count.
    pub is_layered: bool,
    /// Triangles of the other layers.
    pub above: Vec<Near>,
}

/// Bound on the work of one cell: numbers of triangles.
///
/// Both numbers follow from the geometry, the cell and the radius of the areas. They do not depend
/// on time, threads or what is already known.
#[derive(Clone, Copy, Debug)]
pub struct WorkBound {
    /// Maximum number of triangles whose boxes meet the box around the cell, extended by the
    /// radius.
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
        let own_tag = self.sides.tag(own.side);
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
            let tags = sides.map(|side| self.sides.tag(side));
            let sends = may_send.then(|| {
                let given = self.surfaces.normal(place, triangle);
                let may_send = |&side: &usize| {
                    let counts = (lit[side] || sides[side] == own.side)
                        && !admission::is_other_side(tags[side], own_tag);
                    let normal = if side == 0 { given } else { -given };
                    counts && admits(packed(normal), own.normal)
                };
                let side = (0..2).find(may_send)?;
                let front = frame.facing(normal, given);
                Some((if side == 0 { front } else { -front }, tags[side]))
            });
            let component = front.component();
            if let Some((normal, tag)) = sends.flatten() {
                let holes = seen.holes;
                near.push(Near { place, triangle, corners, normal, component, tag, holes });
            } else if !is_solid {
                return true;
            }
            if is_solid {
                solids.push(Solid { place, triangle, corners, front: lit[0], component });
            }
            kept += 1;
            kept <= bound.kept
        });
        complete.then(|| self.sorted(own, (frame, cell), near, solids))
    }

    /// Keeps the solids that may cover some of the triangles that are near.
    fn sorted(
        &self,
        own: &GatherFacet,
        (frame, cell): (&PatchFrame, &CellFrame),
        mut near: Vec<Near>,
        mut solids: Vec<Solid>,
    ) -> Surroundings {
        let component = own.side.component();
        let own_tag = self.sides.tag(own.side);
        let is_layered = are_layers(&near, own_tag, cell.tolerance);
        let mut above = Vec::new();
        if is_layered {
            let (same, other) = near.into_iter().partition(|near| near.tag == own_tag);
            (near, above) = (same, other);
        }
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
        let walls = Walls::new(solids.iter().map(wall).collect());
        Surroundings { near, above, walls, is_mixed, is_layered }
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

    /// The normal in these coordinates, or its opposite, that points to the side of one in the
    /// scene.
    fn facing(&self, normal: DVec3, side: Vec3) -> DVec3 {
        let side = DVec3::from_array(self.axes.map(|axis| axis.dot(side.as_dvec3())));
        if normal.dot(side) < 0.0 { -normal } else { normal }
    }
}

/// Whether some triangle of another side lies over or under a triangle of the side of this tag, or
/// over one of a third side: these are layers with light of their own. Beside a thin body that lets
/// light in, the inside of its back seems to be one surface with the point. Triangles side by side
/// are one layer, and so are those at the same place.
fn are_layers(near: &[Near], own_tag: u8, tolerance: f64) -> bool {
    if near.iter().all(|near| near.tag == own_tag) {
        return false;
    }
    let flat: Vec<(u8, Flat)> = near.iter().map(|near| (near.tag, Flat::new(near))).collect();
    flat.iter().enumerate().any(|(index, (tag, own))| {
        let mut later = flat[index + 1..].iter().filter(|(other, _)| other != tag);
        later.any(|(_, other)| own.is_over_or_under(other, tolerance))
    })
}

/// A triangle seen along the normal of a patch.
struct Flat {
    polygon: [DVec2; 3],
    /// Its plane: the height is `offset + slope . point`.
    offset: f64,
    slope: DVec2,
    low: DVec3,
    high: DVec3,
}

/// Smallest overlap of two layers, squares of the radius: less is rounding, or too little to
/// matter.
const MIN_OVERLAP: f64 = 1e-6;

impl Flat {
    fn new(near: &Near) -> Self {
        let [a, b, c] = near.corners;
        let mut polygon = [a, b, c].map(DVec3::truncate);
        if area(&polygon) < 0.0 {
            polygon.reverse();
        }
        // The normals of triangles that are admitted are within 60 degrees.
        let normal = near.normal / near.normal.z.max(0.1);
        let slope = -normal.truncate();
        Self {
            polygon,
            offset: a.z - slope.dot(a.truncate()),
            slope,
            low: a.min(b).min(c),
            high: a.max(b).max(c),
        }
    }

    fn is_over_or_under(&self, other: &Self, tolerance: f64) -> bool {
        let apart = self.low.cmpgt(other.high) | self.high.cmplt(other.low);
        if apart.x || apart.y {
            return false;
        }
        let mut overlap = self.polygon.to_vec();
        for (a, b) in edges(&other.polygon) {
            let Some(line) = Line::through(a, b) else { return false };
            overlap = clip(&overlap, line);
            if overlap.is_empty() {
                return false;
            }
        }
        let gap = |p: &DVec2| {
            let [own, other] = [self, other].map(|flat| flat.offset + flat.slope.dot(*p));
            (own - other).abs()
        };
        area(&overlap) > MIN_OVERLAP && gap(&middle(&overlap)) > 2.0 * tolerance
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
