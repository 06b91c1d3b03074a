#![doc = include_str!("../README.md")]

pub mod accel;
pub mod autopilot;
pub mod block;
pub mod bsdf;
pub mod camera_paths;
pub mod checkpoint;
pub mod compare;
pub mod counts;
pub mod error;
pub mod film;
pub mod goal;
pub mod light_paths;
pub mod math;
mod memory;
pub mod merge;
pub mod noise;
pub mod optimize;
pub mod origin;
pub mod output;
pub mod photon_map;
pub mod plan;
mod pool;
pub mod published;
pub mod reference;
pub mod render;
pub mod reproduce;
pub mod rng;
pub mod scene;
pub mod settings;
pub mod steer;
pub mod timing;
mod worker;

pub use error::{Error, Result};
pub use render::Renderer;
pub use scene::Scene;
pub use settings::Settings;
