//! Aimed light paths meet small objects and carry their flux.

use super::*;
use crate::base::rng::{Stream, StreamKey};
use crate::scene::bsdf::{Bsdf, Dielectric};
use crate::scene::lights::emitter::Falloff;
use crate::scene::lights::primary_sample;
use crate::scene::{Camera, Directional, Environment, FieldOfView, Material, Mesh, Spot};

/// A cube of glass on a ground of this half side.
fn cube_on_ground(half: f32, lights: Vec<Emitter>, sky: Option<f32>) -> Scene {
    let corner = |i: u32| {
        let [x, y, z] = [i & 1, i >> 1 & 1, i >> 2].map(|bit| bit as f32 - 0.5);
        Vec3::new(3.0 + x, 1.0 + y, z - 2.0)
    };
    let cube = Mesh {
        positions: (0..8).map(corner).collect(),
        triangles: vec![[0, 1, 2], [5, 4, 7], [0, 4, 1], [2, 3, 6], [0, 2, 4], [1, 5, 3]],
        ..Mesh::default()
    };
    let place = |x: f32, z: f32| Vec3::new(half * x, 0.0, half * z);
    let ground = Mesh {
        positions: vec![place(-1.0, -1.0), place(-1.0, 1.0), place(1.0, 1.0), place(1.0, -1.0)],
        triangles: vec![[0, 1, 2], [0, 2, 3]],
        material: 1,
        ..Mesh::default()
    };
    let materials = vec![
        Material::new("glass", Bsdf::Dielectric(Dielectric::new(1.5))),
        Material::new("ground", Bsdf::diffuse(Vec3::splat(0.5))),
    ];
    let camera = Camera::look(Vec3::Y, -Vec3::Y, Vec3::Z, FieldOfView::X(60.0)).unwrap();
    let meshes = vec![cube, ground];
    let scene = Scene::new("cube".into(), meshes, materials, lights, camera, vec![]).unwrap();
    let map = sky.map(|radiance| Environment::new(2, 1, vec![Vec3::splat(radiance); 2], 0.0));
    scene.with_environment(map)
}

fn sun() -> Emitter {
    Emitter::Directional(Directional::new(Vec3::new(0.6, -0.8, 0.0), Vec3::splat(3.0)))
}

fn spot() -> Emitter {
    let position = Vec3::new(0.0, 60.0, 0.0);
    let direction = Vec3::new(0.05, -1.0, 0.0).normalize();
    let intensity = Vec3::splat(2e5);
    let falloff = Falloff::default();
    let (cos_inner, cos_outer) = (0.9, 0.8);
    Emitter::Spot(Spot { position, direction, intensity, cos_inner, cos_outer, falloff })
}

fn lamp() -> Emitter {
    let corners = [Vec3::new(9.0, 40.0, 0.0), Vec3::new(9.0, 40.0, 1.0), Vec3::new(8.0, 40.0, 0.0)];
    let shape = crate::scene::Triangle::new(corners, 0);
    Emitter::Triangle { shape, radiance: Vec3::splat(1e5) }
}

/// Share of the light paths that meet the ball around the cube, and the mean flux that they
/// carry to it, with its standard error.
fn share_and_flux(scene: &Scene, guide: &Guide, paths: u32) -> (f64, [f64; 2]) {
    let ball = Ball { center: Vec3::new(3.0, 1.0, -2.0), radius: 0.75f32.sqrt() };
    let mut rng = StreamKey::new(3, Stream::Test, 0).rng(0);
    let (mut met, mut sum, mut squares) = (0.0, 0.0, 0.0);
    for _ in 0..paths {
        let (_, emission) = scene.lights().emit_guided(guide, primary_sample(&mut rng));
        let away = ball.center - emission.origin;
        let along = away.dot(emission.direction);
        let off = (away - along * emission.direction).length();
        if along > 0.0 && off < ball.radius {
            let flux = f64::from(luminance(emission.flux));
            met += 1.0;
            sum += flux;
            squares += flux * flux;
        }
    }
    let n = f64::from(paths);
    let mean = sum / n;
    (met / n, [mean, ((squares / n - mean * mean) / n).sqrt()])
}

#[test]
fn aimed_paths_meet_small_casters_and_carry_their_flux() {
    let kinds = [
        ("sun", vec![sun()], None),
        ("sky", vec![], Some(0.4)),
        ("sun and sky", vec![sun()], Some(0.4)),
        ("spot", vec![spot()], None),
        ("lamp", vec![lamp()], None),
        ("all", vec![sun(), spot(), lamp()], Some(0.4)),
    ];
    for (name, lights, sky) in kinds {
        let small = cube_on_ground(30.0, lights.clone(), sky);
        // The true flux, by many paths that are not aimed.
        let (even, expected) = share_and_flux(&small, &Guide::even(), 4_000_000);
        let guide = Guide::aimed(&small).unwrap_or_else(|| panic!("{name}"));
        let (share, flux) = share_and_flux(&small, &guide, 100_000);
        // A third of the aimed ball is outside of the ball, and boxes around the rays of a sky,
        // whose places on the disc turn with the direction, have room.
        assert!(share > 0.12 * AIMED_SHARE && share > 4.0 * even, "{name}: {share} {even}");
        let error = flux[1].hypot(expected[1]);
        assert!((flux[0] - expected[0]).abs() < 4.0 * error, "{name}: {flux:?} {expected:?}");
        // As many paths that are not aimed, a fortieth of those above, have over twice the noise.
        let unaimed = 40f64.sqrt() * expected[1];
        assert!(flux[1] < 0.5 * unaimed, "{name}: {flux:?} {unaimed}");
    }
}

/// Boxes of any two sides have about as many rays as their area says: one without rays would look
/// empty. Multiples of powers of the root of `x^6 = x + 1` had none in some, and light paths of a
/// sun that started there toward a pool carried 32,000 times the mean flux.
#[test]
fn rays_fill_each_pair_of_sides() {
    let numbers = even_numbers();
    for (one, other) in (0..5).flat_map(|one| (0..one).map(move |other| (one, other))) {
        let mut counts = [0u32; 256];
        for own in &numbers {
            let [x, y] = [one, other].map(|side| (16.0 * own[side]) as usize);
            counts[16 * x + y] += 1;
        }
        let expected = RAYS as u32 / 256;
        let fill = expected / 2..=2 * expected;
        assert!(counts.iter().all(|count| fill.contains(count)), "{one} {other}");
    }
}

/// No path to the cube carries far more flux than others.
#[test]
fn no_path_to_a_small_caster_carries_far_more_than_others() {
    let scene = cube_on_ground(300.0, vec![sun()], Some(0.1));
    let ball = Ball { center: Vec3::new(3.0, 1.0, -2.0), radius: 0.75f32.sqrt() };
    let aimed = Guide::aimed(&scene).unwrap();
    let mut rng = StreamKey::new(4, Stream::Test, 0).rng(0);
    let (mut sum, mut squares, mut met) = (0.0, 0.0, 0.0);
    for _ in 0..1_000_000 {
        let (_, emission) = scene.lights().emit_guided(&aimed, primary_sample(&mut rng));
        let away = ball.center - emission.origin;
        let along = away.dot(emission.direction);
        if along > 0.0 && (away - along * emission.direction).length() < ball.radius {
            let flux = f64::from(luminance(emission.flux));
            (sum, squares, met) = (sum + flux, squares + flux * flux, met + 1.0);
        }
    }
    let moment = squares * met / (sum * sum);
    assert!(met > 1000.0 && moment < 3.0, "{met} {moment}");
}

/// The noise of the flux to the cube hardly depends on the size of the ground.
#[test]
fn aim_does_not_depend_on_the_size_of_the_ground() {
    let noise = |half: f32| {
        let scene = cube_on_ground(half, vec![sun()], None);
        let guide = Guide::aimed(&scene).unwrap();
        let (_, [mean, error]) = share_and_flux(&scene, &guide, 100_000);
        (mean, error)
    };
    let [small, large, huge] = [30.0, 3000.0, 1e5].map(noise);
    for (mean, error) in [large, huge] {
        assert!((mean - small.0).abs() < 4.0 * error.hypot(small.1), "{mean} {small:?}");
        assert!(error < 1.1 * small.1, "{error} {small:?}");
    }
}

#[test]
fn nothing_is_aimed_without_casters_or_where_all_light_meets_them() {
    let scene = cube_on_ground(1.0, vec![sun()], None);
    assert!(Guide::aimed(&scene).is_none(), "a third of the light meets the cube");
    let point = Emitter::Point { position: Vec3::new(3.0, 1.0, -2.0), intensity: Vec3::ONE };
    let scene = cube_on_ground(3000.0, vec![point], None);
    assert!(Guide::aimed(&scene).is_none(), "the light is inside of the cube");
    let scene = cube_on_ground(3000.0, vec![sun()], None);
    assert!(Guide::aimed(&scene).is_some());
    let only = scene.copies().split_off(1);
    let camera = scene.camera;
    let materials = scene.materials().to_vec();
    let bare = Scene::new("bare".into(), only, materials, vec![sun()], camera, vec![]).unwrap();
    assert!(Guide::aimed(&bare).is_none(), "there is no caster");
}
