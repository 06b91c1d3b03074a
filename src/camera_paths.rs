//! Camera phase: traces camera paths breadth-first, connects them to the lights and leaves the
//! points at which photons are gathered.

use crate::accel::{Coherence, Hit, Intersect, Ray};
use crate::math::Rgb;
use crate::rng::{Rng, StreamKey, camera_path_index};
use crate::scene::{Scene, Surface, View};
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
    /// area (of the merge kernel) is multiplied with.
    pub weight: Rgb,
    /// Number of the diffuse vertex, `1..=k`: all photons are merged at `k`; before, only those that
    /// come from a light without a diffuse bounce.
    pub vertex: u32,
    /// Unit normal on the side that the camera path sees.
    pub normal: Vec3,
}

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
    /// Index within the batch.
    path: u32,
}

impl CameraPaths {
    /// Traces one batch, in place of the one before.
    pub fn trace(&mut self, pass: &CameraPass, paths: impl Iterator<Item = CameraPathId>) {
        self.start(pass, paths);
        let last = pass.settings.merge_vertex;
        for vertex in 1..=last {
            // Neighboring camera paths stay close up to their first vertex.
            let coherence = match vertex {
                1 => Coherence::Coherent,
                _ => Coherence::Incoherent,
            };
            self.rays += self.segments.len() as u64;
            self.hits.resize(self.segments.len(), Hit::MISS);
            pass.accel.closest_hits(&self.segments, &mut self.hits, coherence);
            self.scatter(pass, vertex);
            self.add_connections(pass.accel, coherence);
        }
        if last > 1 && pass.gather_early {
            // Breadth-first order to path order.
            self.gather_points.sort_unstable_by_key(|point| (point.path, point.vertex));
        }
    }

    fn start(&mut self, pass: &CameraPass, paths: impl Iterator<Item = CameraPathId>) {
        self.segments.clear();
        self.walks.clear();
        self.gather_points.clear();
        for (path, id) in paths.enumerate() {
            let pixel = id.y * pass.settings.width + id.x;
            let mut rng = pass.key.rng(camera_path_index(pixel, id.index));
            let [dx, dy] = rng.next_2d();
            let lens = if pass.view.has_aperture() { rng.next_2d() } else { [0.0; 2] };
            let (ray, weight) = pass.view.ray(id.x as f32 + dx, id.y as f32 + dy, lens);
            self.segments.push(ray);
            self.walks.push(Walk { rng, throughput: Rgb::splat(weight), path: path as u32 });
        }
        self.direct.clear();
        self.direct.resize(self.walks.len(), Rgb::ZERO);
    }

    /// At the hits that are the paths' diffuse vertices number `vertex`: emission, connection,
    /// gathering, and the next segment; paths that end are squeezed out.
    fn scatter(&mut self, pass: &CameraPass, vertex: u32) {
        let Settings { direct, camera_roulette, merge_vertex, .. } = *pass.settings;
        let last = vertex == merge_vertex;
        let mut alive = 0;
        for i in 0..self.walks.len() {
            let hit = self.hits[i];
            if hit.is_miss() {
                continue;
            }
            let mut walk = self.walks[i].clone();
            let Surface { position, normal, off_surface, front, material } =
                pass.scene.surface(&self.segments[i], &hit);

            // Emission hit later is carried by connections or photons.
            if vertex == 1 && front {
                self.direct[walk.path as usize] += walk.throughput * material.emission;
            }
            let weight = walk.throughput * material.bsdf.eval();
            if direct == Direct::Connect
                && let Some(light) = pass.scene.lights.connect(position, &mut walk.rng)
                && let cos_theta = light.wi.dot(normal)
                && cos_theta > 0.0
            {
                // From the light: shadow rays to one point then share their origin.
                self.shadow_rays.push(Ray::segment(light.target, off_surface));
                self.connections.push((walk.path, weight * light.irradiance * cos_theta));
            }
            if last || pass.gather_early {
                let path = walk.path;
                self.gather_points.push(GatherPoint { position, path, weight, vertex, normal });
            }
            if last {
                continue;
            }
            let sample = material.bsdf.sample(normal, walk.rng.next_2d());
            walk.throughput *= sample.weight;
            if camera_roulette == Roulette::Albedo {
                let survival = sample.weight.max_element().min(1.0);
                if walk.rng.next_1d() >= survival {
                    continue;
                }
                walk.throughput /= survival;
            }
            self.segments[alive] = Ray::new(off_surface, sample.wi);
            self.walks[alive] = walk;
            alive += 1;
        }
        self.segments.truncate(alive);
        self.walks.truncate(alive);
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
