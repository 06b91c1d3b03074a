//! `bdpm info SCENE`, or of an image: [`image_info`].

use super::image_info;
use super::settings_args::with_chosen_default;
use super::verbose::given_names;
use super::{SceneArgs, human_time, json, print_notes};
use bdpm::accel::AccelInfo;
use bdpm::base::error::Result;
use bdpm::import::Warning;
use bdpm::load::counted;
use bdpm::load::{Loaded, SceneSummary};
use bdpm::scene::backend;
use bdpm::scene::{Emitter, Extent, FieldOfView, Optics};
use bdpm::settings::{PartialSettings, Settings};
use serde::Serialize;
use std::collections::{BTreeSet, HashMap};
use std::fmt::Write;
use std::time::{Duration, Instant};

#[derive(clap::Args)]
#[command(mut_args(with_chosen_default))]
#[command(mut_arg("scene", |arg| arg.value_name("SCENE|IMAGE").help(
    "Read a scene, as `bdpm render` does, or an .exr image"
)))]
pub struct Args {
    #[command(flatten)]
    scene: SceneArgs,
}

#[derive(Serialize)]
struct InfoReport<'a> {
    scene: &'a str,
    fingerprint: String,
    /// Meshes and triangles, counted once per instance.
    meshes: usize,
    triangles: usize,
    /// Meshes and triangles in memory, where instances share them.
    stored_meshes: usize,
    stored_triangles: usize,
    materials: usize,
    read: &'a SceneSummary,
    #[serde(rename = "notes")]
    warnings: &'a [Warning],
    /// Times to read the files, and to build the triangles and lights.
    read_seconds: f64,
    assembly_seconds: f64,
    /// Point of the file's coordinates that is the origin of the scene, scene units.
    origin: [f64; 3],
    /// Lower and upper corner in the file's coordinates, scene units.
    bounds: [[f64; 3]; 2],
    size: f32,
    accel: AccelSummary<'a>,
    lights: LightSummary,
    /// Names of the light sources, for `--lights`.
    light_sources: Vec<String>,
    camera: CameraSummary,
    regions: Vec<&'a str>,
    settings: &'a Settings,
}

#[derive(Serialize)]
struct AccelSummary<'a> {
    name: &'a str,
    packet_size: usize,
    triangles: usize,
    bytes: usize,
    build_seconds: f64,
}

#[derive(Serialize)]
struct LightSummary {
    points: usize,
    spots: usize,
    suns: usize,
    luminaires: usize,
    triangles: usize,
    environment: bool,
    /// Radiant power per channel, W.
    power: [f32; 3],
}

impl LightSummary {
    fn text(&self) -> String {
        let all = [
            (self.points, "point"),
            (self.spots, "spot"),
            (self.suns, "sun"),
            (self.luminaires, "luminaire"),
            (self.triangles, "triangle"),
        ];
        let some = all.into_iter().filter(|(count, _)| *count > 0);
        let mut names: Vec<_> = some.map(|(count, noun)| counted(count, noun)).collect();
        if self.environment {
            names.push("environment".into());
        }
        names.join(", ")
    }
}

#[derive(Serialize)]
struct CameraSummary {
    position: [f64; 3],
    direction: [f32; 3],
    up: [f32; 3],
    #[serde(flatten)]
    optics: OpticsSummary,
}

/// Camera optics: angles in degrees across the width or height of the image, lengths in scene
/// units, times in seconds.
#[derive(Serialize)]
#[serde(tag = "type", rename_all = "kebab-case")]
enum OpticsSummary {
    Pinhole { field_of_view: f32, across: &'static str },
    ThinLens { field_of_view: f32, across: &'static str, aperture_radius: f32, focus_distance: f32 },
    Sensor { sensor_width: f32, disc_distance: f32, disc_radius: f32, exposure: f32 },
    Orthographic { extent: f32, across: &'static str },
    Panorama,
    Fisheye { projection: &'static str, field_of_view: f32 },
}

impl OpticsSummary {
    fn new(optics: Optics) -> Self {
        let angle = |field_of_view| match field_of_view {
            FieldOfView::X(degrees) => (degrees, "width"),
            FieldOfView::Y(degrees) => (degrees, "height"),
        };
        match optics {
            Optics::Pinhole(field_of_view) => {
                let (field_of_view, across) = angle(field_of_view);
                Self::Pinhole { field_of_view, across }
            }
            Optics::ThinLens { field_of_view, aperture_radius, focus_distance } => {
                let (field_of_view, across) = angle(field_of_view);
                Self::ThinLens { field_of_view, across, aperture_radius, focus_distance }
            }
            Optics::Sensor { width, disc_distance, disc_radius, exposure } => {
                Self::Sensor { sensor_width: width, disc_distance, disc_radius, exposure }
            }
            Optics::Orthographic(extent) => {
                let (extent, across) = match extent {
                    Extent::X(width) => (width, "width"),
                    Extent::Y(height) => (height, "height"),
                };
                Self::Orthographic { extent, across }
            }
            Optics::Panorama => Self::Panorama,
            Optics::Fisheye { projection, field_of_view } => {
                Self::Fisheye { projection: projection.name(), field_of_view }
            }
        }
    }

    fn text(&self) -> String {
        match self {
            Self::Pinhole { field_of_view, across } => {
                format!("pinhole, {field_of_view} degrees across the {across}")
            }
            Self::ThinLens { field_of_view, across, aperture_radius, focus_distance } => format!(
                "thin lens of radius {aperture_radius}, focused at {focus_distance}, {field_of_view} \
                 degrees across the {across}"
            ),
            Self::Sensor { sensor_width, disc_distance, disc_radius, exposure } => format!(
                "sensor {sensor_width} wide behind a disc of radius {disc_radius} at \
                 {disc_distance}, exposed for {exposure} s: values are J/m^2"
            ),
            Self::Orthographic { extent, across } => {
                format!("orthographic, {extent} across the {across}")
            }
            Self::Panorama => "panorama of all directions".to_owned(),
            Self::Fisheye { projection, field_of_view } => {
                format!("{projection} fisheye, {field_of_view} degrees across the image circle")
            }
        }
    }
}

pub fn run(args: &Args) -> Result<String> {
    let SceneArgs { scene: path, json: as_json, .. } = &args.scene;
    if image_info::is_image(path) {
        args.scene.require_no_option()?;
        return image_info::run(path, *as_json);
    }
    let start = Instant::now();
    let loaded = args.scene.load()?;
    let loading = start.elapsed();
    print_notes(&loaded.warnings);
    let scene = &loaded.scene;
    let settings =
        Settings::resolve(&(&args.scene.settings).into(), &loaded.defaults, scene.size())?;
    let accel = backend::build(args.scene.accel.unwrap_or_default(), scene)?.describe();
    let report = InfoReport::new(&loaded, loading, &accel, &settings);
    let fixed = fixed_names(&(&args.scene.settings).into());
    Ok(if args.scene.json { json(&report) } else { text(&report, &fixed) })
}

impl<'a> InfoReport<'a> {
    fn new(
        loaded: &'a Loaded,
        loading: Duration,
        accel: &'a AccelInfo,
        settings: &'a Settings,
    ) -> Self {
        let scene = &loaded.scene;
        let emitters = scene.lights().emitters();
        let count = |of: fn(&Emitter) -> bool| emitters.iter().filter(|e| of(e)).count();
        Self {
            scene: &scene.name,
            fingerprint: format!("{:016x}", scene.fingerprint()),
            meshes: scene.placements().len(),
            triangles: scene.triangle_count(),
            stored_meshes: scene.meshes().len(),
            stored_triangles: scene.stored_triangle_count(),
            materials: scene.materials().len(),
            read: &loaded.summary,
            warnings: &loaded.warnings,
            read_seconds: loading.saturating_sub(loaded.assembly).as_secs_f64(),
            assembly_seconds: loaded.assembly.as_secs_f64(),
            origin: scene.file_origin().to_array(),
            bounds: [scene.bounds().min, scene.bounds().max]
                .map(|corner| scene.in_file(corner).to_array()),
            size: scene.size(),
            accel: AccelSummary {
                name: &accel.name,
                packet_size: accel.packet_size,
                triangles: accel.triangles,
                bytes: accel.bytes,
                build_seconds: accel.build_time.as_secs_f64(),
            },
            lights: LightSummary {
                points: count(|e| matches!(e, Emitter::Point { .. })),
                spots: count(|e| matches!(e, Emitter::Spot(_))),
                suns: count(|e| matches!(e, Emitter::Directional(_))),
                luminaires: count(|e| matches!(e, Emitter::Luminaire(_) | Emitter::Opening(_))),
                triangles: count(|e| matches!(e, Emitter::Triangle { .. } | Emitter::Textured(_))),
                environment: scene.lights().environment().is_some(),
                power: scene.lights().power().to_array(),
            },
            light_sources: scene.light_sources().into_iter().map(|(_, name)| name).collect(),
            camera: CameraSummary {
                position: scene.in_file(scene.camera.position()).to_array(),
                direction: scene.camera.direction().to_array(),
                up: scene.camera.up().to_array(),
                optics: OpticsSummary::new(scene.camera.optics()),
            },
            regions: scene.regions.iter().map(|region| &region.name[..]).collect(),
            settings,
        }
    }
}

/// Names of the settings that automatic rendering does not choose, because the command line fixes
/// them or a pilot never does.
fn fixed_names(command_line: &PartialSettings) -> BTreeSet<String> {
    let mut names = given_names(command_line);
    names.extend(["width", "height", "seed"].map(str::to_owned));
    names
}

/// Rows of a name and a value.
#[derive(Default)]
struct Rows(String);

impl Rows {
    fn add(&mut self, name: &str, value: String) {
        writeln!(self.0, "{name:<17} {value}").expect("strings take everything");
    }

    fn add_contents(&mut self, report: &InfoReport) {
        self.add("scene", format!("{} (fingerprint {})", report.scene, report.fingerprint));
        let [triangles, meshes, materials] = [
            (report.triangles, "triangle"),
            (report.meshes, "mesh"),
            (report.materials, "material"),
        ]
        .map(|(count, noun)| counted(count, noun));
        self.add("geometry", format!("{triangles} in {meshes}, {materials}"));
        if report.stored_meshes < report.meshes {
            let held = counted(report.stored_triangles, "triangle");
            self.add("in memory", format!("{held} in {}", counted(report.stored_meshes, "mesh")));
        }
        let [read, assembly] = [report.read_seconds, report.assembly_seconds].map(short_time);
        self.add("loading", format!("read in {read}, assembled in {assembly}"));
        self.add("materials", names(&report.read.materials));
        if !report.read.dispersive_materials.is_empty() {
            self.add("dispersive", names(&report.read.dispersive_materials));
        }
        if !report.read.media.is_empty() {
            self.add("media", names(&report.read.media));
        }
        self.add("textures", report.read.textures.to_string());
        let [min, max] = report.bounds.map(numbers);
        self.add("bounds", format!("{min} to {max}, scene units"));
        self.add("scene size", format!("{} scene units", report.size));
    }

    fn add_backend(&mut self, accel: &AccelSummary) {
        self.add("backend", format!("{}, {} rays per packet", accel.name, accel.packet_size));
        let (size, time) = (accel.bytes as f64 / 1024.0, short_time(accel.build_seconds));
        self.add("hierarchy", format!("{size:.1} KiB, built in {time}"));
    }

    fn add_lights_and_camera(&mut self, report: &InfoReport) {
        let InfoReport { lights, camera, read, .. } = report;
        let power = numbers(lights.power.map(f64::from));
        self.add("lights", format!("{}, {power} W in total", lights.text()));
        self.add("light sources", names(&report.light_sources));
        let direction = camera.direction.map(f64::from);
        let (at, toward) = (numbers(camera.position), numbers(direction));
        self.add("camera", format!("at {at} toward {toward}: {}", camera.optics.text()));
        if let Some(name) = &read.camera {
            self.add("camera name", format!("{name}, of {}", names(&read.cameras)));
        }
        let regions = match &report.regions[..] {
            [] => "none".into(),
            names => names.join(", "),
        };
        self.add("regions", regions);
    }
}

/// Coordinates or channels, rounded to four decimals.
fn numbers(values: [f64; 3]) -> String {
    let [x, y, z] = values.map(|value| (value * 1e4).round() / 1e4);
    format!("({x}, {y}, {z})")
}

/// The contents of the scene, and the `fixed` settings.
fn text(report: &InfoReport, fixed: &BTreeSet<String>) -> String {
    let mut rows = Rows::default();
    rows.add_contents(report);
    rows.add_backend(&report.accel);
    rows.add_lights_and_camera(report);
    for (name, value) in report.settings.to_map() {
        if fixed.contains(&name) {
            let value = value.as_str().map_or_else(|| value.to_string(), str::to_owned);
            rows.add(&name.replace('_', " "), value);
        }
    }
    let others = "chosen by `bdpm render`, unless --iterations is given";
    rows.add("other settings", others.into());
    rows.0
}

fn short_time(seconds: f64) -> String {
    if seconds < 0.1 { format!("{:.2}ms", 1e3 * seconds) } else { human_time(seconds) }
}

/// The first names of a list, and the number of the others. Equal names are counted.
fn names(all: &[String]) -> String {
    const SHOWN: usize = 12;
    let mut counts: Vec<(&str, usize)> = Vec::new();
    let mut places = HashMap::new();
    for name in all {
        let place = *places.entry(&name[..]).or_insert_with(|| {
            counts.push((name, 0));
            counts.len() - 1
        });
        counts[place].1 += 1;
    }
    let named = |(name, count): &(&str, usize)| match count {
        1 => (*name).to_owned(),
        count => format!("{name} ({count} times)"),
    };
    let shown: Vec<_> = counts.iter().take(SHOWN).map(named).collect();
    let shown = shown.join(", ");
    match counts.len().saturating_sub(SHOWN) {
        0 => shown,
        more => format!("{shown} and {more} more"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn equal_names_are_counted_and_many_are_cut() {
        let list = |names: &[&str]| names.iter().map(|name| (*name).to_owned()).collect::<Vec<_>>();
        let found = names(&list(&["wall", "lamp", "lamp", "floor", "lamp"]));
        assert_eq!(found, "wall, lamp (3 times), floor");
        let many: Vec<String> = (0..14).map(|n| format!("m{n}")).collect();
        assert!(names(&many).ends_with("m11 and 2 more"), "{}", names(&many));
        assert_eq!(names(&[]), "");
    }
}
