//! Scale of the surfaces that an image shows: their area, and that of a pixel on them.

use bdpm_core::accel::Intersect;
use bdpm_core::scene::{Placement, Scene};
use bdpm_core::settings::Settings;
use rayon::prelude::*;
use std::f64::consts::PI;

/// Pixels across and down at which the size of a pixel's footprint is computed.
const FOOTPRINTS: u32 = 16;

/// Side of the pixel of a meter at distance 1: its rays spread over a wide cone, so that details of
/// this size do not show.
const METER_PIXEL: f64 = 0.01;

/// Width of what an image shows, or distance of what meters see, median, scene units.
pub fn width_seen(scene: &Scene, accel: &dyn Intersect, settings: &Settings) -> f64 {
    let side = footprint(scene, accel, settings) * PI.sqrt();
    match scene.meters() {
        Some(_) => side / METER_PIXEL,
        None => side * f64::from(settings.full_resolution()[0]),
    }
}

/// Area of all surfaces on which photons are merged, scene units squared.
pub fn merging_area(scene: &Scene) -> f64 {
    let places = scene.placements().par_iter().enumerate();
    let area = |(place, placement): (usize, &Placement)| {
        if !scene.materials()[placement.material as usize].bsdf.merges() {
            return 0.0;
        }
        let triangles = 0..scene.mesh(placement).triangles.len() as u32;
        let area = |triangle| f64::from(scene.placed_triangle(place as u32, triangle).area());
        triangles.map(area).sum()
    };
    // The order of the sum does not depend on the number of threads.
    places.map(area).collect::<Vec<f64>>().iter().sum()
}

/// Radius of a disc of the area that a pixel sees head-on, median over the image, scene units; that
/// of a unit square if nothing is seen.
pub fn footprint(scene: &Scene, accel: &dyn Intersect, settings: &Settings) -> f64 {
    let view = scene.camera.view_of(settings);
    let [w, h] = [settings.width, settings.height].map(|pixels| pixels as f32);
    // Offset between the two rays, pixels. A whole pixel may span the whole view.
    const PART: f32 = 0.1;
    let side = |index: u32| {
        let [x, y] = [(index % FOOTPRINTS, w), (index / FOOTPRINTS, h)]
            .map(|(i, pixels)| (i as f32 + 0.5) / FOOTPRINTS as f32 * pixels);
        let (ray, weight) = scene.camera_ray(&view, x, y, [0.5; 2]);
        let (next, _) = scene.camera_ray(&view, x + PART, y, [0.5; 2]);
        let hit = accel.closest_hit(&ray);
        // Rays of an orthographic camera differ by their origins alone.
        let offset = (next.origin - ray.origin).cross(ray.direction);
        let across = offset + hit.t * next.direction.cross(ray.direction);
        let side = match scene.meters() {
            Some(_) => METER_PIXEL * f64::from(hit.t),
            None => f64::from(across.length() / PART),
        };
        (weight > 0.0 && !hit.is_miss()).then_some(side)
    };
    let mut sides: Vec<f64> = (0..FOOTPRINTS * FOOTPRINTS).filter_map(side).collect();
    sides.sort_by(f64::total_cmp);
    let side = sides.get(sides.len() / 2).copied().unwrap_or(1.0);
    side / PI.sqrt()
}
