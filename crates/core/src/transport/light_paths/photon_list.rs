//! A growing list of photons.

use crate::simd::LANES;
use crate::transport::photon::Photon;

/// Photons by which a full [`PhotonList`] grows.
const STEP: usize = 256;

/// A list to which photons are added sixteen at a time.
#[derive(Debug, Default)]
pub(super) struct PhotonList {
    /// The first `count` are valid.
    buffer: Vec<Photon>,
    count: usize,
}

impl PhotonList {
    pub fn clear(&mut self) {
        self.count = 0;
    }

    pub fn as_slice(&self) -> &[Photon] {
        &self.buffer[..self.count]
    }

    /// Space for the photons of sixteen paths; [`Self::commit`] adds those that were written.
    #[inline(always)]
    pub fn space(&mut self) -> &mut [Photon; LANES] {
        let end = self.count + LANES;
        if self.buffer.len() < end {
            self.buffer.resize(end.next_multiple_of(STEP), Photon::default());
        }
        self.buffer[self.count..].first_chunk_mut().expect("there is room")
    }

    /// Adds the first `count` photons that were written to [`Self::space`].
    #[inline(always)]
    pub fn commit(&mut self, count: usize) {
        self.count += count;
    }

    pub fn push(&mut self, photon: Photon) {
        self.space()[0] = photon;
        self.commit(1);
    }
}
