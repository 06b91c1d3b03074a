//! Bookcases full of books.

use super::super::mesh::{Mesh, Vertex};
use super::super::obj::Model;
use super::super::random::Random;
use super::super::shapes::{Side, cuboid_without};
use glam::dvec3;

/// Colors of bindings: names of materials.
pub const BINDINGS: [&str; 6] = ["oxblood", "moss", "navy", "tan", "umber", "parchment"];

const WIDTH: f64 = 2.6;
const DEPTH: f64 = 0.36;
const HEIGHT: f64 = 3.5;
const BOARD: f64 = 0.035;
const SHELVES: usize = 9;

/// A bookcase 2.6 wide and 3.5 high, standing at y = 0 with its back at z = 0 and its front toward
/// +z.
pub fn bookcase(seed: u64) -> Model {
    let mut random = Random(seed);
    let (case, clear) = carcass();
    let mut books: [Mesh; BINDINGS.len()] = Default::default();
    for shelf in 0..SHELVES {
        let bottom = 0.16 + BOARD + shelf as f64 * (clear + BOARD);
        for half in 0..2 {
            let left = -0.5 * WIDTH + 0.06 + 0.5 * (WIDTH - 0.06) * f64::from(half);
            fill(&mut books, &mut random, [left, left + 0.5 * (WIDTH - 0.18)], bottom, clear);
        }
    }
    let model =
        Model::new("A bookcase, 2.6 wide and 3.5 high, its front toward +z.").decimals(3, 3);
    let model = model.part("case", "walnut", case);
    let parts = BINDINGS.into_iter().zip(books);
    parts.fold(model, |model, (binding, mesh)| model.part(binding, binding, mesh))
}

/// Sides, shelves and cornice, and the clear height between shelves.
fn carcass() -> (Mesh, f64) {
    let (x, open) = (0.5 * WIDTH, [Side::Back]);
    let clear = (HEIGHT - 0.16 - 0.14 - BOARD * (SHELVES + 1) as f64) / SHELVES as f64;
    let mut case = Mesh::default();
    let mut board = |min: [f64; 3], max: [f64; 3], missing: &[Side]| {
        case.push(cuboid_without(
            dvec3(min[0], min[1], min[2]),
            dvec3(max[0], max[1], max[2]),
            missing,
        ));
    };
    let (floor, top) = ([Side::Back, Side::Bottom], HEIGHT - 0.14);
    for [a, b] in [[-x, -x + 0.05], [x - 0.05, x]] {
        board([a, 0.0, 0.0], [b, top, DEPTH], &floor);
    }
    board([-0.025, 0.161, 0.0], [0.025, top - 0.001, DEPTH - 0.005], &open);
    // Foot, shelves, and a back a finger's breadth before the wall.
    board([-x - 0.02, 0.0, 0.0], [x + 0.02, 0.16, DEPTH + 0.02], &floor);
    for shelf in 0..=SHELVES {
        let y = 0.16 + shelf as f64 * (clear + BOARD);
        board([0.049 - x, y + 0.0005, 0.011], [x - 0.049, y + BOARD, DEPTH - 0.01], &open);
    }
    case.push(Mesh::polygon(&[
        dvec3(0.049 - x, 0.15, 0.01),
        dvec3(x - 0.049, 0.15, 0.01),
        dvec3(x - 0.049, top, 0.01),
        dvec3(0.049 - x, top, 0.01),
    ]));
    // A cornice around all sides but the back.
    let row = |(out, y): (f64, f64)| {
        let (x, z) = (x + out, DEPTH + out);
        [(-x, 0.0), (-x, z), (x, z), (x, 0.0)].map(|(x, z)| Vertex::flat(dvec3(x, y, z))).to_vec()
    };
    let line =
        [(0.001, top - 0.02), (0.02, top), (0.02, top + 0.04), (0.07, top + 0.09), (0.07, HEIGHT)];
    case.push(Mesh::rows(&line.map(row), false));
    let (min, max) = (dvec3(-x - 0.07, top, 0.0), dvec3(x + 0.07, HEIGHT, DEPTH + 0.07));
    let around = [Side::Back, Side::Bottom, Side::Left, Side::Right, Side::Front];
    case.push(cuboid_without(min, max, &around));
    (case, clear)
}

/// A row of books from left to right, in runs of like bindings, with a gap now and then.
fn fill(books: &mut [Mesh], random: &mut Random, [left, right]: [f64; 2], bottom: f64, clear: f64) {
    let mut x = left + random.between(0.0, 0.02);
    let (mut run, mut binding) = (0, 0);
    let (mut height, mut width, mut depth) = (0.0, 0.0, 0.0);
    while x < right {
        if run == 0 {
            run = 1 + random.below(6);
            binding = random.below(BINDINGS.len());
            height = clear * random.between(0.7, 0.94);
            width = random.between(0.028, 0.065);
            depth = random.between(0.2, 0.29);
            if random.below(9) == 0 {
                x += random.between(0.03, 0.16);
            }
        }
        run -= 1;
        let w = width * random.between(0.85, 1.1);
        if x + w > right {
            break;
        }
        let d = depth + random.between(-0.006, 0.006);
        let h = height * random.between(0.985, 1.0);
        let (min, max) =
            (dvec3(x, bottom - 0.002, 0.03), dvec3(x + w - 0.002, bottom + h, 0.03 + d));
        books[binding].push(cuboid_without(min, max, &[Side::Bottom, Side::Back]));
        x += w;
    }
}
