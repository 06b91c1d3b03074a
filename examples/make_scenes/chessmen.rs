//! Chessmen as they come from a lathe: centimeters, standing on y = 0.

use super::mesh::Mesh;
use super::profile::{ProfilePoint, arc, line, smooth};
use super::shapes::lathe;
use glam::{DVec2, dvec2};

const SEGMENTS: usize = 48;

/// 5 cm high.
pub fn pawn() -> Mesh {
    let body = [(1.7, 0.0), (1.75, 0.4), (1.45, 0.85), (1.0, 1.5), (0.72, 2.4), (0.68, 2.95)];
    let collar = [(0.68, 2.95), (1.1, 3.05), (1.12, 3.22), (0.72, 3.36)];
    turned(&[&body, &collar], dvec2(0.0, 4.12), 0.95)
}

/// 8.7 cm high.
pub fn queen() -> Mesh {
    let foot = [(2.1, 0.0), (2.15, 0.45), (1.9, 0.8), (1.8, 1.15), (1.35, 1.6)];
    let body = [(1.35, 1.6), (0.98, 2.9), (0.8, 4.4), (0.85, 5.4)];
    let collar = [(0.85, 5.4), (1.4, 5.6), (1.42, 5.8), (0.9, 6.0)];
    let crown = [(0.9, 6.0), (1.05, 6.7), (1.45, 7.5), (1.3, 7.7), (0.7, 7.85), (0.3, 7.95)];
    turned(&[&foot, &body, &collar, &crown], dvec2(0.0, 8.28), 0.42)
}

/// A closed body: a flat bottom, smooth curves with edges between them, a ball on top.
fn turned(curves: &[&[(f64, f64)]], ball: DVec2, radius: f64) -> Mesh {
    let curve = |points: &[(f64, f64)]| {
        let points: Vec<_> = points.iter().map(|&(x, y)| dvec2(x, y)).collect();
        smooth(&points, 4)
    };
    let mut profiles: Vec<Vec<ProfilePoint>> = curves.iter().map(|points| curve(points)).collect();
    let (first, last) = (profiles[0][0].at, profiles[profiles.len() - 1].last().unwrap().at);
    // The ball begins where the neck ends.
    let below = ((last.x / radius).min(1.0)).acos().to_degrees();
    let mut top = arc(ball, radius, -below, 90.0, 12);
    top[0].at = last;
    profiles.push(top);
    profiles.push(line(DVec2::ZERO, first));
    Mesh::join(profiles.iter().map(|profile| lathe(profile, SEGMENTS)))
}
