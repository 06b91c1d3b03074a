//! A 64-bit fingerprint that identifies a scene.

use super::{
    Camera, Emitter, Environment, Material, Medium, Mesh, Meters, Placement, Scene, Texture,
};
use bytemuck::Pod;
use rayon::prelude::*;
use serde::{Serialize, Serializer};
use std::io::BufWriter;
use xxhash_rust::xxh3::Xxh3Default;

/// Everything that an image depends on. Types of the scene leave out of their serialization what
/// does not count (names) and what follows from the rest (tables for sampling, means of BSDFs),
/// which may differ between machines by rounding.
#[derive(Serialize)]
struct Content<'a> {
    /// Fingerprint of the mesh in scene space, and material.
    placements: Vec<(u64, u32)>,
    materials: &'a [Material],
    environment: Option<&'a Environment>,
    /// Without those on surfaces, which follow from meshes and materials.
    emitters: Vec<&'a Emitter>,
    /// If it is not that of the size of the scene.
    ray_offset: Option<f32>,
    camera: &'a Camera,
    meters: Option<&'a Meters>,
    filling_medium: Option<&'a Medium>,
}

impl Scene {
    /// A hash (XXH3) of everything that an image depends on: geometry, materials, lights and
    /// camera, bit by bit and in order. Names, regions and paths of files do not count. It is the
    /// same on every machine. Instances of a mesh and copies of it have one fingerprint.
    pub fn fingerprint(&self) -> u64 {
        let placed = |Placement { mesh, material, transform }: &Placement| {
            let mesh = &self.meshes[*mesh as usize];
            let hash = match transform {
                None => hash(mesh),
                Some(transform) => hash(&mesh.moved(transform)),
            };
            (hash, *material)
        };
        let emitters = self.lights.emitters().iter();
        hash(&Content {
            placements: self.placements.par_iter().map(placed).collect(),
            materials: &self.materials,
            environment: self.lights.environment(),
            emitters: emitters.filter(|emitter| emitter.is_delta()).collect(),
            ray_offset: self.own_ray_offset(),
            camera: &self.camera,
            meters: self.meters(),
            filling_medium: self.filling_medium().map(AsRef::as_ref),
        })
    }
}

/// The hash of a value in the binary format of `postcard`, in which lists begin with their lengths
/// and variants with their numbers: different values have different bytes.
fn hash(value: &(impl Serialize + ?Sized)) -> u64 {
    let writer = BufWriter::with_capacity(1 << 16, Xxh3Default::new());
    let writer = postcard::to_io(value, writer).expect("hashing does not fail");
    let Ok(hash) = writer.into_inner() else { unreachable!("hashing does not fail") };
    hash.digest()
}

/// Numbers as they are in memory, written as a whole: little-endian, as on every machine that this
/// program knows.
struct Bytes<'a>(&'a [u8]);

impl<'a> Bytes<'a> {
    fn of<T: Pod>(numbers: &'a [T]) -> Self {
        const { assert!(cfg!(target_endian = "little"), "fingerprints would differ") };
        Self(bytemuck::cast_slice(numbers))
    }
}

impl Serialize for Bytes<'_> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.serialize_bytes(self.0)
    }
}

impl Serialize for Mesh {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let Self { name: _, positions, normals, uvs, tangents, colors, triangles, material: _ } =
            self;
        let vectors = [positions, normals, tangents, colors].map(|list| Bytes::of(list));
        (vectors, Bytes::of(uvs), Bytes::of(triangles)).serialize(serializer)
    }
}

impl Serialize for Texture {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let texels = Bytes::of(self.texels());
        (self.size(), texels, self.sampling()).serialize(serializer)
    }
}

impl Serialize for Environment {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let pixels: Vec<_> = self.pixels().collect();
        let inset = self.inset().map(|(grid, pixels)| (grid, pixels.collect::<Vec<_>>()));
        let inset = inset.as_ref().map(|(grid, pixels)| (grid, Bytes::of(pixels)));
        (self.size(), Bytes::of(&pixels), self.turn(), inset).serialize(serializer)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::math::Rgb;
    use crate::scene::bsdf::{
        Bsdf, Coated, Conductor, Dielectric, DiffuseTransmission, FacetModel, Facets, Glossy,
        Plastic, Reflectance, RoughDielectric, ThinDielectric,
    };
    use crate::scene::texture::{Sampling, Wrap};
    use crate::scene::{
        Arrangement, Directional, Extent, Falloff, FieldOfView, FisheyeProjection, NormalMap,
        Optics, Region, Spot, Transform,
    };
    use glam::{DAffine3, DVec3, Vec2, Vec3};
    use std::sync::Arc;

    fn metal(name: &str, alpha: f32) -> Bsdf {
        Bsdf::Conductor(Conductor::new(Reflectance::named(name).unwrap(), alpha))
    }

    fn once(model: FacetModel, tint: f32) -> Bsdf {
        let facets = Facets { model, alpha: 0.2 };
        let gold = Reflectance::named("gold").unwrap();
        Bsdf::Conductor(Conductor::once(gold, facets, Rgb::splat(tint)))
    }

    fn sheet(reflectance: f32, transmittance: f32) -> Bsdf {
        let shares = [reflectance, transmittance].map(Rgb::splat);
        Bsdf::DiffuseTransmission(DiffuseTransmission::new(shares[0], shares[1]))
    }

    fn glossy([albedo, metallic, eta, alpha]: [f32; 4]) -> Bsdf {
        Bsdf::Glossy(Glossy::new(Rgb::splat(albedo), metallic, eta, alpha))
    }

    fn plastic(albedo: f32, eta: f32, alpha: f32, is_nonlinear: bool) -> Bsdf {
        let facets = Facets { model: FacetModel::Beckmann, alpha };
        Bsdf::Plastic(Plastic::new(Rgb::splat(albedo), eta, facets, is_nonlinear))
    }

    fn fisheye(projection: FisheyeProjection, field_of_view: f32) -> Optics {
        Optics::Fisheye { projection, field_of_view }
    }

    fn texture(code: u8) -> Arc<Texture> {
        Arc::new(Texture::new(1, 1, vec![[code; 4]]))
    }

    fn clamped(code: u8) -> Arc<Texture> {
        let sampling = Sampling { wrap: [Wrap::Clamp; 2], nearest: false };
        Arc::new(Texture::clone(&texture(code)).sampled(sampling))
    }

    #[derive(Clone)]
    struct SceneParts {
        name: &'static str,
        mesh: Mesh,
        material: Material,
        lights: Vec<Emitter>,
        eye: Vec3,
        up: Vec3,
        optics: Optics,
        regions: Vec<Region>,
    }

    impl SceneParts {
        fn fingerprint(self) -> u64 {
            let camera = Camera::with_optics(self.eye, Vec3::Z, self.up, self.optics).unwrap();
            let (meshes, materials) = (vec![self.mesh], vec![self.material]);
            Scene::new(self.name.into(), meshes, materials, self.lights, camera, self.regions)
                .unwrap()
                .fingerprint()
        }
    }

    fn spot() -> Spot {
        Spot {
            position: Vec3::Y,
            direction: Vec3::Z,
            intensity: Rgb::ONE,
            cos_inner: 0.8,
            cos_outer: 0.5,
            falloff: Falloff::Quadratic,
        }
    }

    fn thin_lens(degrees: f32, aperture_radius: f32, focus_distance: f32) -> Optics {
        let field_of_view = FieldOfView::X(degrees);
        Optics::ThinLens { field_of_view, aperture_radius, focus_distance }
    }

    fn sensor([width, disc_distance, disc_radius, exposure]: [f32; 4]) -> Optics {
        Optics::Sensor { width, disc_distance, disc_radius, exposure }
    }

    fn parts() -> SceneParts {
        let positions = vec![Vec3::ZERO, Vec3::X, Vec3::Y, Vec3::ONE];
        let bsdf = Bsdf::diffuse(Rgb::splat(0.5));
        SceneParts {
            name: "a",
            mesh: Mesh {
                name: "m".into(),
                positions,
                triangles: vec![[0, 1, 2]],
                ..Mesh::default()
            },
            material: Material { emission: Rgb::ONE, ..Material::new("n", bsdf) },
            lights: vec![Emitter::Point { position: Vec3::Y, intensity: Rgb::ONE }],
            eye: Vec3::ZERO,
            up: Vec3::Y,
            optics: Optics::Pinhole(FieldOfView::X(40.0)),
            regions: vec![],
        }
    }

    #[test]
    fn every_visible_change_changes_the_fingerprint() {
        let changes: [fn(&mut SceneParts); 78] = [
            |p| p.mesh.positions[3].x = 1.5,
            |p| p.mesh.triangles[0] = [0, 2, 1],
            |p| p.mesh.normals = vec![Vec3::Z; 4],
            |p| p.mesh.normals = vec![Vec3::Y; 4],
            |p| p.mesh.uvs = vec![Vec2::X; 4],
            |p| p.material.opacity = Some(1.0),
            |p| p.material.opacity = Some(0.5),
            |p| {
                let transmittance = Rgb::new(1.0, 1.0, 0.5);
                p.material.bsdf = Bsdf::Dielectric(Dielectric { eta: 1.5, transmittance });
            },
            |p| {
                let glass = RoughDielectric::new(1.5, 0.1).tinted(Rgb::splat(0.5));
                p.material.bsdf = Bsdf::RoughDielectric(glass);
            },
            |p| p.mesh.colors = vec![Rgb::splat(0.5); 4],
            |p| p.mesh.tangents = vec![Vec3::X; 4],
            |p| p.mesh.triangles.push([1, 2, 3]),
            |p| p.material.bsdf = Bsdf::diffuse(Rgb::splat(0.6)),
            |p| p.material.bsdf = Bsdf::Lambertian { albedo: Rgb::splat(0.5), two_sided: false },
            |p| p.material.bsdf = Bsdf::Mirror { reflectance: Rgb::splat(0.5) },
            |p| p.material.bsdf = Bsdf::Dielectric(Dielectric::new(1.5)),
            |p| p.material.bsdf = Bsdf::Dielectric(Dielectric::new(1.4)),
            |p| p.material.bsdf = Bsdf::ThinDielectric(ThinDielectric::new(1.5)),
            |p| p.material.bsdf = Bsdf::RoughDielectric(RoughDielectric::new(1.5, 0.1)),
            |p| p.material.bsdf = Bsdf::RoughDielectric(RoughDielectric::new(1.5, 0.2)),
            |p| p.material.bsdf = Bsdf::Coated(Coated::new(Rgb::splat(0.5), 1.5)),
            |p| p.material.bsdf = Bsdf::Coated(Coated::new(Rgb::splat(0.5), 1.4)),
            |p| p.material.bsdf = glossy([0.5, 0.0, 1.5, 0.2]),
            |p| p.material.bsdf = glossy([0.6, 0.0, 1.5, 0.2]),
            |p| p.material.bsdf = glossy([0.5, 0.1, 1.5, 0.2]),
            |p| p.material.bsdf = glossy([0.5, 0.0, 1.4, 0.2]),
            |p| p.material.bsdf = glossy([0.5, 0.0, 1.5, 0.3]),
            |p| p.material.bsdf = plastic(0.5, 1.5, 0.0, false),
            |p| p.material.bsdf = plastic(0.6, 1.5, 0.0, false),
            |p| p.material.bsdf = plastic(0.5, 1.4, 0.0, false),
            |p| p.material.bsdf = plastic(0.5, 1.5, 0.2, false),
            |p| p.material.bsdf = plastic(0.5, 1.5, 0.2, true),
            |p| p.material.bsdf = metal("gold", 0.1),
            |p| p.material.bsdf = metal("gold", 0.2),
            |p| p.material.bsdf = metal("silver", 0.2),
            |p| p.material.bsdf = once(FacetModel::Ggx, 1.0),
            |p| p.material.bsdf = once(FacetModel::Beckmann, 1.0),
            |p| p.material.bsdf = once(FacetModel::Beckmann, 0.5),
            |p| {
                let facets = Facets { model: FacetModel::Beckmann, alpha: 0.1 };
                p.material.bsdf = Bsdf::RoughDielectric(RoughDielectric::of(1.5, facets));
            },
            |p| p.material.albedo_texture = Some(texture(1)),
            |p| p.material.albedo_texture = Some(texture(2)),
            |p| p.material.opacity_texture = Some(texture(1)),
            |p| p.material.opacity_texture = Some(clamped(1)),
            |p| p.material.metallic_roughness_texture = Some(texture(1)),
            |p| p.material.emission_texture = Some(texture(1)),
            |p| p.material.normal_map = Some(NormalMap { texture: texture(1), scale: 1.0 }),
            |p| p.material.normal_map = Some(NormalMap { texture: texture(1), scale: 0.5 }),
            |p| p.material.normal_map = Some(NormalMap { texture: texture(2), scale: 1.0 }),
            |p| p.material.emission = Rgb::ZERO,
            |p| p.lights[0] = Emitter::Point { position: Vec3::Y, intensity: 2.0 * Rgb::ONE },
            |p| p.lights[0] = Emitter::Point { position: Vec3::X, intensity: Rgb::ONE },
            |p| p.lights.clear(),
            |p| p.lights[0] = Emitter::Spot(spot()),
            |p| p.lights[0] = Emitter::Spot(Spot { cos_inner: 0.9, ..spot() }),
            |p| p.lights[0] = Emitter::Spot(Spot { cos_outer: 0.3, ..spot() }),
            |p| p.lights[0] = Emitter::Spot(Spot { direction: Vec3::X, ..spot() }),
            |p| p.lights[0] = Emitter::Directional(Directional::new(Vec3::X, Rgb::ONE)),
            |p| p.lights[0] = Emitter::Directional(Directional::new(Vec3::Y, Rgb::ONE)),
            |p| p.eye = Vec3::X,
            |p| p.up = Vec3::X,
            |p| p.optics = Optics::Pinhole(FieldOfView::Y(40.0)),
            |p| p.optics = Optics::Pinhole(FieldOfView::X(41.0)),
            |p| p.optics = thin_lens(40.0, 0.1, 1.0),
            |p| p.optics = thin_lens(41.0, 0.1, 1.0),
            |p| p.optics = thin_lens(40.0, 0.2, 1.0),
            |p| p.optics = thin_lens(40.0, 0.1, 2.0),
            |p| p.optics = sensor([1.0, 1.0, 1.0, 1.0]),
            |p| p.optics = sensor([2.0, 1.0, 1.0, 1.0]),
            |p| p.optics = sensor([1.0, 2.0, 1.0, 1.0]),
            |p| p.optics = sensor([1.0, 1.0, 2.0, 1.0]),
            |p| p.optics = sensor([1.0, 1.0, 1.0, 2.0]),
            |p| p.optics = Optics::Orthographic(Extent::X(1.0)),
            |p| p.optics = Optics::Orthographic(Extent::X(2.0)),
            |p| p.optics = Optics::Orthographic(Extent::Y(1.0)),
            |p| p.optics = Optics::Panorama,
            |p| p.optics = fisheye(FisheyeProjection::Equidistant, 180.0),
            |p| p.optics = fisheye(FisheyeProjection::Equidistant, 181.0),
            |p| p.optics = fisheye(FisheyeProjection::Equisolid, 180.0),
        ];
        let mut seen = vec![parts().fingerprint()];
        for change in changes {
            let mut changed = parts();
            change(&mut changed);
            seen.push(changed.fingerprint());
        }
        let count = seen.len();
        seen.sort_unstable();
        seen.dedup();
        assert_eq!(seen.len(), count);
    }

    #[test]
    fn falloffs_of_spots_and_sides_of_emission_count() {
        let spots =
            [Falloff::Quadratic, Falloff::Smoothstep, Falloff::LinearInAngle].map(|falloff| {
                let lights = vec![Emitter::Spot(Spot { falloff, ..spot() })];
                SceneParts { lights, ..parts() }.fingerprint()
            });
        assert!(spots[0] != spots[1] && spots[1] != spots[2] && spots[2] != spots[0]);
        let material = Material { two_sided_emission: true, ..parts().material };
        let both = SceneParts { material, ..parts() };
        assert_ne!(both.fingerprint(), parts().fingerprint());
    }

    #[test]
    fn both_shares_of_a_sheet_and_its_textures_count() {
        let seen = [
            (sheet(0.5, 0.2), None),
            (sheet(0.5, 0.3), None),
            (sheet(0.4, 0.3), None),
            (sheet(0.4, 0.3), Some(texture(1))),
            (sheet(0.4, 0.3), Some(texture(2))),
        ]
        .map(|(bsdf, transmittance_texture)| {
            let material = Material { bsdf, transmittance_texture, ..parts().material };
            SceneParts { material, ..parts() }.fingerprint()
        });
        let own = parts().fingerprint();
        let is_new = |index: usize| seen[index] != own && !seen[..index].contains(&seen[index]);
        assert!((0..seen.len()).all(is_new), "{seen:?} {own}");
    }

    #[test]
    fn mesh_material_and_transform_of_each_placement_count() {
        let mesh = |x: f32| Mesh {
            positions: vec![Vec3::ZERO, x * Vec3::X, Vec3::Y],
            triangles: vec![[0, 1, 2]],
            ..Mesh::default()
        };
        let fingerprint = |placed: [(u32, u32, f64); 2]| {
            let place = |(mesh, material, x): (u32, u32, f64)| {
                let moved = Transform::new(DAffine3::from_translation(DVec3::X * x)).unwrap();
                Placement { mesh, material, transform: (x > 0.0).then_some(moved) }
            };
            let placements = placed.map(place).to_vec();
            let arrangement = Arrangement { meshes: vec![mesh(1.0), mesh(2.0)], placements };
            let material = |albedo| Material::new("m", Bsdf::diffuse(Rgb::splat(albedo)));
            let SceneParts { lights, eye, up, optics, .. } = parts();
            let camera = Camera::with_optics(eye, Vec3::Z, up, optics).unwrap();
            let materials = vec![material(0.5), material(0.6)];
            let scene = Scene::new("".into(), arrangement, materials, lights, camera, vec![]);
            scene.unwrap().fingerprint()
        };
        let first = fingerprint([(0, 0, 1.0), (1, 0, 0.0)]);
        assert_eq!(first, fingerprint([(0, 0, 1.0), (1, 0, 0.0)]));
        for changed in [
            [(0, 0, 2.0), (1, 0, 0.0)],
            [(0, 1, 1.0), (1, 0, 0.0)],
            [(1, 0, 1.0), (1, 0, 0.0)],
            [(0, 0, 1.0), (0, 0, 0.0)],
            [(1, 0, 1.0), (0, 0, 0.0)],
        ] {
            assert_ne!(first, fingerprint(changed), "{changed:?}");
        }
    }

    #[test]
    fn names_and_regions_do_not_count() {
        let mut renamed = parts();
        renamed.name = "b";
        renamed.mesh.name = "c".into();
        renamed.material.name = "d".into();
        renamed.regions.push(Region { name: "r".into(), rectangles: vec![] });
        assert_eq!(renamed.fingerprint(), parts().fingerprint());
    }
}
