//! Camera paths that end at a cache of light. `tests/check` has more surfaces.

use crate::common::cached_light::{
    SHORT, assert_cached_light, assert_suffix_paths, box_of, coat, gathering, scenes,
};
use crate::common::far_counts::Subject;
use crate::common::{accel, furnished_box};
use bdpm::noise::Measure;
use bdpm::settings::Bias;
use bdpm::{Renderer, Settings};

#[test]
fn cached_light_is_that_of_full_paths() {
    assert_cached_light(&scenes()[..SHORT]);
}

#[test]
fn suffix_paths_tell_what_a_bad_cache_adds() {
    assert_suffix_paths(&scenes()[..SHORT]);
}

/// Coefficients that were measured at few paths predict the noise at many, as with photons, once
/// the paths fill the cache.
#[test]
fn noise_of_a_cache_is_predicted_at_far_counts() {
    let settings = Settings { radius: 0.2, ..gathering(12) };
    let (name, scene) = ("cache".into(), &furnished_box());
    Subject { name, scene, settings, few: 3000, iterations: 2500, quiet: 1.0, most: 0.05 }
        .assert_far_counts(&[(30_000, 4, 130), (3000, 100, 500), (10_000, 25, 250)]);
}

/// The cache is filled by batches of a fixed size, and its cells are sums in a fixed order.
#[test]
fn images_do_not_depend_on_the_number_of_threads() {
    let scene = box_of(coat(0.15));
    let render = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| {
            let own = Settings { bias: Bias::Reduce, ..gathering(40) };
            let mut renderer = Renderer::new(&scene, &accel(&scene), own).unwrap();
            (0..4).for_each(|_| drop(renderer.iterate(Measure::Pairs)));
            renderer.block().clone()
        })
    };
    let (one, three) = (render(1), render(3));
    assert!(one.film == three.film && one.statistics == three.statistics);
}
