//! The Cornell box in meters, with straight walls: 5.6 wide and deep, 5.5 high, open toward +z.

use super::mesh::Mesh;
use super::obj::Model;
use glam::{DVec3, dvec3};

/// Half its width and depth; the floor is y = 0, centered at the origin.
pub const HALF: f64 = 2.8;
pub const HEIGHT: f64 = 5.5;

/// Floor, ceiling and walls, whose fronts face the inside, of the materials `white`, `red` (at -x)
/// and `green` (at +x).
pub fn cornell(comment: &'static str) -> Model {
    let (w, h) = (HALF, HEIGHT);
    let at = |x: f64, y: f64, z: f64| dvec3(x * w, y * h, z * w);
    let quad = |corners: [DVec3; 4]| Mesh::polygon(&corners);
    let floor = [at(-1., 0., 1.), at(1., 0., 1.), at(1., 0., -1.), at(-1., 0., -1.)];
    let ceiling = [at(-1., 1., 1.), at(-1., 1., -1.), at(1., 1., -1.), at(1., 1., 1.)];
    let back = [at(-1., 0., -1.), at(1., 0., -1.), at(1., 1., -1.), at(-1., 1., -1.)];
    let left = [at(-1., 0., 1.), at(-1., 0., -1.), at(-1., 1., -1.), at(-1., 1., 1.)];
    let right = [at(1., 0., -1.), at(1., 0., 1.), at(1., 1., 1.), at(1., 1., -1.)];
    Model::new(comment)
        .part("floor", "white", quad(floor))
        .part("ceiling", "white", quad(ceiling))
        .part("back-wall", "white", quad(back))
        .part("left-wall", "red", quad(left))
        .part("right-wall", "green", quad(right))
}
