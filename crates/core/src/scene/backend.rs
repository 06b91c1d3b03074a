//! The choice of an intersection backend at run time.

use super::Scene;
use super::alpha_mask::AlphaMasks;
use crate::accel::Intersect;
use crate::accel::bvh::{Bvh, BvhError};
#[cfg(feature = "embree")]
use crate::accel::embree::EmbreeError;
use crate::base::error::{Error, Result};
use std::fmt;
use std::sync::Arc;

/// An intersection backend.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Backend {
    /// Intel Embree 4.
    Embree,
    /// The pure-Rust BVH.
    Bvh,
}

impl Backend {
    /// All backends, also those that this program was built without.
    pub const ALL: [Self; 2] = [Self::Embree, Self::Bvh];

    /// The backend of this name.
    pub fn named(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|backend| backend.name() == name)
    }

    /// Its name on the command line.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Embree => "embree",
            Self::Bvh => "bvh",
        }
    }
}

impl Default for Backend {
    /// Embree if the program was built with it.
    fn default() -> Self {
        if cfg!(feature = "embree") { Self::Embree } else { Self::Bvh }
    }
}

impl fmt::Display for Backend {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(self.name())
    }
}

/// Builds the acceleration structure of `scene`.
///
/// # Errors
/// If the program was built without `backend`, or the build fails.
pub fn build(backend: Backend, scene: &Scene) -> Result<Arc<dyn Intersect>> {
    let geometry = scene.geometry();
    match backend {
        Backend::Bvh => {
            let bvh = Bvh::new(&geometry).map_err(|error| refused_by_bvh(&error))?;
            Ok(AlphaMasks::wrap(Arc::new(bvh), scene))
        }
        #[cfg(feature = "embree")]
        Backend::Embree => {
            use crate::accel::embree::{CommittedScene, Device};
            let committed = Device::new()
                .and_then(|device| CommittedScene::new(&device, &geometry))
                .map_err(|error| refused_by_embree(&error))?;
            Ok(AlphaMasks::wrap(Arc::new(committed), scene))
        }
        #[cfg(not(feature = "embree"))]
        Backend::Embree => Err(Error::new(
            "this program was built without Embree",
            "use the backend bvh, or build the program with the default feature `embree`",
        )),
    }
}

fn refused_by_bvh(error: &BvhError) -> Error {
    let advice = match error {
        BvhError::Mesh { .. } => CORRECT_MESH,
        BvhError::TooManyTriangles { .. } => "use fewer triangles",
    };
    Error::new(format!("the scene cannot be traced: {error}"), advice)
}

/// Both backends refuse the same meshes.
const CORRECT_MESH: &str = "correct the mesh";

#[cfg(feature = "embree")]
fn refused_by_embree(error: &EmbreeError) -> Error {
    let (problem, advice) = match error {
        EmbreeError::Mesh { .. } => (format!("the scene cannot be traced: {error}"), CORRECT_MESH),
        EmbreeError::TooManyMeshes => (error.to_string(), "join meshes"),
        EmbreeError::Load { problem } => (
            format!("Embree 4 cannot be loaded: {problem}"),
            "install Embree 4, set EMBREE_DIR to the folder whose lib folder has it, or use the \
             backend bvh, which is slower",
        ),
        EmbreeError::Version { .. } => (
            error.to_string(),
            "install that version, build the program again, or use the backend bvh",
        ),
        EmbreeError::Layout { library } => (
            format!("the Embree library, version {library}, has other structs than its header"),
            "build the program again with EMBREE_DIR set to the folder of both, or use the backend \
             bvh",
        ),
        EmbreeError::Feature(_) => {
            (error.to_string(), "install another build of Embree, or use the backend bvh")
        }
        EmbreeError::Library { .. } => {
            (error.to_string(), "free some memory, render fewer triangles, or use the backend bvh")
        }
    };
    Error::new(problem, advice)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::accel::MeshError;

    #[test]
    fn refused_meshes_are_to_be_corrected() {
        let problem = MeshError::TooManyVertices { count: 7 };
        let error = BvhError::Mesh { mesh: 2, problem: problem.clone() };
        let shown = refused_by_bvh(&error).to_string();
        assert!(shown.contains("mesh 2: 7 vertices") && shown.ends_with("help: correct the mesh"));
        #[cfg(feature = "embree")]
        assert_eq!(refused_by_embree(&EmbreeError::Mesh { mesh: 2, problem }).to_string(), shown);
    }

    /// No mesh is at fault if Embree is missing or fails.
    #[cfg(feature = "embree")]
    #[test]
    fn missing_or_failing_embree_is_answered_with_the_other_backend() {
        let text = || String::from("4.4.0");
        for error in [
            EmbreeError::Load { problem: "no such file".into() },
            EmbreeError::Version { library: text(), header: "5.0.0".into() },
            EmbreeError::Layout { library: text() },
            EmbreeError::Feature("without masks"),
            EmbreeError::Library { doing: "commit", code: "out of memory", message: text() },
        ] {
            let shown = refused_by_embree(&error).to_string();
            let (problem, advice) = shown.split_once("\nhelp: ").unwrap();
            assert!(problem.contains("Embree"), "{shown}");
            assert!(advice.contains("backend bvh") && !shown.contains("correct"), "{shown}");
        }
    }
}
