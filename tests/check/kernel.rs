//! The true and the estimated merge bias of both kernels in a box: a row of the table of
//! `examples/kernel_table.rs`.

use crate::common::true_bias::{Biases, TINY, biases, reference, settings};
use bdpm::load::load;
use bdpm::scene::backend::{Backend, build};
use bdpm::settings::Kernel;
use std::path::Path;

#[test]
fn areas_leave_little_of_the_bias_of_discs() {
    const ITERATIONS: u64 = 4;
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes/cornell-box-classic");
    let loaded = load(&path).unwrap();
    let (scene, defaults) = (&loaded.scene, &loaded.defaults);
    let accel = &build(Backend::default(), scene).unwrap();
    let tiny = settings(scene, defaults, TINY, Kernel::Area);
    let reference = reference(scene, accel, tiny, ITERATIONS);
    let of = |kernel| {
        let settings = settings(scene, defaults, 0.04, kernel);
        let found = biases(scene, accel, settings, &reference, ITERATIONS);
        println!("{kernel:?}: {found:?}");
        found
    };
    let [disc, area] = [Kernel::Disc, Kernel::Area].map(of);
    assert!(disc.real.error < 0.1 * disc.real.value, "says little: {disc:?}");
    assert!(area.real.value + 2.0 * area.real.error < 0.2 * disc.real.value);
    assert!(area.estimated.value < 0.1 * disc.estimated.value);
    // Edges under discs are where estimates are worst: the mean square within a factor.
    for Biases { real, estimated } in [disc, area] {
        let error = 2.0 * real.error.hypot(estimated.error);
        assert!((estimated.value - real.value).abs() < 0.5 * real.value + error);
    }
}
