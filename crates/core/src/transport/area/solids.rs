//! Covered surface: the surface inside of solids.
//!
//! A surface is covered where a point just above it is inside of a solid of another component.
//! Solids need not be closed. A surface that light reaches from one side only has something solid
//! behind it (see [`sides`](super::lit_sides)). The depth of a point in solids is counted along a
//! line from a point that light reaches: plus one where the line enters a solid, minus one where it
//! leaves. A point can be in several overlapping solids; it is covered if it is in any. Sheets that
//! light reaches from both sides cover only surface within [`LIFT`] of them.

use super::polygon::{Line, Polygon, clip, meets};
use glam::{DVec2, DVec3};
use std::ops::Range;

/// Height in radii that a solid must have above a surface to cover it. Layers that are closer than
/// this are one surface.
pub const LIFT: f64 = 2e-3;

/// A triangle in front of something solid.
#[derive(Clone, Copy, Debug)]
pub struct Wall {
    /// Its corners.
    pub corners: [DVec3; 3],
    /// Unit normal away from what is solid.
    pub outward: DVec3,
    /// Component of the triangle.
    pub component: u32,
    /// The box around it.
    low: DVec3,
    high: DVec3,
}

impl Wall {
    /// A triangle of a component with something solid behind it, on the side away from the unit
    /// normal `outward`.
    pub fn new(corners: [DVec3; 3], outward: DVec3, component: u32) -> Self {
        let (low, high) = around(corners.into_iter());
        Self { corners, outward, component, low, high }
    }
}

/// A plane with coordinates in it and above it.
#[derive(Clone, Copy, Debug)]
pub struct Plane {
    /// A point of it.
    pub origin: DVec3,
    /// Unit vectors in it.
    pub axes: [DVec3; 2],
    /// Unit vector that points up.
    pub normal: DVec3,
}

impl Plane {
    /// The plane that coordinates are given in.
    pub const GROUND: Self =
        Self { origin: DVec3::ZERO, axes: [DVec3::X, DVec3::Y], normal: DVec3::Z };

    /// Through a point.
    pub fn new(point: DVec3, normal: DVec3) -> Self {
        let (u, v) = normal.any_orthonormal_pair();
        // The middle of all discs in it is not far from the foot of the origin.
        Self { origin: normal * normal.dot(point), axes: [u, v], normal }
    }

    /// Coordinates in it.
    pub fn project(&self, point: DVec3) -> DVec2 {
        let [u, v] = self.axes;
        let from = point - self.origin;
        DVec2::new(u.dot(from), v.dot(from))
    }

    /// Height above it.
    pub fn height(&self, point: DVec3) -> f64 {
        self.normal.dot(point - self.origin)
    }

    /// The point of these coordinates, just above.
    pub fn above(&self, at: DVec2) -> DVec3 {
        let [u, v] = self.axes;
        self.origin + u * at.x + v * at.y + self.normal * LIFT
    }

    /// Where a wall stands on it, if it does.
    fn cut(&self, wall: &Wall) -> Option<(DVec2, DVec2)> {
        let heights = wall.corners.map(|corner| self.height(corner));
        let is_above = heights.map(|height| height > LIFT);
        if is_above[0] == is_above[1] && is_above[1] == is_above[2] {
            return None;
        }
        // One corner is on another side than both others.
        let alone = (0..3).find(|&i| {
            is_above[i] != is_above[(i + 1) % 3] && is_above[i] != is_above[(i + 2) % 3]
        })?;
        let end = |other: usize| {
            let (low, high) = if is_above[alone] { (other, alone) } else { (alone, other) };
            // Where it meets the plane, or ends above it.
            let level = heights[low].max(0.0);
            let share = (level - heights[low]) / (heights[high] - heights[low]);
            let (low, high) = (wall.corners[low], wall.corners[high]);
            self.project(low + (high - low) * share)
        };
        Some((end((alone + 1) % 3), end((alone + 2) % 3)))
    }
}

/// All walls around a cell.
#[derive(Clone, Debug, Default)]
pub struct Walls {
    /// Component after component.
    walls: Vec<Wall>,
    blocks: Vec<Block>,
}

/// The walls of a component.
#[derive(Clone, Debug)]
struct Block {
    component: u32,
    range: Range<usize>,
    /// The box around them.
    low: DVec3,
    high: DVec3,
}

impl Walls {
    /// Sorts walls.
    pub fn new(mut walls: Vec<Wall>) -> Self {
        walls.sort_by_key(|wall| wall.component);
        let (mut blocks, mut first) = (Vec::new(), 0);
        for own in walls.chunk_by(|a, b| a.component == b.component) {
            let corners = own.iter().flat_map(|wall| wall.corners);
            let (low, high) = around(corners);
            let range = first..first + own.len();
            first = range.end;
            blocks.push(Block { component: own[0].component, range, low, high });
        }
        Self { walls, blocks }
    }

    /// Whether none are of other components.
    pub fn are_all_of(&self, component: u32) -> bool {
        self.blocks.iter().all(|block| block.component == component)
    }

    /// Walls of other components that may be near a box.
    fn near(&self, component: u32, (low, high): (DVec3, DVec3)) -> impl Iterator<Item = &Wall> {
        let is_near = move |block: &&Block| {
            let apart = low.cmpgt(block.high) | high.cmplt(block.low);
            block.component != component && !apart.any()
        };
        self.blocks.iter().filter(is_near).flat_map(|block| &self.walls[block.range.clone()])
    }

    /// Splits convex `pieces` of a component's surface in a plane along the walls that stand on it:
    /// then each is covered either all over or nowhere.
    pub fn split(&self, plane: &Plane, pieces: &mut Vec<Polygon>, component: u32, tolerance: f64) {
        let corners = pieces.iter().flatten();
        let (low, high) = around(corners.map(|&corner| plane.above(corner)));
        let margin = DVec3::splat(2.0 * LIFT);
        let (low, high) = (low - margin, high + margin);
        let is_near = |wall: &&Wall| !(low.cmpgt(wall.high) | high.cmplt(wall.low)).any();
        for wall in self.near(component, (low, high)).filter(is_near) {
            let Some(cut) = plane.cut(wall) else { continue };
            let Some(line) = Line::through(cut.0, cut.1) else { continue };
            for index in 0..pieces.len() {
                if meets(&pieces[index], cut, tolerance) {
                    let right = clip(&pieces[index], line.reversed());
                    let left = clip(&pieces[index], line);
                    if !(left.is_empty() || right.is_empty()) {
                        pieces[index] = left;
                        pieces.push(right);
                    }
                }
            }
        }
    }

    /// Depth of `to` in solids of other components, minus that of `from`.
    pub fn depth(&self, from: DVec3, to: DVec3, component: u32) -> i32 {
        let walls = self.near(component, (from.min(to), from.max(to)));
        walls.map(|wall| wall.crossed(from, to)).sum()
    }
}

/// The box around points.
fn around(points: impl Iterator<Item = DVec3>) -> (DVec3, DVec3) {
    let none = (DVec3::INFINITY, DVec3::NEG_INFINITY);
    points.fold(none, |(low, high), point| (low.min(point), high.max(point)))
}

impl Wall {
    /// 1 for a way into the solid, -1 for one out of it, 0 for one that does not meet the wall.
    fn crossed(&self, from: DVec3, to: DVec3) -> i32 {
        let [start, end] = [from, to].map(|point| self.outward.dot(point - self.corners[0]) > 0.0);
        if start == end {
            return 0;
        }
        let along = to - from;
        let [a, b, c] = self.corners.map(|corner| corner - from);
        // Each edge from its lower to its higher end, so that both its triangles agree.
        let side = |p: DVec3, q: DVec3| {
            let swap = (p.x, p.y, p.z) > (q.x, q.y, q.z);
            let volume = if swap { -along.dot(q.cross(p)) } else { along.dot(p.cross(q)) };
            if volume == 0.0 { !swap } else { volume > 0.0 }
        };
        let [ab, bc, ca] = [side(a, b), side(b, c), side(c, a)];
        match ab == bc && bc == ca {
            true if start => 1,
            true => -1,
            false => 0,
        }
    }
}
