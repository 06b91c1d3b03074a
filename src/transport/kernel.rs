//! The merge kernel: which photons count at a point, and what area their flux is divided by.

use super::area::{Areas, Query, admission};
use super::gather::GatherPacket;
use super::photon::{Photon, PhotonClass};
use crate::base::math::disc_area;
use crate::settings::{self, Settings};
use crate::simd::{LANES, Mask, Vec3s};
use glam::Vec3;
use std::array::from_fn;
use std::f32::consts::FRAC_1_SQRT_2;

/// A value for photons of either class, by [`PhotonClass`].
pub type ByClass<T> = [T; 2];

const EVERY: usize = PhotonClass::Caustic as usize;
const LAST: usize = PhotonClass::Diffuse as usize;

/// Which photons count: those within the radius of their class, on a surface whose normal is nearly that at
/// the point and whose plane is near it: theory.md (45b).
#[derive(Clone, Copy, Debug)]
pub struct Admission {
    /// Squares of the merge radii, scene units squared.
    pub radius2: ByClass<f32>,
    /// Those of the nested radii: theory.md (68).
    pub nested2: [ByClass<f32>; 2],
    /// What the dot product of the point's normal with the photon's, 127 units long, must exceed.
    pub limit: f32,
    /// Of the squared offset along the photon's normal, 127 units long: it must be within the squared radius, too.
    pub flattening: f32,
    /// Whether classes are told apart even where both count within the same radius.
    pub apart: bool,
}

impl Admission {
    /// Square of the smallest radius within which a photon at the squared distance `distance2` from `position` may
    /// count there.
    #[inline]
    pub fn least_radius2(&self, photon: &Photon, distance2: f32, position: Vec3) -> f32 {
        let offset = photon.cosine(photon.position - position);
        distance2.max(self.flattening * offset * offset)
    }

    /// Whether a photon of this [`Self::least_radius2`] counts where the surface has the unit normal `normal`.
    #[inline]
    pub fn admits(&self, photon: &Photon, least_radius2: f32, normal: Vec3) -> bool {
        least_radius2 <= self.radius2[photon.class() as usize] && photon.cosine(normal) > self.limit
    }

    /// Whether photons of both classes count within the same radius, and need not be told apart.
    pub fn is_uniform(&self) -> bool {
        !self.apart && self.radius2[EVERY] == self.radius2[LAST]
    }

    /// The same for photons of every vertex alone.
    pub fn of_every_vertex(self) -> Self {
        let mut radius2 = self.radius2;
        radius2[LAST] = -1.0;
        Self { radius2, ..self }
    }

    /// Where the flux of photons of a class is summed up: all together if the radius is the same.
    pub fn sum_of(&self, class: PhotonClass) -> usize {
        if self.is_uniform() { LAST } else { class as usize }
    }
}

/// A constant kernel for either class of photons: theory.md (45).
#[derive(Clone, Copy)]
pub struct Kernel<'a> {
    /// Merge radii, scene units.
    radii: ByClass<f32>,
    /// What could have sent the photons; discs if none.
    areas: Option<&'a Areas>,
    /// Which classes of photons have nested radii; those of the other are the radius again.
    nests: ByClass<bool>,
}

/// Nested radii over the merge radius.
const NESTED: [f32; 2] = [FRAC_1_SQRT_2, 0.5];

/// At which of them a kernel is asked for.
pub mod nested {
    /// At none.
    pub const NONE: usize = 0;
    /// At half the merge radii.
    pub const HALF: usize = 1;
    /// At `1/sqrt(2)` of them, too.
    pub const BOTH: usize = 2;
}

/// The kernel at sixteen points.
#[derive(Clone, Copy, Debug, Default)]
pub struct PointKernels {
    inverse_area: [f32; LANES],
    every: [f32; LANES],
    nested: [ByClass<[f32; LANES]>; 2],
}

/// The kernel at one point.
#[derive(Clone, Copy, Debug, Default)]
pub struct PointKernel {
    /// Reciprocal of the area for photons of the last vertex, 1/scene units squared.
    pub inverse_area: f32,
    /// The kernel for photons of every vertex over that for photons of the last.
    pub every: f32,
    /// The kernels at `1/sqrt(2)` and at half of the radii over those at the radii; nothing unless asked for.
    pub nested: [ByClass<f32>; 2],
}

impl<'a> Kernel<'a> {
    /// As the settings say, with the areas of the scene's surfaces where they ask for them.
    ///
    /// # Panics
    /// If they do and there are none.
    pub fn new(settings: &Settings, areas: Option<&'a Areas>) -> Self {
        let radii = [settings.caustic_radius, settings.radius];
        match settings.kernel {
            settings::Kernel::Disc => Self::discs(radii),
            settings::Kernel::Area => {
                Self { areas: Some(areas.expect("areas")), ..Self::discs(radii) }
            }
        }
    }

    /// The same with nested radii only for one class of photons, whose bias they then tell alone. The radii must
    /// not be equal.
    #[must_use]
    pub fn nesting(self, class: PhotonClass) -> Self {
        let mut nests = [false; 2];
        nests[class as usize] = true;
        Self { nests, ..self }
    }

    /// The same where there are no photons of every vertex: one radius serves.
    #[must_use]
    pub fn of_last_vertex(self) -> Self {
        Self { radii: [self.radii[LAST]; 2], nests: [self.nests[LAST]; 2], ..self }
    }

    /// A disc of one radius for all photons.
    pub fn disc(radius: f32) -> Self {
        Self::discs([radius; 2])
    }

    /// Discs of these radii.
    pub fn discs(radii: ByClass<f32>) -> Self {
        Self { radii, areas: None, nests: [true; 2] }
    }

    /// The radius within which photons are looked up, scene units.
    pub fn reach(&self) -> f32 {
        self.radii[EVERY].max(self.radii[LAST])
    }

    /// Which photons count.
    pub fn admission(&self) -> Admission {
        // Photons on a disc count on the same side of the surface; true areas are those of surfaces within
        // 60 degrees and not far from their own planes.
        let (limit, flattening) = if self.areas.is_some() {
            (admission::LIMIT, admission::FLATTENING)
        } else {
            (0.0, 0.0)
        };
        let square = |radii: ByClass<f32>| radii.map(|radius| radius * radius);
        let nested2 = NESTED.map(|share| square(self.nested(share)));
        Admission { radius2: square(self.radii), nested2, limit, flattening, apart: false }
    }

    /// The radii at a share of them.
    #[inline(always)] // part of vectorized code
    fn nested(&self, share: f32) -> ByClass<f32> {
        from_fn(
            |class| if self.nests[class] { share * self.radii[class] } else { self.radii[class] },
        )
    }

    /// The kernel at the points of these lanes, with those at smaller radii that are wanted.
    #[inline(always)] // vectorized
    pub(super) fn at<const NESTED_RADII: usize>(
        &self,
        points: &GatherPacket,
        wanted: &Mask,
    ) -> PointKernels {
        let Some(areas) = self.areas else {
            let [every, last] = self.radii.map(disc_area);
            return PointKernels {
                inverse_area: [last.recip(); LANES],
                every: [last / every; LANES],
                nested: NESTED.map(|share| {
                    let nested = self.nested(share);
                    from_fn(|class| [(self.radii[class] / nested[class]).powi(2); LANES])
                }),
            };
        };
        let facet = from_fn(|lane| {
            if wanted[lane] { areas.number(points.mesh[lane], points.side[lane]) } else { 0 }
        });
        let query = Query { position: &points.position, facet: &facet, wanted };
        let [inner, half] = NESTED.map(|share| self.nested(share));
        // Of both classes side by side, or of one where the radius is the same for all photons.
        if self.radii[EVERY] == self.radii[LAST] {
            return match NESTED_RADII {
                nested::NONE => of_one(areas.areas(&query, &[self.radii[LAST]])),
                nested::HALF => of_one(areas.areas(&query, &[self.radii[LAST], half[LAST]])),
                _ => of_one(areas.areas(&query, &[self.radii[LAST], half[LAST], inner[LAST]])),
            };
        }
        let ([every, last], [half_every, half_last]) = (self.radii, half);
        match NESTED_RADII {
            nested::NONE => of_two(areas.areas(&query, &[every, last])),
            nested::HALF => of_two(areas.areas(&query, &[every, last, half_every, half_last])),
            _ => {
                let [inner_every, inner_last] = inner;
                let radii = [every, last, half_every, half_last, inner_every, inner_last];
                of_two(areas.areas(&query, &radii))
            }
        }
    }
}

/// From areas at the merge radius of all photons, and at half and `1/sqrt(2)` of it as far as these are known.
#[inline(always)] // vectorized
fn of_one<const N: usize>(areas: [[f32; LANES]; N]) -> PointKernels {
    let over = |at: usize| -> ByClass<[f32; LANES]> {
        areas.get(at).map_or_else(Default::default, |inner| {
            [from_fn(|lane| areas[0][lane] / inner[lane]); 2]
        })
    };
    PointKernels {
        inverse_area: areas[0].map(f32::recip),
        every: [1.0; LANES],
        nested: [over(2), over(1)],
    }
}

/// The same of both classes in turn.
#[inline(always)] // vectorized
fn of_two<const N: usize>(areas: [[f32; LANES]; N]) -> PointKernels {
    let over = |at: usize| -> ByClass<[f32; LANES]> {
        let of = |class: usize| {
            areas
                .get(2 * at + class)
                .map_or([0.0; LANES], |inner| from_fn(|lane| areas[class][lane] / inner[lane]))
        };
        [of(EVERY), of(LAST)]
    };
    PointKernels {
        inverse_area: areas[LAST].map(f32::recip),
        every: from_fn(|lane| areas[LAST][lane] / areas[EVERY][lane]),
        nested: [over(2), over(1)],
    }
}

impl PointKernels {
    /// What of the flux of a class found at the point of a lane counts beyond half the merge radius, where so much is
    /// found within that: W, as if it were of the last vertex. Its mean is the bias that the outer part adds.
    #[inline(always)] // part of vectorized code
    pub fn beyond(&self, lane: usize, class: usize, all: Vec3, half: Vec3) -> Vec3 {
        let relative = if class == EVERY { self.every[lane] } else { 1.0 };
        relative * (all - self.nested[1][class][lane] * half)
    }

    /// The flux of photons found at the point of a lane, W, as if all were of the last vertex.
    #[inline(always)] // part of vectorized code
    pub fn together(&self, lane: usize, flux: &ByClass<Vec3s>) -> Vec3 {
        flux[LAST].get(lane) + self.every[lane] * flux[EVERY].get(lane)
    }

    /// That of one lane.
    #[inline(always)] // part of vectorized code
    pub fn get(&self, lane: usize) -> PointKernel {
        PointKernel {
            inverse_area: self.inverse_area[lane],
            every: self.every[lane],
            nested: self.nested.map(|nested| nested.map(|class| class[lane])),
        }
    }
}

impl PointKernel {
    /// The kernel for photons of a class over that for photons of the last vertex.
    #[inline(always)] // part of vectorized code
    pub fn relative(&self) -> ByClass<f32> {
        let mut relative = [1.0; 2];
        relative[EVERY] = self.every;
        relative
    }
}
