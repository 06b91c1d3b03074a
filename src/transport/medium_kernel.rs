//! The merge kernel in media: a ball around a point, or a disc across a segment.

use super::kernel::{ByClass, MergeKernel, NESTED, WavelengthKernel};
use super::photon::PhotonClass;
use super::room::Room;
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
    /// Reciprocals of the volumes of balls, 1/scene units cubed, or of the areas of discs, 1/scene units squared.
    pub inverse_size: ByClass<f32>,
    /// The kernels at the nested radii over the kernels at the radii.
    pub nested: [ByClass<f32>; 2],
    /// Wavelengths that merge, where photons and camera paths have one.
    pub(super) wavelengths: WavelengthKernel,
}

impl MediumKernel {
    /// The kernel of these settings: at [`Settings::medium_scale`] times the radii of a kernel at surfaces.
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
        }
    }

    /// Admits caustic photons only.
    pub(super) fn caustics_only(self) -> Self {
        let mut radius2 = self.radius2;
        radius2[PhotonClass::Diffuse as usize] = -1.0;
        Self { radius2, ..self }
    }

    /// The kernel where surfaces cut balls or discs: `share` is the part of one of a radius that they leave.
    fn cut(&self, share: impl Fn(f32) -> f32) -> Self {
        let share = |radius2: &ByClass<f32>| radius2.map(|radius2| share(radius2.max(0.0).sqrt()));
        let whole = share(&self.radius2);
        let inner = [share(&self.nested2[0]), share(&self.nested2[1])];
        Self {
            inverse_size: from_fn(|class| self.inverse_size[class] / whole[class]),
            nested: from_fn(|at| {
                from_fn(|class| self.nested[at][class] * whole[class] / inner[at][class])
            }),
            ..*self
        }
    }

    /// The kernel at a point whose surroundings cut the balls.
    #[must_use]
    pub(super) fn cut_by(&self, room: &Room) -> Self {
        self.cut(|radius| room.share(radius))
    }

    /// The kernel across a ray at this offset from the center of a room.
    #[must_use]
    pub(super) fn cut_across(&self, room: &Room, offset: Vec3, direction: Vec3) -> Self {
        self.cut(|radius| room.disc_share(offset, direction, radius))
    }

    /// The larger radius, scene units.
    pub fn radius(&self) -> f32 {
        self.radius2[0].max(self.radius2[1]).sqrt()
    }

    /// Distance within which surfaces can cut balls around points, or discs on which a photon lies, scene units.
    pub fn room_radius(&self) -> f32 {
        match self.query {
            MediumQuery::Points => self.radius(),
            MediumQuery::Beams => 2.0 * self.radius(),
        }
    }

    /// Tests whether photons are merged along segments.
    pub(super) fn is_along_segments(&self) -> bool {
        self.query == MediumQuery::Beams
    }
}
