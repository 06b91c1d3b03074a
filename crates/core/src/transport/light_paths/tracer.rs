//! Traces a batch of light paths bounce by bounce.

use super::photon_list::PhotonList;
use super::{Batch, LightPass, class_of, survival};
use crate::accel::{Coherence, HitPacket};
use crate::base::math::{Rgb, pack_direction};
use crate::base::rng::Rng;
use crate::scene::bsdf::{BsdfSample, Lobe, Transport};
use crate::scene::diffuse::{DiffuseVertices, TriangleSide};
use crate::scene::{Emitter, HitScratch, Surface};
use crate::simd::dispatch::{Simd, vectorized};
use crate::simd::{LANES, Mask, any, lanes_of};
use crate::transport::free_flight::{MediumVertex, Passed, travel, travel_all};
use crate::transport::mis::Mis;
use crate::transport::mis::photons::LightPartials;
use crate::transport::path_queue::PathQueue;
use crate::transport::path_state::{History, PathState, PathStates, other_surface};
use crate::transport::photon::{Arrival, Extent, Photon, PhotonPacket, pack_wavelength};
use crate::transport::roulette::survives;
use crate::transport::step::{PathVertex, Role, step_at_surface, step_in_medium};
use glam::Vec3;
use std::mem;
use std::ops::Range;
use std::time::Instant;

/// A reusable workspace that traces one batch after another.
#[derive(Debug, Default)]
pub(super) struct Tracer {
    segments: PathQueue<PathStates, 16>,
    /// The segments of the next bounce, in the order in which they are found.
    next: PathQueue<PathStates, 16>,
    hits: Vec<HitPacket>,
    /// Photons of the current batch.
    photons: PhotonList,
    medium_photons: PhotonList,
    partials: LightPartials,
    /// Photons keep their directions.
    stores_directions: bool,
    /// Photons keep their wavelengths.
    stores_wavelengths: bool,
    /// Photons straight from a light source are stored, not replaced by connections.
    stores_direct: bool,
    /// Photons of caustics alone are stored.
    only_caustics: bool,
}

impl Tracer {
    pub fn trace(&mut self, pass: &LightPass, paths: Range<u32>, batch: &mut Batch) {
        let start = Instant::now();
        mem::swap(&mut self.photons, &mut batch.photons);
        mem::swap(&mut self.medium_photons, &mut batch.medium_photons);
        mem::swap(&mut self.partials.photons, &mut batch.mis_partials);
        self.photons.clear();
        self.medium_photons.clear();
        self.partials.start(Mis::new(pass.settings), paths.clone());
        self.stores_directions = pass.scene.merges_by_direction();
        self.stores_wavelengths = pass.scene.is_dispersive();
        self.stores_direct = !pass.settings.connects();
        self.only_caustics = pass.settings.strategy.has_only_caustics();
        batch.rays = 0;
        vectorized(
            #[inline(always)]
            |simd| self.emit(simd, pass, paths),
        );
        while self.segments.len() > 0 {
            batch.rays += self.segments.len() as u64;
            let count = self.segments.len();
            let rays = vectorized(
                #[inline(always)]
                |_| self.segments.rays(),
            );
            self.hits.resize(rays.len(), HitPacket::default());
            pass.accel.intersect(rays, count, &mut self.hits, Coherence::Incoherent);
            vectorized(
                #[inline(always)]
                |simd| self.bounce(simd, pass),
            );
        }
        mem::swap(&mut self.photons, &mut batch.photons);
        mem::swap(&mut self.medium_photons, &mut batch.medium_photons);
        mem::swap(&mut self.partials.photons, &mut batch.mis_partials);
        batch.extent = Extent::of(batch.photons.as_slice());
        batch.busy = start.elapsed();
    }

    #[inline(always)] // vectorized
    fn emit(&mut self, simd: Simd, pass: &LightPass, mut paths: Range<u32>) {
        self.segments.clear();
        let mut states = PathStates::default();
        while !paths.is_empty() {
            let first = paths.start;
            let count = paths.by_ref().take(LANES).count();
            for lane in 0..count {
                states.rng.set(lane, pass.key.rng(u64::from(first) + lane as u64));
            }
            let starts = pass.starts(first, &mut states.rng);
            let emissions = pass.scene.lights().emit_all(pass.guide, &starts, count);
            if self.partials.is_active() {
                self.partials.emit(pass.scene.lights(), first, &emissions, count);
            }
            (states.origin, states.direction) = (emissions.origin, emissions.direction);
            states.weight = emissions.flux;
            let mut emitted = Mask::default();
            for (lane, emitted) in emitted.iter_mut().enumerate() {
                states.path[lane] = first.wrapping_add(lane as u32);
                // Black parts of pictures emit nothing.
                *emitted = (lane < count) & (states.weight.get(lane) != Rgb::ZERO);
            }
            if pass.photon_only {
                let emitters = pass.scene.lights().emitters();
                for (lane, emitted) in emitted.iter_mut().enumerate() {
                    let emitter = emitters.get(emissions.emitter[lane] as usize);
                    *emitted &= emitter.is_some_and(Emitter::is_delta);
                }
            }
            if pass.scene.media().is_some() {
                for lane in 0..count {
                    let origin = emissions.origin.get(lane);
                    let emitter = emissions.emitter[lane];
                    let around = pass.scene.media_at_emitter(pass.accel, emitter, origin);
                    states.history[lane] = History::default().within(around);
                }
            }
            self.segments.append(simd, &emitted, &states);
        }
    }

    /// Stores a photon at each hit of a surface that merges, and scatters the path.
    #[inline(always)] // vectorized
    fn bounce(&mut self, simd: Simd, pass: &LightPass) {
        let scene = pass.scene;
        self.next.clear();
        let (segments, mut all_hits) = (mem::take(&mut self.segments), mem::take(&mut self.hits));
        let (mut states, mut seen, mut at) = <(PathStates, HitScratch, DiffuseVertices)>::default();
        for (packet, hits) in all_hits.iter_mut().enumerate() {
            let count = segments.load(packet, &mut states);
            if let Some(media) = scene.media() {
                travel_all(&mut states, hits, count, |ray, hit, state| {
                    let passed = travel(scene, media, ray, hit, state);
                    passed.map(|passed| self.pass(pass, *state, passed)).is_none()
                });
            }
            let rest = scene.lambertian(
                simd,
                [&states.origin, &states.direction],
                hits,
                count,
                &mut seen,
                &mut at,
            );
            if rest.others != 0 {
                scene.read_ahead(hits, rest.others);
            }
            for lane in lanes_of(rest.others) {
                let (ray, mut state) = states.get(lane);
                let hit = hits.get(lane);
                let surface = other_surface(scene, &ray, &hit, &mut at, lane, &mut state);
                if let Some(surface) = surface {
                    self.scatter_other(pass, &surface, &state);
                }
            }
            self.store_diffuse(simd, pass, &at, &states);
            let arrived = self.partials.is_active().then_some(states);
            let left = self.scatter_diffuse(simd, pass, &at, &mut states);
            if let Some(arrived) = arrived {
                self.partials.scatter_diffuse(scene.lights(), &at, &arrived, &left.goes_on);
            }
            if pass.splitting > 1.0 {
                self.split(simd, pass, &at, &states, &left);
            }
        }
        self.hits = all_hits;
        self.segments = mem::replace(&mut self.next, segments);
    }

    /// Continues a path that met no surface that scatters.
    #[inline(never)] // media are rare
    fn pass(&mut self, pass: &LightPass, state: PathState, passed: Passed) {
        let gone_on = match passed {
            Passed::Boundary(ray) => Some((ray, state)),
            Passed::Scattered(vertex) => {
                let mut role = LightRole { tracer: self, pass, is_more: false };
                step_in_medium(&mut role, &vertex, state)
            }
        };
        if let Some((ray, state)) = gone_on {
            self.next.push_state(&ray, &state);
        }
    }

    /// Stores arrivals at diffuse vertices.
    #[inline(always)] // vectorized
    fn store_diffuse(
        &mut self,
        simd: Simd,
        pass: &LightPass,
        at: &DiffuseVertices,
        states: &PathStates,
    ) {
        let (mut stored, mut arrival, mut from) = (Mask::default(), [0; LANES], [0; LANES]);
        for lane in 0..LANES {
            let history = states.history[lane];
            stored[lane] = at.active[lane] & self.stores(history);
            arrival[lane] = Arrival::new(at.normal.get(lane), class_of(history) as u32).0;
        }
        if !any(&stored) {
            return;
        }
        if self.partials.is_active() {
            self.partials.store_diffuse(&stored, states);
        }
        if self.stores_directions {
            for (lane, from) in from.iter_mut().enumerate() {
                *from = pack_direction(-states.direction.get(lane));
            }
        }
        if self.stores_wavelengths {
            for (lane, from) in from.iter_mut().enumerate() {
                *from = pack_wavelength(*from, states.history[lane].wavelength_index());
            }
        }
        if let Some(areas) = pass.areas {
            for lane in (0..LANES).filter(|&lane| stored[lane]) {
                let tag = areas.side_tag(at.mesh[lane], at.side[lane]);
                arrival[lane] = Arrival(arrival[lane]).on_side(tag).0;
            }
        }
        let path = states.path.map(|path| pass.sample_of(self.partials.light_path(path)));
        let (position, flux) = (at.position, states.weight);
        let photons = PhotonPacket { position, path, flux, arrival };
        // Writes all sixteen and keeps those that are stored: a branch for each could not be
        // predicted.
        let (space, mut count) = (self.photons.space(), 0);
        photons.one_by_one(simd, &from, |lane, photon| {
            space[count % LANES] = photon;
            count += usize::from(stored[lane]);
        });
        self.photons.commit(count);
    }

    /// Scatters at diffuse vertices. Without splitting each path has at most one continuation.
    #[inline(always)] // vectorized
    fn scatter_diffuse(
        &mut self,
        simd: Simd,
        pass: &LightPass,
        at: &DiffuseVertices,
        states: &mut PathStates,
    ) -> Left {
        states.origin = at.off_surface;
        states.direction = at.sample(&states.rng.next_pair());
        let ends = states.rng.next_1d();
        let (mut goes_on, mut expected) = (Mask::default(), [0.0; LANES]);
        for lane in 0..LANES {
            let (flux, albedo) = (states.weight.get(lane), at.albedo.get(lane));
            let is_first = states.history[lane].diffuse() == 0;
            expected[lane] = survival(albedo) * if is_first { pass.splitting } else { 1.0 };
            goes_on[lane] = at.active[lane] & (ends[lane] < expected[lane]);
            goes_on[lane] &= !pass.leaves_out(states.history[lane]) & !self.only_caustics;
            // theory.md (38)
            states.weight.set(lane, flux * (albedo / expected[lane]));
            states.history[lane] = states.history[lane].scattered();
        }
        self.next.append(simd, &goes_on, states);
        Left { goes_on, ends, expected }
    }

    /// Adds the continuations after the first. Their number is the expected one, rounded up or down
    /// at random. theory.md (39a)
    #[inline(always)] // vectorized
    fn split(
        &mut self,
        simd: Simd,
        pass: &LightPass,
        at: &DiffuseVertices,
        first: &PathStates,
        Left { goes_on, ends, expected }: &Left,
    ) {
        let mut states = *first;
        for number in 1u32.. {
            let mut more = Mask::default();
            for (lane, more) in more.iter_mut().enumerate() {
                *more = goes_on[lane] & (number as f32 + ends[lane] < expected[lane]);
            }
            if !any(&more) {
                return;
            }
            for (lane, goes_on) in more.iter().enumerate() {
                let path = first.path[lane];
                let stream = continuation(number, path, first.history[lane]);
                states.rng.set(lane, pass.key.rng(stream));
                if *goes_on {
                    states.path[lane] = self.partials.split(path, self.partials.of(path));
                }
            }
            states.direction = at.sample(&states.rng.next_pair());
            self.next.append(simd, &more, &states);
        }
    }

    /// Continues a path at a surface that is not only diffuse, unless it ends. A path that scatters
    /// diffusely for the first time splits.
    fn scatter_other(&mut self, pass: &LightPass, surface: &Surface, state: &PathState) {
        let at = surface.vertex(Transport::Flux);
        let is_first = state.history.diffuse() == 0 && surface.bsdf.merges();
        let count = if is_first { pass.splitting as u32 } else { 1 };
        let arrived = self.partials.of(state.path).filter(|_| count > 1);
        for number in 0..count {
            let mut state = *state;
            if number > 0 {
                state.rng = pass.key.rng(continuation(number, state.path, state.history));
                state.path = self.partials.split(state.path, arrived);
            }
            let mut role = LightRole { tracer: self, pass, is_more: number > 0 };
            let gone_on = step_at_surface(&mut role, pass.scene, surface, &at, state);
            if let Some((ray, state)) = gone_on {
                self.next.push_state(&ray, &state);
            }
        }
    }

    /// Tests whether a path leaves a photon at its next vertex where photons are merged.
    #[inline(always)] // part of vector loops
    fn stores(&self, history: History) -> bool {
        self.stores_direct | !history.is_start()
    }

    /// The photon of a single path at a position and normal, which is zero in media. It keeps the
    /// direction `from` which it comes, if there is one.
    fn photon(
        &self,
        pass: &LightPass,
        state: &PathState,
        (position, normal): (Vec3, Vec3),
        flux: Rgb,
        from: Option<Vec3>,
    ) -> Photon {
        let path = pass.sample_of(self.partials.light_path(state.path));
        let class = class_of(state.history);
        let photon = Photon::new(position, path, flux, normal, class);
        let mut photon = from.map_or(photon, |from| photon.coming_from(from));
        if self.stores_wavelengths {
            photon.from = pack_wavelength(photon.from, state.history.wavelength_index());
        }
        photon
    }
}

/// Index of the random stream of a continuation of a light path of this history. Numbers are from 1
/// to 63. Where the path itself passes through a vertex, it splits again at the next.
#[inline(always)] // part of vector loops
fn continuation(number: u32, path: u32, history: History) -> u64 {
    u64::from(history.passed()) << 40 | u64::from(number) << 32 | u64::from(path)
}

/// How paths leave diffuse vertices.
struct Left {
    /// They survive.
    goes_on: Mask,
    /// The random number of their roulette.
    ends: [f32; LANES],
    /// Expected number of continuations.
    expected: [f32; LANES],
}

/// Light paths at vertices that are handled alone: the differences to other paths.
struct LightRole<'a> {
    tracer: &'a mut Tracer,
    pass: &'a LightPass<'a>,
    /// The path has left the vertex before.
    is_more: bool,
}

impl Role for LightRole<'_> {
    const TRANSPORT: Transport = Transport::Flux;

    fn at_surface(&mut self, vertex: &PathVertex, rng: &mut Rng) -> Option<BsdfSample> {
        let Self { tracer, pass, is_more } = self;
        let PathVertex { surface, at, state } = *vertex;
        let Surface { position, normal, wo, .. } = *surface;
        if surface.bsdf.merges() && !*is_more && tracer.stores(state.history) {
            tracer.partials.store(state);
            let TriangleSide { mesh, side } = surface.facet;
            let tag = pass.areas.map_or(0, |areas| areas.side_tag(mesh, side));
            let from = tracer.stores_directions.then_some(wo);
            let photon = tracer.photon(pass, state, (position, normal), state.weight, from);
            tracer.photons.push(photon.on_side(tag));
        }
        let sample = surface.scatter_flux(at, rng)?;
        let is_left_out = pass.leaves_out(state.history) && sample.lobe != Lobe::Delta;
        let passes = sample.lobe.passes_through();
        if is_left_out || tracer.only_caustics && !passes || *is_more && passes {
            return None;
        }
        tracer.partials.scatter(pass.scene.lights(), surface, state, &sample);
        Some(sample)
    }

    fn arrive_in_medium(&mut self, vertex: &MediumVertex, state: &mut PathState) -> bool {
        let Self { tracer, pass, .. } = self;
        if pass.leaves_out(state.history) {
            return false;
        }
        if tracer.stores(state.history) {
            // theory.md (37g)
            let (at, flux) = ((vertex.position, Vec3::ZERO), state.weight * vertex.weight);
            let photon = tracer.photon(pass, state, at, flux, Some(-vertex.direction));
            tracer.medium_photons.push(photon);
        }
        true
    }

    fn survives(&self, weight: Rgb, lobe: Option<Lobe>, state: &mut PathState) -> bool {
        // theory.md (39b): what passes through a surface does not split there.
        if state.history.diffuse() == 1 && lobe.is_some_and(|lobe| !lobe.passes_through()) {
            state.weight /= self.pass.splitting;
        }
        survives(weight, state)
    }
}
