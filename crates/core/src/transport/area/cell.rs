//! Computes the surface in the spheres around the points of a cell, in f64.

use super::boundary::boundary;
use super::cell_builder::{CellBuilder, CellFrame, GatherFacet, Near, PatchFrame};
use super::domain::MAX_LEVEL;
use super::edge_list::{Holed, HoledList, List, ListedTriangle};
use super::neighbors::{Surroundings, WorkBound};
use super::patch::PatchGrid;
use super::polygon::{Polygon, area, clip_to, edges, middle, subtract};
use super::solids::Plane;
use super::surfaces::corners;
use glam::{DVec2, DVec3};

/// Half the side of a cell, in radii, above which it is large.
const LARGE: f64 = 0.8;

/// Triangles in reach of a large cell above which it is split: each query goes through all of them.
const CROWD: usize = 48;

/// Triangles in reach of a small cell above which its points are merged within a smaller radius:
/// those that may send photons or be in front of a solid. The work grows faster than their number,
/// since each is tested against the others.
///
/// Smaller radii cost more noise than large cells cost time, which is spent once. Measured in
/// classroom, merging at vertex 2 (docs/measurements/areas.md): with 128 triangles, and 32 in
/// smaller radii, 1.9 times the variance, and .8 times the merging of the first four iterations at
/// 1280x720.
const MAX_KEPT: usize = 512;

/// The same where the radius was halved already.
const MAX_KEPT_AGAIN: usize = 256;

/// Triangles that are looked at for a cell, over those that are kept at most. It bounds the search
/// among triangles that do not matter, such as those of glass.
const MAX_VISITED: usize = 4;

/// The surface in reach of the points of a cell.
#[derive(Debug)]
pub enum Cell {
    /// The surface in reach is flat, and ends at most at one straight line: a point is
    /// `offset + toward . point` away from it, or anything above 1 if there is none.
    Line {
        /// Unit vector away from the line.
        toward: [f32; 2],
        /// Distance of the middle of the cell.
        offset: f32,
    },
    /// Any other surface without holes.
    List(List),
    /// Any other surface.
    Holed(Box<HoledList>),
    /// Too much is in reach of a large cell.
    Split(Box<PatchGrid>),
    /// Too much is in reach of a small cell: points are merged within half the radius.
    Crowded,
    /// Too much is in reach even within the smallest radius, of a cell whose own surface has holes:
    /// points take the disc times the mean opacity there.
    HoledDisc(Box<Holed>),
    /// Surfaces lie over each other: the surface in reach of one layer, with which only photons of
    /// that layer merge.
    Layered(Box<Self>),
}

impl Cell {
    /// The surface in reach is a whole disc.
    const DISC: Self = Self::Line { toward: [0.0; 2], offset: 2.0 };

    /// Merges photons of the point's own layer only.
    fn of_own_layer(self) -> Self {
        Self::Layered(Box::new(self))
    }

    /// Size in bytes of the memory that it owns.
    pub fn bytes(&self) -> usize {
        match self {
            Self::Line { .. } | Self::Crowded => 0,
            Self::List(list) => list.bytes(),
            Self::Holed(list) => list.bytes(),
            Self::Split(grid) => grid.bytes(),
            Self::HoledDisc(_) => size_of::<Holed>(),
            Self::Layered(own) => size_of::<Self>() + own.bytes(),
        }
    }
}

impl CellBuilder<'_> {
    /// Computes one cell of a grid.
    pub fn build(&self, own: &GatherFacet, grid: &PatchGrid, index: usize) -> Cell {
        let place = &self.surfaces.places()[own.place as usize];
        let own_corners = corners(self.surfaces, place, own.triangle);
        let (at, half) = grid.cell(index);
        let frame = PatchFrame::new(own_corners, own.normal, self.radius).about(at);
        let cell = self.cell_frame(&frame, own_corners, half);
        let is_large = half.max_element() > LARGE;
        let kept = match (is_large, self.level) {
            (true, _) => CROWD,
            (false, 0 | MAX_LEVEL) => MAX_KEPT,
            (false, _) => MAX_KEPT_AGAIN,
        };
        let bound = WorkBound { kept, visited: MAX_VISITED * kept.max(MAX_KEPT) };
        match self.surroundings(own, &frame, &cell, bound) {
            Some(surroundings) => surroundings.cell(own, &cell),
            None if is_large => Cell::Split(Box::new(grid.split(index))),
            None if self.level < MAX_LEVEL => Cell::Crowded,
            None if own.holes => {
                Cell::HoledDisc(Box::new(own.hole_in(&frame, own_corners))).of_own_layer()
            }
            None => Cell::DISC.of_own_layer(),
        }
    }
}

impl GatherFacet {
    /// All of the triangle, in its own plane.
    fn hole_in(&self, frame: &PatchFrame, corners: [DVec3; 3]) -> Holed {
        let facet = ListedTriangle { foot: [[1.0, 0.0], [0.0, 1.0]], ..ListedTriangle::default() };
        let whole = corners.map(|corner| frame.local(corner).truncate());
        Holed { facet, whole, place: self.place, triangle: self.triangle }
    }
}

impl Surroundings {
    fn cell(&self, own: &GatherFacet, cell: &CellFrame) -> Cell {
        let all = self.surface(own, cell);
        if self.is_layered { all.of_own_layer() } else { all }
    }

    /// The surface in reach.
    fn surface(&self, own: &GatherFacet, cell: &CellFrame) -> Cell {
        let solid = !own.holes;
        let outer = cell.half + 1.0;
        // Separate the triangles in the plane of the patch from the others.
        let (mut ground, mut others) = (Vec::<(Polygon, u32)>::new(), Vec::new());
        for near in &self.near {
            match near.on_ground(outer).filter(|_| solid && !near.holes) {
                Some(polygon) => lay(&mut ground, polygon, near.component, cell.tolerance),
                None => others.push(near),
            }
        }
        // Under another layer that touches the surface there is no light.
        let above = self.above.iter().filter(|near| near.is_above_ground() && solid && !near.holes);
        for cover in above.filter_map(|near| near.on_ground(outer)) {
            let mut rest = Vec::new();
            for (polygon, component) in ground {
                let mut pieces = Vec::new();
                subtract(&polygon, &cover, cell.tolerance, &mut pieces);
                rest.extend(pieces.into_iter().map(|piece| (piece, component)));
            }
            ground = rest;
        }
        let base = self.base(own.side.component(), cell);
        let mut all = Vec::new();
        for (polygon, component) in ground {
            self.exposed(&Plane::GROUND, polygon, component, base, cell, |polygon| {
                all.extend(edges(polygon));
            });
        }
        let mut segments = boundary(all, cell.tolerance);
        segments.retain(|segment| cell.reaches(segment, outer));
        let (mut facets, mut holes) = (Vec::new(), Vec::new());
        for near in others {
            self.add_facets(near, base, cell, &mut facets, &mut holes);
        }
        if solid && facets.is_empty() && holes.is_empty() {
            match *segments {
                [] => return Cell::DISC,
                [(p, q)] if [p, q].iter().all(|&end| cell.is_beyond(end, outer)) => {
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

    /// A point just above the patch that is inside of as few solids as possible, where light can
    /// be.
    fn base(&self, component: u32, cell: &CellFrame) -> DVec3 {
        let mut pieces = vec![cell.polygon.clone()];
        if self.walls.are_all_of(component) {
            return Plane::GROUND.above(middle(&pieces[0]));
        }
        self.walls.split(&Plane::GROUND, &mut pieces, component, cell.tolerance);
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
        cell: &CellFrame,
        mut visit: impl FnMut(&[DVec2]),
    ) {
        if self.walls.are_all_of(component) {
            return visit(&piece);
        }
        let mut pieces = vec![piece];
        self.walls.split(plane, &mut pieces, component, cell.tolerance);
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
        cell: &CellFrame,
        facets: &mut Vec<ListedTriangle>,
        holes: &mut Vec<Holed>,
    ) {
        let plane = Plane::new(near.corners[0], near.normal);
        let whole = near.corners.map(|corner| plane.project(corner));
        let height = plane.height(DVec3::ZERO);
        let normal = plane.normal;
        let common = ListedTriangle {
            height: [-height, -normal.x, -normal.y],
            foot: plane.axes.map(|axis| [axis.x, axis.y]),
            ..ListedTriangle::default()
        };
        let mut add = |piece: &[DVec2]| {
            for pair in piece[1..].windows(2) {
                let facet = ListedTriangle { corners: [piece[0], pair[0], pair[1]], ..common };
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
        let reach = 2.0 + cell.extent;
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
                subtract(&piece, &other, cell.tolerance, &mut rest);
            }
            pieces = rest;
        }
        for piece in pieces {
            self.exposed(&plane, piece, near.component, base, cell, &mut add);
        }
    }
}

/// The triangle with its corners in counterclockwise order.
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
