//! Perfect mirrors.

use super::model::{
    Describe, Lobes, Local, LocalModel, TextureValues, Traits, Transmission, only_single_directions,
};
use super::{Bsdf, BsdfSample, Lobe, LobeSet, LobeValue, Transport};
use crate::base::math::Rgb;
use crate::base::rng::Rng;
use glam::Vec3;

/// [`Bsdf::Mirror`](super::Bsdf::Mirror) as a model.
#[derive(Clone, Copy, Debug)]
pub(super) struct Mirror {
    pub(super) reflectance: Rgb,
}

/// The reflection of the local direction `wo` in the surface.
pub(super) fn mirrored(wo: Vec3, weight: Rgb) -> BsdfSample {
    BsdfSample { wi: Vec3::new(-wo.x, -wo.y, wo.z), weight, lobe: Lobe::Delta }
}

impl Describe for Mirror {
    #[inline]
    fn traits(&self) -> Traits {
        Traits {
            classes: Lobes::of(Lobe::Delta),
            transmission: Transmission::None,
            depends_on_tangent: false,
            albedo_bound: self.reflectance,
        }
    }

    fn textured(&self, _texture: &TextureValues) -> Option<Bsdf> {
        None
    }

    /// White: denoisers see what the mirror shows.
    fn color(&self, _front: bool) -> Rgb {
        Rgb::ONE
    }
}

impl LocalModel for Mirror {
    only_single_directions!();

    #[inline]
    fn sample(
        &self,
        at: Local,
        _transport: Transport,
        _wanted: LobeSet,
        _rng: &mut Rng,
    ) -> Option<BsdfSample> {
        Some(mirrored(at.wo, self.reflectance))
    }
}
