//! Where camera paths leave the scene, or hit surfaces that are not diffuse alone: one at a time.

use super::connections::Connections;
use super::{CameraPass, CameraPaths};
use crate::accel::Ray;
use crate::base::math::Rgb;
use crate::scene::bsdf::{Lobe, LobeSet, Transport, Vertex};
use crate::scene::{LightSample, Lights, Surface};
use crate::settings::{Direct, Roulette, Settings};
use crate::simd::{LANES, Vec3s, lanes_of};
use crate::transport::gather::{GatherPoint, GatherView};
use crate::transport::path_state::{WEIGHT_FLOOR, Walk, Walks};
use glam::Vec3;

impl CameraPaths {
    /// Adds what the paths that left the scene saw there, if nothing else carries it.
    #[inline(never)] // keeps the loop over Lambertian vertices short
    pub(super) fn add_beyond(&mut self, pass: &CameraPass, walks: &Walks, missed: u32) {
        for lane in lanes_of(missed).filter(|&lane| walks.depth[lane].diffuse() == 0) {
            let direction = walks.direction.get(lane);
            let mut beyond = pass.scene.lights().environment_radiance(direction);
            if self.mis.is_some() {
                beyond *= self.beyond_weight(pass.scene, walks.path[lane], direction);
            }
            // theory.md (42), second line
            let seen = walks.weight.get(lane) * beyond;
            self.direct[walks.path[lane] as usize] += seen;
            if self.tells {
                self.tell_emission(walks.path[lane], seen);
            }
        }
    }

    /// At a surface that is not diffuse alone; the next segment unless the path ends.
    pub(super) fn scatter_other(
        &mut self,
        pass: &CameraPass,
        surface: &Surface,
        mut walk: Walk,
    ) -> Option<(Ray, Walk)> {
        let Settings { camera_roulette, merge_vertex, .. } = *pass.settings;
        // Emission hit later is carried by connections or photons.
        if walk.depth.diffuse() == 0 && surface.front {
            // theory.md (42), first line
            let mut emission = surface.emission();
            if self.mis.is_some() && emission != Rgb::ZERO {
                let place = (surface.facet, surface.position);
                emission *= self.emission_weight(pass.scene, walk.path, place);
            }
            self.direct[walk.path as usize] += walk.weight * emission;
            if self.tells {
                self.tell_emission(walk.path, walk.weight * emission);
            }
        }
        let vertex = walk.depth.diffuse() + 1;
        let at = surface.vertex(Transport::Radiance);
        if self.tells {
            self.tell_other(pass, surface, (&walk, at.normal));
        }
        let merges = self.at_other_vertex(pass, surface, &mut walk);
        // Cut here, the path still goes on where the surface mirrors besides.
        let cut = merges && vertex == merge_vertex;
        let wanted = if cut { LobeSet::PassThrough } else { LobeSet::All };
        let sample = surface.bsdf.sample(&at, Transport::Radiance, wanted, &mut walk.rng)?;
        if !surface.agrees(&at, sample.wi) {
            return None;
        }
        self.carry_on(surface, (&walk, &at), &sample);
        if self.tells && sample.lobe == Lobe::Rough && walk.depth.diffuse() == 0 {
            self.tell_rough(walk.path);
        }
        // theory.md (41)
        walk.weight *= sample.weight;
        if sample.lobe.passes_through() {
            let ray = Ray::new(surface.start(sample.wi), sample.wi);
            return passes_on(&mut walk).then_some((ray, walk));
        }
        walk.depth = walk.depth.scattered();
        if camera_roulette == Roulette::Albedo {
            // theory.md (43)
            let survival = sample.weight.max_element().min(1.0);
            if walk.rng.next_1d() >= survival {
                return None;
            }
            walk.weight /= survival;
        }
        Some((Ray::new(surface.off_surface, sample.wi), walk))
    }

    /// Connects and gathers where the BSDF depends on the direction of light; whether it merges.
    fn at_other_vertex(&mut self, pass: &CameraPass, surface: &Surface, walk: &mut Walk) -> bool {
        let lights = pass.scene.lights();
        let bsdf = &surface.bsdf;
        let merges = bsdf.merges();
        let at = surface.vertex(Transport::Radiance);
        if merges && pass.settings.direct == Direct::Connect {
            let light = lights.connect(surface.receiver(), &mut walk.rng);
            self.connect_lobe(lights, surface, (walk, &at), (Lobe::Diffuse, light));
        }
        if bsdf.has_rough() && walk.depth.diffuse() == 0 {
            // Such lights cannot be hit, or, weighted, hits are not all; after a diffuse vertex photons carry such paths.
            let light = if self.mis.is_some() {
                lights.connect(surface.receiver(), &mut walk.rng)
            } else {
                lights.connect_delta(surface.receiver(), &mut walk.rng)
            };
            self.connect_lobe(lights, surface, (walk, &at), (Lobe::Rough, light));
        }
        if merges {
            self.views.push(GatherView { bsdf: *bsdf, at, interpolated: surface.interpolated });
            let view = self.views.len() as u32 - 1;
            self.gather(pass, surface, walk, view);
        }
        merges
    }

    /// Connects the lobes of one class with a light, if there is one.
    fn connect_lobe(
        &mut self,
        lights: &Lights,
        surface: &Surface,
        (walk, at): (&Walk, &Vertex),
        (lobe, light): (Lobe, Option<LightSample>),
    ) {
        if let Some(light) = light
            && surface.agrees(at, light.wi)
        {
            let value = surface.bsdf.eval_lobe(lobe, at, light.wi);
            let cos_theta = light.wi.dot(at.normal).abs();
            // theory.md (42), third and fourth line
            let mut contribution = walk.weight * value * light.irradiance * cos_theta;
            if self.mis.is_some() {
                contribution *= self.connection_weight(lights, surface, (walk, at), (lobe, &light));
            }
            let start = surface.start(light.wi);
            self.send_shadow_ray(walk.path, contribution, light.target, start);
        }
    }

    /// Leaves a point at which photons are gathered with the BSDF in one of `views`.
    fn gather(&mut self, pass: &CameraPass, surface: &Surface, walk: &Walk, view: u32) {
        let vertex = walk.depth.diffuse() + 1;
        if vertex < pass.settings.merge_vertex && !pass.gather_early {
            return;
        }
        let Surface { position, facet, normal, .. } = *surface;
        let (path, weight) = (walk.path, walk.weight);
        let point = GatherPoint { position, path, weight, vertex, normal, facet, view };
        self.gather_points.push(&point);
        if self.mis.is_some() {
            self.gather_points.set_part(self.parts[path as usize]);
        }
    }

    /// [`Self::send_shadow_rays`] for one.
    fn send_shadow_ray(&mut self, path: u32, contribution: Rgb, target: Vec3, off_surface: Vec3) {
        self.shadow_rays.push(&Connections {
            origin: Vec3s::splat(target),
            direction: Vec3s::splat(off_surface - target),
            path: [path; LANES],
            contribution: Vec3s::splat(contribution),
        });
    }
}

/// From so many vertices on that a path passed through it may end at each of them with this
/// probability: light may be caught between mirrors.
const LONG_CHAIN: u32 = 16;
const LONG_CHAIN_END: f32 = 0.1;

/// Roulette where a path passed through a vertex: whether it goes on.
fn passes_on(walk: &mut Walk) -> bool {
    walk.depth = walk.depth.passed_on();
    let share = walk.weight.max_element() * walk.inverse_start;
    // theory.md (44)
    let mut survival = (share / WEIGHT_FLOOR).min(1.0);
    if walk.depth.passed() >= LONG_CHAIN {
        survival = survival.min(1.0 - LONG_CHAIN_END);
    }
    if survival < 1.0 {
        if walk.rng.next_1d() >= survival {
            return false;
        }
        walk.weight /= survival;
    }
    true
}
