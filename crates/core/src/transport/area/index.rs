//! Areas around gather points, computed where they are asked for and kept.

use super::cell::Cell;
use super::cell_builder::{CellBuilder, GatherFacet};
use super::disc::half_plane;
use super::domain::Domain;
use super::lit_sides::Sides;
use super::patch::{CellPoint, Patch, PatchGrid};
use super::surfaces::{Surfaces, corners};
use super::triangle_index::TriangleIndex;
use crate::simd::dispatch::vectorized;
use crate::simd::{LANES, Mask, Vec3s, lanes_of};
use glam::Vec3;
use std::f32::consts::PI;
use std::sync::atomic::{AtomicU64, AtomicUsize, Ordering::Relaxed};
use std::sync::{Arc, OnceLock};
use std::time::{Duration, Instant};

/// Lower bound of an area, as a share of the disc's.
pub const MIN_SHARE: f32 = 0.05;

/// Facets kept together.
const CHUNK: usize = 64;

/// The area that could have sent photons to a point, for all points of a scene and spheres of up to
/// one radius.
///
/// Points with too much in reach have areas within smaller spheres, and points among layers have
/// those of their own layer; see [`PointAreas`].
pub struct Areas {
    shared: Arc<SharedGeometry>,
    radius: f32,
    /// Patch of each side of each triangle, in chunks.
    patches: Box<[OnceLock<Chunk>]>,
    kept: AtomicUsize,
    work: WorkCounter,
    budget: usize,
    /// How often the radius was halved.
    level: u8,
    /// Areas for half the radius, once a point needs them.
    finer: OnceLock<Box<Self>>,
}

/// Cells that were computed and kept, and the thread time that this took.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct CellWork {
    /// Number of cells, of all levels.
    pub cells: u64,
    /// Time, summed over threads.
    pub time: Duration,
}

impl CellWork {
    /// What was added to the work of an earlier moment.
    #[must_use]
    pub fn since(self, earlier: Self) -> Self {
        Self { cells: self.cells - earlier.cells, time: self.time - earlier.time }
    }
}

/// [`CellWork`] that any number of threads add to.
#[derive(Debug, Default)]
struct WorkCounter {
    cells: AtomicU64,
    nanoseconds: AtomicU64,
}

impl WorkCounter {
    /// One more cell is known, which took the time since `begun`.
    fn add(&self, begun: Instant) {
        self.cells.fetch_add(1, Relaxed);
        self.nanoseconds.fetch_add(begun.elapsed().as_nanos() as u64, Relaxed);
    }

    fn total(&self) -> CellWork {
        let time = Duration::from_nanos(self.nanoseconds.load(Relaxed));
        CellWork { cells: self.cells.load(Relaxed), time }
    }
}

/// Areas at sixteen points.
#[derive(Clone, Copy, Debug)]
pub struct PointAreas<const N: usize> {
    /// Areas in spheres of the radii of the query times `2^-level` of the domain, scene units
    /// squared.
    pub areas: [[f32; LANES]; N],
    /// Domain of each point.
    pub domain: [Domain; LANES],
}

/// Surfaces and search structures, shared by areas of all radii.
struct SharedGeometry {
    surfaces: Box<dyn Surfaces>,
    sides: Sides,
    reach: TriangleIndex,
    /// Number of the first triangle of each place.
    first: Vec<u32>,
}

type Chunk = Box<[OnceLock<Box<Patch>>; CHUNK]>;

/// Sixteen points at which photons are merged.
#[derive(Clone, Copy, Debug)]
pub struct Query<'q> {
    /// Their positions.
    pub position: &'q Vec3s,
    /// The sides of triangles that they are on, by [`Areas::facet`].
    pub facet: &'q [u32; LANES],
    /// Lanes that hold a point.
    pub wanted: &'q Mask,
}

/// Bytes that [`Areas`] take.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Memory {
    /// Without cells.
    pub fixed: usize,
    /// Patches and cells that were computed so far.
    pub kept: usize,
}

impl Areas {
    /// Areas in spheres of up to `radius`. Cells are kept in about `budget` bytes. A cell that does
    /// not fit is computed for each query, with an equal result.
    pub fn new(surfaces: Box<dyn Surfaces>, sides: Sides, radius: f32, budget: usize) -> Self {
        let reach = TriangleIndex::new(&*surfaces);
        let mut first = vec![0];
        for place in surfaces.places() {
            let count = surfaces.mesh(place.mesh).triangles.len();
            first.push(first[first.len() - 1] + count as u32);
        }
        Self::on(Arc::new(SharedGeometry { surfaces, sides, reach, first }), radius, budget, 0)
    }

    /// Areas of these surfaces for another radius.
    #[must_use]
    pub fn at(&self, radius: f32) -> Self {
        Self::on(Arc::clone(&self.shared), radius, self.budget, 0)
    }

    fn on(shared: Arc<SharedGeometry>, radius: f32, budget: usize, level: u8) -> Self {
        let facets = 2 * shared.first[shared.first.len() - 1] as usize;
        Self {
            shared,
            radius,
            patches: (0..facets.div_ceil(CHUNK)).map(|_| OnceLock::new()).collect(),
            kept: AtomicUsize::new(0),
            work: WorkCounter::default(),
            budget,
            level,
            finer: OnceLock::new(),
        }
    }

    /// Areas for half the radius.
    fn finer(&self) -> &Self {
        self.finer.get_or_init(|| {
            let shared = Arc::clone(&self.shared);
            Box::new(Self::on(shared, 0.5 * self.radius, self.budget, self.level + 1))
        })
    }

    /// Number of the side of a triangle.
    #[inline]
    pub fn facet(&self, place: u32, triangle: u32, front: bool) -> u32 {
        2 * (self.shared.first[place as usize] + triangle) + u32::from(!front)
    }

    /// Number of the side of a triangle that a gather point names by a
    /// [`Facet`](crate::scene::diffuse::Facet).
    #[inline(always)] // vectorized
    pub fn number(&self, mesh: u32, side: u32) -> u32 {
        2 * self.shared.first[mesh as usize] + side
    }

    /// The tag (`Components::tag`) of a side of a triangle; arguments as of [`Self::number`].
    #[inline]
    pub fn side_tag(&self, mesh: u32, side: u32) -> u8 {
        let SharedGeometry { sides, .. } = &*self.shared;
        sides.tag(sides.of(mesh, side >> 1, side & 1 == 0))
    }

    /// Largest radius that can be asked for.
    pub fn radius(&self) -> f32 {
        self.radius
    }

    /// Size in bytes.
    pub fn memory(&self) -> Memory {
        let SharedGeometry { sides, reach, first, .. } = &*self.shared;
        let fixed =
            reach.bytes() + sides.bytes() + 4 * first.capacity() + size_of_val(&*self.patches);
        let own = Memory { fixed, kept: self.kept.load(Relaxed) };
        let finer = self.finer.get().map(|finer| finer.memory());
        finer.map_or(own, |finer| Memory {
            fixed: own.fixed + size_of_val(&*self.patches),
            kept: own.kept + finer.kept,
        })
    }

    /// Cells that queries have computed and kept so far.
    pub fn work(&self) -> CellWork {
        let own = self.work.total();
        let finer = self.finer.get().map_or(CellWork::default(), |finer| finer.work());
        CellWork { cells: own.cells + finer.cells, time: own.time + finer.time }
    }

    /// Areas in spheres of these radii around points, or in smaller ones where too much is in
    /// reach.
    pub fn areas<const N: usize>(&self, query: &Query, radii: &[f32; N]) -> PointAreas<N> {
        vectorized(
            #[inline(always)]
            |_| self.areas_vectorized(query, radii),
        )
    }

    #[inline(always)] // vectorized
    fn areas_vectorized<const N: usize>(&self, query: &Query, radii: &[f32; N]) -> PointAreas<N> {
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
        let (mut listed, mut domain) = ([[0.0; N]; LANES], [Domain::default(); LANES]);
        for lane in lanes_of(lists) {
            if let Some(Cell::List(list)) = cells[lane] {
                listed[lane] = list.areas(at[lane], &radii2);
            }
        }
        for lane in lanes_of(others) {
            (listed[lane], domain[lane]) =
                self.compute(query.facet[lane], query.position.get(lane), &radii2);
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
        // Radii and their unit are halved together.
        let scale = domain.map(|domain| unit * 0.25f32.powi(domain.level().into()));
        for (areas, radius2) in areas.iter_mut().zip(radii2) {
            for (area, scale) in areas.iter_mut().zip(scale) {
                *area = area.max(MIN_SHARE * PI * radius2) * scale;
            }
        }
        PointAreas { areas, domain }
    }

    /// A patch that is kept.
    #[inline(always)] // vectorized
    fn patch(&self, facet: u32) -> Option<&Patch> {
        let (chunk, own) = (facet as usize / CHUNK, facet as usize % CHUNK);
        self.patches[chunk].get()?[own].get().map(|patch| &**patch)
    }

    /// Areas at one point of a cell that is not known yet or is no simple list, in squares of the
    /// radius of its level, and the domain of the point.
    #[inline(never)] // keeps the common case short
    fn compute<const N: usize>(
        &self,
        facet: u32,
        position: Vec3,
        radii2: &[f32; N],
    ) -> ([f32; N], Domain) {
        let Some(own) = self.own(facet) else {
            return (radii2.map(|radius2| PI * radius2), Domain::at_level(self.level));
        };
        let make = || {
            let surfaces = &*self.shared.surfaces;
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
        match self.in_grid(&own, patch.grid(), patch.local(position), radii2) {
            Some(found) => found,
            None => self.finer().compute(facet, position, radii2),
        }
    }

    /// Areas at a point in one cell; `None` if too much is in reach.
    fn in_grid<const N: usize>(
        &self,
        own: &GatherFacet,
        grid: &PatchGrid,
        local: [f32; 2],
        radii2: &[f32; N],
    ) -> Option<([f32; N], Domain)> {
        let CellPoint { index, at } = grid.place(local);
        let make = || {
            let SharedGeometry { surfaces, sides, reach, .. } = &*self.shared;
            let builder = CellBuilder {
                surfaces: &**surfaces,
                sides,
                reach,
                radius: self.radius.into(),
                level: self.level,
            };
            builder.build(own, grid, index)
        };
        let made;
        let cell = match grid.known(index).get() {
            Some(cell) => cell,
            None if self.has_room() => grid.known(index).get_or_init(|| {
                let begun = Instant::now();
                let cell = make();
                self.kept.fetch_add(cell.bytes(), Relaxed);
                self.work.add(begun);
                cell
            }),
            None => {
                made = make();
                &made
            }
        };
        let surfaces = &*self.shared.surfaces;
        let (cell, domain) = match cell {
            Cell::Layered(own) => (&**own, Domain::at_level(self.level).of_own_layer()),
            _ => (cell, Domain::at_level(self.level)),
        };
        let areas = match cell {
            Cell::Line { toward, offset } => {
                let height = offset + (toward[0] * at[0] + toward[1] * at[1]);
                radii2.map(|radius2| half_plane(height.max(0.0), radius2))
            }
            Cell::List(list) => list.areas(at, radii2),
            Cell::Holed(list) => list.areas(surfaces, self.radius, at, radii2),
            Cell::Split(grid) => return self.in_grid(own, grid, local, radii2),
            Cell::Crowded => return None,
            Cell::HoledDisc(hole) => hole.discs(surfaces, self.radius, at, radii2),
            Cell::Layered(_) => unreachable!("a layer is a single cell"),
        };
        Some((areas, domain))
    }

    /// Whether another cell may be kept.
    fn has_room(&self) -> bool {
        self.kept.load(Relaxed) < self.budget
    }

    /// The side of a triangle of this number; `None` if it has no area.
    fn own(&self, facet: u32) -> Option<GatherFacet> {
        let SharedGeometry { surfaces, sides, first, .. } = &*self.shared;
        let number = facet / 2;
        let place = first.partition_point(|&first| first <= number) - 1;
        let (place, triangle) = (place as u32, number - first[place]);
        let normal = surfaces.normal(place, triangle);
        let front = facet.is_multiple_of(2);
        let side = sides.of(place, triangle, front);
        let holes = surfaces.has_holes(place);
        let normal = if front { normal } else { -normal };
        (normal != Vec3::ZERO).then_some(GatherFacet { place, triangle, normal, side, holes })
    }
}
