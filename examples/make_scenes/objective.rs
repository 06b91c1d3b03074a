//! `objective`: chessmen on a board and lamps far behind them, on a sensor behind the six elements of
//! a double Gauss.
//!
//! Meters; the lens's first vertex is the origin and looks along -z.

use crate::chessmen::{pawn, queen};
use crate::lens::{DOUBLE_GAUSS, depths, glass, mounts};
use crate::mesh::Mesh;
use crate::obj::{Model, number};
use crate::scene_text::{Folder, Place, SceneText};
use crate::shapes::{Side, cuboid, cuboid_without, sphere};
use glam::{DVec3, dvec3};
use std::collections::BTreeMap;

/// Sharp at this distance before the first vertex.
const FOCUS: f64 = 0.6;
/// From the last vertex to the sensor, millimeters: the paraxial image of `FOCUS`, which the tests
/// compare with exact rays.
const SENSOR: f64 = 40.76;
/// Inner radius of the lens's tube, millimeters.
const TUBE: f64 = 14.0;

/// Heights of the table and of the board on it.
const TABLE: f64 = -0.105;
const BOARD: f64 = -0.085;
/// Side of a square of the board.
const SQUARE: f64 = 0.055;

pub fn folder() -> Folder {
    let mut scene = SceneText::new(
        "Chessmen and lamps through a real lens: double Gauss, 50 mm, f/2 (US patent 2,673,491),\n\
         wide open, focused on the glass queen at 0.6 m.",
    );
    let mut lens = Model::new("Double Gauss, millimeters; the scene is at -z.").decimals(4, 5);
    let mut media = BTreeMap::new();
    for (i, interface) in glass(&DOUBLE_GAUSS).into_iter().enumerate() {
        let name = format!("n{:.0}", 1000.0 * interface.inside);
        let name = match interface.outside {
            1.0 => name,
            outside => format!("{name}-in-n{:.0}", 1000.0 * outside),
        };
        lens = lens.part(format!("lens-{i}"), &name, interface.mesh);
        media.insert(name, [interface.inside, interface.outside]);
    }
    let sensor = depths(&DOUBLE_GAUSS)[DOUBLE_GAUSS.len() - 1] + SENSOR;
    lens = lens.part("lens-mounts", "black", mounts(&DOUBLE_GAUSS, TUBE, sensor + 1.0));

    scene.copy("lens.obj", None, Place::at(0.0, 0.0, 0.0).scaled(1e-3, 1e-3, 1e-3));
    scene.mesh("room.obj");
    men(&mut scene);
    lamps(&mut scene);
    scene.light(
        "type = \"spot\", position = [-0.5, 0.5, -1.2], target = [0.02, -0.06, -0.58], \
         outer_deg = 20, inner_deg = 14, intensity = 6",
    );
    camera(&mut scene, sensor);
    scene.table(
        "render",
        &["resolution = [480, 320]", "radius = 0.005", "merge_vertex = 2", "direct = \"connect\""],
    );
    for (name, [inside, outside]) in media {
        let mut lines = vec!["type = \"dielectric\"".to_owned(), format!("ior = {inside}")];
        if outside != 1.0 {
            lines.push(format!("outside_ior = {outside}"));
        }
        let lines: Vec<&str> = lines.iter().map(String::as_str).collect();
        scene.table(&format!("materials.{name}"), &lines);
    }
    for (name, lines) in MATERIALS {
        scene.table(&format!("materials.{name}"), lines);
    }
    let centimeters = |comment| Model::new(comment).decimals(3, 4);
    let bulb = Model::new("A ball of radius 1.").plain("bulb", sphere(1.0, 8, 16));
    Folder {
        name: "objective",
        files: vec![
            ("scene.toml", scene.text()),
            ("lens.obj", lens.text()),
            ("room.obj", room().text()),
            ("pawn.obj", centimeters("A pawn, centimeters.").plain("pawn", pawn()).text()),
            ("queen.obj", centimeters("A queen, centimeters.").plain("queen", queen()).text()),
            ("bulb.obj", bulb.text()),
        ],
    }
}

const MATERIALS: &[(&str, &[&str])] = &[
    ("black", &["albedo = 0"]),
    ("wall", &["albedo = [0.16, 0.2, 0.28]"]),
    ("table", &["albedo = [0.22, 0.11, 0.06]"]),
    ("light-square", &["type = \"coated\"", "albedo = [0.75, 0.6, 0.4]"]),
    ("dark-square", &["type = \"coated\"", "albedo = [0.2, 0.075, 0.035]"]),
    ("glass", &["type = \"dielectric\"", "ior = 1.52"]),
    ("ivory", &["type = \"coated\"", "albedo = [0.8, 0.72, 0.55]"]),
    ("red", &["type = \"coated\"", "albedo = [0.55, 0.04, 0.03]"]),
    ("silver", &["type = \"metal\"", "metal = \"silver\""]),
    ("panel", &["albedo = 0", "emission = [8, 8.5, 10]"]),
    ("amber", &["albedo = 0", "emission = [70, 30, 6]"]),
    ("warm", &["albedo = 0", "emission = [60, 42, 22]"]),
    ("rose", &["albedo = 0", "emission = [60, 16, 20]"]),
    ("blue", &["albedo = 0", "emission = [14, 30, 70]"]),
];

/// The sensor, millimeters behind the first vertex.
fn camera(scene: &mut SceneText, sensor: f64) {
    let last = DOUBLE_GAUSS[DOUBLE_GAUSS.len() - 1];
    let meters = |millimeters: f64| number(1e-3 * millimeters, 7);
    scene.table(
        "camera",
        &[
            "type = \"sensor\"",
            &format!("position = [0, 0, {}]", meters(sensor)),
            "direction = [0, 0, -1]",
            "sensor_width = 0.036",
            // The plane of the last rim: what the glass before it bulges out is crossed on the way.
            &format!("disc_distance = {}", meters(SENSOR - last.sag())),
            &format!("disc_radius = {}", meters(0.5 * last.diameter)),
            "exposure = 1",
        ],
    );
}

/// The chessmen on their squares, columns and rows from the board's middle.
fn men(scene: &mut SceneText) {
    for (file, material, column, row) in [
        ("queen.obj", "glass", 0.5, 0.5),
        ("pawn.obj", "red", -1.5, -2.5),
        ("pawn.obj", "silver", 2.5, 1.5),
        ("queen.obj", "ivory", -1.5, 2.5),
        ("pawn.obj", "red", 1.5, 3.5),
        ("pawn.obj", "ivory", -3.5, 3.5),
    ] {
        let square = on_board(column, row);
        // Felt, rather than two surfaces in one place.
        let place = Place::at(square.x, square.y + 2e-4, square.z).scaled(0.01, 0.01, 0.01);
        scene.copy(file, Some(material), place);
    }
}

/// Three strings of bulbs behind the board.
fn lamps(scene: &mut SceneText) {
    let colors = ["amber", "warm", "rose", "warm", "blue"];
    for string in 0..3 {
        for i in 0..7 {
            let (s, x) = (f64::from(string), f64::from(i) - 3.0);
            let x = 0.34 * x + 0.13 * s - 0.1;
            let place = Place::at(x, 0.04 + 0.17 * s + 0.12 * x * x, -2.3 - 0.7 * s);
            let color = colors[(2 * string + i) as usize % colors.len()];
            scene.copy("bulb.obj", Some(color), place.scaled(0.02, 0.02, 0.02));
        }
    }
}

/// A corner of squares of the board, in squares from its middle, rows away from the lens. The glass
/// queen's square is in focus.
fn on_board(column: f64, row: f64) -> DVec3 {
    dvec3(column * SQUARE, BOARD, -FOCUS - (row - 0.5) * SQUARE)
}

fn room() -> Model {
    let table = cuboid_without(dvec3(-0.8, -0.8, -1.5), dvec3(0.8, TABLE, -0.25), &[Side::Bottom]);
    let (near, far) = (on_board(-4.0, -4.0), on_board(4.0, 4.0));
    let edge = cuboid_without(
        dvec3(near.x - 0.01, TABLE, far.z - 0.01),
        dvec3(far.x + 0.01, BOARD - 1e-4, near.z + 0.01),
        &[Side::Bottom],
    );
    let squares = |color: i32| {
        let all = (0..64).filter(|i| (i % 8 + i / 8) % 2 == color);
        Mesh::join(all.map(|i| {
            let (x, y) = (f64::from(i % 8) - 4.0, f64::from(i / 8) - 4.0);
            let corners = [(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)];
            Mesh::polygon(&corners.map(|(u, v)| on_board(x + u, y + v)))
        }))
    };
    let (x, y, z) = (-0.7, 1.5, 0.4);
    let panel = Mesh::polygon(&[
        dvec3(x - 0.3, y, z - 0.3),
        dvec3(x + 0.3, y, z - 0.3),
        dvec3(x + 0.3, y, z + 0.3),
        dvec3(x - 0.3, y, z + 0.3),
    ]);
    Model::new("A closed room with a table, a chessboard and a lamp, meters.")
        .part("walls", "wall", cuboid(dvec3(-1.8, -0.8, -4.5), dvec3(1.8, 1.6, 1.0)).flipped())
        .part("table", "table", table)
        .part("board", "dark-square", edge)
        .part("light-squares", "light-square", squares(0))
        .part("dark-squares", "dark-square", squares(1))
        .part("panel", "panel", panel)
}
