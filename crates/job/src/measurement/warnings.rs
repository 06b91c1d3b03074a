//! Errors that a measurement does not know.

use crate::job::RenderResult;
use bdpm_core::scene::{NormalLoss, Scene};

/// Smallest share of the light that is worth a note, of each reflection.
const LEAST_SHARE: f64 = 1e-3;

/// Number of materials that a note names.
const NAMED: usize = 5;

/// A warning if the merge bias of a render is unknown: nested radii are measured only where the
/// pilot ran.
pub(super) fn unknown_bias(result: &RenderResult) -> Option<String> {
    let merges = result.state.provenance.settings.has_photons();
    let text = "path counts are fixed, so that the merge bias is not measured: uncertainties are those of the noise";
    (merges && result.selection().is_none()).then(|| text.to_owned())
}

/// A warning if shading normals lose light, with the share at each reflection by the materials
/// that lose most. Uncertainties do not include this light.
pub fn normal_loss(scene: &Scene) -> Option<String> {
    let mut all = scene.light_lost_by_normals();
    all.retain(|own| own.share >= LEAST_SHARE);
    all.sort_by(|a, b| b.share.total_cmp(&a.share));
    let one = |own: &NormalLoss| format!("{:.1} % by `{}`", 100.0 * own.share, own.material);
    let mut names: Vec<String> = all.iter().take(NAMED).map(one).collect();
    if all.len() > NAMED {
        names.push(format!("less by {} others", all.len() - NAMED));
    }
    let text = || {
        format!(
            "normals off the facets lose light that uncertainties do not include, at each reflection up to {}: use flat or finer faces without normal maps",
            names.join(", ")
        )
    };
    (!all.is_empty()).then(text)
}

#[cfg(test)]
mod tests {
    use super::*;
    use bdpm_core::scene::bsdf::Bsdf;
    use bdpm_core::scene::{Camera, FieldOfView, Material, Mesh};
    use glam::Vec3;

    /// A scene with a triangle for each angle between its normals and its facet, degrees.
    fn scene(angles: &[f32]) -> Scene {
        let mesh = |(material, degrees): (u32, &f32)| {
            let (sin, cos) = degrees.to_radians().sin_cos();
            Mesh {
                positions: vec![Vec3::ZERO, Vec3::X, Vec3::Y],
                normals: vec![Vec3::new(sin, 0.0, cos); 3],
                triangles: vec![[0, 1, 2]],
                material,
                ..Mesh::default()
            }
        };
        let meshes: Vec<Mesh> = (0..).zip(angles).map(mesh).collect();
        let white = |degrees: &f32| {
            Material::new(&format!("at {degrees}"), Bsdf::diffuse(Vec3::splat(0.9)))
        };
        let materials = angles.iter().map(white).collect();
        let camera = Camera::look(Vec3::Z, -Vec3::Z, Vec3::Y, FieldOfView::X(60.0)).unwrap();
        Scene::new("some".into(), meshes, materials, vec![], camera, vec![]).unwrap()
    }

    #[test]
    fn note_names_the_materials_that_lose_most() {
        assert_eq!(normal_loss(&scene(&[0.0, 10.0])), None, "smooth surfaces lose nothing");
        // (1 - cos 60 degrees)/2 and (1 - cos 30 degrees)/2
        let note = normal_loss(&scene(&[30.0, 5.0, 60.0])).unwrap();
        assert!(note.contains("up to 25.0 % by `at 60`, 6.7 % by `at 30`:"), "{note}");
        let many = normal_loss(&scene(&[20.0, 30.0, 40.0, 50.0, 60.0, 70.0, 80.0])).unwrap();
        assert!(many.contains("by `at 40`, less by 2 others:"), "{many}");
    }
}
