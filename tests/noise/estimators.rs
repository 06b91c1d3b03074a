//! The coefficients against their definitions and against ensembles with known `a`, `b`, `f`.

use crate::common::Estimate;
use bdpm::base::rng::{Rng, Stream, StreamKey};
use bdpm::noise::halves::Halves;
use bdpm::noise::pairs::AllPairs;
use bdpm::noise::{Coefficients, Estimator};

/// The merged light `i[path of light][path of camera]` and the direct light of one iteration.
struct Pairs {
    i: Vec<Vec<f64>>,
    d: Vec<f64>,
}

impl Pairs {
    fn counts(&self) -> (usize, usize) {
        (self.i.len(), self.d.len())
    }

    fn estimate(&self, estimator: &mut impl Estimator) -> Coefficients {
        let (n_light, n_camera) = self.counts();
        estimator.start_pixel();
        for j in 0..n_camera {
            for (path, row) in self.i.iter().enumerate() {
                if row[j] != 0.0 {
                    // In two parts, as two photons of one light path.
                    estimator.pair(path as u32, 0.25 * row[j]);
                    estimator.pair(path as u32, 0.75 * row[j]);
                }
            }
            estimator.end_path(self.d[j], n_light as u32);
        }
        estimator.finish_pixel(n_light as u32, n_camera as u32)
    }

    fn c(&self, i: usize, j: usize) -> f64 {
        self.i[i][j] + self.d[j]
    }

    /// `a`, `b`, `f` from C2, B, F and L^2 as means over distinct paths, term by term.
    /// theory.md (52), (53).
    fn by_definition(&self) -> Coefficients {
        let (n, m) = self.counts();
        let (mut c2, mut b, mut f, mut l2) = (0.0, 0.0, 0.0, 0.0);
        for i in 0..n {
            for j in 0..m {
                for k in 0..n {
                    for l in 0..m {
                        let product = self.c(i, j) * self.c(k, l);
                        match (i == k, j == l) {
                            (true, true) => c2 += product,
                            (false, true) => b += product,
                            (true, false) => f += product,
                            (false, false) => l2 += product,
                        }
                    }
                }
            }
        }
        let (n, m) = (n as f64, m as f64);
        let (c2, b) = (c2 / (n * m), b / (n * (n - 1.0) * m));
        let (f, l2) = (f / (n * m * (m - 1.0)), l2 / (n * (n - 1.0) * m * (m - 1.0)));
        Coefficients { a: c2 - b - f + l2, b: b - l2, f: f - l2 }
    }

    /// The paper's sums over halves as Section 3 writes them, without Section 4's expansion.
    /// theory.md (58) to (61).
    fn by_halves(&self) -> Coefficients {
        let (n, m) = self.counts();
        let half = |count: usize, parity: usize| (parity..count).step_by(2).collect::<Vec<_>>();
        let (lights, cameras) = ([half(n, 0), half(n, 1)], [half(m, 0), half(m, 1)]);
        let mean = |lights: &[usize], cameras: &[usize]| {
            let sum: f64 =
                lights.iter().flat_map(|&i| cameras.iter().map(move |&j| self.c(i, j))).sum();
            sum / (lights.len() * cameras.len()) as f64
        };
        let (mut c2, mut b, mut f) = (0.0, 0.0, 0.0);
        for i in 0..n {
            c2 += (0..m).map(|j| self.c(i, j).powi(2)).sum::<f64>() / (n * m) as f64;
            f += mean(&[i], &cameras[0]) * mean(&[i], &cameras[1]) / n as f64;
        }
        for j in 0..m {
            b += mean(&lights[0], &[j]) * mean(&lights[1], &[j]) / m as f64;
        }
        let l2 = 0.5
            * (mean(&lights[0], &cameras[0]) * mean(&lights[1], &cameras[1])
                + mean(&lights[0], &cameras[1]) * mean(&lights[1], &cameras[0]));
        Coefficients { a: c2 - b - f + l2, b: b - l2, f: f - l2 }
    }
}

#[track_caller]
fn assert_same(x: Coefficients, y: Coefficients, scale: f64) {
    let difference = x - y;
    for d in [difference.a, difference.b, difference.f] {
        assert!(d.abs() < 1e-11 * scale, "{x:?} {y:?}");
    }
}

/// A sparse ensemble as in a renderer: most pairs do not meet.
fn sparse(rng: &mut Rng, n: usize, m: usize) -> Pairs {
    let mut value = || {
        let u = f64::from(rng.next_1d());
        if u < 0.7 { 0.0 } else { u }
    };
    let i = (0..n).map(|_| (0..m).map(|_| value()).collect()).collect();
    Pairs { i, d: (0..m).map(|_| value()).collect() }
}

#[test]
fn both_estimators_match_their_definitions() {
    let mut rng = StreamKey::new(1, Stream::Test, 0).rng(0);
    let (mut pairs, mut halves) = (AllPairs::default(), Halves::default());
    for (n, m) in [(2, 2), (3, 2), (2, 5), (7, 4), (12, 9)] {
        for _ in 0..20 {
            let sample = sparse(&mut rng, n, m);
            assert_same(sample.estimate(&mut pairs), sample.by_definition(), 1.0);
            assert_same(sample.estimate(&mut halves), sample.by_halves(), 1.0);
        }
    }
}

/// `I = mean + f x_i + b y_j + a x_i y_j` with independent centered uniform `x`, `y` of unit
/// variance, and `D = d (1 + y_j)`: the coefficients are `a^2`, `(b + d)^2`, `f^2`.
struct Ensemble {
    mean: f64,
    root: Coefficients,
    d: f64,
}

impl Ensemble {
    fn truth(&self) -> Coefficients {
        let Coefficients { a, b, f } = self.root;
        Coefficients { a: a * a, b: (b + self.d).powi(2), f: f * f }
    }

    fn draw(&self, rng: &mut Rng, n: usize, m: usize) -> Pairs {
        let mut unit = || 12_f64.sqrt() * (f64::from(rng.next_1d()) - 0.5);
        let x: Vec<f64> = (0..n).map(|_| unit()).collect();
        let y: Vec<f64> = (0..m).map(|_| unit()).collect();
        let Coefficients { a, b, f } = self.root;
        let pair = |x: f64, y: f64| self.mean + f * x + b * y + a * x * y;
        Pairs {
            i: x.iter().map(|&x| y.iter().map(|&y| pair(x, y)).collect()).collect(),
            d: y.iter().map(|&y| self.d * (1.0 + y)).collect(),
        }
    }

    /// Estimates of a, b, f over many iterations.
    fn estimates<E: Estimator>(&self, n: usize, m: usize, iterations: u64) -> [Estimate; 3] {
        let mut estimator = E::default();
        let mut samples: [Vec<f64>; 3] = Default::default();
        for iteration in 0..iterations {
            let mut rng = StreamKey::new(2, Stream::Test, iteration).rng(0);
            let Coefficients { a, b, f } = self.draw(&mut rng, n, m).estimate(&mut estimator);
            samples.iter_mut().zip([a, b, f]).for_each(|(list, x)| list.push(x));
        }
        samples.map(|list| Estimate::from_samples(&list))
    }
}

#[track_caller]
fn assert_unbiased(estimates: [Estimate; 3], truth: Coefficients) {
    for (estimate, truth) in estimates.iter().zip([truth.a, truth.b, truth.f]) {
        let Estimate { mean, error } = *estimate;
        assert!((mean - truth).abs() < 4.0 * error + 1e-9, "{mean} +- {error}, not {truth}");
    }
}

#[test]
fn both_estimators_are_unbiased_at_any_counts() {
    let ensembles = [
        Ensemble { mean: 1.0, root: Coefficients { a: 2.0, b: 0.7, f: 0.3 }, d: 0.0 },
        Ensemble { mean: 1.0, root: Coefficients { a: 0.5, b: 0.1, f: 1.5 }, d: 5.0 },
        Ensemble { mean: 3.0, root: Coefficients { a: 0.0, b: 1.0, f: 0.0 }, d: 0.5 },
    ];
    for ensemble in &ensembles {
        for (n, m) in [(2, 2), (3, 8), (20, 3), (16, 16)] {
            assert_unbiased(ensemble.estimates::<AllPairs>(n, m, 4000), ensemble.truth());
            assert_unbiased(ensemble.estimates::<Halves>(n, m, 4000), ensemble.truth());
        }
    }
}

#[test]
fn all_pairs_need_fewer_iterations_and_ignore_direct_light() {
    let root = Coefficients { a: 2.0, b: 0.5, f: 0.4 };
    let without = Ensemble { mean: 1.0, root, d: 0.01 };
    let with = Ensemble { mean: 1.0, root, d: 10.0 };
    let (n, m) = (24, 10);
    let pairs = [&without, &with].map(|e| e.estimates::<AllPairs>(n, m, 3000));
    let halves = [&without, &with].map(|e| e.estimates::<Halves>(n, m, 3000));
    let ratio = |k: usize, c: usize| (halves[k][c].error / pairs[k][c].error).powi(2);
    for (k, d) in [(0, 0.01), (1, 10.0)] {
        println!(
            "variance of the halves over that of all pairs, D = {d}: a {:.2}, b {:.2}, f {:.2}",
            ratio(k, 0),
            ratio(k, 1),
            ratio(k, 2)
        );
        assert!(ratio(k, 0) > 1.0 && ratio(k, 2) > 1.0);
    }
    // FixedArray the same a and f though D is 1000 times as strong (b is (0.5 + D)^2).
    for c in [0, 2] {
        assert_eq!(pairs[0][c].mean, pairs[1][c].mean);
        assert_eq!(pairs[0][c].error, pairs[1][c].error);
    }
}

#[test]
fn a_large_constant_does_not_spoil_the_sample_variance() {
    let root = Coefficients { a: 0.0, b: 1e-3, f: 0.0 };
    let ensemble = Ensemble { mean: 0.0, root, d: 0.0 };
    let mut rng = StreamKey::new(4, Stream::Test, 0).rng(0);
    let mut sample = ensemble.draw(&mut rng, 3, 50);
    let before = sample.estimate(&mut AllPairs::default());
    sample.d.iter_mut().for_each(|d| *d += 1e5);
    let after = sample.estimate(&mut AllPairs::default());
    // 1e5 has 1.5e-11 between doubles: deviations of 1e-3 keep 8 digits.
    assert!((after.b / before.b - 1.0).abs() < 1e-6, "{} {}", after.b, before.b);
    assert_eq!((after.a, after.f), (before.a, before.f));
}
