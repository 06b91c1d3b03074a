//! Whether negative values of an image are meant, in the metadata of its file.

use bdpm_core::image_io::{Metadata, Value};
use bdpm_core::scene::Scene;

/// Attribute of images whose negative values are meant.
const NEGATIVE: &str = "negative values";

/// Adds the reason for negative values to the metadata of an image of a scene, if there is one.
/// Each path that meets a dispersive surface has the color of a single wavelength, of which at
/// least one channel is negative in Rec. 709. theory.md (47k)
pub fn record_gamut(scene: &Scene, metadata: &mut Metadata) {
    if scene.is_dispersive() {
        let reason = "dispersion: colors of single wavelengths are outside of Rec. 709";
        metadata.insert(NEGATIVE.into(), Value::Text(reason.into()));
    }
}
