//! MIS partials of camera paths, and the MIS weights of connections and of emission after rough lobes.

use super::CameraPaths;
use super::non_diffuse::PathVertex;
use crate::base::math::luminance;
use crate::scene::bsdf::{BsdfSample, Lobe, Vertex};
use crate::scene::diffuse::{DiffuseVertices, Facet};
use crate::scene::{LightSample, LightSamples, Lights, Scene, Surface};
use crate::simd::{LANES, Mask, Vec3s, any};
use crate::transport::gather::GatherView;
use crate::transport::mis::densities::{Directions, PathKind};
use crate::transport::path_state::PathStates;
use glam::Vec3;
use std::array::from_fn;

impl CameraPaths {
    /// Multiplies the contributions of connections from Lambertian vertices by their MIS weights.
    #[inline(always)] // vectorized, as the functions below
    pub(super) fn weight_connections(
        &self,
        scene: &Scene,
        at: &DiffuseVertices,
        states: &PathStates,
        light: &LightSamples,
        contributions: &mut Vec3s,
    ) {
        let is_second: Mask = from_fn(|lane| states.depth[lane].diffuse() == 1);
        let Some(mis) = self.mis.filter(|_| any(&is_second)) else { return };
        let partials = self.partials_of(&states.path);
        let inverse_start = scene.lights().start().recip();
        for lane in 0..LANES {
            let cos = light.wi.get(lane).dot(at.normal.get(lane)).abs();
            // theory.md (47b), `l`
            let l =
                luminance(light.irradiance.get(lane)) * cos * inverse_start / light.relative[lane];
            let density = PathKind::Light.lambertian(at.albedo.get(lane).max_element());
            let weight = mis.balance.connection_weight(partials[lane] * density, l);
            let weight = if is_second[lane] { weight } else { 1.0 };
            contributions.set(lane, contributions.get(lane) * weight);
        }
    }

    /// The partials of these paths; meaningless for lanes without a path.
    #[inline(always)]
    fn partials_of(&self, path: &[u32; LANES]) -> [f32; LANES] {
        path.map(|path| self.mis_partials.get(path as usize).copied().unwrap_or(0.0))
    }

    /// Sets the partials of the last packet of Lambertian gather points, and of their paths.
    #[inline(always)]
    pub(super) fn set_point_partials(
        &mut self,
        at: &DiffuseVertices,
        path: &[u32; LANES],
        vertex: &[u32; LANES],
    ) {
        let Some(mis) = self.mis else { return };
        let (of_paths, mut onward) = (self.partials_of(path), [0.0; LANES]);
        let mut partials = [0.0; LANES];
        for lane in 0..LANES {
            let albedo = at.albedo.get(lane).max_element();
            let camera = PathKind::Camera.lambertian(albedo);
            let second = of_paths[lane] * PathKind::Light.lambertian(albedo);
            onward[lane] = mis.balance.toward_second(camera);
            partials[lane] = if vertex[lane] == 1 { mis.balance.at_first(camera) } else { second };
        }
        self.gather_points.set_mis_partials(&partials);
        for lane in 0..LANES {
            if at.active[lane] & (vertex[lane] == 1) {
                self.mis_partials[path[lane] as usize] = onward[lane];
            }
        }
    }

    /// MIS weight of a connection from the lobes of one class at any vertex.
    pub(super) fn connection_weight(
        &self,
        lights: &Lights,
        vertex: &PathVertex,
        lobe: Lobe,
        light: &LightSample,
    ) -> f32 {
        let PathVertex { surface, at, state } = *vertex;
        if lobe == Lobe::Rough {
            let density = surface.bsdf.pdf_w(lobe, at, light.wi);
            // theory.md (47i)
            return (1.0 + density * light.inverse_pdf_w).recip();
        }
        let Some(mis) = self.mis.filter(|_| state.depth.diffuse() == 1) else { return 1.0 };
        let view = GatherView { bsdf: surface.bsdf, at: *at, interpolated: surface.interpolated };
        let density = view.light_density(light.wi, surface.normal);
        let earlier = self.mis_partials[state.path as usize] * density;
        let l = emission_over_connection(lights, light, surface.normal);
        mis.balance.connection_weight(earlier, l)
    }

    /// Updates the partial of a path that continues from any vertex.
    pub(super) fn update_partial(&mut self, vertex: &PathVertex, sample: &BsdfSample) {
        let Some(mis) = self.mis else { return };
        let PathVertex { surface, at, state } = *vertex;
        if state.depth.diffuse() == 0 {
            self.rough_vertices[state.path as usize] = RoughVertex::new(surface, at, sample);
        }
        let partial = &mut self.mis_partials[state.path as usize];
        if !sample.lobe.passes_through() {
            let density = PathKind::Camera.density(&surface.bsdf, at, sample.wi);
            *partial = mis.balance.toward_second(density);
        } else if state.depth.diffuse() == 1 {
            let directions = Directions { camera: surface.wo, light: sample.wi };
            *partial *= directions.light_over_camera(surface, sample.lobe);
        }
    }
}

/// Last vertex of a camera path before any diffuse vertex, if it took a rough lobe there. The light that it hits can
/// be connected from that vertex, too.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct RoughVertex {
    position: Vec3,
    /// Normal on the side that can be lit, if only one can.
    normal: Option<Vec3>,
    /// Density of the path's direction, 1/sr; 0 unless it took a rough lobe.
    pdf_w: f32,
}

impl RoughVertex {
    /// The vertex where a path continues from this surface.
    fn new(surface: &Surface, at: &Vertex, sample: &BsdfSample) -> Self {
        if sample.lobe != Lobe::Rough {
            return Self::default();
        }
        let pdf_w = surface.bsdf.pdf_w(Lobe::Rough, at, sample.wi);
        Self { position: surface.position, normal: surface.lit_side(), pdf_w }
    }

    /// MIS weight of light that the path hits; `connection` computes the density of connecting it.
    /// theory.md (47i)
    fn weight(&self, connection: impl FnOnce(&Self) -> f32) -> f32 {
        if self.pdf_w > 0.0 { self.pdf_w / (self.pdf_w + connection(self)) } else { 1.0 }
    }
}

impl CameraPaths {
    /// MIS weight of emission that a path hits before its first diffuse vertex.
    #[inline(never)] // rare
    pub(super) fn emission_weight(
        &self,
        scene: &Scene,
        path: u32,
        facet: Facet,
        position: Vec3,
    ) -> f32 {
        if self.mis.is_none() {
            return 1.0;
        }
        self.rough_vertices[path as usize]
            .weight(|rough| scene.connection_pdf_w((facet, position), rough.position, rough.normal))
    }

    /// MIS weight of environment radiance that a path hits before its first diffuse vertex.
    pub(super) fn environment_weight(&self, scene: &Scene, path: u32, direction: Vec3) -> f32 {
        if self.mis.is_none() {
            return 1.0;
        }
        let lights = scene.lights();
        self.rough_vertices[path as usize]
            .weight(|rough| lights.beyond_pdf_w(direction, rough.position, rough.normal))
    }
}

/// Density of emission from a light source over the density of connections with it, at a surface of the unit normal
/// `normal`: theory.md (47b), `l`.
fn emission_over_connection(lights: &Lights, light: &LightSample, normal: Vec3) -> f32 {
    let cos = light.wi.dot(normal).abs();
    luminance(light.irradiance) * cos / (lights.start() * light.relative)
}
