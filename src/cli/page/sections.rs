//! Sections of text and numbers: progress, result, scene and settings.

use super::Snapshot;
use super::convergence::error;
use crate::cli::human_time;
use crate::cli::render_report::text;
use crate::cli::scene_input::SceneInput;
use bdpm::adaptive::error_interval::{COVERAGE, ErrorInterval};
use bdpm::adaptive::stopping::{Stop, StoppedBy, Target};
use bdpm::image_io::number;
use bdpm::job::RenderState;
use bdpm::noise::merge_bias::UPPER_BOUND;
use bdpm::report::number::count;
use bdpm::settings::Strategy;
use bdpm::settings::provenance::Provenance;
use maud::{Markup, html};

/// A share in percent, three digits.
pub fn percent(share: f64) -> String {
    format!("{}\u{202f}%", number(100.0 * share))
}

/// The scene's name and the state of the render.
pub fn heading(provenance: &Provenance, state: &str, class: &str) -> Markup {
    html! {
        h1 { (provenance.scene) " " span .state .(class) { (state) } }
    }
}

/// Progress, in a sentence and in numbers.
pub fn summary(snapshot: &Snapshot) -> Markup {
    let state = snapshot.state;
    let elapsed = state.elapsed().as_secs_f64();
    let (progress, class) = match snapshot.report.map(|report| report.run.stopped_by) {
        None => ("rendering", "running"),
        Some(StoppedBy::Interrupt) => ("stopped by Ctrl-C", "stopped"),
        Some(StoppedBy::Failure) => ("stopped by an error", "stopped"),
        Some(_) => ("done", "done"),
    };
    let (left, fraction) = state.status.time_left(&state.stop, elapsed);
    html! {
        header {
            (heading(&state.provenance, progress, class))
            p .lead { (lead(snapshot, left)) }
            @if snapshot.report.is_none() {
                progress max="1" value=(format!("{:.3}", fraction.clamp(0.0, 1.0)))
                    aria-label="part of the render that is done" {}
            }
            (tiles(snapshot))
        }
    }
}

fn lead(snapshot: &Snapshot, left: Option<f64>) -> Markup {
    let state = snapshot.state;
    let elapsed = state.elapsed().as_secs_f64();
    let now = state.status.convergence.as_ref();
    let now = now.and_then(|convergence| error(state, convergence, 1.0));
    let left = left.filter(|_| snapshot.report.is_none());
    // The picture that was asked for is the denoised one, if there is one.
    let denoised = state.denoised().map(|denoised| denoised.error.as_ref());
    let of_denoised = denoised.flatten().map(|error| percent(error.whole.relative()));
    html! {
        "After " (human_time(elapsed))
        @if let Some(error) = of_denoised {
            " the error of the denoised picture is about " b { (error) } " of "
            (error_reference(&state.stop)) "."
        } @else if denoised.is_some() {
            " the error of the denoised picture is not known."
        } @else if let Some(now) = now {
            " the error of the picture is about " b { (percent(now)) } " of "
            (error_reference(&state.stop)) "."
        } @else {
            " the error of the picture is not known yet."
        }
        @if let Some(stop) = stop_text(&state.stop) { " Target: " (stop) "." }
        @if let Some(left) = left { " About " (human_time(left)) " to go." }
    }
}

/// Quantity that errors are relative to.
pub fn error_reference(stop: &Stop) -> &'static str {
    match stop.objective {
        bdpm::adaptive::optimize::Objective::Relative => "each pixel’s brightness",
        _ => "the picture’s mean brightness",
    }
}

/// Stop conditions in words.
fn stop_text(stop: &Stop) -> Option<String> {
    let mut ends = Vec::new();
    ends.extend(stop.time.map(|time| human_time(time.as_secs_f64())));
    ends.extend(stop.iterations.map(|n| format!("{n} iterations")));
    ends.extend(stop.error.map(|error| format!("an error of {}", percent(error))));
    ends.extend(stop.target.map(|target| match target {
        Target::Share(share) => format!("an RMS of {} of the mean", percent(share)),
        Target::Absolute(rms) => format!("an RMS of {} W/(m² sr)", number(rms)),
    }));
    (!ends.is_empty()).then(|| ends.join(", or "))
}

/// The strategy of the image.
fn strategy(state: &RenderState) -> Strategy {
    state.provenance.settings.strategy
}

fn tiles(snapshot: &Snapshot) -> Markup {
    let state = snapshot.state;
    let convergence = state.status.convergence.as_ref();
    let noise2 = convergence.and_then(|s| s.relative_variance(state.stop.objective));
    let now = convergence.and_then(|convergence| error(state, convergence, 1.0));
    let forecast = convergence.zip(state.status.forecast).filter(|_| snapshot.report.is_none());
    let final_error = forecast.and_then(|(now, then)| error(state, now, then.left));
    let bias = state.stop.bias2.sqrt();
    let promised = snapshot.state.promise().and_then(|promise| {
        promise.error.or_else(|| Some(promise.rms / convergence?.mean_luminance))
    });
    let tile = |name: &str, value: String, more: Option<String>| {
        html! {
            div { dt { (name) } dd { (value) @if let Some(more) = more { span .minor { (more) } } } }
        }
    };
    let range = |interval: &ErrorInterval| {
        let ErrorInterval { low, high } = interval;
        match (high.is_finite(), *low > 0.0) {
            (true, true) => {
                format!("{}: {} to {}", percent(COVERAGE), percent(*low), percent(*high))
            }
            (true, false) => format!("{}: at most {}", percent(COVERAGE), percent(*high)),
            (false, _) => format!("at least {}", percent(*low)),
        }
    };
    let split = (bias > 0.0).then(|| {
        let noise = noise2.map_or("–".into(), |noise2| percent(noise2.sqrt()));
        format!("noise {noise}, {} {}", strategy(state).bias_name(), percent(bias))
    });
    let interval = convergence.and_then(|now| state.error_interval(now));
    let unseen = state.unseen_light().map(|own| format!("no photon has shown {}", own.describe()));
    let parts = split.into_iter().chain(interval.as_ref().map(range)).chain(unseen);
    let more = Some(parts.collect::<Vec<String>>().join("; ")).filter(|own| !own.is_empty());
    let elapsed = human_time(state.elapsed().as_secs_f64());
    let iterations = count(snapshot.image.iterations() as f64);
    let speed = state.totals.rays_per_second() / 1e6;
    html! {
        dl .tiles {
            @if let Some(denoised) = snapshot.state.denoised() {
                @let whole = denoised.error.as_ref().map(|error| error.whole);
                @let shown = whole.map_or("unknown".into(), |error| percent(error.relative()));
                (tile("error, denoised", shown, whole.map(|error| {
                    format!("at most {}", percent(error.bound(UPPER_BOUND).sqrt()))
                })))
            }
            (tile("error", now.map_or("–".into(), percent), more))
            @if let Some(error) = final_error { (tile("expected at the end", percent(error), None)) }
            @if let Some((promise, error)) = snapshot.state.promise().zip(promised) {
                (tile("promised", percent(error), Some(format!(
                    "after {} for {}{}",
                    human_time(promise.said_after),
                    human_time(promise.seconds),
                    promise.interval.as_ref().map_or(String::new(), |own| format!("; {}", range(own))),
                ))))
            }
            (tile("time", elapsed, (snapshot.state.earlier > 0.0).then(|| {
                format!("and {} in earlier runs", human_time(snapshot.state.earlier))
            })))
            (tile("iterations", iterations, Some(format!("{speed:.1} million rays a second"))))
        }
    }
}

/// The report that the program prints at the end.
pub fn outcome(snapshot: &Snapshot) -> Markup {
    html! {
        @if let Some(report) = snapshot.report {
            section {
                h2 { "Result" }
                pre { (text(report, true).trim_end()) }
            }
        }
    }
}

/// Scene, command, settings.
pub fn setup(
    input: &SceneInput,
    provenance: &Provenance,
    accel_name: Option<&str>,
    command: &str,
) -> Markup {
    let settings = &provenance.settings;
    let json = serde_json::to_string_pretty(settings).expect("plain numbers and texts");
    let names = |names: &[String]| match names {
        [] => None,
        names => Some(names.join(", ")),
    };
    let summary = &input.loaded.summary;
    let facts = [
        ("scene", Some(summary.to_string())),
        ("materials", names(&summary.materials)),
        ("lights", names(&summary.light_names)),
        ("fingerprint", Some(format!("{:016x}", provenance.fingerprint))),
        ("resolution", Some(format!("{} by {} pixels", settings.width, settings.height))),
        ("window", settings.crop.map(|crop| crop.to_string())),
        ("seed", Some(settings.seed.to_string())),
        ("program", Some(format!("bdpm {}", provenance.version))),
        ("intersections", accel_name.map(str::to_owned)),
        ("threads", Some(input.threads.current_num_threads().to_string())),
    ];
    html! {
        section {
            h2 { "Scene and settings" }
            pre { code { (command) } }
            dl {
                @for (name, value) in facts {
                    @if let Some(value) = value { dt { (name) } dd { (value) } }
                }
            }
            details #settings { summary { "All settings" } pre { code { (json) } } }
        }
    }
}
