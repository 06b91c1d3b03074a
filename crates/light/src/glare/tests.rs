//! Ratings against closed forms and `evalglare`.

use super::*;
use bdpm_core::base::quantiles::NORMAL_95;
use bdpm_core::base::rng::{Stream, StreamKey};

/// An image of the whole half-space in front of the eye with this luminance, cd/m^2.
fn image(projection: FisheyeProjection, luminance: impl Fn(DVec3) -> f64) -> LuminanceImage {
    // That of the pictures for evalglare.
    let side = 800;
    let black = vec![Rgb::ZERO; side * side];
    let mut own = LuminanceImage::new((side as u32, side as u32), &black, projection, PI);
    own.pixels.iter_mut().for_each(|(direction, _, value)| *value = luminance(*direction));
    own
}

#[test]
fn uniform_image_has_pi_times_its_luminance_and_no_source() {
    for projection in FisheyeProjection::ALL {
        let own = image(projection, |_| 500.0);
        let solid: f64 = own.pixels.iter().map(|(_, solid, _)| solid).sum();
        assert!((solid / (2.0 * PI) - 1.0).abs() < 2e-3, "{projection:?}: {solid}");
        let glare = Glare::new(&own, &SourceSearch::default());
        assert!((glare.vertical_illuminance / (500.0 * PI) - 1.0).abs() < 2e-3);
        assert!(glare.sources.is_empty() && glare.ugr.is_none());
        let expected = 5.87e-5 * glare.vertical_illuminance + 0.16;
        assert!((glare.dgp - expected).abs() < 1e-12, "{}", glare.dgp);
    }
}

#[test]
fn disc_of_a_source_has_its_solid_angle_and_rating() {
    // A disc of 4 degrees at 20 degrees to the right, of 20,000 cd/m^2 before 100 cd/m^2
    let (sin, cos) = 20f64.to_radians().sin_cos();
    let center = DVec3::new(sin, 0.0, cos);
    let half = 2f64.to_radians();
    let own = image(FisheyeProjection::Equidistant, |w| {
        if w.dot(center) > half.cos() { 20_000.0 } else { 100.0 }
    });
    let glare = Glare::new(&own, &SourceSearch::default());
    let [source] = &glare.sources[..] else { panic!("{} sources", glare.sources.len()) };
    let solid = 2.0 * PI * (1.0 - half.cos());
    assert!((source.solid_angle / solid - 1.0).abs() < 0.05, "{}", source.solid_angle);
    assert!((source.luminance - 20_000.0).abs() < 1e-6);
    // tau = 90 degrees and sigma = 20 degrees
    let linear: f64 = 35.2 - 0.31889 * 90.0 - 1.22 * (-20.0f64).exp();
    let square = 21.0 + 0.26667 * 90.0 - 0.002963 * 8100.0;
    let index = (1e-3 * linear * 20.0 + 1e-5 * square * 400.0).exp();
    assert!((source.position_index / index - 1.0).abs() < 1e-3);
    let background = 100.0 * (PI - solid * cos) / PI;
    assert!((glare.background_luminance / background - 1.0).abs() < 2e-3);
    let ugr = 8.0 * (0.25 / background * 4e8 * solid / (index * index)).log10();
    assert!((glare.ugr.unwrap() - ugr).abs() < 0.2, "{:?} {ugr}", glare.ugr);
}

/// Sources: degrees to the right and up, radius in degrees, luminance in cd/m^2.
type Sources<'a> = &'a [[f64; 4]];

/// Background and sources of images, and DGP, UGR, vertical illuminance and background by evalglare
/// 3.06: `scripts/radiance_check.py glare`.
const BY_EVALGLARE: [(f64, Sources, [f64; 4]); 10] = [
    (300.0, &[[25.0, 10.0, 12.0, 6000.0]], [0.2936, 25.277, 1635.6, 288.39]),
    (
        1500.0,
        &[[-10.0, 15.0, 10.0, 15_000.0], [30.0, 5.0, 4.0, 40_000.0]],
        [0.5699, 27.617, 6451.7, 1455.2],
    ),
    (30.0, &[[15.0, 20.0, 3.0, 8000.0]], [0.2625, 24.058, 156.31, 29.905]),
    (
        200.0,
        &[[5.0, -20.0, 5.0, 10_000.0], [-40.0, 30.0, 6.0, 5000.0]],
        [0.2781, 26.078, 958.12, 197.80],
    ),
    (
        80.0,
        &[[0.0, 35.0, 4.0, 5000.0], [-25.0, 40.0, 4.0, 5000.0], [25.0, 40.0, 4.0, 5000.0]],
        [0.2009, 17.109, 416.52, 79.030],
    ),
    // A sun in its glow, before a bright and a dark background.
    (800.0, &[[20.0, 25.0, 8.0, 8000.0], [20.0, 25.0, 1.5, 5e5]], [0.4923, 34.909, 3801.6, 789.47]),
    (200.0, &[[20.0, 25.0, 8.0, 8000.0], [20.0, 25.0, 1.5, 5e5]], [0.4314, 39.725, 1941.5, 197.37]),
    (
        1000.0,
        &[[-15.0, 30.0, 20.0, 6000.0], [-15.0, 30.0, 1.0, 2e6]],
        [0.6640, 39.987, 6308.5, 900.76],
    ),
    // Two peaks, which join; and a source that is a peak as a whole.
    (
        500.0,
        &[[10.0, 20.0, 5.0, 2e4], [10.0, 20.0, 1.0, 8e4], [10.0, 26.0, 1.0, 9e4]],
        [0.3371, 26.969, 2128.8, 495.60],
    ),
    (500.0, &[[-30.0, 20.0, 3.0, 6e4], [30.0, 20.0, 3.0, 3e4]], [0.3444, 27.554, 2195.5, 497.00]),
];

#[test]
fn ratings_are_those_of_evalglare() {
    for (background, sources, [dgp, ugr, vertical, lum_backg]) in BY_EVALGLARE {
        let own = image(FisheyeProjection::Equidistant, |w| {
            let lit = sources.iter().rev().find(|[right, up, radius, _]| {
                let ((sx, cx), (sy, cy)) =
                    (right.to_radians().sin_cos(), up.to_radians().sin_cos());
                w.dot(DVec3::new(sx * cy, sy, cx * cy)) > radius.to_radians().cos()
            });
            lit.map_or(background, |[_, _, _, luminance]| *luminance)
        });
        let glare = Glare::new(&own, &SourceSearch::default());
        println!("{} {:?} {glare:?}", glare.dgp, glare.ugr);
        // The pictures of evalglare have three digits, and its pixels other edges.
        assert!((glare.dgp - dgp).abs() < 5e-3, "{} {dgp}", glare.dgp);
        assert!((glare.ugr.unwrap() - ugr).abs() < 0.2, "{:?} {ugr}", glare.ugr);
        assert!((glare.vertical_illuminance / vertical - 1.0).abs() < 0.01);
        assert!((glare.background_luminance / lum_backg - 1.0).abs() < 0.02);
    }
}

/// Pixels of the images of panels along each axis, and samples of a pixel along each axis.
const PANEL_SIDE: usize = 400;
const FINE: usize = 4;

/// A square panel in the plane z = 1, `half` as wide around a center, as an image has it: the mean
/// luminance of each pixel, cd/m^2. The rest has another luminance. `samples` has all samples of
/// all pixels.
fn panel_image(
    samples: &LuminanceImage,
    center: DVec3,
    half: f64,
    [panel, rest]: [f64; 2],
) -> LuminanceImage {
    let luminance = |w: DVec3| {
        let at = w / w.z - center;
        if w.z > 0.0 && at.x.abs() < half && at.y.abs() < half { panel } else { rest }
    };
    let mut pixels = vec![Rgb::ZERO; PANEL_SIDE * PANEL_SIDE];
    for (at, index) in samples.index.iter().enumerate().filter(|(_, index)| **index != OUTSIDE) {
        let (x, y) = (at % samples.width / FINE, at / samples.width / FINE);
        let value = luminance(samples.pixels[*index as usize].0) / (FINE * FINE) as f64;
        pixels[y * PANEL_SIDE + x] += Rgb::splat((value / f64::from(LUMENS_PER_WATT)) as f32);
    }
    let size = (PANEL_SIDE as u32, PANEL_SIDE as u32);
    LuminanceImage::new(size, &pixels, FisheyeProjection::Equidistant, PI)
}

/// The background before which a panel is rated 21.0, and its rating in an image, for panels of
/// different sizes whose edges cross pixels at different places.
#[test]
fn pixels_that_a_panel_covers_in_part_do_not_change_its_rating_of_21() {
    let rated = 21.0;
    let fine = FINE * PANEL_SIDE;
    let black = vec![Rgb::ZERO; fine * fine];
    let size = (fine as u32, fine as u32);
    let samples = LuminanceImage::new(size, &black, FisheyeProjection::Equidistant, PI);
    for (x, y, half, luminance) in [
        (0.05, 0.35, 0.05, 4000.0),
        (0.053, 0.352, 0.05, 4000.0),
        (0.0, 0.4, 0.15, 3000.0),
        (-0.3, 0.6, 0.1, 8000.0),
        (0.207, 0.203, 0.025, 12_000.0),
    ] {
        // Integrals over the panel of the solid angle, of that times the cosine, and of directions
        let (mut solid, mut projected, mut directions) = (0.0, 0.0, DVec3::ZERO);
        let cells = 100;
        for cell in 0..cells * cells {
            let across = |at: i32| half * (2.0 * (f64::from(at) + 0.5) / f64::from(cells) - 1.0);
            let at = DVec3::new(x + across(cell % cells), y + across(cell / cells), 1.0);
            let length = at.length();
            let own = (2.0 * half / f64::from(cells)).powi(2) / length.powi(3);
            solid += own;
            projected += own / length;
            directions += own * at / length;
        }
        let strength = luminance / position_index(directions.normalize());
        let background = 0.25 * strength * strength * solid / 10f64.powf(rated / 8.0);
        // The rest of the image gives the illuminance of the background.
        let rest = background * PI / (PI - projected);
        let image = panel_image(&samples, DVec3::new(x, y, 1.0), half, [luminance, rest]);
        let found = Glare::new(&image, &SourceSearch::default());
        let ugr = found.ugr.unwrap();
        println!("panel of {solid:.5} sr before {background:.1} cd/m2: UGR {ugr:.3}");
        assert!((ugr - rated).abs() < 0.1, "{x} {y} {half}: {ugr}, not {rated}");
    }
}

#[test]
fn distant_parts_are_sources_of_their_own_and_near_ones_join() {
    let at = |degrees: f64| {
        let (sin, cos) = degrees.to_radians().sin_cos();
        DVec3::new(sin, 0.0, cos)
    };
    let lit = |w: DVec3| [at(-30.0), at(10.0), at(16.0)].iter().any(|c| w.dot(*c) > 0.9995);
    let own = image(FisheyeProjection::Equisolid, |w| if lit(w) { 1e4 } else { 50.0 });
    let count = |search| Glare::new(&own, &search).sources.len();
    assert_eq!(count(SourceSearch::default()), 2);
    assert_eq!(count(SourceSearch { angle: 0.05, ..SourceSearch::default() }), 3);
    assert_eq!(count(SourceSearch { threshold: 2e4, ..SourceSearch::default() }), 0);
}

#[test]
fn position_index_grows_away_from_the_view_direction() {
    let at = |up: f64, right: f64| position_index(DVec3::new(right, up, 1.0).normalize());
    assert!((at(0.0, 0.0) - 1.0).abs() < 1e-9);
    assert!(at(0.3, 0.0) < at(0.6, 0.0) && at(0.0, 0.3) < at(0.0, 0.6));
    // beta = atan(0.5 sqrt(1.3225)) = 29.899 degrees
    let below = (6.49e-3 * 29.899 + 21e-5 * 29.899f64.powi(2)).exp();
    assert!((at(-0.5, 0.0) - below).abs() < 1e-4, "{}", at(-0.5, 0.0));
    assert!(at(5.0, 0.0) <= MAX_INDEX);
}

/// The spread of the ratings of images with noise is that of the uncertainties.
#[test]
fn uncertainties_are_those_of_many_noisy_images() {
    let source = DVec3::new(0.3, 0.2, 0.9).normalize();
    let clean = |w: DVec3| if w.dot(source) > 0.995 { 9000.0 } else { 300.0 };
    let side = 120;
    let own = LuminanceImage::new(
        (side, side),
        &vec![Rgb::ZERO; (side * side) as usize],
        FisheyeProjection::Equidistant,
        PI,
    );
    let relative = 0.2;
    let mut rng = StreamKey::new(3, Stream::Test, 0).rng(0);
    let mut normal = || (0..12).map(|_| f64::from(rng.next_1d())).sum::<f64>() - 6.0;
    let mut noisy = || {
        let mut image = own.clone();
        let mut variances = Vec::new();
        for (direction, _, value) in &mut image.pixels {
            let expected = clean(*direction);
            *value = expected * (1.0 + relative * normal());
            variances.push((relative * expected).powi(2));
        }
        image.noise = Noise::Independent(variances);
        Glare::new(&image, &SourceSearch::default())
    };
    let all: Vec<Glare> = (0..200).map(|_| noisy()).collect();
    let check = |values: Vec<f64>, expanded: f64| {
        let count = values.len() as f64;
        let mean = values.iter().sum::<f64>() / count;
        let squares = values.iter().map(|value| (value - mean).powi(2)).sum::<f64>();
        let spread = NORMAL_95 * (squares / (count - 1.0)).sqrt();
        // The standard deviation of 200 numbers is known to 5 %.
        assert!((expanded / spread - 1.0).abs() < 0.2, "{expanded} {spread}");
    };
    let first = all[0].expanded.unwrap();
    check(all.iter().map(|own| own.vertical_illuminance).collect(), first.vertical_illuminance);
    check(all.iter().map(|own| own.dgp).collect(), first.dgp);
    check(all.iter().map(|own| own.ugr.unwrap()).collect(), first.ugr.unwrap());
    assert!(Glare::new(&own, &SourceSearch::default()).expanded.is_none());
}

/// Intervals of the mean of images whose pixels share photons hold the rating without noise as
/// often as they state. An image alone has no interval.
#[test]
fn spread_of_repeated_images_gives_intervals_that_hold() {
    let source = DVec3::new(0.3, 0.2, 0.9).normalize();
    let clean = |w: &DVec3| if w.dot(source) > 0.97 { 9000.0 } else { 300.0 };
    let side = 60;
    let black = vec![Rgb::ZERO; (side * side) as usize];
    let empty = LuminanceImage::new((side, side), &black, FisheyeProjection::Equidistant, PI);
    let mut rng = StreamKey::new(4, Stream::Test, 0).rng(0);
    let mut normal = || (0..12).map(|_| f64::from(rng.next_1d())).sum::<f64>() - 6.0;
    let with_luminances = |values: Vec<f64>| {
        let mut image = empty.clone();
        image.pixels.iter_mut().zip(values).for_each(|((_, _, own), value)| *own = value);
        image
    };
    let rate = |images: Vec<Vec<f64>>| {
        let images: Vec<LuminanceImage> = images.into_iter().map(with_luminances).collect();
        Glare::new(&LuminanceImage::mean_of(&images), &SourceSearch::default())
    };
    let exact: Vec<f64> = empty.pixels.iter().map(|(w, ..)| clean(w)).collect();
    let truth = rate(vec![exact.clone()]);
    assert!(truth.expanded.is_none());
    let (runs, images) = (300, 4);
    let mut held = [0; 3];
    for _ in 0..runs {
        let mut image = |_| {
            // Photons that all pixels of a half of the image share, and noise of each pixel
            let shared = [0.05 * normal(), 0.05 * normal()];
            let noisy = |(number, value): (usize, &f64)| {
                value * (1.0 + shared[number * 2 / exact.len()] + 0.1 * normal())
            };
            exact.iter().enumerate().map(noisy).collect()
        };
        let own = rate((0..images).map(&mut image).collect());
        let expanded = own.expanded.unwrap();
        let pairs = [
            (own.vertical_illuminance - truth.vertical_illuminance, expanded.vertical_illuminance),
            (own.dgp - truth.dgp, expanded.dgp),
            (own.ugr.unwrap() - truth.ugr.unwrap(), expanded.ugr.unwrap()),
        ];
        held.iter_mut()
            .zip(pairs)
            .for_each(|(held, (off, own))| *held += u32::from(off.abs() <= own));
    }
    // 95 % of 300 runs have a standard deviation of 1.3 %.
    let shares = held.map(|held| f64::from(held) / f64::from(runs));
    assert!(shares.iter().all(|share| (share - 0.95).abs() < 0.05), "{shares:?}");
}
