//! The start-up of an image: time that its iterations take beyond later ones, because the areas
//! around gather points are computed cell by cell where camera paths first arrive, and kept.
//!
//! A trial sees the start of this on a sample of the pixels. The growth of the number of cells with
//! the camera paths predicts how many the whole image will need: theory.md (93k).

use bdpm_core::transport::area::CellWork;

/// Bounds of the factor on the share of repeated cells from one doubling of the camera paths to the
/// next. It is 2 as long as few of equally likely cells repeat. The lower bound keeps a far
/// extrapolation from the noise of a short trial: a start-up is rather predicted too short.
const SATURATION: [f64; 2] = [1.3, 2.0];

/// Repeated cells of which the measured factor counts as much as the factor 2 of equally likely
/// cells.
const ENOUGH_REPEATED: f64 = 100.0;

/// Cells that the measured iterations of trials needed which share areas.
///
/// Equal iterations of these trials trace the same camera paths, because trials have equal seeds.
/// So do those of lanes, which follow the trials.
#[derive(Clone, Debug, Default)]
pub struct CellGrowth {
    /// Camera paths of each iteration, and cells that were new in it.
    iterations: Vec<[f64; 2]>,
    /// Index of the first iteration of lanes, once there is one.
    lanes_from: Option<usize>,
    /// Thread time of all cells, seconds.
    seconds: f64,
}

/// Time to compute the areas of an image, by its number of camera paths.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StartUp {
    /// Camera paths of the trials.
    camera_paths: f64,
    /// Wall-clock time of their cells, seconds, if all threads share it.
    seconds: f64,
    /// Share of the cells that the latest doubling of the camera paths found again. It is 1 if no
    /// cell was new, and above 0: each doubling of the paths would double the cells.
    repeated: f64,
    /// Factor on `repeated` from one doubling to the next, within [`SATURATION`].
    saturation: f64,
}

/// Start-up of an image by the radius of its look-ups: that of the trials, and powers of the radius
/// between and beyond them. Large spheres hold more triangles each, and small ones are more.
#[derive(Clone, Debug, Default)]
pub struct StartUpLaw {
    /// Radii of trials, ascending, scene units.
    known: Vec<(f64, StartUp)>,
}

/// Bounds of the power.
const POWERS: [f64; 2] = [0.0, 2.0];

impl StartUpLaw {
    /// The law through start-ups at some radii, the first at each.
    pub fn of(measured: impl Iterator<Item = (f64, StartUp)>) -> Self {
        let mut known: Vec<(f64, StartUp)> = measured.collect();
        known.sort_by(|(one, _), (other, _)| one.total_cmp(other));
        known.dedup_by(|(one, _), (other, _)| *one < 1.01 * *other);
        Self { known }
    }

    /// The law that agrees with `own` at this radius, with the same powers.
    pub fn through(mut self, radius: f64, own: StartUp) -> Self {
        let Some(expected) = self.at(radius) else { return Self { known: vec![(radius, own)] } };
        let factor = own.seconds(own.camera_paths) / expected.seconds(own.camera_paths);
        if factor.is_finite() {
            self.known.iter_mut().for_each(|(_, known)| known.seconds *= factor);
        }
        self
    }

    /// The start-up at this radius; `None` without areas.
    pub fn at(&self, radius: f64) -> Option<StartUp> {
        let (mut nearest, mut own) = *self.known.first()?;
        let mut power = 0.0;
        for pair in self.known.windows(2) {
            let [(small, first), (large, second)] = [pair[0], pair[1]];
            let camera_paths = first.camera_paths.max(second.camera_paths);
            let [one, other] = [first, second].map(|own| own.seconds(camera_paths));
            let [least, most] = POWERS;
            power = ((other / one).ln() / (large / small).ln()).max(least).min(most);
            if radius < large {
                break;
            }
            (nearest, own) = (large, second);
        }
        own.seconds *= (radius / nearest).powf(power);
        Some(own)
    }
}

impl CellGrowth {
    /// The measured iteration of this number, from 0, of one of the trials traced so many camera
    /// paths and needed this `work`.
    pub fn add(&mut self, iteration: usize, camera_paths: f64, work: CellWork) {
        if iteration >= self.iterations.len() {
            self.iterations.resize(iteration + 1, [camera_paths, 0.0]);
        }
        self.iterations[iteration][1] += work.cells as f64;
        self.seconds += work.time.as_secs_f64();
    }

    /// The same for an iteration of one of the lanes, after all trials.
    pub fn add_of_lane(&mut self, iteration: usize, camera_paths: f64, work: CellWork) {
        let from = *self.lanes_from.get_or_insert(self.iterations.len());
        self.add(from + iteration, camera_paths, work);
    }

    /// Cells after this number of camera paths.
    fn cells(&self, camera_paths: f64) -> f64 {
        let (mut left, mut sum) = (camera_paths, 0.0);
        for &[paths, cells] in &self.iterations {
            sum += cells * (left / paths).clamp(0.0, 1.0);
            left -= paths;
        }
        sum
    }

    /// The start-up of an image on so many `threads`; `None` before any cell was computed.
    pub fn start_up(&self, threads: usize) -> Option<StartUp> {
        let camera_paths: f64 = self.iterations.iter().map(|[paths, _]| paths).sum();
        let cells = self.cells(camera_paths);
        if cells == 0.0 {
            return None;
        }
        let repeated = |until: f64| {
            let growth = (self.cells(until) / self.cells(0.5 * until)).log2();
            if growth.is_finite() { 1.0 - growth.clamp(0.0, 1.0) } else { 0.0 }
        };
        let [earlier, later] = [0.5 * camera_paths, camera_paths].map(repeated);
        let [least, most] = SATURATION;
        let measured = if earlier > 0.0 { (later / earlier).clamp(least, most) } else { most };
        let repeats = earlier * self.cells(0.5 * camera_paths);
        let saturation = most - (most - measured) * repeats / (repeats + ENOUGH_REPEATED);
        // Shares of less than one cell are not measured.
        let repeated = later.max(cells.recip());
        let seconds = self.seconds / threads.max(1) as f64;
        Some(StartUp { camera_paths, seconds, repeated, saturation })
    }
}

impl StartUp {
    /// Wall-clock time to compute all areas for this number of camera paths, seconds.
    /// theory.md (93k)
    pub fn seconds(&self, camera_paths: f64) -> f64 {
        let mut doublings = (camera_paths / self.camera_paths).log2();
        if doublings.is_nan() || doublings <= 0.0 {
            return self.seconds * (camera_paths / self.camera_paths).max(0.0);
        }
        let (mut repeated, mut growth) = (self.repeated, 0.0);
        while doublings > 0.0 {
            repeated *= self.saturation;
            if repeated >= 1.0 {
                break;
            }
            growth += doublings.min(1.0) * (1.0 - repeated);
            doublings -= 1.0;
        }
        self.seconds * growth.exp2()
    }
}

#[cfg(test)]
pub mod tests {
    use super::*;
    use std::time::Duration;

    /// A start-up of always this many seconds.
    pub fn constant(seconds: f64) -> StartUp {
        StartUp { camera_paths: 1.0, seconds, repeated: 1.0, saturation: 1.0 }
    }

    /// Expected number of different cells after some camera paths that each ask for one, cell `i`
    /// in proportion to `weights[i]`.
    fn expected_cells(weights: &[f64], camera_paths: f64) -> f64 {
        let sum: f64 = weights.iter().sum();
        weights.iter().map(|weight| -(-weight / sum * camera_paths).exp_m1()).sum()
    }

    #[test]
    fn cells_of_an_image_follow_from_the_growth_in_a_trial() {
        let equal = vec![1.0; 100_000];
        let slow: Vec<f64> = (1..=200_000).map(|i| f64::from(i).powf(-0.5)).collect();
        let steep: Vec<f64> = (1..=200_000).map(|i| f64::from(i).recip()).collect();
        let second = 1e6; // cells
        for (name, weights) in [("equal", equal), ("slow", slow), ("steep", steep)] {
            for each in [1000.0, 16_000.0] {
                let mut growth = CellGrowth::default();
                let until = |iterations: i32| {
                    let cells = expected_cells(&weights, f64::from(iterations) * each);
                    let time = Duration::from_secs_f64(cells / second);
                    CellWork { cells: cells as u64, time }
                };
                for (iteration, next) in (1..=32).enumerate() {
                    growth.add(iteration, each, until(next).since(until(next - 1)));
                }
                let start_up = growth.start_up(2).unwrap();
                let known = expected_cells(&weights, 32.0 * each);
                for factor in [1.0, 4.0, 64.0] {
                    let camera_paths = factor * 32.0 * each;
                    let expected = expected_cells(&weights, camera_paths) / second / 2.0;
                    let ratio = start_up.seconds(camera_paths) / expected;
                    let range = match factor {
                        1.0 => 0.999..1.001,
                        4.0 => 0.8..1.1,
                        _ => 0.35..1.1,
                    };
                    assert!(range.contains(&ratio), "{name} {each} {factor}: {ratio}");
                }
                // The trial alone would tell too little.
                let whole = expected_cells(&weights, 2048.0 * each);
                assert!(each > 1000.0 || known < 0.3 * whole, "{name}: {known} {whole}");
            }
        }
    }

    /// Lanes at equal radii trace the same camera paths, and find the cells of trials computed.
    #[test]
    fn lanes_continue_the_growth_of_trials() {
        let work = |cells: u64| CellWork { cells, time: Duration::from_millis(cells) };
        let mut growth = CellGrowth::default();
        (0..4).for_each(|number| growth.add(number, 100.0, work(50)));
        let mut continued = growth.clone();
        for lane in [60, 0] {
            (0..2).for_each(|number| continued.add_of_lane(number, 200.0, work(lane)));
        }
        assert_eq!(continued.cells(400.0), growth.cells(400.0));
        assert_eq!(continued.cells(800.0), growth.cells(400.0) + 120.0);
        let [more, few] = [&continued, &growth].map(|own| own.start_up(1).unwrap());
        assert!(more.seconds(800.0) > few.seconds(400.0));
    }

    #[test]
    fn start_up_at_other_radii_is_a_power_of_the_radius() {
        assert_eq!(StartUpLaw::default().at(1.0), None);
        let law = |known: &[(f64, f64)]| {
            StartUpLaw::of(known.iter().map(|(radius, seconds)| (*radius, constant(*seconds))))
        };
        let at = |law: &StartUpLaw, radius: f64| law.at(radius).unwrap().seconds(1.0);
        assert_eq!(at(&law(&[(2.0, 3.0)]), 8.0), 3.0, "one trial tells no power");
        let known = law(&[(4.0, 6.0), (1.0, 3.0)]);
        for (radius, seconds) in [(1.0, 3.0), (2.0, 3.0 * 2f64.sqrt()), (4.0, 6.0), (16.0, 12.0)] {
            assert!((at(&known, radius) / seconds - 1.0).abs() < 1e-12, "{radius}");
        }
        // No start-up grows faster than the area of a look-up, or falls with it.
        assert_eq!(at(&law(&[(1.0, 1.0), (2.0, 100.0)]), 0.5), 0.25);
        assert_eq!(at(&law(&[(1.0, 5.0), (2.0, 4.0)]), 0.5), 5.0);
        let longer = known.through(2.0, constant(6.0 * 2f64.sqrt()));
        assert!((at(&longer, 16.0) / 24.0 - 1.0).abs() < 1e-12);
    }

    #[test]
    fn start_up_is_none_without_cells_and_stays_finite() {
        let mut growth = CellGrowth::default();
        assert_eq!(growth.start_up(1), None);
        growth.add(0, 100.0, CellWork::default());
        assert_eq!(growth.start_up(1), None, "discs need no cells");
        let time = Duration::from_secs(1);
        growth.add(1, 100.0, CellWork { cells: 50, time });
        let start_up = growth.start_up(1).unwrap();
        assert_eq!(start_up.seconds(0.0), 0.0);
        assert!((start_up.seconds(200.0) - 1.0).abs() < 1e-12);
        let most = start_up.seconds(1e15);
        assert!(most.is_finite() && most > 10.0, "{most}");
        // Another trial of the same camera paths finds all cells known.
        for iteration in 0..2 {
            growth.add(iteration, 100.0, CellWork::default());
        }
        assert_eq!(growth.start_up(1), Some(start_up));
    }
}
