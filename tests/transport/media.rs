//! Media: against closed forms, and against the path tracer.

use crate::common::fog::*;
use crate::common::images::{Difference, Subject};
use crate::common::*;
use bdpm::noise::Measure;
use bdpm::scene::bsdf::{Bsdf, Dielectric, ThinDielectric};
use bdpm::scene::{Material, Medium, MediumBoundary, Mesh};
use bdpm::settings::Direct::{Connect, PhotonMap};
use bdpm::settings::MediumQuery::{Beams, Points};
use bdpm::settings::{Kernel, Strategy};
use bdpm::{Renderer, Scene, Settings};
use glam::{DVec3, Vec3};
use std::f64::consts::PI;
use std::sync::Arc;

/// Pixels across and down.
pub(super) const SIDE: u32 = 8;

/// Ways to merge around points and along segments: at one vertex, and with weights.
fn merging(base: &Settings) -> Vec<(String, Settings)> {
    let ways = [
        (Strategy::Single, Connect, 1, Points),
        (Strategy::Single, Connect, 2, Points),
        (Strategy::Single, PhotonMap, 1, Points),
        (Strategy::Single, PhotonMap, 2, Points),
        (Strategy::Single, Connect, 1, Beams),
        (Strategy::Single, PhotonMap, 2, Beams),
        (Strategy::Mis, Connect, 2, Points),
        (Strategy::Mis, Connect, 2, Beams),
        (Strategy::Mis, PhotonMap, 2, Beams),
        (Strategy::CutMis, Connect, 2, Beams),
        (Strategy::CutMis, PhotonMap, 2, Points),
    ];
    let of = |(strategy, direct, merge_vertex, medium_query)| {
        let name = format!("{direct:?} {strategy:?} k = {merge_vertex} {medium_query:?}");
        (name, Settings { strategy, direct, merge_vertex, medium_query, ..base.clone() })
    };
    ways.map(of).into()
}

/// Mean of the image by each strategy.
pub(super) fn means(
    scene: &Arc<Scene>,
    settings: &Settings,
    iterations: u64,
) -> Vec<(String, Estimate)> {
    let accel = accel(scene);
    let mut all = Vec::new();
    let path = Settings { strategy: Strategy::Path, merge_vertex: 2, ..settings.clone() };
    let mut ways = vec![("path".to_owned(), path)];
    ways.extend(merging(settings));
    for (name, settings) in ways {
        let subject = Subject { scene, accel: &accel, settings: &settings, region: &[] };
        let found = subject.rendered(settings.clone(), iterations);
        let count = found.mean.len() as f64;
        let mean = found.mean.iter().sum::<f64>() / count;
        all.push((name, Estimate { mean, error: found.variance_of_sum.sqrt() / count }));
    }
    all
}

/// Light of a panel is seen through slabs of absorbing medium with and without refraction, at a
/// right angle.
#[test]
fn slabs_absorb_by_the_distance() {
    let ink = medium(Vec3::new(0.2, 0.7, 1.5), Vec3::ZERO, 0.0);
    let glass = Bsdf::Dielectric(Dielectric::new(1.5));
    for (bsdf, clear) in [
        (Bsdf::ThinDielectric(ThinDielectric::new(1.0)), [1.0; 2]),
        // Transmittance of one face, and the sum over the reflections inside is done below.
        (glass, [0.96, 0.04]),
    ] {
        let meshes = vec![block(Vec3::ZERO, 0.5, 0), square(2.0 * Vec3::X, -Vec3::X, 3.0, 1)];
        let materials = vec![around(&ink, bsdf), gray(0.0, 1.0)];
        let eye = camera(-3.0 * Vec3::X, Vec3::ZERO, 0.01);
        let scene = scene(meshes, materials, vec![], eye);
        let settings = Settings { strategy: Strategy::Path, merge_vertex: 2, ..settings(4, 4) };
        let mut renderer = Renderer::new(&scene, &accel(&scene), settings).unwrap();
        for _ in 0..4000 {
            renderer.iterate(Measure::Off);
        }
        let mut sum = DVec3::ZERO;
        for pixel in renderer.film().sums.map_rows(|pixel| pixel.radiance) {
            sum += pixel / (16.0 * 4000.0);
        }
        for (channel, sigma) in [0.2, 0.7, 1.5f64].into_iter().enumerate() {
            let left = (-sigma).exp();
            let [through, back] = clear;
            let expected = if back == 1.0 {
                left
            } else {
                // Light that is reflected twice inside crosses the slab twice more.
                through * through * left / (1.0 - (back * left).powi(2))
            };
            // Without refraction there is no noise; with it, a path is reflected or not.
            let error = if back == 1.0 { 1e-5 } else { (0.25f64 / (64_000.0 * 4.0)).sqrt() };
            let found = sum[channel];
            assert!((found - expected).abs() < 4.0 * error, "{channel}: {found} {expected}");
        }
    }
}

/// Radiance that an isotropic point light scatters once into a ray that passes it, in a medium
/// without bounds.
fn scattered_once(absorption: f64, scattering: f64, g: f64, intensity: f64, along: f64) -> f64 {
    let (closest, steps) = (0.5f64, 200_000);
    let extinction = absorption + scattering;
    let step = 20.0 / f64::from(steps);
    let at = |i: u32| {
        let t = (f64::from(i) + 0.5) * step;
        let to_light = along - t;
        let distance = closest.hypot(to_light);
        // Light flies from the light source to the point, and then against the ray.
        let cos = to_light / distance;
        let phase = (1.0 - g * g) / (4.0 * PI * (1.0 + g * g - 2.0 * g * cos).powf(1.5));
        let left = (-extinction * (t + distance)).exp();
        scattering * phase * left * intensity / (distance * distance)
    };
    step * (0..steps).map(at).sum::<f64>()
}

/// Nearly all light is absorbed where it would be scattered again.
#[test]
fn point_light_in_an_unbounded_medium_is_scattered_once() {
    for g in [0.0, 0.6] {
        let (absorption, scattering, intensity, along) = (1.0, 1e-3, 2.0, 1.5);
        let light = point_light(Vec3::new(along, 0.5, 0.0), intensity);
        // Far behind and black: a scene needs some surface.
        let wall = square(100.0 * Vec3::X, -Vec3::X, 1.0, 0);
        let eye = camera(Vec3::ZERO, Vec3::X, 1e-3);
        let scene = scene(vec![wall], vec![gray(0.0, 0.0)], vec![light], eye);
        let scene = filled(scene, gray_medium(absorption, scattering, g));
        let expected = scattered_once(
            absorption.into(),
            scattering.into(),
            g.into(),
            intensity.into(),
            along.into(),
        );
        let settings = Settings {
            light_paths: 200_000,
            camera_paths: 256,
            radius: 0.03,
            caustic_radius: 0.03,
            medium_scale: 1.0,
            seed: 5,
            ..settings(SIDE, SIDE)
        };
        for (name, Estimate { mean, error }) in means(&scene, &settings, 20) {
            println!("g = {g}, {name}: {mean:.4e} +- {error:.1e}, {expected:.4e}");
            // Direct light from photons is noisy so near to the light source.
            let most = if name.starts_with("Photon") { 0.04 } else { 0.01 };
            assert!(error < most * expected, "says little: {name}");
            // Light that is scattered twice adds up to about a thousandth; balls blur it less.
            assert!((mean - expected).abs() < 4.0 * error + 2e-3 * expected, "{g} {name}");
        }
    }
}

/// A medium that absorbs nothing is invisible where the same radiance comes from all sides.
#[test]
fn lossless_medium_is_invisible_in_a_furnace() {
    let milk = medium(Vec3::ZERO, Vec3::new(3.0, 2.0, 1.0), 0.4);
    for bsdf in
        [Bsdf::ThinDielectric(ThinDielectric::new(1.0)), Bsdf::Dielectric(Dielectric::new(1.3))]
    {
        let mut meshes = cube(Vec3::ZERO, 1.0, true, 0);
        meshes.push(sphere(Vec3::ZERO, 0.5, 3, false, 1));
        let materials = vec![gray(0.0, 1.0), around(&milk, bsdf)];
        let eye = camera(Vec3::new(-0.9, 0.1, 0.05), Vec3::ZERO, 50.0);
        let scene = scene(meshes, materials, vec![], eye);
        let settings = Settings {
            light_paths: 50_000,
            camera_paths: 16,
            radius: 0.02,
            caustic_radius: 0.02,
            medium_scale: 4.0,
            seed: 2,
            ..settings(SIDE, SIDE)
        };
        for (name, Estimate { mean, error }) in means(&scene, &settings, 12) {
            println!("{bsdf:?} {name}: {mean:.4} +- {error:.4}");
            assert!(error < 0.01, "says little: {name}");
            // The boundary of the ball is flat only by triangle.
            let lost = if name == "path" { 0.0 } else { 0.005 };
            assert!((mean - 1.0).abs() < 4.0 * error + lost, "{bsdf:?} {name}: {mean} +- {error}");
        }
    }
}

/// Fog all around, a ball of dark glass, one of milk that does not refract, and one of milk in
/// glass.
pub(super) fn everything() -> Arc<Scene> {
    let mut meshes = cube(Vec3::ZERO, 1.0, true, 0);
    meshes.push(square(Vec3::new(0.0, 0.0, 0.99), -Vec3::Z, 0.5, 1));
    meshes.push(sphere(Vec3::new(0.35, 0.45, -0.5), 0.35, 4, false, 2));
    meshes.push(sphere(Vec3::new(0.4, -0.45, -0.4), 0.3, 3, false, 3));
    meshes.push(sphere(Vec3::new(-0.3, 0.3, 0.2), 0.25, 3, false, 4));
    let ink = medium(Vec3::new(2.0, 0.5, 0.1), Vec3::ZERO, 0.0);
    let milk = medium(Vec3::new(0.1, 0.2, 0.4), Vec3::new(3.0, 2.5, 2.0), 0.5);
    let glass = Bsdf::Dielectric(Dielectric::new(1.4));
    let materials = vec![
        gray(0.5, 0.0),
        gray(0.0, 4.0),
        around(&ink, glass),
        index_matched(&milk),
        around(&milk, glass),
    ];
    let eye = camera(Vec3::new(-0.9, -0.85, 0.4), Vec3::new(0.2, 0.2, -0.4), 75.0);
    filled(scene(meshes, materials, vec![], eye), gray_medium(0.1, 0.3, 0.3))
}

#[test]
fn all_strategies_make_the_image_of_the_path_tracer() {
    let scene = &everything();
    let accel = &accel(scene);
    let base = Settings {
        light_paths: 40_000,
        camera_paths: 8,
        radius: 0.03,
        caustic_radius: 0.03,
        medium_scale: 3.0,
        seed: 3,
        ..settings(SIDE, SIDE)
    };
    let path = Settings { strategy: Strategy::Path, merge_vertex: 2, ..base.clone() };
    let subject = |settings| Subject { scene, accel, settings, region: &[] };
    let expected = subject(&base).traced(8192);
    let mut ways = vec![("path".to_owned(), path)];
    ways.extend(merging(&base));
    for (name, settings) in &ways {
        let of = subject(settings);
        let found = match settings.strategy {
            Strategy::Path => of.rendered(Settings { camera_paths: 128, ..settings.clone() }, 20),
            _ => of.extrapolated(20),
        };
        let difference = found.against(&expected);
        let what = format!("{name}: {difference}");
        println!("{what}");
        let Difference { off, error, z2, .. } = difference;
        assert!(error < 0.012, "says little: {what}");
        assert!(off.abs() < 4.0 * error + 5e-3, "{what}");
        assert!(z2 < 2.0, "{what}");
    }
}

/// Much light of a bright room is scattered in its fog, and arrives at walls by way of other
/// walls. It has one technique: merges at both vertices would count it twice.
#[test]
fn light_of_fog_is_counted_once() {
    let mut meshes = cube(Vec3::ZERO, 1.0, true, 0);
    meshes.push(square(Vec3::new(0.0, 0.0, 0.99), -Vec3::Z, 0.5, 1));
    let eye = camera(Vec3::new(-0.9, -0.85, 0.4), Vec3::new(0.2, 0.2, -0.4), 75.0);
    let materials = vec![gray(0.8, 0.0), gray(0.0, 4.0)];
    let scene = &filled(scene(meshes, materials, vec![], eye), gray_medium(0.02, 0.4, 0.3));
    let accel = &accel(scene);
    let base = Settings {
        light_paths: 40_000,
        camera_paths: 4,
        radius: 0.04,
        caustic_radius: 0.04,
        seed: 3,
        ..settings(SIDE, SIDE)
    };
    let subject = |settings| Subject { scene, accel, settings, region: &[] };
    let expected = subject(&base).traced(4096);
    let ways = [(Strategy::Mis, Connect), (Strategy::CutMis, PhotonMap)]
        .map(|(strategy, direct)| Settings { strategy, direct, merge_vertex: 2, ..base.clone() });
    for settings in &ways {
        let name = settings.strategy;
        let Difference { off, error, .. } = subject(settings).extrapolated(8).against(&expected);
        println!("{name:?}: {off:+.4} +- {error:.4}");
        assert!(error < 0.02 && off.abs() < 4.0 * error + 5e-3, "{name:?}: {off} +- {error}");
    }
}

/// Balls reach through thin walls, but photons behind them do not count.
#[test]
fn fog_does_not_shine_through_a_wall() {
    let mut meshes = cube(Vec3::ZERO, 1.0, true, 0);
    // Its floor and ceiling are not in the same planes: photons on surfaces reach around walls in a
    // plane.
    meshes.extend(cube(Vec3::new(2.01, 0.3, 0.3), 1.0, true, 0));
    meshes.push(square(Vec3::new(2.0, 0.3, 1.2), -Vec3::Z, 0.5, 1));
    let materials = vec![gray(0.5, 0.0), gray(0.0, 4.0)];
    let eye = camera(Vec3::new(-0.9, 0.1, 0.2), Vec3::new(1.0, 0.0, 0.0), 70.0);
    let scene = filled(scene(meshes, materials, vec![], eye), gray_medium(0.1, 2.0, 0.0));
    let base = Settings {
        kernel: Kernel::Area,
        light_paths: 20_000,
        camera_paths: 8,
        radius: 0.1,
        caustic_radius: 0.1,
        ..settings(SIDE, SIDE)
    };
    for (name, settings) in merging(&base) {
        let mut renderer = Renderer::new(&scene, &accel(&scene), settings).unwrap();
        renderer.iterate(Measure::Off);
        let sums = renderer.film().sums.map_rows(|pixel| pixel.radiance);
        let is_dark = sums.iter().all(|radiance| *radiance == DVec3::ZERO);
        assert!(is_dark, "{name}");
    }
}

/// A ball of this boundary around ink, under a panel.
fn ink_ball(bsdf: Bsdf) -> Arc<Scene> {
    let mut meshes = cube(Vec3::ZERO, 1.0, true, 0);
    meshes.push(square(Vec3::new(0.0, 0.0, 0.99), -Vec3::Z, 0.5, 1));
    meshes.push(sphere(Vec3::new(0.1, 0.1, -0.4), 0.45, 4, false, 2));
    let ink = medium(Vec3::new(2.0, 0.5, 0.1), Vec3::ZERO, 0.0);
    let materials = vec![gray(0.5, 0.0), gray(0.0, 4.0), around(&ink, bsdf)];
    let eye = camera(Vec3::new(-0.9, -0.85, 0.4), Vec3::new(0.2, 0.2, -0.4), 75.0);
    scene(meshes, materials, vec![], eye)
}

#[test]
fn weights_of_several_techniques_hold_around_ink() {
    for bsdf in
        [Bsdf::Dielectric(Dielectric::new(1.5)), Bsdf::ThinDielectric(ThinDielectric::new(1.0))]
    {
        compare_weighted(&ink_ball(bsdf));
    }
}

fn compare_weighted(scene: &Arc<Scene>) {
    let accel = &accel(scene);
    let base = Settings {
        kernel: Kernel::Area,
        merge_vertex: 2,
        light_paths: 30_000,
        camera_paths: 8,
        radius: 0.04,
        caustic_radius: 0.04,
        seed: 3,
        ..settings(SIDE, SIDE)
    };
    let expected = Subject { scene, accel, settings: &base, region: &[] }.traced(8192);
    for strategy in [Strategy::Mis, Strategy::CutMis, Strategy::PathCaustics] {
        for direct in [Connect, PhotonMap] {
            if strategy.has_only_caustics() && direct == PhotonMap {
                continue; // refused
            }
            let settings = &Settings { strategy, direct, ..base.clone() };
            let own = Subject { scene, accel, settings, region: &[] };
            let difference = own.extrapolated(24).against(&expected);
            let what = format!("{strategy:?} {direct:?}: {difference}");
            println!("{what}");
            let Difference { off, error, z2, .. } = difference;
            assert!(error < 0.012, "says little: {what}");
            assert!(off.abs() < 4.0 * error, "{what}");
            assert!(z2 < 2.0, "{what}");
        }
    }
}

#[test]
fn photons_of_caustics_alone_are_refused_where_media_scatter() {
    let clear = ink_ball(Bsdf::ThinDielectric(ThinDielectric::new(1.0)));
    for (scene, is_allowed) in [(clear, true), (everything(), false)] {
        for strategy in [Strategy::PathCaustics, Strategy::GatherCaustics] {
            let settings = Settings { strategy, merge_vertex: 2, ..settings(4, 4) };
            let made = Renderer::new(&scene, &accel(&scene), settings);
            assert_eq!(made.is_ok(), is_allowed, "{strategy:?}");
        }
    }
}

/// Share of light that two parts of a stack let through and reflect, from the front and from the
/// back.
#[derive(Clone, Copy)]
struct Layer {
    through: f64,
    front: f64,
    back: f64,
}

impl Layer {
    /// The interface of two refractive indices at a right angle.
    fn interface(before: f64, behind: f64) -> Self {
        let reflected = ((before - behind) / (before + behind)).powi(2);
        Self { through: 1.0 - reflected, front: reflected, back: reflected }
    }

    /// This layer, a distance that leaves the share `left`, and another layer. Light is reflected
    /// between both.
    fn and(self, left: f64, other: Self) -> Self {
        let again = 1.0 / (1.0 - self.back * other.front * left * left);
        let returned = |own: Self, next: f64| own.through.powi(2) * left * left * next * again;
        Self {
            through: self.through * left * other.through * again,
            front: self.front + returned(self, other.front),
            back: other.back + returned(other, self.back),
        }
    }
}

/// Mean color of the front of a panel with radiance 1 through these meshes, and its error.
fn through(meshes: Vec<Mesh>, materials: Vec<Material>, iterations: u32) -> (DVec3, f64) {
    let mut all = vec![square(3.0 * Vec3::X, -Vec3::X, 4.0, 0)];
    all.extend(meshes);
    let materials = [vec![gray(0.0, 1.0)], materials].concat();
    let scene = scene(all, materials, vec![], camera(-3.0 * Vec3::X, Vec3::ZERO, 0.01));
    let settings = Settings { strategy: Strategy::Path, merge_vertex: 2, ..settings(4, 4) };
    let mut renderer = Renderer::new(&scene, &accel(&scene), settings).unwrap();
    for _ in 0..iterations {
        renderer.iterate(Measure::Off);
    }
    let sum: DVec3 =
        renderer.film().sums.map_rows(|pixel| pixel.radiance).into_iter().sum::<DVec3>();
    // Values of paths are in [0, 1].
    let paths = 16.0 * 4.0 * f64::from(iterations);
    (sum / (16.0 * f64::from(iterations)), (0.25 / paths).sqrt())
}

/// Wine between two walls of a glass, at a right angle: the wine's surface is the only one where
/// both touch, and names the glass as its exterior.
#[test]
fn liquid_in_glass_refracts_and_absorbs_by_its_interfaces() {
    let glass = medium(Vec3::new(0.3, 0.1, 0.2), Vec3::ZERO, 0.0);
    let wine = medium(Vec3::new(0.3, 2.0, 1.5), Vec3::ZERO, 0.0);
    let of = |interior: &Arc<Medium>, exterior: Option<&Arc<Medium>>, bsdf| {
        let boundary =
            MediumBoundary { interior: Some(interior.clone()), exterior: exterior.cloned() };
        Material { boundary: Some(boundary), ..Material::new("wall", bsdf) }
    };
    let materials = vec![
        of(&glass, None, Bsdf::Dielectric(Dielectric::new(1.5))),
        of(&wine, Some(&glass), Bsdf::Dielectric(Dielectric::new(1.34 / 1.5))),
    ];
    let face = |x: f32, normal, material| square(x * Vec3::X, normal, 1.0, material);
    let meshes = vec![
        face(0.0, -Vec3::X, 1),
        face(0.3, -Vec3::X, 2),
        face(0.8, Vec3::X, 2),
        face(1.0, Vec3::X, 1),
    ];
    let (found, error) = through(meshes, materials, 4000);
    for channel in 0..3 {
        let left = |medium: &Medium, distance: f64| {
            (-f64::from(medium.absorption[channel]) * distance).exp()
        };
        let stack = Layer::interface(1.0, 1.5)
            .and(left(&glass, 0.3), Layer::interface(1.5, 1.34))
            .and(left(&wine, 0.5), Layer::interface(1.34, 1.5))
            .and(left(&glass, 0.2), Layer::interface(1.5, 1.0));
        let (found, expected) = (found[channel], stack.through);
        assert!((found - expected).abs() < 4.0 * error, "{channel}: {found} {expected}");
    }
}

/// Wine that reaches into the walls of its glass: the glass has the higher priority, and fills the
/// space of both. Here no interface refracts, for those of overlapping objects keep their own
/// indices.
#[test]
fn overlapping_media_absorb_by_their_priority() {
    let with = |absorption, priority| {
        Arc::new(Medium { priority, ..Medium::clone(&medium(absorption, Vec3::ZERO, 0.0)) })
    };
    let (glass, wine) = (Vec3::new(0.3, 0.1, 0.2), Vec3::new(0.3, 2.0, 1.5));
    for (of_glass, of_wine, [in_glass, in_wine]) in
        [(1, 0, [0.8, 0.6]), (0, 1, [0.4, 1.0]), (-2, -3, [0.8, 0.6])]
    {
        let materials =
            vec![index_matched(&with(glass, of_glass)), index_matched(&with(wine, of_wine))];
        let thin = |x: f32, half: f32, material| {
            let mut mesh = block(Vec3::ZERO, 1.0, material);
            for corner in &mut mesh.positions {
                corner.x = x + half * corner.x;
            }
            mesh
        };
        // Walls from -.7 to -.3 and from .3 to .7, and wine from -.5 to .5.
        let meshes = vec![thin(-0.5, 0.2, 1), thin(0.5, 0.2, 1), thin(0.0, 0.5, 2)];
        let (found, _) = through(meshes, materials, 1);
        let expected = (-(in_glass as f32) * glass - (in_wine as f32) * wine).map(f32::exp);
        assert!(found.distance(expected.as_dvec3()) < 1e-5, "{of_glass}: {found} {expected}");
    }
}
