//! What camera paths tell of themselves beside the light that they carry, if they are asked: what they saw first,
//! and which part of the light is emission or light of one bounce. They draw no random numbers for that.

use super::{CameraPass, CameraPaths};
use crate::base::math::Rgb;
use crate::scene::Surface;
use crate::scene::diffuse::DiffuseVertices;
use crate::simd::LANES;
use crate::transport::path_state::{Depth, Walk, Walks};
use glam::Vec3;

/// Of one camera path.
#[derive(Clone, Copy, Debug, Default)]
pub struct Told {
    /// Part of `D_j`: emission seen directly, or by mirrors and clear glass alone, W/(m^2 sr).
    pub emission: Rgb,
    /// Part of `D_j`: light connected at its first vertex, and emission hit by way of a rough lobe.
    pub direct: Rgb,
    /// Albedo of the first surface that is no mirror and no clear glass, tinted by those before.
    pub albedo: Rgb,
    /// Unit shading normal of that surface on the side that is seen.
    pub normal: Vec3,
    /// Where the very first surface is, scene units.
    pub position: Vec3,
    /// How far from the camera that is along its axis, scene units.
    pub depth: f32,
    /// Whether there is any surface.
    pub hits: bool,
    /// Whether `albedo` and `normal` are known.
    knows_surface: bool,
    /// Whether a rough lobe came before any diffuse vertex.
    after_rough: bool,
    /// Number of the diffuse vertex that it is at.
    vertex: u32,
}

impl CameraPaths {
    /// Whether camera paths that are traced from now on leave what they [tell](Told).
    pub fn tell(&mut self, tell: bool) {
        self.tells = tell;
    }

    /// Room for paths that were begun.
    pub(super) fn prepare_telling(&mut self) {
        // What was there belongs to paths before these.
        let first = self.direct.len() - self.segments.len();
        self.told.truncate(first);
        self.told.resize(self.direct.len(), Told::default());
    }

    /// At Lambertian vertices, before paths go on.
    #[inline(never)] // rare
    pub(super) fn tell_diffuse(&mut self, pass: &CameraPass, at: &DiffuseVertices, walks: &Walks) {
        for lane in (0..LANES).filter(|&lane| at.active[lane]) {
            let depth = walks.depth[lane];
            let told = &mut self.told[walks.path[lane] as usize];
            told.vertex = depth.diffuse() + 1;
            if depth.diffuse() == 0 {
                told.sees_first(pass, depth, at.position.get(lane));
                let tint = walks.weight.get(lane) * walks.inverse_start[lane];
                told.sees(tint * at.albedo.get(lane), at.normal.get(lane));
            }
        }
    }

    /// At any other surface.
    #[inline(never)] // rare
    pub(super) fn tell_other(
        &mut self,
        pass: &CameraPass,
        surface: &Surface,
        (walk, normal): (&Walk, Vec3),
    ) {
        let told = &mut self.told[walk.path as usize];
        told.vertex = walk.depth.diffuse() + 1;
        if walk.depth.diffuse() == 0 {
            told.sees_first(pass, walk.depth, surface.position);
            if surface.bsdf.spread().is_some() {
                let tint = walk.weight * walk.inverse_start;
                told.sees(tint * surface.bsdf.color(surface.front), normal);
            }
        }
    }

    /// Emission that a path hit before any diffuse vertex.
    #[inline(never)] // rare
    pub(super) fn tell_emission(&mut self, path: u32, emission: Rgb) {
        let told = &mut self.told[path as usize];
        let kind = if told.after_rough { &mut told.direct } else { &mut told.emission };
        *kind += emission;
    }

    /// A path goes on by a rough lobe, before any diffuse vertex.
    pub(super) fn tell_rough(&mut self, path: u32) {
        self.told[path as usize].after_rough = true;
    }
}

impl Told {
    /// Light was connected where the path is now.
    pub(super) fn connects(&mut self, light: Rgb) {
        if self.vertex == 1 {
            self.direct += light;
        }
    }

    fn sees_first(&mut self, pass: &CameraPass, depth: Depth, position: Vec3) {
        if depth.is_start() {
            let camera = &pass.scene.camera;
            self.position = position;
            self.depth = (position - camera.position()).dot(camera.direction());
            self.hits = true;
        }
    }

    fn sees(&mut self, albedo: Rgb, normal: Vec3) {
        if !self.knows_surface {
            (self.albedo, self.normal, self.knows_surface) = (albedo, normal, true);
        }
    }
}
