//! Records of suffixes: what full camera paths contribute from a diffuse vertex on.

use super::CellPoint;
use crate::base::math::Rgb;
use std::cmp::Ordering;

/// The suffix of a camera path from one of its diffuse vertices on.
#[derive(Clone, Copy, Debug)]
pub struct SuffixRecord {
    /// The vertex.
    pub at: CellPoint,
    /// Throughput of the path up to the vertex times the albedo of the diffuse lobe.
    pub carried: Rgb,
    /// Contribution of the lobe to the path, W/(m^2 sr): light connected at the vertex, and light
    /// from further on. Over `carried` it is the incident light, averaged over the lobe.
    pub light: Rgb,
    /// Probability that the path took the lobe. Light that it finds further on was divided by it.
    pub prob: f32,
    /// Length of the segment to the vertex, scene units.
    pub distance: f32,
    /// Number of the path.
    pub path: u32,
    /// Number of the wave of segments that ended at the vertex.
    pub wave: u32,
}

/// Light of photons that were merged with a path at one of its vertices.
#[derive(Clone, Copy, Debug)]
pub struct MergedLight {
    /// Number of the path.
    pub path: u32,
    /// Number of the wave of segments that ended at the vertex.
    pub wave: u32,
    /// Contribution to the path, W/(m^2 sr).
    pub light: Rgb,
}

impl SuffixRecord {
    /// Half of the suffix paths that it belongs to.
    #[inline]
    pub fn half(&self) -> usize {
        self.path as usize & 1
    }
}

/// Collects the records of the batch of camera paths that is being traced.
#[derive(Clone, Debug, Default)]
pub struct SuffixRecorder {
    records: Vec<SuffixRecord>,
    /// First record of the vertices that are being shaded.
    current: usize,
    /// For each path what other lobes contribute by connections at its current vertex.
    others: Vec<Rgb>,
    /// Gather points at the ends of the waves so far.
    waves: Vec<usize>,
}

impl SuffixRecorder {
    /// Begins with `paths` paths.
    pub fn start(&mut self, paths: usize) {
        self.records.clear();
        self.current = 0;
        self.waves.clear();
        self.others.clear();
        self.others.resize(paths, Rgb::ZERO);
    }

    /// Adds a vertex of the current wave. The light is what the path has contributed before it was
    /// connected.
    #[inline]
    pub fn push(&mut self, record: SuffixRecord) {
        let wave = self.waves.len() as u32;
        self.records.push(SuffixRecord { wave, ..record });
    }

    /// Number of the wave in which the gather point of this number was found.
    pub fn wave_of(&self, point: usize) -> u32 {
        self.waves.partition_point(|end| *end <= point) as u32
    }

    /// Adds light that another lobe of the path's current vertex contributes.
    #[inline]
    pub fn add_other(&mut self, path: usize, light: Rgb) {
        self.others[path] += light;
    }

    /// Ends the current wave, up to this gather point: all of its vertices are connected. `direct`
    /// has what each path has contributed.
    pub fn end_vertices(&mut self, direct: &[Rgb], point: usize) {
        self.waves.push(point);
        for record in &mut self.records[self.current..] {
            let path = record.path as usize;
            let connected = direct[path] - record.light - self.others[path];
            record.light = connected - record.prob * direct[path];
        }
        self.others.fill(Rgb::ZERO);
        self.current = self.records.len();
    }

    /// Ends all paths, to which `merged` adds light of photons, in the order of the paths. Returns
    /// their records.
    pub fn end_paths(
        &mut self,
        direct: &[Rgb],
        merged: &[MergedLight],
    ) -> impl Iterator<Item = SuffixRecord> {
        self.records.iter().map(|record| {
            let SuffixRecord { path, wave, prob, .. } = *record;
            let mut light = record.light + prob * direct[path as usize];
            let first = merged.partition_point(|own| own.path < path);
            for own in merged[first..].iter().take_while(|own| own.path == path) {
                // The lobe alone merges photons at its own vertex.
                light += match own.wave.cmp(&wave) {
                    Ordering::Less => Rgb::ZERO,
                    Ordering::Equal => own.light,
                    Ordering::Greater => prob * own.light,
                };
            }
            SuffixRecord { light, ..*record }
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn records_hold_what_their_lobe_contributes() {
        let mut recorder = SuffixRecorder::default();
        recorder.start(1);
        let at = |light: f32| SuffixRecord {
            at: CellPoint::default(),
            carried: Rgb::ONE,
            light: Rgb::splat(light),
            prob: 0.5,
            distance: 1.0,
            path: 0,
            wave: 0,
        };
        // Light of 3 before, of 2 by the lobe and 5 by another, and of 8 from further on.
        recorder.push(at(3.0));
        recorder.add_other(0, Rgb::splat(5.0));
        recorder.end_vertices(&[Rgb::splat(10.0)], 3);
        // The next vertex has no record, and other lobes again.
        recorder.add_other(0, Rgb::splat(1.0));
        recorder.end_vertices(&[Rgb::splat(14.0)], 5);
        let ended: Vec<_> = recorder.end_paths(&[Rgb::splat(18.0)], &[]).collect();
        assert_eq!(ended.len(), 1);
        assert_eq!(ended[0].light, Rgb::splat(2.0 + 0.5 * 8.0));
        // Photons of 16 at the vertex and of 64 at the next one; the others are of another path.
        assert_eq!([0, 2, 3, 4].map(|point| recorder.wave_of(point)), [0, 0, 1, 1]);
        let merged = [(0, 0, 16.0), (0, 1, 64.0), (1, 0, 256.0)];
        let merged =
            merged.map(|(path, wave, light)| MergedLight { path, wave, light: Rgb::splat(light) });
        let ended: Vec<_> = recorder.end_paths(&[Rgb::splat(18.0)], &merged).collect();
        assert_eq!(ended[0].light, Rgb::splat(6.0 + 16.0 + 0.5 * 64.0));
    }
}
