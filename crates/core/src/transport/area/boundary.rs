//! The boundary of many polygons together: edges that two have in common drop out.

use glam::DVec2;

/// A directed segment with what counts on its left.
pub type Segment = (DVec2, DVec2);

/// The boundary of the union of polygons that do not overlap. Edges closer than `tolerance` are
/// equal.
///
/// The boundary must still wind once around each inner point, so that the ends of edges are not
/// moved.
pub fn boundary(mut edges: Vec<Segment>, tolerance: f64) -> Vec<Segment> {
    cancel_pairs(&mut edges);
    let mut kept = Vec::new();
    while let Some(first) = edges.pop() {
        let line = Along::new(first, tolerance);
        let is_against = |&edge: &Segment| line.is_against(edge);
        if !edges.iter().any(is_against) {
            kept.push(first);
            continue;
        }
        let mut events = vec![(0.0, 1, first.0), (line.length, -1, first.1)];
        edges.retain(|&edge| {
            let is_on_line = line.holds(edge);
            if is_on_line {
                // A segment of the other direction counts against it.
                events.push((line.place(edge.0), 1, edge.0));
                events.push((line.place(edge.1), -1, edge.1));
            }
            !is_on_line
        });
        keep_net(&mut events, tolerance, &mut kept);
    }
    join(kept, tolerance)
}

/// The line of a segment.
struct Along {
    start: DVec2,
    direction: DVec2,
    length: f64,
    tolerance: f64,
}

impl Along {
    fn new((p, q): Segment, tolerance: f64) -> Self {
        let (direction, length) = (q - p).normalize_and_length();
        Self { start: p, direction, length, tolerance }
    }

    fn place(&self, point: DVec2) -> f64 {
        self.direction.dot(point - self.start)
    }

    fn holds(&self, (p, q): Segment) -> bool {
        [p, q]
            .iter()
            .all(|point| self.direction.perp_dot(point - self.start).abs() <= self.tolerance)
    }

    /// Whether a segment leads back over some of this one.
    fn is_against(&self, edge: Segment) -> bool {
        let (start, end) = (self.place(edge.0), self.place(edge.1));
        start.min(self.length) - end.max(0.0) > self.tolerance && self.holds(edge)
    }
}

/// Makes one segment of those that go on straight from each other.
fn join(segments: Vec<Segment>, tolerance: f64) -> Vec<Segment> {
    let key = |point: DVec2| point.to_array().map(f64::to_bits);
    let mut starts: Vec<_> =
        segments.iter().enumerate().map(|(index, (start, _))| (key(*start), index)).collect();
    starts.sort_unstable();
    let next = |(p, q): Segment| {
        // The last that starts there.
        let after = starts.partition_point(|(start, _)| *start <= key(q));
        let &(start, index) = starts[..after].last()?;
        if start != key(q) {
            return None;
        }
        let (_, end) = segments[index];
        let whole = Along::new((p, end), tolerance);
        let is_straight = whole.holds((p, q)) && (0.0..whole.length).contains(&whole.place(q));
        is_straight.then_some(index)
    };
    let mut follows = vec![false; segments.len()];
    for &segment in &segments {
        if let Some(index) = next(segment) {
            follows[index] = true;
        }
    }
    let heads = segments.iter().zip(&follows).filter(|&(_, &follows)| !follows);
    let mut joined: Vec<_> = Vec::new();
    let mut is_used: Vec<_> = follows.iter().map(|&follows| !follows).collect();
    for (&head, _) in heads {
        let mut whole = head;
        let mut last = head;
        while let Some(index) = next(last).filter(|&index| !is_used[index]) {
            is_used[index] = true;
            last = segments[index];
            let longer = (whole.0, last.1);
            if !Along::new(longer, tolerance).holds(whole) {
                joined.push(whole);
                whole = last;
            } else {
                whole = longer;
            }
        }
        joined.push(whole);
    }
    joined.extend(segments.iter().zip(&is_used).filter(|&(_, &used)| !used).map(|(s, _)| *s));
    joined
}

/// Drops segments whose reverse is there as well.
fn cancel_pairs(edges: &mut Vec<Segment>) {
    let order = |a: DVec2, b: DVec2| a.x.total_cmp(&b.x).then(a.y.total_cmp(&b.y));
    // From the lower end to the higher, and whether that is the other way around.
    let upward = |&(p, q): &Segment| match order(p, q).is_gt() {
        true => ((q, p), true),
        false => ((p, q), false),
    };
    edges.sort_unstable_by(|a, b| {
        let ((a, back_a), (b, back_b)) = (upward(a), upward(b));
        order(a.0, b.0).then(order(a.1, b.1)).then(back_a.cmp(&back_b))
    });
    let same = |a: &Segment, b: &Segment| upward(a).0 == upward(b).0;
    let mut kept = Vec::new();
    for edges in edges.chunk_by(same) {
        let back = edges.iter().filter(|edge| upward(edge).1).count();
        let forth = edges.len() - back;
        // Edges of one direction precede those of the other.
        kept.extend(&edges[back.min(forth)..edges.len() - back.min(forth)]);
    }
    *edges = kept;
}

/// Intervals of a line where segments do not cancel, in the direction of the majority. A segment
/// adds 1 at its start and subtracts 1 at its end. The end of a segment of the other direction
/// precedes its start, so that it subtracts 1 in between.
fn keep_net(events: &mut [(f64, i32, DVec2)], tolerance: f64, kept: &mut Vec<Segment>) {
    events.sort_by(|a, b| a.0.total_cmp(&b.0));
    let (mut net, mut open) = (0, None::<DVec2>);
    let mut index = 0;
    while index < events.len() {
        let (at, _, point) = events[index];
        let before: i32 = net;
        // All that are at the same place together.
        while index < events.len() && events[index].0 <= at + tolerance {
            net += events[index].1;
            index += 1;
        }
        if before.signum() != net.signum() {
            if let Some(start) = open.take() {
                kept.push(if before > 0 { (start, point) } else { (point, start) });
            }
            open = (net != 0).then_some(point);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::dvec2;

    fn polygon(corners: &[(f64, f64)]) -> Vec<Segment> {
        let corners: Vec<_> = corners.iter().map(|&(x, y)| dvec2(x, y)).collect();
        crate::transport::area::polygon::edges(&corners).collect()
    }

    /// Sum over segments of twice the area between them and the origin.
    fn doubled(segments: &[Segment]) -> f64 {
        segments.iter().map(|(p, q)| p.perp_dot(*q)).sum()
    }

    #[test]
    fn squares_side_by_side_are_one() {
        let mut edges = polygon(&[(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)]);
        // The right neighbor is of two squares, one above the other.
        edges.extend(polygon(&[(1.0, 0.0), (2.0, 0.0), (2.0, 0.5), (1.0, 0.5)]));
        edges.extend(polygon(&[(1.0, 0.5), (2.0, 0.5), (2.0, 1.0), (1.0, 1.0)]));
        let found = boundary(edges, 1e-9);
        assert_eq!(found.len(), 4, "{found:?}");
        assert!((doubled(&found) - 4.0).abs() < 1e-12);
    }

    #[test]
    fn what_is_left_of_a_shared_edge_stays() {
        let mut edges = polygon(&[(0.0, 0.0), (4.0, 0.0), (4.0, 1.0), (0.0, 1.0)]);
        edges.extend(polygon(&[(1.0, 1.0), (2.0, 1.0), (2.0, 2.0), (1.0, 2.0)]));
        let found = boundary(edges, 1e-9);
        assert_eq!(found.len(), 8, "{found:?}");
        assert!((doubled(&found) - 10.0).abs() < 1e-12);
    }
}
