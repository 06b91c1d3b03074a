//! MIS partials of light paths and their photons.

use super::Mis;
use super::densities::{Directions, PathKind};
use super::weights::PreviousTechnique;
use crate::scene::bsdf::{BsdfSample, Transport};
use crate::scene::diffuse::DiffuseVertices;
use crate::scene::{Lights, Surface};
use crate::simd::{LANES, Mask};
use crate::transport::path_state::{Depth, PathState, PathStates};
use crate::transport::photon::PhotonClass;
use glam::Vec3;
use std::ops::Range;

/// Partial of a photon straight from a light source. A merge at the first vertex is its only technique, so that it
/// weighs as much as with the partial 0, which is 1. The sign marks that it is not merged at second vertices.
const STRAIGHT: f32 = -0.0;

/// The partials of one batch of light paths and of their photons.
#[derive(Debug, Default)]
pub struct LightPartials {
    mis: Option<Mis>,
    /// The first light path of the batch.
    first: u32,
    /// One for each path, after its last vertex.
    paths: Vec<PathPartial>,
    /// One for each photon, in the order of the photons.
    pub photons: Vec<f32>,
}

#[derive(Clone, Copy, Debug, Default)]
struct PathPartial {
    /// Number of the light source.
    emitter: u32,
    partial: f32,
}

/// First segment of a light path, and the diffuse vertex at its end.
struct FirstSegment {
    /// Origin and direction.
    ray: [Vec3; 2],
    /// Position and normal of the vertex.
    vertex: [Vec3; 2],
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
    pub fn emit(&mut self, first: u32, emitters: &[u32]) {
        let first = (first - self.first) as usize;
        for (path, &emitter) in self.paths[first..].iter_mut().zip(emitters) {
            *path = PathPartial { emitter, partial: 0.0 };
        }
    }

    /// Adds the partials of the photons that are stored in these lanes.
    #[inline(never)]
    pub(in crate::transport) fn store_diffuse(&mut self, stored: &Mask, states: &PathStates) {
        for lane in (0..LANES).filter(|&lane| stored[lane]) {
            self.push(states.path[lane], states.depth[lane]);
        }
    }

    /// Adds the partial of a photon.
    pub(in crate::transport) fn store(&mut self, state: &PathState) {
        if self.mis.is_some() {
            self.push(state.path, state.depth);
        }
    }

    fn push(&mut self, path: u32, depth: Depth) {
        let partial = self.paths[(path - self.first) as usize].partial;
        self.photons.push(if depth.is_start() { STRAIGHT } else { partial });
    }

    /// Updates the partials of paths that go on from Lambertian vertices. `states` are as before scattering.
    #[inline(never)]
    pub(in crate::transport) fn scatter_diffuse(
        &mut self,
        lights: &Lights,
        at: &DiffuseVertices,
        states: &PathStates,
        goes_on: &Mask,
    ) {
        let Some(mis) = self.mis else { return };
        for lane in (0..LANES).filter(|&lane| goes_on[lane]) {
            let path = &mut self.paths[(states.path[lane] - self.first) as usize];
            let previous =
                mis.previous(lights, path.emitter, states.depth[lane], || FirstSegment {
                    ray: [states.origin.get(lane), states.direction.get(lane)],
                    vertex: [at.position.get(lane), at.normal.get(lane)],
                });
            let albedo = at.albedo.get(lane).max_element();
            path.partial = mis.balance.photon(previous, PathKind::Light.lambertian(albedo));
        }
    }

    /// Updates the partial of a path that goes on from any vertex. `state` is as before scattering; `origin` is the
    /// start of the segment to the vertex.
    pub(in crate::transport) fn scatter(
        &mut self,
        lights: &Lights,
        surface: &Surface,
        origin: Vec3,
        state: &PathState,
        sample: &BsdfSample,
    ) {
        let Some(mis) = self.mis else { return };
        let path = &mut self.paths[(state.path - self.first) as usize];
        if sample.lobe.passes_through() {
            if state.depth.diffuse() > 0 {
                let directions = Directions { camera: sample.wi, light: surface.wo };
                path.partial /= directions.light_over_camera(surface, sample.lobe);
            }
            return;
        }
        let previous = mis.previous(lights, path.emitter, state.depth, || FirstSegment {
            ray: [origin, -surface.wo],
            vertex: [surface.position, surface.normal],
        });
        let at = surface.vertex(Transport::Flux);
        let density = PathKind::Light.density(&surface.bsdf, &at, sample.wi);
        path.partial = mis.balance.photon(previous, density);
    }
}

impl Mis {
    /// Technique of a camera path that ends at a diffuse vertex of a light path. `depth` is the depth at which the
    /// light path arrives there; `segment` is called if it arrives straight from its light source.
    fn previous(
        &self,
        lights: &Lights,
        emitter: u32,
        depth: Depth,
        segment: impl FnOnce() -> FirstSegment,
    ) -> PreviousTechnique {
        if depth.diffuse() > 0 {
            PreviousTechnique::Merged(PhotonClass::Diffuse)
        } else if !depth.is_start() {
            PreviousTechnique::Merged(PhotonClass::Caustic)
        } else if self.connects {
            let FirstSegment { ray, vertex: [position, normal] } = segment();
            let emitter = emitter as usize;
            let inverse_l = lights.connection_over_emission(emitter, ray, position, normal);
            PreviousTechnique::Connected { inverse_l }
        } else {
            PreviousTechnique::Never
        }
    }
}
