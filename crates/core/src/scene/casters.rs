//! Where caustics come from: groups of surfaces that pass light on in narrow lobes.

use super::{Material, Placement, Scene};
use crate::base::math::Bounds;
use glam::Vec3;

/// Maximum number of groups.
const MOST_GROUPS: usize = 16;

/// Maximum number of boxes that are grouped; each holds consecutive triangles of a placement.
const MOST_BOXES: usize = 1 << 13;

/// A group is divided if this saves at least this share of the area of its box.
const LEAST_SAVED: f32 = 0.3;

/// A group is divided as well where so much of its extent is empty.
const LEAST_GAP: f32 = 0.02;

/// Whether light that meets a surface of this material leaves it in narrow lobes alone: glass,
/// mirrors, smooth metal.
pub fn casts_caustics(material: &Material) -> bool {
    let bsdf = &material.bsdf;
    bsdf.passes_through() && !bsdf.merges() && !material.is_index_matched_boundary()
}

impl Scene {
    /// Boxes around groups of neighboring surfaces that [cast caustics](casts_caustics), at most
    /// sixteen.
    pub fn caustic_casters(&self) -> Vec<Bounds> {
        let casts = |own: &&Placement| casts_caustics(&self.materials[own.material as usize]);
        let count = |own: &Placement| self.mesh(own).triangles.len();
        let all: usize = self.placements.iter().filter(casts).map(count).sum();
        let each = all.div_ceil(MOST_BOXES).max(1);
        let mut boxes = Vec::new();
        for placement in self.placements.iter().filter(casts) {
            let mesh = self.mesh(placement);
            let move_by = |point: Vec3| match &placement.transform {
                Some(transform) => transform.point(point).unwrap_or_default(),
                None => point,
            };
            let corners = |triangle: &[u32; 3]| triangle.map(|i| mesh.positions[i as usize]);
            boxes.extend(mesh.triangles.chunks(each).map(|triangles| {
                let corners = triangles.iter().flat_map(corners);
                corners.fold(Bounds::EMPTY, |all, corner| all.with(move_by(corner)))
            }));
        }
        groups(boxes)
    }
}

/// Smallest box around two.
fn union(one: Bounds, other: Bounds) -> Bounds {
    Bounds { min: one.min.min(other.min), max: one.max.max(other.max) }
}

/// Half of the area of a box; 0 for an empty one.
fn area(of: &Bounds) -> f32 {
    let Vec3 { x, y, z } = (of.max - of.min).max(Vec3::ZERO);
    x * y + y * z + z * x
}

/// A group of boxes, and where to divide it.
struct Group {
    boxes: Vec<Bounds>,
    bounds: Bounds,
    /// The axis, and the smallest center above the division.
    division: Option<(usize, f32)>,
}

/// A place where a group may be divided.
#[derive(Clone, Copy, Debug)]
struct Division {
    axis: usize,
    middle: f32,
    /// Share of the area that both parts do not have.
    saved: f32,
    /// Empty distance between both parts, over the extent of the group.
    gap: f32,
}

impl Group {
    fn new(boxes: Vec<Bounds>) -> Self {
        let bounds = boxes.iter().copied().fold(Bounds::EMPTY, union);
        let mut group = Self { boxes, bounds, division: None };
        let all: Vec<Division> = (0..3).flat_map(|axis| group.divisions(axis)).collect();
        let by_area = all.iter().max_by(|one, other| one.saved.total_cmp(&other.saved));
        let by_gap = all.iter().max_by(|one, other| one.gap.total_cmp(&other.gap));
        // Objects in rows hardly save area before the last division.
        let best = by_area
            .filter(|best| best.saved > LEAST_SAVED)
            .or_else(|| by_gap.filter(|best| best.gap > LEAST_GAP));
        group.division = best.map(|best| (best.axis, best.middle));
        group
    }

    /// All divisions by the order of the centers along an axis.
    fn divisions(&self, axis: usize) -> Vec<Division> {
        let mut sorted: Vec<&Bounds> = self.boxes.iter().collect();
        sorted.sort_by(|one, other| one.center()[axis].total_cmp(&other.center()[axis]));
        let mut above = vec![Bounds::EMPTY; sorted.len() + 1];
        for (index, own) in sorted.iter().enumerate().rev() {
            above[index] = union(above[index + 1], **own);
        }
        let (whole, extent) = (area(&self.bounds), (self.bounds.max - self.bounds.min)[axis]);
        let mut below = Bounds::EMPTY;
        let mut divisions = Vec::with_capacity(sorted.len());
        for (pair, above) in sorted.windows(2).zip(&above[1..]) {
            below = union(below, *pair[0]);
            let [before, middle] = [pair[0], pair[1]].map(|own| own.center()[axis]);
            if before < middle {
                let saved = 1.0 - (area(&below) + area(above)) / whole;
                let gap = (above.min[axis] - below.max[axis]) / extent;
                divisions.push(Division { axis, middle, saved, gap });
            }
        }
        divisions
    }
}

/// Groups of boxes that are near each other. The largest group is divided first.
fn groups(boxes: Vec<Bounds>) -> Vec<Bounds> {
    if boxes.is_empty() {
        return Vec::new();
    }
    let mut groups = vec![Group::new(boxes)];
    while groups.len() < MOST_GROUPS {
        let divisible = (0..groups.len()).filter(|&index| groups[index].division.is_some());
        let size = |index: &usize| area(&groups[*index].bounds);
        let Some(largest) = divisible.max_by(|one, other| size(one).total_cmp(&size(other))) else {
            break;
        };
        let Group { boxes, division, .. } = groups.swap_remove(largest);
        let (axis, middle) = division.expect("it is divisible");
        let parts: (Vec<_>, Vec<_>) =
            boxes.into_iter().partition(|own| own.center()[axis] < middle);
        groups.extend([parts.0, parts.1].map(Group::new));
    }
    groups.into_iter().map(|own| own.bounds).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The unit cube at a position, as boxes of its faces.
    fn cube(at: Vec3) -> Vec<Bounds> {
        let point = |corner: Vec3| Bounds { min: at + corner, max: at + corner };
        let corners =
            (0..8).map(|i| Vec3::new((i & 1) as f32, (i >> 1 & 1) as f32, (i >> 2) as f32));
        corners.map(|corner| union(point(corner), point(Vec3::splat(0.5)))).collect()
    }

    #[test]
    fn objects_far_apart_are_groups_of_their_own() {
        let places = [Vec3::ZERO, Vec3::X * 40.0, Vec3::Y * 9.0 + Vec3::X * 41.0];
        let mut found = groups(places.into_iter().flat_map(cube).collect());
        found.sort_by(|one, other| one.min.x.total_cmp(&other.min.x));
        let expected = places.map(|at| Bounds { min: at, max: at + 1.0 });
        assert_eq!(found, expected);
    }

    #[test]
    fn one_object_is_one_group_and_a_city_has_few() {
        assert_eq!(groups(cube(Vec3::ZERO)).len(), 1);
        assert!(groups(Vec::new()).is_empty());
        let city = (0..1000).map(|i| Vec3::new((i % 40) as f32, 0.0, (i / 40) as f32) * 30.0);
        let city = groups(city.flat_map(cube).collect());
        assert_eq!(city.len(), MOST_GROUPS);
    }
}
