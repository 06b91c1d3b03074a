//! The default light of scenes without a usable light source, which is decided by how much their
//! camera sees lit.

use super::lit_check::LitCheck;
use bdpm_core::accel::{Intersect, Ray};
use bdpm_core::base::math::Rgb;
use bdpm_core::scene::backend::{Backend, build};
use bdpm_core::scene::{Emitter, Environment, Scene};
use bdpm_import::Warning;
use std::f32::consts::PI;
use std::path::Path;
use std::sync::Arc;

/// Minimum share of the visible surfaces that must not be black.
const MIN_LIT: f64 = 0.5;
/// Minimum share if the file places lights, because a spot in the dark is intended.
const MIN_LIT_BY_PLACED: f64 = 0.2;

/// The scene with light, and a warning about added light. The scene keeps its own light if that
/// shows what the camera sees. Otherwise it gets a soft environment and, where too little of that
/// gets in, a lamp near the camera as well. `accel` is the scene's acceleration structure, if there
/// is one already.
pub(super) fn with_light(
    mut scene: Scene,
    accel: Option<Arc<dyn Intersect>>,
    resolution: [u32; 2],
    path: &Path,
    warnings: &mut Vec<Warning>,
) -> Scene {
    let has_own = !scene.lights().is_empty();
    let bounds = scene.bounds();
    let eye = scene.camera.position();
    let is_inside = eye.cmpge(bounds.min).all() && eye.cmple(bounds.max).all();
    // The decision does not depend on the backend of the render. A scene that no backend supports
    // is refused later.
    let built = || accel.or_else(|| build(Backend::Bvh, &scene).ok());
    let Some(accel) = (has_own || is_inside).then(built).flatten() else {
        if !has_own {
            warnings.push(warning(path, "nothing emits light", &environment_text(1.0)));
            scene = scene.with_environment(soft(1.0));
        }
        return scene;
    };
    let check = |scene: &Scene| LitCheck::new(scene, &*accel, resolution);
    let is_placed = scene.lights().emitters().iter().any(Emitter::is_delta);
    let min_lit = if is_placed { MIN_LIT_BY_PLACED } else { MIN_LIT };
    let own = has_own.then(|| check(&scene));
    let own_share = own.as_ref().map_or(0.0, LitCheck::lit_share);
    if own_share >= min_lit {
        return scene;
    }
    // Emission is meant to be seen under the light of viewers, of about 1. Placed lights may have
    // any strength.
    let white = own.filter(|_| is_placed).and_then(|own| own.typical_radiance()).unwrap_or(1.0);
    let problem = if has_own {
        format!("its lights leave {:.0}% of the visible surfaces black", 100.0 * (1.0 - own_share))
    } else {
        "nothing emits light".to_owned()
    };
    scene = scene.with_environment(soft(white));
    let with_environment = check(&scene);
    let share = with_environment.lit_share();
    if share < min_lit {
        let Lamp { position, intensity } = Lamp::new(&scene, &*accel, &with_environment);
        let lamp = Emitter::Point { position, intensity: glam::Vec3::splat(intensity) };
        let with_lamp = scene.clone().with_light(lamp);
        if check(&with_lamp).lit_share() > share {
            let added = format!(
                "{} and, because little of that gets in, a point light of {intensity} W/sr at {}",
                environment_text(white),
                scene.in_file(position)
            );
            warnings.push(warning(path, &problem, &added));
            return with_lamp;
        }
    }
    if share > own_share || !has_own {
        warnings.push(warning(path, &problem, &environment_text(white)));
        return scene;
    }
    scene.with_environment(None)
}

fn warning(path: &Path, problem: &str, added: &str) -> Warning {
    let text = format!("{}: {problem}; added {added}", path.display());
    let advice = Some("give another environment, or disable the default light");
    Warning { advice, ..Warning::chosen(text) }
}

fn environment_text(white: f32) -> String {
    let [low, high] = SOFT.map(|radiance| white * radiance);
    format!("soft gray light around it, of radiance {low} below to {high} above")
}

/// A point light for a camera between walls.
struct Lamp {
    position: glam::Vec3,
    /// Intensity of all channels, W/sr.
    intensity: f32,
}

impl Lamp {
    /// A lamp half way from the camera to the surface above it. A white surface that faces the lamp
    /// at the typical distance of what the camera sees has radiance 1.
    fn new(scene: &Scene, accel: &dyn Intersect, seen: &LitCheck) -> Self {
        let camera = &scene.camera;
        let hit = accel.closest_hit(&Ray::new(camera.position(), camera.up()));
        let position = camera.position() + 0.5 * hit.t.min(scene.size()) * camera.up();
        let distance2 = seen.mean_distance2().clamp(f32::MIN_POSITIVE, f32::MAX / 8.0);
        Self { position, intensity: PI * distance2 }
    }
}

/// Mean radiance of [`soft`], W/(m^2 sr).
const SOFT_MEAN: f32 = 0.6;
/// Difference between the radiance toward +y and the mean, W/(m^2 sr).
const SOFT_RISE: f32 = 0.6;
/// Rows of its map: more than the eye distinguishes in a preview.
const SOFT_ROWS: u32 = 256;

/// Minimum and maximum radiance of [`soft`], W/(m^2 sr), for a white surface of radiance 1.
const SOFT: [f32; 2] = [SOFT_MEAN - SOFT_RISE, SOFT_MEAN + SOFT_RISE];

/// A gray environment that is brighter from above (+y): its radiance is `0.6 (1 + y)` times that of
/// a `white` surface that faces up, W/(m^2 sr). The cosine-weighted mean of `y` over such a surface
/// is 2/3.
fn soft(white: f32) -> Environment {
    let row = |row: u32| {
        let latitude = std::f32::consts::PI * (row as f32 + 0.5) / SOFT_ROWS as f32;
        Rgb::splat(white * (SOFT_MEAN + SOFT_RISE * latitude.cos()))
    };
    Environment::new(1, SOFT_ROWS, (0..SOFT_ROWS).map(row).collect(), 0.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn white_surfaces_in_soft_light_have_the_expected_radiance() {
        // Surfaces facing up, sideways and down: mean radiance plus 2/3 of the rise times the
        // normal's height.
        let map = soft(1.0);
        let n = 400;
        for (y, expected) in [(1.0, 1.0), (0.0, SOFT_MEAN), (-1.0, 0.2)] {
            let normal = glam::Vec3::new((1.0_f32 - y * y).sqrt(), y, 0.0);
            let mut sum = 0.0;
            for i in 0..n * n {
                let height = 2.0 * ((i / n) as f32 + 0.5) / n as f32 - 1.0;
                let (sin, cos) = (2.0 * PI * ((i % n) as f32 + 0.5) / n as f32).sin_cos();
                let across = (1.0 - height * height).sqrt();
                let wi = glam::Vec3::new(across * cos, height, across * sin);
                sum += f64::from(map.radiance(wi).x * wi.dot(normal).max(0.0));
            }
            let radiance = sum / f64::from(n * n) * 4.0;
            assert!((radiance - f64::from(expected)).abs() < 3e-3, "{y}: {radiance}");
        }
    }
}
