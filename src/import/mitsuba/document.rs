//! The elements of a scene file and of those that it includes, with all parameters put in.

use super::names;
use crate::base::error::{Error, Result};
use crate::import::text;
use roxmltree::{Node, ParsingOptions};
use std::cell::Cell;
use std::collections::HashMap;
use std::path::{Path, PathBuf};

/// Most elements of all files.
const MAX_ELEMENTS: usize = 1 << 21;
/// Most XML nodes of one file: white space counts.
const MAX_NODES: u32 = 1 << 23;
/// Deepest nesting of elements and of references.
pub(super) const MAX_DEPTH: usize = 48;
/// Deepest nesting of included files, and most of them.
const MAX_INCLUDES: [usize; 2] = [16, 1000];
/// Longest value of an attribute with its parameters put in, bytes.
const MAX_VALUE: usize = 1 << 16;

/// An element, its names in the style of Mitsuba 3.
#[derive(Debug)]
pub(super) struct Element {
    pub tag: String,
    attributes: Vec<(String, String)>,
    pub children: Vec<usize>,
    /// Index of its file, and the byte at which it begins.
    place: (usize, usize),
    /// Whether anybody asked for it.
    pub used: Cell<bool>,
}

impl Element {
    pub fn attribute(&self, name: &str) -> Option<&str> {
        self.attributes.iter().find(|(key, _)| key == name).map(|(_, value)| &value[..])
    }
}

/// A scene file with all that it includes.
#[derive(Debug)]
pub(super) struct Document {
    pub elements: Vec<Element>,
    /// Children of the scene, in order.
    pub top: Vec<usize>,
    /// Whether the file is of Mitsuba 0.5 or 0.6.
    pub is_old: bool,
    sources: Vec<(PathBuf, String)>,
    /// Where files are looked for.
    folders: Vec<PathBuf>,
    ids: HashMap<String, usize>,
    defaults: Vec<(String, String)>,
}

impl Document {
    /// Reads a file and what it includes.
    ///
    /// # Errors
    /// Names the file, line and element that cannot be read.
    pub fn read(path: &Path) -> Result<Self> {
        let mut document = Self {
            elements: Vec::new(),
            top: Vec::new(),
            is_old: false,
            sources: Vec::new(),
            folders: vec![path.parent().unwrap_or(Path::new("")).to_owned()],
            ids: HashMap::new(),
            defaults: Vec::new(),
        };
        document.top = document.file(path, &mut Vec::new())?;
        Ok(document)
    }

    /// The elements within the scene of a file; `open` are those that include it.
    fn file(&mut self, path: &Path, open: &mut Vec<PathBuf>) -> Result<Vec<usize>> {
        let text = text::read(path)?;
        let source = self.sources.len();
        self.sources.push((path.to_owned(), text.clone()));
        let options = ParsingOptions { nodes_limit: MAX_NODES, ..ParsingOptions::default() };
        let parsed = roxmltree::Document::parse_with_options(&text, options).map_err(|e| {
            let row = e.pos().row as usize;
            let line = text.lines().nth(row.saturating_sub(1)).unwrap_or_default().to_owned();
            let problem = match e {
                roxmltree::Error::DtdDetected => "it has a DTD, which is not read".to_owned(),
                roxmltree::Error::NodesLimitReached => "it has too many elements".to_owned(),
                e => format!("it is no XML: {e}"),
            };
            let advice = "give a scene of Mitsuba 3, 0.6 or 0.5";
            Error::new(problem, advice).at(path).line(row.max(1), line.trim_end())
        })?;
        let root = parsed.root_element();
        if root.tag_name().name() != "scene" {
            let problem = format!("its root is <{}>, not <scene>", root.tag_name().name());
            let advice = "give a scene of Mitsuba 3, 0.6 or 0.5";
            return Err(Error::new(problem, advice).at(path).at_offset(&text, root.range().start));
        }
        if open.is_empty() {
            let version = root.attribute("version").unwrap_or("3.0.0");
            self.is_old = version.trim().starts_with("0.");
        }
        open.push(path.canonicalize().unwrap_or_else(|_| path.to_owned()));
        let children = self.children(root, source, open, 0);
        open.pop();
        children
    }

    /// Those of an element, in order.
    fn children(
        &mut self,
        parent: Node,
        source: usize,
        open: &mut Vec<PathBuf>,
        depth: usize,
    ) -> Result<Vec<usize>> {
        let mut all = Vec::new();
        for node in parent.children().filter(Node::is_element) {
            let place = (source, node.range().start);
            let tag = names::modern(node.tag_name().name());
            let here = |document: &Self, problem: String, advice: &str| {
                document.error_at(place, &format!("<{tag}>"), problem, advice)
            };
            if depth >= MAX_DEPTH {
                let problem = format!("elements are nested more than {MAX_DEPTH} deep");
                return Err(here(self, problem, "nest them less"));
            }
            if self.elements.len() >= MAX_ELEMENTS {
                let problem = format!("there are more than {MAX_ELEMENTS} elements");
                return Err(here(self, problem, "split the scene"));
            }
            let mut attributes = Vec::new();
            for attribute in node.attributes() {
                let value = self
                    .substituted(attribute.value())
                    .map_err(|(problem, advice)| here(self, problem, &advice))?;
                let value = if attribute.name() == "name" { names::modern(&value) } else { value };
                attributes.push((attribute.name().to_owned(), value));
            }
            let used = Cell::new(false);
            let element =
                Element { tag: tag.clone(), attributes, children: Vec::new(), place, used };
            let needed = |name: &str| {
                element.attribute(name).map(str::to_owned).ok_or_else(|| {
                    let problem = format!("it has no `{name}`");
                    self.error_at(place, &format!("<{}>", element.tag), problem, "add it")
                })
            };
            match &element.tag[..] {
                "default" => {
                    let (name, value) = (needed("name")?, needed("value")?);
                    // The name is no property's.
                    let name = node.attribute("name").map_or(name, str::to_owned);
                    if self.defaults.iter().all(|(known, _)| *known != name) {
                        self.defaults.push((name, value));
                    }
                }
                "path" => {
                    let folder = self.folders[0].join(needed("value")?);
                    self.folders.push(folder);
                }
                "alias" => {
                    let (id, new) = (needed("id")?, needed("as")?);
                    let target = *self.ids.get(&id).ok_or_else(|| {
                        here(self, format!("nothing has the id `{id}`"), "define it before")
                    })?;
                    self.ids.insert(new, target);
                }
                "include" => {
                    let name = needed("filename")?;
                    let inner = self.included(&name, place, open)?;
                    all.extend(inner);
                }
                _ => {
                    let index = self.elements.len();
                    if let Some(id) = element.attribute("id")
                        && element.tag != "ref"
                    {
                        if self.ids.contains_key(id) {
                            let problem = format!("the id `{id}` is given twice");
                            return Err(here(self, problem, "rename one of them"));
                        }
                        self.ids.insert(id.to_owned(), index);
                    }
                    self.elements.push(element);
                    self.elements[index].children = self.children(node, source, open, depth + 1)?;
                    all.push(index);
                }
            }
        }
        Ok(all)
    }

    fn included(
        &mut self,
        name: &str,
        place: (usize, usize),
        open: &mut Vec<PathBuf>,
    ) -> Result<Vec<usize>> {
        let here =
            |problem: String, advice: &str| Err(self.error_at(place, "<include>", problem, advice));
        let Some(path) = self.find(name, place.0) else {
            return here(format!("there is no file `{name}`"), "check the name");
        };
        let full = path.canonicalize().unwrap_or_else(|_| path.clone());
        if open.contains(&full) {
            return here(format!("`{name}` includes itself"), "remove the include");
        }
        let [deepest, most] = MAX_INCLUDES;
        if open.len() >= deepest || self.sources.len() >= most {
            return here("too many files are included".into(), "put them into one");
        }
        self.file(&path, open)
    }

    /// A value with all parameters put in, or the problem and what to do.
    fn substituted(&self, value: &str) -> std::result::Result<String, (String, String)> {
        let mut text = String::new();
        let mut rest = value;
        while let Some(at) = rest.find('$') {
            let name = &rest[at + 1..];
            // The longest of those that it may be.
            let known = self.defaults.iter().filter(|(key, _)| name.starts_with(&key[..]));
            let Some((key, value)) = known.max_by_key(|(key, _)| key.len()) else {
                let end = name.find(|c: char| !(c.is_alphanumeric() || c == '_'));
                let name = &name[..end.unwrap_or(name.len())];
                let advice = format!("add `<default name=\"{name}\" value=\"...\"/>` before");
                return Err((format!("the parameter `${name}` has no value"), advice));
            };
            text += &rest[..at];
            text += value;
            rest = &name[key.len()..];
            if text.len() > MAX_VALUE {
                return Err((
                    format!("a value has more than {MAX_VALUE} bytes"),
                    "shorten it".into(),
                ));
            }
        }
        Ok(text + rest)
    }

    /// A file that an element of the source of this index names.
    fn find(&self, name: &str, source: usize) -> Option<PathBuf> {
        let own = self.sources[source].0.parent().unwrap_or(Path::new(""));
        let mut folders = self.folders.iter().map(PathBuf::as_path).chain([own]);
        folders.find_map(|folder| text::find(folder, name)).filter(|path| path.is_file())
    }

    /// The file that this element calls so.
    pub fn find_file(&self, index: usize, name: &str) -> Option<PathBuf> {
        self.find(name, self.elements[index].place.0)
    }

    /// The index of what has this id.
    pub fn by_id(&self, id: &str) -> Option<usize> {
        self.ids.get(id).copied()
    }

    /// The element as messages show it.
    pub fn shown(&self, index: usize) -> String {
        let element = &self.elements[index];
        let mut text = format!("<{}", element.tag);
        for key in ["type", "name", "id"] {
            if let Some(value) = element.attribute(key) {
                let value: String = value.chars().take(60).collect();
                text += &format!(" {key}=\"{value}\"");
            }
        }
        text + ">"
    }

    /// The element's line in its file, from 1.
    pub fn line(&self, index: usize) -> usize {
        let (source, offset) = self.elements[index].place;
        let text = &self.sources[source].1;
        text.get(..offset).map_or(1, |before| before.matches('\n').count() + 1)
    }

    /// A problem with an element.
    pub fn error(&self, index: usize, problem: impl Into<String>, advice: &str) -> Error {
        let place = self.elements[index].place;
        self.error_at(place, &self.shown(index), problem.into(), advice)
    }

    fn error_at(
        &self,
        (source, offset): (usize, usize),
        shown: &str,
        problem: String,
        advice: &str,
    ) -> Error {
        let (path, text) = &self.sources[source];
        Error::new(format!("{shown}: {problem}"), advice).at(path).at_offset(text, offset)
    }
}
