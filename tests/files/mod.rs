//! Reading and writing of scenes, meshes and textures, and errors about them.

mod bad_input;
mod camera_change;
mod convert;
mod fuzz_gltf;
mod fuzz_luminaires;
mod fuzz_mitsuba;
mod fuzz_pbrt;
mod fuzz_pictures;
mod fuzz_toml_obj;
mod gltf;
mod gltf_bad;
mod gltf_looks;
mod instances;
mod light;
mod luminaires;
mod media;
mod memory;
mod mitsuba;
mod mtl;
mod obj;
mod pbrt;
mod ply;
mod shapes;
mod sky;
mod tolerant;
mod toml;
