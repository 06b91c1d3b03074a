//! Meshes in PLY files, text or binary, compressed by gzip or not: vertices with normals, texture
//! coordinates and colors, and faces with those of their corners.

mod content;
mod corners;
mod vertices;

use crate::far::DBounds;
use crate::shape::polygon::{self, Cutter};
use crate::text::list;
use crate::warnings::Warning;
use bdpm_core::base::error::{Error, Result};
use bdpm_core::base::math::Rgb;
use bdpm_core::scene::Mesh;
use content::Content;
use corners::Corners;
use glam::{DVec3, Vec2};
use ply_rs_bw::ply::{ElementDef, PropertyType};
use std::path::Path;
use vertices::{Channel, ColorChannels};

/// Direction in which texture coordinates `v` grow in the picture.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum VDirection {
    /// In most programs.
    Up,
    /// In Mitsuba.
    Down,
}

impl VDirection {
    /// Texture coordinates of a [`Mesh`].
    fn upright(self, [u, v]: [f64; 2]) -> Vec2 {
        Vec2::new(u as f32, if self == Self::Down { 1.0 - v } else { v } as f32)
    }
}

/// How a scene uses PLY files.
#[derive(Clone, Copy, Debug)]
pub struct PlyUse {
    pub v_direction: VDirection,
    /// Whether colors multiply the albedo. Other formats of scenes ignore them.
    pub has_colors: bool,
}

/// The mesh of a file, and warnings about what it lacks.
pub struct PlyFile {
    pub mesh: Mesh,
    /// Point to which all positions are relative: zero unless they are far from the origin.
    pub origin: DVec3,
    pub warnings: Vec<Warning>,
}

/// Names of the list of a face's vertices.
const INDICES: [&str; 2] = ["vertex_indices", "vertex_index"];

/// Minimum bytes of memory per triangle and per corner of a face with texture coordinates or
/// colors.
const TRIANGLE: usize = 12;
const CORNER: usize = 32;

/// A file while it is read.
struct Loader<'a> {
    content: Content<'a>,
    wanted: PlyUse,
    /// Point to which positions are relative.
    origin: DVec3,
    /// Box around all positions of the file.
    bounds: DBounds,
    mesh: Mesh,
    corners: Corners,
    cutter: Cutter,
    /// Whether any color was outside of [0, 1].
    is_clamped: bool,
    /// Whether any vertex is translucent.
    is_translucent: bool,
    /// Phrases about skipped content.
    skipped: Vec<String>,
}

/// Reads a mesh. Positions far from the origin are read relative to their center, in double
/// precision.
///
/// # Errors
/// Names the file and its problem, and the line of a text.
pub fn read(path: &Path, wanted: PlyUse) -> Result<PlyFile> {
    let (file, bounds) = read_relative(path, wanted, DVec3::ZERO)?;
    match bounds.far_center_of_part() {
        Some(center) => Ok(read_relative(path, wanted, center)?.0),
        None => Ok(file),
    }
}

/// Reads a mesh with positions relative to `origin`, and the box around all positions of the file.
fn read_relative(path: &Path, wanted: PlyUse, origin: DVec3) -> Result<(PlyFile, DBounds)> {
    let (content, header) = Content::open(path)?;
    let mut loader = Loader {
        content,
        wanted,
        origin,
        bounds: DBounds::EMPTY,
        mesh: Mesh::default(),
        corners: Corners::default(),
        cutter: Cutter::default(),
        is_clamped: false,
        is_translucent: false,
        skipped: Vec::new(),
    };
    for (name, element) in &header.elements {
        // Elements without properties take no bytes, so that the file does not limit their number.
        if element.properties.is_empty() && element.count > 0 {
            return Err(loader.content.broken(&format!("the element `{name}` has no properties")));
        }
        match &name[..] {
            "vertex" => loader.vertices(element)?,
            "face" => loader.faces(element)?,
            "tristrips" => loader.strips(element)?,
            _ => {
                if element.count > 0 {
                    loader.skipped.push(format!("ignored {} elements `{name}`", element.count));
                }
                loader.pass_over(element)?;
            }
        }
    }
    let pictures = header.comments.iter().filter_map(|text| text.strip_prefix("TextureFile"));
    let pictures: Vec<&str> = pictures.map(str::trim).collect();
    if !pictures.is_empty() {
        let text =
            "ignored the pictures of the comment `TextureFile`, which materials have to name:";
        loader.skipped.push(format!("{text} {}", list(pictures)));
    }
    let bounds = loader.bounds;
    Ok((loader.finish(path)?, bounds))
}

impl Loader<'_> {
    fn finish(mut self, path: &Path) -> Result<PlyFile> {
        let count = self.mesh.positions.len();
        let bad = self.mesh.triangles.as_flattened().iter().find(|i| **i as usize >= count);
        if let Some(bad) = bad {
            return Err(self.content.broken(&format!("a face uses vertex {bad} of {count}")));
        }
        let polygons = self.cutter.rough;
        for (is_met, phrase) in [
            (self.is_clamped, "clamped colors of vertices or faces to [0, 1]".to_owned()),
            (self.is_translucent, "ignored the opacity of vertices".to_owned()),
            (
                polygons > 0,
                format!(
                    "cut {polygons} faces of more than {} vertices that are not convex as if they were",
                    polygon::LARGEST
                ),
            ),
        ] {
            if is_met {
                self.skipped.push(phrase);
            }
        }
        let mut mesh = self.corners.split(self.mesh);
        // White is the color of a mesh without colors.
        if mesh.colors.iter().all(|color| *color == Rgb::ONE) {
            mesh.colors.clear();
        }
        let note = |phrase: String| Warning::skipped(format!("{}: {phrase}", path.display()));
        let warnings = self.skipped.into_iter().map(note).collect();
        Ok(PlyFile { mesh, origin: self.origin, warnings })
    }

    /// Adds a note about properties of `element` that have no effect. Numbers that say how a scan
    /// was made, and where faces belong, would not change the image.
    fn note_unused<'a>(&mut self, element: &str, unused: impl Iterator<Item = &'a str>) {
        const INVISIBLE: [&str; 12] = [
            "confidence",
            "intensity",
            "quality",
            "value",
            "curvature",
            "flags",
            "radius",
            "scalar",
            "class",
            "label",
            "group",
            "id",
        ];
        let is_visible = |name: &&str| {
            let own = name.to_ascii_lowercase();
            !INVISIBLE.iter().any(|known| own.contains(known))
        };
        let names: Vec<&str> = unused.filter(is_visible).collect();
        if !names.is_empty() {
            let phrase = format!("ignored the properties of the element `{element}`:");
            self.skipped.push(format!("{phrase} {}", list(names)));
        }
    }

    /// The next number of the item `index` of an element.
    fn number(&mut self, kind: &ply_rs_bw::ply::ScalarType, place: (&str, usize)) -> Result<f64> {
        match self.content.number(kind)? {
            Some(number) => Ok(number),
            None => Err(self.content.ends(place.0, place.1)),
        }
    }

    /// The length of a list.
    fn length(&mut self, kind: &ply_rs_bw::ply::ScalarType, place: (&str, usize)) -> Result<u64> {
        let length = self.number(kind, place)?;
        if length >= 0.0 && length.fract() == 0.0 {
            return Ok(length as u64);
        }
        Err(self.content.wrong(&format!("a list of item {} has the length {length}", place.1)))
    }

    /// Reads a list into `numbers`, in place of its content.
    fn list(
        &mut self,
        data: &PropertyType,
        place: (&str, usize),
        numbers: &mut Vec<f64>,
    ) -> Result<()> {
        numbers.clear();
        let (count, kind) = match data {
            PropertyType::List(length, kind) => (self.length(length, place)?, kind),
            PropertyType::Scalar(kind) => (1, kind),
        };
        for i in 0..count {
            // A short list takes no memory that counts.
            if i % 4096 == 4095 {
                self.content.store(4096 * size_of::<f64>())?;
            }
            numbers.push(self.number(kind, place)?);
        }
        Ok(())
    }

    /// Reads over an element.
    fn pass_over(&mut self, element: &ElementDef) -> Result<()> {
        let mut numbers = Vec::new();
        for index in 0..element.count {
            self.content.next_item(&element.name, index)?;
            for (_, property) in &element.properties {
                self.list(&property.data_type, (&element.name, index), &mut numbers)?;
            }
        }
        Ok(())
    }

    /// A vertex index of item `index`.
    fn vertex(&self, number: f64, index: usize) -> Result<u32> {
        if number.fract() == 0.0 && (0.0..f64::from(u32::MAX)).contains(&number) {
            return Ok(number as u32);
        }
        Err(self.content.wrong(&format!("face {index} has the vertex index {number}")))
    }

    /// Adds triangles and polygons, with texture coordinates and colors of their own if they have
    /// some.
    fn faces(&mut self, element: &ElementDef) -> Result<()> {
        let names = |name: &str| element.properties.contains_key(name);
        let colors = ColorChannels::find(names).filter(|_| self.wanted.has_colors);
        let colors = colors.map(|colors| colors.of(element));
        let indices = INDICES.into_iter().find(|name| names(name));
        let is_used = |name: &str| {
            Some(name) == indices
                || name == "texcoord"
                || name == "alpha"
                || ColorChannels::NAMES.as_flattened().contains(&name)
        };
        let unused = element.properties.iter().map(|(name, _)| &name[..]);
        // Several pictures need a number each; one picture has the number 0.
        self.note_unused("face", unused.filter(|name| !is_used(name) && *name != "texnumber"));
        let (mut corners, mut uvs, mut numbers) = (Vec::new(), Vec::new(), Vec::new());
        let mut has_pictures = false;
        for index in 0..element.count {
            let place = (&element.name[..], index);
            self.content.next_item(&element.name, index)?;
            let mut color = [1.0; 3];
            corners.clear();
            uvs.clear();
            for (name, property) in &element.properties {
                self.list(&property.data_type, place, &mut numbers)?;
                let kind = match &property.data_type {
                    PropertyType::Scalar(kind) | PropertyType::List(_, kind) => kind,
                };
                match &name[..] {
                    own if Some(own) == indices => std::mem::swap(&mut corners, &mut numbers),
                    "texcoord" => std::mem::swap(&mut uvs, &mut numbers),
                    "texnumber" => has_pictures |= numbers.iter().any(|number| *number > 0.0),
                    own => {
                        let channel = colors.and_then(|colors| colors.channel(own, kind));
                        if let (Some(Channel { axis, scale }), [code]) = (channel, &numbers[..]) {
                            color[axis] = code * scale;
                        }
                    }
                }
            }
            let mut vertices = Vec::with_capacity(corners.len());
            for number in &corners {
                vertices.push(self.vertex(*number, index)?);
            }
            let first = self.mesh.triangles.len();
            self.polygon(&vertices, index)?;
            let count = self.mesh.triangles.len() - first;
            if names("texcoord") {
                self.corner_uvs(&uvs, &vertices, first, index)?;
            }
            if let Some(channels) = colors {
                self.content.store(CORNER * count)?;
                let color = channels.decode(color, &mut self.is_clamped);
                self.corners.colors.extend(std::iter::repeat_n(color, count));
            }
        }
        if has_pictures {
            self.skipped.push("used one picture for all numbers `texnumber`".to_owned());
        }
        Ok(())
    }

    /// Adds the texture coordinates `uvs` of the corners of a face to its triangles, which begin at
    /// the index `first`.
    fn corner_uvs(
        &mut self,
        uvs: &[f64],
        vertices: &[u32],
        first: usize,
        face: usize,
    ) -> Result<()> {
        let triangles = &self.mesh.triangles[first..];
        self.content.store(CORNER * 3 * triangles.len())?;
        let (pairs, rest) = uvs.as_chunks::<2>();
        if !uvs.is_empty() && (pairs.len() != vertices.len() || !rest.is_empty()) {
            let (has, needs) = (uvs.len(), 2 * vertices.len());
            let problem = format!("face {face} has {has} of {needs} texture coordinates");
            return Err(self.content.wrong(&problem));
        }
        let uv = |vertex: u32| {
            let corner = vertices.iter().position(|own| *own == vertex);
            let pair = corner.and_then(|corner| pairs.get(corner)).copied();
            self.wanted.v_direction.upright(pair.unwrap_or_default())
        };
        self.corners.uvs.extend(triangles.iter().flat_map(|corners| corners.map(uv)));
        Ok(())
    }

    /// Cuts a polygon into triangles.
    fn polygon(&mut self, vertices: &[u32], index: usize) -> Result<()> {
        self.content.store(TRIANGLE * vertices.len())?;
        if let &[a, b, c] = vertices {
            self.mesh.triangles.push([a, b, c]);
        } else if vertices.len() > 3 {
            let positions = &self.mesh.positions;
            let count = positions.len();
            if let Some(bad) = vertices.iter().find(|vertex| **vertex as usize >= count) {
                let problem = format!("face {index} uses vertex {bad} of {count}");
                return Err(self.content.wrong(&problem));
            }
            let points = vertices.iter().map(|vertex| positions[*vertex as usize]);
            let triangles = &mut self.mesh.triangles;
            self.cutter.cut(points, |corners| triangles.push(corners.map(|i| vertices[i])));
        }
        Ok(())
    }

    /// Adds strips of triangles: each vertex makes one with the two before it, turned in turn, and
    /// -1 begins a new strip.
    fn strips(&mut self, element: &ElementDef) -> Result<()> {
        let mut numbers = Vec::new();
        for index in 0..element.count {
            self.content.next_item(&element.name, index)?;
            for (name, property) in &element.properties {
                self.list(&property.data_type, (&element.name, index), &mut numbers)?;
                if !INDICES.contains(&&name[..]) {
                    continue;
                }
                self.content.store(TRIANGLE * numbers.len())?;
                let mut strip: Vec<u32> = Vec::new();
                for number in &numbers {
                    if *number == -1.0 {
                        strip.clear();
                        continue;
                    }
                    strip.push(self.vertex(*number, index)?);
                    if let &[.., a, b, c] = &strip[..] {
                        let is_even = strip.len() % 2 == 1;
                        self.mesh.triangles.push(if is_even { [a, b, c] } else { [b, a, c] });
                    }
                }
            }
        }
        Ok(())
    }
}

/// The error for a mesh with too many vertices to number.
fn too_many(content: &Content<'_>) -> Error {
    content.broken(&format!("it has more than {} vertices", u32::MAX - 1))
}
