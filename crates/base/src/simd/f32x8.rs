//! Eight numbers side by side: one instruction of AVX2 for all of them, or two of narrower ones.
//!
//! Results do not depend on the processor: both kinds do the same operations in the same order.

use super::dispatch::compacted;
use glam::{BVec4A, Vec4};
#[cfg(target_arch = "x86_64")]
use pulp::x86::V3;
use std::array::from_fn;
use std::ops::{Add, BitAnd, Mul, Sub};

/// Number of lanes.
pub const EIGHT: usize = 8;

/// Instructions on eight lanes.
pub trait F32x8: Copy {
    /// Eight numbers.
    type Floats: Copy
        + Add<Output = Self::Floats>
        + Sub<Output = Self::Floats>
        + Mul<Output = Self::Floats>;
    /// A condition for each lane.
    type Mask: Copy + BitAnd<Output = Self::Mask>;

    /// One number in all lanes.
    fn splat(self, number: f32) -> Self::Floats;

    /// Eight numbers from memory.
    fn load(self, numbers: &[f32; EIGHT]) -> Self::Floats;

    /// Numbers of 16 bits, the upper half of an `f32`: those in the upper halves of words.
    fn upper_halves(self, words: &[u32; EIGHT]) -> Self::Floats;

    /// Numbers of 16 bits, the upper half of an `f32`: those in the lower halves of words.
    fn lower_halves(self, words: &[u32; EIGHT]) -> Self::Floats;

    /// The larger numbers.
    fn max(self, a: Self::Floats, b: Self::Floats) -> Self::Floats;

    /// Reciprocals, correctly rounded.
    fn recip(self, a: Self::Floats) -> Self::Floats;

    /// Sum over the lanes.
    fn sum(self, a: Self::Floats) -> f32;

    /// Tests `a <= b`; false where a number is NaN.
    fn le(self, a: Self::Floats, b: Self::Floats) -> Self::Mask;

    /// Tests `a < b`; false where a number is NaN.
    fn lt(self, a: Self::Floats, b: Self::Floats) -> Self::Mask;

    /// Tests whether the selected bits of each word equal `value`.
    fn bits_equal(self, words: &[u32; EIGHT], selected: u32, value: u32) -> Self::Mask;

    /// `a` where `b` does not hold.
    fn and_not(self, a: Self::Mask, b: Self::Mask) -> Self::Mask;

    /// `a` where the mask holds, `b` in the other lanes.
    fn select(self, mask: Self::Mask, a: Self::Floats, b: Self::Floats) -> Self::Floats;

    /// The mask as bits, that of lane 0 lowest.
    fn bits(self, mask: Self::Mask) -> u32;

    /// For each set bit of `bits` the word of its lane and the bits of its number, then any others.
    fn compact(self, bits: u32, words: &[u32; EIGHT], numbers: Self::Floats) -> [[u32; 2]; EIGHT];

    /// `a` where the mask holds, 0 in the other lanes.
    #[inline(always)]
    fn keep(self, mask: Self::Mask, a: Self::Floats) -> Self::Floats {
        self.select(mask, a, self.splat(0.0))
    }
}

/// Work with instructions on eight lanes.
pub trait F32x8Work {
    /// Its result.
    type Output;

    /// Does the work. Functions that it calls must be inlined. A closure, or the loop of
    /// `array::map`, may remain a function without AVX2 and then calls another one for each
    /// instruction.
    fn run<E: F32x8>(self, eight: E) -> Self::Output;
}

/// Runs `work`, compiled for AVX2 if the processor has it.
#[inline(always)]
pub fn by_f32x8<W: F32x8Work>(work: W) -> W::Output {
    #[cfg(target_arch = "x86_64")]
    if let Some(v3) = V3::try_new() {
        return pulp::Simd::vectorize(v3, OnEight(work, v3));
    }
    work.run(Portable)
}

/// Work of [`by_f32x8`] with AVX2.
#[cfg(target_arch = "x86_64")]
struct OnEight<W>(W, V3);

#[cfg(target_arch = "x86_64")]
impl<W: F32x8Work> pulp::WithSimd for OnEight<W> {
    type Output = W::Output;

    #[inline(always)]
    fn with_simd<S: pulp::Simd>(self, _: S) -> W::Output {
        let Self(work, v3) = self;
        work.run(v3)
    }
}

/// Instructions of any processor.
#[derive(Clone, Copy, Debug)]
pub struct Portable;

/// The numbers of [`Portable`].
#[derive(Clone, Copy, Debug)]
pub struct Halves([Vec4; 2]);

/// The mask of [`Portable`].
#[derive(Clone, Copy, Debug)]
pub struct MaskHalves([BVec4A; 2]);

impl Halves {
    /// Eight numbers, lane by lane.
    #[inline(always)] // part of vector loops, as all functions here
    fn from_array(numbers: [f32; EIGHT]) -> Self {
        Self([0, 4].map(|half| Vec4::from_array(from_fn(|lane| numbers[half + lane]))))
    }
}

impl Add for Halves {
    type Output = Self;

    #[inline(always)]
    fn add(self, Self([low, high]): Self) -> Self {
        Self([self.0[0] + low, self.0[1] + high])
    }
}

impl Sub for Halves {
    type Output = Self;

    #[inline(always)]
    fn sub(self, Self([low, high]): Self) -> Self {
        Self([self.0[0] - low, self.0[1] - high])
    }
}

impl Mul for Halves {
    type Output = Self;

    #[inline(always)]
    fn mul(self, Self([low, high]): Self) -> Self {
        Self([self.0[0] * low, self.0[1] * high])
    }
}

impl BitAnd for MaskHalves {
    type Output = Self;

    #[inline(always)]
    fn bitand(self, Self([low, high]): Self) -> Self {
        Self([self.0[0] & low, self.0[1] & high])
    }
}

impl F32x8 for Portable {
    type Floats = Halves;
    type Mask = MaskHalves;

    #[inline(always)]
    fn splat(self, number: f32) -> Halves {
        Halves([Vec4::splat(number); 2])
    }

    #[inline(always)]
    fn load(self, numbers: &[f32; EIGHT]) -> Halves {
        Halves::from_array(*numbers)
    }

    #[inline(always)]
    fn upper_halves(self, words: &[u32; EIGHT]) -> Halves {
        Halves::from_array(words.map(|word| f32::from_bits(word & 0xffff_0000)))
    }

    #[inline(always)]
    fn lower_halves(self, words: &[u32; EIGHT]) -> Halves {
        Halves::from_array(words.map(|word| f32::from_bits(word << 16)))
    }

    #[inline(always)]
    fn max(self, a: Halves, b: Halves) -> Halves {
        Halves(from_fn(|half| a.0[half].max(b.0[half])))
    }

    #[inline(always)]
    fn recip(self, a: Halves) -> Halves {
        Halves(a.0.map(Vec4::recip))
    }

    #[inline(always)]
    fn sum(self, Halves([low, high]): Halves) -> f32 {
        (low + high).element_sum()
    }

    #[inline(always)]
    fn le(self, a: Halves, b: Halves) -> MaskHalves {
        MaskHalves(from_fn(|half| a.0[half].cmple(b.0[half])))
    }

    #[inline(always)]
    fn lt(self, a: Halves, b: Halves) -> MaskHalves {
        MaskHalves(from_fn(|half| a.0[half].cmplt(b.0[half])))
    }

    #[inline(always)]
    fn bits_equal(self, words: &[u32; EIGHT], selected: u32, value: u32) -> MaskHalves {
        let others = words.map(|word| if word & selected == value { 0.0 } else { 1.0 });
        MaskHalves(Halves::from_array(others).0.map(|others| others.cmpeq(Vec4::ZERO)))
    }

    #[inline(always)]
    fn and_not(self, a: MaskHalves, b: MaskHalves) -> MaskHalves {
        MaskHalves(from_fn(|half| a.0[half] & !b.0[half]))
    }

    #[inline(always)]
    fn select(self, mask: MaskHalves, a: Halves, b: Halves) -> Halves {
        Halves(from_fn(|half| Vec4::select(mask.0[half], a.0[half], b.0[half])))
    }

    #[inline(always)]
    fn bits(self, MaskHalves([low, high]): MaskHalves) -> u32 {
        low.bitmask() | high.bitmask() << 4
    }

    #[inline(always)]
    fn compact(self, bits: u32, words: &[u32; EIGHT], numbers: Halves) -> [[u32; 2]; EIGHT] {
        let [low, high] = numbers.0.map(|half| half.to_array().map(f32::to_bits));
        let order = compacted(bits);
        order.map(|lane| {
            let lane = usize::from(lane) % EIGHT;
            [words[lane], if lane < 4 { low[lane] } else { high[lane - 4] }]
        })
    }
}

#[cfg(target_arch = "x86_64")]
mod avx2 {
    use super::*;
    use std::arch::x86_64::{__m128, __m256};

    /// The numbers of AVX2, with the proof that the processor has it.
    #[derive(Clone, Copy)]
    pub struct Floats(__m256, V3);

    /// The mask of AVX2: all bits of a lane are set or none.
    #[derive(Clone, Copy)]
    pub struct Mask(__m256, V3);

    impl Add for Floats {
        type Output = Self;

        #[inline(always)]
        fn add(self, Self(other, v3): Self) -> Self {
            Self(v3.avx._mm256_add_ps(self.0, other), v3)
        }
    }

    impl Sub for Floats {
        type Output = Self;

        #[inline(always)]
        fn sub(self, Self(other, v3): Self) -> Self {
            Self(v3.avx._mm256_sub_ps(self.0, other), v3)
        }
    }

    impl Mul for Floats {
        type Output = Self;

        #[inline(always)]
        fn mul(self, Self(other, v3): Self) -> Self {
            Self(v3.avx._mm256_mul_ps(self.0, other), v3)
        }
    }

    impl BitAnd for Mask {
        type Output = Self;

        #[inline(always)]
        fn bitand(self, Self(other, v3): Self) -> Self {
            Self(v3.avx._mm256_and_ps(self.0, other), v3)
        }
    }

    impl F32x8 for V3 {
        type Floats = Floats;
        type Mask = Mask;

        #[inline(always)]
        fn splat(self, number: f32) -> Floats {
            Floats(self.avx._mm256_set1_ps(number), self)
        }

        #[inline(always)]
        fn load(self, numbers: &[f32; EIGHT]) -> Floats {
            Floats(bytemuck::cast(*numbers), self)
        }

        #[inline(always)]
        fn upper_halves(self, words: &[u32; EIGHT]) -> Floats {
            let upper = self.avx._mm256_set1_epi32(0xffff_0000_u32 as i32);
            Floats(bytemuck::cast(self.avx2._mm256_and_si256(bytemuck::cast(*words), upper)), self)
        }

        #[inline(always)]
        fn lower_halves(self, words: &[u32; EIGHT]) -> Floats {
            let lower = self.avx2._mm256_slli_epi32::<16>(bytemuck::cast(*words));
            Floats(bytemuck::cast(lower), self)
        }

        #[inline(always)]
        fn max(self, a: Floats, b: Floats) -> Floats {
            Floats(self.avx._mm256_max_ps(a.0, b.0), self)
        }

        #[inline(always)]
        fn recip(self, a: Floats) -> Floats {
            Floats(self.avx._mm256_div_ps(self.splat(1.0).0, a.0), self)
        }

        #[inline(always)]
        fn sum(self, a: Floats) -> f32 {
            let [low, high]: [__m128; 2] =
                [self.avx._mm256_castps256_ps128(a.0), self.avx._mm256_extractf128_ps::<1>(a.0)];
            Portable.sum(Halves([Vec4::from(low), Vec4::from(high)]))
        }

        #[inline(always)]
        fn le(self, a: Floats, b: Floats) -> Mask {
            Mask(self.avx._mm256_cmp_ps::<{ std::arch::x86_64::_CMP_LE_OQ }>(a.0, b.0), self)
        }

        #[inline(always)]
        fn lt(self, a: Floats, b: Floats) -> Mask {
            Mask(self.avx._mm256_cmp_ps::<{ std::arch::x86_64::_CMP_LT_OQ }>(a.0, b.0), self)
        }

        #[inline(always)]
        fn bits_equal(self, words: &[u32; EIGHT], selected: u32, value: u32) -> Mask {
            let Self { avx, avx2, .. } = self;
            let selected = avx._mm256_set1_epi32(selected as i32);
            let bits = avx2._mm256_and_si256(bytemuck::cast(*words), selected);
            let equal = avx2._mm256_cmpeq_epi32(bits, avx._mm256_set1_epi32(value as i32));
            Mask(bytemuck::cast(equal), self)
        }

        #[inline(always)]
        fn and_not(self, a: Mask, b: Mask) -> Mask {
            Mask(self.avx._mm256_andnot_ps(b.0, a.0), self)
        }

        #[inline(always)]
        fn select(self, mask: Mask, a: Floats, b: Floats) -> Floats {
            Floats(self.avx._mm256_blendv_ps(b.0, a.0, mask.0), self)
        }

        #[inline(always)]
        fn keep(self, mask: Mask, a: Floats) -> Floats {
            Floats(self.avx._mm256_and_ps(mask.0, a.0), self)
        }

        #[inline(always)]
        fn bits(self, mask: Mask) -> u32 {
            self.avx._mm256_movemask_ps(mask.0) as u32
        }

        #[inline(always)]
        fn compact(self, bits: u32, words: &[u32; EIGHT], numbers: Floats) -> [[u32; 2]; EIGHT] {
            let avx2 = self.avx2;
            let order = u64::from_le_bytes(compacted(bits));
            let order = avx2._mm256_cvtepu8_epi32(bytemuck::cast([order, 0]));
            let words = avx2._mm256_permutevar8x32_epi32(bytemuck::cast(*words), order);
            let numbers = avx2._mm256_permutevar8x32_epi32(bytemuck::cast(numbers.0), order);
            let low = avx2._mm256_unpacklo_epi32(words, numbers);
            let high = avx2._mm256_unpackhi_epi32(words, numbers);
            bytemuck::cast([
                avx2._mm256_permute2x128_si256::<0x20>(low, high),
                avx2._mm256_permute2x128_si256::<0x31>(low, high),
            ])
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rng::{Rng, Stream, StreamKey};
    use crate::simd::lanes_of;

    /// Random operands of every operation.
    struct Operands {
        words: [u32; EIGHT],
        numbers: [[f32; EIGHT]; 2],
    }

    impl Operands {
        fn random(rng: &mut Rng) -> Self {
            let mut numbers =
                [0; 2].map(|_| [0.0; EIGHT].map(|_: f32| 200.0 * rng.next_1d() - 100.0));
            // Equal numbers and one that is none.
            numbers[1][2] = numbers[0][2];
            numbers[0][5] = f32::NAN;
            Self { words: [0; EIGHT].map(|_| rng.next_u32()), numbers }
        }
    }

    /// The results of every operation, as bits.
    impl F32x8Work for &Operands {
        type Output = Vec<u32>;

        #[inline(always)]
        fn run<E: F32x8>(self, eight: E) -> Vec<u32> {
            let [a, b] = self.numbers.map(|numbers| eight.load(&numbers));
            let (all, lower) = (eight.le(b, b), eight.lt(a, b));
            let floats = [
                a + b,
                a - b,
                a * b,
                eight.splat(0.1),
                eight.recip(b),
                eight.max(b, eight.splat(3.0)),
                eight.select(lower, a, b),
                eight.keep(lower, b),
                eight.upper_halves(&self.words),
                eight.lower_halves(&self.words),
            ];
            let masks = [
                lower,
                eight.le(a, b),
                lower & eight.le(b, eight.splat(0.0)),
                eight.and_not(all, lower),
                eight.bits_equal(&self.words, 0x0300_0000, 0x0100_0000),
            ];
            let mut results = vec![eight.sum(b).to_bits()];
            results.extend(masks.map(|mask| eight.bits(mask)));
            let mut push = |bits: u32, numbers| {
                let compact = eight.compact(bits, &self.words, numbers);
                results.extend(compact[..bits.count_ones() as usize].as_flattened());
            };
            floats.into_iter().for_each(|numbers| push(0xff, numbers));
            push(eight.bits(lower), b);
            results
        }
    }

    #[test]
    fn operations_match_plain_numbers_on_any_processor() {
        let mut rng = StreamKey::new(1, Stream::Test, 0).rng(0);
        for _ in 0..1000 {
            let operands = Operands::random(&mut rng);
            let Operands { words, numbers: [a, b] } = &operands;
            let bits = |test: &dyn Fn(usize) -> bool| {
                (0..EIGHT).map(|lane| u32::from(test(lane)) << lane).sum::<u32>()
            };
            let lower = bits(&|lane| a[lane] < b[lane]);
            let half = |half: usize| b[half] + b[4 + half];
            let portable = operands.run(Portable);
            let sum = f32::from_bits(portable[0]);
            let expected = (half(0) + half(1)) + (half(2) + half(3));
            assert!((sum - expected).abs() <= 1e-3, "{sum} {expected}");
            let masks = [
                lower,
                bits(&|lane| a[lane] <= b[lane]),
                bits(&|lane| a[lane] < b[lane] && b[lane] <= 0.0),
                bits(&|lane| a[lane] >= b[lane] || a[lane].is_nan()),
                bits(&|lane| words[lane] >> 24 & 3 == 1),
            ];
            assert_eq!(portable[1..6], masks);
            let number =
                |at: usize, lane: usize| f32::from_bits(portable[6 + 16 * at + 2 * lane + 1]);
            for lane in 0..EIGHT {
                assert_eq!(portable[6 + 2 * lane], words[lane]);
                let (a, b) = (a[lane], b[lane]);
                let is_lower = lower >> lane & 1 == 1;
                let expected = [
                    a + b,
                    a - b,
                    a * b,
                    0.1,
                    b.recip(),
                    b.max(3.0),
                    if is_lower { a } else { b },
                    if is_lower { b } else { 0.0 },
                ];
                for (at, expected) in expected.into_iter().enumerate() {
                    let own = number(at, lane);
                    assert!(own == expected || own.is_nan() && expected.is_nan(), "{at}: {own}");
                }
                let bits = |at: usize| portable[6 + 16 * at + 2 * lane + 1];
                let halves = [words[lane] >> 16 << 16, words[lane] << 16];
                assert_eq!([bits(8), bits(9)], halves);
            }
            let compact: Vec<u32> =
                lanes_of(lower).flat_map(|lane| [words[lane], b[lane].to_bits()]).collect();
            assert_eq!(portable[6 + 16 * 10..], compact);
            assert_eq!(by_f32x8(&operands), portable);
        }
    }
}
