//! Sensors behind lenses of glass: one element against the ideal thin lens, an objective of six
//! against exact rays through its prescription.

mod common;
#[allow(dead_code)]
#[path = "../examples/make_scenes/lens.rs"]
mod lens;
#[allow(dead_code)]
#[path = "../examples/make_scenes/mesh.rs"]
mod mesh;
mod optics;
#[allow(dead_code)]
#[path = "../examples/make_scenes/profile.rs"]
mod profile;
#[allow(dead_code)]
#[path = "../examples/make_scenes/shapes.rs"]
mod shapes;

use bdpm::Settings;
use bdpm::bsdf::{Bsdf, Dielectric};
use bdpm::scene::{Camera, FieldOfView, Material, Optics};
use common::*;
use glam::{DVec2, Vec3, dvec2};
use lens::Surface;
use optics::sequential::image;
use optics::{Picture, loaded};
use std::f64::consts::PI;

const RADIANCE: f64 = 3.0;

/// A biconvex lens of 50 mm behind its stop, f/10: aberrations are small against pixels.
const SINGLET: [Surface; 3] = [
    Surface { radius: 0.0, thickness: 0.2, index: 1.0, diameter: 5.0 },
    Surface { radius: 50.0, thickness: 0.6, index: 1.5, diameter: 6.0 },
    Surface { radius: -50.0, thickness: 0.0, index: 1.0, diameter: 6.0 },
];

/// Of the plane that is sharp.
const FOCUS: f64 = 200.0;

/// Squares that face the lens, by their center, distance and half side. Those out of focus are near
/// the axis: the field of one element is curved.
const SQUARES: [(DVec2, f64, f64); 5] = [
    (dvec2(0.0, 0.0), 100.0, 0.4),
    (dvec2(36.0, 0.0), 1000.0, 4.0),
    (dvec2(-9.0, 0.0), FOCUS, 0.8),
    (dvec2(0.0, 9.0), FOCUS, 0.8),
    (dvec2(6.0, -9.0), FOCUS, 0.8),
];

/// The light of `SQUARES` as a camera sees it, with the meshes of its lens.
fn squares(camera: Camera, lens: Vec<bdpm::scene::Mesh>, side: u32) -> Vec<[f64; 2]> {
    let mut meshes = lens;
    for (center, distance, half) in SQUARES {
        let center = center.extend(-distance).as_vec3();
        meshes.push(square(center, Vec3::Z, half as f32, 0));
    }
    let glass = Material::new("glass", Bsdf::Dielectric(Dielectric { eta: 1.5 }));
    let materials = vec![gray(0.0, RADIANCE as f32), gray(0.0, 0.0), glass];
    let scene = scene(meshes, materials, vec![], camera);
    let settings = Settings { camera_paths: 32, light_paths: 2, ..settings(side, side) };
    pixel_means(&scene, settings, 80)
}

#[test]
fn one_element_is_a_thin_lens() {
    let lens = SINGLET;
    let [behind, magnification] = image(&lens, FOCUS);
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

    // The same plane sharp, through the same stop, at the same scale.
    let across = f64::from(width) / -magnification;
    let field_of_view = FieldOfView::X(2.0 * (0.5 * across / FOCUS).atan().to_degrees() as f32);
    let (aperture_radius, focus_distance) = (2.5, FOCUS as f32);
    let thin = Optics::ThinLens { field_of_view, aperture_radius, focus_distance };
    let camera = Camera::with_optics(Vec3::ZERO, -Vec3::Z, Vec3::Y, thin).unwrap();
    let ideal = Picture { pixels: squares(camera, vec![], side), side: side as usize, pitch };

    // The stop is a polygon.
    let corner = 2.0 * PI / lens::SEGMENTS as f64;
    let stop = PI * 2.5 * 2.5 * corner.sin() / corner;
    let glass = (1.0 - 0.2_f64.powi(2)).powi(2);
    let mut transmitted = Vec::new();
    for (center, distance, half) in SQUARES {
        let place = center / distance * FOCUS * -magnification;
        let [real, ideal] = [&real, &ideal].map(|picture| picture.spot(place, 1.2));
        println!("{center} {distance}: {real:?}\n  {ideal:?}");

        // What the stop lets in of the square's light, cos^4 and all, less two reflections.
        let cos = distance / center.length().hypot(distance);
        let solid_angle = stop * cos.powi(4) / distance.powi(2);
        let arriving = solid_angle * RADIANCE * (2.0 * half).powi(2);
        real.energy.assert_is(glass * arriving, 3e-3);
        transmitted.push([real.energy.mean / arriving, real.energy.error / arriving]);
        // The thin lens tells radiance.
        let irradiance = glass * solid_angle * (distance / FOCUS / magnification).powi(2);
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
        let blur = 2.5 * FOCUS * -magnification * (1.0 / distance - 1.0 / FOCUS).abs();
        let size = 2.0 * half / distance * FOCUS * -magnification;
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

#[test]
fn explore() {
    use glam::DVec3;
    use optics::sequential::*;
    let l = &lens::DOUBLE_GAUSS;
    let d = lens::depths(l)[10];
    println!("{:?} {:?}", paraxial(l, 1.0, 0.0), image(l, 1e9));
    for dist in [1e6, 2000.0, 1500.0, 1200.0, 1000.0] {
        let par = image(l, dist);
        println!("dist {dist}: paraxial {par:?}");
        for x in [0.0, 0.15, 0.3] {
            for k in -10..=6 {
                let off = 0.05 * f64::from(k);
                let a = arrival(l, DVec3::new(x * dist, 0.0, -dist), d + par[0] + off);
                println!(
                    "  {x} {off:.2}: {} {:.1} um, E {:.4}",
                    a.place.x,
                    1e3 * a.spread.sqrt(),
                    a.energy * dist * dist
                );
            }
        }
    }
}
