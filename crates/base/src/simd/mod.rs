//! Numbers of sixteen paths side by side, one path per lane.
//!
//! Loops over the lanes of these arrays become vector instructions as long as their bodies have
//! neither calls nor branches.

pub mod dispatch;
pub mod draw;
pub mod f32x8;
pub mod sobol;

pub use bdpm_accel::lanes::{LANES, Mask, Vec3s};

use crate::rng::Rng;
use bytemuck::{Pod, Zeroable};
use dispatch::Reorder;

/// Returns true if the condition holds for any path.
#[inline(always)]
pub fn any(mask: &Mask) -> bool {
    mask.iter().fold(false, |any, &lane| any | lane)
}

/// The mask as bits, that of lane 0 lowest.
#[inline(always)]
pub fn bits(mask: &Mask) -> u32 {
    let [low, high] = Reorder::kept_first(mask).map(Reorder::bits);
    low | high << 8
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

/// The random number generator of each path.
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
#[repr(C, align(64))]
pub struct Rngs([[u32; LANES]; 4]);

impl Rngs {
    /// The generator of one path.
    #[inline(always)]
    pub fn get(&self, lane: usize) -> Rng {
        let [a, b, c, d] = &self.0;
        Rng([a[lane], b[lane], c[lane], d[lane]])
    }

    /// Replaces the generator of one path.
    #[inline(always)]
    pub fn set(&mut self, lane: usize, rng: Rng) {
        for (words, word) in self.0.iter_mut().zip(rng.0) {
            words[lane] = word;
        }
    }

    /// Draws one number per path, uniform in [0, 1).
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

    /// Draws two numbers per path, uniform in [0, 1).
    #[inline(always)]
    pub fn next_pair(&mut self) -> [[f32; LANES]; 2] {
        [self.next_1d(), self.next_1d()]
    }

    /// Draws 64 bits per path, the lower half first, for a number in [0, 1) of 53 bits.
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
    fn masks_convert_to_bits_and_lanes() {
        for bits in 0..=u16::MAX {
            let mask: Mask = std::array::from_fn(|lane| bits >> lane & 1 == 1);
            assert_eq!(any(&mask), bits != 0);
            assert_eq!(super::bits(&mask), u32::from(bits));
            let set: Vec<_> = (0..LANES).filter(|&lane| mask[lane]).collect();
            assert_eq!(lanes_of(bits.into()).collect::<Vec<_>>(), set);
        }
    }
}
