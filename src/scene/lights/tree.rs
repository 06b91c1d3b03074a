//! A choice among local emitters by an estimate of what each contributes to a point: a binary tree of
//! clusters, descended at random in proportion to the estimates of both children.
//!
//! After Conty Estevez and Kulla, *Importance Sampling of Many Lights with Adaptive Tree Splitting*
//! (2018), without splitting and with another estimate: a cluster carries radiant intensity rather
//! than power, so that for a small one the estimate is the irradiance itself.

use super::cluster::Cluster;
use super::emitter::Emitter;
use super::split::split;
use glam::Vec3;
use std::f32::consts::PI;

/// A cluster as its estimate needs it: one cache line.
#[derive(Clone, Copy, Debug, Default)]
#[repr(C, align(64))]
struct Node {
    /// Middle of the box around all its emitters.
    center: Vec3,
    /// Half the sides of that box.
    half: Vec3,
    axis: Vec3,
    cos_spread: f32,
    sin_spread: f32,
    cos_reach: f32,
    /// Half the extent of the box along any of its emitters' axes, or more.
    emitting_extent: f32,
    /// Luminance of the radiant intensity, W/sr.
    intensity: f32,
    /// Of a leaf its emitter with [`LEAF`] set, else the index of the first child; the second one
    /// follows it.
    content: u32,
}

const LEAF: u32 = 1 << 31;

/// Slack in radians and of lengths for the rounding of bounds: no light may be lost to it.
const SLACK: f32 = 1e-3;

/// Squared distances to a cluster's middle grow by this share of the squared half diagonal. Of 0.1 to
/// 0.5 it gave the least variance among lamps in a grid, in rows, in clumps and anywhere.
const SPREAD_OUT: f32 = 0.25;

/// Cosine of `a - b`, or 1 if `b` is the larger angle; both in [0, pi].
#[inline]
fn cos_of_rest(cos_a: f32, (sin_b, cos_b): (f32, f32)) -> f32 {
    if cos_a >= cos_b { 1.0 } else { cos_a * cos_b + (1.0 - cos_a * cos_a).max(0.0).sqrt() * sin_b }
}

/// Each of two clusters that may contribute gets this share of the choices at the least. Estimates
/// know nothing of what is in between, and bounds may be far off: a lamp close by that is hidden, or
/// shines elsewhere, must not take all.
const LEAST_SHARE: f32 = 0.01;

/// Share of the choices that the first of two clusters gets by their estimates.
/// theory.md (17).
#[inline]
fn share(a: f32, b: f32) -> f32 {
    let share = a / (a + b);
    if a > 0.0 && b > 0.0 { share.clamp(LEAST_SHARE, 1.0 - LEAST_SHARE) } else { share }
}

/// The middle of the heights that are above the horizon, of a body that reaches from `extent` below
/// `height` to as much above.
#[inline]
fn above_horizon(height: f32, extent: f32) -> f32 {
    if height >= extent { height } else { 0.5 * (height + extent) }
}

impl Node {
    fn new(cluster: &Cluster, content: u32) -> Self {
        let Cluster { bounds, beam, intensity } = cluster;
        let half = 0.5 * (bounds.max - bounds.min);
        let half = half + SLACK * half.length();
        let spread = (beam.spread + SLACK).min(PI);
        let (sin_spread, cos_spread) = spread.sin_cos();
        // Of an axis off by the spread: |a'| <= |a| + |a' - a|.
        let radius = half.length();
        let along = beam.axis.abs().dot(half) + 2.0 * (0.5 * spread).sin() * radius;
        Self {
            center: bounds.center(),
            half,
            axis: beam.axis,
            cos_spread,
            sin_spread: sin_spread.max(0.0), // not the -8e-8 of pi
            cos_reach: (beam.reach + SLACK).cos(),
            emitting_extent: along.min(radius),
            intensity: *intensity,
            content,
        }
    }

    /// An estimate of the irradiance at `position` on a surface of this normal, on all sides without
    /// one, W/m^2; 0 only where there is none.
    ///
    /// It is `I h h' / r^4` with the heights of the cluster over the surface and of the point over the
    /// emitters. Bounds of the cosines, as there, would be 1 for all large clusters; the mean
    /// of what is above the horizon leaves a fourth to an eighth of the variance.
    /// theory.md (16).
    #[inline]
    fn estimate(&self, position: Vec3, normal: Option<Vec3>) -> f32 {
        let to_center = self.center - position;
        let distance2 = to_center.length_squared();
        let radius2 = self.half.length_squared();
        let spread_out2 = (distance2 + SPREAD_OUT * radius2).max(f32::MIN_POSITIVE);
        let spread_out = spread_out2.sqrt();
        let received = normal.map_or(spread_out, |normal| {
            above_horizon(to_center.dot(normal), normal.abs().dot(self.half))
        });
        let distance = distance2.sqrt().max(f32::MIN_POSITIVE);
        let cos_axis = -to_center.dot(self.axis) / distance;
        let cos_nearest = cos_of_rest(cos_axis, (self.sin_spread, self.cos_spread));
        let emitted = above_horizon(distance * cos_nearest, self.emitting_extent);
        if received <= 0.0 || emitted <= 0.0 {
            return 0.0;
        }
        if self.cos_reach > 0.0 && distance2 > radius2 {
            // Of spots. Less half the angle under which the cluster is seen.
            let sin2 = radius2 / distance2;
            if cos_of_rest(cos_nearest, (sin2.sqrt(), (1.0 - sin2).sqrt())) < self.cos_reach {
                return 0.0;
            }
        }
        let cosines =
            (received.min(spread_out) / spread_out) * (emitted.min(spread_out) / spread_out);
        // Finite, also in the very place of a point.
        (self.intensity * cosines / spread_out2).min(f32::MAX / 4.0)
    }
}

/// All local emitters of a set.
#[derive(Clone, Debug, Default)]
pub(in crate::scene) struct LightTree {
    /// The root first, then children in pairs.
    nodes: Vec<Node>,
    /// Of each node; the root has none.
    parents: Vec<u32>,
    /// Of each emitter its leaf, if it has one.
    leaves: Vec<u32>,
}

impl LightTree {
    /// Over those emitters that have a place, with their indices.
    pub(in crate::scene) fn new<'a>(emitters: impl Iterator<Item = (u32, &'a Emitter)>) -> Self {
        let placed = |(index, emitter)| Some((index, Cluster::of(emitter)?));
        let mut leaves: Vec<(u32, Cluster)> = emitters.filter_map(placed).collect();
        let mut tree = Self { nodes: Vec::with_capacity(2 * leaves.len()), ..Self::default() };
        if !leaves.is_empty() {
            tree.nodes.push(Node::default());
            tree.fill(0, &mut leaves);
            tree.find_ways_up();
        }
        tree
    }

    /// Sets parents and leaves.
    fn find_ways_up(&mut self) {
        self.parents.resize(self.nodes.len(), 0);
        for (index, node) in (0..).zip(&self.nodes) {
            let content = (node.content & !LEAF) as usize;
            if node.content & LEAF == 0 {
                self.parents[content..content + 2].fill(index);
            } else {
                self.leaves.resize(self.leaves.len().max(content + 1), 0);
                self.leaves[content] = index;
            }
        }
    }

    /// An estimate of the irradiance from all, W/m^2; 0 only where there is none.
    pub(in crate::scene) fn estimate(&self, position: Vec3, normal: Option<Vec3>) -> f32 {
        self.nodes.first().map_or(0.0, |root| root.estimate(position, normal))
    }

    /// Chooses an emitter for a point with this normal (a surface that is lit from one side) by a
    /// uniform number: its index and probability; `None` where none can light it.
    pub(in crate::scene) fn choose(
        &self,
        position: Vec3,
        normal: Option<Vec3>,
        mut u: f64,
    ) -> Option<(u32, f32)> {
        let mut content = self.nodes.first()?.content;
        let mut prob = 1.0;
        while content & LEAF == 0 {
            let first = content as usize;
            let children = &self.nodes[first..first + 2];
            let [a, b] = [0, 1].map(|child| children[child].estimate(position, normal));
            let total = a + b;
            if total <= 0.0 {
                return None;
            }
            let share = share(a, b);
            let (child, own) = if u < f64::from(share) {
                u /= f64::from(share);
                (0, share)
            } else {
                u = (u - f64::from(share)) / (1.0 - f64::from(share));
                (1, 1.0 - share)
            };
            prob *= own;
            content = children[child].content;
        }
        (prob > 0.0).then_some((content & !LEAF, prob))
    }

    /// Probability that [`Self::choose`] takes this emitter, which is in the tree.
    pub(in crate::scene) fn prob(
        &self,
        emitter: usize,
        position: Vec3,
        normal: Option<Vec3>,
    ) -> f32 {
        let mut node = self.leaves[emitter] as usize;
        let mut prob = 1.0;
        while node != 0 {
            // The first of two children has an odd number.
            let (own, other) = (node, if node % 2 == 1 { node + 1 } else { node - 1 });
            let [own, other] =
                [own, other].map(|child| self.nodes[child].estimate(position, normal));
            if own <= 0.0 {
                return 0.0;
            }
            let first = if node % 2 == 1 { share(own, other) } else { share(other, own) };
            prob *= if node % 2 == 1 { first } else { 1.0 - first };
            node = self.parents[node] as usize;
        }
        prob
    }

    /// Makes `node`, which holds `leaves`, a leaf or gives it children; what bounds it.
    fn fill(&mut self, node: usize, leaves: &mut [(u32, Cluster)]) -> Cluster {
        let (cluster, content) = match leaves {
            [(emitter, cluster)] => (*cluster, *emitter | LEAF),
            _ => {
                let middle = split(leaves);
                let (left, right) = leaves.split_at_mut(middle);
                let first = self.nodes.len();
                self.nodes.extend([Node::default(); 2]);
                let children = [self.fill(first, left), self.fill(first + 1, right)];
                (children[0].with(children[1]), first as u32)
            }
        };
        self.nodes[node] = Node::new(&cluster, content);
        cluster
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::math::{luminance, uniform_sphere};
    use crate::base::rng::{Rng, Stream, StreamKey};
    use crate::scene::{Spot, Triangle};

    fn rng(seed: u64) -> Rng {
        StreamKey::new(seed, Stream::Test, 0).rng(0)
    }

    fn somewhere(rng: &mut Rng) -> Vec3 {
        Vec3::new(rng.next_1d(), rng.next_1d(), 0.3 * rng.next_1d()) * 10.0
    }

    /// Points, narrow and wide spots, and triangles of all sizes, in clumps.
    fn emitters(count: usize, rng: &mut Rng) -> Vec<Emitter> {
        let mut clump = Vec3::ZERO;
        let mut one = |i: usize| {
            if i.is_multiple_of(7) {
                clump = somewhere(rng);
            }
            let position = clump + 0.3 * somewhere(rng) * rng.next_1d().powi(3);
            let radiance = Vec3::splat(10f32.powf(2.0 * rng.next_1d()));
            let direction = uniform_sphere(rng.next_2d());
            match i % 3 {
                0 => Emitter::Point { position, intensity: 0.1 * radiance },
                1 => {
                    let cos_outer = 0.98 * rng.next_1d();
                    let (cos_inner, intensity) = (0.99, radiance);
                    Emitter::Spot(Spot { position, direction, intensity, cos_inner, cos_outer })
                }
                _ => {
                    let size = rng.next_1d().powi(4);
                    let (s, t) = direction.any_orthonormal_pair();
                    let corners = [position, position + size * s, position + 2.0 * size * t];
                    Emitter::Triangle { shape: Triangle::new(corners, 0), radiance }
                }
            }
        };
        (0..count).map(&mut one).collect()
    }

    fn tree(emitters: &[Emitter]) -> LightTree {
        LightTree::new((0..).zip(emitters))
    }

    /// Probability of each emitter, by the estimates along its way.
    fn probs(tree: &LightTree, position: Vec3, normal: Option<Vec3>, count: usize) -> Vec<f64> {
        let mut probs = vec![0.0; count];
        let mut todo = vec![(0, 1.0)];
        while let Some((node, prob)) = todo.pop() {
            let content = tree.nodes[node].content;
            if content & LEAF != 0 {
                probs[(content & !LEAF) as usize] = prob;
                continue;
            }
            let children = [0, 1].map(|child| content as usize + child);
            let own = children.map(|child| tree.nodes[child].estimate(position, normal));
            if own[0] + own[1] > 0.0 {
                let share = f64::from(share(own[0], own[1]));
                todo.extend([(children[0], prob * share), (children[1], prob * (1.0 - share))]);
            }
        }
        probs
    }

    #[test]
    fn emitters_are_chosen_as_often_as_they_say_and_none_that_lights_is_left_out() {
        let mut rng = rng(1);
        let emitters = emitters(300, &mut rng);
        let tree = tree(&emitters);
        let mut lit = 0;
        for i in 0..200 {
            let position = somewhere(&mut rng);
            let normal = (i % 4 > 0).then(|| uniform_sphere(rng.next_2d()));
            let probs = probs(&tree, position, normal, emitters.len());
            for (index, emitter) in emitters.iter().enumerate() {
                for _ in 0..8 {
                    let sample = emitter.connect(position, 1.0, &mut rng);
                    let lights = sample
                        .filter(|sample| normal.is_none_or(|normal| normal.dot(sample.wi) > 0.0));
                    assert!(lights.is_none() || probs[index] > 0.0, "{i} {emitter:?} {lights:?}");
                    lit += u32::from(lights.is_some());
                }
            }
            let n = 400;
            let mut counts = vec![0.0; emitters.len()];
            for _ in 0..n {
                if let Some((index, prob)) = tree.choose(position, normal, rng.next_f64()) {
                    let expected = probs[index as usize];
                    assert!((f64::from(prob) / expected - 1.0).abs() < 1e-4, "{prob} {expected}");
                    let asked = tree.prob(index as usize, position, normal);
                    assert!((asked / prob - 1.0).abs() < 1e-5, "{asked} {prob}");
                    counts[index as usize] += 1.0;
                }
            }
            // Likely ones, five standard errors: 200 x 20 of them.
            for (count, prob) in counts.into_iter().zip(probs).filter(|(_, prob)| *prob > 0.02) {
                let n = f64::from(n);
                let error = (n * prob * (1.0 - prob)).sqrt();
                assert!(f64::abs(count - n * prob) < 5.0 * error + 1.0, "{count} {prob}");
            }
        }
        assert!(lit > 50_000, "{lit}");
    }

    /// The variance of the irradiance at points among lamps below a ceiling, one connection each, by
    /// estimate over that by power.
    #[test]
    fn estimates_find_the_lamps_nearby() {
        let mut rng = rng(2);
        let lamp = |i: usize| {
            let corner = Vec3::new((i % 40) as f32, (i / 40) as f32, 3.0);
            let corners = [corner, corner + 0.1 * Vec3::Y, corner + 0.1 * Vec3::X];
            let radiance = Vec3::splat(100.0);
            Emitter::Triangle { shape: Triangle::new(corners, 0), radiance }
        };
        let emitters: Vec<Emitter> = (0..1600).map(lamp).collect();
        let tree = tree(&emitters);
        let (mut by_estimate, mut by_power) = (0.0, 0.0);
        for _ in 0..20 {
            let position = Vec3::new(40.0 * rng.next_1d(), 40.0 * rng.next_1d(), 0.0);
            let irradiance = |index: usize, rng: &mut Rng| {
                let sample = emitters[index].connect(position, 1.0, rng).expect("above");
                f64::from(luminance(sample.irradiance) * sample.wi.z)
            };
            let expected: f64 = (0..emitters.len()).map(|i| irradiance(i, &mut rng)).sum();
            let n = 2000;
            let mut mean = 0.0;
            for _ in 0..n {
                let (index, prob) =
                    tree.choose(position, Some(Vec3::Z), rng.next_f64()).expect("lit");
                let own = irradiance(index as usize, &mut rng) / f64::from(prob);
                mean += own / f64::from(n);
                by_estimate += (own / expected - 1.0).powi(2);
                let index = (rng.next_f64() * emitters.len() as f64) as usize;
                let own = irradiance(index, &mut rng) * emitters.len() as f64;
                by_power += (own / expected - 1.0).powi(2);
            }
            assert!((mean / expected - 1.0).abs() < 0.08, "{mean} {expected}");
        }
        println!("variance over that by power: {}", by_estimate / by_power);
        assert!(by_estimate < 0.03 * by_power, "{by_estimate} {by_power}");
    }

    /// Spots overhead that shine elsewhere, as nobody can tell from their bounds, and a far lamp.
    #[test]
    fn bright_lamps_that_shine_elsewhere_do_not_hide_a_far_one() {
        let mut rng = rng(3);
        let spot = |i: usize| {
            let direction = Vec3::from([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]][i]);
            let (position, intensity) = (Vec3::new(0.0, 0.0, 3.0), Vec3::splat(1e4));
            let (cos_inner, cos_outer) = (0.99, 0.98);
            Emitter::Spot(Spot { position, direction, intensity, cos_inner, cos_outer })
        };
        let far = Emitter::Point { position: Vec3::new(60.0, 0.0, 3.0), intensity: Vec3::ONE };
        let tree = tree(&[spot(0), spot(1), spot(2), far]);
        let choices = (0..1000).map(|_| tree.choose(Vec3::ZERO, Some(Vec3::Z), rng.next_f64()));
        let found = choices.flatten().filter(|&(index, _)| index == 3).count();
        assert!(found >= 5, "{found}");
    }

    #[test]
    fn lamps_in_one_place_and_far_apart_make_a_tree() {
        let point = |x: f32| {
            let position = Vec3::new(x, 0.0, 0.0);
            Emitter::Point { position, intensity: Vec3::ONE }
        };
        for emitters in [
            vec![point(1.0)],
            vec![point(1.0); 1000],
            (0..100).map(|i| point(1e-15 * 2f32.powi(i))).collect(),
        ] {
            let tree = tree(&emitters);
            assert_eq!(tree.nodes.len(), 2 * emitters.len() - 1);
            let probs = probs(&tree, Vec3::new(0.5, 1.0, 2.0), None, emitters.len());
            assert!((probs.iter().sum::<f64>() - 1.0).abs() < 1e-6);
            assert!(probs.iter().all(|&prob| prob > 0.0));
        }
        assert!(tree(&[]).choose(Vec3::ZERO, None, 0.5).is_none());
    }
}
