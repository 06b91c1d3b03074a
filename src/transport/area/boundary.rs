//! The boundary of many polygons together: edges that two have in common drop out.

use glam::DVec2;

/// A directed segment with what counts on its left.
pub type Segment = (DVec2, DVec2);

/// What of the edges of polygons that do not overlap is an edge of them all together. Edges that are
/// less than `tolerance` apart are one.
pub fn boundary(mut edges: Vec<Segment>, tolerance: f64) -> Vec<Segment> {
    cancel_pairs(&mut edges);
    let mut kept = Vec::new();
    while let Some(first) = edges.pop() {
        let along = first.1 - first.0;
        let length = along.length();
        if length <= tolerance {
            continue;
        }
        let along = along / length;
        let height = |p: DVec2| along.perp_dot(p - first.0);
        let place = |p: DVec2| along.dot(p - first.0);
        let mut events = vec![(0.0, 1), (length, -1)];
        edges.retain(|&(p, q)| {
            let is_on_line = height(p).abs() <= tolerance && height(q).abs() <= tolerance;
            if is_on_line {
                let (start, end) = (place(p), place(q));
                // A segment of the other direction counts against it.
                events.extend([(start, 1), (end, -1)]);
            }
            !is_on_line
        });
        if events.len() == 2 {
            kept.push(first);
        } else {
            keep_net(&mut events, tolerance, |start, end| {
                kept.push((first.0 + along * start, first.0 + along * end));
            });
        }
    }
    kept
}

/// Drops segments whose reverse is there as well.
fn cancel_pairs(edges: &mut Vec<Segment>) {
    let mut index = 0;
    while index < edges.len() {
        let (p, q) = edges[index];
        if let Some(other) = edges[index + 1..].iter().position(|&(a, b)| (a, b) == (q, p)) {
            edges.swap_remove(index + 1 + other);
            edges.swap_remove(index);
        } else {
            index += 1;
        }
    }
}

/// Intervals of a line where segments do not cancel, in the direction of most of them. A segment
/// adds 1 from its start on and takes 1 from its end on, so that one of the other direction, whose end
/// comes first, takes 1 between its ends.
fn keep_net(events: &mut [(f64, i32)], tolerance: f64, mut keep: impl FnMut(f64, f64)) {
    events.sort_unstable_by(|a, b| a.0.total_cmp(&b.0));
    let (mut net, mut open) = (0, None::<f64>);
    let mut index = 0;
    while index < events.len() {
        let at = events[index].0;
        let before = net;
        // All that are at the same place together.
        while index < events.len() && events[index].0 <= at + tolerance {
            net += events[index].1;
            index += 1;
        }
        if before.signum() != net.signum() {
            if let Some(start) = open.take() {
                if before > 0 { keep(start, at) } else { keep(at, start) }
            }
            open = (net != 0).then_some(at);
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
