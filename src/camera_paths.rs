//! Camera phase: traces camera paths breadth-first, connects them to the lights and leaves the
//! points at which photons are gathered.

use crate::accel::{Coherence, Hit, Intersect, Ray};
use crate::bsdf::{Lobe, Transport, Vertex, Wanted};
use crate::diffuse::{DiffusePoint, DiffuseVertices};
use crate::flight::Flight;
use crate::gather::{GatherPoint, GatherView};
use crate::lanes::{LANES, Rngs, vectorized};
use crate::math::Rgb;
use crate::rng::{Rng, StreamKey, camera_path_index};
use crate::scene::{LightSample, Scene, Surface, View};
use crate::settings::{Direct, Roulette, Settings};
use glam::Vec3;

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
    segments: Flight<Walk>,
    /// The next segments, in the order in which they are found.
    next: Flight<Walk>,
    hits: Vec<Hit>,
    shadow_rays: Vec<Ray>,
    /// Path and contribution of each shadow ray.
    connections: Vec<(u32, Rgb)>,
    occluded: Vec<bool>,
    /// For putting gather points in order: these, and where those of each path go.
    unordered: Vec<GatherPoint>,
    places: Vec<u32>,
}

/// A path under way.
#[derive(Clone, Copy, Debug, Default)]
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
        vectorized(
            #[inline(always)]
            || self.start(pass, paths),
        );
        // Neighboring camera paths stay close up to their first vertex.
        let mut coherence = Coherence::Coherent;
        while self.segments.len() > 0 {
            self.rays += self.segments.len() as u64;
            self.hits.resize(self.segments.len(), Hit::MISS);
            pass.accel.closest_hits(self.segments.rays(), &mut self.hits, coherence);
            vectorized(
                #[inline(always)]
                || self.scatter(pass),
            );
            self.add_connections(pass.accel, coherence);
            coherence = Coherence::Incoherent;
        }
        if !self.gather_points.is_sorted_by_key(|point| point.path) {
            self.order_by_path();
        }
    }

    /// Breadth-first order to path order; points of a path stay in theirs (a counting sort).
    fn order_by_path(&mut self) {
        self.places.clear();
        self.places.resize(self.direct.len() + 1, 0);
        for point in &self.gather_points {
            self.places[point.path as usize + 1] += 1;
        }
        let mut sum = 0;
        for place in &mut self.places {
            sum += *place;
            *place = sum;
        }
        std::mem::swap(&mut self.gather_points, &mut self.unordered);
        self.gather_points.clone_from(&self.unordered);
        for point in &self.unordered {
            let place = &mut self.places[point.path as usize];
            self.gather_points[*place as usize] = *point;
            *place += 1;
        }
    }

    #[inline(always)] // vectorized
    fn start(&mut self, pass: &CameraPass, paths: impl Iterator<Item = CameraPathId>) {
        self.segments.clear();
        self.gather_points.clear();
        self.views.clear();
        let mut paths = paths.fuse();
        loop {
            let (mut count, mut rngs) = (0, Rngs::default());
            let [mut x, mut y] = [[0.0; LANES]; 2];
            for id in paths.by_ref().take(LANES) {
                let pixel = id.y * pass.settings.width + id.x;
                rngs.set(count, pass.key.rng(camera_path_index(pixel, id.index)));
                (x[count], y[count]) = (id.x as f32, id.y as f32);
                count += 1;
            }
            if count == 0 {
                break;
            }
            let offsets = [rngs.next_1d(), rngs.next_1d()];
            for lane in 0..LANES {
                x[lane] += offsets[0][lane];
                y[lane] += offsets[1][lane];
            }
            let start = self.segments.len();
            for lane in 0..count {
                let (_, walk) = self.segments.add();
                walk.rng = rngs.get(lane);
                walk.throughput = Rgb::ONE;
                walk.inverse_weight = 1.0;
                walk.path = (start + lane) as u32;
                walk.vertices = 0;
                walk.passed = 0;
            }
            if pass.view.has_aperture() {
                for lane in 0..count {
                    let (ray, walk) = self.segments.at(start + lane);
                    let weight;
                    (*ray, weight) = pass.view.ray(x[lane], y[lane], walk.rng.next_2d());
                    (walk.throughput, walk.inverse_weight) = (Rgb::splat(weight), weight.recip());
                }
            } else {
                let directions = pass.view.pinhole_directions(&x, &y);
                for lane in 0..count {
                    *self.segments.at(start + lane).0 =
                        Ray::new(pass.view.position, directions.get(lane));
                }
            }
        }
        self.direct.clear();
        self.direct.resize(self.segments.len(), Rgb::ZERO);
    }

    /// At the hits: emission, connection, gathering, and the next segment.
    #[inline(always)] // vectorized
    fn scatter(&mut self, pass: &CameraPass) {
        let mut vertices = DiffuseVertices::default();
        self.next.clear();
        for i in 0..self.segments.len() {
            let (ray, hit) = (&self.segments.rays()[i], self.hits[i]);
            if hit.is_miss() {
                self.leave(pass, i);
                continue;
            }
            let Some(point) = pass.scene.plain(ray, &hit).or_else(|| self.elsewhere(pass, i))
            else {
                continue;
            };
            let Walk { rng, throughput, path, vertices: before, .. } = self.segments.walks()[i];
            // Emission hit later is carried by connections or photons.
            if before == 0 && point.emission != Rgb::ZERO {
                self.direct[path as usize] += throughput * point.emission;
            }
            vertices.push(i, &point, throughput, rng);
            if vertices.is_full() {
                self.scatter_diffuse(pass, &mut vertices);
            }
        }
        self.scatter_diffuse(pass, &mut vertices);
        std::mem::swap(&mut self.segments, &mut self.next);
    }

    /// What path `i` hit where that is not plain: a diffuse point is told, another done with.
    #[inline(never)] // keeps the loop over plain vertices short
    fn elsewhere(&mut self, pass: &CameraPass, i: usize) -> Option<DiffusePoint> {
        let surface = pass.scene.surface(&self.segments.rays()[i], &self.hits[i]);
        let diffuse = surface.diffuse();
        if diffuse.is_none()
            && let Some(next) = self.scatter_other(pass, &surface, self.segments.walks()[i])
        {
            let (ray, walk) = self.next.add();
            (*ray, *walk) = next;
        }
        diffuse
    }

    /// Connects and gathers at diffuse vertices, and goes on from those that are not the last.
    #[inline(always)] // vectorized
    fn scatter_diffuse(&mut self, pass: &CameraPass, at: &mut DiffuseVertices) {
        let Settings { direct, merge_vertex, camera_roulette, .. } = *pass.settings;
        if direct == Direct::Connect {
            self.connect_diffuse(pass, at);
        }
        let mut any_goes_on = false;
        for (lane, walk) in at.lanes() {
            let Walk { path, vertices, .. } = self.segments.walks()[walk];
            let (position, normal) = (at.position.get(lane), at.normal.get(lane));
            let weight = at.weight(lane);
            let (vertex, view) = (vertices + 1, GatherPoint::NO_VIEW);
            any_goes_on |= vertex < merge_vertex;
            if vertex == merge_vertex || pass.gather_early {
                self.gather_points.push(GatherPoint {
                    position,
                    path,
                    weight,
                    vertex,
                    normal,
                    view,
                });
            }
        }
        if any_goes_on {
            let directions = at.sample();
            let ends = match camera_roulette {
                Roulette::Albedo => at.rng.next_1d(),
                Roulette::Weight => [0.0; LANES],
            };
            for (lane, walk) in at.lanes() {
                let before = &self.segments.walks()[walk];
                let (off_surface, albedo) = (at.off_surface.get(lane), at.albedo.get(lane));
                let survival = match camera_roulette {
                    Roulette::Albedo => albedo.max_element().min(1.0),
                    Roulette::Weight => 1.0,
                };
                let vertices = before.vertices + 1;
                if vertices < merge_vertex && albedo != Rgb::ZERO && ends[lane] < survival {
                    let (ray, walk) = self.next.add();
                    *ray = Ray::new(off_surface, directions.get(lane));
                    walk.rng = at.rng.get(lane);
                    walk.throughput = at.carried.get(lane) * (albedo / survival);
                    walk.inverse_weight = before.inverse_weight;
                    walk.path = before.path;
                    walk.vertices = vertices;
                    walk.passed = before.passed;
                }
            }
        }
        at.clear();
    }

    /// Connects diffuse vertices with one light each.
    #[inline(always)]
    fn connect_diffuse(&mut self, pass: &CameraPass, at: &mut DiffuseVertices) {
        let light = pass.scene.lights.connect_all(at);
        let contributions = at.contributions(&light);
        for (lane, walk) in at.lanes() {
            let contribution = contributions.get(lane);
            if contribution != Rgb::ZERO {
                let path = self.segments.walks()[walk].path;
                let off_surface = at.off_surface.get(lane);
                self.send_shadow_ray(path, contribution, light.target.get(lane), off_surface);
            }
        }
    }

    /// Where path `i` left the scene: emission from all around, if nothing else carries it.
    #[inline(never)] // keeps the loop over diffuse vertices short
    fn leave(&mut self, pass: &CameraPass, i: usize) {
        let walk = &self.segments.walks()[i];
        if walk.vertices == 0 {
            let direction = self.segments.rays()[i].direction;
            let beyond = pass.scene.lights.beyond(direction);
            self.direct[walk.path as usize] += walk.throughput * beyond;
        }
    }

    /// At a surface that is not diffuse alone; the next segment unless the path ends.
    fn scatter_other(
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
        let merges = self.at_other_vertex(pass, surface, &mut walk);
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

    /// Connects and gathers where the BSDF depends on the direction of light; whether it merges.
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
            self.gather(pass, surface, walk, view);
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
            let contribution = walk.throughput * value * light.irradiance * cos_theta;
            let start = surface.start(light.wi);
            self.send_shadow_ray(walk.path, contribution, light.target, start);
        }
    }

    /// Leaves a point at which photons are gathered with the BSDF in one of `views`.
    fn gather(&mut self, pass: &CameraPass, surface: &Surface, walk: &Walk, view: u32) {
        let vertex = walk.vertices + 1;
        if vertex < pass.settings.merge_vertex && !pass.gather_early {
            return;
        }
        let Surface { position, normal, .. } = *surface;
        let (path, weight) = (walk.path, walk.throughput);
        self.gather_points.push(GatherPoint { position, path, weight, vertex, normal, view });
    }

    /// Adds this to a path if nothing is between a point on a light and a vertex.
    #[inline]
    fn send_shadow_ray(&mut self, path: u32, contribution: Rgb, target: Vec3, off_surface: Vec3) {
        // From the light: shadow rays to one point then share their origin.
        self.shadow_rays.push(Ray::segment(target, off_surface));
        self.connections.push((path, contribution));
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
