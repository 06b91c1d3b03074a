//! What lies in the spheres around the points of a patch, ready to be summed up.
//!
//! Coordinates are those of the patch, in its plane, in units of the radius.

use super::disc::chord;
use super::surfaces::{Hole, Surfaces};
use crate::lanes::lanes_of;
use glam::DVec2;
use std::array::from_fn;
use std::f32::consts::PI;

/// So many side by side.
const WIDTH: usize = 8;

type Lane = [f32; WIDTH];

/// All that is not in the plane of the patch, and the boundary of what is.
#[derive(Clone, Debug, Default)]
pub struct List {
    /// How often the surface in the plane winds around points of the patch: 1, or 0 if it has holes.
    inside: f32,
    segments: Box<[Segments]>,
    facets: Box<[Facets]>,
    holes: Box<[Holed]>,
}

/// Edges in the plane of the patch.
#[derive(Clone, Copy, Debug)]
#[repr(C, align(32))]
struct Segments {
    /// Height of a point above the line: coefficients of 1, x and y.
    height: [Lane; 3],
    /// Place of the start, counted from the foot of a point: coefficients of 1, x and y.
    start: [Lane; 3],
    length: Lane,
}

/// Triangles in other planes.
#[derive(Clone, Copy, Debug)]
#[repr(C, align(32))]
struct Facets {
    /// Height of their plane above a point: coefficients of 1, x and y.
    height: [Lane; 3],
    /// Coordinates in their plane of the foot of a point: coefficients of x and y each.
    foot: [[Lane; 2]; 2],
    /// Counterclockwise, x and y of each.
    corners: [[Lane; 2]; 3],
}

/// A triangle in the space of a patch.
#[derive(Clone, Copy, Debug, Default)]
pub struct Facet {
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
    pub facet: Facet,
    /// Corners of all of the triangle in the same plane, in the order of the mesh.
    pub whole: [DVec2; 3],
    /// Index of the place.
    pub place: u32,
    /// Index of the triangle in its mesh.
    pub triangle: u32,
}

impl List {
    /// Of boundary segments with the surface on their left, and of other triangles.
    pub fn new(
        inside: bool,
        segments: &[(DVec2, DVec2)],
        facets: &[Facet],
        holes: Vec<Holed>,
    ) -> Self {
        Self {
            inside: if inside { 1.0 } else { 0.0 },
            segments: segments.chunks(WIDTH).map(Segments::new).collect(),
            facets: facets.chunks(WIDTH).map(Facets::new).collect(),
            holes: holes.into(),
        }
    }

    /// Area within spheres of these squared radii around a point, in squares of the unit.
    #[inline(always)] // part of vectorized code
    pub fn areas<const N: usize>(&self, at: [f32; 2], radii2: &[f32; N]) -> [f32; N] {
        let mut edges = Edges::new(radii2);
        for segments in &self.segments {
            segments.add(at, &mut edges);
        }
        for facets in &self.facets {
            facets.add(at, &mut edges);
        }
        let sums = edges.finish();
        from_fn(|i| self.inside * PI * radii2[i] + sums[i])
    }

    /// Whether any of it has holes.
    #[inline(always)]
    pub fn has_holes(&self) -> bool {
        !self.holes.is_empty()
    }

    /// What is added by surfaces with holes; `unit` is that of the coordinates, in scene units.
    #[inline(never)]
    pub fn areas_with_holes<const N: usize>(
        &self,
        surfaces: &dyn Surfaces,
        unit: f32,
        at: [f32; 2],
        radii2: &[f32; N],
    ) -> [f32; N] {
        let mut areas = [0.0; N];
        for holed in &self.holes {
            let own = List::new(false, &[], &[holed.facet], vec![]).areas(at, radii2);
            for ((area, own), radius2) in areas.iter_mut().zip(own).zip(radii2) {
                if own > 0.0 {
                    *area += own * surfaces.opacity(&holed.hole(at, unit * radius2.sqrt()));
                }
            }
        }
        areas
    }

    /// Packs of segments and of facets.
    pub fn lengths(&self) -> [usize; 2] {
        [self.segments.len(), self.facets.len()]
    }

    /// Scratch: real segments, facets, those that cross, all inside, all outside at a point.
    pub fn scratch(&self, [x, y]: [f32; 2]) -> [usize; 6] {
        let mut n = [0; 6];
        for s in &self.segments {
            for lane in 0..WIDTH {
                if s.height[0][lane] == 4.0 && s.length[lane] == 0.0 {
                    continue;
                }
                n[0] += 1;
                let h = s.height[0][lane] + s.height[1][lane] * x + s.height[2][lane] * y;
                let a = s.start[0][lane] + s.start[1][lane] * x + s.start[2][lane] * y;
                let l = (1.0 - h * h).max(0.0).sqrt();
                n[1] += usize::from(h.abs() < 1.0 && a < l && a + s.length[lane] > -l);
            }
        }
        for f in &self.facets {
            for lane in 0..WIDTH {
                if f.height[0][lane] == 4.0 && f.corners[0][0][lane] == f.corners[1][0][lane] {
                    continue;
                }
                n[2] += 1;
                let h = f.height[0][lane] + f.height[1][lane] * x + f.height[2][lane] * y;
                let rho2 = 1.0 - h * h;
                if rho2 <= 0.0 {
                    n[5] += 1;
                    continue;
                }
                let foot = [0, 1].map(|a| f.foot[a][0][lane] * x + f.foot[a][1][lane] * y);
                let c = [0, 1, 2]
                    .map(|c| [f.corners[c][0][lane] - foot[0], f.corners[c][1][lane] - foot[1]]);
                if c.iter().all(|c| c[0] * c[0] + c[1] * c[1] <= rho2) {
                    n[4] += 1;
                    continue;
                }
                let mut any = 0;
                for i in 0..3 {
                    let (p, q) = (c[i], c[(i + 1) % 3]);
                    let d = [q[0] - p[0], q[1] - p[1]];
                    let t = (-(p[0] * d[0] + p[1] * d[1]) / (d[0] * d[0] + d[1] * d[1]))
                        .clamp(0.0, 1.0);
                    let e = [p[0] + t * d[0], p[1] + t * d[1]];
                    if e[0] * e[0] + e[1] * e[1] < rho2 {
                        any += 1;
                    }
                }
                n[3] += any;
                n[5] += usize::from(any == 0);
            }
        }
        n
    }

    /// Bytes that it takes.
    pub fn bytes(&self) -> usize {
        size_of::<Self>()
            + size_of_val(&*self.segments)
            + size_of_val(&*self.facets)
            + size_of_val(&*self.holes)
    }
}

impl Segments {
    fn new(segments: &[(DVec2, DVec2)]) -> Self {
        // Those that fill up are far away.
        let mut all =
            Self { height: [[0.0; WIDTH]; 3], start: [[0.0; WIDTH]; 3], length: [0.0; WIDTH] };
        all.height[0] = [4.0; WIDTH];
        for (lane, &(p, q)) in segments.iter().enumerate() {
            let (along, length) = (q - p).normalize_and_length();
            let up = along.perp();
            let set = |to: &mut [Lane; 3], numbers: [f64; 3]| {
                for (to, number) in to.iter_mut().zip(numbers) {
                    to[lane] = number as f32;
                }
            };
            set(&mut all.height, [-up.dot(p), up.x, up.y]);
            set(&mut all.start, [along.dot(p), -along.x, -along.y]);
            all.length[lane] = length as f32;
        }
        all
    }

    #[inline(always)] // part of vectorized code
    fn add<const N: usize>(&self, [x, y]: [f32; 2], edges: &mut Edges<N>) {
        let affine = |k: &[Lane; 3], lane: usize| k[0][lane] + (k[1][lane] * x + k[2][lane] * y);
        let (mut heights, mut starts, mut cross) = <(Lane, Lane, [u32; WIDTH])>::default();
        for lane in 0..WIDTH {
            let height = affine(&self.height, lane);
            // Points of the patch are on the surface, however coordinates were rounded.
            heights[lane] = if height.abs() < 1e-5 { height.abs() } else { height };
            starts[lane] = affine(&self.start, lane);
            let (start, end) = (starts[lane], starts[lane] + self.length[lane]);
            let half2 = edges.largest2 - height * height;
            let is_past = (start > 0.0) & (start * start >= half2);
            let is_before = (end < 0.0) & (end * end >= half2);
            cross[lane] = u32::from((half2 > 0.0) & !is_past & !is_before) << lane;
        }
        for lane in lanes_of(any_of(&cross)) {
            let (start, end) = (starts[lane], starts[lane] + self.length[lane]);
            edges.push([heights[lane], start, end, 1.0, 0.0]);
        }
    }
}

/// A bit for each lane.
#[inline(always)]
fn any_of(bits: &[u32; WIDTH]) -> u32 {
    bits.iter().fold(0, |all, bit| all | bit)
}

/// So many edges are summed up at a time.
const EDGES: usize = 16;

/// Edges that discs of some radii meet.
struct Edges<'a, const N: usize> {
    radii2: &'a [f32; N],
    largest2: f32,
    smallest2: f32,
    /// Height of the center above each edge, start and end, times its length; the square of that; and
    /// that of the height of the sphere's center above the plane.
    waiting: [[f32; EDGES]; 5],
    count: usize,
    sums: [[f32; EDGES]; N],
    /// What is added besides.
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
        if self.count % EDGES == 0 {
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
                let rho2 = (radius2 - height2[lane]).max(0.0);
                let chord = chord(cross[lane] * inverse, ends, rho2);
                *sum += if lane < count { chord } else { 0.0 };
            }
        }
    }

    #[inline(always)] // part of vectorized code
    fn finish(mut self) -> [f32; N] {
        if self.count % EDGES > 0 {
            self.add(self.count % EDGES);
        }
        from_fn(|i| self.more[i] + self.sums[i].iter().sum::<f32>())
    }
}

impl Facets {
    fn new(facets: &[Facet]) -> Self {
        let mut all = Self {
            height: [[0.0; WIDTH]; 3],
            foot: [[[0.0; WIDTH]; 2]; 2],
            corners: [[[0.0; WIDTH]; 2]; 3],
        };
        // Those that fill up are far away.
        all.height[0] = [4.0; WIDTH];
        for (lane, facet) in facets.iter().enumerate() {
            for (to, number) in all.height.iter_mut().zip(facet.height) {
                to[lane] = number as f32;
            }
            for (to, number) in all.foot.iter_mut().flatten().zip(facet.foot.iter().flatten()) {
                to[lane] = *number as f32;
            }
            let corners = facet.corners.iter().flat_map(|corner| corner.to_array());
            for (to, number) in all.corners.iter_mut().flatten().zip(corners) {
                to[lane] = number as f32;
            }
        }
        all
    }

    #[inline(always)] // part of vectorized code
    fn add<const N: usize>(&self, [x, y]: [f32; 2], edges: &mut Edges<N>) {
        let mut height2 = [0.0; WIDTH];
        let (mut crosses, mut from, mut to, mut length2) = <[[Lane; 3]; 4]>::default().into();
        let mut meet = [[0; WIDTH]; 3];
        let mut inside = [0.0; WIDTH];
        let mut whole = [0.0; WIDTH];
        for lane in 0..WIDTH {
            let height =
                self.height[0][lane] + (self.height[1][lane] * x + self.height[2][lane] * y);
            height2[lane] = height * height;
            let foot = |axis: usize| self.foot[axis][0][lane] * x + self.foot[axis][1][lane] * y;
            let (foot_x, foot_y) = (foot(0), foot(1));
            let corners = [0, 1, 2].map(|corner| {
                (self.corners[corner][0][lane] - foot_x, self.corners[corner][1][lane] - foot_y)
            });
            let distances2 = corners.map(|(x, y)| x * x + y * y);
            let rho2 = edges.largest2 - height2[lane];
            let mut is_inside = true;
            let mut doubled_area = 0.0;
            let [a, b, c] = distances2;
            let is_whole = a.max(b).max(c) <= edges.smallest2 - height2[lane];
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
                let rho2 = (radius2 - height2[lane]).max(0.0);
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
    /// Where to ask for its opacity.
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
