//! Light sources that pixels see, which are left as they are where a denoiser would spread them.
//!
//! A flame in one pixel is a thousand times as bright as its neighbors. Other light sources are
//! seen through a lens, or in a curved surface, by a part of the paths of many pixels: they are
//! noisy, and a denoiser is right to smooth them.

use super::folded_image::sums;
use super::pooling::boxes;
use super::window::Window;
use bdpm_core::base::error::Result;
use bdpm_core::base::math::{Rgb, luminance};
use bdpm_core::film::folds::DENOISE_FOLDS;
use bdpm_core::render::block::CombinedImage;
use glam::DVec3;
use rayon::prelude::*;

/// Radius of the squares of pixels that tell whether light is isolated.
const RADIUS: usize = 3;

/// Correlation of both halves in a square, below which light is noise: most pixels that one half
/// sees lit, such as by a reflection of a lamp in glass, the other one sees dark.
const AGREEING: f64 = 0.5;

/// Share of the pixels of a square that see light, from which on it is not isolated.
const MANY: f64 = 0.25;

/// Squared relative noise of light that is not isolated, from which on it is denoised. Edges of
/// lamps have less: one pixel in seven is at the edge, and several rays tell how much of it is
/// covered.
const NOISY: f64 = 0.01;

/// Denoises radiance without the light sources that pixels see, and adds these.
pub fn denoise_around(
    seen: &[Rgb],
    radiance: &[Rgb],
    denoise: impl FnOnce(&[Rgb]) -> Result<Vec<Rgb>>,
) -> Result<Vec<Rgb>> {
    if seen.is_empty() {
        return denoise(radiance);
    }
    let rest = radiance.iter().zip(seen).map(|(all, seen)| *all - *seen);
    let denoised = denoise(&rest.collect::<Vec<Rgb>>())?;
    Ok(denoised.iter().zip(seen).map(|(denoised, seen)| *denoised + *seen).collect())
}

/// Mean emission that pixels see in a window, over the iterations of the [`DENOISE_FOLDS`] folds
/// for which `takes` returns true, where it is isolated or has little noise; empty if it is not
/// kept.
pub fn isolated_lights(
    image: &CombinedImage,
    window: Window,
    takes: impl Fn(usize) -> bool + Sync,
) -> Vec<Rgb> {
    let mut iterations = [0.0; DENOISE_FOLDS];
    for (block, weight) in image.blocks().iter().zip(image.weights()) {
        let Some(seen) = &block.statistics.seen_lights else { return vec![] };
        for (fold, count) in seen.iterations().iter().enumerate().filter(|(fold, _)| takes(*fold)) {
            iterations[fold] += weight * *count as f64;
        }
    }
    let rendered: Vec<usize> = (0..DENOISE_FOLDS).filter(|fold| iterations[*fold] > 0.0).collect();
    let halves = [0, 1].map(|half| {
        let own: Vec<usize> = rendered.iter().copied().skip(half).step_by(2).collect();
        let weight: f64 = own.iter().map(|fold| iterations[*fold]).sum();
        (own, weight)
    });
    let [first, second] = &halves;
    let all = first.1 + second.1;
    let [one, other] = [first, second].map(|(own, weight)| {
        sums(image, window, weight.max(f64::MIN_POSITIVE).recip(), |block, at| {
            let seen = block.statistics.seen_lights.as_ref().expect("kept");
            let taken = seen.at(at).enumerate().filter(|(fold, _)| own.contains(fold));
            taken.map(|(_, seen)| seen.radiance().as_dvec3()).sum()
        })
    });
    let share = first.1 / all;
    let mean = |(one, other): (&DVec3, &DVec3)| (*one * share + *other * (1.0 - share)).as_vec3();
    let seen: Vec<Rgb> = one.iter().zip(&other).map(mean).collect();
    if second.1 == 0.0 {
        return seen; // Nothing is known of its noise.
    }
    let halves = [one, other].map(|half| {
        half.iter().map(|own| f64::from(luminance(own.as_vec3()))).collect::<Vec<f64>>()
    });
    without_noisy(seen, &halves, window)
}

/// `seen` without the light that a denoiser should smooth, by the luminances of both halves of the
/// iterations.
fn without_noisy(seen: Vec<Rgb>, [one, other]: &[Vec<f64>; 2], window: Window) -> Vec<Rgb> {
    if seen.iter().all(|own| *own == Rgb::ZERO) {
        return seen;
    }
    let size = (window.width as usize, window.height as usize);
    let around = |value: &(dyn Fn(f64, f64) -> f64 + Sync)| {
        let values: Vec<f64> =
            one.iter().zip(other).map(|(one, other)| value(*one, *other)).collect();
        boxes(&values, size, RADIUS)
    };
    let ((mean, lit), (squares, common)) = rayon::join(
        || {
            let mean = around(&|one, other| 0.5 * (one + other));
            (mean, around(&|one, other| f64::from(u8::from(one + other > 0.0))))
        },
        || {
            let squares = around(&|one, other| 0.5 * (one * one + other * other));
            (squares, around(&|one, other| one * other))
        },
    );
    let kept = |(index, own): (usize, Rgb)| {
        let is_structure = common[index] > AGREEING * squares[index];
        // The halves are nearly equally long: half of the difference of the terms is the squared
        // noise of their mean.
        let noise = 0.5 * (squares[index] - common[index]);
        let is_smooth = lit[index] > MANY && noise > NOISY * mean[index] * mean[index];
        if is_structure && !is_smooth { own } else { Rgb::ZERO }
    };
    seen.into_par_iter().enumerate().map(kept).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use bdpm_core::base::rng::{Stream, StreamKey};

    const WINDOW: Window = Window { x: 0, y: 0, width: 48, height: 48 };

    /// Share of a light of 1 that is kept as it is, if a pixel sees it by the share `visible` of
    /// `paths` paths in each half.
    fn kept(visible: impl Fn(u32, u32) -> f32, paths: u32) -> f32 {
        let mut rng = StreamKey::new(7, Stream::Test, 1).rng(0);
        let mut half = || -> Vec<f64> {
            let pixels = (0..48 * 48).map(|index| visible(index % 48, index / 48));
            let mut hits = |share| (0..paths).filter(|_| rng.next_1d() < share).count();
            pixels.map(|share| hits(share) as f64 / f64::from(paths)).collect()
        };
        let halves = [half(), half()];
        let mean = |(one, other): (&f64, &f64)| Rgb::splat(0.5 * (one + other) as f32);
        let seen: Vec<Rgb> = halves[0].iter().zip(&halves[1]).map(mean).collect();
        let sum = |own: &[Rgb]| own.iter().map(|own| own.x).sum::<f32>();
        let all = sum(&seen);
        sum(&without_noisy(seen, &halves, WINDOW)) / all
    }

    #[test]
    fn flames_and_lamps_stay() {
        // Paths at edges are split into rays.
        let flames = |x: u32, y: u32| if x % 8 == 3 && y % 9 == 3 { 0.3 } else { 0.0 };
        assert_eq!(kept(flames, 28), 1.0);
        let lamp = |x: u32, y: u32| match (x.abs_diff(24), y.abs_diff(20)) {
            (12.., _) | (_, 9..) => 0.0,
            (11, _) | (_, 8) => 0.4,
            _ => 1.0,
        };
        // In a corner, one pixel of the edge may differ between the halves.
        let of_lamp = kept(lamp, 14);
        assert!(of_lamp > 0.97, "{of_lamp}");
    }

    #[test]
    fn what_lenses_and_reflections_show_is_denoised_while_it_is_noisy() {
        for (share, few, many) in [(0.9, 2, 64), (0.4, 2, 512), (0.04, 2, 8192)] {
            let noisy = kept(|_, _| share, few);
            assert!(noisy < 0.02, "{share}: {noisy}");
            assert_eq!(kept(|_, _| share, many), 1.0, "{share}");
        }
    }
}
