//! The camera of scenes without one.

use super::camera_change::CameraChange;
use bdpm_core::scene::Scene;
use bdpm_import::{WHOLE_VIEW_DEGREES, Warning};
use std::path::Path;

/// A warning about the default camera of the scene, unless `change` replaces its position.
pub(super) fn warning(scene: &Scene, change: &CameraChange, file: &Path) -> Option<Warning> {
    if change.from.is_some() || change.look_at.is_some() {
        return None;
    }
    let (file, position) = (file.display(), scene.in_file(scene.camera.position()));
    let degrees = change.fov.unwrap_or(WHOLE_VIEW_DEGREES);
    let text = format!("{file}: no camera; added one at {position}, {degrees} degrees high");
    Some(Warning::chosen(text))
}
