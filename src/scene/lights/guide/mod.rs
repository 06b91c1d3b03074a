//! Where light paths start: more often where they bring more to the image.
//!
//! All ways to start a light path are a unit cube, [`PrimarySample`]: the light, where on it, and the direction. A guide
//! divides it into cells, in each of which the density is even, and which [`learn`](Guide::learn) finds from what light
//! paths brought. Flux is divided by the density, so that means stay what they are, whatever the guide. theory.md, section 10a.

mod learn;

use super::{Emission, Lights, PrimarySample};
use crate::base::rng::Rng;
pub use learn::GuideSample;

/// A density of the places where light paths start, even within cells.
#[derive(Clone, Debug, PartialEq)]
pub struct Guide {
    cells: Vec<Cell>,
    /// Upper end of each cell's share of the choices.
    cumulative: Vec<f64>,
    /// Second moment of what it was learned from, over that of light paths that start evenly.
    expected: f64,
}

/// A box of the unit cube.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Cell {
    low: PrimarySample,
    size: PrimarySample,
    /// Of places in it, where even is 1.
    density: f64,
}

/// A start of a light path.
#[derive(Clone, Copy, Debug)]
pub struct GuidedStart {
    /// Where among all.
    pub place: PrimarySample,
    /// How much denser than evenly.
    pub density: f64,
}

impl Cell {
    const ALL: Self = Self { low: [0.0; 5], size: [1.0; 5], density: 1.0 };

    fn volume(&self) -> f64 {
        self.size.iter().product()
    }
}

impl Guide {
    /// All places alike: in proportion to what the lights emit there.
    pub fn even() -> Self {
        Self::of_cells(vec![Cell::ALL], 1.0)
    }

    /// Of cells that fill the cube and whose densities have the mean 1.
    fn of_cells(cells: Vec<Cell>, expected: f64) -> Self {
        let mut sum = 0.0;
        let cumulative = cells.iter().map(|cell| {
            sum += cell.density * cell.volume();
            sum
        });
        let cumulative: Vec<f64> = cumulative.collect();
        Self { cumulative: cumulative.iter().map(|end| end / sum).collect(), cells, expected }
    }

    /// Second moment of what light paths bring that start so, over that of those that start evenly: by what it was
    /// learned from, hence less than it will be.
    pub fn expected(&self) -> f64 {
        self.expected
    }

    /// How many cells it has.
    pub fn len(&self) -> usize {
        self.cells.len()
    }

    /// Whether it has none: never.
    pub fn is_empty(&self) -> bool {
        self.cells.is_empty()
    }

    /// Chooses a start.
    #[inline]
    pub fn start(&self, rng: &mut Rng) -> GuidedStart {
        let u = rng.next_f64();
        let index = self.cumulative.partition_point(|&end| end <= u).min(self.cells.len() - 1);
        let Cell { low, size, density } = &self.cells[index];
        let mut place = *low;
        for (place, size) in place.iter_mut().zip(size) {
            *place += size * rng.next_f64();
        }
        GuidedStart { place, density: *density }
    }
}

impl Lights {
    /// Starts a light path where `guide` says; with the light's index.
    ///
    /// # Panics
    /// If there are no lights.
    pub fn emit_guided(&self, guide: &Guide, rng: &mut Rng) -> (usize, Emission) {
        let GuidedStart { place, density } = guide.start(rng);
        let (index, emission) = self.emit_at(place);
        // theory.md (40a)
        (index, Emission { flux: emission.flux / density as f32, ..emission })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::rng::{Stream, StreamKey};

    /// Light paths from the places of `guide` bring this, whose mean over the even places is asked for.
    fn brings(place: &PrimarySample) -> f64 {
        let near = |side: usize, from: f64, to: f64| (from..to).contains(&place[side]);
        if near(0, 0.7, 0.75) && near(3, 0.2, 0.8) { 1.0 + place[4] } else { 0.01 }
    }

    /// What paths that start as `guide` says bring.
    fn samples(guide: &Guide, index: u64, count: usize) -> Vec<GuideSample> {
        let mut rng = StreamKey::new(9, Stream::Test, index).rng(0);
        let one = || {
            let start = guide.start(&mut rng);
            GuideSample { start, square: (brings(&start.place) / start.density).powi(2) }
        };
        std::iter::repeat_with(one).take(count).collect()
    }

    fn mean(values: impl Iterator<Item = f64>) -> [f64; 2] {
        let (mut n, mut sum, mut square) = (0.0, 0.0, 0.0);
        for value in values {
            n += 1.0;
            sum += value;
            square += value * value;
        }
        let mean: f64 = sum / n;
        [mean, ((square / n - mean * mean) / n).sqrt()]
    }

    #[test]
    fn starts_are_as_dense_as_they_say() {
        let guide = Guide::learn(&samples(&Guide::even(), 0, 100_000));
        assert!(guide.len() > 20, "{}", guide.len());
        let mut rng = StreamKey::new(9, Stream::Test, 1).rng(0);
        let starts: Vec<GuidedStart> = (0..200_000).map(|_| guide.start(&mut rng)).collect();
        assert!(starts.iter().all(|s| s.place.iter().all(|x| (0.0..1.0).contains(x))));
        // The mean of any function over all places, by places where the guide puts them.
        let functions: [fn(&PrimarySample) -> f64; 4] = [
            |_| 1.0,
            |p| p[0] * p[3],
            |p| f64::from(p[1] < 0.3 && p[0] > 0.72),
            |p| (p[2] - 0.5) * p[4],
        ];
        let expected = [1.0, 0.25, 0.3 * 0.28, 0.0];
        for (f, expected) in functions.iter().zip(expected) {
            let [mean, error] = mean(starts.iter().map(|s| f(&s.place) / s.density));
            assert!((mean - expected).abs() < 4.0 * error, "{mean} +- {error}, {expected}");
        }
    }

    #[test]
    fn learned_places_come_near_the_least_second_moment() {
        let even = Guide::even();
        let first = Guide::learn(&samples(&even, 2, 20_000));
        let both = [samples(&even, 2, 20_000), samples(&first, 3, 60_000)].concat();
        let guide = Guide::learn(&both);
        let moment = |guide: &Guide, index| {
            mean(samples(guide, index, 200_000).iter().map(|brought| brought.square))
        };
        let [plain, _] = moment(&even, 4);
        let [guided, error] = moment(&guide, 5);
        // The least is the squared mean.
        let (inside, outside) = (0.05 * 0.6 * 1.5, 0.01 * (1.0 - 0.05 * 0.6));
        let least = f64::powi(inside + outside, 2);
        println!("{plain} {guided} +- {error}, least {least}");
        // Where nothing is brought, a fifth of the light paths still starts: 1/0.8 of the least.
        assert!(guided < 1.6 * least && guided > least - 4.0 * error);
        assert!(plain > 20.0 * guided, "{plain} {guided}");
    }

    #[test]
    fn noise_teaches_nothing() {
        // The same everywhere, but for a few values that are a thousand times as large.
        let even = Guide::even();
        let mut some = samples(&even, 6, 5000);
        for (index, brought) in some.iter_mut().enumerate() {
            brought.square = if index % 500 == 3 { 1000.0 } else { 1.0 };
        }
        assert_eq!(Guide::learn(&some).len(), 1);
        assert_eq!(Guide::learn(&[]).len(), 1);
        // Values alike of a few hundred paths.
        some.truncate(400);
        some.iter_mut().for_each(|brought| brought.square = 1.0);
        assert!(Guide::learn(&some).cells.iter().all(|c| (0.5..2.0).contains(&c.density)));
    }
}
