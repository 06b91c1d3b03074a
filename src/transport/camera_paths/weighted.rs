//! What camera paths carry of their weights, where paths are found in several ways.

use super::CameraPaths;
use crate::base::math::luminance;
use crate::bsdf::{BsdfSample, Vertex};
use crate::lanes::{LANES, Vec3s};
use crate::scene::diffuse::DiffuseVertices;
use crate::scene::{LightSample, LightSamples, Lights, Scene, Surface};
use crate::transport::gather::GatherView;
use crate::transport::mis::densities::Ways;
use crate::transport::walks::{Walk, Walks};
use glam::Vec3;

impl CameraPaths {
    /// Weighs connections from Lambertian vertices.
    #[inline(never)] // as the next: keeps the loop without weights short
    pub(super) fn weigh_connections(
        &self,
        scene: &Scene,
        at: &DiffuseVertices,
        walks: &Walks,
        light: &LightSamples,
        contributions: &mut Vec3s,
    ) {
        let Some(mis) = self.mis else { return };
        for lane in 0..LANES {
            if at.active[lane] && walks.depth[lane].diffuse() == 1 {
                let density = mis.light.lambertian(at.albedo.get(lane).max_element());
                let sample = LightSample {
                    target: light.target.get(lane),
                    wi: light.wi.get(lane),
                    irradiance: light.irradiance.get(lane),
                    relative: light.relative[lane],
                };
                let l = emission_over_connection(scene.lights(), &sample, at.normal.get(lane));
                let earlier = self.parts[walks.path[lane] as usize] * density;
                let weight = mis.balance.connection_weight(earlier, l);
                contributions.set(lane, contributions.get(lane) * weight);
            }
        }
    }

    /// Sets what the Lambertian points that were left last carry, and what their paths carry on.
    #[inline(never)]
    pub(super) fn weigh_points(
        &mut self,
        at: &DiffuseVertices,
        path: &[u32; LANES],
        vertex: &[u32; LANES],
    ) {
        let Some(mis) = self.mis else { return };
        let mut parts = [0.0; LANES];
        for lane in (0..LANES).filter(|&lane| at.active[lane]) {
            let albedo = at.albedo.get(lane).max_element();
            let of_path = &mut self.parts[path[lane] as usize];
            if vertex[lane] == 1 {
                let density = mis.camera.lambertian(albedo);
                *of_path = mis.balance.toward_second(density);
                parts[lane] = mis.balance.at_first(density);
            } else {
                parts[lane] = *of_path * mis.light.lambertian(albedo);
            }
        }
        self.gather_points.set_parts(&parts);
    }

    /// Weight of a connection from any vertex.
    pub(super) fn connection_weight(
        &self,
        lights: &Lights,
        surface: &Surface,
        (walk, at): (&Walk, &Vertex),
        light: &LightSample,
    ) -> f32 {
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
        let part = &mut self.parts[walk.path as usize];
        if !sample.lobe.passes_through() {
            let density = mis.camera.density(&surface.bsdf, at, sample.wi);
            *part = mis.balance.toward_second(density);
        } else if walk.depth.diffuse() == 1 {
            let ways = Ways { camera: surface.wo, light: sample.wi };
            *part *= ways.light_over_camera(surface, sample.lobe);
        }
    }
}

/// How much denser emission from a light hits a surface of this unit normal than connections with it, per area.
/// theory.md (47b), `l`.
fn emission_over_connection(lights: &Lights, light: &LightSample, normal: Vec3) -> f32 {
    let cos = light.wi.dot(normal).abs();
    luminance(light.irradiance) * cos / (lights.start() * light.relative)
}
