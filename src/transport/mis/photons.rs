//! What photons carry of their paths' weights, beside them: existing where paths are weighted alone.

use super::Mis;
use super::densities::Directions;
use super::weights::PreviousTechnique;
use crate::scene::bsdf::{BsdfSample, Transport};
use crate::scene::diffuse::DiffuseVertices;
use crate::scene::{Lights, Surface};
use crate::simd::{LANES, Mask};
use crate::transport::path_state::{Walk, Walks};
use crate::transport::photon::PhotonClass;
use glam::Vec3;
use std::ops::Range;

/// Carried by a photon straight from a light. Merged at the first vertex, it weighs as much as one that carries 0
/// and can be found in no other way: 1. Its sign tells that it is merged nowhere else.
pub const STRAIGHT: f32 = -0.0;

/// The parts of one batch of light paths and their photons.
#[derive(Debug, Default)]
pub struct PhotonParts {
    mis: Option<Mis>,
    first: u32,
    /// Of each path, after its last vertex.
    paths: Vec<PathPart>,
    /// Of each photon, in their order.
    pub photons: Vec<f32>,
}

#[derive(Clone, Copy, Debug, Default)]
struct PathPart {
    /// Which it started from.
    emitter: u32,
    part: f32,
}

impl PhotonParts {
    /// Takes all out, for a batch of these paths.
    pub fn start(&mut self, mis: Option<Mis>, paths: Range<u32>) {
        self.mis = mis;
        self.first = paths.start;
        self.photons.clear();
        self.paths.clear();
        if mis.is_some() {
            self.paths.resize(paths.len(), PathPart::default());
        }
    }

    /// Whether photons carry any.
    #[inline(always)] // part of the loop over vertices
    pub fn are_wanted(&self) -> bool {
        self.mis.is_some()
    }

    /// Paths from this one on start at these emitters.
    #[inline(never)] // as the next: keeps the loops without weights short
    pub fn emit(&mut self, first: u32, emitters: &[u32]) {
        let first = (first - self.first) as usize;
        for (path, &emitter) in self.paths[first..].iter_mut().zip(emitters) {
            *path = PathPart { emitter, part: 0.0 };
        }
    }

    /// Photons are left in these lanes.
    #[inline(never)]
    pub(in crate::transport) fn store_diffuse(&mut self, stored: &Mask, walks: &Walks) {
        for lane in (0..LANES).filter(|&lane| stored[lane]) {
            let straight = walks.depth[lane].is_start();
            let part = self.paths[(walks.path[lane] - self.first) as usize].part;
            self.photons.push(if straight { STRAIGHT } else { part });
        }
    }

    /// A photon is left.
    pub(in crate::transport) fn store(&mut self, walk: &Walk) {
        if self.mis.is_some() {
            let part = self.paths[(walk.path - self.first) as usize].part;
            self.photons.push(if walk.depth.is_start() { STRAIGHT } else { part });
        }
    }

    /// Paths go on from Lambertian vertices, which they reached as `walks` tell.
    #[inline(never)]
    pub(in crate::transport) fn scatter_diffuse(
        &mut self,
        lights: &Lights,
        at: &DiffuseVertices,
        walks: &Walks,
        goes_on: &Mask,
    ) {
        let Some(mis) = self.mis else { return };
        for lane in (0..LANES).filter(|&lane| goes_on[lane]) {
            let depth = walks.depth[lane];
            let path = &mut self.paths[(walks.path[lane] - self.first) as usize];
            let otherwise = if depth.diffuse() > 0 {
                PreviousTechnique::Merged(PhotonClass::Diffuse)
            } else if !depth.is_start() {
                PreviousTechnique::Merged(PhotonClass::Caustic)
            } else {
                let from = [walks.origin.get(lane), walks.direction.get(lane)];
                let place = [at.position.get(lane), at.normal.get(lane)];
                mis.straight(lights, path.emitter, from, place)
            };
            let albedo = at.albedo.get(lane).max_element();
            path.part = mis.balance.photon(otherwise, mis.light.lambertian(albedo));
        }
    }

    /// A path goes on from any vertex, which it reached as `walk` tells from `origin`.
    pub(in crate::transport) fn scatter(
        &mut self,
        lights: &Lights,
        surface: &Surface,
        (origin, walk): (Vec3, &Walk),
        sample: &BsdfSample,
    ) {
        let Some(mis) = self.mis else { return };
        let path = &mut self.paths[(walk.path - self.first) as usize];
        let depth = walk.depth;
        if sample.lobe.passes_through() {
            if depth.diffuse() > 0 {
                let ways = Directions { camera: sample.wi, light: surface.wo };
                path.part /= ways.light_over_camera(surface, sample.lobe);
            }
            return;
        }
        let otherwise = if depth.diffuse() > 0 {
            PreviousTechnique::Merged(PhotonClass::Diffuse)
        } else if !depth.is_start() {
            PreviousTechnique::Merged(PhotonClass::Caustic)
        } else {
            let place = [surface.position, surface.normal];
            mis.straight(lights, path.emitter, [origin, -surface.wo], place)
        };
        let at = surface.vertex(Transport::Flux);
        path.part = mis.balance.photon(otherwise, mis.light.density(&surface.bsdf, &at, sample.wi));
    }
}

impl Mis {
    /// How else a path could be found of which emission from a light hits this diffuse vertex, its position and
    /// normal, straight from an origin along a direction.
    fn straight(
        &self,
        lights: &Lights,
        emitter: u32,
        from: [Vec3; 2],
        [position, normal]: [Vec3; 2],
    ) -> PreviousTechnique {
        if !self.connects {
            return PreviousTechnique::Never;
        }
        let inverse_l = lights.connection_over_emission(emitter as usize, from, position, normal);
        PreviousTechnique::Connected { inverse_l }
    }
}
