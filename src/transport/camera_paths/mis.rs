//! What camera paths carry of their weights, where paths are found in several ways.

use super::CameraPaths;
use crate::base::math::luminance;
use crate::scene::bsdf::{BsdfSample, Lobe, Vertex};
use crate::scene::diffuse::{DiffuseVertices, TriangleSide};
use crate::scene::{LightSample, LightSamples, Lights, Receiver, Scene, Surface};
use crate::simd::{LANES, Mask, Vec3s, any};
use crate::transport::gather::GatherView;
use crate::transport::mis::densities::Directions;
use crate::transport::path_state::{Walk, Walks};
use glam::Vec3;
use std::array::from_fn;

impl CameraPaths {
    /// Weighs connections from Lambertian vertices.
    #[inline(always)] // as those below: vectorized
    pub(super) fn weigh_connections(
        &self,
        scene: &Scene,
        at: &DiffuseVertices,
        walks: &Walks,
        light: &LightSamples,
        contributions: &mut Vec3s,
    ) {
        let is_second: Mask = from_fn(|lane| walks.depth[lane].diffuse() == 1);
        let Some(mis) = self.mis.filter(|_| any(&is_second)) else { return };
        let (parts, inverse_start) =
            (self.parts_of(&walks.path), scene.lights().total_power().recip());
        for lane in 0..LANES {
            let cos = light.wi.get(lane).dot(at.normal.get(lane)).abs();
            // theory.md (47b), `l`
            let l =
                luminance(light.irradiance.get(lane)) * cos * inverse_start / light.relative[lane];
            let density = mis.light.lambertian(at.albedo.get(lane).max_element());
            let weight = mis.balance.connection_weight(parts[lane] * density, l);
            let weight = if is_second[lane] { weight } else { 1.0 };
            contributions.set(lane, contributions.get(lane) * weight);
        }
    }

    /// What these paths carry; anything of numbers that are none.
    #[inline(always)]
    fn parts_of(&self, path: &[u32; LANES]) -> [f32; LANES] {
        path.map(|path| self.parts.get(path as usize).copied().unwrap_or(0.0))
    }

    /// Sets what the Lambertian points that were left last carry, and what their paths carry on.
    #[inline(always)]
    pub(super) fn weigh_points(
        &mut self,
        at: &DiffuseVertices,
        path: &[u32; LANES],
        vertex: &[u32; LANES],
    ) {
        let Some(mis) = self.mis else { return };
        let (of_paths, mut onward) = (self.parts_of(path), [0.0; LANES]);
        let mut parts = [0.0; LANES];
        for lane in 0..LANES {
            let albedo = at.albedo.get(lane).max_element();
            let camera = mis.camera.lambertian(albedo);
            let second = of_paths[lane] * mis.light.lambertian(albedo);
            onward[lane] = mis.balance.toward_second(camera);
            parts[lane] = if vertex[lane] == 1 { mis.balance.at_first(camera) } else { second };
        }
        self.gather_points.set_parts(&parts);
        for lane in 0..LANES {
            if at.active[lane] & (vertex[lane] == 1) {
                self.parts[path[lane] as usize] = onward[lane];
            }
        }
    }

    /// Weight of a connection from the lobes of a class at any vertex.
    pub(super) fn connection_weight(
        &self,
        lights: &Lights,
        surface: &Surface,
        (walk, at): (&Walk, &Vertex),
        (lobe, light): (Lobe, &LightSample),
    ) -> f32 {
        if lobe == Lobe::Rough {
            let density = surface.bsdf.pdf_w(lobe, at, light.wi);
            // theory.md (47i)
            return (1.0 + density * light.inverse_pdf_w).recip();
        }
        let Some(mis) = self.mis.filter(|_| walk.depth.diffuse() == 1) else { return 1.0 };
        let view = GatherView { bsdf: surface.bsdf, at: *at, interpolated: surface.interpolated };
        let density = view.light_density(&mis, light.wi, surface.normal);
        let earlier = self.parts[walk.path as usize] * density;
        let l = emission_over_connection(lights, light, surface.normal);
        mis.balance.connection_weight(earlier, l)
    }

    /// A path goes on from any vertex, which it reached as `walk` tells.
    pub(super) fn carry_on(
        &mut self,
        surface: &Surface,
        (walk, at): (&Walk, &Vertex),
        sample: &BsdfSample,
    ) {
        let Some(mis) = self.mis else { return };
        if walk.depth.diffuse() == 0 {
            self.roughs[walk.path as usize] = Rough::new(surface, at, sample);
        }
        let part = &mut self.parts[walk.path as usize];
        if !sample.lobe.passes_through() {
            let density = mis.camera.density(&surface.bsdf, at, sample.wi);
            *part = mis.balance.toward_second(density);
        } else if walk.depth.diffuse() == 1 {
            let ways = Directions { camera: surface.wo, light: sample.wi };
            *part *= ways.light_over_camera(surface, sample.lobe);
        }
    }
}

/// The rough lobe that a camera path came from at last, before any diffuse vertex: light that it hits could be
/// connected, too.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Rough {
    receiver: Receiver,
    /// Of the path's direction, 1/sr; 0 if it came from anywhere else.
    pdf_w: f32,
}

impl Rough {
    /// Where a path goes on from this surface.
    fn new(surface: &Surface, at: &Vertex, sample: &BsdfSample) -> Self {
        if sample.lobe != Lobe::Rough {
            return Self::default();
        }
        let pdf_w = surface.bsdf.pdf_w(Lobe::Rough, at, sample.wi);
        Self { receiver: surface.receiver(), pdf_w }
    }

    /// Weight of light that the path hits, where connections are chosen with the density of `connection`.
    /// theory.md (47i)
    fn weight(&self, connection: impl FnOnce(&Self) -> f32) -> f32 {
        if self.pdf_w > 0.0 { self.pdf_w / (self.pdf_w + connection(self)) } else { 1.0 }
    }
}

impl CameraPaths {
    /// Weight of emission that a path hits before its first diffuse vertex.
    #[inline(never)] // rare
    pub(super) fn emission_weight(
        &self,
        scene: &Scene,
        path: u32,
        (facet, position): (TriangleSide, Vec3),
    ) -> f32 {
        if self.mis.is_none() {
            return 1.0;
        }
        self.roughs[path as usize]
            .weight(|rough| scene.connection_pdf_w(facet, position, rough.receiver))
    }

    /// The same of light from beyond.
    pub(super) fn beyond_weight(&self, scene: &Scene, path: u32, direction: Vec3) -> f32 {
        if self.mis.is_none() {
            return 1.0;
        }
        let lights = scene.lights();
        self.roughs[path as usize]
            .weight(|rough| lights.environment_pdf_w(direction, rough.receiver))
    }
}

/// How much denser emission from a light hits a surface of this unit normal than connections with it, per area.
/// theory.md (47b), `l`.
fn emission_over_connection(lights: &Lights, light: &LightSample, normal: Vec3) -> f32 {
    let cos = light.wi.dot(normal).abs();
    luminance(light.irradiance) * cos / (lights.total_power() * light.relative)
}
