//! Which light paths meet which camera paths, and what they bring: in any order as they are found, camera
//! path after camera path as they are read.

use bytemuck::{Pod, Zeroable};
use std::ops;

/// A part of what a light path contributes to a camera path; all its parts add up to `I_ij`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct Pair {
    /// Which light path.
    pub light_path: u32,
    /// Luminance of the part, W/(m^2 sr).
    pub value: f32,
}

/// Pairs of many camera paths; buffers are reused.
#[derive(Debug, Default)]
pub struct PairList {
    /// As they were found; any after the first `count`.
    pairs: Vec<Pair>,
    count: usize,
    runs: Vec<Run>,
    /// Runs in the order of their camera paths.
    ordered: Vec<Run>,
    /// Where those of each camera path begin, and the end of all.
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
    /// Takes all out.
    pub fn clear(&mut self) {
        self.count = 0;
        self.runs.clear();
    }

    /// How many were found.
    pub fn len(&self) -> usize {
        self.count
    }

    /// Whether none was found.
    pub fn is_empty(&self) -> bool {
        self.count == 0
    }

    /// Where at most so many more can be written before they are [taken](Self::take).
    #[inline]
    pub(crate) fn space(&mut self, most: usize) -> &mut [Pair] {
        let end = self.count + most;
        if self.pairs.len() < end {
            self.pairs.resize(end + end / 4, Pair::default());
        }
        &mut self.pairs[self.count..end]
    }

    /// Takes the first `count` of those that were written: found at one gather point of a camera path, whose
    /// value they make larger by `nested` in all than at `1/sqrt(2)` of the merge radii, and there than at
    /// half of them.
    #[inline]
    pub(crate) fn take(&mut self, count: usize, camera_path: u32, nested: [f32; 2]) {
        let start = self.count as u32;
        self.count += count;
        self.runs.push(Run { camera_path, start, end: self.count as u32, nested });
    }

    /// Puts all in the order of their camera paths, which are these; those of one path stay in theirs (a
    /// counting sort).
    pub(crate) fn order_by_path(&mut self, camera_paths: ops::Range<usize>) {
        let Self { runs, ordered, starts, first, .. } = self;
        *first = camera_paths.start;
        let path = |run: &Run| run.camera_path as usize - camera_paths.start;
        starts.clear();
        // One more in front: where the next of each path goes becomes where those of the next begin.
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

    /// The pairs of one camera path, gather point after gather point, with what each point's lose from the merge
    /// radii to `1/sqrt(2)` of them, and on to half.
    #[inline]
    pub fn of_path(&self, camera_path: usize) -> impl Iterator<Item = (&[Pair], [f32; 2])> {
        let path = camera_path - self.first;
        let runs = &self.ordered[self.starts[path] as usize..self.starts[path + 1] as usize];
        runs.iter().map(|run| (&self.pairs[run.start as usize..run.end as usize], run.nested))
    }
}
