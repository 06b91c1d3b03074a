//! Pictures of the page: the image, the error of each pixel, where its noise comes from.

use super::Snapshot;
use super::sections::{error_reference, percent};
use bdpm::adaptive::optimize::Objective;
use bdpm::adaptive::stopping::importance;
use bdpm::base::math::Rgb;
use bdpm::film::radiance::box_filter;
use bdpm::image_io::auto_exposure;
use bdpm::noise::merge_bias::BIAS_CERTAINTY;
use bdpm::render::bias_over_noise;
use bdpm::render::block::coefficients;
use bdpm::report::picture::{Colors, Picture};
use bdpm::report::picture_scale::PictureScale;
use maud::{Markup, html};
use rayon::prelude::*;

/// The three terms of the noise: name, formula, and the paths that reduce it.
const TERMS: [(&str, &str, &str); 3] = [
    ("pairs of paths", "a/(N_F N_B)", "light paths and camera paths reduce it"),
    ("camera paths", "b/N_B", "only camera paths reduce it"),
    ("light paths", "f/N_F", "only light paths reduce it"),
];

/// All pictures. Those of errors are `None` until the errors are known.
pub struct Maps {
    image: Picture,
    denoised: Option<Picture>,
    /// Relative RMS of the noise.
    noise: Option<Picture>,
    /// Relative bias of the pixels in which it is significant.
    bias: Option<Picture>,
    /// True if the picture shows the bias before its correction.
    is_corrected: bool,
    /// True if the bias is that of a cache.
    has_cache: bool,
    terms: Option<NoiseTerms>,
}

/// The three terms of the noise of an iteration.
struct NoiseTerms {
    picture: Picture,
    /// Shares of the terms in the noise of the image, by the objective.
    shares: [f64; 3],
}

impl Maps {
    /// Pictures of a snapshot. During the render they have at most about `live_pixels` pixels.
    pub fn new(snapshot: &Snapshot, live_pixels: u64) -> Self {
        let image = snapshot.image;
        let size = image.resolution();
        let pixels = u64::from(size.0) * u64::from(size.1);
        let step = match snapshot.report {
            Some(_) => 1,
            None => pixels.div_ceil(live_pixels).isqrt().max(1) as u32,
        };
        let scale = PictureScale { size, step };
        let mean = image.mean();
        let shown = snapshot.state.denoised().map_or(&mean, |denoised| &denoised.image);
        let exposure = auto_exposure(shown);
        let radiance = |name, alt: &str, pixels: &[Rgb]| {
            let pixels = scale.shrink(pixels, |pixel| pixel.to_array().map(f64::from));
            let pixels: Vec<Rgb> = pixels.into_iter().map(|p| p.map(|x| x as f32).into()).collect();
            Picture::exposed((name, alt), scale.shrunk(), &pixels, exposure)
        };
        let scene = &snapshot.state.provenance.scene;
        let strategy = snapshot.state.provenance.settings.strategy;
        // Relative to the luminance of each pixel, whatever the objective.
        let cells = image.grid();
        let importance = importance(image.blocks(), Objective::Relative);
        let weights = cells.expanded(&importance);
        let noise = image.rms().map(|rms| {
            let relative = |(rms, weight): (&f32, &f64)| [100.0 * f64::from(*rms) * weight.sqrt()];
            let values: Vec<_> = rms.par_iter().zip(&weights).map(relative).collect();
            percentages(scale, ("noise", "RMS noise of each pixel"), &values, Colors::Sequential)
        });
        let bias = bias_over_noise::per_cell(image.blocks()).map(|bias| {
            let relative = |([bias, error], weight): (&[f64; 2], &f64)| {
                let certain = bias.abs() > BIAS_CERTAINTY * error;
                [if certain { 100.0 * bias * weight.sqrt() } else { 0.0 }]
            };
            let values: Vec<_> = bias.par_iter().zip(&importance).map(relative).collect();
            let values = cells.expanded(&values);
            let alt = format!("{} of each pixel", strategy.bias_name());
            percentages(scale, ("bias", &alt), &values, Colors::Diverging)
        });
        Self {
            image: radiance("image", &format!("the picture of {scene}"), &mean),
            denoised: snapshot.state.denoised().map(|denoised| {
                radiance("denoised", &format!("the picture of {scene}, denoised"), &denoised.image)
            }),
            noise,
            bias,
            is_corrected: image.bias_correction().is_some(),
            has_cache: strategy.has_cache(),
            terms: NoiseTerms::new(snapshot, scale, &importance),
        }
    }

    /// The picture with its zoom, and a slider between raw and denoised if there are both.
    pub fn viewer(&self, (width, height): (u32, u32)) -> Markup {
        html! {
            section .viewer style=(format!("--aspect:{width}/{height};--wide:{width};--high:{height}")) {
                @if let Some(denoised) = &self.denoised {
                    div .pair {
                        (frame(&self.image, "raw"))
                        (frame(denoised, "denoised"))
                    }
                } @else {
                    (frame(&self.image, ""))
                }
                div .tools {
                    @if self.denoised.is_some() {
                        label .split {
                            span { "raw" }
                            input #split type="range" min="0" max="100" value="50" step="0.5"
                                aria-label="left edge of the denoised picture";
                            span { "denoised" }
                        }
                    }
                    div .zoom role="group" aria-label="zoom of all pictures" {
                        button #out type="button" aria-label="smaller" { "−" }
                        output #scale { "100 %" }
                        button #in type="button" aria-label="larger" { "+" }
                        button #fit type="button" { "whole picture" }
                    }
                }
                p .hint { "Zoom with + and −, a pinch, or Ctrl and the wheel; drag to move. All pictures follow." }
            }
        }
    }

    /// The errors of each pixel.
    pub fn errors(&self, snapshot: &Snapshot) -> Markup {
        html! {
            section {
                h2 { "Error of each pixel" }
                @if let Some(noise) = &self.noise {
                    div .figures .maps {
                        (figure(noise, &html! {
                            "Noise: the typical difference of each pixel from its value after a very long time, "
                            "in percent of its brightness." (noise.above_scale())
                        }))
                        @if let Some(bias) = &self.bias {
                            (figure(bias, &html! {
                                @if self.has_cache {
                                    "Bias of the cache: pixels are too bright (positive) or too dark because light is "
                                    "averaged over small cells. "
                                } @else {
                                    "Merge bias: pixels are too bright (positive) or too dark because photons are merged "
                                    "over a small area. "
                                }
                                "Only bias that exceeds the noise is shown. "
                                @if self.is_corrected {
                                    "This is the bias before its correction."
                                } @else {
                                    "A smaller merge radius reduces it, more time does not."
                                }
                                (bias.above_scale())
                            }))
                        }
                    }
                    @if self.bias.is_none() && snapshot.report.is_some() {
                        p { "Too few iterations were measured to estimate the bias of each pixel." }
                    }
                } @else {
                    p { "The error is known after the second iteration." }
                }
            }
        }
    }

    /// The three terms of the noise.
    pub fn sources(&self, snapshot: &Snapshot) -> Markup {
        html! {
            section {
                h2 { "Sources of the noise" }
                @if let Some(NoiseTerms { picture, shares }) = &self.terms {
                    div .sources {
                        div {
                            div .stack aria-hidden="true" {
                                @for (k, share) in shares.iter().enumerate() {
                                    div .(format!("term-{k}")) style=(format!("flex-grow:{share:.4}")) {}
                                }
                            }
                            (term_list(shares, error_reference(&snapshot.state.stop)))
                        }
                        (figure(picture, &html! {
                            "The three terms in each pixel: the root of each term is a color."
                            (picture.above_scale())
                        }))
                    }
                } @else {
                    p { "No iteration has measured the noise." }
                }
            }
        }
    }
}

fn term_list(shares: &[f64; 3], reference: &str) -> Markup {
    html! {
        p {
            "The variance of an iteration with N_F light paths and N_B camera paths per pixel has three terms, "
            "relative to " (reference) ":"
        }
        dl .terms {
            @for (k, (name, formula, remedy)) in TERMS.iter().enumerate() {
                div {
                    dt { span .swatch .(format!("term-{k}")) {} (name) " " code { (formula) } }
                    dd { b { (percent(shares[k])) } span .minor { (remedy) } }
                }
            }
        }
    }
}

impl NoiseTerms {
    fn new(snapshot: &Snapshot, scale: PictureScale, relative: &[f64]) -> Option<Self> {
        let blocks = snapshot.image.blocks();
        let measured = coefficients(blocks)?;
        let counts = &blocks.last()?.counts;
        let n_light = f64::from(counts.light_paths);
        let cells = snapshot.image.grid();
        let of_cell = |cell: usize| {
            measured[cell].terms(n_light, counts.camera_paths.at(cells.first_pixel(cell)).into())
        };
        let terms: Vec<_> = (0..measured.len()).into_par_iter().map(of_cell).collect();
        let counts_relative = snapshot.state.stop.objective == Objective::Relative;
        let mut sums = [0.0; 3];
        for (terms, weight) in terms.iter().zip(relative) {
            let weight = if counts_relative { *weight } else { 1.0 };
            sums.iter_mut().zip(terms).for_each(|(sum, term)| *sum += weight * term);
        }
        let sums = sums.map(|sum| sum.max(0.0));
        let all: f64 = sums.iter().sum();
        let (width, height) = cells.size();
        let roots = |terms: &[f64; 3]| terms.map(|term| term.max(0.0).sqrt());
        let pooled: Vec<_> = box_filter(&terms, width, height).iter().map(roots).collect();
        let pooled = cells.expanded(&pooled);
        let names = TERMS.map(|(name, ..)| name);
        let picture = Picture::channels(
            ("terms", "the three terms of the noise as red, green and blue"),
            scale.shrunk(),
            &scale.shrink(&pooled, |roots| *roots),
            names,
        );
        (all > 0.0).then(|| Self { picture, shares: sums.map(|sum| sum / all) })
    }
}

/// A picture of percentages.
fn percentages(
    scale: PictureScale,
    (name, alt): (&'static str, &str),
    values: &[[f64; 1]],
    colors: Colors,
) -> Picture {
    let values: Vec<f64> = scale.shrink(values, |value| *value).into_flattened();
    let unit = "% of the pixel’s brightness";
    Picture::values((name, alt), scale.shrunk(), &values, (colors, unit))
}

/// A picture whose zoom is shared with the other pictures.
fn frame(picture: &Picture, label: &str) -> Markup {
    html! {
        div class={ "frame " (label) } tabindex="0" role="group" aria-label="picture: + and − zoom, arrows move" {
            div .layer { (picture.image()) }
            @if !label.is_empty() { span .label { (label) } }
        }
    }
}

/// A picture with its scale and a caption.
fn figure(picture: &Picture, caption: &Markup) -> Markup {
    html! {
        figure .picture {
            (frame(picture, ""))
            (picture.scale())
            figcaption { (caption) }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn denoised_picture_overlays_the_raw_one_with_a_slider() {
        let picture =
            |alt, value| Picture::exposed((alt, alt), (4, 3), &[Rgb::splat(value); 12], 1.0);
        let raw = Maps {
            image: picture("raw picture", 0.1),
            denoised: None,
            noise: None,
            bias: None,
            is_corrected: false,
            has_cache: false,
            terms: None,
        };
        let html = raw.viewer((4, 3)).into_string();
        assert!(!html.contains("id=\"split\"") && html.contains("id=\"in\""), "{html}");
        let both = Maps { denoised: Some(picture("denoised picture", 0.2)), ..raw };
        let html = both.viewer((4, 3)).into_string();
        assert!(html.contains("id=\"split\"") && html.contains("--aspect:4/3"), "{html}");
        let places =
            ["raw picture", "frame denoised", "denoised picture"].map(|text| html.find(text));
        assert!(places.is_sorted() && places[0].is_some(), "{html}");
    }
}
