//! The objects that cast caustics: a goblet, a ring and a gem.

use super::super::mesh::Mesh;
use super::super::obj::Model;
use super::super::profile::{ProfilePoint, arc, line, spline};
use super::super::shapes::{disc, lathe};
use glam::{DVec2, DVec3, dvec2, dvec3};

/// Pieces of a curve between two of its given points.
const PIECES: usize = 10;
/// Pieces around the goblet.
const AROUND: usize = 48;

/// A goblet with water: glass outside and above the water inside, the water's surface, and where
/// glass and water meet.
pub fn goblet() -> Model {
    let points = |points: &[(f64, f64)]| -> Vec<DVec2> {
        points.iter().map(|&(x, y)| dvec2(x, y)).collect()
    };
    let stem = [
        (0.4, 0.035),
        (0.33, 0.05),
        (0.2, 0.085),
        (0.1, 0.13),
        (0.06, 0.2),
        (0.055, 0.28),
        (0.075, 0.36),
        (0.15, 0.43),
        (0.3, 0.56),
        (0.44, 0.77),
        (0.5, 1.04),
        (0.475, 1.3),
        (0.415, 1.56),
    ];
    let outside = spline(&points(&stem), PIECES);
    let inner = [
        (0.0, 0.47),
        (0.135, 0.495),
        (0.282, 0.59),
        (0.413, 0.785),
        (0.467, 1.04),
        (0.444, 1.3),
        (0.391, 1.56),
    ];
    let inside = spline(&points(&inner), PIECES);
    // The water stands at one of the given points.
    let level = 4 * PIECES;
    let dry = backward(&inside[level..]);
    let water = inside[level].at;
    let surface = disc(water.x, AROUND).moved(0.0, water.y, 0.0);
    let foot = line(DVec2::ZERO, dvec2(0.4, 0.0));
    let edge = arc(dvec2(0.4, 0.0175), 0.0175, -90.0, 90.0, 6);
    let lip = arc(dvec2(0.403, 1.56), 0.012, 0.0, 180.0, 8);
    let turned = |run: &[ProfilePoint]| lathe(run, AROUND);
    let glass = [foot, edge, outside, lip, dry].map(|run| turned(&run));
    Model::new("A goblet with water. Fronts of glass look out of it, that of the water up.")
        .decimals(4, 5)
        .part("goblet", "glass", Mesh::join(glass))
        .part("wet", "water-in-glass", turned(&inside[..=level]))
        .part("surface", "water", surface)
}

/// A profile in the other direction, its front on the other side.
fn backward(profile: &[ProfilePoint]) -> Vec<ProfilePoint> {
    let swapped = |p: &ProfilePoint| ProfilePoint { at: p.at, normal: p.normal.map(|n| -n) };
    profile.iter().rev().map(swapped).collect()
}

/// A polished ring like a cuff: radius 0.8, height 0.4.
pub fn ring() -> Model {
    let (inner, outer, low, high) = (0.78, 0.84, 0.03, 0.39);
    let middle = 0.5 * (inner + outer);
    let profile = [
        line(dvec2(outer, low), dvec2(outer, high)),
        arc(dvec2(middle, high), 0.03, 0.0, 180.0, 8),
        line(dvec2(inner, high), dvec2(inner, low)),
        arc(dvec2(middle, low), 0.03, 180.0, 360.0, 8),
    ];
    let mesh = Mesh::join(profile.iter().map(|run| lathe(run, 96)));
    Model::new("A ring: radius 0.8, height 0.4.").decimals(5, 4).plain("ring", mesh)
}

/// A gem of radius 0.36 in brilliant cut, standing on its table: 57 facets and a girdle.
pub fn gem() -> Model {
    let at = |radius: f64, height: f64, sixteenths: usize| {
        let (sin, cos) = (std::f64::consts::TAU * sixteenths as f64 / 16.0).sin_cos();
        dvec3(radius * sin, height, radius * cos)
    };
    // Crown and pavilion: the main facets are flat, for the points between them lie on their plane.
    let half = (std::f64::consts::TAU / 16.0).cos();
    let (table, top, crown, girdle, bottom) = (0.56, 0.36, 0.8, 0.03, -0.86);
    let crown_height = top + (crown * half - table) / (1.0 - table) * (girdle - top);
    let pavilion = 0.25;
    let pavilion_height = bottom + pavilion * half * (-girdle - bottom);
    let mut faces: Vec<Vec<DVec3>> = vec![(0..8).map(|i| at(table, top, 2 * i)).collect()];
    for i in 0..8 {
        let (here, next, last) = (2 * i, 2 * i + 1, 2 * i + 15);
        let (star, kite) = (at(crown, crown_height, next), at(crown, crown_height, last));
        let (rim, rim_next, rim_after) =
            (at(1.0, girdle, here), at(1.0, girdle, next), at(1.0, girdle, here + 2));
        faces.push(vec![at(table, top, here), star, at(table, top, here + 2)]);
        faces.push(vec![at(table, top, here), kite, rim, star]);
        faces.push(vec![star, rim, rim_next]);
        faces.push(vec![star, rim_next, rim_after]);
        let (low, low_last) =
            (at(pavilion, pavilion_height, next), at(pavilion, pavilion_height, last));
        let (edge, edge_next, edge_after) =
            (at(1.0, -girdle, here), at(1.0, -girdle, next), at(1.0, -girdle, here + 2));
        faces.push(vec![dvec3(0.0, bottom, 0.0), low, edge, low_last]);
        faces.push(vec![low, edge_next, edge]);
        faces.push(vec![low, edge_after, edge_next]);
        faces.push(vec![rim, edge, edge_next, rim_next]);
        faces.push(vec![rim_next, edge_next, edge_after, rim_after]);
    }
    let size = 0.36;
    let mesh = Mesh::join(faces.iter().map(|face| Mesh::polygon(face)));
    let mesh = mesh.turned_x(180.0).scaled(size, size, size).moved(0.0, size * top + 0.004, 0.0);
    Model::new("A gem in brilliant cut, standing on its table.").decimals(5, 4).plain("gem", mesh)
}
