//! Areas of all surfaces of a scene, worked out where they are asked for.

use super::cell::Cell;
use super::cell_builder::{Maker, Own};
use super::disc::half_plane;
use super::lit_sides::Sides;
use super::patch::{Grid, Patch, Place};
use super::surfaces::{Surfaces, corners};
use super::triangle_index::Reach;
use crate::simd::dispatch::vectorized;
use crate::simd::{LANES, Mask, Vec3s, lanes_of};
use glam::Vec3;
use std::f32::consts::PI;
use std::sync::atomic::{AtomicUsize, Ordering::Relaxed};
use std::sync::{Arc, OnceLock};

/// Less than this share of the disc is taken for so much.
pub const LEAST: f32 = 0.05;

/// Facets kept together.
const CHUNK: usize = 64;

/// The area that could have sent photons to a point, for all points of a scene and spheres of up to
/// one radius.
pub struct Areas {
    ground: Arc<Ground>,
    radius: f32,
    /// Of each side of each triangle, some at a time.
    patches: Box<[OnceLock<Chunk>]>,
    kept: AtomicUsize,
    budget: usize,
}

/// What areas of any radius rest on.
struct Ground {
    surfaces: Box<dyn Surfaces>,
    sides: Sides,
    reach: Reach,
    /// Number of the first triangle of each place.
    first: Vec<u32>,
}

type Chunk = Box<[OnceLock<Box<Patch>>; CHUNK]>;

/// Sixteen points at which photons are merged.
#[derive(Clone, Copy, Debug)]
pub struct Query<'q> {
    /// Where they are.
    pub position: &'q Vec3s,
    /// The sides of triangles that they are on, by [`Areas::facet`].
    pub facet: &'q [u32; LANES],
    /// Which of them there are.
    pub wanted: &'q Mask,
}

/// Bytes that [`Areas`] take.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Memory {
    /// From the beginning.
    pub fixed: usize,
    /// For what was worked out so far.
    pub kept: usize,
}

impl Areas {
    /// For spheres of up to `radius`, keeping what takes up to about `budget` bytes; what does not fit is
    /// worked out each time it is asked for, with the same result.
    pub fn new(surfaces: Box<dyn Surfaces>, sides: Sides, radius: f32, budget: usize) -> Self {
        let reach = Reach::new(&*surfaces);
        let mut first = vec![0];
        for place in surfaces.places() {
            let count = surfaces.mesh(place.mesh).triangles.len();
            first.push(first[first.len() - 1] + count as u32);
        }
        Self::on(Arc::new(Ground { surfaces, sides, reach, first }), radius, budget)
    }

    /// The same surfaces for another radius.
    #[must_use]
    pub fn at(&self, radius: f32) -> Self {
        Self::on(Arc::clone(&self.ground), radius, self.budget)
    }

    fn on(ground: Arc<Ground>, radius: f32, budget: usize) -> Self {
        let facets = 2 * ground.first[ground.first.len() - 1] as usize;
        Self {
            ground,
            radius,
            patches: (0..facets.div_ceil(CHUNK)).map(|_| OnceLock::new()).collect(),
            kept: AtomicUsize::new(0),
            budget,
        }
    }

    /// Number of the side of a triangle.
    #[inline]
    pub fn facet(&self, place: u32, triangle: u32, front: bool) -> u32 {
        2 * (self.ground.first[place as usize] + triangle) + u32::from(!front)
    }

    /// The same by the numbers that gather points keep; see [`TriangleSide`](crate::scene::diffuse::TriangleSide).
    #[inline(always)] // vectorized
    pub fn number(&self, mesh: u32, side: u32) -> u32 {
        2 * self.ground.first[mesh as usize] + side
    }

    /// Largest radius that can be asked for.
    pub fn radius(&self) -> f32 {
        self.radius
    }

    /// Bytes that are kept at the most, about.
    pub fn budget(&self) -> usize {
        self.budget
    }

    /// Bytes taken.
    pub fn memory(&self) -> Memory {
        let Ground { sides, reach, first, .. } = &*self.ground;
        let fixed =
            reach.bytes() + sides.bytes() + 4 * first.capacity() + size_of_val(&*self.patches);
        Memory { fixed, kept: self.kept.load(Relaxed) }
    }

    /// Areas in spheres of these radii around points, scene units squared.
    pub fn areas<const N: usize>(&self, query: &Query, radii: &[f32; N]) -> [[f32; LANES]; N] {
        vectorized(
            #[inline(always)]
            |_| self.areas_vectorized(query, radii),
        )
    }

    #[inline(always)] // vectorized
    fn areas_vectorized<const N: usize>(
        &self,
        query: &Query,
        radii: &[f32; N],
    ) -> [[f32; LANES]; N] {
        let radii2 = radii.map(|radius| (radius / self.radius) * (radius / self.radius));
        let mut height = [2.0; LANES];
        // Step by step for all points, so that their waits for memory overlap.
        let mut patches = [None; LANES];
        for (lane, patch) in patches.iter_mut().enumerate() {
            if query.wanted[lane] {
                *patch = self.patch(query.facet[lane]);
            }
        }
        let (mut at, mut cells) = ([[0.0; 2]; LANES], [None; LANES]);
        for lane in 0..LANES {
            if let Some(patch) = patches[lane] {
                let place = patch.grid().place(patch.local(query.position.get(lane)));
                at[lane] = place.at;
                cells[lane] = patch.grid().known(place.index).get();
            }
        }
        let (mut lists, mut others, mut touched) = (0, 0, 0.0);
        for lane in 0..LANES {
            match cells[lane] {
                Some(Cell::Line { toward, offset }) => {
                    let [x, y] = at[lane];
                    height[lane] = offset + (toward[0] * x + toward[1] * y);
                }
                Some(Cell::List(list)) => {
                    lists |= 1 << lane;
                    touched += list.touch();
                }
                _ => others |= u32::from(query.wanted[lane]) << lane,
            }
        }
        std::hint::black_box(touched);
        let mut listed = [[0.0; N]; LANES];
        for lane in lanes_of(lists) {
            if let Some(Cell::List(list)) = cells[lane] {
                listed[lane] = list.areas(at[lane], &radii2);
            }
        }
        for lane in lanes_of(others) {
            listed[lane] = self.elsewhere(query.facet[lane], query.position.get(lane), &radii2);
        }
        let mut areas = [[0.0; LANES]; N];
        for (areas, radius2) in areas.iter_mut().zip(radii2) {
            for lane in 0..LANES {
                // Points are on the surface, however coordinates were rounded.
                areas[lane] = half_plane(height[lane].max(0.0), radius2);
            }
        }
        for lane in lanes_of(lists | others) {
            for (areas, listed) in areas.iter_mut().zip(listed[lane]) {
                areas[lane] = listed;
            }
        }
        let unit = self.radius * self.radius;
        for (areas, radius2) in areas.iter_mut().zip(radii2) {
            for area in areas {
                *area = area.max(LEAST * PI * radius2) * unit;
            }
        }
        areas
    }

    /// A patch that is kept.
    #[inline(always)] // vectorized
    fn patch(&self, facet: u32) -> Option<&Patch> {
        let (chunk, own) = (facet as usize / CHUNK, facet as usize % CHUNK);
        self.patches[chunk].get()?[own].get().map(|patch| &**patch)
    }

    /// Where it is not known, or no simple list.
    #[inline(never)] // keeps the common case short
    fn elsewhere<const N: usize>(&self, facet: u32, position: Vec3, radii2: &[f32; N]) -> [f32; N] {
        let Some(own) = self.own(facet) else { return radii2.map(|radius2| PI * radius2) };
        let make = || {
            let surfaces = &*self.ground.surfaces;
            let place = &surfaces.places()[own.place as usize];
            let corners = corners(surfaces, place, own.triangle);
            Box::new(Patch::new(corners, own.normal, self.radius.into()))
        };
        let slot = || {
            let chunk = self.patches[facet as usize / CHUNK].get_or_init(|| {
                self.kept.fetch_add(CHUNK * size_of::<OnceLock<Box<Patch>>>(), Relaxed);
                Box::new([const { OnceLock::new() }; CHUNK])
            });
            &chunk[facet as usize % CHUNK]
        };
        let made;
        let patch = match self.patch(facet) {
            Some(patch) => patch,
            None if self.has_room() => slot().get_or_init(|| {
                let patch = make();
                self.kept.fetch_add(patch.bytes(), Relaxed);
                patch
            }),
            None => {
                made = make();
                &made
            }
        };
        self.in_grid(&own, patch.grid(), patch.local(position), radii2)
    }

    fn in_grid<const N: usize>(
        &self,
        own: &Own,
        grid: &Grid,
        local: [f32; 2],
        radii2: &[f32; N],
    ) -> [f32; N] {
        let Place { index, at } = grid.place(local);
        let make = || {
            let Ground { surfaces, sides, reach, .. } = &*self.ground;
            let maker = Maker { surfaces: &**surfaces, sides, reach, radius: self.radius.into() };
            maker.cell(own, grid, index)
        };
        let made;
        let cell = match grid.known(index).get() {
            Some(cell) => cell,
            None if self.has_room() => grid.known(index).get_or_init(|| {
                let cell = make();
                self.kept.fetch_add(cell.bytes(), Relaxed);
                cell
            }),
            None => {
                made = make();
                &made
            }
        };
        match cell {
            Cell::Line { toward, offset } => {
                let height = offset + (toward[0] * at[0] + toward[1] * at[1]);
                radii2.map(|radius2| half_plane(height.max(0.0), radius2))
            }
            Cell::List(list) => list.areas(at, radii2),
            Cell::Holed(list) => list.areas(&*self.ground.surfaces, self.radius, at, radii2),
            Cell::Split(grid) => self.in_grid(own, grid, local, radii2),
        }
    }

    /// Whether more may be kept.
    fn has_room(&self) -> bool {
        self.kept.load(Relaxed) < self.budget
    }

    /// The side of a triangle of this number; `None` if it has no area.
    fn own(&self, facet: u32) -> Option<Own> {
        let Ground { surfaces, sides, first, .. } = &*self.ground;
        let number = facet / 2;
        let place = first.partition_point(|&first| first <= number) - 1;
        let (place, triangle) = (place as u32, number - first[place]);
        let normal = surfaces.normal(place, triangle);
        let front = facet.is_multiple_of(2);
        let side = sides.of(place, triangle, front);
        let holes = surfaces.has_holes(place);
        let normal = if front { normal } else { -normal };
        (normal != Vec3::ZERO).then_some(Own { place, triangle, normal, side, holes })
    }
}
