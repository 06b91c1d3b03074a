//! What the spheres around the points of a cell hold, worked out in f64.

use super::admission::{admits, packed};
use super::boundary::boundary;
use super::components::SideId;
use super::covered::{LIFT, Plane, Wall, Walls};
use super::list::{Facet, Holed, HoledList, List};
use super::patch::Grid;
use super::polygon::{Line, Polygon, area, clip, edges, middle, subtract};
use super::reach::Reach;
use super::sides::Sides;
use super::surfaces::{Surfaces, box_around, corners};
use glam::{DVec2, DVec3, Vec3};

/// Cells larger than this, in radii, that have more triangles in reach than [`CROWD`] are split.
const LARGE: f64 = 0.8;
const CROWD: usize = 48;

/// What is known of a cell.
#[derive(Debug)]
pub enum Cell {
    /// The surface in reach is flat, and ends at most at one straight line: a point is
    /// `offset + toward . point` away from it, or anything above 1 if there is none.
    Line {
        /// Unit vector away from the line.
        toward: [f32; 2],
        /// Of the middle of the cell.
        offset: f32,
    },
    /// Anything else without holes.
    List(List),
    /// Anything else.
    Holed(Box<HoledList>),
    /// Too much to go through.
    Split(Box<Grid>),
}

impl Cell {
    const FLAT: Self = Self::Line { toward: [0.0; 2], offset: 2.0 };

    /// Bytes that it takes besides itself.
    pub fn bytes(&self) -> usize {
        match self {
            Self::Line { .. } => 0,
            Self::List(list) => list.bytes(),
            Self::Holed(list) => list.bytes(),
            Self::Split(grid) => grid.bytes(),
        }
    }
}

/// Coordinates of a patch: in its plane and above it, in radii.
#[derive(Clone, Copy, Debug)]
pub struct Frame {
    /// A point of the plane.
    pub origin: DVec3,
    /// Unit vectors; the last points up.
    pub axes: [DVec3; 3],
    radius: f64,
    per_radius: f64,
}

impl Frame {
    /// Of the side of a triangle to which `up` points: the first axis along its longest edge.
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

    /// The same with another point of the plane as origin.
    fn about(&self, at: DVec2) -> Self {
        let from = self.axes[0] * at.x + self.axes[1] * at.y;
        Self { origin: self.origin + from * self.radius, ..*self }
    }
}

/// A side of a triangle on which points are.
#[derive(Clone, Copy, Debug)]
pub struct Own {
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
struct Near {
    place: u32,
    triangle: u32,
    corners: [DVec3; 3],
    /// Unit normal of the side that may send photons.
    normal: DVec3,
    component: u32,
    /// Whether it has holes.
    holes: bool,
}

/// Works out cells.
#[derive(Clone, Copy)]
pub struct Maker<'a> {
    /// All that there is.
    pub surfaces: &'a dyn Surfaces,
    /// Which of it light reaches.
    pub sides: &'a Sides,
    /// How to find it.
    pub reach: &'a Reach,
    /// Of the spheres, scene units.
    pub radius: f64,
}

/// All that matters to a cell.
struct Surroundings {
    /// That may send photons.
    near: Vec<Near>,
    /// In front of something solid.
    walls: Walls,
}

/// Where points are.
struct Spot {
    /// Half of the sides of the cell around the origin.
    half: DVec2,
    /// The part of the cell in the triangle.
    polygon: Polygon,
    /// Distance of its farthest point from the origin.
    extent: f64,
    /// Smallest and largest coordinates of its points.
    low: DVec3,
    high: DVec3,
    /// Of coordinates, in radii: points that are closer are one.
    tolerance: f64,
}

impl Maker<'_> {
    /// A cell of the side of a triangle, or how to split it.
    pub fn cell(&self, own: &Own, grid: &Grid, index: usize) -> Cell {
        let geometry = self.surfaces.geometry();
        let own_corners = corners(geometry, &geometry.places[own.place as usize], own.triangle);
        let (at, half) = grid.cell(index);
        let frame = Frame::new(own_corners, own.normal, self.radius).about(at);
        let spot = self.spot(&frame, own_corners, half);
        let limit = if half.max_element() > LARGE { CROWD } else { usize::MAX };
        let Some(surroundings) = self.surroundings(own, &frame, &spot, limit) else {
            return Cell::Split(Box::new(grid.split(index)));
        };
        surroundings.cell(own, &spot)
    }

    fn spot(&self, frame: &Frame, corners: [DVec3; 3], half: DVec2) -> Spot {
        let flat = corners.map(|corner| frame.local(corner).truncate());
        let mut polygon = clip_to(&flat, half);
        if polygon.is_empty() {
            // Rounding may bring points here all the same.
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
        Spot { half, polygon, extent, low, high, tolerance: tolerance.min(1e-2) }
    }

    /// All in reach; `None` if these are more than `limit` triangles.
    fn surroundings(
        &self,
        own: &Own,
        frame: &Frame,
        spot: &Spot,
        limit: usize,
    ) -> Option<Surroundings> {
        let Frame { origin, axes: [u, v, up], .. } = *frame;
        let radius = 1.0 + spot.tolerance;
        let reach = radius + spot.extent;
        let outer = spot.polygon.iter().map(|p| origin + (u * p.x + v * p.y) * self.radius);
        let margin = DVec3::splat(self.radius * (1.0 + spot.tolerance));
        let around = box_around(outer.flat_map(|p| [p - margin, p + margin]));
        let geometry = self.surfaces.geometry();
        let (mut near, mut walls) = (Vec::new(), Vec::new());
        let mut count = 0;
        let complete = self.reach.find(self.surfaces, &around, |place, triangle| {
            let in_scene = corners(geometry, &geometry.places[place as usize], triangle);
            let corners = in_scene.map(|corner| frame.local(corner));
            let (low, high) = corners
                .iter()
                .fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(low, high), &corner| {
                    (low.min(corner), high.max(corner))
                });
            let gap = (low - spot.high).max(spot.low - high).max(DVec3::ZERO);
            if gap.length_squared() >= radius * radius || distance2(corners) >= reach * reach {
                return true;
            }
            if self.sides.is_double(place, triangle) {
                return true;
            }
            let front = self.sides.of(place, triangle, true);
            let front_normal = self.surfaces.normal(place, triangle);
            let sides = [(front, front_normal), (SideId(front.0 ^ 1), -front_normal)];
            let may_send = |&(side, normal): &(SideId, Vec3)| {
                let counts = self.sides.reached(side) || side == own.side;
                counts && admits(packed(normal), own.normal) && self.surfaces.merges(place)
            };
            let [sends, is_solid] = [
                sides.iter().position(may_send),
                sides.iter().position(|&(side, _)| self.sides.is_solid_behind(side)),
            ];
            if sends.is_none() && is_solid.is_none() {
                return true;
            }
            let Some(around) =
                (corners[1] - corners[0]).cross(corners[2] - corners[0]).try_normalize()
            else {
                return true;
            };
            // The front's in these coordinates.
            let front_normal = front_normal.as_dvec3();
            let given = DVec3::new(u.dot(front_normal), v.dot(front_normal), up.dot(front_normal));
            let normal = if around.dot(given) < 0.0 { -around } else { around };
            let of_side = [normal, -normal];
            count += 1;
            let component = front.component();
            if let Some(side) = is_solid {
                walls.push(Wall::new(corners, of_side[side], component));
            }
            if let Some(side) = sends {
                let (normal, holes) = (of_side[side], self.surfaces.has_holes(place));
                near.push(Near { place, triangle, corners, normal, component, holes });
            }
            count <= limit
        });
        complete.then(|| Surroundings { near, walls: Walls::new(walls) })
    }
}

impl Surroundings {
    fn cell(&self, own: &Own, spot: &Spot) -> Cell {
        let solid = !own.holes;
        let outer = spot.half + 1.0;
        // What is in the plane of the patch, and the rest.
        let (mut ground, mut others) = (Vec::<(Polygon, u32)>::new(), Vec::new());
        for near in &self.near {
            match near.on_ground(outer).filter(|_| solid && !near.holes) {
                Some(polygon) => lay(&mut ground, polygon, near.component, spot.tolerance),
                None => others.push(near),
            }
        }
        let base = self.base(own.side.component(), spot);
        let mut all = Vec::new();
        for (polygon, component) in ground {
            for polygon in self.exposed(&Plane::GROUND, vec![polygon], component, base, spot) {
                all.extend(edges(&polygon));
            }
        }
        let mut segments = boundary(all, spot.tolerance);
        segments.retain(|segment| spot.reaches(segment, outer));
        let (mut facets, mut holes) = (Vec::new(), Vec::new());
        for near in others {
            self.add_facets(near, base, spot, &mut facets, &mut holes);
        }
        if solid && facets.is_empty() && holes.is_empty() {
            match *segments {
                [] => return Cell::FLAT,
                [(p, q)] if [p, q].iter().all(|&end| spot.is_beyond(end, outer)) => {
                    let toward = (q - p).normalize().perp();
                    let offset = -toward.dot(p) as f32;
                    return Cell::Line { toward: toward.as_vec2().to_array(), offset };
                }
                _ => {}
            }
        }
        let list = List::new(solid, &segments, &facets);
        if holes.is_empty() {
            Cell::List(list)
        } else {
            Cell::Holed(Box::new(HoledList { list, holes }))
        }
    }

    /// A point just above the patch that is in as few solids as any: there light can be.
    fn base(&self, component: u32, spot: &Spot) -> DVec3 {
        let mut pieces = vec![spot.polygon.clone()];
        if self.walls.are_all_of(component) {
            return Plane::GROUND.above(middle(&pieces[0]));
        }
        self.walls.split(&Plane::GROUND, &mut pieces, component, spot.tolerance);
        let points: Vec<_> =
            pieces.iter().map(|piece| Plane::GROUND.above(middle(piece))).collect();
        let first = points[0];
        let depth = |point: &&DVec3| self.walls.depth(first, **point, component);
        *points.iter().min_by_key(depth).expect("a cell has some surface")
    }

    /// The parts of a component's surface in a plane that nothing covers.
    fn exposed(
        &self,
        plane: &Plane,
        mut pieces: Vec<Polygon>,
        component: u32,
        base: DVec3,
        spot: &Spot,
    ) -> Vec<Polygon> {
        if self.walls.are_all_of(component) {
            return pieces;
        }
        self.walls.split(plane, &mut pieces, component, spot.tolerance);
        pieces.retain(|piece| self.walls.depth(base, plane.above(middle(piece)), component) <= 0);
        pieces
    }

    /// Adds the exposed part of a triangle that is not in the plane of the patch.
    fn add_facets(
        &self,
        near: &Near,
        base: DVec3,
        spot: &Spot,
        facets: &mut Vec<Facet>,
        holes: &mut Vec<Holed>,
    ) {
        let plane = Plane::new(near.corners[0], near.normal);
        let whole = near.corners.map(|corner| plane.project(corner));
        let mut counterclockwise = whole.to_vec();
        if area(&whole) < 0.0 {
            counterclockwise.reverse();
        }
        // Corners far away would cost precision.
        let reach = 2.0 + spot.extent;
        let is_small = whole.iter().all(|corner| corner.abs().max_element() < 2.0 * reach);
        let part = if is_small {
            counterclockwise
        } else {
            clip_to(&counterclockwise, DVec2::splat(reach))
        };
        if part.is_empty() {
            return;
        }
        let mut pieces = vec![part];
        for other in self.near.iter().filter(|other| near.is_under(other, &plane)) {
            let other = other.corners.map(|corner| plane.project(corner));
            let mut other = other.to_vec();
            if area(&other) < 0.0 {
                other.reverse();
            }
            let mut rest = Vec::new();
            for piece in pieces {
                subtract(&piece, &other, spot.tolerance, &mut rest);
            }
            pieces = rest;
        }
        let height = plane.height(DVec3::ZERO);
        let normal = plane.normal;
        let common = Facet {
            height: [-height, -normal.x, -normal.y],
            foot: plane.axes.map(|axis| [axis.x, axis.y]),
            ..Facet::default()
        };
        for piece in self.exposed(&plane, pieces, near.component, base, spot) {
            for pair in piece[1..].windows(2) {
                let facet = Facet { corners: [piece[0], pair[0], pair[1]], ..common };
                if near.holes {
                    let Near { place, triangle, .. } = *near;
                    holes.push(Holed { facet, whole, place, triangle });
                } else {
                    facets.push(facet);
                }
            }
        }
    }
}

impl Near {
    /// The part within a rectangle around the patch, if all of that is in its plane.
    fn on_ground(&self, half: DVec2) -> Option<Polygon> {
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

    /// Whether another component's triangle lies in the same plane, and takes precedence.
    fn is_under(&self, other: &Self, plane: &Plane) -> bool {
        other.component != self.component
            && (other.place, other.triangle) < (self.place, self.triangle)
            && other.holes == self.holes
            && other.normal.dot(self.normal) > 0.999
            && other.corners.iter().all(|&corner| plane.height(corner).abs() <= LIFT)
    }
}

impl Spot {
    /// Whether a segment that is not on the border of what was looked at is in reach.
    fn reaches(&self, &(p, q): &(DVec2, DVec2), outer: DVec2) -> bool {
        let on_border = |axis: usize| {
            let at = |p: DVec2| p[axis].abs() >= outer[axis] - self.tolerance;
            at(p) && at(q) && (p[axis] > 0.0) == (q[axis] > 0.0)
        };
        let share = (-p.dot(q - p) / (q - p).length_squared()).clamp(0.0, 1.0);
        let distance = (p + (q - p) * share).length();
        !on_border(0) && !on_border(1) && distance < 1.0 + self.extent + self.tolerance
    }

    /// Whether a point is out of reach.
    fn is_beyond(&self, p: DVec2, outer: DVec2) -> bool {
        let on_border = p.abs().cmpge(outer - self.tolerance).any();
        on_border || p.length() >= 1.0 + self.extent
    }
}

/// Lays a component's surface beside what lies in the plane already: what is under or over other
/// components counts once.
fn lay(ground: &mut Vec<(Polygon, u32)>, polygon: Polygon, component: u32, tolerance: f64) {
    let mut pieces = vec![polygon];
    for (other, _) in ground.iter().filter(|(_, other)| *other != component) {
        let mut rest = Vec::new();
        for piece in pieces {
            subtract(&piece, other, tolerance, &mut rest);
        }
        pieces = rest;
    }
    ground.extend(pieces.into_iter().filter(|piece| !piece.is_empty()).map(|p| (p, component)));
}

fn rectangle(half: DVec2) -> [DVec2; 4] {
    let DVec2 { x, y } = half;
    [DVec2::new(-x, -y), DVec2::new(x, -y), DVec2::new(x, y), DVec2::new(-x, y)]
}

/// The part of a polygon in a rectangle around the origin, given by half of its sides.
fn clip_to(polygon: &[DVec2], half: DVec2) -> Polygon {
    let mut part = polygon.to_vec();
    if polygon.iter().all(|corner| corner.abs().cmple(half).all()) {
        return part;
    }
    let corners = rectangle(half);
    for (a, b) in edges(&corners) {
        let Some(line) = Line::through(a, b) else { continue };
        part = clip(&part, line);
        if part.is_empty() {
            break;
        }
    }
    part
}

/// Squared distance of a triangle from the origin.
fn distance2([a, b, c]: [DVec3; 3]) -> f64 {
    let normal = (b - a).cross(c - a);
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
