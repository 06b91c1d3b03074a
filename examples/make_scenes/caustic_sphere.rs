//! `caustic-sphere`: a ball of glass and a mirror ball in the Cornell box, under a small lamp.

use super::mesh::Mesh;
use super::obj::Model;
use super::room::{HEIGHT, cornell};
use super::scene_text::{Folder, Place, SceneText};
use super::shapes::sphere;
use glam::dvec3;

pub fn folder() -> Folder {
    // Off the middle, so that the caustic comes out from under the ball.
    let (x, y, z, half) = (-1.3, HEIGHT - 0.01, -0.9, 0.25);
    let lamp = Mesh::polygon(&[
        dvec3(x - half, y, z - half),
        dvec3(x + half, y, z - half),
        dvec3(x + half, y, z + half),
        dvec3(x - half, y, z + half),
    ]);
    let room = cornell("The Cornell box in meters, with a small lamp 1 cm below its ceiling.");
    let room = room.part("lamp", "lamp", lamp);
    let ball = Model::new("A ball of radius 1 about the origin, smooth normals.").decimals(5, 5);
    let ball = ball.plain("ball", sphere(1.0, 48, 96));

    let mut scene =
        SceneText::new("A ball of glass and a mirror ball under a small lamp. Lengths are meters.");
    scene.mesh("room.obj");
    // The glass ball stands a hair above the floor.
    let place = |x, y, z| Place::at(x, y, z).scaled(1.1, 1.1, 1.1);
    scene.copy("ball.obj", Some("glass"), place(0.75, 1.102, 0.2));
    scene.copy("ball.obj", Some("mirror"), place(-1.35, 1.102, -1.3));
    scene.table(
        "camera",
        &["position = [0, 3.1, 10.8]", "target = [0, 2.65, 0]", "fov_x_deg = 39.3"],
    );
    scene.table(
        "render",
        &[
            "resolution = [512, 512]",
            "light_paths = 300000",
            "camera_paths = 4",
            "radius = 0.015",
            "merge_vertex = 2",
            "direct = \"connect\"",
        ],
    );
    scene.table("regions", &["caustic = [[0.58, 0.83, 0.73, 0.9]]"]);
    scene.table("materials.mirror", &["type = \"mirror\"", "reflectance = 0.95"]);
    scene.table("materials.white", &["albedo = [0.725, 0.71, 0.68]"]);
    scene.table("materials.red", &["albedo = [0.63, 0.065, 0.05]"]);
    scene.table("materials.green", &["albedo = [0.14, 0.45, 0.091]"]);
    scene.table("materials.lamp", &["albedo = 0.78", "emission = [92, 74, 48]"]);
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
