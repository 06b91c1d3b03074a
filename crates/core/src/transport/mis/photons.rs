//! MIS partials of light paths and their photons.

use super::Mis;
use super::densities::{Directions, Survival};
use super::weights::{LightPartial, PhotonPartials, StraightDensities};
use crate::scene::bsdf::{BsdfSample, Lobe, Transport};
use crate::scene::diffuse::DiffuseVertices;
use crate::scene::{Emissions, Lights, Receiver, Surface};
use crate::simd::{LANES, Mask};
use crate::transport::light_paths::class_of;
use crate::transport::path_state::{History, PathState, PathStates};
use crate::transport::photon::PhotonClass;
use glam::Vec3;
use std::ops::Range;

/// Partials of a photon that a medium scattered: merges at first vertices alone sample its path.
/// theory.md (47p)
const PHOTON_FROM_MEDIUM: PhotonPartials = [0.0, -1.0];

/// The partials of one batch of light paths and of their photons.
#[derive(Debug, Default)]
pub struct LightPartials {
    mis: Option<Mis>,
    /// The first light path of the batch.
    first: u32,
    /// One for each path, after its last vertex, and then for each continuation of a path that
    /// splits, whose states have numbers of their own.
    paths: Vec<PathPartial>,
    /// One for each photon, in the order of the photons.
    pub photons: Vec<PhotonPartials>,
}

/// A light path, or a continuation where it splits.
#[derive(Clone, Copy, Debug, Default)]
pub(in crate::transport) struct PathPartial {
    /// Number of the light path.
    path: u32,
    /// Number of the light source.
    emitter: u32,
    /// Where the path started. Segments start anew at boundaries of media.
    origin: Vec3,
    /// After the last vertex.
    partial: LightPartial,
}

/// First segment of a light path, and the vertex at its end.
struct FirstSegment {
    /// Origin and direction.
    ray: [Vec3; 2],
    /// Position and normal of the vertex.
    vertex: [Vec3; 2],
}

impl FirstSegment {
    /// Density of connections of `at` over the density of emission, both along the segment.
    fn connection(&self, lights: &Lights, emitter: u32, at: Receiver) -> f32 {
        lights.connection_over_emission(emitter as usize, self.ray, at, self.vertex[1])
    }
}

impl LightPartials {
    /// Starts a batch of these paths.
    pub fn start(&mut self, mis: Option<Mis>, paths: Range<u32>) {
        self.mis = mis;
        self.first = paths.start;
        self.photons.clear();
        self.paths.clear();
        if mis.is_some() {
            self.paths.resize(paths.len(), PathPartial::default());
        }
    }

    /// Tests whether photons have partials.
    #[inline(always)] // part of the loop over vertices
    pub fn is_active(&self) -> bool {
        self.mis.is_some()
    }

    /// Records the light sources of the paths from `first` on.
    #[inline(never)] // keeps the loops without MIS short, as the functions below
    pub fn emit(&mut self, lights: &Lights, first: u32, emissions: &Emissions, count: usize) {
        let Some(mis) = self.mis else { return };
        let first = (first - self.first) as usize;
        for (lane, path) in self.paths[first..][..count].iter_mut().enumerate() {
            let emitter = emissions.emitter[lane];
            let ray = [emissions.origin.get(lane), emissions.direction.get(lane)];
            let emission = lights.emission_density(emitter as usize, ray);
            let partial = mis.balance.start(emission.map_or(0.0, f32::recip));
            let number = self.first + (first + lane) as u32;
            *path = PathPartial { path: number, emitter, origin: ray[0], partial };
        }
    }

    /// Number of the light path that a state of this number belongs to.
    #[inline(always)] // part of the loop over vertices
    pub fn light_path(&self, number: u32) -> u32 {
        // Lanes without a path have any number.
        self.paths.get(number.wrapping_sub(self.first) as usize).map_or(number, |own| own.path)
    }

    /// Partial of the path of this number; `None` without MIS.
    pub(in crate::transport) fn of(&self, path: u32) -> Option<PathPartial> {
        self.is_active().then(|| self.paths[(path - self.first) as usize])
    }

    /// Number of another continuation of the path of this number, with this partial.
    pub(in crate::transport) fn split(&mut self, path: u32, partial: Option<PathPartial>) -> u32 {
        let Some(partial) = partial else { return path };
        self.paths.push(partial);
        self.first + (self.paths.len() - 1) as u32
    }

    /// Adds the partials of the photons that are stored in these lanes.
    #[inline(never)]
    pub(in crate::transport) fn store_diffuse(&mut self, stored: &Mask, states: &PathStates) {
        for lane in (0..LANES).filter(|&lane| stored[lane]) {
            self.push(states.path[lane], states.history[lane]);
        }
    }

    /// Adds the partial of a photon.
    pub(in crate::transport) fn store(&mut self, state: &PathState) {
        if self.mis.is_some() {
            self.push(state.path, state.history);
        }
    }

    fn push(&mut self, path: u32, history: History) {
        let Some(mis) = self.mis else { return };
        let partial = &self.paths[(path - self.first) as usize].partial;
        self.photons.push(if history.was_in_medium() {
            PHOTON_FROM_MEDIUM
        } else if history.is_start() {
            mis.balance.straight_photon(partial)
        } else {
            mis.balance.photon(partial, class_of(history))
        });
    }

    /// Updates the partials of paths that go on from Lambertian vertices. `states` are as before
    /// scattering.
    #[inline(never)]
    pub(in crate::transport) fn scatter_diffuse(
        &mut self,
        lights: &Lights,
        at: &DiffuseVertices,
        states: &PathStates,
        goes_on: &Mask,
    ) {
        let Some(mis) = self.mis else { return };
        let survival = mis.camera_survival(2);
        for lane in (0..LANES).filter(|&lane| goes_on[lane]) {
            let path = &mut self.paths[(states.path[lane] - self.first) as usize];
            let history = states.history[lane];
            let albedo = at.albedo.get(lane).max_element();
            let segment = FirstSegment {
                ray: [path.origin, states.direction.get(lane)],
                vertex: [at.position.get(lane), at.normal.get(lane)],
            };
            let [position, normal] = segment.vertex;
            let at = Receiver { position, normal: Some(normal) };
            let techniques = StraightDensities {
                connection: mis.connection(lights, path.emitter, history, (&segment, at)),
                camera: survival.lambertian(albedo),
            };
            let merges = mis.merges(history);
            let light = Survival::LIGHT.lambertian(albedo);
            let light = mis.balance.continuations(history.diffuse(), light);
            path.partial = mis.balance.scatter(&path.partial, techniques, merges, light);
        }
    }

    /// Updates the partial of a path that goes on from any vertex. `state` is as before scattering.
    pub(in crate::transport) fn scatter(
        &mut self,
        lights: &Lights,
        surface: &Surface,
        state: &PathState,
        sample: &BsdfSample,
    ) {
        let Some(mis) = self.mis else { return };
        let path = &mut self.paths[(state.path - self.first) as usize];
        let directions = Directions { camera: sample.wi, light: surface.wo };
        let vertex = [surface.position, surface.normal];
        let segment = FirstSegment { ray: [path.origin, -surface.wo], vertex };
        let is_first_rough = state.history.is_start() && sample.lobe == Lobe::Rough;
        if sample.lobe.passes_through() && !is_first_rough {
            let ratio = directions.light_over_camera(surface, sample.lobe, mis.pass_choice(1));
            path.partial = path.partial.pass(ratio);
            return;
        }
        let (techniques, merges, light) = if is_first_rough {
            // Camera paths connect the light source from here, too.
            let techniques = StraightDensities {
                connection: segment.connection(lights, path.emitter, surface.receiver()),
                camera: directions.camera_rough(surface, mis.pass_choice(1)),
            };
            (techniques, None, directions.light_rough(surface))
        } else {
            let techniques = StraightDensities {
                connection: mis.connection(
                    lights,
                    path.emitter,
                    state.history,
                    (&segment, surface.receiver()),
                ),
                camera: directions.camera_diffuse(surface, mis.camera_survival(2)),
            };
            let at = surface.vertex(Transport::Flux);
            let light = Survival::LIGHT.density(&surface.bsdf, &at, sample.wi);
            let light = mis.balance.continuations(state.history.diffuse(), light);
            (techniques, mis.merges(state.history), light)
        };
        path.partial = mis.balance.scatter(&path.partial, techniques, merges, light);
    }
}

impl Mis {
    /// Density of connections over the density of emission where a light path arrives at a diffuse
    /// vertex with this history; 0 unless it arrives straight from its light source and is
    /// connected from there, as this receiver.
    fn connection(
        &self,
        lights: &Lights,
        emitter: u32,
        history: History,
        (segment, at): (&FirstSegment, Receiver),
    ) -> f32 {
        if !history.is_start() || !self.connects {
            return 0.0;
        }
        segment.connection(lights, emitter, at)
    }

    /// Class of the photon of a light path that arrives with this history, if it is merged at
    /// second vertices.
    fn merges(&self, history: History) -> Option<PhotonClass> {
        (!history.is_start()).then(|| class_of(history))
    }
}
