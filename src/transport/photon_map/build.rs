//! Sorts photons by bucket on all threads: first within chunks of them by wide ranges of buckets,
//! the partitions, then each partition by bucket. Few photons are one partition and sorted in one go.
//!
//! Photons of a bucket keep their order, which does not depend on chunks and partitions. Places, which
//! decide the order of additions, depend on the photons but not on the number of threads.

use super::{Grid, PhotonMap, QUAD, Quad};
use crate::base::math::Rgb;
use crate::transport::photon::{Extent, Photon, Side};
use glam::Vec3;
use rayon::prelude::*;

/// Photons per chunk, and per partition, about: they stay in the second-level cache.
const CHUNK: usize = 8192;
/// Most partitions: so many places are written to in turn.
const PARTITIONS: usize = 256;

/// Fills places that hold no photon: no look-up finds it.
const NOTHING: Photon =
    Photon { position: Vec3::NAN, path: 0, flux: Rgb::ZERO, side: Side(0), from: 0 };

/// Consecutive photons sorted by partition; if there is only one, their buckets alone.
#[derive(Debug, Default)]
pub struct Chunk {
    photons: Vec<Photon>,
    /// What they carry of their paths' weights, or nothing.
    parts: Vec<f32>,
    /// Bucket of each.
    buckets: Vec<u32>,
    /// Where each partition ends.
    ends: Vec<u32>,
    /// Bucket of each photon in the order they came.
    unsorted: Vec<u32>,
}

impl Chunk {
    /// Finds the bucket of each photon, in the order they come.
    fn find_buckets(&mut self, slices: &[&[Photon]], grid: &Grid) {
        // A position that is not finite, which no look-up finds, has any bucket.
        let last = grid.buckets() - 1;
        self.unsorted.clear();
        for photons in slices {
            let bucket = |photon: &Photon| grid.bucket(grid.cell(photon.position.into())).min(last);
            self.unsorted.extend(photons.iter().map(bucket));
        }
    }

    /// Takes the photons of `slices` and the `parts` of their weights, sorted by `partitions` ranges of
    /// `2^shift` buckets.
    fn sort(&mut self, slices: &[&[Photon]], parts: &[&[f32]], shift: u32, partitions: usize) {
        // Places are handed out from where a partition starts, one ahead of its end.
        let mut next = [0u32; PARTITIONS + 1];
        for bucket in &self.unsorted {
            next[(bucket >> shift) as usize + 1] += 1;
        }
        for i in 1..=partitions {
            next[i] += next[i - 1];
        }
        self.ends.clear();
        self.ends.extend_from_slice(&next[1..=partitions]);
        let count = self.unsorted.len();
        self.buckets.resize(count, 0);
        self.photons.resize(count, Photon::default());
        self.sort_parts(parts, shift, &next);
        let (sorted, buckets) = (&mut self.photons[..count], &mut self.buckets[..count]);
        for Run { photons, buckets: own, .. } in runs(slices, &[], &self.unsorted) {
            for (photon, &bucket) in photons.iter().zip(own) {
                let next = &mut next[(bucket >> shift) as usize];
                let place = *next as usize;
                *next += 1;
                sorted[place] = *photon;
                buckets[place] = bucket;
            }
        }
    }

    /// Takes the parts, if there are any, in the same order as the photons, whose partitions start at `next`.
    fn sort_parts(&mut self, parts: &[&[f32]], shift: u32, next: &[u32; PARTITIONS + 1]) {
        let mut next = *next;
        let count = parts.iter().map(|parts| parts.len()).sum();
        self.parts.resize(count, 0.0);
        for (part, bucket) in parts.iter().copied().flatten().zip(&self.unsorted) {
            let next = &mut next[(bucket >> shift) as usize];
            self.parts[*next as usize] = *part;
            *next += 1;
        }
    }

    /// The photons of one partition and their buckets.
    fn partition(&self, partition: usize) -> Run<'_> {
        let start = partition.checked_sub(1).map_or(0, |before| self.ends[before] as usize);
        let range = start..self.ends[partition] as usize;
        Run {
            photons: &self.photons[range.clone()],
            buckets: &self.buckets[range.clone()],
            parts: self.parts.get(range).unwrap_or(&[]),
        }
    }
}

/// Photons, the bucket of each, and its part of a weight unless there are none.
#[derive(Clone, Copy)]
struct Run<'a> {
    photons: &'a [Photon],
    buckets: &'a [u32],
    parts: &'a [f32],
}

/// The photons of slices, with buckets that are in the same order.
fn runs<'a>(slices: &[&'a [Photon]], parts: &[&'a [f32]], mut buckets: &'a [u32]) -> Vec<Run<'a>> {
    let mut own = |(index, photons): (usize, &&'a [Photon])| Run {
        photons,
        buckets: buckets.split_off(..photons.len()).expect("one for each"),
        parts: parts.get(index).copied().unwrap_or(&[]),
    };
    slices.iter().enumerate().map(&mut own).collect()
}

/// The places of one partition in the map.
struct Partition<'a> {
    /// Of its first photon.
    offset: u32,
    starts: &'a mut [u32],
    quads: &'a mut [Quad],
    froms: &'a mut [u32],
    parts: &'a mut [f32],
}

impl Partition<'_> {
    /// Sorts the partition's photons, whose buckets start at `first`, into their places.
    fn fill(&mut self, runs: &[Run], first: u32) {
        self.starts.fill(0);
        for &bucket in runs.iter().flat_map(|run| run.buckets) {
            self.starts[(bucket - first) as usize] += 1;
        }
        let mut end = self.offset;
        let (most, rest) = self.starts.as_chunks_mut::<8>();
        for eight in most {
            // Photons lie on surfaces: most cells are empty.
            if *eight == [0; 8] {
                *eight = [end; 8];
            } else {
                add_up(eight, &mut end);
            }
        }
        add_up(rest, &mut end);
        // From the last photon to the first, so that ends turn into starts.
        for Run { photons, buckets, parts } in runs.iter().rev() {
            for (index, (photon, bucket)) in photons.iter().zip(*buckets).enumerate().rev() {
                let start = &mut self.starts[(bucket - first) as usize];
                *start -= 1;
                let place = (*start - self.offset) as usize;
                self.quads[place / QUAD].set(place % QUAD, photon);
                if let Some(from) = self.froms.get_mut(place) {
                    *from = photon.from;
                }
                if let Some(part) = self.parts.get_mut(place) {
                    *part = parts[index];
                }
            }
        }
        for place in (end - self.offset) as usize..self.quads.len() * QUAD {
            self.quads[place / QUAD].set(place % QUAD, &NOTHING);
        }
    }
}

/// Where each of these counts ends, and all of them.
fn add_up(counts: &mut [u32], end: &mut u32) {
    for count in counts {
        *end += *count;
        *count = *end;
    }
}

/// Takes the first `count` elements off `rest`.
fn take<'a, T>(rest: &mut &'a mut [T], count: usize) -> &'a mut [T] {
    rest.split_off_mut(..count).expect("there are as many")
}

impl PhotonMap {
    /// Sorts the photons into the buckets of `self.grid`, with the parts of their weights if there are any.
    pub(super) fn sort(&mut self, slices: &[&[Photon]], parts: &[&[f32]], extent: &Extent) {
        let Extent { count, directions, .. } = *extent;
        let buckets = self.grid.buckets() as usize;
        let partitions = (count / CHUNK).next_power_of_two().min(PARTITIONS);
        let shift = buckets.div_ceil(partitions).next_power_of_two().ilog2();
        let in_one_go = partitions == 1;
        let per_chunk = slices.len().div_ceil(if in_one_go { 1 } else { count / CHUNK });
        self.chunks.resize_with(slices.len().div_ceil(per_chunk), Chunk::default);
        let grid = &self.grid;
        let weighted = !parts.is_empty();
        let all = self.chunks.par_iter_mut().zip(slices.par_chunks(per_chunk)).enumerate();
        all.for_each(|(index, (chunk, slices))| {
            chunk.find_buckets(slices, grid);
            if !in_one_go {
                let parts = parts.chunks(per_chunk).nth(index).unwrap_or(&[]);
                chunk.sort(slices, parts, shift, partitions);
            }
        });
        let chunks = &self.chunks[..];
        let runs = |partition: usize| match chunks {
            [chunk] if in_one_go => runs(slices, parts, &chunk.unsorted),
            _ => chunks.iter().map(|chunk| chunk.partition(partition)).collect(),
        };

        // Partitions begin with a quad of their own: they can be filled at the same time.
        let sizes: Vec<usize> = (0..partitions)
            .map(|p| runs(p).iter().map(|run| run.photons.len()).sum::<usize>())
            .map(|photons: usize| photons.next_multiple_of(QUAD))
            .collect();
        let places = sizes.iter().sum();
        assert!(u32::try_from(places).is_ok(), "the photon map holds fewer than 2^32 photons");
        self.quads.resize(places / QUAD, Quad::default());
        self.froms.resize(if directions { places } else { 0 }, 0);
        self.parts.resize(if weighted { places } else { 0 }, 0.0);
        self.starts.resize(buckets + 1, 0);
        self.starts[buckets] = places as u32;

        let mut starts = &mut self.starts[..buckets];
        let (mut quads, mut froms) = (&mut self.quads[..], &mut self.froms[..]);
        let mut part_of_all = &mut self.parts[..];
        let mut offset = 0;
        let all: Vec<Partition> = sizes
            .iter()
            .map(|&size| {
                let own = starts.len().min(1 << shift);
                let partition = Partition {
                    offset,
                    starts: take(&mut starts, own),
                    quads: take(&mut quads, size / QUAD),
                    froms: take(&mut froms, if directions { size } else { 0 }),
                    parts: take(&mut part_of_all, if weighted { size } else { 0 }),
                };
                offset += size as u32;
                partition
            })
            .collect();
        all.into_par_iter().enumerate().with_max_len(1).for_each(|(index, mut partition)| {
            partition.fill(&runs(index), (index as u32) << shift);
        });
    }
}
