//! Many look-ups in an order in which they share what they read.

use super::PhotonMap;
use crate::simd::LANES;
use glam::Vec3;

/// Zones of a map, at most: as many places are written to in turn.
pub(super) const ZONES: usize = 4096;

/// Where photons are looked up, and which of those within the radius count.
#[derive(Clone, Copy, Debug, Default)]
#[repr(C, align(32))] // half a cache line
pub struct LookUp {
    /// Center of the look-up, scene units.
    pub position: Vec3,
    /// Number of the gather point's lane among those of all packets.
    pub point: u32,
    /// Photons count that arrived on the side of a surface that this normal points to.
    pub normal: Vec3,
    /// Whether photons of all classes count, or those alone that are merged at every vertex.
    pub last: bool,
    /// Whether photons count by the direction that they come from.
    pub view: bool,
    /// Where it is; set by [`LookUps::sort`].
    pub zone: u16,
}

/// Look-ups zone by zone; buffers are reused.
#[derive(Debug, Default)]
pub struct LookUps {
    ordered: Vec<LookUp>,
    /// As they came.
    unordered: Vec<LookUp>,
}

impl LookUps {
    /// Takes those that may find photons in `map`.
    #[inline(always)] // vectorized
    pub fn sort(&mut self, map: &PhotonMap, look_ups: impl Iterator<Item = LookUp>) {
        let Self { ordered, unordered } = self;
        let mut starts = [0u32; ZONES + 1];
        unordered.clear();
        unordered.extend(look_ups.filter_map(|look_up| {
            let zone = map.zone(look_up.position)?;
            starts[usize::from(zone) + 1] += 1;
            Some(LookUp { zone, ..look_up })
        }));
        for zone in 1..ZONES {
            starts[zone] += starts[zone - 1];
        }
        ordered.resize(unordered.len(), LookUp::default());
        for look_up in unordered {
            let next = &mut starts[usize::from(look_up.zone)];
            ordered[*next as usize] = *look_up;
            *next += 1;
        }
    }

    /// All of them, sixteen at most at a time.
    pub fn packets(&self) -> impl Iterator<Item = &[LookUp]> {
        self.ordered.chunks(LANES)
    }
}
