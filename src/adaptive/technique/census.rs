//! What the areas of surfaces cost before they are known: they are worked out where they are first asked for, which
//! a scene of fine geometry pays for all along a short render.

use crate::accel::{Intersect, Ray};
use crate::base::rng::{Rng, Stream, StreamKey};
use crate::scene::{Scene, View};
use crate::settings::policy::*;
use crate::simd::{LANES, Mask, Vec3s};
use crate::transport::area::{Areas, Query};
use rayon::prelude::*;
use std::array::from_fn;
use std::hint::black_box;
use std::time::Instant;

/// Visits of a pixel that are tried.
const VISITS: usize = 4;

/// Vertices of a camera path at the most.
const MOST_VERTICES: u32 = 16;

/// What camera paths pay, on one thread, for areas that are not known yet.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Census {
    /// Seconds per pixel that its first visit takes more than if all were known.
    first: f64,
    /// The power of the number of the visit that this falls with.
    falls: f64,
    /// Visits after which no more may be kept.
    kept: f64,
}

/// What areas of surfaces cost an image before they are known.
#[derive(Clone, Debug, Default)]
pub struct Surfaces {
    /// At two radii, of each vertex at which they are asked for; none without areas.
    pub census: Vec<[(f64, Census); 2]>,
    /// Pixels of the image over threads.
    pub pixels_per_thread: f64,
}

impl Surfaces {
    /// Seconds at a reach after so many camera paths per pixel.
    pub fn cost(&self, reach: f64, visits: f64) -> f64 {
        let of = |census: &[(f64, Census); 2]| Census::between(*census, reach).cost(visits);
        self.pixels_per_thread * self.census.iter().map(of).sum::<f64>()
    }
}

/// Camera paths of blocks of an image that meet surfaces.
pub struct Ground<'a> {
    pub scene: &'a Scene,
    pub accel: &'a dyn Intersect,
    pub view: View,
    /// Of the image, pixels.
    pub resolution: [u32; 2],
    pub seed: u64,
}

/// Sixteen points.
#[derive(Clone, Copy, Default)]
struct Packet {
    position: Vec3s,
    facet: [u32; LANES],
    wanted: Mask,
}

impl Census {
    /// Thread-seconds that a pixel has cost after so many visits.
    pub fn cost(&self, visits: f64) -> f64 {
        let Self { first, falls, kept } = *self;
        // The sum of `first/v^falls` over visits, the first of them by itself; beyond those that were tried it falls
        // as `1/v` or faster, as there is an end to what can be new.
        let sum = |falls: f64, from: f64, to: f64| {
            if (falls - 1.0).abs() < 1e-6 {
                (to / from).ln()
            } else {
                (to.powf(1.0 - falls) - from.powf(1.0 - falls)) / (1.0 - falls)
            }
        };
        if visits <= 1.0 {
            return first * visits.max(0.0);
        }
        let known = visits.min(kept.max(1.0));
        let (tried, steep) = (VISITS as f64, falls.max(1.0));
        let mut rest = sum(falls, 1.0, known.min(tried));
        if known > tried {
            rest += tried.powf(steep - falls) * sum(steep, tried, known);
        }
        first * (1.0 + rest + (visits - known))
    }

    /// So many times as dear.
    #[must_use]
    pub fn times(self, factor: f64) -> Self {
        Self { first: factor * self.first, kept: self.kept / factor, ..self }
    }

    /// What the least census takes that finds it, seconds.
    pub fn least_time(&self) -> f64 {
        f64::from(BLOCK * BLOCK) * self.cost(VISITS as f64)
    }

    /// Between those of two radii, by their logarithms.
    pub fn between([low, high]: [(f64, Self); 2], radius: f64) -> Self {
        let power = |low: f64, high: f64, at: f64| -> f64 {
            if low > 0.0 && high > 0.0 { low * (high / low).powf(at) } else { low.max(high) }
        };
        let span = (high.0 / low.0).ln();
        let at = if span > 0.0 { (radius / low.0).ln() / span } else { 0.0 };
        Self {
            first: power(low.1.first, high.1.first, at),
            falls: low.1.falls + (high.1.falls - low.1.falls) * at.clamp(0.0, 1.0),
            kept: power(low.1.kept, high.1.kept, at),
        }
    }
}

impl Ground<'_> {
    /// Takes the census at the diffuse vertex `vertex` of camera paths in blocks of pixels all over the image, as many
    /// as fit in so many seconds, at least one for each thread; `areas` are new ones.
    pub fn census(&self, areas: &Areas, vertex: u32, seconds: f64) -> Census {
        let start = Instant::now();
        let threads = rayon::current_num_threads();
        let (mut blocks, mut excess) = (0, [0.0; VISITS]);
        while blocks == 0 || blocks < CENSUS_BLOCKS && start.elapsed().as_secs_f64() < seconds {
            let batch: Vec<[f64; VISITS]> = (blocks..blocks + threads)
                .into_par_iter()
                .map(|block| from_fn(|visit| self.visit(areas, vertex, block as u32, visit as u64)))
                .collect();
            for own in &batch {
                excess.iter_mut().zip(own).for_each(|(sum, own)| *sum += own);
            }
            blocks += threads;
        }
        let pixels = blocks as f64 * f64::from(BLOCK * BLOCK);
        let [first, last] = [excess[0], excess[VISITS - 1]].map(|sum| sum / pixels);
        let falls = if last > 0.0 { (first / last).ln() / (VISITS as f64).ln() } else { f64::MAX };
        // Bytes go with what is worked out.
        let [width, height] = self.resolution.map(f64::from);
        let census = Census { first, falls: falls.clamp(0.0, 4.0), kept: f64::INFINITY };
        let per_second = areas.memory().kept as f64 / (census.cost(VISITS as f64) * pixels);
        let room = areas.budget() as f64 / (per_second * width * height);
        let mut kept = 1.0;
        while census.cost(2.0 * kept) < room && kept < 1e9 {
            kept *= 2.0;
        }
        Census { kept, ..census }
    }

    /// Seconds that areas of a block take more than if they were known.
    fn visit(&self, areas: &Areas, vertex: u32, block: u32, visit: u64) -> f64 {
        let packets = self.points(areas, vertex, block, visit);
        let radii = [areas.radius()];
        let ask = || {
            let start = Instant::now();
            for Packet { position, facet, wanted } in &packets {
                black_box(areas.areas(&Query { position, facet, wanted }, &radii));
            }
            start.elapsed().as_secs_f64()
        };
        let new = ask();
        (new - ask()).max(0.0)
    }

    fn points(&self, areas: &Areas, vertex: u32, block: u32, visit: u64) -> Vec<Packet> {
        let key = StreamKey::new(self.seed, Stream::Census, visit);
        let [width, height] = self.resolution;
        // Blocks spread evenly over the image, whatever their number.
        let [left, top] =
            [(0.754_877_7, width), (0.569_840_3, height)].map(|(step, size): (f64, u32)| {
                let at = (0.5 + step * f64::from(block)).fract();
                (at * f64::from(size.saturating_sub(BLOCK))) as u32
            });
        let mut packets = Vec::new();
        let mut lane = LANES;
        for pixel in 0..BLOCK * BLOCK {
            let mut rng = key.rng(u64::from(block) << 32 | u64::from(pixel));
            let (x, y) = (left + pixel % BLOCK, top + pixel / BLOCK);
            let Some((position, facet)) = self.point(areas, vertex, [x, y], &mut rng) else {
                continue;
            };
            if lane == LANES {
                packets.push(Packet::default());
                lane = 0;
            }
            let packet = packets.last_mut().expect("one");
            packet.position.set(lane, position);
            packet.facet[lane] = facet;
            packet.wanted[lane] = true;
            lane += 1;
        }
        packets
    }

    /// Where a camera path of a pixel meets its diffuse vertex of this number.
    fn point(
        &self,
        areas: &Areas,
        vertex: u32,
        [x, y]: [u32; 2],
        rng: &mut Rng,
    ) -> Option<(glam::Vec3, u32)> {
        let [dx, dy] = [rng.next_1d(), rng.next_1d()];
        let lens = [rng.next_1d(), rng.next_1d()];
        let (mut ray, _) = self.view.ray(x as f32 + dx, y as f32 + dy, lens);
        let mut met = 0;
        for _ in 0..MOST_VERTICES {
            let hit = self.accel.closest_hit(&ray);
            if hit.is_miss() {
                return None;
            }
            let surface = self.scene.surface(&ray, &hit);
            let place = &self.scene.placements()[hit.mesh as usize];
            if self.scene.materials()[place.material as usize].bsdf.merges() {
                met += 1;
                if met == vertex {
                    let facet = areas.facet(hit.mesh, hit.triangle, surface.front);
                    return Some((ray.origin + hit.t * ray.direction, facet));
                }
            }
            let sample = surface.scatter_flux(rng)?;
            ray = Ray::new(surface.start(sample.wi), sample.wi);
        }
        None
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn costs_add_up_over_visits() {
        let census = |falls, kept| Census { first: 2.0, falls, kept };
        assert_eq!(census(1.0, f64::INFINITY).cost(0.5), 1.0);
        // All new each time as far as it was tried, then as `1/v`; and known for good after the first.
        let all_new = 2.0 * (4.0 + 4.0 * (10.0f64 / 4.0).ln());
        assert!((census(0.0, f64::INFINITY).cost(10.0) - all_new).abs() < 1e-12);
        let steep = census(4.0, f64::INFINITY).cost(1e6);
        assert!((steep - 2.0 * (1.0 + 1.0 / 3.0)).abs() < 1e-9, "{steep}");
        // Where no more is kept, all further visits cost as much as the first.
        let full = census(4.0, 1.0);
        assert!((full.cost(11.0) - 22.0).abs() < 1e-12);
    }

    #[test]
    fn between_two_radii_it_goes_by_a_power() {
        let at = |radius: f64, first: f64| (radius, Census { first, falls: 1.0, kept: 8.0 });
        let middle = Census::between([at(1.0, 1.0), at(4.0, 16.0)], 2.0);
        assert!((middle.first - 4.0).abs() < 1e-12 && middle.kept == 8.0);
        let alone = Census::between([at(1.0, 3.0), at(1.0, 3.0)], 1.0);
        assert_eq!(alone.first, 3.0);
    }
}
