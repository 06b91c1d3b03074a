//! Media, boundaries around them, and a room of fog.

use crate::common::far_counts::Subject;
use crate::common::*;
use bdpm::scene::bsdf::{Bsdf, ThinDielectric};
use bdpm::scene::{Material, Medium, MediumBoundary, Mesh};
use bdpm::settings::{MediumQuery, MisScales, Strategy};
use bdpm::{Scene, Settings};
use glam::Vec3;
use std::sync::Arc;

/// A homogeneous medium of the priority 0, with coefficients per scene unit.
pub fn medium(absorption: Vec3, scattering: Vec3, asymmetry: f32) -> Arc<Medium> {
    Arc::new(Medium { name: "fog".into(), absorption, scattering, asymmetry, priority: 0 })
}

pub fn gray_medium(absorption: f32, scattering: f32, asymmetry: f32) -> Arc<Medium> {
    medium(Vec3::splat(absorption), Vec3::splat(scattering), asymmetry)
}

/// A material around a medium.
pub fn around(interior: &Arc<Medium>, bsdf: Bsdf) -> Material {
    let boundary = MediumBoundary { interior: Some(interior.clone()), exterior: None };
    Material { boundary: Some(boundary), ..Material::new("boundary", bsdf) }
}

/// A material around a medium that does not refract.
pub fn index_matched(interior: &Arc<Medium>) -> Material {
    around(interior, Bsdf::ThinDielectric(ThinDielectric::new(1.0)))
}

pub fn filled(scene: Arc<Scene>, medium: Arc<Medium>) -> Arc<Scene> {
    Arc::unwrap_or_clone(scene).with_filling_medium(Some(medium)).unwrap().into()
}

/// The six sides of a cube, with fronts outside or inside.
pub fn cube(center: Vec3, half: f32, inward: bool, material: u32) -> Vec<Mesh> {
    let sides = [Vec3::X, Vec3::Y, Vec3::Z].into_iter().flat_map(|axis| [axis, -axis]);
    let to = if inward { -1.0 } else { 1.0 };
    sides.map(|side| square(center + half * side, to * side, half, material)).collect()
}

/// One closed mesh of the sides of a cube: the boundary of a medium.
pub fn block(center: Vec3, half: f32, material: u32) -> Mesh {
    let mut whole = Mesh { name: "block".into(), material, ..Mesh::default() };
    for side in cube(center, half, false, material) {
        let first = whole.positions.len() as u32;
        whole.positions.extend(side.positions);
        whole.triangles.extend(side.triangles.iter().map(|corners| corners.map(|i| i + first)));
    }
    whole
}

/// A room of fog around a ball of milk, under a panel as wide as the ceiling.
pub fn foggy_room() -> Arc<Scene> {
    let mut meshes = cube(Vec3::ZERO, 1.0, true, 0);
    meshes.push(square(Vec3::new(0.0, 0.0, 0.95), -Vec3::Z, 0.8, 1));
    meshes.push(sphere(Vec3::new(0.1, 0.2, -0.4), 0.4, 2, false, 2));
    let milk = gray_medium(0.1, 2.0, 0.3);
    let materials = vec![gray(0.5, 0.0), gray(0.0, 4.0), index_matched(&milk)];
    let eye = camera(Vec3::new(-0.9, -0.8, 0.2), Vec3::new(0.1, 0.2, -0.6), 70.0);
    filled(scene(meshes, materials, vec![], eye), gray_medium(0.1, 0.5, 0.0))
}

/// Asserts that coefficients that are measured at few paths predict the noise at others: vertices
/// in media keep to the law. Direct light from photons takes more iterations:
/// `tests/check/predicts.rs`.
pub fn assert_noise_in_media(
    strategy: Strategy,
    (merge_vertex, medium_query, medium_share): (u32, MediumQuery, f64),
) {
    let asked = Settings { radius: 0.25, caustic_radius: 0.2, ..settings(8, 8) };
    let asked = Settings { direct: Direct::Connect, medium_scale: 1.5, ..asked };
    // The law holds for fixed weights.
    let mis_scales = strategy.is_weighted().then(|| MisScales::new(2000, 8));
    let asked = Settings { strategy, mis_scales, ..asked };
    let settings = Settings { merge_vertex, medium_query, medium_share, ..asked };
    let name = format!("media {strategy:?} k = {merge_vertex} {medium_query:?} {medium_share}");
    let scene = &foggy_room();
    // Two standard errors: .03 with the 144 pixels of `far_counts::assert_far_counts`, hence
    // .03 sqrt(144/64) with these 64.
    Subject { name, scene, settings, few: 300, iterations: 3000, quiet: 1.0, most: 0.045 }
        .assert_far_counts(&[(6000, 4, 300), (300, 60, 400)]);
}
