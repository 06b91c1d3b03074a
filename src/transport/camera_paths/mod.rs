//! Camera phase: traces camera paths breadth-first, connects them to the lights and leaves the
//! points at which photons are gathered.

mod connections;
mod non_diffuse;
mod aov;
mod mis;

pub use aov::Told;

use super::gather::{GatherPoints, GatherView};
use super::mis::Mis;
use super::path_queue::Flight;
use super::path_state::{Walks, at_other_surface};
use crate::accel::{Coherence, HitPacket, Intersect};
use crate::base::math::Rgb;
use crate::base::rng::{StreamKey, camera_path_index};
use crate::scene::diffuse::{DiffuseVertices, TriangleSide};
use crate::scene::{HitScratch, Scene, Surface, View};
use crate::settings::{Direct, Roulette, Settings};
use crate::simd::dispatch::{Simd, vectorized};
use crate::simd::{LANES, Mask, Vec3s, any, lanes_of};
use connections::Connections;
use mis::Rough;
use std::mem;

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

/// Camera paths that are merged together, traced batch by batch; the buffers serve many in turn.
#[derive(Clone, Debug, Default)]
pub struct CameraPaths {
    /// `D_j` of each path: emission seen and light connected, W/(m^2 sr).
    pub direct: Vec<Rgb>,
    /// Those of one path are in the order of its vertices.
    pub gather_points: GatherPoints,
    /// What some gather points refer to.
    pub views: Vec<GatherView>,
    /// Rays traced so far, over all batches.
    pub rays: u64,
    segments: Flight<Walks, 16>,
    /// The next segments, in the order in which they are found.
    next: Flight<Walks, 16>,
    hits: Vec<HitPacket>,
    shadow_rays: Flight<Connections, 10>,
    occluded: Vec<Mask>,
    /// How paths are weighted, if they are.
    mis: Option<Mis>,
    /// What each path carries of its weight from its first diffuse vertex on.
    parts: Vec<f32>,
    /// Where light could be connected that each path hits.
    roughs: Vec<Rough>,
    /// What each path tells of itself, if they are to.
    pub told: Vec<Told>,
    tells: bool,
}

impl CameraPaths {
    /// Camera paths to trace at a time: enough to fill ray packets, few enough to stay in the
    /// second-level cache.
    pub const BATCH: usize = 2048;

    /// Takes all out.
    pub fn clear(&mut self) {
        self.direct.clear();
        self.gather_points.clear();
        self.views.clear();
    }

    /// Traces one more batch.
    pub fn trace(&mut self, pass: &CameraPass, paths: impl Iterator<Item = CameraPathId>) {
        self.mis = Mis::new(pass.settings);
        vectorized(
            #[inline(always)]
            |simd| self.start(simd, pass, paths),
        );
        if self.mis.is_some() {
            // What was there belongs to paths before these.
            let first = self.direct.len() - self.segments.len();
            self.parts.resize(self.direct.len(), 0.0);
            self.roughs.truncate(first);
            self.roughs.resize(self.direct.len(), Rough::default());
        }
        if self.tells {
            self.prepare_telling();
        }
        // Neighboring camera paths stay close up to their first vertex.
        let mut coherence = Coherence::Coherent;
        while self.segments.len() > 0 {
            self.rays += self.segments.len() as u64;
            let count = self.segments.len();
            let rays = vectorized(
                #[inline(always)]
                |_| self.segments.rays(),
            );
            self.hits.resize(rays.len(), HitPacket::default());
            pass.accel.intersect(rays, count, &mut self.hits, coherence);
            if coherence == Coherence::Coherent && pass.scene.has_hidden_materials() {
                pass.scene.skip_hidden(pass.accel, rays, count, &mut self.hits);
            }
            vectorized(
                #[inline(always)]
                |simd| self.scatter(simd, pass),
            );
            self.add_connections(pass.accel, coherence);
            coherence = Coherence::Incoherent;
        }
    }

    #[inline(always)] // vectorized
    fn start(&mut self, simd: Simd, pass: &CameraPass, paths: impl Iterator<Item = CameraPathId>) {
        self.segments.clear();
        let before = self.direct.len();
        let mut paths = paths.fuse();
        let (origin, weight) = (Vec3s::splat(pass.view.position), Vec3s::splat(Rgb::ONE));
        let inverse_start = [1.0; LANES];
        let mut walks = Walks { origin, weight, inverse_start, ..Walks::default() };
        loop {
            let [mut x, mut y] = [[0.0; LANES]; 2];
            let mut index = [0; LANES];
            let mut count = 0;
            for id in paths.by_ref().take(LANES) {
                let pixel = id.y * pass.settings.width + id.x;
                index[count] = camera_path_index(pixel, id.index);
                (x[count], y[count]) = (id.x as f32, id.y as f32);
                count += 1;
            }
            if count == 0 {
                break;
            }
            let first = before + self.segments.len();
            for (lane, index) in index.into_iter().enumerate() {
                walks.rng.set(lane, pass.key.rng(index));
            }
            let offsets = [walks.rng.next_1d(), walks.rng.next_1d()];
            for lane in 0..LANES {
                x[lane] += offsets[0][lane];
                y[lane] += offsets[1][lane];
                walks.path[lane] = (first + lane) as u32;
            }
            if pass.view.has_aperture() {
                for lane in 0..count {
                    let (_, mut walk) = walks.get(lane);
                    let (ray, weight) = pass.view.ray(x[lane], y[lane], walk.rng.next_2d());
                    walk.weight = Rgb::splat(weight);
                    walk.inverse_start = weight.recip();
                    walks.set(lane, &ray, &walk);
                }
            } else {
                walks.direction = pass.view.pinhole_directions(&x, &y);
            }
            self.segments.append(simd, &std::array::from_fn(|lane| lane < count), &walks);
        }
        self.direct.resize(before + self.segments.len(), Rgb::ZERO);
    }

    /// At the hits: emission, connection, gathering, and the next segments.
    #[inline(always)] // vectorized
    fn scatter(&mut self, simd: Simd, pass: &CameraPass) {
        self.next.clear();
        let (segments, hits) = (mem::take(&mut self.segments), mem::take(&mut self.hits));
        let (mut walks, mut seen, mut at) = <(Walks, HitScratch, DiffuseVertices)>::default();
        for (packet, hits) in hits.iter().enumerate() {
            let count = segments.load(packet, &mut walks);
            let rest =
                pass.scene.lambertian(simd, &walks.direction, hits, count, &mut seen, &mut at);
            if rest.missed != 0 && pass.scene.lights().has_environment() {
                self.add_beyond(pass, &walks, rest.missed);
            }
            for lane in lanes_of(rest.others) {
                let (ray, walk) = walks.get(lane);
                let scatter = |surface: &Surface| self.scatter_other(pass, surface, walk);
                if let Some((ray, walk)) =
                    at_other_surface(pass.scene, &ray, &hits.get(lane), (&mut at, lane), scatter)
                {
                    self.next.push_walk(&ray, &walk);
                }
            }
            if self.tells {
                self.tell_diffuse(pass, &at, &walks);
            }
            self.scatter_diffuse(simd, pass, &at, &mut walks);
        }
        self.hits = hits;
        self.segments = mem::replace(&mut self.next, segments);
    }

    /// Connects and gathers at diffuse vertices, and goes on from those that are not the last.
    #[inline(always)] // vectorized
    fn scatter_diffuse(
        &mut self,
        simd: Simd,
        pass: &CameraPass,
        at: &DiffuseVertices,
        walks: &mut Walks,
    ) {
        let Settings { direct, merge_vertex, camera_roulette, .. } = *pass.settings;
        if at.any_emits {
            self.add_emission(pass.scene, at, walks);
        }
        let weights = at.weights(&walks.weight);
        if direct == Direct::Connect {
            let light = pass.scene.lights().connect_all(at, &mut walks.rng);
            // theory.md (42), third line
            let mut contributions = at.contributions(&weights, &light);
            if self.mis.is_some() {
                self.weigh_connections(pass.scene, at, walks, &light, &mut contributions);
            }
            self.send_shadow_rays(simd, at, &walks.path, &light.target, &contributions);
        }
        let (mut gathers, mut goes_on) = <(Mask, Mask)>::default();
        let mut vertex = [0; LANES];
        for lane in 0..LANES {
            walks.depth[lane] = walks.depth[lane].scattered();
            vertex[lane] = walks.depth[lane].diffuse();
            let last = vertex[lane] == merge_vertex;
            gathers[lane] = at.active[lane] & (last | pass.gather_early);
            goes_on[lane] = at.active[lane] & (vertex[lane] < merge_vertex);
        }
        if any(&gathers) {
            self.gather_points.push_diffuse(&gathers, at, &weights, &walks.path, &vertex);
            if self.mis.is_some() {
                self.weigh_points(at, &walks.path, &vertex);
            }
        }
        if !any(&goes_on) {
            return;
        }
        walks.origin = at.off_surface;
        walks.direction = at.sample(&mut walks.rng);
        let by_albedo = camera_roulette == Roulette::Albedo;
        let ends = if by_albedo { walks.rng.next_1d() } else { [0.0; LANES] };
        for lane in 0..LANES {
            let albedo = at.albedo.get(lane);
            // theory.md (43)
            let survival = if by_albedo { albedo.max_element().min(1.0) } else { 1.0 };
            goes_on[lane] &= (albedo != Rgb::ZERO) & (ends[lane] < survival);
            // theory.md (41)
            walks.weight.set(lane, walks.weight.get(lane) * (albedo / survival));
        }
        self.next.append(simd, &goes_on, walks);
    }

    /// Adds what diffuse surfaces emit; what is hit later is carried by connections or photons.
    #[inline(never)] // keeps the common case short
    fn add_emission(&mut self, scene: &Scene, at: &DiffuseVertices, walks: &Walks) {
        for lane in 0..LANES {
            if at.active[lane] && at.front[lane] && walks.depth[lane].diffuse() == 0 {
                let mut emission = at.emission.get(lane);
                if self.mis.is_some() {
                    let facet = TriangleSide { mesh: at.mesh[lane], side: at.side[lane] };
                    let place = (facet, at.position.get(lane));
                    emission *= self.emission_weight(scene, walks.path[lane], place);
                }
                // theory.md (42), first line
                let seen = walks.weight.get(lane) * emission;
                self.direct[walks.path[lane] as usize] += seen;
                if self.tells {
                    self.tell_emission(walks.path[lane], seen);
                }
            }
        }
    }

    /// Adds these contributions to their paths if nothing is between points on lights and vertices.
    #[inline(always)] // vectorized
    fn send_shadow_rays(
        &mut self,
        simd: Simd,
        at: &DiffuseVertices,
        path: &[u32; LANES],
        target: &Vec3s,
        contribution: &Vec3s,
    ) {
        let (mut sent, mut direction) = (at.active, Vec3s::default());
        for (lane, sent) in sent.iter_mut().enumerate() {
            *sent &= contribution.get(lane) != Rgb::ZERO;
            direction.set(lane, at.off_surface.get(lane) - target.get(lane));
        }
        // From the light: shadow rays to one point then share their origin.
        let (origin, path, contribution) = (*target, *path, *contribution);
        self.shadow_rays.append(
            simd,
            &sent,
            &Connections { origin, direction, path, contribution },
        );
    }

    /// Adds the light of all connections that nothing blocks.
    fn add_connections(&mut self, accel: &dyn Intersect, coherence: Coherence) {
        let count = self.shadow_rays.len();
        let rays = vectorized(
            #[inline(always)]
            |_| self.shadow_rays.rays(),
        );
        self.rays += count as u64;
        self.occluded.resize(rays.len(), Mask::default());
        accel.occlude(rays, count, &mut self.occluded, coherence);
        let mut connections = Connections::default();
        for (packet, occluded) in self.occluded.iter().enumerate() {
            let count = self.shadow_rays.load(packet, &mut connections);
            for (lane, occluded) in occluded.iter().enumerate().take(count) {
                // Added in any case: what is in the shadow nobody foresees.
                let contribution = connections.contribution.get(lane);
                let visible = if *occluded { Rgb::ZERO } else { contribution };
                self.direct[connections.path[lane] as usize] += visible;
                if self.tells {
                    self.told[connections.path[lane] as usize].connects(visible);
                }
            }
        }
        self.shadow_rays.clear();
    }
}
