//! How light gets from the lights to the camera: light paths, the photons they leave, camera paths,
//! and the pairs that meet.

pub mod area;
pub mod camera_paths;
pub mod clearance;
pub mod daylight;
mod path_queue;
pub mod path_walker;
mod free_flight;
pub mod gather;
pub mod goniometer;
pub mod kernel;
pub mod light_paths;
pub mod medium_kernel;
pub mod medium_photons;
pub mod merge;
pub mod meter_photons;
pub mod mis;
pub mod pair_list;
pub mod photon;
pub mod photon_map;
pub mod photon_tree;
pub mod reference;
mod path_state;
pub mod near_planes;
mod roulette;
pub mod suffix_cache;
