//! Turned stone: columns and balusters.

use super::super::mesh::Mesh;
use super::super::obj::Model;
use super::super::profile::{arc, line, smooth};
use super::super::shapes::{Side, cuboid_without, lathe};
use super::measures::GALLERY;
use glam::{dvec2, dvec3};

/// A Tuscan column that carries the gallery: as high as the gallery's underside, and a little into
/// it.
pub fn column() -> Model {
    let top = GALLERY + 0.005;
    let block = |half: f64, from: f64, to: f64, missing: &[Side]| {
        cuboid_without(dvec3(-half, from, -half), dvec3(half, to, half), missing)
    };
    let round = |profile: &[super::super::profile::ProfilePoint]| lathe(profile, 28);
    // A torus below; the shaft's swelling; a ring and the echinus above.
    let foot = arc(dvec2(0.33, 0.27), 0.07, -90.0, 90.0, 6);
    let flare = arc(dvec2(0.385, 0.42), 0.08, 270.0, 180.0, 4);
    let shaft = [(0.305, 0.42), (0.304, 1.4), (0.291, 2.6), (0.268, 3.5), (0.256, 3.92)];
    let shaft = smooth(&shaft.map(|(x, y)| dvec2(x, y)), 3);
    let collar = arc(dvec2(0.296, 3.92), 0.04, 180.0, 90.0, 3);
    let ring = arc(dvec2(0.265, 4.0), 0.035, -90.0, 90.0, 5);
    let neck = line(dvec2(0.262, 4.035), dvec2(0.262, 4.17));
    let bowl = arc(dvec2(0.262, 4.29), 0.12, -90.0, 0.0, 5);
    Model::new("A Tuscan column, 4.5 high.")
        .decimals(3, 3)
        .plain("plinth", block(0.41, 0.0, 0.2, &[Side::Bottom]))
        .plain("base", round(&foot))
        .plain("shaft", Mesh::join([flare, shaft, collar].map(|run| round(&run))))
        .plain("ring", round(&ring))
        .plain("neck", round(&neck))
        .plain("echinus", round(&bowl))
        .plain("abacus", block(0.4, 4.29, top, &[Side::Top]))
}

/// A baluster between the rails of the gallery, 0.74 high.
pub fn baluster() -> Model {
    let low = cuboid_without(dvec3(-0.07, -0.005, -0.07), dvec3(0.07, 0.06, 0.07), &[Side::Bottom]);
    let high =
        cuboid_without(dvec3(-0.065, 0.68, -0.065), dvec3(0.065, 0.745, 0.065), &[Side::Top]);
    let line = [
        (0.055, 0.059),
        (0.062, 0.085),
        (0.035, 0.11),
        (0.05, 0.16),
        (0.078, 0.23),
        (0.072, 0.31),
        (0.045, 0.42),
        (0.03, 0.53),
        (0.033, 0.59),
        (0.05, 0.61),
        (0.036, 0.635),
        (0.055, 0.681),
    ];
    let turned = lathe(&smooth(&line.map(|(x, y)| dvec2(x, y)), 2), 16);
    Model::new("A baluster, 0.74 high.")
        .decimals(3, 2)
        .plain("baluster", Mesh::join([low, turned, high]))
}
