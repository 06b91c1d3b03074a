//! MIS weights of merges, from the partials of photons and gather points: theory.md (47f).

use super::Mis;
use super::weights::first_weight;
use crate::transport::gather::{GatherPoint, GatherView};
use crate::transport::kernel::ByClass;
use crate::transport::photon::PhotonClass;
use crate::transport::photon_map::{PhotonWeights, quad_partials};
use glam::{Vec3, Vec4};

/// Weights of merges at a Lambertian first vertex, which has this partial.
pub(crate) struct FirstVertexWeights(pub f32);

/// Weights of merges at a Lambertian second vertex.
pub(crate) struct SecondVertexWeights {
    by_class: ByClass<f32>,
    /// There may be photons straight from a light, which are not merged at second vertices.
    has_straight: bool,
}

/// A photon at a gather point where the BSDF depends on its direction.
pub(crate) struct MergedPhoton {
    pub class: PhotonClass,
    pub mis_partial: f32,
    /// Unit vector against the direction of flight.
    pub wi: Vec3,
}

impl SecondVertexWeights {
    /// The weights at a gather point of this partial, which includes the density of light paths there.
    #[inline(always)] // part of the loop over queries, as the functions below
    pub fn new(mis: &Mis, partial: f32) -> Self {
        Self { by_class: mis.balance.second_weights(partial), has_straight: !mis.connects }
    }

    /// The weight of diffuse photons.
    #[inline(always)]
    pub fn diffuse(&self) -> f32 {
        self.by_class[PhotonClass::Diffuse as usize]
    }
}

impl PhotonWeights for FirstVertexWeights {
    const ALL_CLASSES: bool = true;

    #[inline(always)]
    fn by_class(&self) -> Option<ByClass<f32>> {
        None
    }

    #[inline(always)]
    fn of_quad(&self, mis_partials: &[f32], quad: usize) -> Option<Vec4> {
        // Four times `first_weight`.
        Some((Vec4::ONE + self.0 * quad_partials(mis_partials, quad)).recip())
    }
}

impl PhotonWeights for SecondVertexWeights {
    const ALL_CLASSES: bool = true;

    #[inline(always)]
    fn by_class(&self) -> Option<ByClass<f32>> {
        Some(self.by_class)
    }

    #[inline(always)]
    fn of_quad(&self, mis_partials: &[f32], quad: usize) -> Option<Vec4> {
        self.has_straight.then(|| {
            let partials = quad_partials(mis_partials, quad).to_array();
            Vec4::from(partials.map(merges_at_second))
        })
    }
}

/// 0 for the partial of a photon straight from a light, which has a sign: it is not merged at second vertices.
/// Else 1.
#[inline(always)]
fn merges_at_second(mis_partial: f32) -> f32 {
    if mis_partial.is_sign_negative() { 0.0 } else { 1.0 }
}

impl Mis {
    /// Weight of a merge of `photon` at `point`, which has the partial `point_partial`.
    pub(crate) fn directional_weight(
        &self,
        view: &GatherView,
        point: &GatherPoint,
        point_partial: f32,
        photon: &MergedPhoton,
    ) -> f32 {
        let MergedPhoton { class, mis_partial, wi } = *photon;
        if point.vertex == 1 {
            return first_weight(self.balance.at_first(view.camera_density(wi)), mis_partial);
        }
        let partial = point_partial * view.light_density(wi, point.normal);
        self.balance.second_weights(partial)[class as usize] * merges_at_second(mis_partial)
    }
}
