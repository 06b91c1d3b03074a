//! `caustic-sphere`: a ball of glass in the Cornell box, under a small lamp.

use crate::mesh::Mesh;
use crate::obj::Model;
use crate::room::{HEIGHT, cornell};
use crate::scene_text::{Folder, Place, SceneText};
use crate::shapes::sphere;
use glam::dvec3;

pub fn folder() -> Folder {
    let (half, y) = (0.35, HEIGHT - 0.01);
    let lamp = Mesh::polygon(&[
        dvec3(-half, y, -half),
        dvec3(half, y, -half),
        dvec3(half, y, half),
        dvec3(-half, y, half),
    ]);
    let room = cornell("The Cornell box in meters, with a small lamp 1 cm below its ceiling.");
    let room = room.part("lamp", "lamp", lamp);
    let ball = Model::new("A ball of radius 1 about the origin, smooth normals.").decimals(5, 5);
    let ball = ball.plain("ball", sphere(1.0, 48, 96));

    let mut scene = SceneText::new("A glass ball gathers the light of a small lamp.");
    scene.mesh("room.obj");
    let place = Place::at(0.55, 1.35, 0.35).scaled(1.1, 1.1, 1.1);
    scene.copy("ball.obj", Some("glass"), place);
    scene.table(
        "camera",
        &["position = [0, 2.73, 10.8]", "target = [0, 2.73, 0]", "fov_x_deg = 39.3"],
    );
    scene.table(
        "render",
        &["resolution = [512, 512]", "radius = 0.015", "merge_vertex = 2", "direct = \"connect\""],
    );
    scene.table("materials.white", &["albedo = [0.725, 0.71, 0.68]"]);
    scene.table("materials.red", &["albedo = [0.63, 0.065, 0.05]"]);
    scene.table("materials.green", &["albedo = [0.14, 0.45, 0.091]"]);
    scene.table("materials.lamp", &["albedo = 0.78", "emission = [48, 38, 24]"]);
    scene.table("materials.glass", &["type = \"dielectric\"", "ior = 1.5"]);
    Folder {
        name: "caustic-sphere",
        files: vec![
            ("scene.toml", scene.text()),
            ("room.obj", room.text()),
            ("ball.obj", ball.text()),
        ],
    }
}
