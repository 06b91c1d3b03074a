//! Peaks and opening angles of distributions with known noise.

use super::*;
use bdpm_core::base::rng::{Rng, Stream, StreamKey};
use std::f64::consts::{PI, TAU};

const ROWS: usize = 37;
const PLANES: usize = 24;

fn normal(rng: &mut Rng) -> f64 {
    (0..12).map(|_| f64::from(rng.next_1d())).sum::<f64>() - 6.0
}

/// Mean of a distribution over gamma, in degrees, over the hat functions of a row.
fn over_row(row: usize, of: impl Fn(f64) -> f64) -> f64 {
    let step = 180.0 / (ROWS - 1) as f64;
    let (mut sum, mut weights) = (0.0, 0.0);
    for sample in 0..100 {
        let off = (f64::from(sample) + 0.5) / 50.0 - 1.0;
        let gamma = step * (row as f64 + off);
        let weight = (1.0 - off.abs()) * gamma.to_radians().sin();
        // Beyond the poles the sine is negative.
        if weight > 0.0 && gamma < 180.0 {
            sum += weight * of(gamma);
            weights += weight;
        }
    }
    sum / weights
}

/// Groups of a distribution over gamma, in degrees, with the noise of nodes of their solid
/// angles: `noise` of the greatest intensity at a node of a whole step.
fn groups(rng: &mut Rng, noise: f64, of: impl Fn(f64) -> f64) -> GroupedIntensities {
    let exact: Vec<f64> = (0..ROWS).map(|row| over_row(row, &of)).collect();
    let group = |rng: &mut Rng| {
        let mut values = Vec::new();
        for (row, exact) in exact.iter().enumerate() {
            let gamma = 180.0 * row as f64 / (ROWS - 1) as f64;
            let is_pole = row == 0 || row == ROWS - 1;
            let mut pole = None;
            for _ in 0..PLANES {
                let solid = if is_pole { 0.35 } else { gamma.to_radians().sin() };
                let own = exact + noise * (exact / solid).sqrt() * normal(rng);
                // All nodes of a pole are one direction.
                values.push(if is_pole { *pole.get_or_insert(own) } else { own });
            }
        }
        Group { weight: 3.0, values }
    };
    let groups = (0..8).map(|_| group(rng)).collect();
    GroupedIntensities::new(PLANES, groups)
}

fn lambertian(gamma: f64) -> f64 {
    gamma.to_radians().cos().max(0.0)
}

#[test]
fn noise_free_angles_are_those_of_powers_of_the_cosine() {
    let mut rng = StreamKey::new(1, Stream::Test, 0).rng(0);
    // Nodes are means over a step of 5 degrees.
    for (power, tolerance) in [(1.0, 0.2), (4.0, 0.7)] {
        let own = groups(&mut rng, 0.0, |gamma| lambertian(gamma).powf(power));
        assert!((own.peak().value - 1.0).abs() < 1e-3 * power, "{:?}", own.peak());
        for share in [0.5f64, 0.1] {
            let expected = 2.0 * share.powf(1.0 / power).acos().to_degrees();
            let found = own.opening_angle(45.0, share).unwrap();
            assert!((found.value - expected).abs() < tolerance, "{found:?} {expected}");
            assert!(found.error < 1e-9);
        }
    }
    assert_eq!(groups(&mut rng, 0.0, |_| 1.0).opening_angle(0.0, 0.5), None);
    assert_eq!(groups(&mut rng, 0.0, |_| 0.0).opening_angle(0.0, 0.5), None);
    // Upward, around the zenith
    let up = groups(&mut rng, 0.0, |gamma| lambertian(180.0 - gamma));
    assert!((up.opening_angle(0.0, 0.5).unwrap().value - 120.0).abs() < 0.2);
}

#[test]
fn noisy_lambertian_reads_its_peak_and_120_degrees_within_standard_errors() {
    let mut rng = StreamKey::new(2, Stream::Test, 0).rng(0);
    let runs = 200;
    let (mut angles, mut peaks, mut within) = (Vec::new(), Vec::new(), [0; 2]);
    for _ in 0..runs {
        // 1 % of noise at the equator, 5 % at the nodes of 5 degrees
        let own = groups(&mut rng, 0.03, lambertian);
        let (peak, angle) = (own.peak(), own.opening_angle(0.0, 0.5).unwrap());
        within[0] += u32::from((peak.value - 1.0).abs() < 2.5 * peak.error);
        within[1] += u32::from((angle.value - 120.0).abs() < 2.5 * angle.error);
        angles.push(angle.value);
        peaks.push(peak.value);
    }
    let mean = |values: &[f64]| values.iter().sum::<f64>() / f64::from(runs);
    let spread = |values: &[f64]| {
        let mean = mean(values);
        let squares = values.iter().map(|own| (own - mean).powi(2)).sum::<f64>();
        (squares / f64::from(runs - 1)).sqrt()
    };
    // The plain maximum is over two standard deviations too high.
    assert!((mean(&peaks) - 1.0).abs() < spread(&peaks), "{} {}", mean(&peaks), spread(&peaks));
    let off = mean(&angles) - 120.0;
    assert!(off.abs() < 0.5 * spread(&angles) + 0.1, "{off} {}", spread(&angles));
    // 2.5 standard errors of eight groups hold for 96 %.
    assert!(within.iter().all(|count| *count >= 180), "{within:?}");
}

#[test]
fn falls_are_those_of_the_fit_that_does_not_rise() {
    assert_eq!(fall(&[4.0, 3.0, 1.0], 2.0), Some(1.5));
    // The second and third value have the mean 3.
    assert_eq!(fall(&[4.0, 2.0, 4.0, 1.0], 2.0), Some(2.25));
    assert_eq!(fall(&[1.0, 0.0], 2.0), None);
    assert_eq!(fall(&[3.0, 2.5], 2.0), None);
}

/// Groups of a Lambertian lamp toward the nadir of this peak, by as many paths as each has. All
/// paths carry the same flux, and add to the nodes around them by their hat functions.
fn measured_lambertian(rng: &mut Rng, peak: f64, paths: u32) -> GroupedIntensities {
    let grid = Nodes::new(ROWS, PLANES);
    let [step, c_step] = [PI / (ROWS - 1) as f64, TAU / PLANES as f64];
    let flux = PI * peak / f64::from(paths);
    let group = |rng: &mut Rng| {
        let mut values = vec![0.0; ROWS * PLANES];
        for _ in 0..paths {
            let [u, v] = rng.next_2d().map(f64::from);
            let (row, column) = (u.sqrt().asin() / step, TAU * v / c_step);
            let (low, part) = (row.floor() as usize, row.fract());
            let (left, part_c) = (column.floor() as usize, column.fract());
            for (row, by_row) in [(low, 1.0 - part), (low + 1, part)] {
                for (plane, by_plane) in [(left, 1.0 - part_c), (left + 1, part_c)] {
                    // Poles are one node, their first.
                    let plane = if row == 0 || row == ROWS - 1 { 0 } else { plane % PLANES };
                    values[row * PLANES + plane] += flux * by_row * by_plane;
                }
            }
        }
        for (node, value) in values.iter_mut().enumerate() {
            *value /= grid.solid_angle(node);
        }
        for row in [0, ROWS - 1] {
            let pole = values[row * PLANES];
            values[row * PLANES..][..PLANES].fill(pole);
        }
        Group { weight: 1.0, values }
    };
    GroupedIntensities::new(PLANES, (0..8).map(|_| group(rng)).collect())
}

#[test]
fn measured_lambertian_reads_1800_and_120_degrees_within_stated_uncertainties() {
    // Quantile of 95 % of Student's distribution for eight groups
    const EXPANDED: f64 = 2.365;
    let mut rng = StreamKey::new(7, Stream::Test, 0).rng(0);
    let (runs, peak) = (60, 1800.0);
    let mut held = [0; 3];
    let mut off = Vec::new();
    for _ in 0..runs {
        let own = measured_lambertian(&mut rng, peak, 50_000);
        let found = [
            own.peak(),
            own.opening_angle(0.0, 0.5).unwrap(),
            own.opening_angle(90.0, 0.5).unwrap(),
        ];
        for ((held, found), expected) in held.iter_mut().zip(found).zip([peak, 120.0, 120.0]) {
            *held += u32::from((found.value - expected).abs() <= EXPANDED * found.error);
        }
        off.push(found[0].value / peak - 1.0);
        let row = own.peak_node() / PLANES;
        assert!(row <= 4, "the peak is {} degrees off", 5 * row);
    }
    let mean = off.iter().sum::<f64>() / f64::from(runs);
    let square = off.iter().map(|own| own * own).sum::<f64>() / f64::from(runs);
    println!("held {held:?} of {runs}; peaks off by {mean:.5}, rms {:.5}", square.sqrt());
    // 95 % of 60 runs have a standard deviation of 2.8 %.
    assert!(held.iter().all(|held| *held >= 51), "{held:?} of {runs}");
    // The brightest node alone is 5 % too high, and a node next to the nadir scatters by 6 %.
    assert!(mean.abs() < 0.01 && square.sqrt() < 0.03, "{mean} {square}");
}

/// Narrow beams are no polynomial within two steps: they are read at their nodes.
#[test]
fn narrow_beams_are_not_smoothed() {
    let mut rng = StreamKey::new(8, Stream::Test, 0).rng(0);
    let own = groups(&mut rng, 1e-4, |gamma| (-(gamma / 4.0).powi(2)).exp());
    let (peak, mean) = (own.peak(), over_row(0, |gamma| (-(gamma / 4.0).powi(2)).exp()));
    assert!((peak.value - mean).abs() < 4.0 * peak.error + 1e-3, "{peak:?} {mean}");
}
