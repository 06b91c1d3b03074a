//! The default light of scenes without a usable light source, which is decided by how much their
//! camera sees lit.

use super::default_camera::{self, Lamp};
use super::environment::{SOFT, soft};
use super::lit_check::LitCheck;
use super::warnings::Warning;
use bdpm_core::scene::backend::{Backend, build};
use bdpm_core::scene::{Emitter, Scene};
use std::path::Path;

/// Minimum share of the visible surfaces that must not be black.
const MIN_LIT: f64 = 0.5;
/// Minimum share if the file places lights, because a spot in the dark is intended.
const MIN_LIT_BY_PLACED: f64 = 0.2;

/// The scene with light, and a warning about added light. The scene keeps its own light if that
/// shows what the camera sees. Otherwise it gets a soft environment and, where too little of that
/// gets in, a lamp near the camera as well.
pub(super) fn with_light(
    mut scene: Scene,
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
    let accel = if has_own || is_inside { build(Backend::Bvh, &scene).ok() } else { None };
    let Some(accel) = accel else {
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
    let problem = match has_own {
        true => format!(
            "its lights leave {:.0}% of the visible surfaces black",
            100.0 * (1.0 - own_share)
        ),
        false => "nothing emits light".to_owned(),
    };
    scene = scene.with_environment(soft(white));
    let with_environment = check(&scene);
    let share = with_environment.lit_share();
    if share < min_lit {
        let distance2 = with_environment.mean_distance2();
        let Lamp { position, intensity } = default_camera::lamp(&scene, &*accel, distance2);
        let lamp = Emitter::Point { position, intensity: glam::Vec3::splat(intensity) };
        let with_lamp = scene.clone().with_light(lamp);
        if check(&with_lamp).lit_share() > share {
            let added = format!(
                "{} and, because little of that gets in, a point light of {intensity} W/sr at {position}",
                environment_text(white)
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
