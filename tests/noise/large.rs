//! Images of more than half a million pixels keep statistics for cells of several pixels. These are
//! the means of what single pixels have, and the image and its layers keep all pixels.

use crate::common::Estimate;
use crate::common::automatic::scene;
use bdpm::base::iteration_set::IterationSet;
use bdpm::base::math::Rgb;
use bdpm::film::aov::AovSelection;
use bdpm::film::cells::CellGrid;
use bdpm::film::radiance::luminance;
use bdpm::film::statistic::{BatchGrain, StatisticRequest};
use bdpm::noise::{Coefficients, Measure};
use bdpm::output::checkpoint::Checkpoint;
use bdpm::output::layers::{LayerName, LayerSelection};
use bdpm::render::block;
use bdpm::render::block::CombinedImage;
use bdpm::render::{PartialRender, RenderConfig, bytes_per_pixel};
use bdpm::scene::backend::{Backend, build};
use bdpm::settings::Bias;
use bdpm::settings::provenance::Provenance;
use bdpm::{Renderer, Settings};
use std::borrow::Cow;

/// Just above a million pixels, and no multiple of the side of a tile or cell.
const SIZE: (u32, u32) = (1043, 1021);

const LAYERS: AovSelection =
    AovSelection { light: true, features: true, folds: false, halves: false };

fn settings(settings: Settings) -> Settings {
    let (width, height) = SIZE;
    Settings { width, height, camera_paths: 1, bias: Bias::Reduce, ..settings }
}

fn renderer(grain: BatchGrain, aovs: AovSelection) -> Renderer {
    let (scene, own) = scene();
    let accel = build(Backend::Bvh, &scene).unwrap();
    let renderer = Renderer::new(&scene, &accel, settings(own)).unwrap();
    renderer.configure(RenderConfig { grain, aovs, ..RenderConfig::default() }).unwrap()
}

#[test]
fn statistics_of_cells_are_means_over_their_pixels() {
    let grid = CellGrid::of(SIZE);
    assert_eq!(grid.side(), 2);
    let mut by_cell = renderer(BatchGrain::Tile, AovSelection::default());
    by_cell.iterate(Measure::Pairs);
    let cells = block::coefficients(by_cell.blocks()).unwrap();
    assert_eq!(cells.len(), grid.len());

    // The value of a cell and the mean of the image over it come from different sums.
    let film = by_cell.film();
    let noise = by_cell.block().statistics.noise.as_ref().unwrap();
    let values = noise.sums().map_rows(|sums| sums.value);
    let pixels = film.sums.values();
    let sums = film.sums.fold_cells(grid, 0.0, |sum, at| *sum += luminance(pixels[at].radiance));
    for (cell, (value, sum)) in values.iter().zip(sums).enumerate() {
        let mean = sum / grid.pixels_of(cell);
        assert!((value - mean).abs() <= 1e-12 * mean.abs(), "{cell}: {value} {mean}");
    }

    let mut by_pixel = renderer(BatchGrain::Pixel, AovSelection::default());
    by_pixel.iterate(Measure::Pairs);
    assert_eq!(by_cell.film(), by_pixel.film(), "statistics do not change the image");
    let means = block::coefficients(by_pixel.blocks()).unwrap();
    // One pixel of each cell is measured. Of 266,000 cells, means agree within the errors of the
    // difference.
    let mean_of = |values: Vec<f64>| Estimate::from_samples(&values);
    let terms: [fn(&Coefficients) -> f64; 3] = [|own| own.a, |own| own.b, |own| own.f];
    for term in terms {
        let pairs = cells.iter().zip(&means);
        let difference = mean_of(pairs.map(|(own, mean)| term(own) - term(mean)).collect());
        let mean = mean_of(means.iter().map(term).collect()).mean;
        println!("{difference:?} of {mean}");
        assert!(difference.mean.abs() < 4.0 * difference.error, "{difference:?} of {mean}");
        // A few pixels at the edges of the lamp have most of `b`.
        assert!(difference.error < 0.2 * mean, "{difference:?} says little about {mean}");
    }
}

#[test]
fn large_image_is_written_by_rows_and_survives_parts_and_checkpoints() {
    let render = |numbers: std::ops::Range<u64>| {
        let mut renderer = renderer(BatchGrain::Tile, LAYERS);
        renderer.assign(IterationSet::from(numbers));
        while !renderer.remaining().is_empty() {
            renderer.iterate(Measure::Off);
        }
        renderer
    };
    let whole = render(0..4);
    let image = CombinedImage::new(whole.blocks(), vec![1.0]);
    let (width, height) = SIZE;

    // Rows are those of the whole image.
    let (mean, rms) = (image.mean(), image.rms().unwrap());
    for rows in [0..3, 500..517, height - 1..height] {
        let pixels = (rows.start * width) as usize..(rows.end * width) as usize;
        assert_eq!(image.mean_rows(rows.clone()), mean[pixels.clone()]);
        assert_eq!(image.rms_rows(rows).unwrap(), rms[pixels]);
    }
    assert!(image.bias_correction().is_some());

    // The variances of cells have the mean of those of pixels.
    let of_pixels = image.variance_of_mean().unwrap();
    let of_cells = image.cell_variance().unwrap();
    let grid = image.grid();
    let weighted = of_cells.iter().enumerate().map(|(cell, own)| own * grid.pixels_of(cell));
    let (sum, expected) = (weighted.sum::<f64>(), of_pixels.iter().sum::<f64>());
    assert!((sum / expected - 1.0).abs() < 1e-6, "{sum} {expected}");

    // Light layers add up to the image.
    let rows = 300..310;
    let pixels = image.mean_rows(rows.clone());
    let selection = LayerSelection::new(&[LayerName::All]);
    let layers = selection.layers(whole.shared(), &image, rows, &pixels);
    let colors = |name: &str| layers.iter().find(|own| own.name == name).unwrap().to_rgb().unwrap();
    let parts = ["emission", "direct", "indirect", "caustics"].map(colors);
    let mut compared = 0;
    for (index, pixel) in pixels.iter().enumerate() {
        let sum: Rgb = parts.iter().map(|part| part[index]).sum();
        // Indirect light is cut off below 0 where the correction of the bias exceeds it.
        let is_whole = parts[2][index].min_element() > 0.0;
        compared += usize::from(is_whole);
        let near = (sum - *pixel).abs().max_element() <= 1e-4 * sum.max_element();
        assert!(near || !is_whole, "{index}: {sum} {pixel}");
    }
    assert!(2 * compared > pixels.len(), "{compared}");
    let depth = layers.iter().find(|own| own.name == "depth").unwrap();
    assert!(depth.channels[0].1.iter().all(|depth| *depth > 0.0));

    // Two parts and a checkpoint give the same sums.
    let [mut one, mut two] = [0..2, 2..4].map(render);
    let mut merged = one.take_partial();
    merged.merge(two.take_partial()).unwrap();
    let PartialRender { blocks, shared, .. } = merged;
    let (scene, own) = scene();
    let provenance = Provenance {
        version: "1".into(),
        scene: "box".into(),
        fingerprint: scene.fingerprint(),
        backend: "bvh".into(),
        settings: settings(own),
    };
    let checkpoint =
        Checkpoint { shared: Cow::Owned(shared), ..Checkpoint::new(provenance, blocks) };
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("large.ckpt");
    checkpoint.save(&path).unwrap();
    let mut loaded = Checkpoint::load(&path).unwrap();
    assert_eq!(loaded.shared, checkpoint.shared);
    for (own, other) in loaded.blocks.iter().zip(checkpoint.blocks.iter()) {
        assert_eq!((&own.film, &own.statistics), (&other.film, &other.statistics));
    }
    let mut resumed = renderer(BatchGrain::Tile, LAYERS);
    resumed.resume(loaded.take_partial()).unwrap();
    assert_eq!(resumed.config().aovs, LAYERS);
    let merged = CombinedImage::new(resumed.blocks(), vec![1.0]);
    for (one, two) in merged.mean().iter().zip(&mean) {
        assert!((*one - *two).abs().max_element() <= 1e-4 * two.abs().max_element().max(1e-3));
    }
}

#[test]
fn sums_of_a_large_image_take_less_than_200_bytes_per_pixel() {
    let (_, own) = scene();
    let bytes = |width, height, blocks| {
        let settings = Settings { width, height, ..settings(own.clone()) };
        let request = StatisticRequest {
            independent_paths: false,
            settings: &settings,
            aovs: LAYERS,
            grain: BatchGrain::Tile,
            measured_before: None,
        };
        bytes_per_pixel(&request, blocks)
    };
    let large = bytes(3840, 2160, 2);
    // The copy of the image (12), layers (80), estimates by cell (16), two blocks (43.25 each) and
    // counts (4).
    assert_eq!(large, 12.0 + 80.0 + 16.0 + 2.0 * 43.25 + 4.0);
    assert!(large < 200.0);
    // A block more: the image (32), counts (4), a sixteenth of annulus (88) and noise (64), batches
    // (1.5).
    let block = bytes(3840, 2160, 3) - large;
    assert_eq!(block, 32.0 + 4.0 + (2.0 * 44.0 + 64.0) / 16.0 + 1.5);
    // Cells of 2 by 2 pixels, and single pixels.
    assert!(large < bytes(1920, 1080, 2) && bytes(1920, 1080, 2) <= bytes(1280, 720, 2));
}
