//! The audit of an image: a second estimate by path tracing without photons, areas and guides, in
//! two halves. Light that no camera path finds is estimated beside it: theory.md, section 22b.

use super::combined_image::CombinedImage;
use super::photon_only_light::{has_photon_only_light, has_rare_sunlight};
use super::{RenderConfig, Renderer};
use crate::base::error::Result;
use crate::base::iteration_set::IterationSet;
use crate::film::cells::CellGrid;
use crate::film::radiance::{PixelSums, box_filter, luminance};
use crate::noise::Measure;
use crate::noise::difference::{Cells, Compared, Difference, Estimates};
use crate::scene::Scene;
use crate::settings::{Bias, Direct, Settings, Strategy};
use serde::{Deserialize, Serialize};
use std::f64::consts::PI;

/// Minimum side of a cell, pixels.
const MIN_SIDE: u32 = 2;

/// Maximum number of cells: larger images have larger cells, so that each cell has some paths.
const MAX_CELLS: usize = 1 << 17;

/// Added to the seed of the image, so that the audit shares no samples with it.
const AUDIT_SEED: u64 = 0x0a0d_170f_1e57_ab1e;

/// Part of the light that only photons find by which its estimate may differ from that in the
/// image: both merge.
const UNFINDABLE_TOLERANCE: f64 = 0.25;

/// Distance to a point light at which its light is taken to be the brightest, relative to the size
/// of the scene.
const NEAREST_LIGHT: f32 = 0.05;

/// Factor on the radiance of uniform emitters, and on the mean radiance of others, for the largest
/// contribution of a path.
const BRIGHTEST: [f64; 2] = [2.0, 4.0];

/// Sums over the iterations of one half of an estimate, by cell.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct HalfSums {
    /// Number of iterations.
    pub iterations: u64,
    /// Sum of the luminance of each cell, W/(m^2 sr).
    pub sums: Vec<f64>,
    /// Sum of its square.
    pub squares: Vec<f64>,
}

/// Sums of an audit.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct AuditSums {
    /// The cells.
    pub cells: Cells,
    /// Path tracing, one path for each cell and iteration.
    pub traced: [HalfSums; 2],
    /// Light that no camera path finds; `None` if there is none.
    pub photon_only: Option<[HalfSums; 2]>,
}

/// An audit of one image, compared with it.
#[derive(Clone, Debug)]
pub struct Audited {
    /// Difference between the image and the audit.
    pub difference: Difference,
    /// Share of the light that the audit does not know, since only photons find it.
    pub not_audited: f64,
    /// Number of paths that should have found the light by which the image exceeds the audit:
    /// theory.md (98f).
    pub expected_hits: f64,
    /// Camera paths of the audit.
    pub paths: f64,
}

impl HalfSums {
    fn new(cells: usize) -> Self {
        Self { iterations: 0, sums: vec![0.0; cells], squares: vec![0.0; cells] }
    }

    /// Adds an iteration with these luminances.
    pub fn add(&mut self, values: &[f64]) {
        self.iterations += 1;
        let both = self.sums.iter_mut().zip(&mut self.squares).zip(values);
        both.for_each(|((sum, square), value)| {
            *sum += value;
            *square += value * value;
        });
    }

    fn merge(&mut self, other: &Self) {
        self.iterations += other.iterations;
        self.sums.iter_mut().zip(&other.sums).for_each(|(own, other)| *own += other);
        self.squares.iter_mut().zip(&other.squares).for_each(|(own, other)| *own += other);
    }

    fn mean(&self) -> Vec<f64> {
        self.sums.iter().map(|sum| sum / self.iterations as f64).collect()
    }

    fn fits(&self, cells: usize) -> bool {
        let is_number = |values: &[f64]| values.iter().all(|value| value.is_finite());
        self.sums.len() == cells
            && self.squares.len() == cells
            && is_number(&self.sums)
            && is_number(&self.squares)
    }
}

/// Variance of the mean of one half in each cell, sampled from both halves.
fn variance_of_half([one, other]: &[HalfSums; 2]) -> Vec<f64> {
    let n = (one.iterations + other.iterations) as f64;
    let of_half = 0.5 * (1.0 / one.iterations as f64 + 1.0 / other.iterations as f64);
    let variance = |cell: usize| {
        let mean = (one.sums[cell] + other.sums[cell]) / n;
        let square = (one.squares[cell] + other.squares[cell]) / n;
        (square - mean * mean).max(0.0) * n / (n - 1.0) * of_half
    };
    (0..one.sums.len()).map(variance).collect()
}

/// Variance of each cell of an image, from the differences of neighbors between it and the audit,
/// whose noise of one half has the variances `variance`. Means over 5 by 5 cells. theory.md (98h)
fn neighbor_variance(
    cells: Cells,
    image: &[f64],
    audit: &[Vec<f64>; 2],
    variance: &[f64],
) -> Vec<f64> {
    let (width, height) = (cells.width as usize, cells.height as usize);
    let of = |cell: usize| image[cell] - 0.5 * (audit[0][cell] + audit[1][cell]);
    let single = |cell: usize| {
        let (x, y) = (cell % width, cell / width);
        let neighbors = [
            (x > 0).then(|| cell - 1),
            (x + 1 < width).then(|| cell + 1),
            (y > 0).then(|| cell - width),
            (y + 1 < height).then(|| cell + width),
        ];
        let (mut sum, mut count) = (0.0, 0.0);
        for other in neighbors.into_iter().flatten() {
            // The mean of both halves has half of the variance of one.
            let of_audit = 0.25 * (variance[cell] + variance[other]);
            sum += 0.5 * (of(cell) - of(other)).powi(2) - of_audit;
            count += 1.0;
        }
        [sum / count]
    };
    let single: Vec<_> = (0..cells.len()).map(single).collect();
    let pooled = box_filter(&single, cells.width, cells.height);
    pooled.into_iter().map(|[own]| own.max(0.0)).collect()
}

/// Cells of an image of these settings.
fn cells_of(settings: &Settings) -> Cells {
    let (width, height) = settings.resolution();
    let of = |side: u32| Cells { width: width / side, height: height / side, side };
    let mut cells = of(MIN_SIDE.max(CellGrid::of((width, height)).side()));
    while cells.len() > MAX_CELLS {
        cells = of(2 * cells.side);
    }
    cells
}

impl AuditSums {
    /// Sums of no iteration.
    pub fn new(cells: Cells, has_photon_only: bool) -> Self {
        let halves = || [HalfSums::new(cells.len()), HalfSums::new(cells.len())];
        Self { cells, traced: halves(), photon_only: has_photon_only.then(halves) }
    }

    /// Adds the sums of another part of the same audit. Sums of another image are left out.
    pub fn merge(&mut self, other: &Self) {
        if self.cells != other.cells || self.photon_only.is_some() != other.photon_only.is_some() {
            return;
        }
        self.traced.iter_mut().zip(&other.traced).for_each(|(own, other)| own.merge(other));
        if let (Some(own), Some(other)) = (&mut self.photon_only, &other.photon_only) {
            own.iter_mut().zip(other).for_each(|(own, other)| own.merge(other));
        }
    }

    /// Whether the sums are possible for an image with these settings. They may come from a file.
    pub fn fits(&self, settings: &Settings) -> bool {
        let cells = self.cells.len();
        self.cells == cells_of(settings)
            && self.traced.iter().all(|half| half.fits(cells))
            && self.photon_only.iter().flatten().all(|half| half.fits(cells))
    }

    /// Camera paths of both halves.
    pub fn paths(&self) -> f64 {
        let iterations: u64 = self.traced.iter().map(|half| half.iterations).sum();
        iterations as f64 * self.cells.len() as f64
    }

    /// Compares the audit with an image of the scene. `brightest` is that of [`brightest_path`].
    /// `None` before both have two halves with some samples, or if the image is too small.
    pub fn compare(&self, image: &CombinedImage, brightest: f64) -> Option<Audited> {
        let has_halves = |halves: &[HalfSums; 2]| halves.iter().all(|half| half.iterations > 0);
        if !has_halves(&self.traced)
            || self.photon_only.as_ref().is_some_and(|own| !has_halves(own))
        {
            return None;
        }
        let mut halves = self.in_cells(&image.halves()?, image.grid());
        let photon_only = self.photon_only.as_ref().map(|own| own.each_ref().map(HalfSums::mean));
        let mean = |values: &[f64]| values.iter().sum::<f64>() / values.len() as f64;
        let all = 0.5 * (mean(&halves[0]) + mean(&halves[1]));
        let (mut not_audited, mut common, mut tolerance) = (0.0, None, None);
        if let Some(own) = &photon_only {
            for (half, own) in halves.iter_mut().zip(own) {
                half.iter_mut().zip(own).for_each(|(half, own)| *half -= own);
            }
            let both: Vec<f64> = own[0].iter().zip(&own[1]).map(|(a, b)| 0.5 * (a + b)).collect();
            not_audited = if all > 0.0 { (mean(&both) / all).clamp(0.0, 1.0) } else { 0.0 };
            tolerance = Some(self.tolerance(&both));
            common = Some(both);
        }
        let audit = self.traced.each_ref().map(HalfSums::mean);
        let difference = Difference::new(&Estimates {
            cells: self.cells,
            image: Compared::Halves([&halves[0], &halves[1]]),
            audit: [&audit[0], &audit[1]],
            audit_variance: &variance_of_half(&self.traced),
            common: common.as_deref(),
            tolerance: tolerance.as_deref(),
        })?;
        let paths = self.paths();
        let expected_hits = paths * difference.excess() / brightest.max(f64::MIN_POSITIVE);
        Some(Audited { difference, not_audited, expected_hits, paths })
    }

    /// Compares the audit with one or two images of another program: luminances of all pixels, in
    /// row order. The noise of two images is known from their difference, that of one from
    /// differences of neighbors. Light that only photons find belongs to the audit if
    /// `has_photon_only`. `None` in the cases of [`Self::compare`].
    pub fn compare_images(
        &self,
        images: &[Vec<f64>],
        size: (u32, u32),
        (has_photon_only, brightest): (bool, f64),
    ) -> Option<Audited> {
        let has_halves = |halves: &[HalfSums; 2]| halves.iter().all(|half| half.iterations > 0);
        if !has_halves(&self.traced) {
            return None;
        }
        let (one, other) = (images.first()?, images.last()?);
        let both: Vec<[f64; 2]> = one.iter().zip(other).map(|(a, b)| [*a, *b]).collect();
        let halves = self.in_cells(&both, CellGrid::single_pixels(size));
        let mut audit = self.traced.each_ref().map(HalfSums::mean);
        let mut variance = variance_of_half(&self.traced);
        let (mut not_audited, mut tolerance) = (0.0, None);
        let mean = |values: &[f64]| values.iter().sum::<f64>() / values.len() as f64;
        if let Some(own) = self.photon_only.as_ref().filter(|own| has_halves(own)) {
            let means = own.each_ref().map(HalfSums::mean);
            let both: Vec<f64> =
                means[0].iter().zip(&means[1]).map(|(a, b)| 0.5 * (a + b)).collect();
            let all = mean(&audit[0]) + mean(&both);
            not_audited = if all > 0.0 { (mean(&both) / all).clamp(0.0, 1.0) } else { 0.0 };
            if has_photon_only {
                for (half, own) in audit.iter_mut().zip(&means) {
                    half.iter_mut().zip(own).for_each(|(half, own)| *half += own);
                }
                variance.iter_mut().zip(variance_of_half(own)).for_each(|(v, own)| *v += own);
                tolerance = Some(self.tolerance(&both));
            }
        }
        let noise = neighbor_variance(self.cells, &halves[0], &audit, &variance);
        let image = match images.len() {
            1 => Compared::Single(&halves[0], &noise),
            _ => Compared::Halves([&halves[0], &halves[1]]),
        };
        let difference = Difference::new(&Estimates {
            cells: self.cells,
            image,
            audit: [&audit[0], &audit[1]],
            audit_variance: &variance,
            common: None,
            tolerance: tolerance.as_deref(),
        })?;
        let paths = self.paths();
        let expected_hits = paths * difference.excess() / brightest.max(f64::MIN_POSITIVE);
        Some(Audited { difference, not_audited, expected_hits, paths })
    }

    /// Mean luminance of images of this size and of the audit in each cell, and the variance of the
    /// mean of the audit. `None` before both halves have samples.
    pub fn means(
        &self,
        images: &[Vec<f64>],
        size: (u32, u32),
    ) -> Option<(Vec<f64>, Vec<f64>, Vec<f64>)> {
        if self.traced.iter().any(|half| half.iterations == 0) {
            return None;
        }
        let pairs = images.first()?.iter().zip(images.last()?).map(|(a, b)| [*a, *b]);
        let pairs: Vec<_> = pairs.collect();
        let mean = |[one, other]: [Vec<f64>; 2]| -> Vec<f64> {
            one.iter().zip(other).map(|(a, b)| 0.5 * (a + b)).collect()
        };
        let image = mean(self.in_cells(&pairs, CellGrid::single_pixels(size)));
        let audit = mean(self.traced.each_ref().map(HalfSums::mean));
        let variance = variance_of_half(&self.traced).into_iter().map(|own| 0.5 * own).collect();
        Some((image, audit, variance))
    }

    /// theory.md (98e)
    fn tolerance(&self, photon_only: &[f64]) -> Vec<f64> {
        let own: Vec<_> = photon_only.iter().map(|own| [*own]).collect();
        let around = box_filter(&own, self.cells.width, self.cells.height);
        let of = |(own, [around]): (&f64, &[f64; 1])| {
            UNFINDABLE_TOLERANCE * own.abs() + (own - around).abs()
        };
        photon_only.iter().zip(&around).map(of).collect()
    }

    /// Means over the cells of the audit of values of the cells of an image, which are not larger.
    fn in_cells(&self, values: &[[f64; 2]], grid: CellGrid) -> [Vec<f64>; 2] {
        let Cells { width, height, side } = self.cells;
        let across = grid.size().0 as usize;
        let parts = (side / grid.side()) as usize;
        let mut halves = [vec![0.0; self.cells.len()], vec![0.0; self.cells.len()]];
        let scale = ((parts * parts) as f64).recip();
        for row in 0..height as usize * parts {
            for column in 0..width as usize * parts {
                let cell = row / parts * width as usize + column / parts;
                let value = values[row * across + column];
                halves.iter_mut().zip(value).for_each(|(half, own)| half[cell] += scale * own);
            }
        }
        halves
    }
}

/// The largest luminance that a single camera path is likely to find, W/(m^2 sr): theory.md (98f),
/// `B`.
pub fn brightest_path(scene: &Scene) -> f64 {
    let [uniform, _] = BRIGHTEST;
    let of = |radiance: crate::base::math::Rgb| luminance(radiance.as_dvec3());
    let near = f64::from(NEAREST_LIGHT * scene.size()).powi(2);
    let lights = scene.lights();
    let emitters = lights.emitters().iter().map(|emitter| emitter.brightest(BRIGHTEST, near));
    let sky = lights.environment().map_or(0.0, |map| {
        // A sun in the inset is hit behind glass only. Elsewhere it is connected, like parallel
        // light.
        let hit = map.inset().filter(|_| has_rare_sunlight(scene));
        let inset = hit.into_iter().flat_map(|(_, radiance)| radiance);
        let brightest = map.pixels().chain(inset).map(of).fold(0.0, f64::max);
        (uniform * brightest).max(of(map.integral()) / PI)
    });
    emitters.fold(sky, f64::max)
}

/// Renders the audit of an image.
pub struct Auditor {
    tracer: Renderer,
    photon_only: Option<Renderer>,
    sums: AuditSums,
}

impl Auditor {
    /// Prepares to audit the image of a renderer. `None` for images without photons, of meters, or
    /// of fewer than 16 cells, and where path tracing finds the light of a sun too rarely.
    ///
    /// # Errors
    /// If the memory does not suffice.
    pub fn new(renderer: &Renderer) -> Result<Option<Self>> {
        let (scene, _) = renderer.scene_and_accel();
        let own = renderer.settings();
        let cells = cells_of(own);
        let is_small = cells.len() < 16;
        if !own.has_photons() || scene.meters().is_some() || is_small || has_rare_sunlight(scene) {
            return Ok(None);
        }
        Self::of_any(renderer).map(Some)
    }

    /// Prepares to estimate the image of a renderer by path tracing, whatever its technique.
    ///
    /// # Errors
    /// If the memory does not suffice.
    pub fn of_any(renderer: &Renderer) -> Result<Self> {
        let (scene, _) = renderer.scene_and_accel();
        let own = renderer.settings();
        let cells = cells_of(own);
        let settings = Settings {
            bias: Bias::Keep,
            direct: Direct::Connect,
            guide: 0,
            sobol_set: 1,
            splitting: 1,
            camera_paths: 1,
            mis_scales: None,
            seed: own.seed.wrapping_add(AUDIT_SEED),
            ..own.clone()
        };
        let path = Settings { strategy: Strategy::Path, merge_vertex: 2, ..settings.clone() };
        let config = RenderConfig { independent_paths: true, ..RenderConfig::default() };
        let tracer = renderer.binned(path, cells.side)?.configure(config)?.uninterrupted();
        let photon_only = if has_photon_only_light(scene) {
            let light_paths =
                (cells.len() as u32).clamp(1024, renderer.most_light_paths().max(1024));
            let merged =
                Settings { strategy: Strategy::Single, merge_vertex: 1, light_paths, ..settings };
            let config = RenderConfig { photon_only: true, ..RenderConfig::default() };
            Some(renderer.binned(merged, cells.side)?.configure(config)?.uninterrupted())
        } else {
            None
        };
        let sums = AuditSums::new(cells, photon_only.is_some());
        Ok(Self { tracer, photon_only, sums })
    }

    /// The sums so far.
    pub fn sums(&self) -> &AuditSums {
        &self.sums
    }

    /// Takes the sums and leaves none.
    pub fn take_sums(&mut self) -> AuditSums {
        let empty = AuditSums::new(self.sums.cells, self.photon_only.is_some());
        std::mem::replace(&mut self.sums, empty)
    }

    /// Adds the sums of other steps.
    pub fn add(&mut self, sums: &AuditSums) {
        self.sums.merge(sums);
    }

    /// Paths of a step, of all kinds.
    pub fn paths_per_step(&self) -> f64 {
        let cells = self.sums.cells.len() as f64;
        let of = |own: &Renderer| cells + f64::from(own.settings().light_paths);
        2.0 * (cells + self.photon_only.as_ref().map_or(0.0, of))
    }

    /// Renders one iteration of each half, on the threads of the current rayon pool. Steps of
    /// different numbers, below 2^62, share no samples.
    pub fn step(&mut self, number: u64) {
        for half in 0..2 {
            let iteration = 2 * number + half;
            self.sums.traced[half as usize].add(&iterate(&mut self.tracer, iteration));
            if let (Some(renderer), Some(sums)) =
                (&mut self.photon_only, &mut self.sums.photon_only)
            {
                sums[half as usize].add(&iterate(renderer, iteration));
            }
        }
    }
}

/// Luminance of each cell in the iteration with this number.
fn iterate(renderer: &mut Renderer, number: u64) -> Vec<f64> {
    renderer.assign(IterationSet::from(number..number + 1));
    renderer.iterate(Measure::Off);
    let of = |sums: &PixelSums| luminance(sums.radiance);
    renderer.take_partial().blocks[0].film.sums.map_rows(of)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cells_of_large_images_have_more_pixels() {
        let own = Settings::resolve(&Default::default(), &Default::default(), 1.0).unwrap();
        let side = |width, height| {
            let settings = Settings { width, height, ..own.clone() };
            let cells = cells_of(&settings);
            assert!(cells.len() <= MAX_CELLS);
            (cells.width, cells.height, cells.side)
        };
        assert_eq!(side(49, 31), (24, 15, 2));
        assert_eq!(side(1920, 1080), (480, 270, 4));
        assert_eq!(side(3840, 2160).2, 8);
    }
}
