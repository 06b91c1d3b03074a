//! Figures 1 to 4 from the results.

use crate::implied;
use crate::published::{CAMERA_PATHS, TABLE_1, TABLE_1_CAMERA_PATHS, TABLE_2};
use crate::results::Results;
use crate::tables::Cell;
use crate::terms::pooled_rms;
use bdpm_core::film::radiance::box_filter;
use bdpm_core::noise::file::NoiseFile;
use bdpm_report::noise_plot::{NoisePlot, NoisePoint};
use bdpm_report::picture::{Colors, Picture};
use maud::Markup;

/// Names of the three terms.
pub const TERMS: [&str; 3] = ["C: pairs of paths", "B: camera paths", "F: light paths"];

const RADIANCE: &str = "W/(m² sr)";

/// Everything to look at.
pub struct Figures {
    /// Figure 1.
    pub image: Picture,
    /// Figure 2: sampled, by formula, and their difference.
    pub rms: [Picture; 3],
    /// Figure 3 at `N_B = 25` and `100`.
    pub terms: [Picture; 2],
    /// Its channels one by one, at `N_B = 25`; F from the run at `N_B = 100`.
    pub single: [Picture; 3],
    /// Figure 4 here, as SVG.
    pub here: Markup,
    /// Figure 4 from the published numbers, as SVG.
    pub published: Markup,
}

impl Figures {
    /// Draws all of them.
    pub fn new(results: &Results) -> Self {
        let [few, many] = &results.noise;
        let size = (few.noise.width, few.noise.height);
        let (n, m) = (f64::from(few.noise.light_paths), f64::from(few.noise.camera_paths));
        let variance =
            |p: &bdpm_core::noise::image::PixelEstimate| p.noise.coefficients.variance(n, m);
        let formula: Vec<f64> =
            few.noise.pixels.iter().map(|p| variance(p).max(0.0).sqrt()).collect();
        let sampled: Vec<f64> =
            few.noise.pixels.iter().map(|p| p.noise.sampled.max(0.0).sqrt()).collect();
        let difference: Vec<f64> = formula
            .iter()
            .zip(&sampled)
            .map(|(formula, sampled)| match sampled {
                0.0 => 0.0,
                _ => 100.0 * (formula / sampled - 1.0),
            })
            .collect();
        let sequential = (Colors::Sequential, RADIANCE);
        let (few_terms, many_terms) =
            (roots(few, m, false), roots(many, f64::from(CAMERA_PATHS[1]), false));
        let from_many = roots(many, m, true);
        let single = |k: usize, name, terms: &[[f64; 3]]| {
            let values: Vec<f64> = terms.iter().map(|terms| terms[k]).collect();
            Picture::values((name, TERMS[k]), size, &values, sequential)
        };
        Self {
            image: Picture::radiance(("figure-1", "the Cornell box"), size, &few.pixels),
            rms: [
                Picture::values(("figure-2-sampled", "RMS sampled"), size, &sampled, sequential),
                Picture::values(("figure-2-formula", "RMS by formula"), size, &formula, sequential),
                Picture::values(
                    ("figure-2-difference", "difference of the RMS"),
                    size,
                    &difference,
                    (Colors::Diverging, "% of the sampled RMS"),
                ),
            ],
            terms: [("figure-3-25", &few_terms), ("figure-3-100", &many_terms)].map(
                |(name, terms)| {
                    Picture::channels((name, "the three terms as colors"), size, terms, TERMS)
                },
            ),
            single: [
                single(0, "figure-3-25-c", &few_terms),
                single(1, "figure-3-25-b", &few_terms),
                single(2, "figure-3-25-f", &from_many),
            ],
            here: plot_here(results),
            published: plot_published(results),
        }
    }

    /// All pictures of pixels.
    pub fn pictures(&self) -> impl Iterator<Item = &Picture> {
        let first = std::iter::once(&self.image);
        first.chain(&self.rms).chain(&self.terms).chain(&self.single)
    }

    /// All plots with their names.
    pub fn plots(&self) -> [(&'static str, &str); 2] {
        [("figure-4-here", &self.here.0), ("figure-4-published", &self.published.0)]
    }
}

/// Roots of the three terms of (1) at `N_F` as measured, if wanted pooled over 5 by 5 pixels
/// before.
fn roots(file: &NoiseFile, n_camera: f64, pooled: bool) -> Vec<[f64; 3]> {
    let noise = &file.noise;
    let n_light = f64::from(noise.light_paths);
    let terms: Vec<[f64; 3]> =
        noise.pixels.iter().map(|p| p.noise.coefficients.paper_terms(n_light, n_camera)).collect();
    let terms = if pooled { box_filter(&terms, noise.width, noise.height) } else { terms };
    terms.iter().map(|terms| terms.map(|term| term.max(0.0).sqrt())).collect()
}

/// RMS after the time at the best number of light paths for `N_B = 25`.
fn least(results: &Results) -> f64 {
    rms_after(results, results.optima.here.light_paths.value, CAMERA_PATHS[0])
}

/// Pooled RMS after the time, by formula and time model.
fn rms_after(results: &Results, n_light: f64, n_camera: u32) -> f64 {
    let noise = &results.noise[0].noise;
    let pixels: Vec<_> = results.region.iter().map(|&i| noise.pixels[i].noise).collect();
    let m = f64::from(n_camera);
    let time = results.timings.model.iteration(n_light, m) / crate::published::TIME;
    pooled_rms(&pixels, n_light, m) * time.sqrt()
}

/// Figure 4 from measured noise and times.
fn plot_here(results: &Results) -> Markup {
    let least = least(results);
    let point = |cell: &Cell| NoisePoint {
        light_paths: f64::from(cell.light_paths),
        camera_paths: cell.camera_paths,
        rms: cell.after.value / least,
        error: cell.after.error.unwrap_or(0.0) / least,
    };
    plot(
        results,
        &|n, m| rms_after(results, n, m) / least,
        &TABLE_1_CAMERA_PATHS,
        &results.cells.iter().map(point).collect::<Vec<_>>(),
        results.optima.here.light_paths.value,
    )
}

/// Figure 4 from the published numbers.
fn plot_published(results: &Results) -> Markup {
    let model = implied::time_model();
    // A model of one pixel: its times at other numbers of camera paths are not printed.
    let after = |n: f64| implied::rms(n, 25.0) * model.iteration(n, 25.0).sqrt();
    let minimum = results.optima.implied.light_paths.value;
    let least = after(minimum);
    let column = TABLE_1_CAMERA_PATHS.iter().position(|&n| n == CAMERA_PATHS[0]).unwrap_or(0);
    let lowest = TABLE_1.iter().map(|(_, cells)| cells[column]).fold(f64::INFINITY, f64::min);
    let points = TABLE_1.iter().flat_map(|(n, cells)| {
        TABLE_1_CAMERA_PATHS.into_iter().zip(cells).map(move |(camera_paths, rms)| NoisePoint {
            light_paths: f64::from(*n),
            camera_paths,
            rms: rms / lowest,
            // Rounded to the third digit.
            error: 0.0005 / lowest,
        })
    });
    let points: Vec<_> = points.collect();
    plot(results, &|n, _| after(n) / least, &CAMERA_PATHS[..1], &points, minimum)
}

/// RMS over the least, on the same axes for both plots.
fn plot(
    results: &Results,
    rms: &dyn Fn(f64, u32) -> f64,
    curves: &[u32],
    points: &[NoisePoint],
    minimum: f64,
) -> Markup {
    // Show all measured values up to about twice the least.
    let least = least(results);
    let highest = results.cells.iter().map(|cell| cell.after.value / least).fold(1.5, f64::max);
    let plot = NoisePlot {
        alt: "Noise after a time against the number of light paths",
        rms_name: "RMS over the least",
        rms,
        camera_paths: &TABLE_1_CAMERA_PATHS,
        curves,
        points,
        minimum: (minimum, CAMERA_PATHS[0], "minimum at N_B = 25".into()),
        light_paths: [80.0, f64::from(TABLE_2[TABLE_2.len() - 1].light_paths) * 1.3],
        limits: [0.95, (highest * 1.05).min(2.2)],
    };
    plot.svg().expect("the minimum is a point")
}
