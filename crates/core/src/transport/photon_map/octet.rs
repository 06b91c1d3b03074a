//! Eight photons side by side, and the tests and sums of a merge query over them.

use super::mis_weights::PhotonWeights;
use super::queries::MergeQuery;
use crate::base::math::Rgb;
use crate::simd::f32x8::{EIGHT, F32x8};
use crate::transport::kernel::{Admission, ByClass, PointKernel};
use crate::transport::pair_list::Pair;
use crate::transport::photon::{Arrival, Photon, PhotonClass, PhotonSide};
use glam::Vec3;
use std::ops::{Add, Mul};

/// Photons of an octet.
pub const OCTET: usize = EIGHT;

/// Eight photons without their directions, 36 bytes each.
#[derive(Clone, Copy, Debug, Default)]
#[repr(C, align(32))]
pub struct Octet {
    position: [[f32; OCTET]; 3],
    /// First and second coordinate of the normal, 127 units long: the upper halves of `f32`, which
    /// hold whole numbers up to 256.
    normal: [u32; OCTET],
    /// Third coordinate in the upper half, and the highest byte of [`Arrival`].
    side: [u32; OCTET],
    flux: [[f32; OCTET]; 3],
    path: [u32; OCTET],
}

/// A merge query with its kernel and weights, in all lanes.
#[derive(Clone, Copy)]
pub struct OctetQuery<E: F32x8> {
    eight: E,
    position: [E::Floats; 3],
    radius2: ByClass<E::Floats>,
    nested2: [ByClass<E::Floats>; 2],
    normal: [E::Floats; 3],
    limit: E::Floats,
    flattening: E::Floats,
    /// Planes of photons do not matter.
    is_disc: bool,
    all_classes: bool,
    /// Photons on this side do not count.
    excluded: PhotonSide,
    /// If set, only photons on this side count.
    only: Option<PhotonSide>,
    /// Kernels over the kernel of diffuse photons, times the weight of the class.
    relative: ByClass<E::Floats>,
    /// Kernels at the nested radii over the kernels at the merge radii.
    nested: [ByClass<E::Floats>; 2],
    /// Weights of the classes.
    by_class: ByClass<f32>,
    /// Radius, kernel and weight do not depend on the class.
    is_uniform: bool,
}

/// Photons of an octet, as a query sees them.
#[derive(Clone, Copy)]
pub struct Admitted<E: F32x8> {
    /// The photons that count.
    pub count: E::Mask,
    /// Squares of the smallest radii within which they may count: [`Admission::min_radius2`].
    min_radius2: E::Floats,
}

/// Sum of flux by photon class, lane by lane: the order of additions is the order of the photons. A
/// uniform query adds all flux to the diffuse class.
#[derive(Clone, Copy)]
pub struct FluxSum<E: F32x8>(ByClass<[E::Floats; 3]>);

impl<E: F32x8> OctetQuery<E> {
    /// Prepares a query for the loop over octets.
    #[inline(always)] // part of the loop over photons, as the functions below
    pub fn new<W: PhotonWeights>(
        eight: E,
        query: &MergeQuery,
        admission: &Admission,
        kernel: &PointKernel,
        weights: &W,
    ) -> Self {
        let (mut relative, by_class) = (kernel.relative(), weights.by_class());
        if let Some(weights) = by_class {
            relative.iter_mut().zip(weights).for_each(|(relative, weight)| *relative *= weight);
        }
        let [inner2, half2] = admission.nested2;
        let [inner, half] = kernel.nested;
        Self {
            eight,
            position: splat_vector(eight, query.position),
            radius2: splat_classes(eight, admission.radius2),
            nested2: [splat_classes(eight, inner2), splat_classes(eight, half2)],
            normal: splat_vector(eight, query.normal),
            limit: eight.splat(admission.limit),
            flattening: eight.splat(admission.flattening),
            is_disc: admission.flattening == 0.0,
            all_classes: W::ALL_CLASSES | query.kind.all_classes(),
            excluded: query.excluded,
            only: query.only_side(),
            relative: splat_classes(eight, relative),
            nested: [splat_classes(eight, inner), splat_classes(eight, half)],
            by_class: by_class.unwrap_or([1.0; 2]),
            is_uniform: admission.is_uniform() & by_class.is_none(),
        }
    }
}

impl<E: F32x8> FluxSum<E> {
    /// No flux.
    #[inline(always)]
    pub fn new(eight: E) -> Self {
        Self([[eight.splat(0.0); 3]; 2])
    }

    /// The sum over all lanes, times the weights of the classes.
    #[inline(always)]
    pub fn total(&self, query: &OctetQuery<E>) -> ByClass<Rgb> {
        let [caustic, diffuse] = &self.0;
        let diffuse = sum_vector(query.eight, diffuse);
        if query.is_uniform {
            return [Rgb::ZERO, diffuse];
        }
        let [caustic_weight, diffuse_weight] = query.by_class;
        [sum_vector(query.eight, caustic) * caustic_weight, diffuse * diffuse_weight]
    }
}

/// Receives the photons that a query merges.
pub(crate) trait PairSink<E: F32x8> {
    /// Takes the photons of an octet that count, with the weights of single photons.
    fn add(
        &mut self,
        octet: &Octet,
        query: &OctetQuery<E>,
        admitted: &Admitted<E>,
        weights: Option<E::Floats>,
    );
}

/// Drops the pairs where sums suffice.
pub(crate) struct NoPairs;

impl<E: F32x8> PairSink<E> for NoPairs {
    #[inline(always)]
    fn add(&mut self, _: &Octet, _: &OctetQuery<E>, _: &Admitted<E>, _: Option<E::Floats>) {}
}

/// Writes the pairs of one gather point to a slice.
pub(crate) struct PointPairs<'a, E: F32x8> {
    eight: E,
    /// Factors from flux to luminance at the point, for diffuse photons.
    weight: [E::Floats; 3],
    space: &'a mut [Pair],
    count: usize,
    nested: [E::Floats; 2],
}

impl<'a, E: F32x8> PointPairs<'a, E> {
    /// Prepares to write to `space`, which has a place for every photon of the octets that are
    /// searched.
    #[inline(always)]
    pub fn new(eight: E, weight: Rgb, space: &'a mut [Pair]) -> Self {
        let weight = splat_vector(eight, weight);
        Self { eight, weight, space, count: 0, nested: [eight.splat(0.0); 2] }
    }

    /// Number of the pairs, and the sums of their differences between nested radii: theory.md (68).
    #[inline(always)]
    pub fn finish(self) -> (usize, [f32; 2]) {
        let [outer, inner] = self.nested;
        (self.count, [self.eight.sum(outer), self.eight.sum(inner)])
    }
}

impl<E: F32x8> PairSink<E> for PointPairs<'_, E> {
    #[inline(always)]
    fn add(
        &mut self,
        octet: &Octet,
        query: &OctetQuery<E>,
        admitted: &Admitted<E>,
        weights: Option<E::Floats>,
    ) {
        let eight = self.eight;
        let values = octet.values(query, &self.weight);
        let values = if let Some(weights) = weights { values * weights } else { values };
        let nested = octet.nested(query, admitted, values);
        for (sum, nested) in self.nested.iter_mut().zip(nested) {
            *sum = *sum + eight.keep(admitted.count, nested);
        }
        // Writes all eight and keeps those that count: a branch for each could not be predicted.
        let count = eight.bits(admitted.count);
        let pairs = eight.compact(count, &octet.path, values);
        self.space[self.count..self.count + OCTET].copy_from_slice(bytemuck::cast_slice(&pairs));
        self.count += count.count_ones() as usize;
    }
}

impl Octet {
    /// Replaces one photon.
    #[inline]
    pub fn set(&mut self, lane: usize, photon: &Photon) {
        let Self { position, normal, side, flux, path } = self;
        for (lanes, coordinate) in position.iter_mut().zip(photon.position.to_array()) {
            lanes[lane] = coordinate;
        }
        let [x, y, z] = photon.arrival.normal().to_array().map(f32::to_bits);
        normal[lane] = x | y >> 16;
        side[lane] = z | photon.arrival.0 >> 24;
        for (lanes, channel) in flux.iter_mut().zip(photon.flux.to_array()) {
            lanes[lane] = channel;
        }
        path[lane] = photon.path;
    }

    /// One photon, without its direction.
    #[inline]
    pub fn get(&self, lane: usize) -> Photon {
        Photon {
            position: Vec3::from_array(self.position.map(|lanes| lanes[lane])),
            path: self.path[lane],
            flux: Rgb::from_array(self.flux.map(|lanes| lanes[lane])),
            arrival: self.arrival(lane),
            from: 0,
        }
    }

    /// Normal, class and side of one photon.
    #[inline]
    fn arrival(&self, lane: usize) -> Arrival {
        let (xy, z) = (self.normal[lane], self.side[lane]);
        let byte = |half: u32| u32::from(f32::from_bits(half << 16) as i8 as u8);
        Arrival(byte(xy >> 16) | byte(xy) << 8 | byte(z >> 16) << 16 | z << 24)
    }

    /// Bits of the lanes within a radius of a point.
    #[inline(always)]
    pub fn within<E: F32x8>(&self, eight: E, point: Vec3, radius2: f32) -> u32 {
        let from = self.from(eight, &splat_vector(eight, point));
        eight.bits(eight.le(dot(&from, &from), eight.splat(radius2)))
    }

    /// Finds the photons that count.
    #[inline(always)]
    pub fn admitted<E: F32x8>(&self, query: &OctetQuery<E>) -> Admitted<E> {
        let eight = query.eight;
        let from = self.from(eight, &query.position);
        let distance2 = dot(&from, &from);
        let (first, second) = (eight.upper_halves(&self.normal), eight.lower_halves(&self.normal));
        let normal = [first, second, eight.upper_halves(&self.side)];
        let faces = eight.lt(query.limit, dot(&normal, &query.normal));
        let min_radius2 = if query.is_disc {
            distance2
        } else {
            let offset = dot(&normal, &from);
            eight.max(distance2, query.flattening * offset * offset)
        };
        let near = eight.le(min_radius2, self.by_class(query, &query.radius2));
        let mut count = near & faces;
        if query.excluded != PhotonSide::NONE {
            let (selected, side) = Arrival::side_bits(query.excluded);
            let excluded = eight.bits_equal(&self.side, selected, side);
            count = eight.and_not(count, excluded);
        }
        if let Some(only) = query.only {
            let (selected, side) = Arrival::side_bits(only);
            let others = eight.and_not(count, eight.bits_equal(&self.side, selected, side));
            count = eight.and_not(count, others);
        }
        if !query.all_classes {
            count = count & self.is_caustic(eight);
        }
        Admitted { count, min_radius2 }
    }

    /// In each lane the value of the photon's class.
    #[inline(always)]
    fn by_class<E: F32x8>(
        &self,
        query: &OctetQuery<E>,
        [caustic, diffuse]: &ByClass<E::Floats>,
    ) -> E::Floats {
        if query.is_uniform {
            return *diffuse;
        }
        query.eight.select(self.is_caustic(query.eight), *caustic, *diffuse)
    }

    /// Selects the lanes of caustic photons.
    #[inline(always)]
    pub fn is_caustic<E: F32x8>(&self, eight: E) -> E::Mask {
        let (selected, class) = Arrival::class_bits(PhotonClass::Caustic);
        eight.bits_equal(&self.side, selected, class)
    }

    /// Adds the flux of some lanes, times the weights of single photons.
    #[inline(always)]
    pub fn add_to<E: F32x8>(
        &self,
        sum: &mut FluxSum<E>,
        query: &OctetQuery<E>,
        lanes: E::Mask,
        weights: Option<E::Floats>,
    ) {
        let eight = query.eight;
        let [caustic, diffuse] = &mut sum.0;
        if query.is_uniform {
            self.add_lanes(eight, diffuse, lanes, weights);
        } else {
            let is_caustic = self.is_caustic(eight);
            self.add_lanes(eight, caustic, lanes & is_caustic, weights);
            self.add_lanes(eight, diffuse, eight.and_not(lanes, is_caustic), weights);
        }
    }

    #[inline(always)]
    fn add_lanes<E: F32x8>(
        &self,
        eight: E,
        sum: &mut [E::Floats; 3],
        lanes: E::Mask,
        weights: Option<E::Floats>,
    ) {
        for (sum, flux) in sum.iter_mut().zip(&self.flux) {
            let flux = eight.load(flux);
            let flux = if let Some(weights) = weights { flux * weights } else { flux };
            *sum = *sum + eight.keep(lanes, flux);
        }
    }

    /// Selects the lanes that count within half the merge radius.
    #[inline(always)]
    pub fn within_half<E: F32x8>(&self, query: &OctetQuery<E>, admitted: &Admitted<E>) -> E::Mask {
        let half2 = self.by_class(query, &query.nested2[1]);
        admitted.count & query.eight.le(admitted.min_radius2, half2)
    }

    /// Values at the merge radius less those at `1/sqrt(2)` of it, and the latter less those at
    /// half of it: theory.md (68).
    #[inline(always)]
    fn nested<E: F32x8>(
        &self,
        query: &OctetQuery<E>,
        admitted: &Admitted<E>,
        values: E::Floats,
    ) -> [E::Floats; 2] {
        let [inner, core] = [
            self.nested_at(query, admitted, values, 0),
            self.nested_at(query, admitted, values, 1),
        ];
        [values - inner, inner - core]
    }

    /// Values at a nested radius.
    #[inline(always)]
    fn nested_at<E: F32x8>(
        &self,
        query: &OctetQuery<E>,
        admitted: &Admitted<E>,
        values: E::Floats,
        at: usize,
    ) -> E::Floats {
        let radius2 = self.by_class(query, &query.nested2[at]);
        let inside = query.eight.le(admitted.min_radius2, radius2);
        query.eight.keep(inside, self.by_class(query, &query.nested[at]) * values)
    }

    /// Luminances at the gather point.
    #[inline(always)]
    fn values<E: F32x8>(&self, query: &OctetQuery<E>, weight: &[E::Floats; 3]) -> E::Floats {
        let value = dot(&load_vectors(query.eight, &self.flux), weight);
        if query.is_uniform { value } else { value * self.by_class(query, &query.relative) }
    }

    /// Vectors from a point.
    #[inline(always)]
    fn from<E: F32x8>(&self, eight: E, point: &[E::Floats; 3]) -> [E::Floats; 3] {
        let [x, y, z] = load_vectors(eight, &self.position);
        [x - point[0], y - point[1], z - point[2]]
    }
}

/// Dot products with the order of additions of `Vec3::dot`.
#[inline(always)]
fn dot<F: Copy + Add<Output = F> + Mul<Output = F>>(
    [ax, ay, az]: &[F; 3],
    [bx, by, bz]: &[F; 3],
) -> F {
    *ax * *bx + *ay * *by + *az * *bz
}

#[inline(always)]
fn splat_vector<E: F32x8>(eight: E, vector: Vec3) -> [E::Floats; 3] {
    [eight.splat(vector.x), eight.splat(vector.y), eight.splat(vector.z)]
}

#[inline(always)]
fn splat_classes<E: F32x8>(eight: E, [caustic, diffuse]: ByClass<f32>) -> ByClass<E::Floats> {
    [eight.splat(caustic), eight.splat(diffuse)]
}

#[inline(always)]
fn load_vectors<E: F32x8>(eight: E, [x, y, z]: &[[f32; OCTET]; 3]) -> [E::Floats; 3] {
    [eight.load(x), eight.load(y), eight.load(z)]
}

#[inline(always)]
fn sum_vector<E: F32x8>(eight: E, [x, y, z]: &[E::Floats; 3]) -> Rgb {
    Rgb::new(eight.sum(*x), eight.sum(*y), eight.sum(*z))
}
