//! How densely paths of either kind go on where they scatter, in projected solid angle: the area that they cover
//! at the next vertex then needs no cosines and distances, which cancel between both kinds.

use crate::bsdf::{Bsdf, Lobe, Transport, Vertex};
use crate::scene::Surface;
use glam::Vec3;
use std::f32::consts::FRAC_1_PI;

/// Densities below count as this one: where a path of one kind cannot go, but rounding leaves it a way.
const LEAST: f32 = 1e-9;

/// Roulette at a merging lobe. What depends on a path's throughput counts as certain, for paths of both kinds.
#[derive(Clone, Copy, Debug)]
pub struct Survival {
    /// Whether paths survive by the share that is reflected.
    pub by_albedo: bool,
    /// At most with this probability.
    pub most: f32,
}

/// Unit vectors to the next vertex of a path toward the camera and toward the light.
#[derive(Clone, Copy, Debug)]
pub struct Ways {
    /// Toward the camera.
    pub camera: Vec3,
    /// Toward the light.
    pub light: Vec3,
}

impl Survival {
    /// Density at a Lambertian surface, in all directions alike.
    #[inline(always)] // part of vector loops
    pub fn lambertian(&self, albedo: f32) -> f32 {
        let survival = if self.by_albedo { albedo.min(self.most) } else { 1.0 };
        (survival * FRAC_1_PI).max(LEAST)
    }

    /// Density of going on toward `wi` from lobes that merge.
    /// theory.md (47a)
    pub fn density(&self, bsdf: &Bsdf, at: &Vertex, wi: Vec3) -> f32 {
        let cos = wi.dot(at.normal);
        if let Some(albedo) = bsdf.diffuse_albedo(at.front) {
            return if cos > 0.0 { self.lambertian(albedo.max_element()) } else { LEAST };
        }
        let density = bsdf.pdf_w(Lobe::Diffuse, at, wi) / cos.abs().max(LEAST);
        let survival = if self.by_albedo {
            // The weight is f/density.
            (self.most * density).min(bsdf.eval_lobe(Lobe::Diffuse, at, wi).max_element())
        } else {
            density
        };
        survival.max(LEAST)
    }
}

impl Ways {
    /// Density of light paths over that of camera paths where `surface` lets both through by a lobe. After a diffuse
    /// vertex, camera paths pass through wherever they can.
    /// theory.md (47a)
    #[inline(never)] // rare
    pub fn light_over_camera(&self, surface: &Surface, lobe: Lobe) -> f32 {
        let bsdf = &surface.bsdf;
        let at_light = surface.seen_from(self.light).vertex(Transport::Flux);
        let at_camera = surface.seen_from(self.camera).vertex(Transport::Radiance);
        let chosen = bsdf.pass_prob(&at_light);
        let ratio = if lobe == Lobe::Delta {
            let refracted = self.light.dot(surface.normal) * self.camera.dot(surface.normal) < 0.0;
            let eta = if refracted { bsdf.relative_index(at_camera.front) } else { 1.0 };
            chosen / (eta * eta)
        } else {
            let density = |at: &Vertex, wi: Vec3| {
                bsdf.pdf_w(Lobe::Rough, at, wi) / wi.dot(at.normal).abs().max(LEAST)
            };
            let light = density(&at_light, self.camera);
            let camera = density(&at_camera, self.light) / bsdf.pass_prob(&at_camera).max(LEAST);
            light.max(LEAST) / camera.max(LEAST)
        };
        ratio.clamp(LEAST, LEAST.recip())
    }
}
