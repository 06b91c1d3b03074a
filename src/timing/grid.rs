//! At which counts the phases are measured.

use super::sample::Phase;

/// IterationSet of light paths.
const LIGHT_PATHS: [u32; 4] = [1000, 10_000, 100_000, 1_000_000];
/// IterationSet of camera paths per pixel: few, so that iterations are short.
const CAMERA_PATHS: [u32; 3] = [1, 2, 4];

/// Counts of an iteration.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Size {
    /// `N_F`.
    pub light_paths: u32,
    /// `N_B`, in every pixel.
    pub camera_paths: u32,
}

/// Where `phase` is measured for an image of so many pixels: its own counts vary, those of the other
/// phases are small.
pub fn sizes_of(phase: Phase, pixels: usize) -> Vec<Size> {
    let size = |light_paths, camera_paths| Size { light_paths, camera_paths };
    // More than a few light paths per pixel take long and are no good choice for the image.
    let most = (4 * pixels).max(10_000);
    let light = LIGHT_PATHS.into_iter().filter(|&n| n as usize <= most);
    let [few, _, many] = CAMERA_PATHS;
    match phase {
        Phase::Light => light.map(|n| size(n, few)).collect(),
        Phase::Camera => CAMERA_PATHS.map(|n| size(LIGHT_PATHS[0], n)).into(),
        // What depends on both counts is measured at pairs of them, but for the largest.
        Phase::Merge | Phase::Rest => {
            let many = light.clone().filter(|&n| n < LIGHT_PATHS[3]).map(|n| size(n, many));
            light.map(|n| size(n, few)).chain(many).collect()
        }
    }
}

/// All of these, each once.
pub fn sizes(pixels: usize) -> Vec<Size> {
    let mut all = Vec::new();
    for size in Phase::ALL.into_iter().flat_map(|phase| sizes_of(phase, pixels)) {
        if !all.contains(&size) {
            all.push(size);
        }
    }
    all
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::timing::fit::fit;
    use crate::timing::sample::Sample;

    #[test]
    fn the_sizes_tell_all_coefficients_apart() {
        for pixels in [1, 192, 16_384, 512 * 512, 3840 * 2160] {
            let sample = |phase| {
                move |size: Size| Sample {
                    phase,
                    light_paths: f64::from(size.light_paths),
                    camera_paths: f64::from(size.camera_paths),
                    seconds: 1.0,
                    error: Some(0.1),
                }
            };
            let of = |phase| sizes_of(phase, pixels).into_iter().map(sample(phase));
            let all: Vec<Sample> = Phase::ALL.into_iter().flat_map(of).collect();
            assert_eq!(fit(&all, pixels as f64).unwrap().notes, Vec::<String>::new());
        }
        assert_eq!(sizes(512 * 512).len(), 8);
        assert_eq!(sizes(192).len(), 5);
    }
}
