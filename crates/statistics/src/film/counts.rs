//! Numbers of light paths and camera paths of an iteration.

use crate::settings::{Settings, check_camera_paths, check_light_paths, check_whole_sets};
use bdpm_base::error::Result;
use serde::{Deserialize, Serialize};

/// Numbers of paths of one iteration. They determine the noise and the time, but not the bias.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Counts {
    /// Light paths emitted per iteration, `N_F`.
    pub light_paths: u32,
    /// Camera paths per pixel and iteration, `N_B`.
    pub camera_paths: CameraCounts,
}

/// Camera paths per pixel and iteration, `N_B`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub enum CameraCounts {
    /// The number is the same for all pixels.
    Uniform(u32),
    /// One number for each pixel, in row order.
    PerPixel(Vec<u32>),
}

impl Counts {
    /// Equal numbers of camera paths for every pixel.
    #[inline]
    pub fn uniform(light_paths: u32, camera_paths: u32) -> Self {
        Self { light_paths, camera_paths: CameraCounts::Uniform(camera_paths) }
    }

    /// Whether noise coefficients can be measured, which needs two independent samples of light
    /// paths and two camera paths in each pixel.
    #[inline]
    pub fn can_measure(&self, settings: &Settings) -> bool {
        settings.light_samples(self.light_paths) >= 2 && self.camera_paths.least() >= 2
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
        check_whole_sets(self.light_paths, settings.sobol_set)?;
        if let CameraCounts::PerPixel(counts) = &self.camera_paths {
            assert_eq!(counts.len(), settings.pixels(), "one count for each pixel");
        }
        check_camera_paths(&self.camera_paths.least())
    }
}

impl CameraCounts {
    /// Camera paths of the pixel with this index in row order.
    #[inline]
    pub fn at(&self, pixel: usize) -> u32 {
        match self {
            Self::Uniform(count) => *count,
            Self::PerPixel(counts) => counts[pixel],
        }
    }

    /// Mean over pixels.
    #[inline]
    pub fn mean(&self) -> f64 {
        match self {
            Self::Uniform(count) => f64::from(*count),
            Self::PerPixel(counts) => {
                let sum: u64 = counts.iter().map(|&count| u64::from(count)).sum();
                sum as f64 / counts.len() as f64
            }
        }
    }

    /// Minimum over pixels.
    #[inline]
    pub fn least(&self) -> u32 {
        match self {
            Self::Uniform(count) => *count,
            Self::PerPixel(counts) => counts.iter().copied().min().unwrap_or(0),
        }
    }

    /// Maximum over pixels.
    #[inline]
    pub fn most(&self) -> u32 {
        match self {
            Self::Uniform(count) => *count,
            Self::PerPixel(counts) => counts.iter().copied().max().unwrap_or(0),
        }
    }
}
