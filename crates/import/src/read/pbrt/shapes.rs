//! Shapes as triangle meshes in their own space. Round meshes are scaled to the area of their shape
//! (`shape/round.rs`).

use super::params::Params;
use super::subdivision;
use super::textures::Textures;
use crate::read::ply::{self, PlyUse, VDirection};
use crate::shape::curves::{self, CurveBasis};
use crate::shape::round::{area, grid, steps};
use crate::text::check_memory;
use bdpm_core::base::error::{Error, Result};
use bdpm_core::base::memory::available_memory;
use bdpm_core::scene::Mesh;
use glam::{DVec3, DVec4, Vec2, Vec3};
use std::f32::consts::TAU;

/// The triangles of a shape, and the point to which its positions are relative; `None` if its type
/// is not supported. Texture coordinates have v up.
pub(super) fn mesh(
    params: &Params,
    is_lamp: bool,
    textures: &mut Textures,
) -> Result<Option<(Mesh, DVec3)>> {
    let around = steps(is_lamp);
    let at_origin = |mesh| (mesh, DVec3::ZERO);
    let (mut mesh, origin) = match &params.kind[..] {
        "sphere" => at_origin(sphere(params, around)?),
        "disk" => at_origin(disk(params, around)?),
        "cylinder" => at_origin(cylinder(params, around)?),
        "trianglemesh" => triangle_mesh(params)?,
        "bilinearmesh" => bilinear_mesh(params)?,
        "loopsubdiv" => subdivided(params)?,
        "plymesh" => ply_mesh(params, textures)?,
        "curve" => match curve(params)? {
            Some(mesh) => mesh,
            None => return Ok(None),
        },
        other => {
            let problem = format!("shapes of type `{other}` are unknown");
            let advice = "use sphere, disk, cylinder, trianglemesh, bilinearmesh, loopsubdiv, plymesh or curve";
            return Err(params.location.error(problem, advice));
        }
    };
    if let Some(vertex) = mesh.positions.iter().position(|point| !point.is_finite()) {
        return Err(params.error(format!("vertex {vertex} is not finite"), "correct the mesh"));
    }
    for uv in &mut mesh.uvs {
        *uv = if uv.is_finite() { *uv } else { Vec2::ZERO };
    }
    face_normals(&mut mesh);
    if mesh.name.is_empty() {
        mesh.name.clone_from(&params.kind);
    }
    Ok(Some((mesh, origin)))
}

/// A subdivision surface, and the point to which its positions are relative.
fn subdivided(params: &Params) -> Result<(Mesh, DVec3)> {
    let (positions, origin) = params.positions("P")?;
    let triangles = triangles(params, positions.len())?;
    let levels = params.float_in("levels", 3.0, [0.0, 8.0])? as u32;
    let _ = params.text("scheme")?;
    let made = subdivision::triangle_count(triangles.len(), levels);
    let needed = made as f64 * subdivision::TRIANGLE_BYTES;
    check_memory(needed, available_memory()).map_err(|problem| {
        let problem = format!("{levels} levels make {made} triangles, which take {problem}");
        params.error(problem, "lower `levels`")
    })?;
    if made > subdivision::MAX_TRIANGLES {
        let problem = format!("{levels} levels make {made} triangles");
        let most = subdivision::MAX_TRIANGLES;
        return Err(params.error(problem, format!("lower `levels`: at most {most} are made")));
    }
    let mesh = subdivision::limit_surface(&positions, &triangles, levels);
    let mesh =
        mesh.ok_or_else(|| params.error("an edge has more than two triangles", "repair the mesh"))?;
    Ok((mesh, origin))
}

/// The mesh of a PLY file, and the point to which its positions are relative.
fn ply_mesh(params: &Params, textures: &mut Textures) -> Result<(Mesh, DVec3)> {
    let Some(name) = params.text("filename")? else {
        return Err(params.error("the `filename` is missing", "add it"));
    };
    let path = textures.find(params, name)?;
    for part in ["displacement", "edgelength"] {
        if params.get(part).is_some() {
            textures.warnings.skipped("left out the displacement of", name);
        }
    }
    let wanted = PlyUse { v_direction: VDirection::Up, has_colors: false };
    let ply::PlyFile { mesh, origin, warnings } = ply::read(&path, wanted)?;
    textures.file_warnings.extend(warnings);
    let name = path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
    Ok((Mesh { name, ..mesh }, origin))
}

/// Turns triangles whose front is not on the side of their vertex normals.
fn face_normals(mesh: &mut Mesh) {
    let Mesh { positions, normals, triangles, .. } = mesh;
    if normals.is_empty() {
        return;
    }
    for corners in triangles {
        let [a, b, c] = corners.map(|i| positions[i as usize]);
        let mean: Vec3 = corners.iter().map(|i| normals[*i as usize]).sum();
        if (b - a).cross(c - a).dot(mean) < 0.0 {
            corners.swap(1, 2);
        }
    }
}

/// A curve as a tube; `None` if it has no width. Ribbons and flat curves, which turn to the viewer,
/// become tubes as well. Also returns the point to which its positions are relative.
fn curve(params: &Params) -> Result<Option<(Mesh, DVec3)>> {
    let degree = params.float_in("degree", 3.0, [2.0, 3.0])? as usize;
    let basis = match params.text("basis")? {
        None | Some("bezier") => CurveBasis::Bezier(degree),
        Some("bspline") => CurveBasis::BSpline(degree),
        Some(other) => {
            let problem = format!("`basis` is `{other}`");
            return Err(params.error(problem, "use bezier or bspline"));
        }
    };
    let (points, origin) = params.positions("P")?;
    let points: Vec<DVec4> = points.iter().map(|point| point.as_dvec3().extend(0.0)).collect();
    if basis.segments(points.len()).is_none() {
        let problem = format!("{} control points do not fit its basis", points.len());
        return Err(params.error(problem, "correct the list"));
    }
    let width = params.float_or("width", 1.0)?;
    let ends = [params.float_or("width0", width)?, params.float_or("width1", width)?];
    for part in ["type", "N", "splitdepth"] {
        let _ = params.get(part);
    }
    let mut mesh = Mesh::default();
    curves::add_tube(&mut mesh, &points, basis, |_, share| {
        0.5 * (ends[0] + (ends[1] - ends[0]) * share)
    });
    curves::remove_empty(&mut mesh);
    Ok((!mesh.triangles.is_empty()).then_some((mesh, origin)))
}

fn radius(params: &Params) -> Result<f32> {
    Ok(params.float_in("radius", 1.0, [1e-30, 1e30])? as f32)
}

/// Share of the full turn.
fn turn(params: &Params) -> Result<f32> {
    Ok(params.float_in("phimax", 360.0, [1e-3, 360.0])? as f32 / 360.0)
}

fn scaled_to(mesh: &mut Mesh, expected: f32, stretch: Vec3) {
    let scale = expected / area(mesh);
    let stretch = Vec3::ONE + stretch * (scale - 1.0);
    mesh.positions.iter_mut().for_each(|point| *point *= stretch);
}

fn sphere(params: &Params, around: u32) -> Result<Mesh> {
    let (radius, turn) = (radius(params)?, turn(params)?);
    let (low, high) = (
        params.float_or("zmin", -f64::from(radius))? as f32,
        params.float_or("zmax", f64::from(radius))? as f32,
    );
    let [low, high] = [low.min(high), low.max(high)].map(|z| z.clamp(-radius, radius));
    let [bottom, top] = [low, high].map(|z| (z / radius).clamp(-1.0, 1.0).acos());
    let mut mesh = grid(around, around / 2, |u, v| {
        let ((sin, cos), (across, z)) =
            ((TAU * turn * u).sin_cos(), (bottom + (top - bottom) * v).sin_cos());
        Vec3::new(across * cos, across * sin, z)
    });
    mesh.normals.clone_from(&mesh.positions);
    mesh.positions.iter_mut().for_each(|point| *point *= radius);
    upright(&mut mesh);
    // An isotropic scale by the root of the ratio of areas.
    let ratio = (TAU * turn * radius * (high - low) / area(&mesh)).sqrt();
    if ratio.is_finite() {
        mesh.positions.iter_mut().for_each(|point| *point *= ratio);
    }
    Ok(mesh)
}

fn disk(params: &Params, around: u32) -> Result<Mesh> {
    let (radius, turn) = (radius(params)?, turn(params)?);
    let height = params.float_in("height", 0.0, [-1e30, 1e30])? as f32;
    let inner = params.float_in("innerradius", 0.0, [0.0, f64::from(radius)])? as f32;
    let mut mesh = grid(around, 1, |u, v| {
        let (sin, cos) = (TAU * turn * u).sin_cos();
        let distance = radius + (inner - radius) * v;
        Vec3::new(distance * cos, distance * sin, 0.0)
    });
    mesh.normals = vec![Vec3::Z; mesh.positions.len()];
    upright(&mut mesh);
    let expected = 0.5 * TAU * turn * (radius * radius - inner * inner);
    let ratio = (expected / area(&mesh)).sqrt();
    if ratio.is_finite() {
        mesh.positions.iter_mut().for_each(|point| *point *= ratio);
    }
    mesh.positions.iter_mut().for_each(|point| point.z = height);
    Ok(mesh)
}

fn cylinder(params: &Params, around: u32) -> Result<Mesh> {
    let (radius, turn) = (radius(params)?, turn(params)?);
    let z = |name, default| Ok::<_, Error>(params.float_or(name, default)? as f32);
    let (low, high) = (z("zmin", -1.0)?, z("zmax", 1.0)?);
    let (low, high) = (low.min(high), low.max(high));
    let mut mesh = grid(around, 1, |u, v| {
        let (sin, cos) = (TAU * turn * u).sin_cos();
        Vec3::new(radius * cos, radius * sin, low + (high - low) * v)
    });
    mesh.normals =
        mesh.positions.iter().map(|point| point.with_z(0.0).normalize_or_zero()).collect();
    upright(&mut mesh);
    let expected = TAU * turn * radius * (high - low);
    scaled_to(&mut mesh, expected, Vec3::new(1.0, 1.0, 0.0));
    Ok(mesh)
}

/// Turns texture coordinates, which [`grid`] gives with v down.
fn upright(mesh: &mut Mesh) {
    mesh.uvs.iter_mut().for_each(|uv| uv.y = 1.0 - uv.y);
}

fn triangles(params: &Params, count: usize) -> Result<Vec<[u32; 3]>> {
    let indices = params.indices("indices", count)?;
    if indices.is_empty() && count == 3 {
        return Ok(vec![[0, 1, 2]]);
    }
    let (triangles, rest) = indices.as_chunks::<3>();
    if triangles.is_empty() || !rest.is_empty() {
        let problem = format!("it has {} vertex indices", indices.len());
        return Err(params.error(problem, "give three for each triangle"));
    }
    Ok(triangles.to_vec())
}

/// Positions, normals and texture coordinates of vertices, and the point to which the positions are
/// relative.
fn vertices(params: &Params) -> Result<(Mesh, DVec3)> {
    let (positions, origin) = params.positions("P")?;
    let normals: Vec<Vec3> =
        params.points("N")?.into_iter().map(|normal| normal.normalize_or_zero()).collect();
    let uvs = match params.points2("uv")? {
        own if own.is_empty() => params.points2("st")?,
        own => own,
    };
    let _ = (params.get("S"), params.get("faceIndices"));
    for (what, length) in [("N", normals.len()), ("uv", uvs.len())] {
        if length != 0 && length != positions.len() {
            let problem = format!("`{what}` has {length} items for {} points", positions.len());
            return Err(params.error(problem, "give one for each point"));
        }
    }
    Ok((Mesh { positions, normals, uvs, ..Mesh::default() }, origin))
}

fn triangle_mesh(params: &Params) -> Result<(Mesh, DVec3)> {
    let (mesh, origin) = vertices(params)?;
    let triangles = triangles(params, mesh.positions.len())?;
    let mut mesh = Mesh { triangles, ..mesh };
    if mesh.uvs.is_empty() {
        own_corners(&mut mesh, &[Vec2::ZERO, Vec2::X, Vec2::ONE]);
    }
    Ok((mesh, origin))
}

/// Gives each triangle vertices of its own with these texture coordinates, which pbrt takes for
/// meshes without. Large meshes stay without: pictures on them would show once per triangle.
fn own_corners(mesh: &mut Mesh, uvs: &[Vec2; 3]) {
    const MOST: usize = 64;
    if mesh.triangles.len() > MOST {
        return;
    }
    let corners: Vec<usize> = mesh.triangles.as_flattened().iter().map(|i| *i as usize).collect();
    mesh.positions = corners.iter().map(|i| mesh.positions[*i]).collect();
    if !mesh.normals.is_empty() {
        mesh.normals = corners.iter().map(|i| mesh.normals[*i]).collect();
    }
    mesh.uvs = uvs.iter().copied().cycle().take(corners.len()).collect();
    let count = mesh.triangles.len() as u32;
    mesh.triangles = (0..count).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect();
}

/// Two triangles for each patch.
fn bilinear_mesh(params: &Params) -> Result<(Mesh, DVec3)> {
    let (mut mesh, origin) = vertices(params)?;
    let count = mesh.positions.len();
    let mut indices = params.indices("indices", count)?;
    if indices.is_empty() && count == 4 {
        indices = vec![0, 1, 2, 3];
    }
    let _ = params.get("emissionfilename");
    let (patches, rest) = indices.as_chunks::<4>();
    if patches.is_empty() || !rest.is_empty() {
        let problem = format!("it has {} vertex indices", indices.len());
        return Err(params.error(problem, "give four for each patch"));
    }
    if mesh.uvs.is_empty() {
        let corners = patches.as_flattened();
        let source = std::mem::take(&mut mesh);
        mesh.positions = corners.iter().map(|i| source.positions[*i as usize]).collect();
        if !source.normals.is_empty() {
            mesh.normals = corners.iter().map(|i| source.normals[*i as usize]).collect();
        }
        let uvs = [Vec2::ZERO, Vec2::X, Vec2::Y, Vec2::ONE];
        mesh.uvs = uvs.into_iter().cycle().take(corners.len()).collect();
        let patches = 0..patches.len() as u32;
        mesh.triangles = patches
            .flat_map(|i| [[4 * i, 4 * i + 1, 4 * i + 3], [4 * i, 4 * i + 3, 4 * i + 2]])
            .collect();
    } else {
        mesh.triangles =
            patches.iter().flat_map(|[a, b, c, d]| [[*a, *b, *d], [*a, *d, *c]]).collect();
    }
    Ok((mesh, origin))
}
