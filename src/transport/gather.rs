//! Where camera paths gather photons.

use super::mis::Mis;
use super::photon::Photon;
use crate::base::math::Rgb;
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
    /// Where it is, scene units.
    pub position: Vec3,
    /// Its camera path: index among those that are merged together.
    pub path: u32,
    /// Throughput of the path times the BSDF toward the camera, 1/sr: what a photon's flux per
    /// area (of the merge kernel) is multiplied with. The throughput alone if there is a `view`.
    pub weight: Rgb,
    /// Number of the diffuse vertex, `1..=k`: all photons are merged at `k`; before, only those that
    /// come from a light without a diffuse bounce.
    pub vertex: u32,
    /// Unit normal on the side that the camera path sees.
    pub normal: Vec3,
    /// That side.
    pub facet: TriangleSide,
    /// Index in [`CameraPaths::views`](crate::transport::camera_paths::CameraPaths::views), or
    /// [`GatherPoint::NO_VIEW`] if the BSDF is the same for all photons.
    pub view: u32,
}

impl GatherPoint {
    /// The BSDF does not depend on where photons come from.
    pub const NO_VIEW: u32 = u32::MAX;
}

/// The gather points of camera paths that are merged together.
#[derive(Clone, Debug, Default)]
pub struct GatherPoints {
    packets: Vec<GatherPacket>,
    /// What the points carry of their paths' weights, if paths are weighted.
    parts: Vec<[f32; LANES]>,
    /// Lanes that are taken: all of a packet, even if not all of its points gather.
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
    pub vertex: [u32; LANES],
    pub view: [u32; LANES],
    /// The facets; see [`TriangleSide`].
    pub mesh: [u32; LANES],
    pub side: [u32; LANES],
    /// Which lanes gather.
    pub gathers: Mask,
}

impl GatherPacket {
    /// Which lanes gather for these camera paths.
    #[inline(always)] // part of vectorized code
    pub fn gathers_of(&self, paths: &Range<usize>) -> Mask {
        let (start, end) = (paths.start as u32, paths.end as u32);
        from_fn(|lane| self.gathers[lane] & (self.path[lane] >= start) & (self.path[lane] < end))
    }

    /// One of the points.
    #[inline(always)] // part of vectorized code
    pub fn get(&self, lane: usize) -> GatherPoint {
        GatherPoint {
            position: self.position.get(lane),
            path: self.path[lane],
            weight: self.weight.get(lane),
            vertex: self.vertex[lane],
            normal: self.normal.get(lane),
            view: self.view[lane],
            facet: TriangleSide { mesh: self.mesh[lane], side: self.side[lane] },
        }
    }
}

impl GatherPoints {
    /// Takes all out.
    pub fn clear(&mut self) {
        self.taken = 0;
    }

    /// All of them; those of one path are in the order of its vertices.
    pub fn iter(&self) -> impl Iterator<Item = GatherPoint> {
        self.packets().iter().flat_map(|packet| {
            (0..LANES).filter(|&lane| packet.gathers[lane]).map(|lane| packet.get(lane))
        })
    }

    /// The one in this lane.
    #[inline]
    pub(crate) fn at(&self, number: usize) -> GatherPoint {
        self.packets[number / LANES].get(number % LANES)
    }

    /// Lanes that all of them take.
    pub(crate) fn lanes(&self) -> usize {
        self.taken
    }

    /// All side by side; points of one path are in the order of its vertices.
    pub(crate) fn packets(&self) -> &[GatherPacket] {
        &self.packets[..self.taken.div_ceil(LANES)]
    }

    /// Adds one.
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
        packet.vertex[lane] = point.vertex;
        packet.view[lane] = point.view;
        (packet.mesh[lane], packet.side[lane]) = (point.facet.mesh, point.facet.side);
        packet.gathers[lane] = true;
        self.taken += 1;
    }

    /// Sets what the last point carries of its path's weight.
    pub(crate) fn set_part(&mut self, part: f32) {
        let last = self.taken - 1;
        self.parts_of_last()[last % LANES] = part;
    }

    /// Sets that of the last packet of points.
    pub(crate) fn set_parts(&mut self, parts: &[f32; LANES]) {
        *self.parts_of_last() = *parts;
    }

    fn parts_of_last(&mut self) -> &mut [f32; LANES] {
        let packets = self.taken.div_ceil(LANES);
        if self.parts.len() < packets {
            self.parts.resize(packets, [0.0; LANES]);
        }
        &mut self.parts[packets - 1]
    }

    /// What the point in this lane carries of its path's weight.
    #[inline]
    pub(crate) fn part(&self, number: usize) -> f32 {
        self.parts[number / LANES][number % LANES]
    }

    /// The one with the next lane to take.
    #[inline(always)]
    fn packet(&mut self) -> &mut GatherPacket {
        let packet = self.taken / LANES;
        if packet == self.packets.len() {
            self.packets.push(GatherPacket::default());
        }
        &mut self.packets[packet]
    }

    /// Adds those of diffuse vertices that gather; the numbers are those of the vertices.
    #[inline(always)] // part of the loop over vertices
    pub(crate) fn push_diffuse(
        &mut self,
        gathers: &Mask,
        at: &DiffuseVertices,
        weight: &Vec3s,
        path: &[u32; LANES],
        vertex: &[u32; LANES],
    ) {
        self.taken = self.taken.next_multiple_of(LANES);
        *self.packet() = GatherPacket {
            position: at.position,
            weight: *weight,
            normal: at.normal,
            path: *path,
            vertex: *vertex,
            view: [GatherPoint::NO_VIEW; LANES],
            mesh: at.mesh,
            side: at.side,
            gathers: *gathers,
        };
        self.taken += LANES;
    }
}

/// A surface whose BSDF depends on where photons come from, as a camera path sees it.
#[derive(Clone, Copy, Debug)]
pub struct GatherView {
    /// How it scatters.
    pub bsdf: Bsdf,
    /// Whence it is seen.
    pub at: Vertex,
    /// Unit normal that is not the triangle's, on the side that is seen, if there is one.
    pub interpolated: Option<Vec3>,
}

impl GatherView {
    /// The BSDF's value for a photon that is merged at `point`, 1/sr. Photons count by the area of
    /// the triangles, light by that of the interpolated surface.
    pub fn value(&self, photon: &Photon, point: &GatherPoint) -> Rgb {
        self.value_from(photon.from_as_at(point.normal), point)
    }

    /// The same for light from `wi`.
    pub fn value_from(&self, wi: Vec3, point: &GatherPoint) -> Rgb {
        // theory.md (37)
        let areas = wi.dot(self.at.normal) / wi.dot(point.normal);
        if areas > 0.0 {
            // theory.md (46)
            self.bsdf.eval_lobe(Lobe::Diffuse, &self.at, wi) * areas
        } else {
            Rgb::ZERO
        }
    }

    /// Density with which camera paths go on toward light from `wi`.
    pub(crate) fn camera_density(&self, mis: &Mis, wi: Vec3) -> f32 {
        mis.camera.density(&self.bsdf, &self.at, wi)
    }

    /// Density with which light paths that come from `wi` go on along the camera path, where the triangle has
    /// the unit normal `normal`.
    pub(crate) fn light_density(&self, mis: &Mis, wi: Vec3, normal: Vec3) -> f32 {
        let normal = self.interpolated.map_or(normal, |interpolated| {
            shading_normal(&self.bsdf, interpolated, normal, wi, Transport::Flux)
        });
        let at = Vertex { normal, wo: wi, front: self.at.front };
        mis.light.density(&self.bsdf, &at, self.at.wo)
    }
}
