//! Numbers within bounds: those of `[materials.NAME]`, and amounts of light.

use super::keys::Triple;
use bdpm_core::base::error::Error;
use bdpm_core::base::math::Rgb;
use bdpm_core::settings::as_serde;
use serde::{Deserialize, Deserializer};

/// A number, or one per channel, as it is read from a file and stored.
trait Bounded: Sized {
    type Read: for<'de> Deserialize<'de>;

    /// The stored value, with its minimum and maximum.
    fn with_range(read: Self::Read) -> (Self, [f64; 2]);
}

impl Bounded for f32 {
    type Read = f32;

    fn with_range(read: f32) -> (Self, [f64; 2]) {
        (read, [read.into(); 2])
    }
}

impl Bounded for Rgb {
    type Read = Triple;

    fn with_range(Triple { values, .. }: Triple) -> (Self, [f64; 2]) {
        (values.as_vec3(), [values.min_element(), values.max_element()])
    }
}

/// Defines numbers within bounds, with the problem and advice for others.
macro_rules! bounded {
    ($($(#[$doc:meta])* $name:ident($inner:ty), $low:expr, $high:expr, $problem:expr, $advice:expr;)*) => {$(
        $(#[$doc])*
        #[derive(Clone, Copy, Debug)]
        pub struct $name(pub $inner);

        impl<'de> Deserialize<'de> for $name {
            fn deserialize<D: Deserializer<'de>>(from: D) -> Result<Self, D::Error> {
                let read = <$inner as Bounded>::Read::deserialize(from)?;
                let (value, [low, high]) = <$inner as Bounded>::with_range(read);
                if low >= $low && high <= $high {
                    return Ok(Self(value));
                }
                Err(as_serde(Error::new($problem, $advice)))
            }
        }
    )*};
}

bounded! {
    /// Reflected share of light per channel.
    Albedo(Rgb), 0.0, 1.0, "the albedo is not between 0 and 1",
    "give the reflected share of light, such as 0.5 or [0.6, 0.1, 0.1]";
    /// Radiance, intensity or irradiance per channel, or another number of at least 0.
    NonNegative(Rgb), 0.0, f64::MAX, "light is negative", "give numbers of at least 0";
    /// Absorption or scattering coefficient, 1/scene unit, per channel.
    Coefficient(Rgb), 0.0, 1e9, "the coefficient is out of range",
    "give one number per scene unit, or one per channel, from 0 to 1e9";
    /// Real part of a metal's refractive index.
    MetalIndex(Rgb), 1e-3, 100.0, "the refractive index is out of range",
    "give a number from 0.001 to 100, or one per channel";
    /// The square root of the GGX width.
    Roughness(f32), 0.0, 1.0, "the roughness is out of range",
    "give a number from 0 (smooth) to 1";
    /// Share of the rays that meet a surface.
    Opacity(f32), 0.0, 1.0, "the opacity is out of range", "give a number from 0 to 1";
    /// A share or an amount in [0, 1].
    Share(f32), 0.0, 1.0, "the number is out of range", "give a number from 0 to 1";
    /// Share of a metal.
    Metallic(f32), 0.0, 1.0, "the metallic share is out of range", "give a number from 0 to 1";
    /// Factor of the tangential components in a normal map.
    NormalScale(f32), -100.0, 100.0, "the scale of the normals is out of range",
    "give a number from -100 to 100";
}
