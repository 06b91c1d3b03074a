//! Paths under way, sixteen side by side, packed without gaps.

use crate::accel::RayPacket;
use crate::simd::dispatch::{Reorder, Simd};
use crate::simd::{LANES, Mask};
use bytemuck::Pod;
use std::marker::PhantomData;

/// `N` columns of sixteen words, the first six of which are origins and directions of rays.
pub(crate) trait Columns<const N: usize>: Pod {
    /// Where the rays end, in multiples of their direction's length.
    const T_FAR: f32;
}

/// Rays with what goes with them.
#[derive(Clone, Debug, Default)]
pub(crate) struct Flight<P, const N: usize> {
    chunks: Vec<Chunk<N>>,
    len: usize,
    rays: Vec<RayPacket>,
    packets: PhantomData<P>,
}

/// Column by column. Behind each is room for what sixteen new ones have too many; it moves on to the next
/// chunk.
type Chunk<const N: usize> = [[u32; CHUNK + LANES]; N];

/// Lanes of a chunk. That it is constant leaves one check of an index for all columns.
const CHUNK: usize = 512;

impl<P: Columns<N>, const N: usize> Flight<P, N> {
    /// Takes all out.
    pub fn clear(&mut self) {
        self.len = 0;
    }

    /// How many there are.
    pub fn len(&self) -> usize {
        self.len
    }

    /// Sets `packet` to sixteen of them, `16 index` and on; how many there are.
    #[inline(always)] // part of the loops over vertices
    pub fn load(&self, index: usize, packet: &mut P) -> usize {
        let (chunk, first) = (&self.chunks[index * LANES / CHUNK], index * LANES % CHUNK);
        for (words, column) in columns_mut(packet).iter_mut().zip(chunk) {
            *words = column[first..first + LANES].try_into().unwrap();
        }
        LANES.min(self.len - index * LANES)
    }

    /// The rays, as backends take them.
    #[inline(always)] // part of vectorized code
    pub fn rays(&mut self) -> &[RayPacket] {
        let packets = self.len.div_ceil(LANES);
        if self.rays.len() < packets {
            self.rays.resize(packets, RayPacket::until(P::T_FAR));
        }
        for (index, rays) in self.rays[..packets].iter_mut().enumerate() {
            let (chunk, first) = (&self.chunks[index * LANES / CHUNK], index * LANES % CHUNK);
            for (words, column) in columns_mut(rays)[..6].iter_mut().zip(chunk) {
                *words = column[first..first + LANES].try_into().unwrap();
            }
        }
        &self.rays[..packets]
    }

    /// Adds the lanes that are `kept`, in their order.
    #[inline(always)] // part of the loops over vertices
    pub fn append(&mut self, simd: Simd, kept: &Mask, packet: &P) {
        const { assert!(size_of::<P>() == N * size_of::<[u32; LANES]>()) };
        let mut at = self.len % CHUNK;
        let chunk = self.chunk();
        for (half, reorder) in Reorder::kept_first(kept).into_iter().enumerate() {
            // Always eight: behind those that are kept comes anything, which the next replace. A branch for
            // each would be decided by chance, and nothing predicts that.
            reorder.columns::<N>(
                simd,
                |column| columns(packet)[column].as_chunks().0[half],
                |column, eight| chunk[column][at..at + 8].copy_from_slice(&eight),
            );
            at += reorder.kept();
        }
        self.len = self.len / CHUNK * CHUNK + at;
        if at >= CHUNK {
            self.move_on();
        }
    }

    /// The one with the next lane to take.
    #[inline(always)]
    fn chunk(&mut self) -> &mut Chunk<N> {
        if self.len / CHUNK == self.chunks.len() {
            self.chunks.push([[0; CHUNK + LANES]; N]);
        }
        &mut self.chunks[self.len / CHUNK]
    }

    /// Starts another chunk with what the last one has too many.
    #[cold]
    fn move_on(&mut self) {
        let next = self.len / CHUNK;
        if next == self.chunks.len() {
            self.chunks.push([[0; CHUNK + LANES]; N]);
        }
        let [before, next] = &mut self.chunks[next - 1..=next] else { unreachable!() };
        for (before, next) in before.iter().zip(next) {
            next[..LANES].copy_from_slice(&before[CHUNK..]);
        }
    }

    /// Adds the first lane.
    pub fn push(&mut self, packet: &P) {
        let at = self.len % CHUNK;
        for (column, words) in self.chunk().iter_mut().zip(columns(packet)) {
            column[at] = words[0];
        }
        self.len += 1;
    }
}

#[inline(always)]
fn columns<C: Pod>(packet: &C) -> &[[u32; LANES]] {
    bytemuck::cast_slice(std::slice::from_ref(packet))
}

#[inline(always)]
fn columns_mut<C: Pod>(packet: &mut C) -> &mut [[u32; LANES]] {
    bytemuck::cast_slice_mut(std::slice::from_mut(packet))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::simd::dispatch::vectorized;

    impl Columns<7> for [[f32; LANES]; 7] {
        const T_FAR: f32 = 1.0;
    }

    fn check(simd: Simd) {
        let mut flight = Flight::<[[f32; LANES]; 7], 7>::default();
        let mut expected = Vec::new();
        for round in 0..100_u32 {
            let names: [f32; LANES] =
                std::array::from_fn(|lane| (round * 100 + lane as u32) as f32);
            let packet =
                std::array::from_fn(|column| names.map(|name| name + 0.125 * column as f32));
            // All, none, and many in between.
            let pattern = match round % 5 {
                0 => 0xffff,
                1 => 0,
                _ => round.wrapping_mul(0x9e37_79b9) >> 16,
            };
            let kept = std::array::from_fn(|lane| pattern >> lane & 1 == 1);
            flight.append(simd, &kept, &packet);
            expected
                .extend(names.iter().zip(kept).filter(|&(_, kept)| kept).map(|(&name, _)| name));
            if round % 3 == 0 {
                flight.push(&packet);
                expected.push(names[0]);
            }
        }
        assert_eq!(flight.len(), expected.len());
        for (index, &name) in expected.iter().enumerate() {
            let mut packet = [[0.0; LANES]; 7];
            let count = flight.load(index / LANES, &mut packet);
            assert_eq!(count, LANES.min(expected.len() - index / LANES * LANES));
            let columns = packet.map(|column| column[index % LANES]);
            assert_eq!(columns, [0, 1, 2, 3, 4, 5, 6].map(|column| name + 0.125 * column as f32));
            let ray = flight.rays()[index / LANES].get(index % LANES);
            assert_eq!(ray.origin.to_array(), columns[..3]);
            assert_eq!(ray.direction.to_array(), columns[3..6]);
            assert_eq!((ray.t_near, ray.t_far), (0.0, 1.0));
        }
    }

    #[test]
    fn chunks_are_filled_to_their_ends() {
        let mut flight = Flight::<[[f32; LANES]; 7], 7>::default();
        for index in 0..2 * CHUNK / LANES {
            flight.append(Simd::default(), &[true; LANES], &[[index as f32; LANES]; 7]);
        }
        assert_eq!(flight.len(), 2 * CHUNK);
        assert_eq!(flight.rays().len(), 2 * CHUNK / LANES);
        for index in 0..2 * CHUNK / LANES {
            let mut packet = [[0.0; LANES]; 7];
            assert_eq!(flight.load(index, &mut packet), LANES);
            assert_eq!(packet, [[index as f32; LANES]; 7]);
        }
    }

    #[test]
    fn those_that_are_kept_follow_each_other_in_their_order() {
        check(Simd::default());
        vectorized(check);
    }
}
