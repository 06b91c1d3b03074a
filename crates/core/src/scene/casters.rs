//! Where caustics come from: groups of surfaces that pass light on in narrow lobes.

use super::{Material, Placement, Scene};
use crate::base::math::Bounds;
use glam::Vec3;

/// Maximum number of groups.
const MOST_GROUPS: usize = 16;

/// Maximum number of boxes that are grouped; each holds consecutive triangles of a placement.
const MOST_BOXES: usize = 1 << 16;

/// A group is divided if this lowers the area of its boxes at least by this factor.
const WORTHWHILE: f32 = 0.7;

/// Number of positions along each axis at which a group may be divided.
const BINS: usize = 16;

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

/// A group of boxes, and the best place to divide it.
struct Group {
    boxes: Vec<Bounds>,
    bounds: Bounds,
    /// Area that the best division saves, the axis, and the largest center below it.
    division: Option<(f32, usize, f32)>,
}

impl Group {
    fn new(boxes: Vec<Bounds>) -> Self {
        let bounds = boxes.iter().copied().fold(Bounds::EMPTY, union);
        let mut group = Self { boxes, bounds, division: None };
        let axes = (0..3).filter_map(|axis| group.divide_along(axis));
        group.division = axes.max_by(|one, other| one.0.total_cmp(&other.0));
        group
    }

    /// The best division at the ends of equal intervals of the centers.
    fn divide_along(&self, axis: usize) -> Option<(f32, usize, f32)> {
        let centers = self.boxes.iter().map(|own| own.center()[axis]);
        let [low, high] = [
            centers.clone().fold(f32::INFINITY, f32::min),
            centers.fold(f32::NEG_INFINITY, f32::max),
        ];
        let step = (high - low) / BINS as f32;
        let mut bins = [Bounds::EMPTY; BINS];
        for own in &self.boxes {
            let bin = ((own.center()[axis] - low) / step) as usize;
            let bin = &mut bins[bin.min(BINS - 1)];
            *bin = union(*bin, *own);
        }
        let all = area(&self.bounds);
        let saved = |count: usize| {
            let [below, above] = [&bins[..count], &bins[count..]]
                .map(|bins| area(&bins.iter().copied().fold(Bounds::EMPTY, union)));
            (all - below - above, axis, low + count as f32 * step)
        };
        let best = (1..BINS).map(saved).max_by(|one, other| one.0.total_cmp(&other.0));
        best.filter(|(saved, ..)| step > 0.0 && *saved > (1.0 - WORTHWHILE) * all)
    }
}

/// Groups of boxes that are near each other: the division that saves the most area comes first.
fn groups(boxes: Vec<Bounds>) -> Vec<Bounds> {
    if boxes.is_empty() {
        return Vec::new();
    }
    let mut groups = vec![Group::new(boxes)];
    while groups.len() < MOST_GROUPS {
        let saved = |own: &Group| own.division.map_or(0.0, |(saved, ..)| saved);
        let best =
            (0..groups.len()).max_by(|&a, &b| saved(&groups[a]).total_cmp(&saved(&groups[b])));
        let Some(group) = best.filter(|&best| saved(&groups[best]) > 0.0) else { break };
        let Group { boxes, division, .. } = groups.swap_remove(group);
        let (_, axis, middle) = division.expect("it saves area");
        let (below, above) = boxes.into_iter().partition(|own| own.center()[axis] < middle);
        groups.extend([below, above].map(Group::new));
    }
    groups.into_iter().filter(|own| !own.boxes.is_empty()).map(|own| own.bounds).collect()
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
