//! Checks of a scene that no single part of its file can fail.

use bdpm_core::base::error::{Error, Result};
use bdpm_core::base::math::Rgb;
use bdpm_core::scene::{Emitter, Material, Scene};
use bdpm_import::{Warning, WarningKind, problems};

/// Refuses a scene without light, and one whose light overflows.
pub(super) fn require_light(scene: &Scene) -> Result<()> {
    if scene.lights().is_empty() {
        let advice = "add a `[[light]]` table to the scene file, give a material an `emission`, or \
                      give an environment of radiance 1";
        return Err(Error::new("the scene has no light", advice));
    }
    if !scene.lights().power().is_finite() {
        let problem = format!("the power of all lights overflows{}", strongest(scene));
        return Err(Error::new(problem, "lower their intensity or emission"));
    }
    Ok(())
}

/// Names the light that makes the power of all overflow, as the end of a sentence.
fn strongest(scene: &Scene) -> String {
    let emitters = scene.lights().emitters();
    let power = |emitter: &Emitter| {
        let largest = emitter.power().max_element();
        if largest.is_nan() { f32::INFINITY } else { largest }
    };
    let first = emitters.iter().max_by(|a, b| power(a).total_cmp(&power(b)));
    let of_all: Rgb = emitters.iter().map(Emitter::power).sum();
    match first {
        Some(Emitter::Triangle { .. } | Emitter::Textured(_)) if !of_all.is_finite() => {
            let emission = |own: &&Material| own.emission.max_element();
            let materials = scene.materials().iter();
            let brightest = materials.max_by(|a, b| emission(a).total_cmp(&emission(b)));
            brightest.map_or_else(String::new, |own| {
                format!("; the material `{}` has the largest emission", own.name)
            })
        }
        Some(first) if !of_all.is_finite() => match first.position() {
            Some(position) => {
                format!("; the strongest light is at {}", scene.in_file(position))
            }
            None => "; the strongest light is parallel".to_owned(),
        },
        _ => "; the environment is the strongest".to_owned(),
    }
}

/// Refuses a scene if anything was skipped.
pub(super) fn require_complete(warnings: &[Warning]) -> Result<()> {
    let skipped = warnings.iter().filter(|warning| warning.kind == WarningKind::Skipped);
    let text = problems(skipped.map(|warning| &warning.text[..]));
    if text.is_empty() {
        return Ok(());
    }
    let advice = "change the files, or load the scene without strict checking";
    Err(Error::new(format!("not all of the scene can be rendered: {text}"), advice))
}
