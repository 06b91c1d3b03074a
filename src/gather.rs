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
    /// Its camera path: index within the batch.
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

/// The gather points of a batch.
#[derive(Clone, Debug, Default)]
pub struct GatherPoints {
    packets: Vec<Packet>,
    /// Lanes that are taken: all of a packet, even if not all of its points gather.
    taken: usize,
    /// Number of each point's lane among those of all packets.
    order: Vec<u32>,
    /// For putting them in order: these, and where those of each path go.
    unordered: Vec<u32>,
    places: Vec<u32>,
}

/// Up to sixteen points side by side; see [`GatherPoint`].
#[derive(Clone, Copy, Debug, Default)]
#[repr(C, align(64))]
struct Packet {
    position: Vec3s,
    weight: Vec3s,
    normal: Vec3s,
    path: [u32; LANES],
    vertex: [u32; LANES],
    view: [u32; LANES],
}

impl GatherPoints {
    /// Takes all out.
    pub fn clear(&mut self) {
        self.taken = 0;
        self.order.clear();
    }

    /// How many there are.
    pub fn len(&self) -> usize {
        self.order.len()
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.order.is_empty()
    }

    /// One of them, at a place in their order.
    ///
    /// # Panics
    /// If there are not so many.
    #[inline]
    pub fn get(&self, place: usize) -> GatherPoint {
        let lane = self.order[place] as usize;
        let (packet, lane) = (&self.packets[lane / LANES], lane % LANES);
        GatherPoint {
            position: packet.position.get(lane),
            path: packet.path[lane],
            weight: packet.weight.get(lane),
            vertex: packet.vertex[lane],
            normal: packet.normal.get(lane),
            view: packet.view[lane],
        }
    }

    /// All in their order.
    pub fn iter(&self) -> impl Iterator<Item = GatherPoint> {
        (0..self.len()).map(|place| self.get(place))
    }

    /// Adds one.
    pub(crate) fn push(&mut self, point: &GatherPoint) {
        self.order.push(self.taken as u32);
        let lane = self.taken % LANES;
        let packet = self.packet();
        packet.position.set(lane, point.position);
        packet.weight.set(lane, point.weight);
        packet.normal.set(lane, point.normal);
        packet.path[lane] = point.path;
        packet.vertex[lane] = point.vertex;
        packet.view[lane] = point.view;
        self.taken += 1;
    }

    /// The one with the next lane to take.
    #[inline(always)]
    fn packet(&mut self) -> &mut Packet {
        let packet = self.taken / LANES;
        if packet == self.packets.len() {
            self.packets.push(Packet::default());
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
        let first = self.taken;
        let packet = self.packet();
        packet.position = at.position;
        packet.weight = *weight;
        packet.normal = at.normal;
        packet.path = *path;
        packet.vertex = *vertex;
        packet.view = [GatherPoint::NO_VIEW; LANES];
        self.taken += LANES;
        let lanes = (first as u32..).zip(gathers).filter(|&(_, gathers)| *gathers);
        self.order.extend(lanes.map(|(lane, _)| lane));
    }

    /// Breadth-first order to path order; points of one of the `paths` stay in theirs (a counting
    /// sort).
    pub(crate) fn order_by_path(&mut self, paths: usize) {
        let path = |place: &u32| {
            let place = *place as usize;
            self.packets[place / LANES].path[place % LANES]
        };
        if self.order.is_sorted_by_key(path) {
            return;
        }
        self.places.clear();
        self.places.resize(paths + 1, 0);
        for place in &self.order {
            self.places[path(place) as usize + 1] += 1;
        }
        let mut sum = 0;
        for place in &mut self.places {
            sum += *place;
            *place = sum;
        }
        self.unordered.clone_from(&self.order);
        for from in &self.unordered {
            let to = &mut self.places[path(from) as usize];
            self.order[*to as usize] = *from;
            *to += 1;
        }
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
