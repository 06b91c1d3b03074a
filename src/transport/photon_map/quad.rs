//! Photons side by side, and which of them a look-up counts.

use super::{LookUp, Weighing};
use crate::base::math::Rgb;
use crate::transport::kernel::{Admission, ByClass, PointKernel};
use crate::transport::photon::{Photon, Side};
use glam::{BVec4A, Vec3, Vec4};

/// Photons of a quad.
pub const QUAD: usize = 4;

/// Four photons: what decides whether they count, and what they carry, a cache line each.
#[derive(Clone, Copy, Debug, Default)]
#[repr(C, align(64))]
pub struct Quad {
    position: [[f32; QUAD]; 3],
    side: [Side; QUAD],
    flux: [[f32; QUAD]; 3],
    path: [u32; QUAD],
}

/// What a look-up compares photons with and multiplies them with, in all lanes.
#[derive(Clone, Copy, Debug)]
pub struct Counting {
    position: [Vec4; 3],
    radius2: ByClass<Vec4>,
    nested2: [ByClass<Vec4>; 2],
    normal: [Vec4; 3],
    limit: Vec4,
    flattening: Vec4,
    last: bool,
    /// Kernels over those of the last vertex, and the nested ones over those at the radii.
    relative: ByClass<Vec4>,
    nested: [ByClass<Vec4>; 2],
    /// Weights of either class.
    by_class: ByClass<f32>,
    /// Whether all of these are the same for both classes.
    is_uniform: bool,
}

/// Which lanes of a quad are at this place or after it, counted from its first.
#[inline(always)]
pub fn lanes_from(place: usize) -> BVec4A {
    Vec4::new(0.0, 1.0, 2.0, 3.0).cmpge(Vec4::splat(place as i32 as f32))
}

/// Flux found by a look-up, by class unless both count within the same radius: then all of it is that of
/// the last vertex. In each lane by itself: the order of additions is that of the places.
#[derive(Clone, Copy, Debug, Default)]
pub struct Flux(ByClass<[Vec4; 3]>);

impl Counting {
    /// Photons that this look-up counts, with the kernel at its point and weights by their class.
    #[inline(always)] // as those below: parts of the loop over ranges
    pub fn new<W: Weighing>(
        look_up: &LookUp,
        admission: &Admission,
        kernel: &PointKernel,
        weighing: &W,
    ) -> Self {
        let (mut relative, by_class) = (kernel.relative(), weighing.by_class());
        if let Some(weights) = by_class {
            relative.iter_mut().zip(weights).for_each(|(relative, weight)| *relative *= weight);
        }
        Self {
            position: look_up.position.to_array().map(Vec4::splat),
            radius2: admission.radius2.map(Vec4::splat),
            nested2: admission.nested2.map(|nested2| nested2.map(Vec4::splat)),
            normal: look_up.normal.to_array().map(Vec4::splat),
            limit: Vec4::splat(admission.limit),
            flattening: Vec4::splat(admission.flattening),
            last: W::ALL | look_up.last,
            relative: relative.map(Vec4::splat),
            nested: kernel.nested.map(|nested| nested.map(Vec4::splat)),
            by_class: by_class.unwrap_or([1.0; 2]),
            is_uniform: admission.is_uniform() & by_class.is_none(),
        }
    }
}

impl Flux {
    /// Of all lanes together, times the weights of classes.
    #[inline(always)]
    pub fn total(&self, counting: &Counting) -> ByClass<Rgb> {
        let [every, last] = self.0.map(|flux| Rgb::from_array(flux.map(Vec4::element_sum)));
        let [of_every, of_last] = counting.by_class;
        [every * of_every, last * of_last]
    }
}

impl Quad {
    /// Replaces one photon.
    #[inline]
    pub fn set(&mut self, lane: usize, photon: &Photon) {
        let Self { position, side, flux, path } = self;
        for (lanes, coordinate) in position.iter_mut().zip(photon.position.to_array()) {
            lanes[lane] = coordinate;
        }
        side[lane] = photon.side;
        for (lanes, channel) in flux.iter_mut().zip(photon.flux.to_array()) {
            lanes[lane] = channel;
        }
        path[lane] = photon.path;
    }

    /// One photon, as far as it is here.
    #[inline]
    pub fn get(&self, lane: usize) -> Photon {
        Photon {
            position: Vec3::from_array(self.position.map(|lanes| lanes[lane])),
            path: self.path[lane],
            flux: Rgb::from_array(self.flux.map(|lanes| lanes[lane])),
            side: self.side[lane],
            from: 0,
        }
    }

    /// The lanes within a distance of a point, a bit for each.
    #[inline(always)]
    pub fn within(&self, point: Vec3, radius2: f32) -> u64 {
        let from = self.from(&point.to_array().map(Vec4::splat));
        dot(&from, &from).cmple(Vec4::splat(radius2)).bitmask().into()
    }

    /// Which of some lanes count.
    #[inline(always)]
    pub fn counting(&self, counting: &Counting, lanes: BVec4A) -> BVec4A {
        let faces = dot(&self.normal(), &counting.normal);
        let near = self.least_radius2(counting).cmple(self.of(counting, &counting.radius2));
        let mut counts = near & faces.cmpgt(counting.limit) & lanes;
        if !counting.last {
            counts &= self.at_every_vertex();
        }
        counts
    }

    /// Of each lane that of its class.
    #[inline(always)]
    fn of(&self, counting: &Counting, [every, last]: &ByClass<Vec4>) -> Vec4 {
        if counting.is_uniform {
            return *last;
        }
        Vec4::select(self.at_every_vertex(), *every, *last)
    }

    #[inline(always)]
    fn at_every_vertex(&self) -> BVec4A {
        let late = self.side.map(|side| if side.at_every_vertex() { 0.0 } else { 1.0 });
        Vec4::from_array(late).cmpeq(Vec4::ZERO)
    }

    /// Adds the flux of some lanes, times any weights of single photons.
    #[inline(always)]
    pub fn add_to(
        &self,
        sum: &mut Flux,
        counting: &Counting,
        lanes: BVec4A,
        weights: Option<Vec4>,
    ) {
        let [every, last] = &mut sum.0;
        let add = |sum: &mut [Vec4; 3], lanes: BVec4A| {
            for (sum, flux) in sum.iter_mut().zip(self.flux) {
                let flux = Vec4::from_array(flux);
                let flux = weights.map_or(flux, |weights| flux * weights);
                *sum += Vec4::select(lanes, flux, Vec4::ZERO);
            }
        };
        if counting.is_uniform {
            add(last, lanes);
        } else {
            let at_every_vertex = self.at_every_vertex();
            add(every, lanes & at_every_vertex);
            add(last, lanes & !at_every_vertex);
        }
    }

    /// Which lanes are within half the radius.
    #[inline(always)]
    pub fn within_half(&self, counting: &Counting) -> BVec4A {
        self.least_radius2(counting).cmple(self.of(counting, &counting.nested2[1]))
    }

    /// What values at the kernel's radius are more than at `1/sqrt(2)` of it, and those more than at half:
    /// theory.md (68).
    #[inline(always)]
    pub fn nested(&self, counting: &Counting, values: Vec4) -> [Vec4; 2] {
        let least_radius2 = self.least_radius2(counting);
        let [inner, core] = [0, 1].map(|at| {
            let inside = least_radius2.cmple(self.of(counting, &counting.nested2[at]));
            Vec4::select(inside, self.of(counting, &counting.nested[at]) * values, Vec4::ZERO)
        });
        [values - inner, inner - core]
    }

    /// The light path of each lane, and its flux times `weight` and the kernel over that of the last vertex.
    #[inline(always)]
    pub fn pairs(&self, counting: &Counting, weight: Rgb) -> ([u32; QUAD], Vec4) {
        let [r, g, b] = self.flux.map(Vec4::from_array);
        let value = r * weight.x + g * weight.y + b * weight.z;
        let relative = self.of(counting, &counting.relative);
        (self.path, if counting.is_uniform { value } else { value * relative })
    }

    /// Squares of the smallest radii within which photons may count: [`Admission::least_radius2`].
    #[inline(always)]
    fn least_radius2(&self, counting: &Counting) -> Vec4 {
        let from = self.from(&counting.position);
        let offset = dot(&self.normal(), &from);
        dot(&from, &from).max(counting.flattening * offset * offset)
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
        [0, 1, 2].map(|axis| Vec4::from_array(self.side.map(|side| side.coordinate(axis))))
    }
}

/// In the order of `Vec3::dot`.
#[inline(always)]
fn dot([ax, ay, az]: &[Vec4; 3], [bx, by, bz]: &[Vec4; 3]) -> Vec4 {
    *ax * *bx + *ay * *by + *az * *bz
}
