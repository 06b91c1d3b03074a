//! The measurements behind a choice of technique: samples of the pixels, and nested radii for one
//! class of photons.

use crate::common::*;
use bdpm::film::radiance::luminance;
use bdpm::noise::Measure;
use bdpm::render::{NestedPart, RenderConfig};
use bdpm::settings::Direct;
use bdpm::transport::photon::PhotonClass;
use bdpm::{Renderer, Settings};

#[test]
fn sampled_pixels_equal_those_of_the_image() {
    let scene = furnished_box();
    let accel = accel(&scene);
    let all = Settings { radius: 0.2, caustic_radius: 0.2, ..settings(24, 16) };
    let mut image = Renderer::new(&scene, &accel, all.clone()).unwrap();
    let other = Settings { seed: 2, ..all };
    let mut sample = image.sample(other, 4).unwrap();
    for renderer in [&mut image, &mut sample] {
        (0..400).for_each(|_| drop(renderer.iterate(Measure::Off)));
    }
    assert_eq!(sample.film().resolution(), (6, 4));
    let parts = |renderer: &Renderer| {
        let mean: Vec<f64> =
            renderer.film().mean().into_iter().map(|value| luminance(value.as_dvec3())).collect();
        (mean, renderer.film().variance_of_mean().unwrap())
    };
    let ((all, all_variance), (some, variance)) = (parts(&image), parts(&sample));
    let mut squares = 0.0;
    for y in 0..4 {
        for x in 0..6 {
            // Each square has another column by its row of squares, and another row by its column.
            let (own, whole) = (y * 6 + x, (4 * y + x % 4) * 24 + 4 * x + y % 4);
            let error2 = variance[own] + all_variance[whole];
            squares += (some[own] - all[whole]).powi(2) / error2 / 24.0;
        }
    }
    // 24 squares, some of them of the same light paths: a standard error of .3 or more.
    assert!((0.2..2.2).contains(&squares), "{squares}");
}

#[test]
fn nested_radii_of_either_kind_of_photons_add_up() {
    let scene = furnished_box();
    let accel = accel(&scene);
    // Light straight from the lamp is then merged, too, at a radius of its own.
    let direct = Direct::PhotonMap;
    let own = Settings { direct, radius: 0.2, caustic_radius: 0.1, ..settings(8, 8) };
    let nested = |class: Option<PhotonClass>| {
        let renderer = Renderer::new(&scene, &accel, own.clone()).unwrap();
        let batches = RenderConfig::with_pixel_batches();
        let config = RenderConfig { nested_part: class.map(NestedPart::Class), ..batches };
        let mut renderer = renderer.configure(config).unwrap();
        (0..3).for_each(|_| drop(renderer.iterate(Measure::Pairs)));
        let noise = renderer.block().noise_image().unwrap();
        (renderer.film().clone(), noise.pixels.iter().map(|p| p.noise.nested).collect::<Vec<_>>())
    };
    let (film, both) = nested(None);
    let (last_film, last) = nested(Some(PhotonClass::Diffuse));
    let (every_film, every) = nested(Some(PhotonClass::Caustic));
    assert!(film == last_film && film == every_film, "the image is the same");
    let scale = film.mean_luminance();
    let some = |part: &[[f64; 2]]| part.iter().any(|d| d[0].abs() > 0.01 * scale);
    assert!(some(&last) && some(&every), "both have a part");
    for ((both, last), every) in both.iter().zip(&last).zip(&every) {
        for a in 0..2 {
            assert!(
                (last[a] + every[a] - both[a]).abs() < 1e-5 * scale,
                "{last:?} {every:?} {both:?}"
            );
        }
    }
}
