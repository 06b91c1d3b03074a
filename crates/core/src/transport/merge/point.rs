//! What one query finds: the photons near a gather point, with MIS weights and pairs.

use super::super::camera_paths::CameraPaths;
use super::super::gather::GatherPoint;
use super::super::kernel::{Admission, WavelengthFactors};
use super::super::mis::merge_weights::{CutWeights, MergedPhoton, VertexWeights};
use super::super::pair_list::{Pair, PairList};
use super::super::photon::PhotonClass;
use super::super::photon_map::{
    MergedFlux, NoPairs, PairSink, PhotonWeights, PointPairs, PointSearch, Unweighted,
};
use super::{Batch, Merge};
use crate::base::math::{LUMINANCE, Rgb};
use crate::simd::f32x8::F32x8;

impl Merge<'_> {
    /// Merges the photons that one query finds. Where the BSDF is not constant, flux and weights
    /// include its value.
    #[inline(always)] // vectorized
    pub(super) fn merge_point<E: F32x8, const PAIRS: bool>(
        &self,
        batch: &Batch<E>,
        search: &PointSearch,
        pairs: &mut PairList,
    ) -> MergedFlux {
        let query = search.query;
        if query.kind.is_one_by_one() {
            return self.merge_one_by_one::<PAIRS>(batch.paths, search, pairs);
        }
        let Some(mis) = self.options.mis else {
            return self.merge_lambertian::<E, PAIRS>(batch, search, &Unweighted, 1.0, pairs);
        };
        let point = batch.paths.gather_points.mis_partials(query.point as usize);
        let has_caustics = self.map.has_caustic_photons();
        if !query.kind.all_classes() {
            let weights = &VertexWeights::<1>::new(&mis, point, has_caustics);
            return self.merge_lambertian::<E, PAIRS>(batch, search, weights, 1.0, pairs);
        }
        // Partials of photons tell which of them a medium scattered.
        if mis.continues() || !mis.connects || self.medium.is_some() {
            let weights = &VertexWeights::<2>::new(&mis, point, has_caustics);
            return self.merge_lambertian::<E, PAIRS>(batch, search, weights, 1.0, pairs);
        }
        let weights = &CutWeights::new(&mis, point);
        if has_caustics {
            return self.merge_lambertian::<E, PAIRS>(batch, search, weights, 1.0, pairs);
        }
        // One weight for all photons.
        self.merge_lambertian::<E, PAIRS>(batch, search, &Unweighted, weights.diffuse(), pairs)
    }

    /// Merges photons where the BSDF is constant. MIS weights are `weights` times `weight`.
    #[inline(always)] // vectorized
    fn merge_lambertian<E: F32x8, const PAIRS: bool>(
        &self,
        batch: &Batch<E>,
        search: &PointSearch,
        weights: &impl PhotonWeights,
        weight: f32,
        pairs: &mut PairList,
    ) -> MergedFlux {
        let MergedFlux { all, inner } = if PAIRS {
            let point = batch.paths.gather_points.at(search.query.point as usize);
            let to_luminance = to_luminance(&point, search) * weight;
            let mut sink = PointPairs::new(batch.eight, to_luminance, pairs.space(search.places()));
            let flux = self.merge_photons(batch.eight, search, weights, &mut sink);
            let (count, nested) = sink.finish();
            if count > 0 {
                pairs.commit(count, point.path, nested);
            }
            flux
        } else {
            self.merge_photons(batch.eight, search, weights, &mut NoPairs)
        };
        MergedFlux { all: all.map(|flux| flux * weight), inner: inner.map(|flux| flux * weight) }
    }

    #[inline(always)] // vectorized
    fn merge_photons<E: F32x8>(
        &self,
        eight: E,
        search: &PointSearch,
        weights: &impl PhotonWeights,
        pairs: &mut impl PairSink<E>,
    ) -> MergedFlux {
        if self.options.records_annulus {
            self.map.merge::<E, true>(eight, search, &self.admission, weights, pairs)
        } else {
            self.map.merge::<E, false>(eight, search, &self.admission, weights, pairs)
        }
    }

    /// Merges photons where the BSDF depends on their directions, or the camera path has a
    /// wavelength.
    #[inline(never)] // keeps the common case short
    fn merge_one_by_one<const PAIRS: bool>(
        &self,
        paths: &CameraPaths,
        search: &PointSearch,
        pairs: &mut PairList,
    ) -> MergedFlux {
        let number = search.query.point as usize;
        let point = paths.gather_points.at(number);
        let view = paths.views.get(point.view as usize);
        let (kernel, to_luminance) = (&search.kernel, to_luminance(&point, search));
        let (mut sums, mut nested, mut count) = (MergedFlux::default(), [0.0; 2], 0);
        let Admission { nested2, .. } = self.admission;
        let mis = self.options.mis.map(|mis| (mis, paths.gather_points.mis_partials(number)));
        let wavelengths = point.wavelength.map(|own| self.kernel.wavelengths.around(own));
        self.map.for_each_in(search.ranges, point.position, |photon, distance2, mis_partials| {
            let class = photon.class();
            let counts =
                search.query.kind.all_classes() || mis.is_some() || class == PhotonClass::Caustic;
            let min_radius2 = self.admission.min_radius2(photon, distance2, point.position);
            if counts && self.admission.admits(photon, min_radius2, search.query) {
                // theory.md (47l)
                let factors = match &wavelengths {
                    Some(near) => near.factors(photon),
                    None => Some(WavelengthFactors::ALL),
                };
                let Some(by_wavelength) = factors else { return };
                let mut flux = photon.flux * by_wavelength.flux;
                if let Some(view) = view {
                    // theory.md (46)
                    let wi = photon.from_as_at(point.normal);
                    flux *= view.value_from(wi, &point);
                    if let Some((mis, partials)) = mis {
                        let photon = MergedPhoton { class, mis_partials, wi };
                        flux *= mis.directional_weight(view, &point, partials.earlier, &photon);
                    }
                } else if let Some((mis, partials)) = mis {
                    flux *= mis.lambertian_weight(&point, partials, class, mis_partials);
                }
                sums.all[self.admission.sum_of(class)] += flux;
                if min_radius2 <= nested2[1][class as usize] {
                    sums.inner[self.admission.sum_of(class)] += flux * by_wavelength.nested[1];
                }
                if PAIRS {
                    let class = class as usize;
                    let value = to_luminance.dot(flux * kernel.relative()[class]);
                    // theory.md (68)
                    let [inner, core] = [0, 1].map(|at| {
                        let inside = min_radius2 <= nested2[at][class];
                        let nested = kernel.nested[at][class] * by_wavelength.nested[at];
                        if inside { nested * value } else { 0.0 }
                    });
                    nested[0] += value - inner;
                    nested[1] += inner - core;
                    pairs.space(count + 1)[count] = Pair { light_path: photon.path, value };
                    count += 1;
                }
            }
        });
        if count > 0 {
            pairs.commit(count, point.path, nested);
        }
        sums
    }
}

/// Factors from the flux of diffuse photons to the luminance that they contribute at a point.
#[inline(always)] // vectorized
fn to_luminance(point: &GatherPoint, search: &PointSearch) -> Rgb {
    LUMINANCE * point.weight * search.kernel.inverse_area
}
