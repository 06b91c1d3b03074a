//! The graphics state: transform, material and other attributes of the shapes that follow.

use super::lights::AreaLight;
use super::materials::MaterialRef;
use super::params::{Attributes, Params};
use super::spectra::ColorSpace;
use super::tokens::Location;
use bdpm_core::base::error::{Error, Result};
use glam::{DAffine3, DMat3, DMat4, DVec3};
use std::collections::BTreeMap;
use std::rc::Rc;

/// Maximum number of parameters that `Attribute` adds to a target. Nested states may copy the list.
const MAX_ATTRIBUTES: usize = 256;

/// Attributes of the shapes and lights that follow.
#[derive(Clone)]
pub(super) struct GraphicsState {
    /// Current transform, from the space of objects to that of the world.
    pub transform: DAffine3,
    pub reverse_orientation: bool,
    pub material: MaterialRef,
    pub area_light: Option<Rc<AreaLight>>,
    pub color_space: ColorSpace,
    /// Names of the media inside and outside of shapes; empty for none.
    pub media: [String; 2],
    /// Transforms apply to the start of the shutter interval.
    pub changes_start: bool,
    /// Parameters that `Attribute` adds, by target: `shape`, `light`, `material`, `medium` or
    /// `texture`.
    pub attributes: BTreeMap<String, Attributes>,
}

impl GraphicsState {
    pub fn new() -> Self {
        Self {
            transform: DAffine3::IDENTITY,
            reverse_orientation: false,
            material: MaterialRef::Default,
            area_light: None,
            color_space: ColorSpace::Srgb,
            media: Default::default(),
            changes_start: true,
            attributes: BTreeMap::new(),
        }
    }

    /// Multiplies the current transform on the side of the objects.
    pub fn multiply(&mut self, map: DAffine3) {
        if self.changes_start {
            self.transform *= map;
        }
    }

    /// Replaces the current transform.
    pub fn set(&mut self, map: DAffine3) {
        if self.changes_start {
            self.transform = map;
        }
    }

    /// Parameters that `Attribute` adds to directives of a target.
    pub fn added(&self, target: &str) -> Attributes {
        self.attributes.get(target).cloned().unwrap_or_default()
    }

    /// Adds parameters of an `Attribute` directive.
    pub fn add(&mut self, target: &str, params: Params) -> Result<()> {
        let location = params.location.clone();
        let all = Rc::make_mut(self.attributes.entry(target.to_owned()).or_default());
        all.extend(params.into_all().into_iter().map(Rc::new));
        if all.len() > MAX_ATTRIBUTES {
            let problem = format!("Attribute adds more than {MAX_ATTRIBUTES} parameters");
            return Err(location.error(problem, "write them in the directives that use them"));
        }
        Ok(())
    }

    /// The current transform, if it is finite and has an inverse.
    pub fn invertible(&self, owner: &Params) -> Result<DAffine3> {
        check(self.transform).map_err(|(problem, advice)| owner.error(problem, advice))
    }
}

fn check(map: DAffine3) -> std::result::Result<DAffine3, (&'static str, &'static str)> {
    let determinant = map.matrix3.determinant();
    if map.is_finite() && determinant != 0.0 && determinant.is_finite() {
        return Ok(map);
    }
    Err(("the current transform has no inverse", "use scales other than 0, and smaller numbers"))
}

/// The map of `Transform` and `ConcatTransform`: 16 numbers, column by column.
pub(super) fn matrix(numbers: [f64; 16], location: &Location) -> Result<DAffine3> {
    let matrix = DMat4::from_cols_array(&numbers);
    let w = matrix.row(3);
    if w.truncate() == DVec3::ZERO && w.w != 0.0 {
        return Ok(DAffine3::from_mat4(matrix * w.w.recip()));
    }
    let problem = "the matrix is a projection";
    Err(location.error(problem, "give a matrix whose last row is 0 0 0 1"))
}

/// The map of `LookAt`, from the world to a camera that looks along +z with +x to the right.
pub(super) fn look_at(numbers: [f64; 9], location: &Location) -> Result<DAffine3> {
    let [position, target, up] = [0, 3, 6].map(|i| DVec3::from_slice(&numbers[i..i + 3]));
    let direction = (target - position).normalize_or_zero();
    let right = up.normalize_or_zero().cross(direction).normalize_or_zero();
    if right == DVec3::ZERO {
        let problem = "the direction and the up vector are parallel or zero";
        return Err(location.error(problem, "give another up vector"));
    }
    let matrix3 = DMat3::from_cols(right, direction.cross(right), direction);
    Ok(DAffine3 { matrix3, translation: position }.inverse())
}

/// The map of `Rotate`: degrees about an axis.
pub(super) fn rotation([degrees, x, y, z]: [f64; 4], location: &Location) -> Result<DAffine3> {
    let axis = DVec3::new(x, y, z).try_normalize();
    let axis = axis.ok_or_else(|| -> Error {
        location.error("the axis of the rotation is zero", "give another axis")
    })?;
    Ok(DAffine3::from_axis_angle(axis, degrees.to_radians()))
}
