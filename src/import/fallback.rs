//! Light for scenes that bring none worth the name, judged by what their camera sees.

use super::environment::{SOFT, soft};
use super::framing;
use super::glance::Glance;
use super::notes::Note;
use crate::scene::Scene;
use crate::scene::backend::{Backend, build};
use std::path::Path;

/// Of the surfaces that the camera sees, the share that must not be black.
const ENOUGH: f64 = 0.5;

/// What to say to who wants it otherwise.
const OTHERWISE: &str = "--environment gives another, --no-fallback-light none";

/// The scene with light, as told in a note: with its own if that shows what the camera sees; else with soft
/// light from all around or, where that does not get in, with a lamp near the camera as well.
pub(super) fn lit(
    mut scene: Scene,
    resolution: [u32; 2],
    path: &Path,
    notes: &mut Vec<Note>,
) -> Scene {
    let has_own = !scene.lights().is_empty();
    let bounds = scene.bounds();
    let eye = scene.camera.position();
    let is_inside = eye.cmpge(bounds.min).all() && eye.cmple(bounds.max).all();
    // The same everywhere, whatever the image is rendered with. What no backend takes is refused later.
    let accel = if has_own || is_inside { build(Backend::Bvh, &scene).ok() } else { None };
    let Some(accel) = accel else {
        if !has_own {
            notes.push(note(path, "nothing emits light", &surroundings()));
            scene = scene.with_environment(soft());
        }
        return scene;
    };
    let look = |scene: &Scene| Glance::new(scene, &*accel, resolution);
    let own = if has_own { look(&scene).lit() } else { 0.0 };
    if own >= ENOUGH {
        return scene;
    }
    let problem = match has_own {
        true => format!("its lights leave {:.0}% of what is seen black", 100.0 * (1.0 - own)),
        false => "nothing emits light".to_owned(),
    };
    scene = scene.with_environment(soft());
    let glance = look(&scene);
    let surrounded = glance.lit();
    if surrounded < ENOUGH {
        let (lamp, position, intensity) = framing::lamp(&scene, &*accel, glance.distance2());
        let told = format!("a point light of {intensity} W/sr at {position}");
        let with_lamp = scene.clone().with_light(lamp);
        if look(&with_lamp).lit() > surrounded {
            let told = format!("{} and, as little of that gets in, {told}", surroundings());
            notes.push(note(path, &problem, &told));
            return with_lamp;
        }
    }
    if surrounded > own || !has_own {
        notes.push(note(path, &problem, &surroundings()));
        return scene;
    }
    scene.with_environment(None)
}

fn note(path: &Path, problem: &str, put: &str) -> Note {
    Note::chosen(format!("{}: {problem}; put {put} ({OTHERWISE})", path.display()))
}

fn surroundings() -> String {
    let [low, high] = SOFT;
    format!("soft gray light around it, of radiance {low} below to {high} above")
}
