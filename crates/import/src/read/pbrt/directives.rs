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

/// Reads the map of a directive.
type MapReader = fn(&Location, &mut Tokens) -> Result<DAffine3>;

/// Directives that replace the current transform (true) or multiply it (false).
const TRANSFORMS: &[(&str, bool, MapReader)] = &[
    ("Identity", true, |_, _| Ok(DAffine3::IDENTITY)),
    ("Transform", true, |at, tokens| state::matrix(numbers(tokens, at)?, at)),
    ("ConcatTransform", false, |at, tokens| state::matrix(numbers(tokens, at)?, at)),
    ("Translate", false, |at, tokens| {
        Ok(DAffine3::from_translation(DVec3::from_array(numbers(tokens, at)?)))
    }),
    ("Scale", false, |at, tokens| {
        Ok(DAffine3::from_scale(DVec3::from_array(numbers(tokens, at)?)))
    }),
    ("Rotate", false, |at, tokens| state::rotation(numbers(tokens, at)?, at)),
    ("LookAt", false, |at, tokens| state::look_at(numbers(tokens, at)?, at)),
];

/// What a directive without a type does.
type Action = fn(&mut SceneReader, &Location, &mut Tokens) -> Result<()>;

/// Other directives without a type.
const DIRECTIVES: &[(&str, Action)] = &[
    ("CoordinateSystem", |reader, at, tokens| {
        let name = text(tokens, at)?;
        reader.systems.insert(name, reader.state.transform);
        Ok(())
    }),
    ("CoordSysTransform", SceneReader::set_named_system),
    ("TransformBegin", |reader, at, _| reader.save(at)),
    ("TransformEnd", |reader, at, _| reader.end_transform(at)),
    ("AttributeBegin", |reader, at, _| reader.save(at)),
    ("AttributeEnd", |reader, at, _| {
        reader.state = reader.restored("AttributeEnd", at)?;
        Ok(())
    }),
    ("ActiveTransform", SceneReader::activate),
    ("TransformTimes", |_, at, tokens| numbers::<2>(tokens, at).map(drop)),
    ("ReverseOrientation", |reader, _, _| {
        reader.state.reverse_orientation ^= true;
        Ok(())
    }),
    ("WorldBegin", |reader, _, _| reader.begin_world()),
    ("WorldEnd", |_, _, _| Ok(())), // of earlier versions
    ("ColorSpace", SceneReader::set_color_space),
    ("Include", |reader, at, tokens| reader.include(false, at, tokens)),
    ("Import", |reader, at, tokens| reader.include(true, at, tokens)),
    ("ObjectBegin", SceneReader::begin_object),
    ("ObjectEnd", |reader, at, _| reader.end_object(at)),
    ("ObjectInstance", SceneReader::use_object),
    ("Attribute", SceneReader::add_attributes),
    ("NamedMaterial", |reader, at, tokens| {
        // The name is checked when a shape uses it.
        reader.state.material = MaterialRef::Named(text(tokens, at)?);
        Ok(())
    }),
    ("MediumInterface", SceneReader::set_media),
    ("Option", |_, at, tokens| {
        let own = Attributes::default();
        Params::read(String::new(), at.clone(), tokens, own).map(drop)
    }),
    ("Texture", SceneReader::texture),
];

/// What a directive with a type and parameters does.
type Maker = fn(&mut SceneReader, Params) -> Result<()>;

/// Directives with a type and parameters, and the target whose `Attribute` directives apply to
/// them.
const OBJECTS: &[(&str, Option<&str>, Maker)] = &[
    ("Shape", Some("shape"), SceneReader::add_shape),
    ("LightSource", Some("light"), SceneReader::add_light),
    ("AreaLightSource", Some("light"), |reader, params| {
        let color_space = reader.state.color_space;
        reader.state.area_light = Some(Rc::new(AreaLight { params, color_space }));
        Ok(())
    }),
    ("Material", Some("material"), SceneReader::set_material),
    ("MakeNamedMaterial", Some("material"), SceneReader::define_material),
    ("MakeNamedMedium", Some("medium"), |reader, params| {
        reader.media.define(&params, reader.state.color_space, &mut reader.textures)
    }),
    ("Camera", None, SceneReader::camera),
    ("Film", None, |reader, params| {
        reader.film = FilmSource::read(&params, &mut reader.textures)?;
        Ok(())
    }),
    ("PixelFilter", None, SceneReader::warn_of_filter),
    ("Integrator", None, SceneReader::warn_of_integrator),
    // They have no effect on the image.
    ("Sampler", None, |_, _| Ok(())),
    ("Accelerator", None, |_, _| Ok(())),
];

impl SceneReader {
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
        if let Some((_, replaces, map)) = TRANSFORMS.iter().find(|(name, ..)| *name == directive) {
            let map = map(location, tokens)?;
            match replaces {
                true => self.state.set(map),
                false => self.state.multiply(map),
            }
            return Ok(());
        }
        if let Some((_, act)) = DIRECTIVES.iter().find(|(name, _)| *name == directive) {
            return act(self, location, tokens);
        }
        let Some((_, target, make)) = OBJECTS.iter().find(|(name, ..)| *name == directive) else {
            let advice = "use directives of pbrt-v4; pbrt's --upgrade converts files of pbrt-v3";
            return Err(location.error(format!("the directive `{directive}` is unknown"), advice));
        };
        let added = target.map(|target| self.state.added(target)).unwrap_or_default();
        let kind = text(tokens, location)?;
        make(self, Params::read(kind, location.clone(), tokens, added)?)
    }

    fn texture(&mut self, location: &Location, tokens: &mut Tokens) -> Result<()> {
        let (name, value_type) = (text(tokens, location)?, text(tokens, location)?);
        let added = self.state.added("texture");
        let class = text(tokens, location)?;
        let params = Params::read(class, location.clone(), tokens, added)?;
        self.textures.define(&name, &value_type, &params, self.state.color_space)
    }

    fn set_named_system(&mut self, location: &Location, tokens: &mut Tokens) -> Result<()> {
        let name = text(tokens, location)?;
        let Some(map) = self.systems.get(&name).copied() else {
            let problem = format!("there is no coordinate system `{name}`");
            return Err(location.error(problem, "define it by CoordinateSystem"));
        };
        self.state.set(map);
        Ok(())
    }

    fn end_transform(&mut self, location: &Location) -> Result<()> {
        let own = self.restored("TransformEnd", location)?;
        self.state.transform = own.transform;
        self.state.changes_start = own.changes_start;
        Ok(())
    }

    fn activate(&mut self, location: &Location, tokens: &mut Tokens) -> Result<()> {
        let Some((Token::Word(which), _)) = tokens.next()? else {
            let advice = "use StartTime, EndTime or All";
            return Err(location.error("the active transform is missing", advice));
        };
        self.state.changes_start = which != "EndTime";
        if which == "EndTime" {
            let phrase = "left out motion after the start of";
            self.textures.warnings.skipped(phrase, "the shutter");
        }
        Ok(())
    }

    fn begin_world(&mut self) -> Result<()> {
        self.in_world = true;
        self.state.transform = DAffine3::IDENTITY;
        self.state.changes_start = true;
        Ok(())
    }

    fn set_color_space(&mut self, location: &Location, tokens: &mut Tokens) -> Result<()> {
        let name = text(tokens, location)?;
        self.state.color_space = ColorSpace::named(&name).ok_or_else(|| {
            let advice = "use srgb, dci-p3, rec2020 or aces2065-1";
            location.error(format!("the color space `{name}` is unknown"), advice)
        })?;
        Ok(())
    }

    fn begin_object(&mut self, location: &Location, tokens: &mut Tokens) -> Result<()> {
        let name = text(tokens, location)?;
        if self.object.is_some() {
            let problem = "objects cannot be within each other";
            return Err(location.error(problem, "end the first object before"));
        }
        self.save(location)?;
        self.objects.insert(name.clone(), Vec::new());
        self.object = Some(name);
        Ok(())
    }

    fn end_object(&mut self, location: &Location) -> Result<()> {
        if self.object.take().is_none() {
            let problem = "no object was begun";
            return Err(location.error(problem, "remove it, or add ObjectBegin"));
        }
        self.state = self.restored("ObjectEnd", location)?;
        Ok(())
    }

    fn use_object(&mut self, location: &Location, tokens: &mut Tokens) -> Result<()> {
        let name = text(tokens, location)?;
        if self.object.is_some() {
            let problem = "an object cannot use another one";
            return Err(location.error(problem, "move the use behind ObjectEnd"));
        }
        let params = Params::read(name.clone(), location.clone(), tokens, Attributes::default())?;
        let map = self.state.invertible(&params)?;
        self.uses.push((name, params, map));
        Ok(())
    }

    fn add_attributes(&mut self, location: &Location, tokens: &mut Tokens) -> Result<()> {
        let target = text(tokens, location)?;
        let own = Attributes::default();
        self.state.add(&target, Params::read(target.clone(), location.clone(), tokens, own)?)
    }

    fn set_media(&mut self, location: &Location, tokens: &mut Tokens) -> Result<()> {
        let inside = text(tokens, location)?;
        // A single name is that of both sides.
        let outside = match tokens.peek()? {
            Some((Token::Text(_), _)) => text(tokens, location)?,
            _ => inside.clone(),
        };
        self.state.media = [inside, outside];
        Ok(())
    }

    fn camera(&mut self, params: Params) -> Result<()> {
        let to_world = self.state.invertible(&params)?.inverse();
        self.systems.insert("camera".to_owned(), to_world);
        self.camera = Some(CameraSource { params, to_world });
        self.camera_medium = self.state.media[1].clone();
        Ok(())
    }

    fn warn_of_integrator(&mut self, params: Params) -> Result<()> {
        let has_limit = params.float("maxdepth").is_ok_and(|depth| depth.is_some());
        let phrase = "ignored the limit of the path length of";
        if has_limit {
            self.textures.warnings.chosen(phrase, &params.kind);
        }
        Ok(())
    }

    fn warn_of_filter(&mut self, params: Params) -> Result<()> {
        if params.kind != "box" {
            self.textures.warnings.chosen("used the box filter instead of", &params.kind);
        }
        Ok(())
    }

    fn set_material(&mut self, params: Params) -> Result<()> {
        let (name, color_space) = (params.kind.clone(), self.state.color_space);
        let source = MaterialSource { name, params, color_space };
        self.state.material = MaterialRef::Own(Rc::new(source));
        Ok(())
    }

    fn define_material(&mut self, params: Params) -> Result<()> {
        let (name, color_space) = (params.kind.clone(), self.state.color_space);
        if self.materials.is_known(&name) {
            return Err(params.location.error(
                format!("the material `{name}` is defined twice"),
                "give one of them another name",
            ));
        }
        let Some(kind) = params.text("type")?.map(str::to_owned) else {
            return Err(params.error("the parameter `type` is missing", "add \"string type\""));
        };
        let params = params.of_kind(kind);
        self.materials.define(MaterialSource { name, params, color_space });
        Ok(())
    }

    fn add_light(&mut self, params: Params) -> Result<()> {
        if let Some(object) = &self.object {
            let phrase = "placed once, where they are defined as in pbrt, the lights of objects:";
            self.textures.warnings.chosen(phrase, object);
        }
        let map = self.state.invertible(&params)?;
        self.lights.push((params, map, self.state.color_space));
        Ok(())
    }

    fn add_shape(&mut self, params: Params) -> Result<()> {
        let map = self.state.invertible(&params)?;
        let shape = PlacedShape { params, map, state: self.state.clone() };
        match &self.object {
            None => self.shapes.push(shape),
            Some(name) => self.objects.entry(name.clone()).or_default().push(shape),
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
    fn include(&mut self, is_import: bool, location: &Location, tokens: &mut Tokens) -> Result<()> {
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
        let own = is_import.then(|| self.state.clone());
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
