//! The step of a path at a vertex that is handled alone. Camera paths, light paths and the light
//! paths of measurements have it in common; a [`Role`] has the differences between them.

use super::free_flight::{MediumVertex, Passed, travel};
use super::path_state::{PathState, disperse};
use super::roulette::survives_passing;
use crate::accel::{Coherence, Hit, Intersect, Ray};
use crate::base::math::Rgb;
use crate::base::rng::Rng;
use crate::scene::bsdf::{BsdfSample, Lobe, Transport, Vertex};
use crate::scene::panes::PanePassage;
use crate::scene::{Scene, Surface};
use glam::Vec3;
use std::mem;

/// The next ray of a path, and its state.
pub type Segment = (Ray, PathState);

/// A vertex of a path at a surface.
#[derive(Clone, Copy)]
pub struct PathVertex<'a> {
    /// The surface.
    pub surface: &'a Surface<'a>,
    /// Shading normal and direction back along the path.
    pub at: &'a Vertex,
    /// State of the path as it arrives.
    pub state: &'a PathState,
}

/// The differences between kinds of paths at their vertices.
pub trait Role {
    /// The quantity that BSDFs are sampled for.
    const TRANSPORT: Transport;

    /// Handles the arrival of a path at a surface, and samples how it leaves; `None` if it ends.
    fn at_surface(&mut self, vertex: &PathVertex, rng: &mut Rng) -> Option<BsdfSample>;

    /// Handles the arrival of a path where a medium scatters it, and returns false if it ends
    /// there. May draw random numbers, and changes nothing else of the state.
    fn arrive_in_medium(&mut self, vertex: &MediumVertex, state: &mut PathState) -> bool;

    /// Handles a path that a medium scatters in the direction `next`.
    fn leave_medium(&mut self, _vertex: &MediumVertex, _next: Vec3, _state: &PathState) {}

    /// Multiplies the weight of a path by that of a vertex, and plays roulette. Returns false if it
    /// ends. Its history has the vertex. `lobe` is `None` in media.
    fn survives(&self, weight: Rgb, lobe: Option<Lobe>, state: &mut PathState) -> bool;
}

/// Takes a path on from a surface, where `at` has the arguments of its BSDF, unless it ends.
#[inline]
pub fn step_at_surface(
    role: &mut impl Role,
    scene: &Scene,
    surface: &Surface,
    at: &Vertex,
    mut state: PathState,
) -> Option<Segment> {
    let mut rng = state.rng;
    let sample = role.at_surface(&PathVertex { surface, at, state: &state }, &mut rng)?;
    let BsdfSample { wi, weight, lobe, .. } = sample;
    state.rng = rng;
    let history = state.history.leaving(scene, surface, wi);
    state.history =
        if lobe.passes_through() { history.passed_through() } else { history.scattered() };
    let survives = role.survives(weight, Some(lobe), &mut state);
    survives.then(|| (Ray::new(surface.start(wi), wi), state))
}

/// Takes a path on from a point where a medium scatters it, unless it ends.
pub fn step_in_medium(
    role: &mut impl Role,
    vertex: &MediumVertex,
    mut state: PathState,
) -> Option<Segment> {
    if !role.arrive_in_medium(vertex, &mut state) {
        return None;
    }
    state.history = state.history.scattered_in_medium();
    if !role.survives(vertex.factor(), None, &mut state) {
        return None;
    }
    let next = vertex.medium.scatter(vertex.direction, &mut state.rng);
    role.leave_medium(vertex, next, &state);
    Some((Ray::new(vertex.position, next), state))
}

/// Takes a path straight on through a pane, or mirrors it there; `None` if it ends.
pub fn step_at_pane(
    pane: &PanePassage,
    surface: &Surface,
    mut state: PathState,
) -> Option<Segment> {
    let [transmitted, reflected] = [pane.transmitted, pane.reflected].map(Rgb::max_element);
    let prob = transmitted / (transmitted + reflected);
    if state.rng.next_1d() < prob {
        state.weight *= pane.transmitted / prob;
        state.history = state.history.within(pane.beyond);
        if pane.is_slab() {
            state.history = state.history.through_slab();
        }
        return Some((Ray::new(pane.start, -surface.wo), state));
    }
    state.weight *= pane.reflected / (1.0 - prob);
    state.history = state.history.passed_through();
    let mirrored = 2.0 * surface.normal.dot(surface.wo) * surface.normal - surface.wo;
    survives_passing(&mut state)
        .then(|| (Ray::new(surface.off_surface, mirrored.normalize()), state))
}

/// A measurement by paths that leave no photons.
pub trait Walker: Role {
    /// Handles a segment that ends at `hit`, or misses everything.
    fn segment(&mut self, _ray: &Ray, _hit: &Hit, _state: &PathState) {}

    /// Handles a path that leaves the scene.
    fn leave_scene(&mut self, _ray: &Ray, _state: &PathState) {}

    /// Takes a path straight through a surface, or mirrors it there: `Some(None)` if it ends, and
    /// `None` if it scatters as [`Role`] says.
    fn pass_straight(&self, _surface: &Surface, _state: &PathState) -> Option<Option<Segment>> {
        None
    }
}

/// Takes paths to their ends, one segment of all of them after the other.
pub fn walk<W: Walker>(
    walker: &mut W,
    (scene, accel): (&Scene, &dyn Intersect),
    paths: impl Iterator<Item = Segment>,
) {
    let mut paths: Vec<Segment> = paths.collect();
    let (mut hits, mut next) = (Vec::new(), Vec::with_capacity(paths.len()));
    while !paths.is_empty() {
        let rays: Vec<Ray> = paths.iter().map(|(ray, _)| *ray).collect();
        hits.clear();
        hits.resize(rays.len(), Hit::MISS);
        accel.closest_hits(&rays, &mut hits, Coherence::Incoherent);
        for ((ray, mut state), hit) in paths.drain(..).zip(&hits) {
            walker.segment(&ray, hit, &state);
            let media = scene.media();
            let gone_on = match media.and_then(|own| travel(scene, own, &ray, hit, &mut state)) {
                Some(Passed::Boundary(ray)) => Some((ray, state)),
                Some(Passed::Scattered(vertex)) => step_in_medium(walker, &vertex, state),
                None if hit.is_miss() => {
                    walker.leave_scene(&ray, &state);
                    None
                }
                None => {
                    let mut surface = scene.surface(&ray, hit);
                    walker.pass_straight(&surface, &state).unwrap_or_else(|| {
                        disperse(&mut surface, &mut state);
                        let at = surface.vertex(W::TRANSPORT);
                        step_at_surface(walker, scene, &surface, &at, state)
                    })
                }
            };
            next.extend(gone_on);
        }
        mem::swap(&mut paths, &mut next);
    }
}
