//! MIS partials of camera paths, and the MIS weights of connections and of light sources that
//! camera paths hit.

use super::CameraPaths;
use crate::base::math::{Rgb, luminance};
use crate::scene::bsdf::{BsdfSample, Lobe, LobeValue};
use crate::scene::diffuse::{DiffuseVertices, TriangleSide};
use crate::scene::{LightSample, LightSamples, Lights, Receiver, Scene};
use crate::simd::{LANES, Mask, Vec3s};
use crate::transport::mis::Mis;
use crate::transport::mis::densities::{Directions, Survival};
use crate::transport::mis::weights::{CameraPartial, GatherPartials};
use crate::transport::path_state::PathStates;
use crate::transport::step::PathVertex;
use glam::Vec3;
use std::array::from_fn;

/// Last vertex of a camera path, for the weight of a light source that the next segment hits. The
/// default is the camera: light sources that it sees have no other technique.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct LastVertex {
    pub receiver: Receiver,
    /// Unit normal of its triangle.
    pub normal: Vec3,
    /// Density in projected solid angle with which the path goes on; 0 if no connection can replace
    /// its direction.
    pub density: f32,
    /// Partial after the vertex.
    pub partial: CameraPartial,
    /// The vertex is diffuse.
    pub is_diffuse: bool,
}

/// Light that a camera path hits.
#[derive(Clone, Copy, Debug)]
struct Hit {
    /// Unit direction of the path.
    direction: Vec3,
    /// Density in solid angle of connections of the last vertex with it, 1/sr.
    connection_pdf_w: f32,
    /// Density of emission toward the last vertex; 0 if no light path emits there.
    emission: f32,
}

impl LastVertex {
    /// A vertex in a medium, from which the path goes on along `direction` with this density, 1/sr.
    /// Without photons in the weights it has no partial.
    pub(super) fn in_medium(receiver: Receiver, direction: Vec3, density: f32) -> Self {
        let partial = CameraPartial::default();
        // The direction has no cosine in a medium.
        Self { receiver, normal: direction, density, partial, is_diffuse: true }
    }

    /// MIS weight of light that a path hits after `diffuse` diffuse vertices.
    /// theory.md (47i)
    fn hit_weight(&self, mis: &Mis, diffuse: u32, hit: &Hit) -> f32 {
        let cos = hit.direction.dot(self.normal).abs();
        let can_connect = self.density > 0.0 && (mis.connects || !self.is_diffuse);
        let connection =
            if can_connect { hit.connection_pdf_w / (self.density * cos) } else { 0.0 };
        let merges_straight = self.is_diffuse && diffuse == 1 && !mis.connects;
        let merges = if self.is_diffuse && !merges_straight {
            mis.balance.before_last(self.partial.earlier)
        } else {
            mis.balance.caustic_merges(&self.partial)
        };
        mis.balance.hit_weight(merges, hit.emission, connection)
    }
}

impl CameraPaths {
    /// Prepares partials for the new paths, the last in `direct`.
    pub(super) fn start_partials(&mut self) {
        if self.hit_weights.is_some() {
            // Entries from the first new path on belong to paths that were cleared.
            self.last_vertices.truncate(self.first_path);
            self.last_vertices.resize(self.direct.len(), LastVertex::default());
        }
    }

    /// Densities of merges at earlier vertices where paths arrive at Lambertian vertices;
    /// meaningless for lanes without a vertex.
    #[inline(always)] // vectorized, as the functions below
    pub(super) fn earlier_merges(
        &self,
        mis: &Mis,
        at: &DiffuseVertices,
        states: &PathStates,
    ) -> [f32; LANES] {
        from_fn(|lane| {
            let last = self.last_vertices.get(states.path[lane] as usize);
            let partial = last.map_or(CameraPartial::default(), |last| last.partial);
            let albedo = at.albedo.get(lane).max_element();
            mis.balance.arrive(&partial, Survival::LIGHT.lambertian(albedo))
        })
    }

    /// Multiplies the contributions of connections from Lambertian vertices by their MIS weights.
    /// `earlier` has the densities of merges at earlier vertices.
    #[inline(always)]
    pub(super) fn weight_connections(
        mis: &Mis,
        lights: &Lights,
        at: &DiffuseVertices,
        states: &PathStates,
        earlier: &[f32; LANES],
        light: &LightSamples,
        contributions: &mut Vec3s,
    ) {
        let inverse_power = lights.total_power().recip();
        for (lane, &earlier) in earlier.iter().enumerate() {
            let cos = light.wi.get(lane).dot(at.normal.get(lane)).abs();
            // theory.md (47b), `l`
            let l =
                luminance(light.irradiance.get(lane)) * cos * inverse_power / light.relative[lane];
            let survival = mis.camera_survival(states.history[lane].diffuse() + 1);
            let density = survival.lambertian(at.albedo.get(lane).max_element());
            let hit = density * cos * light.inverse_pdf_w[lane];
            let merges = mis.balance.before_last(earlier);
            let weight = mis.balance.connection_weight(merges, l, hit);
            contributions.set(lane, contributions.get(lane) * weight);
        }
    }

    /// Sets the partials of the last packet of Lambertian gather points.
    #[inline(always)]
    pub(super) fn set_point_partials(
        &mut self,
        mis: &Mis,
        at: &DiffuseVertices,
        vertex: &[u32; LANES],
        earlier: &[f32; LANES],
    ) {
        let mut partials = [GatherPartials::default(); LANES];
        for lane in 0..LANES {
            let albedo = at.albedo.get(lane).max_element();
            let camera = mis.camera_survival(vertex[lane]).lambertian(albedo);
            partials[lane] = mis.balance.gather(vertex[lane], earlier[lane], camera);
        }
        self.gather_points.set_mis_partials(&partials);
    }

    /// Updates the partials of paths that go on from Lambertian vertices of these numbers.
    #[inline(always)]
    pub(super) fn leave_diffuse(
        &mut self,
        mis: &Mis,
        at: &DiffuseVertices,
        states: &PathStates,
        vertex: &[u32; LANES],
        earlier: &[f32; LANES],
        goes_on: &Mask,
    ) {
        for lane in (0..LANES).filter(|&lane| goes_on[lane]) {
            let albedo = at.albedo.get(lane).max_element();
            let density = mis.camera_survival(vertex[lane]).lambertian(albedo);
            let (position, normal) = (at.position.get(lane), at.normal.get(lane));
            self.last_vertices[states.path[lane] as usize] = LastVertex {
                receiver: Receiver { position, normal: Some(normal) },
                normal,
                density,
                partial: mis.balance.leave(vertex[lane], earlier[lane], density),
                is_diffuse: true,
            };
        }
    }

    /// MIS weight of a connection from the lobes of one class at any vertex, which have these
    /// values toward the light.
    pub(super) fn connection_weight(
        &self,
        lights: &Lights,
        vertex: &PathVertex,
        (lobe, values): (Lobe, &LobeValue),
        light: &LightSample,
    ) -> f32 {
        let weights = if lobe == Lobe::Rough { self.hit_weights } else { self.mis };
        let Some(mis) = weights else { return 1.0 };
        let PathVertex { surface, at, state } = *vertex;
        let partial = &self.last_vertices[state.path as usize].partial;
        let directions = Directions { camera: surface.wo, light: light.wi };
        let shading_cos = light.wi.dot(at.normal);
        let (camera, merges) = if lobe == Lobe::Rough {
            let choice = mis.pass_choice(state.history.diffuse());
            let camera = choice.rough_density_of(&surface.bsdf, at, values.pdf_w, shading_cos);
            let merges = mis.balance.caustic_merges(partial);
            (camera, if merges > 0.0 { merges * directions.light_rough(surface) } else { 0.0 })
        } else {
            let survival = mis.camera_survival(state.history.diffuse() + 1);
            let camera = survival.density_of(values, shading_cos);
            let merges = mis.balance.before_last(mis.balance.arrive(partial, 1.0));
            (camera, if merges > 0.0 { merges * directions.light_diffuse(surface) } else { 0.0 })
        };
        let cos = light.wi.dot(surface.normal).abs();
        let l = emission_over_connection(lights, light, cos);
        mis.balance.connection_weight(merges, l, camera * cos * light.inverse_pdf_w)
    }

    /// Density of merges at earlier vertices where a path arrives at a vertex, over the density of
    /// light paths there.
    pub(super) fn arriving_merges(&self, mis: &Mis, path: u32) -> f32 {
        mis.balance.arrive(&self.last_vertices[path as usize].partial, 1.0)
    }

    /// Updates the partial of a path that continues from any vertex.
    pub(super) fn update_partial(&mut self, vertex: &PathVertex, sample: &BsdfSample) {
        let Some(mis) = self.hit_weights else { return };
        let PathVertex { surface, state, .. } = *vertex;
        let last = &mut self.last_vertices[state.path as usize];
        let directions = Directions { camera: surface.wo, light: sample.wi };
        let is_diffuse = !sample.lobe.passes_through();
        let (density, partial) = if is_diffuse {
            let number = state.history.diffuse() + 1;
            let density = directions.camera_diffuse(surface, mis.camera_survival(number));
            let merges = mis.balance.arrive(&last.partial, 1.0);
            let earlier =
                if merges > 0.0 { merges * directions.light_diffuse(surface) } else { 0.0 };
            (density, mis.balance.leave(number, earlier, density))
        } else {
            let is_rough = sample.lobe == Lobe::Rough;
            let choice = mis.pass_choice(state.history.diffuse());
            let density = if is_rough { directions.camera_rough(surface, choice) } else { 0.0 };
            let partial = if last.partial == CameraPartial::default() {
                last.partial
            } else {
                last.partial.pass(directions.light_over_camera(surface, sample.lobe, choice))
            };
            (density, partial)
        };
        let (receiver, normal) = (surface.receiver(), surface.normal);
        *last = LastVertex { receiver, normal, density, partial, is_diffuse };
    }

    /// MIS weight of emission that a path hits along `direction` at `position`, after `diffuse`
    /// diffuse vertices.
    #[inline(never)] // rare
    pub(super) fn emission_weight(
        &self,
        scene: &Scene,
        path: u32,
        diffuse: u32,
        side: TriangleSide,
        [position, direction]: [Vec3; 2],
    ) -> f32 {
        let Some(mis) = self.hit_weights else { return 1.0 };
        let last = &self.last_vertices[path as usize];
        let Some(emitter) = scene.emitter(side) else { return 1.0 };
        let lights = scene.lights();
        let connection_pdf_w = if last.density > 0.0 {
            lights.connection_pdf_w(emitter, position, last.receiver)
        } else {
            0.0
        };
        let emission = lights.emission_density(emitter, [position, -direction]).unwrap_or(0.0);
        last.hit_weight(&mis, diffuse, &Hit { direction, connection_pdf_w, emission })
    }

    /// Environment radiance that a path hits along `direction` after `diffuse` diffuse vertices,
    /// times its MIS weight.
    pub(super) fn environment_hit(
        &self,
        lights: &Lights,
        path: u32,
        diffuse: u32,
        direction: Vec3,
    ) -> Rgb {
        let Some(mis) = self.hit_weights else { return lights.environment_radiance(direction) };
        let last = &self.last_vertices[path as usize];
        let (radiance, connection_pdf_w) = if last.density > 0.0 {
            lights.environment_sight(direction, last.receiver)
        } else {
            (lights.environment_radiance(direction), 0.0)
        };
        let emission = lights.environment_emission(radiance, [last.receiver.position, -direction]);
        radiance * last.hit_weight(&mis, diffuse, &Hit { direction, connection_pdf_w, emission })
    }
}

/// Density of emission from a light source over the density of connections with it, at a surface
/// that its light meets at this cosine: theory.md (47b), `l`.
fn emission_over_connection(lights: &Lights, light: &LightSample, cos: f32) -> f32 {
    luminance(light.irradiance) * cos / (lights.total_power() * light.relative)
}
