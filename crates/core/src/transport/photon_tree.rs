//! Photons in a tree of boxes, for queries along segments.
//!
//! Eight neighbors share a box, eight boxes share one, and so on: the tree needs no pointers, and
//! its shape depends on the photons alone. A segment skips empty space by a few boxes, whereas a
//! grid would be read step by step.

use super::photon::{Photon, PhotonClass};
use crate::base::math::Bounds;
use crate::simd::lanes_of;
use glam::Vec3;
use std::array::from_fn;

/// Children of a node, and photons of a leaf.
const WIDE: usize = 8;

/// Maximum number of nodes that wait while a query reads others: seven of each level, and one more.
const STACK: usize = WIDE * 11;

/// Parts of more photons are ordered by several threads.
const PARALLEL: usize = 8192;

/// Coordinates of eight points, by axis.
type F32x8 = [[f32; WIDE]; 3];

/// Photons in a tree of boxes.
#[derive(Debug, Default)]
pub struct PhotonTree {
    /// Neighbors are near each other.
    photons: Vec<Photon>,
    /// Positions of eight photons at a time. Places after the last photon have none (NaN).
    positions: Vec<F32x8>,
    /// Boxes of eight leaves or nodes at a time, from the leaves to the root.
    levels: Vec<Vec<Boxes>>,
    has_caustic_photons: bool,
}

/// Eight boxes.
#[derive(Clone, Copy, Debug)]
struct Boxes {
    min: F32x8,
    max: F32x8,
    /// Number of boxes.
    count: usize,
}

/// A part of a ray.
#[derive(Clone, Copy, Debug)]
pub struct Segment {
    /// Start, scene units.
    pub origin: Vec3,
    /// Unit direction.
    pub direction: Vec3,
    /// Length, scene units; may be infinite.
    pub length: f32,
}

impl Boxes {
    const NONE: Self =
        Self { min: [[f32::INFINITY; WIDE]; 3], max: [[f32::NEG_INFINITY; WIDE]; 3], count: 0 };

    fn of(boxes: impl Iterator<Item = Bounds>) -> Self {
        let mut own = Self::NONE;
        for (lane, Bounds { min, max }) in boxes.enumerate() {
            for axis in 0..3 {
                (own.min[axis][lane], own.max[axis][lane]) = (min[axis], max[axis]);
            }
            own.count = lane + 1;
        }
        own
    }

    /// The box around all.
    fn all(&self) -> Bounds {
        let fold = |of: &F32x8, with: fn(f32, f32) -> f32| {
            Vec3::from_array(of.map(|lanes| lanes.into_iter().reduce(with).expect("eight")))
        };
        Bounds { min: fold(&self.min, f32::min), max: fold(&self.max, f32::max) }
    }

    /// Bits of the boxes that a segment meets within `radius`, or that it may meet. `inverse` is
    /// that of its direction.
    #[inline(always)] // part of the vectorized query
    fn met(&self, segment: &Segment, inverse: Vec3, radius: f32) -> u32 {
        let (mut start, mut end) = ([0.0f32; WIDE], [segment.length; WIDE]);
        for axis in 0..3 {
            let (origin, inverse) = (segment.origin[axis], inverse[axis]);
            for lane in 0..WIDE {
                let one = (self.min[axis][lane] - radius - origin) * inverse;
                let other = (self.max[axis][lane] + radius - origin) * inverse;
                start[lane] = start[lane].max(one.min(other));
                end[lane] = end[lane].min(one.max(other));
            }
        }
        let met: [bool; WIDE] = from_fn(|lane| start[lane] <= end[lane]);
        bits(&met) & ((1 << self.count) - 1)
    }
}

#[inline(always)]
fn bits(lanes: &[bool; WIDE]) -> u32 {
    lanes.iter().enumerate().fold(0, |bits, (lane, own)| bits | u32::from(*own) << lane)
}

/// A photon that is being sorted: its position and its index.
type Place = (Vec3, u32);

/// Orders photons so that neighbors are near each other: splits them along the longest side of
/// their box, at a multiple of the number of photons of some nodes, until leaves are left.
fn order(places: &mut [Place]) {
    let count = places.len();
    if count <= WIDE {
        return;
    }
    let bounds = places.iter().fold(Bounds::EMPTY, |bounds, (position, _)| bounds.with(*position));
    let axis = (bounds.max - bounds.min).max_position();
    let mut node = WIDE;
    while node * WIDE < count {
        node *= WIDE;
    }
    let middle = (count.div_ceil(node) / 2).max(1) * node;
    places.select_nth_unstable_by(middle, |one, other| {
        one.0[axis].total_cmp(&other.0[axis]).then(one.1.cmp(&other.1))
    });
    let (low, high) = places.split_at_mut(middle);
    if count > PARALLEL {
        rayon::join(|| order(low), || order(high));
    } else {
        order(low);
        order(high);
    }
}

impl PhotonTree {
    /// Sorts photons into the tree, on the threads of the current rayon pool. The order depends on
    /// the photons alone.
    ///
    /// # Panics
    /// If there are 2^32 photons.
    pub fn build<'a>(&mut self, slices: impl Iterator<Item = &'a [Photon]>) {
        let unsorted: Vec<Photon> = slices.flatten().copied().collect();
        assert!(u32::try_from(unsorted.len()).is_ok(), "too many photons");
        let place = |(index, photon): (usize, &Photon)| (photon.position, index as u32);
        let mut places: Vec<Place> = unsorted.iter().enumerate().map(place).collect();
        order(&mut places);
        self.photons.clear();
        self.photons.extend(places.iter().map(|&(_, index)| unsorted[index as usize]));
        let is_caustic = |photon: &Photon| photon.class() == PhotonClass::Caustic;
        self.has_caustic_photons = self.photons.iter().any(is_caustic);
        self.positions.clear();
        self.positions.extend(self.photons.chunks(WIDE).map(|photons| {
            let at = |lane: usize| photons.get(lane).map_or(Vec3::NAN, |own| own.position);
            from_fn(|axis| from_fn(|lane| at(lane)[axis]))
        }));
        let around = |photons: &[Photon]| {
            photons.iter().fold(Bounds::EMPTY, |bounds, own| bounds.with(own.position))
        };
        let leaves: Vec<Bounds> = self.photons.chunks(WIDE).map(around).collect();
        self.levels.clear();
        let mut below = leaves;
        while !below.is_empty() {
            let level: Vec<Boxes> =
                below.chunks(WIDE).map(|boxes| Boxes::of(boxes.iter().copied())).collect();
            below = match level.len() {
                1 => vec![],
                _ => level.iter().map(Boxes::all).collect(),
            };
            self.levels.push(level);
        }
    }

    /// Calls `visit` with the index of each photon within `radius` of a segment, and with the
    /// distance of the foot of its perpendicular from the start. The order depends on the photons
    /// and the segment only.
    #[inline(always)] // vectorized
    pub fn for_each_near(&self, segment: &Segment, radius: f32, mut visit: impl FnMut(usize, f32)) {
        let Some(root) = self.levels.len().checked_sub(1) else { return };
        // Parallel to a side, the distances to it are huge instead of not numbers.
        let inverse = segment
            .direction
            .to_array()
            .map(|along| if along.abs() > 1e-18 { along.recip() } else { 1e18f32.copysign(along) });
        let inverse = Vec3::from_array(inverse);
        let (mut stack, mut waiting) = ([(0u32, 0u32); STACK], 1);
        stack[0] = (root as u32, 0);
        while waiting > 0 {
            waiting -= 1;
            let (level, index) = stack[waiting];
            let met = self.levels[level as usize][index as usize].met(segment, inverse, radius);
            let first = index * WIDE as u32;
            if level == 0 {
                for lane in lanes_of(met) {
                    self.visit_leaf((first as usize) + lane, segment, radius, &mut visit);
                }
            } else {
                for lane in lanes_of(met) {
                    stack[waiting] = (level - 1, first + lane as u32);
                    waiting += 1;
                }
            }
        }
    }

    #[inline(always)] // part of the vectorized query
    fn visit_leaf(
        &self,
        leaf: usize,
        segment: &Segment,
        radius: f32,
        visit: &mut impl FnMut(usize, f32),
    ) {
        let [x, y, z] = &self.positions[leaf];
        let Segment { origin, direction, length } = *segment;
        let mut along = [0.0; WIDE];
        let mut is_near = [false; WIDE];
        for lane in 0..WIDE {
            let [dx, dy, dz] = [x[lane] - origin.x, y[lane] - origin.y, z[lane] - origin.z];
            let t = dx * direction.x + dy * direction.y + dz * direction.z;
            let [ox, oy, oz] = [dx - t * direction.x, dy - t * direction.y, dz - t * direction.z];
            let distance2 = ox * ox + oy * oy + oz * oz;
            is_near[lane] = (distance2 <= radius * radius) & (t >= 0.0) & (t < length);
            along[lane] = t;
        }
        for lane in lanes_of(bits(&is_near)) {
            visit(leaf * WIDE + lane, along[lane]);
        }
    }

    /// The photons, in the order of their indices.
    pub fn photons(&self) -> &[Photon] {
        &self.photons
    }

    /// Tests whether there are caustic photons.
    pub fn has_caustic_photons(&self) -> bool {
        self.has_caustic_photons
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::math::Rgb;
    use crate::base::rng::{Stream, StreamKey};
    use crate::simd::dispatch::vectorized;

    fn photons(count: u32) -> Vec<Photon> {
        let mut rng = StreamKey::new(1, Stream::Test, 0).rng(0);
        (0..count)
            .map(|path| {
                let position = Vec3::new(rng.next_1d(), rng.next_1d(), 0.2 * rng.next_1d());
                Photon::new(position, path, Rgb::ONE, Vec3::ZERO, PhotonClass::Diffuse)
            })
            .collect()
    }

    #[test]
    fn segments_find_all_photons_near_them_once() {
        let mut rng = StreamKey::new(1, Stream::Test, 0).rng(1);
        let mut found_any = 0;
        for count in [0, 1, 7, 8, 9, 64, 65, 3000] {
            let all = photons(count);
            let (first, second) = all.split_at(all.len() / 3);
            let mut tree = PhotonTree::default();
            tree.build([first, second].into_iter());
            assert_eq!(tree.photons().len(), all.len());
            for number in 0..60 {
                let [u, v, w] = [rng.next_1d(), rng.next_1d(), rng.next_1d()];
                let direction = match number % 4 {
                    0 => Vec3::X,
                    1 => -Vec3::Z,
                    _ => (Vec3::new(w, u, v) - 0.5).normalize(),
                };
                let origin = 1.4 * Vec3::new(u, v, w) - 0.2;
                let length = if number % 3 == 0 { f32::INFINITY } else { 0.7 * v };
                let (segment, radius) = (Segment { origin, direction, length }, 0.05);
                let mut found = vec![];
                vectorized(|_| {
                    tree.for_each_near(&segment, radius, |index, along| {
                        let photon = &tree.photons()[index];
                        let foot = (photon.position - origin).dot(direction);
                        assert!((along - foot).abs() < 1e-5);
                        found.push(photon.path);
                    });
                });
                found_any += found.len();
                found.sort_unstable();
                // Not those that rounding errors decide about
                let is_near = |photon: &Photon, margin: f32| {
                    let foot = (photon.position - origin).dot(direction);
                    let distance = photon.position.distance(origin + foot * direction);
                    distance <= radius + margin && foot >= -margin && foot < length + margin
                };
                let sure = all.iter().filter(|own| is_near(own, -1e-5));
                assert!(sure.clone().all(|own| found.binary_search(&own.path).is_ok()));
                assert!(found.windows(2).all(|two| two[0] < two[1]), "some are found twice");
                let may = |path: &u32| is_near(&all[*path as usize], 1e-5);
                assert!(found.iter().all(may));
            }
        }
        assert!(found_any > 100, "{found_any}");
    }

    #[test]
    fn order_does_not_depend_on_the_slices() {
        let all = photons(1000);
        let [mut one, mut many] = [PhotonTree::default(), PhotonTree::default()];
        one.build([&all[..]].into_iter());
        many.build(all.chunks(77));
        let paths = |tree: &PhotonTree| tree.photons().iter().map(|p| p.path).collect::<Vec<_>>();
        assert_eq!(paths(&one), paths(&many));
    }
}
