//! Paths under way: the ray of each, and what goes with it.

use crate::accel::Ray;

/// Rays with a `W` each. Both are written in place, field by field: putting them together elsewhere and
/// moving them here would make the processor wait for its own stores.
#[derive(Clone, Debug, Default)]
pub(crate) struct Flight<W> {
    rays: Vec<Ray>,
    walks: Vec<W>,
    len: usize,
}

impl<W: Copy + Default> Flight<W> {
    /// Takes all out.
    pub fn clear(&mut self) {
        self.len = 0;
    }

    /// The place of one more, which still holds something else.
    #[inline(always)] // part of the loops over vertices
    pub fn add(&mut self) -> (&mut Ray, &mut W) {
        self.candidate();
        self.keep(true);
        self.at(self.len - 1)
    }

    /// The place of one that may be kept: see [`Self::keep`].
    #[inline(always)] // as above
    pub fn candidate(&mut self) -> (&mut Ray, &mut W) {
        if self.len == self.rays.len() {
            self.grow();
        }
        (&mut self.rays[self.len], &mut self.walks[self.len])
    }

    /// Keeps the candidate or not, without a branch that chance decides and nothing predicts.
    #[inline(always)] // as above
    pub fn keep(&mut self, kept: bool) {
        self.len += usize::from(kept);
    }

    /// The place of one that was added.
    #[inline(always)] // as above
    pub fn at(&mut self, index: usize) -> (&mut Ray, &mut W) {
        debug_assert!(index < self.len);
        (&mut self.rays[index], &mut self.walks[index])
    }

    #[cold]
    fn grow(&mut self) {
        let room = (2 * self.len).max(64);
        self.rays.resize(room, Ray::default());
        self.walks.resize(room, W::default());
    }

    /// How many there are.
    #[inline(always)]
    pub fn len(&self) -> usize {
        self.len
    }

    /// Their rays.
    #[inline(always)]
    pub fn rays(&self) -> &[Ray] {
        &self.rays[..self.len]
    }

    /// What goes with them.
    #[inline(always)]
    pub fn walks(&self) -> &[W] {
        &self.walks[..self.len]
    }
}
