//! Scrambled Sobol points: random numbers that fill a cube evenly, sixteen points side by side.
//!
//! The points are those of Sobol with the direction numbers of Joe and Kuo (2008). Owen's nested
//! uniform scrambling makes each of them uniform in the cube and keeps their even distribution. It
//! is done by hashing, after Burley, "Practical Hash-based Owen Scrambling" (2020), with the hash
//! of Vegdahl (2021). They are not from a crate, because they are made side by side here; a test
//! compares the points before scrambling with the definition.

use super::{LANES, Rngs};
use crate::rng::Rng;

/// Numbers of a point of a set.
pub const DIMENSIONS: usize = 5;

/// Numbers of a [`SobolPoint`].
pub const POINT_DIMENSIONS: usize = 9;

/// Maximum number of points of a set.
pub const MAX_POINTS: u32 = 1 << MAX_BITS;

const MAX_BITS: usize = 18;

/// Degree, coefficients and first direction numbers of the primitive polynomials of all dimensions
/// but the first.
const POLYNOMIALS: [(usize, u32, &[u32]); POINT_DIMENSIONS - 1] = [
    (1, 0, &[1]),
    (2, 1, &[1, 3]),
    (3, 1, &[1, 3, 1]),
    (3, 2, &[1, 1, 1]),
    (4, 1, &[1, 1, 3, 3]),
    (4, 4, &[1, 3, 5, 13]),
    (5, 2, &[1, 1, 5, 5, 17]),
    (5, 4, &[1, 1, 5, 5, 5]),
];

/// Direction numbers with their bits in reverse: the highest digit of a number in [0, 1) is bit 0.
const DIRECTIONS: [[u32; MAX_BITS]; POINT_DIMENSIONS] = directions();

/// The first sixteen points, in reverse.
const FIRST: [[u32; LANES]; DIMENSIONS] = first_points();

const fn directions() -> [[u32; MAX_BITS]; POINT_DIMENSIONS] {
    let mut all = [[0; MAX_BITS]; POINT_DIMENSIONS];
    let mut bit = 0;
    while bit < MAX_BITS {
        all[0][bit] = 1 << bit;
        bit += 1;
    }
    let mut dimension = 1;
    while dimension < POINT_DIMENSIONS {
        let (degree, coefficients, first) = POLYNOMIALS[dimension - 1];
        let mut m = [0; MAX_BITS];
        let mut k = 0;
        while k < MAX_BITS {
            if k < degree {
                m[k] = first[k];
            } else {
                m[k] = m[k - degree] ^ (m[k - degree] << degree);
                let mut i = 1;
                while i < degree {
                    if coefficients >> (degree - 1 - i) & 1 == 1 {
                        m[k] ^= m[k - i] << i;
                    }
                    i += 1;
                }
            }
            all[dimension][k] = (m[k] << (31 - k as u32)).reverse_bits();
            k += 1;
        }
        dimension += 1;
    }
    all
}

const fn first_points() -> [[u32; LANES]; DIMENSIONS] {
    let mut all = [[0; LANES]; DIMENSIONS];
    let mut dimension = 0;
    while dimension < DIMENSIONS {
        let mut lane = 0;
        while lane < LANES {
            all[dimension][lane] = reversed_sobol(dimension, lane as u32);
            lane += 1;
        }
        dimension += 1;
    }
    all
}

/// A number of the point with this index before scrambling, in reverse.
#[inline]
const fn reversed_sobol(dimension: usize, index: u32) -> u32 {
    let (mut word, mut bit) = (0, 0);
    while bit < MAX_BITS {
        if index >> bit & 1 == 1 {
            word ^= DIRECTIONS[dimension][bit];
        }
        bit += 1;
    }
    word
}

/// A set of Sobol points with a scrambling of its own.
#[derive(Clone, Copy, Debug)]
pub struct ScrambledSobol {
    /// Seed of the hash, and random bits that make each number exactly uniform, for each dimension.
    seeds: [[u32; 2]; DIMENSIONS],
}

impl ScrambledSobol {
    /// A set scrambled by the numbers of `rng`.
    #[inline]
    pub fn new(mut rng: Rng) -> Self {
        Self { seeds: [(); DIMENSIONS].map(|()| [rng.next_u32(), rng.next_u32()]) }
    }

    /// The points from `first`, a multiple of sixteen, less than [`MAX_POINTS`]: 32 random bits for
    /// each number.
    #[inline(always)] // part of the loop over light paths
    pub fn points(&self, first: u32) -> [[u32; LANES]; DIMENSIONS] {
        debug_assert!(first.is_multiple_of(LANES as u32) && first < MAX_POINTS);
        let mut points = FIRST;
        for (dimension, numbers) in points.iter_mut().enumerate() {
            let high = reversed_sobol(dimension, first);
            let [seed, shift] = self.seeds[dimension];
            for number in numbers {
                *number = (scrambled(*number ^ high, seed) ^ shift).reverse_bits();
            }
        }
        points
    }
}

/// The points with one index of many sets, each scrambled by itself.
#[derive(Clone, Copy, Debug)]
pub struct SobolPoint {
    /// The numbers before scrambling, in reverse.
    words: [u32; POINT_DIMENSIONS],
}

impl SobolPoint {
    /// The points with this index, less than [`MAX_POINTS`].
    #[inline]
    pub fn new(index: u32) -> Self {
        debug_assert!(index < MAX_POINTS);
        Self { words: std::array::from_fn(|dimension| reversed_sobol(dimension, index)) }
    }

    /// The points of sixteen sets, each scrambled by its generator: 32 random bits for each number.
    #[inline(always)] // part of the loop over camera paths
    pub fn scrambled(&self, rngs: &mut Rngs) -> [[u32; LANES]; POINT_DIMENSIONS] {
        let mut points = [[0; LANES]; POINT_DIMENSIONS];
        for (numbers, word) in points.iter_mut().zip(self.words) {
            let [seeds, shifts] = rngs.next_bits();
            for (lane, number) in numbers.iter_mut().enumerate() {
                *number = (scrambled(word, seeds[lane]) ^ shifts[lane]).reverse_bits();
            }
        }
        points
    }
}

/// Changes each bit depending on the bits below it alone, which are higher digits of the number.
#[inline(always)]
fn scrambled(mut bits: u32, seed: u32) -> u32 {
    bits ^= bits.wrapping_mul(0x3d20_adea);
    bits = bits.wrapping_add(seed);
    bits = bits.wrapping_mul((seed >> 16) | 1);
    bits ^= bits.wrapping_mul(0x0552_6c56);
    bits ^ bits.wrapping_mul(0x53a2_2864)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rng::{Stream, StreamKey};

    /// All points of a set of `size`, each number as 32 bits.
    fn set(index: u64, size: u32) -> Vec<[u32; DIMENSIONS]> {
        let set = ScrambledSobol::new(StreamKey::new(5, Stream::Test, 0).rng(index));
        let groups = (0..size).step_by(LANES).map(|first| set.points(first));
        groups.flat_map(|group| (0..LANES).map(move |lane| group.map(|side| side[lane]))).collect()
    }

    /// Tests whether each box of `across` by ... of these sides has one of as many points.
    fn is_even(points: &[[u32; DIMENSIONS]], sides: [usize; 2], bits: [u32; 2]) -> bool {
        let mut found = vec![false; points.len()];
        for point in points {
            let [x, y] = [0, 1].map(|i| (u64::from(point[sides[i]]) >> (32 - bits[i])) as usize);
            found[x << bits[1] | y] = true;
        }
        found.into_iter().all(|found| found)
    }

    #[test]
    fn scrambled_points_fill_all_boxes_that_sobol_points_fill() {
        for index in 0..20 {
            let points = set(index, 1024);
            // Each dimension alone is stratified, and the first two are a (0, 10, 2) net.
            for side in 0..DIMENSIONS {
                assert!(is_even(&points, [side, 0], [10, 0]), "{side}");
            }
            for x in 0..=10 {
                assert!(is_even(&points, [0, 1], [x, 10 - x]), "{x}");
            }
            // Nets of all pairs of dimensions have at most a small quality parameter t: boxes of
            // 2^t points.
            for (x, y) in [(1, 2), (2, 3), (3, 4), (0, 4)] {
                let coarse: Vec<_> = points[..256].to_vec();
                let mut count = [0; 16];
                for point in &coarse {
                    count[(point[x] >> 30 << 2 | point[y] >> 30) as usize] += 1;
                }
                assert!(count.iter().all(|&count| count == 16), "{x} {y}: {count:?}");
            }
        }
    }

    #[test]
    fn points_before_scrambling_are_those_of_sobol() {
        // Points by Joe and Kuo's generator, in the order of the binary index instead of Gray's
        // code. The last one has a bit of each polynomial's first numbers.
        let expected = [
            (0, [0.0; POINT_DIMENSIONS]),
            (1, [0.5; POINT_DIMENSIONS]),
            (2, [0.25, 0.75, 0.75, 0.75, 0.25, 0.25, 0.75, 0.25, 0.25]),
            (3, [0.75, 0.25, 0.25, 0.25, 0.75, 0.75, 0.25, 0.75, 0.75]),
            (4, [0.125, 0.625, 0.375, 0.125, 0.125, 0.375, 0.625, 0.625, 0.625]),
            (
                37,
                [
                    0.640_625, 0.921_875, 0.734_375, 0.828_125, 0.484_375, 0.765_625, 0.703_125,
                    0.015_625, 0.953_125,
                ],
            ),
        ];
        for (index, expected) in expected {
            let point: [f64; POINT_DIMENSIONS] = std::array::from_fn(|dimension| {
                f64::from(reversed_sobol(dimension, index).reverse_bits()) / f64::powi(2.0, 32)
            });
            assert_eq!(point, expected, "{index}");
        }
    }

    #[test]
    fn points_of_one_set_that_are_scrambled_one_by_one_fill_the_cube_evenly() {
        let key = StreamKey::new(7, Stream::Test, 0);
        let rngs = || {
            let mut rngs = Rngs::default();
            (0..LANES).for_each(|lane| rngs.set(lane, key.rng(lane as u64)));
            rngs
        };
        let points: Vec<_> =
            (0..64).map(|index| SobolPoint::new(index).scrambled(&mut rngs())).collect();
        for lane in 0..LANES {
            for side in 0..POINT_DIMENSIONS {
                let strata: u64 =
                    points.iter().fold(0, |found, point| found | 1 << (point[side][lane] >> 26));
                assert_eq!(strata, u64::MAX, "{side}");
            }
            // The first two numbers are a (0, 6, 2) net.
            for bits in 1..6 {
                let cell = |point: &[[u32; LANES]; POINT_DIMENSIONS]| {
                    (point[0][lane] >> (32 - bits)) << (6 - bits) | point[1][lane] >> (26 + bits)
                };
                let cells: u64 = points.iter().fold(0, |found, point| found | 1 << cell(point));
                assert_eq!(cells, u64::MAX, "{bits}");
            }
        }
        // Sets of different lanes differ.
        let first = points.iter().map(|point| point[0][0]).collect::<Vec<_>>();
        assert_ne!(first, points.iter().map(|point| point[0][1]).collect::<Vec<_>>());
    }

    #[test]
    fn each_point_is_uniform_and_points_of_different_sets_are_independent() {
        // Over many scramblings: mean and products between dimensions and between points of two
        // sets.
        let n = 20_000;
        let (mut means, mut products, mut between) = ([0.0; DIMENSIONS], [0.0; 4], 0.0);
        let centered = |bits: u32| f64::from(bits) / f64::powi(2.0, 32) - 0.5;
        let mut last = [0; DIMENSIONS];
        for index in 0..n {
            let points =
                ScrambledSobol::new(StreamKey::new(6, Stream::Test, 0).rng(index)).points(16);
            let point = points.map(|side| side[5]);
            for side in 0..DIMENSIONS {
                means[side] += centered(point[side]);
                if side > 0 {
                    products[side - 1] += centered(point[0]) * centered(point[side]);
                }
            }
            between += centered(point[0]) * centered(last[0]);
            last = point;
        }
        // Standard deviation of the sum of n uniform deviates (1/12), of their products (1/144)
        let n = n as f64;
        assert!(means.iter().all(|mean| mean.abs() < 4.0 * (n / 12.0).sqrt()), "{means:?}");
        assert!(products.iter().all(|sum| sum.abs() < 4.0 * (n / 144.0).sqrt()), "{products:?}");
        assert!(between.abs() < 4.0 * (n / 144.0).sqrt(), "{between}");
    }

    #[test]
    fn means_over_sets_vary_less_than_over_random_points() {
        // A smooth function of all five numbers: variance of means over 256 points.
        let value = |p: &[u32; DIMENSIONS]| {
            p.iter().map(|&bits| f64::from(bits) / f64::powi(2.0, 32)).product::<f64>()
        };
        let sets = 400;
        let (mut sum, mut square) = (0.0, 0.0);
        for index in 0..sets {
            let mean = set(1000 + index, 256).iter().map(value).sum::<f64>() / 256.0;
            sum += mean;
            square += mean * mean;
        }
        let n = sets as f64;
        let variance = (square - sum * sum / n) / (n - 1.0);
        let expected = 0.5f64.powi(5);
        assert!((sum / n - expected).abs() < 4.0 * (variance / n).sqrt(), "{}", sum / n);
        // Of independent points: E[f^2] - E[f]^2 = 3^-5 - 4^-5, over 256. A ratio of 10 is far
        // outside of the error of a variance from 400 sets (7 %).
        let independent = (f64::powi(3.0, -5) - f64::powi(4.0, -5)) / 256.0;
        assert!(independent > 10.0 * variance, "{independent} {variance}");
    }
}
