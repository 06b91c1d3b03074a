//! Cuts polygons into triangles that cover exactly the area inside the outline. If the fan from the
//! first corner does so, as it does for every convex polygon, the fan is used. Otherwise ears are
//! clipped.

use glam::{DVec2, DVec3, Vec2Swizzles, Vec3};

/// Maximum number of corners of a polygon whose ears are clipped. The time grows with its square.
pub const LARGEST: usize = 1024;

/// Maximum depth of a dent, relative to its length, that counts as a straight edge with rounded
/// coordinates.
const DENT: f64 = 1e-3;

/// Cuts polygons, one after another.
#[derive(Debug, Default)]
pub struct Cutter {
    /// Points of the current polygon in space.
    points: Vec<DVec3>,
    /// Points of the polygon in the plane, counterclockwise.
    flat: Vec<DVec2>,
    /// Number of polygons that were too large to clip. Their fans may cover too much.
    pub rough: u64,
}

impl Cutter {
    /// Calls `triangle` with the corners of each triangle of a polygon of three or more points.
    pub fn cut(&mut self, points: impl Iterator<Item = Vec3>, triangle: impl FnMut([usize; 3])) {
        self.points.clear();
        self.points.extend(points.map(|point| point.as_dvec3()));
        self.flatten();
        let fan = (1..self.flat.len() - 1).map(|i| [0, i, i + 1]);
        if fan.clone().all(|corners| self.turn(corners) >= -DENT * self.size(corners)) {
            fan.for_each(triangle);
        } else if self.flat.len() <= LARGEST {
            self.clip(triangle);
        } else {
            self.rough += 1;
            fan.for_each(triangle);
        }
    }

    /// Projects the points along the axis that is nearest to the normal.
    fn flatten(&mut self) {
        let first = self.points[0];
        let pairs = self.points.windows(2);
        let normal: DVec3 = pairs.map(|pair| (pair[0] - first).cross(pair[1] - first)).sum();
        let size = normal.abs();
        let flat = |point: &DVec3| {
            let DVec3 { x, y, z } = point - first;
            let (flat, up) = match size.max_element() {
                largest if largest == size.z => (DVec2::new(x, y), normal.z),
                largest if largest == size.y => (DVec2::new(z, x), normal.y),
                _ => (DVec2::new(y, z), normal.x),
            };
            if up < 0.0 { flat.yx() } else { flat }
        };
        self.flat.clear();
        self.flat.extend(self.points.iter().map(flat));
    }

    /// Returns twice the signed area of a triangle, which is positive if it turns left.
    fn turn(&self, [a, b, c]: [usize; 3]) -> f64 {
        let [a, b, c] = [a, b, c].map(|i| self.flat[i]);
        (b - a).perp_dot(c - b)
    }

    /// Returns the squared length of a triangle's longest edge.
    fn size(&self, [a, b, c]: [usize; 3]) -> f64 {
        let length = |[a, b]: [usize; 2]| self.flat[a].distance_squared(self.flat[b]);
        [[a, b], [b, c], [c, a]].map(length).into_iter().fold(0.0, f64::max)
    }

    /// Repeatedly cuts off a corner that turns left and whose triangle contains no other corner.
    /// Corners that cover nothing precede, because triangles with them may cover too much.
    fn clip(&self, mut triangle: impl FnMut([usize; 3])) {
        let mut outline = Outline::new(self.flat.len());
        outline.cut(|ear, _| self.is_empty(ear), &mut triangle);
        outline.cut(|ear, next| self.is_empty(ear) || self.is_ear(ear, next), &mut triangle);
        // One triangle remains, or more if the outline crosses itself.
        let is_left = |corner: &usize| !outline.is_cut[*corner];
        let rest: Vec<usize> = (0..self.flat.len()).filter(is_left).collect();
        for pair in rest[1..].windows(2) {
            triangle([rest[0], pair[0], pair[1]]);
        }
    }

    /// Whether two corners of a triangle are at one place, whatever their numbers are: a repeated
    /// corner, or the end of a spike.
    fn is_empty(&self, ear: [usize; 3]) -> bool {
        let [a, b, c] = ear.map(|corner| self.flat[corner]);
        a == b || b == c || c == a
    }

    fn is_ear(&self, ear: [usize; 3], next: &[usize]) -> bool {
        let [a, b, c] = ear;
        if self.turn(ear) <= 0.0 {
            return false;
        }
        let own = ear.map(|corner| self.flat[corner]);
        let mut other = next[c];
        while other != a {
            let point = self.flat[other];
            // An outline may touch itself, for example along a bridge to a hole.
            let is_inside =
                [[a, b], [b, c], [c, a]].iter().all(|[p, q]| self.turn([*p, *q, other]) >= 0.0);
            if is_inside && !own.contains(&point) {
                return false;
            }
            other = next[other];
        }
        true
    }
}

/// The corners of a polygon that are not cut off yet.
struct Outline {
    next: Vec<usize>,
    previous: Vec<usize>,
    is_cut: Vec<bool>,
    left: usize,
}

impl Outline {
    fn new(count: usize) -> Self {
        Self {
            next: (1..count).chain([0]).collect(),
            previous: [count - 1].into_iter().chain(0..count - 1).collect(),
            is_cut: vec![false; count],
            left: count,
        }
    }

    /// Cuts off corners whose triangles satisfy `can_cut`, which also gets the corner after each,
    /// while more than three are left.
    fn cut(
        &mut self,
        can_cut: impl Fn([usize; 3], &[usize]) -> bool,
        triangle: &mut impl FnMut([usize; 3]),
    ) {
        // Each corner is tried once. A cut changes only its two neighbors, which are tried again.
        let mut to_try: Vec<usize> = (0..self.next.len()).rev().collect();
        while let Some(corner) = to_try.pop() {
            let ear = [self.previous[corner], corner, self.next[corner]];
            if self.left > 3 && !self.is_cut[corner] && can_cut(ear, &self.next) {
                triangle(ear);
                let [before, _, after] = ear;
                (self.next[before], self.previous[after]) = (after, before);
                self.is_cut[corner] = true;
                to_try.extend([after, before]);
                self.left -= 1;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use std::f64::consts::TAU;

    /// Returns the area of a polygon and the sum of the areas of its triangles, whose orientations
    /// must agree.
    fn areas(outline: &[Vec3]) -> [f64; 2] {
        let mut cutter = Cutter::default();
        let mut triangles = Vec::new();
        cutter.cut(outline.iter().copied(), |triangle| triangles.push(triangle));
        assert_eq!((triangles.len(), cutter.rough), (outline.len() - 2, 0));
        let area = |corners: [usize; 3]| {
            let [a, b, c] = corners.map(|i| outline[i].as_dvec3());
            0.5 * (b - a).cross(c - a)
        };
        let whole: DVec3 = (1..outline.len() - 1).map(|i| area([0, i, i + 1])).sum();
        let parts = triangles.iter().map(|corners| area(*corners));
        let up = whole.normalize();
        assert!(parts.clone().all(|part| part.dot(up) > -1e-2 * whole.length()));
        [whole.length(), parts.map(DVec3::length).sum()]
    }

    fn flat(outline: &[[f32; 2]]) -> Vec<Vec3> {
        outline.iter().map(|[x, y]| Vec3::new(*x, *y, 0.0)).collect()
    }

    #[test]
    fn triangles_cover_area_of_known_shapes() {
        let arrow = [[0.0, 0.0], [2.0, -1.0], [0.0, 3.0], [-2.0, -1.0]];
        let l = [[0.0, 0.0], [2.0, 0.0], [2.0, 1.0], [1.0, 1.0], [1.0, 2.0], [0.0, 2.0]];
        // Some corners lie on straight edges.
        let u = [
            [0.0, 0.0],
            [1.0, 0.0],
            [2.0, 0.0],
            [3.0, 0.0],
            [3.0, 2.0],
            [2.0, 2.0],
            [2.0, 1.0],
            [1.5, 1.0],
            [1.0, 1.0],
            [1.0, 2.0],
            [0.0, 2.0],
            [0.0, 1.0],
        ];
        // A square with a square hole. The outline passes the bridge between them twice.
        let ring = [
            [0.0, 0.0],
            [3.0, 0.0],
            [3.0, 3.0],
            [0.0, 3.0],
            [0.0, 0.0],
            [1.0, 1.0],
            [1.0, 2.0],
            [2.0, 2.0],
            [2.0, 1.0],
            [1.0, 1.0],
        ];
        let shapes: [(&[[f32; 2]], f64); 4] = [(&arrow, 6.0), (&l, 3.0), (&u, 5.0), (&ring, 8.0)];
        for (shape, area) in shapes {
            for turned in 0..shape.len() {
                let mut outline = flat(shape);
                outline.rotate_left(turned);
                for _ in 0..2 {
                    let tilted = |p: &Vec3| Vec3::new(p.y, p.x + 2.0 * p.y, 3.0 * p.x - p.y);
                    assert_eq!(areas(&outline), [area; 2], "{outline:?}");
                    let [whole, parts] = areas(&outline.iter().map(tilted).collect::<Vec<_>>());
                    assert!((parts / whole - 1.0).abs() < 1e-12, "{outline:?}");
                    outline.reverse();
                }
            }
        }
    }

    #[test]
    fn corners_at_one_place_do_not_change_the_area() {
        let star = |i: u32| {
            let angle = i as f32 * (std::f32::consts::TAU / 8.0);
            Vec3::new(angle.cos(), angle.sin(), 0.0) * if i.is_multiple_of(2) { 0.9 } else { 0.3 }
        };
        let once: Vec<Vec3> = (0..8).map(star).collect();
        let [area, _] = areas(&once);
        for copies in [2, 3] {
            for turned in 0..8 * copies {
                let mut outline: Vec<Vec3> =
                    once.iter().flat_map(|point| vec![*point; copies]).collect();
                outline.rotate_left(turned);
                let [whole, parts] = areas(&outline);
                assert!((whole / area - 1.0).abs() < 1e-6 && (parts / area - 1.0).abs() < 1e-6);
            }
        }
        // A spike out of a dented outline and back.
        let spike = [[0.0, 0.0], [2.0, -1.0], [5.0, -2.0], [2.0, -1.0], [0.0, 3.0], [-2.0, -1.0]];
        let [whole, parts] = areas(&flat(&spike));
        assert_eq!([whole, parts], [6.0; 2]);
    }

    #[test]
    fn convex_and_nearly_convex_polygons_become_fans() {
        let square = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]];
        let rounded = [[0.0, 0.0], [1.0, 0.001], [2.0, 0.0], [2.0, 1.0]];
        let hollow = [[0.0, 0.0], [1.0, 0.0], [0.2, 0.2], [0.0, 1.0]];
        for shape in [square, rounded, hollow] {
            let mut triangles = Vec::new();
            let outline = flat(&shape).into_iter();
            Cutter::default().cut(outline, |triangle| triangles.push(triangle));
            assert_eq!(triangles, [[0, 1, 2], [0, 2, 3]]);
        }
    }

    #[test]
    fn degenerate_and_huge_outlines_yield_expected_number_of_triangles() {
        let star = |i: u32| {
            let angle = i as f32 * (std::f32::consts::TAU / 100_000.0);
            Vec3::new(angle.cos(), angle.sin(), 0.0) * (1 + i % 2) as f32
        };
        for (outline, rough) in [
            (vec![Vec3::ONE; 7], 0),
            ((0..9).map(|i| Vec3::splat(i as f32)).collect(), 0),
            (flat(&[[0.0, 0.0], [1.0, 1.0], [1.0, 0.0], [0.0, 1.0]]), 0),
            ((0..100_000).map(star).collect(), 1),
        ] {
            let (mut cutter, mut count) = (Cutter::default(), 0);
            cutter.cut(outline.iter().copied(), |_| count += 1);
            assert_eq!((count, cutter.rough), (outline.len() - 2, rough));
        }
    }

    proptest! {
        #[test]
        fn triangles_cover_area_of_any_star_shaped_outline(radii in proptest::collection::vec(0.05..1.0_f64, 4..60)) {
            let point = |(i, radius): (usize, &f64)| {
                let angle = TAU * i as f64 / radii.len() as f64;
                (DVec3::new(angle.cos(), angle.sin(), 0.3 * angle.cos()) * radius).as_vec3()
            };
            let outline: Vec<Vec3> = radii.iter().enumerate().map(point).collect();
            let [whole, parts] = areas(&outline);
            prop_assert!((parts / whole - 1.0).abs() < 1e-2, "{parts}, not {whole}");
        }
    }
}
