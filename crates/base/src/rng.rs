//! Keyed random streams: path `index` of `iteration` draws the same numbers on any thread.
//!
//! The generator is xoshiro128++ (Blackman and Vigna 2021). It is not from a crate because
//! [`simd`](crate::simd) steps sixteen generators side by side; a test compares it with the crate.

/// The part of the renderer that draws; streams of different parts never coincide.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Stream {
    /// One stream per light path, indexed by its id.
    LightPath = 1,
    /// One stream per camera path, indexed by [`camera_path_index`].
    CameraPath = 2,
    /// For tests and benches.
    Test = 3,
    /// One stream per pixel of the reference path tracer.
    Reference = 4,
    /// One stream per light path that finds out what light reaches.
    Pilot = 5,
    /// One stream per pixel of a quick look at a scene.
    LitCheck = 6,
    /// One stream per batch of vertices that test which lights they see.
    Visibility = 7,
    /// One stream per set of light paths, which scrambles the Sobol points that they start from.
    LightPathSet = 8,
    /// One stream per camera path of a pixel and set, which scrambles its Sobol points.
    CameraPathSet = 11,
    /// For the tiles in which the error of a denoised image is estimated.
    Denoiser = 9,
    /// One stream per light path of a goniophotometer.
    Goniometer = 10,
    /// One stream per band of the half space in which an eye sees luminaires.
    Glare = 30,
    /// One stream per light path that finds out which light arrives at meters by mirrors and
    /// through glass.
    MeterPilot = 31,
    /// One stream per light path whose photons are merged at meters.
    MeterPhotons = 32,
    /// One stream per camera path whose suffixes fill a cache.
    SuffixPath = 33,
    /// For the rays toward casters of caustics.
    Aim = 34,
    /// One stream per batch of camera paths of daylight coefficients.
    Daylight = 35,
    /// Directions in which a surface reflects, for its reflectance.
    Reflectance = 36,
}

/// Index of camera path `path` of `pixel` in the stream [`Stream::CameraPath`].
#[inline]
pub fn camera_path_index(pixel: u32, path: u32) -> u64 {
    u64::from(pixel) << 32 | u64::from(path)
}

/// The streams of one part of the renderer in one iteration.
#[derive(Clone, Copy, Debug)]
pub struct StreamKey(u64);

impl StreamKey {
    /// The key of `(seed, stream, iteration)`.
    #[inline]
    pub fn new(seed: u64, stream: Stream, iteration: u64) -> Self {
        let key = mix(seed.wrapping_add(GOLDEN));
        let key = mix(key ^ (stream as u64).wrapping_mul(GOLDEN));
        Self(mix(key ^ iteration.wrapping_mul(GOLDEN)))
    }

    /// The stream of path `index`.
    #[inline]
    pub fn rng(self, index: u64) -> Rng {
        // For one key, index -> a is a bijection: no two paths share a state.
        let a = mix(self.0.wrapping_add(index.wrapping_mul(GOLDEN)));
        let b = mix(a ^ self.0.rotate_left(32));
        // Only 0 mixes to 0: the state is never all zero, where the generator would stand still,
        // unless the key is 0.
        Rng([a as u32, (a >> 32) as u32, b as u32, (b >> 32) as u32])
    }
}

/// The random numbers of one path: 16 bytes of state.
#[derive(Clone, Copy, Debug, Default)]
pub struct Rng(pub(crate) [u32; 4]);

impl Rng {
    /// 32 random bits.
    #[inline(always)] // like those below: parts of vector loops
    pub fn next_u32(&mut self) -> u32 {
        let [a, b, c, d] = self.0;
        let bits = a.wrapping_add(d).rotate_left(7).wrapping_add(a);
        let (c, d) = (c ^ a, d ^ b);
        self.0 = [a ^ d, b ^ c, c ^ (b << 9), d.rotate_left(11)];
        bits
    }

    /// Uniform in [0, 1), a multiple of 2^-24.
    #[inline(always)]
    pub fn next_1d(&mut self) -> f32 {
        unit_f32(self.next_u32())
    }

    /// Uniform in [0, 1), a multiple of 2^-53: for choices among many items.
    #[inline(always)]
    pub fn next_f64(&mut self) -> f64 {
        unit_f64([self.next_u32(), self.next_u32()])
    }

    /// Two independent uniform numbers in [0, 1).
    #[inline(always)]
    pub fn next_2d(&mut self) -> [f32; 2] {
        [self.next_1d(), self.next_1d()]
    }
}

/// A source of uniform numbers of one path.
pub trait Draw {
    /// 32 bits that determine a number, uniform over all paths.
    fn next_word(&mut self) -> u32;

    /// 32 random bits for the lower digits of a number.
    fn next_low(&mut self) -> u32;

    /// Uniform in [0, 1), a multiple of 2^-24.
    #[inline(always)]
    fn next_1d(&mut self) -> f32 {
        unit_f32(self.next_word())
    }

    /// Uniform in [0, 1), a multiple of 2^-53: for choices among many items.
    #[inline(always)]
    fn next_f64(&mut self) -> f64 {
        unit_f64([self.next_low(), self.next_word()])
    }

    /// Two uniform numbers in [0, 1).
    #[inline(always)]
    fn next_2d(&mut self) -> [f32; 2] {
        [self.next_1d(), self.next_1d()]
    }
}

impl Draw for Rng {
    #[inline(always)]
    fn next_word(&mut self) -> u32 {
        self.next_u32()
    }

    #[inline(always)]
    fn next_low(&mut self) -> u32 {
        self.next_u32()
    }
}

/// A number in [0, 1) of 32 random bits, a multiple of 2^-24.
#[inline(always)]
pub fn unit_f32(bits: u32) -> f32 {
    // Convert from `i32`, which has vector instructions.
    (bits >> 8) as i32 as f32 * (1.0 / (1 << 24) as f32)
}

/// A number in [0, 1) of 64 random bits, a multiple of 2^-53.
#[inline(always)]
pub fn unit_f64([low, high]: [u32; 2]) -> f64 {
    let bits = u64::from(low) | u64::from(high) << 32;
    (bits >> 11) as i64 as f64 * (1.0 / (1u64 << 53) as f64)
}

/// 2^64 divided by the golden ratio, odd: spreads consecutive integers over all bits.
const GOLDEN: u64 = 0x9e37_79b9_7f4a_7c15;

/// A bijection on 64 bits in which each input bit flips each output bit with probability near 1/2
/// (the finalizer of SplitMix64: Steele, Lea, Flood 2014; constants by Stafford).
#[inline]
fn mix(mut x: u64) -> u64 {
    x = (x ^ (x >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    x = (x ^ (x >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    x ^ (x >> 31)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn equal_keys_give_equal_numbers_and_other_keys_other_numbers() {
        let draw = |seed, stream, iteration, index| {
            let mut rng = StreamKey::new(seed, stream, iteration).rng(index);
            [rng.next_2d(), rng.next_2d()]
        };
        let base = draw(1, Stream::LightPath, 2, 3);
        assert_eq!(base, draw(1, Stream::LightPath, 2, 3));
        assert_ne!(base, draw(2, Stream::LightPath, 2, 3));
        assert_ne!(base, draw(1, Stream::CameraPath, 2, 3));
        assert_ne!(base, draw(1, Stream::LightPath, 3, 3));
        assert_ne!(base, draw(1, Stream::LightPath, 2, 4));
    }

    #[test]
    fn generator_is_xoshiro128_plus_plus() {
        use rand_core::{Rng as _, SeedableRng};
        for index in 0..100 {
            let mut own = StreamKey::new(9, Stream::Test, 0).rng(index);
            let mut seed = [0; 16];
            for (bytes, word) in seed.as_chunks_mut::<4>().0.iter_mut().zip(own.0) {
                *bytes = word.to_le_bytes();
            }
            let mut other = rand_xoshiro::Xoshiro128PlusPlus::from_seed(seed);
            for _ in 0..100 {
                assert_eq!(own.next_u32(), other.next_u32());
            }
            let number = (other.next_u64() >> 11) as f64 / (1u64 << 53) as f64;
            assert_eq!(own.next_f64(), number);
        }
    }

    #[test]
    fn neighboring_streams_are_uniform_and_uncorrelated() {
        // First draws over (index, iteration), and their products between neighbors in each.
        let n = 1000;
        let first = |iteration: u64, index: u64| {
            f64::from(StreamKey::new(0, Stream::CameraPath, iteration).rng(index).next_1d()) - 0.5
        };
        let (mut mean, mut by_index, mut by_iteration) = (0.0, 0.0, 0.0);
        for iteration in 0..n {
            for index in 0..n {
                let x = first(iteration, index);
                mean += x;
                by_index += x * first(iteration, index + 1);
                by_iteration += x * first(iteration + 1, index);
            }
        }
        // Standard deviation of the sum of n^2 uniform deviates (1/12), of their products (1/144).
        let count = (n * n) as f64;
        assert!(mean.abs() < 4.0 * (count / 12.0).sqrt(), "{mean}");
        assert!(by_index.abs() < 4.0 * (count / 144.0).sqrt(), "{by_index}");
        assert!(by_iteration.abs() < 4.0 * (count / 144.0).sqrt(), "{by_iteration}");
    }

    #[test]
    fn uniform_numbers_stay_below_one() {
        let mut rng = StreamKey::new(0, Stream::Test, 0).rng(0);
        assert!((0..1_000_000).map(|_| rng.next_1d()).all(|x| (0.0..1.0).contains(&x)));
    }
}
