//! Audits of images: a planted fault is found and named, and the sums do not depend on threads,
//! parts or interruptions.

use bdpm::job::{AuditReport, Shard, Verdict, thread_pool};
use bdpm::load::{Loaded, load};
use bdpm::render::audit::AuditSums;
use bdpm::settings::{Kernel, Length, PartialSettings, Strategy};
use bdpm::{RenderJob, Stop};
use std::fs;
use std::path::Path;
use std::sync::Arc;

/// A closed room whose floor lies 1 mm above the ground, with a lamp inside and the sun outside.
const SCENE: &str = r#"
[camera]
position = [-0.8, 0.5, 0.8]
target = [0.6, -0.3, -0.6]
fov_y_deg = 80
[[mesh]]
file = "shell.obj"
material = "walls"
[[mesh]]
file = "floor.obj"
material = "planks"
[[mesh]]
file = "ground.obj"
material = "soil"
[materials.walls]
albedo = 0.6
[materials.planks]
albedo = 0.6
[materials.soil]
albedo = 0.8
[environment]
radiance = 100
[[light]]
type = "sun"
direction = [-0.4, -1, -0.3]
irradiance = 1000
[[light]]
type = "point"
position = [0, 0.5, 0]
intensity = 2
"#;

/// Corners of a box of half the side `half`.
fn corners(half: f64) -> String {
    let signs = [-half, half];
    let mut text = String::new();
    for z in signs {
        for y in signs {
            for x in signs {
                text += &format!("v {x} {y} {z}\n");
            }
        }
    }
    text
}

fn thin_floor(folder: &Path) -> Loaded {
    let outer = "f 1 5 7\nf 1 7 3\nf 2 4 8\nf 2 8 6\nf 1 2 6\nf 1 6 5\nf 3 7 8\nf 3 8 4\nf 1 3 4\nf 1 4 2\nf 5 6 8\nf 5 8 7\n";
    let inner = "f 15 13 9\nf 11 15 9\nf 16 12 10\nf 14 16 10\nf 16 15 11\nf 12 16 11\nf 12 11 9\nf 10 12 9\nf 16 14 13\nf 15 16 13\n";
    let write = |name: &str, text: String| fs::write(folder.join(name), text).unwrap();
    write("shell.obj", corners(1.0) + &corners(0.999) + outer + inner);
    write("floor.obj", corners(0.999) + "f 6 2 1\nf 5 6 1\n");
    write("ground.obj", "v -4 -1 -4\nv -4 -1 4\nv 4 -1 4\nv 4 -1 -4\nf 1 2 3\nf 1 3 4\n".into());
    write("scene.toml", SCENE.into());
    load(folder).unwrap()
}

fn settings(kernel: Kernel) -> PartialSettings {
    PartialSettings {
        resolution: Some([48, 48]),
        light_paths: Some(20_000),
        camera_paths: Some(1),
        radius: Some(Length::Units(0.05)),
        caustic_radius: Some(Length::Units(0.05)),
        strategy: Some(Strategy::Single),
        merge_vertex: Some(1),
        kernel: Some(kernel),
        ..PartialSettings::default()
    }
}

fn job(loaded: &Loaded, kernel: Kernel) -> RenderJob {
    RenderJob::new(loaded).settings(settings(kernel)).audit(0.3)
}

fn audited(loaded: &Loaded, kernel: Kernel) -> AuditReport {
    let result = job(loaded, kernel).stop(Stop::iterations(40)).render().unwrap();
    result.audit.expect("the image is audited")
}

#[test]
fn leaks_through_a_thin_floor_are_found_and_the_floor_is_named() {
    let folder = tempfile::tempdir().unwrap();
    let loaded = thin_floor(folder.path());
    let leaking = audited(&loaded, Kernel::Disc);
    assert_eq!(leaking.verdict, Verdict::Differs, "{}", leaking.describe());
    let warning = leaking.warning().unwrap();
    assert!(warning.contains("`floor`") && warning.contains("`planks`"), "{warning}");
    assert!(leaking.regions[0].region.ratio > 1.1, "{warning}");
    let right = audited(&loaded, Kernel::Area);
    assert_eq!(right.verdict, Verdict::Agrees, "{:?}", right.warning());
    assert_eq!(right.not_audited, 0.0, "{}", right.describe());
}

#[test]
fn audits_at_fixed_counts_do_not_depend_on_threads_and_parts_add_up() {
    let folder = tempfile::tempdir().unwrap();
    let loaded = thin_floor(folder.path());
    let run = |threads, part: Option<&str>| -> AuditSums {
        let job = job(&loaded, Kernel::Area).threads(Arc::new(thread_pool(threads).unwrap()));
        let shard = part.map(|part| part.parse::<Shard>().unwrap());
        let result = job.shard(shard).stop(Stop::iterations(12)).render().unwrap();
        result.state.checkpoint().audit.expect("checkpoints keep the audit")
    };
    let whole = run(1, None);
    assert!(whole.traced[0].iterations > 3 && whole.traced[0] != whole.traced[1]);
    assert_eq!(whole, run(2, None));
    let mut parts = run(2, Some("1/2"));
    assert_ne!(parts, whole);
    parts.merge(&run(1, Some("2/2")));
    for (own, all) in parts.traced.iter().zip(&whole.traced) {
        assert_eq!(own.iterations, all.iterations);
        let pairs = own.sums.iter().zip(&all.sums);
        assert!(pairs.into_iter().all(|(a, b)| (a - b).abs() <= 1e-12 * b.abs()));
    }
}

#[test]
fn images_with_fixed_counts_and_images_by_path_tracing_have_no_audit_unless_asked() {
    let folder = tempfile::tempdir().unwrap();
    let loaded = thin_floor(folder.path());
    let render = |job: RenderJob| job.stop(Stop::iterations(2)).render().unwrap();
    let plain = RenderJob::new(&loaded).settings(settings(Kernel::Area));
    let unasked = render(plain.clone());
    assert!(unasked.audit.is_none() && unasked.state.audit.is_none());
    // The image is that of an audited render.
    assert_eq!(unasked.image, render(plain.audit(0.5)).image);
    let path = PartialSettings { strategy: Some(Strategy::Path), ..settings(Kernel::Area) };
    assert!(render(RenderJob::new(&loaded).settings(path).audit(0.5)).audit.is_none());
}
