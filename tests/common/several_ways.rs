//! Furnaces in which paths are found in several ways: the weights add up to 1, whatever they are.

use crate::common::*;
use bdpm::Settings;
use bdpm::scene::bsdf::{
    Bsdf, Coated, Conductor, Dielectric, DiffuseTransmission, Glossy, Reflectance,
};
use bdpm::scene::{Material, Mesh, Scene};
use bdpm::settings::{Direct, Kernel, MisScales, Strategy};
use glam::Vec3;
use std::sync::Arc;

pub const SIDE: u32 = 16;
const TILE: u32 = 4;
pub const TILES: usize = (SIDE / TILE * (SIDE / TILE)) as usize;

/// Strategy, scales of merges at both vertices, and the planned light paths over the actual ones.
pub type Weighting = (Strategy, [f64; 2], f64);

/// With unequal scales light paths split as well.
pub fn weighted(settings: &Settings, (strategy, scales, planned): Weighting) -> Settings {
    let light_paths = (f64::from(settings.light_paths) * planned) as u32;
    let mis_scales = Some(MisScales { light_paths, scales });
    let splitting = if scales[0] == scales[1] { 1 } else { 3 };
    Settings { strategy, merge_vertex: 2, mis_scales, splitting, ..settings.clone() }
}

/// Mean of each tile in each iteration: `[tile][iteration]`.
pub fn tiles(scene: &Arc<Scene>, settings: Settings, iterations: usize) -> Vec<Vec<f64>> {
    let all = pixel_samples(scene, &accel(scene), settings, iterations);
    let mut tiles = vec![vec![0.0; iterations]; TILES];
    for (pixel, samples) in (0..).zip(all) {
        let (x, y) = (pixel % SIDE / TILE, pixel / SIDE / TILE);
        let tile = &mut tiles[(y * (SIDE / TILE) + x) as usize];
        tile.iter_mut().zip(samples).for_each(|(sum, x)| *sum += x / f64::from(TILE * TILE));
    }
    tiles
}

/// Asserts that differences have the mean 0 in each tile, and over all of them within `resolution`
/// of `value`; `systematic` is what they may be off besides, relative.
#[track_caller]
pub fn assert_zero(
    what: &str,
    differences: &[Vec<f64>],
    value: f64,
    resolution: f64,
    systematic: f64,
) {
    let mut square = 0.0;
    for samples in differences {
        let Estimate { mean, error } = Estimate::from_samples(samples);
        square += ((mean.abs() - 2.0 * systematic * value).max(0.0) / error).powi(2) / TILES as f64;
    }
    let iterations = differences[0].len();
    let whole = |i: usize| differences.iter().map(|tile| tile[i]).sum::<f64>() / TILES as f64;
    let Estimate { mean, error } =
        Estimate::from_samples(&(0..iterations).map(whole).collect::<Vec<_>>());
    let (off, error) = (mean / value, error / value);
    println!("{what}: off by {off:+.5} +- {error:.5}, squared deviations of tiles {square:.2}");
    assert!(error < resolution, "{what}: {error} says little");
    assert!(off.abs() < 4.0 * error + systematic, "{what}: off by {off} +- {error}");
    // The mean of 16 squares has a standard error of .35, and more as tiles share light paths.
    assert!(square < 4.0, "{what}: {square}");
}

/// Settings that give the same paths other weights; `k = 2` is compared with each.
pub const WEIGHTINGS: [Weighting; 6] = [
    (Strategy::Mis, [1.0, 1.0], 1.0),
    (Strategy::CutMis, [0.3, 2.0], 0.02),
    (Strategy::Mis, [0.3, 2.0], 0.002),
    (Strategy::CutMis, [4.0, 0.1], 0.1),
    (Strategy::Mis, [4.0, 0.1], 0.1),
    (Strategy::Path, [1.0, 1.0], 1.0),
];

/// Everything that does not absorb is as bright as the walls, which emit 1 and reflect half: 2.
pub fn furnace(bsdfs: &[Bsdf], normals: bool) -> Arc<Scene> {
    let mut meshes = Vec::new();
    for axis in [Vec3::X, Vec3::Y, Vec3::Z] {
        meshes.push(square(axis, -axis, 1.0, 0));
        meshes.push(square(-axis, axis, 1.0, 0));
    }
    let mut materials = vec![gray(0.5, 1.0)];
    for (index, bsdf) in bsdfs.iter().enumerate() {
        let center =
            Vec3::new(-0.45 + 0.6 * (index % 2) as f32, 0.3, -0.5 + 0.8 * (index / 2) as f32);
        let ball = sphere(center, 0.3, 4, false, index as u32 + 1);
        let own = ball.positions.iter().map(|p| (*p - center).normalize()).collect();
        meshes.push(Mesh { normals: if normals { own } else { vec![] }, ..ball });
        materials.push(Material::new("lossless", *bsdf));
    }
    let camera = camera(Vec3::new(-0.1, -0.97, 0.1), Vec3::new(-0.1, 1.0, 0.0), 75.0);
    scene(meshes, materials, vec![], camera)
}

/// Technique for direct light, and the radius for caustics.
pub type Way = (Direct, f32);

pub const WAYS: [Way; 3] =
    [(Direct::Connect, 0.05), (Direct::Connect, 0.15), (Direct::PhotonMap, 0.05)];

/// Asserts that everything is as bright as it must be, but for a `loss`, and as without weights.
/// The standard errors of the means are less than `resolution`, relative.
pub fn assert_furnace(
    name: &str,
    scene: &Arc<Scene>,
    loss: f64,
    (iterations, resolution): (usize, f64),
    (ways, weightings): (&[Way], &[Weighting]),
) {
    for &(direct, caustic_radius) in ways {
        let settings = Settings {
            direct,
            kernel: Kernel::Area,
            light_paths: 8000,
            camera_paths: 8,
            radius: 0.15,
            caustic_radius,
            seed: 5,
            ..settings(SIDE, SIDE)
        };
        let single = tiles(scene, Settings { merge_vertex: 2, ..settings.clone() }, iterations);
        for &weighting in weightings {
            let several = tiles(scene, weighted(&settings, weighting), iterations);
            let what = format!("{name} {direct:?} {caustic_radius} {weighting:?}");
            let exact: Vec<Vec<f64>> =
                several.iter().map(|tile| tile.iter().map(|x| x - 2.0).collect()).collect();
            assert_zero(&format!("{what}, 2"), &exact, 2.0, resolution, loss);
            let differences: Vec<Vec<f64>> = several
                .iter()
                .zip(&single)
                .map(|(several, single)| several.iter().zip(single).map(|(a, b)| a - b).collect())
                .collect();
            assert_zero(&format!("{what}, k = 2"), &differences, 2.0, resolution, loss);
        }
    }
}

pub fn white_metal(alpha: f32) -> Bsdf {
    let reflectance = Reflectance::Artist { normal: Vec3::ONE };
    Bsdf::Conductor(Conductor::new(reflectance, alpha))
}

/// Smooth surfaces of all kinds, in a furnace.
pub fn smooth_things() -> Arc<Scene> {
    let bsdfs = [
        Bsdf::Mirror { reflectance: Vec3::ONE },
        Bsdf::Dielectric(Dielectric::new(1.5)),
        Bsdf::Coated(Coated::new(Vec3::ONE, 1.5)),
        Bsdf::Glossy(Glossy::new(Vec3::ONE, 0.0, 1.5, 0.0)),
    ];
    furnace(&bsdfs, false)
}

/// A sheet that reflects and transmits these shares of the light.
pub fn diffuse_sheet(reflectance: f32, transmittance: f32) -> Bsdf {
    let shares = [reflectance, transmittance].map(Vec3::splat);
    Bsdf::DiffuseTransmission(DiffuseTransmission::new(shares[0], shares[1]))
}

/// Asserts that white sheets are invisible in a furnace, and that the weights of all techniques add
/// up to 1.
pub fn assert_white_sheets(normals: bool, ways: &[Way], weightings: &[Weighting]) {
    let bsdfs = [diffuse_sheet(0.3, 0.7), diffuse_sheet(0.0, 1.0), diffuse_sheet(0.8, 0.2)];
    let scene = furnace(&bsdfs, normals);
    let name = if normals { "smooth sheets" } else { "sheets" };
    // Interpolated normals of a ball send some light below its facets: it is lost.
    let loss = if normals { 5e-3 } else { 0.0 };
    assert_furnace(name, &scene, loss, (28, 6e-3), (ways, weightings));
}
