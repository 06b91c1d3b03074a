//! Convex polygons in a plane, in f64: clipped, split and taken from one another.

use glam::DVec2;

/// Corners, counterclockwise; fewer than three of nothing.
pub type Polygon = Vec<DVec2>;

/// A directed line: what is left of it has a positive height.
#[derive(Clone, Copy, Debug)]
pub struct Line {
    normal: DVec2,
    offset: f64,
}

impl Line {
    /// Through two points; `None` if they are as good as one.
    pub fn through(a: DVec2, b: DVec2) -> Option<Self> {
        let normal = (b - a).perp().try_normalize()?;
        Some(Self { normal, offset: normal.dot(a) })
    }

    /// Height of a point above it.
    pub fn height(&self, point: DVec2) -> f64 {
        self.normal.dot(point) - self.offset
    }

    /// The other side up.
    pub fn reversed(self) -> Self {
        Self { normal: -self.normal, offset: -self.offset }
    }
}

/// Twice the area.
fn doubled_area(polygon: &[DVec2]) -> f64 {
    let Some((&first, rest)) = polygon.split_first() else { return 0.0 };
    rest.windows(2).map(|pair| (pair[0] - first).perp_dot(pair[1] - first)).sum()
}

/// Area; negative if clockwise.
pub fn area(polygon: &[DVec2]) -> f64 {
    0.5 * doubled_area(polygon)
}

/// Mean of the corners: a point within.
pub fn middle(polygon: &[DVec2]) -> DVec2 {
    polygon.iter().sum::<DVec2>() / polygon.len() as f64
}

/// Its edges.
pub fn edges(polygon: &[DVec2]) -> impl Iterator<Item = (DVec2, DVec2)> {
    let next = polygon.iter().cycle().skip(1);
    polygon.iter().copied().zip(next.copied())
}

/// The part left of a line.
pub fn clip(polygon: &[DVec2], line: Line) -> Polygon {
    let mut kept = Polygon::with_capacity(polygon.len() + 1);
    for (a, b) in edges(polygon) {
        let (height_a, height_b) = (line.height(a), line.height(b));
        if height_a >= 0.0 {
            kept.push(a);
        }
        if (height_a > 0.0 && height_b < 0.0) || (height_a < 0.0 && height_b > 0.0) {
            kept.push(crossing((a, height_a), (b, height_b)));
        }
    }
    if kept.len() < 3 {
        kept.clear();
    }
    kept
}

/// Where an edge has no height; the same for its reverse.
fn crossing((a, height_a): (DVec2, f64), (b, height_b): (DVec2, f64)) -> DVec2 {
    if height_a > height_b {
        return crossing((b, height_b), (a, height_a));
    }
    a + (b - a) * (height_a / (height_a - height_b))
}

/// Adds convex polygons to `rest` that together are `polygon` without `other`.
pub fn subtract(polygon: &[DVec2], other: &[DVec2], tolerance: f64, rest: &mut Vec<Polygon>) {
    let mut left = polygon.to_vec();
    let lines: Vec<_> = edges(other).filter_map(|(a, b)| Line::through(a, b)).collect();
    // If the polygons do not overlap, the whole polygon is outside of one edge of the other.
    let apart = |line: &Line| polygon.iter().all(|&p| line.height(p) <= tolerance);
    if lines.iter().any(apart) {
        rest.push(left);
        return;
    }
    for line in lines {
        let outside = clip(&left, line.reversed());
        if area(&outside) > tolerance * tolerance {
            rest.push(outside);
        }
        left = clip(&left, line);
        if left.is_empty() {
            return;
        }
    }
}

/// Whether a segment has points inside of a polygon, by more than the tolerance.
pub fn meets(polygon: &[DVec2], (p, q): (DVec2, DVec2), tolerance: f64) -> bool {
    let (mut first, mut last) = (0.0f64, 1.0f64);
    for (a, b) in edges(polygon) {
        let Some(line) = Line::through(a, b) else { continue };
        let (start, end) = (line.height(p) - tolerance, line.height(q) - tolerance);
        if start <= 0.0 && end <= 0.0 {
            return false;
        }
        if start < 0.0 {
            first = first.max(start / (start - end));
        } else if end < 0.0 {
            last = last.min(start / (start - end));
        }
    }
    (last - first) * p.distance(q) > tolerance
}

/// The corners of a rectangle around the origin, given by half of its sides.
pub fn rectangle(half: DVec2) -> [DVec2; 4] {
    let DVec2 { x, y } = half;
    [DVec2::new(-x, -y), DVec2::new(x, -y), DVec2::new(x, y), DVec2::new(-x, y)]
}

/// The part of a polygon in a rectangle around the origin, given by half of its sides.
pub fn clip_to(polygon: &[DVec2], half: DVec2) -> Polygon {
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
