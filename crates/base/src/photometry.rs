//! Photometric units.
//!
//! The renderer computes in watts. A color of linear Rec. 709 with the luminance 1
//! ([`luminance`](crate::math::luminance)) and 1 W stands for 683 lm, whatever its hue. Candela,
//! lumen, lux and cd/m^2 of files are divided by this constant, and values in photometric units are
//! multiplied by it.

/// Luminous efficacy of radiation, lm/W: the defining constant Kcd of the candela (SI brochure,
/// 2019, Section 2.3.1), as glTF's `KHR_lights_punctual` uses it.
pub const LUMENS_PER_WATT: f32 = 683.0;
