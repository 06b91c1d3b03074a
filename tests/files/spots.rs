//! Penumbras of spots follow the formulas of the formats, by connections and by light paths.

use crate::common::gltf::{SQUARE_OBJ, files};
use crate::common::{accel, mean_luminance, settings};
use bdpm::base::photometry::LUMENS_PER_WATT;
use bdpm::base::rng::{Stream, StreamKey};
use bdpm::load::{Loaded, export, load};
use bdpm::scene::{Emitter, Receiver, Scene, Spot};
use bdpm::settings::{Direct, Settings};
use glam::Vec3;

/// A spot 2 above a plane, of 4 W/sr.
fn mitsuba(keys: &str) -> Loaded {
    let text = format!(
        "<scene version='3.0.0'><sensor type='orthographic'><transform name='to_world'>
         <lookat origin='0,0,1.9' target='0,0,0' up='0,1,0'/></transform></sensor>
         <emitter type='spot'><transform name='to_world'>
         <lookat origin='0,0,2' target='0,0,0' up='0,1,0'/></transform>
         <rgb name='intensity' value='4'/><float name='cutoff_angle' value='20'/>{keys}</emitter>
         <shape type='rectangle'><transform name='to_world'><scale value='3'/></transform>
         <bsdf type='diffuse'/></shape></scene>"
    );
    files(&[("a.xml", text.as_bytes())]).load()
}

fn pbrt(cone: f64, delta: f64) -> Loaded {
    let text = format!(
        "Scale -1 1 1\nLookAt 0 0 1.9  0 0 0  0 1 0\n\
         Camera \"orthographic\" \"float screenwindow\" [-1 1 -1 1]\nWorldBegin\n\
         LightSource \"spot\" \"rgb I\" [4 4 4] \"point3 from\" [0 0 2] \"point3 to\" [0 0 0] \
         \"float coneangle\" {cone} \"float conedeltaangle\" {delta}\n\
         Shape \"trianglemesh\" \"point3 P\" [-3 -3 0  3 -3 0  3 3 0  -3 3 0] \
         \"integer indices\" [0 1 2 0 2 3]\n"
    );
    files(&[("a.pbrt", text.as_bytes())]).load()
}

/// Illuminance of the plane at this angle from the axis, lx.
fn lux(scene: &Scene, degrees: f32) -> f64 {
    let mut rng = StreamKey::new(3, Stream::Test, 0).rng(0);
    let position = Vec3::X * 2.0 * degrees.to_radians().tan();
    let at = Receiver { position, normal: Some(Vec3::Z) };
    let sample = scene.lights().connect(at, &mut rng);
    let watts = sample.map_or(0.0, |sample| f64::from(sample.irradiance.y * sample.wi.z));
    watts * f64::from(LUMENS_PER_WATT)
}

/// That of the full intensity.
fn full(degrees: f64) -> f64 {
    f64::from(LUMENS_PER_WATT) * degrees.to_radians().cos().powi(3)
}

/// Mitsuba: linear in the angle from the width of the beam to the cutoff.
#[test]
fn spots_of_mitsuba_fall_off_linearly_in_the_angle() {
    let beam = "<float name='beam_width' value='2'/>";
    for (keys, width) in [("", 15.0_f64), (beam, 2.0)] {
        let loaded = mitsuba(keys);
        assert!(!loaded.warnings_text().contains("falloff"), "{}", loaded.warnings_text());
        for degrees in [0.0_f64, 10.0, 17.5, 19.0, 19.9, 21.0] {
            let share = ((20.0 - degrees) / (20.0 - width)).clamp(0.0, 1.0);
            let (own, expected) = (lux(&loaded.scene, degrees as f32), share * full(degrees));
            assert!((own - expected).abs() < 0.02 + 1e-4 * expected, "{degrees}: {own} {expected}");
        }
    }
}

/// pbrt: a smooth step of the cosine.
#[test]
fn spots_of_pbrt_fall_off_by_a_smooth_step_of_the_cosine() {
    for (cone, delta) in [(20.0_f64, 5.0_f64), (60.0, 60.0), (5.0, 0.5)] {
        let loaded = pbrt(cone, delta);
        assert!(!loaded.warnings_text().contains("falloff"), "{}", loaded.warnings_text());
        let cosine = |degrees: f64| degrees.to_radians().cos();
        for part in [0.0, 0.3, 0.8, 0.95, 1.05] {
            let degrees = part * cone;
            let x = (cosine(degrees) - cosine(cone)) / (cosine(cone - delta) - cosine(cone));
            let x = x.clamp(0.0, 1.0);
            let (own, expected) =
                (lux(&loaded.scene, degrees as f32), x * x * (3.0 - 2.0 * x) * full(degrees));
            assert!((own - expected).abs() < 0.05 + 1e-3 * expected, "{degrees}: {own} {expected}");
        }
    }
}

/// Light paths carry the same light as connections.
#[test]
fn light_paths_have_the_same_penumbra() {
    for (name, loaded) in [
        ("linear", mitsuba("<float name='beam_width' value='2'/>")),
        ("smooth step", pbrt(20.0, 15.0)),
    ] {
        let scene = loaded.scene;
        let accel = accel(&scene);
        let of = |direct, iterations| {
            let settings = Settings {
                direct,
                light_paths: 50_000,
                radius: 0.05,
                caustic_radius: 0.05,
                ..settings(8, 8)
            };
            mean_luminance(&scene, &accel, settings, iterations)
        };
        let (connected, photons) = (of(Direct::Connect, 100), of(Direct::PhotonMap, 200));
        println!("{name}: {connected:?} {photons:?}");
        photons.assert_is(connected.mean, 0.01);
    }
}

/// The power, which chooses lights and light paths, is the integral of the intensity.
#[test]
fn power_of_each_falloff_is_its_integral() {
    for loaded in [mitsuba(""), mitsuba("<float name='beam_width' value='0'/>"), pbrt(20.0, 5.0)] {
        let Emitter::Spot(spot) = &loaded.scene.lights().emitters()[0] else { panic!() };
        let (n, end) = (20_000, 21_f64.to_radians());
        let across = spot.direction.any_orthonormal_vector();
        let ring = |i: u32| {
            let angle = (f64::from(i) + 0.5) / f64::from(n) * end;
            let (sin, cos) = angle.sin_cos();
            let direction = spot.direction * cos as f32 + across * sin as f32;
            f64::from(spot.share(direction)) * std::f64::consts::TAU * sin
        };
        let integral = (0..n).map(ring).sum::<f64>() * end / f64::from(n);
        let off = f64::from(spot.solid_angle()) / integral - 1.0;
        assert!(off.abs() < 1e-4, "{spot:?}: {off}");
    }
}

#[test]
fn scene_files_keep_the_falloff() {
    let spot = |loaded: &Loaded| -> Spot {
        let Emitter::Spot(spot) = loaded.scene.lights().emitters()[0] else { panic!() };
        spot
    };
    for loaded in [mitsuba(""), pbrt(20.0, 5.0)] {
        let folder = tempfile::tempdir().unwrap();
        let copy = folder.path().join("copy");
        export(&loaded, "a spot", &copy, false).unwrap();
        assert_eq!(spot(&load(&copy).unwrap()), spot(&loaded));
    }
    let scene = "mesh = [{ file = 'a.obj' }]\n\
                 camera = { position = [0, 0, 5], direction = [0, 0, -1], fov_x_deg = 40 }\n\
                 [[light]]\ntype = 'spot'\nposition = [0, 0, 2]\ndirection = [0, 0, -1]\n\
                 outer_deg = 20\nintensity = 1\nfalloff = 'sharp'\n";
    files(&[("a.obj", SQUARE_OBJ.as_bytes()), ("a.toml", scene.as_bytes())]).refused(&[
        "a.toml:9:",
        "sharp",
        "quadratic",
    ]);
}
