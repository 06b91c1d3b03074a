//! Faces of glass and of a liquid that touch, overlap, or are closer than rounding errors: the
//! image is that of a small gap, or the faces are named.

use crate::common::fog::*;
use crate::common::*;
use bdpm::Scene;
use bdpm::scene::bsdf::{Bsdf, Dielectric};
use bdpm::scene::{Camera, FieldOfView, Material, Medium, Mesh};
use bdpm::settings::{Settings, Strategy};
use glam::Vec3;
use std::sync::Arc;

/// Gaps between both faces, scene units; negative where the bodies overlap.
const GAPS: [f32; 9] = [0.0, 1e-7, 1e-6, 1e-5, 1e-4, -1e-7, -1e-6, -1e-5, -1e-4];

fn body(name: &str, absorption: f32, eta: f32) -> Material {
    let medium = Medium {
        name: name.into(),
        absorption: Vec3::splat(absorption),
        scattering: Vec3::ZERO,
        asymmetry: 0.0,
        priority: 0,
    };
    Material {
        name: name.into(),
        ..around(&Arc::new(medium), Bsdf::Dielectric(Dielectric::new(eta)))
    }
}

/// A block of ink on a shining floor, below a block of glass, seen from above at a small angle. The
/// faces between them are in a plane at this height, across an axis or turned.
fn blocks(gap: f32, height: f32, turn: f32) -> Arc<Scene> {
    let (sin, cos) = turn.sin_cos();
    let turned = |mut mesh: Mesh| {
        for at in &mut mesh.positions {
            *at = Vec3::new(cos * at.x + sin * at.z, at.y, cos * at.z - sin * at.x);
            at.z += height;
        }
        mesh
    };
    let meshes = vec![
        turned(block(Vec3::new(0.0, 0.0, -0.5), 0.5, 1)),
        turned(block(Vec3::new(0.0, 0.0, 0.5 + gap), 0.5, 2)),
        turned(square(Vec3::new(0.0, 0.0, -1.5), Vec3::Z, 3.0, 0)),
    ];
    let materials = vec![gray(0.0, 1.0), body("ink", 0.7, 1.33), body("glass", 0.4, 1.5)];
    let up = Vec3::new(sin, 0.0, cos);
    let eye = Vec3::Z * height + 4.0 * up + 0.2 * Vec3::Y;
    let camera = Camera::look(eye, -up, Vec3::Y, FieldOfView::X(6.0)).unwrap();
    scene(meshes, materials, vec![], camera)
}

#[test]
fn glass_on_a_liquid_is_rendered_or_named_at_any_gap() {
    // With a gap that no rounding error reaches.
    let places = [(0.0, 0.0, 2e-3f32), (3.0, 0.0, 2e-3), (3.0, 0.6, 2e-3), (1000.0, 0.6, 0.05)];
    for (height, turn, wide_gap) in places {
        let own = |gap: f32| {
            let scene = blocks(gap, height, turn);
            let accel = accel(&scene);
            let settings =
                Settings { strategy: Strategy::Path, camera_paths: 16, ..settings(8, 8) };
            let mean = mean_luminance(&scene, &accel, settings, 64);
            (mean, scene.near_faces(&*accel))
        };
        let (wide, named) = own(wide_gap);
        assert_eq!(named, [], "{height}");
        let mut rendered = 0;
        for gap in GAPS {
            let (found, named) = own(gap);
            if !named.is_empty() {
                continue;
            }
            rendered += 1;
            let error = found.error.hypot(wide.error);
            // The gap shifts light, and the media by its own length.
            let off = (found.mean - wide.mean).abs() - 2.0 * f64::from(wide_gap) * wide.mean;
            assert!(off <= 4.0 * error, "{gap} at {height}: {found:?}, not {wide:?}");
        }
        // Near the origin, only faces closer than a rounding error are named.
        assert!(height > 0.0 || turn != 0.0 || rendered >= 4, "{rendered}");
    }
}
