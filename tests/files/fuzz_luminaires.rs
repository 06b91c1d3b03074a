//! No photometric file makes the reader panic: good ones with pieces deleted, doubled or replaced.
//! `PROPTEST_CASES=100000` tries far more.

use crate::common::mutate::{apply, change, fuzz_config};
use bdpm::light::photometry::LuminaireFile;
use proptest::collection::vec;
use proptest::prelude::*;

const FILES: [(&str, &[u8]); 6] = [
    ("a.ies", include_bytes!("../data/photometry/quarter.ies")),
    ("a.ies", include_bytes!("../data/photometry/tilted.ies")),
    ("a.ies", include_bytes!("../data/photometry/flood.ies")),
    ("a.ies", include_bytes!("../data/photometry/headlamp.ies")),
    ("a.ldt", include_bytes!("../data/photometry/quadrants.ldt")),
    ("a.ldt", include_bytes!("../data/photometry/c90-c270.ldt")),
];

proptest! {
    #![proptest_config(fuzz_config(2000))]

    #[test]
    fn changed_photometric_files_are_read_or_refused(
        index in 0..FILES.len(),
        changes in vec(change(), 1..6),
        numbers in [0.0..1.0f64, 0.0..1.0f64],
    ) {
        let (name, text) = FILES[index];
        let mut text = text.to_vec();
        changes.iter().for_each(|change| apply(&mut text, change));
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join(name);
        std::fs::write(&path, &text).unwrap();
        match LuminaireFile::read(&path) {
            Ok(file) => {
                // Sound for rendering
                let own = &file.distribution;
                assert!(own.flux().is_finite() && own.flux() >= 0.0);
                if own.flux() > 0.0 {
                    let direction = own.sample(numbers);
                    assert!((direction.length() - 1.0).abs() < 1e-9, "{direction}");
                    assert!(own.intensity(direction).is_finite());
                }
                assert!(file.tilt_factor(30.0).is_finite());
            }
            Err(error) => {
                let shown = error.to_string();
                assert!(shown.contains(name) && shown.contains("\nhelp: "), "{shown}");
            }
        }
    }
}
