//! Camera paths at diffuse bases with or without a coat, sixteen at a time: most vertices of rooms,
//! whose surfaces have textures, smooth normals and varnish. One path at a time,
//! [`non_diffuse`](super::non_diffuse) does the same, for all surfaces and strategies.

use super::mis::LastVertex;
use super::non_diffuse::{LONG_CHAIN, LONG_CHAIN_END, WEIGHT_FLOOR};
use super::{CameraPass, CameraPaths, Connections};
use crate::accel::HitPacket;
use crate::base::math::Rgb;
use crate::scene::coated_hits::{CoatedHits, CoatedScratch, CoatedVertices};
use crate::scene::{Receiver, Receivers};
use crate::simd::dispatch::Simd;
use crate::simd::{LANES, Mask, Vec3s, any};
use crate::transport::light_paths::survival;
use crate::transport::mis::densities::{Survival, rough_density_of};
use crate::transport::path_queue::Columns;
use crate::transport::path_state::PathStates;
use bytemuck::{Pod, Zeroable};

/// Sixteen segments that end at diffuse bases with or without a coat.
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
#[repr(C, align(64))]
pub(super) struct CoatedSegments {
    states: PathStates,
    hits: CoatedHits,
}

impl Columns<20> for CoatedSegments {
    const T_FAR: f32 = f32::INFINITY;
}

impl CameraPass<'_> {
    /// Vertices at bases and coats are shaded together: nothing merges or measures there, and there
    /// are no media.
    #[inline(always)]
    pub(super) fn shades_coats_together(&self) -> bool {
        let Self { scene, settings, .. } = self;
        let is_plain = scene.media().is_none() && scene.meters().is_none();
        !settings.strategy.has_photons() && is_plain
    }
}

impl CameraPaths {
    /// Queues those of `lanes`, which hit bases and coats, that can be shaded together. Returns
    /// them.
    #[inline(always)] // vectorized
    pub(super) fn queue_coated(
        &mut self,
        simd: Simd,
        pass: &CameraPass,
        states: &PathStates,
        hits: &HitPacket,
        lanes: u32,
    ) -> u32 {
        let queued = pass.scene.plain_placements(hits, lanes);
        let HitPacket { mesh, triangle, u, v, .. } = *hits;
        let segments =
            CoatedSegments { states: *states, hits: CoatedHits { mesh, triangle, u, v } };
        let mut kept = Mask::default();
        for (lane, kept) in kept.iter_mut().enumerate() {
            *kept = queued >> lane & 1 == 1;
        }
        self.coated.append(simd, &kept, &segments);
        queued
    }

    /// Handles all hits that were queued: connects, and finds the next segments.
    #[inline(always)] // vectorized
    pub(super) fn scatter_all_coated(&mut self, simd: Simd, pass: &CameraPass) {
        if self.coated.len() == 0 {
            return;
        }
        let (mut segments, mut seen, mut at) =
            <(CoatedSegments, CoatedScratch, CoatedVertices)>::default();
        for packet in 0..self.coated.len().div_ceil(LANES) {
            let count = self.coated.load(packet, &mut segments);
            let CoatedSegments { states, hits } = &mut segments;
            let directions = &states.direction;
            pass.scene.coated_vertices(simd, directions, hits, count, &mut seen, &mut at);
            if self.records_aovs {
                self.record_coated(pass, &at, states);
            }
            self.connect_coated(simd, pass, &at, states);
            self.leave_coated(simd, &at, states);
        }
        self.coated.clear();
    }

    /// Connects all vertices with light sources.
    #[inline(always)] // vectorized
    fn connect_coated(
        &mut self,
        simd: Simd,
        pass: &CameraPass,
        at: &CoatedVertices,
        states: &mut PathStates,
    ) {
        let receivers =
            Receivers { active: &at.active, position: &at.position, normal: &at.normal };
        let light = pass.scene.lights().connect_all(&receivers, &mut states.rng);
        let (wide, rough) = at.bsdf.lobes(&light.wi);
        let (mut sum, mut caustic) = <(Vec3s, Vec3s)>::default();
        for lane in 0..LANES {
            let number = states.history[lane].diffuse() + 1;
            let wi = light.wi.get(lane);
            let cos = wi.dot(at.shading_normal.get(lane)).abs();
            let carried = states.weight.get(lane) * light.irradiance.get(lane);
            let carried = carried * if at.agrees(lane, wi) { cos } else { 0.0 };
            // Without merges, theory.md (47g) is the balance of connections and hits.
            let hits = wi.dot(at.normal.get(lane)).abs() * light.inverse_pdf_w[lane];
            let value = wide.value.get(lane);
            let density = survivors(number, value.max_element(), wide.pdf_w[lane], cos);
            let rough_density = rough_density_of(rough.pdf_w[lane], cos);
            // theory.md (42), third and fourth line
            let wide = carried * value * (1.0 + density * hits).recip();
            let rough = carried * rough.value.get(lane) * (1.0 + rough_density * hits).recip();
            // Light of rough lobes after the first diffuse vertex is part of caustics.
            let is_caustic = if number == 2 { 1.0 } else { 0.0 };
            sum.set(lane, wide + rough * (1.0 - is_caustic));
            caustic.set(lane, rough * is_caustic);
        }
        let start = [&at.off_surface, &light.target];
        self.queue_shadow_rays(simd, &at.active, start, &states.path, &sum);
        let (mut is_caustic, mut path) = (Mask::default(), states.path);
        for lane in 0..LANES {
            is_caustic[lane] = at.active[lane] & (caustic.get(lane) != Rgb::ZERO);
            path[lane] |= Connections::CAUSTIC;
        }
        if any(&is_caustic) {
            self.queue_shadow_rays(simd, &is_caustic, start, &path, &caustic);
        }
    }

    /// Continues the paths.
    #[inline(always)] // vectorized
    fn leave_coated(&mut self, simd: Simd, at: &CoatedVertices, states: &mut PathStates) {
        let numbers = [states.rng.next_1d(), states.rng.next_1d(), states.rng.next_1d()];
        let samples = at.bsdf.sample(&numbers);
        let ends = states.rng.next_1d();
        if self.records_aovs {
            self.record_rough_samples(&at.active, &samples, states);
        }
        let mut goes_on = Mask::default();
        let mut density = [0.0; LANES];
        for lane in 0..LANES {
            let number = states.history[lane].diffuse() + 1;
            let (wi, weight) = (samples.wi.get(lane), samples.weight.get(lane));
            let passes = samples.passes_through[lane];
            let cos = wi.dot(at.shading_normal.get(lane));
            let pdf_w = samples.pdf_w[lane];
            let wide = survivors(number, samples.value[lane], pdf_w, cos);
            let rough = if pdf_w > 0.0 { rough_density_of(pdf_w, cos) } else { 0.0 };
            density[lane] = if passes { rough } else { wide };
            // theory.md (41)
            let carried = states.weight.get(lane) * weight;
            let history = states.history[lane];
            let (passed, scattered) = (history.passed_through(), history.scattered());
            states.history[lane] = if passes { passed } else { scattered };
            // theory.md (44)
            let share = carried.abs().max_element() * states.inverse_start[lane];
            let chain_end = if passed.passed() >= LONG_CHAIN { LONG_CHAIN_END } else { 0.0 };
            let passing = (share / WEIGHT_FLOOR).min(1.0 - chain_end);
            // theory.md (43)
            let scattering = if number > 1 { survival(weight) } else { 1.0 };
            let survival = if passes { passing } else { scattering };
            let is_left = samples.is_some[lane] & at.agrees(lane, wi);
            goes_on[lane] = at.active[lane] & is_left & (ends[lane] < survival);
            states.weight.set(lane, carried / survival);
        }
        for lane in 0..LANES {
            if !goes_on[lane] {
                continue;
            }
            let (position, normal) = (at.position.get(lane), at.normal.get(lane));
            self.last_vertices[states.path[lane] as usize] = LastVertex {
                receiver: Receiver { position, normal: Some(normal) },
                normal,
                density: density[lane],
                is_diffuse: !samples.passes_through[lane],
                // Nothing merges.
                ..LastVertex::default()
            };
        }
        states.origin = at.off_surface;
        states.direction = samples.wi;
        self.next.append(simd, &goes_on, states);
    }
}

/// Density in projected solid angle of the lobes that merge, with survival at the vertex of this
/// number: [`Mis::camera_survival`] of paths that go on.
#[inline(always)]
fn survivors(number: u32, value: f32, pdf_w: f32, cos: f32) -> f32 {
    let certain = Survival::Certain.density_from(value, pdf_w, cos);
    let reflected = Survival::Reflected.density_from(value, pdf_w, cos);
    if number == 1 { certain } else { reflected }
}
