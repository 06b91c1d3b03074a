//! Light that a measurement does not include, and errors that it does not know.

use crate::job::RenderResult;
use bdpm_core::scene::bsdf::Lobe;
use bdpm_core::scene::{Emitter, Placement, Scene};

/// A warning if light of points, spots or parallel light can reach meters by mirrors or through
/// glass alone: no photons are merged at meters, and camera paths cannot hit such lights.
pub(super) fn missing_light(scene: &Scene) -> Option<String> {
    let is_delta = scene.lights().emitters().iter().any(Emitter::is_delta);
    let passes = |placement: &Placement| {
        let material = &scene.materials()[placement.material as usize];
        let passes = material.bsdf.passes_through();
        passes
            && material.bsdf.spread() != Some(Lobe::Rough)
            && !material.is_index_matched_boundary()
    };
    let text = "light of points, spots and suns that reaches a meter only by mirrors or through glass is missing";
    (is_delta && scene.placements().iter().any(passes)).then(|| text.to_owned())
}

/// A warning if the merge bias of a render is unknown: nested radii are measured only where the
/// pilot ran.
pub(super) fn unknown_bias(result: &RenderResult) -> Option<String> {
    let merges = result.state.provenance.settings.has_photons();
    let text = "path counts are fixed, so that the merge bias is not measured: uncertainties are those of the noise";
    (merges && result.selection().is_none()).then(|| text.to_owned())
}
