//! Parameters of a directive: `"float radius" 2` or `"rgb L" [1 2 3]`.

use super::tokens::{Location, Token, Tokens};
use crate::far::DBounds;
use bdpm_core::base::error::{Error, Result};
use glam::{DVec3, Vec2, Vec3};
use std::cell::{Cell, RefCell};
use std::rc::Rc;

/// A typed value of a parameter.
#[derive(Clone, Default)]
pub(super) struct Values {
    pub numbers: Vec<f64>,
    pub texts: Vec<String>,
    flags: Vec<bool>,
}

/// A parameter with its place.
#[derive(Clone)]
pub(super) struct Param {
    /// Its type, such as `rgb` or `texture`.
    pub kind: String,
    pub name: String,
    pub values: Values,
    pub location: Location,
    used: Cell<bool>,
}

/// The parameters of a directive.
#[derive(Clone)]
pub(super) struct Params {
    /// Type of the object that the directive makes, such as `sphere`.
    pub kind: String,
    pub location: Location,
    all: Vec<Param>,
    /// Parameters of `Attribute` directives, after the own ones.
    added: Attributes,
    /// Indices of the added parameters that were asked for. Many directives share these.
    used: RefCell<Vec<usize>>,
}

/// Parameters that `Attribute` adds to the directives that follow, which share them.
pub(super) type Attributes = Rc<Vec<Rc<Param>>>;

impl Params {
    /// Reads all parameters that follow in a file; `added` are those of `Attribute` directives.
    pub fn read(
        kind: String,
        location: Location,
        tokens: &mut Tokens,
        added: Attributes,
    ) -> Result<Self> {
        let mut all = Vec::new();
        while let Some((Token::Text(head), offset)) = tokens.peek()? {
            let (head, location) = (head.clone(), *offset);
            let location = tokens.location(location);
            tokens.next()?;
            let mut words = head.split_whitespace();
            let (Some(kind), Some(name), None) = (words.next(), words.next(), words.next()) else {
                let problem = format!("`{head}` is not the type and name of a parameter");
                return Err(location.error(problem, "write them as \"float radius\""));
            };
            let values = Values::read(tokens, &location)?;
            let (kind, name, used) = (kind.to_owned(), name.to_owned(), Cell::new(false));
            all.push(Param { kind, name, values, location, used });
        }
        Ok(Self { kind, location, all, added, used: RefCell::default() })
    }

    /// The same parameters of another type of object.
    pub fn of_kind(self, kind: String) -> Self {
        Self { kind, ..self }
    }

    /// All parameters, for `Attribute`.
    pub fn into_all(self) -> Vec<Param> {
        self.all
    }

    /// A problem with the directive.
    pub fn error(&self, problem: impl Into<String>, advice: impl Into<String>) -> Error {
        let problem = problem.into();
        let named =
            if self.kind.is_empty() { problem } else { format!("{}: {problem}", self.kind) };
        self.location.error(named, advice)
    }

    /// An error that names no place, with this directive as its place.
    pub fn placed(&self, error: &Error) -> Error {
        self.error(error.problem(), error.advice())
    }

    /// The parameter of this name. The last of several counts, and those of the directive precede
    /// those of `Attribute`.
    pub fn get(&self, name: &str) -> Option<&Param> {
        // All of this name are considered.
        let own = self.all.iter().filter(|param| param.name == name);
        own.for_each(|param| param.used.set(true));
        let added = self.added.iter().enumerate().filter(|(_, param)| param.name == name);
        self.used.borrow_mut().extend(added.clone().map(|(index, _)| index));
        let own = self.all.iter().rfind(|param| param.name == name);
        own.or_else(|| added.map(|(_, param)| &**param).next_back())
    }

    /// Names of the parameters that nothing asked for.
    pub fn unused(&self) -> impl Iterator<Item = &str> {
        let own = self.all.iter().filter(|param| !param.used.get());
        let used = self.used.borrow().clone();
        let added = self.added.iter().enumerate();
        let added =
            added.filter(move |(index, _)| !used.contains(index)).map(|(_, param)| &**param);
        own.chain(added).map(|param| &param.name[..])
    }

    /// One number.
    pub fn float(&self, name: &str) -> Result<Option<f64>> {
        let Some(param) = self.get(name) else { return Ok(None) };
        match param.values.numbers[..] {
            [number] if matches!(&param.kind[..], "float" | "integer") => Ok(Some(number)),
            _ => Err(param.location.error(format!("`{name}` is not one number"), "give one")),
        }
    }

    /// One number, or a default.
    pub fn float_or(&self, name: &str, default: f64) -> Result<f64> {
        Ok(self.float(name)?.unwrap_or(default))
    }

    /// One number within a range, or a default.
    pub fn float_in(&self, name: &str, default: f64, [low, high]: [f64; 2]) -> Result<f64> {
        let value = self.float_or(name, default)?;
        if (low..=high).contains(&value) {
            return Ok(value);
        }
        let location = self.get(name).map_or(&self.location, |param| &param.location);
        let problem = format!("`{name}` is {value}");
        Err(location.error(problem, format!("give a number from {low} to {high}")))
    }

    /// `true` or `false`.
    pub fn boolean(&self, name: &str, default: bool) -> Result<bool> {
        let Some(param) = self.get(name) else { return Ok(default) };
        let by_text = match param.values.texts.first().map(String::as_str) {
            Some("true") => Some(true),
            Some("false") => Some(false),
            _ => None,
        };
        param.values.flags.first().copied().or(by_text).ok_or_else(|| {
            param.location.error(format!("`{name}` is neither true nor false"), "give one of them")
        })
    }

    /// A text.
    pub fn text(&self, name: &str) -> Result<Option<&str>> {
        let Some(param) = self.get(name) else { return Ok(None) };
        match &param.values.texts[..] {
            [text] => Ok(Some(text)),
            _ => Err(param.location.error(format!("`{name}` is not one text"), "give one")),
        }
    }

    /// The numbers of a parameter, or none.
    pub fn numbers(&self, name: &str) -> &[f64] {
        self.get(name).map_or(&[], |param| &param.values.numbers)
    }

    /// A point or vector.
    pub fn point(&self, name: &str) -> Result<Option<DVec3>> {
        let Some(param) = self.get(name) else { return Ok(None) };
        match param.values.numbers[..] {
            [x, y, z] => Ok(Some(DVec3::new(x, y, z))),
            _ => Err(param.location.error(format!("`{name}` is not three numbers"), "give three")),
        }
    }

    /// A list of points or vectors.
    pub fn points(&self, name: &str) -> Result<Vec<Vec3>> {
        let numbers = self.tuples::<3>(name)?;
        Ok(numbers.map(|[x, y, z]| DVec3::new(*x, *y, *z).as_vec3()).collect())
    }

    /// A list of positions, relative to the point that is returned as well: the origin unless they
    /// are far from it.
    pub fn positions(&self, name: &str) -> Result<(Vec<Vec3>, DVec3)> {
        let points = self.tuples::<3>(name)?.copied().map(DVec3::from_array);
        let points: Vec<DVec3> = points.collect();
        let bounds = points.iter().copied().fold(DBounds::EMPTY, DBounds::with);
        let origin = bounds.far_center_of_part().unwrap_or(DVec3::ZERO);
        Ok((points.iter().map(|point| (*point - origin).as_vec3()).collect(), origin))
    }

    /// A list of points in the plane.
    pub fn points2(&self, name: &str) -> Result<Vec<Vec2>> {
        Ok(self.tuples::<2>(name)?.map(|[x, y]| Vec2::new(*x as f32, *y as f32)).collect())
    }

    fn tuples<const N: usize>(&self, name: &str) -> Result<impl Iterator<Item = &[f64; N]>> {
        let numbers = self.numbers(name);
        let (tuples, rest) = numbers.as_chunks::<N>();
        if rest.is_empty() {
            return Ok(tuples.iter());
        }
        let location = self.get(name).map_or(&self.location, |param| &param.location);
        let problem =
            format!("`{name}` has {} numbers, which is no multiple of {N}", numbers.len());
        Err(location.error(problem, "correct the list"))
    }

    /// A list of indices below `count`.
    pub fn indices(&self, name: &str, count: usize) -> Result<Vec<u32>> {
        let Some(param) = self.get(name) else { return Ok(Vec::new()) };
        let valid = |number: &f64| number.fract() == 0.0 && (0.0..count as f64).contains(number);
        if let Some(bad) = param.values.numbers.iter().find(|number| !valid(number)) {
            let problem = format!("`{name}` has the index {bad}, but there are {count} vertices");
            return Err(param.location.error(problem, "correct the list"));
        }
        Ok(param.values.numbers.iter().map(|number| *number as u32).collect())
    }
}

impl Values {
    fn read(tokens: &mut Tokens, location: &Location) -> Result<Self> {
        let missing = || location.error("the parameter has no value", "add one");
        let mut values = Self::default();
        let (first, _) = tokens.next()?.ok_or_else(missing)?;
        if first != Token::Open {
            return if values.add(first) { Ok(values) } else { Err(missing()) };
        }
        loop {
            let Some((token, offset)) = tokens.next()? else {
                return Err(location.error("the list has no end", "add `]`"));
            };
            if token == Token::Close {
                return Ok(values);
            }
            if !values.add(token) {
                let place = tokens.location(offset);
                return Err(place.error("this is not a value of a list", "add `]` before it"));
            }
        }
    }

    /// Adds a value; `false` if the token is none.
    fn add(&mut self, token: Token) -> bool {
        match token {
            Token::Number(number) => self.numbers.push(number),
            Token::Text(text) => self.texts.push(text),
            Token::Word(word) if word == "true" || word == "false" => {
                self.flags.push(word == "true");
            }
            Token::Word(_) | Token::Open | Token::Close => return false,
        }
        true
    }
}
