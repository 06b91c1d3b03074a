//! Scenes: from files, or from arrays.

use crate::arrays::{rows, triangles};
use crate::error::raised;
use crate::tables;
use bdpm::import::EnvironmentSource;
use bdpm::load::{CameraChange, LoadOptions, Loaded, LookAt, NamedMesh, load_meshes, load_with};
use bytemuck::allocation::cast_vec;
use glam::{DVec3, Vec2, Vec3};
use pyo3::exceptions::PyTypeError;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use std::path::PathBuf;
use std::sync::Arc;
use toml::{Table, Value};

/// A triangle mesh.
///
/// - `vertices`: positions, scene units, shape (n, 3).
/// - `triangles`: indices of vertices, integers of shape (m, 3), counterclockwise seen from the
///   front.
/// - `material`: the name of a material of the scene, or a dictionary with the keys of a
///   `[materials.NAME]` table.
/// - `normals`: normals to interpolate, shape (n, 3); without them the triangles are flat.
/// - `uvs`: texture coordinates, shape (n, 2); `v` points up in the picture.
/// - `colors`: factors of the albedo, linear and from 0 to 1, shape (n, 3).
/// - `name`: name in error messages.
#[pyclass(frozen, module = "bdpm")]
pub struct Mesh {
    mesh: Arc<bdpm::scene::Mesh>,
    material: MeshMaterial,
}

enum MeshMaterial {
    Name(String),
    Table(Table),
}

#[pymethods]
impl Mesh {
    #[new]
    #[pyo3(signature = (
        vertices, triangles, material, *, normals=None, uvs=None, colors=None, name="mesh"
    ))]
    fn new(
        vertices: &Bound<'_, PyAny>,
        triangles: &Bound<'_, PyAny>,
        material: &Bound<'_, PyAny>,
        normals: Option<&Bound<'_, PyAny>>,
        uvs: Option<&Bound<'_, PyAny>>,
        colors: Option<&Bound<'_, PyAny>>,
        name: &str,
    ) -> PyResult<Self> {
        let vectors = |array: Option<&Bound<'_, PyAny>>, what| -> PyResult<Vec<Vec3>> {
            let rows = array.map(|array| rows::<3>(array, what)).transpose()?;
            Ok(cast_vec(rows.unwrap_or_default()))
        };
        let uvs = uvs.map(|uvs| rows::<2>(uvs, "uvs")).transpose()?.unwrap_or_default();
        // Unit normals, as the library expects them; those of length zero stay.
        let mut normals = vectors(normals, "normals")?;
        normals.iter_mut().for_each(|normal| *normal = normal.normalize_or_zero());
        let mesh = bdpm::scene::Mesh {
            name: name.to_owned(),
            positions: vectors(Some(vertices), "vertices")?,
            normals,
            uvs: cast_vec::<[f32; 2], Vec2>(uvs),
            colors: vectors(colors, "colors")?,
            triangles: self::triangles(triangles)?,
            ..bdpm::scene::Mesh::default()
        };
        let material = match material.extract::<String>() {
            Ok(name) => MeshMaterial::Name(name),
            Err(_) => MeshMaterial::Table(tables::table(material).map_err(|_| {
                PyTypeError::new_err("material is neither the name of a material nor a dictionary")
            })?),
        };
        Ok(Self { mesh: Arc::new(mesh), material })
    }

    fn __repr__(&self) -> String {
        let bdpm::scene::Mesh { name, positions, triangles, .. } = &*self.mesh;
        format!("<Mesh {name}: {} vertices, {} triangles>", positions.len(), triangles.len())
    }
}

/// A scene: meshes, materials, lights and a camera. `bdpm.load` and `Scene.from_meshes` make
/// scenes.
#[pyclass(frozen, module = "bdpm")]
pub struct Scene {
    pub loaded: Loaded,
}

#[pymethods]
impl Scene {
    /// Builds a scene from arrays.
    ///
    /// - `meshes`: a list of `Mesh`.
    /// - `camera`: the keys of a `[camera]` table, such as dict(position=(0, 1, 4), target=(0, 0,
    ///   0), fov_y_deg=40).
    /// - `lights`: a list of `[[light]]` tables, such as dict(type="point", position=(0, 3, 0),
    ///   intensity=20).
    /// - `environment`: an `[environment]` table; or `sky`: a `[sky]` table.
    /// - `materials`: `[materials.NAME]` tables by name.
    /// - `media`: `[media.NAME]` tables by name, and `medium`: the name of the one between all
    ///   objects.
    /// - `meters`: a list of `[[meter]]` tables, which `bdpm.measure` measures.
    /// - `regions`: lists of rectangles (x0, y0, x1, y1) in fractions of the image, by name.
    /// - `render`: a `[render]` table: defaults of the settings.
    /// - `folder`: the folder of textures [default: the current one].
    ///
    /// docs/reference/scene-format.md describes the keys and units of all tables.
    ///
    /// Raises bdpm.Error if a key is unknown, a value is wrong, or a mesh is not valid.
    #[staticmethod]
    #[pyo3(signature = (
        meshes, *, camera, lights=None, environment=None, sky=None, materials=None, media=None,
        medium=None, meters=None, regions=None, render=None, folder=None, name="scene"
    ))]
    #[expect(clippy::too_many_arguments, reason = "keyword arguments")]
    fn from_meshes(
        py: Python<'_>,
        meshes: Vec<PyRef<'_, Mesh>>,
        camera: &Bound<'_, PyDict>,
        lights: Option<Vec<Bound<'_, PyDict>>>,
        environment: Option<&Bound<'_, PyDict>>,
        sky: Option<&Bound<'_, PyDict>>,
        materials: Option<&Bound<'_, PyDict>>,
        media: Option<&Bound<'_, PyDict>>,
        medium: Option<String>,
        meters: Option<Vec<Bound<'_, PyDict>>>,
        regions: Option<&Bound<'_, PyDict>>,
        render: Option<&Bound<'_, PyDict>>,
        folder: Option<PathBuf>,
        name: &str,
    ) -> PyResult<Self> {
        let mut file = Table::new();
        for (key, table) in [
            ("camera", Some(camera)),
            ("environment", environment),
            ("sky", sky),
            ("media", media),
            ("regions", regions),
            ("render", render),
        ] {
            if let Some(table) = table {
                file.insert(key.into(), Value::Table(tables::table(table)?));
            }
        }
        file.extend(medium.map(|name| ("medium".into(), Value::String(name))));
        for (key, list) in [("light", lights), ("meter", meters)] {
            let all = list.iter().flatten().map(|own| Ok(Value::Table(tables::table(own)?)));
            file.insert(key.into(), Value::Array(all.collect::<PyResult<_>>()?));
        }
        let mut materials =
            materials.map(|table| tables::table(table)).transpose()?.unwrap_or_default();
        let mut named = Vec::new();
        for (index, mesh) in meshes.iter().enumerate() {
            let material = match &mesh.material {
                MeshMaterial::Name(name) => name.clone(),
                MeshMaterial::Table(table) => {
                    let name = format!("{} {index}", mesh.mesh.name);
                    materials.insert(name.clone(), Value::Table(table.clone()));
                    name
                }
            };
            named.push(NamedMesh { mesh: Arc::clone(&mesh.mesh), material });
        }
        file.insert("materials".into(), Value::Table(materials));
        let (text, path) = (tables::text(&file), folder.unwrap_or_default().join(name));
        drop(meshes);
        let loaded = py.detach(|| load_meshes(&path, &text, &named, &LoadOptions::default()));
        Ok(Self { loaded: loaded.map_err(raised)? })
    }

    /// Name of the scene.
    #[getter]
    fn name(&self) -> &str {
        &self.loaded.scene.name
    }

    /// Point of the file's coordinates that is the origin of the scene: zero, except for scenes
    /// that are far from the origin of their file.
    #[getter]
    fn origin(&self) -> [f64; 3] {
        self.loaded.scene.file_origin().to_array()
    }

    /// Number of triangles that have an area.
    #[getter]
    fn triangles(&self) -> usize {
        self.loaded.summary.triangles
    }

    /// Names of the regions of the image.
    #[getter]
    fn regions(&self) -> Vec<String> {
        self.loaded.scene.regions.iter().map(|region| region.name.clone()).collect()
    }

    /// Settings of the scene file, as a dictionary. They are defaults of a render that chooses
    /// nothing.
    #[getter]
    fn settings<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        tables::object(py, &self.loaded.defaults)
    }

    /// Sentences about parts that were skipped, approximated or chosen when the scene was loaded.
    #[getter]
    fn warnings(&self) -> Vec<String> {
        self.loaded.warnings.iter().map(ToString::to_string).collect()
    }

    fn __repr__(&self) -> String {
        format!("<Scene {}: {}>", self.loaded.scene.name, self.loaded.summary)
    }
}

/// Loads a scene file (.toml, .gltf, .glb, .obj, .xml of Mitsuba or .pbrt of pbrt-v4), or a folder
/// with scene.toml.
///
/// - `camera`: name of a camera of a glTF or Mitsuba file; the first one by default.
/// - `strict`: refuse a scene if a part of it would be skipped.
/// - `environment`: an .exr or .hdr file, or a radiance in W/(m^2 sr), in place of the environment
///   of the file; or `sky`: the keys of a `[sky]` table, such as dict(model="cie", cie_type=1,
///   diffuse_lx=10000).
/// - `fallback_light`: add a light to a glTF or OBJ file that has none.
/// - `camera_from`: a scene whose camera replaces the scene's own.
/// - `look_at`: moves the camera: position, target and optionally up vector, such as ((0, 1, 5),
///   (0, 1, 0)).
/// - `fov`: full opening angle of the camera in degrees, across the side to which its own angle
///   refers.
/// - `lights`: names of the only light sources that shine; `*` stands for any characters.
///
/// Raises bdpm.Error with the file and the line that cannot be read.
#[pyfunction]
#[pyo3(signature = (
    path, *, camera=None, strict=false, environment=None, sky=None, fallback_light=true, camera_from=None,
    look_at=None, fov=None, lights=None
))]
#[expect(clippy::too_many_arguments, reason = "keyword arguments")]
pub fn load(
    py: Python<'_>,
    path: PathBuf,
    camera: Option<&str>,
    strict: bool,
    environment: Option<&Bound<'_, PyAny>>,
    sky: Option<&Bound<'_, PyDict>>,
    fallback_light: bool,
    camera_from: Option<PathBuf>,
    look_at: Option<Vec<[f64; 3]>>,
    fov: Option<f32>,
    lights: Option<Vec<String>>,
) -> PyResult<Scene> {
    let look_at = look_at.map(|vectors| match vectors[..] {
        [position, target] => Ok(LookAt::new(position.into(), target.into(), None)),
        [position, target, up] => {
            Ok(LookAt::new(position.into(), target.into(), Some(DVec3::from(up).as_vec3())))
        }
        _ => Err(PyTypeError::new_err(
            "look_at is not a position, a target and optionally an up vector",
        )),
    });
    let look_at = look_at.transpose()?;
    let environment = match (environment, sky) {
        (Some(_), Some(_)) => {
            return Err(PyTypeError::new_err("give an environment or a sky, not both"));
        }
        (Some(environment), None) => Some(environment.str()?.to_str()?.parse().map_err(raised)?),
        (None, Some(sky)) => {
            // The keys of a table without tables are lines.
            let keys = tables::text(&tables::table(sky)?).trim().replace('\n', ", ");
            Some(EnvironmentSource::sky(&keys).map_err(raised)?)
        }
        (None, None) => None,
    };
    let loaded = py.detach(|| {
        let (environment, no_fallback_light) = (environment.as_ref(), !fallback_light);
        let camera_change = CameraChange { from: camera_from.as_deref(), look_at, fov };
        let options = LoadOptions {
            camera,
            strict,
            environment,
            no_fallback_light,
            camera_change,
            lights: lights.as_deref(),
        };
        load_with(&path, &options)
    });
    Ok(Scene { loaded: loaded.map_err(raised)? })
}
