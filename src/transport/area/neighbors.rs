//! Finds what lies around a cell.

use super::admission::{THICKNESS, admits, packed};
use super::cell_builder::{Frame, Maker, Near, Own, Spot};
use super::components::SideId;
use super::solids::{Wall, Walls};
use super::surfaces::box_around;
use glam::{DAffine3, DVec3, Vec3};

/// All that matters to a cell.
pub struct Surroundings {
    /// That may send photons.
    pub near: Vec<Near>,
    /// In front of something solid, if that may cover any of these.
    pub walls: Walls,
    /// Whether these are of several components.
    pub is_mixed: bool,
}

/// A place as seen from a patch.
#[derive(Clone, Copy)]
struct Seen {
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

impl Maker<'_> {
    /// All in reach; `None` if these are more than `limit` triangles.
    pub fn surroundings(
        &self,
        own: &Own,
        frame: &Frame,
        spot: &Spot,
        limit: usize,
    ) -> Option<Surroundings> {
        let Frame { origin, axes: [u, v, _], .. } = *frame;
        let radius = 1.0 + spot.tolerance;
        let reach = radius + spot.extent;
        let outer = spot.polygon.iter().map(|p| origin + (u * p.x + v * p.y) * self.radius);
        let margin = DVec3::splat(self.radius * (1.0 + spot.tolerance));
        let around = box_around(outer.flat_map(|p| [p - margin, p + margin]));
        let (mut near, mut solids) = (Vec::new(), Vec::new());
        let mut seen = self.seen(frame, own.place);
        let mut count = 0;
        let complete = self.reach.find(self.surfaces, &around, |place, triangle, corners| {
            if place != seen.place {
                seen = self.seen(frame, place);
            }
            let corners = corners.map(|corner| seen.to_patch.transform_point3(corner.as_dvec3()));
            let [low, high] =
                [DVec3::min, DVec3::max].map(|of| of(of(corners[0], corners[1]), corners[2]));
            let gap = (low - spot.high).max(spot.low - high).max(DVec3::ZERO);
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
            // All over the cell it may be too far from its plane.
            let height = normal.dot(corners[0]).abs() - normal.truncate().length() * spot.extent;
            let may_send = may_send && height < 1.01 * f64::from(THICKNESS);
            if !(is_solid || may_send) {
                return true;
            }
            let sends = may_send.then(|| {
                let given = self.surfaces.normal(place, triangle);
                let may_send = |&side: &usize| {
                    let counts = lit[side] || sides[side] == own.side;
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
            count += 1;
            count <= limit
        });
        complete.then(|| self.sorted(own, frame, near, solids))
    }

    /// Keeps what may cover some of what is near.
    fn sorted(
        &self,
        own: &Own,
        frame: &Frame,
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

    fn seen(&self, frame: &Frame, place: u32) -> Seen {
        let to_scene = self.surfaces.places()[place as usize].to_scene;
        let from_scene = frame.scene_to_local();
        Seen {
            place,
            to_patch: to_scene.map_or(from_scene, |to_scene| from_scene * to_scene),
            merges: self.surfaces.merges(place),
            holes: self.surfaces.has_holes(place),
        }
    }
}

impl Frame {
    /// To these coordinates.
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

/// Whether photons of a triangle with this normal, of any length, may be admitted on either side, before
/// their own normals tell.
fn may_be_admitted(normal: DVec3, [a, b, c]: [DVec3; 3]) -> bool {
    let length2 = normal.length_squared();
    // Those of slivers are rounded by more.
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
