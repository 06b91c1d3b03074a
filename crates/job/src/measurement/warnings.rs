//! Errors that a measurement does not know.

use crate::job::RenderResult;

/// A warning if the merge bias of a render is unknown: nested radii are measured only where the
/// pilot ran.
pub(super) fn unknown_bias(result: &RenderResult) -> Option<String> {
    let merges = result.state.provenance.settings.has_photons();
    let text = "path counts are fixed, so that the merge bias is not measured: uncertainties are those of the noise";
    (merges && result.selection().is_none()).then(|| text.to_owned())
}
