//! `bdpm info SCENE`.

use super::{SceneArgs, human_time, json, say};
use bdpm::accel::AccelInfo;
use bdpm::accel::backend;
use bdpm::error::Result;
use bdpm::scene::{Emitter, FieldOfView, Scene, load::load};
use bdpm::settings::Settings;
use serde::Serialize;
use std::fmt::Write;

#[derive(clap::Args)]
pub struct Args {
    #[command(flatten)]
    scene: SceneArgs,
}

#[derive(Serialize)]
struct Report<'a> {
    scene: &'a str,
    fingerprint: String,
    meshes: usize,
    triangles: usize,
    materials: usize,
    /// Lower and upper corner, scene units.
    bounds: [[f32; 3]; 2],
    size: f32,
    accel: Accel<'a>,
    lights: Lights,
    camera: Camera,
    regions: Vec<&'a str>,
    settings: &'a Settings,
}

#[derive(Serialize)]
struct Accel<'a> {
    name: &'a str,
    packet_size: usize,
    triangles: usize,
    bytes: usize,
    build_seconds: f64,
}

#[derive(Serialize)]
struct Lights {
    points: usize,
    triangles: usize,
    /// Radiant power per channel, W.
    power: [f32; 3],
}

#[derive(Serialize)]
struct Camera {
    position: [f32; 3],
    direction: [f32; 3],
    up: [f32; 3],
    /// Full angle across the image's width or height, degrees.
    field_of_view: f32,
    across: &'static str,
}

pub fn run(args: &Args) -> Result<String> {
    let loaded = load(&args.scene.scene)?;
    loaded.notes.iter().for_each(|note| say(&format!("note: {note}")));
    let scene = &loaded.scene;
    let settings = Settings::resolve(&args.scene.wishes(), &loaded.defaults, scene.size())?;
    let accel = backend::build(args.scene.accel.unwrap_or_default(), scene)?.describe();
    let report = Report::new(scene, &accel, &settings);
    Ok(if args.scene.json { json(&report) } else { text(&report) })
}

impl<'a> Report<'a> {
    fn new(scene: &'a Scene, accel: &'a AccelInfo, settings: &'a Settings) -> Self {
        let emitters = scene.lights.emitters();
        let points = emitters.iter().filter(|e| matches!(e, Emitter::Point { .. })).count();
        let (across, field_of_view) = match scene.camera.field_of_view() {
            FieldOfView::X(degrees) => ("width", degrees),
            FieldOfView::Y(degrees) => ("height", degrees),
        };
        Self {
            scene: &scene.name,
            fingerprint: format!("{:016x}", scene.fingerprint()),
            meshes: scene.meshes.len(),
            triangles: scene.triangle_count(),
            materials: scene.materials.len(),
            bounds: [scene.bounds.min.to_array(), scene.bounds.max.to_array()],
            size: scene.size(),
            accel: Accel {
                name: &accel.name,
                packet_size: accel.packet_size,
                triangles: accel.triangles,
                bytes: accel.bytes,
                build_seconds: accel.build_time.as_secs_f64(),
            },
            lights: Lights {
                points,
                triangles: emitters.len() - points,
                power: scene.lights.power().to_array(),
            },
            camera: Camera {
                position: scene.camera.position().to_array(),
                direction: scene.camera.direction().to_array(),
                up: scene.camera.up().to_array(),
                field_of_view,
                across,
            },
            regions: scene.regions.iter().map(|region| &region.name[..]).collect(),
            settings,
        }
    }
}

fn text(report: &Report) -> String {
    let Report { bounds: [min, max], accel, lights, camera, .. } = report;
    let numbers = |values: &[f32; 3]| {
        let [x, y, z] = values.map(|value| (f64::from(value) * 1e4).round() / 1e4);
        format!("({x}, {y}, {z})")
    };
    let mut text = String::new();
    let mut row = |name: &str, value: String| {
        writeln!(text, "{name:<17} {value}").expect("strings take everything");
    };
    row("scene", format!("{} (fingerprint {})", report.scene, report.fingerprint));
    row(
        "geometry",
        format!(
            "{} in {}, {}",
            counted(report.triangles, "triangle"),
            counted(report.meshes, "mesh"),
            counted(report.materials, "material")
        ),
    );
    row("bounds", format!("{} to {}, scene units", numbers(min), numbers(max)));
    row("scene size", format!("{} scene units", report.size));
    row("backend", format!("{}, {} rays per packet", accel.name, accel.packet_size));
    row(
        "hierarchy",
        format!(
            "{:.1} KiB, built in {}",
            accel.bytes as f64 / 1024.0,
            match accel.build_seconds {
                seconds if seconds < 0.1 => format!("{:.2}ms", 1e3 * seconds),
                seconds => human_time(seconds),
            }
        ),
    );
    row(
        "lights",
        format!(
            "{} and {}, {} W in all",
            counted(lights.points, "point"),
            counted(lights.triangles, "triangle"),
            numbers(&lights.power)
        ),
    );
    row(
        "camera",
        format!(
            "at {} toward {}, {} degrees across the {}",
            numbers(&camera.position),
            numbers(&camera.direction),
            camera.field_of_view,
            camera.across
        ),
    );
    row(
        "regions",
        match &report.regions[..] {
            [] => "none".into(),
            names => names.join(", "),
        },
    );
    for (name, value) in report.settings.to_map() {
        let value = value.as_str().map_or_else(|| value.to_string(), str::to_owned);
        row(&name.replace('_', " "), value);
    }
    text
}

/// A number with its noun.
fn counted(count: usize, noun: &str) -> String {
    match (count, noun) {
        (1, noun) => format!("1 {noun}"),
        (count, "mesh") => format!("{count} meshes"),
        (count, noun) => format!("{count} {noun}s"),
    }
}
