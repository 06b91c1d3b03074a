//! `hall`: a library with a coffered vault, its readers' tables, its books and its thousand
//! candles.

mod books;
mod columns;
mod furniture;
mod lamps;
mod measures;
mod shell;

use super::random::Random;
use super::scene_text::{Folder, Place, SceneText};
use measures::*;

pub fn folder() -> Folder {
    let mut scene = SceneText::new(
        "A library by candlelight: a nave of ten bays under a coffered vault, galleries on both sides,\n\
         bookcases in every alcove. Most of it is copies of few meshes. Lengths are meters.",
    );
    scene.mesh("shell.obj");
    stone(&mut scene);
    bookcases(&mut scene);
    furniture(&mut scene);
    lights(&mut scene);
    settings(&mut scene);
    materials(&mut scene);
    Folder {
        name: "hall",
        files: vec![
            ("scene.toml", scene.text()),
            ("shell.obj", shell::shell().text()),
            ("coffers.obj", shell::vault().text()),
            ("column.obj", columns::column().text()),
            ("baluster.obj", columns::baluster().text()),
            ("bookcase-1.obj", books::bookcase(1).text()),
            ("bookcase-2.obj", books::bookcase(2).text()),
            ("table.obj", furniture::table().text()),
            ("chair.obj", furniture::chair().text()),
            ("reading-lamp.obj", furniture::reading_lamp().text()),
            ("book.obj", furniture::open_book().text()),
            ("globe.obj", furniture::globe().text()),
            ("chandelier.obj", lamps::chandelier().text()),
            ("wall-lamp.obj", lamps::wall_lamp().text()),
            ("pendant.obj", lamps::pendant().text()),
        ],
    }
}

/// The vault, the columns of both floors, and the balusters between the upper ones.
fn stone(scene: &mut SceneText) {
    let rings = (2.0 * END / shell::COFFER).round() as usize;
    for i in 0..rings {
        let z = shell::COFFER * i as f64 - END;
        scene.copy("coffers.obj", None, Place::at(0.0, SPRINGING, z));
    }
    let upper = (ENTABLATURE - GALLERY_FLOOR + 0.004) / GALLERY;
    for side in [-1.0, 1.0] {
        for i in 0..=BAYS {
            let z = BAY * i as f64 - END;
            scene.copy("column.obj", Some("stone"), Place::at(side * NAVE, 0.0, z));
            let place = Place::at(side * NAVE, GALLERY_FLOOR, z).scaled(0.84, upper, 0.84);
            scene.copy("column.obj", Some("stone"), place);
        }
        for i in 0..BAYS {
            for k in 0..14 {
                let z = bay(i) + 0.245 * (f64::from(k) - 6.5);
                let place = Place::at(side * NAVE, GALLERY_FLOOR + 0.12, z);
                scene.copy("baluster.obj", Some("stone"), place);
            }
        }
    }
}

/// Three bookcases in each alcove: on both partitions and on the outer wall.
fn bookcases(scene: &mut SceneText) {
    let mut random = Random(7);
    let mut put = |place: Place| {
        let file = ["bookcase-1.obj", "bookcase-2.obj"][random.below(2)];
        scene.copy(file, None, place);
    };
    let x = 0.5 * (PARTITION + WALL);
    for (y, height) in [(0.0, 1.14), (GALLERY_FLOOR, 1.0)] {
        for side in [-1.0, 1.0] {
            for i in 0..BAYS {
                // From the middle of the bay to what the bookcases lean on.
                let wall = |end: bool| 0.5 * BAY - 0.002 - if end { 0.0 } else { PARTITION_HALF };
                let (far, near) = (bay(i) - wall(i == 0), bay(i) + wall(i + 1 == BAYS));
                put(Place::at(side * x, y, far).scaled(1.0, height, 1.0));
                put(Place::at(side * x, y, near).turned(180.0).scaled(1.0, height, 1.0));
                let back = Place::at(side * (WALL - 0.002), y, bay(i)).turned(-90.0 * side);
                put(back.scaled(1.0, height, 1.0));
            }
        }
    }
}

/// Two rows of tables with chairs, lamps and books, and the globe in the apse.
fn furniture(scene: &mut SceneText) {
    let mut random = Random(3);
    scene.copy("globe.obj", None, Place::at(0.0, 0.0, -END - 0.7));
    for side in [-1.0, 1.0] {
        for i in 0..BAYS {
            let (x, z) = (2.75 * side, bay(i));
            scene.copy("table.obj", None, Place::at(x, 0.0, z));
            for (dx, turn) in [(-0.74, 90.0), (0.74, -90.0)] {
                for dz in [-0.82, 0.0, 0.82] {
                    let away = 1.0 + random.between(-0.05, 0.25);
                    let place = Place::at(x + dx * away, 0.0, z + dz + random.between(-0.05, 0.05));
                    let turn = turn + random.between(-12.0, 12.0);
                    scene.copy("chair.obj", None, place.turned(turn));
                    if random.below(3) == 0 {
                        let place = Place::at(x + 0.36 * dx, 0.7625, z + dz);
                        let turn = 90.0 + random.between(-20.0, 20.0);
                        scene.copy("book.obj", None, place.turned(turn));
                    }
                }
            }
            for dz in [-0.42, 0.42] {
                let place = Place::at(x, 0.7625, z + dz).turned(90.0);
                scene.copy("reading-lamp.obj", None, place);
            }
        }
    }
}

fn lights(scene: &mut SceneText) {
    for i in 0..BAYS {
        scene.copy(
            "chandelier.obj",
            None,
            Place::at(0.0, 7.6, bay(i)).turned(4.5 * (i % 2) as f64),
        );
    }
    for side in [-1.0, 1.0] {
        for i in 1..BAYS {
            let z = BAY * i as f64 - END;
            for (x, y) in [(NAVE - 0.285, 2.5), (NAVE - 0.235, 7.15)] {
                scene.copy("wall-lamp.obj", None, Place::at(side * x, y, z).turned(-90.0 * side));
            }
        }
        for i in 0..BAYS {
            for ceiling in [GALLERY, ENTABLATURE] {
                scene.copy("pendant.obj", None, Place::at(side * 7.3, ceiling - 0.8, bay(i)));
            }
        }
        for (x, y) in [(4.1, 2.5), (4.1, 7.15)] {
            scene.copy("wall-lamp.obj", None, Place::at(side * x, y, -END));
        }
        // From the cornice onto the globe, and along the ceiling of the apse.
        let spot = format!(
            "type = \"spot\", position = [{}, 8.6, {}], target = [0, 1.75, {}], outer_deg = 14, \
             intensity = [260, 210, 150]",
            1.2 * side,
            4.0 - END,
            -END - 0.7
        );
        scene.light(&spot);
    }
    let glow =
        format!("type = \"point\", position = [0, 2.9, {}], intensity = [5, 3.6, 2]", -END - 2.4);
    scene.light(&glow);
}

fn settings(scene: &mut SceneText) {
    scene.table(
        "camera",
        &["position = [-0.9, 2.7, 20.2]", "direction = [0.035, 0.06, -1]", "fov_y_deg = 62"],
    );
    scene.table(
        "render",
        &[
            "resolution = [720, 480]",
            "light_paths = 500000",
            "camera_paths = 2",
            "radius = 0.04",
            "merge_vertex = 2",
            "direct = \"connect\"",
        ],
    );
    scene.table("regions", &["vault = [[0.3, 0, 0.7, 0.25]]", "floor = [[0.35, 0.75, 0.65, 1]]"]);
}

fn materials(scene: &mut SceneText) {
    for (name, albedo) in [
        ("plaster", [0.7, 0.63, 0.51]),
        ("stone", [0.72, 0.66, 0.56]),
        ("vault", [0.78, 0.73, 0.64]),
        ("azure", [0.1, 0.2, 0.36]),
        ("walnut", [0.24, 0.115, 0.055]),
        ("green-leather", [0.05, 0.16, 0.09]),
        ("oxblood", [0.36, 0.06, 0.04]),
        ("moss", [0.09, 0.17, 0.07]),
        ("navy", [0.06, 0.1, 0.22]),
        ("tan", [0.5, 0.3, 0.13]),
        ("umber", [0.2, 0.1, 0.05]),
        ("parchment", [0.75, 0.66, 0.47]),
        ("wax", [0.8, 0.74, 0.6]),
    ] {
        let line = format!("albedo = {}", super::scene_text::vector(albedo));
        scene.table(&format!("materials.{name}"), &[&line]);
    }
    for (name, albedo) in [
        ("marble-light", "[0.7, 0.64, 0.53]"),
        ("marble-dark", "[0.2, 0.075, 0.05]"),
        ("polished-walnut", "[0.26, 0.12, 0.055]"),
        ("green-glass", "[0.02, 0.22, 0.1]"),
        ("globe", "[0.16, 0.3, 0.34]"),
    ] {
        let albedo = format!("albedo = {albedo}");
        scene.table(&format!("materials.{name}"), &["type = \"coated\"", &albedo]);
    }
    for (name, reflectance) in [("brass", "[0.85, 0.62, 0.3]"), ("gilt", "[0.95, 0.7, 0.34]")] {
        let reflectance = format!("reflectance = {reflectance}");
        let metal = ["type = \"metal\"", &reflectance, "roughness = 0.6"];
        scene.table(&format!("materials.{name}"), &metal);
    }
    for (name, emission) in
        [("flame", "[175, 122, 72]"), ("bulb", "[90, 66, 38]"), ("globe-light", "[75, 56, 35]")]
    {
        let emission = format!("emission = {emission}");
        scene.table(&format!("materials.{name}"), &["albedo = 0", &emission]);
    }
}
