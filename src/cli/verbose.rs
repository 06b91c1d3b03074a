//! `bdpm render --verbose`: settings with their origin, candidates of the pilot, and times of
//! phases.

use super::human_time;
use super::render::Args;
use super::render_report::{RenderReport, describe_counts};
use super::run_report::Seconds;
use super::scene_input::SceneInput;
use bdpm::adaptive::technique::{Candidate, FreeParameters, Selection};
use bdpm::job::{JobOutline, RenderState};
use bdpm::settings::{PartialSettings, Settings};
use serde_json::Map;
use std::collections::BTreeSet;

/// Maximum number of candidates that are listed.
const CANDIDATES: usize = 5;

/// Lines at the start of a render.
pub fn at_start(args: &Args, input: &SceneInput, state: &RenderState) -> Vec<String> {
    let [load, build] = [input.load_time, state.build_time].map(|time| time.as_secs_f64());
    let mut lines = vec![format!(
        "read the scene in {load:.3}s, built the acceleration structure in {build:.3}s"
    )];
    if let Some(selection) = &state.selection {
        lines.extend(candidates(selection));
    }
    let resolved = ResolvedSettings {
        settings: &state.provenance.settings,
        is_automatic: state.is_automatic,
        chosen: state.selection.as_ref().map(|selection| selection.open),
        is_open: false,
    };
    lines.extend(settings_by_origin(args, input, &resolved));
    lines
}

/// Lines of `--dry-run`: the settings that are known before the render, and options that do less
/// than alone.
pub fn before_render(args: &Args, input: &SceneInput, outline: &JobOutline) -> Vec<String> {
    let resolved = ResolvedSettings {
        settings: &outline.provenance.settings,
        is_automatic: outline.is_automatic,
        chosen: outline.pilot,
        is_open: true,
    };
    let mut lines = settings_by_origin(args, input, &resolved);
    lines.extend(outline.notes.iter().map(|note| format!("note: {note}")));
    lines
}

/// The best candidates of the pilot with their predicted errors.
fn candidates(selection: &Selection) -> Vec<String> {
    let listed = &selection.candidates[..CANDIDATES.min(selection.candidates.len())];
    let line = |(index, candidate): (usize, &Candidate)| {
        let [error, noise, bias] =
            [candidate.error, candidate.noise, candidate.bias].map(|share| 100.0 * share);
        let radius = match candidate.technique.strategy.has_photons() {
            true => format!(", radius {:.4}", candidate.radius),
            false => String::new(),
        };
        format!(
            "{}: {}{radius}: error {error:.2} % after {}, noise {noise:.2} %, {} {bias:.2} %{}",
            if index == 0 { "chosen" } else { "not chosen" },
            candidate.technique.describe(),
            human_time(candidate.seconds),
            candidate.technique.strategy.bias_name(),
            if candidate.tried { "" } else { " (predicted)" },
        )
    };
    listed.iter().enumerate().map(line).collect()
}

/// Settings of a job, before or after the choice of a pilot.
struct ResolvedSettings<'a> {
    settings: &'a Settings,
    /// True if the path counts are chosen during the render.
    is_automatic: bool,
    /// The parameters that a pilot chose or will choose.
    chosen: Option<FreeParameters>,
    /// True if the pilot has not chosen yet.
    is_open: bool,
}

/// One line for each origin of settings. Settings that are still to be chosen have none.
fn settings_by_origin(args: &Args, input: &SceneInput, resolved: &ResolvedSettings) -> Vec<String> {
    let ResolvedSettings { settings, is_automatic, chosen, is_open } = *resolved;
    let (of_command_line, of_file) =
        (given_names(&args.settings()), given_names(&input.loaded.defaults));
    let continued = args.resume.as_ref().or(args.plan.as_ref());
    let origin = |name: &str| match continued {
        _ if of_command_line.contains(name) => "settings of the command line".to_owned(),
        Some(file) => format!("settings of {}", file.display()),
        None if chosen.is_some_and(|open| open.includes(name)) => "settings of the pilot".into(),
        None if of_file.contains(name) => "settings of the scene file".into(),
        None => "default settings".into(),
    };
    let mut lines: Vec<(String, Vec<String>)> = Vec::new();
    for (name, value) in settings.to_map() {
        // Path counts that are chosen are reported when they are
        let is_count = ["light_paths", "camera_paths"].contains(&&name[..]);
        if is_automatic && is_count || is_open && chosen.is_some_and(|open| open.includes(&name)) {
            continue;
        }
        let value = value.as_str().map_or_else(|| value.to_string(), str::to_owned);
        let (origin, text) = (origin(&name), format!("{} {value}", name.replace('_', " ")));
        match lines.iter_mut().find(|(other, _)| *other == origin) {
            Some((_, texts)) => texts.push(text),
            None => lines.push((origin, vec![text])),
        }
    }
    lines.into_iter().map(|(origin, texts)| format!("{origin}: {}", texts.join(", "))).collect()
}

/// Names of the settings that are given.
pub fn given_names(given: &PartialSettings) -> BTreeSet<String> {
    let value = serde_json::to_value(given).expect("plain numbers and names");
    let mut names: BTreeSet<_> =
        value.as_object().into_iter().flat_map(Map::keys).cloned().collect();
    if names.remove("resolution") {
        names.extend(["width", "height"].map(str::to_owned));
    }
    if given.crop.is_some() {
        names.extend(["width", "height", "crop"].map(str::to_owned));
    }
    names
}

/// The number of an iteration, and the path counts that begin with it.
pub fn new_counts(state: &RenderState) -> String {
    let counts = describe_counts(state.renderer.block(), &state.provenance.settings);
    let elapsed = human_time(state.elapsed().as_secs_f64());
    format!("iteration {}, after {elapsed}: {counts}", state.renderer.iterations())
}

/// Lines at the end of a render: times of the phases, and the gain of the chosen path counts.
pub fn at_end(report: &RenderReport) -> Vec<String> {
    let Seconds { total, load, build, pilot, light, camera, merge, render, .. } =
        report.run.seconds;
    let Seconds { choices, audit, estimates, denoising, write, .. } = report.run.seconds;
    let all = [
        ("reading", load),
        ("building", build),
        ("rendering in total", total),
        ("pilot", pilot),
        ("iterations", render),
        ("light paths", light),
        ("camera paths", camera),
        ("merging", merge),
        ("choice of counts", choices),
        ("audit", audit),
        ("estimates", estimates),
        ("denoising", denoising),
        ("writing", write),
    ];
    let all = all.map(|(name, seconds)| format!("{name} {seconds:.3}s"));
    let mut lines = vec![format!("times: {}", all.join(", "))];
    // Path tracing has no number of light paths to choose
    if report.run.settings.shares_light()
        && let Some(promise) = &report.promise
    {
        lines.push(format!(
            "iterations of one light path and one camera path per pixel would take {:.2} times as long for the same \
             noise",
            promise.gain_over_one_each
        ));
    }
    lines
}

#[cfg(test)]
mod tests {
    use super::*;
    use bdpm::adaptive::technique::Technique;
    use bdpm::settings::{Direct, Kernel, Strategy};
    use bdpm::timing::TimeModel;

    fn candidate(error: f64, tried: bool) -> Candidate {
        let technique = Technique {
            strategy: Strategy::Mis,
            merge_vertex: 2,
            direct: Direct::Connect,
            kernel: Kernel::Area,
            splitting: 1,
            medium_query: None,
        };
        let times = TimeModel {
            fixed: 0.0,
            light_path: 1e-6,
            camera_path: 1e-6,
            look_up: 0.0,
            merge_pair: 0.0,
            pixels: 100.0,
        };
        Candidate {
            technique,
            radius: 0.1,
            caustic_radius: 0.1,
            medium_scale: 4.0,
            medium_share: 1.0,
            light_paths: 1000,
            camera_paths: 1,
            seconds: 10.0,
            error,
            noise: error,
            bias: 0.0,
            bias2_error: 0.0,
            tried,
            times,
        }
    }

    #[test]
    fn candidates_that_were_not_tried_say_so() {
        let selection = Selection {
            candidates: vec![candidate(0.132, true), candidate(0.1074, false)],
            open: FreeParameters::ALL,
            guide: None,
            seconds: 1.0,
            refuted: None,
            refuted_trials: Vec::new(),
        };
        let lines = candidates(&selection);
        assert!(lines[0].starts_with("chosen: ") && lines[0].ends_with("0.00 %"), "{lines:?}");
        assert!(lines[1].starts_with("not chosen: ") && lines[1].ends_with("(predicted)"));
    }

    #[test]
    fn names_of_given_settings_are_those_of_all_settings() {
        let given = PartialSettings {
            resolution: Some([4, 3]),
            crop: Some([0, 0, 2, 2]),
            seed: Some(1),
            ..Default::default()
        };
        let names = given_names(&given);
        assert_eq!(names.iter().collect::<Vec<_>>(), ["crop", "height", "seed", "width"]);
        assert!(names.iter().all(|name| Settings::NAMES.contains(&&name[..])));
    }
}
