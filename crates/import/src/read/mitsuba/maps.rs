//! Transforms: each step is applied after the previous ones.

use super::object::Object;
use bdpm_core::base::error::Result;
use glam::{DAffine3, DMat3, DMat4, DQuat, DVec3, DVec4};

/// The map of a `<transform>`.
pub(super) fn read(transform: &Object) -> Result<DAffine3> {
    let mut map = DAffine3::IDENTITY;
    for child in &transform.element().children {
        let step = step(&Object::new(transform.document, *child))?;
        map = step * map;
    }
    if map.is_finite() {
        return Ok(map);
    }
    Err(transform.error("its numbers are too large", "use smaller ones"))
}

fn step(step: &Object) -> Result<DAffine3> {
    match &step.element().tag[..] {
        "translate" => Ok(DAffine3::from_translation(step.vector(0.0)?)),
        "scale" => Ok(DAffine3::from_scale(step.vector(1.0)?)),
        "rotate" => {
            let axis = step.vector(0.0)?.try_normalize();
            let axis = axis.ok_or_else(|| step.error("its axis is zero", "give x, y or z"))?;
            let degrees = step.parse(step.attribute("angle")?)?;
            Ok(DAffine3::from_quat(DQuat::from_axis_angle(axis, degrees.to_radians())))
        }
        "lookat" => lookat(step),
        "matrix" => matrix(step),
        _ => {
            let advice = "use translate, rotate, scale, lookat or matrix";
            Err(step.error("this step of a transform is unknown", advice))
        }
    }
}

fn lookat(step: &Object) -> Result<DAffine3> {
    let point = |name| match step.parse_list(step.attribute(name)?)?[..] {
        [x, y, z] => Ok(DVec3::new(x, y, z)),
        _ => Err(step.error(format!("`{name}` does not have three numbers"), "give three")),
    };
    let (origin, target) = (point("origin")?, point("target")?);
    let forward = (target - origin).normalize_or_zero();
    let up = match step.element().attribute("up") {
        Some(_) => point("up")?,
        None => forward.any_orthonormal_vector(),
    };
    let left = up.cross(forward).normalize_or_zero();
    if left == DVec3::ZERO {
        let problem = "the target is the origin, or the up vector is along the line of sight";
        return Err(step.error(problem, "give another target or up vector"));
    }
    let matrix = DMat3::from_cols(left, forward.cross(left), forward);
    Ok(DAffine3 { matrix3: matrix, translation: origin })
}

/// Row by row, of 16 numbers, or of 9 without translation.
fn matrix(step: &Object) -> Result<DAffine3> {
    let numbers = step.numbers()?;
    if let Ok(numbers) = <[f64; 9]>::try_from(&numbers[..]) {
        return Ok(DAffine3::from_mat3(DMat3::from_cols_array(&numbers).transpose()));
    }
    let Ok(numbers) = <[f64; 16]>::try_from(&numbers[..]) else {
        return Err(step.error("it has neither 16 nor 9 numbers", "give 16, row by row"));
    };
    let matrix = DMat4::from_cols_array(&numbers).transpose();
    if matrix.row(3) != DVec4::W {
        return Err(step.error("its last row is not 0 0 0 1", "give an affine matrix"));
    }
    Ok(DAffine3::from_mat4(matrix))
}
