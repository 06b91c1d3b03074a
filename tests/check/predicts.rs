//! Far counts by the strategies that `tests/noise/predicts.rs` leaves out, by areas, and of scenes
//! of this project.

use crate::common::committed;
use crate::common::far_counts::{Subject, assert_far_counts};
use crate::common::fog::foggy_room;
use crate::common::{MIS, furnished_box, settings};
use bdpm::Settings;
use bdpm::settings::{Direct, Kernel, MediumQuery, MisScales, Strategy};

#[test]
#[ignore = "takes minutes: make check-long"]
fn coefficients_measured_anywhere_predict_the_noise_everywhere() {
    for (direct, merge_vertex, kernel) in [
        (Direct::Connect, 2, Kernel::Disc),
        (Direct::PhotonMap, 1, Kernel::Disc),
        (Direct::PhotonMap, 2, Kernel::Disc),
        (Direct::PhotonMap, MIS, Kernel::Disc),
        (Direct::Connect, 1, Kernel::Area),
        (Direct::Connect, MIS, Kernel::Area),
    ] {
        assert_far_counts(direct, merge_vertex, kernel);
    }
}

/// Guided light paths have coefficients of their own, which predict as well.
#[test]
#[ignore = "takes minutes: make check-long"]
fn noise_of_guided_light_paths_is_predicted_at_far_counts() {
    let settings =
        Settings { direct: Direct::PhotonMap, radius: 0.2, guide: 16, ..settings(12, 12) };
    let (name, scene) = ("guided".into(), &furnished_box());
    Subject { name, scene, settings, few: 300, iterations: 16000, quiet: 1.0, most: 0.03 }
        .assert_far_counts(&[(30_000, 4, 1000), (300, 100, 800)]);
}

/// Direct light from photons in fog. All pixels share bright photons, so that the error of a
/// sampled variance is underestimated at the iterations of `tests/transport/media.rs`.
#[test]
#[ignore = "takes minutes: make check-long"]
fn noise_of_photons_in_media_is_predicted() {
    let scene = &foggy_room();
    for (merge_vertex, medium_query) in
        [(1, MediumQuery::Points), (1, MediumQuery::Beams), (2, MediumQuery::Beams)]
    {
        let settings = Settings {
            direct: Direct::PhotonMap,
            merge_vertex,
            medium_query,
            medium_scale: 1.5,
            radius: 0.25,
            caustic_radius: 0.2,
            ..settings(8, 8)
        };
        let name = format!("fog k = {merge_vertex} {medium_query:?}");
        Subject { name, scene, settings, few: 300, iterations: 6000, quiet: 1.0, most: 0.045 }
            .assert_far_counts(&[(6000, 4, 1200), (300, 60, 1200)]);
    }
}

/// By all ways at once, with areas and a radius of their own for caustics, as a render without
/// options does.
#[test]
#[ignore = "takes minutes: make check-long"]
fn noise_of_every_technique_is_predicted_at_far_counts() {
    for name in ["cornell-box-classic", "caustic-sphere"] {
        let (scene, settings) = committed::small(name);
        let radius = 0.04 * scene.size();
        let settings = Settings {
            strategy: Strategy::Mis,
            merge_vertex: 2,
            kernel: Kernel::Area,
            radius,
            caustic_radius: 0.5 * radius,
            mis_scales: Some(MisScales { light_paths: 1000, ..settings.mis_scales() }),
            ..settings
        };
        let (name, scene) = (name.into(), &scene);
        Subject { name, scene, settings, few: 300, iterations: 10_000, quiet: 0.3, most: 0.05 }
            .assert_far_counts(&[(30_000, 4, 260), (300, 60, 2000)]);
    }
}
