//! Guided directions from diffuse vertices, and the record of directions that a guide learns from.
//! theory.md, section 11a.

use super::{CameraPass, CameraPaths};
use crate::base::math::{cosine_hemisphere, luminance};
use crate::scene::bsdf::coats::CoatSamples;
use crate::scene::coated_hits::CoatedVertices;
use crate::scene::diffuse::DiffuseVertices;
use crate::simd::{LANES, Mask, Vec3s};
use crate::transport::direction_guide::{DirectionSample, GuidedVertices};
use crate::transport::path_state::PathStates;
use std::f32::consts::FRAC_1_PI;

/// Minimum cosine of directions that are recorded.
const MIN_COSINE: f32 = 1e-6;

/// A direction in which a path left a diffuse vertex.
#[derive(Clone, Copy, Debug)]
pub struct RecordedDirection {
    /// The direction, and the luminance that the path contributed later, W/(m^2 sr).
    pub sample: DirectionSample,
    /// Luminance of the whole path, W/(m^2 sr).
    pub total: f32,
}

/// Records directions of diffuse vertices with what their paths contribute later.
#[derive(Clone, Debug, Default)]
pub struct DirectionRecorder {
    /// Directions of the paths that have ended, and then of those that have not.
    pub directions: Vec<RecordedDirection>,
    /// First direction of the current segments of all paths.
    current: usize,
    /// First direction of the current batch.
    batch: usize,
}

/// Diffuse vertices as guides see them.
#[inline(always)] // part of the loops over vertices, as the functions below
pub(super) fn guided_vertices<'a>(active: &'a Mask, at: &'a DiffuseVertices) -> GuidedVertices<'a> {
    let DiffuseVertices { position, normal, .. } = at;
    GuidedVertices { active, position, normal, shading_normal: normal }
}

/// Vertices at bases and coats as guides see them.
#[inline(always)]
pub(super) fn coated_vertices<'a, const METAL: bool>(
    active: &'a Mask,
    at: &'a CoatedVertices<METAL>,
) -> GuidedVertices<'a> {
    let CoatedVertices::<METAL> { position, normal, shading_normal, .. } = at;
    GuidedVertices { active, position, normal, shading_normal }
}

/// Directions from diffuse vertices by two uniform numbers each, and factors of the throughput: 1
/// without a guide, and 0 below the surface.
#[inline(always)]
pub(super) fn diffuse_directions(
    pass: &CameraPass,
    at: &DiffuseVertices,
    goes_on: &Mask,
    [u, v]: &[[f32; LANES]; 2],
) -> (Vec3s, [f32; LANES]) {
    let Some(guide) = pass.directions else {
        let mut directions = Vec3s::default();
        for lane in 0..LANES {
            directions.set(lane, cosine_hemisphere(at.normal.get(lane), [u[lane], v[lane]]));
        }
        return (directions, [1.0; LANES]);
    };
    let vertices = guided_vertices(goes_on, at);
    let sampled = guide.sample(&vertices, [u, v]);
    let mixtures = guide.mixtures(&vertices, &sampled, &sampled.wi);
    let mut factors = [0.0; LANES];
    for (lane, factor) in factors.iter_mut().enumerate() {
        let is_above = sampled.wi.get(lane).dot(at.normal.get(lane)) > 0.0;
        *factor = if is_above { mixtures[lane].recip() } else { 0.0 };
    }
    (sampled.wi, factors)
}

/// Directions from bases and coats by three uniform numbers each, and factors of the throughput: 1
/// without a guide and for lobes of coats alone.
#[inline(always)]
pub(super) fn coated_directions<const METAL: bool>(
    pass: &CameraPass,
    at: &CoatedVertices<METAL>,
    numbers: &[[f32; LANES]; 3],
) -> (CoatSamples, [f32; LANES]) {
    let Some(guide) = pass.directions else {
        return (at.bsdf.sample(numbers), [1.0; LANES]);
    };
    let vertices = coated_vertices(&at.active, at);
    let bases = guide.sample(&vertices, [&numbers[1], &numbers[2]]);
    let samples = at.bsdf.sample_around(numbers, &bases.wi);
    let mixtures = guide.mixtures(&vertices, &bases, &samples.wi);
    let mut factors = [1.0; LANES];
    for (lane, factor) in factors.iter_mut().enumerate() {
        // theory.md (44e)
        let share = samples.base_share[lane];
        *factor = (share * mixtures[lane] + (1.0 - share)).recip();
    }
    (samples, factors)
}

impl CameraPaths {
    /// Records the directions of the active paths; `factors` are those of their throughput.
    #[inline(never)] // not part of images
    pub(super) fn record_directions(
        &mut self,
        at: &GuidedVertices,
        states: &PathStates,
        factors: &[f32; LANES],
    ) {
        let Some(recorder) = &mut self.recorder else { return };
        for (lane, factor) in factors.iter().enumerate() {
            let wi = states.direction.get(lane);
            let cos = wi.dot(at.shading_normal.get(lane));
            if !at.active[lane] || cos < MIN_COSINE {
                continue;
            }
            let cosine_pdf_w = cos * FRAC_1_PI;
            let sample = DirectionSample {
                position: at.position.get(lane),
                normal: at.normal.get(lane),
                wi,
                cosine_pdf_w,
                pdf_w: cosine_pdf_w / factor,
                path: states.path[lane] - self.first_path as u32,
                contribution: 0.0,
            };
            recorder.directions.push(RecordedDirection { sample, total: 0.0 });
        }
    }

    /// Subtracts from the current directions what their paths contributed up to the vertices.
    pub(super) fn end_current_directions(&mut self) {
        let Some(recorder) = &mut self.recorder else { return };
        let direct = &self.direct[self.first_path..];
        for RecordedDirection { sample, .. } in &mut recorder.directions[recorder.current..] {
            sample.contribution = -luminance(direct[sample.path as usize]);
        }
        recorder.current = recorder.directions.len();
    }

    /// Adds to the directions of the batch all that their paths contributed.
    pub(super) fn end_directions(&mut self) {
        let Some(recorder) = &mut self.recorder else { return };
        let direct = &self.direct[self.first_path..];
        for RecordedDirection { sample, total } in &mut recorder.directions[recorder.batch..] {
            *total = luminance(direct[sample.path as usize]);
            sample.contribution += *total;
        }
        recorder.batch = recorder.directions.len();
    }
}
