//! Which sides of surfaces light reaches.
//!
//! Only these sides can have sent a photon. If light reaches one side and not the other, something
//! solid is in between. Materials do not decide this, since most reflect on both sides. Light paths
//! do: [`Marks`] records the surfaces at which they arrived, in any order, for whole components.
//! The front of a component counts if none arrived. The side at which photons are gathered counts
//! in any case.

use super::components::{Components, SideId};
use super::surfaces::Surfaces;
use std::sync::atomic::{AtomicBool, Ordering::Relaxed};

/// Records where light arrives; any number of threads may do so in any order.
#[derive(Debug)]
pub struct Marks {
    components: Components,
    reached: Vec<AtomicBool>,
}

/// Which sides of surfaces light reaches.
#[derive(Debug)]
pub struct Sides {
    components: Components,
    reached: Vec<bool>,
}

impl Marks {
    /// No light has arrived anywhere.
    pub fn new(surfaces: &dyn Surfaces) -> Self {
        let components = Components::new(surfaces);
        let reached = (0..components.sides()).map(|_| AtomicBool::new(false)).collect();
        Self { components, reached }
    }

    /// Light arrived at this side of a triangle. Arrivals at surfaces that do not merge count, too.
    pub fn add(&self, place: u32, triangle: u32, front: bool) {
        let SideId(side) = self.components.side(place, triangle, front);
        self.reached[side as usize].store(true, Relaxed);
    }

    /// The sides that were marked.
    pub fn freeze(self) -> Sides {
        let mut reached: Vec<_> = self.reached.into_iter().map(AtomicBool::into_inner).collect();
        for sides in reached.as_chunks_mut::<2>().0 {
            sides[0] |= !sides[1];
        }
        Sides { components: self.components, reached }
    }
}

impl Sides {
    /// The side of a triangle.
    pub(super) fn of(&self, place: u32, triangle: u32, front: bool) -> SideId {
        self.components.side(place, triangle, front)
    }

    /// The side as photons hold it.
    #[inline]
    pub(super) fn tag(&self, side: SideId) -> u8 {
        self.components.tag(side)
    }

    /// Whether a triangle repeats another, which counts for both.
    pub(super) fn is_double(&self, place: u32, triangle: u32) -> bool {
        self.components.is_double(place, triangle)
    }

    /// Whether light reaches it.
    pub(super) fn reached(&self, side: SideId) -> bool {
        self.reached[side.0 as usize]
    }

    /// Number of sides, and how many of them light reaches.
    pub fn counts(&self) -> [usize; 2] {
        [self.reached.len(), self.reached.iter().filter(|&&reached| reached).count()]
    }

    /// Size in bytes.
    pub fn bytes(&self) -> usize {
        self.reached.capacity() + self.components.bytes()
    }
}
