//! The elements of a scene file and of the files that it includes, with all parameters substituted.

use crate::file_names::is_guess;
use crate::text;
use bdpm_core::base::error::{Error, Result};
use roxmltree::{Node, ParsingOptions};
use std::cell::{Cell, RefCell};
use std::collections::{BTreeSet, HashMap};
use std::path::{Path, PathBuf};

/// Maximum number of elements of all files.
const MAX_ELEMENTS: usize = 1 << 21;
/// Maximum number of XML nodes of one file, including white space.
const MAX_NODES: u32 = 1 << 23;
/// Maximum depth of nested elements and references.
pub(super) const MAX_DEPTH: usize = 48;
/// Maximum depth of included files.
const MAX_INCLUDE_DEPTH: usize = 16;
/// Maximum number of files.
const MAX_FILES: usize = 1000;
/// Maximum length of an attribute with its parameters substituted, bytes.
const MAX_VALUE: usize = 1 << 16;

/// Maximum bytes of all files, and of all attributes with their parameters substituted.
const MAX_TOTAL: usize = 1 << 28;

/// A position in the files of a document.
#[derive(Clone, Copy, Debug)]
struct SourcePosition {
    /// Index of the file.
    source: usize,
    /// Bytes from its beginning.
    offset: usize,
}

/// An element with names in the style of Mitsuba 3.
#[derive(Debug)]
pub(super) struct Element {
    pub tag: String,
    attributes: Vec<(String, String)>,
    pub children: Vec<usize>,
    start: SourcePosition,
    /// Whether the element was read.
    pub used: Cell<bool>,
}

impl Element {
    pub fn attribute(&self, name: &str) -> Option<&str> {
        self.attributes.iter().find(|(key, _)| key == name).map(|(_, value)| &value[..])
    }
}

/// A scene file with all files that it includes.
#[derive(Debug, Default)]
pub(super) struct XmlDocument {
    pub elements: Vec<Element>,
    /// Children of the scene, in order.
    pub top: Vec<usize>,
    /// Whether the file has the format of Mitsuba 0.5 or 0.6.
    pub is_old: bool,
    sources: Vec<(PathBuf, String)>,
    /// Offsets at which the lines of each source begin. Names of elements have their line.
    line_starts: Vec<Vec<usize>>,
    /// Bytes of all files, and of all attributes.
    read: usize,
    substituted: usize,
    /// Names of files that were found under other names.
    pub guessed: RefCell<BTreeSet<String>>,
    /// Folders in which files are searched.
    folders: Vec<PathBuf>,
    ids: HashMap<String, usize>,
    defaults: Vec<(String, String)>,
}

impl XmlDocument {
    /// Reads a file and all files that it includes.
    ///
    /// # Errors
    /// Names the file, line and element that cannot be read.
    pub fn read(path: &Path) -> Result<Self> {
        let mut document = Self {
            folders: vec![path.parent().unwrap_or(Path::new("")).to_owned()],
            ..Self::default()
        };
        document.top = document.file(path, &mut Vec::new())?;
        Ok(document)
    }

    /// The elements in the scene of a file. `open` are the files that include it.
    fn file(&mut self, path: &Path, open: &mut Vec<PathBuf>) -> Result<Vec<usize>> {
        let text = text::read(path)?;
        self.read += text.len();
        if self.read > MAX_TOTAL {
            let problem = format!("the files of the scene have over {} MiB", MAX_TOTAL >> 20);
            return Err(Error::new(problem, "include each file once").at(path));
        }
        let source = self.sources.len();
        self.sources.push((path.to_owned(), text.clone()));
        let ends = memchr::memchr_iter(b'\n', text.as_bytes());
        self.line_starts.push(std::iter::once(0).chain(ends.map(|end| end + 1)).collect());
        let options = ParsingOptions { nodes_limit: MAX_NODES, ..ParsingOptions::default() };
        let parsed = roxmltree::Document::parse_with_options(&text, options).map_err(|e| {
            let row = e.pos().row as usize;
            let line = text.lines().nth(row.saturating_sub(1)).unwrap_or_default().to_owned();
            let problem = match e {
                roxmltree::Error::DtdDetected => "it has a DTD, which is not supported".to_owned(),
                roxmltree::Error::NodesLimitReached => "it has too many elements".to_owned(),
                e => format!("it is not valid XML: {e}"),
            };
            Error::new(problem, KNOWN_VERSIONS).at(path).line(row.max(1), line.trim_end())
        })?;
        let root = parsed.root_element();
        if root.tag_name().name() != "scene" {
            let problem = format!("its root is <{}>, not <scene>", root.tag_name().name());
            return Err(Error::new(problem, KNOWN_VERSIONS)
                .at(path)
                .at_offset(&text, root.range().start));
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

    /// Adds the child elements of an element, and returns their indices in order.
    fn children(
        &mut self,
        parent: Node,
        source: usize,
        open: &mut Vec<PathBuf>,
        depth: usize,
    ) -> Result<Vec<usize>> {
        let mut all = Vec::new();
        for node in parent.children().filter(Node::is_element) {
            let element = self.element(node, source, depth)?;
            self.add(element, node, open, depth, &mut all)?;
        }
        Ok(all)
    }

    /// An element with its attributes, without its children.
    fn element(&mut self, node: Node, source: usize, depth: usize) -> Result<Element> {
        let mut element = Element {
            tag: modern_name(node.tag_name().name()),
            attributes: Vec::new(),
            children: Vec::new(),
            start: SourcePosition { source, offset: node.range().start },
            used: Cell::new(false),
        };
        if depth >= MAX_DEPTH {
            let problem = format!("elements are nested more than {MAX_DEPTH} deep");
            return Err(self.error_in(&element, problem, "nest them less"));
        }
        if self.elements.len() >= MAX_ELEMENTS {
            let problem = format!("there are more than {MAX_ELEMENTS} elements");
            return Err(self.error_in(&element, problem, "split the scene"));
        }
        for attribute in node.attributes() {
            let value = self
                .substituted(attribute.value())
                .map_err(|(problem, advice)| self.error_in(&element, problem, &advice))?;
            self.substituted += value.len();
            if self.substituted > MAX_TOTAL {
                let problem = format!("its values have over {} MiB so far", MAX_TOTAL >> 20);
                return Err(self.error_in(&element, problem, "use shorter parameters"));
            }
            let value = if attribute.name() == "name" { modern_name(&value) } else { value };
            element.attributes.push((attribute.name().to_owned(), value));
        }
        Ok(element)
    }

    /// Does what an element says, or adds it and its children. `siblings` are those of the same
    /// parent.
    fn add(
        &mut self,
        element: Element,
        node: Node,
        open: &mut Vec<PathBuf>,
        depth: usize,
        siblings: &mut Vec<usize>,
    ) -> Result<()> {
        let required = |name: &str| {
            let value = element.attribute(name).map(str::to_owned);
            value.ok_or_else(|| self.error_in(&element, format!("it has no `{name}`"), "add it"))
        };
        match &element.tag[..] {
            "default" => {
                let (name, value) = (required("name")?, required("value")?);
                // This is not the name of a property, which would be modernized.
                let name = node.attribute("name").map_or(name, str::to_owned);
                if self.defaults.iter().all(|(known, _)| *known != name) {
                    self.defaults.push((name, value));
                }
            }
            "path" => {
                let folder = self.folders[0].join(required("value")?);
                self.folders.push(folder);
            }
            "alias" => {
                let (id, new) = (required("id")?, required("as")?);
                let target = *self.ids.get(&id).ok_or_else(|| {
                    let problem = format!("nothing has the id `{id}`");
                    self.error_in(&element, problem, "define it before")
                })?;
                self.ids.insert(new, target);
            }
            "include" => {
                siblings.extend(self.included(&required("filename")?, element.start, open)?);
            }
            _ => {
                let index = self.elements.len();
                if let Some(id) = element.attribute("id")
                    && element.tag != "ref"
                {
                    if self.ids.contains_key(id) {
                        let problem = format!("the id `{id}` is given twice");
                        return Err(self.error_in(&element, problem, "rename one of them"));
                    }
                    self.ids.insert(id.to_owned(), index);
                }
                let source = element.start.source;
                self.elements.push(element);
                self.elements[index].children = self.children(node, source, open, depth + 1)?;
                siblings.push(index);
            }
        }
        Ok(())
    }

    fn included(
        &mut self,
        name: &str,
        start: SourcePosition,
        open: &mut Vec<PathBuf>,
    ) -> Result<Vec<usize>> {
        let here =
            |problem: String, advice: &str| Err(self.error_at(start, "<include>", problem, advice));
        let Some(path) = self.find(name, start.source) else {
            return here(format!("there is no file `{name}`"), "check the name");
        };
        let full = path.canonicalize().unwrap_or_else(|_| path.clone());
        if open.contains(&full) {
            return here(format!("`{name}` includes itself"), "remove the include");
        }
        if open.len() >= MAX_INCLUDE_DEPTH || self.sources.len() >= MAX_FILES {
            return here("too many files are included".into(), "merge some of them");
        }
        self.file(&path, open)
    }

    /// A value with all parameters substituted, or the problem and the advice.
    fn substituted(&self, value: &str) -> std::result::Result<String, (String, String)> {
        let mut text = String::new();
        let mut rest = value;
        while let Some(at) = rest.find('$') {
            let name = &rest[at + 1..];
            // The longest matching name.
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
                let problem = format!("a value has more than {MAX_VALUE} bytes");
                return Err((problem, "shorten it".to_owned()));
            }
        }
        Ok(text + rest)
    }

    /// Finds a file that an element of the source of this index names.
    fn find(&self, name: &str, source: usize) -> Option<PathBuf> {
        let own = self.sources[source].0.parent().unwrap_or(Path::new(""));
        let mut folders = self.folders.iter().map(PathBuf::as_path).chain([own]);
        let own = folders.find_map(|folder| Some((folder, text::find(folder, name)?)));
        let (folder, path) = own.filter(|(_, path)| path.is_file())?;
        if is_guess(folder, name, &path) {
            self.guessed.borrow_mut().insert(name.to_owned());
        }
        Some(path)
    }

    /// Finds a file that the element of this index names.
    pub fn find_file(&self, index: usize, name: &str) -> Option<PathBuf> {
        self.find(name, self.elements[index].start.source)
    }

    /// The index of the element with this id.
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
        let SourcePosition { source, offset } = self.elements[index].start;
        self.line_starts[source].partition_point(|start| *start <= offset)
    }

    /// A problem with an element.
    pub fn error(&self, index: usize, problem: impl Into<String>, advice: &str) -> Error {
        self.error_at(self.elements[index].start, &self.shown(index), problem.into(), advice)
    }

    /// A problem of an element.
    fn error_in(&self, element: &Element, problem: String, advice: &str) -> Error {
        self.error_at(element.start, &format!("<{}>", element.tag), problem, advice)
    }

    fn error_at(&self, start: SourcePosition, shown: &str, problem: String, advice: &str) -> Error {
        let (path, text) = &self.sources[start.source];
        Error::new(format!("{shown}: {problem}"), advice).at(path).at_offset(text, start.offset)
    }
}

const KNOWN_VERSIONS: &str = "give a scene of Mitsuba 3, 0.6 or 0.5";

/// Converts names of Mitsuba 0.5 and 0.6 to those of Mitsuba 3: `toWorld` to `to_world`, `intIOR`
/// to `int_ior`.
fn modern_name(name: &str) -> String {
    if name == "lookAt" {
        return "lookat".to_owned();
    }
    let mut text = String::with_capacity(name.len() + 4);
    let mut before = '_';
    for c in name.chars() {
        if c.is_uppercase() && (before.is_lowercase() || before.is_numeric()) {
            text.push('_');
        }
        text.extend(c.to_lowercase());
        before = c;
    }
    text
}

#[cfg(test)]
mod tests {
    use super::modern_name;

    #[test]
    fn old_names_are_converted_to_new_ones() {
        for (old, new) in [
            ("toWorld", "to_world"),
            ("intIOR", "int_ior"),
            ("lookAt", "lookat"),
            ("alphaU", "alpha_u"),
            ("diffuseReflectance", "diffuse_reflectance"),
            ("filename", "filename"),
            ("color0", "color0"),
        ] {
            assert_eq!(modern_name(old), new);
        }
    }
}
