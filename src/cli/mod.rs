//! Subcommands, and the arguments that they share.
//!
//! Results go to stdout, with `--json` as exactly one object; all else goes to stderr.

mod analyze;
mod analyze_text;
mod calibrate;
mod compare;
mod convert;
mod daylight;
mod black_image;
mod denoise;
mod dry_run;
mod error_text;
mod glare;
mod glare_picture;
mod goniometer;
mod image_file_args;
mod image_info;
mod info;
mod interrupts;
mod layers;
mod light_groups;
mod luminance_files;
mod measure;
mod merge;
mod mix;
mod mix_page;
mod optimize;
mod option_groups;
mod option_hints;
mod optimize_plot;
mod optimize_text;
mod outputs;
mod page;
mod predict;
mod preview;
mod progress;
mod render;
mod render_files;
mod render_observer;
mod render_report;
mod room_glare;
mod run_report;
mod scene_input;
mod time_residuals;
#[cfg(feature = "paper")]
mod paper;
mod settings_args;
mod shell_files;
mod tone;
mod usage_tips;
mod verbose;
mod view;

use bdpm::base::duration::positive_time;
use bdpm::base::error::{Error, Result};
use bdpm::base::names::{is_control, visible};
use bdpm::import::{EnvironmentSource, Warning};
use bdpm::load::{CameraChange, LoadOptions, Loaded, LookAt, load_with};
use bdpm::scene::backend::Backend;
use clap::{Args, CommandFactory, FromArgMatches};
use option_groups::with_groups;
use option_hints::with_options;
use serde::Serialize;
use settings_args::SettingsArgs;
use std::ffi::OsString;
use std::io::{self, Write};
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::time::Duration;
use usage_tips::with_tip;

/// Renders scenes by bidirectional photon mapping and estimates its own noise.
#[derive(clap::Parser)]
#[command(name = "bdpm", version, arg_required_else_help = true)]
struct Cli {
    #[command(subcommand)]
    command: Command,
}

#[derive(clap::Subcommand)]
enum Command {
    /// Render a scene to an EXR image and a PNG preview beside it
    Render(Box<render::Args>),
    /// Measure illuminance and luminance at meters, with their uncertainty
    Measure(Box<measure::Args>),
    /// Measure the daylight of a year at meters: autonomy, useful illuminance, sunlight
    Daylight(Box<daylight::Args>),
    /// Merge the parts that `render --part` rendered on several machines
    Merge(merge::Args),
    /// Mix images of single light sources, each as bright as wanted
    Mix(mix::Args),
    /// Measure noise coefficients of a scene, which predict it at any path counts
    Analyze(analyze::Args),
    /// Predict the noise at other path counts from the file of `analyze`
    Predict(predict::Args),
    /// Find the path counts with the least noise after a time, also per pixel
    Optimize(optimize::Args),
    /// Measure how long the phases of an iteration take, for `--timings`
    Calibrate(calibrate::Args),
    /// Repeat the paper's experiment and compare it with the published values
    #[cfg(feature = "paper")]
    Reproduce(paper::Args),
    /// Show the contents of a scene and its settings, or what an image states about itself
    Info(info::Args),
    /// Write a scene as a folder that can be edited: TOML, OBJ and PNG files
    Convert(convert::Args),
    /// Measure the luminous intensity distribution of a luminaire's model
    Goniometer(goniometer::Args),
    /// Rate the discomfort glare of a fisheye image (DGP and UGR) or of a scene (UGR)
    Glare(glare::Args),
    /// Compare an image with a reference, or judge it by an estimate of its scene
    Compare(compare::Args),
    /// Denoise an image, guided by its albedo and normals if it has them
    Denoise(denoise::Args),
    /// Write an image as PNG with a tone curve, an exposure and a white balance
    Tone(tone::Args),
    /// Print completions for a shell
    Completions(shell_files::CompletionsArgs),
    /// Write manual pages
    Man(shell_files::ManArgs),
}

/// The command line, with options in groups.
fn definition() -> clap::Command {
    with_groups(Cli::command())
}

/// Status if a render failed after its first iteration and the image so far was written.
const PARTIAL_RESULT: u8 = 4;

/// Status if a measurement has readings that are unknown.
const UNKNOWN_READING: u8 = 3;

/// The customary status of a program that SIGINT ended.
const INTERRUPTED: u8 = 130;

/// Result of a subcommand.
#[derive(Default)]
struct Output {
    /// Printed to stdout.
    text: String,
    /// The error that left the result incomplete, if there was one.
    failure: Option<Error>,
    /// True if the failure is that readings are unknown.
    is_unknown: bool,
}

impl From<String> for Output {
    fn from(text: String) -> Self {
        Self { text, ..Self::default() }
    }
}

/// Runs the program: 0 on success, 1 on an error, 2 on wrong usage, 3 if readings are unknown, 4 if
/// the result is incomplete, 130 if an interrupt left no result.
pub fn run() -> ExitCode {
    interrupts::survive_file_size_limit();
    let arguments: Vec<OsString> = std::env::args_os().collect();
    let matches = match definition().try_get_matches_from(&arguments) {
        Ok(matches) => matches,
        Err(error) => return refuse(with_tip(error, &definition(), &arguments), &arguments),
    };
    let command = match Cli::from_arg_matches(&matches) {
        Ok(cli) => cli.command,
        Err(error) => return refuse(error, &arguments),
    };
    let output = match command {
        Command::Render(args) => render::run(*args),
        Command::Measure(args) => measure::run(&args),
        command => run_other(command).map(Output::from),
    };
    let printed = output.and_then(|output| print(&output.text).map(|()| output));
    let failure = match printed.map(|output| (output.failure, output.is_unknown)) {
        Ok((None, _)) => return ExitCode::SUCCESS,
        Ok((Some(failure), true)) => (failure, UNKNOWN_READING),
        Ok((Some(failure), false)) => (failure, PARTIAL_RESULT),
        Err(error) if error.is_interrupt() => (error, INTERRUPTED),
        Err(error) => (error, 1),
    };
    let (error, status) = failure;
    let cli = definition();
    let subcommand = matches.subcommand_name().and_then(|name| cli.find_subcommand(name));
    let shown = error.to_string();
    let shown = subcommand.map_or(shown.clone(), |command| with_options(&shown, command));
    say(&format!("error: {shown}"));
    ExitCode::from(status)
}

/// Runs any subcommand but `render` and `measure`, and returns the text to print.
fn run_other(command: Command) -> Result<String> {
    match command {
        Command::Render(_) | Command::Measure(_) => unreachable!("they have more than a text"),
        Command::Daylight(args) => daylight::run(&args),
        Command::Merge(args) => merge::run(&args),
        Command::Mix(args) => mix::run(&args),
        Command::Analyze(args) => analyze::run(&args),
        Command::Predict(args) => predict::run(&args),
        Command::Optimize(args) => optimize::run(&args),
        Command::Calibrate(args) => calibrate::run(&args),
        #[cfg(feature = "paper")]
        Command::Reproduce(args) => paper::run(args),
        Command::Info(args) => info::run(&args),
        Command::Convert(args) => convert::run(&args),
        Command::Goniometer(args) => goniometer::run(&args),
        Command::Glare(args) => glare::run(&args),
        Command::Compare(args) => compare::run(&args),
        Command::Denoise(args) => denoise::run(&args),
        Command::Tone(args) => tone::run(&args),
        Command::Completions(args) => Ok(shell_files::completions(&args, definition())),
        Command::Man(args) => shell_files::manual(&args, definition()),
    }
}

/// Shows a usage error, which quotes arguments: names of files may control the terminal. Help and
/// the version are no errors to clap's callers, but end the program in the same way.
fn refuse(error: clap::Error, arguments: &[OsString]) -> ExitCode {
    let is_hostile = |argument: &OsString| argument.to_string_lossy().contains(is_control);
    if !arguments.iter().any(is_hostile) {
        error.exit();
    }
    say(error.render().to_string().trim_end());
    ExitCode::from(error.exit_code() as u8)
}

/// The text without characters that would let names from files control the terminal.
fn harmless(text: &str) -> String {
    text.chars().map(visible).collect()
}

/// Prints to stdout. A reader that closes the pipe early is no error.
fn print(text: &str) -> Result<()> {
    let mut stdout = io::stdout().lock();
    match stdout.write_all(harmless(text).as_bytes()).and_then(|()| stdout.flush()) {
        Err(e) if e.kind() != io::ErrorKind::BrokenPipe => {
            Err(Error::io("write the result", Path::new("standard output"), e))
        }
        _ => Ok(()),
    }
}

/// Prints a line to stderr. A failure cannot be reported anywhere, so it is ignored.
fn say(line: &str) {
    let _ = writeln!(io::stderr(), "{}", harmless(line));
}

/// Prints a picture of colored characters, which control the terminal, to stderr.
fn draw(lines: &str) {
    let _ = writeln!(io::stderr(), "{lines}");
}

/// Prints warnings about a scene, for a command that cannot change how it is loaded.
fn print_plain_notes<'a>(warnings: impl IntoIterator<Item = &'a Warning>) {
    warnings.into_iter().for_each(|warning| say(&format!("note: {warning}")));
}

/// Prints warnings about a scene, with the options that their advice is about.
fn print_notes<'a>(warnings: impl IntoIterator<Item = &'a Warning>) {
    // All subcommands that have any options for loading a scene have these.
    let options = CameraArgs::augment_args(LightArgs::augment_args(clap::Command::new("")));
    for warning in warnings {
        say(&with_options(&format!("note: {warning}"), &options));
    }
}

/// One JSON object on a line. Characters that control what shows them are escaped, so that names
/// are kept.
fn json(value: &impl Serialize) -> String {
    let text = serde_json::to_string(value).expect("plain numbers and texts");
    let mut escaped = String::with_capacity(text.len() + 1);
    for c in text.chars() {
        match is_control(c) {
            // They are within strings, and of the basic plane.
            true => escaped += &format!("\\u{:04x}", u32::from(c)),
            false => escaped.push(c),
        }
    }
    escaped + "\n"
}

/// What a command prints about its result: a JSON object if that is requested, nothing with
/// `--quiet`, otherwise text.
fn reported(
    (as_json, is_quiet): (bool, bool),
    report: &impl Serialize,
    text: impl FnOnce() -> String,
) -> String {
    match (as_json, is_quiet) {
        (true, _) => json(report),
        (false, true) => String::new(),
        (false, false) => text(),
    }
}

/// Arguments for the scene and its settings.
#[derive(Clone, clap::Args)]
struct SceneArgs {
    /// Read a .toml, .gltf, .glb, .obj, .xml or .pbrt file, or a folder with scene.toml
    #[arg(value_name = "SCENE")]
    scene: PathBuf,
    /// Render with this camera of a glTF or Mitsuba file [default: the first]
    #[arg(long, value_name = "NAME")]
    camera: Option<String>,
    #[command(flatten)]
    camera_change: CameraArgs,
    /// Refuse a scene if a part of it would be skipped
    #[arg(long)]
    strict: bool,
    #[command(flatten)]
    light: LightArgs,
    #[command(flatten)]
    settings: SettingsArgs,
    /// Intersect rays by this backend [default: embree if built with it, else bvh]
    #[arg(long, value_parser = settings_args::backend())]
    accel: Option<Backend>,
    /// Print the result as one JSON object on stdout
    #[arg(long)]
    json: bool,
}

impl SceneArgs {
    /// Refuses options of scenes.
    fn require_no_option(&self) -> Result<()> {
        let Self { scene, camera, camera_change, strict, light, settings, accel, json: _ } = self;
        let has_settings = !verbose::given_names(&settings.into()).is_empty();
        let is_camera = camera.is_some() || camera_change.is_given();
        let is_other = accel.is_some() || *strict;
        if has_settings || is_camera || light.is_given() || is_other {
            let problem = "this is an image, for which only --json makes sense";
            return Err(Error::new(problem, "leave out the other options").at(scene));
        }
        Ok(())
    }

    /// Loads the scene.
    fn load(&self) -> Result<Loaded> {
        self.load_under(None)
    }

    /// Loads the scene with this environment instead of its own or that of the arguments.
    fn load_under(&self, environment: Option<&EnvironmentSource>) -> Result<Loaded> {
        let options = self.light.options(self.camera.as_deref(), self.strict);
        let (camera_change, own) = (self.camera_change.change(), options.environment);
        let environment = environment.or(own);
        load_with(&self.scene, &LoadOptions { camera_change, environment, ..options })
    }
}

/// Arguments that change the camera.
#[derive(Clone, clap::Args)]
struct CameraArgs {
    /// Move the camera: position, target and optionally up, such as 0,1,5,0,1,0
    #[arg(
        long,
        value_name = "X,Y,Z,X,Y,Z",
        allow_negative_numbers = true,
        allow_hyphen_values = true
    )]
    look_at: Option<LookAt>,
    /// Set the full opening angle, across the width or height as in the scene file
    #[arg(long, value_name = "DEGREES", allow_negative_numbers = true)]
    fov: Option<f32>,
    /// Use the camera of this scene; of a .toml file only [camera] and [render] count
    #[arg(long, value_name = "FILE")]
    camera_from: Option<PathBuf>,
}

impl CameraArgs {
    fn is_given(&self) -> bool {
        let Self { look_at, fov, camera_from } = self;
        look_at.is_some() || fov.is_some() || camera_from.is_some()
    }

    fn change(&self) -> CameraChange<'_> {
        let Self { look_at, fov, camera_from } = self;
        CameraChange { from: camera_from.as_deref(), look_at: *look_at, fov: *fov }
    }
}

/// Arguments for light that the scene file does not define.
#[derive(Clone, clap::Args)]
struct LightArgs {
    /// Replace the environment by an .exr or .hdr file, or a radiance such as 1
    #[arg(long, value_name = "FILE|RADIANCE", allow_negative_numbers = true)]
    environment: Option<EnvironmentSource>,
    /// Replace the environment by a sky with these keys of [sky], such as hour = 12
    #[arg(long, value_name = "KEYS", value_parser = EnvironmentSource::sky, conflicts_with = "environment")]
    sky: Option<EnvironmentSource>,
    /// Add no default light to a glTF or OBJ file without a usable light source
    #[arg(long)]
    no_fallback_light: bool,
    /// Let only these light sources shine, by the names that `info` shows; * stands for any
    /// characters
    #[arg(long, value_name = "NAME", value_delimiter = ',')]
    lights: Vec<String>,
}

impl LightArgs {
    fn is_given(&self) -> bool {
        let Self { environment, sky, no_fallback_light, lights } = self;
        environment.is_some() || sky.is_some() || *no_fallback_light || !lights.is_empty()
    }

    /// Options for loading a scene.
    fn options<'a>(&'a self, camera: Option<&'a str>, strict: bool) -> LoadOptions<'a> {
        let Self { environment, sky, no_fallback_light, lights } = self;
        LoadOptions {
            camera,
            strict,
            environment: environment.as_ref().or(sky.as_ref()),
            no_fallback_light: *no_fallback_light,
            camera_change: CameraChange::default(),
            lights: (!lights.is_empty()).then_some(&lights[..]),
        }
    }
}

/// A duration in words, such as `1m 5s`.
fn human_time(seconds: f64) -> String {
    if seconds < 10.0 {
        return format!("{seconds:.1}s");
    }
    humantime::format_duration(Duration::from_secs(seconds.round() as u64)).to_string()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn argument_definitions_are_consistent() {
        definition().debug_assert();
    }

    #[test]
    fn json_keeps_names_that_control_the_terminal() {
        let name = "a\u{202e}b\u{9b}c\x1bd\ne";
        let text = json(&name);
        assert!(!text.trim_end().contains(is_control), "{text:?}");
        assert_eq!(serde_json::from_str::<String>(&text).unwrap(), name);
    }

    #[test]
    fn human_time_rounds_to_seconds_above_10_seconds() {
        assert_eq!(human_time(0.25), "0.2s");
        assert_eq!(human_time(75.4), "1m 15s");
    }
}
