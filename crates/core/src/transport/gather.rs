//! Gather points: the vertices of camera paths at which photons are merged.

use super::mis::densities::Survival;
use super::mis::weights::GatherPartials;
use super::path_state::History;
use super::photon::Photon;
use crate::base::math::Rgb;
use crate::base::spectrum::Wavelength;
use crate::scene::bsdf::{Bsdf, Lobe, Transport, Vertex};
use crate::scene::diffuse::{DiffuseVertices, TriangleSide};
use crate::scene::shading_normal;
use crate::simd::{LANES, Mask, Vec3s};
use glam::Vec3;
use std::array::from_fn;
use std::ops::Range;

/// A vertex of a camera path at which photons are merged.
#[derive(Clone, Copy, Debug)]
pub struct GatherPoint {
    /// Position, scene units.
    pub position: Vec3,
    /// Index of its camera path among those that are merged together.
    pub path: u32,
    /// Throughput of the path times the BSDF toward the camera, 1/sr: the factor of a photon's flux
    /// per area of the merge kernel. The throughput alone if there is a `view`.
    pub weight: Rgb,
    /// Number of the diffuse vertex, `1..=k`. Photons of all classes are merged at `k`, only
    /// caustic photons before.
    pub vertex: u32,
    /// Wavelength of the path; `None` for all wavelengths.
    pub wavelength: Option<Wavelength>,
    /// Unit normal on the side on which photons merge: the one that the camera path sees, or the
    /// other one of surfaces that transmit diffusely.
    pub normal: Vec3,
    /// That side of the triangle.
    pub facet: TriangleSide,
    /// Index in [`CameraPaths::views`](crate::transport::camera_paths::CameraPaths::views), or
    /// [`GatherPoint::NO_VIEW`] if the BSDF is constant.
    pub view: u32,
}

impl GatherPoint {
    /// Marks a point whose BSDF does not depend on the directions of photons.
    pub const NO_VIEW: u32 = u32::MAX;
}

/// The gather points of camera paths that are merged together.
#[derive(Clone, Debug, Default)]
pub struct GatherPoints {
    packets: Vec<GatherPacket>,
    /// MIS partials of the points; meaningless without MIS. Points with a view have
    /// [`Self::set_earlier_merges`] alone.
    mis_partials: Vec<[GatherPartials; LANES]>,
    /// Lanes in use. A packet of diffuse vertices uses all lanes even if not all of its points
    /// gather.
    taken: usize,
}

/// Up to sixteen points side by side; see [`GatherPoint`].
#[derive(Clone, Copy, Debug, Default)]
#[repr(C, align(64))]
pub(crate) struct GatherPacket {
    pub position: Vec3s,
    pub weight: Vec3s,
    pub normal: Vec3s,
    pub path: [u32; LANES],
    /// Numbers of the diffuse vertices, and wavelengths.
    pub history: [History; LANES],
    pub view: [u32; LANES],
    /// Meshes and sides of the [`TriangleSide`]s.
    pub mesh: [u32; LANES],
    pub side: [u32; LANES],
    /// Lanes that gather.
    pub gathers: Mask,
}

impl GatherPacket {
    /// The lanes that gather for these camera paths.
    #[inline(always)] // part of vectorized code
    pub fn gathers_of(&self, paths: &Range<usize>) -> Mask {
        let (start, end) = (paths.start as u32, paths.end as u32);
        from_fn(|lane| self.gathers[lane] & (self.path[lane] >= start) & (self.path[lane] < end))
    }

    /// The point in one lane.
    #[inline(always)] // part of vectorized code
    pub fn get(&self, lane: usize) -> GatherPoint {
        GatherPoint {
            position: self.position.get(lane),
            path: self.path[lane],
            weight: self.weight.get(lane),
            vertex: self.history[lane].diffuse(),
            wavelength: self.history[lane].wavelength(),
            normal: self.normal.get(lane),
            view: self.view[lane],
            facet: TriangleSide { mesh: self.mesh[lane], side: self.side[lane] },
        }
    }
}

impl GatherPoints {
    /// Removes all points.
    pub fn clear(&mut self) {
        self.taken = 0;
    }

    /// All points; the points of one path are in the order of its vertices.
    pub fn iter(&self) -> impl Iterator<Item = GatherPoint> {
        self.packets().iter().flat_map(|packet| {
            (0..LANES).filter(|&lane| packet.gathers[lane]).map(|lane| packet.get(lane))
        })
    }

    /// Numbers the points one by one in place of their paths, so that each has a sum of its own
    /// when photons are merged. Returns the path and the lane of each.
    pub(crate) fn number_each(&mut self) -> Vec<(u32, usize)> {
        let mut all = Vec::new();
        let packets = self.taken.div_ceil(LANES);
        for (index, packet) in self.packets[..packets].iter_mut().enumerate() {
            for lane in (0..LANES).filter(|&lane| packet.gathers[lane]) {
                let number = all.len() as u32;
                all.push((packet.path[lane], index * LANES + lane));
                packet.path[lane] = number;
            }
        }
        all
    }

    /// The point in the lane of this number.
    #[inline]
    pub(crate) fn at(&self, number: usize) -> GatherPoint {
        self.packets[number / LANES].get(number % LANES)
    }

    /// Number of lanes in use.
    pub(crate) fn lanes(&self) -> usize {
        self.taken
    }

    /// All packets; the points of one path are in the order of its vertices.
    pub(crate) fn packets(&self) -> &[GatherPacket] {
        &self.packets[..self.taken.div_ceil(LANES)]
    }

    /// Adds a point.
    pub(crate) fn push(&mut self, point: &GatherPoint) {
        let lane = self.taken % LANES;
        let packet = self.packet();
        if lane == 0 {
            packet.gathers = Mask::default();
        }
        packet.position.set(lane, point.position);
        packet.weight.set(lane, point.weight);
        packet.normal.set(lane, point.normal);
        packet.path[lane] = point.path;
        packet.history[lane] = History::at_vertex(point.vertex, point.wavelength);
        packet.view[lane] = point.view;
        (packet.mesh[lane], packet.side[lane]) = (point.facet.mesh, point.facet.side);
        packet.gathers[lane] = true;
        self.taken += 1;
    }

    /// Sets the density of merges at earlier vertices of the last point, over the density of light
    /// paths there.
    pub(crate) fn set_earlier_merges(&mut self, earlier: f32) {
        self.set_point_partials(GatherPartials { earlier, camera: 0.0 });
    }

    /// Sets the MIS partials of the last point, which has no view.
    pub(crate) fn set_point_partials(&mut self, partials: GatherPartials) {
        let last = self.taken - 1;
        self.last_partials()[last % LANES] = partials;
    }

    /// Sets the MIS partials of the last packet of points.
    pub(crate) fn set_mis_partials(&mut self, partials: &[GatherPartials; LANES]) {
        *self.last_partials() = *partials;
    }

    fn last_partials(&mut self) -> &mut [GatherPartials; LANES] {
        let packets = self.taken.div_ceil(LANES);
        if self.mis_partials.len() < packets {
            self.mis_partials.resize(packets, [GatherPartials::default(); LANES]);
        }
        &mut self.mis_partials[packets - 1]
    }

    /// The MIS partials of the point in the lane of this number.
    #[inline]
    pub(crate) fn mis_partials(&self, number: usize) -> &GatherPartials {
        &self.mis_partials[number / LANES][number % LANES]
    }

    /// The packet with the next free lane.
    #[inline(always)]
    fn packet(&mut self) -> &mut GatherPacket {
        let packet = self.taken / LANES;
        if packet == self.packets.len() {
            self.packets.push(GatherPacket::default());
        }
        &mut self.packets[packet]
    }

    /// Adds the diffuse vertices in the lanes of `gathers`; `history` has their numbers along their
    /// paths.
    #[inline(always)] // part of the loop over vertices
    pub(crate) fn push_diffuse(
        &mut self,
        gathers: &Mask,
        at: &DiffuseVertices,
        weight: &Vec3s,
        path: &[u32; LANES],
        history: &[History; LANES],
    ) {
        self.taken = self.taken.next_multiple_of(LANES);
        *self.packet() = GatherPacket {
            position: at.position,
            weight: *weight,
            normal: at.normal,
            path: *path,
            history: *history,
            view: [GatherPoint::NO_VIEW; LANES],
            mesh: at.mesh,
            side: at.side,
            gathers: *gathers,
        };
        self.taken += LANES;
    }
}

/// A surface whose BSDF depends on the directions of photons, as a camera path sees it.
#[derive(Clone, Copy, Debug)]
pub struct GatherView {
    /// The BSDF.
    pub bsdf: Bsdf,
    /// Shading normal and direction toward the camera path.
    pub at: Vertex,
    /// Interpolated or mapped unit normal on the side that is seen, if there is one.
    pub interpolated: Option<Vec3>,
    /// True if photons merge on the other side, and their light is transmitted.
    pub transmits: bool,
}

impl GatherView {
    /// The BSDF's value for a photon that is merged at `point`, 1/sr. Photons count by the area of
    /// the triangles, light by the area of the interpolated surface.
    pub fn value(&self, photon: &Photon, point: &GatherPoint) -> Rgb {
        self.value_from(photon.from_as_at(point.normal), point)
    }

    /// The BSDF's value as of [`Self::value`] for a photon from `wi`, 1/sr.
    pub fn value_from(&self, wi: Vec3, point: &GatherPoint) -> Rgb {
        // theory.md (37)
        let areas = wi.dot(self.turned(self.at.normal)) / wi.dot(point.normal);
        if areas > 0.0 {
            // theory.md (46)
            self.bsdf.eval_lobe(Lobe::Wide, &self.at, wi) * areas
        } else {
            Rgb::ZERO
        }
    }

    /// Density with which camera paths go on toward `wi`.
    pub(crate) fn camera_density(&self, wi: Vec3, survival: Survival) -> f32 {
        survival.density(&self.bsdf, &self.at, wi)
    }

    /// Density with which light paths from `wi` go on along the camera path. The triangle has the
    /// unit normal `normal` on the side of the photons.
    pub(crate) fn light_density(&self, wi: Vec3, normal: Vec3) -> f32 {
        let normal = self.interpolated.map_or(normal, |interpolated| {
            let interpolated = self.turned(interpolated);
            shading_normal(&self.bsdf, interpolated, normal, wi, Transport::Flux)
        });
        let front = self.at.front != self.transmits;
        let at = Vertex { normal, wo: wi, front, ..self.at };
        Survival::LIGHT.density(&self.bsdf, &at, self.at.wo)
    }

    /// Turns a vector from the side that is seen to the side of the photons.
    fn turned(&self, seen: Vec3) -> Vec3 {
        if self.transmits { -seen } else { seen }
    }
}
