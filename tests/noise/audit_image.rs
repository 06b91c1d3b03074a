//! Audits of images of known scenes.

use bdpm::film::aov::AovSelection;
use bdpm::load;
use bdpm::noise::Measure;
use bdpm::render::audit::{Audited, Auditor, HalfSums, brightest_path};
use bdpm::render::block::CombinedImage;
use bdpm::render::{RenderConfig, Renderer};
use bdpm::scene::backend::{Backend, build};
use bdpm::settings::{Bias, Kernel, PartialSettings, Settings, Strategy};

/// A renderer of a scene of this repository that keeps both halves of its iterations.
fn renderer(scene: &str, settings: impl FnOnce(Settings) -> Settings) -> Renderer {
    let loaded = load(format!("{}/scenes/{scene}", env!("CARGO_MANIFEST_DIR"))).unwrap();
    let given = PartialSettings { resolution: Some([48, 48]), ..PartialSettings::default() };
    let own = Settings::resolve(&given, &loaded.defaults, loaded.scene.size()).unwrap();
    let own = Settings { bias: Bias::Keep, light_paths: 4000, camera_paths: 1, ..own };
    let accel = build(Backend::Bvh, &loaded.scene).unwrap();
    let aovs = AovSelection { halves: true, ..AovSelection::default() };
    let config = RenderConfig { aovs, ..RenderConfig::default() };
    Renderer::new(&loaded.scene, &accel, settings(own)).unwrap().configure(config).unwrap()
}

/// The audit of an image after these iterations of the image, and steps of the audit.
fn audited(renderer: &mut Renderer, iterations: u64, steps: u64) -> Audited {
    let mut auditor = Auditor::new(renderer).unwrap().unwrap();
    for _ in 0..iterations {
        renderer.iterate(Measure::Off);
    }
    (0..steps).for_each(|number| auditor.step(number));
    let (scene, _) = renderer.scene_and_accel();
    let image = CombinedImage::new(renderer.blocks(), vec![1.0]);
    auditor.sums().compare(&image, brightest_path(scene)).unwrap()
}

#[test]
fn a_right_image_agrees_and_a_blurred_one_differs() {
    let of = |scale: f32| {
        let mut own = renderer("cornell-box-classic", |own| Settings {
            strategy: Strategy::Single,
            merge_vertex: 1,
            radius: scale * own.radius,
            caustic_radius: scale * own.radius,
            kernel: Kernel::Disc,
            ..own
        });
        audited(&mut own, 60, 60)
    };
    let right = of(0.5);
    assert!(!right.difference.is_significant(1e-3, 1), "{:?}", right.difference.scales);
    assert!(right.not_audited == 0.0 && right.difference.mean_score() < 4.0);
    // Discs of eight times the radius lose light at all edges.
    let blurred = of(8.0);
    assert!(blurred.difference.is_significant(1e-3, 1), "{:?}", blurred.difference.scales);
    let regions = blurred.difference.regions(1e-3);
    assert!(!regions.is_empty() && regions[0].ratio < 1.0, "{regions:?}");
}

#[test]
fn caustics_of_point_lights_are_not_audited_and_no_difference() {
    let mut own = renderer("point-caustic", |own| Settings { strategy: Strategy::Single, ..own });
    let audited = audited(&mut own, 100, 100);
    let Audited { difference, not_audited, .. } = &audited;
    assert!(*not_audited > 0.02 && *not_audited < 0.9, "{not_audited}");
    assert!(!difference.is_significant(1e-3, 1), "{not_audited} {:?}", difference.scales);
}

#[test]
fn parts_of_an_audit_add_up_to_the_whole() {
    let own = renderer("point-caustic", |own| own);
    let run = |numbers: std::ops::Range<u64>| {
        let mut auditor = Auditor::new(&own).unwrap().unwrap();
        numbers.for_each(|number| auditor.step(number));
        auditor.take_sums()
    };
    let (all, mut parts) = (run(0..5), run(0..2));
    assert_ne!(all, parts);
    parts.merge(&run(2..5));
    let close = |one: &HalfSums, other: &HalfSums| {
        let pairs = one.sums.iter().zip(&other.sums);
        one.iterations == other.iterations
            && pairs.into_iter().all(|(a, b)| (a - b).abs() <= 1e-12 * a.abs())
    };
    assert!(all.traced.iter().zip(&parts.traced).all(|(one, other)| close(one, other)));
    let [one, other] = [&all, &parts].map(|own| own.photon_only.as_ref().unwrap());
    assert!(one.iter().zip(other).all(|(one, other)| close(one, other)));
    assert!(one[0].sums.iter().sum::<f64>() > 0.0);
    assert!(all.fits(own.settings()));
    assert!(!all.fits(&Settings { width: 60, ..own.settings().clone() }));
}

#[test]
fn images_without_photons_are_not_audited() {
    let own = renderer("cornell-box-classic", |own| Settings { strategy: Strategy::Path, ..own });
    assert!(Auditor::new(&own).unwrap().is_none());
}
