//! The directives of a scene file.

use super::PlacedShape;
use super::SceneReader;
use super::camera::{CameraSource, FilmSource};
use super::lights::AreaLight;
use super::materials::{MaterialRef, MaterialSource};
use super::params::{Attributes, Params};
use super::spectra::ColorSpace;
use super::state::{self, GraphicsState};
use super::tokens::{Location, Token, Tokens};
use crate::text::RELATIVE_NAME;
use bdpm_core::base::error::Result;
use glam::{DAffine3, DVec3};
use std::path::Path;
use std::rc::Rc;

/// Maximum number of files that include each other.
const MAX_DEPTH: usize = 32;

/// Maximum number of states that are saved at the same time.
const MAX_SAVED: usize = 100_000;

impl SceneReader<'_> {
    /// Reads all directives of a file.
    pub(super) fn read(&mut self, path: &Path) -> Result<()> {
        let mut tokens = self.files.tokens(path)?;
        let saved = self.saved.len();
        while let Some((token, offset)) = tokens.next()? {
            let location = tokens.location(offset);
            let Token::Word(directive) = token else {
                let advice =
                    "begin with a directive such as Shape; parameters have a type and a name";
                return Err(location.error("a directive was expected", advice));
            };
            self.directive(&directive, &location, &mut tokens)?;
        }
        if let Some((_, begin)) = self.saved.get(saved).filter(|_| self.depth == 0) {
            let problem = "the file ends within AttributeBegin or ObjectBegin";
            return Err(begin.error(problem, "add AttributeEnd or ObjectEnd"));
        }
        Ok(())
    }

    fn directive(
        &mut self,
        directive: &str,
        location: &Location,
        tokens: &mut Tokens,
    ) -> Result<()> {
        match directive {
            "Identity" => self.state.set(DAffine3::IDENTITY),
            "Translate" => {
                let offset = DVec3::from_array(numbers(tokens, location)?);
                self.state.multiply(DAffine3::from_translation(offset));
            }
            "Scale" => {
                let scale = DVec3::from_array(numbers(tokens, location)?);
                self.state.multiply(DAffine3::from_scale(scale));
            }
            "Rotate" => {
                let map = state::rotation(numbers(tokens, location)?, location)?;
                self.state.multiply(map);
            }
            "LookAt" => {
                let map = state::look_at(numbers(tokens, location)?, location)?;
                self.state.multiply(map);
            }
            "Transform" => {
                let map = state::matrix(numbers(tokens, location)?, location)?;
                self.state.set(map);
            }
            "ConcatTransform" => {
                let map = state::matrix(numbers(tokens, location)?, location)?;
                self.state.multiply(map);
            }
            "CoordinateSystem" => {
                let name = text(tokens, location)?;
                self.systems.insert(name, self.state.transform);
            }
            "CoordSysTransform" => {
                let name = text(tokens, location)?;
                let Some(map) = self.systems.get(&name).copied() else {
                    let problem = format!("there is no coordinate system `{name}`");
                    return Err(location.error(problem, "define it by CoordinateSystem"));
                };
                self.state.set(map);
            }
            "TransformBegin" | "AttributeBegin" => self.save(location)?,
            "TransformEnd" => {
                let own = self.restored(directive, location)?;
                self.state.transform = own.transform;
                self.state.changes_start = own.changes_start;
            }
            "AttributeEnd" => self.state = self.restored(directive, location)?,
            "ActiveTransform" => {
                let Some((Token::Word(which), _)) = tokens.next()? else {
                    let advice = "use StartTime, EndTime or All";
                    return Err(location.error("the active transform is missing", advice));
                };
                self.state.changes_start = which != "EndTime";
                if which == "EndTime" {
                    self.textures
                        .warnings
                        .skipped("left out motion after the start of", "the shutter");
                }
            }
            "TransformTimes" => {
                let _: [f64; 2] = numbers(tokens, location)?;
            }
            "ReverseOrientation" => {
                self.state.reverse_orientation = !self.state.reverse_orientation;
            }
            "WorldBegin" => {
                self.in_world = true;
                self.state.transform = DAffine3::IDENTITY;
                self.state.changes_start = true;
            }
            "WorldEnd" => {} // of earlier versions
            "ColorSpace" => {
                let name = text(tokens, location)?;
                self.state.color_space = ColorSpace::named(&name).ok_or_else(|| {
                    let advice = "use srgb, dci-p3, rec2020 or aces2065-1";
                    location.error(format!("the color space `{name}` is unknown"), advice)
                })?;
            }
            "Include" | "Import" => self.include(directive, location, tokens)?,
            "ObjectBegin" => {
                let name = text(tokens, location)?;
                if self.object.is_some() {
                    let problem = "objects cannot be within each other";
                    return Err(location.error(problem, "end the first object before"));
                }
                self.save(location)?;
                self.objects.insert(name.clone(), Vec::new());
                self.object = Some(name);
            }
            "ObjectEnd" => {
                if self.object.take().is_none() {
                    let problem = "no object was begun";
                    return Err(location.error(problem, "remove it, or add ObjectBegin"));
                }
                self.state = self.restored(directive, location)?;
            }
            "ObjectInstance" => {
                let name = text(tokens, location)?;
                if self.object.is_some() {
                    let problem = "an object cannot use another one";
                    return Err(location.error(problem, "move the use behind ObjectEnd"));
                }
                let params =
                    Params::read(name.clone(), location.clone(), tokens, Attributes::default())?;
                let map = self.state.invertible(&params)?;
                self.uses.push((name, params, map));
            }
            "Attribute" => {
                let target = text(tokens, location)?;
                let params =
                    Params::read(target.clone(), location.clone(), tokens, Attributes::default())?;
                self.state.add(&target, params)?;
            }
            "NamedMaterial" => {
                let name = text(tokens, location)?;
                // The name is checked when a shape uses it.
                self.state.material = MaterialRef::Named(name);
            }
            "MediumInterface" => {
                let inside = text(tokens, location)?;
                // A single name is that of both sides.
                let outside = match tokens.peek()? {
                    Some((Token::Text(_), _)) => text(tokens, location)?,
                    _ => inside.clone(),
                };
                self.state.media = [inside, outside];
            }
            _ => self.object_directive(directive, location, tokens)?,
        }
        Ok(())
    }

    /// Directives with a type and parameters.
    fn object_directive(
        &mut self,
        directive: &str,
        location: &Location,
        tokens: &mut Tokens,
    ) -> Result<()> {
        let targets = [
            ("Shape", "shape"),
            ("LightSource", "light"),
            ("AreaLightSource", "light"),
            ("Material", "material"),
            ("MakeNamedMaterial", "material"),
            ("MakeNamedMedium", "medium"),
            ("Texture", "texture"),
        ];
        let target = targets.iter().find(|(own, _)| *own == directive);
        let is_known = target.is_some()
            || matches!(
                directive,
                "Camera"
                    | "Film"
                    | "PixelFilter"
                    | "Sampler"
                    | "Integrator"
                    | "Accelerator"
                    | "Option"
            );
        if !is_known {
            let advice = "use directives of pbrt-v4; pbrt's --upgrade converts files of pbrt-v3";
            return Err(location.error(format!("the directive `{directive}` is unknown"), advice));
        }
        let added = target.map(|(_, target)| self.state.added(target)).unwrap_or_default();
        if directive == "Option" {
            Params::read(String::new(), location.clone(), tokens, Attributes::default())?;
            return Ok(());
        }
        let kind = text(tokens, location)?;
        if directive == "Texture" {
            let (value_type, class) = (text(tokens, location)?, text(tokens, location)?);
            let params = Params::read(class, location.clone(), tokens, added)?;
            return self.textures.define(&kind, &value_type, &params, self.state.color_space);
        }
        let params = Params::read(kind, location.clone(), tokens, added)?;
        self.object_with(directive, params)
    }

    fn object_with(&mut self, directive: &str, params: Params) -> Result<()> {
        let color_space = self.state.color_space;
        match directive {
            "Camera" => {
                let to_world = self.state.invertible(&params)?.inverse();
                self.systems.insert("camera".to_owned(), to_world);
                self.camera = Some(CameraSource { params, to_world });
                self.camera_medium = self.state.media[1].clone();
            }
            "Film" => self.film = FilmSource::read(&params, &mut self.textures)?,
            "Integrator" if params.float("maxdepth").ok().flatten().is_some() => {
                let phrase = "ignored the limit of the path length of";
                self.textures.warnings.chosen(phrase, &params.kind);
            }
            "PixelFilter" if params.kind != "box" => {
                let phrase = "used the box filter instead of";
                self.textures.warnings.chosen(phrase, &params.kind);
            }
            "MakeNamedMedium" => {
                self.media.define(&params, color_space, &mut self.textures)?;
            }
            "Material" => {
                let name = params.kind.clone();
                let source = MaterialSource { name, params, color_space };
                self.state.material = MaterialRef::Own(Rc::new(source));
            }
            "MakeNamedMaterial" => {
                let name = params.kind.clone();
                if self.materials.is_known(&name) {
                    return Err(params.location.error(
                        format!("the material `{name}` is defined twice"),
                        "give one of them another name",
                    ));
                }
                let Some(kind) = params.text("type")?.map(str::to_owned) else {
                    return Err(
                        params.error("the parameter `type` is missing", "add \"string type\"")
                    );
                };
                let params = params.of_kind(kind);
                self.materials.define(MaterialSource { name, params, color_space });
            }
            "AreaLightSource" => {
                self.state.area_light = Some(Rc::new(AreaLight { params, color_space }));
            }
            "LightSource" => {
                if self.object.is_some() {
                    let phrase = "left out lights within";
                    self.textures.warnings.skipped(phrase, "objects");
                    return Ok(());
                }
                let map = self.state.invertible(&params)?;
                self.lights.push((params, map, color_space));
            }
            "Shape" => {
                let map = self.state.invertible(&params)?;
                let shape = PlacedShape { params, map, state: self.state.clone() };
                match &self.object {
                    None => self.shapes.push(shape),
                    Some(name) => self.objects.entry(name.clone()).or_default().push(shape),
                }
            }
            _ => {} // Accelerators, samplers and box filters have no effect on the image.
        }
        Ok(())
    }

    fn save(&mut self, location: &Location) -> Result<()> {
        if self.saved.len() >= MAX_SAVED {
            let problem = "too many attributes are nested";
            return Err(location.error(problem, "end some of them"));
        }
        self.saved.push((self.state.clone(), location.clone()));
        Ok(())
    }

    fn restored(&mut self, directive: &str, location: &Location) -> Result<GraphicsState> {
        self.saved.pop().map(|(state, _)| state).ok_or_else(|| {
            let problem = format!("{directive} has no beginning");
            location.error(problem, "remove it, or add AttributeBegin")
        })
    }

    /// Reads another file, whose name is relative to the folder of the scene.
    fn include(&mut self, directive: &str, location: &Location, tokens: &mut Tokens) -> Result<()> {
        let name = text(tokens, location)?;
        let path = self
            .textures
            .located(&name)
            .ok_or_else(|| location.error(format!("there is no file `{name}`"), RELATIVE_NAME))?;
        if self.depth >= MAX_DEPTH {
            let problem = format!("more than {MAX_DEPTH} files include each other");
            return Err(location.error(problem, "include each file once"));
        }
        self.depth += 1;
        // Attributes of an imported file have no effect behind it.
        let own = (directive == "Import").then(|| self.state.clone());
        self.read(&path).map_err(|error| location.place(error))?;
        if let Some(own) = own {
            self.state = own;
        }
        self.depth -= 1;
        Ok(())
    }
}

/// A text in quotes.
fn text(tokens: &mut Tokens, location: &Location) -> Result<String> {
    match tokens.next()? {
        Some((Token::Text(text), _)) => Ok(text),
        _ => Err(location.error("a text in quotes is missing", "add it")),
    }
}

/// Numbers, with or without brackets.
fn numbers<const N: usize>(tokens: &mut Tokens, location: &Location) -> Result<[f64; N]> {
    let wrong = || location.error(format!("it does not have {N} numbers"), format!("give {N}"));
    let has_brackets = matches!(tokens.peek()?, Some((Token::Open, _)));
    if has_brackets {
        tokens.next()?;
    }
    let mut all = [0.0; N];
    for number in &mut all {
        let Some((Token::Number(own), _)) = tokens.next()? else { return Err(wrong()) };
        *number = own;
    }
    if has_brackets && !matches!(tokens.next()?, Some((Token::Close, _))) {
        return Err(wrong());
    }
    Ok(all)
}
