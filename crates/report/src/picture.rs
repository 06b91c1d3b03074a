//! Pictures in pages: pixels as PNG, scale and caption as text.

use super::number::count;
use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use bdpm_core::base::math::Rgb;
use bdpm_core::image_io::{auto_exposure, encode_png, number, quantile, tick_step, tone_map};
use colorgrad::Gradient;
use maud::{Markup, html};
use rayon::prelude::*;

/// Number of color stops of a scale.
const STOPS: u32 = 24;

/// Share of the values that a scale covers. A few very large values would otherwise determine the
/// scale.
pub const COVERED: f64 = 0.97;

/// Maximum number of steps of a scale, so that their numbers have room on a phone.
pub const MAX_STEPS: f64 = 5.0;

/// A picture with its scale.
pub struct Picture {
    /// File name.
    pub name: &'static str,
    /// Text alternative.
    pub alt: String,
    width: u32,
    height: u32,
    /// The PNG file.
    pub png: Vec<u8>,
    scale: Scale,
    /// Number of pixels whose value exceeds the scale.
    above: usize,
}

enum Scale {
    /// CSS colors from left to right, ticks with their positions in percent, and a unit.
    Bar { colors: Vec<String>, ticks: Vec<(f64, String)>, unit: &'static str },
    /// Names of the channels, and the value of their full color.
    Channels { names: [&'static str; 3], full: String },
}

/// Color map of a picture.
#[derive(Clone, Copy)]
pub enum Colors {
    /// From 0 to the maximum.
    Sequential,
    /// Symmetric about 0.
    Diverging,
}

impl Colors {
    /// Color of a place on the scale, from 0 to 1, sRGB.
    fn at(self, share: f64) -> [u8; 3] {
        let share = share.clamp(0.0, 1.0) as f32;
        let [r, g, b, _] = match self {
            Self::Sequential => colorgrad::preset::viridis().at(share).to_rgba8(),
            Self::Diverging => colorgrad::preset::pu_or().at(share).to_rgba8(),
        };
        [r, g, b]
    }

    /// Colors of 256 even steps along the scale.
    pub fn table(self) -> Vec<[u8; 3]> {
        (0..=255).map(|step| self.at(f64::from(step) / 255.0)).collect()
    }
}

impl Picture {
    /// Radiance, tone-mapped, W/(m^2 sr).
    pub fn radiance(names: (&'static str, &str), size: (u32, u32), pixels: &[Rgb]) -> Self {
        Self::exposed(names, size, pixels, auto_exposure(pixels))
    }

    /// Radiance, W/(m^2 sr), tone-mapped with this exposure.
    pub fn exposed(
        (name, alt): (&'static str, &str),
        (width, height): (u32, u32),
        pixels: &[Rgb],
        exposure: f32,
    ) -> Self {
        let mapped: Vec<_> = pixels.par_iter().map(|&pixel| tone_map(pixel, exposure)).collect();
        let bytes = mapped.into_flattened();
        // Twice the white of the display is nearly white after tone mapping.
        let max = 2.0 / f64::from(exposure);
        let gray = |x: f64| tone_map(Rgb::splat(x as f32), exposure);
        let colors = stops(|share| gray(share * max));
        let step = tick_step(max, MAX_STEPS);
        let ticks = ticks((0.0, max), step, number);
        Self {
            name,
            alt: alt.into(),
            width,
            height,
            png: encode_png(width, height, &bytes),
            scale: Scale::Bar { colors, ticks, unit: "W/(m² sr)" },
            above: 0,
        }
    }

    /// A value for each pixel, in colors that color-blind people can distinguish.
    pub fn values(
        (name, alt): (&'static str, &str),
        (width, height): (u32, u32),
        values: &[f64],
        (colors, unit): (Colors, &'static str),
    ) -> Self {
        let known = values.iter().map(|value| value.abs()).filter(|value| value.is_finite());
        let known: Vec<f64> = known.collect();
        let max = if known.is_empty() { 0.0 } else { quantile(known, COVERED) };
        // A picture of zeros has a scale as well.
        let max = if max > 0.0 { max } else { 1.0 };
        let step = tick_step(max, MAX_STEPS);
        let max = (max / step).ceil() * step;
        let min = match colors {
            Colors::Sequential => 0.0,
            Colors::Diverging => -max,
        };
        // Looked up: a gradient is slow for every pixel.
        let table = colors.table();
        let index = |value: f64| (255.0 * ((value - min) / (max - min))).round() as usize;
        let bytes: Vec<u8> =
            values.iter().flat_map(|&value| table[index(value).min(255)]).collect();
        let step = if min < 0.0 { tick_step(2.0 * max, MAX_STEPS) } else { step };
        let ticks = ticks((min, max), step, number);
        Self {
            name,
            alt: alt.into(),
            width,
            height,
            png: encode_png(width, height, &bytes),
            scale: Scale::Bar { colors: stops(|share| colors.at(share)), ticks, unit },
            above: values.iter().filter(|value| value.abs() > max).count(),
        }
    }

    /// Three values for each pixel as red, green and blue on one linear scale.
    pub fn channels(
        (name, alt): (&'static str, &str),
        (width, height): (u32, u32),
        values: &[[f64; 3]],
        names: [&'static str; 3],
    ) -> Self {
        let largest = values.iter().map(|v| v.iter().copied().fold(0.0, f64::max)).collect();
        let full = quantile(largest, COVERED);
        let byte = |x: f64| (255.0 * (x / full).clamp(0.0, 1.0)).round() as u8;
        let bytes: Vec<u8> = values.iter().flat_map(|value| value.map(byte)).collect();
        Self {
            name,
            alt: alt.into(),
            width,
            height,
            png: encode_png(width, height, &bytes),
            scale: Scale::Channels { names, full: number(full) },
            above: values.iter().filter(|v| v.iter().any(|x| *x > full)).count(),
        }
    }

    /// Figure with scale and caption. `boxes`, in fractions of the image, are outlined.
    pub fn figure(&self, boxes: &[[f64; 4]], caption: &Markup) -> Markup {
        let percent = |x: f64| format!("{:.3}%", 100.0 * x);
        html! {
            figure .picture {
                div .pixels {
                    (self.image())
                    @for [x0, y0, x1, y1] in boxes {
                        div .box style=(format!(
                            "left:{};top:{};width:{};height:{}",
                            percent(*x0), percent(*y0), percent(x1 - x0), percent(y1 - y0)
                        )) {}
                    }
                }
                (self.scale())
                figcaption { (caption) (self.above_scale()) }
            }
        }
    }

    /// The picture without its scale.
    pub fn image(&self) -> Markup {
        html! {
            img src=(format!("data:image/png;base64,{}", STANDARD.encode(&self.png)))
                width=(self.width) height=(self.height) alt=(self.alt);
        }
    }

    /// The scale.
    pub fn scale(&self) -> Markup {
        self.scale.markup()
    }

    /// A sentence about pixels above the scale, if there are any.
    pub fn above_scale(&self) -> Markup {
        html! { @if self.above > 0 { " " (count(self.above as f64)) " pixels lie outside the scale." } }
    }
}

impl Scale {
    fn markup(&self) -> Markup {
        match self {
            Self::Bar { colors, ticks, unit } => html! {
                div .scale {
                    div .bar
                        style=(format!("background:linear-gradient(to right,{})", colors.join(","))) {}
                    div .ticks {
                        @for (place, label) in ticks {
                            span style=(format!("left:{place:.2}%")) { (label) }
                        }
                    }
                    div .unit { (unit) }
                }
            },
            Self::Channels { names, full } => html! {
                div .scale .channels {
                    @for (color, name) in ["#f00", "#0f0", "#00f"].iter().zip(names) {
                        span { span .swatch style=(format!("background:{color}")) {} (name) }
                    }
                    div .unit { "full color: " (full) " W/(m² sr)" }
                }
            },
        }
    }
}

fn stops(color: impl Fn(f64) -> [u8; 3]) -> Vec<String> {
    let stop = |i: u32| {
        let [r, g, b] = color(f64::from(i) / f64::from(STOPS));
        format!("#{r:02x}{g:02x}{b:02x}")
    };
    (0..=STOPS).map(stop).collect()
}

/// Multiples of the step, with their positions in percent.
fn ticks((min, max): (f64, f64), step: f64, label: impl Fn(f64) -> String) -> Vec<(f64, String)> {
    let (first, last) = ((min / step - 1e-9).ceil() as i64, (max / step + 1e-9).floor() as i64);
    let tick = |i: i64| {
        let value = i as f64 * step;
        (100.0 * (value - min) / (max - min), label(value).replace('-', "\u{2212}"))
    };
    (first..=last).map(tick).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ticks_are_round_numbers_inside_the_scale() {
        let found = ticks((-3.0, 3.0), 2.0, number);
        let labels: Vec<&str> = found.iter().map(|(_, label)| &label[..]).collect();
        assert_eq!(labels, ["\u{2212}2", "0", "2"]);
        assert_eq!(found[1].0, 50.0);
        assert_eq!(ticks((0.0, 1.0), 0.2, number).len(), 6);
    }

    #[test]
    fn pictures_of_zeros_and_of_unknown_values_have_a_scale() {
        for values in [vec![0.0; 4], vec![f64::NAN; 4], vec![0.0, f64::INFINITY, f64::NAN, 0.0]] {
            let own = Picture::values(("a", "b"), (2, 2), &values, (Colors::Sequential, "lx"));
            let Scale::Bar { ticks, .. } = &own.scale else { panic!("a bar") };
            assert!(ticks.len() > 1 && ticks.len() < 20, "{values:?}");
        }
    }

    #[test]
    fn picture_decodes_to_its_colors() {
        let values: Vec<f64> = (0..256).map(f64::from).collect();
        for colors in [Colors::Sequential, Colors::Diverging] {
            let picture = Picture::values(("a", "b"), (16, 16), &values, (colors, "%"));
            let mut reader =
                png::Decoder::new(std::io::Cursor::new(&picture.png)).read_info().unwrap();
            let mut bytes = vec![0; reader.output_buffer_size().unwrap()];
            reader.next_frame(&mut bytes).unwrap();
            let [r, g, b, _] = match colors {
                Colors::Sequential => colorgrad::preset::viridis().at(0.0).to_rgba8(),
                Colors::Diverging => colorgrad::preset::pu_or().at(0.5).to_rgba8(),
            };
            for (found, expected) in bytes[..3].iter().zip([r, g, b]) {
                assert!(found.abs_diff(expected) <= 3, "{:?} {expected}", &bytes[..3]);
            }
        }
    }
}
