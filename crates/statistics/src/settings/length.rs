//! Lengths that may be relative to the scene.

use super::checks::{as_serde, check_radius};
use bdpm_base::error::{Error, Result};
use serde::{Deserialize, Deserializer, Serialize, Serializer, de};
use std::fmt;
use std::str::FromStr;

/// A positive length, absolute or relative to the scene.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Length {
    /// Scene units.
    Units(f32),
    /// Share of the scene size (longest side of its bounding box), 0.01 for 1 %.
    Share(f32),
}

impl Length {
    /// In scene units, for a scene of this size in scene units.
    pub fn resolve(self, scene_size: f32) -> f32 {
        match self {
            Self::Units(length) => length,
            Self::Share(share) => share * scene_size,
        }
    }
}

impl FromStr for Length {
    type Err = Error;

    /// Reads a number of scene units such as `4.5`, or a share such as `0.8%`.
    fn from_str(text: &str) -> Result<Self> {
        let text = text.trim();
        let (number, percent) = match text.strip_suffix('%') {
            Some(number) => (number.trim_end(), true),
            None => (text, false),
        };
        let value: f64 = number
            .parse()
            .map_err(|_| Error::new(format!("`{text}` is not a length"), LENGTH_ADVICE))?;
        let value = (if percent { value / 100.0 } else { value }) as f32;
        check_radius(&value)?;
        Ok(if percent { Self::Share(value) } else { Self::Units(value) })
    }
}

impl Serialize for Length {
    /// Writes the shortest number or share that [`Deserialize`] reads as this length.
    fn serialize<S: Serializer>(&self, to: S) -> std::result::Result<S::Ok, S::Error> {
        // Through text, which keeps an f32 such as 0.1 short.
        let short = |value: f32| value.to_string().parse::<f64>().expect("a number");
        match *self {
            Self::Units(length) => to.serialize_f64(short(length)),
            Self::Share(share) => {
                let exact = f64::from(share) * 100.0;
                let percent = short(exact as f32);
                let leads_back = (percent / 100.0) as f32 == share;
                to.collect_str(&format_args!("{}%", if leads_back { percent } else { exact }))
            }
        }
    }
}

impl<'de> Deserialize<'de> for Length {
    fn deserialize<D: Deserializer<'de>>(from: D) -> std::result::Result<Self, D::Error> {
        struct Visitor;
        impl de::Visitor<'_> for Visitor {
            type Value = Length;
            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                write!(
                    f,
                    "a length: a number of scene units, or a share of the scene size in quotes, such as \"0.8%\""
                )
            }
            fn visit_f64<E: de::Error>(self, value: f64) -> std::result::Result<Length, E> {
                check_radius(&(value as f32)).map_err(as_serde)?;
                Ok(Length::Units(value as f32))
            }
            fn visit_i64<E: de::Error>(self, value: i64) -> std::result::Result<Length, E> {
                self.visit_f64(value as f64)
            }
            fn visit_u64<E: de::Error>(self, value: u64) -> std::result::Result<Length, E> {
                self.visit_f64(value as f64)
            }
            fn visit_str<E: de::Error>(self, value: &str) -> std::result::Result<Length, E> {
                value.parse().map_err(as_serde)
            }
        }
        from.deserialize_any(Visitor)
    }
}

pub(super) const LENGTH_ADVICE: &str =
    "give a positive radius in scene units, or a share of the scene size such as 0.8%";

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn length_is_parsed_as_units_or_share() {
        assert_eq!("4.5".parse::<Length>().unwrap(), Length::Units(4.5));
        assert_eq!(" 1e-3 ".parse::<Length>().unwrap(), Length::Units(1e-3));
        assert_eq!("0.8%".parse::<Length>().unwrap(), Length::Share(0.008));
        assert_eq!("50 %".parse::<Length>().unwrap(), Length::Share(0.5));
        assert_eq!(Length::Share(0.008).resolve(500.0), 4.0);
        assert_eq!(Length::Units(3.0).resolve(500.0), 3.0);
        for bad in ["", "%", "x", "0", "-1", "0%", "nan", "inf", "1e39", "1e-50", "5%%", "3 m"] {
            let error = bad.parse::<Length>().unwrap_err().to_string();
            assert!(error.contains("help: give a positive radius"), "{bad}: {error}");
        }
    }

    #[test]
    fn written_length_is_read_unchanged() {
        for text in ["0.8%", "1%", "33.3%", "0.000123%", "4.633333", "1e-30"] {
            let length: Length = text.parse().unwrap();
            let written = serde_json::to_string(&length).unwrap();
            assert_eq!(serde_json::from_str::<Length>(&written).unwrap(), length, "{written}");
        }
        let written = |length| serde_json::to_string(&length).unwrap();
        assert_eq!(written(Length::Share(0.008)), "\"0.8%\"");
        assert_eq!(written(Length::Units(2.5)), "2.5");
    }
}
