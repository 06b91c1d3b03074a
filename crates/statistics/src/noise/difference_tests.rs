use super::*;
use bdpm_base::rng::{Rng, Stream, StreamKey};

const CELLS: Cells = Cells { width: 64, height: 48, side: 2 };

/// A normal variable with mean 0 and variance 1.
fn normal(rng: &mut Rng) -> f64 {
    let [u, v] = rng.next_2d().map(f64::from);
    (-2.0 * (1.0 - u).ln()).sqrt() * (std::f64::consts::TAU * v).cos()
}

/// Luminance of a cell: a gradient with a dark band.
fn luminance(cell: usize) -> f64 {
    let (x, y) = (cell % 64, cell / 64);
    (0.5 + x as f64 / 64.0) * if (20..24).contains(&y) { 0.05 } else { 1.0 }
}

/// Noise of the image, of the other estimate, and side of the squares of cells that share the noise
/// of the image.
#[derive(Clone, Copy)]
struct Noise {
    image: f64,
    audit: f64,
    shared: usize,
}

const NOISE: Noise = Noise { image: 0.05, audit: 0.5, shared: 1 };

struct Example {
    image: [Vec<f64>; 2],
    audit: [Vec<f64>; 2],
    variance: Vec<f64>,
    image_variance: Vec<f64>,
}

impl Example {
    /// `factor` is the fault of the image in a cell.
    fn new(run: u64, noise: Noise, factor: impl Fn(usize, usize) -> f64) -> Self {
        let mut rng = StreamKey::new(run, Stream::Test, 7).rng(0);
        let count = CELLS.len();
        let mut image = || {
            let all: Vec<f64> = (0..count).map(|_| normal(&mut rng)).collect();
            let value = |cell: usize| {
                let (x, y) = (cell % 64, cell / 64);
                let own = all[y / noise.shared * 64 + x / noise.shared];
                luminance(cell) * (factor(x, y) + noise.image * own)
            };
            (0..count).map(value).collect::<Vec<f64>>()
        };
        let image = [image(), image()];
        let mut audit = || {
            let value = |cell: usize| luminance(cell) * (1.0 + noise.audit * normal(&mut rng));
            (0..count).map(value).collect::<Vec<f64>>()
        };
        let audit = [audit(), audit()];
        let variance = |noise: f64| (0..count).map(move |cell| (noise * luminance(cell)).powi(2));
        let (of_audit, of_image) = (variance(noise.audit), variance(noise.image));
        Self { image, audit, variance: of_audit.collect(), image_variance: of_image.collect() }
    }

    fn halves(&self) -> Estimates<'_> {
        Estimates {
            cells: CELLS,
            image: Compared::Halves([&self.image[0], &self.image[1]]),
            audit: [&self.audit[0], &self.audit[1]],
            audit_variance: &self.variance,
            common: None,
            tolerance: None,
        }
    }

    fn single(&self) -> Estimates<'_> {
        let image = Compared::Single(&self.image[0], &self.image_variance);
        Estimates { image, ..self.halves() }
    }
}

/// Mean of values, and the standard error of it.
fn mean(values: &[f64]) -> (f64, f64) {
    let n = values.len() as f64;
    let mean = values.iter().sum::<f64>() / n;
    let square = values.iter().map(|own| (own - mean).powi(2)).sum::<f64>();
    (mean, (square / (n * (n - 1.0))).sqrt())
}

const RUNS: u64 = 300;

/// Differences of all runs at each scale have the expectation `expected`, and stated errors of the
/// scatter of all runs.
fn check(noise: Noise, is_single: bool, fault: f64) {
    let differences: Vec<Difference> = (0..RUNS)
        .map(|run| {
            let example = Example::new(run, noise, |_, _| 1.0 + fault);
            let own = if is_single { example.single() } else { example.halves() };
            Difference::new(&own).unwrap()
        })
        .collect();
    for scale in 0..differences[0].scales.len() {
        let all: Vec<ScaleDifference> = differences.iter().map(|own| own.scales[scale]).collect();
        let squares: Vec<f64> = all.iter().map(|own| own.square).collect();
        let (square, error) = mean(&squares);
        let side = all[0].side;
        // The weights are those of the mean luminance and a hundredth of the square of the mean of
        // all.
        let expected = fault * fault * mean_weight(side);
        // The weights share some noise with the differences.
        let allowed = 4.5 * error + 0.1 * expected;
        assert!((square - expected).abs() < allowed, "{side}: {square} {expected} {error}");
        if fault == 0.0 {
            let stated = all.iter().map(|own| own.error.powi(2)).sum::<f64>() / RUNS as f64;
            let scatter = error * (RUNS as f64).sqrt();
            assert!(stated.sqrt() > 0.9 * scatter, "{side}: {} {scatter}", stated.sqrt());
        }
    }
}

/// Mean over tiles of the squared luminance times its weight, both known without noise.
fn mean_weight(side: u32) -> f64 {
    let noiseless = Noise { image: 0.0, audit: 0.0, shared: 1 };
    // A fault of 1 of an image without noise; the weights follow the mean of both.
    let example = Example::new(0, noiseless, |_, _| 1.0);
    let (weights, own) = example.halves().weights();
    let tiles = example.halves().tiles(side / CELLS.side, &weights, &own);
    let squares = tiles.iter().map(|tile| tile.weight * tile.luminance.powi(2));
    squares.sum::<f64>() / tiles.len() as f64
}

#[test]
fn squares_of_equal_estimates_have_mean_zero_and_their_stated_errors() {
    check(NOISE, false, 0.0);
    check(NOISE, true, 0.0);
    check(Noise { image: 0.3, audit: 0.3, shared: 4 }, false, 0.0);
}

#[test]
fn squares_of_a_fault_are_unbiased_whatever_the_noise() {
    check(Noise { image: 0.1, audit: 0.2, shared: 2 }, false, 0.03);
    check(Noise { image: 0.1, audit: 0.2, shared: 1 }, true, 0.03);
}

/// A bright path stays in one half, a fault is in both.
#[test]
fn a_bright_path_in_one_half_is_no_region_and_a_fault_is() {
    let regions = |faulty: [bool; 2]| {
        let mut example = Example::new(1, NOISE, |_, _| 1.0);
        for (image, _) in example.image.iter_mut().zip(faulty).filter(|(_, is)| *is) {
            image[10 * 64 + 32] += 100.0;
        }
        Difference::new(&example.halves()).unwrap().regions(0.01).len()
    };
    assert_eq!([[false, false], [true, false], [true, true]].map(regions), [0, 0, 1]);
}

#[test]
fn equal_estimates_are_hardly_ever_significant_and_a_leak_is() {
    let alarms = |fault: f64| {
        let run = |run: u64| {
            let own = Example::new(run, NOISE, |_, _| 1.0 + fault);
            Difference::new(&own.halves()).unwrap().is_significant(0.01, 4)
        };
        (0..RUNS).filter(|own| run(*own)).count()
    };
    // At most 1 % over four looks, so that a single look has a fourth: one of 300 is expected.
    assert!(alarms(0.0) <= 5, "{}", alarms(0.0));
    assert_eq!(alarms(0.1), RUNS as usize);
}

#[test]
fn mean_ratio_is_within_its_errors() {
    for is_single in [false, true] {
        let scores: Vec<f64> = (0..RUNS)
            .map(|run| {
                let example = Example::new(run, NOISE, |_, _| 1.03);
                let own = if is_single { example.single() } else { example.halves() };
                let mean = Difference::new(&own).unwrap().mean.unwrap();
                (mean.ratio - 1.03) / mean.error
            })
            .collect();
        let (score, error) = mean(&scores);
        let deviation = error * (RUNS as f64).sqrt();
        assert!(
            score.abs() < 4.0 * error && (0.8..1.15).contains(&deviation),
            "{score} {deviation}"
        );
    }
}

#[test]
fn a_leak_in_a_rectangle_is_a_region() {
    let is_inside = |x: usize, y: usize| (16..40).contains(&x) && (32..40).contains(&y);
    let example = Example::new(3, NOISE, |x, y| if is_inside(x, y) { 1.5 } else { 1.0 });
    let difference = Difference::new(&example.halves()).unwrap();
    assert!(difference.is_significant(1e-4, 4));
    let regions = difference.regions(1e-4);
    assert_eq!(regions.len(), 1, "{regions:?}");
    assert_eq!(regions[0].pixels, [32, 64, 80, 80]);
    assert!((regions[0].ratio - 1.5).abs() < 0.2, "{}", regions[0].ratio);
    // Luminance of the excess: half of the rectangle, which covers a sixteenth of the image.
    let expected = (16..40).map(|x| 0.5 * luminance(x)).sum::<f64>() * 8.0 / CELLS.len() as f64;
    // Some tiles without a leak score 2 by their noise.
    let ratio = difference.excess() / expected;
    assert!((0.9..1.4).contains(&ratio), "{ratio}");
}

#[test]
fn a_tolerated_difference_is_not_significant() {
    let example = Example::new(5, NOISE, |_, _| 1.1);
    let tolerance: Vec<f64> = (0..CELLS.len()).map(|cell| 0.12 * luminance(cell)).collect();
    let own = Estimates { tolerance: Some(&tolerance), ..example.halves() };
    let difference = Difference::new(&own).unwrap();
    assert!(!difference.is_significant(0.05, 1) && difference.regions(0.05).is_empty());
    assert!(difference.mean_score() < 2.0, "{}", difference.mean_score());
    assert!(Difference::new(&example.halves()).unwrap().is_significant(0.01, 4));
}

#[test]
fn tiny_images_are_not_compared() {
    let own = [1.0; 9];
    let estimates = Estimates {
        cells: Cells { width: 3, height: 3, side: 2 },
        image: Compared::Halves([&own; 2]),
        audit: [&own; 2],
        audit_variance: &own,
        common: None,
        tolerance: None,
    };
    assert_eq!(Difference::new(&estimates), None);
}

/// Half of the light is that of a lamp that hardly any path hits. Hits balance the light that other
/// paths lack, so that no difference is known. Without hits the image is known to be brighter.
#[test]
fn rare_hits_are_no_light_that_the_image_lacks() {
    let prob = 0.0003;
    let mut with_hits = 0;
    for run in 0..RUNS {
        let mut own = Example::new(run, NOISE, |_, _| 1.0);
        let mut rng = StreamKey::new(run, Stream::Test, 8).rng(0);
        let hit = |cell: usize| 0.5 / prob * luminance(cell);
        let mut hits = 0;
        for cell in 0..CELLS.len() {
            for half in &mut own.audit {
                half[cell] -= 0.5 * luminance(cell);
                if f64::from(rng.next_1d()) < prob {
                    half[cell] += hit(cell);
                    own.variance[cell] += 0.5 * hit(cell).powi(2);
                    hits += 1;
                }
            }
        }
        let difference = Difference::new(&own.halves()).unwrap();
        let is_significant = difference.is_significant(0.01, 4);
        let is_brighter = difference.is_brighter(difference.threshold(0.01, 4));
        assert!(!is_significant || is_brighter, "{run}: {hits} hits");
        assert!(hits > 0 || is_significant);
        with_hits += u32::from(hits > 1 && !is_significant);
    }
    // Most have more than one hit.
    assert!(with_hits > 80, "{with_hits}");
}

/// The image lacks a tenth of its light in the lower half, which many hits show. No tile with a
/// single hit scores -2, and some tiles score 2 by chance.
#[test]
fn light_that_is_lacking_by_the_mean_is_no_excess() {
    let prob = 0.02;
    let (mut brighter, mut by_tiles) = (0, 0);
    for run in 0..RUNS {
        let mut own = Example::new(run, NOISE, |_, _| 1.0);
        let mut rng = StreamKey::new(run, Stream::Test, 9).rng(0);
        for cell in CELLS.len() / 2..CELLS.len() {
            let hit = 0.2 / prob * luminance(cell);
            for half in &mut own.audit {
                if f64::from(rng.next_1d()) < prob {
                    half[cell] += hit;
                    own.variance[cell] += 0.5 * hit * hit;
                }
            }
        }
        let difference = Difference::new(&own.halves()).unwrap();
        brighter += u32::from(difference.is_brighter(difference.threshold(0.01, 4)));
        by_tiles += u32::from(difference.is_brighter(f64::INFINITY));
    }
    assert!(brighter < by_tiles / 10 && by_tiles > 30, "{brighter} {by_tiles}");
}
