//! The photons in media, and the surfaces around them.

use super::light_paths::LightPaths;
use super::medium_kernel::MediumKernel;
use super::near_planes::{NearPlanes, Surroundings};
use super::photon_map::PhotonMap;
use super::photon_tree::PhotonTree;
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
    planes: Vec<NearPlanes>,
    /// For each photon of the tree, one more than the index of its planes; 0 where no surface is
    /// near.
    planes_of: Vec<u32>,
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
            self.find_planes(surroundings, kernel.reach());
        } else {
            self.map.build_from(&paths.medium_photons().collect::<Vec<_>>(), kernel.radius());
        }
        start.elapsed() * rayon::current_num_threads() as u32
    }

    fn find_planes(&mut self, surroundings: &Surroundings, radius: f32) {
        let photons = self.tree.photons().par_iter().enumerate();
        let near: Vec<(usize, NearPlanes)> = photons
            .map(|(index, photon)| (index, surroundings.planes(photon.position, radius)))
            .filter(|(_, planes)| !planes.is_open())
            .collect();
        self.planes.clear();
        self.planes_of.clear();
        self.planes_of.resize(self.tree.photons().len(), 0);
        for (index, planes) in near {
            self.planes.push(planes);
            self.planes_of[index] = self.planes.len() as u32;
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
    pub(super) fn planes(&self, photon: usize) -> Option<&NearPlanes> {
        self.planes.get((self.planes_of[photon] as usize).wrapping_sub(1))
    }
}
