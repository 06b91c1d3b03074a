//! The pairs of light paths and camera paths that meet: written in the order in which they are
//! found, read camera path by camera path.

use bytemuck::{Pod, Zeroable};
use std::ops;

/// A part of what a light path contributes to a camera path. All parts of a pair of paths add up to
/// `I_ij`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct Pair {
    /// Number of the light path.
    pub light_path: u32,
    /// Luminance of the part, W/(m^2 sr).
    pub value: f32,
}

/// Pairs of many camera paths; buffers are reused.
#[derive(Debug, Default)]
pub struct PairList {
    /// In the order in which they were found. The first `count` are valid.
    pairs: Vec<Pair>,
    count: usize,
    runs: Vec<Run>,
    /// Runs in the order of their camera paths.
    ordered: Vec<Run>,
    /// Start of the runs of each camera path, and the end of all.
    starts: Vec<u32>,
    /// The first camera path.
    first: usize,
}

/// Pairs at one gather point.
#[derive(Clone, Copy, Debug, Default)]
struct Run {
    camera_path: u32,
    start: u32,
    end: u32,
    nested: [f32; 2],
}

impl PairList {
    /// Removes all pairs.
    pub fn clear(&mut self) {
        self.count = 0;
        self.runs.clear();
    }

    /// Number of pairs.
    pub fn len(&self) -> usize {
        self.count
    }

    /// Tests whether there is no pair.
    pub fn is_empty(&self) -> bool {
        self.count == 0
    }

    /// Space for up to `max` pairs of one gather point; [`Self::commit`] adds those that were
    /// written.
    #[inline]
    pub(crate) fn space(&mut self, max: usize) -> &mut [Pair] {
        let end = self.count + max;
        if self.pairs.len() < end {
            self.pairs.resize(end + end / 4, Pair::default());
        }
        &mut self.pairs[self.count..end]
    }

    /// Adds the first `count` pairs that were written to [`Self::space`], all at one gather point
    /// of a camera path. `nested` is how much larger their values are at the merge radii than at
    /// `1/sqrt(2)` of them, and how much larger there than at half of them.
    #[inline]
    pub(crate) fn commit(&mut self, count: usize, camera_path: u32, nested: [f32; 2]) {
        let start = self.count as u32;
        self.count += count;
        self.runs.push(Run { camera_path, start, end: self.count as u32, nested });
    }

    /// Sorts the pairs by camera path; `camera_paths` holds all paths. Pairs of one path keep their
    /// order: this is a counting sort.
    pub(crate) fn order_by_path(&mut self, camera_paths: ops::Range<usize>) {
        let Self { runs, ordered, starts, first, .. } = self;
        *first = camera_paths.start;
        let path = |run: &Run| run.camera_path as usize - camera_paths.start;
        starts.clear();
        // One more in front: the place of a path's next run becomes the start of the following
        // path.
        starts.resize(camera_paths.len() + 2, 0);
        for run in &*runs {
            starts[path(run) + 2] += 1;
        }
        let mut sum = 0;
        for start in &mut *starts {
            sum += *start;
            *start = sum;
        }
        ordered.resize(runs.len(), Run::default());
        for run in &*runs {
            let next = &mut starts[path(run) + 1];
            ordered[*next as usize] = *run;
            *next += 1;
        }
    }

    /// The pairs of one camera path, gather point by gather point, with the differences between
    /// nested radii that [`Self::commit`] takes.
    #[inline]
    pub fn of_path(&self, camera_path: usize) -> impl Iterator<Item = (&[Pair], [f32; 2])> {
        let path = camera_path - self.first;
        let runs = &self.ordered[self.starts[path] as usize..self.starts[path + 1] as usize];
        runs.iter().map(|run| (&self.pairs[run.start as usize..run.end as usize], run.nested))
    }
}
