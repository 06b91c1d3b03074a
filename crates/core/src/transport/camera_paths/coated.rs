//! Camera paths at diffuse bases with or without a coat, sixteen at a time: most vertices of rooms,
//! whose surfaces have textures, smooth normals and varnish. One path at a time,
//! [`non_diffuse`](super::non_diffuse) does the same, for all surfaces and strategies.

use super::mis::LastVertex;
use super::{CameraPass, CameraPaths, Connections};
use crate::accel::HitPacket;
use crate::base::math::{Rgb, luminance};
use crate::scene::bsdf::coats::CoatSamples;
use crate::scene::coated_hits::{CoatedHits, CoatedScratch, CoatedVertices};

use crate::scene::{Receiver, Receivers};
use crate::settings::Settings;
use crate::simd::dispatch::Simd;
use crate::simd::{LANES, Mask, Vec3s, any};
use crate::transport::gather::{GatherPoint, GatherView};
use crate::transport::light_paths::survival;
use crate::transport::mis::Mis;
use crate::transport::mis::densities::{MIN_DENSITY, Survival, bounded, rough_density_of};
use crate::transport::mis::weights::CameraPartial;
use crate::transport::path_queue::Columns;
use crate::transport::path_state::{History, PathStates};
use crate::transport::roulette::{LONG_CHAIN, LONG_CHAIN_END, WEIGHT_FLOOR};
use bytemuck::{Pod, Zeroable};
use std::array::from_fn;
use std::f32::consts::FRAC_1_PI;
use std::mem;

/// Sixteen segments that end at diffuse bases with or without a coat.
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
#[repr(C, align(64))]
pub(super) struct CoatedSegments {
    states: PathStates,
    hits: CoatedHits,
}

impl Columns<21> for CoatedSegments {
    const T_FAR: f32 = f32::INFINITY;
}

impl CameraPass<'_> {
    /// Vertices at bases and coats are shaded together. All of them connect with lights.
    #[inline(always)]
    pub(super) fn shades_coats_together(&self) -> bool {
        let Self { scene, settings: Settings { strategy, .. }, .. } = self;
        let is_plain = scene.media().is_none() && scene.meters().is_none();
        strategy.is_weighted() && strategy.continues() && self.connects() && is_plain
    }
}

/// Densities in projected solid angle with which light from the direction of a connection or a
/// sample scatters back along camera paths. All are 0 if nothing merges.
#[derive(Clone, Copy, Debug, Default)]
struct LightDensities {
    wide: [f32; LANES],
    rough: [f32; LANES],
    /// Probabilities that light passes through.
    pass_prob: [f32; LANES],
}

impl LightDensities {
    #[inline(always)]
    fn new<const METAL: bool>(at: &CoatedVertices<METAL>, wi: &Vec3s) -> Self {
        let seen = at.seen_by_light(wi);
        let (wide, rough) = seen.lobes(at.bsdf.wo());
        let mut own = Self::default();
        for lane in 0..LANES {
            let cos = at.bsdf.wo().get(lane).dot(seen.normal(lane));
            let value = wide.value.get(lane).max_element();
            own.wide[lane] = Survival::LIGHT.density_from(value, wide.pdf_w[lane], cos);
            own.rough[lane] = rough_density_of(rough.pdf_w[lane], cos);
            own.pass_prob[lane] = seen.pass_prob(lane);
        }
        own
    }
}

/// How paths leave vertices.
struct Left<'a> {
    samples: &'a CoatSamples,
    /// Densities in projected solid angle of going on.
    density: &'a [f32; LANES],
    goes_on: &'a Mask,
}

impl CameraPaths {
    /// Queues the hits of bases and coats, each kind on its own. Returns their lanes.
    #[inline(always)] // vectorized
    pub(super) fn queue_coated(
        &mut self,
        simd: Simd,
        states: &PathStates,
        hits: &HitPacket,
        [coated, metals]: [u32; 2],
    ) -> u32 {
        let HitPacket { mesh, triangle, u, v, t } = *hits;
        let segments =
            CoatedSegments { states: *states, hits: CoatedHits { mesh, triangle, u, v, t } };
        for (lanes, queue) in [coated, metals].into_iter().zip(&mut self.coated) {
            if lanes != 0 {
                queue.append(simd, &from_fn(|lane| lanes >> lane & 1 == 1), &segments);
            }
        }
        coated | metals
    }

    /// Handles all hits that were queued: connects, and finds the next segments.
    #[inline(always)] // vectorized
    pub(super) fn scatter_all_coated<const METAL: bool>(&mut self, simd: Simd, pass: &CameraPass) {
        let queue = &mut self.coated[usize::from(METAL)];
        if queue.len() == 0 {
            return;
        }
        let mut queue = mem::take(queue);
        let (mut segments, mut seen, mut at) =
            <(CoatedSegments, CoatedScratch, CoatedVertices<METAL>)>::default();
        for packet in 0..queue.len().div_ceil(LANES) {
            let count = queue.load(packet, &mut segments);
            let CoatedSegments { states, hits } = &mut segments;
            let rays = [&states.origin, &states.direction];
            pass.scene.coated_vertices(simd, rays, hits, count, &mut seen, &mut at);
            if self.records_aovs {
                self.record_coated(pass, &at, states);
            }
            let Some(mis) = self.mis else { unreachable!("a weighted strategy") };
            let partials = self.arriving_partials(&states.path);
            let ended = match pass.cache {
                Some(cache) => self.end_at_bases(cache, pass, &at, states),
                None => Mask::default(),
            };
            if pass.settings.strategy.has_photons() {
                self.gather_coated(pass, &mis, &at, (&partials, &ended), states);
            }
            self.connect_coated(simd, pass, &mis, &at, (&partials, &ended), states);
            self.leave_coated(simd, pass, &mis, &at, (&partials, &ended), states);
        }
        queue.clear();
        self.coated[usize::from(METAL)] = queue;
    }

    /// MIS partials of paths where they arrive.
    #[inline(always)]
    fn arriving_partials(&self, path: &[u32; LANES]) -> [CameraPartial; LANES] {
        let mut partials = [CameraPartial::default(); LANES];
        for (partial, &path) in partials.iter_mut().zip(path) {
            // Lanes without a path have any number.
            if let Some(last) = self.last_vertices.get(path as usize) {
                *partial = last.partial;
            }
        }
        partials
    }

    /// Stores gather points; bases of `ended` lanes have their light already.
    #[inline(never)] // keeps the loop of paths without photons short
    fn gather_coated<const METAL: bool>(
        &mut self,
        pass: &CameraPass,
        mis: &Mis,
        at: &CoatedVertices<METAL>,
        (partials, ended): (&[CameraPartial; LANES], &Mask),
        states: &PathStates,
    ) {
        for (lane, partial) in partials.iter().enumerate() {
            let (history, carried) = (states.history[lane], states.weight.get(lane));
            let vertex = history.diffuse() + 1;
            let merges = at.active[lane] && !ended[lane] && at.bsdf.merges(lane);
            if !(merges && pass.gathers_at(vertex)) {
                continue;
            }
            let mut point = GatherPoint {
                position: at.position.get(lane),
                path: states.path[lane],
                weight: carried,
                vertex,
                wavelength: history.wavelength(),
                normal: at.normal.get(lane),
                facet: at.facet(lane),
                view: self.views.len() as u32,
            };
            if at.is_bent[lane] || at.bsdf.has_coat(lane) > 0.0 {
                let (bsdf, interpolated) =
                    (pass.scene.coated_bsdf(at, lane), at.interpolated(lane));
                let (at, transmits) = (at.vertex(lane), false);
                self.views.push(GatherView { bsdf, at, interpolated, transmits });
                self.gather_points.push(&point);
                self.gather_points.set_earlier_merges(mis.balance.arrive(partial, 1.0));
                continue;
            }
            let albedo = at.bsdf.albedo.get(lane);
            // theory.md (27)
            (point.weight, point.view) = (carried * albedo * FRAC_1_PI, GatherPoint::NO_VIEW);
            let light = Survival::LIGHT.lambertian(albedo.max_element());
            let camera = mis.camera_survival(vertex).lambertian(albedo.max_element());
            let own = mis.balance.gather(vertex, mis.balance.arrive(partial, light), camera);
            self.gather_points.push(&point);
            self.gather_points.set_point_partials(own);
        }
    }

    /// Connects all vertices with light sources; bases of `ended` lanes have their light already.
    #[inline(always)] // vectorized
    fn connect_coated<const METAL: bool>(
        &mut self,
        simd: Simd,
        pass: &CameraPass,
        mis: &Mis,
        at: &CoatedVertices<METAL>,
        (partials, ended): (&[CameraPartial; LANES], &Mask),
        states: &mut PathStates,
    ) {
        let is_recorded = self.suffixes.is_some();
        let receivers =
            Receivers { active: &at.active, position: &at.position, normal: &at.normal };
        let lights = pass.scene.lights();
        let light = self.light_samples(lights, &receivers, states);
        let (wide, rough) = at.bsdf.lobes(&light.wi);
        let mut back = LightDensities::default();
        if mis.balance.weighs_merges() {
            back = LightDensities::new(at, &light.wi);
        }
        let inverse_power = lights.total_power().recip();
        let (mut sum, mut caustic) = <(Vec3s, Vec3s)>::default();
        for (lane, partial) in partials.iter().enumerate() {
            let number = states.history[lane].diffuse() + 1;
            let wi = light.wi.get(lane);
            let cos = wi.dot(at.shading_normal.get(lane)).abs();
            let irradiance = light.irradiance.get(lane);
            let carried = states.weight.get(lane) * irradiance;
            let carried = carried * if at.agrees(lane, wi) { cos } else { 0.0 };
            let cos_triangle = wi.dot(at.normal.get(lane)).abs();
            // theory.md (47b), `l`
            let l = luminance(irradiance) * cos_triangle * inverse_power / light.relative[lane];
            let hits = cos_triangle * light.inverse_pdf_w[lane];
            let value = wide.value.get(lane);
            let density = survivors(number, value.max_element(), wide.pdf_w[lane], cos);
            let rough_density = rough_density_of(rough.pdf_w[lane], cos);
            let merges = mis.balance.arrive(partial, back.wide[lane]);
            let merges = mis.balance.before_last(merges);
            let rough_merges = mis.balance.caustic_merges(partial) * back.rough[lane];
            let weight = mis.balance.connection_weight(merges, l, density * hits);
            let rough_weight = mis.balance.connection_weight(rough_merges, l, rough_density * hits);
            // theory.md (42), third and fourth line
            let wide = carried * value * if ended[lane] { 0.0 } else { weight };
            let rough = carried * rough.value.get(lane) * rough_weight;
            // Light of rough lobes after the first diffuse vertex is part of caustics.
            let is_caustic = if (number == 2) | is_recorded { 1.0 } else { 0.0 };
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

    /// Continues the paths; those of `ended` lanes only by coats.
    #[inline(always)] // vectorized
    fn leave_coated<const METAL: bool>(
        &mut self,
        simd: Simd,
        pass: &CameraPass,
        mis: &Mis,
        at: &CoatedVertices<METAL>,
        (partials, ended): (&[CameraPartial; LANES], &Mask),
        states: &mut PathStates,
    ) {
        let numbers = self.lobe_numbers(states);
        let samples = at.bsdf.sample(&numbers);
        let ends = states.rng.next_1d();
        if self.records_aovs {
            self.record_rough_samples(&at.active, &samples, states);
        }
        if self.suffixes.is_some() {
            self.record_bases(pass, at, states, &samples);
        }
        let (mut goes_on, mut density) = (Mask::default(), [0.0; LANES]);
        let before = states.history;
        for lane in 0..LANES {
            let number = before[lane].diffuse() + 1;
            let (wi, weight) = (samples.wi.get(lane), samples.weight.get(lane));
            let passes = samples.passes_through[lane];
            let cos = wi.dot(at.shading_normal.get(lane));
            let pdf_w = samples.pdf_w[lane];
            let wide = survivors(number, samples.value[lane], pdf_w, cos);
            let rough = if pdf_w > 0.0 { rough_density_of(pdf_w, cos) } else { 0.0 };
            density[lane] = if passes { rough } else { wide };
            // theory.md (41)
            let carried = states.weight.get(lane) * weight;
            let (passed, scattered) = (before[lane].passed_through(), before[lane].scattered());
            states.history[lane] = if passes { passed } else { scattered };
            // theory.md (44)
            let share = carried.abs().max_element() * states.inverse_start[lane];
            let chain_end = if passed.passed() >= LONG_CHAIN { LONG_CHAIN_END } else { 0.0 };
            let passing = (share / WEIGHT_FLOOR).min(1.0 - chain_end);
            // theory.md (43)
            let scattering = if number > 1 { survival(weight) } else { 1.0 };
            let survival = if passes { passing } else { scattering };
            let is_left = samples.is_some[lane] & at.agrees(lane, wi);
            let is_over = ended[lane] & !passes;
            goes_on[lane] = at.active[lane] & is_left & !is_over & (ends[lane] < survival);
            states.weight.set(lane, carried / survival);
        }
        let left = Left { samples: &samples, density: &density, goes_on: &goes_on };
        self.set_last_vertices(mis, at, &before, partials, &left, &states.path);
        states.origin = at.off_surface;
        states.direction = samples.wi;
        self.next.append(simd, &goes_on, states);
    }

    /// Keeps the vertices of paths that go on, for the weights of light that they hit.
    #[inline(always)] // vectorized
    fn set_last_vertices<const METAL: bool>(
        &mut self,
        mis: &Mis,
        at: &CoatedVertices<METAL>,
        before: &[History; LANES],
        partials: &[CameraPartial; LANES],
        left: &Left,
        path: &[u32; LANES],
    ) {
        let mut back = LightDensities::default();
        if mis.balance.weighs_merges() {
            back = LightDensities::new(at, &left.samples.wi);
        }
        for lane in 0..LANES {
            if !left.goes_on[lane] {
                continue;
            }
            let (position, normal) = (at.position.get(lane), at.normal.get(lane));
            let (density, number) = (left.density[lane], before[lane].diffuse() + 1);
            let is_diffuse = !left.samples.passes_through[lane];
            let partial = if is_diffuse {
                mis.balance.leave(
                    number,
                    mis.balance.arrive(&partials[lane], back.wide[lane]),
                    density,
                )
            } else if partials[lane] == CameraPartial::default() {
                partials[lane]
            } else if left.samples.is_delta[lane] {
                let camera = at.bsdf.pass_prob(lane).max(MIN_DENSITY);
                partials[lane].pass(bounded(back.pass_prob[lane] / camera))
            } else {
                partials[lane].pass(bounded(back.rough[lane] / density))
            };
            let receiver = Receiver { position, normal: Some(normal) };
            self.last_vertices[path[lane] as usize] =
                LastVertex { receiver, normal, density, partial, is_diffuse };
        }
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
