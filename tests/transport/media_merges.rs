//! Merges of photons in media: their noise, their bias, and how they nest.

use super::media::{SIDE, everything};
use crate::common::fog::*;
use crate::common::*;
use bdpm::accel::Intersect;
use bdpm::base::math::luminance;
use bdpm::base::rng::{Stream, StreamKey};
use bdpm::noise::Measure;
use bdpm::render::{NestedPart, RenderConfig};
use bdpm::scene::Environment;
use bdpm::settings::Direct::PhotonMap;
use bdpm::settings::MediumQuery::{Beams, Points};
use bdpm::settings::{MediumQuery, Strategy};
use bdpm::transport::camera_paths::{CameraPass, CameraPathId, CameraPaths};
use bdpm::transport::clearance::Clearance;
use bdpm::transport::kernel::MergeKernel;
use bdpm::transport::light_paths::LightPaths;
use bdpm::transport::medium_kernel::MediumKernel;
use bdpm::transport::medium_photons::MediumPhotons;
use bdpm::transport::merge::{Merge, MergeOptions, MergeOutput};
use bdpm::transport::near_planes::Surroundings;
use bdpm::transport::photon_map::PhotonMap as Map;
use bdpm::{Renderer, Scene, Settings};
use glam::Vec3;
use std::sync::Arc;

#[test]
fn noise_in_media_is_predicted() {
    assert_noise_in_media(Strategy::Single, (1, Beams, 0.25));
}

/// Merges in media that are done stand for those that are left out: the mean image is the same, and
/// so are paths and photons.
#[test]
fn merges_in_media_that_are_done_stand_for_all() {
    let scene = Arc::new(everything());
    for medium_query in [Points, Beams] {
        let settings = Settings { medium_query, direct: PhotonMap, ..settings(SIDE, SIDE) };
        let image = |medium_share: f64| {
            let own = Settings { medium_share, ..settings.clone() };
            let mut renderer = Renderer::new(&scene, &accel(&scene), own).unwrap();
            (0..200).for_each(|_| drop(renderer.iterate(Measure::Off)));
            let film = renderer.film();
            let variance: f64 = film.variance_of_mean().unwrap().iter().sum();
            (film.mean_luminance(), variance.sqrt() / film.pixels() as f64)
        };
        let (all, some) = (image(1.0), image(0.2));
        // Photons and paths are the same, so that the noise of the share alone differs. It is
        // independent from pixel to pixel, as the errors of these means take all of it to be.
        let error = some.1;
        assert!((some.0 - all.0).abs() < 3.0 * error, "{medium_query:?} {all:?} {some:?}");
        assert!(some.1 > 1.05 * all.1, "{medium_query:?}: merges were left out");
        assert!(error < 0.01 * all.0, "{medium_query:?} {all:?} {some:?}");
    }
}

/// Nested differences of the pixels where only a part of the merges has nested radii.
fn nested(scene: &Arc<Scene>, part: Option<NestedPart>) -> Vec<[f64; 2]> {
    let own = Settings { direct: PhotonMap, medium_query: Beams, ..settings(SIDE, SIDE) };
    let config = RenderConfig { nested_part: part, ..RenderConfig::with_pixel_batches() };
    let renderer = Renderer::new(scene, &accel(scene), own).unwrap();
    let mut renderer = renderer.configure(config).unwrap();
    (0..2).for_each(|_| drop(renderer.iterate(Measure::Pairs)));
    renderer.block().noise_image().unwrap().pixels.iter().map(|own| own.noise.nested).collect()
}

/// Between black walls, media have all of the bias; without media they have none.
#[test]
fn bias_of_merges_in_media_is_measured_alone() {
    let lit = |albedo: f32, fog: f32| {
        let mut meshes = cube(Vec3::ZERO, 1.0, true, 0);
        meshes.push(square(Vec3::new(0.0, 0.0, 0.95), -Vec3::Z, 0.8, 1));
        let eye = camera(Vec3::new(-0.9, -0.8, 0.2), Vec3::new(0.1, 0.2, -0.6), 70.0);
        let scene = scene(meshes, vec![gray(albedo, 0.0), gray(0.0, 4.0)], vec![], eye);
        filled(scene, gray_medium(0.1, fog, 0.0))
    };
    let media = Some(NestedPart::Media);
    let black = lit(0.0, 0.5);
    let all = nested(&black, None);
    assert!(all.iter().flatten().any(|own| *own != 0.0));
    assert_eq!(nested(&black, media), all);
    let clear = lit(0.5, 0.0);
    assert!(nested(&clear, None).iter().flatten().any(|own| *own != 0.0));
    assert!(nested(&clear, media).iter().flatten().all(|own| *own == 0.0));
}

/// Before a render, camera paths learn which lights are visible from where. They also meet media,
/// and merge nothing.
#[test]
fn visibility_of_lights_is_learned_in_fog() {
    let fog = gray_medium(0.1, 1.0, 0.0);
    let meshes = vec![block(Vec3::ZERO, 1.0, 0), square(-1.1 * Vec3::Z, Vec3::Z, 2.0, 1)];
    let materials = vec![index_matched(&fog), gray(0.5, 0.0)];
    let eye = camera(Vec3::new(-3.0, 0.1, 0.2), Vec3::ZERO, 40.0);
    let sky = Environment::new(1, 1, vec![Vec3::ONE], 0.0);
    let scene =
        Arc::new(Arc::unwrap_or_clone(scene(meshes, materials, vec![], eye)).with_environment(sky));
    for medium_query in [Points, Beams] {
        let own = Settings { medium_query, light_visibility: 4096, ..settings(SIDE, SIDE) };
        let mut renderer = Renderer::new(&scene, &accel(&scene), own).unwrap();
        renderer.iterate(Measure::Off);
        let sums = renderer.film().sums.map_rows(|pixel| pixel.radiance);
        assert!(sums.iter().all(|radiance| radiance.is_finite() && radiance.x > 0.0));
    }
}

/// The sums within the radii less the annulus are the sums within half of them, and pairs have the
/// same sums and the differences of their nested radii.
#[test]
fn merges_in_media_nest() {
    let scene = everything();
    let accel = accel(&scene);
    let scene = scene.with_start_media(&*accel);
    [Points, Beams].into_iter().for_each(|query| assert_merges_nest(&scene, &*accel, query));
}

fn assert_merges_nest(scene: &Scene, accel: &dyn Intersect, medium_query: MediumQuery) {
    let (radius, caustic_radius) = (0.1, 0.06);
    let settings =
        Settings { merge_vertex: 1, medium_query, radius, caustic_radius, ..settings(SIDE, SIDE) };
    let mut light = LightPaths::default();
    light.trace(scene, accel, &settings, 20_000, 0);
    let at_surfaces = MergeKernel::new(&settings, None);
    let whole_kernel = MediumKernel::new(&at_surfaces, &settings);
    let clearance = Clearance::of_scene(scene, whole_kernel.reach());
    let mut photons = MediumPhotons::default();
    let surroundings = Surroundings { scene, accel, clearance: &clearance };
    photons.build(&light, &whole_kernel, &surroundings);
    let pass = CameraPass {
        scene,
        view: scene.camera.view(SIDE, SIDE),
        accel,
        settings: &settings,
        key: StreamKey::new(1, Stream::CameraPath, 0),
        gather_early: true,
        hides_lights: false,
        points: None,
        cache: None,
        light_edges: None,
    };
    let mut paths = CameraPaths::default();
    let ids = (0..SIDE * SIDE * 4).map(|i| CameraPathId {
        x: i % SIDE,
        y: i / SIDE % SIDE,
        index: i / 64,
    });
    paths.trace(&pass, ids);
    let nothing = Map::default();
    let options = MergeOptions { records_annulus: true, ..MergeOptions::default() };
    let merged = |share: f64| {
        let merge = Merge::new(&nothing, 1, at_surfaces, options);
        let mut output = MergeOutput::default();
        let medium_scale = share * settings.medium_scale;
        let settings = Settings { medium_scale, ..settings.clone() };
        // Nested merges know the surfaces around the whole ball.
        let kernel = MediumKernel::new(&at_surfaces, &settings).within_planes_of(&whole_kernel);
        let merge = merge.with_medium(&photons, kernel, surroundings);
        merge.gather_pairs(&paths, &mut output, |_, _| {});
        output
    };
    let [whole, inner, half] = [1.0, 0.5f64.sqrt(), 0.5].map(merged);
    let close = |a: f32, b: f32, size: f32| (a - b).abs() <= 1e-4 * size;
    let (mut lit, mut differ) = (0, 0);
    for path in 0..paths.direct.len() {
        let all = whole.sums[path];
        let size = luminance(all).max(luminance(half.sums[path])) + 1e-6;
        let annulus = luminance(whole.annulus[path][0] + whole.annulus[path][1]);
        let mut nests = close(luminance(all) - annulus, luminance(half.sums[path]), size);
        let (mut sum, mut nested) = (0.0, [0.0; 2]);
        for (pairs, own) in whole.pairs.of_path(path) {
            sum += pairs.iter().map(|pair| pair.value).sum::<f32>();
            nested = [nested[0] + own[0], nested[1] + own[1]];
        }
        let [a, b, c] = [&whole, &inner, &half].map(|output| luminance(output.sums[path]));
        assert!(close(sum, a, size), "{path}: {sum} {a}");
        nests &= close(nested[0], a - b, size) && close(nested[1], b - c, size);
        lit += u32::from(a != c);
        differ += u32::from(!nests);
    }
    assert!(lit > 100, "few paths merge in media: {lit}");
    assert_eq!(differ, 0, "of {lit}");
}
