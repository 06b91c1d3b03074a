//! MIS weights of merges, from the partials of photons and gather points: theory.md (47f).

use super::Mis;
use super::weights::{GatherPartials, PhotonPartials, merge_weight, partial_index};
use crate::simd::f32x8::F32x8;
use crate::transport::gather::{GatherPoint, GatherView};
use crate::transport::kernel::ByClass;
use crate::transport::photon::PhotonClass;
use crate::transport::photon_map::{OctetPartials, PhotonWeights};
use glam::Vec3;

/// Weights of merges at a Lambertian vertex of this number, 1 or 2.
pub(crate) struct VertexWeights<const VERTEX: usize> {
    /// Terms of merges at earlier vertices for caustic and diffuse photons.
    earlier: ByClass<f32>,
    camera: f32,
    /// Caustic photons have other terms.
    separate_classes: bool,
}

/// Weights of merges at a Lambertian second vertex where camera paths are cut: one for each class.
pub(crate) struct CutWeights(ByClass<f32>);

/// A photon at a gather point where the BSDF depends on its direction.
pub(crate) struct MergedPhoton {
    pub class: PhotonClass,
    pub mis_partials: PhotonPartials,
    /// Unit vector against the direction of flight.
    pub wi: Vec3,
}

impl<const VERTEX: usize> VertexWeights<VERTEX> {
    /// The weights at a gather point of these partials, which include the density of light paths
    /// there.
    #[inline(always)] // part of the loop over queries, as the functions below
    pub fn new(mis: &Mis, point: &GatherPartials, has_caustics: bool) -> Self {
        let earlier = mis.balance.earlier_factors().map(|factor| point.earlier * factor);
        let separate_classes = has_caustics && VERTEX == 2;
        Self { earlier, camera: point.camera, separate_classes }
    }
}

impl CutWeights {
    /// The weights at a gather point of these partials.
    #[inline(always)]
    pub fn new(mis: &Mis, point: &GatherPartials) -> Self {
        Self(mis.balance.earlier_factors().map(|factor| (1.0 + point.earlier * factor).recip()))
    }

    /// The weight of diffuse photons.
    #[inline(always)]
    pub fn diffuse(&self) -> f32 {
        self.0[PhotonClass::Diffuse as usize]
    }
}

impl<const VERTEX: usize> PhotonWeights for VertexWeights<VERTEX> {
    const ALL_CLASSES: bool = true;

    #[inline(always)]
    fn by_class(&self) -> Option<ByClass<f32>> {
        None
    }

    #[inline(always)]
    fn of_octet<E: F32x8>(
        &self,
        eight: E,
        mis_partials: &[OctetPartials],
        octet: usize,
        is_caustic: E::Mask,
    ) -> Option<E::Floats> {
        let photon = eight.load(&mis_partials[octet][VERTEX - 1]);
        // Eight times `merge_weight`.
        let [caustic, diffuse] = self.earlier;
        let mut earlier = eight.splat(diffuse);
        if self.separate_classes {
            earlier = eight.select(is_caustic, eight.splat(caustic), earlier);
        }
        let weight = eight.recip(eight.splat(1.0) + earlier + eight.splat(self.camera) * photon);
        Some(if VERTEX == 2 {
            eight.keep(eight.le(eight.splat(0.0), photon), weight)
        } else {
            weight
        })
    }
}

impl PhotonWeights for CutWeights {
    const ALL_CLASSES: bool = true;

    #[inline(always)]
    fn by_class(&self) -> Option<ByClass<f32>> {
        Some(self.0)
    }

    #[inline(always)]
    fn of_octet<E: F32x8>(
        &self,
        _: E,
        _: &[OctetPartials],
        _: usize,
        _: E::Mask,
    ) -> Option<E::Floats> {
        None
    }
}

impl Mis {
    /// Weight of a merge of a photon at `point`, where the BSDF is constant, with the partials of
    /// both.
    pub(crate) fn lambertian_weight(
        &self,
        point: &GatherPoint,
        partials: &GatherPartials,
        class: PhotonClass,
        mis_partials: PhotonPartials,
    ) -> f32 {
        let factor = self.balance.earlier_factors()[class as usize];
        merge_weight(partials, factor, mis_partials[partial_index(point.vertex)])
    }

    /// Weight of a merge of `photon` at `point`. `earlier` is the sum of the camera path's partial
    /// where it arrives.
    pub(crate) fn directional_weight(
        &self,
        view: &GatherView,
        point: &GatherPoint,
        earlier: f32,
        photon: &MergedPhoton,
    ) -> f32 {
        let MergedPhoton { class, mis_partials, wi } = *photon;
        let camera = view.camera_density(wi, self.camera_survival(point.vertex));
        let earlier =
            if point.vertex == 1 { 0.0 } else { earlier * view.light_density(wi, point.normal) };
        let point_partials = self.balance.gather(point.vertex, earlier, camera);
        let factor = self.balance.earlier_factors()[class as usize];
        merge_weight(&point_partials, factor, mis_partials[partial_index(point.vertex)])
    }
}
