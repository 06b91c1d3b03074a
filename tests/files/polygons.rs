//! Polygons of mesh files whose corners are at the same places by other numbers.

use crate::common::area;
use crate::common::gltf::files;

/// A star of eight corners, each so many times.
fn star(copies: usize) -> f64 {
    let mut obj = String::new();
    for i in 0..8 {
        let angle = std::f64::consts::TAU * f64::from(i) / 8.0;
        let radius = if i % 2 == 0 { 0.9 } else { 0.3 };
        let line = format!("v {} {} 0\n", radius * angle.cos(), radius * angle.sin());
        obj += &line.repeat(copies);
    }
    let corners: Vec<String> = (1..=8 * copies).map(|i| i.to_string()).collect();
    obj += &format!("f {}\n", corners.join(" "));
    files(&[("a.obj", obj.as_bytes())]).load().scene.meshes().iter().map(area).sum()
}

#[test]
fn corners_at_the_same_place_do_not_change_the_area() {
    // Eight triangles of the center and two corners.
    let expected = 4.0 * 0.9 * 0.3 * (std::f64::consts::TAU / 8.0).sin();
    for copies in 1..=3 {
        let area = star(copies);
        assert!((area - expected).abs() < 1e-5, "{copies} copies: {area}, not {expected}");
    }
}
