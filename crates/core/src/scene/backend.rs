//! The choice of an intersection backend at run time.

use super::Scene;
use super::alpha_mask::AlphaMasks;
use crate::accel::Intersect;
use crate::accel::bvh::Bvh;
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
            let bvh = Bvh::new(&geometry).map_err(|e| refused(backend, &e))?;
            Ok(AlphaMasks::wrap(Arc::new(bvh), scene))
        }
        #[cfg(feature = "embree")]
        Backend::Embree => {
            use crate::accel::embree::{CommittedScene, Device};
            let committed = Device::new()
                .and_then(|device| CommittedScene::new(&device, &geometry))
                .map_err(|e| refused(backend, &e))?;
            Ok(AlphaMasks::wrap(Arc::new(committed), scene))
        }
        #[cfg(not(feature = "embree"))]
        Backend::Embree => Err(Error::new(
            "this program was built without Embree",
            "use the backend bvh, or build the program with the default feature `embree`",
        )),
    }
}

fn refused(backend: Backend, error: &dyn fmt::Display) -> Error {
    let other = if backend == Backend::Embree { Backend::Bvh } else { Backend::Embree };
    Error::new(
        format!("{backend} cannot take the scene: {error}"),
        format!("correct the mesh, or try the backend {other}"),
    )
}
