//! Whether readings have what is required of them, as far as their intervals tell.

use super::extremes::Estimated;
use super::reading::Reading;
use super::results::SetReadings;
use bdpm_core::scene::Requirement;
use serde::Serialize;

/// Shares of the points of a grid that EN 17037 wants to have the target and the minimum of the
/// daylight factor.
const DAYLIT: [(f64, &str); 2] =
    [(50.0, "points with the target daylight factor"), (95.0, "points with the minimum of it")];

/// What an interval says of a requirement.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Verdict {
    /// The whole interval is at least what is required.
    Met,
    /// The whole interval is less.
    NotMet,
    /// What is required lies in the interval, or there may be more light than it says.
    NotDecided,
}

impl Verdict {
    /// The verdict on an estimate that may have at most this value; `None` where it is not known.
    fn of_most(found: Estimated, most: f64) -> Self {
        let Estimated { value, expanded } = found;
        if value + expanded <= most {
            Self::Met
        } else if value - expanded > most {
            Self::NotMet
        } else {
            Self::NotDecided
        }
    }

    /// The verdict on an estimate. Where its interval is open above, nothing is known to be too
    /// little.
    fn of(Estimated { value, expanded }: Estimated, required: f64, is_open: bool) -> Self {
        if value - expanded >= required {
            Self::Met
        } else if value + expanded < required && !is_open {
            Self::NotMet
        } else {
            Self::NotDecided
        }
    }

    /// The name in JSON.
    pub fn name(self) -> &'static str {
        match self {
            Self::Met => "met",
            Self::NotMet => "not-met",
            Self::NotDecided => "not-decided",
        }
    }

    /// The verdict in words.
    pub fn describe(self) -> &'static str {
        match self {
            Self::Met => "met",
            Self::NotMet => "not met",
            Self::NotDecided => "not decided: measure longer",
        }
    }
}

/// The side on which a requirement bounds a value.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Limit {
    /// At least the required value.
    Least,
    /// At most the required value.
    Most,
}

impl Limit {
    /// The name in JSON.
    pub fn name(self) -> &'static str {
        match self {
            Self::Least => "least",
            Self::Most => "most",
        }
    }

    /// The limit in words.
    pub fn describe(self) -> &'static str {
        match self {
            Self::Least => "at least",
            Self::Most => "at most",
        }
    }
}

/// A requirement with what was found.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Judged {
    /// What is required.
    pub what: &'static str,
    /// Unit of both numbers.
    pub unit: &'static str,
    /// Whether the found value must be at least or at most the required one.
    pub limit: Limit,
    /// The required value.
    pub required: f64,
    /// What was found, with an interval of 95 %.
    #[serde(flatten)]
    pub found: Estimated,
    /// Whether it is enough.
    pub verdict: Verdict,
}

impl SetReadings {
    /// Every requirement of the set with what was found. The mean counts after the maintenance
    /// factor, daylight factors by the points of the grid that have them.
    pub fn judged(&self) -> Vec<Judged> {
        let Requirement { mean, minimum, uniformity, diversity, ugr, daylight_factor, maintenance } =
            self.requirement;
        let judged = |what, unit, required, found| Judged {
            what,
            unit,
            limit: Limit::Least,
            required,
            found,
            verdict: Verdict::of(found, required, self.open > 0),
        };
        if self.is_daylight_factor {
            let least = daylight_factor.into_iter().flatten().zip(DAYLIT);
            let of_share = |(least, (share, what))| judged(what, "%", share, self.share(least));
            return least.map(of_share).collect();
        }
        let maintained = |own: Estimated| Estimated {
            value: maintenance * own.value,
            expanded: maintenance * own.expanded,
        };
        let of_unit =
            |what, required, found| judged(what, self.unit(), required, maintained(found));
        let ratio = |what, required, found| judged(what, "", required, found);
        let glare = |most| {
            let found = self.largest_ugr();
            let verdict = Verdict::of_most(found, most);
            let limit = Limit::Most;
            Judged { what: "largest UGR", unit: "", limit, required: most, found, verdict }
        };
        [
            mean.map(|own| of_unit("maintained mean", own, (&self.mean).into())),
            minimum.map(|own| of_unit("maintained minimum", own, self.extremes()[0])),
            uniformity.map(|own| ratio("uniformity U0", own, self.uniformity())),
            diversity.map(|own| ratio("diversity Ud", own, self.diversity())),
            ugr.map(glare),
        ]
        .into_iter()
        .flatten()
        .collect()
    }

    /// The largest unified glare rating of the eyes; 0 if none has a luminaire in view.
    fn largest_ugr(&self) -> Estimated {
        let rated = self.ugr.iter().flatten();
        let most = |sign: f64| {
            let bound = |own: &Estimated| own.value + sign * own.expanded;
            rated.clone().map(bound).fold(0.0, f64::max)
        };
        let [value, low, high] = [0.0, -1.0, 1.0].map(most);
        if rated.clone().any(|own| !own.value.is_finite()) {
            return Estimated::UNKNOWN;
        }
        Estimated { value, expanded: (high - value).max(value - low) }
    }

    /// The factor on the mean that a requirement is compared with, if it is not 1.
    pub fn maintenance_factor(&self) -> Option<f64> {
        let own = self.requirement.maintenance;
        (own != 1.0 && !self.is_daylight_factor).then_some(own)
    }

    /// Share of the meters that read at least this, percent. The interval reaches from those that
    /// certainly do to those that may.
    fn share(&self, least: f64) -> Estimated {
        let count = |has: &dyn Fn(&Reading) -> bool| {
            100.0 * self.readings.iter().filter(|own| has(own)).count() as f64
                / self.readings.len() as f64
        };
        let certain = count(&|own| own.value - own.expanded >= least);
        // Unknown readings may be as high as any.
        let lacking = count(&|own| own.value + own.expanded < least);
        let possible = 100.0 - lacking;
        Estimated { value: 0.5 * (certain + possible), expanded: 0.5 * (possible - certain) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use bdpm_core::scene::MeterKind;

    fn reading(value: f64, expanded: f64) -> Reading {
        Reading { value, noise: 0.5 * expanded, bias: 0.0, expanded, direct: 0.0 }
    }

    fn grid(readings: Vec<Reading>, mean: Reading, requirement: Requirement) -> SetReadings {
        let set = SetReadings::single("desks", MeterKind::Irradiance, mean);
        SetReadings { grid: [readings.len() as u32, 1], readings, requirement, ..set }
    }

    #[test]
    fn intervals_decide_about_the_maintained_mean() {
        let requirement = Requirement { mean: Some(500.0), maintenance: 0.8, ..Default::default() };
        let verdict = |value, expanded, open| {
            let mean = reading(value, expanded);
            let set = SetReadings { open, ..grid(vec![mean], mean, requirement) };
            let [judged] = set.judged()[..] else { panic!("one requirement") };
            assert_eq!(judged.found.value.to_bits(), (0.8 * value).to_bits());
            judged.verdict
        };
        assert_eq!(verdict(640.0, 10.0, 0), Verdict::Met);
        assert_eq!(verdict(620.0, 6.0, 1), Verdict::NotDecided);
        assert_eq!(verdict(620.0, 4.0, 0), Verdict::NotMet);
        assert_eq!(verdict(620.0, 4.0, 1), Verdict::NotDecided, "open above");
        assert_eq!(verdict(620.0, 10.0, 0), Verdict::NotDecided);
        assert_eq!(verdict(f64::NAN, f64::NAN, 0), Verdict::NotDecided);
        assert_eq!(verdict(640.0, f64::INFINITY, 0), Verdict::NotDecided);
    }

    #[test]
    fn the_darkest_point_and_the_worst_eye_decide() {
        let requirement = Requirement {
            minimum: Some(1.0),
            diversity: Some(0.025),
            ugr: Some(19.0),
            maintenance: 0.8,
            ..Requirement::default()
        };
        let readings = vec![reading(1.5, 0.1), reading(30.0, 0.1), reading(20.0, 0.1)];
        let mut set = grid(readings, reading(17.0, 0.1), requirement);
        let rating = |value, expanded| Some(Estimated { value, expanded });
        set.ugr = vec![rating(17.0, 0.3), None, rating(16.0, 2.0)];
        let [minimum, diversity, ugr] = set.judged()[..] else { panic!("three requirements") };
        assert_eq!(minimum.verdict, Verdict::Met);
        assert!((minimum.found.value - 1.2).abs() < 0.1, "{minimum:?}");
        assert_eq!(diversity.verdict, Verdict::Met);
        assert_eq!(ugr.verdict, Verdict::Met);
        assert_eq!((ugr.found.value, ugr.found.expanded), (17.0, 1.0), "the highest bound is 18");
        for (worst, verdict) in [
            (rating(21.0, 1.0), Verdict::NotMet),
            (rating(19.5, 1.0), Verdict::NotDecided),
            (Some(Estimated::UNKNOWN), Verdict::NotDecided),
            (None, Verdict::Met),
        ] {
            set.ugr[0] = worst;
            assert_eq!(set.judged()[2].verdict, verdict);
        }
        set.readings[0] = reading(0.9, 0.1);
        assert_eq!(set.judged()[0].verdict, Verdict::NotMet);
    }

    #[test]
    fn points_decide_about_daylight_factors() {
        let requirement =
            Requirement { daylight_factor: Some([2.0, 0.7]), ..Requirement::default() };
        let judged = |values: [f64; 10]| {
            let readings: Vec<Reading> = values.iter().map(|own| reading(*own, 0.1)).collect();
            let set = grid(readings, reading(2.0, 0.1), requirement);
            let set = SetReadings { is_daylight_factor: true, ..set };
            let [target, minimum] = set.judged()[..] else { panic!("two requirements") };
            (target.verdict, minimum.verdict, target.found)
        };
        let bright = [3.0, 3.0, 3.0, 3.0, 3.0, 1.0, 1.0, 1.0, 1.0, 1.0];
        let (target, minimum, found) = judged(bright);
        assert_eq!((target, minimum), (Verdict::Met, Verdict::Met));
        assert_eq!((found.value, found.expanded), (50.0, 0.0));
        // One point may have 2 % or not, and one has less than .7 %.
        let (target, minimum, found) = judged([3.0, 3.0, 3.0, 3.0, 2.05, 1.0, 1.0, 1.0, 1.0, 0.5]);
        assert_eq!((target, minimum), (Verdict::NotDecided, Verdict::NotMet));
        assert_eq!((found.value, found.expanded), (45.0, 5.0));
    }

    #[test]
    fn uniformity_is_judged_by_its_interval() {
        let requirement = Requirement { uniformity: Some(0.6), ..Requirement::default() };
        let verdict = |least: f64| {
            let readings = vec![reading(500.0, 1.0), reading(least, 1.0), reading(520.0, 1.0)];
            let mean = reading((1020.0 + least) / 3.0, 0.5);
            grid(readings, mean, requirement).judged()[0].verdict
        };
        assert_eq!(verdict(400.0), Verdict::Met);
        assert_eq!(verdict(200.0), Verdict::NotMet);
        // .6 of the mean is 255.
        assert_eq!(verdict(255.2), Verdict::NotDecided);
    }
}
