//! Where camera paths gather photons.

use crate::bsdf::{Bsdf, Lobe, Vertex};
use crate::diffuse::DiffuseVertices;
use crate::lanes::{LANES, Mask, Vec3s};
use crate::math::Rgb;
use crate::photon::Photon;
use glam::Vec3;

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
    /// Index in [`CameraPaths::views`](crate::camera_paths::CameraPaths::views), or
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
    /// Lanes that are taken: all of a packet, even if not all of its points gather.
    taken: usize,
    /// Points in the order of their paths: number of each one's lane among those of all packets.
    order: Vec<u32>,
    /// For putting them in order: where those of each path go.
    places: Vec<u32>,
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
    /// Which lanes gather.
    pub gathers: Mask,
}

impl GatherPacket {
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
        }
    }
}

impl GatherPoints {
    /// Takes all out.
    pub fn clear(&mut self) {
        self.taken = 0;
        self.order.clear();
    }

    /// Whether all were put in the order of their paths.
    pub(crate) fn is_ordered(&self) -> bool {
        self.numbers().count() == self.order.len()
    }

    /// Numbers of the lanes that gather.
    fn numbers(&self) -> impl Iterator<Item = usize> {
        let packets = self.packets().iter().zip((0..).step_by(LANES));
        packets.flat_map(|(packet, first)| {
            (first..).zip(&packet.gathers).filter(|&(_, gathers)| *gathers).map(|(lane, _)| lane)
        })
    }

    /// How many were [put in order](crate::camera_paths::CameraPaths::order_by_path).
    pub fn len(&self) -> usize {
        self.order.len()
    }

    /// Whether none was put in order.
    pub fn is_empty(&self) -> bool {
        self.order.is_empty()
    }

    /// One of them, at a place in their order.
    ///
    /// # Panics
    /// If there are not so many.
    #[inline]
    pub fn get(&self, place: usize) -> GatherPoint {
        self.at(self.number(place))
    }

    /// The number of the lane of the one at a place in their order.
    #[inline]
    pub(crate) fn number(&self, place: usize) -> usize {
        self.order[place] as usize
    }

    /// The one in this lane.
    #[inline]
    pub(crate) fn at(&self, number: usize) -> GatherPoint {
        self.packets[number / LANES].get(number % LANES)
    }

    /// All in their order.
    pub fn iter(&self) -> impl Iterator<Item = GatherPoint> {
        (0..self.len()).map(|place| self.get(place))
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
        packet.gathers[lane] = true;
        self.taken += 1;
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
            gathers: *gathers,
        };
        self.taken += LANES;
    }

    /// Puts all in the order of their `paths`; points of one path stay in theirs (a counting sort).
    pub(crate) fn order_by_path(&mut self, paths: usize) {
        let mut order = std::mem::take(&mut self.order);
        let mut places = std::mem::take(&mut self.places);
        let path = |number: usize| self.packets[number / LANES].path[number % LANES] as usize;
        places.clear();
        places.resize(paths + 1, 0);
        for number in self.numbers() {
            places[path(number) + 1] += 1;
        }
        let mut sum = 0;
        for place in &mut places {
            sum += *place;
            *place = sum;
        }
        order.resize(sum as usize, 0);
        for number in self.numbers() {
            let place = &mut places[path(number)];
            order[*place as usize] = number as u32;
            *place += 1;
        }
        (self.order, self.places) = (order, places);
    }
}

/// A surface whose BSDF depends on where photons come from, as a camera path sees it.
#[derive(Clone, Copy, Debug)]
pub struct GatherView {
    /// How it scatters.
    pub bsdf: Bsdf,
    /// Whence it is seen.
    pub at: Vertex,
}

impl GatherView {
    /// The BSDF's value for a photon that is merged at `point`, 1/sr. Photons count by the area of
    /// the triangles, light by that of the interpolated surface.
    pub fn value(&self, photon: &Photon, point: &GatherPoint) -> Rgb {
        let wi = photon.from_as_at(point.normal);
        let areas = wi.dot(self.at.normal) / wi.dot(point.normal);
        if areas > 0.0 {
            self.bsdf.eval_lobe(Lobe::Diffuse, &self.at, wi) * areas
        } else {
            Rgb::ZERO
        }
    }
}
