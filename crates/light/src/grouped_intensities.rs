//! Greatest intensity, beam angle and field angle of a distribution that was measured in
//! independent groups of light paths, with standard errors.
//!
//! The greatest of many noisy intensities is too high: noise chooses it. Therefore each group is
//! read in the direction in which the other groups are greatest, and a fall below a share of the
//! maximum is sought in the nonincreasing fit of least squares. Standard errors are those of the
//! jackknife over the groups.

/// Standard errors by which an intensity is below a limit before a fall is certain.
const CERTAIN: f64 = 2.0;

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

    /// The greatest intensity of all nodes, cd.
    pub fn peak(&self) -> Estimate {
        let tables: Tables =
            self.groups.iter().map(|group| (group.weight, group.values.clone())).collect();
        jackknife(&tables, |tables| Some(greatest(tables))).expect("a peak always exists")
    }

    /// Angle between the directions of a plane in which the intensity falls to a share of its
    /// maximum in the plane, degrees: the beam angle for a share of .5 and the field angle for .1.
    /// `None` if the plane is dark, or if the intensity does not fall that far on both sides.
    pub fn opening_angle(&self, c: f64, share: f64) -> Option<Estimate> {
        let profile = |group: &Group| (group.weight, self.profile(group, c));
        let tables: Tables = self.groups.iter().map(profile).collect();
        let step = 180.0 / (self.rows() - 1) as f64;
        let angle = |tables: &Tables| Some(step * width(tables, share)?);
        jackknife(&tables, angle)
    }

    fn rows(&self) -> usize {
        self.groups[0].values.len() / self.planes
    }

    /// Intensities over a whole turn through nadir and zenith in the plane C, which is interpolated
    /// between its neighbors: from the nadir on the side of C to the zenith, and back on the other
    /// side.
    fn profile(&self, group: &Group, c: f64) -> Vec<f64> {
        let last = self.rows() - 1;
        let at = |row: usize, c: f64| {
            let turn = (c / 360.0).rem_euclid(1.0) * self.planes as f64;
            let (column, part) = (turn.floor() as usize, turn.fract());
            let node = |column: usize| group.values[row * self.planes + column % self.planes];
            node(column) + part * (node(column + 1) - node(column))
        };
        let near = (0..=last).map(|row| at(row, c));
        near.chain((1..last).rev().map(|row| at(row, c + 180.0))).collect()
    }
}

/// The estimate of all groups, with the standard error of the jackknife that leaves out each group
/// in turn. `None` if there is none of all groups; the error is NaN if a group less has none.
fn jackknife(tables: &Tables, estimate: impl Fn(&Tables) -> Option<f64>) -> Option<Estimate> {
    let value = estimate(tables)?;
    let count = tables.len();
    let without = |left_out: usize| {
        let mut rest = tables.clone();
        rest.remove(left_out);
        if rest.is_empty() { None } else { estimate(&rest) }
    };
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

/// Steps between the directions of a closed profile in which it falls below a share of its maximum.
fn width(tables: &Tables, share: f64) -> Option<f64> {
    let limit = share * greatest(tables);
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
mod tests {
    use super::*;
    use bdpm_core::base::rng::{Rng, Stream, StreamKey};

    const ROWS: usize = 37;
    const PLANES: usize = 24;

    fn normal(rng: &mut Rng) -> f64 {
        (0..12).map(|_| f64::from(rng.next_1d())).sum::<f64>() - 6.0
    }

    /// Groups of a distribution over gamma, in degrees, with the noise of nodes of their solid
    /// angles: `noise` of the greatest intensity at a node of a whole step.
    fn groups(rng: &mut Rng, noise: f64, of: impl Fn(f64) -> f64) -> GroupedIntensities {
        let group = |rng: &mut Rng| {
            let mut values = Vec::new();
            for row in 0..ROWS {
                let gamma = 180.0 * row as f64 / (ROWS - 1) as f64;
                let is_pole = row == 0 || row == ROWS - 1;
                let mut pole = None;
                for _ in 0..PLANES {
                    let solid = if is_pole { 0.3 } else { gamma.to_radians().sin() };
                    let spread = noise * (of(gamma) / solid).sqrt();
                    let own = of(gamma) + spread * normal(rng);
                    // All nodes of a pole are one direction.
                    values.push(if is_pole { *pole.get_or_insert(own) } else { own });
                }
            }
            Group { weight: 3.0, values }
        };
        let groups = (0..8).map(|_| group(rng)).collect();
        GroupedIntensities::new(PLANES, groups)
    }

    fn lambertian(gamma: f64) -> f64 {
        gamma.to_radians().cos().max(0.0)
    }

    #[test]
    fn noise_free_angles_are_those_of_powers_of_the_cosine() {
        let mut rng = StreamKey::new(1, Stream::Test, 0).rng(0);
        for (power, tolerance) in [(1.0, 0.15), (4.0, 0.5)] {
            let own = groups(&mut rng, 0.0, |gamma| lambertian(gamma).powf(power));
            assert_eq!(own.peak().value, 1.0);
            for share in [0.5f64, 0.1] {
                let expected = 2.0 * share.powf(1.0 / power).acos().to_degrees();
                let found = own.opening_angle(45.0, share).unwrap();
                assert!((found.value - expected).abs() < tolerance, "{found:?} {expected}");
                assert!(found.error < 1e-9);
            }
        }
        assert_eq!(groups(&mut rng, 0.0, |_| 1.0).opening_angle(0.0, 0.5), None);
        assert_eq!(groups(&mut rng, 0.0, |_| 0.0).opening_angle(0.0, 0.5), None);
        // Upward, around the zenith
        let up = groups(&mut rng, 0.0, |gamma| lambertian(180.0 - gamma));
        assert!((up.opening_angle(0.0, 0.5).unwrap().value - 120.0).abs() < 0.15);
    }

    #[test]
    fn noisy_lambertian_reads_its_peak_and_120_degrees_within_standard_errors() {
        let mut rng = StreamKey::new(2, Stream::Test, 0).rng(0);
        let runs = 200;
        let (mut angles, mut peaks, mut within) = (Vec::new(), Vec::new(), [0; 2]);
        for _ in 0..runs {
            // 1 % of noise at the equator, 5 % at the nodes of 5 degrees
            let own = groups(&mut rng, 0.03, lambertian);
            let (peak, angle) = (own.peak(), own.opening_angle(0.0, 0.5).unwrap());
            within[0] += u32::from((peak.value - 1.0).abs() < 2.5 * peak.error);
            within[1] += u32::from((angle.value - 120.0).abs() < 2.5 * angle.error);
            angles.push(angle.value);
            peaks.push(peak.value);
        }
        let mean = |values: &[f64]| values.iter().sum::<f64>() / f64::from(runs);
        let spread = |values: &[f64]| {
            let mean = mean(values);
            let squares = values.iter().map(|own| (own - mean).powi(2)).sum::<f64>();
            (squares / f64::from(runs - 1)).sqrt()
        };
        // The plain maximum is over two standard deviations too high.
        assert!((mean(&peaks) - 1.0).abs() < spread(&peaks), "{} {}", mean(&peaks), spread(&peaks));
        let off = mean(&angles) - 120.0;
        assert!(off.abs() < 0.5 * spread(&angles) + 0.1, "{off} {}", spread(&angles));
        // 2.5 standard errors of eight groups hold for 96 %.
        assert!(within.iter().all(|count| *count >= 180), "{within:?}");
    }

    #[test]
    fn falls_are_those_of_the_fit_that_does_not_rise() {
        assert_eq!(fall(&[4.0, 3.0, 1.0], 2.0), Some(1.5));
        // The second and third value have the mean 3.
        assert_eq!(fall(&[4.0, 2.0, 4.0, 1.0], 2.0), Some(2.25));
        assert_eq!(fall(&[1.0, 0.0], 2.0), None);
        assert_eq!(fall(&[3.0, 2.5], 2.0), None);
    }
}
