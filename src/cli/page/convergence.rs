//! The error against time: as it fell, as it was promised, as it is expected.

use super::Snapshot;
use super::sections::percent;
use crate::cli::human_time;
use bdpm::adaptive::stopping::Convergence;
use bdpm::job::RenderState;
use bdpm::output::page::axes::{Curve, LogPlot, Mark, decimal_ticks, time_ticks};
use maud::{Markup, html};

/// Points of a curve that is computed.
const STEPS: u32 = 40;

/// Relative error, noise and bias, when a part `left` of the noise's square is left.
pub fn error(state: &RenderState, standing: &Convergence, left: f64) -> Option<f64> {
    let noise2 = standing.relative_variance(state.stop.objective)?;
    Some((noise2 * left + state.stop.bias2).sqrt())
}

/// The plot with its legend.
pub fn section(moment: &Snapshot) -> Markup {
    let lines = Lines::new(moment);
    let percents = |ends: [f64; 2]| decimal_ticks(ends, percent);
    let plot = LogPlot {
        alt: "The error of the picture against the time of rendering, both on logarithmic axes",
        names: ["time of rendering", "relative error"],
        ticks: [&time_ticks, &percents],
        curves: lines.curves(),
        marks: lines.marks(),
        legend: Vec::new(),
    };
    html! {
        @if let Some(svg) = plot.svg() {
            figure .plot {
                (svg)
                figcaption {
                    (lines.legend())
                    p { (caption(moment)) }
                }
            }
        } @else {
            p { "Nothing is known of it yet." }
        }
    }
}

fn caption(moment: &Snapshot) -> Markup {
    let promise = moment.state.promise();
    html! {
        "On these axes, noise falls along a straight line: a quarter of it takes sixteen times as long."
        @if moment.state.stop.bias2 > 0.0 {
            " What merging photons smears, the merge bias, does not fall with time."
        }
        @if let Some(promise) = promise {
            " The promise was made after " (human_time(promise.said_after)) " and stays as it was made."
        }
        @if moment.state.earlier > 0.0 {
            " The line begins with this run."
        }
    }
}

/// Points of the plot: seconds and relative errors.
struct Lines {
    fell: Vec<[f64; 2]>,
    promised: Vec<[f64; 2]>,
    expected: Vec<[f64; 2]>,
    bias: Vec<[f64; 2]>,
    asked: Vec<[f64; 2]>,
    names: Vec<(&'static str, &'static str)>,
}

impl Lines {
    fn new(moment: &Snapshot) -> Self {
        let state = moment.state;
        let goal = &state.stop;
        let at = |noise2: f64| (noise2 + goal.bias2).sqrt();
        let past = state.history.iter();
        let noise: Vec<[f64; 2]> =
            past.map(|past| [moment.state.earlier + past.seconds, past.noise2]).collect();
        let fell: Vec<[f64; 2]> = noise.iter().map(|&[time, noise2]| [time, at(noise2)]).collect();
        let promised = promised(moment, &noise).unwrap_or_default();
        let expected = expected(moment).unwrap_or_default();
        let of_errors = |points: Vec<[f64; 2]>| -> Vec<[f64; 2]> {
            points.into_iter().map(|[time, noise2]| [time, at(noise2)]).collect()
        };
        let (promised, expected) = (of_errors(promised), of_errors(expected));
        let all = || fell.iter().chain(&promised).chain(&expected);
        let times = all().map(|point| point[0]);
        let [from, to] =
            times.fold([f64::INFINITY, 0.0f64], |[from, to], time| [from.min(time), to.max(time)]);
        let least = all().map(|point| point[1]).fold(f64::INFINITY, f64::min);
        let level = |value: f64| vec![[from, value], [to, value]];
        // Far below all else, it would only make the rest small.
        let is_near = |value: &f64| *value > 0.25 * least;
        let bias = Some(goal.bias2.sqrt()).filter(|bias| *bias > 0.0).filter(is_near);
        let asked = goal.error.filter(is_near).map_or(Vec::new(), level);
        let bias = bias.map_or(Vec::new(), level);
        let curves = [
            ("fell", "as it fell", &fell),
            ("promised", "as it was promised", &promised),
            ("expected", "as it is expected now", &expected),
            ("bias", "merge bias", &bias),
            ("asked", "asked for", &asked),
        ];
        let named = curves.iter().filter(|(_, _, points)| !points.is_empty());
        let names = named.map(|&(class, name, _)| (class, name)).collect();
        Self { fell, promised, expected, bias, asked, names }
    }

    fn curves(&self) -> Vec<Curve<'static>> {
        let Self { fell, promised, expected, bias, asked, .. } = self;
        let all = [
            ("bias", bias),
            ("asked", asked),
            ("expected", expected),
            ("promised", promised),
            ("fell", fell),
        ];
        all.map(|(class, points)| Curve { class, points: points.clone() }).into()
    }

    /// The ends of what was promised and of what is known.
    fn marks(&self) -> Vec<Mark<'static>> {
        let last = |class, points: &[[f64; 2]]| points.last().map(|&at| Mark { class, at });
        [last("promised", &self.promised), last("fell", &self.fell)].into_iter().flatten().collect()
    }

    fn legend(&self) -> Markup {
        html! {
            div .legend {
                @for (class, name) in &self.names {
                    span {
                        svg .sample viewBox="0 0 32 10" width="32" height="10" aria-hidden="true" {
                            line .(class) x1="0" x2="32" y1="5" y2="5" {}
                        }
                        (name)
                    }
                }
            }
        }
    }
}

/// Relative variance from when the promise was made to its end, as it was promised. Information, the reciprocal
/// of the variance, adds up over time.
fn promised(moment: &Snapshot, noise: &[[f64; 2]]) -> Option<Vec<[f64; 2]>> {
    let promise = moment.state.promise()?;
    let then = promise.error.map(|error| error.powi(2) - moment.state.stop.bias2);
    let then = then.or_else(|| {
        let standing = moment.state.status.convergence.as_ref()?;
        Some((promise.rms / standing.mean_luminance).powi(2))
    })?;
    let to = [promise.seconds, then];
    let from = noise.iter().find(|[time, _]| *time >= promise.said_after);
    let line = from.map_or(Vec::new(), |from| between(*from, to));
    Some(if line.is_empty() { vec![to] } else { line })
}

/// The same from now to the end, as it is expected now.
fn expected(moment: &Snapshot) -> Option<Vec<[f64; 2]>> {
    let state = moment.state;
    let forecast = state.status.forecast.filter(|_| moment.report.is_none())?;
    let noise2 = state.status.convergence.as_ref()?.relative_variance(state.stop.objective)?;
    let now = moment.state.earlier + state.elapsed().as_secs_f64();
    Some(between([now, noise2], [now + forecast.seconds, noise2 * forecast.left]))
}

/// Points between two at which information grows evenly with time; none if it does not.
fn between([from, many]: [f64; 2], [to, few]: [f64; 2]) -> Vec<[f64; 2]> {
    if !(from > 0.0 && to > from && few > 0.0 && many > few) {
        return Vec::new();
    }
    let point = |step: u32| {
        let time = from * (to / from).powf(f64::from(step) / f64::from(STEPS));
        let share = (time - from) / (to - from);
        [time, ((1.0 - share) / many + share / few).recip()]
    };
    (0..=STEPS).map(point).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn information_grows_evenly_between_two_moments() {
        let points = between([1.0, 4.0], [9.0, 0.4]);
        let close = |a: f64, b: f64| (a / b - 1.0).abs() < 1e-12;
        assert!(close(points[0][1], 4.0) && close(points[STEPS as usize][1], 0.4));
        for [time, noise2] in points {
            let expected = 0.25 + (time - 1.0) / 8.0 * (2.5 - 0.25);
            assert!(close(noise2.recip(), expected), "{time} {noise2}");
        }
        assert!(between([1.0, 4.0], [0.5, 1.0]).is_empty());
        assert!(between([1.0, 0.0], [2.0, f64::NAN]).is_empty());
    }
}
