//! Chooses among local emitters by estimates of their irradiance at a point: a tree of clusters,
//! descended at random in proportion to the estimates of a node's children.
//!
//! After Conty Estevez and Kulla, *Importance Sampling of Many Lights with Adaptive Tree Splitting*
//! (2018), without splitting. The estimate differs: a cluster has radiant intensity instead of
//! power, so that the estimate of a small cluster is the irradiance itself. A node has eight
//! children instead of two: their estimates are computed side by side, and the tree has a third of
//! the levels.

mod slots;

use super::Receiver;
use super::cluster::Cluster;
use super::emitter::Emitter;
use super::tree_build::split_lights;
use super::tree_node::{TreeNode, WIDE};
use super::visibility::Factors;
use crate::simd::dispatch::vectorized;

const LEAF: u32 = 1 << 31;

/// Approximate minimum probability of each child that may contribute. Estimates ignore occlusion,
/// and bounds may be far off: a close lamp that is hidden, or shines elsewhere, must not take all
/// choices.
const LEAST_SHARE: f32 = 0.01;

/// Weights of a node's children for the choice among them, and their sum.
struct ChildProbs {
    weights: [f32; WIDE],
    sum: f32,
}

impl ChildProbs {
    /// The weights of children with these estimates; `None` if all are 0.
    /// theory.md (17).
    #[inline(always)]
    fn new(estimates: &[f32; WIDE]) -> Option<Self> {
        let least = LEAST_SHARE * sum(estimates);
        let weights =
            estimates.map(|estimate| if estimate > 0.0 { estimate.max(least) } else { 0.0 });
        let sum = sum(&weights);
        (sum > 0.0).then_some(Self { weights, sum })
    }

    /// Chooses a child by a uniform number; also returns a new uniform number.
    #[inline(always)]
    fn choose(&self, u: f64) -> (usize, f64) {
        let mut rest = u * f64::from(self.sum);
        let mut last = 0;
        for (child, weight) in self.weights.iter().enumerate().filter(|(_, weight)| **weight > 0.0)
        {
            let weight = f64::from(*weight);
            if rest < weight {
                return (child, rest / weight);
            }
            rest -= weight;
            last = child;
        }
        // Rounding left a small rest.
        (last, 1.0)
    }

    /// Probability of a child.
    #[inline(always)]
    fn prob(&self, child: usize) -> f32 {
        self.weights[child] / self.sum
    }
}

/// Sum in pairs, whose additions do not depend on each other.
#[inline(always)]
fn sum(numbers: &[f32; WIDE]) -> f32 {
    let four: [f32; 4] = std::array::from_fn(|i| numbers[i] + numbers[i + 4]);
    (four[0] + four[2]) + (four[1] + four[3])
}

/// A child of a node: index of the node, and of the child in it.
#[derive(Clone, Copy, Debug, Default)]
struct Slot {
    node: u32,
    child: u32,
}

/// The tree of the local emitters of a set.
#[derive(Clone, Debug, Default)]
pub(super) struct LightTree {
    /// The first node has one child: the whole tree.
    nodes: Vec<TreeNode>,
    /// For each node the slot that it fills; unused for the first.
    parents: Vec<Slot>,
    /// For each emitter of the tree its slot.
    leaves: Vec<Slot>,
}

impl LightTree {
    /// The tree of those emitters that have a position, given with their indices.
    pub(super) fn new<'a>(emitters: impl Iterator<Item = (u32, &'a Emitter)>) -> Self {
        let placed = |(index, emitter)| Some((index, Cluster::of(emitter)?));
        let mut leaves: Vec<(u32, Cluster)> = emitters.filter_map(placed).collect();
        let mut tree = Self::default();
        if !leaves.is_empty() {
            tree.add_node(Slot::default());
            tree.fill(Slot::default(), &mut leaves);
            tree.number_by_level();
        }
        tree
    }

    /// Whether no emitter has a position.
    pub(super) fn is_empty(&self) -> bool {
        self.nodes.is_empty()
    }

    /// An estimate of the irradiance from all emitters, W/m^2; 0 only if none can light `at`.
    pub(super) fn estimate(&self, at: Receiver, factors: Option<&Factors>) -> f32 {
        if self.is_empty() {
            return 0.0;
        }
        vectorized(
            #[inline(always)]
            |_| self.estimates(0, at, factors)[0],
        )
    }

    /// Estimates of the irradiance from each child of a node, W/m^2, times their factors if they
    /// were learned. theory.md (17a).
    #[inline(always)] // part of vectorized code
    fn estimates(&self, node: u32, at: Receiver, factors: Option<&Factors>) -> [f32; WIDE] {
        let mut estimates = self.nodes[node as usize].estimates(at);
        if let Some(own) = factors.and_then(|factors| factors.of_node(node)) {
            for (estimate, factor) in estimates.iter_mut().zip(own) {
                *estimate *= factor;
            }
        }
        estimates
    }

    /// Chooses an emitter for `at` by a uniform number: its index and probability; `None` if none
    /// can light it.
    pub(super) fn choose(
        &self,
        at: Receiver,
        u: f64,
        factors: Option<&Factors>,
    ) -> Option<(u32, f32)> {
        let whole = self.nodes.first()?.content[0];
        vectorized(
            #[inline(always)]
            |_| self.descend(whole, at, u, factors),
        )
    }

    /// Chooses an emitter of a slot with this content, without vector instructions of its own.
    #[inline(always)]
    fn descend(
        &self,
        mut content: u32,
        at: Receiver,
        mut u: f64,
        factors: Option<&Factors>,
    ) -> Option<(u32, f32)> {
        let mut prob = 1.0;
        while content & LEAF == 0 {
            let probs = ChildProbs::new(&self.estimates(content, at, factors))?;
            let (child, rest) = probs.choose(u);
            prob *= probs.prob(child);
            content = self.nodes[content as usize].content[child];
            u = rest;
        }
        (prob > 0.0).then_some((content & !LEAF, prob))
    }

    /// Probability that [`Self::choose`] takes this emitter of the tree.
    pub(super) fn prob(&self, emitter: usize, at: Receiver, factors: Option<&Factors>) -> f32 {
        vectorized(
            #[inline(always)]
            |_| self.climb(self.leaves[emitter], at, factors),
        )
    }

    /// Probability of a leaf.
    #[inline(always)]
    fn climb(&self, leaf: Slot, at: Receiver, factors: Option<&Factors>) -> f32 {
        let Slot { mut node, mut child } = leaf;
        let mut prob = 1.0;
        while node != 0 {
            let estimates = self.estimates(node, at, factors);
            let Some(probs) = ChildProbs::new(&estimates) else { return 0.0 };
            prob *= probs.prob(child as usize);
            Slot { node, child } = self.parents[node as usize];
        }
        prob
    }

    /// Adds an empty node that fills the slot `parent`; returns its index.
    fn add_node(&mut self, parent: Slot) -> u32 {
        self.nodes.push(TreeNode::default());
        self.parents.push(parent);
        self.nodes.len() as u32 - 1
    }

    /// Fills a slot with `leaves`, as a leaf or as a node; returns their cluster.
    fn fill(&mut self, slot: Slot, leaves: &mut [(u32, Cluster)]) -> Cluster {
        let (cluster, content) = match leaves {
            [(emitter, cluster)] => {
                let emitters = self.leaves.len().max(*emitter as usize + 1);
                self.leaves.resize(emitters, Slot::default());
                self.leaves[*emitter as usize] = slot;
                (*cluster, *emitter | LEAF)
            }
            _ => {
                let node = self.add_node(slot);
                let parts = divide(leaves).into_iter().zip(0..);
                let clusters = parts.map(|(part, child)| self.fill(Slot { node, child }, part));
                let cluster = clusters.reduce(Cluster::with).expect("at least two");
                (cluster, node)
            }
        };
        self.nodes[slot.node as usize].set(slot.child as usize, &cluster, content);
        cluster
    }
}

/// Divides two or more lights into up to eight sets, always the set of the highest cost next.
fn divide(leaves: &mut [(u32, Cluster)]) -> Vec<&mut [(u32, Cluster)]> {
    let cost = |part: &[(u32, Cluster)]| {
        let clusters = part.iter().map(|(_, cluster)| *cluster);
        clusters.reduce(Cluster::with).map_or(0.0, |whole| whole.cost())
    };
    let mut parts = vec![(f32::INFINITY, leaves)];
    while parts.len() < WIDE {
        let several = parts.iter().enumerate().filter(|(_, (_, part))| part.len() > 1);
        // Among equal costs, such as those of lights at one position, the largest set.
        let order = |(cost, part): &(f32, &mut [_])| (*cost, part.len());
        let most = several.max_by(|(_, one), (_, other)| {
            order(one).partial_cmp(&order(other)).unwrap_or(std::cmp::Ordering::Equal)
        });
        let Some((most, _)) = most else { break };
        let (_, part) = parts.swap_remove(most);
        let middle = split_lights(part);
        let (left, right) = part.split_at_mut(middle);
        parts.extend([left, right].map(|part| (cost(part), part)));
    }
    parts.into_iter().map(|(_, part)| part).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::math::{luminance, uniform_sphere};
    use crate::base::rng::{Rng, Stream, StreamKey};
    use crate::scene::{Falloff, Spot, Triangle};
    use glam::Vec3;
    use std::f32::consts::PI;

    pub(super) fn rng(seed: u64) -> Rng {
        StreamKey::new(seed, Stream::Test, 0).rng(0)
    }

    pub(super) fn somewhere(rng: &mut Rng) -> Vec3 {
        Vec3::new(rng.next_1d(), rng.next_1d(), 0.3 * rng.next_1d()) * 10.0
    }

    /// Points, narrow and wide spots, and triangles of all sizes, in clumps.
    pub(super) fn emitters(count: usize, rng: &mut Rng) -> Vec<Emitter> {
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
                    let cos_outer = f64::from(0.98 * rng.next_1d());
                    let (cos_inner, intensity, falloff) = (0.99, radiance, Falloff::default());
                    Emitter::Spot(Spot {
                        position,
                        direction,
                        intensity,
                        cos_inner,
                        cos_outer,
                        falloff,
                    })
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

    /// A receiver that is lit from above.
    fn above(position: Vec3) -> Receiver {
        Receiver { position, normal: Some(Vec3::Z) }
    }

    /// A receiver that is lit from both sides.
    fn isotropic(position: Vec3) -> Receiver {
        Receiver { position, normal: None }
    }

    pub(super) fn tree(emitters: &[Emitter]) -> LightTree {
        LightTree::new((0..).zip(emitters))
    }

    /// Probability of each emitter, from the estimates on the way to its leaf.
    fn probs(tree: &LightTree, at: Receiver, count: usize) -> Vec<f64> {
        let mut probs = vec![0.0; count];
        let mut todo = vec![(tree.nodes[0].content[0], 1.0)];
        while let Some((content, prob)) = todo.pop() {
            if content & LEAF != 0 {
                probs[(content & !LEAF) as usize] = prob;
                continue;
            }
            let children = &tree.nodes[content as usize];
            let own = children.estimates(at).map(f64::from);
            let total: f64 = own.iter().sum();
            // theory.md (17)
            let raised = own.map(|one| if one > 0.0 { one.max(0.01 * total) } else { 0.0 });
            let sum: f64 = raised.iter().sum();
            let lit = children.content.into_iter().zip(raised).filter(|(_, own)| *own > 0.0);
            todo.extend(lit.map(|(content, own)| (content, prob * own / sum)));
        }
        probs
    }

    #[test]
    fn emitters_are_chosen_with_their_probability_and_none_is_lost() {
        let mut rng = rng(1);
        let emitters = emitters(300, &mut rng);
        let tree = tree(&emitters);
        let mut lit = 0;
        for i in 0..200 {
            let position = somewhere(&mut rng);
            let normal = (i % 4 > 0).then(|| uniform_sphere(rng.next_2d()));
            let at = Receiver { position, normal };
            let probs = probs(&tree, at, emitters.len());
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
                if let Some((index, prob)) = tree.choose(at, rng.next_f64(), None) {
                    let expected = probs[index as usize];
                    assert!((f64::from(prob) / expected - 1.0).abs() < 1e-4, "{prob} {expected}");
                    let asked = tree.prob(index as usize, at, None);
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

    /// The variance of the irradiance at points among lamps below a ceiling, one connection each,
    /// by estimate over that by power.
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
                    tree.choose(above(position), rng.next_f64(), None).expect("lit");
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

    /// Two balls of triangles over a floor: half of each faces away.
    #[test]
    fn estimates_find_the_near_sides_of_balls() {
        let mut rng = rng(4);
        let ball = |center: Vec3, radius: f32| {
            let at = move |i: usize, j: usize| {
                let (polar, around) = (PI * i as f32 / 12.0, PI * j as f32 / 12.0);
                let (z, s) = (polar.cos(), polar.sin());
                center + radius * Vec3::new(s * around.cos(), s * around.sin(), z)
            };
            let quads = (0..12).flat_map(|i| (0..24).map(move |j| (i, j)));
            quads.flat_map(move |(i, j)| {
                let corners = [at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)];
                [[0, 1, 2], [0, 2, 3]].map(|three| three.map(|k: usize| corners[k]))
            })
        };
        let balls = ball(Vec3::new(0.0, 0.0, 3.0), 1.0).chain(ball(Vec3::new(5.0, 1.0, 2.0), 0.2));
        let triangles = balls.map(|corners| Triangle::new(corners, 0));
        let triangles = triangles.filter(|shape| shape.area() > 1e-6);
        let lamp = |shape| Emitter::Triangle { shape, radiance: Vec3::ONE };
        let emitters: Vec<Emitter> = triangles.map(lamp).collect();
        let tree = tree(&emitters);
        let mut variance = 0.0;
        for _ in 0..20 {
            let position = Vec3::new(6.0 * rng.next_1d() - 1.0, rng.next_1d(), 0.0);
            let irradiance = |index: usize, prob: f32, rng: &mut Rng| {
                let sample = emitters[index].connect(position, prob, rng);
                sample.map_or(0.0, |s| f64::from(luminance(s.irradiance) * s.wi.z.max(0.0)))
            };
            let each = |i: usize| (0..16).map(move |_| i);
            let all = (0..emitters.len()).flat_map(each);
            let expected: f64 = all.map(|i| irradiance(i, 16.0, &mut rng)).sum();
            let n = 2000;
            let mut mean = 0.0;
            for _ in 0..n {
                let chosen = tree.choose(above(position), rng.next_f64(), None);
                let own = chosen.map_or(0.0, |(i, prob)| irradiance(i as usize, prob, &mut rng))
                    / expected;
                mean += own / f64::from(n);
                variance += (own - 1.0).powi(2) / f64::from(20 * n);
            }
            assert!((mean - 1.0).abs() < 0.12, "{mean}");
        }
        println!("relative variance of the irradiance: {variance}");
        assert!(variance < 0.12, "{variance}");
    }

    /// Spots overhead that shine elsewhere, which their bounds do not show, and a far lamp.
    #[test]
    fn bright_lamps_that_shine_elsewhere_do_not_exclude_a_far_one() {
        let mut rng = rng(3);
        let spot = |i: usize| {
            let direction = Vec3::from([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]][i]);
            let (position, intensity) = (Vec3::new(0.0, 0.0, 3.0), Vec3::splat(1e4));
            let (cos_inner, cos_outer, falloff) = (0.99, 0.98, Falloff::default());
            Emitter::Spot(Spot { position, direction, intensity, cos_inner, cos_outer, falloff })
        };
        let far = Emitter::Point { position: Vec3::new(60.0, 0.0, 3.0), intensity: Vec3::ONE };
        let tree = tree(&[spot(0), spot(1), spot(2), far]);
        let choices = (0..1000).map(|_| tree.choose(above(Vec3::ZERO), rng.next_f64(), None));
        let found = choices.flatten().filter(|&(index, _)| index == 3).count();
        assert!(found >= 5, "{found}");
    }

    #[test]
    fn lamps_at_one_position_and_far_apart_make_a_tree() {
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
            let children: Vec<u32> =
                tree.nodes.iter().flat_map(|node| node.content).filter(|c| c & LEAF != 0).collect();
            assert_eq!(children.len(), emitters.len());
            assert!(tree.nodes.len() <= emitters.len());
            let probs = probs(&tree, isotropic(Vec3::new(0.5, 1.0, 2.0)), emitters.len());
            assert!((probs.iter().sum::<f64>() - 1.0).abs() < 1e-6);
            assert!(probs.iter().all(|&prob| prob > 0.0));
        }
        assert!(tree(&[]).choose(isotropic(Vec3::ZERO), 0.5, None).is_none());
    }
}
