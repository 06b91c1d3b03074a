//! Measures how long a large mesh takes to load: a hilly ground of a million triangles with
//! normals, as OBJ and as binary glTF.
//!
//! ```sh
//! cargo run --release --example load_table
//! ```

use bdpm::load::load;
use bdpm::scene::backend::{Backend, build};
use serde_json::json;
use std::fmt::Write as _;
use std::path::Path;
use std::time::Instant;

/// Squares along each side, of two triangles each.
const SIDE: usize = 708;
/// Number of loads of each file. The shortest time counts because other processes disturb it least.
const TIMES: usize = 3;

/// A vertex: its position and unit normal.
type Vertex = ([f32; 3], [f32; 3]);

fn vertices() -> Vec<Vertex> {
    let place = |i: usize| 20.0 * i as f32 / SIDE as f32 - 10.0;
    let vertex = |index: usize| {
        let (x, z) = (place(index % (SIDE + 1)), place(index / (SIDE + 1)));
        let (sx, cx, sz, cz) = (x.sin(), x.cos(), z.sin(), z.cos());
        // Derivatives of the height 0.2 sin(x) cos(z).
        let (dx, dz) = (0.2 * cx * cz, -0.2 * sx * sz);
        let length = (dx * dx + dz * dz + 1.0).sqrt();
        ([x, 0.2 * sx * cz, z], [-dx / length, 1.0 / length, -dz / length])
    };
    (0..(SIDE + 1).pow(2)).map(vertex).collect()
}

fn triangles() -> Vec<[u32; 3]> {
    let square = |index: usize| {
        let (x, z) = (index % SIDE, index / SIDE);
        let corner = |x: usize, z: usize| (z * (SIDE + 1) + x) as u32;
        let [a, b, c, d] = [corner(x, z), corner(x, z + 1), corner(x + 1, z + 1), corner(x + 1, z)];
        [[a, b, c], [a, c, d]]
    };
    (0..SIDE * SIDE).flat_map(square).collect()
}

fn obj() -> String {
    let mut text = String::new();
    for ([x, y, z], [nx, ny, nz]) in vertices() {
        let _ = writeln!(text, "v {x} {y} {z}\nvn {nx} {ny} {nz}");
    }
    for corners in triangles() {
        let [a, b, c] = corners.map(|index| index + 1);
        let _ = writeln!(text, "f {a}//{a} {b}//{b} {c}//{c}");
    }
    text
}

fn glb() -> Vec<u8> {
    let (vertices, triangles) = (vertices(), triangles());
    let floats = |of: fn(&Vertex) -> [f32; 3]| {
        vertices.iter().flat_map(of).flat_map(f32::to_le_bytes).collect::<Vec<u8>>()
    };
    let parts = [
        floats(|vertex| vertex.0),
        floats(|vertex| vertex.1),
        triangles.as_flattened().iter().flat_map(|index| index.to_le_bytes()).collect(),
    ];
    let mut views = Vec::new();
    let mut start = 0;
    for part in &parts {
        views.push(json!({ "buffer": 0, "byteOffset": start, "byteLength": part.len() }));
        start += part.len();
    }
    let document = json!({
        "asset": { "version": "2.0" },
        "buffers": [{ "byteLength": start }],
        "bufferViews": views,
        "accessors": [
            { "bufferView": 0, "componentType": 5126, "count": vertices.len(), "type": "VEC3",
              "min": [-10, -1, -10], "max": [10, 1, 10] },
            { "bufferView": 1, "componentType": 5126, "count": vertices.len(), "type": "VEC3" },
            { "bufferView": 2, "componentType": 5125, "count": 3 * triangles.len(), "type": "SCALAR" },
        ],
        "meshes": [{ "primitives": [
            { "attributes": { "POSITION": 0, "NORMAL": 1 }, "indices": 2 },
        ] }],
        "nodes": [{ "mesh": 0 }],
        "scenes": [{ "nodes": [0] }],
        "scene": 0,
    });
    let mut text = document.to_string().into_bytes();
    text.resize(text.len().next_multiple_of(4), b' ');
    let binary = parts.concat();
    let mut file = Vec::new();
    let total = 12 + 8 + text.len() + 8 + binary.len();
    for number in [0x4654_6c67, 2, total as u32, text.len() as u32, 0x4e4f_534a] {
        file.extend(u32::to_le_bytes(number));
    }
    file.extend(text);
    for number in [binary.len() as u32, 0x004e_4942] {
        file.extend(u32::to_le_bytes(number));
    }
    file.extend(binary);
    file
}

/// Returns the seconds of reading, of assembly, and of building a hierarchy by each backend.
fn measure(path: &Path) -> bdpm::Result<[f64; 4]> {
    let mut least = [f64::INFINITY; 4];
    for _ in 0..TIMES {
        let start = Instant::now();
        let loaded = load(path)?;
        let (all, assembly) = (start.elapsed(), loaded.assembly);
        let built = |backend| {
            let start = Instant::now();
            build(backend, &loaded.scene).map(|_| start.elapsed())
        };
        let times = [all - assembly, assembly, built(Backend::default())?, built(Backend::Bvh)?];
        least = std::array::from_fn(|part| least[part].min(times[part].as_secs_f64()));
    }
    Ok(least)
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let folder = tempfile::tempdir()?;
    println!("| file of {} triangles | MB | read | put together | Embree | BVH |", 2 * SIDE * SIDE);
    println!("|---|---|---|---|---|---|");
    for (name, content) in [("ground.obj", obj().into_bytes()), ("ground.glb", glb())] {
        let path = folder.path().join(name);
        std::fs::write(&path, &content)?;
        let times = measure(&path)?.map(|seconds| format!("{seconds:.2} s"));
        println!("| {name} | {} | {} |", content.len() / 1_000_000, times.join(" | "));
    }
    Ok(())
}
