//! Noise in media by the query that `tests/transport/media_merges.rs` leaves out, and with weights.

use crate::common::fog::assert_noise_in_media;
use bdpm::settings::{MediumQuery, Strategy};

#[test]
fn noise_in_media_is_predicted() {
    assert_noise_in_media(Strategy::Single, (2, MediumQuery::Points, 1.0));
    assert_noise_in_media(Strategy::Mis, (2, MediumQuery::Beams, 1.0));
}
