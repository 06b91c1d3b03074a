//! How many light paths and camera paths an iteration takes.

use crate::base::error::Result;
use crate::settings::{Settings, check_camera_paths, check_light_paths};
use serde::{Deserialize, Serialize};

/// The two counts that decide about noise and time, and about nothing else.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Counts {
    /// Light paths emitted per iteration, `N_F`.
    pub light_paths: u32,
    /// Camera paths per pixel and iteration, `N_B`.
    pub camera_paths: CameraCounts,
}

/// `N_B`, the same everywhere or for each pixel.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub enum CameraCounts {
    /// Every pixel takes as many.
    Uniform(u32),
    /// `N_B(p)`, row by row.
    PerPixel(Vec<u32>),
}

impl Counts {
    /// The same number of camera paths in every pixel.
    pub fn uniform(light_paths: u32, camera_paths: u32) -> Self {
        Self { light_paths, camera_paths: CameraCounts::Uniform(camera_paths) }
    }

    /// Whether noise coefficients can be measured: that takes two paths of each kind in each pixel.
    pub fn can_measure(&self) -> bool {
        self.light_paths >= 2 && self.camera_paths.least() >= 2
    }

    /// Refuses counts that cannot be rendered.
    ///
    /// # Errors
    /// Names the count and its bounds.
    ///
    /// # Panics
    /// If there are counts for another number of pixels than `settings` has.
    pub fn validate(&self, settings: &Settings) -> Result<()> {
        check_light_paths(&self.light_paths)?;
        if let CameraCounts::PerPixel(counts) = &self.camera_paths {
            assert_eq!(counts.len(), settings.pixels(), "one count for each pixel");
        }
        check_camera_paths(&self.camera_paths.least())
    }
}

impl CameraCounts {
    /// Camera paths of the pixel with this index, row by row.
    #[inline]
    pub fn at(&self, pixel: usize) -> u32 {
        match self {
            Self::Uniform(count) => *count,
            Self::PerPixel(counts) => counts[pixel],
        }
    }

    /// Mean over pixels.
    pub fn mean(&self) -> f64 {
        match self {
            Self::Uniform(count) => f64::from(*count),
            Self::PerPixel(counts) => {
                let sum: u64 = counts.iter().map(|&count| u64::from(count)).sum();
                sum as f64 / counts.len() as f64
            }
        }
    }

    /// The least of any pixel.
    pub fn least(&self) -> u32 {
        match self {
            Self::Uniform(count) => *count,
            Self::PerPixel(counts) => counts.iter().copied().min().unwrap_or(0),
        }
    }

    /// The greatest of any pixel.
    pub fn most(&self) -> u32 {
        match self {
            Self::Uniform(count) => *count,
            Self::PerPixel(counts) => counts.iter().copied().max().unwrap_or(0),
        }
    }
}
