//! Splits a cluster of lights between bins of their centers along an axis (Conty Estevez and Kulla
//! 2018, Section 4.2).

use super::cluster::Cluster;
use crate::base::math::Bounds;

/// Bins along each axis.
const BINS: usize = 12;

/// Maximum number of lights that the cost of a plane takes into account; of more, an even
/// selection.
const MOST: usize = 2048;

/// Reorders two or more lights into two sets of nearly minimum cost; returns the first index of the
/// second set.
pub(super) fn split_lights(leaves: &mut [(u32, Cluster)]) -> usize {
    if leaves.len() == 2 {
        return 1;
    }
    let centers = leaves.iter().map(|(_, leaf)| leaf.bounds.center());
    let centers = centers.fold(Bounds::EMPTY, Bounds::with);
    let boxes = leaves.iter().map(|(_, leaf)| leaf.bounds);
    let whole = boxes.fold(Bounds::EMPTY, |all, own| all.with(own.min).with(own.max));
    let extent = centers.max - centers.min;
    let bin = |leaf: &Cluster, axis: usize| {
        let share = (leaf.bounds.center()[axis] - centers.min[axis]) / extent[axis];
        ((share * BINS as f32) as usize).min(BINS - 1)
    };
    let mut best: Option<(f32, usize, usize)> = None;
    for axis in (0..3).filter(|&axis| extent[axis] > 0.0) {
        let mut bins: [Option<Cluster>; BINS] = [None; BINS];
        for (_, leaf) in leaves.iter().step_by(leaves.len().div_ceil(MOST)) {
            let own = &mut bins[bin(leaf, axis)];
            *own = join(*own, Some(*leaf));
        }
        // Clusters of the bins below each plane and above it.
        let (mut below, mut above) = ([None; BINS + 1], [None; BINS + 1]);
        for i in 0..BINS {
            below[i + 1] = join(below[i], bins[i]);
            above[BINS - 1 - i] = join(above[BINS - i], bins[BINS - 1 - i]);
        }
        // Thin boxes are cut across.
        let cut = whole.longest_side() / (whole.max - whole.min)[axis];
        for plane in 1..BINS {
            if let (Some(below), Some(above)) = (below[plane], above[plane]) {
                // theory.md (19)
                let cost = cut * (below.cost() + above.cost());
                if best.is_none_or(|(least, ..)| cost < least) {
                    best = Some((cost, axis, plane));
                }
            }
        }
    }
    let Some((_, axis, plane)) = best else {
        // All lights have one position.
        return leaves.len() / 2;
    };
    let mut middle = 0;
    for i in 0..leaves.len() {
        if bin(&leaves[i].1, axis) < plane {
            leaves.swap(i, middle);
            middle += 1;
        }
    }
    middle
}

fn join(a: Option<Cluster>, b: Option<Cluster>) -> Option<Cluster> {
    match (a, b) {
        (Some(a), Some(b)) => Some(a.with(b)),
        (one, None) | (None, one) => one,
    }
}
