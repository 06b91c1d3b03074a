//! Merge phase: what light paths bring to camera paths, all together or pair by pair.

use super::camera_paths::CameraPaths;
use super::gather::{GatherPacket, GatherPoint};
use super::kernel::{Admission, ByClass, Kernel, PointKernel, PointKernels, nested};
use super::mis::Mis;
use super::mis::points::{AtFirst, AtSecond};
use super::pair_list::{Pair, PairList};
use super::photon::PhotonClass;
use super::photon_map::{Found, LookUp, LookUps, PhotonMap, Range, Ranges, Unweighted, Weighing};
use crate::base::math::{LUMINANCE, Rgb};
use crate::simd::dispatch::{Simd, vectorized};
use crate::simd::{LANES, Mask, Vec3s};
use std::array::from_fn;
use std::ops;

/// Camera paths or gather points merged together where look-ups in any order wait for memory: enough for
/// neighbors to share what they read of a large photon map.
const MERGED: usize = 65_536;

/// The same in iterations that measure: their pairs take room in the caches, too.
const MEASURED: usize = 16_384;

/// Pairs found at a time: as many camera paths as find more are merged in parts.
const MOST_PAIRS: usize = 1 << 22;

/// A merge kernel over a photon map.
#[derive(Clone, Copy)]
pub struct Merge<'a> {
    map: &'a PhotonMap,
    merge_vertex: u32,
    kernel: Kernel<'a>,
    admission: Admission,
    mis: Option<Mis>,
    in_zones: bool,
    most_pairs: usize,
    /// Whether caustics are told.
    tells: bool,
    /// Whether it is told what photons beyond half the merge radii bring.
    halves: bool,
}

/// What camera paths gathered; buffers are reused by the next.
#[derive(Debug, Default)]
pub struct Gathered {
    /// `sum_i I_ij` of each camera path, W/(m^2 sr).
    pub sums: Vec<Rgb>,
    /// All of which these are the sums, if they were asked for.
    pub pairs: PairList,
    /// The part of the sums that photons without a diffuse bounce add at first vertices, if it was asked for and
    /// can be told apart: if [`Merge::tells_caustics`].
    pub caustics: Vec<Rgb>,
    /// What the sums are more than they would be at half the merge radii, by class of photons, if that was asked for.
    pub beyond: Vec<ByClass<Rgb>>,
    look_ups: LookUps,
    ranges: Ranges,
    /// At the gather points, W.
    flux: Vec<ByClass<Vec3s>>,
    /// The same within half the merge radii; as many, or none if it is not asked for.
    half: Vec<ByClass<Vec3s>>,
    kernels: Vec<PointKernels>,
}

impl<'a> Merge<'a> {
    /// Merges with the photons of `map`, built for the kernel's reach, camera paths that are cut at their
    /// diffuse vertex number `merge_vertex`.
    pub fn new(map: &'a PhotonMap, merge_vertex: u32, kernel: Kernel<'a>) -> Self {
        let kernel = if map.has_caustic_photons() { kernel } else { kernel.of_last_vertex() };
        let admission = kernel.admission();
        let (in_zones, most_pairs) = (map.is_large(), MOST_PAIRS);
        let (mis, tells, halves) = (None, false, false);
        Self { map, merge_vertex, kernel, admission, mis, in_zones, most_pairs, tells, halves }
    }

    /// Whether it is told what photons beyond half the merge radii bring.
    pub fn halves(&self) -> bool {
        self.halves
    }

    /// The same, telling what photons beyond half the merge radii bring as well.
    #[must_use]
    pub fn with_annulus(self, halves: bool) -> Self {
        let apart = halves && self.map.has_caustic_photons();
        Self { halves, admission: Admission { apart, ..self.admission }, ..self }
    }

    /// The same, telling caustics by themselves as well.
    #[must_use]
    pub fn telling(self, tells: bool) -> Self {
        Self { tells, ..self }
    }

    /// Whether photons with and without a diffuse bounce are summed apart: their radii differ, or there are none of
    /// the latter.
    pub fn tells_caustics(&self) -> bool {
        !self.admission.is_uniform() || !self.map.has_caustic_photons()
    }

    /// The same with photons without a diffuse bounce alone: tells caustics where all have one radius.
    #[must_use]
    pub fn of_caustics(self) -> Self {
        Self { admission: self.admission.of_every_vertex(), halves: false, ..self }
    }

    /// Weighs what is merged, at both vertices of camera paths that are cut at the second.
    #[must_use]
    pub fn weighted(self, mis: Option<Mis>) -> Self {
        Self { mis, ..self }
    }

    /// How many camera paths or gather points it pays to merge together, about, with or without their pairs.
    pub fn together(&self, pairs: bool) -> usize {
        let large = if pairs { MEASURED } else { MERGED };
        if self.in_zones { large } else { CameraPaths::BATCH }
    }

    /// Sets `gathered` to what these camera paths gather.
    pub fn gather(&self, paths: &CameraPaths, gathered: &mut Gathered) {
        gathered.clear(paths, (self.tells, self.halves));
        self.find::<false>(paths, 0..paths.direct.len(), gathered);
    }

    /// Sets `gathered` to what these camera paths gather and the pairs that this consists of, and shows it
    /// to `visit` with the camera paths that are complete, in their order: all at once unless they have
    /// very many pairs.
    pub fn gather_pairs(
        &self,
        paths: &CameraPaths,
        gathered: &mut Gathered,
        mut visit: impl FnMut(&Gathered, ops::Range<usize>),
    ) {
        gathered.clear(paths, (self.tells, self.halves));
        let (mut first, end) = (0, paths.direct.len());
        let mut count = end;
        while first < end {
            let part = first..first.saturating_add(count).min(end);
            gathered.pairs.clear();
            if self.find::<true>(paths, part.clone(), gathered) {
                gathered.pairs.order_by_path(part.clone());
                visit(gathered, part.clone());
                first = part.end;
                count = count.saturating_mul(2);
            } else {
                gathered.sums[part.clone()].fill(Rgb::ZERO);
                if self.tells {
                    gathered.caustics[part.clone()].fill(Rgb::ZERO);
                }
                if self.halves {
                    gathered.beyond[part.clone()].fill([Rgb::ZERO; 2]);
                }
                count = part.len().div_ceil(2);
            }
        }
    }

    /// Adds what these camera paths gather, and their pairs if asked for. Returns whether all are found: if
    /// not, there are more pairs than are kept at a time, and several camera paths.
    fn find<const PAIRS: bool>(
        &self,
        paths: &CameraPaths,
        part: ops::Range<usize>,
        gathered: &mut Gathered,
    ) -> bool {
        vectorized(
            #[inline(always)]
            |simd| match (self.mis.is_some(), self.in_zones) {
                (false, true) => self.find_in_zones::<PAIRS, false>(simd, paths, part, gathered),
                (false, false) => self.find_in_order::<PAIRS, false>(simd, paths, part, gathered),
                (true, true) => self.find_in_zones::<PAIRS, true>(simd, paths, part, gathered),
                (true, false) => self.find_in_order::<PAIRS, true>(simd, paths, part, gathered),
            },
        )
    }

    /// Packet by packet.
    #[inline(always)] // vectorized
    fn find_in_order<const PAIRS: bool, const MIS: bool>(
        &self,
        simd: Simd,
        paths: &CameraPaths,
        part: ops::Range<usize>,
        gathered: &mut Gathered,
    ) -> bool {
        let Gathered { sums, pairs, caustics, beyond, ranges, .. } = gathered;
        for (packet, first) in paths.gather_points.packets().iter().zip((0..).step_by(LANES)) {
            let gathers = if PAIRS { packet.gathers_of(&part) } else { packet.gathers };
            self.map.find_ranges(&packet.position, &gathers, ranges);
            if ranges.is_empty() {
                continue;
            }
            let mut kernels = PointKernels::default();
            if PAIRS {
                kernels = self.kernel.at::<{ nested::BOTH }>(packet, &ranges.look_ups());
            }
            let (mut flux, mut half) = <(ByClass<Vec3s>, ByClass<Vec3s>)>::default();
            for ranges in ranges.by_look_up() {
                let lane = ranges[0].look_up;
                let point = packet.get(lane);
                let look_up = self.look_up(&point, first + lane);
                let to = (&kernels.get(lane), &mut *pairs);
                let found = self.flux_in::<PAIRS, MIS>(simd, paths, ranges, &look_up, to);
                set(&mut flux, lane, found.all);
                set(&mut half, lane, found.half);
            }
            if !PAIRS {
                kernels = self.kernels(packet, &lit(&flux));
            }
            self.add(packet, &kernels, &flux, sums);
            self.add_caustics(packet, &kernels, &flux, caustics);
            if self.halves {
                add_beyond(packet, &kernels, (&flux, &half), beyond);
            }
            if PAIRS && pairs.len() > self.most_pairs && part.len() > 1 {
                return false;
            }
        }
        true
    }

    /// First all look-ups in one part of the photon map, then in the next: they read the same photons.
    #[inline(always)] // vectorized
    fn find_in_zones<const PAIRS: bool, const MIS: bool>(
        &self,
        simd: Simd,
        paths: &CameraPaths,
        part: ops::Range<usize>,
        gathered: &mut Gathered,
    ) -> bool {
        let Gathered { sums, pairs, caustics, beyond, look_ups, ranges, flux, half, kernels } =
            gathered;
        let packets = paths.gather_points.packets();
        look_ups.sort(
            self.map,
            packets.iter().zip((0..).step_by(LANES)).flat_map(|(packet, first)| {
                let gathers = if PAIRS { packet.gathers_of(&part) } else { packet.gathers };
                let lanes = (0..LANES).filter(move |&lane| gathers[lane]);
                lanes.map(move |lane| self.look_up(&packet.get(lane), first + lane))
            }),
        );
        flux.clear();
        flux.resize(packets.len(), <ByClass<Vec3s>>::default());
        half.clear();
        half.resize(if self.halves { packets.len() } else { 0 }, <ByClass<Vec3s>>::default());
        kernels.clear();
        kernels.resize(packets.len(), PointKernels::default());
        if PAIRS {
            for (packet, kernels) in packets.iter().zip(&mut *kernels) {
                *kernels = self.kernel.at::<{ nested::BOTH }>(packet, &packet.gathers_of(&part));
            }
        }
        for look_ups in look_ups.packets() {
            let mut positions = Vec3s::default();
            for (lane, look_up) in look_ups.iter().enumerate() {
                positions.set(lane, look_up.position);
            }
            self.map.find_ranges(&positions, &from_fn(|lane| lane < look_ups.len()), ranges);
            for ranges in ranges.by_look_up() {
                let look_up = &look_ups[ranges[0].look_up];
                let point = look_up.point as usize;
                let to = (&kernels[point / LANES].get(point % LANES), &mut *pairs);
                let found = self.flux_in::<PAIRS, MIS>(simd, paths, ranges, look_up, to);
                set(&mut flux[point / LANES], point % LANES, found.all);
                if let Some(half) = half.get_mut(point / LANES) {
                    set(half, point % LANES, found.half);
                }
            }
            if PAIRS && pairs.len() > self.most_pairs && part.len() > 1 {
                return false;
            }
        }
        for (index, (packet, kernels)) in packets.iter().zip(kernels).enumerate() {
            let flux = &flux[index];
            if !PAIRS {
                *kernels = self.kernels(packet, &lit(flux));
            }
            self.add(packet, kernels, flux, sums);
            self.add_caustics(packet, kernels, flux, caustics);
            if let Some(half) = half.get(index) {
                add_beyond(packet, kernels, (flux, half), beyond);
            }
        }
        true
    }

    /// The kernels of an iteration that does not measure, where there is flux.
    #[inline(always)] // vectorized
    fn kernels(&self, packet: &GatherPacket, lit: &Mask) -> PointKernels {
        if self.halves {
            self.kernel.at::<{ nested::HALF }>(packet, lit)
        } else {
            self.kernel.at::<{ nested::NONE }>(packet, lit)
        }
    }

    /// Adds what photons of so much flux contribute to the camera paths of a packet of points.
    #[inline(always)] // vectorized
    fn add(
        &self,
        packet: &GatherPacket,
        kernels: &PointKernels,
        flux: &ByClass<Vec3s>,
        sums: &mut [Rgb],
    ) {
        let mut contribution = Vec3s::default();
        for lane in 0..LANES {
            // theory.md (45)
            let weight = packet.weight.get(lane) * kernels.get(lane).inverse_area;
            contribution.set(lane, weight * kernels.together(lane, flux));
        }
        let lit = lit(flux);
        for lane in (0..LANES).filter(|&lane| packet.gathers[lane] & lit[lane]) {
            sums[packet.path[lane] as usize] += contribution.get(lane);
        }
    }

    /// Of the same, what photons without a diffuse bounce contribute at first vertices, if that is told.
    #[inline(always)] // vectorized
    fn add_caustics(
        &self,
        packet: &GatherPacket,
        kernels: &PointKernels,
        [every, _]: &ByClass<Vec3s>,
        caustics: &mut [Rgb],
    ) {
        if !self.tells {
            return;
        }
        for lane in (0..LANES).filter(|&lane| packet.gathers[lane] & (packet.vertex[lane] == 1)) {
            if every.get(lane) == Rgb::ZERO {
                continue; // The kernel is known where there is flux.
            }
            let kernel = kernels.get(lane);
            let flux = every.get(lane) * kernel.relative()[PhotonClass::Caustic as usize];
            caustics[packet.path[lane] as usize] +=
                packet.weight.get(lane) * kernel.inverse_area * flux;
        }
    }

    /// The flux of the photons in the ranges of a look-up that it counts, W; times the BSDF where that is
    /// not the same for all photons. Adds their pairs if asked for.
    #[inline(always)] // vectorized
    fn flux_in<const PAIRS: bool, const MIS: bool>(
        &self,
        simd: Simd,
        paths: &CameraPaths,
        ranges: &[Range],
        look_up: &LookUp,
        (kernel, pairs): (&PointKernel, &mut PairList),
    ) -> Found {
        if look_up.view {
            self.flux_viewed::<PAIRS>(paths, ranges, look_up, (kernel, pairs))
        } else if let Some(mis) = self.mis.filter(|_| MIS) {
            let part = paths.gather_points.part(look_up.point as usize);
            let to = (kernel, pairs);
            if !look_up.last {
                let first = (&AtFirst(part), 1.0);
                return self.lambertian_flux::<PAIRS>(simd, paths, ranges, look_up, to, first);
            }
            let second = AtSecond::new(&mis, part);
            if self.map.has_caustic_photons() {
                let all = (&second, 1.0);
                return self.lambertian_flux::<PAIRS>(simd, paths, ranges, look_up, to, all);
            }
            let all = (&Unweighted, second.bounced());
            self.lambertian_flux::<PAIRS>(simd, paths, ranges, look_up, to, all)
        } else {
            let (to, all) = ((kernel, pairs), (&Unweighted, 1.0));
            self.lambertian_flux::<PAIRS>(simd, paths, ranges, look_up, to, all)
        }
    }

    /// [`Self::flux_in`] where the BSDF is the same for all photons, which are weighed each and all alike.
    #[inline(always)] // vectorized
    fn lambertian_flux<const PAIRS: bool>(
        &self,
        simd: Simd,
        paths: &CameraPaths,
        ranges: &[Range],
        look_up: &LookUp,
        (kernel, pairs): (&PointKernel, &mut PairList),
        (weighing, weight): (&impl Weighing, f32),
    ) -> Found {
        let Found { all, half } = if PAIRS {
            let point = paths.gather_points.at(look_up.point as usize);
            let to = (point.path, pair_weight(&point, kernel) * weight, pairs);
            let by = (&self.admission, kernel);
            match self.halves {
                true => self.map.pairs_in::<true>(simd, ranges, look_up, by, weighing, to),
                false => self.map.pairs_in::<false>(simd, ranges, look_up, by, weighing, to),
            }
        } else if self.halves {
            self.map.flux_in::<true>(ranges, look_up, &self.admission, weighing)
        } else {
            self.map.flux_in::<false>(ranges, look_up, &self.admission, weighing)
        };
        Found { all: all.map(|flux| flux * weight), half: half.map(|flux| flux * weight) }
    }

    /// [`Self::flux_in`] where the BSDF depends on where photons come from.
    #[inline(never)] // keeps the common case short
    fn flux_viewed<const PAIRS: bool>(
        &self,
        paths: &CameraPaths,
        ranges: &[Range],
        look_up: &LookUp,
        (kernel, pairs): (&PointKernel, &mut PairList),
    ) -> Found {
        let point = paths.gather_points.at(look_up.point as usize);
        let view = &paths.views[point.view as usize];
        let weight = pair_weight(&point, kernel);
        let (mut sums, mut nested, mut count) = (Found::default(), [0.0; 2], 0);
        let Admission { nested2, .. } = self.admission;
        let own = self.mis.map(|mis| (mis, paths.gather_points.part(look_up.point as usize)));
        self.map.for_each_in(ranges, point.position, |photon, distance2, part| {
            let class = photon.class();
            let counts = look_up.last || own.is_some() || class == PhotonClass::Caustic;
            let least_radius2 = self.admission.least_radius2(photon, distance2, point.position);
            if counts && self.admission.admits(photon, least_radius2, point.normal) {
                // theory.md (46)
                let wi = photon.from_as_at(point.normal);
                let mut flux = photon.flux * view.value_from(wi, &point);
                if let Some((mis, own)) = own {
                    flux *= mis.weight_in_view(view, &point, own, (photon.class(), part), wi);
                }
                sums.all[self.admission.sum_of(class)] += flux;
                if least_radius2 <= nested2[1][class as usize] {
                    sums.half[self.admission.sum_of(class)] += flux;
                }
                if PAIRS {
                    let class = class as usize;
                    let value = weight.dot(flux * kernel.relative()[class]);
                    // theory.md (68)
                    let [inner, core] = [0, 1].map(|at| {
                        let inside = least_radius2 <= nested2[at][class];
                        if inside { kernel.nested[at][class] * value } else { 0.0 }
                    });
                    nested[0] += value - inner;
                    nested[1] += inner - core;
                    pairs.space(count + 1)[count] = Pair { light_path: photon.path, value };
                    count += 1;
                }
            }
        });
        if count > 0 {
            pairs.take(count, point.path, nested);
        }
        sums
    }

    /// Where a gather point of this number looks for photons.
    #[inline(always)] // vectorized
    fn look_up(&self, point: &GatherPoint, number: usize) -> LookUp {
        let GatherPoint { position, normal, vertex, view, .. } = *point;
        let last = vertex == self.merge_vertex;
        let view = view != GatherPoint::NO_VIEW;
        LookUp { position, point: number as u32, normal, last, view, zone: 0 }
    }
}

/// What the flux of a photon is multiplied with to get the luminance that it contributes at a point.
#[inline(always)] // vectorized
fn pair_weight(point: &GatherPoint, kernel: &PointKernel) -> Rgb {
    LUMINANCE * point.weight * kernel.inverse_area
}

/// Adds what photons beyond half the merge radii contribute to the camera paths of a packet of points: that of all,
/// less what the photons within contribute at half the radii. theory.md (71a).
#[inline(always)] // vectorized
fn add_beyond(
    packet: &GatherPacket,
    kernels: &PointKernels,
    (flux, half): (&ByClass<Vec3s>, &ByClass<Vec3s>),
    beyond: &mut [ByClass<Rgb>],
) {
    let lit = lit(flux);
    for lane in (0..LANES).filter(|&lane| packet.gathers[lane] & lit[lane]) {
        let weight = packet.weight.get(lane) * kernels.get(lane).inverse_area;
        let to = &mut beyond[packet.path[lane] as usize];
        for (class, to) in to.iter_mut().enumerate() {
            let [all, half] = [flux, half].map(|flux| flux[class].get(lane));
            if all != Rgb::ZERO {
                *to += weight * kernels.beyond(lane, class, all, half);
            }
        }
    }
}

/// Sets the flux of one lane.
#[inline(always)] // vectorized
fn set(flux: &mut ByClass<Vec3s>, lane: usize, found: ByClass<Rgb>) {
    for (flux, found) in flux.iter_mut().zip(found) {
        flux.set(lane, found);
    }
}

/// Where there is flux: only there the kernel matters.
#[inline(always)] // vectorized
fn lit(flux: &ByClass<Vec3s>) -> Mask {
    from_fn(|lane| flux.iter().any(|flux| flux.get(lane) != Rgb::ZERO))
}

impl Gathered {
    fn clear(&mut self, paths: &CameraPaths, (tells, halves): (bool, bool)) {
        self.sums.clear();
        self.sums.resize(paths.direct.len(), Rgb::ZERO);
        self.caustics.clear();
        if tells {
            self.caustics.resize(paths.direct.len(), Rgb::ZERO);
        }
        self.beyond.clear();
        if halves {
            self.beyond.resize(paths.direct.len(), [Rgb::ZERO; 2]);
        }
    }
}

#[cfg(test)]
mod tests;
