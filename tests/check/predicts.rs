//! Far counts by the strategies that `tests/noise/predicts.rs` leaves out.

use crate::common::MIS;
use crate::far_counts::assert_far_counts;
use bdpm::settings::Direct;

#[test]
fn coefficients_measured_anywhere_predict_the_noise_everywhere() {
    for (direct, merge_vertex) in
        [(Direct::Connect, 2), (Direct::PhotonMap, 1), (Direct::PhotonMap, MIS)]
    {
        assert_far_counts(direct, merge_vertex);
    }
}
