//! One block from two of other iterations.

use super::{Block, PhaseClock};
use crate::base::error::{Error, Result};
use crate::film::counts::Counts;

impl Block {
    /// Adds the iterations of another block of the same place in the same image.
    ///
    /// All that is kept of iterations are sums, so that the result is that of one run but for the order of
    /// additions, and for which terms tell the error of the variance.
    ///
    /// # Errors
    /// If both hold the same iteration, have other counts, or keep other things.
    pub fn merge(&mut self, other: &Self) -> Result<()> {
        self.check_counts(&other.counts)?;
        let both = self.numbers.within(&other.numbers);
        if !both.is_empty() {
            return Err(Error::new(
                format!("iterations {both} are in both"),
                "give every part once, all with the same number of parts",
            ));
        }
        let kept =
            |block: &Self| (block.light.is_some(), block.parts.is_some(), block.beyond.is_some());
        let grain = |block: &Self| block.noise.as_ref().map(|noise| noise.grain());
        let grains = grain(self).zip(grain(other));
        if kept(self) != kept(other) || grains.is_some_and(|(one, two)| one != two) {
            return Err(Error::new(
                "one keeps what the other does not",
                "render all parts with the same --layers, --noise and --denoise",
            ));
        }
        self.film.merge(&other.film);
        match (&mut self.noise, &other.noise) {
            (Some(noise), Some(others)) => noise.merge(others, self.film.tiles()),
            (noise @ None, others) => noise.clone_from(others),
            (Some(_), None) => {}
        }
        for (own, new) in self.light.iter_mut().flatten().zip(other.light.iter().flatten()) {
            own.add(new, 1.0);
        }
        if let (Some(parts), Some(others)) = (&mut self.parts, &other.parts) {
            parts.merge(others);
        }
        if let (Some(beyond), Some(others)) = (&mut self.beyond, &other.beyond) {
            beyond.merge(others);
        }
        self.numbers = self.numbers.with(&other.numbers);
        self.clock.merge(&other.clock);
        Ok(())
    }

    /// Refuses other counts.
    pub(crate) fn check_counts(&self, counts: &Counts) -> Result<()> {
        if self.counts == *counts {
            return Ok(());
        }
        Err(Error::new(
            format!("the numbers of paths from iteration {} on differ", self.first),
            "render all parts with the same numbers of paths, or the same --plan",
        ))
    }
}

impl PhaseClock {
    fn merge(&mut self, other: &Self) {
        self.iterations += other.iterations;
        self.times += other.times;
    }
}
