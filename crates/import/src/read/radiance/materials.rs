//! Materials and what modifies them.

use super::patterns;
use super::tokens::Primitive;
use crate::builder::Builder;
use crate::look::{Look, Paint};
use crate::look::{correlated, in_vacuum};
use crate::warnings::GroupedWarnings;
use bdpm_core::base::error::{Error, Result};
use bdpm_core::base::math::Rgb;
use bdpm_core::base::photometry::LUMENS_PER_WATT;
use bdpm_core::scene::bsdf::{Bsdf, DiffuseTransmission, Facets, Glossy};
use bdpm_core::scene::{Medium, MediumBoundary};
use glam::DAffine3;
use std::collections::HashMap;
use std::path::Path;
use std::rc::Rc;
use std::sync::Arc;

/// Lumens of a watt in Radiance, whatever its spectrum.
const RADIANCE_LUMENS_PER_WATT: f32 = 179.0;

/// Refractive index of `glass`.
const GLASS: f32 = 1.52;

/// Modifiers of modifiers, at most.
const MAX_CHAIN: usize = 64;

/// Radiance of a color of a light source: a lamp has as many lumens as in Radiance.
pub fn emitted([r, g, b]: [f64; 3]) -> Rgb {
    let factor = RADIANCE_LUMENS_PER_WATT / LUMENS_PER_WATT;
    Rgb::new(r as f32, g as f32, b as f32) * factor
}

/// Kinds of primitives that are no surfaces.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    Material,
    /// A pattern or texture of what modifies it.
    Pattern,
    /// A mixture of two others.
    Mixture,
    Alias,
}

impl Kind {
    /// The kind of a primitive; `None` for surfaces and unknown ones.
    pub fn of(kind: &str) -> Option<Self> {
        Some(match kind {
            "plastic" | "metal" | "trans" | "plastic2" | "metal2" | "trans2" | "ashik2"
            | "glass" | "dielectric" | "interface" | "mirror" | "light" | "glow" | "illum"
            | "spotlight" | "mist" | "antimatter" | "prism1" | "prism2" | "BRTDfunc"
            | "plasfunc" | "metfunc" | "transfunc" | "plasdata" | "metdata" | "transdata"
            | "BSDF" | "aBSDF" | "WGMDfunc" => Self::Material,
            "colorfunc" | "brightfunc" | "colordata" | "brightdata" | "colorpict" | "colortext"
            | "brighttext" | "texfunc" | "texdata" | "spectrum" | "specfile" | "specdata"
            | "specfunc" | "specpict" => Self::Pattern,
            "mixfunc" | "mixdata" | "mixpict" | "mixtext" => Self::Mixture,
            "alias" => Self::Alias,
            _ => return None,
        })
    }
}

/// A primitive with what modified it when it was defined.
#[derive(Debug)]
pub struct Definition {
    pub primitive: Primitive,
    pub modifier: Option<Rc<Definition>>,
    /// From the coordinates of its file to those of the scene.
    pub map: DAffine3,
    /// The file that it is in.
    pub file: Rc<Path>,
}

/// All materials so far. A later one of the same name replaces an earlier one for what follows.
#[derive(Default)]
pub struct Materials {
    named: HashMap<String, Rc<Definition>>,
    /// Names that each open scope has defined, with what they were before.
    scopes: Vec<Vec<(String, Option<Rc<Definition>>)>>,
    /// Index in the scene by the address of a definition, which is kept alive.
    indices: HashMap<*const Definition, (u32, Rc<Definition>)>,
}

impl Materials {
    /// Takes a material or pattern of a file that is placed by a map.
    ///
    /// # Errors
    /// If it refers to what is not defined.
    pub fn define(
        &mut self,
        own: &Primitive,
        (file, map): (&Rc<Path>, DAffine3),
        warnings: &mut GroupedWarnings,
    ) -> Result<()> {
        let modifier = match &own.modifier[..] {
            "void" => None,
            name => Some(self.named(name, own)?),
        };
        let definition = match Kind::of(&own.kind) {
            Some(Kind::Alias) => self.named(&own.words[0], own)?,
            Some(Kind::Mixture) => {
                warnings.skipped(
                    "used the foreground, or the background of a `void` one, of the mixtures",
                    &own.name,
                );
                // The foreground is transparent if it is `void`.
                let mut both = own.words.iter().take(2);
                match both.find(|name| *name != "void") {
                    None => modifier.ok_or_else(|| undefined("void", own))?,
                    Some(name) => self.named(name, own)?,
                }
            }
            _ => {
                Rc::new(Definition { primitive: own.clone(), modifier, map, file: Rc::clone(file) })
            }
        };
        let before = self.named.insert(own.name.clone(), definition);
        if let Some(scope) = self.scopes.last_mut() {
            scope.push((own.name.clone(), before));
        }
        Ok(())
    }

    /// Opens a scope, whose definitions end with it.
    pub fn enter(&mut self) {
        self.scopes.push(Vec::new());
    }

    /// Closes the last scope.
    pub fn leave(&mut self) {
        // In reverse order, because a name may be defined twice.
        for (name, before) in self.scopes.pop().into_iter().flatten().rev() {
            match before {
                Some(own) => self.named.insert(name, own),
                None => self.named.remove(&name),
            };
        }
    }

    fn named(&self, name: &str, of: &Primitive) -> Result<Rc<Definition>> {
        self.named.get(name).cloned().ok_or_else(|| undefined(name, of))
    }

    /// The material that a modifier leads to, and the patterns on the way.
    ///
    /// # Errors
    /// If there is none.
    pub fn resolve(&self, modifier: &str) -> Result<(Rc<Definition>, Vec<Rc<Definition>>)> {
        let problem = format!("the material `{modifier}` is not defined");
        let missing = || Error::new(problem.clone(), "define it before the surface that has it");
        let (mut own, mut patterns) = (self.named.get(modifier).cloned(), Vec::new());
        for _ in 0..MAX_CHAIN {
            let Some(definition) = own else { return Err(missing()) };
            if Kind::of(&definition.primitive.kind) == Some(Kind::Material) {
                let mut below = definition.modifier.clone();
                while let Some(pattern) = below.filter(|_| patterns.len() < MAX_CHAIN) {
                    below = pattern.modifier.clone();
                    patterns.push(pattern);
                }
                return Ok((definition, patterns));
            }
            own = definition.modifier.clone();
            patterns.push(definition);
        }
        Err(missing())
    }

    /// The look of surfaces with a modifier.
    ///
    /// # Errors
    /// If it is not defined, or its numbers are not those of its kind.
    pub fn look(&self, modifier: &str, warnings: &mut GroupedWarnings) -> Result<Look> {
        let (own, patterns) = self.resolve(modifier)?;
        let emits = matches!(&own.primitive.kind[..], "light" | "glow" | "illum" | "spotlight");
        for pattern in patterns {
            // Distributions of lamps belong to their surfaces.
            if !(emits && patterns::is_distribution(&pattern.primitive)) {
                warnings.skipped("ignored the patterns and textures", &pattern.primitive.name);
            }
        }
        if matches!(&own.primitive.kind[..], "BSDF" | "aBSDF") {
            return super::bsdf::look(&own, warnings);
        }
        self.look_of(&own.primitive, warnings)
    }

    /// Index of the material of a modifier in the scene.
    ///
    /// # Errors
    /// Those of [`Self::look`].
    pub fn index(
        &mut self,
        modifier: &str,
        builder: &mut Builder,
        warnings: &mut GroupedWarnings,
    ) -> Result<u32> {
        let (own, _) = self.resolve(modifier)?;
        if let Some((index, _)) = self.indices.get(&Rc::as_ptr(&own)) {
            return Ok(*index);
        }
        let material = self.look(modifier, warnings)?.named(&own.primitive.name);
        let index = builder.add_material(material);
        self.indices.insert(Rc::as_ptr(&own), (index, own));
        Ok(index)
    }

    fn look_of(&self, own: &Primitive, warnings: &mut GroupedWarnings) -> Result<Look> {
        let color = |rgb: [f64; 3]| Rgb::from_array(rgb.map(|x| x.clamp(0.0, 1.0) as f32));
        Ok(match &own.kind[..] {
            "plastic" | "plastic2" | "ashik2" => {
                let [r, g, b, specular, rough] = own.at_least()?;
                anisotropic(own, warnings);
                plastic(color([r, g, b]), specular, rough)
            }
            "metal" | "metal2" => {
                let [r, g, b, specular, rough] = own.at_least()?;
                anisotropic(own, warnings);
                let specular = specular.clamp(0.0, 1.0) as f32;
                Look::new(Bsdf::Glossy(Glossy::new(color([r, g, b]), specular, 1.0, width(rough))))
            }
            "trans" | "trans2" => {
                anisotropic(own, warnings);
                translucent(own, warnings)?
            }
            "glass" => {
                let [r, g, b] = own.at_least()?;
                let eta = own.numbers.get(3).map_or(GLASS, |eta| *eta as f32);
                check_index(own, eta)?;
                Look::tinted_sheet(eta, color([r, g, b]))
            }
            "dielectric" | "interface" => dielectric(own)?,
            "mirror" => {
                let [r, g, b] = own.exactly()?;
                Look::new(Bsdf::Mirror { reflectance: color([r, g, b]) })
            }
            "illum" if !own.words.is_empty() => {
                warnings.chosen("light comes from what is behind the surfaces of", &own.name);
                match &own.words[0][..] {
                    "void" => invisible(),
                    name => {
                        if self.resolve(name)?.0.primitive.kind == "spotlight" {
                            let phrase = "light in all directions instead of the cone of";
                            warnings.skipped(phrase, name);
                        }
                        self.look(name, warnings)?
                    }
                }
            }
            "light" | "glow" | "illum" | "spotlight" => glowing(own, warnings)?,
            "mist" | "antimatter" => {
                warnings.skipped("left out the surfaces of", &format!("{} {}", own.kind, own.name));
                invisible()
            }
            kind => {
                warnings.skipped("diffuse gray of .5 for", &format!("{kind} {}", own.name));
                Look::gray()
            }
        })
    }
}

/// A black surface that emits.
fn glowing(own: &Primitive, warnings: &mut GroupedWarnings) -> Result<Look> {
    let [r, g, b] = own.at_least()?;
    let mut look = Look::new(Bsdf::diffuse(Rgb::ZERO));
    // They are seen, but shine on nothing.
    if own.kind == "glow" && own.numbers.get(3).is_some_and(|radius| *radius < 0.0) {
        warnings.skipped("black instead of a glow of a negative radius:", &own.name);
        return Ok(look);
    }
    let _ = look.emit(Paint::plain(emitted([r, g, b].map(|own| own.max(0.0)))));
    Ok(look)
}

fn undefined(name: &str, of: &Primitive) -> Error {
    of.error(&format!("refers to `{name}`, which is not defined"), "define it before")
}

/// GGX width of facets with this RMS slope, which is that of Ward's model and of Beckmann's.
fn width(rough: f64) -> f32 {
    rough.clamp(0.0, 1.0) as f32
}

fn anisotropic(own: &Primitive, warnings: &mut GroupedWarnings) {
    if own.kind.ends_with('2') {
        warnings.skipped("the same roughness in all directions of", &own.name);
    }
}

/// A diffuse base of this color under facets of a dielectric that reflect the share `specular`
/// straight on.
fn plastic(color: Rgb, specular: f64, rough: f64) -> Look {
    let specular = specular.clamp(0.0, 0.9);
    if specular == 0.0 {
        return Look::new(Bsdf::diffuse(color));
    }
    let root = specular.sqrt();
    let eta = ((1.0 + root) / (1.0 - root)) as f32;
    Look::new(Bsdf::Glossy(Glossy::new(color, 0.0, eta, width(rough))))
}

/// `trans`: light passes diffusely, or straight on.
fn translucent(own: &Primitive, warnings: &mut GroupedWarnings) -> Result<Look> {
    let [r, g, b, specular, rough, transmits, straight] = own.at_least()?;
    let share = |own: f64| own.clamp(0.0, 1.0);
    let [specular, transmits, straight] = [specular, transmits, straight].map(share);
    if specular > 0.0 {
        warnings.skipped("no mirrored light on the translucent surfaces of", &own.name);
    }
    if straight > 0.0 && rough > 0.0 {
        warnings.skipped("sharp images, instead of blurred ones, through", &own.name);
    }
    let color = Rgb::from_array([r, g, b].map(|own| share(own) as f32)) * (1.0 - specular as f32);
    // Rays that pass straight on do not meet the surface.
    let mean = f64::from(bdpm_core::base::math::luminance(color));
    let passes = (mean * transmits * straight).min(1.0);
    let rest = (1.0 - passes).max(1e-6);
    let [reflected, transmitted] =
        [1.0 - transmits, transmits * (1.0 - straight)].map(|own| color * (own / rest) as f32);
    let limit = |own: Rgb| own.clamp(Rgb::ZERO, Rgb::ONE);
    let sheet = DiffuseTransmission::new(limit(reflected), limit(transmitted));
    let [reflected, transmitted] = sheet.shares();
    let sheet = DiffuseTransmission::new(reflected, transmitted);
    let mut look = Look::new(Bsdf::DiffuseTransmission(sheet));
    if passes > 0.0 {
        look.material.opacity = Some(rest as f32);
    }
    Ok(look)
}

/// `dielectric`, or the `interface` of two.
fn dielectric(own: &Primitive) -> Result<Look> {
    let smooth: Facets = correlated(0.0);
    let inside = |own: &Primitive, [r, g, b]: [f64; 3]| {
        let color = Rgb::from_array([r, g, b].map(|own| own.clamp(1e-6, 1.0) as f32));
        (color != Rgb::ONE).then(|| Arc::new(Medium::absorbing(&own.name, color, 1.0)))
    };
    if own.kind == "interface" {
        let [r, g, b, n, r2, g2, b2, n2] = own.exactly()?;
        [n, n2].into_iter().try_for_each(|n| check_index(own, n as f32))?;
        let [index, other] = [n, n2].map(bdpm_core::scene::RefractiveIndex::Constant);
        let mut look = Look::dielectric([index, other], smooth, Rgb::ONE);
        let media = [inside(own, [r, g, b]), inside(own, [r2, g2, b2])];
        let [interior, exterior] = media;
        look.bound(
            (interior.is_some() || exterior.is_some())
                .then_some(MediumBoundary { interior, exterior }),
        );
        return Ok(look);
    }
    let [r, g, b, n] = own.at_least()?;
    check_index(own, n as f32)?;
    let mut look = Look::dielectric(in_vacuum(n as f32), smooth, Rgb::ONE);
    let interior = inside(own, [r, g, b]);
    look.bound(interior.map(|own| MediumBoundary { interior: Some(own), exterior: None }));
    Ok(look)
}

fn check_index(own: &Primitive, index: f32) -> Result<()> {
    if (0.1..=10.0).contains(&index) {
        return Ok(());
    }
    Err(own.error(&format!("has the refractive index {index}"), "give one from .1 to 10"))
}

/// A surface that rays pass.
fn invisible() -> Look {
    let mut look = Look::gray();
    look.material.opacity = Some(0.0);
    look
}
