//! Photons of caustics alone, beside path tracing and beside a cache of light. `tests/check` has
//! the other balls, and the noise with a cache.

use crate::common::accel;
use crate::common::caustics::{
    assert_far_counts, assert_light_of_panels, assert_light_of_points, balls, box_with, caustics,
};
use crate::common::several_ways::*;
use bdpm::Renderer;
use bdpm::noise::Measure;
use bdpm::scene::bsdf::{Bsdf, FacetModel, Facets, Glossy, Plastic, ThinDielectric};
use bdpm::settings::Strategy;
use glam::Vec3;

/// Weights of merges as planned, and much smaller ones.
const CAUSTICS: [Weighting; 2] =
    [(Strategy::PathCaustics, [1.0; 2], 1.0), (Strategy::PathCaustics, [0.3, 2.0], 0.01)];

#[test]
fn smooth_objects_in_a_furnace_have_its_radiance() {
    assert_furnace("smooth", &smooth_things(), 0.0, (40, 4e-3), (&WAYS[1..2], &CAUSTICS));
}

/// Rough lobes pass photons on and are connected as well; coats are shaded sixteen at a time. They
/// lose light between smooth normals, as much as with path tracing.
#[test]
fn rough_objects_and_coats_in_a_furnace_look_as_by_path_tracing() {
    let facets = |alpha| Facets { model: FacetModel::Ggx, alpha };
    let bsdfs = [
        white_metal(0.15),
        Bsdf::Glossy(Glossy::new(Vec3::ONE, 0.3, 1.5, 0.2)),
        Bsdf::Plastic(Plastic::new(Vec3::ONE, 1.5, facets(0.0), true)),
        Bsdf::Plastic(Plastic::new(Vec3::ONE, 1.5, facets(0.15), true)),
    ];
    let (scene, iterations) = (furnace(&bsdfs, true), 60);
    let path = tiles(&scene, caustics(Strategy::Path, SIDE), iterations);
    for weighting in CAUSTICS {
        let own = weighted(&caustics(Strategy::PathCaustics, SIDE), weighting);
        let own = tiles(&scene, own, iterations);
        let differences: Vec<Vec<f64>> = own
            .iter()
            .zip(&path)
            .map(|(own, path)| own.iter().zip(path).map(|(a, b)| a - b).collect())
            .collect();
        assert_zero(&format!("{weighting:?}"), &differences, 2.0, 4e-3, 0.0);
    }
}

#[test]
fn light_of_panels_is_that_of_path_tracing() {
    assert_light_of_panels(&balls()[..1]);
}

#[test]
fn light_of_points_is_that_of_photons_of_all_kinds() {
    assert_light_of_points(&balls()[..1]);
}

#[test]
fn noise_is_predicted_at_far_counts() {
    assert_far_counts(Strategy::PathCaustics);
}

#[test]
fn images_do_not_depend_on_the_number_of_threads() {
    let pane = Bsdf::ThinDielectric(ThinDielectric::new(1.5));
    let scene = box_with(pane, 3.0, 1.0);
    for strategy in [Strategy::PathCaustics, Strategy::GatherCaustics] {
        let render = |threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| {
                let accel = accel(&scene);
                let settings = caustics(strategy, 24);
                let mut renderer = Renderer::new(&scene, &accel, settings).unwrap();
                renderer.iterate(Measure::Off);
                renderer.iterate(Measure::Pairs);
                renderer.film().mean()
            })
        };
        assert_eq!(render(1), render(3), "{strategy:?}");
    }
}
