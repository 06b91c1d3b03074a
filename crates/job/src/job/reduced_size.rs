//! Fewer pixels, where the time does not suffice for all of them.

use super::root_run::Run;
use super::{Denoising, Prepared, RenderJob};
use bdpm_auto::adaptive::time_probe;
use bdpm_core::base::error::Result;
use bdpm_core::render::Renderer;
use std::time::{Duration, Instant};

/// Iterations that fit at least: each half of the image then has one.
const ITERATIONS: f64 = 2.0;

/// Time of an iteration over that of one path per pixel by path tracing: light paths, merges, and
/// the pairs that half of the iterations measure.
const OVER_PATHS: f64 = 4.0;

/// Share of the time for the pilot.
const PILOT_SHARE: f64 = 0.15;

/// Time per pixel from which on all pixels are rendered, whatever the scene, seconds.
const ENOUGH: f64 = 12e-6;

/// Largest factor between the widths.
const MOST: f64 = 8.0;

impl RenderJob {
    /// Reduces the size of the image by a whole factor such that the fewest iterations fit in the
    /// time. Returns the renderer of the image.
    pub(super) fn reduce_size(
        &self,
        run: &mut Run,
        renderer: Renderer,
        start: Instant,
    ) -> Result<Renderer> {
        let Prepared { scene, threads, provenance, .. } = &mut run.prepared;
        let settings = &mut provenance.settings;
        let full = settings.resolution();
        let pixels = settings.pixels() as f64;
        let may_reduce = self.reserve_per_enlarged_pixel.is_some()
            && settings.crop.is_none()
            && run.config.ranks == 1 // Workers render the size that they were started with.
            && self.settings.strategy.is_none()
            && self.is_timed_picture(scene);
        let is_short = |time: &Duration| time.as_secs_f64() < ENOUGH * pixels;
        let Some(time) = self.stop.time.filter(|time| may_reduce && is_short(time)) else {
            return Ok(renderer);
        };
        let iteration = OVER_PATHS * threads.install(|| time_probe::path_time(&renderer))?;
        let denoiser = run.denoising.as_ref().map_or(0.0, Denoising::pixel_time);
        let all = ITERATIONS * iteration + denoiser * pixels;
        let before = (1.0 - PILOT_SHARE) * time.as_secs_f64() - start.elapsed().as_secs_f64();
        let left = |is_reduced| before - self.reserve(pixels as usize, is_reduced).as_secs_f64();
        // What a reduced size saves in the files is no reason to reduce it.
        let factor = factor(all, left(false)).min(factor(all, left(true)).max(2));
        if factor == 1 {
            return Ok(renderer);
        }
        settings.width = full.0.div_ceil(factor);
        settings.height = full.1.div_ceil(factor);
        let size = settings.resolution();
        run.denoising = run.denoising.take().map(|own| own.for_size(size, &self.stop));
        run.full_size = Some(full);
        let settings = settings.clone();
        threads.install(|| renderer.with_settings(settings)?.configure(run.config))
    }

    /// Time that is reserved for the caller's work after a render whose picture has this many
    /// pixels.
    pub(super) fn reserve(&self, pixels: usize, is_reduced: bool) -> Duration {
        let enlarged = self.reserve_per_enlarged_pixel.filter(|_| is_reduced);
        enlarged.unwrap_or(self.reserve_per_pixel) * pixels as u32
    }
}

/// Factor between the widths where all pixels take `all` seconds of `left`.
fn factor(all: f64, left: f64) -> u32 {
    // Work that does not fit by less than 2 is done: twice as few pixels are seen, late ones
    // hardly.
    (all / left.max(1e-9)).sqrt().round().clamp(1.0, MOST) as u32
}

/// What a user reads about a reduced image.
pub(super) fn warning(time: Duration, size: (u32, u32), full: (u32, u32)) -> String {
    format!(
        "{:.1} s are too short for {}x{} pixels: {}x{} are rendered, and the picture is enlarged\n\
         help: give more time; `--layers all` renders every pixel, and ends late",
        time.as_secs_f64(),
        full.0,
        full.1,
        size.0,
        size.1
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn factor_lets_the_work_fit_but_for_a_small_excess() {
        for (all, left, wanted) in [
            (1.0, 2.0, 1),
            (2.0, 1.0, 1),
            (3.0, 1.0, 2),
            (12.0, 1.0, 3),
            (1e3, 1.0, 8),
            (1.0, -1.0, 8),
        ] {
            assert_eq!(factor(all, left), wanted, "{all} {left}");
        }
    }
}
