//! Lines of equal values on a grid, by marching squares, and their picture as SVG.

use super::false_color::ValueGrid;
use bdpm_core::image_io::number;
use std::collections::HashMap;
use std::fmt::Write;

/// A line of equal values. Coordinates are cells from the center of the cell at the top left.
#[derive(Clone, Debug, PartialEq)]
pub struct Isoline {
    /// The value.
    pub level: f64,
    /// Points in order; the last is the first if the line is closed.
    pub points: Vec<[f64; 2]>,
}

/// An edge between two neighboring cells: the first cell, and whether the other is below instead of
/// to the right.
type Edge = (u32, u32, bool);

/// Lines on which the bilinear interpolation between the centers of cells has one of the `levels`.
/// Squares that touch a cell without a number have none.
pub fn isolines(grid: ValueGrid, levels: &[f64]) -> Vec<Isoline> {
    levels.iter().flat_map(|&level| lines_of(grid, level)).collect()
}

fn lines_of(grid: ValueGrid, level: f64) -> Vec<Isoline> {
    // Both neighbors on the line of each crossed edge
    let mut next: HashMap<Edge, Vec<Edge>> = HashMap::new();
    let mut order = Vec::new();
    for (a, b) in segments(grid, level) {
        for (from, to) in [(a, b), (b, a)] {
            let neighbors = next.entry(from).or_insert_with(|| {
                order.push(from);
                Vec::new()
            });
            neighbors.push(to);
        }
    }
    let mut lines = Vec::new();
    // Open lines begin at an edge with one neighbor; what remains is closed.
    let ends: Vec<Edge> = order.iter().copied().filter(|edge| next[edge].len() == 1).collect();
    for start in ends.into_iter().chain(order) {
        let mut at = start;
        let mut points = vec![crossing(grid, at, level)];
        while let Some(to) = next.get_mut(&at).and_then(Vec::pop) {
            let back = next.get_mut(&to).expect("neighbors are mutual");
            let own = back.iter().position(|edge| *edge == at).expect("neighbors are mutual");
            back.swap_remove(own);
            points.push(crossing(grid, to, level));
            at = to;
        }
        if points.len() > 1 {
            lines.push(Isoline { level, points });
        }
    }
    lines
}

/// Pairs of crossed edges that a line joins within a square of four cells.
fn segments(grid: ValueGrid, level: f64) -> Vec<(Edge, Edge)> {
    let [width, height] = grid.size();
    let mut all = Vec::new();
    for y in 0..height.saturating_sub(1) {
        for x in 0..width.saturating_sub(1) {
            let corners = [[x, y], [x + 1, y], [x + 1, y + 1], [x, y + 1]];
            let values = corners.map(|[x, y]| grid.at(x, y));
            if values.iter().any(|value| !value.is_finite()) {
                continue;
            }
            let above = values.map(|value| value >= level);
            // Edges between successive corners
            let edges = [(x, y, false), (x + 1, y, true), (x, y + 1, false), (x, y, true)];
            let crossed: Vec<Edge> =
                (0..4).filter(|&i| above[i] != above[(i + 1) % 4]).map(|i| edges[i]).collect();
            match crossed[..] {
                [a, b] => all.push((a, b)),
                [top, right, bottom, left] => {
                    // In a saddle, the mean of the corners decides which of them are joined.
                    let middle = values.iter().sum::<f64>() / 4.0 >= level;
                    if middle == above[0] {
                        all.extend([(top, right), (bottom, left)]);
                    } else {
                        all.extend([(left, top), (right, bottom)]);
                    }
                }
                _ => {}
            }
        }
    }
    all
}

/// The point of an edge at the level.
fn crossing(grid: ValueGrid, (x, y, is_down): Edge, level: f64) -> [f64; 2] {
    let first = grid.at(x, y);
    let second = if is_down { grid.at(x, y + 1) } else { grid.at(x + 1, y) };
    let share = ((level - first) / (second - first)).clamp(0.0, 1.0);
    let (x, y) = (f64::from(x), f64::from(y));
    if is_down { [x, y + share] } else { [x + share, y] }
}

/// A complete SVG file with the lines and their values. A cell is `cell` units wide.
pub fn isolines_svg(grid: ValueGrid, levels: &[f64], unit: &str, cell: f64) -> String {
    let [width, height] = grid.size().map(|count| f64::from(count) * cell);
    let place = |[x, y]: [f64; 2]| format!("{:.2},{:.2}", (x + 0.5) * cell, (y + 0.5) * cell);
    let mut svg = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {width} {height}\" \
         font-family=\"sans-serif\" font-size=\"{:.1}\">\n<rect width=\"{width}\" \
         height=\"{height}\" fill=\"white\" stroke=\"black\"/>\n",
        0.025 * width.max(height)
    );
    let unit: String = unit.chars().filter(|c| !"<>&\"".contains(*c)).collect();
    for Isoline { level, points } in isolines(grid, levels) {
        let text: Vec<_> = points.iter().map(|point| place(*point)).collect();
        let _ = writeln!(
            svg,
            "<polyline fill=\"none\" stroke=\"black\" points=\"{}\"/>",
            text.join(" ")
        );
        let [x, y] = points[points.len() / 2].map(|at| (at + 0.5) * cell);
        let _ = writeln!(
            svg,
            "<text x=\"{x:.2}\" y=\"{y:.2}\" paint-order=\"stroke\" stroke=\"white\" \
             stroke-width=\"3\">{} {unit}</text>",
            number(level)
        );
    }
    svg + "</svg>\n"
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn line_around_a_cone_is_a_closed_circle() {
        let (side, radius) = (41, 12.3);
        let values: Vec<f64> = (0..side * side)
            .map(|i| 20.0 - f64::from(i % side - 20).hypot(f64::from(i / side - 20)))
            .collect();
        let grid = ValueGrid::new(side as u32, side as u32, &values);
        let lines = isolines(grid, &[20.0 - radius, 100.0]);
        let [Isoline { points, .. }] = &lines[..] else { panic!("{} lines", lines.len()) };
        assert_eq!(points.first(), points.last());
        for [x, y] in points {
            let distance = (x - 20.0).hypot(y - 20.0);
            assert!((distance - radius).abs() < 0.05, "{distance}");
        }
        let length: f64 =
            points.windows(2).map(|w| (w[1][0] - w[0][0]).hypot(w[1][1] - w[0][1])).sum();
        assert!((length / (std::f64::consts::TAU * radius) - 1.0).abs() < 0.01, "{length}");
    }

    #[test]
    fn lines_across_a_slope_are_straight_and_end_at_cells_without_a_number() {
        let mut values: Vec<f64> = (0..30).map(|i| f64::from(i % 6)).collect();
        let grid = ValueGrid::new(6, 5, &values);
        let lines = isolines(grid, &[1.5, 3.0]);
        assert_eq!(lines.len(), 2);
        assert!(lines[0].points.iter().all(|[x, _]| (x - 1.5).abs() < 1e-12));
        assert_eq!(lines[0].points.len(), 5);
        values[13] = f64::NAN;
        let grid = ValueGrid::new(6, 5, &values);
        let rows: Vec<_> = isolines(grid, &[1.5]).iter().map(|line| line.points.len()).collect();
        assert_eq!(rows, [2, 2], "cell (1, 2) interrupts it");
        let svg = isolines_svg(grid, &[1.5], "lx", 10.0);
        assert!(svg.contains(">1.5 lx</text>") && svg.ends_with("</svg>\n"));
    }

    #[test]
    fn saddles_join_no_line_with_another() {
        let values = [1.0, 0.0, 0.0, 1.0];
        let lines = isolines(ValueGrid::new(2, 2, &values), &[0.6]);
        assert_eq!(lines.len(), 2);
        assert!(lines.iter().all(|line| line.points.len() == 2));
    }
}
