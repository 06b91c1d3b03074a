//! Merging in media: photons within a ball around points of camera paths, or along their segments.

use super::super::camera_paths::{CameraPaths, MediumBeam, MediumPoint};
use super::super::kernel::{ByClass, PathWavelengths, WavelengthFactors};
use super::super::medium_kernel::{CutKernel, MediumKernel};
use super::super::medium_photons::MediumPhotons;
use super::super::near_planes::{NearPlanes, Surroundings};
use super::super::pair_list::{Pair, PairList};
use super::super::photon::{Photon, PhotonClass};
use super::super::photon_map::{Range, Ranges};
use super::super::photon_tree::Segment;
use super::{Merge, PathSums};
use crate::base::math::{LUMINANCE, Rgb};
use crate::scene::henyey_greenstein;
use crate::simd::dispatch::vectorized;
use crate::simd::{LANES, Vec3s};
use std::array::from_fn;
use std::ops;

/// A merge kernel over the photons in media.
#[derive(Clone, Copy)]
pub(super) struct MediumMerge<'a> {
    pub photons: &'a MediumPhotons,
    pub kernel: MediumKernel,
    pub surroundings: Surroundings<'a>,
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
    /// Merges photons at the points and along the segments in media of a part of the camera paths.
    /// Returns false if it stopped because several camera paths have too many pairs.
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
        let are_too_many =
            |pairs: &PairList| PAIRS && pairs.len() > self.max_pairs && part.len() > 1;
        for points in paths.medium_points.chunks(LANES) {
            let mut positions = Vec3s::default();
            points.iter().enumerate().for_each(|(lane, at)| positions.set(lane, at.position));
            let wanted = from_fn(|lane| {
                points.get(lane).is_some_and(|point| part.contains(&(point.path as usize)))
            });
            medium.photons.map().find_ranges(&positions, &wanted, &mut ranges);
            for ranges in ranges.by_lane() {
                let point = &points[ranges[0].lane];
                let is_last = self.merges_all_in_media(point.vertex);
                let found = medium.merge::<PAIRS>(point, is_last, ranges, pairs);
                self.add_in_media(&found, point.path, point.vertex, pairs, sums);
            }
            if are_too_many(pairs) {
                return false;
            }
        }
        for beam in paths.beams.iter().filter(|beam| part.contains(&(beam.path as usize))) {
            let is_last = self.merges_all_in_media(beam.vertex);
            let found = medium.merge_along::<PAIRS>(beam, is_last, pairs);
            self.add_in_media(&found, beam.path, beam.vertex, pairs, sums);
            if are_too_many(pairs) {
                return false;
            }
        }
        true
    }

    /// Photons of all classes merge in media at the vertex of this number. With weights, paths end
    /// where a medium scatters them: theory.md (47p).
    fn merges_all_in_media(&self, vertex: u32) -> bool {
        vertex == self.merge_vertex || self.options.mis.is_some()
    }

    /// Adds what was merged at a vertex of this number, or on the way to it.
    fn add_in_media(
        &self,
        found: &Merged,
        path: u32,
        vertex: u32,
        pairs: &mut PairList,
        sums: &mut PathSums,
    ) {
        let index = path as usize;
        sums.sums[index] += found.all[0] + found.all[1];
        if self.options.records_caustics && vertex == 1 {
            sums.caustics[index] += found.all[PhotonClass::Caustic as usize];
        }
        if self.options.records_annulus {
            // theory.md (71a)
            for (class, sum) in sums.annulus[index].iter_mut().enumerate() {
                *sum += found.all[class] - found.inner[class];
            }
        }
        if found.pairs > 0 {
            pairs.commit(found.pairs, path, found.nested);
        }
    }
}

impl Merged {
    /// Adds the light of a photon. `nested` are the kernels at the nested radii over the kernel at
    /// the radius, in the order of theory.md (68), and 0 where the photon is outside.
    fn add<const PAIRS: bool>(
        &mut self,
        photon: &Photon,
        light: Rgb,
        nested: [f32; 2],
        pairs: &mut PairList,
    ) {
        let of = photon.class() as usize;
        self.all[of] += light;
        self.inner[of] += light * nested[1];
        if PAIRS {
            let value = LUMINANCE.dot(light);
            // theory.md (68)
            let [inner, core] = nested.map(|nested| nested * value);
            self.nested[0] += value - inner;
            self.nested[1] += inner - core;
            pairs.space(self.pairs + 1)[self.pairs] = Pair { light_path: photon.path, value };
            self.pairs += 1;
        }
    }
}

/// Factors of a photon by its wavelength and the kernel of a camera path, if that has one; `None`
/// if they do not merge.
fn factors(own: Option<&PathWavelengths>, photon: &Photon) -> Option<WavelengthFactors> {
    // theory.md (47l)
    own.map_or(Some(WavelengthFactors::ALL), |own| own.factors(photon))
}

impl MediumMerge<'_> {
    /// Merges the photons near a point, and lists pairs if `PAIRS`. Only the last vertex of a path,
    /// `is_last`, merges photons of all classes. theory.md (37i)
    fn merge<const PAIRS: bool>(
        &self,
        point: &MediumPoint,
        is_last: bool,
        ranges: &[Range],
        pairs: &mut PairList,
    ) -> Merged {
        let MediumKernel { radius2, wavelengths, .. } = &self.kernel;
        let planes = self.surroundings.planes(point.position, self.kernel.reach());
        let kernels = self.kernel.cut_by(&planes);
        let wavelengths = point.wavelength.map(|own| wavelengths.around(own));
        let mut found = Merged::default();
        self.photons.map().for_each_in(ranges, point.position, |photon, distance2, _| {
            let of = photon.class() as usize;
            let is_merged = is_last || photon.class() == PhotonClass::Caustic;
            let is_inside =
                distance2 <= radius2[of] && planes.contains(photon.position - point.position);
            if !(is_merged && is_inside) {
                return;
            }
            let Some(by_wavelength) = factors(wavelengths.as_ref(), photon) else { return };
            let cos = photon.direction().dot(point.direction);
            let light = henyey_greenstein(point.asymmetry, cos) * point.weight;
            self.add::<PAIRS>(
                photon,
                light,
                distance2,
                (&kernels[of], by_wavelength),
                &mut found,
                pairs,
            );
        });
        found
    }

    /// Merges the photons along a segment, and lists pairs if `PAIRS`: the beam radiance estimate
    /// of Jarosz, Zwicker and Jensen 2008. Each photon counts at the foot of its perpendicular.
    /// theory.md (37m)
    fn merge_along<const PAIRS: bool>(
        &self,
        beam: &MediumBeam,
        is_last: bool,
        pairs: &mut PairList,
    ) -> Merged {
        let (tree, mut found) = (self.photons.tree(), Merged::default());
        let radius = self.kernel.radius();
        let wavelengths = beam.wavelength.map(|own| self.kernel.wavelengths.around(own));
        vectorized(
            #[inline(always)]
            |_| {
                tree.for_each_near(&beam.segment, radius, |index, along| {
                    let photon = &tree.photons()[index];
                    if is_last || photon.class() == PhotonClass::Caustic {
                        let planes = self.photons.planes(index);
                        let around = (planes, wavelengths.as_ref());
                        self.merge_at_foot::<PAIRS>(beam, photon, along, around, &mut found, pairs);
                    }
                });
            },
        );
        found
    }

    /// Merges a photon at the foot of its perpendicular on a segment, which is at this distance.
    #[inline(always)] // part of the loop over photons
    fn merge_at_foot<const PAIRS: bool>(
        &self,
        beam: &MediumBeam,
        photon: &Photon,
        along: f32,
        (planes, wavelengths): (Option<&NearPlanes>, Option<&PathWavelengths>),
        found: &mut Merged,
        pairs: &mut PairList,
    ) {
        let of = photon.class() as usize;
        let Segment { origin, direction, .. } = beam.segment;
        let offset = origin + along * direction - photon.position;
        let distance2 = offset.length_squared();
        if distance2 > self.kernel.radius2[of] {
            return;
        }
        let kernel = match planes {
            None => self.kernel.whole(of),
            Some(planes) if !planes.contains(offset) => return,
            Some(planes) => self.kernel.cut_across(of, planes, offset, direction),
        };
        let Some(by_wavelength) = factors(wavelengths, photon) else { return };
        let cos = photon.direction().dot(direction);
        let transmittance = (-beam.extinction * along).exp();
        let light = henyey_greenstein(beam.asymmetry, cos) * beam.weight * transmittance;
        self.add::<PAIRS>(photon, light, distance2, (&kernel, by_wavelength), found, pairs);
    }

    /// Adds a photon at this squared distance whose flux has the factor `light` besides the
    /// kernels.
    #[inline(always)] // part of the loops over photons
    fn add<const PAIRS: bool>(
        &self,
        photon: &Photon,
        light: Rgb,
        distance2: f32,
        (kernel, by_wavelength): (&CutKernel, WavelengthFactors),
        found: &mut Merged,
        pairs: &mut PairList,
    ) {
        let of = photon.class() as usize;
        let light = light * photon.flux * by_wavelength.flux * kernel.inverse_size;
        let nested = from_fn(|at| {
            let is_inside = distance2 <= self.kernel.nested2[at][of];
            if is_inside { kernel.nested[at] * by_wavelength.nested[at] } else { 0.0 }
        });
        found.add::<PAIRS>(photon, light, nested, pairs);
    }
}
