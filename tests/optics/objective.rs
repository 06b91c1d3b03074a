//! Sensors behind lenses of glass: one element against the ideal thin lens, an objective of six
//! against exact rays through its prescription.

use super::sequential::{Ray, arrival, image, paraxial};
use super::{Picture, loaded};
use crate::common::*;
use crate::make_scenes::lens::{self, DOUBLE_GAUSS, Surface};
use bdpm::Settings;
use bdpm::load::load;
use bdpm::scene::bsdf::{Bsdf, Dielectric};
use bdpm::scene::{Camera, FieldOfView, Material, Mesh, Optics};
use glam::{DVec2, DVec3, Vec3, dvec2, dvec3};
use std::f64::consts::PI;
use std::path::Path;

const RADIANCE: f64 = 3.0;

/// A biconvex lens of 50 mm behind its stop, f/10: aberrations are small against pixels.
const SINGLET: [Surface; 3] = [
    Surface { radius: 0.0, thickness: 0.2, index: 1.0, diameter: 5.0 },
    Surface { radius: 50.0, thickness: 0.6, index: 1.5, diameter: 6.0 },
    Surface { radius: -50.0, thickness: 0.0, index: 1.0, diameter: 6.0 },
];

/// Distance of the plane that is sharp behind it.
const SHARP: f64 = 200.0;

/// Squares that face the lens, by their center, distance and half side. Those out of focus are near
/// the axis: the field of one element is curved.
const SQUARES: [(DVec2, f64, f64); 5] = [
    (dvec2(0.0, 0.0), 100.0, 0.4),
    (dvec2(36.0, 0.0), 1000.0, 4.0),
    (dvec2(-9.0, 0.0), SHARP, 0.8),
    (dvec2(0.0, 9.0), SHARP, 0.8),
    (dvec2(6.0, -9.0), SHARP, 0.8),
];

/// The light of `SQUARES` as a camera sees it, with the meshes of its lens.
fn squares(camera: Camera, lens: Vec<bdpm::scene::Mesh>, side: u32) -> Vec<[f64; 2]> {
    let mut meshes = lens;
    for (center, distance, half) in SQUARES {
        let center = center.extend(-distance).as_vec3();
        meshes.push(square(center, Vec3::Z, half as f32, 0));
    }
    let glass = Material::new("glass", Bsdf::Dielectric(Dielectric::new(1.5)));
    let materials = vec![gray(0.0, RADIANCE as f32), gray(0.0, 0.0), glass];
    let scene = scene(meshes, materials, vec![], camera);
    let settings = Settings { camera_paths: 32, light_paths: 2, ..settings(side, side) };
    pixel_means(&scene, settings, 80)
}

#[test]
fn one_element_matches_a_thin_lens() {
    let lens = SINGLET;
    let [behind, magnification] = image(&lens, SHARP);
    let (side, width) = (60, 9.0);
    let back = lens::depths(&lens)[2] + behind;

    let mut meshes: Vec<_> =
        lens::glass(&lens).iter().map(|interface| loaded(&interface.mesh, 2)).collect();
    meshes.push(loaded(&lens::mounts(&lens, 10.0, 10.0, back + 1.0), 1));
    let disc_distance = (behind - lens[2].sag()) as f32;
    let sensor = Optics::Sensor { width, disc_distance, disc_radius: 3.0, exposure: 1.0 };
    let position = Vec3::new(0.0, 0.0, back as f32);
    let camera = Camera::with_optics(position, -Vec3::Z, Vec3::Y, sensor).unwrap();
    let pitch = f64::from(width) / side as f64;
    let real = Picture { pixels: squares(camera, meshes, side), side: side as usize, pitch };

    // One plane in focus, through one stop, at one scale.
    let across = f64::from(width) / -magnification;
    let field_of_view = FieldOfView::X(2.0 * (0.5 * across / SHARP).atan().to_degrees() as f32);
    let (aperture_radius, focus_distance) = (2.5, SHARP as f32);
    let thin = Optics::ThinLens { field_of_view, aperture_radius, focus_distance };
    let camera = Camera::with_optics(Vec3::ZERO, -Vec3::Z, Vec3::Y, thin).unwrap();
    let ideal = Picture { pixels: squares(camera, vec![], side), side: side as usize, pitch };

    // The stop is a polygon.
    let corner = 2.0 * PI / lens::SEGMENTS as f64;
    let stop = PI * 2.5 * 2.5 * corner.sin() / corner;
    let glass = (1.0 - 0.2_f64.powi(2)).powi(2);
    let mut transmitted = Vec::new();
    for (center, distance, half) in SQUARES {
        let place = center / distance * SHARP * -magnification;
        let [real, ideal] = [&real, &ideal].map(|picture| picture.spot(place, 1.2));
        println!("{center} {distance}: {real:?}\n  {ideal:?}");

        // The square's light through the stop, by the cos^4 law, less two reflections.
        let cos = distance / center.length().hypot(distance);
        let solid_angle = stop * cos.powi(4) / distance.powi(2);
        let arriving = solid_angle * RADIANCE * (2.0 * half).powi(2);
        real.energy.assert_is(glass * arriving, 3e-3);
        transmitted.push([real.energy.mean / arriving, real.energy.error / arriving]);
        // The thin lens measures radiance.
        let irradiance = glass * solid_angle * (distance / SHARP / magnification).powi(2);
        let error = real.energy.error / irradiance;
        Estimate { mean: real.energy.mean / irradiance, error: error.hypot(ideal.energy.error) }
            .assert_is(ideal.energy.mean, 3e-3);

        let error = real.place_error.hypot(ideal.place_error);
        assert!(error < 0.02 * real.spread.mean.sqrt(), "{error}");
        assert!((real.place - place).length() < 4.0 * error + 0.01 * pitch, "{place}");
        assert!((real.place - ideal.place).length() < 4.0 * error + 0.01 * pitch);

        let error = real.spread.error.hypot(ideal.spread.error);
        Estimate { error, ..real.spread }.assert_is(ideal.spread.mean, 0.02);
        // A disc of the radius of the circle of confusion; moments add, pixels are squares as well.
        // Sharp edges meet pixels as they happen to.
        let blur = 2.5 * SHARP * -magnification * (1.0 / distance - 1.0 / SHARP).abs();
        let size = 2.0 * half / distance * SHARP * -magnification;
        let expected = 0.5 * blur.powi(2) + (size.powi(2) + pitch.powi(2)) / 6.0;
        if blur > pitch {
            real.spread.assert_is(expected, 0.02);
        }
    }
    let n = transmitted.len() as f64;
    let mean = transmitted.iter().map(|[mean, _]| mean).sum::<f64>() / n;
    let error = transmitted.iter().map(|[_, error]| error * error).sum::<f64>().sqrt() / n;
    Estimate { mean, error }.assert_is(glass, 3e-3);
}

/// Before the lens, sharp in the scene, millimeters.
const FOCUS: f64 = 500.0;

/// The double Gauss as the scene has it: its meshes and materials, and the camera.
fn committed() -> (Vec<Mesh>, Vec<Material>, Camera) {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes/objective");
    let scene = load(&path).unwrap().scene;
    let mut meshes = scene.meshes().to_vec();
    meshes.retain(|mesh| mesh.name.starts_with("lens"));
    assert_eq!(meshes.len(), 11);
    (meshes, scene.materials().to_vec(), scene.camera)
}

/// Depth of the scene's sensor and the radius of its disc, millimeters.
fn sensor(camera: &Camera) -> [f64; 2] {
    let Optics::Sensor { disc_radius, .. } = camera.optics() else { panic!("no sensor") };
    [camera.position().z, disc_radius].map(|meters| 1e3 * f64::from(meters))
}

#[test]
fn prescription_has_focal_length_and_aperture_of_a_50_mm_f_2() {
    let lens = &DOUBLE_GAUSS;
    let last = lens::depths(lens)[lens.len() - 1];
    let [height, slope] = paraxial(lens, 1.0, 0.0);
    let (focal_length, back_focal_length) = (-1.0 / slope, -height / slope);
    // Published: 50 mm, and 72.228 mm at twice the size.
    assert!((focal_length / 50.0 - 1.0).abs() < 0.01, "{focal_length}");
    assert!((back_focal_length / 36.114 - 1.0).abs() < 5e-4, "{back_focal_length}");

    // Exact rays close to the axis meet where paraxial ones do.
    let parallel = |height: f64| {
        let from = dvec3(0.0, height, -10.0);
        Ray::between(from, from + DVec3::Z).through(lens)
    };
    let ray = parallel(0.01).unwrap();
    let across = ray.direction.y / ray.direction.z;
    assert!((ray.origin.y / -across / back_focal_length - 1.0).abs() < 1e-6);
    assert!((0.01 / -across / focal_length - 1.0).abs() < 1e-6);

    // The pupil by bisection: the highest ray that the stop lets through is f/2.
    let (mut inside, mut outside) = (5.0, 20.0);
    while outside - inside > 1e-9 {
        let middle = 0.5 * (inside + outside);
        *(if parallel(middle).is_some() { &mut inside } else { &mut outside }) = middle;
    }
    let number = focal_length / (2.0 * inside);
    assert!((number / 2.0 - 1.0).abs() < 0.02, "f/{number}");
    // As paraxially, the stop seen through the elements before it, but for aberrations.
    let at_stop = paraxial(&lens[..5], 1.0, 0.0)[0];
    assert!((inside * at_stop / (0.5 * lens[5].diameter) - 1.0).abs() < 0.02, "{inside}");

    // A point's light is within 1/1000 of the picture's height where the scene's sensor is, and
    // nowhere near as narrow a little before and behind it.
    let [sensor, disc] = sensor(&committed().2);
    let [behind, magnification] = image(lens, FOCUS);
    assert!((sensor - last - behind).abs() < 1e-3 && magnification < 0.0, "{sensor} {behind}");
    let blur = |off: f64| arrival(lens, dvec3(0.0, 0.0, -FOCUS), sensor + off).spread.sqrt();
    assert!(blur(0.0) < 0.024 && blur(-0.2) > 2.0 * blur(0.0) && blur(0.2) > 2.0 * blur(0.0));
    assert!((disc - 0.5 * lens[lens.len() - 1].diameter).abs() < 1e-5, "{disc}");
}

#[test]
fn rendered_objective_matches_exact_rays() {
    let lens = &DOUBLE_GAUSS;
    let [sensor, disc] = sensor(&committed().2);
    let rear = lens::depths(lens)[lens.len() - 1] + lens[lens.len() - 1].sag();
    // A small emitter: its place, half its side, and half the width of the region compared.
    for (from, half, reach) in [
        (dvec3(0.0, 0.0, -FOCUS), 0.4, 0.15),
        (dvec3(40.0, 25.0, -FOCUS), 0.4, 0.2),
        (dvec3(0.0, 0.0, -350.0), 1.0, 1.0),
        (dvec3(-80.0, 50.0, -1000.0), 3.0, 1.0),
    ] {
        let expected = arrival(lens, from, sensor);
        let aside = arrival(lens, from + DVec3::X, sensor);
        let size = 2.0 * half * (aside.place - expected.place).length();
        let (mut meshes, mut materials, _) = committed();
        let emitter = materials.len() as u32;
        materials.push(gray(0.0, RADIANCE as f32));
        let side = 32;
        meshes.push(square(1e-3 * from.as_vec3(), Vec3::Z, 1e-3 * half as f32, emitter));
        // A sensor of its own around the image; it turns pictures upright.
        let center = expected.place.extend(sensor);
        let optics = Optics::Sensor {
            width: 2e-3 * reach as f32,
            disc_distance: 1e-3 * (sensor - rear) as f32,
            disc_radius: 1e-3 * (disc + expected.place.length()) as f32,
            exposure: 1.0,
        };
        let position = 1e-3 * center.as_vec3();
        let camera = Camera::with_optics(position, -Vec3::Z, Vec3::Y, optics).unwrap();
        let scene = scene(meshes, materials, vec![], camera);
        let settings = Settings { camera_paths: 32, light_paths: 2, ..settings(side, side) };
        let pixels = pixel_means(&scene, settings, 24);
        let pitch = 2.0 * reach / f64::from(side);
        let picture = Picture { pixels, side: side as usize, pitch };
        let found = picture.spot(DVec2::ZERO, reach);
        println!("{from}: {found:?}\n  {expected:?}");

        let emitted = RADIANCE * (2.0 * half).powi(2);
        found.energy.assert_is(expected.energy * emitted, 3e-3);
        // As in the sensor's middle.
        let error = found.place_error;
        assert!(error < 0.02 * found.spread.mean.sqrt(), "{error}");
        assert!(found.place.length() < 4.0 * error + 0.01 * pitch, "{}", found.place);
        // Moments of the blur, of the emitter and of a pixel; facets add some um of blur.
        let spread = expected.spread + (size.powi(2) + pitch.powi(2)) / 6.0;
        found.spread.assert_is(spread + 0.006_f64.powi(2), 0.01);
    }
}

#[test]
fn all_light_comes_through_the_lens() {
    let light = |capped: bool| {
        let (mut meshes, mut materials, camera) = committed();
        let material = materials.len() as u32;
        materials.extend([gray(0.0, RADIANCE as f32), gray(0.0, 0.0)]);
        meshes.push(sphere(Vec3::ZERO, 1.0, 2, true, material));
        if capped {
            // Around the front as far as behind the first element.
            meshes.push(sphere(Vec3::ZERO, 0.016, 4, false, material + 1));
        }
        let scene = scene(meshes, materials, vec![], camera);
        let settings = Settings { camera_paths: 16, light_paths: 2, ..settings(24, 16) };
        pixel_means(&scene, settings, 20).iter().map(|[mean, _]| mean).sum::<f64>()
    };
    assert!(light(false) > 1.0);
    assert_eq!(light(true), 0.0);
}
