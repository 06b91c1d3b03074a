//! A 64-bit fingerprint that identifies a scene.

use super::texture::{Sampling, Texture};
use super::{
    AimedDistribution, Camera, Directional, Emitter, Environment, Extent, FieldOfView, InsetGrid,
    Material, Medium, MediumBoundary, Mesh, Meter, MeterKind, Meters, NormalMap, Optics, Placement,
    Scene,
};
use crate::base::math::Rgb;
use crate::scene::bsdf::{Bsdf, FacetModel, Facets, PrincipledParameters, Reflectance};
use glam::Vec3;
use xxhash_rust::xxh3::Xxh3Default;

impl Scene {
    /// A hash (XXH3) of everything that an image depends on: geometry, materials, lights and
    /// camera, bit by bit and in order. Names, regions and paths of files do not count. It is the
    /// same on every machine.
    pub fn fingerprint(&self) -> u64 {
        let mut hash = Hash(Xxh3Default::new());
        // Every list starts with its length: no two scenes write the same bytes.
        hash.count(self.placements.len());
        for Placement { mesh, material, transform } in self.placements.iter() {
            hash.u32(*material);
            let mesh = &self.meshes[*mesh as usize];
            match transform {
                None => hash.mesh(mesh),
                // Instances and copies have one fingerprint.
                Some(transform) => hash.mesh(&mesh.moved(transform)),
            }
        }
        hash.count(self.materials.len());
        self.materials.iter().for_each(|material| hash.material(material));
        // Emissive triangles follow from meshes and materials.
        if let Some(environment) = self.lights.environment() {
            hash.environment(environment);
        }
        for emitter in self.lights.emitters() {
            hash.emitter(emitter);
        }
        if let Some(distance) = self.own_ray_offset() {
            hash.text("ray offset");
            hash.f32(distance);
        }
        hash.camera(&self.camera);
        if let Some(meters) = self.meters() {
            hash.meters(meters);
        }
        if let Some(medium) = self.filling_medium() {
            hash.text("filling medium");
            hash.medium(medium);
        }
        hash.0.digest()
    }
}

struct Hash(Xxh3Default);

impl Hash {
    fn u32(&mut self, value: u32) {
        self.0.update(&value.to_le_bytes());
    }

    fn count(&mut self, value: usize) {
        self.0.update(&(value as u64).to_le_bytes());
    }

    fn text(&mut self, value: &str) {
        self.0.update(value.as_bytes());
    }

    fn f32(&mut self, value: f32) {
        self.u32(value.to_bits());
    }

    fn vec3(&mut self, value: Vec3) {
        value.to_array().into_iter().for_each(|value| self.f32(value));
    }

    /// Writes a tag and vectors, then numbers.
    fn record(&mut self, tag: u32, vectors: &[Vec3], numbers: &[f32]) {
        self.u32(tag);
        vectors.iter().for_each(|&vector| self.vec3(vector));
        numbers.iter().for_each(|&number| self.f32(number));
    }

    /// Writes a list of vectors after its name; nothing if it is empty.
    fn vertex_list(&mut self, name: &str, vectors: &[Vec3]) {
        if !vectors.is_empty() {
            self.text(name);
            vectors.iter().for_each(|&vector| self.vec3(vector));
        }
    }

    fn mesh(&mut self, mesh: &Mesh) {
        self.count(mesh.positions.len());
        mesh.positions.iter().for_each(|&position| self.vec3(position));
        self.vertex_list("normals", &mesh.normals);
        if !mesh.uvs.is_empty() {
            self.text("uvs");
            mesh.uvs.iter().for_each(|uv| uv.to_array().into_iter().for_each(|x| self.f32(x)));
        }
        self.vertex_list("tangents", &mesh.tangents);
        self.vertex_list("colors", &mesh.colors);
        self.count(mesh.triangles.len());
        mesh.triangles.iter().flatten().for_each(|&index| self.u32(index));
    }

    fn medium(&mut self, medium: &Medium) {
        let Medium { name: _, absorption, scattering, asymmetry, priority } = medium;
        let vectors = [*absorption, *scattering];
        self.record(*priority as u32, &vectors, &[*asymmetry]);
    }

    fn material(&mut self, material: &Material) {
        let Material {
            name: _,
            bsdf,
            dispersion,
            albedo_texture,
            metallic_roughness_texture,
            opacity_texture,
            opacity,
            normal_map,
            emission,
            emission_texture,
            luminous_opening,
            hidden_from_camera,
            boundary,
        } = material;
        if let Some(MediumBoundary { interior, exterior }) = boundary {
            for (name, medium) in [("interior", interior), ("exterior", exterior)] {
                if let Some(medium) = medium {
                    self.text(name);
                    self.medium(medium);
                }
            }
        }
        for (name, texture) in [
            ("albedo", albedo_texture),
            ("metallic roughness", metallic_roughness_texture),
            ("opacity", opacity_texture),
            ("emission", emission_texture),
        ] {
            if let Some(texture) = texture {
                self.text(name);
                self.texture(texture);
            }
        }
        if let Some(NormalMap { texture, scale }) = normal_map {
            self.text("normal");
            self.texture(texture);
            self.f32(*scale);
        }
        if let Some(opacity) = opacity {
            self.text("translucent");
            self.f32(*opacity);
        }
        if *hidden_from_camera {
            self.text("hidden");
        }
        if let Some(opening) = luminous_opening {
            self.text(if opening.is_flat() { "flat opening" } else { "opening" });
            self.aimed(opening.aimed());
        }
        if let Some(dispersion) = dispersion {
            self.text("dispersion");
            dispersion.all_relative().iter().for_each(|&index| self.f32(index));
        }
        self.bsdf(bsdf);
        self.vec3(*emission);
    }

    fn texture(&mut self, texture: &Texture) {
        texture.size().into_iter().for_each(|size| self.u32(size));
        self.0.update(texture.texels().as_flattened());
        let Sampling { wrap, nearest } = texture.sampling();
        if texture.sampling() != Sampling::default() {
            self.text("sampled");
            wrap.into_iter().for_each(|wrap| self.u32(wrap as u32));
            self.u32(nearest.into());
        }
    }

    fn bsdf(&mut self, bsdf: &Bsdf) {
        match bsdf {
            Bsdf::Lambertian { albedo, two_sided: true } => self.record(1, &[*albedo], &[]),
            Bsdf::Lambertian { albedo, two_sided: false } => self.record(2, &[*albedo], &[]),
            Bsdf::Mirror { reflectance } => self.record(3, &[*reflectance], &[]),
            Bsdf::Dielectric(interface) => {
                self.record(4, &[], &[interface.eta]);
                self.transmittance(interface.transmittance);
            }
            Bsdf::ThinDielectric(sheet) => {
                self.record(5, &[], &[sheet.eta]);
                self.transmittance(sheet.transmittance);
            }
            Bsdf::Conductor(conductor) => {
                let alpha = conductor.alpha();
                match conductor.reflectance() {
                    Reflectance::Measured { eta, k } => self.record(6, &[eta, k], &[alpha]),
                    Reflectance::Artist { normal } => self.record(7, &[normal], &[alpha]),
                }
                if let Some((model, tint)) = conductor.single() {
                    self.text("once");
                    self.record(model as u32, &[tint], &[]);
                }
            }
            Bsdf::RoughDielectric(interface) => {
                self.record(8, &[], &[interface.eta(), interface.alpha()]);
                if interface.model() != FacetModel::Correlated {
                    self.text("facets");
                    self.u32(interface.model() as u32);
                }
                self.transmittance(interface.transmittance());
            }
            Bsdf::Coated(coated) => self.record(9, &[coated.albedo()], &[coated.eta()]),
            Bsdf::Glossy(glossy) => {
                let numbers = [glossy.metallic(), glossy.normal_reflectance(), glossy.alpha()];
                self.record(10, &[glossy.albedo()], &numbers);
            }
            Bsdf::Plastic(plastic) => {
                let Facets { model, alpha } = plastic.facets();
                self.record(11, &[plastic.albedo(), plastic.tint()], &[plastic.eta(), alpha]);
                self.u32(model as u32);
                self.u32(plastic.is_nonlinear().into());
            }
            Bsdf::Principled(principled) => {
                let PrincipledParameters {
                    base_color,
                    roughness,
                    anisotropic,
                    metallic,
                    spec_trans,
                    eta,
                    spec_tint,
                    sheen,
                    sheen_tint,
                    flatness,
                    clearcoat,
                    clearcoat_gloss,
                    two_sided,
                } = *principled.parameters();
                let numbers = [
                    roughness,
                    anisotropic,
                    metallic,
                    spec_trans,
                    eta,
                    spec_tint,
                    sheen,
                    sheen_tint,
                    flatness,
                    clearcoat,
                    clearcoat_gloss,
                ];
                self.record(12, &[base_color], &numbers);
                self.u32(two_sided.into());
            }
        }
    }

    fn transmittance(&mut self, color: Rgb) {
        if color != Rgb::ONE {
            self.text("tinted");
            self.vec3(color);
        }
    }

    fn environment(&mut self, environment: &Environment) {
        environment.size().into_iter().for_each(|size| self.u32(size));
        environment.pixels().for_each(|pixel| self.vec3(pixel));
        self.f32(environment.turn());
        if let Some((InsetGrid { first, replaced, size }, pixels)) = environment.inset() {
            self.text("inset");
            [first, replaced, size].into_iter().flatten().for_each(|count| self.u32(count));
            pixels.for_each(|pixel| self.vec3(pixel));
        }
    }

    fn emitter(&mut self, emitter: &Emitter) {
        match emitter {
            Emitter::Point { position, intensity } => self.record(1, &[*position, *intensity], &[]),
            Emitter::Spot(spot) => {
                let vectors = [spot.position, spot.direction, spot.intensity];
                self.record(2, &vectors, &[spot.cos_inner, spot.cos_outer]);
            }
            Emitter::Directional(Directional { direction, irradiance, .. }) => {
                self.record(3, &[*direction, *irradiance], &[]);
            }
            Emitter::Luminaire(lamp) => {
                self.record(4, &[lamp.position], &[]);
                self.aimed(&lamp.aimed);
            }
            Emitter::Triangle { .. } | Emitter::Textured(_) | Emitter::Opening(_) => {}
        }
    }

    fn aimed(&mut self, aimed: &AimedDistribution) {
        let own = aimed.distribution();
        self.u32(own.photometry() as u32);
        let lists = [own.polar(), own.azimuth(), own.values(), &aimed.axes().to_cols_array()];
        for list in lists {
            self.count(list.len());
            list.iter().for_each(|value| self.0.update(&value.to_bits().to_le_bytes()));
        }
        self.vec3(aimed.factor());
    }

    fn camera(&mut self, camera: &Camera) {
        let frame = [camera.position(), camera.direction(), camera.up()];
        frame.into_iter().for_each(|vector| self.vec3(vector));
        if camera.shift() != [0.0; 2] {
            self.text("shifted");
            camera.shift().into_iter().for_each(|share| self.f32(share));
        }
        match camera.optics() {
            Optics::Pinhole(field_of_view) => self.field_of_view(field_of_view),
            Optics::ThinLens { field_of_view, aperture_radius, focus_distance } => {
                self.u32(3);
                self.field_of_view(field_of_view);
                self.f32(aperture_radius);
                self.f32(focus_distance);
            }
            Optics::Sensor { width, disc_distance, disc_radius, exposure } => {
                self.record(4, &[], &[width, disc_distance, disc_radius, exposure]);
            }
            Optics::Orthographic(Extent::X(across)) => self.record(5, &[], &[across]),
            Optics::Orthographic(Extent::Y(across)) => self.record(6, &[], &[across]),
            Optics::Panorama => self.record(7, &[], &[]),
            Optics::Fisheye { projection, field_of_view } => {
                self.record(8 + projection as u32, &[], &[field_of_view]);
            }
        }
    }

    fn meters(&mut self, meters: &Meters) {
        self.text("meters");
        self.u32(u32::from(meters.kind == MeterKind::Irradiance));
        self.count(meters.list.len());
        for Meter { position, normal, half_angle } in &meters.list {
            self.record(0, &[*position, *normal], &[*half_angle]);
        }
    }

    fn field_of_view(&mut self, field_of_view: FieldOfView) {
        match field_of_view {
            FieldOfView::X(degrees) => self.record(1, &[], &[degrees]),
            FieldOfView::Y(degrees) => self.record(2, &[], &[degrees]),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::bsdf::{
        Coated, Conductor, Dielectric, Glossy, Plastic, RoughDielectric, ThinDielectric,
    };
    use crate::scene::texture::Wrap;
    use crate::scene::{FisheyeProjection, Region, Spot};
    use glam::Vec2;
    use std::sync::Arc;

    fn metal(name: &str, alpha: f32) -> Bsdf {
        Bsdf::Conductor(Conductor::new(Reflectance::named(name).unwrap(), alpha))
    }

    fn once(model: FacetModel, tint: f32) -> Bsdf {
        let facets = Facets { model, alpha: 0.2 };
        let gold = Reflectance::named("gold").unwrap();
        Bsdf::Conductor(Conductor::once(gold, facets, Rgb::splat(tint)))
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
    fn names_and_regions_do_not_count() {
        let mut renamed = parts();
        renamed.name = "b";
        renamed.mesh.name = "c".into();
        renamed.material.name = "d".into();
        renamed.regions.push(Region { name: "r".into(), rectangles: vec![] });
        assert_eq!(renamed.fingerprint(), parts().fingerprint());
    }
}
