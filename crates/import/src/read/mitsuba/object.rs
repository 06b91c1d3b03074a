//! Properties of an element: numbers, words, transforms and other elements.

use super::document::{Element, XmlDocument};
use super::maps;
use crate::text::RELATIVE_NAME;
use bdpm_core::base::error::{Error, Result};
use glam::{DAffine3, DVec3};
use std::path::PathBuf;

/// An element of a document.
#[derive(Clone, Copy)]
pub(super) struct Object<'a> {
    pub document: &'a XmlDocument,
    pub index: usize,
}

impl<'a> Object<'a> {
    /// The element of this index, which is marked as used.
    pub fn new(document: &'a XmlDocument, index: usize) -> Self {
        document.elements[index].used.set(true);
        Self { document, index }
    }

    pub fn element(&self) -> &'a Element {
        &self.document.elements[self.index]
    }

    /// The plugin's name.
    pub fn kind(&self) -> &'a str {
        self.element().attribute("type").unwrap_or("")
    }

    /// The id, else the type and the line.
    /// Its id, if it has one.
    pub fn id(&self) -> Option<&str> {
        self.element().attribute("id")
    }

    pub fn label(&self) -> String {
        let line = || format!("{} in line {}", self.kind(), self.document.line(self.index));
        self.id().map_or_else(line, str::to_owned)
    }

    pub fn error(&self, problem: impl Into<String>, advice: &str) -> Error {
        self.document.error(self.index, problem, advice)
    }

    /// An error that names no place, with this element as its place.
    pub fn placed(&self, error: &Error) -> Error {
        self.error(error.problem(), error.advice())
    }

    /// An attribute that must be there.
    pub fn attribute(&self, name: &str) -> Result<&'a str> {
        let value = self.element().attribute(name);
        value.ok_or_else(|| self.error(format!("it has no `{name}`"), "add it"))
    }

    /// The child, or the element to which it refers.
    fn resolved(&self, child: usize) -> Result<Self> {
        let child = Self::new(self.document, child);
        if child.element().tag != "ref" {
            return Ok(child);
        }
        let id = child.attribute("id")?;
        let target = self.document.by_id(id).ok_or_else(|| {
            child.error(format!("nothing has the id `{id}`"), "define it, or remove this reference")
        })?;
        Ok(Self::new(self.document, target))
    }

    /// The child of this name, or the element to which it refers.
    pub fn get(&self, name: &str) -> Result<Option<Self>> {
        let named =
            |index: &&usize| self.document.elements[**index].attribute("name") == Some(name);
        // Repeated names are an error in Mitsuba. Here the first one is used, and the others are
        // reported as ignored.
        self.element().children.iter().find(named).map(|index| self.resolved(*index)).transpose()
    }

    /// All children with this tag, and references to such, in order.
    pub fn all(&self, tag: &str) -> Result<Vec<Self>> {
        let mut found = Vec::new();
        for index in &self.element().children {
            let element = &self.document.elements[*index];
            let is_wanted = match &element.tag[..] {
                "ref" => {
                    let target = element.attribute("id").and_then(|id| self.document.by_id(id));
                    // `resolved` reports references to nothing.
                    target.is_none_or(|target| self.document.elements[target].tag == tag)
                }
                own => own == tag,
            };
            if is_wanted {
                found.push(self.resolved(*index)?);
            }
        }
        Ok(found)
    }

    /// The numbers of the attribute `value`.
    pub fn numbers(&self) -> Result<Vec<f64>> {
        self.parse_list(self.attribute("value")?)
    }

    /// Numbers separated by commas or white space.
    pub fn parse_list(&self, text: &str) -> Result<Vec<f64>> {
        words(text).map(|word| self.parse(word)).collect()
    }

    /// A finite number.
    pub fn parse(&self, word: &str) -> Result<f64> {
        let number = word.trim().parse().ok().filter(|number: &f64| number.is_finite());
        number.ok_or_else(|| {
            let shown: String = word.chars().take(40).collect();
            self.error(format!("`{shown}` is not a finite number"), "give a number")
        })
    }

    /// A point or vector by its attributes, or by `value`.
    pub fn vector(&self, default: f64) -> Result<DVec3> {
        if let Some(text) = self.element().attribute("value") {
            return match self.parse_list(text)?[..] {
                [all] => Ok(DVec3::splat(all)),
                [x, y] => Ok(DVec3::new(x, y, default)),
                [x, y, z] => Ok(DVec3::new(x, y, z)),
                _ => Err(self.error("it does not have three numbers", "give three")),
            };
        }
        let one =
            |name| self.element().attribute(name).map_or(Ok(default), |text| self.parse(text));
        Ok(DVec3::new(one("x")?, one("y")?, one("z")?))
    }

    /// A value, if it is given.
    fn value(&self, name: &str) -> Result<Option<(Self, &'a str)>> {
        let Some(child) = self.get(name)? else { return Ok(None) };
        Ok(Some((child, child.attribute("value")?)))
    }

    pub fn float(&self, name: &str) -> Result<Option<f64>> {
        self.value(name)?.map(|(child, text)| child.parse(text)).transpose()
    }

    /// A number within bounds.
    pub fn float_in(&self, name: &str, default: f64, [low, high]: [f64; 2]) -> Result<f64> {
        let Some(value) = self.float(name)? else { return Ok(default) };
        if (low..=high).contains(&value) {
            return Ok(value);
        }
        let problem = format!("`{name}` is {value}");
        Err(self.error(problem, &format!("give a number from {low:e} to {high:e}")))
    }

    pub fn string(&self, name: &str) -> Result<Option<&'a str>> {
        Ok(self.value(name)?.map(|(_, text)| text))
    }

    pub fn boolean(&self, name: &str) -> Result<Option<bool>> {
        let Some((child, text)) = self.value(name)? else { return Ok(None) };
        match &text.trim().to_ascii_lowercase()[..] {
            "true" => Ok(Some(true)),
            "false" => Ok(Some(false)),
            _ => {
                Err(child.error(format!("`{text}` is neither true nor false"), "give one of them"))
            }
        }
    }

    pub fn point(&self, name: &str) -> Result<Option<DVec3>> {
        self.get(name)?.map(|child| child.vector(0.0)).transpose()
    }

    /// The transform of this name; the identity if there is none.
    pub fn map(&self, name: &str) -> Result<DAffine3> {
        self.get(name)?.map_or(Ok(DAffine3::IDENTITY), |child| maps::read(&child))
    }

    /// The file of the property `filename`.
    pub fn file(&self) -> Result<PathBuf> {
        let Some((child, name)) = self.value("filename")? else {
            return Err(self.error("it names no file", "add `filename`"));
        };
        self.document
            .find_file(child.index, name)
            .ok_or_else(|| child.error(format!("there is no file `{name}`"), RELATIVE_NAME))
    }
}

/// The words of a list, which are separated by commas or white space.
pub(super) fn words(text: &str) -> impl Iterator<Item = &str> {
    text.split(|c: char| c == ',' || c.is_whitespace()).filter(|word| !word.is_empty())
}
