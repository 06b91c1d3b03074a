//! Weights of merges where camera paths gather.

use super::Mis;
use super::weights::first_weight;
use crate::transport::gather::{GatherPoint, GatherView};
use crate::transport::kernel::ByClass;
use crate::transport::photon::PhotonClass;
use crate::transport::photon_map::{Weighing, of_quad};
use glam::{Vec3, Vec4};

/// Those at a Lambertian vertex.
pub(crate) enum PointWeights {
    /// The first: what photons carry is multiplied with this.
    First(f32),
    /// The second: weights by class.
    Second {
        /// Of photons that are merged there.
        by_class: ByClass<f32>,
        /// Whether there may be others, straight from a light.
        any_straight: bool,
    },
}

impl PointWeights {
    /// Of a camera path's first vertex, or its last, that carries `part`.
    #[inline(always)] // part of the loop over look-ups
    pub fn new(mis: &Mis, last: bool, part: f32) -> Self {
        if !last {
            return Self::First(part);
        }
        let by_class = mis.balance.second_weights(part);
        Self::Second { by_class, any_straight: !mis.connects }
    }
}

impl Weighing for PointWeights {
    const ALL: bool = true;

    #[inline(always)] // as the next: parts of the loop over ranges
    fn by_class(&self) -> Option<ByClass<f32>> {
        match *self {
            Self::First(_) => None,
            Self::Second { by_class, .. } => Some(by_class),
        }
    }

    #[inline(always)]
    fn weights(&self, parts: &[f32], quad: usize) -> Option<Vec4> {
        match *self {
            // As `first_weight`.
            Self::First(by) => Some((Vec4::ONE + by * of_quad(parts, quad)).recip()),
            Self::Second { any_straight: false, .. } => None,
            Self::Second { .. } => {
                Some(Vec4::from(of_quad(parts, quad).to_array().map(|part| merged_at_second(part))))
            }
        }
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
