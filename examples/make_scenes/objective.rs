//! `objective`: chessmen on a board and lamps far behind them, on a sensor behind the six elements
//! of a double Gauss.
//!
//! Meters; the lens's first vertex is the origin and looks along -z.

use super::chessmen::{pawn, queen};
use super::lens::{DOUBLE_GAUSS, depths, glass, mounts};
use super::mesh::Mesh;
use super::obj::{Model, number};
use super::scene_text::{Folder, Place, SceneText};
use super::shapes::{Side, cuboid, cuboid_without, disc};
use glam::{DVec3, dvec3};
use std::collections::BTreeMap;

/// Sharp at this distance before the first vertex.
const FOCUS: f64 = 0.5;
/// From the last vertex to the sensor, millimeters: the paraxial image of `FOCUS`, which the tests
/// compare with exact rays.
const SENSOR: f64 = 41.469;
/// Inner radii of the lens's tube and of the camera's body, millimeters: the picture's corners are
/// 21.6 off the axis.
const TUBE: f64 = 14.0;
const BODY: f64 = 24.0;

/// Heights of the table and of the board on it.
const TABLE: f64 = -0.095;
const BOARD: f64 = -0.075;
/// Side of a square of the board.
const SQUARE: f64 = 0.055;

pub fn folder() -> Folder {
    let mut scene = SceneText::new(
        "Chessmen and lamps through a real lens: double Gauss, 50 mm, f/2 (US patent 2,673,491),\n\
         wide open, focused on the glass queen at 0.5 m.",
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
    lens = lens.part("lens-mounts", "black", mounts(&DOUBLE_GAUSS, TUBE, BODY, sensor + 1.0));

    scene.copy("lens.obj", None, Place::at(0.0, 0.0, 0.0).scaled(1e-3, 1e-3, 1e-3));
    scene.mesh("room.obj");
    men(&mut scene);
    lamps(&mut scene);
    scene.light(
        "type = \"spot\", position = [-0.75, 0.5, -0.75], target = [0, -0.06, -0.5], \
         outer_deg = 15, inner_deg = 9, intensity = 6",
    );
    camera(&mut scene, sensor);
    scene.table(
        "render",
        &[
            "resolution = [360, 240]",
            "light_paths = 20000",
            "radius = 0.005",
            "merge_vertex = 2",
            "direct = \"connect\"",
        ],
    );
    scene.table(
        "regions",
        &["queen = [[0.5, 0.43, 0.66, 0.87]]", "lamps = [[0.02, 0.12, 0.98, 0.52]]"],
    );
    for (name, [inside, outside]) in media {
        let mut lines = vec!["type = \"dielectric\"".to_owned(), format!("ior = {inside}")];
        if outside != 1.0 {
            lines.push(format!("outside_ior = {outside}"));
        }
        let lines: Vec<&str> = lines.iter().map(String::as_str).collect();
        scene.table(&format!("materials.{name}"), &lines);
    }
    for (i, [red, green, blue]) in DUSK.into_iter().enumerate() {
        let emission = format!("emission = [{red}, {green}, {blue}]");
        scene.table(&format!("materials.dusk-{i}"), &["albedo = 0", &emission]);
    }
    for (name, lines) in MATERIALS {
        scene.table(&format!("materials.{name}"), lines);
    }
    let centimeters = |comment| Model::new(comment).decimals(3, 4);
    let lamp = disc(1.0, 16).turned_x(90.0);
    let lamp = Model::new("A disc of radius 1 that faces +z.").plain("lamp", lamp);
    Folder {
        name: "objective",
        files: vec![
            ("scene.toml", scene.text()),
            ("lens.obj", lens.text()),
            ("room.obj", room().text()),
            ("pawn.obj", centimeters("A pawn, centimeters.").plain("pawn", pawn()).text()),
            ("queen.obj", centimeters("A queen, centimeters.").plain("queen", queen()).text()),
            ("lamp.obj", lamp.text()),
        ],
    }
}

const MATERIALS: &[(&str, &[&str])] = &[
    ("black", &["albedo = 0"]),
    ("wall", &["albedo = 0.4"]),
    ("table", &["albedo = [0.22, 0.11, 0.06]"]),
    ("light-square", &["albedo = [0.75, 0.62, 0.44]"]),
    ("dark-square", &["albedo = [0.2, 0.085, 0.045]"]),
    ("glass", &["type = \"dielectric\"", "ior = 1.52"]),
    ("ivory", &["type = \"coated\"", "albedo = [0.8, 0.72, 0.55]"]),
    ("lacquer", &["type = \"coated\"", "albedo = [0.55, 0.04, 0.03]"]),
    ("silver", &["type = \"metal\"", "metal = \"silver\""]),
    ("softbox", &["albedo = 0", "emission = [4, 3.7, 3.3]"]),
    ("amber", &["albedo = 0", "emission = [3.6, 1.6, 0.3]"]),
    ("warm", &["albedo = 0", "emission = [2.9, 2.1, 1.1]"]),
    ("red", &["albedo = 0", "emission = [3, 0.55, 0.4]"]),
    ("teal", &["albedo = 0", "emission = [0.55, 1.9, 2]"]),
];

/// Radiance of the sky, from the horizon up.
const DUSK: [[f64; 3]; 8] = [
    [0.42, 0.2, 0.1],
    [0.4, 0.2, 0.12],
    [0.34, 0.18, 0.14],
    [0.27, 0.16, 0.16],
    [0.2, 0.14, 0.18],
    [0.15, 0.12, 0.19],
    [0.11, 0.1, 0.18],
    [0.08, 0.09, 0.17],
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
            "exposure = 0.7",
        ],
    );
}

/// The chessmen on their squares, columns and rows from the board's middle.
fn men(scene: &mut SceneText) {
    for (file, material, column, row) in [
        ("queen.obj", "glass", 0.5, 0.5),
        ("pawn.obj", "lacquer", -1.5, -2.5),
        ("pawn.obj", "silver", 2.5, 1.5),
        ("queen.obj", "ivory", -1.5, 2.5),
        ("pawn.obj", "lacquer", 1.5, 3.5),
        ("pawn.obj", "ivory", -3.5, 3.5),
    ] {
        let square = on_board(column, row);
        // Felt, rather than two surfaces in one place.
        let place = Place::at(square.x, square.y + 2e-4, square.z).scaled(0.01, 0.01, 0.01);
        scene.copy(file, Some(material), place);
    }
}

/// Three strings of lamps, flat: out of focus that is hard to tell behind the board.
fn lamps(scene: &mut SceneText) {
    let colors = ["amber", "teal", "warm", "amber", "red"];
    for string in 0..3 {
        for i in 0..5 {
            let (s, x) = (f64::from(string), f64::from(i) - 2.0);
            let x = 0.25 * x + 0.1 * s - 0.11;
            let place = Place::at(x, 0.05 + 0.11 * s + 0.13 * x * x, -1.6 - 0.3 * s);
            let color = colors[(2 * string + i) as usize % colors.len()];
            scene.copy("lamp.obj", Some(color), place.scaled(0.019, 0.019, 0.019));
        }
    }
}

/// A corner of squares of the board, in squares from its middle, rows away from the lens. The glass
/// queen's square is in focus.
fn on_board(column: f64, row: f64) -> DVec3 {
    dvec3(column * SQUARE, BOARD, -FOCUS - (row - 0.5) * SQUARE)
}

fn room() -> Model {
    let table = cuboid_without(dvec3(-0.8, -0.8, -1.4), dvec3(0.8, TABLE, -0.25), &[Side::Bottom]);
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
    let (softbox, toward) = (dvec3(-0.35, 0.5, 0.05), on_board(0.0, 0.0));
    let (right, up) = (toward - softbox).normalize().any_orthonormal_pair();
    let corner = |(u, v): (f64, f64)| softbox + 0.12 * (u * right + v * up);
    let softbox = Mesh::polygon(&[(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)].map(corner));
    let mut room = Model::new("A closed room with a table, a chessboard, a lamp and dusk, meters.")
        .part("walls", "wall", cuboid(dvec3(-1.8, -0.8, -2.6), dvec3(1.8, 1.6, 1.0)).flipped())
        .part("table", "table", table)
        .part("board", "dark-square", edge)
        .part("light-squares", "light-square", squares(0))
        .part("dark-squares", "dark-square", squares(1))
        .part("softbox", "softbox", softbox);
    for i in 0..DUSK.len() {
        let (x, z) = (1.0, -2.59);
        let [low, high] = [i, i + 1].map(|i| 0.115 * i as f64 - 0.28);
        let corners = [dvec3(-x, low, z), dvec3(x, low, z), dvec3(x, high, z), dvec3(-x, high, z)];
        room = room.part(format!("sky-{i}"), format!("dusk-{i}"), Mesh::polygon(&corners));
    }
    room
}
