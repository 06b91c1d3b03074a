//! Greatest intensity, beam angle and field angle of a distribution that was measured in
//! independent groups of light paths, with standard errors.
//!
//! The greatest of many noisy intensities is too high: noise chooses it. Therefore each group is
//! read in the direction in which the other groups are greatest, and a fall below a share of the
//! maximum is sought in the nonincreasing fit of least squares. Standard errors are those of the
//! jackknife over the groups.
//!
//! Where the distribution is smooth around its maximum, a direction is read by a quadratic fit to
//! the nodes around it. The fit has less noise than a node, and gives the intensity instead of its
//! mean over a step. Its radius grows as long as the peak agrees with those of smaller radii within
//! their errors (Lepski 1991).

mod local_fit;

use glam::DVec3;
use local_fit::{Functional, Nodes};

/// Standard errors by which an intensity is below a limit before a fall is certain.
const CERTAIN: f64 = 2.0;

/// Radii of fits, in steps of gamma.
const RADII: [f64; 7] = [2.0, 2.5, 3.0, 4.0, 5.0, 6.0, 8.0];

/// Largest radius of a fit, radians: 30 degrees.
const WIDEST: f64 = 0.524;

/// Standard errors by which the peaks of two radii may differ.
const AGREEMENT: f64 = 2.0;

/// Share of the peak by which fits may be off besides noise.
const MISFIT: f64 = 5e-4;

/// Directions in which the peak is sought: those of the greatest intensities of all groups.
const CANDIDATES: usize = 24;

/// Nodes with the greatest intensities among which candidates are.
const PRESELECTED: usize = 2000;

/// An estimate with its standard error.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Estimate {
    /// The estimate.
    pub value: f64,
    /// Its standard error; NaN with a single group.
    pub error: f64,
}

/// Intensities of one group of iterations, cd.
#[derive(Clone, Debug)]
pub struct Group {
    /// Number of iterations.
    pub weight: f64,
    /// Intensity of each node, row by row of gamma.
    pub values: Vec<f64>,
}

/// Intensities of all groups at the nodes of a grid: gamma from 0 to 180 degrees, and C planes of a
/// whole turn, both in even steps.
#[derive(Clone, Debug)]
pub struct GroupedIntensities {
    /// Number of C planes.
    planes: usize,
    groups: Vec<Group>,
}

/// Values of the same directions in each group, with the weights of the groups.
type Tables = Vec<(f64, Vec<f64>)>;

impl GroupedIntensities {
    /// Groups of a grid with so many C planes.
    ///
    /// # Panics
    /// If there is no group, or groups differ in their number of nodes.
    pub fn new(planes: usize, groups: Vec<Group>) -> Self {
        let nodes = groups.first().expect("at least one group").values.len();
        let is_whole = |group: &Group| group.values.len() == nodes && nodes.is_multiple_of(planes);
        assert!(planes > 0 && groups.iter().all(is_whole), "one value per node");
        Self { planes, groups }
    }

    /// The greatest intensity, cd.
    pub fn peak(&self) -> Estimate {
        let readings = self.readings(&self.brightest_nodes());
        readings.peak().expect("a peak always exists")
    }

    /// Index of the node in whose direction the intensity is greatest.
    pub fn peak_node(&self) -> usize {
        let directions = self.brightest_nodes();
        let readings = self.readings(&directions);
        let best = index_of_greatest(&means(&readings.tables));
        let (node, _) = directions[readings.directions[best]].nodes[0];
        node
    }

    /// Angle between the directions of a plane in which the intensity falls to a share of its
    /// maximum in the plane, degrees: the beam angle for a share of .5 and the field angle for .1.
    /// `None` if the plane is dark, or if the intensity does not fall that far on both sides.
    pub fn opening_angle(&self, c: f64, share: f64) -> Option<Estimate> {
        let profile = self.profile(c);
        let values = self.tables(profile.iter().map(|direction| &direction.nodes[..]));
        let readings = self.readings(&profile);
        let step = 180.0 / (self.rows() - 1) as f64;
        jackknife(self.groups.len(), |left_out| {
            let limit = share * greatest(&without(&readings.tables, left_out));
            Some(step * width(&without(&values, left_out), limit)?)
        })
    }

    /// Directions of the nodes with the greatest intensities. The nodes of a pole are one.
    fn brightest_nodes(&self) -> Vec<Direction> {
        let (grid, last) = (self.grid(), self.rows() - 1);
        let is_first = |node: &usize| {
            let row = node / self.planes;
            node.is_multiple_of(self.planes) || row > 0 && row < last
        };
        let means = self.node_means();
        let mut nodes: Vec<usize> = (0..means.len()).filter(is_first).collect();
        nodes.sort_by(|a, b| means[*b].total_cmp(&means[*a]).then(a.cmp(b)));
        nodes.truncate(PRESELECTED);
        let direction = |node| Direction { unit: grid.direction(node), nodes: vec![(node, 1.0)] };
        nodes.into_iter().map(direction).collect()
    }

    /// Directions of a whole turn through nadir and zenith in the plane C, which is interpolated
    /// between its neighbors: from the nadir on the side of C to the zenith, and back on the other
    /// side.
    fn profile(&self, c: f64) -> Vec<Direction> {
        let (last, grid) = (self.rows() - 1, self.grid());
        let at = |row: usize, c: f64| {
            let turn = (c / 360.0).rem_euclid(1.0) * self.planes as f64;
            let (column, part) = (turn.floor() as usize, turn.fract());
            let node = |column: usize| row * self.planes + column % self.planes;
            let nodes = vec![(node(column), 1.0 - part), (node(column + 1), part)];
            Direction { unit: grid.in_plane(row, c.to_radians()), nodes }
        };
        let near = (0..=last).map(|row| at(row, c));
        near.chain((1..last).rev().map(|row| at(row, c + 180.0))).collect()
    }

    fn grid(&self) -> Nodes {
        Nodes::new(self.rows(), self.planes)
    }

    /// Sums over the nodes of each group, for each list of nodes and factors.
    fn tables<'a>(&self, sums: impl Iterator<Item = &'a [(usize, f64)]> + Clone) -> Tables {
        let sum = |group: &Group, nodes: &[(usize, f64)]| -> f64 {
            nodes.iter().map(|(node, factor)| factor * group.values[*node]).sum()
        };
        let of_group =
            |group: &Group| (group.weight, sums.clone().map(|nodes| sum(group, nodes)).collect());
        self.groups.iter().map(of_group).collect()
    }

    /// Reads the brightest of these directions: by the widest fit that is as good as the narrower
    /// ones, or at the nodes if none is good.
    fn readings(&self, directions: &[Direction]) -> Readings {
        let nodes = || directions.iter().map(|direction| &direction.nodes[..]);
        let at_nodes =
            Readings { directions: (0..directions.len()).collect(), tables: self.tables(nodes()) };
        let grid = self.grid();
        let candidates = self.candidates(&grid, directions);
        let mut accepted: Vec<(Readings, Estimate)> = Vec::new();
        for radius in RADII.map(|steps| steps * grid.step()) {
            if radius > WIDEST || self.groups.len() < 2 {
                break;
            }
            let fit = |candidate: &usize| grid.fit(directions[*candidate].unit, radius);
            let fits: Option<Vec<Functional>> = candidates.iter().map(fit).collect();
            let Some(fits) = fits else { continue };
            let tables = self.tables(fits.iter().map(|fit| &fit[..]));
            let readings = Readings { directions: candidates.clone(), tables };
            let Some(peak) = readings.peak() else { break };
            let slack = MISFIT * peak.value;
            let agrees = |(_, other): &(Readings, Estimate)| {
                (other.value - peak.value).abs() <= AGREEMENT * other.error + slack
            };
            let best = readings.directions[index_of_greatest(&means(&readings.tables))];
            let is_good = match accepted.is_empty() {
                true => self.fits_nodes(&grid, directions[best].unit, radius, slack),
                false => accepted.iter().all(agrees),
            };
            if !is_good {
                break;
            }
            accepted.push((readings, peak));
        }
        accepted.pop().map_or(at_nodes, |(readings, _)| readings)
    }

    /// Indices of the directions that are brightest, by means of the nodes within three steps that
    /// fall to 0 at their edge.
    fn candidates(&self, grid: &Nodes, directions: &[Direction]) -> Vec<usize> {
        let means = self.node_means();
        let radius = 3.0 * grid.step();
        let smoothed = |direction: &Direction| -> f64 {
            let (mut sum, mut weights) = (0.0, 0.0);
            for node in grid.within(direction.unit, radius) {
                let off = grid.direction(node).dot(direction.unit).clamp(-1.0, 1.0).acos() / radius;
                let weight = grid.solid_angle(node) * (1.0 - off * off).max(0.0).powi(2);
                sum += weight * means[node];
                weights += weight;
            }
            match weights > 0.0 {
                true => sum / weights,
                false => direction.nodes.iter().map(|(node, share)| share * means[*node]).sum(),
            }
        };
        let values: Vec<f64> = directions.iter().map(smoothed).collect();
        let mut order: Vec<usize> = (0..directions.len()).collect();
        order.sort_by(|a, b| values[*b].total_cmp(&values[*a]).then(a.cmp(b)));
        order.truncate(CANDIDATES);
        order
    }

    /// Mean intensity of each node over the groups, cd.
    fn node_means(&self) -> Vec<f64> {
        let total: f64 = self.groups.iter().map(|group| group.weight).sum();
        let mut means = vec![0.0; self.groups[0].values.len()];
        for Group { weight, values } in &self.groups {
            means.iter_mut().zip(values).for_each(|(mean, value)| *mean += weight / total * value);
        }
        means
    }

    /// Tests whether the fit of a radius around a direction describes the nodes within it: whether
    /// they are off it by no more than their noise and `slack`, cd.
    fn fits_nodes(&self, grid: &Nodes, center: DVec3, radius: f64, slack: f64) -> bool {
        let near = grid.within(center, radius);
        let single: Vec<Functional> = near.iter().map(|node| vec![(*node, 1.0)]).collect();
        let measured = self.tables(single.iter().map(|node| &node[..]));
        let fits: Option<Vec<Functional>> =
            near.iter().map(|node| grid.fitted(center, radius, *node)).collect();
        let Some(fits) = fits else { return false };
        let fitted = means(&self.tables(fits.iter().map(|fit| &fit[..])));
        let values = means(&measured);
        let errors = standard_errors(&measured, &values);
        let solid: Vec<f64> = near.iter().map(|node| grid.solid_angle(*node)).collect();
        let count = near.len() as f64;
        // Each node's own error is known to a quarter only: they are pooled by solid angle.
        let pooled = |(error, solid): (&f64, &f64)| error * error * solid / count;
        let noise: f64 = errors.iter().zip(&solid).map(pooled).sum();
        let squares = (0..near.len()).map(|at| {
            let variance = noise / solid[at] + slack * slack;
            (values[at] - fitted[at]).powi(2) / variance
        });
        // Four standard deviations of the sum of as many squares
        squares.sum::<f64>() <= count + 4.0 * (2.0 * count).sqrt()
    }

    fn rows(&self) -> usize {
        self.groups[0].values.len() / self.planes
    }
}

/// A direction, and the nodes between which it lies, with their shares.
#[derive(Clone, Debug)]
struct Direction {
    unit: DVec3,
    nodes: Functional,
}

/// Intensities of some directions in each group.
#[derive(Clone, Debug)]
struct Readings {
    /// Indices of the directions.
    directions: Vec<usize>,
    tables: Tables,
}

impl Readings {
    /// The greatest intensity.
    fn peak(&self) -> Option<Estimate> {
        jackknife(self.tables.len(), |left_out| Some(greatest(&without(&self.tables, left_out))))
    }
}

/// Tables without those of one group.
fn without(tables: &Tables, left_out: Option<usize>) -> Tables {
    let kept = |(index, _): &(usize, &(f64, Vec<f64>))| Some(*index) != left_out;
    tables.iter().enumerate().filter(kept).map(|(_, table)| table.clone()).collect()
}

/// The estimate of all groups, with the standard error of the jackknife that leaves out each group
/// in turn. `None` if there is none of all groups; the error is NaN if a group less has none.
fn jackknife(count: usize, estimate: impl Fn(Option<usize>) -> Option<f64>) -> Option<Estimate> {
    let value = estimate(None)?;
    let without = |left_out| if count > 1 { estimate(Some(left_out)) } else { None };
    let others: Option<Vec<f64>> = (0..count).map(without).collect();
    let error = others.map_or(f64::NAN, |others| {
        let mean = others.iter().sum::<f64>() / count as f64;
        let squares: f64 = others.iter().map(|own| (own - mean).powi(2)).sum();
        (squares * (count as f64 - 1.0) / count as f64).sqrt()
    });
    Some(Estimate { value, error })
}

/// Weighted means over the groups.
fn means(tables: &Tables) -> Vec<f64> {
    let total: f64 = tables.iter().map(|(weight, _)| weight).sum();
    let mut means = vec![0.0; tables[0].1.len()];
    for (weight, values) in tables {
        means.iter_mut().zip(values).for_each(|(mean, value)| *mean += weight / total * value);
    }
    means
}

/// Index of the greatest value; of equal ones the first.
fn index_of_greatest(values: &[f64]) -> usize {
    let first = |best: usize, index: usize| if values[index] > values[best] { index } else { best };
    (0..values.len()).fold(0, first)
}

/// Mean over the groups of each one's value in the direction in which the others are greatest. It
/// is below the maximum by as much as that direction is off.
fn greatest(tables: &Tables) -> f64 {
    let means = means(tables);
    if tables.len() == 1 {
        return means[index_of_greatest(&means)];
    }
    let total: f64 = tables.iter().map(|(weight, _)| weight).sum();
    let of_group = |(weight, values): &(f64, Vec<f64>)| {
        let others: Vec<f64> =
            means.iter().zip(values).map(|(mean, own)| total * mean - weight * own).collect();
        weight * values[index_of_greatest(&others)]
    };
    tables.iter().map(of_group).sum::<f64>() / total
}

/// Steps between the directions of a closed profile in which it falls below a limit.
fn width(tables: &Tables, limit: f64) -> Option<f64> {
    if limit <= 0.0 {
        return None;
    }
    let means = means(tables);
    let errors = standard_errors(tables, &means);
    let count = means.len();
    // Of equal intensities, the one next to the nadir
    let signed = |index: usize| index.min(count - index);
    let peak = (0..count)
        .max_by(|a, b| means[*a].total_cmp(&means[*b]).then(signed(*b).cmp(&signed(*a))))?;
    let end = |sign: isize| {
        let at = |step: usize| {
            (peak as isize + sign * step as isize).rem_euclid(count as isize) as usize
        };
        let is_below =
            |step: &usize, margin: f64| means[at(*step)] + margin * errors[at(*step)] < limit;
        // A fall that noise may have made is none yet.
        let certain = (1..count).find(|step| is_below(step, CERTAIN));
        let last = certain.or_else(|| (1..count).find(|step| is_below(step, 0.0)))?;
        let side: Vec<f64> = (0..=last).map(|step| means[at(step)]).collect();
        fall(&side, limit)
    };
    Some(end(1)? + end(-1)?)
}

/// Standard error of the mean of each direction, from the spread of the groups; 0 with one group.
fn standard_errors(tables: &Tables, means: &[f64]) -> Vec<f64> {
    let total: f64 = tables.iter().map(|(weight, _)| weight).sum();
    let mut squares = vec![0.0; means.len()];
    for (weight, values) in tables {
        let off = values.iter().zip(means).map(|(value, mean)| weight * (value - mean).powi(2));
        squares.iter_mut().zip(off).for_each(|(sum, own)| *sum += own);
    }
    let degrees = (tables.len() as f64 - 1.0).max(1.0);
    squares.into_iter().map(|sum| (sum / (total * degrees)).sqrt()).collect()
}

/// Steps at which the nonincreasing fit of values falls below a limit, linear between the middles
/// of its pieces; `None` if it begins below or does not fall.
fn fall(values: &[f64], limit: f64) -> Option<f64> {
    // Neighbors that rise are replaced by their mean, until none do (pool adjacent violators).
    // Each piece has a sum, its first step and the number of its steps.
    let mut pieces: Vec<(f64, usize, usize)> = Vec::new();
    for (step, value) in values.iter().enumerate() {
        let mut new = (*value, step, 1);
        while let Some((sum, first, count)) = pieces.last().copied()
            && sum / count as f64 <= new.0 / new.2 as f64
        {
            pieces.pop();
            new = (sum + new.0, first, count + new.2);
        }
        pieces.push(new);
    }
    let middle = |&(sum, first, count): &(f64, usize, usize)| {
        (first as f64 + 0.5 * (count as f64 - 1.0), sum / count as f64)
    };
    let below = pieces.iter().position(|piece| middle(piece).1 < limit)?;
    let (after, low) = middle(&pieces[below]);
    let (before, high) = middle(pieces.get(below.checked_sub(1)?)?);
    Some(before + (high - limit) / (high - low) * (after - before))
}

#[cfg(test)]
mod tests;
