//! What makes two scenes the same, in 64 bits.

use super::texture::{Sampling, Texture};
use super::{
    Camera, Emitter, Environment, FieldOfView, Material, Mesh, NormalMap, Optics, Placement, Scene,
};
use crate::base::math::Rgb;
use crate::scene::bsdf::{Bsdf, FacetModel, Reflectance};
use glam::Vec3;
use xxhash_rust::xxh3::Xxh3Default;

impl Scene {
    /// A hash (XXH3) of all that an image depends on: geometry, materials, lights and camera, bit
    /// by bit and in order. Names and regions do not count, nor does where the files are. The same
    /// on every machine.
    pub fn fingerprint(&self) -> u64 {
        let mut hash = Hash(Xxh3Default::new());
        // Every list starts with its length, so that no two scenes write the same bytes.
        hash.count(self.placements.len());
        for Placement { mesh, material, transform } in &self.placements {
            hash.u32(*material);
            let mesh = &self.meshes[*mesh as usize];
            match transform {
                None => hash.mesh(mesh),
                // Whether it is held once does not show.
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
        hash.camera(&self.camera);
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

    fn rgb(&mut self, value: Rgb) {
        self.vec3(value);
    }

    fn mesh(&mut self, mesh: &Mesh) {
        self.count(mesh.positions.len());
        mesh.positions.iter().for_each(|&position| self.vec3(position));
        if !mesh.normals.is_empty() {
            self.text("normals");
            mesh.normals.iter().for_each(|&normal| self.vec3(normal));
        }
        if !mesh.uvs.is_empty() {
            self.text("uvs");
            mesh.uvs.iter().for_each(|uv| uv.to_array().into_iter().for_each(|x| self.f32(x)));
        }
        if !mesh.tangents.is_empty() {
            self.text("tangents");
            mesh.tangents.iter().for_each(|&tangent| self.vec3(tangent));
        }
        if !mesh.colors.is_empty() {
            self.text("colors");
            mesh.colors.iter().for_each(|&color| self.rgb(color));
        }
        self.count(mesh.triangles.len());
        mesh.triangles.iter().flatten().for_each(|&index| self.u32(index));
    }

    fn material(&mut self, material: &Material) {
        let Material {
            name: _,
            bsdf,
            albedo_texture,
            metallic_roughness_texture,
            opacity_texture,
            opacity,
            normal_map,
            emission,
            emission_texture,
            hidden_from_camera,
        } = material;
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
        self.bsdf(bsdf);
        self.rgb(*emission);
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
            Bsdf::Lambertian { albedo, two_sided } => {
                self.u32(if *two_sided { 1 } else { 2 });
                self.rgb(*albedo);
            }
            Bsdf::Mirror { reflectance } => {
                self.u32(3);
                self.rgb(*reflectance);
            }
            Bsdf::Dielectric(interface) => {
                self.u32(4);
                self.f32(interface.eta);
                self.transmittance(interface.transmittance);
            }
            Bsdf::ThinDielectric(sheet) => {
                self.u32(5);
                self.f32(sheet.eta);
                self.transmittance(sheet.transmittance);
            }
            Bsdf::Conductor(conductor) => {
                match conductor.reflectance() {
                    Reflectance::Measured { eta, k } => {
                        self.u32(6);
                        self.rgb(eta);
                        self.rgb(k);
                    }
                    Reflectance::Artist { normal } => {
                        self.u32(7);
                        self.rgb(normal);
                    }
                }
                self.f32(conductor.alpha());
                if let Some((model, tint)) = conductor.single() {
                    self.text("once");
                    self.u32(model as u32);
                    self.rgb(tint);
                }
            }
            Bsdf::RoughDielectric(interface) => {
                self.u32(8);
                self.f32(interface.eta());
                self.f32(interface.alpha());
                if interface.model() != FacetModel::Correlated {
                    self.text("facets");
                    self.u32(interface.model() as u32);
                }
                self.transmittance(interface.transmittance());
            }
            Bsdf::Coated(coated) => {
                self.u32(9);
                self.rgb(coated.albedo());
                self.f32(coated.eta());
            }
            Bsdf::Glossy(glossy) => {
                self.u32(10);
                self.rgb(glossy.albedo());
                let numbers = [glossy.metallic(), glossy.normal_reflectance(), glossy.alpha()];
                numbers.into_iter().for_each(|number| self.f32(number));
            }
        }
    }

    fn transmittance(&mut self, color: Rgb) {
        if color != Rgb::ONE {
            self.text("tinted");
            self.rgb(color);
        }
    }

    fn environment(&mut self, environment: &Environment) {
        let ([width, height], radiance, turn) = environment.parts();
        self.u32(width);
        self.u32(height);
        radiance.iter().for_each(|pixel| self.rgb(*pixel));
        self.f32(turn);
    }

    fn emitter(&mut self, emitter: &Emitter) {
        match emitter {
            Emitter::Point { position, intensity } => {
                self.u32(1);
                self.vec3(*position);
                self.rgb(*intensity);
            }
            Emitter::Spot(spot) => {
                self.u32(2);
                self.vec3(spot.position);
                self.vec3(spot.direction);
                self.rgb(spot.intensity);
                self.f32(spot.cos_inner);
                self.f32(spot.cos_outer);
            }
            Emitter::Directional(light) => {
                self.u32(3);
                self.vec3(light.direction);
                self.rgb(light.irradiance);
            }
            Emitter::Triangle { .. } | Emitter::Textured(_) => {}
        }
    }

    fn camera(&mut self, camera: &Camera) {
        self.vec3(camera.position());
        self.vec3(camera.direction());
        self.vec3(camera.up());
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
                self.u32(4);
                for value in [width, disc_distance, disc_radius, exposure] {
                    self.f32(value);
                }
            }
        }
    }

    fn field_of_view(&mut self, field_of_view: FieldOfView) {
        let (tag, degrees) = match field_of_view {
            FieldOfView::X(degrees) => (1, degrees),
            FieldOfView::Y(degrees) => (2, degrees),
        };
        self.u32(tag);
        self.f32(degrees);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::bsdf::{
        Coated, Conductor, Dielectric, Facets, Glossy, RoughDielectric, ThinDielectric,
    };
    use crate::scene::texture::Wrap;
    use crate::scene::{Directional, Region, Spot};
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

    fn texture(code: u8) -> Arc<Texture> {
        Arc::new(Texture::new(1, 1, vec![[code; 4]]))
    }

    fn clamped(code: u8) -> Arc<Texture> {
        let sampling = Sampling { wrap: [Wrap::Clamp; 2], nearest: false };
        Arc::new(Texture::clone(&texture(code)).sampled(sampling))
    }

    #[derive(Clone)]
    struct Parts {
        name: &'static str,
        mesh: Mesh,
        material: Material,
        lights: Vec<Emitter>,
        eye: Vec3,
        up: Vec3,
        optics: Optics,
        regions: Vec<Region>,
    }

    impl Parts {
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

    fn parts() -> Parts {
        let positions = vec![Vec3::ZERO, Vec3::X, Vec3::Y, Vec3::ONE];
        let bsdf = Bsdf::diffuse(Rgb::splat(0.5));
        Parts {
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
    fn every_change_that_shows_is_seen() {
        let changes: [fn(&mut Parts); 66] = [
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
