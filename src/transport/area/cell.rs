//! What the spheres around the points of a cell hold, worked out in f64.

use super::boundary::boundary;
use super::cell_builder::{Frame, Maker, Near, Own, Spot};
use super::edge_list::{Facet, Holed, HoledList, List};
use super::neighbors::Surroundings;
use super::patch::Grid;
use super::polygon::{Polygon, area, clip_to, edges, middle, subtract};
use super::solids::Plane;
use super::surfaces::corners;
use glam::{DVec2, DVec3};

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

impl Maker<'_> {
    /// A cell of the side of a triangle, or how to split it.
    pub fn cell(&self, own: &Own, grid: &Grid, index: usize) -> Cell {
        let place = &self.surfaces.places()[own.place as usize];
        let own_corners = corners(self.surfaces, place, own.triangle);
        let (at, half) = grid.cell(index);
        let frame = Frame::new(own_corners, own.normal, self.radius).about(at);
        let spot = self.spot(&frame, own_corners, half);
        let limit = if half.max_element() > LARGE { CROWD } else { usize::MAX };
        let Some(surroundings) = self.surroundings(own, &frame, &spot, limit) else {
            return Cell::Split(Box::new(grid.split(index)));
        };
        surroundings.cell(own, &spot)
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
            self.exposed(&Plane::GROUND, polygon, component, base, spot, |polygon| {
                all.extend(edges(polygon));
            });
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

    /// Visits the parts of a component's surface in a plane that nothing covers.
    fn exposed(
        &self,
        plane: &Plane,
        piece: Polygon,
        component: u32,
        base: DVec3,
        spot: &Spot,
        mut visit: impl FnMut(&[DVec2]),
    ) {
        if self.walls.are_all_of(component) {
            return visit(&piece);
        }
        let mut pieces = vec![piece];
        self.walls.split(plane, &mut pieces, component, spot.tolerance);
        for piece in &pieces {
            if self.walls.depth(base, plane.above(middle(piece)), component) <= 0 {
                visit(piece);
            }
        }
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
        let height = plane.height(DVec3::ZERO);
        let normal = plane.normal;
        let common = Facet {
            height: [-height, -normal.x, -normal.y],
            foot: plane.axes.map(|axis| [axis.x, axis.y]),
            ..Facet::default()
        };
        let mut add = |piece: &[DVec2]| {
            for pair in piece[1..].windows(2) {
                let facet = Facet { corners: [piece[0], pair[0], pair[1]], ..common };
                if near.holes {
                    let Near { place, triangle, .. } = *near;
                    holes.push(Holed { facet, whole, place, triangle });
                } else {
                    facets.push(facet);
                }
            }
        };
        let turned = counterclockwise(whole);
        // Corners far away would cost precision.
        let reach = 2.0 + spot.extent;
        let is_small = whole.iter().all(|corner| corner.abs().max_element() < 2.0 * reach);
        if is_small && !self.is_mixed && self.walls.are_all_of(near.component) {
            return add(&turned);
        }
        let part = if is_small { turned.to_vec() } else { clip_to(&turned, DVec2::splat(reach)) };
        if part.is_empty() {
            return;
        }
        let mut pieces = vec![part];
        for other in self.near.iter().filter(|other| near.is_under(other, &plane)) {
            let other = counterclockwise(other.corners.map(|corner| plane.project(corner)));
            let mut rest = Vec::new();
            for piece in pieces {
                subtract(&piece, &other, spot.tolerance, &mut rest);
            }
            pieces = rest;
        }
        for piece in pieces {
            self.exposed(&plane, piece, near.component, base, spot, &mut add);
        }
    }
}

/// The same triangle.
fn counterclockwise(mut corners: [DVec2; 3]) -> [DVec2; 3] {
    if area(&corners) < 0.0 {
        corners.reverse();
    }
    corners
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
