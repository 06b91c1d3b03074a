//! Weights of merges where camera paths gather.

use super::Mis;
use super::weights::first_weight;
use crate::transport::gather::{GatherPoint, GatherView};
use crate::transport::kernel::ByClass;
use crate::transport::photon::PhotonClass;
use crate::transport::photon_map::{Weighing, of_quad};
use glam::{Vec3, Vec4};

/// Those at a Lambertian first vertex, which multiplies what photons carry with this.
pub(crate) struct AtFirst(pub f32);

/// Those at a Lambertian second vertex.
pub(crate) struct AtSecond {
    /// Of photons that are merged there.
    by_class: ByClass<f32>,
    /// Whether there may be others, straight from a light.
    any_straight: bool,
}

impl AtSecond {
    /// Of a camera path whose part, times the density of light paths there, is `earlier`.
    #[inline(always)] // as those below: parts of the loop over look-ups
    pub fn new(mis: &Mis, earlier: f32) -> Self {
        Self { by_class: mis.balance.second_weights(earlier), any_straight: !mis.connects }
    }

    /// That of photons that had a diffuse bounce.
    #[inline(always)]
    pub fn bounced(&self) -> f32 {
        self.by_class[PhotonClass::Diffuse as usize]
    }
}

impl Weighing for AtFirst {
    const ALL: bool = true;

    #[inline(always)]
    fn by_class(&self) -> Option<ByClass<f32>> {
        None
    }

    #[inline(always)]
    fn weights(&self, parts: &[f32], quad: usize) -> Option<Vec4> {
        // As `first_weight`.
        Some((Vec4::ONE + self.0 * of_quad(parts, quad)).recip())
    }
}

impl Weighing for AtSecond {
    const ALL: bool = true;

    #[inline(always)]
    fn by_class(&self) -> Option<ByClass<f32>> {
        Some(self.by_class)
    }

    #[inline(always)]
    fn weights(&self, parts: &[f32], quad: usize) -> Option<Vec4> {
        self.any_straight.then(|| Vec4::from(of_quad(parts, quad).to_array().map(merged_at_second)))
    }
}

/// 1 of a photon that is merged at the second vertex, too, by what it carries; else 0.
#[inline(always)]
fn merged_at_second(part: f32) -> f32 {
    if part.is_sign_negative() { 0.0 } else { 1.0 }
}

impl Mis {
    /// Weight of a merge at `point`, which carries `own`, of a photon that came from `wi` and carries `part`.
    pub(crate) fn weight_in_view(
        &self,
        view: &GatherView,
        point: &GatherPoint,
        own: f32,
        (class, part): (PhotonClass, f32),
        wi: Vec3,
    ) -> f32 {
        if point.vertex == 1 {
            return first_weight(self.balance.at_first(view.camera_density(self, wi)), part);
        }
        let earlier = own * view.light_density(self, wi, point.normal);
        self.balance.second_weights(earlier)[class as usize] * merged_at_second(part)
    }
}
