//! Which medium fills the space around a path.
//!
//! Boundaries of media are surfaces whose material names the media on its two sides. A path carries
//! a [`MediumState`], the number of a set of media that it is inside of, and each boundary that it
//! crosses leads from one state to another. All states that paths can reach are listed when the
//! scene is built, so that a crossing is one look-up. theory.md, section 9a.

mod build;

use super::medium::Medium;
use super::{Scene, Surface};
use crate::accel::{Hit, Intersect, Ray, next_after};
use crate::base::error::{Error, Result};
use crate::base::math::Rgb;
use glam::Vec3;
use serde::Serialize;
use std::sync::Arc;

/// Number of the set of media that a path is inside of.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct MediumState(pub(crate) u8);

impl MediumState {
    /// Number of states that a scene may have.
    pub(crate) const COUNT: usize = 64;
}

/// The media that a material separates.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct MediumBoundary {
    /// Medium behind the surface; `None` if nothing is known of it.
    pub interior: Option<Arc<Medium>>,
    /// Medium in front of the surface, if it is not that of the object around it.
    pub exterior: Option<Arc<Medium>>,
}

/// A set of media, one bit each.
type Members = u64;

/// Media of a scene, their boundaries, and all sets of media that a path may be inside of.
#[derive(Debug)]
pub struct Media {
    media: Vec<Arc<Medium>>,
    states: Vec<State>,
    /// For each placement the number of its boundary, if it is one.
    boundary_of: Vec<Option<u16>>,
    boundaries: Vec<Boundary>,
}

#[derive(Debug)]
struct State {
    members: Members,
    /// Index of the medium that fills the space.
    medium: Option<u8>,
    /// For each boundary the states after a crossing to the back and to the front.
    next: Vec<[MediumState; 2]>,
}

#[derive(Clone, Copy, Debug, PartialEq)]
struct Boundary {
    /// Sets of at most one medium.
    interior: Members,
    exterior: Members,
    /// Paths go straight on.
    is_index_matched: bool,
}

impl Boundary {
    /// The set of media after a crossing, without any that never meets the new one.
    fn cross(&self, members: Members, to_back: bool, meets: &[Members]) -> Members {
        let (left, entered) =
            if to_back { (self.exterior, self.interior) } else { (self.interior, self.exterior) };
        let others = members & !left;
        if entered == 0 {
            return others;
        }
        others & meets[entered.trailing_zeros() as usize] | entered
    }
}

impl Media {
    /// All media.
    pub fn media(&self) -> &[Arc<Medium>] {
        &self.media
    }

    /// Returns true if a medium scatters light.
    pub fn any_scatters(&self) -> bool {
        self.media.iter().any(|medium| medium.scatters())
    }

    /// Largest extinction coefficient of the media that scatter, of any color, 1/scene unit; 0
    /// without such media.
    pub fn largest_extinction(&self) -> f32 {
        let scattering = self.media.iter().filter(|medium| medium.scatters());
        scattering.map(|medium| medium.extinction().max_element()).fold(0.0, f32::max)
    }

    /// Largest share of the light that a medium scatters and does not absorb, of any color; 0
    /// without media that scatter.
    pub fn largest_albedo(&self) -> f32 {
        let scattering = self.media.iter().filter(|medium| medium.scatters());
        // A color that meets nothing has none.
        let albedo =
            |own: &Medium| own.scattering / own.extinction().max(Rgb::splat(f32::MIN_POSITIVE));
        scattering.map(|medium| albedo(medium).max_element()).fold(0.0, f32::max)
    }

    /// The medium that fills the space in a state; `None` for empty space.
    #[inline]
    pub fn medium(&self, state: MediumState) -> Option<&Medium> {
        let index = self.states[usize::from(state.0)].medium?;
        Some(&self.media[usize::from(index)])
    }

    /// The state after a path crosses a surface of this placement, to its back if it comes from the
    /// front.
    #[inline]
    pub fn cross(&self, state: MediumState, placement: u32, from_front: bool) -> MediumState {
        match self.boundary_of[placement as usize] {
            None => state,
            Some(boundary) => {
                let [to_back, to_front] =
                    self.states[usize::from(state.0)].next[usize::from(boundary)];
                if from_front { to_back } else { to_front }
            }
        }
    }

    /// The state after a path leaves a surface along `direction`.
    #[inline]
    pub fn after(&self, state: MediumState, surface: &Surface, direction: Vec3) -> MediumState {
        if surface.normal.dot(direction) >= 0.0 {
            return state;
        }
        self.cross(state, surface.facet.mesh, surface.front)
    }

    /// Returns true if paths go straight through surfaces of this placement.
    #[inline]
    pub fn is_index_matched(&self, placement: u32) -> bool {
        let boundary = self.boundary_of.get(placement as usize).copied().flatten();
        boundary.is_some_and(|number| self.boundaries[usize::from(number)].is_index_matched)
    }

    /// Returns true if the surfaces of a placement bound a medium.
    pub(super) fn bounds_medium(&self, placement: u32) -> bool {
        self.boundary_of[placement as usize].is_some()
    }

    /// Returns true if paths go straight through any surface.
    fn has_index_matched(&self) -> bool {
        self.boundaries.iter().any(|boundary| boundary.is_index_matched)
    }

    /// The state at a point, by the boundaries around it: the first crossing of each medium's
    /// boundary by a ray tells on which side the point is.
    pub fn at(&self, scene: &Scene, accel: &dyn Intersect, point: Vec3) -> MediumState {
        // Along no axis, edge or diagonal of common models.
        let ray = Ray::new(point, Vec3::new(0.431_6, 0.276_1, 0.858_8).normalize());
        let (mut seen, mut members) = (0, self.states[0].members);
        let (mut hit, mut step) = (accel.closest_hit(&ray), f32::EPSILON);
        while !hit.is_miss() {
            if let Some(number) = self.boundary_of[hit.mesh as usize] {
                let Boundary { interior, exterior, .. } = self.boundaries[usize::from(number)];
                let normal = scene.placed_normal(hit.mesh, hit.triangle);
                let (near, far) = if normal.dot(ray.direction) < 0.0 {
                    (exterior, interior)
                } else {
                    (interior, exterior)
                };
                members |= near & !seen;
                seen |= near | far;
            }
            (hit, step) = next_after(accel, &ray, &hit, step);
        }
        let same = |state: &State| state.members == members;
        // Sets that no path reaches belong to surfaces that are not closed.
        MediumState(self.states.iter().position(same).unwrap_or(0) as u8)
    }

    /// Transmittance of the segment between two points that nothing but index-matched surfaces
    /// blocks. A path in the state `state` is at `from`. theory.md (37f)
    pub fn transmittance(
        &self,
        scene: &Scene,
        accel: &dyn Intersect,
        state: MediumState,
        [from, to]: [Vec3; 2],
    ) -> Rgb {
        let length = from.distance(to);
        let through = |state: MediumState, share: f32| {
            self.medium(state).map_or(Rgb::ONE, |medium| medium.transmittance(share * length))
        };
        if !self.has_index_matched() {
            return through(state, 1.0);
        }
        let ray = Ray::segment(from, to);
        let (mut state, mut start, mut total) = (state, 0.0, Rgb::ONE);
        let (mut hit, mut step): (Hit, _) = (accel.closest_hit(&ray), f32::EPSILON);
        while !hit.is_miss() && hit.t < 1.0 {
            if self.is_index_matched(hit.mesh) {
                total *= through(state, hit.t - start);
                start = hit.t;
                let normal = scene.placed_normal(hit.mesh, hit.triangle);
                state = self.cross(state, hit.mesh, normal.dot(ray.direction) < 0.0);
            }
            (hit, step) = next_after(accel, &ray, &hit, step);
        }
        total * through(state, 1.0 - start)
    }
}

impl Scene {
    /// The media of the scene, if there are any.
    #[inline]
    pub fn media(&self) -> Option<&Media> {
        self.media.as_deref()
    }

    /// The medium that fills the space between all others, if there is one.
    pub fn filling_medium(&self) -> Option<&Arc<Medium>> {
        self.filling_medium.as_ref()
    }

    /// The scene with a medium between all others, without bounds.
    ///
    /// # Errors
    /// If light would have to come from infinitely far, or there are too many media.
    pub fn with_filling_medium(mut self, medium: Option<Arc<Medium>>) -> Result<Self> {
        // A medium that neither absorbs nor scatters is empty space.
        let medium = medium.filter(|own| own.absorption + own.scattering != Rgb::ZERO);
        let lights = self.lights();
        let has_sun = lights.emitters().iter().any(|emitter| emitter.parallel().is_some());
        if medium.is_some() && (lights.has_environment() || has_sun) {
            let problem =
                "a medium without bounds absorbs all light of environments, skies and suns";
            let advice = "put the medium into a closed object that is large enough, with index-matched surfaces";
            return Err(Error::new(problem, advice));
        }
        let (meshes, placements) = (&self.meshes, &self.placements);
        let media = Media::new(meshes, placements, &self.materials, medium.as_ref())?;
        self.media = media.map(Arc::new);
        self.filling_medium = medium;
        Ok(self)
    }
}

#[cfg(test)]
mod tests;
