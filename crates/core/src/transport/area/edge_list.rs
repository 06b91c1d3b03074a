//! Edges and triangles in reach of the points of a cell, packed to sum up areas.
//!
//! Coordinates are those of the patch, in its plane, in units of the radius.

use super::admission::THICKNESS;
use super::disc::chord;
use super::surfaces::{Hole, Surfaces};
use crate::simd::lanes_of;
use glam::DVec2;
use std::array::from_fn;
use std::f32::consts::PI;

/// Edges or triangles of a pack.
const WIDTH: usize = 8;

type Lane = [f32; WIDTH];

/// All that is not in the plane of the patch, and the boundary of what is.
#[derive(Clone, Debug, Default)]
pub struct List {
    /// Segments, then facets: numbers of each pack in turn.
    rows: Box<[Row]>,
    /// Packs of segments.
    segments: u32,
    /// Whether points of the patch are inside of the surface in its plane: not if that has holes.
    inside: bool,
}

/// A [`List`] beside surfaces with holes.
#[derive(Clone, Debug)]
pub struct HoledList {
    /// Surfaces without holes.
    pub list: List,
    /// Surfaces with holes.
    pub holes: Vec<Holed>,
}

/// No more aligned than memory is that is asked for: other alignment costs much where lists are
/// many.
#[derive(Clone, Copy, Debug, Default)]
#[repr(C)]
struct Row(Lane);

/// Edges in the plane of the patch: rows of
/// - height of a point above the line: coefficients of 1, x and y;
/// - place of the start, counted from the foot of a point: coefficients of 1, x and y;
/// - length.
struct Segments;

/// Triangles in other planes: rows of
/// - height of their plane above a point: coefficients of 1, x and y;
/// - coordinates in their plane of the foot of a point: coefficients of x and y each;
/// - corners, counterclockwise, x and y of each.
struct Facets;

/// A triangle in the space of a patch.
#[derive(Clone, Copy, Debug, Default)]
pub struct ListedTriangle {
    /// Height of its plane above a point: coefficients of 1, x and y.
    pub height: [f64; 3],
    /// Coordinates in its plane of the foot of a point: coefficients of x and y each.
    pub foot: [[f64; 2]; 2],
    /// Counterclockwise.
    pub corners: [DVec2; 3],
}

/// A part of a triangle with holes.
#[derive(Clone, Copy, Debug)]
pub struct Holed {
    /// The part.
    pub facet: ListedTriangle,
    /// Corners of all of the triangle in the same plane, in the order of the mesh.
    pub whole: [DVec2; 3],
    /// Index of the place.
    pub place: u32,
    /// Index of the triangle in its mesh.
    pub triangle: u32,
}

impl List {
    /// Packs boundary segments, which have the surface on their left, and triangles in other
    /// planes.
    pub fn new(inside: bool, segments: &[(DVec2, DVec2)], facets: &[ListedTriangle]) -> Self {
        let packs = |count: usize| count.div_ceil(WIDTH);
        let own = Segments::ROWS * packs(segments.len());
        let mut rows = vec![Row::default(); own + Facets::ROWS * packs(facets.len())];
        for (rows, segments) in rows.chunks_mut(Segments::ROWS).zip(segments.chunks(WIDTH)) {
            Segments::fill(rows, segments);
        }
        for (rows, facets) in rows[own..].chunks_mut(Facets::ROWS).zip(facets.chunks(WIDTH)) {
            Facets::fill(rows, facets);
        }
        let segments = packs(segments.len()) as u32;
        Self { rows: rows.into(), segments, inside }
    }

    /// Area within spheres of these squared radii around a point, in squares of the unit.
    #[inline(always)] // part of vectorized code
    pub fn areas<const N: usize>(&self, at: [f32; 2], radii2: &[f32; N]) -> [f32; N] {
        let mut edges = Edges::new(radii2);
        let (segments, facets) = self.rows.split_at(Segments::ROWS * self.segments as usize);
        for rows in segments.as_chunks().0 {
            Segments::add(rows, at, &mut edges);
        }
        for rows in facets.as_chunks().0 {
            Facets::add(rows, at, &mut edges);
        }
        let sums = edges.finish();
        let inside = if self.inside { PI } else { 0.0 };
        from_fn(|i| inside * radii2[i] + sums[i])
    }

    /// Reads a little of it, so that the rest is in the cache when it is summed up.
    #[inline(always)]
    pub fn touch(&self) -> f32 {
        self.rows.iter().step_by(4).take(8).map(|row| row.0[0]).sum()
    }

    /// Size in bytes of the memory that it owns.
    pub fn bytes(&self) -> usize {
        size_of_val(&*self.rows)
    }
}

impl HoledList {
    /// Area within spheres of these squared radii around a point, in squares of the unit, which is
    /// `unit` in the scene's.
    pub fn areas<const N: usize>(
        &self,
        surfaces: &dyn Surfaces,
        unit: f32,
        at: [f32; 2],
        radii2: &[f32; N],
    ) -> [f32; N] {
        let mut areas = self.list.areas(at, radii2);
        for holed in &self.holes {
            let own = List::new(false, &[], &[holed.facet]).areas(at, radii2);
            for ((area, own), radius2) in areas.iter_mut().zip(own).zip(radii2) {
                if own > 0.0 {
                    *area += own * surfaces.opacity(&holed.hole(at, unit * radius2.sqrt()));
                }
            }
        }
        areas
    }

    /// Size in bytes.
    pub fn bytes(&self) -> usize {
        size_of::<Self>() + self.list.bytes() + size_of_val(&*self.holes)
    }
}

impl Segments {
    const ROWS: usize = 7;

    fn fill(rows: &mut [Row], segments: &[(DVec2, DVec2)]) {
        // Lanes without a segment are far away.
        rows[0] = Row([4.0; WIDTH]);
        for (lane, &(p, q)) in segments.iter().enumerate() {
            let (along, length) = (q - p).normalize_and_length();
            let up = along.perp();
            let numbers = [-up.dot(p), up.x, up.y, along.dot(p), -along.x, -along.y, length];
            for (row, number) in rows.iter_mut().zip(numbers) {
                row.0[lane] = number as f32;
            }
        }
    }

    #[inline(always)] // part of vectorized code
    fn add<const N: usize>(rows: &[Row; Self::ROWS], [x, y]: [f32; 2], edges: &mut Edges<N>) {
        let affine = |k: usize, lane: usize| {
            rows[k].0[lane] + (rows[k + 1].0[lane] * x + rows[k + 2].0[lane] * y)
        };
        let (mut heights, mut starts, mut ends, mut cross) =
            <(Lane, Lane, Lane, [u32; WIDTH])>::default();
        for lane in 0..WIDTH {
            let height = affine(0, lane);
            // Points of the patch are on the surface, however coordinates were rounded.
            heights[lane] = if height.abs() < 1e-5 { height.abs() } else { height };
            starts[lane] = affine(3, lane);
            ends[lane] = starts[lane] + rows[6].0[lane];
            let (start, end) = (starts[lane], ends[lane]);
            let half2 = edges.largest2 - height * height;
            let is_past = (start > 0.0) & (start * start >= half2);
            let is_before = (end < 0.0) & (end * end >= half2);
            cross[lane] = u32::from((half2 > 0.0) & !is_past & !is_before) << lane;
        }
        for lane in lanes_of(any_of(&cross)) {
            edges.push([heights[lane], starts[lane], ends[lane], 1.0, 0.0]);
        }
    }
}

/// A bit for each lane.
#[inline(always)]
fn any_of(bits: &[u32; WIDTH]) -> u32 {
    bits.iter().fold(0, |all, bit| all | bit)
}

/// Squared radius of the disc that a sphere cuts out of a plane, from the squared height of its
/// center above the plane; 0 if the plane is another layer: theory.md (45b).
#[inline(always)]
fn disc2(radius2: f32, height2: f32) -> f32 {
    if height2 <= THICKNESS * THICKNESS * radius2 { radius2 - height2 } else { 0.0 }
}

/// Edges that are summed up at a time.
const EDGES: usize = 16;

/// Edges that discs of some radii meet.
struct Edges<'a, const N: usize> {
    radii2: &'a [f32; N],
    largest2: f32,
    smallest2: f32,
    /// Height of the center above each edge, start and end, times its length; the square of that;
    /// and that of the height of the sphere's center above the plane.
    waiting: [[f32; EDGES]; 5],
    count: usize,
    sums: [[f32; EDGES]; N],
    /// Areas that do not come from edges.
    more: [f32; N],
}

impl<'a, const N: usize> Edges<'a, N> {
    #[inline(always)] // part of vectorized code
    fn new(radii2: &'a [f32; N]) -> Self {
        let largest2 = radii2.iter().copied().fold(0.0, f32::max);
        let smallest2 = radii2.iter().copied().fold(f32::INFINITY, f32::min);
        let (sums, more) = ([[0.0; EDGES]; N], [0.0; N]);
        let waiting = [[1.0; EDGES]; 5];
        Self { radii2, largest2, smallest2, waiting, count: 0, sums, more }
    }

    #[inline(always)] // part of vectorized code
    fn push(&mut self, edge: [f32; 5]) {
        let place = self.count % EDGES;
        for (column, number) in self.waiting.iter_mut().zip(edge) {
            column[place] = number;
        }
        self.count += 1;
        if self.count.is_multiple_of(EDGES) {
            self.add(EDGES);
        }
    }

    /// Sums up the first of those that wait.
    #[inline(always)] // part of vectorized code
    fn add(&mut self, count: usize) {
        let [cross, from, to, length2, height2] = &self.waiting;
        for (radius2, sums) in self.radii2.iter().zip(&mut self.sums) {
            for (lane, sum) in sums.iter_mut().enumerate() {
                let inverse = 1.0 / length2[lane].sqrt();
                let ends = [from[lane] * inverse, to[lane] * inverse];
                let rho2 = disc2(*radius2, height2[lane]);
                let chord = chord(cross[lane] * inverse, ends, rho2);
                *sum += if lane < count { chord } else { 0.0 };
            }
        }
    }

    #[inline(always)] // part of vectorized code
    fn finish(mut self) -> [f32; N] {
        if !self.count.is_multiple_of(EDGES) {
            self.add(self.count % EDGES);
        }
        from_fn(|i| self.more[i] + self.sums[i].iter().sum::<f32>())
    }
}

impl Facets {
    const ROWS: usize = 13;

    fn fill(rows: &mut [Row], facets: &[ListedTriangle]) {
        // Lanes without a triangle are far away.
        rows[0] = Row([4.0; WIDTH]);
        for (lane, facet) in facets.iter().enumerate() {
            let corners = facet.corners.iter().flat_map(|corner| corner.to_array());
            let numbers = facet.height.into_iter().chain(facet.foot.into_iter().flatten());
            for (row, number) in rows.iter_mut().zip(numbers.chain(corners)) {
                row.0[lane] = number as f32;
            }
        }
    }

    #[inline(always)] // part of vectorized code
    fn add<const N: usize>(rows: &[Row; Self::ROWS], [x, y]: [f32; 2], edges: &mut Edges<N>) {
        let mut height2 = [0.0; WIDTH];
        let (mut crosses, mut from, mut to, mut length2) = <[[Lane; 3]; 4]>::default().into();
        let mut meet = [[0; WIDTH]; 3];
        let mut inside = [0.0; WIDTH];
        let mut whole = [0.0; WIDTH];
        for lane in 0..WIDTH {
            let row = |row: usize| rows[row].0[lane];
            let height = row(0) + (row(1) * x + row(2) * y);
            height2[lane] = height * height;
            let foot = [3, 5].map(|axis| row(axis) * x + row(axis + 1) * y);
            let corners =
                [7, 9, 11].map(|corner| (row(corner) - foot[0], row(corner + 1) - foot[1]));
            let distances2 = corners.map(|(x, y)| x * x + y * y);
            let rho2 = disc2(edges.largest2, height2[lane]);
            let mut is_inside = true;
            let mut doubled_area = 0.0;
            let [a, b, c] = distances2;
            let is_whole = a.max(b).max(c) <= disc2(edges.smallest2, height2[lane]);
            for side in 0..3 {
                let (p, q) = (corners[side], corners[(side + 1) % 3]);
                let along = (q.0 - p.0, q.1 - p.1);
                let cross = p.0 * along.1 - p.1 * along.0;
                let (start, end) = (p.0 * along.0 + p.1 * along.1, q.0 * along.0 + q.1 * along.1);
                let squared = along.0 * along.0 + along.1 * along.1;
                let is_past = (start > 0.0) & (distances2[side] >= rho2);
                let is_before = (end < 0.0) & (distances2[(side + 1) % 3] >= rho2);
                let meets = (cross * cross < rho2 * squared) & !is_past & !is_before & !is_whole;
                crosses[side][lane] = cross;
                from[side][lane] = start;
                to[side][lane] = end;
                length2[side][lane] = squared;
                meet[side][lane] = u32::from(meets) << lane;
                is_inside &= cross >= 0.0;
                doubled_area += cross;
            }
            inside[lane] = if is_inside & !is_whole { PI } else { 0.0 };
            whole[lane] = if is_whole { 0.5 * doubled_area } else { 0.0 };
        }
        for (radius2, more) in edges.radii2.iter().zip(&mut edges.more) {
            let mut sums = [0.0; WIDTH];
            for lane in 0..WIDTH {
                let rho2 = disc2(*radius2, height2[lane]);
                sums[lane] = inside[lane] * rho2 + whole[lane];
            }
            *more += sums.iter().sum::<f32>();
        }
        for side in 0..3 {
            for lane in lanes_of(any_of(&meet[side])) {
                edges.push([
                    crosses[side][lane],
                    from[side][lane],
                    to[side][lane],
                    length2[side][lane],
                    height2[lane],
                ]);
            }
        }
    }
}

impl Holed {
    /// Areas of discs of these squared radii around a point in the triangle's plane, times the mean
    /// opacity there. The units are those of [`HoledList::areas`].
    pub fn discs<const N: usize>(
        &self,
        surfaces: &dyn Surfaces,
        unit: f32,
        at: [f32; 2],
        radii2: &[f32; N],
    ) -> [f32; N] {
        radii2.map(|radius2| PI * radius2 * surfaces.opacity(&self.hole(at, unit * radius2.sqrt())))
    }

    /// The place at which to ask for its opacity.
    fn hole(&self, [x, y]: [f32; 2], radius: f32) -> Hole {
        let foot = self.facet.foot.map(|[a, b]| a * f64::from(x) + b * f64::from(y));
        let foot = DVec2::from_array(foot);
        let [a, b, c] = self.whole;
        let mut nearest = (f64::INFINITY, [0.0; 2]);
        let mut offer = |at: [f64; 2]| {
            let point = a + (b - a) * at[0] + (c - a) * at[1];
            let distance = point.distance_squared(foot);
            if distance < nearest.0 {
                nearest = (distance, at);
            }
        };
        let (edge1, edge2, from) = (b - a, c - a, foot - a);
        let inverse = edge1.perp_dot(edge2).recip();
        let (u, v) = (from.perp_dot(edge2) * inverse, edge1.perp_dot(from) * inverse);
        if u >= 0.0 && v >= 0.0 && u + v <= 1.0 {
            offer([u, v]);
        } else {
            let share = |p: DVec2, q: DVec2| {
                ((foot - p).dot(q - p) / (q - p).length_squared()).clamp(0.0, 1.0)
            };
            offer([share(a, b), 0.0]);
            offer([0.0, share(a, c)]);
            let along = share(b, c);
            offer([1.0 - along, along]);
        }
        let at = nearest.1.map(|weight| weight as f32);
        Hole { place: self.place, triangle: self.triangle, at, radius }
    }
}
