//! How light gets from the lights to the camera: light paths, the photons they leave, camera paths,
//! and the pairs that meet.

pub mod area;
pub mod camera_paths;
pub mod clearance;
pub mod daylight;
mod path_queue;
pub mod path_walker;
pub mod free_flight;
pub mod gather;
pub mod kernel;
pub mod light_paths;
pub mod medium_kernel;
pub mod medium_photons;
pub mod merge;
pub mod mis;
pub mod pair_list;
pub mod photon;
pub mod photon_map;
pub mod photon_tree;
pub mod reference;
pub mod path_state;
pub mod near_planes;
pub mod roulette;
pub mod step;
pub mod suffix_cache;
