//! Light: intersections, cameras, surfaces, lights, whole images.

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
mod crop;
mod guides;
mod hidden;
mod instances;
mod interpolated_normals;
mod layers;
mod light_visibility;
mod lights;
mod materials_furnace;
mod materials_light;
mod mis;
mod normal_maps;
mod reference;
mod scenes;
mod textured_light;
mod textures;
