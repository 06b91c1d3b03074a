//! Profiles of turned things: points in a plane of radius and height.

use glam::{DVec2, dvec2};

/// A point of a profile: `x` is the distance from the axis, `y` the height along it.
#[derive(Clone, Copy, Debug)]
pub struct ProfilePoint {
    pub at: DVec2,
    /// Unit normal of the front; without one the surface is flat between the points of a ring.
    pub normal: Option<DVec2>,
}

/// An arc about `center`, angles in degrees counterclockwise from the direction away from the axis.
/// Counterclockwise arcs (`to` greater than `from`) bulge to the front, others are hollow.
pub fn arc(center: DVec2, radius: f64, from: f64, to: f64, pieces: usize) -> Vec<ProfilePoint> {
    let outward = if to > from { 1.0 } else { -1.0 };
    let point = |i: usize| {
        let angle = (from + (to - from) * i as f64 / pieces as f64).to_radians();
        let direction = dvec2(angle.cos(), angle.sin());
        let at = snapped(center + radius * direction);
        ProfilePoint { at, normal: Some(outward * direction) }
    };
    (0..=pieces).map(point).collect()
}

/// A straight line: a cylinder, a cone or a ring.
pub fn line(from: DVec2, to: DVec2) -> Vec<ProfilePoint> {
    let normal = Some(right(to - from));
    vec![ProfilePoint { at: from, normal }, ProfilePoint { at: to, normal }]
}

/// A smooth curve through points (Catmull and Rom's), each step cut into `pieces`. It follows its
/// points closely, but its curvature jumps at them.
pub fn smooth(points: &[DVec2], pieces: usize) -> Vec<ProfilePoint> {
    let last = points.len() - 1;
    let before = |i: usize| if i == 0 { 2.0 * points[0] - points[1] } else { points[i - 1] };
    let after = |i: usize| if i == last { 2.0 * points[i] - points[i - 1] } else { points[i + 1] };
    let mut curve = Vec::new();
    for i in 0..last {
        let (p, q) = (points[i], points[i + 1]);
        let (u, v) = (0.5 * (q - before(i)), 0.5 * (after(i + 1) - p));
        for k in 0..pieces + usize::from(i + 1 == last) {
            let t = k as f64 / pieces as f64;
            let (t2, t3) = (t * t, t * t * t);
            let at = (2.0 * t3 - 3.0 * t2 + 1.0) * p + (3.0 * t2 - 2.0 * t3) * q;
            let at = at + (t3 - 2.0 * t2 + t) * u + (t3 - t2) * v;
            let slope = 6.0 * (t2 - t) * (p - q) + (3.0 * t2 - 4.0 * t + 1.0) * u;
            let slope = slope + (3.0 * t2 - 2.0 * t) * v;
            curve.push(ProfilePoint { at: snapped(at), normal: Some(right(slope)) });
        }
    }
    curve
}

/// A curve like [`smooth`] for glass: its curvature is continuous, so that caustics show no bands,
/// and it swings wider (the natural cubic spline over the distances between points).
pub fn spline(points: &[DVec2], pieces: usize) -> Vec<ProfilePoint> {
    let steps: Vec<f64> = points.windows(2).map(|pair| pair[0].distance(pair[1])).collect();
    let bends = second_derivatives(points, &steps);
    let mut curve = Vec::new();
    for (i, &step) in steps.iter().enumerate() {
        let (p, q) = (points[i], points[i + 1]);
        let (u, v) = (bends[i] * (step * step / 6.0), bends[i + 1] * (step * step / 6.0));
        for k in 0..pieces + usize::from(i + 1 == steps.len()) {
            let t = k as f64 / pieces as f64;
            let s = 1.0 - t;
            let at = s * p + t * q + (s * s * s - s) * u + (t * t * t - t) * v;
            let slope = q - p + (1.0 - 3.0 * s * s) * u + (3.0 * t * t - 1.0) * v;
            curve.push(ProfilePoint { at: snapped(at), normal: Some(right(slope)) });
        }
    }
    curve
}

/// Second derivatives of the natural spline at its points: elimination in a matrix of three
/// diagonals.
fn second_derivatives(points: &[DVec2], steps: &[f64]) -> Vec<DVec2> {
    let n = points.len();
    let slope = |i: usize| (points[i + 1] - points[i]) / steps[i];
    let (mut above, mut bends) = (vec![0.0; n], vec![DVec2::ZERO; n]);
    for i in 1..n - 1 {
        let pivot = 2.0 * (steps[i - 1] + steps[i]) - steps[i - 1] * above[i - 1];
        above[i] = steps[i] / pivot;
        bends[i] = (6.0 * (slope(i) - slope(i - 1)) - steps[i - 1] * bends[i - 1]) / pivot;
    }
    for i in (1..n - 1).rev() {
        let next = bends[i + 1];
        bends[i] -= above[i] * next;
    }
    bends
}

/// The profiles of straight lines from point to point, each a run of its own, so that edges between
/// them stay sharp.
pub fn edges(points: &[DVec2]) -> Vec<Vec<ProfilePoint>> {
    points.windows(2).map(|pair| line(pair[0], pair[1])).collect()
}

/// On the axis if only rounding keeps it off.
fn snapped(at: DVec2) -> DVec2 {
    if at.x.abs() < 1e-12 { dvec2(0.0, at.y) } else { at }
}

/// To the right of a direction, of length 1.
fn right(direction: DVec2) -> DVec2 {
    dvec2(direction.y, -direction.x).normalize()
}
