//! Vector instructions that the compiler does not emit by itself, on words of several paths side by
//! side.
//!
//! Each function has an equivalent in plain Rust for processors without AVX2.
#![cfg_attr(not(target_arch = "x86_64"), allow(unused_variables))] // `Simd` is empty there

use super::{LANES, Mask};
use bytemuck::Pod;
#[cfg(target_arch = "x86_64")]
use pulp::x86::V3;
use std::array::from_fn;

/// Runs `work`, compiled for AVX2 if the processor has it; the rest of the program runs on any
/// processor. Functions that `work` calls must be inlined to profit. Results do not depend on AVX2,
/// because the order of additions and multiplications is the same. (AVX-512 made camera paths of
/// rooms 1 % faster, and the program larger.)
#[inline(always)]
pub fn vectorized<T>(work: impl FnOnce(Simd) -> T) -> T {
    #[cfg(target_arch = "x86_64")]
    if let Some(v3) = V3::try_new() {
        return pulp::Simd::vectorize(v3, Work(work, v3));
    }
    work(Simd::default())
}

/// Proof that [`vectorized`] work may use AVX2, if it may.
#[derive(Clone, Copy, Debug, Default)]
pub struct Simd(#[cfg(target_arch = "x86_64")] Option<V3>);

/// The work of [`vectorized`] with AVX2.
#[cfg(target_arch = "x86_64")]
struct Work<F>(F, V3);

#[cfg(target_arch = "x86_64")]
impl<T, F: FnOnce(Simd) -> T> pulp::WithSimd for Work<F> {
    type Output = T;

    #[inline(always)]
    fn with_simd<S: pulp::Simd>(self, _: S) -> T {
        let Self(work, v3) = self;
        work(Simd(Some(v3)))
    }
}

/// An order of eight lanes: the kept ones first, then any others.
#[derive(Clone, Copy, Debug)]
pub struct Reorder {
    /// A bit for each lane that is kept.
    bits: usize,
}

/// For the bits of a [`Reorder`]: the lane at each position.
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
    /// The orders of both halves of a mask.
    #[inline(always)]
    pub fn kept_first(mask: &Mask) -> [Self; 2] {
        // This factor moves the lowest bits of eight bytes into the highest byte.
        let gathered = |bytes: u64| bytes.wrapping_mul(0x0102_0408_1020_4080) >> 56;
        bytemuck::cast::<_, [u64; 2]>(mask.map(u8::from))
            .map(|bytes| Self { bits: gathered(bytes.to_le()) as usize })
    }

    /// A bit for each lane that is kept.
    #[inline(always)]
    pub fn bits(self) -> u32 {
        self.bits as u32
    }

    /// Number of lanes that are kept.
    #[inline(always)]
    pub fn kept(self) -> usize {
        self.bits.count_ones() as usize
    }

    /// Reorders eight words of each of `N` columns: reads them with `from`, passes them to `to`.
    #[inline(always)]
    pub fn columns<const N: usize>(
        self,
        simd: Simd,
        from: impl Fn(usize) -> [u32; 8],
        mut to: impl FnMut(usize, [u32; 8]),
    ) {
        let order = ORDERS[self.bits];
        #[cfg(target_arch = "x86_64")]
        if let Simd(Some(V3 { avx2, .. })) = simd {
            // One instruction reorders all eight words.
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

#[inline]
fn reordered(words: [u32; 8], order: [u8; 8]) -> [u32; 8] {
    order.map(|lane| words[usize::from(lane) % 8])
}

/// For the lowest eight bits: the lanes of the set ones, then any others.
#[inline(always)]
pub(super) fn compacted(bits: u32) -> [u8; 8] {
    ORDERS[bits as usize % ORDERS.len()]
}

/// Calls `each` with each row of a packet of eight columns of words.
#[inline(always)]
pub fn for_each_row(
    simd: Simd,
    columns: &[[u32; LANES]; 8],
    mut each: impl FnMut(usize, [[u32; 4]; 2]),
) {
    for half in [0, 8] {
        let eight =
            |column: usize| *columns[column][half..].first_chunk().expect("eight of sixteen");
        let low = rows_of(simd, [eight(0), eight(1), eight(2), eight(3)]);
        let high = rows_of(simd, [eight(4), eight(5), eight(6), eight(7)]);
        for row in 0..8 {
            each(half + row, [low[row], high[row]]);
        }
    }
}

/// Transposes eight rows of four words to four columns of eight.
#[inline(always)]
pub fn columns_of(simd: Simd, rows: [&[u32; 4]; 8]) -> [[u32; 8]; 4] {
    // Loops, not closures: these may remain calls.
    #[cfg(target_arch = "x86_64")]
    if let Simd(Some(simd)) = simd {
        let mut pairs = [[0; 8]; 4];
        for (row, pair) in pairs.iter_mut().enumerate() {
            pair[..4].copy_from_slice(rows[row]);
            pair[4..].copy_from_slice(rows[row + 4]);
        }
        return transposed(simd, pairs);
    }
    from_fn(|column| rows.map(|row| row[column]))
}

/// Transposes sixteen `rows` of words to one packet of columns.
#[inline(always)]
pub fn transpose_rows<T: Pod, P: Pod>(simd: Simd, rows: &[&T; LANES], packet: &mut P) {
    const { assert!(size_of::<P>() == LANES * size_of::<T>() && size_of::<T>().is_multiple_of(16)) };
    let quads = bytemuck::cast_slice_mut(std::slice::from_mut(packet));
    for (quad, columns) in quads.as_chunks_mut::<4>().0.iter_mut().enumerate() {
        for half in [0, 8] {
            let mut eight = [&[0; 4]; 8];
            for (row, words) in eight.iter_mut().enumerate() {
                *words = &bytemuck::cast_slice(std::slice::from_ref(rows[half + row]))[quad];
            }
            let eight = columns_of(simd, eight);
            for (column, eight) in columns.iter_mut().zip(eight) {
                let column: &mut [u32; LANES] = column;
                column[half..half + 8].copy_from_slice(&eight);
            }
        }
    }
}

/// Transposes four columns of eight words to eight rows of four.
#[inline(always)]
pub fn rows_of(simd: Simd, columns: [[u32; 8]; 4]) -> [[u32; 4]; 8] {
    #[cfg(target_arch = "x86_64")]
    if let Simd(Some(simd)) = simd {
        let pairs: [[[u32; 4]; 2]; 4] = transposed(simd, columns).map(bytemuck::cast);
        return from_fn(|row| pairs[row % 4][row / 4]);
    }
    from_fn(|row| columns.map(|column| column[row]))
}

/// Transposes the first four words of each row, and the last four.
#[cfg(target_arch = "x86_64")]
#[inline(always)]
fn transposed(V3 { avx2, .. }: V3, quads: [[u32; 8]; 4]) -> [[u32; 8]; 4] {
    let [a, b, c, d] = quads;
    let (a, b) = (bytemuck::cast(a), bytemuck::cast(b));
    let (c, d) = (bytemuck::cast(c), bytemuck::cast(d));
    let (ab, cd) = (avx2._mm256_unpacklo_epi32(a, b), avx2._mm256_unpacklo_epi32(c, d));
    let first = (avx2._mm256_unpacklo_epi64(ab, cd), avx2._mm256_unpackhi_epi64(ab, cd));
    let (ab, cd) = (avx2._mm256_unpackhi_epi32(a, b), avx2._mm256_unpackhi_epi32(c, d));
    let last = (avx2._mm256_unpacklo_epi64(ab, cd), avx2._mm256_unpackhi_epi64(ab, cd));
    [
        bytemuck::cast(first.0),
        bytemuck::cast(first.1),
        bytemuck::cast(last.0),
        bytemuck::cast(last.1),
    ]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::simd::lanes_of;

    /// Runs `check` without and with vector instructions.
    fn both(check: impl Fn(Simd)) {
        check(Simd::default());
        vectorized(check);
    }

    #[test]
    fn kept_lanes_come_first() {
        both(|simd| {
            for bits in 0..=u16::MAX {
                let mask: Mask = from_fn(|lane| bits >> lane & 1 == 1);
                let mut kept = Vec::new();
                for (half, reorder) in Reorder::kept_first(&mask).into_iter().enumerate() {
                    let lanes = |_| from_fn(|lane| (8 * half + lane) as u32);
                    reorder.columns::<1>(simd, lanes, |_, words| {
                        kept.extend(words[..reorder.kept()].iter().map(|&lane| lane as usize));
                    });
                }
                assert_eq!(kept, lanes_of(bits.into()).collect::<Vec<_>>());
            }
        });
    }

    #[test]
    fn transposed_columns_hold_words_of_rows() {
        let rows: [[u32; 8]; LANES] = from_fn(|row| from_fn(|column| (8 * row + column) as u32));
        both(|simd| {
            let mut columns = [[0; LANES]; 8];
            transpose_rows(simd, &rows.each_ref(), &mut columns);
            for (column, words) in columns.iter().enumerate() {
                assert_eq!(*words, rows.map(|row| row[column]));
            }
            let mut seen = 0;
            for_each_row(simd, &columns, |row, words| {
                assert_eq!(words.as_flattened(), rows[row]);
                seen += 1;
            });
            assert_eq!(seen, LANES);
        });
    }
}
