//! Luminaires of a scene: their frame, and the point or the surface that they become.

use super::builder::Builder;
use super::shape::instancing::MaterialMesh;
use bdpm_core::base::error::{Error, Result};
use bdpm_core::base::math::Rgb;
use bdpm_core::scene::bsdf::Bsdf;
use bdpm_core::scene::transform::{MAX_COORDINATE, Transform};
use bdpm_core::scene::{
    AimedDistribution, Emitter, IntensityDistribution, LuminousOpening, Material, PointLuminaire,
};
use bdpm_light::photometry::OpeningShape;
use glam::{DMat3, DVec3, Vec3};
use std::sync::Arc;

/// A luminaire with its place in the scene.
pub struct PlacedLuminaire {
    pub name: String,
    pub distribution: Arc<IntensityDistribution>,
    pub opening: OpeningShape,
    /// Unit vectors along C0, C90 and up.
    pub axes: DMat3,
    /// Photometric center, scene units.
    pub position: Vec3,
    /// Radiant intensity per candela, W/(sr cd).
    pub factor: Rgb,
    /// True if camera rays pass the opening.
    pub is_hidden: bool,
}

/// Axes of a luminaire: its nadir points along `direction`, by default -y, and C0 toward `c0`, by
/// default +x. The turn is about the axis upward, degrees.
///
/// # Errors
/// If the vectors are parallel or have no length.
pub fn frame(direction: Option<DVec3>, c0: Option<DVec3>, turn_deg: f64) -> Result<DMat3> {
    let down = direction.unwrap_or(DVec3::NEG_Y).normalize_or_zero();
    if down == DVec3::ZERO {
        let advice = "give a vector along which it shines, such as [0, -1, 0]";
        return Err(Error::new("the direction of the luminaire has no length", advice));
    }
    if !turn_deg.is_finite() {
        let problem = format!("`turn_deg` is {turn_deg}");
        return Err(Error::new(problem, "give a number of degrees"));
    }
    let across = |v: DVec3| (v - v.dot(down) * down).normalize_or_zero();
    let x = match c0 {
        Some(c0) => across(c0.normalize_or_zero()),
        // A luminaire that shines along x has C0 toward z.
        None if down.x.abs() > 0.999 => across(DVec3::Z),
        None => across(DVec3::X),
    };
    if x == DVec3::ZERO {
        let advice = "give a vector across the direction, in which C0 is";
        return Err(Error::new("`c0` has no length, or is along the direction", advice));
    }
    let up = -down;
    let (sin, cos) = turn_deg.to_radians().sin_cos();
    let y = up.cross(x);
    Ok(DMat3::from_cols(cos * x + sin * y, cos * y - sin * x, up))
}

impl Builder {
    /// Adds a luminaire: the surface of its opening to the meshes, or a point, which is returned.
    ///
    /// # Errors
    /// If it is outside of the range of coordinates. The error names no file.
    pub fn add_luminaire(&mut self, luminaire: PlacedLuminaire) -> Result<Option<Emitter>> {
        let PlacedLuminaire { name, distribution, opening, axes, position, factor, is_hidden } =
            luminaire;
        if position.abs().max_element() > MAX_COORDINATE {
            let problem = format!("the position of the luminaire is beyond {MAX_COORDINATE:e}");
            return Err(Error::new(problem, "scale the scene down"));
        }
        let aimed = AimedDistribution::new(distribution, axes, factor);
        let Some((mut mesh, is_flat)) = opening.surface(axes, position.as_dvec3()) else {
            return Ok(Some(Emitter::Luminaire(Box::new(PointLuminaire { position, aimed }))));
        };
        mesh.name.clone_from(&name);
        let opening = LuminousOpening::new(aimed, &mesh, is_flat);
        let black = Material::new(&name, Bsdf::diffuse(Rgb::ZERO));
        let luminous_opening = Some(Arc::new(opening));
        let hidden_from_camera = is_hidden;
        let material =
            self.add_material(Material { luminous_opening, hidden_from_camera, ..black });
        let part = MaterialMesh::new(Arc::new(mesh), material);
        self.place(Some(&name), &[part], &Transform::IDENTITY).ok_or_else(|| {
            let problem = "the luminaire is outside of the range of coordinates";
            Error::new(problem, "scale the scene down")
        })?;
        Ok(None)
    }
}
