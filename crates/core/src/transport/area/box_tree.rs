//! A tree of boxes that finds those that meet another box.

use glam::Vec3A;

/// An axis-aligned box.
#[derive(Clone, Copy, Debug)]
pub struct Box3 {
    /// Smallest coordinates.
    pub min: Vec3A,
    /// Largest coordinates.
    pub max: Vec3A,
}

impl Box3 {
    /// The box that holds nothing.
    pub const EMPTY: Self = Self { min: Vec3A::INFINITY, max: Vec3A::NEG_INFINITY };

    /// The smallest box that also holds `other`.
    pub fn and(self, other: Self) -> Self {
        Self { min: self.min.min(other.min), max: self.max.max(other.max) }
    }

    /// The smallest box that also holds `point`.
    pub fn with(self, point: Vec3A) -> Self {
        self.and(Self { min: point, max: point })
    }

    /// Whether they have a point in common.
    pub fn meets(&self, other: &Self) -> bool {
        !(self.min.cmpgt(other.max) | self.max.cmplt(other.min)).any()
    }
}

/// Boxes, found by box.
#[derive(Clone, Debug, Default)]
pub struct BoxTree {
    nodes: Vec<Node>,
    /// Indices of the boxes, leaf by leaf.
    order: Vec<u32>,
}

#[derive(Clone, Copy, Debug)]
struct Node {
    around: Box3,
    /// First index in `order` for a leaf, otherwise the second child. The first child follows its
    /// parent.
    first: u32,
    /// Boxes of a leaf; 0 for inner nodes.
    count: u32,
}

impl BoxTree {
    /// Halves the boxes by their middles along the longest side, until there are no more than
    /// `leaf`.
    pub fn new(boxes: &[Box3], leaf: usize) -> Self {
        let mut order: Vec<u32> = (0..boxes.len() as u32).collect();
        let mut nodes = Vec::with_capacity(2 * boxes.len().div_ceil(leaf));
        if !boxes.is_empty() {
            build(boxes, leaf, &mut order, 0, &mut nodes);
        }
        nodes.shrink_to_fit();
        Self { nodes, order }
    }

    /// Visits all boxes that meet `around`, and some others, until a visit returns `false`. Returns
    /// whether none did.
    pub fn find(&self, around: &Box3, mut visit: impl FnMut(u32) -> bool) -> bool {
        // Halves of 32 bits' worth of boxes are no deeper than this.
        let mut waiting = [0; 64];
        let mut count = usize::from(!self.nodes.is_empty());
        while count > 0 {
            count -= 1;
            let index = waiting[count];
            let node = &self.nodes[index as usize];
            if !node.around.meets(around) {
                continue;
            }
            if node.count == 0 {
                waiting[count..count + 2].copy_from_slice(&[node.first, index + 1]);
                count += 2;
                continue;
            }
            let leaf = &self.order[node.first as usize..][..node.count as usize];
            if !leaf.iter().all(|&index| visit(index)) {
                return false;
            }
        }
        true
    }

    /// The box around all.
    pub fn bounds(&self) -> Box3 {
        self.nodes.first().map_or(Box3::EMPTY, |root| root.around)
    }

    /// Size in bytes.
    pub fn bytes(&self) -> usize {
        self.nodes.capacity() * size_of::<Node>() + self.order.capacity() * size_of::<u32>()
    }
}

fn build(boxes: &[Box3], leaf: usize, order: &mut [u32], first: u32, nodes: &mut Vec<Node>) {
    let (mut around, mut middles) = (Box3::EMPTY, Box3::EMPTY);
    let middle = |index: u32| {
        let Box3 { min, max } = boxes[index as usize];
        0.5 * min + 0.5 * max
    };
    for &index in order.iter() {
        around = around.and(boxes[index as usize]);
        middles = middles.with(middle(index));
    }
    let index = nodes.len();
    nodes.push(Node { around, first, count: order.len() as u32 });
    if order.len() <= leaf {
        return;
    }
    let sides = middles.max - middles.min;
    let axis = (0..3).max_by(|&a, &b| sides[a].total_cmp(&sides[b])).expect("three axes");
    let half = order.len() / 2;
    order.select_nth_unstable_by(half, |&a, &b| middle(a)[axis].total_cmp(&middle(b)[axis]));
    let (low, high) = order.split_at_mut(half);
    build(boxes, leaf, low, first, nodes);
    (nodes[index].first, nodes[index].count) = (nodes.len() as u32, 0);
    build(boxes, leaf, high, first + half as u32, nodes);
}
