//! Camera paths at vertices that are handled alone: the differences to other paths.

use super::mis::LastVertex;
use super::non_diffuse::ScalarVertex;
use super::{CameraPass, CameraPaths};
use crate::base::math::Rgb;
use crate::base::rng::Rng;
use crate::scene::Receiver;
use crate::scene::bsdf::{BsdfSample, Lobe, LobeSet, Transport};
use crate::transport::free_flight::MediumVertex;
use crate::transport::path_state::PathState;
use crate::transport::roulette::{survival, survives_passing};
use crate::transport::step::{PathVertex, Role};
use crate::transport::suffix_cache::CellLight;
use glam::Vec3;

/// A camera path at a vertex.
pub(super) struct CameraRole<'a> {
    paths: &'a mut CameraPaths,
    pass: &'a CameraPass<'a>,
    /// Length of the segment to a surface, scene units.
    distance: f32,
    /// Light that a cache knows for the lobes of a surface that merge.
    cached: Option<CellLight>,
    /// Weight of the technique that connects a point in a medium.
    share: f32,
}

impl<'a> CameraRole<'a> {
    pub fn at_surface(
        paths: &'a mut CameraPaths,
        pass: &'a CameraPass,
        &ScalarVertex { distance, cached, .. }: &ScalarVertex,
    ) -> Self {
        Self { paths, pass, distance, cached, share: 1.0 }
    }

    pub fn in_medium(paths: &'a mut CameraPaths, pass: &'a CameraPass, share: f32) -> Self {
        Self { paths, pass, distance: 0.0, cached: None, share }
    }
}

impl Role for CameraRole<'_> {
    const TRANSPORT: Transport = Transport::Radiance;

    fn at_surface(&mut self, vertex: &PathVertex, rng: &mut Rng) -> Option<BsdfSample> {
        let Self { paths, pass, distance, cached, .. } = self;
        let PathVertex { surface, at, state } = *vertex;
        let number = state.history.diffuse() + 1;
        let merges = surface.bsdf.merges();
        if merges && cached.is_none() && pass.gathers_at(number) {
            paths.gather(surface, at, state);
        }
        // A path that is cut here still takes lobes that pass through.
        let cut = merges && !pass.goes_on_from(number);
        let wanted = if cut { LobeSet::PassThrough } else { LobeSet::All };
        let sample = surface.bsdf.sample_lobe(at, Transport::Radiance, wanted, rng)?;
        let is_lost = sample.weight == Rgb::ZERO || !surface.agrees(at, sample.wi);
        let share = if is_lost { Rgb::ZERO } else { sample.weight };
        let is_over = !sample.lobe.passes_through()
            && merges
            && paths.ends_or_records(pass, vertex, (*distance, cached), state.weight * share);
        if is_lost || is_over {
            return None;
        }
        paths.update_partial(vertex, &sample);
        if paths.records_aovs && sample.lobe == Lobe::Rough && state.history.diffuse() == 0 {
            paths.record_rough(state.path);
        }
        Some(sample)
    }

    fn arrive_in_medium(&mut self, vertex: &MediumVertex, state: &mut PathState) -> bool {
        let Self { paths, pass, share, .. } = self;
        let mut scattered = PathState { weight: state.weight * vertex.factor(), ..*state };
        let number = state.history.diffuse() + 1;
        if paths.records_aovs {
            paths.record_medium(pass, &scattered, vertex.position);
        }
        if pass.connects() {
            paths.connect_in_medium(pass, vertex, *share, &mut scattered);
        }
        paths.merge_in_medium(pass, vertex, &scattered);
        state.rng = scattered.rng;
        pass.goes_on_from(number) && !pass.ends_in_media()
    }

    fn leave_medium(&mut self, vertex: &MediumVertex, next: Vec3, state: &PathState) {
        if self.paths.mis.is_some() {
            let density = vertex.medium.phase(vertex.direction, next);
            let receiver = Receiver { position: vertex.position, normal: None };
            self.paths.last_vertices[state.path as usize] =
                LastVertex::in_medium(receiver, next, density);
        }
    }

    fn survives(&self, weight: Rgb, lobe: Option<Lobe>, state: &mut PathState) -> bool {
        // theory.md (41)
        state.weight *= weight;
        if lobe.is_some_and(Lobe::passes_through) {
            return survives_passing(state);
        }
        if state.history.diffuse() > 1 && self.paths.mis.is_some() {
            let survival = survival(weight);
            if state.rng.next_1d() >= survival {
                return false;
            }
            state.weight /= survival;
        }
        true
    }
}
