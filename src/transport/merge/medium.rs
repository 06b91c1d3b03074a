//! Merging in media: photons within a ball around points of camera paths.

use super::super::camera_paths::{CameraPaths, MediumPoint};
use super::super::kernel::{ByClass, MediumKernel};
use super::super::pair_list::{Pair, PairList};
use super::super::photon::{Photon, PhotonClass};
use super::super::photon_map::{PhotonMap, Range, Ranges};
use super::{MAX_PAIRS, Merge, PathSums};
use crate::base::math::{LUMINANCE, Rgb};
use crate::base::spectrum::Wavelength;
use crate::scene::henyey_greenstein;
use crate::simd::{LANES, Vec3s};
use std::array::from_fn;
use std::ops;

/// A merge kernel over the photons in media.
#[derive(Clone, Copy)]
pub(super) struct MediumMerge<'a> {
    pub map: &'a PhotonMap,
    pub kernel: MediumKernel,
}

/// Light that is merged at one point.
#[derive(Default)]
struct Merged {
    /// Radiance by photon class, W/(m^2 sr).
    all: ByClass<Rgb>,
    /// The same from half of the radii, by the kernels of those.
    inner: ByClass<Rgb>,
    pairs: usize,
    /// As [`PairList::commit`] takes it.
    nested: [f32; 2],
}

impl Merge<'_> {
    /// Merges photons at the points in media of a part of the camera paths. Returns false if it stopped because several
    /// camera paths have too many pairs.
    /// theory.md (37i)
    #[inline(never)] // media are rare
    pub(super) fn merge_media<const PAIRS: bool>(
        &self,
        paths: &CameraPaths,
        part: &ops::Range<usize>,
        pairs: &mut PairList,
        sums: &mut PathSums,
    ) -> bool {
        let Some(medium) = &self.medium else { return true };
        let mut ranges = Ranges::default();
        for points in paths.medium_points.chunks(LANES) {
            let mut positions = Vec3s::default();
            points.iter().enumerate().for_each(|(lane, at)| positions.set(lane, at.position));
            let wanted = from_fn(|lane| {
                points.get(lane).is_some_and(|point| part.contains(&(point.path as usize)))
            });
            medium.map.find_ranges(&positions, &wanted, &mut ranges);
            for ranges in ranges.by_lane() {
                let point = &points[ranges[0].lane];
                let is_last = point.vertex == self.merge_vertex;
                let found = medium.merge::<PAIRS>(point, is_last, ranges, pairs);
                let path = point.path as usize;
                sums.sums[path] += found.all[0] + found.all[1];
                if self.options.records_caustics && point.vertex == 1 {
                    sums.caustics[path] += found.all[PhotonClass::Caustic as usize];
                }
                if self.options.records_annulus {
                    // theory.md (71a)
                    for (class, sum) in sums.annulus[path].iter_mut().enumerate() {
                        *sum += found.all[class] - found.inner[class];
                    }
                }
                if found.pairs > 0 {
                    pairs.commit(found.pairs, point.path, found.nested);
                }
            }
            if PAIRS && pairs.len() > MAX_PAIRS && part.len() > 1 {
                return false;
            }
        }
        true
    }
}

impl MediumMerge<'_> {
    /// Merges the photons near a point, and lists pairs if `PAIRS`. Only the last vertex of a path, `is_last`, merges
    /// photons of all classes.
    fn merge<const PAIRS: bool>(
        &self,
        point: &MediumPoint,
        is_last: bool,
        ranges: &[Range],
        pairs: &mut PairList,
    ) -> Merged {
        let MediumKernel { radius2, nested2, inverse_volume, nested } =
            &self.kernel.cut_by(&point.room);
        let mut found = Merged::default();
        self.map.for_each_in(ranges, point.position, |photon: &Photon, distance2, _| {
            let class = photon.class();
            let of = class as usize;
            let is_merged = is_last || class == PhotonClass::Caustic;
            let is_inside =
                distance2 <= radius2[of] && point.room.contains(photon.position - point.position);
            if !(is_merged && is_inside) {
                return;
            }
            let cos = photon.direction().dot(point.direction);
            let kernel = henyey_greenstein(point.asymmetry, cos) * inverse_volume[of];
            let mut light = point.weight * photon.flux * kernel;
            if let Some(own) = point.wavelength
                && let Some(other) = Wavelength::from_index(photon.wavelength_index())
            {
                // theory.md (47l)
                light *= own.merge_factor(other);
            }
            found.all[of] += light;
            let inside = [0, 1].map(|at| distance2 <= nested2[at][of]);
            if inside[1] {
                found.inner[of] += light * nested[1][of];
            }
            if PAIRS {
                let value = LUMINANCE.dot(light);
                // theory.md (68)
                let [inner, core] =
                    from_fn(|at| if inside[at] { nested[at][of] * value } else { 0.0 });
                found.nested[0] += value - inner;
                found.nested[1] += inner - core;
                pairs.space(found.pairs + 1)[found.pairs] = Pair { light_path: photon.path, value };
                found.pairs += 1;
            }
        });
        found
    }
}
