//! Tags of connected components: six bits by which photons of neighboring components differ.

use crate::accel::Instance;
use glam::{Vec3, Vec3Swizzles};

/// Number of different tags.
const TAGS: usize = 64;

/// Components that get the best tag. The work grows with the square of their number; smaller ones
/// get a hash.
const COMPARED: usize = 2048;

/// Distance between boxes up to which components are neighbors, over the size of all.
const NEAR: f32 = 0.02;

/// The box around a component.
#[derive(Clone, Copy, Debug)]
pub struct ComponentBox {
    pub low: Vec3,
    pub high: Vec3,
}

impl ComponentBox {
    /// The box of no points.
    pub const EMPTY: Self = Self { low: Vec3::INFINITY, high: Vec3::NEG_INFINITY };

    /// Grows to hold another box.
    pub fn add(&mut self, other: &Self) {
        (self.low, self.high) = (self.low.min(other.low), self.high.max(other.high));
    }

    /// The box around this one at a place of its mesh.
    pub fn placed(&self, place: &Instance) -> Self {
        let Some(to_scene) = place.to_scene else { return *self };
        let mut placed = Self::EMPTY;
        for corner in 0..8u32 {
            let pick = |axis: usize| {
                if corner >> axis & 1 == 0 { self.low[axis] } else { self.high[axis] }
            };
            let corner = Vec3::new(pick(0), pick(1), pick(2)).as_dvec3();
            let corner = to_scene.transform_point3(corner).as_vec3();
            placed.add(&Self { low: corner, high: corner });
        }
        placed
    }

    fn is_empty(&self) -> bool {
        self.low.cmpgt(self.high).any()
    }

    /// Half of the area of its surface.
    fn size(&self) -> f32 {
        let sides = self.high - self.low;
        sides.dot(sides.zxy())
    }

    fn is_near(&self, other: &Self, distance: f32) -> bool {
        let gap = (self.low - other.high).max(other.low - self.high);
        gap.max_element() <= distance
    }
}

/// A tag below [`TAGS`] for each component. Large components with neighboring boxes have different
/// tags, as far as there are enough.
pub fn tags(boxes: &[ComponentBox]) -> Vec<u8> {
    // The high bits of a product with an odd number near the golden ratio of 2^32
    let hash = |component: u32| (component.wrapping_mul(0x9e37_79b9) >> 26) as u8;
    let mut tags: Vec<u8> = (0..boxes.len() as u32).map(hash).collect();
    let mut all = ComponentBox::EMPTY;
    boxes.iter().for_each(|own| all.add(own));
    let distance = NEAR * (all.high - all.low).max_element();
    let mut order: Vec<usize> = (0..boxes.len()).filter(|&own| !boxes[own].is_empty()).collect();
    order.sort_by(|&a, &b| boxes[b].size().total_cmp(&boxes[a].size()).then(a.cmp(&b)));
    order.truncate(COMPARED);
    for (number, &own) in order.iter().enumerate() {
        let mut used = [0u32; TAGS];
        for &earlier in &order[..number] {
            if boxes[own].is_near(&boxes[earlier], distance) {
                used[usize::from(tags[earlier])] += 1;
            }
        }
        // Among equals the hash decides, so that small components do not share one tag.
        let start = usize::from(tags[own]);
        let best = (0..TAGS).map(|tag| (start + tag) % TAGS).min_by_key(|&tag| used[tag]);
        tags[own] = best.unwrap_or(start) as u8;
    }
    tags
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn neighbors_have_different_tags_while_there_are_enough() {
        let at = |x: f32| ComponentBox { low: Vec3::new(x, 0.0, 0.0), high: Vec3::splat(x + 1.0) };
        // 60 boxes around one place, and 60 around another: all of one place differ.
        let boxes: Vec<_> =
            (0..120).map(|own| at(if own % 2 == 0 { 0.0 } else { 100.0 })).collect();
        let tags = tags(&boxes);
        for first in 0..2 {
            let mut own: Vec<u8> = tags.iter().copied().skip(first).step_by(2).collect();
            own.sort_unstable();
            own.dedup();
            assert_eq!(own.len(), 60);
        }
        assert!(tags.iter().all(|tag| usize::from(*tag) < TAGS));
    }
}
