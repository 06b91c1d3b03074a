//! Sorts photons by bucket on all threads. Chunks of photons are sorted by wide ranges of buckets,
//! the partitions. Then each partition is sorted by bucket. Few photons form one partition and are
//! sorted in one pass.
//!
//! Photons of a bucket keep their order, which does not depend on chunks and partitions. Places,
//! which decide the order of additions, depend on the photons but not on the number of threads.

use super::{OCTET, Octet, OctetPartials, PhotonGrid, PhotonMap};
use crate::base::math::Rgb;
use crate::transport::mis::weights::PhotonPartials;
use crate::transport::photon::{Arrival, Extent, Photon};
use glam::Vec3;
use rayon::prelude::*;

/// Approximate number of photons per chunk and per partition: they stay in the second-level cache.
const CHUNK: usize = 8192;
/// Maximum number of partitions: sorting a chunk writes to as many places in turn.
const PARTITIONS: usize = 256;

/// Fills places without a photon: no query finds it.
const NOTHING: Photon =
    Photon { position: Vec3::NAN, path: 0, flux: Rgb::ZERO, arrival: Arrival(0), from: 0 };

/// Photons in slices.
#[derive(Clone, Copy)]
pub struct PhotonSlices<'a> {
    /// The photons of each slice.
    pub photons: &'a [&'a [Photon]],
    /// Their MIS partials in the same slices; no slices without MIS.
    pub mis_partials: &'a [&'a [PhotonPartials]],
}

/// Consecutive photons sorted by partition. If there is only one partition, `unsorted` alone is
/// used.
#[derive(Debug, Default)]
pub struct PhotonChunk {
    photons: Vec<Photon>,
    /// MIS partials of the photons; empty without MIS.
    mis_partials: Vec<PhotonPartials>,
    /// Bucket of each photon.
    buckets: Vec<u32>,
    /// End of each partition.
    ends: Vec<u32>,
    /// Bucket of each photon in the original order.
    unsorted: Vec<u32>,
}

impl PhotonChunk {
    /// Finds the bucket of each photon, in the original order.
    fn find_buckets(&mut self, slices: &[&[Photon]], grid: &PhotonGrid) {
        // No query finds a position that is not finite: any bucket will do.
        let last = grid.buckets() - 1;
        self.unsorted.clear();
        for photons in slices {
            let bucket = |photon: &Photon| grid.bucket(grid.cell(photon.position.into())).min(last);
            self.unsorted.extend(photons.iter().map(bucket));
        }
    }

    /// Copies the photons of `slices`, sorted by `partitions` ranges of `2^shift` buckets.
    fn sort(&mut self, slices: PhotonSlices, shift: u32, partitions: usize) {
        // The next place of each partition; at the end, the start of the following one.
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
        self.sort_partials(slices.mis_partials, shift, &next);
        let (sorted, buckets) = (&mut self.photons[..count], &mut self.buckets[..count]);
        for Run { photons, buckets: own, .. } in
            runs(PhotonSlices { mis_partials: &[], ..slices }, &self.unsorted)
        {
            for (photon, &bucket) in photons.iter().zip(own) {
                let next = &mut next[(bucket >> shift) as usize];
                let place = *next as usize;
                *next += 1;
                sorted[place] = *photon;
                buckets[place] = bucket;
            }
        }
    }

    /// Copies the MIS partials in the order of the photons, whose partitions start at `next`.
    fn sort_partials(
        &mut self,
        partials: &[&[PhotonPartials]],
        shift: u32,
        next: &[u32; PARTITIONS + 1],
    ) {
        let mut next = *next;
        let count = partials.iter().map(|partials| partials.len()).sum();
        self.mis_partials.resize(count, PhotonPartials::default());
        for (partial, bucket) in partials.iter().copied().flatten().zip(&self.unsorted) {
            let next = &mut next[(bucket >> shift) as usize];
            self.mis_partials[*next as usize] = *partial;
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
            mis_partials: self.mis_partials.get(range).unwrap_or(&[]),
        }
    }
}

/// Photons, their buckets, and their MIS partials, which are empty without MIS.
#[derive(Clone, Copy)]
struct Run<'a> {
    photons: &'a [Photon],
    buckets: &'a [u32],
    mis_partials: &'a [PhotonPartials],
}

/// The photons of slices, with their buckets, which are in the same order.
fn runs<'a>(slices: PhotonSlices<'a>, mut buckets: &'a [u32]) -> Vec<Run<'a>> {
    let mut run = |(index, photons): (usize, &&'a [Photon])| Run {
        photons,
        buckets: buckets.split_off(..photons.len()).expect("one for each"),
        mis_partials: slices.mis_partials.get(index).copied().unwrap_or(&[]),
    };
    slices.photons.iter().enumerate().map(&mut run).collect()
}

/// The places of one partition in the map.
struct Partition<'a> {
    /// Place of its first photon.
    offset: u32,
    starts: &'a mut [u32],
    octets: &'a mut [Octet],
    directions: &'a mut [u32],
    mis_partials: &'a mut [OctetPartials],
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
        for Run { photons, buckets, mis_partials } in runs.iter().rev() {
            for (index, (photon, bucket)) in photons.iter().zip(*buckets).enumerate().rev() {
                let start = &mut self.starts[(bucket - first) as usize];
                *start -= 1;
                let place = (*start - self.offset) as usize;
                self.octets[place / OCTET].set(place % OCTET, photon);
                if let Some(direction) = self.directions.get_mut(place) {
                    *direction = photon.from;
                }
                if let Some(octet) = self.mis_partials.get_mut(place / OCTET) {
                    for (lanes, partial) in octet.iter_mut().zip(mis_partials[index]) {
                        lanes[place % OCTET] = partial;
                    }
                }
            }
        }
        for place in (end - self.offset) as usize..self.octets.len() * OCTET {
            self.octets[place / OCTET].set(place % OCTET, &NOTHING);
        }
    }
}

/// Replaces counts by the ends of as many places, from `end` on, and advances `end` past all of
/// them.
fn add_up(counts: &mut [u32], end: &mut u32) {
    for count in counts {
        *end += *count;
        *count = *end;
    }
}

/// Splits the first `count` elements off `rest`.
fn take<'a, T>(rest: &mut &'a mut [T], count: usize) -> &'a mut [T] {
    rest.split_off_mut(..count).expect("there are as many")
}

impl PhotonMap {
    /// Sorts the photons into the buckets of `self.grid`.
    pub(super) fn sort(&mut self, slices: PhotonSlices, extent: &Extent) {
        let Extent { count, has_directions, .. } = *extent;
        let PhotonSlices { photons, mis_partials } = slices;
        let buckets = self.grid.buckets() as usize;
        let partitions = (count / CHUNK).next_power_of_two().min(PARTITIONS);
        let shift = buckets.div_ceil(partitions).next_power_of_two().ilog2();
        let in_one_pass = partitions == 1;
        let per_chunk = photons.len().div_ceil(if in_one_pass { 1 } else { count / CHUNK });
        self.chunks.resize_with(photons.len().div_ceil(per_chunk), PhotonChunk::default);
        let grid = &self.grid;
        let weighted = !mis_partials.is_empty();
        let all = self.chunks.par_iter_mut().zip(photons.par_chunks(per_chunk)).enumerate();
        all.for_each(|(index, (chunk, photons))| {
            chunk.find_buckets(photons, grid);
            if !in_one_pass {
                let mis_partials = mis_partials.chunks(per_chunk).nth(index).unwrap_or(&[]);
                chunk.sort(PhotonSlices { photons, mis_partials }, shift, partitions);
            }
        });
        let chunks = &self.chunks[..];
        let runs = |partition: usize| match chunks {
            [chunk] if in_one_pass => runs(slices, &chunk.unsorted),
            _ => chunks.iter().map(|chunk| chunk.partition(partition)).collect(),
        };

        // Each partition starts with a new octet, so that threads can fill them at the same time.
        let sizes: Vec<usize> = (0..partitions)
            .map(|p| runs(p).iter().map(|run| run.photons.len()).sum::<usize>())
            .map(|photons: usize| photons.next_multiple_of(OCTET))
            .collect();
        let places = sizes.iter().sum();
        assert!(u32::try_from(places).is_ok(), "the photon map holds fewer than 2^32 photons");
        self.octets.resize(places / OCTET, Octet::default());
        self.directions.resize(if has_directions { places } else { 0 }, 0);
        let partials = if weighted { places / OCTET } else { 0 };
        self.mis_partials.resize(partials, OctetPartials::default());
        self.starts.resize(buckets + 1, 0);
        self.starts[buckets] = places as u32;

        let mut starts = &mut self.starts[..buckets];
        let (mut octets, mut directions) = (&mut self.octets[..], &mut self.directions[..]);
        let mut mis_partials = &mut self.mis_partials[..];
        let mut offset = 0;
        let all: Vec<Partition> = sizes
            .iter()
            .map(|&size| {
                let own = starts.len().min(1 << shift);
                let partition = Partition {
                    offset,
                    starts: take(&mut starts, own),
                    octets: take(&mut octets, size / OCTET),
                    directions: take(&mut directions, if has_directions { size } else { 0 }),
                    mis_partials: take(&mut mis_partials, if weighted { size / OCTET } else { 0 }),
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
