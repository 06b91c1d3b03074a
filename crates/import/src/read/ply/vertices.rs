//! Vertices of PLY files, and the color space of their colors.

use super::{Loader, too_many};
use crate::srgb;
use bdpm_core::base::error::Result;
use bdpm_core::base::math::Rgb;
use glam::{DVec3, Vec3};
use ply_rs_bw::ply::{ElementDef, PropertyType, ScalarType};

/// A property's component of a color, and the factor that maps its codes to [0, 1].
#[derive(Clone, Copy, Debug)]
pub(super) struct Channel {
    pub axis: usize,
    pub scale: f64,
}

/// The properties that hold colors. Integers are sRGB codes, which most programs write and Blender
/// expects. Floats are linear, as in Mitsuba.
#[derive(Clone, Copy, Debug)]
pub(super) struct ColorChannels {
    names: [&'static str; 3],
    /// Whether the properties are integers.
    is_srgb: bool,
}

impl ColorChannels {
    /// Names of properties, the first of which count.
    pub const NAMES: [[&'static str; 3]; 3] = [
        ["red", "green", "blue"],
        ["r", "g", "b"],
        ["diffuse_red", "diffuse_green", "diffuse_blue"],
    ];

    /// The color of an element with these properties.
    pub fn find(has: impl Fn(&str) -> bool) -> Option<Self> {
        let names = Self::NAMES.into_iter().find(|names| names.iter().any(|name| has(name)))?;
        Some(Self { names, is_srgb: false })
    }

    /// The channel of a property.
    pub fn channel(self, name: &str, kind: &ScalarType) -> Option<Channel> {
        let axis = self.names.iter().position(|own| *own == name)?;
        Some(Channel { axis, scale: scale(kind) })
    }

    /// Whether codes of an element are sRGB.
    pub fn of(self, element: &ElementDef) -> Self {
        let is_integer = |name: &&str| {
            let property = element.properties.get(*name).map(|property| &property.data_type);
            matches!(property, Some(PropertyType::Scalar(kind)) if !is_float(kind))
        };
        Self { is_srgb: self.names.iter().any(is_integer), ..self }
    }

    /// The linear color of codes in [0, 1]. Others are clamped.
    pub fn decode(self, codes: [f64; 3], is_clamped: &mut bool) -> Rgb {
        *is_clamped |= codes.iter().any(|code| !(0.0..=1.0).contains(code));
        if self.is_srgb {
            return srgb::decode(codes);
        }
        let share = |code: f64| if code.is_nan() { 0.0 } else { code.clamp(0.0, 1.0) };
        Rgb::from_array(codes.map(|code| share(code) as f32))
    }
}

fn is_float(kind: &ScalarType) -> bool {
    matches!(kind, ScalarType::Float | ScalarType::Double)
}

/// The factor that maps codes to [0, 1]. Programs that write wider integers still count to 255,
/// except for colors of 16 bits.
fn scale(kind: &ScalarType) -> f64 {
    match kind {
        ScalarType::Float | ScalarType::Double => 1.0,
        ScalarType::UShort => 1.0 / 65_535.0,
        _ => 1.0 / 255.0,
    }
}

/// Part of a vertex that a property sets.
#[derive(Clone, Copy)]
enum Slot {
    Position(usize),
    Normal(usize),
    Uv(usize),
    Color(Channel),
    /// Opacity, with the factor that maps it to [0, 1].
    Alpha(f64),
    Unused,
}

fn slot(name: &str, data: &PropertyType, colors: Option<ColorChannels>) -> Slot {
    let PropertyType::Scalar(kind) = data else { return Slot::Unused };
    match name {
        "x" => Slot::Position(0),
        "y" => Slot::Position(1),
        "z" => Slot::Position(2),
        "nx" => Slot::Normal(0),
        "ny" => Slot::Normal(1),
        "nz" => Slot::Normal(2),
        "u" | "s" | "texture_u" | "texture_s" => Slot::Uv(0),
        "v" | "t" | "texture_v" | "texture_t" => Slot::Uv(1),
        "alpha" | "a" | "diffuse_alpha" => Slot::Alpha(scale(kind)),
        _ => colors.and_then(|own| own.channel(name, kind)).map_or(Slot::Unused, Slot::Color),
    }
}

/// Bytes of memory per vertex with all attributes.
const VERTEX: usize = 44;

impl Loader<'_> {
    /// Adds vertices with the attributes that the element has.
    pub(super) fn vertices(&mut self, element: &ElementDef) -> Result<()> {
        let has = |name: &str| element.properties.contains_key(name);
        if let Some(missing) = ["x", "y", "z"].into_iter().find(|name| !has(name)) {
            return Err(self.content.broken(&format!("its vertices have no `{missing}`")));
        }
        if self.mesh.positions.len().saturating_add(element.count) >= u32::MAX as usize {
            return Err(too_many(&self.content));
        }
        let colors = ColorChannels::find(has).map(|colors| colors.of(element));
        let properties = element.properties.iter();
        let slots: Vec<_> = properties
            .map(|(name, property)| {
                (name, slot(name, &property.data_type, colors), &property.data_type)
            })
            .collect();
        let unused = slots.iter().filter(|(_, slot, _)| matches!(slot, Slot::Unused));
        self.note_unused("vertex", unused.map(|(name, ..)| &name[..]));
        let has_slot = |wanted: fn(&Slot) -> bool| slots.iter().any(|(_, slot, _)| wanted(slot));
        let has_normals = has_slot(|slot| matches!(slot, Slot::Normal(_)));
        let has_uvs = has_slot(|slot| matches!(slot, Slot::Uv(_)));
        let colors = colors.filter(|_| self.wanted.has_colors);
        let mut list = Vec::new();
        for index in 0..element.count {
            let place = (&element.name[..], index);
            self.content.next_item(&element.name, index)?;
            self.content.store(VERTEX)?;
            let (mut position, mut normal, mut uv, mut color) =
                ([0.0; 3], [0.0; 3], [0.0; 2], [0.0; 3]);
            for (_, slot, data) in &slots {
                let PropertyType::Scalar(kind) = data else {
                    self.list(data, place, &mut list)?;
                    continue;
                };
                let value = self.number(kind, place)?;
                match *slot {
                    Slot::Position(axis) => position[axis] = value,
                    Slot::Normal(axis) => normal[axis] = value,
                    Slot::Uv(axis) => uv[axis] = value,
                    Slot::Color(Channel { axis, scale }) => color[axis] = value * scale,
                    Slot::Alpha(scale) => self.is_translucent |= value * scale < 1.0,
                    Slot::Unused => {}
                }
            }
            let vector = |numbers: [f64; 3]| Vec3::from_array(numbers.map(|x| x as f32));
            let position = DVec3::from_array(position);
            self.bounds = self.bounds.with(position);
            self.mesh.positions.push((position - self.origin).as_vec3());
            if has_normals {
                self.mesh.normals.push(vector(normal).normalize_or_zero());
            }
            if has_uvs {
                self.mesh.uvs.push(self.wanted.v_direction.upright(uv));
            }
            if let Some(channels) = colors {
                self.mesh.colors.push(channels.decode(color, &mut self.is_clamped));
            }
        }
        Ok(())
    }
}
