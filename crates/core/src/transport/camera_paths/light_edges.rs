//! Pixels at the edges of light sources that the camera sees.
//!
//! A camera path either hits a light source or passes it. Where a pixel sees a part of one, all of
//! the noise is which of both happens, since the source is far brighter than anything behind it.
//! Several rays of each path tell what share of the pixel it covers: theory.md (42a).

use super::{CameraPass, CameraPathId, CameraPaths};
use crate::accel::{Coherence, HitPacket, Intersect, Ray, RayPacket};
use crate::base::math::Rgb;
use crate::base::rng::{Rng, camera_path_index};
use crate::scene::{Emitter, Scene, Triangle, View};
use crate::simd::LANES;
use crate::transport::path_state::History;
use glam::{Vec2, Vec3};
use rayon::prelude::*;

/// Rays along each side of a pixel at an edge, the most that are affordable.
const SIDES: [u32; 3] = [4, 3, 2];

/// Rays at edges over the pixels of the image.
const MOST_RAYS: f64 = 0.5;

/// Distance of the points at which pixels of an edge are looked up, pixels.
const STEP: f32 = 0.5;

/// Distance of the point beside an edge whose visibility is tested, over that of the center.
const INSIDE: f32 = 0.1;

/// Bit of the index of a random stream that no camera path has.
const OF_EDGES: u64 = 1 << 63;

/// The pixels of an image at edges of light sources.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct LightEdges {
    width: u32,
    /// A bit for each pixel, row by row.
    pixels: Vec<u64>,
    /// Rays of a camera path along each side of its pixel.
    side: u32,
}

/// A camera path of the current batch whose pixel is at an edge.
#[derive(Clone, Copy, Debug)]
pub(super) struct EdgePath {
    /// Number of the path.
    pub path: u32,
    /// Corner of its pixel.
    pub corner: [f32; 2],
    /// Index of its random stream.
    pub index: u64,
}

impl LightEdges {
    /// The edges of the surfaces that emit, as `view` sees them in an image of this width and
    /// height. `None` if no pixel is at one, or for cameras other than pinholes, samples of the
    /// pixels, meters, and scenes with media. Which pixels these are changes no mean.
    pub fn of(
        scene: &Scene,
        accel: &dyn Intersect,
        view: &View,
        (width, height): (u32, u32),
    ) -> Option<Self> {
        let is_plain = view.is_pinhole() && view.is_of_all_pixels();
        if !is_plain || scene.meters().is_some() || scene.media().is_some() {
            return None;
        }
        let words = (width as usize * height as usize).div_ceil(u64::BITS as usize);
        let mut own = Self { width, pixels: vec![0; words], side: 1 };
        let triangles: Vec<&Triangle> =
            scene.lights().emitters().iter().flat_map(Emitter::triangles).collect();
        let seen = triangles.par_iter().map(|triangle| {
            let mut seen = Vec::new();
            visit_edges(triangle, view, Vec2::new(width as f32, height as f32), |at, target| {
                if !emissions(scene, accel, &[view.ray_to(target)]).all(|own| own == Rgb::ZERO) {
                    seen.push(at);
                }
            });
            seen
        });
        for at in seen.collect::<Vec<_>>().into_iter().flatten() {
            own.mark(at, height);
        }
        let marked: f64 = own.pixels.iter().map(|word| f64::from(word.count_ones())).sum();
        let affordable = MOST_RAYS * f64::from(width) * f64::from(height);
        let side = SIDES.into_iter().find(|side| f64::from(side * side) * marked <= affordable)?;
        (marked > 0.0).then_some(Self { side, ..own })
    }

    /// Marks the pixels within half a pixel of a point.
    fn mark(&mut self, at: Vec2, height: u32) {
        for (x, y) in [(-0.5, -0.5), (-0.5, 0.5), (0.5, -0.5), (0.5, 0.5)] {
            let [x, y] = [at.x + x, at.y + y];
            if x >= 0.0 && y >= 0.0 && x < self.width as f32 && y < height as f32 {
                let pixel = y as usize * self.width as usize + x as usize;
                self.pixels[pixel / 64] |= 1 << (pixel % 64);
            }
        }
    }

    /// Whether a pixel is at an edge.
    #[inline]
    pub fn includes(&self, x: u32, y: u32) -> bool {
        let pixel = y as usize * self.width as usize + x as usize;
        self.pixels[pixel / 64] >> (pixel % 64) & 1 == 1
    }
}

/// Visits points of the image on the edges of a triangle, at most half a pixel apart, with points
/// of the triangle beside them.
fn visit_edges(triangle: &Triangle, view: &View, size: Vec2, mut visit: impl FnMut(Vec2, Vec3)) {
    let Triangle { origin: a, edge1, edge2, .. } = *triangle;
    let [b, c] = [a + edge1, a + edge2];
    let center = (a + b + c) / 3.0;
    for ends in [[a, b], [b, c], [c, a]] {
        let Some([from, to]) = view.projected_segment(ends) else { continue };
        let Some([first, last]) = shares_within(from, to, size) else { continue };
        let length = (last - first) * (to - from).abs().max_element();
        let steps = (length / STEP).ceil().max(1.0) as u32;
        for step in 0..=steps {
            let share = first + (last - first) * step as f32 / steps as f32;
            let at = from.lerp(to, share);
            // The point of the edge that is seen there, and one beside it
            let on_edge = view.point_on_segment(ends, at);
            visit(at, on_edge.lerp(center, INSIDE));
        }
    }
}

/// The part of a line within an image and a pixel around it, as shares of its length.
fn shares_within(from: Vec2, to: Vec2, size: Vec2) -> Option<[f32; 2]> {
    let (mut first, mut last) = (0.0f32, 1.0f32);
    for axis in 0..2 {
        let (start, along) = (from[axis], to[axis] - from[axis]);
        let [one, other] = [-1.0, size[axis] + 1.0].map(|end| (end - start) / along);
        if along != 0.0 {
            (first, last) = (first.max(one.min(other)), last.min(one.max(other)));
        } else if !(-1.0..=size[axis] + 1.0).contains(&start) {
            return None;
        }
    }
    (first <= last).then_some([first, last])
}

/// A ray in each of the equal squares of a pixel.
fn rays_of_pixel(view: &View, corner: [f32; 2], side: u32, rng: &mut Rng) -> Vec<Ray> {
    let squares = (0..side).flat_map(|row| (0..side).map(move |column| [column, row]));
    squares
        .map(|square| {
            let within = rng.next_2d();
            let at =
                |axis: usize| corner[axis] + (square[axis] as f32 + within[axis]) / side as f32;
            view.ray(at(0), at(1), [0.5; 2]).0
        })
        .collect()
}

/// Radiance of the surfaces that at most sixteen camera rays hit, W/(m^2 sr); black without a hit.
fn emissions<'a>(
    scene: &'a Scene,
    accel: &'a dyn Intersect,
    rays: &'a [Ray],
) -> impl Iterator<Item = Rgb> + 'a {
    let mut hits = [HitPacket::default()];
    accel.intersect(&[RayPacket::of(rays)], rays.len(), &mut hits, Coherence::Coherent);
    rays.iter().enumerate().map(move |(lane, ray)| {
        let hit = scene.first_visible(accel, ray, hits[0].get(lane));
        if hit.is_miss() { Rgb::ZERO } else { scene.surface(ray, &hit).emission() }
    })
}

impl CameraPaths {
    /// Notes a new path of this number if its pixel is at an edge.
    #[inline]
    pub(super) fn note_light_edge(&mut self, pass: &CameraPass, id: CameraPathId, path: usize) {
        if pass.light_edges.is_some_and(|edges| edges.includes(id.x, id.y)) {
            let index = camera_path_index(id.y * pass.settings.width + id.x, id.index);
            let (path, corner) = (path as u32, [id.x as f32, id.y as f32]);
            self.edge_paths.push(EdgePath { path, corner, index });
        }
    }

    /// Adds the light sources that the new paths at their edges see straight. theory.md (42a)
    pub(super) fn add_light_edges(&mut self, pass: &CameraPass) {
        let Some(edges) = pass.light_edges.filter(|_| !pass.hides_lights) else { return };
        for number in 0..self.edge_paths.len() {
            let EdgePath { path, corner, index } = self.edge_paths[number];
            let mut rng = pass.key.rng(index | OF_EDGES);
            let rays = rays_of_pixel(&pass.view, corner, edges.side, &mut rng);
            self.rays += rays.len() as u64;
            let mut sum = Rgb::ZERO;
            for rays in rays.chunks(LANES) {
                sum += emissions(pass.scene, pass.accel, rays).sum::<Rgb>();
            }
            self.add_hit(path, History::default(), sum / rays.len() as f32);
        }
    }

    /// Whether emission of surfaces that a path hits counts: as [`Self::counts_hit`], but not again
    /// on the first segment of a path at an edge.
    pub(super) fn counts_surface(&self, pass: &CameraPass, path: u32, history: History) -> bool {
        let is_at_edge = || self.edge_paths.binary_search_by_key(&path, |own| own.path).is_ok();
        self.counts_hit(pass, history) && !is_at_edge()
    }
}
