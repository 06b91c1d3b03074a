//! The reported error of denoised images against long references: docs/measurements/denoising.md.

use crate::common::accel;
use crate::common::committed::across;
use crate::common::denoised::{Found, Reference, compare};
use bdpm::Settings;
use bdpm::output::denoise::Oidn;
use std::ops::RangeInclusive;

/// Pixels across.
const WIDTH: u32 = 64;

/// Iterations of the images, and of the reference over the most of them.
const ITERATIONS: [u64; 3] = [8, 32, 128];
const REFERENCE: u64 = 16;

/// At so many light paths per iteration and camera paths per pixel, with these seeds.
fn check(name: &str, light_paths: u32, camera_paths: u32, seeds: RangeInclusive<u64>) {
    let (scene, settings) = across(name, WIDTH);
    let accel = accel(&scene);
    let most = *ITERATIONS.iter().max().unwrap();
    let mut oidn = Oidn::new(rayon::current_num_threads()).unwrap();
    let mut means = Vec::new();
    let each = seeds.flat_map(|seed| ITERATIONS.map(|iterations| (seed, iterations)));
    let mut reference = None;
    for (seed, iterations) in each {
        let settings = Settings { light_paths, camera_paths, seed, ..settings.clone() };
        if iterations == ITERATIONS[0] {
            reference = Some(Reference::render(&scene, &accel, &settings, most * REFERENCE));
        }
        let to = (reference.as_ref().unwrap(), &mut oidn);
        let found = compare(&scene, &accel, &settings, iterations, to);
        eprintln!("{name} {iterations}: {found:?}");
        let Found { raw, unmixed, mixed, reported, error, z2, blocks, share } = found;
        // From few samples the estimate may say no more than that. From more it tells the error, or
        // at least that most of the noise is gone: the denoiser leaves a thirtieth of caustics.
        let says = iterations < most || error < mixed.max(0.1 * raw);
        assert!(says, "{name} {iterations}: says nothing, {found:?}");
        assert!(
            (reported - mixed).abs() < 0.05 * mixed + 3.0 * error,
            "{name} {iterations}: {found:?}"
        );
        assert!((0.0..=1.0).contains(&share) && unmixed > 0.0, "{name} {iterations}: {found:?}");
        assert!(mixed <= 1.02 * raw, "{name} {iterations}: the mix is worse, {found:?}");
        means.push((z2, blocks));
    }
    // Blocks share light paths. Where noise is rare and bright, the reported standard errors are
    // too large.
    let count: usize = means.iter().map(|(_, blocks)| blocks).sum();
    let z2 = means.iter().map(|(z2, blocks)| z2 * *blocks as f64).sum::<f64>() / count as f64;
    assert!((0.4..2.2).contains(&z2), "{name}: {z2} of {count} blocks");
}

#[test]
fn errors_of_a_box_with_a_point_light_match_references() {
    check("cornell-box-classic", 4000, 1, 1..=1);
}

#[test]
fn errors_of_caustics_match_references() {
    check("caustic-sphere", 4000, 1, 1..=1);
}

#[test]
#[ignore = "takes minutes: make check-long"]
fn errors_of_all_materials_match_references() {
    // One seed alone has .37 to .62.
    check("materials", 4000, 1, 1..=4);
}

#[test]
fn errors_of_noise_that_pixels_share_match_references() {
    check("cornell-box", 100, 16, 1..=1);
}
