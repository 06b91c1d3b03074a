//! Intersects a ray with a triangle by Embree:
//! `cargo run --package bdpm-accel --example first_ray`.

use bdpm_accel::embree::{Device, EmbreeError};
use bdpm_accel::glam::Vec3;
use bdpm_accel::{Intersect, Ray, TriangleMesh};

fn main() -> Result<(), EmbreeError> {
    let device = Device::new()?;
    let mut builder = device.scene_builder()?;
    builder.add_mesh(TriangleMesh {
        positions: &[Vec3::ZERO, Vec3::X, Vec3::Y],
        triangles: &[[0, 1, 2]],
    })?;
    let scene = builder.commit()?;
    let hit = scene.closest_hit(&Ray::new(Vec3::new(0.25, 0.5, 2.0), -Vec3::Z));
    println!("distance {}", hit.t);
    Ok(())
}
