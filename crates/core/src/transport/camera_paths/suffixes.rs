//! Suffixes of camera paths: full paths record them, and short paths end where a cache knows them.
//! theory.md, section 11c.

use super::non_diffuse::ScalarVertex;
use super::{CameraPass, CameraPaths};
use crate::base::math::{Rgb, luminance};
use crate::scene::bsdf::coats::CoatSamples;
use crate::scene::bsdf::{Transport, Vertex};
use crate::scene::coated_hits::CoatedVertices;
use crate::scene::diffuse::DiffuseVertices;
use crate::simd::{LANES, Mask};
use crate::transport::merge::{Merge, MergeOutput};
use crate::transport::path_state::{History, PathStates};
use crate::transport::step::PathVertex;
use crate::transport::suffix_cache::{
    CellLight, CellPoint, MergedLight, SuffixCache, SuffixRecord,
};

/// Light of a camera path from a cache, W/(m^2 sr).
#[derive(Clone, Copy, Debug, Default)]
pub struct CachedLight {
    /// The light.
    pub sum: Rgb,
    /// Its luminance if one half of the suffixes alone had filled the cache.
    pub halves: [f32; 2],
}

/// A diffuse lobe at a vertex.
struct Lobe {
    at: CellPoint,
    /// Throughput times albedo.
    carried: Rgb,
    /// Length of the segment to the vertex, scene units.
    distance: f32,
}

impl CameraPass<'_> {
    /// Tests whether suffixes that begin at the vertex after this many diffuse ones are cached.
    /// Those of one wavelength are not: they carry other colors.
    #[inline(always)] // part of the loops over vertices
    fn is_suffix(&self, history: History) -> bool {
        (history.diffuse() + 1 >= self.settings.merge_vertex) & (history.wavelength_index() == 0)
    }

    /// Light that the cache knows for the lobes that merge at a vertex that is shaded alone.
    #[inline(always)] // part of the loop over such vertices
    pub(super) fn cached_light(&self, other: &ScalarVertex) -> Option<CellLight> {
        let ScalarVertex { surface, state, distance, .. } = other;
        let cache = self.cache?;
        if !surface.bsdf.merges() || !self.is_suffix(state.history) {
            return None;
        }
        let Vertex { normal, front, .. } = surface.vertex(Transport::Radiance);
        let at = CellPoint { position: surface.position, normal, front };
        cache.find(at, *distance).copied()
    }
}

impl CameraPaths {
    /// Prepares for the new paths, the last in `direct`.
    pub(super) fn start_suffixes(&mut self, pass: &CameraPass) {
        if pass.cache.is_some() {
            // Entries from the first new path on belong to paths that were cleared.
            self.cached.truncate(self.first_path);
            self.cached.resize(self.direct.len(), CachedLight::default());
        }
        if let Some(recorder) = &mut self.suffixes {
            recorder.start(self.direct.len());
        }
    }

    /// Ends or records suffixes at Lambertian vertices, whose emission was added. Paths that end
    /// have no vertex any more.
    #[inline(never)] // not part of other strategies
    pub(super) fn end_or_record(
        &mut self,
        pass: &CameraPass,
        at: &mut DiffuseVertices,
        states: &PathStates,
    ) {
        for lane in 0..LANES {
            if !at.active[lane] || !pass.is_suffix(states.history[lane]) {
                continue;
            }
            let (position, normal) = (at.position.get(lane), at.normal.get(lane));
            let lobe = Lobe {
                at: CellPoint { position, normal, front: at.front[lane] },
                carried: states.weight.get(lane) * at.albedo.get(lane),
                distance: (position - states.origin.get(lane)).length(),
            };
            if let Some(cache) = pass.cache {
                at.active[lane] = !self.look_up(cache, &lobe, states, lane);
            }
            self.record(&lobe, states.path[lane], 1.0);
        }
    }

    /// Adds the light of a lobe from a cache. Returns false if the cache does not know it.
    #[inline]
    fn look_up(
        &mut self,
        cache: &SuffixCache,
        lobe: &Lobe,
        states: &PathStates,
        lane: usize,
    ) -> bool {
        let Lobe { at, carried, distance } = *lobe;
        let Some(light) = cache.find(at, distance) else { return false };
        self.add_cached(states.path[lane], carried, light);
        true
    }

    /// Adds the light of a cell to a path. theory.md (44i)
    #[inline]
    fn add_cached(&mut self, path: u32, carried: Rgb, light: &CellLight) {
        let cached = &mut self.cached[path as usize];
        cached.sum += carried * light.mean;
        for (sum, half) in cached.halves.iter_mut().zip(light.halves) {
            *sum += luminance(carried * half);
        }
    }

    /// Ends or records a path at a vertex that is shaded alone, where it took a lobe that merges
    /// and `carried` on. Returns true if it ended.
    ///
    /// The albedo of such a lobe is not known. What a path carries on, times the probability of the
    /// lobe, is that times the albedo on average, samples that are lost included: (44k).
    #[inline(never)] // not part of other strategies
    pub(super) fn ends_or_records(
        &mut self,
        pass: &CameraPass,
        vertex: &PathVertex,
        (distance, cached): (f32, &Option<CellLight>),
        carried: Rgb,
    ) -> bool {
        let PathVertex { surface, at, state } = *vertex;
        if let Some(light) = cached {
            self.add_cached(state.path, carried, light);
            return true;
        }
        if self.suffixes.is_some() && pass.is_suffix(state.history) {
            let prob = 1.0 - surface.bsdf.pass_prob(at);
            let lobe = Lobe {
                at: CellPoint { position: surface.position, normal: at.normal, front: at.front },
                carried: carried * prob,
                distance,
            };
            self.record(&lobe, state.path, prob);
        }
        false
    }

    /// Records a lobe that the path took with this probability.
    #[inline]
    fn record(&mut self, lobe: &Lobe, path: u32, prob: f32) {
        let Some(recorder) = &mut self.suffixes else { return };
        let Lobe { at, carried, distance } = *lobe;
        let light = self.direct[path as usize];
        recorder.push(SuffixRecord { at, carried, light, prob, distance, path, wave: 0 });
    }

    /// The lobe of a diffuse base. Coats so rough that they count as diffuse have none: what they
    /// reflect depends on the direction.
    #[inline]
    fn base_lobe<const METAL: bool>(
        pass: &CameraPass,
        at: &CoatedVertices<METAL>,
        states: &PathStates,
        lane: usize,
    ) -> Option<Lobe> {
        if !at.active[lane] || !pass.is_suffix(states.history[lane]) {
            return None;
        }
        let (position, normal) = (at.position.get(lane), at.shading_normal.get(lane));
        Some(Lobe {
            at: CellPoint { position, normal, front: at.facet(lane).is_front() },
            carried: states.weight.get(lane) * at.bsdf.base_albedo(lane)?,
            distance: (position - states.origin.get(lane)).length(),
        })
    }

    /// Adds the light of bases that a cache knows. Returns their lanes, in which only coats are
    /// left.
    #[inline(never)] // not part of other strategies
    pub(super) fn end_at_bases<const METAL: bool>(
        &mut self,
        cache: &SuffixCache,
        pass: &CameraPass,
        at: &CoatedVertices<METAL>,
        states: &PathStates,
    ) -> Mask {
        let mut ended = Mask::default();
        for (lane, ended) in ended.iter_mut().enumerate() {
            if let Some(lobe) = Self::base_lobe(pass, at, states, lane) {
                *ended = self.look_up(cache, &lobe, states, lane);
            }
        }
        ended
    }

    /// Records the bases that paths leave. `states` are those before.
    #[inline(never)] // not part of images
    pub(super) fn record_bases<const METAL: bool>(
        &mut self,
        pass: &CameraPass,
        at: &CoatedVertices<METAL>,
        states: &PathStates,
        samples: &CoatSamples,
    ) {
        for lane in 0..LANES {
            if samples.passes_through[lane] {
                continue;
            }
            if let Some(lobe) = Self::base_lobe(pass, at, states, lane) {
                self.record(&lobe, states.path[lane], 1.0 - at.bsdf.pass_prob(lane));
            }
        }
    }

    /// Ends the vertices whose connections were added.
    pub(super) fn end_suffix_vertices(&mut self) {
        if let Some(recorder) = &mut self.suffixes {
            recorder.end_vertices(&self.direct, self.gather_points.lanes());
        }
    }

    /// Records of all suffixes since the paths were cleared, of one batch, with the photons that
    /// `merge` finds at their vertices. Each light path counts by `per_light_path`.
    pub fn end_suffixes(
        &mut self,
        (merge, per_light_path): (&Merge, f32),
        output: &mut MergeOutput,
    ) -> Vec<SuffixRecord> {
        let points = self.gather_points.number_each();
        merge.gather_points(self, points.len(), output);
        let Some(recorder) = &mut self.suffixes else { return Vec::new() };
        let merged = points.iter().zip(&output.sums).filter(|(_, sum)| **sum != Rgb::ZERO);
        let merged = merged.map(|(&(path, lane), sum)| {
            let (wave, light) = (recorder.wave_of(lane), *sum * per_light_path);
            MergedLight { path, wave, light }
        });
        let mut merged: Vec<MergedLight> = merged.collect();
        merged.sort_by_key(|own| own.path);
        recorder.end_paths(&self.direct, &merged).collect()
    }
}
