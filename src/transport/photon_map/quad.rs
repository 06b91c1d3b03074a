//! Four photons side by side, and the tests and sums of a merge query over them.

use super::mis_weights::PhotonWeights;
use super::queries::MergeQuery;
use crate::base::math::Rgb;
use crate::simd::dispatch::{Simd, interleave_selected};
use crate::transport::kernel::{Admission, ByClass, PointKernel};
use crate::transport::pair_list::Pair;
use crate::transport::photon::{Arrival, Photon, PhotonSide};
use glam::{BVec4A, Vec3, Vec4};

/// Photons of a quad.
pub const QUAD: usize = 4;

/// Four photons without their directions: two cache lines.
#[derive(Clone, Copy, Debug, Default)]
#[repr(C, align(64))]
pub struct Quad {
    position: [[f32; QUAD]; 3],
    arrival: [Arrival; QUAD],
    flux: [[f32; QUAD]; 3],
    path: [u32; QUAD],
}

/// A merge query with its kernel and weights, in all lanes.
#[derive(Clone, Copy, Debug)]
pub struct QuadQuery {
    position: [Vec4; 3],
    radius2: ByClass<Vec4>,
    nested2: [ByClass<Vec4>; 2],
    normal: [Vec4; 3],
    limit: Vec4,
    flattening: Vec4,
    all_classes: bool,
    /// Photons on this side do not count.
    excluded: PhotonSide,
    /// Kernels over the kernel of diffuse photons, times the weight of the class.
    relative: ByClass<Vec4>,
    /// Kernels at the nested radii over the kernels at the merge radii.
    nested: [ByClass<Vec4>; 2],
    /// Weights of the classes.
    by_class: ByClass<f32>,
    /// Radius, kernel and weight do not depend on the class.
    is_uniform: bool,
}

/// Selects the lanes of a quad from `place` on.
#[inline(always)]
pub fn lanes_from(place: usize) -> BVec4A {
    Vec4::new(0.0, 1.0, 2.0, 3.0).cmpge(Vec4::splat(place as i32 as f32))
}

/// Sum of flux by photon class, lane by lane: the order of additions is the order of the photons. A uniform query
/// adds all flux to the diffuse class.
#[derive(Clone, Copy, Debug, Default)]
pub struct FluxSum(ByClass<[Vec4; 3]>);

impl QuadQuery {
    /// Prepares a query for the loop over quads.
    #[inline(always)] // part of the loop over photons, as the functions below
    pub fn new<W: PhotonWeights>(
        query: &MergeQuery,
        admission: &Admission,
        kernel: &PointKernel,
        weights: &W,
    ) -> Self {
        let (mut relative, by_class) = (kernel.relative(), weights.by_class());
        if let Some(weights) = by_class {
            relative.iter_mut().zip(weights).for_each(|(relative, weight)| *relative *= weight);
        }
        Self {
            position: query.position.to_array().map(Vec4::splat),
            radius2: admission.radius2.map(Vec4::splat),
            nested2: admission.nested2.map(|nested2| nested2.map(Vec4::splat)),
            normal: query.normal.to_array().map(Vec4::splat),
            limit: Vec4::splat(admission.limit),
            flattening: Vec4::splat(admission.flattening),
            all_classes: W::ALL_CLASSES | query.kind.all_classes(),
            excluded: query.excluded,
            relative: relative.map(Vec4::splat),
            nested: kernel.nested.map(|nested| nested.map(Vec4::splat)),
            by_class: by_class.unwrap_or([1.0; 2]),
            is_uniform: admission.is_uniform() & by_class.is_none(),
        }
    }
}

impl FluxSum {
    /// The sum over all lanes, times the weights of the classes.
    #[inline(always)]
    pub fn total(&self, query: &QuadQuery) -> ByClass<Rgb> {
        let [caustic, diffuse] = self.0.map(|flux| Rgb::from_array(flux.map(Vec4::element_sum)));
        let [caustic_weight, diffuse_weight] = query.by_class;
        [caustic * caustic_weight, diffuse * diffuse_weight]
    }
}

/// Receives the photons that a query merges.
pub(crate) trait PairSink {
    /// Takes the photons of a quad in the lanes that `count`, with the weights of single photons.
    fn add(&mut self, quad: &Quad, query: &QuadQuery, count: BVec4A, weights: Option<Vec4>);
}

/// Drops the pairs where sums suffice.
pub(crate) struct NoPairs;

impl PairSink for NoPairs {
    #[inline(always)]
    fn add(&mut self, _: &Quad, _: &QuadQuery, _: BVec4A, _: Option<Vec4>) {}
}

/// Writes the pairs of one gather point to a slice.
pub(crate) struct PointPairs<'a> {
    simd: Simd,
    /// Factors from flux to luminance at the point, for diffuse photons.
    weight: Rgb,
    space: &'a mut [Pair],
    count: usize,
    nested: [Vec4; 2],
}

impl<'a> PointPairs<'a> {
    /// Prepares to write to `space`, which has a place for every photon of the quads that are searched.
    #[inline(always)]
    pub fn new(simd: Simd, weight: Rgb, space: &'a mut [Pair]) -> Self {
        Self { simd, weight, space, count: 0, nested: [Vec4::ZERO; 2] }
    }

    /// Number of the pairs, and the sums of their differences between nested radii: theory.md (68).
    #[inline(always)]
    pub fn finish(self) -> (usize, [f32; 2]) {
        (self.count, self.nested.map(Vec4::element_sum))
    }
}

impl PairSink for PointPairs<'_> {
    #[inline(always)]
    fn add(&mut self, quad: &Quad, query: &QuadQuery, count: BVec4A, weights: Option<Vec4>) {
        let (light_paths, values) = quad.pairs(query, self.weight);
        let values = weights.map_or(values, |weights| values * weights);
        for (sum, nested) in self.nested.iter_mut().zip(quad.nested(query, values)) {
            *sum += Vec4::select(count, nested, Vec4::ZERO);
        }
        // Writes all four and keeps those that count: a branch for each could not be predicted.
        let count = count.bitmask();
        let values = values.to_array().map(f32::to_bits);
        let pairs = interleave_selected(self.simd, count, light_paths, values);
        self.space[self.count..self.count + QUAD].copy_from_slice(bytemuck::cast_slice(&pairs));
        self.count += count.count_ones() as usize;
    }
}

impl Quad {
    /// Replaces one photon.
    #[inline]
    pub fn set(&mut self, lane: usize, photon: &Photon) {
        let Self { position, arrival, flux, path } = self;
        for (lanes, coordinate) in position.iter_mut().zip(photon.position.to_array()) {
            lanes[lane] = coordinate;
        }
        arrival[lane] = photon.arrival;
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
            arrival: self.arrival[lane],
            from: 0,
        }
    }

    /// Bits of the lanes within a radius of a point.
    #[inline(always)]
    pub fn within(&self, point: Vec3, radius2: f32) -> u64 {
        let from = self.from(&point.to_array().map(Vec4::splat));
        dot(&from, &from).cmple(Vec4::splat(radius2)).bitmask().into()
    }

    /// Selects those of some lanes whose photons count.
    #[inline(always)]
    pub fn admitted(&self, query: &QuadQuery, lanes: BVec4A) -> BVec4A {
        let faces = dot(&self.normal(), &query.normal);
        let near = self.min_radius2(query).cmple(self.by_class(query, &query.radius2));
        let mut admitted = near & faces.cmpgt(query.limit) & lanes & !self.is_on(query.excluded);
        if !query.all_classes {
            admitted &= self.is_caustic();
        }
        admitted
    }

    /// In each lane the value of the photon's class.
    #[inline(always)]
    fn by_class(&self, query: &QuadQuery, [caustic, diffuse]: &ByClass<Vec4>) -> Vec4 {
        if query.is_uniform {
            return *diffuse;
        }
        Vec4::select(self.is_caustic(), *caustic, *diffuse)
    }

    /// Selects the lanes of caustic photons.
    #[inline(always)]
    pub fn is_caustic(&self) -> BVec4A {
        let diffuse = self.arrival.map(|arrival| if arrival.is_caustic() { 0.0 } else { 1.0 });
        Vec4::from_array(diffuse).cmpeq(Vec4::ZERO)
    }

    /// Selects the lanes of photons on a side.
    #[inline(always)]
    fn is_on(&self, side: PhotonSide) -> BVec4A {
        let others = self.arrival.map(|arrival| if arrival.is_on(side) { 0.0 } else { 1.0 });
        Vec4::from_array(others).cmpeq(Vec4::ZERO)
    }

    /// Adds the flux of some lanes, times the weights of single photons.
    #[inline(always)]
    pub fn add_to(
        &self,
        sum: &mut FluxSum,
        query: &QuadQuery,
        lanes: BVec4A,
        weights: Option<Vec4>,
    ) {
        let [caustic, diffuse] = &mut sum.0;
        let add = |sum: &mut [Vec4; 3], lanes: BVec4A| {
            for (sum, flux) in sum.iter_mut().zip(self.flux) {
                let flux = Vec4::from_array(flux);
                let flux = weights.map_or(flux, |weights| flux * weights);
                *sum += Vec4::select(lanes, flux, Vec4::ZERO);
            }
        };
        if query.is_uniform {
            add(diffuse, lanes);
        } else {
            let is_caustic = self.is_caustic();
            add(caustic, lanes & is_caustic);
            add(diffuse, lanes & !is_caustic);
        }
    }

    /// Selects the lanes within half the merge radius.
    #[inline(always)]
    pub fn within_half(&self, query: &QuadQuery) -> BVec4A {
        self.min_radius2(query).cmple(self.by_class(query, &query.nested2[1]))
    }

    /// Values at the merge radius less those at `1/sqrt(2)` of it, and the latter less those at half of it:
    /// theory.md (68).
    #[inline(always)]
    fn nested(&self, query: &QuadQuery, values: Vec4) -> [Vec4; 2] {
        let min_radius2 = self.min_radius2(query);
        let [inner, core] = [0, 1].map(|at| {
            let inside = min_radius2.cmple(self.by_class(query, &query.nested2[at]));
            Vec4::select(inside, self.by_class(query, &query.nested[at]) * values, Vec4::ZERO)
        });
        [values - inner, inner - core]
    }

    /// The light path of each lane, and its luminance at the gather point.
    #[inline(always)]
    fn pairs(&self, query: &QuadQuery, weight: Rgb) -> ([u32; QUAD], Vec4) {
        let [r, g, b] = self.flux.map(Vec4::from_array);
        let value = r * weight.x + g * weight.y + b * weight.z;
        let relative = self.by_class(query, &query.relative);
        (self.path, if query.is_uniform { value } else { value * relative })
    }

    /// Squares of the smallest radii within which photons may count: [`Admission::min_radius2`].
    #[inline(always)]
    fn min_radius2(&self, query: &QuadQuery) -> Vec4 {
        let from = self.from(&query.position);
        let offset = dot(&self.normal(), &from);
        dot(&from, &from).max(query.flattening * offset * offset)
    }

    /// Vectors from a point.
    #[inline(always)]
    fn from(&self, [x, y, z]: &[Vec4; 3]) -> [Vec4; 3] {
        let position = self.position.map(Vec4::from_array);
        [position[0] - *x, position[1] - *y, position[2] - *z]
    }

    /// Normals on the sides of arrival, 127 units long.
    #[inline(always)]
    fn normal(&self) -> [Vec4; 3] {
        [0, 1, 2].map(|axis| Vec4::from_array(self.arrival.map(|side| side.coordinate(axis))))
    }
}

/// Dot products with the order of additions of `Vec3::dot`.
#[inline(always)]
fn dot([ax, ay, az]: &[Vec4; 3], [bx, by, bz]: &[Vec4; 3]) -> Vec4 {
    *ax * *bx + *ay * *by + *az * *bz
}
