//! Slots of the tree whose visibility is learned: the children of its first nodes.

use super::super::Receiver;
use super::super::tree_node::TreeNode;
use super::super::visibility::{LEARNED_NODES, node_slot, place_of};
use super::{LEAF, LightTree, Slot};
use crate::simd::dispatch::vectorized;

impl LightTree {
    /// Numbers the nodes level by level: the first ones are the largest clusters.
    pub(super) fn number_by_level(&mut self) {
        let is_node = |content: u32| content & LEAF == 0 && content != 0;
        let mut order = vec![0];
        let mut next = 0;
        while let Some(&node) = order.get(next) {
            order.extend(self.nodes[node as usize].content.into_iter().filter(|&c| is_node(c)));
            next += 1;
        }
        let mut number = vec![0; order.len()];
        order.iter().zip(0..).for_each(|(&old, new)| number[old as usize] = new);
        let renumbered = |slot: Slot| Slot { node: number[slot.node as usize], ..slot };
        let node = |&old: &u32| {
            let mut node: TreeNode = self.nodes[old as usize];
            let nodes = node.content.iter_mut().filter(|content| is_node(**content));
            nodes.for_each(|content| *content = number[*content as usize]);
            node
        };
        let nodes = order.iter().map(node).collect();
        self.parents = order.iter().map(|&old| renumbered(self.parents[old as usize])).collect();
        self.leaves.iter_mut().for_each(|leaf| *leaf = renumbered(*leaf));
        self.nodes = nodes;
    }

    /// All slots in use.
    pub fn slots(&self) -> impl Iterator<Item = u8> {
        (0..).zip(&self.nodes).take(LEARNED_NODES).flat_map(|(node, own)| {
            let used = (0..).zip(own.content).filter(|&(_, content)| content != 0);
            used.map(move |(child, _)| node_slot(node, child))
        })
    }

    /// Chooses an emitter of a slot for `at` by a uniform number; `None` if none can light it.
    pub fn choose_in(&self, slot: u8, at: Receiver, u: f64) -> Option<u32> {
        let (node, child) = place_of(slot);
        let content = self.nodes.get(node)?.content[child];
        let chosen = vectorized(
            #[inline(always)]
            |_| self.descend(content, at, u, None),
        );
        chosen.map(|(emitter, _)| emitter)
    }

    /// The slots from `first` down to the leaf of an emitter, as a set of bits.
    pub fn slots_between(&self, first: u8, emitter: u32) -> u64 {
        let mut slots = 0;
        let mut at = self.leaves[emitter as usize];
        loop {
            let Slot { node, child } = at;
            if (node as usize) < LEARNED_NODES {
                let slot = node_slot(node, child);
                slots |= 1 << slot;
                if slot == first {
                    return slots;
                }
            }
            if node == 0 {
                return slots;
            }
            at = self.parents[node as usize];
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::tests::{emitters, rng, somewhere, tree};
    use super::*;
    use crate::base::math::uniform_sphere;
    use crate::scene::lights::visibility::Factors;

    /// Factors of all slots at random.
    fn factors(rng: &mut crate::base::rng::Rng) -> Factors {
        Factors::from_slots(|_| 1 + (254.0 * rng.next_1d()) as u8)
    }

    #[test]
    fn probabilities_with_factors_add_up_to_the_share_of_successful_choices() {
        let mut rng = rng(5);
        let emitters = emitters(300, &mut rng);
        let tree = tree(&emitters);
        let mut lit = 0;
        for _ in 0..100 {
            let factors = factors(&mut rng);
            let position = somewhere(&mut rng);
            let at = Receiver { position, normal: Some(uniform_sphere(rng.next_2d())) };
            let prob = |emitter: usize| f64::from(tree.prob(emitter, at, Some(&factors)));
            let sum: f64 = (0..emitters.len()).map(prob).sum();
            // Clusters without any light for the point take the rest: such choices fail.
            let numbers = (0..2000).map(|i| (f64::from(i) + 0.5) / 2000.0);
            let chosen = numbers.filter(|&u| tree.choose(at, u, Some(&factors)).is_some()).count();
            assert!((sum - chosen as f64 / 2000.0).abs() < 0.01, "{sum} {chosen}");
            let choice = tree.choose(at, rng.next_f64(), Some(&factors));
            let Some((emitter, own)) = choice else { continue };
            lit += 1;
            assert!((prob(emitter as usize) / f64::from(own) - 1.0).abs() < 1e-5, "{own}");
            // Factors change probabilities, and make none of them 0.
            let plain = |emitter| f64::from(tree.prob(emitter, at, None));
            let changed = |i| plain(i) > 0.0 && (prob(i) / plain(i) - 1.0).abs() > 0.1;
            assert!((0..emitters.len()).any(changed));
            assert!((0..emitters.len()).all(|i| (prob(i) > 0.0) == (plain(i) > 0.0)));
        }
        assert!(lit > 80, "{lit}");
    }

    #[test]
    fn tests_of_a_slot_count_for_all_slots_on_the_way_to_the_lamp() {
        let mut rng = rng(6);
        let emitters = emitters(300, &mut rng);
        let tree = tree(&emitters);
        let slots: Vec<u8> = tree.slots().collect();
        // The whole tree, and eight children of seven nodes
        assert_eq!(slots.len(), 57);
        for &slot in &slots {
            let at = Receiver { position: somewhere(&mut rng), normal: None };
            let Some(emitter) = tree.choose_in(slot, at, rng.next_f64()) else { continue };
            let between = tree.slots_between(slot, emitter);
            assert!(between >> slot & 1 == 1, "{slot} {between:b}");
            // Slots of outer clusters have smaller numbers.
            assert_eq!(between.trailing_zeros(), u32::from(slot));
            let whole = tree.slots_between(0, emitter);
            assert!(whole & 1 == 1 && whole & between == between, "{whole:b} {between:b}");
        }
    }
}
