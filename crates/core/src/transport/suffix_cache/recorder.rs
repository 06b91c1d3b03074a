//! Records of suffixes: what full camera paths contribute from a diffuse vertex on.

use crate::base::math::Rgb;
use glam::Vec3;

/// The suffix of a camera path from one of its diffuse vertices on.
#[derive(Clone, Copy, Debug)]
pub struct SuffixRecord {
    /// The vertex.
    pub position: Vec3,
    /// Its unit shading normal, on the side that is seen.
    pub normal: Vec3,
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
}

impl SuffixRecorder {
    /// Begins with `paths` paths.
    pub fn start(&mut self, paths: usize) {
        self.records.clear();
        self.current = 0;
        self.others.clear();
        self.others.resize(paths, Rgb::ZERO);
    }

    /// Adds a vertex. The light is what the path has contributed before it was connected.
    #[inline]
    pub fn push(&mut self, record: SuffixRecord) {
        self.records.push(record);
    }

    /// Adds light that another lobe of the path's current vertex contributes.
    #[inline]
    pub fn add_other(&mut self, path: usize, light: Rgb) {
        self.others[path] += light;
    }

    /// Ends the current vertices: all of them are connected. `direct` has what each path has
    /// contributed.
    pub fn end_vertices(&mut self, direct: &[Rgb]) {
        for record in &mut self.records[self.current..] {
            let path = record.path as usize;
            let connected = direct[path] - record.light - self.others[path];
            record.light = connected - record.prob * direct[path];
        }
        self.others.fill(Rgb::ZERO);
        self.current = self.records.len();
    }

    /// Ends all paths. Returns their records.
    pub fn end_paths(&mut self, direct: &[Rgb]) -> impl Iterator<Item = SuffixRecord> {
        self.records.iter().map(|record| {
            let light = record.light + record.prob * direct[record.path as usize];
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
            position: Vec3::ZERO,
            normal: Vec3::Z,
            carried: Rgb::ONE,
            light: Rgb::splat(light),
            prob: 0.5,
            distance: 1.0,
            path: 0,
        };
        // Light of 3 before, of 2 by the lobe and 5 by another, and of 8 from further on.
        recorder.push(at(3.0));
        recorder.add_other(0, Rgb::splat(5.0));
        recorder.end_vertices(&[Rgb::splat(10.0)]);
        // The next vertex has no record, and other lobes again.
        recorder.add_other(0, Rgb::splat(1.0));
        recorder.end_vertices(&[Rgb::splat(14.0)]);
        let ended: Vec<_> = recorder.end_paths(&[Rgb::splat(18.0)]).collect();
        assert_eq!(ended.len(), 1);
        assert_eq!(ended[0].light, Rgb::splat(2.0 + 0.5 * 8.0));
    }
}
