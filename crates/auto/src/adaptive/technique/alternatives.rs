//! The techniques of the pilot that an image may start again with, if its audit refutes its own.

use super::candidate_cost::CandidateCost;
use super::pilot::Finalist;
use super::{Candidate, End, Selection, Technique};
use serde::{Deserialize, Serialize};

/// Factor on the squared error of other techniques whose pixels share light, once one was refuted:
/// they may have the same fault. Path tracing is what refuted it.
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
    /// relative difference; `None` if no other is expected to differ less from the truth. Of those
    /// whose pixels share light, only the tried ones count: a cache of light that no trial had
    /// measured took the place of photons in a caustic, and had eight times their error.
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
        let unsplit = |own: Technique| Technique { splitting: 1, ..own };
        let is_other =
            |own: &Finalist| unsplit(own.model.technique) != unsplit(instead_of.technique);
        let shares = |own: &Finalist| own.model.technique.strategy.shares_light();
        let after = |own: &Finalist| own.best.after(&self.demand, &again);
        let rank = |own: &Finalist| {
            let doubt = if shares(own) { DOUBT } else { 1.0 };
            doubt * after(own).rank(&again)
        };
        let is_known = |own: &Finalist| is_other(own) && (own.best.tried || !shares(own));
        let is_better = |own: &Finalist| after(own).scored(own.model.technique).error < difference;
        let others = self.finalists.iter().enumerate();
        let others = others.filter(|(_, own)| is_known(own) && is_better(own));
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::adaptive::technique::FreeParameters;
    use crate::adaptive::technique::candidate_cost::{Best, tests::demand};
    use crate::adaptive::technique::model::tests::of_trial;
    use crate::adaptive::technique::trial_runner::TrialRunner;
    use crate::test_scene::TestScene;
    use bdpm_core::noise::Coefficients;
    use bdpm_core::settings::{Settings, Strategy};

    /// Finalists of `scenes/keyhole` with these variances of a camera path.
    fn finalists(of: &[(Strategy, f64, bool)]) -> (Vec<Finalist>, CandidateCost) {
        let scene = TestScene::new("keyhole", [32, 24]);
        let open = FreeParameters { strategy: true, ..FreeParameters::NONE };
        let demand = CandidateCost { open, ..demand(End::Time(10.0)) };
        let finalist = |&(strategy, b, tried): &(Strategy, f64, bool)| {
            let own = Settings { strategy, ..scene.settings.clone() };
            let renderer = scene.renderer(&own);
            let mut runner = TrialRunner::new(&renderer, 0.0).unwrap();
            let (model, _) = of_trial(&mut runner, &own);
            let radii = [f64::from(own.radius); 2];
            let coefficients = Coefficients { a: 0.0, b, f: 0.0 };
            let best = model.evaluate(&coefficients, &model.time(radii), &demand, radii);
            Finalist { model, best: Best { tried, ..best }, is_reserve: false, missed: 0.0 }
        };
        (of.iter().map(finalist).collect(), demand)
    }

    /// The strategy that takes the place of merging, which differs from the truth by this.
    fn instead(others: &[(Strategy, f64, bool)], difference: f64) -> Option<Strategy> {
        let all = [&[(Strategy::Single, 1.0, true)], others].concat();
        let (finalists, demand) = finalists(&all);
        let candidates = finalists.iter().map(|own| own.best.scored(own.model.technique)).collect();
        let selection = Selection {
            candidates,
            open: demand.open,
            guide: None,
            seconds: 1.0,
            refuted: None,
            refuted_trials: vec![],
        };
        let mut others = Alternatives::new(finalists, demand);
        let time = TimeShare { done: 1.0, left: Some(9.0) };
        let again = others.without_refuted(&selection, time, difference)?;
        Some(again.best().technique.strategy)
    }

    #[test]
    fn only_what_is_known_to_be_better_takes_the_place_of_a_refuted_technique() {
        let (gather, path) = (Strategy::Gather, Strategy::Path);
        assert_eq!(instead(&[(gather, 1.0, true), (path, 100.0, false)], 10.0), Some(gather));
        assert_eq!(instead(&[(gather, 1.0, false), (path, 100.0, false)], 10.0), Some(path));
        assert_eq!(instead(&[(gather, 1.0, false)], 10.0), None, "no trial has measured it");
        assert_eq!(instead(&[(path, 100.0, false)], 1e-6), None, "it would have a larger error");
    }
}
