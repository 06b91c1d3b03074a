//! Validation of the parts of a scene.

use super::{Arrangement, Material, Mesh, Placement, triangle_area};
use crate::base::error::{Error, Result};
use crate::base::math::Rgb;

/// Refuses parts that do not make a scene.
///
/// # Errors
/// Names the mesh and the rule that it breaks.
pub(super) fn check(arrangement: &Arrangement, materials: &[Material]) -> Result<()> {
    let Arrangement { meshes, placements } = arrangement;
    meshes.iter().try_for_each(check_mesh)?;
    let count: usize = meshes.iter().map(|mesh| mesh.triangles.len()).sum();
    // The last two indices have special meanings.
    if count >= u32::MAX as usize - 1 {
        let problem = format!("{count} triangles are more than 32 bits can number");
        return Err(Error::new(problem, "simplify some meshes"));
    }
    for (index, Placement { mesh, material, .. }) in placements.iter().enumerate() {
        for (what, index_of, count) in
            [("mesh", *mesh, meshes.len()), ("material", *material, materials.len())]
        {
            if index_of as usize >= count {
                let problem = format!("placement {index} is of {what} {index_of}, of {count}");
                return Err(Error::new(problem, format!("give the index of a {what}")));
            }
        }
        if materials[*material as usize].emission != Rgb::ZERO {
            let mesh = &meshes[*mesh as usize];
            check_emitter(mesh).map_err(|problem| refused(mesh, problem))?;
        }
    }
    Ok(())
}

/// Refuses a mesh that is not valid by itself.
///
/// # Errors
/// Names the mesh and the rule that it breaks.
pub fn check_mesh(mesh: &Mesh) -> Result<()> {
    problem_of(mesh).map_err(|problem| refused(mesh, problem))
}

fn refused(mesh: &Mesh, problem: String) -> Error {
    let problem = format!("the mesh `{}` cannot be used: {problem}", mesh.name);
    Error::new(problem, "mend the mesh, or leave it out")
}

fn problem_of(mesh: &Mesh) -> std::result::Result<(), String> {
    // The backends check the range of coordinates.
    if let Some(vertex) = mesh.positions.iter().position(|position| !position.is_finite()) {
        return Err(format!("vertex {vertex} is not finite"));
    }
    let positions = mesh.positions.len();
    for (triangle, corners) in mesh.triangles.iter().enumerate() {
        if let Some(index) = corners.iter().find(|&&index| index as usize >= positions) {
            return Err(format!("triangle {triangle} uses vertex {index} of {positions}"));
        }
    }
    for (what, count) in [
        ("normals", mesh.normals.len()),
        ("texture coordinates", mesh.uvs.len()),
        ("tangents", mesh.tangents.len()),
        ("colors", mesh.colors.len()),
    ] {
        if count != 0 && count != positions {
            return Err(format!("it has {count} {what} for {positions} positions"));
        }
    }
    // Written so that NaN fails.
    let is_share = |color: &Rgb| color.min_element() >= 0.0 && color.max_element() <= 1.0;
    if let Some(vertex) = mesh.colors.iter().position(|color| !is_share(color)) {
        return Err(format!("the color of vertex {vertex} is not between 0 and 1"));
    }
    Ok(())
}

/// Triangles without area are never hit, but would be chosen to emit from.
fn check_emitter(mesh: &Mesh) -> std::result::Result<(), String> {
    let is_degenerate = |corners: &[u32; 3]| {
        triangle_area(corners.map(|index| mesh.positions[index as usize])) == 0.0
    };
    match mesh.triangles.iter().position(is_degenerate) {
        Some(triangle) => Err(format!("triangle {triangle} emits and has no area")),
        None => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::bsdf::Bsdf;
    use glam::{Vec2, Vec3};

    fn mesh() -> Mesh {
        Mesh {
            name: "one".into(),
            positions: vec![Vec3::ZERO, Vec3::X, Vec3::Y],
            triangles: vec![[0, 1, 2]],
            ..Mesh::default()
        }
    }

    fn checked(change: impl FnOnce(&mut Arrangement)) -> std::result::Result<(), String> {
        let mut arrangement = Arrangement::from(vec![mesh()]);
        change(&mut arrangement);
        let material =
            Material { emission: Vec3::ONE, ..Material::new("white", Bsdf::diffuse(Vec3::ONE)) };
        check(&arrangement, &[material]).map_err(|error| error.to_string())
    }

    #[test]
    fn errors_name_the_broken_rule() {
        checked(|_| {}).unwrap();
        let refused = |change: fn(&mut Arrangement), part: &str| {
            let shown = checked(change).unwrap_err();
            assert!(shown.contains(part), "{shown}");
        };
        refused(
            |a| a.meshes[0].triangles[0][1] = 3,
            "`one` cannot be used: triangle 0 uses vertex 3",
        );
        refused(|a| a.meshes[0].positions[2].x = f32::NAN, "vertex 2 is not finite");
        refused(|a| a.meshes[0].positions[2] = 2.0 * Vec3::X, "triangle 0 emits and has no area");
        refused(|a| a.meshes[0].normals = vec![Vec3::Z; 2], "2 normals for 3 positions");
        refused(|a| a.meshes[0].uvs = vec![Vec2::ZERO; 4], "4 texture coordinates");
        refused(|a| a.meshes[0].tangents = vec![Vec3::X], "1 tangents");
        refused(|a| a.meshes[0].colors = vec![Vec3::ONE], "1 colors");
        refused(
            |a| a.meshes[0].colors = vec![Vec3::ONE, 1.5 * Vec3::ONE, Vec3::ONE],
            "the color of vertex 1 is not between 0 and 1",
        );
        refused(|a| a.placements[0].mesh = 1, "placement 0 is of mesh 1, of 1");
        refused(|a| a.placements[0].material = 7, "placement 0 is of material 7, of 1");
    }
}
