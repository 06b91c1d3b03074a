//! `bdpm mix --report FILE.html`: a page with a slider for each light.
//!
//! The page has the radiance of each light as a small picture, and mixes these pictures in a
//! script. It computes the error of the mixture from a sample of pixels as `bdpm mix` does from all
//! pixels. The page is a single file without external resources.

use super::mix::Mixed;
use super::page::{self, quoted};
use bdpm::adaptive::stopping::{AROUND_PIXEL, LIT_ONCE, MIN_PIXEL_SIGNAL_SHARE};
use bdpm::base::error::{Error, Result};
use bdpm::base::math::Rgb;
use bdpm::image_io::{ToneCurve, ToneMapping, half_bits};
use bdpm::output::light_layers::LightImage;
use bdpm::output::light_sample::{MixtureSample, SampleSquare, SampledLight};
use bdpm::report::document;
use bdpm::report::number::count;
use bdpm::report::packed::words;
use bdpm::report::picture_scale::PictureScale;
use maud::{Markup, PreEscaped, html};
use std::path::PathBuf;

/// Maximum width of the pictures, pixels.
const WIDTH: u32 = 640;

/// Maximum number of bytes of all pictures. As text, they are a third longer.
const PICTURE_BYTES: usize = 4_200_000;

/// Maximum number of bytes of the sample of pixels from which errors are computed.
const SAMPLE_BYTES: usize = 1_700_000;

/// Bytes of a pixel of a picture: three 16-bit floats.
const PIXEL_BYTES: usize = 6;

/// Minimum end of the scale of sliders.
const SLIDER_END: f32 = 2.0;

/// End of the scale of the exposure, stops.
const STOPS_END: f32 = 8.0;

/// Content of the page.
struct MixPage<'a> {
    mixed: &'a Mixed<'a>,
    /// Position of each slider at the start.
    starts: Vec<f32>,
    scale: PictureScale,
    sample: MixtureSample,
    tone: ToneMapping,
    /// Factor from radiance to display brightness without further stops.
    exposure: f32,
    /// The command that mixes the images, without factors.
    command: String,
    /// Names of the images.
    title: String,
}

/// The page of a mixture of lights, whose images were read from these files.
///
/// # Errors
/// If a light has a factor for each channel.
pub fn html(mixed: &Mixed, images: &[PathBuf], tone: ToneMapping) -> Result<String> {
    let lights = mixed.lights;
    let pixels = PICTURE_BYTES / PIXEL_BYTES / lights.lights.len();
    let together = lights.mixture(&vec![Rgb::ONE; lights.lights.len()]);
    let name = |path: &PathBuf| path.to_string_lossy().into_owned();
    let stem = |path: &PathBuf| path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
    let mut command = format!("bdpm mix {}", all(images, |path| quoted(&name(path)), " "));
    if tone.curve != ToneCurve::Srgb {
        command += &format!(" --tonemap {}", curve_name(tone.curve));
    }
    let page = MixPage {
        mixed,
        starts: starts(mixed)?,
        scale: PictureScale::within(lights.size, WIDTH, pixels),
        sample: lights.sample(SAMPLE_BYTES),
        tone,
        exposure: ToneMapping { stops: 0.0, ..tone }.exposure(&together.radiance),
        command,
        title: all(images, stem, ", "),
    };
    Ok(page.document().into_string())
}

fn all(paths: &[PathBuf], name: impl Fn(&PathBuf) -> String, between: &str) -> String {
    paths.iter().map(name).collect::<Vec<_>>().join(between)
}

fn curve_name(curve: ToneCurve) -> &'static str {
    match curve {
        ToneCurve::Srgb => "srgb",
        ToneCurve::Agx => "agx",
        ToneCurve::Filmic => "filmic",
    }
}

/// Positions of the sliders: the factors of the lights.
fn starts(mixed: &Mixed) -> Result<Vec<f32>> {
    let start = |(light, factor): (&LightImage, &Rgb)| {
        if *factor == Rgb::splat(factor.x) {
            return Ok(factor.x);
        }
        let problem = format!("the slider of `{}` in --report has no color", light.name);
        let advice = "write the colors by --output, and make the page of that image";
        Err(Error::new(problem, advice))
    };
    mixed.lights.lights.iter().zip(&mixed.factors).map(start).collect()
}

impl MixPage<'_> {
    fn document(&self) -> Markup {
        let head = html! {
            meta name="color-scheme" content="light dark";
            link rel="icon" href="data:,";
        };
        let body = html! {
            (self.body())
            script { (PreEscaped(include_str!("mix_page.js"))) }
        };
        let style = format!("{}{}", page::STYLE, include_str!("mix_page.css"));
        document(&format!("{}: lights", self.title), &style, &head, &body)
    }

    fn body(&self) -> Markup {
        let (width, height) = self.scale.shrunk();
        let squares: Vec<String> = self.sample.squares.iter().map(square).collect();
        html! {
            main id="mix" data-width=(width) data-height=(height)
                data-exposure=(self.exposure) data-curve=(curve_name(self.tone.curve))
                data-command=(self.command)
                data-size=(format!("{},{}", self.sample.size.0, self.sample.size.1))
                data-squares=(squares.join(" ")) data-clean-share=[self.sample.clean_share]
                data-around=(AROUND_PIXEL) data-lit-once=(LIT_ONCE)
                data-signal-share=(MIN_PIXEL_SIGNAL_SHARE) {
                header {
                    h1 { "Lights of " (self.title) }
                    p .lead {
                        "Each light is an image of its own. Move the sliders to dim the lights after "
                        "the render."
                    }
                    noscript { p .stale { "The sliders need JavaScript." } }
                }
                div .desk {
                    (self.picture())
                    (self.controls())
                }
                section {
                    h2 { "The command for this mixture" }
                    p {
                        "It writes the mixture at full size. The exposure of its preview is that of "
                        "the mixture."
                    }
                    pre { code id="command" tabindex="0" { (self.command) } }
                    p { button type="button" id="copy" { "Copy" } " " span id="copied" role="status" {} }
                }
                section {
                    h2 { "How exact it is" }
                    (self.precision())
                }
                footer { p { "Written by bdpm " (env!("CARGO_PKG_VERSION")) "." } }
            }
        }
    }

    /// The picture, and what is known of it.
    fn picture(&self) -> Markup {
        let (width, height) = self.scale.shrunk();
        html! {
            div .viewer style=(format!("--aspect:{width}/{height};--wide:{width};--high:{height}")) {
                div .frame {
                    canvas id="picture" width=(width) height=(height) role="img"
                        aria-label=(format!("the mixture of the lights of {}", self.title)) {}
                }
                dl .tiles {
                    div {
                        dt { "relative error" }
                        dd { output id="error" { "unknown" } span .minor id="parts" {} }
                    }
                    div {
                        dt { "mean luminance" }
                        dd { span id="mean" { "unknown" } span .minor { "W/(m² sr)" } }
                    }
                }
            }
        }
    }

    fn controls(&self) -> Markup {
        let stops = self.tone.stops;
        let end = STOPS_END.max(stops.abs().ceil());
        let lights = self.mixed.lights.lights.iter().zip(&self.sample.lights);
        html! {
            div .controls role="group" aria-label="lights and exposure" {
                @for (index, ((light, sampled), start)) in lights.zip(&self.starts).enumerate() {
                    (self.light(index, light, sampled, *start))
                }
                div .exposure {
                    label for="stops" { "exposure, stops" }
                    input type="range" id="stops" min=(-end) max=(end) step="0.05" value=(stops)
                        autocomplete="off";
                    input type="number" id="stops-number" aria-label="exposure, stops, number"
                        step="any" value=(stops) autocomplete="off";
                }
                button type="button" id="reset" { "Reset" }
            }
        }
    }

    /// The slider of a light, with its pixels.
    fn light(
        &self,
        index: usize,
        light: &LightImage,
        sampled: &SampledLight,
        start: f32,
    ) -> Markup {
        let id = format!("light-{index}");
        let pixels = self.scale.shrink(light.radiance(), |own| own.to_array().map(f64::from));
        let half = |value: f64| half_bits((value / sampled.scale) as f32);
        let radiance: Vec<u16> = pixels.into_flattened().into_iter().map(half).collect();
        html! {
            div .light data-name=(light.name) data-known[light.has_error()]
                data-scale=(sampled.scale) data-mean=(sampled.mean) data-bias=(sampled.bias)
                data-denoised=[sampled.denoised.filter(|own| own.is_finite())] data-seed=[sampled.seed]
                data-luminance=(words(&sampled.luminance))
                data-rms=[sampled.rms.as_deref().map(words)]
                data-radiance=(words(&radiance)) {
                label for=(id) { (light.name) }
                input type="range" id=(id) min="0" max=(SLIDER_END.max(start)) step="0.01"
                    value=(start) autocomplete="off";
                input type="number" min="0" step="any" value=(start) autocomplete="off"
                    aria-label=(format!("{}, number", light.name));
            }
        }
    }

    /// Sentences about the precision of the picture and the error.
    fn precision(&self) -> Markup {
        let MixtureSample { size, squares, clean_share, largest_difference, .. } = &self.sample;
        let (width, height) = self.scale.shrunk();
        let step = self.scale.step;
        html! {
            p {
                "The images have " (size.0) "x" (size.1) " pixels, and the picture " (width) "x"
                (height) ". "
                @if step > 1 {
                    "Each of its pixels is the mean over " (step) "x" (step) " pixels. "
                }
                "Radiance has 11 bits of precision (16-bit floats). The automatic exposure is that of "
                "all lights together, whatever the sliders show."
            }
            p {
                @if clean_share.is_none() {
                    "The error is the one that bdpm mix states, computed from all pixels. "
                    "It is rounded since the numbers of pixels have 11 bits. "
                } @else {
                    "The error is computed from " (count(squares.len() as f64)) " squares of up to "
                    "8x8 pixels, weighted such that the errors of all lights together, of each alone, "
                    "and of all with one at 0 or 0.25 are those that bdpm mix states. Others are "
                    "rounded. "
                }
                "Over some mixtures, it differs by at most "
                (format!("{:.2} %", (100.0 * largest_difference).max(0.01)))
                " of its value from the error that bdpm mix states."
            }
            p {
                "Noise of different lights is independent, unless their images have the same seed. "
                "Merge biases are taken to add up."
            }
        }
    }
}

/// Ends and weight of a square, as the script reads them.
fn square(square: &SampleSquare) -> String {
    let [left, top, right, bottom] = square.pixels;
    format!("{left},{top},{right},{bottom},{}", square.weight)
}
