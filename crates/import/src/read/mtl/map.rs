//! Records of textures in an MTL file: options, then the name of a file.

use bdpm_core::scene::{Sampling, Wrap};
use glam::{Affine2, Vec2};

/// A record such as `map_Kd -s 4 4 1 wood tile.png`.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct MapRecord<'a> {
    /// Name of the file, which may hold spaces and quotes.
    pub name: &'a str,
    /// Map from the texture coordinates of the mesh to those of the picture: `-s` scales them, then
    /// `-o` moves them.
    pub to_uv: Affine2,
    pub sampling: Sampling,
    /// `-bm`: strength of bumps.
    pub strength: f32,
    /// Options that would change the picture and are ignored.
    pub ignored: Vec<&'a str>,
}

impl<'a> MapRecord<'a> {
    /// Parses the text after the keyword. Options that are not known are part of the name.
    pub fn parse(text: &'a str) -> Self {
        let mut record = Self {
            name: text.trim(),
            to_uv: Affine2::IDENTITY,
            sampling: Sampling::default(),
            strength: 1.0,
            ignored: Vec::new(),
        };
        let (mut scale, mut offset) = (Vec2::ONE, Vec2::ZERO);
        while let Some((option, rest)) = word(record.name).filter(|(own, _)| own.starts_with('-')) {
            let Some((numbers, after)) = values(option, rest) else { break };
            let value = word(rest).map_or("", |(value, _)| value);
            // Numbers that are missing keep their default, as in the specification.
            let vector = |default: Vec2| {
                let [x, y] = [0, 1].map(|i| numbers.get(i).copied().unwrap_or(default[i]));
                Vec2::new(x, y)
            };
            let is_default = match option {
                "-o" => {
                    offset = vector(Vec2::ZERO);
                    true
                }
                "-s" => {
                    scale = vector(Vec2::ONE);
                    true
                }
                "-bm" => {
                    record.strength = numbers.first().copied().unwrap_or(1.0);
                    true
                }
                "-clamp" => {
                    let wrap = if value == "on" { Wrap::Clamp } else { Wrap::Repeat };
                    record.sampling.wrap = [wrap; 2];
                    true
                }
                "-t" => numbers.iter().all(|number| *number == 0.0),
                "-mm" => numbers[..] == [0.0, 1.0] || numbers[..] == [0.0],
                // Matte and luminance are what opacity means here.
                "-imfchan" => matches!(value, "m" | "l"),
                "-cc" => value == "off",
                "-type" => false,
                // Filters between texels, and resolutions.
                _ => true,
            };
            if !is_default {
                record.ignored.push(option);
            }
            record.name = after;
        }
        let to_uv = Affine2::from_scale_angle_translation(scale, 0.0, offset);
        if to_uv.is_finite() && scale.x != 0.0 && scale.y != 0.0 {
            record.to_uv = to_uv;
        } else {
            record.ignored.push("-s");
        }
        record
    }
}

/// The numbers of an option and the text after its values; `None` if there is no such option.
fn values<'a>(option: &str, rest: &'a str) -> Option<(Vec<f32>, &'a str)> {
    match option {
        "-o" | "-s" | "-t" => Some(numbers(rest, 3)),
        "-mm" => Some(numbers(rest, 2)),
        "-bm" | "-boost" | "-texres" => Some(numbers(rest, 1)),
        "-blendu" | "-blendv" | "-cc" | "-clamp" | "-imfchan" | "-type" => {
            let (_, after) = word(rest)?;
            Some((Vec::new(), after))
        }
        _ => None,
    }
}

/// The first word and the text after it.
fn word(text: &str) -> Option<(&str, &str)> {
    let end = text.find(char::is_whitespace).unwrap_or(text.len());
    (end > 0).then(|| (&text[..end], text[end..].trim_start()))
}

/// Up to `most` numbers at the beginning, and the text after them.
fn numbers(mut text: &str, most: usize) -> (Vec<f32>, &str) {
    let mut numbers = Vec::new();
    while numbers.len() < most
        && let Some((own, rest)) = word(text)
        && let Ok(number) = own.parse()
    {
        numbers.push(number);
        text = rest;
    }
    (numbers, text)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn options_precede_names_that_may_hold_spaces() {
        for (text, name, scale, offset, ignored) in [
            ("wood.png", "wood.png", [1.0, 1.0], [0.0, 0.0], ""),
            ("-s 4 2 1 wood tile.png", "wood tile.png", [4.0, 2.0], [0.0, 0.0], ""),
            ("-o .5 -s 3 -clamp on w.png", "w.png", [3.0, 1.0], [0.5, 0.0], ""),
            ("-o 0.1 0.2 0.3 -s 1 1 1 \"a b.png\"", "\"a b.png\"", [1.0, 1.0], [0.1, 0.2], ""),
            ("-bm 1.0 -blendu off 7.png", "7.png", [1.0, 1.0], [0.0, 0.0], ""),
            ("-mm 0 1 -t 0 0 0 -texres 256 x y", "x y", [1.0, 1.0], [0.0, 0.0], ""),
            ("-mm 0.2 2 -cc on a.png", "a.png", [1.0, 1.0], [0.0, 0.0], "-mm -cc"),
            ("-t 1 1 1 -type sphere a.png", "a.png", [1.0, 1.0], [0.0, 0.0], "-t -type"),
            ("-strange.png", "-strange.png", [1.0, 1.0], [0.0, 0.0], ""),
            ("-s 0 1 1 a.png", "a.png", [1.0, 1.0], [0.0, 0.0], "-s"),
            ("-s 1e39 1 1 a.png", "a.png", [1.0, 1.0], [0.0, 0.0], "-s"),
            ("-s", "", [1.0, 1.0], [0.0, 0.0], ""),
            ("", "", [1.0, 1.0], [0.0, 0.0], ""),
        ] {
            let record = MapRecord::parse(text);
            assert_eq!(record.name, name, "{text}");
            let one = record.to_uv.transform_point2(Vec2::ONE);
            assert_eq!(one, Vec2::from_array(scale) + Vec2::from_array(offset), "{text}");
            assert_eq!(record.ignored.join(" "), ignored, "{text}");
            assert_eq!(record.sampling.wrap[0] == Wrap::Clamp, text.contains("-clamp on"));
        }
    }
}
