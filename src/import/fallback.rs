//! Light for scenes that bring none worth the name, judged by what their camera sees.

use super::default_camera;
use super::environment::{SOFT, soft};
use super::lit_check::LitCheck;
use super::warnings::Warning;
use crate::scene::backend::{Backend, build};
use crate::scene::{Emitter, Scene};
use std::path::Path;

/// Of the surfaces that the camera sees, the share that must not be black.
const ENOUGH: f64 = 0.5;
/// The same where somebody placed lights: a spot in the dark is meant so.
const ENOUGH_OF_PLACED: f64 = 0.2;

/// What to say to who wants it otherwise.
const OTHERWISE: &str = "--environment gives another, --no-fallback-light none";

/// The scene with light, as told in a note: with its own if that shows what the camera sees; else with soft
/// light from all around or, where that does not get in, with a lamp near the camera as well.
pub(super) fn lit(
    mut scene: Scene,
    resolution: [u32; 2],
    path: &Path,
    notes: &mut Vec<Warning>,
) -> Scene {
    let has_own = !scene.lights().is_empty();
    let bounds = scene.bounds();
    let eye = scene.camera.position();
    let is_inside = eye.cmpge(bounds.min).all() && eye.cmple(bounds.max).all();
    // The same everywhere, whatever the image is rendered with. What no backend takes is refused later.
    let accel = if has_own || is_inside { build(Backend::Bvh, &scene).ok() } else { None };
    let Some(accel) = accel else {
        if !has_own {
            notes.push(note(path, "nothing emits light", &surroundings(1.0)));
            scene = scene.with_environment(soft(1.0));
        }
        return scene;
    };
    let look = |scene: &Scene| LitCheck::new(scene, &*accel, resolution);
    let has_location = scene.lights().emitters().iter().any(Emitter::is_delta);
    let enough = if has_location { ENOUGH_OF_PLACED } else { ENOUGH };
    let glance = has_own.then(|| look(&scene));
    let own = glance.as_ref().map_or(0.0, LitCheck::lit);
    if own >= enough {
        return scene;
    }
    // Emission is meant to be seen in the light of viewers, of about 1; lights may be of any strength.
    let white = glance.filter(|_| has_location).and_then(|glance| glance.typical()).unwrap_or(1.0);
    let problem = match has_own {
        true => format!("its lights leave {:.0}% of what is seen black", 100.0 * (1.0 - own)),
        false => "nothing emits light".to_owned(),
    };
    scene = scene.with_environment(soft(white));
    let glance = look(&scene);
    let surrounded = glance.lit();
    if surrounded < enough {
        let (lamp, position, intensity) = default_camera::lamp(&scene, &*accel, glance.distance2());
        let told = format!("a point light of {intensity} W/sr at {position}");
        let with_lamp = scene.clone().with_light(lamp);
        if look(&with_lamp).lit() > surrounded {
            let told = format!("{} and, as little of that gets in, {told}", surroundings(white));
            notes.push(note(path, &problem, &told));
            return with_lamp;
        }
    }
    if surrounded > own || !has_own {
        notes.push(note(path, &problem, &surroundings(white)));
        return scene;
    }
    scene.with_environment(None)
}

fn note(path: &Path, problem: &str, put: &str) -> Warning {
    Warning::chosen(format!("{}: {problem}; put {put} ({OTHERWISE})", path.display()))
}

fn surroundings(white: f32) -> String {
    let [low, high] = SOFT.map(|radiance| white * radiance);
    format!("soft gray light around it, of radiance {low} below to {high} above")
}
