//! `point-caustic`: a still life of glass and gold under a single point of light.
//!
//! The lamp is a point, so no path from the camera can hit it, and glass stops shadow rays: every
//! caustic comes from light paths alone.

mod things;

use super::mesh::Mesh;
use super::obj::Model;
use super::scene_text::{Folder, Place, SceneText};
use super::shapes::sphere;
use glam::dvec3;

pub fn folder() -> Folder {
    let ball = Model::new("A ball of radius 1, smooth normals.").decimals(5, 5);
    let ball = ball.plain("ball", sphere(1.0, 32, 64));
    Folder {
        name: "point-caustic",
        files: vec![
            ("scene.toml", text()),
            ("room.obj", room().text()),
            ("goblet.obj", things::goblet().text()),
            ("ring.obj", things::ring().text()),
            ("gem.obj", things::gem().text()),
            ("ball.obj", ball.text()),
        ],
    }
}

/// A closed box, its fronts inward: 8 wide, 5 high, 9 deep. The camera is inside.
fn room() -> Model {
    let at = |i: usize| {
        let pick = |bit, low, high| if i & bit == 0 { low } else { high };
        dvec3(pick(1, -4.0, 4.0), pick(2, 0.0, 5.0), pick(4, -3.5, 5.5))
    };
    let side = |corners: [usize; 4]| Mesh::polygon(&corners.map(at));
    let walls = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 2, 6, 4], [1, 5, 7, 3], [2, 3, 7, 6]];
    Model::new("A closed room, fronts inward.").part("table", "table", side([0, 4, 5, 1])).part(
        "walls",
        "wall",
        Mesh::join(walls.map(side)),
    )
}

fn text() -> String {
    let mut scene = SceneText::new(
        "Caustics of a point: a goblet of water, a ring of gold, a gem and a ball of glass under a\n\
         single point of light, in a closed room. No path tracer finds them. Lengths are decimeters.",
    );
    scene.mesh("room.obj");
    // A hair above the table, as is all that stands on it.
    scene.copy("goblet.obj", None, Place::at(-1.0, 0.003, -0.75));
    scene.copy("ring.obj", Some("gold"), Place::at(1.25, 0.003, -0.3));
    scene.copy("gem.obj", Some("gem"), Place::at(0.75, 0.0, 1.35).turned(10.0));
    scene.copy("ball.obj", Some("glass"), Place::at(-1.15, 0.353, 0.95).scaled(0.35, 0.35, 0.35));
    scene.light(
        "type = \"spot\", position = [-3, 4.8, -2.9], target = [0.2, 0, 0.2], inner_deg = 27, \
         outer_deg = 44, intensity = [48, 42, 34]",
    );
    scene.table(
        "camera",
        &["position = [0.2, 4.6, 3.9]", "target = [0.15, 0.38, 0.05]", "fov_y_deg = 37"],
    );
    scene.table(
        "render",
        &[
            "resolution = [640, 480]",
            "light_paths = 600000",
            "camera_paths = 3",
            "radius = 0.012",
            "merge_vertex = 2",
            "direct = \"connect\"",
        ],
    );
    scene.table(
        "regions",
        &["goblet = [[0.34, 0.5, 0.58, 0.72]]", "ring = [[0.62, 0.4, 0.85, 0.57]]"],
    );
    scene.table("materials.table", &["albedo = [0.62, 0.53, 0.46]"]);
    scene.table("materials.wall", &["albedo = [0.24, 0.42, 0.5]"]);
    scene.table("materials.gold", &["type = \"metal\"", "metal = \"gold\""]);
    scene.table("materials.glass", &["type = \"dielectric\"", "ior = 1.5"]);
    scene.table("materials.gem", &["type = \"dielectric\"", "ior = 1.77"]);
    scene.table("materials.water", &["type = \"dielectric\"", "ior = 1.33"]);
    let wet = ["type = \"dielectric\"", "ior = 1.33", "outside_ior = 1.5"];
    scene.table("materials.water-in-glass", &wet);
    scene.text()
}
