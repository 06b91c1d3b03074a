//! The photons in media, and the surfaces around them.

use super::light_paths::LightPaths;
use super::medium_kernel::MediumKernel;
use super::photon_map::PhotonMap;
use super::photon_tree::PhotonTree;
use super::room::{Room, Surroundings};
use rayon::prelude::*;
use std::time::{Duration, Instant};

/// Photons for queries around points, or for queries along segments, as the kernel needs them.
#[derive(Debug, Default)]
pub struct MediumPhotons {
    /// For points.
    map: PhotonMap,
    /// For segments.
    tree: PhotonTree,
    /// The surfaces around each photon of the tree. A disc across a segment changes from photon to
    /// photon, so that the planes that cut it are found once for each photon and not for each
    /// query: those within two radii of a photon are all that can cut a disc on which it lies.
    rooms: Vec<Room>,
    /// For each photon of the tree, one more than the index of its room; 0 where no surface is
    /// near.
    room_of: Vec<u32>,
}

impl MediumPhotons {
    /// Sorts the photons of `paths` for a kernel, on the threads of the current rayon pool. Returns
    /// the time multiplied by the number of threads.
    pub fn build(
        &mut self,
        paths: &LightPaths,
        kernel: &MediumKernel,
        surroundings: &Surroundings,
    ) -> Duration {
        let start = Instant::now();
        if kernel.is_along_segments() {
            self.tree.build(paths.medium_photons());
            self.find_rooms(surroundings, kernel.room_radius());
        } else {
            self.map.build_from(&paths.medium_photons().collect::<Vec<_>>(), kernel.radius());
        }
        start.elapsed() * rayon::current_num_threads() as u32
    }

    fn find_rooms(&mut self, surroundings: &Surroundings, radius: f32) {
        let photons = self.tree.photons().par_iter().enumerate();
        let near: Vec<(usize, Room)> = photons
            .map(|(index, photon)| (index, surroundings.room(photon.position, radius)))
            .filter(|(_, room)| !room.is_open())
            .collect();
        self.rooms.clear();
        self.room_of.clear();
        self.room_of.resize(self.tree.photons().len(), 0);
        for (index, room) in near {
            self.rooms.push(room);
            self.room_of[index] = self.rooms.len() as u32;
        }
    }

    /// Tests whether there are no photons.
    pub fn is_empty(&self) -> bool {
        self.map.is_empty() && self.tree.photons().is_empty()
    }

    /// Tests whether there are caustic photons.
    pub fn has_caustic_photons(&self) -> bool {
        self.map.has_caustic_photons() || self.tree.has_caustic_photons()
    }

    /// The photons for queries around points.
    pub(super) fn map(&self) -> &PhotonMap {
        &self.map
    }

    /// The photons for queries along segments.
    pub(super) fn tree(&self) -> &PhotonTree {
        &self.tree
    }

    /// The surfaces around a photon of the tree, if any are near.
    #[inline]
    pub(super) fn room(&self, photon: usize) -> Option<&Room> {
        self.rooms.get((self.room_of[photon] as usize).wrapping_sub(1))
    }
}
