//! Light sources by name, and scenes that have only some of them.

use super::{Arrangement, FileFacts, Material, Scene};
use crate::base::error::Result;
use crate::base::math::Rgb;

/// A light source that can be switched on its own.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum LightSource {
    /// A light without a surface, by its number among those with power.
    Light(usize),
    /// All surfaces of an emissive material, by its number.
    Material(usize),
    /// The environment.
    Environment,
}

impl Scene {
    /// All light sources with their names: those of the file, else `light 1` and so on, names of
    /// materials, and `environment`.
    pub fn light_sources(&self) -> Vec<(LightSource, String)> {
        let lights = (0..self.lights_without_surface())
            .map(|index| (LightSource::Light(index), self.light_name(index)));
        let is_used = |index: usize| {
            self.placements.iter().any(|placement| placement.material as usize == index)
        };
        let emits = |(index, material): &(usize, &Material)| {
            let emits = material.emission != Rgb::ZERO || material.luminous_opening.is_some();
            emits && is_used(*index)
        };
        let materials = self
            .materials
            .iter()
            .enumerate()
            .filter(emits)
            .map(|(index, material)| (LightSource::Material(index), material.name.clone()));
        let environment = self.lights.has_environment();
        let environment = environment.then(|| (LightSource::Environment, "environment".to_owned()));
        lights.chain(materials).chain(environment).collect()
    }

    /// Name of a light without a surface, by its number among those with power.
    fn light_name(&self, index: usize) -> String {
        let own = self.file.light_names.get(index).cloned().flatten();
        own.unwrap_or_else(|| format!("light {}", index + 1))
    }

    /// Number of the lights without a surface, which are the first emitters.
    pub(super) fn lights_without_surface(&self) -> usize {
        // A luminous opening is one emitter with many sides.
        let first = self.emitting.iter().map(|(_, emitter)| *emitter as usize).min();
        first.unwrap_or(self.lights.emitters().len())
    }

    /// The scene with only these of its light sources. Geometry, and acceleration structures of it,
    /// are the same.
    ///
    /// # Errors
    /// As [`Self::new`].
    pub fn with_only(&self, sources: &[LightSource]) -> Result<Self> {
        let lights = self.lights.emitters().iter().take(self.lights_without_surface());
        let lights = lights
            .enumerate()
            .filter(|(index, _)| sources.contains(&LightSource::Light(*index)))
            .map(|(_, light)| light.clone())
            .collect();
        let material = |(index, material): (usize, &Material)| {
            if sources.contains(&LightSource::Material(index)) {
                return material.clone();
            }
            Material {
                emission: Rgb::ZERO,
                emission_texture: None,
                luminous_opening: None,
                ..material.clone()
            }
        };
        let arrangement =
            Arrangement { meshes: self.meshes.to_vec(), placements: self.placements.to_vec() };
        let environment = self.lights.environment().cloned();
        let scene = Self::with_ray_offset(
            self.name.clone(),
            arrangement,
            self.materials.iter().enumerate().map(material).collect(),
            lights,
            self.camera,
            self.regions.clone(),
            self.own_ray_offset(),
        )?;
        let light_names = (0..self.lights_without_surface())
            .filter(|index| sources.contains(&LightSource::Light(*index)))
            .map(|index| self.file.light_names.get(index).cloned().flatten())
            .collect();
        let (meters, origin) = (self.meters.clone(), self.file.origin);
        let file = FileFacts { origin, light_names };
        let scene = Self { meters, file, ..scene };
        let keeps_environment = sources.contains(&LightSource::Environment);
        let scene = scene.with_environment(environment.filter(|_| keeps_environment));
        scene.with_filling_medium(self.filling_medium.clone())
    }
}
