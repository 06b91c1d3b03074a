//! Furniture of readers: tables, chairs, lamps with green shades, books that lie about, and a
//! globe.

use super::super::mesh::Mesh;
use super::super::obj::Model;
use super::super::profile::{edges, smooth};
use super::super::shapes::{Side, annulus, cuboid, cuboid_without, lathe, sphere};
use glam::{DVec2, DVec3, dvec2, dvec3};

fn points<const N: usize>(points: [(f64, f64); N]) -> [DVec2; N] {
    points.map(|(x, y)| dvec2(x, y))
}

fn block(min: [f64; 3], max: [f64; 3]) -> Mesh {
    cuboid(DVec3::from_array(min), DVec3::from_array(max))
}

/// A leg turned like a baluster, from y = 0 to `height`.
fn leg(height: f64, width: f64) -> Mesh {
    let line = points([
        (0.3, 0.0),
        (0.5, 0.06),
        (0.32, 0.12),
        (0.42, 0.2),
        (0.5, 0.42),
        (0.42, 0.62),
        (0.3, 0.72),
        (0.46, 0.77),
        (0.3, 0.81),
        (0.45, 0.87),
    ]);
    let turned = lathe(&smooth(&line, 2), 12).scaled(width, height, width);
    let half = 0.5 * width;
    let min = dvec3(-half, 0.86 * height, -half);
    Mesh::join([turned, cuboid_without(min, dvec3(half, height, half), &[Side::Top])])
}

/// A table for six: 1.1 wide, 2.6 long along z, 0.76 high.
pub fn table() -> Model {
    let top = block([-0.55, 0.73, -1.3], [0.55, 0.76, 1.3]);
    let leather = Mesh::polygon(&[
        dvec3(-0.47, 0.762, 1.22),
        dvec3(0.47, 0.762, 1.22),
        dvec3(0.47, 0.762, -1.22),
        dvec3(-0.47, 0.762, -1.22),
    ]);
    let apron = block([-0.46, 0.61, -1.21], [0.46, 0.7305, 1.21]);
    let places =
        [(-0.45, -1.2), (0.45, -1.2), (-0.45, 1.2), (0.45, 1.2), (-0.45, 0.0), (0.45, 0.0)];
    let legs = places.map(|(x, z)| leg(0.731, 0.1).moved(x, 0.0, z));
    let wood = Mesh::join([Mesh::join([top, apron]), Mesh::join(legs)]);
    Model::new("A reading table for six, 1.1 by 2.6.")
        .decimals(3, 2)
        .part("wood", "polished-walnut", wood)
        .part("leather", "green-leather", leather)
}

/// A chair whose sitter looks toward +z.
pub fn chair() -> Model {
    let front = [-0.19, 0.19].map(|x| leg(0.44, 0.05).moved(x, 0.0, 0.18));
    let post = smooth(
        &points([
            (0.016, 0.0),
            (0.024, 0.1),
            (0.02, 0.3),
            (0.026, 0.44),
            (0.018, 0.55),
            (0.022, 0.75),
            (0.016, 0.93),
            (0.026, 0.96),
            (0.018, 0.985),
            (0.022, 1.01),
            (0.0, 1.04),
        ]),
        2,
    );
    let back = [-0.19, 0.19].map(|x| lathe(&post, 12).moved(x, 0.0, -0.2));
    let spindle = smooth(
        &points([(0.008, 0.45), (0.013, 0.56), (0.008, 0.62), (0.012, 0.68), (0.008, 0.86)]),
        2,
    );
    let spindles =
        [-0.11, -0.055, 0.0, 0.055, 0.11].map(|x| lathe(&spindle, 8).moved(x, 0.0, -0.2));
    let seat = block([-0.22, 0.43, -0.225], [0.22, 0.455, 0.22]);
    let crest = block([-0.19, 0.85, -0.213], [0.19, 0.94, -0.187]);
    let stretchers = [
        block([-0.185, 0.17, -0.2], [-0.165, 0.19, 0.18]),
        block([0.165, 0.17, -0.2], [0.185, 0.19, 0.18]),
        block([-0.166, 0.172, -0.02], [0.166, 0.188, 0.0]),
    ];
    // Leather over a cushion with round edges.
    let half = points([(0.2, 0.0), (0.207, 0.018), (0.19, 0.034), (0.1, 0.044), (0.0, 0.046)]);
    let cushion = lathe(&smooth(&half, 2), 20).moved(0.0, 0.454, 0.0);
    let wood = [front, back].into_iter().flatten().chain(spindles).chain([seat, crest]);
    Model::new("A chair whose sitter looks toward +z.")
        .decimals(3, 2)
        .part("wood", "walnut", Mesh::join(wood.chain(stretchers)))
        .part("cushion", "oxblood", cushion)
}

/// A reading lamp of brass with a shade of green glass, thought opaque, and its bulb below.
pub fn reading_lamp() -> Model {
    let foot = points([
        (0.095, 0.0),
        (0.09, 0.02),
        (0.03, 0.035),
        (0.012, 0.07),
        (0.011, 0.2),
        (0.018, 0.23),
        (0.011, 0.26),
        (0.01, 0.4),
        (0.0, 0.41),
    ]);
    let shade = points([(0.13, 0.33), (0.122, 0.37), (0.09, 0.41), (0.04, 0.43), (0.012, 0.435)]);
    let bulb = Mesh::join([-0.05, 0.05].map(|x| sphere(0.022, 4, 8).moved(x, 0.375, 0.0)));
    Model::new("A reading lamp, 0.43 high.")
        .decimals(4, 2)
        .part("foot", "brass", lathe(&smooth(&foot, 2), 16))
        .part("shade", "green-glass", lathe(&smooth(&shade, 3), 24))
        .part("bulbs", "bulb", bulb)
}

/// A book that lies open at its middle, 0.44 wide.
pub fn open_book() -> Model {
    let page = |side: f64| {
        Mesh::patch(6, 1, |u, v| {
            let (x, z) = (0.21 * u, 0.15 - 0.3 * v);
            let y = 0.012 + 0.03 * (6.0 * u).min(1.0).sqrt() * (1.0 - 0.75 * u);
            super::super::mesh::Vertex::flat(dvec3(side * x, y, z))
        })
    };
    let edge = |z: f64| {
        let top = (0..=6).map(|i| {
            let u = f64::from(i) / 6.0;
            let y = 0.012 + 0.03 * (6.0 * u).min(1.0).sqrt() * (1.0 - 0.75 * u);
            dvec3(0.21 * u, y, z)
        });
        Mesh::polygon(&[vec![dvec3(0.21, 0.006, z), dvec3(0.0, 0.006, z)], top.collect()].concat())
    };
    let right = Mesh::join([page(1.0), edge(0.15)]);
    let cover = block([-0.22, 0.0005, -0.157], [0.22, 0.007, 0.157]);
    Model::new("An open book, 0.44 wide.")
        .decimals(4, 3)
        .part("pages", "parchment", Mesh::join([right.clone(), right.scaled(-1.0, 1.0, 1.0)]))
        .part("cover", "oxblood", cover)
}

/// A globe of radius 0.8 on a stand, 2.6 high, and a ring of marble in the floor around it.
pub fn globe() -> Model {
    let foot = points([
        (0.55, 0.0),
        (0.55, 0.1),
        (0.42, 0.16),
        (0.2, 0.22),
        (0.12, 0.34),
        (0.17, 0.44),
        (0.1, 0.56),
        (0.09, 0.64),
        (0.2, 0.74),
        (0.0, 0.82),
    ]);
    let meridian = points([(0.84, 0.02), (0.84, -0.02), (0.92, -0.02), (0.92, 0.02), (0.84, 0.02)]);
    let meridian = edges(&meridian).into_iter().map(|run| lathe(&run, 64).turned_x(90.0));
    let horizon =
        smooth(&points([(0.95, -0.03), (1.1, -0.03), (1.12, 0.0), (1.1, 0.03), (0.95, 0.03)]), 2);
    let axis = |mesh: Mesh| mesh.turned_z(23.4).moved(0.0, 1.75, 0.0);
    Model::new("A globe of radius 0.8 on its stand.")
        .decimals(3, 3)
        .part("foot", "polished-walnut", lathe(&smooth(&foot, 3), 40))
        .part("horizon", "polished-walnut", lathe(&horizon, 64).moved(0.0, 1.75, 0.0))
        .part("meridian", "brass", axis(Mesh::join(meridian)))
        .part("inlay", "marble-dark", annulus(1.3, 1.5, 64).moved(0.0, 0.003, 0.0))
        .part("globe", "globe", axis(sphere(0.8, 32, 64)))
}
