//! Light: intersections, cameras, surfaces, lights, whole images.

#[path = "../common/boxes.rs"]
mod boxes;
#[path = "../common/committed.rs"]
mod committed;
#[path = "../common/mod.rs"]
mod common;
#[path = "../common/material_noise.rs"]
mod material_noise;
#[path = "../common/scene_case.rs"]
mod scene_case;
#[path = "../common/shapes.rs"]
mod shapes;
#[path = "../common/several_ways.rs"]
mod several_ways;
#[path = "../common/strategies.rs"]
mod strategies;

mod accel_agree;
mod accel_instances;
mod analytic_radiance;
mod area_bound;
mod area_furnace;
mod bias;
mod backends_render;
mod bsdf;
mod camera_batches;
mod cameras;
mod guides;
mod hidden;
mod instances;
mod interpolated_normals;
mod layers;
mod lights;
mod materials_furnace;
mod materials_light;
mod mis;
mod normal_maps;
mod reference;
mod scenes;
mod textured_light;
mod textures;
