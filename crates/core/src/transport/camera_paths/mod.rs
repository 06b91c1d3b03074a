//! Camera phase: traces camera paths breadth-first, connects them to the lights and stores their
//! gather points.

mod aov;
mod coated;
mod equiangular;
mod gather;
mod light_edges;
mod medium;
mod meter;
mod mis;
mod non_diffuse;
mod points;
mod role;
mod shadow_rays;
mod suffixes;

pub use aov::PathAov;

use super::gather::{GatherPoints, GatherView};
use super::light_paths::survival;
use super::mis::Mis;
use super::path_queue::PathQueue;
use super::path_state::{History, PathStates};
use super::suffix_cache::{SuffixCache, SuffixRecorder};
use crate::accel::{Coherence, HitPacket, Intersect};
use crate::base::math::Rgb;
use crate::base::rng::{StreamKey, camera_path_index};
use crate::scene::diffuse::{DiffuseVertices, TriangleSide};
use crate::scene::{HitScratch, Scene, View};
use crate::settings::Settings;
use crate::simd::dispatch::{Simd, vectorized};
use crate::simd::draw::numbers_of;
use crate::simd::{LANES, Mask, Vec3s, any};
use coated::CoatedSegments;
use light_edges::EdgePath;
pub use light_edges::LightEdges;
pub use medium::{MediumBeam, MediumPoint};
use mis::LastVertex;
pub use points::CameraPoints;
use points::FirstVertex;
use shadow_rays::Connections;
use std::{array::from_fn, mem};
pub use suffixes::CachedLight;

/// Pixel and number of a camera path, which determine its random numbers.
#[derive(Clone, Copy, Debug)]
pub struct CameraPathId {
    /// Column of its pixel.
    pub x: u32,
    /// Row of its pixel.
    pub y: u32,
    /// Number of the path within its pixel and iteration.
    pub index: u32,
}

/// Settings that all camera paths of an iteration share.
#[derive(Clone, Copy)]
pub struct CameraPass<'a> {
    /// The scene.
    pub scene: &'a Scene,
    /// The camera at the image's resolution.
    pub view: View,
    /// The scene's triangles.
    pub accel: &'a dyn Intersect,
    /// Settings of the image.
    pub settings: &'a Settings,
    /// Random streams of the iteration.
    pub key: StreamKey,
    /// Vertices before the last one gather, too; all of them if photons are those of caustics.
    pub gather_early: bool,
    /// Light sources that paths hit before a diffuse vertex are left out.
    pub hides_lights: bool,
    /// Points that the paths start from; without them their numbers are independent.
    pub points: Option<CameraPoints>,
    /// Light at which paths end.
    pub cache: Option<&'a SuffixCache>,
    /// Pixels in which several rays of a path find the light sources that it sees straight.
    pub light_edges: Option<&'a LightEdges>,
}

/// Camera paths that are merged together, traced batch by batch; buffers are reused.
#[derive(Clone, Debug, Default)]
pub struct CameraPaths {
    /// `D_j` of each path: emission seen and light connected, W/(m^2 sr).
    pub direct: Vec<Rgb>,
    /// The gather points of one path are in the order of its vertices.
    pub gather_points: GatherPoints,
    /// Surfaces of the gather points whose BSDF depends on the directions of photons.
    pub views: Vec<GatherView>,
    /// Points in media at which photons are merged.
    pub medium_points: Vec<MediumPoint>,
    /// Segments in media along which photons are merged.
    pub beams: Vec<MediumBeam>,
    /// Rays traced so far, over all batches.
    pub rays: u64,
    /// Index of the first path of the current batch. Some paths of a fisheye camera have no segment
    /// at all.
    first_path: usize,
    segments: PathQueue<PathStates, 16>,
    /// The next segments, in the order in which they are found.
    next: PathQueue<PathStates, 16>,
    hits: Vec<HitPacket>,
    /// Hits of diffuse bases with or without a coat, which wait until all are found: those whose
    /// coats are no metal, and those whose coats may be.
    coated: [PathQueue<CoatedSegments, 21>; 2],
    shadow_rays: PathQueue<Connections, 10>,
    /// Paths with the light that meters receive through panes.
    pane_light: Vec<(u32, Rgb)>,
    occluded: Vec<Mask>,
    /// Weights of all techniques; `None` if one technique samples each path after a diffuse vertex.
    mis: Option<Mis>,
    /// Weights of light that paths hit and of connections from rough lobes: those of `mis`, or of
    /// both alone before the first diffuse vertex. `None` if both never sample the same path.
    hit_weights: Option<Mis>,
    /// Last vertex of each path, with these weights.
    last_vertices: Vec<LastVertex>,
    /// Light of each path from the cache; empty without one.
    pub cached: Vec<CachedLight>,
    /// Suffixes, if recorded.
    pub suffixes: Option<SuffixRecorder>,
    /// AOVs of each path, if recorded.
    pub aovs: Vec<PathAov>,
    records_aovs: bool,
    /// Numbers of the first vertices of the current batch; none after its first segments.
    points: Vec<FirstVertex>,
    /// Paths of the current batch at edges of light sources; none after its first segments.
    edge_paths: Vec<EdgePath>,
}

impl CameraPass<'_> {
    /// Diffuse vertices are connected with light sources.
    fn connects(&self) -> bool {
        self.settings.connects()
    }

    /// Photons are merged at the diffuse vertex of this number.
    #[inline(always)] // part of a vector loop, as the function below
    fn gathers_at(&self, vertex: u32) -> bool {
        let Settings { merge_vertex, strategy, .. } = *self.settings;
        let (only_caustics, early) = (strategy.has_only_caustics(), self.gather_early);
        let is_last = (vertex == merge_vertex) & !only_caustics;
        let gathers = is_last | early & (only_caustics | (vertex < merge_vertex));
        gathers & strategy.has_photons()
    }

    /// Paths may go on from lobes that merge at the diffuse vertex of this number.
    #[inline(always)]
    fn goes_on_from(&self, vertex: u32) -> bool {
        let Settings { merge_vertex, strategy, .. } = *self.settings;
        strategy.continues() | (vertex < merge_vertex)
    }
}

impl CameraPaths {
    /// Camera paths to trace at a time: enough to fill ray packets, few enough to stay in the
    /// second-level cache.
    pub const BATCH: usize = 2048;

    /// Removes all paths.
    pub fn clear(&mut self) {
        self.direct.clear();
        self.cached.clear();
        self.gather_points.clear();
        self.views.clear();
        self.medium_points.clear();
        self.beams.clear();
    }

    /// Traces one more batch.
    pub fn trace(&mut self, pass: &CameraPass, paths: impl Iterator<Item = CameraPathId>) {
        self.mis = Mis::new(pass.settings);
        self.hit_weights = self.mis.or_else(|| {
            pass.scene.has_rough_materials().then(|| Mis::before_diffuse(pass.settings))
        });
        vectorized(
            #[inline(always)]
            |simd| self.start(simd, pass, paths),
        );
        self.start_partials();
        self.start_suffixes(pass);
        if self.records_aovs {
            self.start_aovs();
        }
        self.add_light_edges(pass);
        // Neighboring camera paths stay close up to their first vertex. Those of a meter do not.
        let mut coherence = match pass.scene.meters() {
            None => Coherence::Coherent,
            Some(_) => Coherence::Incoherent,
        };
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
            self.add_connections(pass, coherence);
            self.points.clear();
            self.edge_paths.clear();
            self.end_suffix_vertices();
            coherence = Coherence::Incoherent;
        }
    }

    #[inline(always)] // vectorized
    fn start(&mut self, simd: Simd, pass: &CameraPass, paths: impl Iterator<Item = CameraPathId>) {
        self.segments.clear();
        self.first_path = self.direct.len();
        self.points.clear();
        self.edge_paths.clear();
        let mut started = self.first_path;
        let mut paths = paths.fuse();
        let (origin, weight) = (Vec3s::splat(pass.view.position), Vec3s::splat(Rgb::ONE));
        let inverse_start = [1.0; LANES];
        let mut states = PathStates { origin, weight, inverse_start, ..PathStates::default() };
        loop {
            let [mut x, mut y] = [[0.0; LANES]; 2];
            let mut index = [0; LANES];
            let mut count = 0;
            for id in paths.by_ref().take(LANES) {
                let pixel = id.y * pass.settings.width + id.x;
                index[count] = camera_path_index(pixel, id.index);
                (x[count], y[count]) = (id.x as f32, id.y as f32);
                self.note_light_edge(pass, id, started + count);
                count += 1;
            }
            if count == 0 {
                break;
            }
            let first = started;
            started += count;
            let mut is_used = std::array::from_fn(|lane| lane < count);
            for (lane, index) in index.iter().enumerate() {
                states.rng.set(lane, pass.key.rng(*index));
            }
            let mut offsets = states.rng.next_pair();
            if let Some(points) = &pass.points {
                let [u, v] = self.start_points(points, &index, count);
                offsets = [numbers_of(&u), numbers_of(&v)];
            }
            for lane in 0..LANES {
                x[lane] += offsets[0][lane];
                y[lane] += offsets[1][lane];
                states.path[lane] = (first + lane) as u32;
            }
            if !pass.view.is_pinhole() || pass.scene.meters().is_some() {
                self.aim(pass, [&x, &y], &mut states, &mut is_used);
            } else {
                states.direction = pass.view.pinhole_directions(&x, &y);
            }
            if pass.scene.media().is_some() {
                for lane in 0..count {
                    let (at, origin) = ([x[lane], y[lane]], states.origin.get(lane));
                    let around = pass.scene.media_at_eye(pass.accel, &pass.view, at, origin);
                    states.history[lane] = History::default().within(around);
                }
            }
            self.segments.append(simd, &is_used, &states);
        }
        self.direct.resize(started, Rgb::ZERO);
    }

    /// Sets the rays of the used lanes, which start on a lens or at a meter.
    #[inline(never)] // keeps the loop over pinhole cameras short
    fn aim(
        &mut self,
        pass: &CameraPass,
        [x, y]: [&[f32; LANES]; 2],
        states: &mut PathStates,
        is_used: &mut Mask,
    ) {
        for (lane, is_used) in is_used.iter_mut().enumerate().filter(|(_, is_used)| **is_used) {
            let (_, mut state) = states.get(lane);
            let lens = state.rng.next_2d();
            let (ray, weight) = pass.scene.camera_ray(&pass.view, x[lane], y[lane], lens);
            state.weight = Rgb::splat(weight);
            state.inverse_start = weight.recip();
            states.set(lane, &ray, &state);
            // Nothing is visible outside the image circle of a fisheye.
            *is_used = weight > 0.0;
            if pass.scene.measures_irradiance() {
                self.connect_meter(pass, [x[lane], y[lane]], states, lane);
            }
        }
    }

    /// Handles all hits: adds emission, connects, stores gather points, and finds the next
    /// segments.
    #[inline(always)] // vectorized
    fn scatter(&mut self, simd: Simd, pass: &CameraPass) {
        self.next.clear();
        let (segments, mut all_hits) = (mem::take(&mut self.segments), mem::take(&mut self.hits));
        let (mut states, mut seen, mut at) = <(PathStates, HitScratch, DiffuseVertices)>::default();
        let mut others = Vec::with_capacity(LANES);
        for (packet, hits) in all_hits.iter_mut().enumerate() {
            let count = segments.load(packet, &mut states);
            let mut passed = 0;
            if let Some(media) = pass.scene.media() {
                passed = self.travel(pass, media, &mut states, hits, count);
            }
            let mut rest = pass.scene.lambertian(
                simd,
                [&states.origin, &states.direction],
                hits,
                count,
                &mut seen,
                &mut at,
            );
            rest.missed &= !passed;
            if rest.missed != 0 && pass.scene.lights().has_environment() {
                self.add_environment(pass, &states, rest.missed);
            }
            if rest.others != 0 && pass.shades_coats_together() {
                let lanes = pass.scene.coated_lanes(hits, &rest);
                rest.others &= !self.queue_coated(simd, &states, hits, lanes);
            }
            if rest.others != 0 {
                self.scatter_others(pass, &states, hits, rest.others, &mut at, &mut others);
            }
            if self.records_aovs {
                self.record_diffuse(pass, &at, &states);
            }
            if at.any_emits {
                self.add_emission(pass, &at, &states);
            }
            if pass.cache.is_some() || self.suffixes.is_some() {
                self.end_or_record(pass, &mut at, &states);
            }
            self.scatter_diffuse(simd, pass, &at, &mut states);
        }
        self.scatter_all_coated::<false>(simd, pass);
        self.scatter_all_coated::<true>(simd, pass);
        self.hits = all_hits;
        self.segments = mem::replace(&mut self.next, segments);
    }

    /// Connects and gathers at diffuse vertices, and continues the paths before their last vertex.
    #[inline(always)] // vectorized
    fn scatter_diffuse(
        &mut self,
        simd: Simd,
        pass: &CameraPass,
        at: &DiffuseVertices,
        states: &mut PathStates,
    ) {
        let (mis, lights) = (self.mis, pass.scene.lights());
        let earlier = match &mis {
            Some(mis) => self.earlier_merges(mis, at, states),
            None => [0.0; LANES],
        };
        let weights = at.weights(&states.weight);
        if pass.connects() {
            let light = self.light_samples(lights, &at.receivers(), states);
            // theory.md (42), third line
            let mut contributions = at.contributions(&weights, &light);
            if let Some(mis) = &mis {
                Self::weight_connections(
                    mis,
                    lights,
                    at,
                    states,
                    &earlier,
                    &light,
                    &mut contributions,
                );
            }
            let path = from_fn(|lane| {
                Connections::path_in(states.path[lane], states.history[lane].media())
            });
            let start = [&at.off_surface, &light.target];
            self.queue_shadow_rays(simd, &at.active, start, &path, &contributions);
        }
        let (mut gathers, mut goes_on) = <(Mask, Mask)>::default();
        let mut vertex = [0; LANES];
        for lane in 0..LANES {
            states.history[lane] = states.history[lane].scattered();
            vertex[lane] = states.history[lane].diffuse();
            gathers[lane] = at.active[lane] & pass.gathers_at(vertex[lane]);
            goes_on[lane] = at.active[lane] & pass.goes_on_from(vertex[lane]);
        }
        if any(&gathers) {
            self.gather_points.push_diffuse(&gathers, at, &weights, &states.path, &states.history);
            if let Some(mis) = &mis {
                self.set_point_partials(mis, at, &vertex, &earlier);
            }
        }
        if !any(&goes_on) {
            return;
        }
        self.continue_diffuse(simd, at, states, (&vertex, &earlier), goes_on);
    }

    /// Continues the paths that go on from diffuse vertices of these numbers. `earlier` has the
    /// densities of merges at earlier vertices.
    #[inline(always)] // vectorized
    fn continue_diffuse(
        &mut self,
        simd: Simd,
        at: &DiffuseVertices,
        states: &mut PathStates,
        (vertex, earlier): (&[u32; LANES], &[f32; LANES]),
        mut goes_on: Mask,
    ) {
        states.origin = at.off_surface;
        let numbers = self.direction_numbers(states);
        states.direction = at.sample(&numbers);
        let mis = self.mis;
        let continues = mis.is_some_and(|mis| mis.continues());
        let ends = if continues { states.rng.next_1d() } else { [0.0; LANES] };
        for (lane, goes_on) in goes_on.iter_mut().enumerate() {
            let albedo = at.albedo.get(lane);
            // theory.md (43): paths that are cut survive up to their last vertex
            let survival = if continues & (vertex[lane] > 1) { survival(albedo) } else { 1.0 };
            *goes_on &= (albedo != Rgb::ZERO) & (ends[lane] < survival);
            // theory.md (41)
            states.weight.set(lane, states.weight.get(lane) * (albedo / survival));
        }
        if let Some(mis) = &mis {
            self.leave_diffuse(mis, at, states, vertex, earlier, &goes_on);
        }
        self.next.append(simd, &goes_on, states);
    }

    /// Adds the emission of diffuse surfaces.
    #[inline(never)] // keeps the common case short
    fn add_emission(&mut self, pass: &CameraPass, at: &DiffuseVertices, states: &PathStates) {
        for lane in 0..LANES {
            let diffuse = states.history[lane].diffuse();
            let counts = self.counts_surface(pass, states.path[lane], states.history[lane]);
            if at.active[lane] && counts {
                let mut emission = at.emission.get(lane);
                if self.hit_weights.is_some() && emission != Rgb::ZERO {
                    let facet = TriangleSide { mesh: at.mesh[lane], side: at.side[lane] };
                    let segment = [at.position.get(lane), states.direction.get(lane)];
                    emission *= self.emission_weight(
                        pass.scene,
                        states.path[lane],
                        diffuse,
                        facet,
                        segment,
                    );
                }
                self.add_hit(
                    states.path[lane],
                    states.history[lane],
                    states.weight.get(lane) * emission,
                );
            }
        }
    }

    /// Returns true if surfaces of light sources that paths of this history hit contribute. Those
    /// that meters see straight are connected. Without MIS, connections and photons contribute
    /// those that are hit after the first diffuse vertex.
    fn counts_hit(&self, pass: &CameraPass, history: History) -> bool {
        let is_connected = history.is_start() && pass.scene.measures_irradiance();
        let is_hidden = pass.hides_lights && history.diffuse() == 0;
        (history.diffuse() == 0 || self.mis.is_some()) && !is_connected && !is_hidden
    }

    /// [`Self::counts_hit`] of the environment. Meters are connected with it through slabs, too.
    fn counts_environment(&self, pass: &CameraPass, history: History) -> bool {
        let is_connected = history.is_straight() && pass.scene.measures_irradiance();
        self.counts_hit(pass, history) && !is_connected
    }

    /// Adds the light source that a path of this history hits.
    fn add_hit(&mut self, path: u32, history: History, seen: Rgb) {
        // theory.md (42), first and second line
        self.direct[path as usize] += seen;
        if self.records_aovs {
            self.record_hit(path, history, seen);
        }
    }
}
