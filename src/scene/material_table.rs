//! `[materials.NAME]` of a scene file.

use super::scene_file::{Albedo, Numbers, Power};
use super::{Material, Texture};
use crate::bsdf::{
    Bsdf, Coated, Conductor, Dielectric, Glossy, Reflectance, RoughDielectric, SMOOTH_ALPHA,
    ThinDielectric,
};
use crate::error::Error;
use crate::math::Rgb;
use crate::scene::mtl;
use crate::scene::text::list;
use crate::settings::as_serde;
use serde::{Deserialize, Deserializer};
use std::path::Path;
use std::sync::Arc;
use toml::Spanned;

/// Refractive index of glass, where nothing else is said.
pub(super) const DEFAULT_IOR: f32 = 1.5;

/// The keys of a material.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct MaterialTable {
    #[serde(default, rename = "type")]
    kind: MaterialKind,
    albedo: Option<Spanned<Albedo>>,
    albedo_texture: Option<Spanned<String>>,
    opacity_texture: Option<Spanned<String>>,
    two_sided: Option<Spanned<bool>>,
    reflectance: Option<Spanned<Albedo>>,
    metal: Option<Spanned<String>>,
    eta: Option<Spanned<Index>>,
    k: Option<Spanned<Power>>,
    ior: Option<Spanned<Ior>>,
    outside_ior: Option<Spanned<Ior>>,
    roughness: Option<Spanned<Roughness>>,
    metallic: Option<Spanned<Metallic>>,
    emission: Option<Power>,
}

/// The materials there are.
#[derive(Clone, Copy, Debug, Default, Deserialize)]
#[serde(rename_all = "kebab-case")]
enum MaterialKind {
    #[default]
    Lambertian,
    Mirror,
    Dielectric,
    ThinDielectric,
    Metal,
    Coated,
    Glossy,
}

impl MaterialKind {
    /// Its name in the file, and the keys that it has besides `type` and `emission`.
    fn keys(self) -> (&'static str, &'static [&'static str]) {
        match self {
            Self::Lambertian => ("lambertian", &["albedo", "albedo_texture", "two_sided"]),
            Self::Mirror => ("mirror", &["reflectance"]),
            Self::Dielectric => ("dielectric", &["ior", "outside_ior", "roughness"]),
            Self::ThinDielectric => ("thin-dielectric", &["ior"]),
            Self::Metal => ("metal", &["metal", "eta", "k", "reflectance", "roughness"]),
            Self::Coated => ("coated", &["albedo", "albedo_texture", "ior"]),
            Self::Glossy => {
                ("glossy", &["albedo", "albedo_texture", "ior", "metallic", "roughness"])
            }
        }
    }
}

/// The error and where in the file it is, bytes.
type Misplaced = (Error, usize);

impl MaterialTable {
    /// The material of these keys, with textures from `folder`.
    ///
    /// # Errors
    /// If a key does not belong to the type, or two contradict each other.
    pub(super) fn material(&self, name: &str, folder: &Path) -> Result<Material, Misplaced> {
        self.check_keys()?;
        let unsaid = if self.albedo_texture.is_some() { 1.0 } else { mtl::DEFAULT_ALBEDO };
        let albedo = rgb(&self.albedo).unwrap_or(Rgb::splat(unsaid));
        let alpha = self.roughness.as_ref().map_or(0.0, |r| r.get_ref().0 * r.get_ref().0);
        let metallic = self.metallic.as_ref().map_or(0.0, |m| m.get_ref().0);
        let ior =
            |key: &Option<Spanned<Ior>>, default| key.as_ref().map_or(default, |i| i.get_ref().0);
        let eta = ior(&self.ior, DEFAULT_IOR) / ior(&self.outside_ior, 1.0);
        let bsdf = match self.kind {
            MaterialKind::Lambertian => {
                let two_sided = self.two_sided.as_ref().is_none_or(|both| *both.get_ref());
                Bsdf::Lambertian { albedo, two_sided }
            }
            MaterialKind::Mirror => {
                Bsdf::Mirror { reflectance: rgb(&self.reflectance).unwrap_or(Rgb::ONE) }
            }
            MaterialKind::Dielectric => dielectric(eta, alpha),
            MaterialKind::ThinDielectric => Bsdf::ThinDielectric(ThinDielectric { eta }),
            MaterialKind::Metal => Bsdf::Conductor(Conductor::new(self.metal()?, alpha)),
            MaterialKind::Coated => Bsdf::Coated(Coated::new(albedo, eta)),
            MaterialKind::Glossy => Bsdf::Glossy(Glossy::new(albedo, metallic, eta, alpha)),
        };
        let emission = self.emission.map_or(Rgb::ZERO, |emission| emission.0);
        Ok(Material {
            emission,
            albedo_texture: texture(&self.albedo_texture, folder)?,
            opacity_texture: texture(&self.opacity_texture, folder)?,
            ..Material::new(name, bsdf)
        })
    }

    /// Refuses keys of other types.
    fn check_keys(&self) -> Result<(), Misplaced> {
        fn place<T>(key: &Option<Spanned<T>>) -> Option<usize> {
            key.as_ref().map(|value| value.span().start)
        }
        let given = [
            ("albedo", place(&self.albedo)),
            ("albedo_texture", place(&self.albedo_texture)),
            ("two_sided", place(&self.two_sided)),
            ("reflectance", place(&self.reflectance)),
            ("metal", place(&self.metal)),
            ("eta", place(&self.eta)),
            ("k", place(&self.k)),
            ("ior", place(&self.ior)),
            ("outside_ior", place(&self.outside_ior)),
            ("roughness", place(&self.roughness)),
            ("metallic", place(&self.metallic)),
        ];
        let (kind, keys) = self.kind.keys();
        for (key, place) in given {
            if let Some(place) = place
                && !keys.contains(&key)
            {
                let problem = format!("a material of type `{kind}` has no `{key}`");
                let advice = format!("remove it, or use {}", list(keys.iter().copied()));
                return Err((Error::new(problem, advice), place));
            }
        }
        Ok(())
    }

    /// How much a metal reflects: by name, by index, or by color; white if nothing is said.
    fn metal(&self) -> Result<Reflectance, Misplaced> {
        let one = "give one of `metal`, `eta` with `k`, and `reflectance`";
        let twice = |place: usize| (Error::new("the metal is described twice", one), place);
        match (&self.metal, &self.eta, &self.k, &self.reflectance) {
            (Some(name), None, None, None) => Reflectance::named(name.get_ref()).ok_or_else(|| {
                let problem = format!("unknown metal `{}`", name.get_ref());
                let advice = format!("use one of {}", list(Reflectance::NAMES));
                (Error::new(problem, advice), name.span().start)
            }),
            (None, Some(eta), Some(k), None) => {
                Ok(Reflectance::Measured { eta: eta.get_ref().0, k: k.get_ref().0 })
            }
            (None, None, None, reflectance) => {
                Ok(Reflectance::Artist { normal: rgb(reflectance).unwrap_or(Rgb::ONE) })
            }
            (Some(name), ..) => Err(twice(name.span().start)),
            (None, Some(eta), None, _) => {
                Err((Error::new("`eta` comes without `k`", one), eta.span().start))
            }
            (None, None, Some(k), _) => {
                Err((Error::new("`k` comes without `eta`", one), k.span().start))
            }
            (None, Some(_), Some(_), Some(reflectance)) => Err(twice(reflectance.span().start)),
        }
    }
}

fn texture(
    name: &Option<Spanned<String>>,
    folder: &Path,
) -> Result<Option<Arc<Texture>>, Misplaced> {
    let Some(name) = name else { return Ok(None) };
    let path = folder.join(name.get_ref());
    let misplaced = |problem: String| {
        let advice = "give a PNG or JPEG file relative to the folder of the scene file";
        (Error::new(problem, advice), name.span().start)
    };
    if !path.is_file() {
        return Err(misplaced(format!("there is no texture `{}`", name.get_ref())));
    }
    let texture = Texture::load(&path)
        .map_err(|e| misplaced(format!("`{}`: {}", name.get_ref(), e.problem())))?;
    Ok(Some(Arc::new(texture)))
}

/// An interface, rough or smooth.
pub(super) fn dielectric(eta: f32, alpha: f32) -> Bsdf {
    if alpha < SMOOTH_ALPHA {
        Bsdf::Dielectric(Dielectric { eta })
    } else {
        Bsdf::RoughDielectric(RoughDielectric::new(eta, alpha))
    }
}

fn rgb(key: &Option<Spanned<Albedo>>) -> Option<Rgb> {
    key.as_ref().map(|value| value.get_ref().0)
}

/// Defines a number within bounds, or one per channel.
macro_rules! bounded {
    ($(#[$doc:meta])* $name:ident($inner:ty), $low:expr, $high:expr, $what:literal, $advice:literal) => {
        $(#[$doc])*
        #[derive(Clone, Copy, Debug)]
        struct $name($inner);

        impl<'de> Deserialize<'de> for $name {
            fn deserialize<D: Deserializer<'de>>(from: D) -> Result<Self, D::Error> {
                let value = <$inner as Bounded>::read(from)?;
                if ($low..=$high).contains(&value.least()) && ($low..=$high).contains(&value.most()) {
                    return Ok(Self(value));
                }
                Err(as_serde(Error::new(concat!("the ", $what, " is out of range"), $advice)))
            }
        }
    };
}

/// What can be checked against bounds.
trait Bounded: Sized {
    fn read<'de, D: Deserializer<'de>>(from: D) -> Result<Self, D::Error>;
    fn least(&self) -> f32;
    fn most(&self) -> f32;
}

impl Bounded for f32 {
    fn read<'de, D: Deserializer<'de>>(from: D) -> Result<Self, D::Error> {
        Self::deserialize(from)
    }
    fn least(&self) -> f32 {
        *self
    }
    fn most(&self) -> f32 {
        *self
    }
}

impl Bounded for Rgb {
    fn read<'de, D: Deserializer<'de>>(from: D) -> Result<Self, D::Error> {
        Ok(Numbers::deserialize(from)?.values.as_vec3())
    }
    fn least(&self) -> f32 {
        self.min_element()
    }
    fn most(&self) -> f32 {
        self.max_element()
    }
}

bounded!(
    /// Refractive index of a clear medium.
    Ior(f32), 0.1, 10.0, "refractive index",
    "give a number from 0.1 to 10, such as 1.5 for glass"
);
bounded!(
    /// Real part of a metal's refractive index.
    Index(Rgb), 1e-3, 100.0, "refractive index",
    "give a number from 0.001 to 100, or one per channel"
);
bounded!(
    /// The square root of the GGX width.
    Roughness(f32), 0.0, 1.0, "roughness", "give a number from 0 (smooth) to 1"
);
bounded!(
    /// Share of a metal.
    Metallic(f32), 0.0, 1.0, "metallic share", "give a number from 0 to 1"
);
