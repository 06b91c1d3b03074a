//! A queue of path segments, sixteen side by side, packed without gaps.

use crate::accel::RayPacket;
use crate::simd::dispatch::{Reorder, Simd};
use crate::simd::{LANES, Mask};
use bytemuck::Pod;
use std::marker::PhantomData;

/// `N` columns of sixteen words. The first six are origins and directions of rays.
pub(crate) trait Columns<const N: usize>: Pod {
    /// End of the rays, in multiples of the length of their direction.
    const T_FAR: f32;
}

/// Rays with the states of their paths.
#[derive(Clone, Debug, Default)]
pub(crate) struct PathQueue<P, const N: usize> {
    chunks: Vec<ColumnChunk<N>>,
    len: usize,
    rays: Vec<RayPacket>,
    packets: PhantomData<P>,
}

/// Lanes of the queue, column by column. Behind each column is room for the excess of sixteen new
/// lanes, which then moves to the next chunk.
type ColumnChunk<const N: usize> = [[u32; CHUNK + LANES]; N];

/// Lanes of a chunk. As a constant it leaves one bounds check for all columns.
const CHUNK: usize = 512;

impl<P: Columns<N>, const N: usize> PathQueue<P, N> {
    /// Removes all lanes.
    pub fn clear(&mut self) {
        self.len = 0;
    }

    /// Number of lanes.
    pub fn len(&self) -> usize {
        self.len
    }

    /// Sets `packet` to the sixteen lanes from `16 * index` on. Returns how many of them there are.
    #[inline(always)] // part of the loops over vertices
    pub fn load(&self, index: usize, packet: &mut P) -> usize {
        let (chunk, first) = (&self.chunks[index * LANES / CHUNK], index * LANES % CHUNK);
        for (words, column) in columns_mut(packet).iter_mut().zip(chunk) {
            *words = column[first..first + LANES].try_into().unwrap();
        }
        LANES.min(self.len - index * LANES)
    }

    /// The rays in packets, as backends take them.
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
            // Writes all eight: the next lanes replace those that are not kept. Branches on random
            // masks could not be predicted.
            reorder.columns::<N>(
                simd,
                |column| columns(packet)[column].as_chunks().0[half],
                |column, eight| chunk[column][at..at + 8].copy_from_slice(&eight),
            );
            at += reorder.kept();
        }
        self.len = self.len / CHUNK * CHUNK + at;
        if at >= CHUNK {
            self.start_chunk();
        }
    }

    /// The chunk with the next free lane.
    #[inline(always)]
    fn chunk(&mut self) -> &mut ColumnChunk<N> {
        if self.len / CHUNK == self.chunks.len() {
            self.chunks.push([[0; CHUNK + LANES]; N]);
        }
        &mut self.chunks[self.len / CHUNK]
    }

    /// Starts another chunk with the excess lanes of the last one.
    #[cold]
    fn start_chunk(&mut self) {
        let next = self.len / CHUNK;
        if next == self.chunks.len() {
            self.chunks.push([[0; CHUNK + LANES]; N]);
        }
        let [before, next] = &mut self.chunks[next - 1..=next] else { unreachable!() };
        for (before, next) in before.iter().zip(next) {
            next[..LANES].copy_from_slice(&before[CHUNK..]);
        }
    }

    /// Adds the first lane of a packet.
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
        let mut queue = PathQueue::<[[f32; LANES]; 7], 7>::default();
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
            queue.append(simd, &kept, &packet);
            expected
                .extend(names.iter().zip(kept).filter(|&(_, kept)| kept).map(|(&name, _)| name));
            if round % 3 == 0 {
                queue.push(&packet);
                expected.push(names[0]);
            }
        }
        assert_eq!(queue.len(), expected.len());
        for (index, &name) in expected.iter().enumerate() {
            let mut packet = [[0.0; LANES]; 7];
            let count = queue.load(index / LANES, &mut packet);
            assert_eq!(count, LANES.min(expected.len() - index / LANES * LANES));
            let columns = packet.map(|column| column[index % LANES]);
            assert_eq!(columns, [0, 1, 2, 3, 4, 5, 6].map(|column| name + 0.125 * column as f32));
            let ray = queue.rays()[index / LANES].get(index % LANES);
            assert_eq!(ray.origin.to_array(), columns[..3]);
            assert_eq!(ray.direction.to_array(), columns[3..6]);
            assert_eq!((ray.t_near, ray.t_far), (0.0, 1.0));
        }
    }

    #[test]
    fn full_chunks_keep_all_lanes() {
        let mut queue = PathQueue::<[[f32; LANES]; 7], 7>::default();
        for index in 0..2 * CHUNK / LANES {
            queue.append(Simd::default(), &[true; LANES], &[[index as f32; LANES]; 7]);
        }
        assert_eq!(queue.len(), 2 * CHUNK);
        assert_eq!(queue.rays().len(), 2 * CHUNK / LANES);
        for index in 0..2 * CHUNK / LANES {
            let mut packet = [[0.0; LANES]; 7];
            assert_eq!(queue.load(index, &mut packet), LANES);
            assert_eq!(packet, [[index as f32; LANES]; 7]);
        }
    }

    #[test]
    fn appended_lanes_keep_their_order() {
        check(Simd::default());
        vectorized(check);
    }
}
