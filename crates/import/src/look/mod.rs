//! The look of surfaces: the one representation of materials that the readers of all formats fill,
//! and its conversion to a [`Material`].
//!
//! A look is a material with what only a mesh decides: the map of its texture coordinates, and
//! bumps. Texture coordinates have v up.

mod bumps;
mod paint;
mod pfm;
pub mod picture_file;
mod pictures;

pub use paint::{Paint, picture, picture_of};
pub use pictures::{Encoding, Pictures, radiances};

use bdpm_core::base::math::{Rgb, luminance};
use bdpm_core::scene::bsdf::{
    Bsdf, Dielectric, DiffuseTransmission, FacetModel, Facets, RoughDielectric, SMOOTH_ALPHA,
    ThinDielectric,
};
use bdpm_core::scene::{
    Dispersion, Material, MediumBoundary, Mesh, NormalMap, RefractiveIndex, Texture,
};
use glam::{Affine2, DMat3, Vec2};
use std::sync::Arc;

/// Albedo of surfaces whose file gives none.
pub const DEFAULT_ALBEDO: f32 = 0.5;

/// Default refractive index.
pub const DEFAULT_IOR: f32 = 1.5;

/// The phrase of a warning about a surface for which [`Look::shares_map`] is false.
pub const ONE_MAP: &str = "used the texture coordinates of the first texture for all of";

/// The look of a surface.
#[derive(Clone, Debug)]
pub struct Look {
    /// Scattering, pictures, emission and media. The name may be empty.
    pub material: Material,
    /// Map from the texture coordinates of meshes to those of all pictures: that of the first one.
    pub first_map: Option<Affine2>,
    /// Heights that bend the normals, in scene units at white.
    pub bumps: Option<(Arc<Texture>, f32)>,
    /// Whether rays pass the surface as if it were not there, unless it bounds media.
    pub is_interface: bool,
    /// Whether the format shows it black from behind, and this renderer does not.
    pub is_black_behind: bool,
}

/// The colors of a surface that only scatters diffusely.
struct DiffusePaints {
    reflected: Paint,
    /// `None` if it only reflects.
    transmitted: Option<Paint>,
    /// The back scatters as well.
    two_sided: bool,
}

impl Look {
    /// A uniform surface.
    pub fn new(bsdf: Bsdf) -> Self {
        Self {
            material: Material::new("", bsdf),
            first_map: None,
            bumps: None,
            is_interface: false,
            is_black_behind: false,
        }
    }

    /// Diffuse gray of the default albedo.
    pub fn gray() -> Self {
        Self::new(Bsdf::diffuse(Rgb::splat(DEFAULT_ALBEDO)))
    }

    /// A surface whose albedo is `paint`, and whose BSDF has the color of the paint.
    pub fn painted(paint: Paint, bsdf: impl FnOnce(Rgb) -> Bsdf) -> Self {
        let mut look = Self::new(bsdf(paint.color));
        look.first_map = paint.texture.is_some().then_some(paint.to_uv);
        look.material.albedo_texture = paint.texture;
        look
    }

    /// The interface of two clear media.
    pub fn dielectric(
        [inside, outside]: [RefractiveIndex; 2],
        facets: Facets,
        transmittance: Rgb,
    ) -> Self {
        let eta = inside.at_d() as f32 / outside.at_d() as f32;
        let mut look = Self::new(interface(eta, facets, transmittance));
        look.material.dispersion = Dispersion::new(inside, outside).map(Arc::new);
        look
    }

    /// A clear sheet of relative refractive index `eta`.
    pub fn sheet(eta: f32, transmittance: Rgb) -> Self {
        Self::new(Bsdf::ThinDielectric(ThinDielectric {
            transmittance,
            ..ThinDielectric::new(eta)
        }))
    }

    /// A sheet that keeps this share of light which crosses it at normal incidence, without
    /// reflections.
    pub fn tinted_sheet(eta: f32, internal: Rgb) -> Self {
        Self::new(Bsdf::ThinDielectric(ThinDielectric { internal, ..ThinDielectric::new(eta) }))
    }

    /// A thin sheet that reflects and transmits diffusely by these paints, and whether their
    /// pictures share one map; see [`Self::shares_map`].
    pub fn translucent(reflectance: Paint, transmittance: Paint) -> (Self, bool) {
        let Paint { color, texture, to_uv } = transmittance;
        let mut sheet = DiffuseTransmission::new(reflectance.color, color);
        if reflectance.texture.is_none() && texture.is_none() {
            // Shares that scene files can hold.
            let [reflected, transmitted] = sheet.shares();
            sheet = DiffuseTransmission::new(reflected, transmitted);
        }
        let mut look = Self::painted(reflectance, |_| Bsdf::DiffuseTransmission(sheet));
        let shares_map = texture.is_none() || look.shares_map(to_uv);
        look.material.transmittance_texture = texture;
        (look, shares_map)
    }

    /// The mean of two diffuse surfaces by the share of the second one, and whether pictures became
    /// their means. `None` unless both only reflect or transmit diffusely, and from one or both
    /// sides alike.
    pub fn mixed(a: &Self, b: &Self, share: &Paint) -> Option<(Self, bool)> {
        let [first, second] = [a.diffuse_paints()?, b.diffuse_paints()?];
        if first.two_sided != second.two_sided {
            return None;
        }
        let mean = |colors: &[Rgb]| {
            colors[0] + (colors[1] - colors[0]) * colors[2].clamp(Rgb::ZERO, Rgb::ONE)
        };
        let mixed = |a: &Paint, b: &Paint| Paint::combined(&[a, b, share], mean);
        let (reflected, is_averaged) = mixed(&first.reflected, &second.reflected);
        if first.transmitted.is_none() && second.transmitted.is_none() {
            let bsdf = |albedo| Bsdf::Lambertian { albedo, two_sided: first.two_sided };
            return Some((Self::painted(reflected, bsdf), is_averaged));
        }
        let black = Paint::plain(Rgb::ZERO);
        let [a, b] = [&first, &second].map(|own| own.transmitted.as_ref().unwrap_or(&black));
        let (transmitted, is_other_averaged) = mixed(a, b);
        let (look, shares_map) = Self::translucent(reflected, transmitted);
        Some((look, is_averaged || is_other_averaged || !shares_map))
    }

    /// The colors of a surface that only scatters diffusely.
    fn diffuse_paints(&self) -> Option<DiffusePaints> {
        let Material { opacity, opacity_texture, normal_map, .. } = &self.material;
        let is_plain = opacity.is_none() && opacity_texture.is_none() && normal_map.is_none();
        if !is_plain || self.bumps.is_some() || self.is_interface {
            return None;
        }
        let to_uv = self.first_map.unwrap_or_default();
        let paint = |color, texture: &Option<Arc<Texture>>| {
            let texture = texture.clone();
            Paint { color, texture, to_uv }
        };
        let Material { albedo_texture, transmittance_texture, .. } = &self.material;
        match self.material.bsdf {
            Bsdf::Lambertian { albedo, two_sided } => {
                let reflected = paint(albedo, albedo_texture);
                Some(DiffusePaints { reflected, transmitted: None, two_sided })
            }
            Bsdf::DiffuseTransmission(sheet) => Some(DiffusePaints {
                reflected: paint(sheet.reflectance(), albedo_texture),
                transmitted: Some(paint(sheet.transmittance(), transmittance_texture)),
                two_sided: true,
            }),
            _ => None,
        }
    }

    /// Takes the map of texture coordinates of a further picture. All pictures share the first map.
    /// Returns false if this one has another.
    #[must_use]
    pub fn shares_map(&mut self, to_uv: Affine2) -> bool {
        *self.first_map.get_or_insert(to_uv) == to_uv
    }

    /// Lets only a share of the rays meet the surface: the luminance of `share`. The result is that
    /// of [`Self::shares_map`].
    #[must_use]
    pub fn mask(&mut self, share: &Paint) -> bool {
        let stored = share.stored(|color| Rgb::splat(luminance(color)));
        let factor = if stored.is_some() { 1.0 } else { share.color.x.clamp(0.0, 1.0) };
        self.material.opacity = Some(factor);
        let shares_map = stored.is_none() || self.shares_map(share.to_uv);
        self.material.opacity_texture = stored;
        shares_map
    }

    /// Lets the surface emit the radiance `paint`, W/(m^2 sr). The result is that of
    /// [`Self::shares_map`].
    #[must_use]
    pub fn emit(&mut self, paint: Paint) -> bool {
        let shares_map = paint.texture.is_none() || self.shares_map(paint.to_uv);
        self.material.emission = paint.color;
        self.material.emission_texture = paint.texture;
        shares_map
    }

    /// Bends the normals by a map. The result is that of [`Self::shares_map`].
    #[must_use]
    pub fn bend(&mut self, texture: Arc<Texture>, to_uv: Affine2) -> bool {
        self.bumps = None;
        self.material.normal_map = Some(NormalMap { texture, scale: 1.0 });
        self.shares_map(to_uv)
    }

    /// Bends the normals by heights, `scale` scene units at white. The result is that of
    /// [`Self::shares_map`].
    #[must_use]
    pub fn bump(&mut self, heights: Arc<Texture>, scale: f32, to_uv: Affine2) -> bool {
        self.material.normal_map = None;
        self.bumps = Some((heights, scale));
        self.shares_map(to_uv)
    }

    /// Adds the media on both sides. Light enters them only if the surface transmits light.
    pub fn bound(&mut self, boundary: Option<MediumBoundary>) {
        if self.is_interface && boundary.is_some() {
            let name = std::mem::take(&mut self.material.name);
            *self = Self::sheet(1.0, Rgb::ONE);
            self.material.name = name;
        }
        self.material.boundary = boundary.filter(|_| self.material.bsdf.transmits());
    }

    /// Map from the texture coordinates of meshes to those of the pictures.
    pub fn to_uv(&self) -> Affine2 {
        self.first_map.unwrap_or_default()
    }

    /// The material of this name for meshes without bumps.
    pub fn named(&self, name: &str) -> Material {
        Material { name: name.to_owned(), ..self.material.clone() }
    }

    /// The material of this name for a mesh, which `to_world` transforms.
    pub fn material(&self, name: &str, mesh: &Mesh, to_world: DMat3) -> Material {
        let mut material = self.named(name);
        if let Some((heights, scale)) = &self.bumps {
            material.normal_map = bumps::normal_map(heights, *scale, mesh, to_world);
        }
        material
    }
}

/// Maps the texture coordinates of a mesh. Coordinates that overflow become 0.
pub fn map_uvs(mesh: &mut Mesh, to_uv: Affine2) {
    for uv in &mut mesh.uvs {
        let mapped = to_uv.transform_point2(*uv);
        *uv = if mapped.is_finite() { mapped } else { Vec2::ZERO };
    }
}

/// The interface of clear media, rough or smooth.
fn interface(eta: f32, facets: Facets, transmittance: Rgb) -> Bsdf {
    if facets.alpha < SMOOTH_ALPHA {
        Bsdf::Dielectric(Dielectric { eta, transmittance })
    } else {
        Bsdf::RoughDielectric(RoughDielectric::of(eta, facets).tinted(transmittance))
    }
}

/// Facets of GGX width `alpha` that scatter light to each other.
pub fn correlated(alpha: f32) -> Facets {
    Facets { model: FacetModel::Correlated, alpha }
}

/// The indices of a medium without dispersion and of the vacuum around it.
pub fn in_vacuum(ior: f32) -> [RefractiveIndex; 2] {
    [ior, 1.0].map(|index| RefractiveIndex::Constant(index.into()))
}
