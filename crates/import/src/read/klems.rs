//! BSDF files of WINDOW and of Radiance's genBSDF: matrices over patches of directions (XML).
//!
//! Their front faces outside, that of a scene's sheet faces the room: "Transmission Front" is light
//! that arrives at the back. Of the spectral parts, `Visible` is read.

use crate::text;
use bdpm_core::base::error::{Error, Result};
use bdpm_core::scene::bsdf::{AngleBand, AngleBasis, KlemsMatrices, MAX_PATCHES, SideValues};
use roxmltree::{Document, Node, ParsingOptions};
use std::f32::consts::FRAC_1_PI;
use std::path::Path;

/// Maximum number of XML nodes.
const MAX_NODES: u32 = 1 << 16;

const ADVICE: &str = "export the system again, as a BSDF file with a Klems basis";

/// Scattering that a file does not have: shares of diffuse light, evenly into all directions.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct EvenShares {
    /// Reflected by the front.
    pub front: f32,
    /// Reflected by the back.
    pub back: f32,
    /// Transmitted both ways.
    pub transmitted: f32,
}

impl EvenShares {
    /// Adds them to the values of both sides. A missing transmission is that of the other side,
    /// which has them then.
    fn add_to(self, values: &mut [SideValues; 2], patches: usize) {
        let transmits = values.iter().any(|[_, transmitted]| transmitted.is_some());
        let add = |matrix: &mut Option<Vec<f32>>, share: f32, is_needed: bool| {
            if share > 0.0 && is_needed {
                matrix.get_or_insert_with(|| vec![0.0; patches * patches]);
            }
            let own = matrix.iter_mut().flatten();
            own.for_each(|value| *value += share * FRAC_1_PI);
        };
        for ([reflected, transmitted], share) in values.iter_mut().zip([self.front, self.back]) {
            add(reflected, share, true);
            add(transmitted, self.transmitted, !transmits);
        }
    }
}

/// The matrices of a file with this added.
///
/// # Errors
/// Names the file and, where it can, the line: no XML, a tensor tree, unknown patches, other
/// numbers of values than patches, more light scattered than arrives.
pub fn read(path: &Path, more: EvenShares) -> Result<&'static KlemsMatrices> {
    let text = text::read(path)?;
    let options = ParsingOptions { nodes_limit: MAX_NODES, ..ParsingOptions::default() };
    let document = Document::parse_with_options(&text, options).map_err(|error| {
        let row = error.pos().row.max(1) as usize;
        let line = text.lines().nth(row - 1).unwrap_or_default().trim_end().to_owned();
        let problem = format!("it is not valid XML: {error}");
        Error::new(problem, ADVICE).at(path).line(row, line)
    })?;
    let file = KlemsFile { path, text: &text };
    let root = document.root_element();
    let layer = (root.descendants().find(|node| node.has_tag_name_of("Layer")))
        .ok_or_else(|| file.error(root, "it has no <Layer>"))?;
    let mut values = file.values(layer)?;
    let basis = file.basis(layer)?;
    more.add_to(&mut values, basis.patches());
    let matrices = KlemsMatrices::new(basis, values);
    Ok(matrices.map_err(|problem| file.error(layer, &problem))?.shared())
}

/// Names of elements without their name space, which differs between programs.
trait TagName {
    fn has_tag_name_of(&self, name: &str) -> bool;
    fn child(&self, name: &str) -> Option<Self>
    where
        Self: Sized;
    fn words(&self, name: &str) -> &str;
}

impl TagName for Node<'_, '_> {
    fn has_tag_name_of(&self, name: &str) -> bool {
        self.tag_name().name() == name
    }

    fn child(&self, name: &str) -> Option<Self> {
        self.children().find(|node| node.has_tag_name_of(name))
    }

    /// The text of a child; empty if there is none.
    fn words(&self, name: &str) -> &str {
        self.child(name).and_then(|node| node.text()).unwrap_or_default().trim()
    }
}

struct KlemsFile<'a> {
    path: &'a Path,
    text: &'a str,
}

impl KlemsFile<'_> {
    fn error(&self, node: Node, problem: &str) -> Error {
        Error::new(problem, ADVICE).at(self.path).at_offset(self.text, node.range().start)
    }

    /// The patches, from the definition in the file or by their name.
    fn basis(&self, layer: Node) -> Result<AngleBasis> {
        let blocks = layer.descendants().filter(|node| node.has_tag_name_of("WavelengthDataBlock"));
        let names: Vec<_> = blocks
            .flat_map(|block| {
                ["ColumnAngleBasis", "RowAngleBasis"].map(|name| block.words(name).to_owned())
            })
            .collect();
        let name = names.first().map_or("", |name| &name[..]);
        if names.iter().any(|other| !other.eq_ignore_ascii_case(name)) {
            return Err(self.error(layer, "its matrices have several angle bases"));
        }
        let mut own = layer.descendants().filter(|node| {
            node.has_tag_name_of("AngleBasis")
                && node.words("AngleBasisName").eq_ignore_ascii_case(name)
        });
        let defined = own.next().map(|node| self.defined(node)).transpose()?;
        defined.or_else(|| AngleBasis::named(name)).ok_or_else(|| {
            let problem = format!("the angle basis `{name}` is not defined");
            self.error(layer, &problem)
        })
    }

    fn defined(&self, node: Node) -> Result<AngleBasis> {
        let wrong = || {
            let problem = format!(
                "its patches are not bands from 0 to 90 degrees of 1 or an even number each, at \
                 most {MAX_PATCHES} in all"
            );
            self.error(node, &problem)
        };
        let band = |block: Node| {
            let bounds = block.child("ThetaBounds")?;
            let upper_deg = bounds.words("UpperTheta").parse().ok()?;
            Some(AngleBand { upper_deg, patches: block.words("nPhis").parse().ok()? })
        };
        let blocks = node.children().filter(|node| node.has_tag_name_of("AngleBasisBlock"));
        let bands = blocks.map(band).collect::<Option<Vec<_>>>();
        bands.and_then(AngleBasis::new).ok_or_else(wrong)
    }

    /// The values of light from the front and the back of the sheet: reflected, transmitted.
    fn values(&self, layer: Node) -> Result<[SideValues; 2]> {
        let by_rows = self.is_by_rows(layer)?;
        let mut values = [[None, None], [None, None]];
        let mut others = Vec::new();
        for data in layer.children().filter(|node| node.has_tag_name_of("WavelengthData")) {
            let part = data.words("Wavelength");
            if part != "Visible" {
                others.push(part.to_owned());
                continue;
            }
            for block in data.children().filter(|own| own.has_tag_name_of("WavelengthDataBlock")) {
                let [from, kind] = match block.words("WavelengthDataDirection") {
                    "Reflection Back" => [0, 0],
                    "Transmission Back" => [0, 1],
                    "Reflection Front" => [1, 0],
                    "Transmission Front" => [1, 1],
                    // Absorbed shares follow from the others.
                    _ => continue,
                };
                values[from][kind] = Some(self.matrix(block, by_rows)?);
            }
        }
        if values.iter().flatten().all(Option::is_none) {
            let problem = match others.first() {
                None => "it has no scattering data".to_owned(),
                Some(other) => format!("it has data for `{other}`, and none for `Visible`"),
            };
            return Err(self.error(layer, &problem));
        }
        Ok(values)
    }

    /// Whether the directions of arriving light are rows.
    fn is_by_rows(&self, layer: Node) -> Result<bool> {
        let Some(node) = layer.child("DataDefinition") else {
            return Err(self.error(layer, "it has no <DataDefinition>"));
        };
        match node.words("IncidentDataStructure") {
            "Columns" => Ok(false),
            "Rows" => Ok(true),
            other => {
                let problem = format!("it has the structure `{other}`, not a matrix");
                Err(self.error(node, &problem))
            }
        }
    }

    /// The numbers of a matrix with a column for each direction of arriving light.
    fn matrix(&self, block: Node, by_rows: bool) -> Result<Vec<f32>> {
        let data = block.child("ScatteringData").unwrap_or(block);
        let words = data.text().unwrap_or_default().split([',', ' ', '\t', '\r', '\n']);
        let words = words.filter(|word| !word.is_empty());
        let mut values = Vec::new();
        for word in words.take(MAX_PATCHES * MAX_PATCHES + 1) {
            let value = word.parse::<f32>().ok().filter(|value| value.is_finite());
            values.push(value.ok_or_else(|| {
                let shown: String = word.chars().take(40).collect();
                self.error(data, &format!("`{shown}` stands for a value"))
            })?);
        }
        let side = values.len().isqrt();
        if by_rows && side * side == values.len() {
            return Ok((0..side * side).map(|i| values[i % side * side + i / side]).collect());
        }
        Ok(values)
    }
}
