//! The merge kernel in media: a ball around a point, or a disc across a segment.

use super::kernel::{ByClass, MergeKernel, NESTED, WavelengthKernel};
use super::near_planes::NearPlanes;
use crate::base::math::{ball_volume, disc_area};
use crate::settings::{MediumQuery, Settings};
use glam::Vec3;
use std::array::from_fn;

/// A constant kernel for either class of photons: theory.md (37i), (37m).
#[derive(Clone, Copy, Debug)]
pub struct MediumKernel {
    /// Where photons are merged.
    query: MediumQuery,
    /// Squares of the radii, scene units squared.
    pub radius2: ByClass<f32>,
    /// Squares of the nested radii, in the order of theory.md (68).
    pub nested2: [ByClass<f32>; 2],
    /// Reciprocals of the volumes of balls, 1/scene units cubed, or of the areas of discs, 1/scene
    /// units squared.
    inverse_size: ByClass<f32>,
    /// The kernels at the nested radii over the kernels at the radii.
    nested: [ByClass<f32>; 2],
    /// Wavelengths that merge, where photons and camera paths have one.
    pub(super) wavelengths: WavelengthKernel,
    /// Distance up to which surfaces are looked for, scene units.
    reach: f32,
}

/// The kernel for photons of one class at one place.
#[derive(Clone, Copy, Debug)]
pub(super) struct CutKernel {
    /// Reciprocal of the volume of the ball, 1/scene units cubed, or of the area of the disc,
    /// 1/scene units squared.
    pub inverse_size: f32,
    /// The kernels at the nested radii over the kernel at the radius.
    pub nested: [f32; 2],
}

impl MediumKernel {
    /// The kernel of these settings: at [`Settings::medium_scale`] times the radii of a kernel at
    /// surfaces.
    pub fn new(at_surfaces: &MergeKernel, settings: &Settings) -> Self {
        let (scale, query) = (settings.medium_scale as f32, settings.medium_query);
        let radii = at_surfaces.radii().map(|radius| scale * radius);
        let square = |radii: ByClass<f32>| radii.map(|radius| radius * radius);
        let nested = NESTED.map(|share| at_surfaces.nested(share).map(|radius| scale * radius));
        let (dimensions, size): (i32, fn(f32) -> f32) = match query {
            MediumQuery::Points => (3, ball_volume),
            MediumQuery::Beams => (2, disc_area),
        };
        let over = |nested: &ByClass<f32>| -> ByClass<f32> {
            from_fn(|class| (radii[class] / nested[class]).powi(dimensions))
        };
        Self {
            query,
            radius2: square(radii),
            nested2: nested.map(square),
            inverse_size: radii.map(|radius| size(radius).recip()),
            nested: [over(&nested[0]), over(&nested[1])],
            wavelengths: at_surfaces.wavelengths,
            reach: match query {
                MediumQuery::Points => radii[0].max(radii[1]),
                MediumQuery::Beams => 2.0 * radii[0].max(radii[1]),
            },
        }
    }

    /// The kernel for photons of a class where surfaces cut balls or discs: `share` is the part of
    /// one of a radius that they leave.
    fn cut(&self, class: usize, share: impl Fn(f32) -> f32) -> CutKernel {
        let share = |radius2: f32| share(radius2.max(0.0).sqrt());
        let whole = share(self.radius2[class]);
        CutKernel {
            inverse_size: self.inverse_size[class] / whole,
            nested: from_fn(|at| self.nested[at][class] * whole / share(self.nested2[at][class])),
        }
    }

    /// The kernel for photons of a class that no surface cuts.
    pub(super) fn whole(&self, class: usize) -> CutKernel {
        let nested = self.nested.map(|nested| nested[class]);
        CutKernel { inverse_size: self.inverse_size[class], nested }
    }

    /// The kernels of the classes at a point whose surroundings cut the balls.
    pub(super) fn cut_by(&self, planes: &NearPlanes) -> ByClass<CutKernel> {
        from_fn(|class| self.cut(class, |radius| planes.share(radius)))
    }

    /// The kernel of a class across a ray at this offset from the point of these planes.
    pub(super) fn cut_across(
        &self,
        class: usize,
        planes: &NearPlanes,
        offset: Vec3,
        direction: Vec3,
    ) -> CutKernel {
        let disc = planes.across(offset, direction);
        self.cut(class, |radius| disc.share(radius))
    }

    /// The larger radius, scene units.
    pub fn radius(&self) -> f32 {
        self.radius2[0].max(self.radius2[1]).sqrt()
    }

    /// Distance within which surfaces can cut balls around points, or discs on which a photon lies,
    /// scene units.
    pub fn reach(&self) -> f32 {
        self.reach
    }

    /// This kernel within the surfaces that are known for another one, whose radii are at least as
    /// large.
    #[must_use]
    pub fn within_planes_of(self, other: &Self) -> Self {
        Self { reach: other.reach, ..self }
    }

    /// Tests whether photons are merged along segments.
    pub(super) fn is_along_segments(&self) -> bool {
        self.query == MediumQuery::Beams
    }
}
