//! The techniques of the pilot that an image may start again with, if its audit refutes its own.

use super::candidate_cost::CandidateCost;
use super::pilot::Finalist;
use super::{Candidate, End, Selection};
use serde::{Deserialize, Serialize};

/// Factor on the squared error of other techniques that merge, once one was refuted: they may have
/// the same fault. Path tracing is what refuted it.
const DOUBT: f64 = 4.0;

/// A technique that an audit of the image refuted.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Refuted {
    /// Rendering time until then, seconds, from the first iteration of the image.
    pub after: f64,
    /// The technique at its radii.
    pub instead_of: Candidate,
    /// Relative difference between its image and the audit.
    pub difference: f64,
}

/// Techniques that the pilot tried.
pub struct Alternatives {
    /// The chosen one first.
    finalists: Vec<Finalist>,
    demand: CandidateCost,
}

/// Time that an image has had, and that it has left.
#[derive(Clone, Copy, Debug)]
pub struct TimeShare {
    /// Rendering time from the first iteration of the image, seconds.
    pub done: f64,
    /// Time until the end, seconds; `None` if an error ends the render.
    pub left: Option<f64>,
}

impl Alternatives {
    pub(super) fn new(finalists: Vec<Finalist>, demand: CandidateCost) -> Self {
        Self { finalists, demand }
    }

    /// Predicted noise of the choice before it is denoised, relative.
    pub fn noise_before_denoising(&self) -> f64 {
        self.finalists[0].best.noise_before_denoising()
    }

    /// Whether a denoiser is expected to remove most of the noise.
    pub fn is_denoised(&self) -> bool {
        self.finalists[0].best.is_denoised()
    }

    /// The best choice without the technique of the `selection`, which an audit refuted by this
    /// relative difference; `None` if no other was tried.
    pub fn without_refuted(
        &mut self,
        selection: &Selection,
        time: TimeShare,
        difference: f64,
    ) -> Option<Selection> {
        let instead_of = *selection.best();
        let end = match self.demand.end {
            End::Time(_) => End::Time(time.left.unwrap_or(0.0) * f64::from(self.demand.ranks)),
            error => error,
        };
        let again = CandidateCost { end, ..self.demand };
        let is_other = |own: &Finalist| own.model.technique != instead_of.technique;
        let rank = |own: &Finalist| {
            let doubt = if own.model.technique.merges() { DOUBT } else { 1.0 };
            doubt * own.best.after(&self.demand, &again).rank(&again)
        };
        let others = self.finalists.iter().enumerate().filter(|(_, own)| is_other(own));
        let (index, _) = others.min_by(|(_, a), (_, b)| rank(a).total_cmp(&rank(b)))?;
        let next = self.finalists.swap_remove(index);
        self.finalists.retain(is_other);
        let best = next.best.after(&self.demand, &again).scored(next.model.technique);
        self.finalists.insert(0, next);
        let mut candidates = selection.candidates.clone();
        candidates.retain(|own| own.technique != best.technique);
        candidates.insert(0, best);
        let refuted = Some(Refuted { after: time.done, instead_of, difference });
        Some(Selection { candidates, refuted, ..selection.clone() })
    }
}
