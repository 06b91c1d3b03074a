//! Materials that are Lambertian, in a fourth of a cache line.

use super::Material;
use crate::base::math::Rgb;
use crate::scene::bsdf::Bsdf;
use bytemuck::{Pod, Zeroable};

/// What is read of a material that is Lambertian, wherever nothing varies: 16 bytes.
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
#[repr(C)]
pub(super) struct Lambertian {
    pub albedo: Rgb,
    /// What holds for it, bit by bit; without [`Self::IS_LAMBERTIAN`] the rest means nothing.
    pub flags: u32,
}

impl Lambertian {
    pub const IS_LAMBERTIAN: u32 = 1;
    pub const TWO_SIDED: u32 = 2;
    pub const EMITS: u32 = 4;

    pub fn of(material: &Material) -> Self {
        let Bsdf::Lambertian { albedo, two_sided } = material.bsdf else { return Self::default() };
        let emits = material.emission != Rgb::ZERO;
        let flag = |flag: u32, is_set: bool| flag * u32::from(is_set);
        let flags = flag(Self::TWO_SIDED, two_sided) | flag(Self::EMITS, emits);
        Self { albedo, flags: flags | Self::IS_LAMBERTIAN }
    }
}
