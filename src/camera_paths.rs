//! Camera phase: traces camera paths breadth-first, connects them to the lights and leaves the
//! points at which photons are gathered.

use crate::accel::{Coherence, Hit, Intersect, Ray};
use crate::bsdf::{Bsdf, Lobe, Transport, Vertex, Wanted};
use crate::light_paths::Photon;
use crate::math::Rgb;
use crate::rng::{Rng, StreamKey, camera_path_index};
use crate::scene::{LightSample, Scene, Surface, View};
use crate::settings::{Direct, Roulette, Settings};
use glam::Vec3;

/// A vertex of a camera path at which photons are merged.
#[derive(Clone, Copy, Debug)]
pub struct GatherPoint {
    /// Where it is, scene units.
    pub position: Vec3,
    /// Its camera path: index within the batch.
    pub path: u32,
    /// Throughput of the path times the BSDF toward the camera, 1/sr: what a photon's flux per
    /// area (of the merge kernel) is multiplied with. The throughput alone if there is a `view`.
    pub weight: Rgb,
    /// Number of the diffuse vertex, `1..=k`: all photons are merged at `k`; before, only those that
    /// come from a light without a diffuse bounce.
    pub vertex: u32,
    /// Unit normal on the side that the camera path sees.
    pub normal: Vec3,
    /// Index in [`CameraPaths::views`], or [`GatherPoint::NO_VIEW`] if the BSDF is the same for all
    /// photons.
    pub view: u32,
}

impl GatherPoint {
    /// The BSDF does not depend on where photons come from.
    pub const NO_VIEW: u32 = u32::MAX;
}

/// A surface whose BSDF depends on where photons come from, as a camera path sees it.
#[derive(Clone, Copy, Debug)]
pub struct GatherView {
    /// How it scatters.
    pub bsdf: Bsdf,
    /// Whence it is seen.
    pub at: Vertex,
}

impl GatherView {
    /// The BSDF's value for a photon that is merged at `point`, 1/sr. Photons count by the area of
    /// the triangles, light by that of the interpolated surface.
    pub fn value(&self, photon: &Photon, point: &GatherPoint) -> Rgb {
        let wi = photon.from_as_at(point.normal);
        let areas = wi.dot(self.at.normal) / wi.dot(point.normal);
        if areas > 0.0 {
            self.bsdf.eval_lobe(Lobe::Diffuse, &self.at, wi) * areas
        } else {
            Rgb::ZERO
        }
    }
}

/// Camera paths whose throughput fell below this share play roulette where they pass through.
const WEIGHT_FLOOR: f32 = 1.0 / 16.0;

/// From so many vertices on that a path passed through it may end at each of them with this
/// probability: light may be caught between mirrors.
const LONG_CHAIN: u32 = 16;
const LONG_CHAIN_END: f32 = 0.1;

/// One camera path: where it starts and which random numbers it draws.
#[derive(Clone, Copy, Debug)]
pub struct CameraPathId {
    /// Column of its pixel.
    pub x: u32,
    /// Row of its pixel.
    pub y: u32,
    /// Number of the path within its pixel and iteration.
    pub index: u32,
}

/// What all camera paths of an iteration share.
#[derive(Clone, Copy)]
pub struct CameraPass<'a> {
    /// The scene.
    pub scene: &'a Scene,
    /// The camera at the image's resolution.
    pub view: View,
    /// The scene's triangles.
    pub accel: &'a dyn Intersect,
    /// How paths are traced.
    pub settings: &'a Settings,
    /// Random streams of the iteration.
    pub key: StreamKey,
    /// Whether vertices before the last gather as well.
    pub gather_early: bool,
}

/// Camera paths that are traced together; the buffers serve many batches in turn.
#[derive(Clone, Debug, Default)]
pub struct CameraPaths {
    /// `D_j` of each path: emission seen and light connected, W/(m^2 sr).
    pub direct: Vec<Rgb>,
    /// In the order of their paths and, along a path, of its vertices.
    pub gather_points: Vec<GatherPoint>,
    /// What some gather points refer to.
    pub views: Vec<GatherView>,
    /// Rays traced so far, over all batches.
    pub rays: u64,
    segments: Vec<Ray>,
    walks: Vec<Walk>,
    hits: Vec<Hit>,
    shadow_rays: Vec<Ray>,
    /// Path and contribution of each shadow ray.
    connections: Vec<(u32, Rgb)>,
    occluded: Vec<bool>,
}

/// A path under way.
#[derive(Clone, Debug)]
struct Walk {
    rng: Rng,
    throughput: Rgb,
    /// Reciprocal of the weight that the camera gave it.
    inverse_weight: f32,
    /// Index within the batch.
    path: u32,
    /// Diffuse vertices so far.
    vertices: u32,
    /// Vertices passed through so far.
    passed: u32,
}

impl Walk {
    /// Roulette where the path passed through a vertex: whether it goes on.
    #[inline(never)] // keeps the loop over diffuse vertices short
    fn passes_on(&mut self) -> bool {
        self.passed += 1;
        let share = self.throughput.max_element() * self.inverse_weight;
        let mut survival = (share / WEIGHT_FLOOR).min(1.0);
        if self.passed >= LONG_CHAIN {
            survival = survival.min(1.0 - LONG_CHAIN_END);
        }
        if survival < 1.0 {
            if self.rng.next_1d() >= survival {
                return false;
            }
            self.throughput /= survival;
        }
        true
    }
}

impl CameraPaths {
    /// Traces one batch, in place of the one before.
    pub fn trace(&mut self, pass: &CameraPass, paths: impl Iterator<Item = CameraPathId>) {
        self.start(pass, paths);
        // Neighboring camera paths stay close up to their first vertex.
        let mut coherence = Coherence::Coherent;
        while !self.segments.is_empty() {
            self.rays += self.segments.len() as u64;
            self.hits.resize(self.segments.len(), Hit::MISS);
            pass.accel.closest_hits(&self.segments, &mut self.hits, coherence);
            self.scatter(pass);
            self.add_connections(pass.accel, coherence);
            coherence = Coherence::Incoherent;
        }
        // Breadth-first order to path order.
        if !self.gather_points.is_sorted_by_key(|point| point.path) {
            self.gather_points.sort_unstable_by_key(|point| (point.path, point.vertex));
        }
    }

    fn start(&mut self, pass: &CameraPass, paths: impl Iterator<Item = CameraPathId>) {
        self.segments.clear();
        self.walks.clear();
        self.gather_points.clear();
        self.views.clear();
        for (path, id) in paths.enumerate() {
            let pixel = id.y * pass.settings.width + id.x;
            let mut rng = pass.key.rng(camera_path_index(pixel, id.index));
            let [dx, dy] = rng.next_2d();
            let lens = if pass.view.has_aperture() { rng.next_2d() } else { [0.0; 2] };
            let (ray, weight) = pass.view.ray(id.x as f32 + dx, id.y as f32 + dy, lens);
            self.segments.push(ray);
            self.walks.push(Walk {
                rng,
                throughput: Rgb::splat(weight),
                inverse_weight: weight.recip(),
                path: path as u32,
                vertices: 0,
                passed: 0,
            });
        }
        self.direct.clear();
        self.direct.resize(self.walks.len(), Rgb::ZERO);
    }

    /// At the hits: emission, connection, gathering, and the next segment; paths that end are
    /// squeezed out.
    fn scatter(&mut self, pass: &CameraPass) {
        let mut alive = 0;
        for i in 0..self.walks.len() {
            let hit = self.hits[i];
            if hit.is_miss() {
                self.leave(pass, i);
                continue;
            }
            let (ray, walk) = (self.segments[i], self.walks[i].clone());
            let next = match pass.scene.plain(&hit) {
                Some(bsdf) => {
                    let surface = pass.scene.plain_surface(&ray, &hit, bsdf);
                    self.scatter_at(pass, &surface, walk)
                }
                None => self.scatter_anywhere(pass, &pass.scene.surface(&ray, &hit), walk),
            };
            if let Some((ray, walk)) = next {
                self.segments[alive] = ray;
                self.walks[alive] = walk;
                alive += 1;
            }
        }
        self.segments.truncate(alive);
        self.walks.truncate(alive);
    }

    /// Where path `i` left the scene: emission from all around, if nothing else carries it.
    #[inline(never)] // keeps the loop over diffuse vertices short
    fn leave(&mut self, pass: &CameraPass, i: usize) {
        let walk = &self.walks[i];
        if walk.vertices == 0 {
            let beyond = pass.scene.lights.beyond(self.segments[i].direction);
            self.direct[walk.path as usize] += walk.throughput * beyond;
        }
    }

    /// [`Self::scatter_at`] of surfaces that are not plain.
    #[inline(never)] // the compiler then specializes the other copy for plain ones
    fn scatter_anywhere(
        &mut self,
        pass: &CameraPass,
        surface: &Surface,
        walk: Walk,
    ) -> Option<(Ray, Walk)> {
        self.scatter_at(pass, surface, walk)
    }

    /// At one hit; the next segment unless the path ends.
    #[inline(always)]
    fn scatter_at(
        &mut self,
        pass: &CameraPass,
        surface: &Surface,
        mut walk: Walk,
    ) -> Option<(Ray, Walk)> {
        let Settings { camera_roulette, merge_vertex, .. } = *pass.settings;
        // Emission hit later is carried by connections or photons.
        if walk.vertices == 0 && surface.front {
            self.direct[walk.path as usize] += walk.throughput * surface.emission();
        }
        let vertex = walk.vertices + 1;
        let merges = match surface.constant() {
            Some(value) => {
                self.connect_lambertian(pass, surface, &mut walk, value);
                self.gather(pass, surface, &walk, (value, GatherPoint::NO_VIEW));
                true
            }
            None => self.at_other_vertex(pass, surface, &mut walk),
        };
        // Cut here, the path still goes on where the surface mirrors besides.
        let cut = merges && vertex == merge_vertex;
        let wanted = if cut { Wanted::PassThrough } else { Wanted::All };
        let at = surface.vertex(Transport::Radiance);
        let sample = surface.bsdf.sample(&at, Transport::Radiance, wanted, &mut walk.rng)?;
        if !surface.agrees(&at, sample.wi) {
            return None;
        }
        walk.throughput *= sample.weight;
        if sample.lobe.passes_through() {
            let ray = Ray::new(surface.start(sample.wi), sample.wi);
            return walk.passes_on().then_some((ray, walk));
        }
        walk.vertices += 1;
        if camera_roulette == Roulette::Albedo {
            let survival = sample.weight.max_element().min(1.0);
            if walk.rng.next_1d() >= survival {
                return None;
            }
            walk.throughput /= survival;
        }
        Some((Ray::new(surface.off_surface, sample.wi), walk))
    }

    /// Connects a vertex whose BSDF is `value` in all directions.
    #[inline(always)]
    fn connect_lambertian(
        &mut self,
        pass: &CameraPass,
        surface: &Surface,
        walk: &mut Walk,
        value: Rgb,
    ) {
        if pass.settings.direct == Direct::Connect
            && let Some(light) =
                pass.scene.lights.connect(surface.position, Some(surface.normal), &mut walk.rng)
            && let cos_theta = light.wi.dot(surface.normal)
            && cos_theta > 0.0
        {
            self.send_shadow_ray(surface.off_surface, walk, &light, (value, cos_theta));
        }
    }

    /// Connects and gathers where the BSDF depends on the direction of light; whether it merges.
    #[inline(never)] // keeps the loop over diffuse vertices short
    fn at_other_vertex(&mut self, pass: &CameraPass, surface: &Surface, walk: &mut Walk) -> bool {
        let lights = &pass.scene.lights;
        let bsdf = &surface.bsdf;
        let merges = bsdf.merges();
        let lit_side = (!bsdf.transmits()).then_some(surface.normal);
        let at = surface.vertex(Transport::Radiance);
        if merges && pass.settings.direct == Direct::Connect {
            let light = lights.connect(surface.position, lit_side, &mut walk.rng);
            self.connect_lobe(surface, walk, &at, (Lobe::Diffuse, light));
        }
        if bsdf.has_rough() && walk.vertices == 0 {
            // Such lights cannot be hit; after a diffuse vertex photons carry such paths.
            let light = lights.connect_delta(surface.position, lit_side, &mut walk.rng);
            self.connect_lobe(surface, walk, &at, (Lobe::Rough, light));
        }
        if merges {
            self.views.push(GatherView { bsdf: *bsdf, at });
            let view = self.views.len() as u32 - 1;
            self.gather(pass, surface, walk, (Rgb::ONE, view));
        }
        merges
    }

    /// Connects the lobes of one class with a light, if there is one.
    fn connect_lobe(
        &mut self,
        surface: &Surface,
        walk: &Walk,
        at: &Vertex,
        (lobe, light): (Lobe, Option<LightSample>),
    ) {
        if let Some(light) = light
            && surface.agrees(at, light.wi)
        {
            let value = surface.bsdf.eval_lobe(lobe, at, light.wi);
            let cos_theta = light.wi.dot(at.normal).abs();
            self.send_shadow_ray(surface.start(light.wi), walk, &light, (value, cos_theta));
        }
    }

    /// Leaves a point at which photons are gathered, with the BSDF as a value or in one of `views`.
    #[inline]
    fn gather(
        &mut self,
        pass: &CameraPass,
        surface: &Surface,
        walk: &Walk,
        (value, view): (Rgb, u32),
    ) {
        let vertex = walk.vertices + 1;
        if vertex < pass.settings.merge_vertex && !pass.gather_early {
            return;
        }
        let weight = walk.throughput * value;
        let Surface { position, normal, .. } = *surface;
        let path = walk.path;
        self.gather_points.push(GatherPoint { position, path, weight, vertex, normal, view });
    }

    /// Connects a vertex with a point on a light, toward which its BSDF has this value and its
    /// normal this cosine.
    #[inline]
    fn send_shadow_ray(
        &mut self,
        off_surface: Vec3,
        walk: &Walk,
        light: &LightSample,
        (value, cos_theta): (Rgb, f32),
    ) {
        let contribution = walk.throughput * value * light.irradiance * cos_theta;
        // From the light: shadow rays to one point then share their origin.
        self.shadow_rays.push(Ray::segment(light.target, off_surface));
        self.connections.push((walk.path, contribution));
    }

    /// Adds the light of all connections that nothing blocks.
    fn add_connections(&mut self, accel: &dyn Intersect, coherence: Coherence) {
        self.rays += self.shadow_rays.len() as u64;
        self.occluded.resize(self.shadow_rays.len(), false);
        accel.occlusions(&self.shadow_rays, &mut self.occluded, coherence);
        for (&(path, contribution), &occluded) in self.connections.iter().zip(&self.occluded) {
            if !occluded {
                self.direct[path as usize] += contribution;
            }
        }
        self.shadow_rays.clear();
        self.connections.clear();
    }
}
