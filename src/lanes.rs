//! Numbers of several paths side by side.
//!
//! Loops over the lanes of these arrays become vector instructions as long as their bodies have neither
//! calls nor branches.

use crate::rng::Rng;
use bytemuck::{Pod, Zeroable};
use glam::Vec3;
#[cfg(target_arch = "x86_64")]
use pulp::x86::V3;

/// Paths side by side: two registers of AVX2, four of SSE.
pub const LANES: usize = 16;

/// Does `work`, compiled for AVX2 where the processor has it: the program itself is built for any. What
/// it calls must be inlined to gain from that. Results do not depend on it, since numbers are added and
/// multiplied in the same order.
#[inline(always)]
pub fn vectorized<T>(work: impl FnOnce() -> T) -> T {
    pulp::Arch::new().dispatch(work)
}

/// Which paths something holds for.
pub type Mask = [bool; LANES];

/// Whether it holds for any.
#[inline(always)]
pub fn any(mask: &Mask) -> bool {
    mask.iter().fold(false, |any, &lane| any | lane)
}

/// How eight lanes are put in another order: those that are kept first, and then anything.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Reorder {
    /// A bit for each lane that is kept.
    bits: usize,
}

/// By the bits of a [`Reorder`]: which lane comes where.
static ORDERS: [[u8; 8]; 256] = {
    let mut orders = [[0; 8]; 256];
    let mut bits = 0;
    while bits < 256 {
        let (mut lane, mut place) = (0, 0);
        while lane < 8 {
            if bits >> lane & 1 == 1 {
                orders[bits][place] = lane;
                place += 1;
            }
            lane += 1;
        }
        bits += 1;
    }
    orders
};

impl Reorder {
    /// For both halves of a mask.
    #[inline(always)]
    pub fn kept_first(mask: &Mask) -> [Self; 2] {
        // Multiplied with this, the lowest bits of eight bytes come together in the highest byte.
        let gathered = |bytes: u64| bytes.wrapping_mul(0x0102_0408_1020_4080) >> 56;
        bytemuck::cast::<_, [u64; 2]>(mask.map(u8::from))
            .map(|bytes| Self { bits: gathered(bytes.to_le()) as usize })
    }

    /// How many lanes are kept.
    #[inline(always)]
    pub fn kept(self) -> usize {
        self.bits.count_ones() as usize
    }

    /// Takes eight words `from` each of `N` columns and gives them in their new order `to` it.
    #[inline(always)]
    pub fn columns<const N: usize>(
        self,
        from: impl Fn(usize) -> [u32; 8],
        mut to: impl FnMut(usize, [u32; 8]),
    ) {
        let order = ORDERS[self.bits];
        #[cfg(target_arch = "x86_64")]
        if let Some(V3 { avx2, .. }) = V3::try_new() {
            // One instruction for all eight, which the compiler does not find by itself.
            let order = avx2._mm256_cvtepu8_epi32(bytemuck::cast([u64::from_le_bytes(order), 0]));
            for column in 0..N {
                let words = bytemuck::cast(from(column));
                to(column, bytemuck::cast(avx2._mm256_permutevar8x32_epi32(words, order)));
            }
            return;
        }
        for column in 0..N {
            to(column, reordered(from(column), order));
        }
    }
}

fn reordered(words: [u32; 8], order: [u8; 8]) -> [u32; 8] {
    order.map(|lane| words[usize::from(lane) % 8])
}

/// By four bits: for each that is set, a lane of the first four words and the same of the last four, and
/// then anything.
static PAIRS: [[u8; 8]; 16] = {
    let mut pairs = [[0; 8]; 16];
    let mut bits = 0;
    while bits < 16 {
        let (mut lane, mut place) = (0, 0);
        while lane < 4 {
            if bits >> lane & 1 == 1 {
                pairs[bits][place] = lane;
                pairs[bits][place + 1] = 4 + lane;
                place += 2;
            }
            lane += 1;
        }
        bits += 1;
    }
    pairs
};

/// One of the first words and one of the second for each bit that is set, and then anything.
#[inline(always)]
pub(crate) fn paired(bits: u32, first: [u32; 4], second: [u32; 4]) -> [[u32; 2]; 4] {
    let order = PAIRS[bits as usize % 16];
    #[cfg(target_arch = "x86_64")]
    if let Some(V3 { avx, avx2, .. }) = V3::try_new() {
        // Put together in a register: eight words just written as two halves could not be read at once.
        let words = avx._mm256_set_m128i(bytemuck::cast(second), bytemuck::cast(first));
        let order = avx2._mm256_cvtepu8_epi32(bytemuck::cast([u64::from_le_bytes(order), 0]));
        return bytemuck::cast(avx2._mm256_permutevar8x32_epi32(words, order));
    }
    bytemuck::cast(reordered(bytemuck::cast([first, second]), order))
}

/// The lanes of the bits that are set.
#[inline(always)]
pub fn lanes_of(mut bits: u32) -> impl Iterator<Item = usize> {
    std::iter::from_fn(move || {
        let lane = bits.trailing_zeros() as usize;
        bits &= bits.wrapping_sub(1);
        (lane < LANES).then_some(lane)
    })
}

/// A vector of each path, component by component.
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
#[repr(C, align(64))]
pub struct Vec3s {
    /// First components.
    pub x: [f32; LANES],
    /// Second components.
    pub y: [f32; LANES],
    /// Third components.
    pub z: [f32; LANES],
}

impl Vec3s {
    /// The same for all paths.
    #[inline(always)]
    pub fn splat(vector: Vec3) -> Self {
        let [x, y, z] = vector.to_array().map(|number| [number; LANES]);
        Self { x, y, z }
    }

    /// That of one path.
    #[inline(always)]
    pub fn get(&self, lane: usize) -> Vec3 {
        Vec3::new(self.x[lane], self.y[lane], self.z[lane])
    }

    /// Replaces that of one path.
    #[inline(always)]
    pub fn set(&mut self, lane: usize, vector: Vec3) {
        (self.x[lane], self.y[lane], self.z[lane]) = vector.into();
    }
}

/// The random numbers of each path.
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
#[repr(C, align(64))]
pub struct Rngs([[u32; LANES]; 4]);

impl Rngs {
    /// Those of one path.
    #[inline(always)]
    pub fn get(&self, lane: usize) -> Rng {
        let [a, b, c, d] = &self.0;
        Rng([a[lane], b[lane], c[lane], d[lane]])
    }

    /// Replaces those of one path.
    #[inline(always)]
    pub fn set(&mut self, lane: usize, rng: Rng) {
        for (words, word) in self.0.iter_mut().zip(rng.0) {
            words[lane] = word;
        }
    }

    /// One number of each path, uniform in [0, 1).
    #[inline(always)]
    pub fn next_1d(&mut self) -> [f32; LANES] {
        let mut numbers = [0.0; LANES];
        for (lane, number) in numbers.iter_mut().enumerate() {
            let mut rng = self.get(lane);
            *number = rng.next_1d();
            self.set(lane, rng);
        }
        numbers
    }

    /// 64 bits of each path, the lower half first, for a number in [0, 1) of 53 of them.
    #[inline(always)]
    pub fn next_bits(&mut self) -> [[u32; LANES]; 2] {
        let mut bits = [[0; LANES]; 2];
        for words in &mut bits {
            for (lane, word) in words.iter_mut().enumerate() {
                let mut rng = self.get(lane);
                *word = rng.next_u32();
                self.set(lane, rng);
            }
        }
        bits
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lanes_that_are_kept_come_first() {
        for bits in 0..=u16::MAX {
            let mask: Mask = std::array::from_fn(|lane| bits >> lane & 1 == 1);
            assert_eq!(any(&mask), bits != 0);
            let set: Vec<_> = (0..LANES).filter(|&lane| mask[lane]).collect();
            assert_eq!(lanes_of(bits.into()).collect::<Vec<_>>(), set);
            let mut kept = Vec::new();
            for (half, reorder) in Reorder::kept_first(&mask).into_iter().enumerate() {
                let lanes = |_| std::array::from_fn(|lane| (8 * half + lane) as u32);
                reorder.columns::<1>(lanes, |_, words| {
                    kept.extend(words[..reorder.kept()].iter().map(|&lane| lane as usize));
                });
            }
            assert_eq!(kept, set);
        }
    }

    #[test]
    fn pairs_are_of_the_bits_that_are_set() {
        let (first, second) = ([10, 11, 12, 13], [20, 21, 22, 23]);
        for bits in 0..16 {
            let set: Vec<_> = lanes_of(bits).map(|lane| [first[lane], second[lane]]).collect();
            assert_eq!(paired(bits, first, second)[..set.len()], set);
            // As where there is no AVX2.
            let words = bytemuck::cast([first, second]);
            let together: [[u32; 2]; 4] = bytemuck::cast(reordered(words, PAIRS[bits as usize]));
            assert_eq!(together[..set.len()], set);
        }
    }
}
