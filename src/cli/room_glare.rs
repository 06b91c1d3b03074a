//! `bdpm glare SCENE`: the rating straight from luminaires and room.

use super::interrupts::catch_interrupts;
use super::progress::{Progress, ProgressFormat};
use super::{json, positive_time, print_notes, say};
use bdpm::MeasureJob;
use bdpm::base::error::{Error, Result};
use bdpm::import::SCENE_EXTENSIONS;
use bdpm::job::thread_pool;
use bdpm::load::{CameraChange, LoadOptions, LookAt, load_with};
use bdpm::measurement::{Estimated, RoomGlare};
use bdpm::scene::backend::Backend;
use serde::Serialize;
use std::fmt::Write;
use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

/// Options that only scenes have.
#[derive(clap::Args)]
#[group(id = "room")]
pub struct Args {
    /// Rate a scene for about this time, such as 30 (seconds) or 2m [default: no limit]
    #[arg(long, value_name = "TIME", value_parser = positive_time)]
    time: Option<Duration>,
    /// Stop at this relative half-width of the illuminance's interval [default: 2%]
    #[arg(long, value_name = "X%", value_parser = super::render::share, allow_negative_numbers = true)]
    target_error: Option<f64>,
    /// Look from this camera of a glTF or Mitsuba file [default: the first one]
    #[arg(long, value_name = "NAME")]
    camera: Option<String>,
    /// Place the eye: position, target and optionally up, such as 0,1,5,0,1,0
    #[arg(long, value_name = "X,Y,Z,X,Y,Z", allow_hyphen_values = true)]
    look_at: Option<LookAt>,
    /// Use this many threads for a scene [default: all processors]
    #[arg(long, value_name = "T", value_parser = clap::value_parser!(u16).range(1..=1024))]
    threads: Option<u16>,
    /// Intersect rays by this backend [default: embree if built with it, else bvh]
    #[arg(long, value_parser = super::settings_args::backend())]
    accel: Option<Backend>,
    /// Show only errors and the rating
    #[arg(long, short)]
    quiet: bool,
}

impl Args {
    /// Refuses these options for an image.
    ///
    /// # Errors
    /// Names the first option that is given.
    pub fn require_none(&self) -> Result<()> {
        let given = [
            ("--time", self.time.is_some()),
            ("--target-error", self.target_error.is_some()),
            ("--camera", self.camera.is_some()),
            ("--look-at", self.look_at.is_some()),
        ];
        let Some((option, _)) = given.into_iter().find(|(_, is_given)| *is_given) else {
            return Ok(());
        };
        let problem = format!("{option} is an option for scenes, and this is an image");
        Err(Error::new(problem, "leave it out, or give a scene"))
    }
}

/// Whether a path is that of a scene.
pub fn is_scene(path: &Path) -> bool {
    let extension = path.extension().map(|own| own.to_string_lossy().to_lowercase());
    path.is_dir() || extension.is_some_and(|own| SCENE_EXTENSIONS.contains(&&own[..]))
}

#[derive(Serialize)]
struct RoomReport<'a> {
    scene: &'a str,
    luminance_unit: &'static str,
    illuminance_unit: &'static str,
    /// Probability of the intervals `value` +- `expanded`.
    probability: f64,
    #[serde(flatten)]
    glare: &'a RoomGlare,
}

/// Rates a scene.
pub fn run(path: &Path, args: &Args, is_json: bool) -> Result<String> {
    let threads = Arc::new(thread_pool(args.threads.unwrap_or(0).into())?);
    let camera_change = CameraChange { look_at: args.look_at, ..CameraChange::default() };
    let camera = args.camera.as_deref();
    let options = LoadOptions { camera, camera_change, ..LoadOptions::default() };
    let loaded = threads.install(|| load_with(path, &options))?;
    if !args.quiet {
        print_notes(&loaded.warnings);
    }
    let format = if args.quiet { ProgressFormat::Nothing } else { ProgressFormat::Text };
    let interrupted = catch_interrupts(Progress::new(format))?;
    let glare = MeasureJob::new(&loaded)
        .target(args.target_error)
        .time(args.time)
        .backend(args.accel.unwrap_or_default())
        .threads(threads)
        .interrupted_by(interrupted)
        .rate_glare()?;
    if !args.quiet {
        glare.notes.iter().for_each(|note| say(&format!("note: {note}")));
        if glare.points > 0 {
            say(&format!(
                "note: {} lights have no surface, so that they have no luminance and do not count",
                glare.points
            ));
        }
    }
    if is_json {
        return Ok(json(&RoomReport {
            scene: &loaded.scene.name,
            luminance_unit: "cd/m2",
            illuminance_unit: "lx",
            probability: 0.95,
            glare: &glare,
        }));
    }
    Ok(text(&glare))
}

fn text(glare: &RoomGlare) -> String {
    let range = |own: &Estimated| format!("{:.1} +- {:.1}", own.value, own.expanded);
    let ugr = glare.ugr.as_ref().map_or("none: no luminaire or no indirect light".into(), range);
    let eye: Estimated = (&glare.vertical_illuminance).into();
    let mut text = format!(
        "UGR  {ugr}\nvertical illuminance  {} lx\nbackground            {} cd/m2\n",
        range(&eye),
        range(&glare.background_luminance)
    );
    for own in &glare.luminaires {
        writeln!(
            text,
            "{}: {:.0} cd/m2, {:.5} sr, position index {:.2}, {:.1} lx",
            own.name, own.luminance, own.solid_angle, own.position_index, own.illuminance
        )
        .expect("strings take everything");
    }
    text
}
