//! Candles on brass: chandeliers, wall lamps and hanging globes. Each flame is a closed mesh.

use super::super::mesh::Mesh;
use super::super::obj::Model;
use super::super::profile::{ProfilePoint, arc, line, smooth};
use super::super::shapes::{lathe, sphere};
use glam::{DVec2, dvec2};

fn points<const N: usize>(points: [(f64, f64); N]) -> [DVec2; N] {
    points.map(|(x, y)| dvec2(x, y))
}

/// Brass, wax and light of a lamp.
#[derive(Default)]
struct Parts {
    brass: Mesh,
    wax: Mesh,
    flames: Mesh,
}

impl Parts {
    /// A candle on its dish; the foot of the dish is at the given place.
    fn candle(&mut self, x: f64, y: f64, z: f64) {
        let dish =
            points([(0.0, -0.03), (0.014, -0.02), (0.016, 0.0), (0.04, 0.012), (0.045, 0.02)]);
        let run: Vec<_> = dish.windows(2).flat_map(|pair| line(pair[0], pair[1])).collect();
        self.brass.push(lathe(&merged(&run), 10).moved(x, y, z));
        let candle = line(dvec2(0.016, 0.005), dvec2(0.014, 0.13));
        self.wax.push(lathe(&candle, 8).moved(x, y, z));
        let flame = points([(0.0, 0.128), (0.0145, 0.148), (0.011, 0.172), (0.0, 0.205)]);
        let flame = flame.map(|at| ProfilePoint { at, normal: None });
        self.flames.push(lathe(&flame, 6).moved(x, y, z));
    }

    fn model(self, comment: &'static str) -> Model {
        Model::new(comment)
            .decimals(4, 2)
            .part("brass", "brass", self.brass)
            .part("candles", "wax", self.wax)
            .part("flames", "flame", self.flames)
    }
}

/// A line without normals: flat between its points.
fn merged(run: &[ProfilePoint]) -> Vec<ProfilePoint> {
    let mut points: Vec<ProfilePoint> = Vec::new();
    for point in run {
        if points.last().is_none_or(|last| last.at != point.at) {
            points.push(ProfilePoint { at: point.at, normal: None });
        }
    }
    points
}

/// A ring of brass about the y axis.
fn hoop(radius: f64, thickness: f64, y: f64) -> Mesh {
    lathe(&arc(dvec2(radius, y), thickness, -180.0, 180.0, 8), 48)
}

/// A straight rod between two points.
fn rod(from: [f64; 3], to: [f64; 3], thickness: f64) -> Mesh {
    let (from, to) = (glam::DVec3::from_array(from), glam::DVec3::from_array(to));
    let tube = lathe(&line(DVec2::new(thickness, 0.0), dvec2(thickness, from.distance(to))), 8);
    let turn = glam::DQuat::from_rotation_arc(glam::DVec3::Y, (to - from).normalize());
    tube.transformed(glam::DAffine3::from_rotation_translation(turn, from))
}

/// A chandelier of three hoops with 80 candles; the origin is the middle of the lowest hoop.
pub fn chandelier() -> Model {
    let mut parts = Parts::default();
    for (radius, y, candles) in [(1.25, 0.0, 40), (0.85, 0.55, 24), (0.48, 1.05, 16)] {
        parts.brass.push(hoop(radius, 0.024, y));
        parts.brass.push(hoop(radius, 0.014, y - 0.1));
        for i in 0..candles {
            let (sin, cos) = (std::f64::consts::TAU * f64::from(i) / f64::from(candles)).sin_cos();
            parts.candle(radius * sin, y + 0.05, radius * cos);
            if i % 3 == 0 {
                let foot = [radius * sin, y - 0.1, radius * cos];
                parts.brass.push(rod(foot, [foot[0], y, foot[2]], 0.008));
            }
            if i % 4 == 0 {
                let rim = [radius * sin, y, radius * cos];
                parts.brass.push(rod(rim, [0.06 * sin, y + 0.15, 0.06 * cos], 0.011));
            }
        }
    }
    let stem = points([
        (0.0, -0.45),
        (0.04, -0.42),
        (0.03, -0.36),
        (0.14, -0.2),
        (0.16, -0.1),
        (0.1, 0.02),
        (0.04, 0.1),
        (0.08, 0.16),
        (0.04, 0.25),
        (0.035, 0.55),
        (0.08, 0.7),
        (0.035, 0.8),
        (0.03, 1.1),
        (0.07, 1.2),
        (0.03, 1.3),
        (0.02, 1.5),
        (0.05, 1.6),
        (0.016, 1.7),
        (0.013, 7.43),
    ]);
    parts.brass.push(lathe(&smooth(&stem, 2), 20));
    parts.model("A chandelier with 80 candles, hung 7.4 above the origin.")
}

/// Three candles on an arm; the wall is the plane z = 0 and the lamp before it.
pub fn wall_lamp() -> Model {
    let mut parts = Parts::default();
    let plate = points([(0.09, 0.0), (0.085, 0.02), (0.04, 0.035), (0.0, 0.05)]);
    parts.brass.push(lathe(&smooth(&plate, 2), 20).turned_x(90.0));
    parts.brass.push(rod([0.0, 0.0, 0.03], [0.0, -0.06, 0.16], 0.011));
    parts.brass.push(rod([-0.17, 0.0, 0.16], [0.17, 0.0, 0.16], 0.009));
    parts.brass.push(rod([0.0, -0.06, 0.16], [0.0, 0.03, 0.16], 0.009));
    for x in [-0.17, 0.0, 0.17] {
        parts.candle(x, 0.035, 0.16);
    }
    parts.model("A wall lamp with three candles, before the plane z = 0.")
}

/// A globe of light on a rod that hangs 0.8 from the ceiling; its middle is the origin.
pub fn pendant() -> Model {
    let globe = sphere(0.09, 6, 12);
    let cap = points([(0.06, 0.072), (0.05, 0.1), (0.012, 0.13), (0.008, 0.2), (0.008, 0.82)]);
    Model::new("A hanging globe of light, its middle at the origin.")
        .decimals(4, 3)
        .part("globe", "globe-light", globe)
        .part("rod", "brass", lathe(&smooth(&cap, 2), 12))
}
