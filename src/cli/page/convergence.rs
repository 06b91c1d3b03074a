//! Plot of the error against time: measured, promised and forecast.

use super::Snapshot;
use super::sections::percent;
use crate::cli::human_time;
use bdpm::adaptive::stopping::Convergence;
use bdpm::job::RenderState;
use bdpm::report::axes::{Curve, LogPlot, Mark, decimal_ticks, time_ticks};
use maud::{Markup, html};

/// Points of a curve that is computed.
const STEPS: u32 = 40;

/// Relative error (noise and bias) when the share `left` of the variance remains.
pub fn error(state: &RenderState, convergence: &Convergence, left: f64) -> Option<f64> {
    let noise2 = convergence.relative_variance(state.stop.objective)?;
    Some((noise2 * left + state.stop.bias2).sqrt())
}

/// The plot with its legend.
pub fn section(snapshot: &Snapshot) -> Markup {
    let lines = ErrorCurves::new(snapshot);
    let percents = |ends: [f64; 2]| decimal_ticks(ends, percent);
    let plot = LogPlot {
        alt: "The error of the picture against the rendering time, both on logarithmic axes",
        names: ["rendering time", "relative error"],
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
                    p { (caption(snapshot)) }
                }
            }
        } @else {
            p { "The error is not known yet." }
        }
    }
}

fn caption(snapshot: &Snapshot) -> Markup {
    let promise = snapshot.state.promise();
    html! {
        "On these axes, noise decreases along a straight line: a quarter of the noise takes sixteen times as long."
        @if snapshot.state.stop.bias2 > 0.0 {
            " The " (snapshot.state.provenance.settings.strategy.bias_name())
            " does not decrease with time."
        }
        @if let Some(promise) = promise {
            " The promise was made after " (human_time(promise.said_after)) " and is not updated."
        }
        @if snapshot.state.earlier > 0.0 {
            " The line begins with this run."
        }
    }
}

/// Points of the plot: seconds and relative errors.
struct ErrorCurves {
    measured: Vec<[f64; 2]>,
    promised: Vec<[f64; 2]>,
    forecast: Vec<[f64; 2]>,
    bias: Vec<[f64; 2]>,
    target: Vec<[f64; 2]>,
    names: Vec<(&'static str, &'static str)>,
}

impl ErrorCurves {
    fn new(snapshot: &Snapshot) -> Self {
        let state = snapshot.state;
        let stop = &state.stop;
        let at = |noise2: f64| (noise2 + stop.bias2).sqrt();
        let past = state.history.iter();
        let noise: Vec<[f64; 2]> =
            past.map(|past| [snapshot.state.earlier + past.seconds, past.noise2]).collect();
        let measured: Vec<[f64; 2]> =
            noise.iter().map(|&[time, noise2]| [time, at(noise2)]).collect();
        let promised = promised(snapshot, &noise).unwrap_or_default();
        let forecast = forecast(snapshot).unwrap_or_default();
        let of_errors = |points: Vec<[f64; 2]>| -> Vec<[f64; 2]> {
            points.into_iter().map(|[time, noise2]| [time, at(noise2)]).collect()
        };
        let (promised, forecast) = (of_errors(promised), of_errors(forecast));
        let all = || measured.iter().chain(&promised).chain(&forecast);
        let times = all().map(|point| point[0]);
        let [from, to] =
            times.fold([f64::INFINITY, 0.0f64], |[from, to], time| [from.min(time), to.max(time)]);
        let min = all().map(|point| point[1]).fold(f64::INFINITY, f64::min);
        let level = |value: f64| vec![[from, value], [to, value]];
        // A level far below all curves would only compress them.
        let is_near = |value: &f64| *value > 0.25 * min;
        let bias = Some(stop.bias2.sqrt()).filter(|bias| *bias > 0.0).filter(is_near);
        let target = stop.error.filter(is_near).map_or(Vec::new(), level);
        let bias = bias.map_or(Vec::new(), level);
        let curves = [
            ("measured", "measured", &measured),
            ("promised", "promised", &promised),
            ("forecast", "expected now", &forecast),
            ("bias", state.provenance.settings.strategy.bias_name(), &bias),
            ("target", "target", &target),
        ];
        let named = curves.iter().filter(|(_, _, points)| !points.is_empty());
        let names = named.map(|&(class, name, _)| (class, name)).collect();
        Self { measured, promised, forecast, bias, target, names }
    }

    fn curves(&self) -> Vec<Curve<'static>> {
        let Self { measured, promised, forecast, bias, target, .. } = self;
        let all = [
            ("bias", bias),
            ("target", target),
            ("forecast", forecast),
            ("promised", promised),
            ("measured", measured),
        ];
        all.map(|(class, points)| Curve { class, points: points.clone() }).into()
    }

    /// The ends of the promised and the measured curve.
    fn marks(&self) -> Vec<Mark<'static>> {
        let last = |class, points: &[[f64; 2]]| points.last().map(|&at| Mark { class, at });
        [last("promised", &self.promised), last("measured", &self.measured)]
            .into_iter()
            .flatten()
            .collect()
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

/// The promised relative variance, from the time of the promise to the end. Information, the
/// reciprocal of the variance, adds up over time.
fn promised(snapshot: &Snapshot, noise: &[[f64; 2]]) -> Option<Vec<[f64; 2]>> {
    let promise = snapshot.state.promise()?;
    let then = promise.error.map(|error| error.powi(2) - snapshot.state.stop.bias2);
    let then = then.or_else(|| {
        let convergence = snapshot.state.status.convergence.as_ref()?;
        Some((promise.rms / convergence.mean_luminance).powi(2))
    })?;
    let to = [promise.seconds, then];
    let from = noise.iter().find(|[time, _]| *time >= promise.said_after);
    let line = from.map_or(Vec::new(), |from| between(*from, to));
    Some(if line.is_empty() { vec![to] } else { line })
}

/// The forecast relative variance, from now to the end.
fn forecast(snapshot: &Snapshot) -> Option<Vec<[f64; 2]>> {
    let state = snapshot.state;
    let forecast = state.status.forecast.filter(|_| snapshot.report.is_none())?;
    let noise2 = state.status.convergence.as_ref()?.relative_variance(state.stop.objective)?;
    let now = snapshot.state.earlier + state.elapsed().as_secs_f64();
    Some(between([now, noise2], [now + forecast.seconds, noise2 * forecast.left]))
}

/// Points between two points if information grows linearly with time; empty if it does not grow.
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
    fn information_grows_linearly_between_two_points() {
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
