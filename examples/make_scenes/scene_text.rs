//! Writing scene.toml: what is there once as tables, meshes and lights as one line each.

use super::obj::number;
use std::fmt::Write;

/// A folder of `scenes/`: its name and its files' names and texts.
pub struct Folder {
    pub name: &'static str,
    pub files: Vec<(&'static str, String)>,
}

/// A scene file in the making.
#[derive(Clone, Debug, Default)]
pub struct SceneText {
    head: String,
    meshes: Vec<String>,
    lights: Vec<String>,
    tables: String,
}

/// Where a copy of a mesh is: scaled, turned about the y axis, moved.
#[derive(Clone, Copy, Debug)]
pub struct Place {
    pub at: [f64; 3],
    pub turn_y_deg: f64,
    pub scale: [f64; 3],
}

impl Place {
    pub fn at(x: f64, y: f64, z: f64) -> Self {
        Self { at: [x, y, z], turn_y_deg: 0.0, scale: [1.0; 3] }
    }

    #[must_use]
    pub fn turned(self, degrees: f64) -> Self {
        Self { turn_y_deg: degrees, ..self }
    }

    #[must_use]
    pub fn scaled(self, x: f64, y: f64, z: f64) -> Self {
        Self { scale: [x, y, z], ..self }
    }
}

impl SceneText {
    /// Begins with a comment, one line or more.
    pub fn new(comment: &str) -> Self {
        let head = comment.lines().fold(String::new(), |text, line| text + "# " + line + "\n");
        Self { head, ..Self::default() }
    }

    /// A mesh as the file has it.
    pub fn mesh(&mut self, file: &str) -> &mut Self {
        self.meshes.push(format!("{{ file = \"{file}\" }}"));
        self
    }

    /// A copy of a mesh, with a material of its own if one is named.
    pub fn copy(&mut self, file: &str, material: Option<&str>, place: Place) -> &mut Self {
        let mut line = format!("{{ file = \"{file}\"");
        if let Some(material) = material {
            let _ = write!(line, ", material = \"{material}\"");
        }
        if place.scale != [1.0; 3] {
            let _ = write!(line, ", scale = {}", vector(place.scale));
        }
        if place.turn_y_deg != 0.0 {
            let _ = write!(line, ", rotate_deg = {}", vector([0.0, place.turn_y_deg, 0.0]));
        }
        let _ = write!(line, ", translate = {} }}", vector(place.at));
        self.meshes.push(line);
        self
    }

    /// A light: what stands between the braces of its TOML table.
    pub fn light(&mut self, keys: &str) -> &mut Self {
        self.lights.push(format!("{{ {keys} }}"));
        self
    }

    /// A table such as `camera` or `materials.glass`, with its lines.
    pub fn table(&mut self, name: &str, lines: &[&str]) -> &mut Self {
        let _ = write!(self.tables, "\n[{name}]\n{}\n", lines.join("\n"));
        self
    }

    /// The file's text. Arrays come before the first table: TOML would count them to the last one.
    pub fn text(&self) -> String {
        let mut text = self.head.clone();
        for (name, entries) in [("mesh", &self.meshes), ("light", &self.lights)] {
            if !entries.is_empty() {
                let _ = write!(text, "\n{name} = [\n    {},\n]\n", entries.join(",\n    "));
            }
        }
        text + &self.tables
    }
}

/// A vector as TOML, rounded to 4 decimals.
pub fn vector(v: [f64; 3]) -> String {
    let [x, y, z] = v.map(|value| number(value, 4));
    format!("[{x}, {y}, {z}]")
}
