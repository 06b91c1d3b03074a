//! How time and memory grow with the numbers of light paths, pixels and triangles, and whether the
//! time model predicts so.
//!
//! ```sh
//! cargo run --release --example growth_table
//! ```
//!
//! The model is fitted as `bdpm calibrate` does it for 64x64 pixels, that is with 10,000 light
//! paths at most: all else is extrapolation. Each table comes from a process of its own, and alone
//! if its name is given (`light-paths`, `pixels`, `triangles` or `memory`). Only Linux reports peak
//! memory.

use bdpm::accel::Intersect;
use bdpm::load::{Loaded, load};
use bdpm::noise::Measure;
use bdpm::scene::backend::{Backend, build};
use bdpm::scene::bsdf::Bsdf;
use bdpm::scene::{Camera, Emitter, FieldOfView, Material, Mesh, Triangle};
use bdpm::settings::{Length, PartialSettings};
use bdpm::timing::TimeModel;
use bdpm::timing::fit::fit;
use bdpm::timing::measure::{Phase, Recorder, SampleSize, TimeSample, sizes};
use bdpm::{Renderer, Scene, Settings};
use glam::Vec3;
use std::path::Path;
use std::process::Command;
use std::sync::Arc;
use std::time::{Duration, Instant};

type Result<T> = std::result::Result<T, Box<dyn std::error::Error>>;

const TABLES: [&str; 4] = ["light-paths", "pixels", "triangles", "memory"];
/// Rendered at all counts.
const SCENE: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/scenes/cornell-box");
/// Width and height of the images that the model is fitted to.
const SIDE: u32 = 64;
/// Rounds in which every size has its turn: a machine that slows down does so for all of them.
const ROUNDS: usize = 5;
/// A turn takes at least one iteration and this long.
const TURN: Duration = Duration::from_millis(300);
/// Squares along each side of the hilly ground, of two triangles each: 10^2 to 10^7.
const GROUNDS: [usize; 6] = [7, 22, 71, 224, 707, 2236];
const GIB: f64 = (1u64 << 30) as f64;
/// Limit for 3840x2160 pixels with a million light paths, bytes.
const MOST_MEMORY: f64 = 4.0 * GIB;

/// Iterations at one size.
struct Run {
    renderer: Renderer,
    recorder: Recorder,
    size: SampleSize,
    side: u32,
}

impl Run {
    /// Renders an iteration that is not counted: it meets cold memory.
    fn new(scene: &Arc<Scene>, accel: &Arc<dyn Intersect>, settings: Settings) -> Result<Self> {
        let Settings { light_paths, camera_paths, width: side, .. } = settings;
        let mut renderer = Renderer::new(scene, accel, settings)?;
        renderer.iterate(Measure::Off);
        let recorder = Recorder::new(rayon::current_num_threads());
        Ok(Self { renderer, recorder, size: SampleSize { light_paths, camera_paths }, side })
    }

    fn take_turn(&mut self) {
        let (start, SampleSize { light_paths, camera_paths }) = (Instant::now(), self.size);
        loop {
            let times = self.renderer.iterate(Measure::Off).times;
            self.recorder.add(light_paths.into(), camera_paths.into(), &times);
            if start.elapsed() > TURN {
                break;
            }
        }
    }

    /// Median seconds of an iteration that this phase takes, as a share of the wall-clock time.
    fn seconds(&self, phase: Phase) -> f64 {
        self.recorder.samples()[phase as usize].seconds
    }

    /// Measured times over those of `model`: light paths, camera paths, merging, and all together.
    fn over(&self, model: TimeModel) -> [f64; 4] {
        let model = TimeModel { pixels: f64::from(self.side).powi(2), ..model };
        let SampleSize { light_paths, camera_paths } = self.size;
        let [_, light, camera, merge] = model.parts(light_paths.into(), camera_paths.into());
        let iteration = model.iteration(light_paths.into(), camera_paths.into());
        let measured = Phase::ALL.map(|phase| self.seconds(phase));
        let all = measured.iter().sum::<f64>() / iteration;
        [measured[0] / light, measured[1] / camera, measured[2] / merge, all]
    }
}

fn take_turns(runs: &mut [Run]) {
    (0..ROUNDS).for_each(|_| runs.iter_mut().for_each(Run::take_turn));
}

fn settings(loaded: &Loaded, resolution: [u32; 2], size: SampleSize) -> bdpm::Result<Settings> {
    let wishes = PartialSettings {
        resolution: Some(resolution),
        light_paths: Some(size.light_paths),
        camera_paths: Some(size.camera_paths),
        ..PartialSettings::default()
    };
    Settings::resolve(&wishes, &loaded.defaults, loaded.scene.size())
}

/// Shows `print` the model and the runs of one camera path per pixel: those of the calibration and
/// `others`, images of so many pixels along each side and light paths.
fn measure(others: &[(u32, u32)], print: impl Fn(&Run, TimeModel)) -> Result<()> {
    let loaded = load(Path::new(SCENE))?;
    let accel = build(Backend::default(), &loaded.scene)?;
    let pixels = SIDE * SIDE;
    let small = sizes(pixels as usize);
    let other = |&(side, light_paths)| (side, SampleSize { light_paths, camera_paths: 1 });
    let all = small.iter().map(|&size| (SIDE, size)).chain(others.iter().map(other));
    let run =
        |(side, size)| Run::new(&loaded.scene, &accel, settings(&loaded, [side, side], size)?);
    let mut runs = all.map(run).collect::<Result<Vec<_>>>()?;
    take_turns(&mut runs);
    let samples = runs[..small.len()].iter().flat_map(|run| run.recorder.samples());
    let model = fit(&samples.collect::<Vec<TimeSample>>(), pixels.into())?.model;
    runs.iter().filter(|run| run.size.camera_paths == 1).for_each(|run| print(run, model));
    Ok(())
}

fn light_paths() -> Result<()> {
    println!("| light paths | light | over model | merging | over model | iteration over model |");
    println!("|---|---|---|---|---|---|");
    measure(&[(SIDE, 100_000), (SIDE, 1_000_000), (SIDE, 10_000_000)], |run, model| {
        let [light, _, merge, all] = run.over(model);
        let millis = |phase| 1e3 * run.seconds(phase);
        let (own_light, own_merge) = (millis(Phase::Light), millis(Phase::Merge));
        println!(
            "| {} | {own_light:.3} ms | {light:.2} | {own_merge:.3} ms | {merge:.2} | {all:.2} |",
            run.size.light_paths
        );
    })
}

fn pixels() -> Result<()> {
    println!(
        "| pixels | light paths | camera, per path | over model | merging, per path | over model | \
         iteration over model |"
    );
    println!("|---|---|---|---|---|---|---|");
    measure(&[(256, 1000), (1024, 1000), (4096, 1000), (1024, 1_000_000)], |run, model| {
        let (side, light_paths) = (run.side, run.size.light_paths);
        let [_, camera, merge, all] = run.over(model);
        let nanos = |phase| 1e9 * run.seconds(phase) / f64::from(run.side).powi(2);
        let (own_camera, own_merge) = (nanos(Phase::Camera), nanos(Phase::Merge));
        println!(
            "| {side}x{side} | {light_paths} | {own_camera:.0} ns | {camera:.2} | \
             {own_merge:.1} ns | {merge:.2} | {all:.2} |"
        );
    })
}

/// A ground of hills, `n` by `n` squares of it.
fn ground(n: usize) -> Mesh {
    let place = |i: usize| 20.0 * i as f32 / n as f32 - 10.0;
    let vertex = |index: usize| {
        let (x, z) = (place(index % (n + 1)), place(index / (n + 1)));
        Vec3::new(x, x.sin() * z.cos(), z)
    };
    let square = |index: usize| {
        let (x, z) = (index % n, index / n);
        let corner = |x: usize, z: usize| (z * (n + 1) + x) as u32;
        let [a, b, c, d] = [corner(x, z), corner(x, z + 1), corner(x + 1, z + 1), corner(x + 1, z)];
        [[a, b, c], [a, c, d]]
    };
    let positions = (0..(n + 1).pow(2)).map(vertex).collect();
    Mesh { positions, triangles: (0..n * n).flat_map(square).collect(), ..Mesh::default() }
}

/// A wall or the ceiling of the room around the ground.
fn wall(normal: Vec3) -> Mesh {
    let (s, t) = normal.any_orthonormal_pair();
    let corner = |(a, b)| 10.0 * (a * s + b * t - normal);
    let positions = [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)].map(corner).into();
    Mesh { positions, triangles: vec![[0, 1, 2], [0, 2, 3]], ..Mesh::default() }
}

/// A scene in memory, and what it took to get there.
struct Room {
    scene: Arc<Scene>,
    accel: Arc<dyn Intersect>,
    seconds: [f64; 2],
    bytes: usize,
}

fn room(n: usize) -> Result<Room> {
    let walls = [Vec3::NEG_Y, Vec3::X, Vec3::NEG_X, Vec3::Z, Vec3::NEG_Z].map(wall);
    let meshes: Vec<Mesh> = walls.into_iter().chain([ground(n)]).collect();
    let held = |mesh: &Mesh| {
        let shading = mesh.triangles.len() * size_of::<Triangle>();
        size_of_val(&mesh.positions[..]) + size_of_val(&mesh.triangles[..]) + shading
    };
    let bytes: usize = meshes.iter().map(held).sum();
    let gray = Material::new("gray", Bsdf::diffuse(Vec3::splat(0.5)));
    let light = Emitter::Point { position: 8.0 * Vec3::Y, intensity: Vec3::ONE };
    let (from, direction) = (Vec3::new(0.0, 5.0, -9.0), Vec3::new(0.0, -0.4, 1.0));
    let camera = Camera::look(from, direction, Vec3::Y, FieldOfView::X(80.0))?;
    let start = Instant::now();
    let scene = Scene::new("room".into(), meshes, vec![gray], vec![light], camera, Vec::new())?;
    let assembly = start.elapsed().as_secs_f64();
    let accel = build(Backend::default(), &scene)?;
    let seconds = [assembly, start.elapsed().as_secs_f64() - assembly];
    let bytes = bytes + accel.describe().bytes;
    Ok(Room { scene: Arc::new(scene), accel, seconds, bytes })
}

fn triangles() -> Result<()> {
    println!("| triangles | put together | Embree | bytes of each | light path | camera path |");
    println!("|---|---|---|---|---|---|");
    let rooms: Vec<Room> = GROUNDS.into_iter().map(room).collect::<Result<_>>()?;
    let wishes = PartialSettings {
        light_paths: Some(100_000),
        camera_paths: Some(1),
        radius: Some(Length::Units(0.1)),
        ..PartialSettings::default()
    };
    let run = |room| {
        let Room { scene, accel, .. }: &Room = room;
        Run::new(scene, accel, Settings::resolve(&wishes, &wishes, scene.size())?)
    };
    let mut runs = rooms.iter().map(run).collect::<Result<Vec<_>>>()?;
    take_turns(&mut runs);
    for (room, run) in rooms.iter().zip(&runs) {
        let count = room.scene.triangle_count();
        let [assembly, embree] = room.seconds.map(|seconds| 1e3 * seconds);
        let ratio = |phase| run.seconds(phase) / runs[0].seconds(phase);
        let (light, camera) = (ratio(Phase::Light), ratio(Phase::Camera));
        let bytes = room.bytes / count;
        println!(
            "| {count} | {assembly:.2} ms | {embree:.1} ms | {bytes} | {light:.2} | {camera:.2} |"
        );
    }
    Ok(())
}

/// Most memory that this process has held, bytes.
fn peak_memory() -> Option<f64> {
    let text = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = text.lines().find_map(|line| line.strip_prefix("VmHWM:"))?;
    let kib: f64 = line.trim().strip_suffix("kB")?.trim().parse().ok()?;
    Some(1024.0 * kib)
}

/// Prints the peak after one iteration, and after another that measures.
fn peak(resolution: [u32; 2], light_paths: u32) -> Result<()> {
    let loaded = load(Path::new(SCENE))?;
    let accel = build(Backend::default(), &loaded.scene)?;
    let settings = settings(&loaded, resolution, SampleSize { light_paths, camera_paths: 1 })?;
    let mut renderer = Renderer::new(&loaded.scene, &accel, settings)?;
    for measure in [Measure::Off, Measure::Pairs] {
        renderer.iterate(measure);
        println!("{}", peak_memory().ok_or("only Linux tells the peak memory")?);
    }
    Ok(())
}

fn memory() -> Result<()> {
    println!("| pixels | light paths | peak, GiB | the same if measured |\n|---|---|---|---|");
    let mut peaks = Vec::new();
    let ([few, many], [small, large]) = ([1000, 1_000_000], [[SIDE, SIDE], [3840, 2160]]);
    for ([width, height], paths) in [(small, few), (small, many), (large, few), (large, many)] {
        let arguments = [width, height, paths].map(|number| number.to_string());
        let child = Command::new(std::env::current_exe()?).arg("peak").args(arguments).output()?;
        let text = String::from_utf8(child.stdout)?;
        let [off, on] = text.lines().collect::<Vec<_>>()[..] else { return Err("no peak".into()) };
        let (off, on): (f64, f64) = (off.parse()?, on.parse()?);
        println!("| {width}x{height} | {paths} | {:.2} | {:.2} |", off / GIB, on / GIB);
        peaks.push((off, on));
    }
    let pixels = f64::from(large[0] * large[1] - small[0] * small[1]);
    let light_path = (peaks[1].0 - peaks[0].0) / f64::from(many - few);
    let pixel = (peaks[2].0 - peaks[0].0) / pixels;
    let measured = (peaks[2].1 - peaks[0].1) / pixels;
    println!("\nBytes of a light path: {light_path:.0}");
    println!("Bytes of a pixel: {pixel:.0}, and if it is measured: {measured:.0}");
    assert!(peaks[3].1 < MOST_MEMORY, "{large:?} pixels take {} bytes", peaks[3].1);
    Ok(())
}

fn main() -> Result<()> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    match arguments.iter().map(String::as_str).collect::<Vec<_>>()[..] {
        [] => TABLES.iter().try_for_each(|table| {
            let status = Command::new(std::env::current_exe()?).arg(table).status()?;
            println!();
            status.success().then_some(()).ok_or_else(|| format!("no table of {table}").into())
        }),
        ["light-paths"] => light_paths(),
        ["pixels"] => pixels(),
        ["triangles"] => triangles(),
        ["memory"] => memory(),
        ["peak", width, height, paths] => peak([width.parse()?, height.parse()?], paths.parse()?),
        _ => Err(format!("give none or one of {}", TABLES.join(", ")).into()),
    }
}
