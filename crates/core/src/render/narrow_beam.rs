//! Beams of light in media that are narrower than the discs on which their photons are merged.

use crate::scene::{Emitter, LightSource, Scene};
use crate::settings::Settings;

/// Share of the size of a scene along a beam. A beam that is wider than merges from there on is
/// blurred over a small part of its way only.
const SHARE: f32 = 0.25;

/// Name of a spot whose beam merges in scattering media blur, with these settings; `None` without
/// one. Nested radii do not show all of this bias: within a radius of the beam, the image is
/// brighter than dark surroundings by any factor.
pub fn narrow_beam(scene: &Scene, settings: &Settings) -> Option<String> {
    let scatters = scene.media().is_some_and(|media| media.any_scatters());
    if !(scatters && settings.has_photons()) {
        return None;
    }
    let radius = settings.reach() * settings.medium_scale as f32;
    let is_narrow = |source: &LightSource| {
        let LightSource::Light(index) = source else { return false };
        let Some(Emitter::Spot(spot)) = scene.lights().emitters().get(*index) else { return false };
        let sine = (1.0 - spot.cos_outer * spot.cos_outer).max(0.0).sqrt();
        // Cones of more than a right angle are no beams.
        let half_width = SHARE * scene.size() * (sine / spot.cos_outer) as f32;
        spot.cos_outer > 0.0 && half_width < radius
    };
    scene.light_sources().into_iter().find(|(source, _)| is_narrow(source)).map(|(_, name)| name)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::math::Rgb;
    use crate::scene::bsdf::Bsdf;
    use crate::scene::{Camera, Falloff, FieldOfView, Material, Medium, Mesh, Spot};
    use crate::settings::{PartialSettings, Strategy};
    use glam::Vec3;
    use std::sync::Arc;

    #[test]
    fn only_beams_narrower_than_merges_in_scattering_media_are_named() {
        let named = |degrees: f64, scattering: f32, strategy: Strategy| {
            let spot = Spot {
                position: Vec3::Z,
                direction: Vec3::NEG_Z,
                intensity: Rgb::ONE,
                cos_inner: (0.5 * degrees).to_radians().cos(),
                cos_outer: degrees.to_radians().cos(),
                falloff: Falloff::Quadratic,
            };
            // 10 units across: merges have a radius of 0.05 at surfaces, and of 0.1 in the medium.
            let ground = Mesh {
                positions: vec![Vec3::ZERO, 10.0 * Vec3::X, 10.0 * Vec3::Y],
                triangles: vec![[0, 1, 2]],
                ..Mesh::default()
            };
            let gray = Material::new("gray", Bsdf::diffuse(Vec3::splat(0.5)));
            let camera = Camera::look(Vec3::Z, -Vec3::Z, Vec3::Y, FieldOfView::X(60.0)).unwrap();
            let lights = vec![Emitter::Spot(spot)];
            let scene =
                Scene::new("fog".into(), vec![ground], vec![gray], lights, camera, vec![]).unwrap();
            let fog = Medium {
                name: "fog".into(),
                absorption: Rgb::splat(0.1),
                scattering: Rgb::splat(scattering),
                asymmetry: 0.0,
                priority: 0,
            };
            let scene = scene.with_filling_medium(Some(Arc::new(fog))).unwrap();
            let none = PartialSettings::default();
            let settings = Settings::resolve(&none, &none, scene.size()).unwrap();
            let own = Settings { strategy, radius: 0.05, caustic_radius: 0.02, ..settings };
            narrow_beam(&scene, &own)
        };
        // At a quarter of the size, 2.5 units, a beam of 2.3 degrees is as wide as merges.
        assert_eq!(named(1.0, 0.5, Strategy::Single).as_deref(), Some("light 1"));
        assert_eq!(named(5.0, 0.5, Strategy::Single), None, "wide");
        assert_eq!(named(1.0, 0.0, Strategy::Single), None, "nothing scatters");
        assert_eq!(named(1.0, 0.5, Strategy::Path), None, "nothing merges");
        assert_eq!(named(100.0, 0.5, Strategy::Single), None, "no beam");
    }
}
