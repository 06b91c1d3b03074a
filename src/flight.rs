//! Paths under way: the ray of each, and what goes with it, sixteen side by side.

use crate::accel::RayPacket;
use crate::lanes::{LANES, Mask, Vec3s, all};
use bytemuck::Pod;

/// What goes with sixteen rays: columns of one word for each.
pub(crate) trait Columns: Pod {
    /// Where the rays end, in multiples of their direction's length.
    const T_FAR: f32;
}

/// Rays with what goes with them, packed without gaps.
#[derive(Clone, Debug, Default)]
pub(crate) struct Flight<W> {
    rays: Vec<RayPacket>,
    walks: Vec<W>,
    len: usize,
}

impl<W: Columns> Flight<W> {
    /// Takes all out.
    pub fn clear(&mut self) {
        self.len = 0;
    }

    /// How many there are.
    pub fn len(&self) -> usize {
        self.len
    }

    /// Their rays.
    pub fn rays(&self) -> &[RayPacket] {
        &self.rays[..self.len.div_ceil(LANES)]
    }

    /// Each packet, with how many of its lanes are in use.
    pub fn packets(&mut self) -> impl Iterator<Item = (&RayPacket, &mut W, usize)> {
        let len = self.len;
        let counts = (0..len).step_by(LANES).map(move |first| (len - first).min(LANES));
        let packets = self.rays.iter().zip(&mut self.walks).zip(counts);
        packets.map(|((rays, walks), count)| (rays, walks, count))
    }

    /// Adds `count` that fill the first lanes of a packet; those before must have filled theirs.
    pub fn add_packet(&mut self, count: usize) -> (&mut RayPacket, &mut W) {
        assert!(self.len.is_multiple_of(LANES) && count <= LANES, "packets without gaps");
        self.make_room();
        let packet = self.len / LANES;
        self.len += count;
        (&mut self.rays[packet], &mut self.walks[packet])
    }

    /// Adds one: its lane of the packets is to be filled.
    pub fn add(&mut self) -> (&mut RayPacket, &mut W, usize) {
        self.make_room();
        let (packet, lane) = (self.len / LANES, self.len % LANES);
        self.len += 1;
        (&mut self.rays[packet], &mut self.walks[packet], lane)
    }

    /// Adds those that are `kept`, in their order.
    #[inline(always)] // part of the loops over vertices
    pub fn append(&mut self, kept: &Mask, origin: &Vec3s, direction: &Vec3s, walks: &W) {
        self.make_room();
        let (first, mut place) = (self.len / LANES, self.len % LANES);
        if place == 0 && all(kept) {
            (self.rays[first].origin, self.rays[first].direction) = (*origin, *direction);
            self.walks[first] = *walks;
            self.len += LANES;
            return;
        }
        let to_rays: &mut [_; 2] = self.rays[first..].first_chunk_mut().unwrap();
        let to_walks: &mut [_; 2] = self.walks[first..].first_chunk_mut().unwrap();
        for (lane, &kept) in kept.iter().enumerate() {
            // Each is copied and the next comes after it, or in its place if it is not kept: no branch
            // that chance decides and nothing predicts.
            let (packet, to) = (place / LANES % 2, place % LANES);
            copy_lane(&mut to_rays[packet].origin, to, origin, lane);
            copy_lane(&mut to_rays[packet].direction, to, direction, lane);
            copy_lane(&mut to_walks[packet], to, walks, lane);
            place += usize::from(kept);
        }
        self.len = first * LANES + place;
    }

    /// Room for sixteen more.
    #[inline(always)]
    fn make_room(&mut self) {
        if self.len / LANES + 2 > self.rays.len() {
            self.grow();
        }
    }

    #[cold]
    fn grow(&mut self) {
        let packets = (2 * self.rays.len()).max(4);
        self.rays.resize(packets, RayPacket::until(W::T_FAR));
        self.walks.resize(packets, W::zeroed());
    }
}

/// Copies all words of one lane.
#[inline(always)]
fn copy_lane<C: Pod>(to: &mut C, to_lane: usize, from: &C, from_lane: usize) {
    let to: &mut [[u32; LANES]] = bytemuck::cast_slice_mut(std::slice::from_mut(to));
    let from: &[[u32; LANES]] = bytemuck::cast_slice(std::slice::from_ref(from));
    for (to, from) in to.iter_mut().zip(from) {
        to[to_lane] = from[from_lane];
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    impl Columns for [u32; LANES] {
        const T_FAR: f32 = 1.0;
    }

    #[test]
    fn those_that_are_kept_follow_each_other_in_their_order() {
        let mut flight = Flight::<[u32; LANES]>::default();
        let mut expected = Vec::new();
        for round in 0..100_u32 {
            let names: [u32; LANES] = std::array::from_fn(|lane| round * 100 + lane as u32);
            let column = names.map(|name| name as f32);
            let vectors = Vec3s { x: column, y: column.map(|x| -x), z: [0.5; LANES] };
            // All, none, and many in between.
            let pattern =
                round.wrapping_mul(0x9e37_79b9) >> 16 | u32::from(round % 7 == 0) * 0xffff;
            let kept = std::array::from_fn(|lane| round % 5 != 0 && pattern >> lane & 1 == 1);
            flight.append(&kept, &vectors, &vectors, &names);
            expected.extend(names.iter().zip(kept).filter(|&(_, kept)| kept).map(|(&n, _)| n));
            if round % 3 == 0 {
                let (rays, walks, lane) = flight.add();
                (rays.origin.x[lane], rays.direction.y[lane]) = (7.0, -7.0);
                walks[lane] = 7;
                expected.push(7);
            }
        }
        assert_eq!(flight.len(), expected.len());
        assert_eq!(flight.packets().map(|(.., count)| count).sum::<usize>(), expected.len());
        for (index, &name) in expected.iter().enumerate() {
            let (packet, lane) = (index / LANES, index % LANES);
            let ray = flight.rays()[packet].get(lane);
            assert_eq!(flight.walks[packet][lane], name);
            assert_eq!([ray.origin.x, -ray.direction.y], [name as f32; 2]);
            assert_eq!((ray.t_near, ray.t_far), (0.0, 1.0));
        }
    }
}
