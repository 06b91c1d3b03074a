//! Finds surfaces that lie behind others within the merge radius: discs leak light between them.

use bdpm_core::accel::{Intersect, Ray};
use bdpm_core::scene::Scene;
use bdpm_core::settings::{Kernel, Settings};

/// Points across and down that are examined.
const SIDE: u32 = 48;

/// Minimum cosine between the normals of two layers.
const PARALLEL: f32 = 0.5;

/// A warning if photons of other layers merge on discs at points that the camera sees; `None` if no
/// point shows this.
pub(super) fn warning(scene: &Scene, accel: &dyn Intersect, settings: &Settings) -> Option<String> {
    if settings.kernel == Kernel::Area || !settings.has_photons() {
        return None;
    }
    let view = scene.camera.view(SIDE, SIDE);
    let (mut seen, mut near) = (0, 0);
    for (x, y) in (0..SIDE).flat_map(|y| (0..SIDE).map(move |x| (x, y))) {
        let (ray, _) = scene.camera_ray(&view, x as f32, y as f32, [0.5; 2]);
        let hit = accel.closest_hit(&ray);
        if hit.is_miss() {
            continue;
        }
        let normal = scene.placed_normal(hit.mesh, hit.triangle).normalize_or_zero();
        let into = if normal.dot(ray.direction) > 0.0 { normal } else { -normal };
        let point = ray.origin + hit.t * ray.direction;
        // The surface itself is at the start of this ray.
        let start = f32::EPSILON * 16.0 * point.abs().max_element();
        let behind = Ray { t_near: start, t_far: settings.reach(), ..Ray::new(point, into) };
        let other = accel.closest_hit(&behind);
        let is_other = !other.is_miss() && (other.mesh, other.triangle) != (hit.mesh, hit.triangle);
        let is_parallel = || {
            let normal = scene.placed_normal(other.mesh, other.triangle).normalize_or_zero();
            normal.dot(into).abs() > PARALLEL
        };
        seen += 1;
        near += u32::from(is_other && is_parallel());
    }
    (near > 0).then(|| {
        format!(
            "at {:.1} % of the points that the camera sees, another surface is behind within the merge radius of \
             {}: discs leak light between them\nhelp: use `--kernel area`, or a smaller radius",
            100.0 * f64::from(near) / f64::from(seen),
            settings.reach()
        )
    })
}
