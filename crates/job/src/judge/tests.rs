use super::*;
use crate::job::named_regions;
use bdpm_core::noise::difference::{DifferentRegion, TileMap};
use bdpm_core::render::Renderer;
use bdpm_core::settings::Bias;
use bdpm_load::load;

const SIZE: (u32, u32) = (64, 48);

fn loaded() -> Loaded {
    load(format!("{}/../../scenes/cornell-box-classic", env!("CARGO_MANIFEST_DIR"))).unwrap()
}

/// An image of the scene by path tracing with this seed.
fn image(loaded: &Loaded, seed: u64, iterations: u64) -> Vec<Rgb> {
    let (width, height) = SIZE;
    let given = PartialSettings {
        resolution: Some([width, height]),
        seed: Some(seed),
        ..PartialSettings::default()
    };
    let own = Settings::resolve(&given, &loaded.defaults, loaded.scene.size()).unwrap();
    let own = Settings {
        strategy: Strategy::Path,
        merge_vertex: 2,
        bias: Bias::Keep,
        kernel: Kernel::Disc,
        camera_paths: 4,
        guide: 0,
        ..own
    };
    let accel = backend::build(Backend::Bvh, &loaded.scene).unwrap();
    let mut renderer = Renderer::new(&loaded.scene, &accel, own).unwrap();
    (0..iterations).for_each(|_| {
        renderer.iterate(bdpm_core::noise::Measure::Off);
    });
    renderer.film().mean()
}

/// Findings of a judge with this many steps of its estimate, in the first of two looks.
fn findings(loaded: &Loaded, images: &[Vec<Rgb>], (seed, steps): (u64, u64)) -> Findings {
    let settings = PartialSettings { seed: Some(seed), ..PartialSettings::default() };
    let job = JudgeJob::new(loaded, images, SIZE).unwrap().settings(settings);
    let accel = backend::build(Backend::Bvh, &loaded.scene).unwrap();
    let mut auditor = job.auditor(&accel).unwrap();
    (0..steps).for_each(|number| auditor.step(number));
    let brightest = brightest_path(&loaded.scene);
    Findings::new(auditor.sums(), (&job.images, job.size), brightest, 1).unwrap()
}

fn judgment(loaded: &Loaded, findings: Findings) -> Judgment {
    let accel = backend::build(Backend::Bvh, &loaded.scene).unwrap();
    let (width, height) = SIZE;
    let given = PartialSettings { resolution: Some([width, height]), ..PartialSettings::default() };
    let settings = Settings::resolve(&given, &loaded.defaults, loaded.scene.size()).unwrap();
    findings.judgment((&loaded.scene, &*accel, &settings), 0.01, Duration::from_secs(1))
}

#[test]
fn right_images_are_hardly_ever_called_wrong() {
    let loaded = loaded();
    let runs = 40;
    for count in [1, 2] {
        let wrong = (0..runs).filter(|run| {
            let seed = |number: u64| 1000 * (count as u64) + 2 * run + number;
            let images: Vec<_> = (0..count as u64).map(|n| image(&loaded, seed(n), 4)).collect();
            findings(&loaded, &images, (run + 7, 12)).is_wrong()
        });
        // 5 % of 40 are 2; more than 7 have a probability of .03 %.
        let wrong = wrong.count();
        assert!(wrong <= 6, "{count}: {wrong} of {runs}");
    }
}

/// A floor that is too bright brightens the ceiling, too. More of the difference may be there, but
/// less of its own light.
#[test]
fn surfaces_with_the_largest_relative_difference_are_named_first() {
    let loaded = loaded();
    let accel = backend::build(Backend::Bvh, &loaded.scene).unwrap();
    let (width, height) = SIZE;
    let given = PartialSettings { resolution: Some([width, height]), ..PartialSettings::default() };
    let settings = Settings::resolve(&given, &loaded.defaults, loaded.scene.size()).unwrap();
    // The ceiling above, beside the lamp; the floor and what stands on it below.
    let tile = |row: usize| if row == 0 { (0.3, 3.0) } else { (0.05, 0.2) };
    let (columns, rows) = (8, 6);
    let all: Vec<_> = (0..columns * rows).map(|index| tile(index / columns)).collect();
    let map = TileMap {
        side: 8,
        width: columns as u32,
        height: rows as u32,
        scores: vec![9.0; all.len()],
        differences: all.iter().map(|(difference, _)| *difference).collect(),
        luminances: all.iter().map(|(_, luminance)| *luminance).collect(),
    };
    let tiles = [2, 34, 35, 42, 43].to_vec();
    let region = DifferentRegion { pixels: [16, 0, 32, 48], ratio: 1.1, tiles };
    let place = (&*loaded.scene, &*accel, &settings);
    let named = named_regions(vec![region], &map, place);
    let objects = &named[0].objects;
    assert!(objects.len() > 1 && objects.last().unwrap() == "ceiling", "{named:?}");
}

#[test]
fn planted_errors_are_found_and_named() {
    let loaded = loaded();
    let pair: Vec<Vec<Rgb>> = [1, 2].map(|seed| image(&loaded, seed, 64)).into();
    let changed = |change: &dyn Fn(usize, usize, Rgb) -> Rgb| -> Vec<Vec<Rgb>> {
        let width = SIZE.0 as usize;
        let of = |own: &Vec<Rgb>| {
            let pixels = own.iter().enumerate();
            pixels.map(|(index, own)| change(index % width, index / width, *own)).collect()
        };
        pair.iter().map(of).collect()
    };
    let judge = |images: &[Vec<Rgb>]| judgment(&loaded, findings(&loaded, images, (5, 300)));
    let right = judge(&pair);
    assert_ne!(right.verdict, JudgeVerdict::Wrong, "{}", right.describe());

    let brighter = judge(&changed(&|_, _, own| 1.03 * own));
    assert_eq!(brighter.verdict, JudgeVerdict::Wrong, "{}", brighter.describe());
    assert!((brighter.factor.unwrap() - 1.03).abs() < 0.01, "{}", brighter.describe());

    let is_inside = |x: usize, y: usize| (16..40).contains(&x) && (20..40).contains(&y);
    let part = judge(&changed(&|x, y, own| if is_inside(x, y) { 1.2 * own } else { own }));
    assert_eq!(part.verdict, JudgeVerdict::Wrong, "{}", part.describe());
    let [left, top, right, bottom] = part.regions[0].region.pixels;
    assert!(left >= 8 && top >= 8 && right <= 48 && bottom <= 48, "{:?}", part.regions);
    assert!(!part.regions[0].objects.is_empty() && part.factor.is_none());

    let (width, height) = (SIZE.0 as usize, SIZE.1 as usize);
    // Half a pixel to the right: the mean of neighbors.
    let shifted: Vec<Vec<Rgb>> = pair
        .iter()
        .map(|own| {
            (0..width * height)
                .map(|index| 0.5 * (own[index] + own[index - (index % width > 0) as usize]))
                .collect()
        })
        .collect();
    let shifted = judge(&shifted);
    assert_eq!(shifted.verdict, JudgeVerdict::Wrong, "{}", shifted.describe());
    let [right, down] = shifted.shift.unwrap_or_else(|| panic!("{}", shifted.describe()));
    assert!((0.2..0.8).contains(&right) && down.abs() < 0.2, "{right} {down}");

    let mirrored: Vec<Vec<Rgb>> = pair
        .iter()
        .map(|own| {
            let at = |index: usize| own[index / width * width + width - 1 - index % width];
            (0..width * height).map(at).collect()
        })
        .collect();
    assert_eq!(judge(&mirrored).verdict, JudgeVerdict::Wrong);
}

#[test]
fn a_job_says_what_it_would_not_have_seen() {
    let loaded = loaded();
    let images = [image(&loaded, 1, 4)];
    let settings = PartialSettings { seed: Some(3), ..PartialSettings::default() };
    let job = JudgeJob::new(&loaded, &images, SIZE).unwrap().settings(settings);
    let job = job.backend(Some(Backend::Bvh)).time(Duration::from_millis(1)).precision(1e-6);
    let judgment = job.run(|_| {}).unwrap();
    let text = judgment.describe();
    assert!(judgment.verdict == JudgeVerdict::Undecided && text.contains("allow about"), "{text}");
    assert_eq!(judgment.noise, NoiseSource::Neighbors);
}

#[test]
fn images_that_cannot_be_judged_are_refused() {
    let loaded = loaded();
    let shown = |images: &[Vec<Rgb>], size| match JudgeJob::new(&loaded, images, size) {
        Ok(_) => panic!("accepted"),
        Err(error) => error.to_string(),
    };
    let gray = vec![Rgb::ONE; 64];
    assert!(shown(&[gray.clone(), gray.clone()], (8, 8)).contains("another seed"));
    assert!(shown(std::slice::from_ref(&gray), (8, 9)).contains("same resolution"));
    assert!(shown(&[], (8, 8)).contains("0 images"));
    let mut bad = gray;
    bad[9] = Rgb::NAN;
    assert!(shown(&[bad], (8, 8)).contains("pixel (1, 1)"));
    let tiny = vec![Rgb::ONE; 16];
    let job = JudgeJob::new(&loaded, &[tiny], (4, 4)).unwrap().backend(Some(Backend::Bvh));
    assert!(job.run(|_| {}).unwrap_err().to_string().contains("too small"));
}

/// Camera paths hit the sun of a sky behind glass only. A judge who did not know its radiance would
/// call an image wrong that found this light where path tracing did not; a judge who always took it
/// would call no image wrong that is too bright.
#[test]
fn brightest_path_is_that_of_the_sun_behind_glass() {
    let quad = "v -1 0 0\nv 1 0 0\nv 1 2 0\nv -1 2 0\nf 1 2 3\nf 1 3 4\n";
    for (material, hits_sun) in [("albedo = 0.5", false), ("type = 'thin-dielectric'", true)] {
        let folder = tempfile::tempdir().unwrap();
        std::fs::write(folder.path().join("pane.obj"), quad).unwrap();
        let scene = format!(
            "[camera]\nposition = [0, 1, 4]\ntarget = [0, 1, 0]\nfov_x_deg = 60\n\
            [[mesh]]\nfile = 'pane.obj'\nmaterial = 'pane'\n[materials.pane]\n{material}\n\
            [sky]\nsun_direction = [-0.7, 0.6, 0.2]\n"
        );
        std::fs::write(folder.path().join("scene.toml"), scene).unwrap();
        let loaded = load(folder.path()).unwrap();
        let map = loaded.scene.lights().environment().unwrap();
        let largest = |all: &mut dyn Iterator<Item = Rgb>| -> f64 {
            all.map(|radiance| luminance(radiance.as_dvec3())).fold(0.0, f64::max)
        };
        let (_, mut sun) = map.inset().expect("the sun has finer pixels");
        let [around, sun] = [largest(&mut map.pixels()), largest(&mut sun)];
        let brightest = brightest_path(&loaded.scene);
        assert_eq!(brightest >= sun, hits_sun, "{material}: {brightest}, {sun}");
        // Connections carry the irradiance of the sun.
        let connected = luminance(map.integral().as_dvec3()) / std::f64::consts::PI;
        assert!(brightest >= connected.max(around), "{material}: {brightest}, {connected}");
    }
}
