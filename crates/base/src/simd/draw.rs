//! Sources of uniform numbers of sixteen paths: generators, alone or after numbers that are known.

use super::{LANES, Rngs};
use crate::rng::{Draw, Rng, unit_f32};

/// A source of uniform numbers of sixteen paths.
pub trait DrawLanes {
    /// The source of one path.
    type One: Draw;

    /// 64 bits per path, the lower half first, for a number in [0, 1) of 53 bits.
    fn next_bits(&mut self) -> [[u32; LANES]; 2];

    /// The source of one path.
    fn get(&self, lane: usize) -> Self::One;

    /// Replaces the source of one path.
    fn set(&mut self, lane: usize, one: Self::One);
}

impl DrawLanes for Rngs {
    type One = Rng;

    #[inline(always)]
    fn next_bits(&mut self) -> [[u32; LANES]; 2] {
        Self::next_bits(self)
    }

    #[inline(always)]
    fn get(&self, lane: usize) -> Rng {
        Self::get(self, lane)
    }

    #[inline(always)]
    fn set(&mut self, lane: usize, one: Rng) {
        Self::set(self, lane, one);
    }
}

/// Numbers that are known of the light source at the first vertex of a camera path.
pub const KNOWN: usize = 4;

/// Generators after [`KNOWN`] numbers for each path, which are drawn first.
#[derive(Clone, Copy, Debug)]
pub struct KnownFirst {
    /// Generators of all other numbers.
    pub rngs: Rngs,
    words: [[u32; LANES]; KNOWN],
    next: usize,
}

/// [`KnownFirst`] of one path.
#[derive(Clone, Copy, Debug)]
pub struct OneKnownFirst {
    /// Generator of all other numbers.
    pub rng: Rng,
    words: [u32; KNOWN],
    next: usize,
}

impl KnownFirst {
    /// Numbers of these words, and others.
    #[inline(always)]
    pub fn new(rngs: Rngs, words: [[u32; LANES]; KNOWN]) -> Self {
        Self { rngs, words, next: 0 }
    }
}

impl OneKnownFirst {
    /// Numbers of these words, and others.
    #[inline(always)]
    pub fn new(rng: Rng, words: [u32; KNOWN]) -> Self {
        Self { rng, words, next: 0 }
    }
}

impl DrawLanes for KnownFirst {
    type One = OneKnownFirst;

    #[inline(always)]
    fn next_bits(&mut self) -> [[u32; LANES]; 2] {
        let mut bits = self.rngs.next_bits();
        if let Some(words) = self.words.get(self.next) {
            bits[1] = *words;
            self.next += 1;
        }
        bits
    }

    #[inline(always)]
    fn get(&self, lane: usize) -> OneKnownFirst {
        let mut words = [0; KNOWN];
        for (word, words) in words.iter_mut().zip(&self.words) {
            *word = words[lane];
        }
        OneKnownFirst { rng: self.rngs.get(lane), words, next: self.next }
    }

    /// Replaces the generator of one path. Its known numbers stay.
    #[inline(always)]
    fn set(&mut self, lane: usize, one: OneKnownFirst) {
        self.rngs.set(lane, one.rng);
    }
}

impl Draw for OneKnownFirst {
    #[inline(always)]
    fn next_word(&mut self) -> u32 {
        match self.words.get(self.next) {
            Some(word) => {
                self.next += 1;
                *word
            }
            None => self.rng.next_u32(),
        }
    }

    #[inline(always)]
    fn next_low(&mut self) -> u32 {
        self.rng.next_u32()
    }
}

/// The uniform number in [0, 1) of each word.
#[inline(always)]
pub fn numbers_of(words: &[u32; LANES]) -> [f32; LANES] {
    let mut numbers = [0.0; LANES];
    for (number, word) in numbers.iter_mut().zip(words) {
        *number = unit_f32(*word);
    }
    numbers
}
