//! Measured noise in files, and predictions from them.

use crate::common::*;
use bdpm::adaptive::optimize::predict::{Predicted, RenderTime, Source};
use bdpm::base::math::Rgb;
use bdpm::image_io::{Image, Layer, Metadata, Value, read_exr, write_exr};
use bdpm::noise::file::NoiseFile;
use bdpm::noise::image::NoiseImage;
use bdpm::noise::{Coefficients, Measure, region};
use bdpm::render::RenderConfig;
use bdpm::scene::Region;
use bdpm::timing::TimeModel;
use bdpm::{Renderer, Settings};

/// A small measurement with two regions.
fn measured() -> NoiseFile {
    let scene = furnished_box();
    let accel = accel(&scene);
    let settings = Settings {
        light_paths: 300,
        camera_paths: 4,
        radius: 0.3,
        caustic_radius: 0.3,
        ..settings(19, 11)
    };
    let renderer = Renderer::new(&scene, &accel, settings).unwrap();
    let mut renderer = renderer.configure(RenderConfig::with_pixel_batches()).unwrap();
    for _ in 0..70 {
        renderer.iterate(Measure::Pairs);
    }
    let noise = renderer.block().noise_image().unwrap();
    let region = |name: &str, rectangles| Region { name: name.to_owned(), rectangles };
    let regions = vec![
        region("left", vec![[0.0, 0.0, 0.5, 1.0]]),
        region("two parts", vec![[0.0, 0.0, 1.0 / 3.0, 0.5], [0.7, 0.1, 1.0, 1.0]]),
    ];
    let facts = Metadata::from([("scene".into(), Value::Text("box".into()))]);
    NoiseFile { noise, pixels: renderer.film().mean(), regions, facts }
}

#[track_caller]
fn assert_close(read: f64, written: f64) {
    let tolerance = f64::from(f32::EPSILON) * written.abs();
    assert!((read - written).abs() <= tolerance, "{read} {written}");
}

#[test]
fn a_round_trip_keeps_the_noise_to_single_precision() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("noise.exr");
    let written = measured();
    written.write(&path).unwrap();
    let read = NoiseFile::read(&path).unwrap();
    assert_eq!((&read.regions, &read.facts), (&written.regions, &written.facts));
    assert_eq!(read.pixels, written.pixels);
    let (a, b) = (&read.noise, &written.noise);
    assert_eq!((a.width, a.height, a.iterations), (19, 11, 70));
    assert_eq!((a.light_paths, a.camera_paths), (300, 4));
    for (a, b) in a.pixels.iter().zip(&b.pixels) {
        assert_close(a.luminance, b.luminance);
        assert_close(a.nested_error, b.nested_error);
        assert_close(a.noise.coefficients.f, b.noise.coefficients.f);
    }
    let samples = |noise: &NoiseImage| {
        let pixels: Vec<_> = noise.pixels.iter().map(|p| p.noise).collect();
        pixels.into_iter().chain(noise.batches.iter().copied().flatten()).collect::<Vec<_>>()
    };
    for (a, b) in samples(a).iter().zip(&samples(b)) {
        for (a, b) in [
            (a.coefficients.a, b.coefficients.a),
            (a.coefficients.b, b.coefficients.b),
            (a.coefficients.f, b.coefficients.f),
            (a.sampled, b.sampled),
            (a.nested[0], b.nested[0]),
            (a.nested[1], b.nested[1]),
        ] {
            assert_close(a, b);
        }
    }
    // A file that was read is written without further change.
    read.write(&path).unwrap();
    assert_eq!(NoiseFile::read(&path).unwrap(), read);
}

#[test]
fn layers_match_their_names() {
    let file = measured();
    let image = file.to_image();
    let value = |layer: &str, channel: &str, i: usize| {
        f64::from(image.layer(layer).unwrap().channel(channel).unwrap()[i])
    };
    for (i, pixel) in file.noise.pixels.iter().enumerate() {
        let Coefficients { a, b, f } = pixel.noise.coefficients;
        let l2 = pixel.luminance2(70);
        assert_close(value("L", "Y", i), pixel.luminance);
        assert_close(value("C2", "Y", i), a + b + f + l2);
        assert_close(value("B", "Y", i), b + l2);
        assert_close(value("F", "Y", i), f + l2);
        assert_close(value("V", "predicted", i), a / 1200.0 + b / 4.0 + f / 300.0);
        assert_close(value("V", "sampled", i), pixel.noise.sampled);
    }
}

#[test]
fn predictions_from_the_file_are_those_from_memory() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("noise.exr");
    let file = measured();
    file.write(&path).unwrap();
    let read = NoiseFile::read(&path).unwrap();
    let model = TimeModel {
        fixed: 1e-4,
        light_path: 2e-7,
        camera_path: 5e-7,
        look_up: 1e-8,
        merge_pair: 1e-11,
        pixels: 209.0,
    };
    let budget = RenderTime { model, time: 60.0 };
    let same = |a: Predicted, b: Predicted| {
        assert!((a.value / b.value - 1.0).abs() < 1e-5, "{a:?} {b:?}");
        assert!((a.error.unwrap() / b.error.unwrap() - 1.0).abs() < 1e-3, "{a:?} {b:?}");
    };
    for wish in [None, Some("left"), Some("two parts"), Some("0.2,0.1,0.9,0.8")] {
        let region = region::find(wish, &read.regions).unwrap();
        let pixels = region::pixels(&region, &read.noise).unwrap();
        let inside = |i: &usize| region.contains((i % 19) as u32, (i / 19) as u32, 19, 11);
        assert_eq!(pixels, (0..209).filter(inside).collect::<Vec<_>>());
        assert!(wish.is_none() || pixels.len() < 209);
        let [a, b] = [&read.noise, &file.noise].map(|noise| Source::Measured(noise, &pixels));
        for (n, m) in [(1.0, 1.0), (300.0, 4.0), (1e5, 100.0)] {
            let (a, b) = (a.predict(n, m, Some(&budget)), b.predict(n, m, Some(&budget)));
            same(a.pooled_rms, b.pooled_rms);
            same(a.mean_rms, b.mean_rms);
            same(a.timed.unwrap().pooled_rms, b.timed.unwrap().pooled_rms);
        }
        same(a.optimum(&budget).light_paths, b.optimum(&budget).light_paths);
    }
}

#[test]
fn other_images_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("other.exr");
    let layers = vec![Layer::rgb("", &[Rgb::ONE; 6])];
    let image = Image { width: 3, height: 2, layers, metadata: Metadata::new() };
    write_exr(&path, &image).unwrap();
    let shown = NoiseFile::read(&path).unwrap_err().to_string();
    assert!(shown.contains("other.exr") && shown.contains("no measured noise"), "{shown}");
    assert!(shown.contains("help: give the .exr file that `bdpm analyze` wrote"), "{shown}");
    // Any missing layer or attribute is found.
    measured().write(&path).unwrap();
    let whole = read_exr(&path).unwrap();
    for name in ["a", "V", "nested", "batch07", ""] {
        let mut part = whole.clone();
        part.layers.retain(|layer| layer.name != name);
        assert!(NoiseFile::from_image(part).is_err(), "{name}");
    }
    for name in ["light_paths", "camera_paths", "iterations"] {
        for value in [None, Some(Value::Number(1.0)), Some(Value::Number(f64::NAN))] {
            let mut part = whole.clone();
            part.metadata.remove(name);
            part.metadata.extend(value.map(|value| (name.to_owned(), value)));
            let shown = NoiseFile::from_image(part).unwrap_err().to_string();
            assert!(shown.contains(name), "{shown}");
        }
    }
}

/// Section 5 of the paper: coefficients from its Figure 3, times from its Table 2.
#[test]
fn published_numbers_are_reproduced() {
    let source = Source::Given(Coefficients { a: 3595.0, b: 37.18, f: 0.3788 });
    // 6.0 s for the camera paths and 0.2 s for their look-ups at N_B = 25, as for one pixel.
    let model = TimeModel {
        fixed: 0.0,
        light_path: 5.67e-7,
        camera_path: 6.0 / 25.0,
        look_up: 0.2 / 25.0,
        merge_pair: 5.03e-5 / 25.0,
        pixels: 1.0,
    };
    let budget = RenderTime { model, time: 1000.0 };
    let after = |n, m| source.predict(n, m, Some(&budget)).timed.unwrap();
    let close = |value: f64, printed: f64, unit: f64| {
        assert!((value - printed).abs() <= 0.5001 * unit, "{value}, printed {printed}");
    };
    // N_F, sqrt(V), tau, sqrt(V_T) at N_B = 25.
    for (n, rms, tau, timed) in [
        (1e3, 1.277, 6.25, 0.1010),
        (3e3, 1.239, 6.35, 0.0988),
        (1e4, 1.225, 6.71, 0.1004),
        (3e4, 1.221, 7.73, 0.1074),
        (1e5, 1.220, 11.29, 0.1296),
        (3e5, 1.220, 21.46, 0.1787),
    ] {
        close(source.predict(n, 25.0, None).pooled_rms.value, rms, 1e-3);
        close(after(n, 25.0).tau, tau, 1e-2);
        close(after(n, 25.0).pooled_rms.value, timed, 1e-4);
    }
    // N_B = 5, 10, 25, 100.
    for (n, row) in [
        (1e2, [0.1347, 0.1348, 0.1348, 0.1351]),
        (1e3, [0.1010; 4]),
        (3e3, [0.0988; 4]),
        (1e4, [0.1005, 0.1004, 0.1004, 0.1003]),
        (3e4, [0.1078, 0.1075, 0.1074, 0.1073]),
        (1e5, [0.1309, 0.1301, 0.1296, 0.1294]),
    ] {
        for (m, printed) in [5.0, 10.0, 25.0, 100.0].into_iter().zip(row) {
            close(after(n, m).pooled_rms.value, printed, 1e-4);
        }
    }
    let best = source.best_light_paths(25.0, &budget);
    assert!((best.light_paths.value - 3440.0).abs() < 5.0, "{best:?}");
    // Figure 3, N_B = 25: the C, B and F terms.
    let terms = Coefficients { a: 3595.0, b: 37.18, f: 0.3788 }.paper_terms(1000.0, 25.0);
    for (term, printed) in terms.iter().zip([0.3812, 1.2188, 0.0191]) {
        close(term.sqrt(), printed, 2e-4);
    }
}
