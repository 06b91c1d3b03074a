//! Directions drawn in proportion to the luminance of an environment.

use super::{Environment, REGIONS_ACROSS, Row};
use crate::base::math::{Rgb, sin_cos_turns};
use crate::base::rng::Draw;
use crate::scene::lights::cutpoints::{Bucket, Choice, Cutpoints};
use crate::scene::lights::{LightSample, Receiver};
use crate::simd::LANES;
use glam::Vec3;

/// A direction that was drawn in proportion to the luminance.
#[derive(Clone, Copy, Debug, Default)]
pub(in crate::scene::lights) struct EnvironmentSample {
    /// Unit vector toward the environment.
    pub direction: Vec3,
    /// Radiance from there over the density, W/m^2.
    pub irradiance: Rgb,
    /// One over the density in solid angle, sr.
    pub inverse_pdf_w: f32,
}

/// A direction of which the row is chosen, and a few pixels that may be chosen.
#[derive(Clone, Copy, Debug, Default)]
struct Draft {
    /// Index in [`Environment::rows`].
    row: usize,
    /// Position down the row, in [0, 1].
    down: f32,
    /// Index of the row's first pixel, and the number of its pixels.
    first: usize,
    width: usize,
    bucket: Bucket,
}

impl Environment {
    /// A direction in proportion to the luminance, from two uniform numbers: latitude and longitude
    /// increase with them. theory.md (15).
    pub(in crate::scene::lights) fn sample(&self, numbers: [f64; 2]) -> EnvironmentSample {
        self.finish(&self.draft(numbers))
    }

    /// [`Self::sample`] for each pair of `numbers`, at most [`LANES`]. Maps are larger than the
    /// caches. Waiting for all cutpoints together, then for all pixels together, costs little more
    /// than waiting for one of them.
    fn sample_each(&self, numbers: &[[f64; 2]], samples: &mut [EnvironmentSample]) {
        let mut drafts = [Draft::default(); LANES];
        let drafts = &mut drafts[..numbers.len()];
        for (draft, &numbers) in drafts.iter_mut().zip(numbers) {
            *draft = self.draft(numbers);
        }
        let pixels = drafts.iter().map(|draft| &self.pixels[draft.first + draft.bucket.first()]);
        std::hint::black_box(pixels.fold(0, |all, pixel| all | pixel.end));
        for (draft, sample) in drafts.iter().zip(samples) {
            *sample = self.finish(draft);
        }
    }

    /// Chooses a row and a bucket of its pixels.
    #[inline]
    fn draft(&self, [u, v]: [f64; 2]) -> Draft {
        let Choice { index: row, rest: down, .. } = self.row_cutpoints.choose(0, &self.rows, v);
        let (cutpoints, own_row, first, width) = self.own_pixels(row);
        Draft { row, down: down as f32, first, width, bucket: cutpoints.bucket(own_row, u) }
    }

    /// Chooses the pixel and the direction.
    #[inline]
    fn finish(&self, draft: &Draft) -> EnvironmentSample {
        let Row { edges: [above, below], inverse_pdf_w, .. } = self.rows[draft.row];
        let pixels = &self.pixels[draft.first..][..draft.width];
        let Choice { index: column, units, rest: u } = draft.bucket.choose(pixels);
        // Uniform in solid angle: in longitude and in the cosine.
        let y = above + draft.down * (below - above);
        let [begin, pixels_around] = self.longitudes(draft.row);
        let around = begin + (column as f32 + u as f32) / pixels_around;
        let longitude = around - 0.5 - self.turn;
        let across = (1.0 - y * y).max(0.0).sqrt();
        let (sin, cos) = sin_cos_turns(longitude - longitude.floor());
        let direction = Vec3::new(across * sin, y, -across * cos);
        let inverse_pdf_w = inverse_pdf_w / units as f32;
        let irradiance = pixels[column].radiance * inverse_pdf_w;
        EnvironmentSample { direction, irradiance, inverse_pdf_w }
    }

    /// Cutpoints of a row, its index in them, and its first pixel and number of pixels.
    #[inline]
    fn own_pixels(&self, row: usize) -> (&Cutpoints, usize, usize, usize) {
        let [width, height] = [self.width, self.height].map(|n| n as usize);
        match self.inset {
            Some(grid) if row >= height => {
                let (own_row, own_width) = (row - height, grid.size[0] as usize);
                let first = width * height + own_row * own_width;
                (&self.inset_cutpoints, own_row, first, own_width)
            }
            _ => (&self.column_cutpoints, row, row * width, width),
        }
    }

    /// The numbers for a direction to connect with: anywhere, or in a region.
    pub(in crate::scene::lights) fn connection_numbers(
        region: Option<usize>,
        rng: &mut impl Draw,
    ) -> [f64; 2] {
        let Some(region) = region else { return [rng.next_f64(), rng.next_f64()] };
        let corner = [region % REGIONS_ACROSS, region / REGIONS_ACROSS];
        corner.map(|corner| (corner as f64 + rng.next_f64()) / REGIONS_ACROSS as f64)
    }

    /// Directions to connect `receivers` with, at most [`LANES`], by [`Self::connection_numbers`].
    /// `probs` are the densities of the choices of the environment and the region, relative to that
    /// of regions in proportion to their power.
    pub(in crate::scene::lights) fn connect_each(
        &self,
        numbers: &[[f64; 2]],
        probs: &[f32],
        receivers: &[Receiver],
        samples: &mut [LightSample],
    ) {
        let mut drawn = [EnvironmentSample::default(); LANES];
        self.sample_each(numbers, &mut drawn);
        for (i, sample) in samples.iter_mut().enumerate() {
            let EnvironmentSample { direction: wi, irradiance, inverse_pdf_w } = drawn[i];
            let position = receivers[i].position;
            *sample = LightSample {
                target: position + self.enclosure.exit(position, wi) * wi,
                wi,
                irradiance: irradiance / probs[i],
                relative: 1.0,
                inverse_pdf_w: inverse_pdf_w / probs[i],
            };
        }
    }
}
