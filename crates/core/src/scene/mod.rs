//! A scene: meshes, materials, lights and a camera, immutable once built.

pub mod backend;
pub mod bsdf;
pub mod camera;
mod alpha_mask;
pub mod diffuse;
mod fingerprint;
mod camera_visibility;
pub mod casters;
pub mod coated_hits;
mod coated_kinds;
mod hit;
mod light_source;
pub mod lights;
mod normal_loss;
pub mod material;
mod media;
mod medium;
mod mesh;
mod meter;
mod near_faces;
mod normal_map;
mod pane_stack;
pub mod panes;
mod placement;
mod polarization;
mod shading;
mod start_media;
mod surface;
mod texture;
pub mod transform;
mod triangle;
mod validate;

#[doc(inline)]
pub use crate::base::dispersion::{self, Dispersion, RefractiveIndex};
pub use crate::settings::{Region, check_rectangles};
pub use alpha_mask::AlphaMask;
pub use camera::{Camera, Extent, FieldOfView, FisheyeProjection, Optics, View};
pub use hit::{HitScratch, NotLambertian};
pub use light_source::LightSource;
pub use lights::emitter::{Directional, Emitter, Falloff, Spot};
pub use lights::environment::{Environment, Inset, InsetGrid};
pub use lights::horizon::{Horizon, StraightLight};
pub use lights::intensity::{IntensityDistribution, Photometry};
pub use lights::luminaire::{AimedDistribution, LuminousOpening, PointLuminaire};
pub use lights::packets::{Emissions, LightSamples, PrimarySamples, Receivers};
pub use lights::textured_emitter::TexturedTriangle;
pub use lights::{ConnectedLight, Emission, LightSample, Lights, Receiver};
pub use material::Material;
pub use media::{Media, MediumBoundary, MediumState};
pub use medium::{Flight, Medium, henyey_greenstein};
pub use mesh::Mesh;
pub use meter::{MAX_METERS, Meter, MeterKind, MeterSet, Meters, Requirement, standard_grid};
pub use near_faces::NearFaces;
pub use normal_loss::NormalLoss;
pub use normal_map::NormalMap;
pub use pane_stack::PaneStack;
pub use placement::{Arrangement, Placement};
pub(crate) use shading::shading_normal;
pub use surface::Surface;
pub use texture::{Sampling, Texture, Wrap};
pub use transform::Transform;
pub use triangle::Triangle;
pub use triangle::triangle_area;
pub use validate::check_mesh;

use crate::base::error::Result;
use crate::base::math::Bounds;
use crate::settings::combinations::SceneFacts;
use coated_kinds::Coated;
use diffuse::TriangleSide;
use glam::{DVec3, Vec3};
use hit::Lambertian;
use lights::enclosure::Enclosure;
use lights::guide::Guide;
use lights::visibility::Visibility;
use placement::Emitting;
use start_media::StartMedia;
use std::sync::Arc;
use triangle::Corners;

/// Facts about the file of a scene, on which no image depends.
#[derive(Clone, Debug, Default)]
struct FileFacts {
    /// Point of its coordinates that is the origin of the scene.
    origin: DVec3,
    /// Name of each light without a surface that has power, if the file names any.
    light_names: Arc<[Option<String>]>,
}

/// Everything that light meets. Clones share all large parts.
#[derive(Clone, Debug)]
pub struct Scene {
    /// Name of the scene's file or folder.
    pub name: String,
    /// The camera of the image.
    pub camera: Camera,
    /// Named parts of the image.
    pub regions: Vec<Region>,
    file: FileFacts,
    /// Meters that take the place of the camera, if there are any.
    meters: Option<Arc<Meters>>,
    // The following fields depend on each other: to change one, build another scene.
    meshes: Arc<[Mesh]>,
    placements: Arc<[Placement]>,
    materials: Arc<[Material]>,
    lights: Lights,
    bounds: Bounds,
    /// Distance off surfaces at which rays start, besides rounding errors, scene units.
    ray_offset: f32,
    /// Whether `ray_offset` was given.
    has_own_ray_offset: bool,
    /// The media and their boundaries, if there are any.
    media: Option<Arc<Media>>,
    /// The medium between all others.
    filling_medium: Option<Arc<Medium>>,
    /// The media where paths start.
    start_media: Option<Arc<StartMedia>>,
    /// All triangles, mesh by mesh, in their mesh's space.
    triangles: Arc<[Triangle]>,
    /// Corners of the triangles with varying shading data.
    corners: Arc<[Corners]>,
    /// For each placement the index in `triangles` of its mesh's first triangle.
    first_triangle: Arc<[u32]>,
    /// For each material its Lambertian part.
    lambertian: Arc<[Lambertian]>,
    /// Tables for [`Scene::coated_vertices`].
    coated: Coated,
    /// Sides that emit, sorted, and the indices of their emitters.
    emitting: Arc<[(TriangleSide, u32)]>,
}

impl Scene {
    /// Builds a scene; `lights` are added to the emissive triangles.
    ///
    /// # Errors
    /// If a position is not finite, or an index is out of range. If there are normals, texture
    /// coordinates or tangents, but not one per position. If a triangle without area emits, or
    /// there are 2^32 triangles. The error names the mesh.
    pub fn new(
        name: String,
        arrangement: impl Into<Arrangement>,
        materials: Vec<Material>,
        lights: Vec<Emitter>,
        camera: Camera,
        regions: Vec<Region>,
    ) -> Result<Self> {
        Self::with_ray_offset(name, arrangement, materials, lights, camera, regions, None)
    }

    /// [`Self::new`] with a distance off surfaces at which rays start, scene units, which is added
    /// to the bound of rounding errors. It keeps layers that are closer together from shading each
    /// other.
    ///
    /// # Errors
    /// In the cases of [`Self::new`].
    pub fn with_ray_offset(
        name: String,
        arrangement: impl Into<Arrangement>,
        materials: Vec<Material>,
        lights: Vec<Emitter>,
        camera: Camera,
        regions: Vec<Region>,
        ray_offset: Option<f32>,
    ) -> Result<Self> {
        let arrangement = arrangement.into();
        validate::check(&arrangement, &materials)?;
        let bounds = arrangement.bounds();
        let Arrangement { meshes, placements } = arrangement;
        let media = Media::new(&meshes, &placements, &materials, None)?;
        let mut varies: Vec<_> = meshes.iter().map(Mesh::varies).collect();
        // Corner index and material of stored triangles; a mesh with several placements has any of
        // their materials.
        let mut looks = vec![(Triangle::FLAT, 0); meshes.len()];
        for Placement { mesh, material, transform } in &placements {
            varies[*mesh as usize] |= materials[*material as usize].varies();
            let flat = if transform.is_some() { Triangle::PLACED } else { Triangle::FLAT };
            looks[*mesh as usize] = (flat, *material);
        }
        let has_own_ray_offset = ray_offset.is_some();
        let ray_offset = ray_offset.unwrap_or(0.0);
        let mut triangles = Vec::with_capacity(meshes.iter().map(|m| m.triangles.len()).sum());
        let mut first_of_mesh = Vec::with_capacity(meshes.len());
        let mut corners = Vec::new();
        for ((mesh, varies), (flat, material)) in meshes.iter().zip(varies).zip(looks) {
            first_of_mesh.push(triangles.len() as u32);
            for indices in &mesh.triangles {
                let indices = indices.map(|index| index as usize);
                let points = indices.map(|index| mesh.positions[index]);
                let shape = Triangle::new(points, material);
                let offset = shape.offset + ray_offset;
                let mut shape = Triangle { corners: flat, offset, ..shape };
                if varies {
                    shape.corners = corners.len() as u32;
                    corners.push(mesh.corners(indices, shape.normal));
                }
                triangles.push(shape);
            }
        }

        let mut first_triangle = Vec::with_capacity(placements.len());
        let (mut emitters, mut facets) = (lights, Vec::new());
        for (number, placement) in (0..).zip(&placements) {
            let mesh = &meshes[placement.mesh as usize];
            let first = first_of_mesh[placement.mesh as usize];
            let stored = &triangles[first as usize..][..mesh.triangles.len()];
            first_triangle.push(first);
            let mut emit = Emitting { ray_offset, facets: &mut facets, emitters: &mut emitters };
            placement.emit(mesh, stored, &materials, number, &mut emit);
        }
        for emitter in &mut emitters {
            if let Emitter::Directional(light) = emitter {
                light.enclosure = Enclosure::new(&bounds);
            }
        }
        // `Lights` keeps the emitters with power, in this order.
        let mut kept = 0;
        let numbers: Vec<Option<u32>> = emitters
            .iter()
            .map(|emitter| {
                let number = kept;
                kept += u32::from(emitter.has_power());
                emitter.has_power().then_some(number)
            })
            .collect();
        let numbered = |(side, index): (TriangleSide, usize)| Some((side, numbers[index]?));
        let mut emitting: Vec<_> = facets.into_iter().filter_map(numbered).collect();
        emitting.sort_by_key(|(side, _)| *side);
        Ok(Self {
            name,
            camera,
            regions,
            file: FileFacts::default(),
            meters: None,
            lambertian: materials.iter().map(Lambertian::of).collect(),
            coated: Coated::new(&materials, &placements, &meshes),
            meshes: meshes.into(),
            placements: placements.into(),
            materials: materials.into(),
            lights: Lights::new(emitters),
            bounds,
            ray_offset,
            has_own_ray_offset,
            media: media.map(Arc::new),
            filling_medium: None,
            start_media: None,
            triangles: triangles.into(),
            corners: corners.into(),
            first_triangle: first_triangle.into(),
            emitting: emitting.into(),
        })
    }

    /// The scene with names of its lights without a surface, in the order of those that have
    /// power. Names do not change any image.
    #[must_use]
    pub fn with_light_names(self, names: Vec<Option<String>>) -> Self {
        // Rounding may leave a light without power. Names must not go to other lights.
        if names.len() != self.lights_without_surface() {
            return self;
        }
        Self { file: FileFacts { light_names: names.into(), ..self.file }, ..self }
    }

    /// Names of the lights without a surface that have power, if the file names any. They are the
    /// first emitters.
    pub fn light_names(&self) -> &[Option<String>] {
        &self.file.light_names
    }

    /// The scene with this point of the coordinates of its file as its origin.
    #[must_use]
    pub fn with_file_origin(self, file_origin: DVec3) -> Self {
        Self { file: FileFacts { origin: file_origin, ..self.file }, ..self }
    }

    /// Point of the coordinates of its file that is the origin of the scene: zero, except for
    /// scenes that are far from the origin of their file.
    pub fn file_origin(&self) -> DVec3 {
        self.file.origin
    }

    /// A position of the scene in the coordinates of its file, with the decimal digits that single
    /// precision has: 0.1 stays 0.1.
    pub fn in_file(&self, position: Vec3) -> DVec3 {
        let decimal = |x: f32| x.to_string().parse().unwrap_or_else(|_| f64::from(x));
        DVec3::from_array(position.to_array().map(decimal)) + self.file.origin
    }

    /// All meshes, those with several placements once.
    pub fn meshes(&self) -> &[Mesh] {
        &self.meshes
    }

    /// Placements of the meshes, in the order of the mesh index of [`Hit`](crate::accel::Hit).
    pub fn placements(&self) -> &[Placement] {
        &self.placements
    }

    /// All materials.
    pub fn materials(&self) -> &[Material] {
        &self.materials
    }

    /// Returns true if any surface may have a lobe that is [`Lobe::Rough`](bsdf::Lobe::Rough).
    pub fn has_rough_materials(&self) -> bool {
        self.materials.iter().any(Material::may_be_rough)
    }

    /// All lights, emissive triangles among them.
    pub fn lights(&self) -> &Lights {
        &self.lights
    }

    /// What decides about options of a render.
    pub fn facts(&self) -> SceneFacts {
        let any_medium_scatters = self.media().is_some_and(Media::any_scatters);
        SceneFacts {
            allows_caustics_alone: !any_medium_scatters,
            any_medium_scatters,
            any_disperses: self.materials.iter().any(|material| material.dispersion.is_some()),
            has_meters: self.meters().is_some(),
        }
    }

    /// Distance off surfaces at which rays start besides rounding errors, scene units, if it was
    /// given.
    pub fn own_ray_offset(&self) -> Option<f32> {
        self.has_own_ray_offset.then_some(self.ray_offset)
    }

    /// Distance off a plane through this position at which rays start, scene units; its unit normal
    /// is given.
    pub(crate) fn offset_at(&self, position: Vec3, normal: Vec3) -> f32 {
        Triangle::offset(normal, position.abs()) + self.ray_offset
    }

    /// Box around all meshes.
    pub fn bounds(&self) -> &Bounds {
        &self.bounds
    }

    /// The scene with this environment, or without one.
    #[must_use]
    pub fn with_environment(mut self, environment: impl Into<Option<Environment>>) -> Self {
        let mut environment = environment.into();
        environment.iter_mut().for_each(|environment| environment.enclose(&self.bounds));
        self.lights.set_environment(environment);
        self
    }

    /// The scene with a further light before all others; it has power and is no triangle.
    #[must_use]
    pub fn with_light(mut self, light: Emitter) -> Self {
        assert!(light.has_power(), "a light without power would have no number");
        let environment = self.lights.environment().cloned();
        let emitters = self.lights.emitters().iter().cloned();
        self.lights = Lights::new(std::iter::once(light).chain(emitters).collect());
        self.lights.set_environment(environment);
        let next = |&(side, number): &(TriangleSide, u32)| (side, number + 1);
        self.emitting = self.emitting.iter().map(next).collect();
        let names = self.file.light_names.iter().cloned();
        self.file.light_names = std::iter::once(None).chain(names).collect();
        self
    }

    /// The scene with this visibility of its lights, or without one. It changes how vertices choose
    /// among lights, not the mean of any image.
    #[must_use]
    pub fn with_visibility(&self, visibility: Option<Arc<Visibility>>) -> Self {
        let mut scene = self.clone();
        scene.lights.set_visibility(visibility);
        scene
    }

    /// The scene with this guide, or without one, in the densities of emission for MIS weights.
    #[must_use]
    pub fn with_weighted_guide(&self, guide: Option<Arc<Guide>>) -> Self {
        let mut scene = self.clone();
        scene.lights.set_weighted_guide(guide);
        scene
    }

    /// Index of the light that a triangle's side is; `None` if it emits nothing.
    pub fn emitter(&self, side: TriangleSide) -> Option<usize> {
        let found = self.emitting.binary_search_by_key(&side, |(side, _)| *side).ok()?;
        Some(self.emitting[found].1 as usize)
    }

    /// Longest side of the bounding box, scene units.
    pub fn size(&self) -> f32 {
        self.bounds.longest_side()
    }

    /// Returns true if merges at any surface need the direction of photons: for BSDFs that vary
    /// with it, or normals that differ from the triangle's.
    pub fn merges_by_direction(&self) -> bool {
        self.materials.iter().any(Material::merges_by_direction)
            || self.meshes.iter().any(|mesh| !mesh.normals.is_empty())
    }

    /// Returns true if paths may have wavelengths: if any material is dispersive.
    pub fn is_dispersive(&self) -> bool {
        self.materials.iter().any(|material| material.dispersion.is_some())
    }
}
