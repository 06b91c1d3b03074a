//! Numbers of `[materials.NAME]`, each within its bounds.

use super::Numbers;
use crate::base::error::Error;
use crate::base::math::Rgb;
use crate::settings::as_serde;
use serde::{Deserialize, Deserializer};

/// Defines a number within bounds, or one per channel.
macro_rules! bounded {
    ($(#[$doc:meta])* $name:ident($inner:ty), $low:expr, $high:expr, $what:literal, $advice:literal) => {
        $(#[$doc])*
        #[derive(Clone, Copy, Debug)]
        pub(in crate::import) struct $name(pub $inner);

        impl<'de> Deserialize<'de> for $name {
            fn deserialize<D: Deserializer<'de>>(from: D) -> Result<Self, D::Error> {
                let value = <$inner as Bounded>::read(from)?;
                if ($low..=$high).contains(&value.least()) && ($low..=$high).contains(&value.most()) {
                    return Ok(Self(value));
                }
                Err(as_serde(Error::new(concat!("the ", $what, " is out of range"), $advice)))
            }
        }
    };
}

/// What can be checked against bounds.
trait Bounded: Sized {
    fn read<'de, D: Deserializer<'de>>(from: D) -> Result<Self, D::Error>;
    fn least(&self) -> f32;
    fn most(&self) -> f32;
}

impl Bounded for f32 {
    fn read<'de, D: Deserializer<'de>>(from: D) -> Result<Self, D::Error> {
        Self::deserialize(from)
    }
    fn least(&self) -> f32 {
        *self
    }
    fn most(&self) -> f32 {
        *self
    }
}

impl Bounded for Rgb {
    fn read<'de, D: Deserializer<'de>>(from: D) -> Result<Self, D::Error> {
        Ok(Numbers::deserialize(from)?.values.as_vec3())
    }
    fn least(&self) -> f32 {
        self.min_element()
    }
    fn most(&self) -> f32 {
        self.max_element()
    }
}

bounded!(
    /// Refractive index of a clear medium.
    Ior(f32), 0.1, 10.0, "refractive index",
    "give a number from 0.1 to 10, such as 1.5 for glass"
);
bounded!(
    /// Real part of a metal's refractive index.
    Index(Rgb), 1e-3, 100.0, "refractive index",
    "give a number from 0.001 to 100, or one per channel"
);
bounded!(
    /// The square root of the GGX width.
    Roughness(f32), 0.0, 1.0, "roughness", "give a number from 0 (smooth) to 1"
);
bounded!(
    /// Share of the rays that meet a surface.
    Opacity(f32), 0.0, 1.0, "opacity", "give a number from 0 to 1"
);
bounded!(
    /// Share of a metal.
    Metallic(f32), 0.0, 1.0, "metallic share", "give a number from 0 to 1"
);
bounded!(
    /// What a map of normals is stretched by.
    NormalScale(f32), -100.0, 100.0, "scale of the normals", "give a number from -100 to 100"
);
