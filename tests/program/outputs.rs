//! Output files replace no input, are complete, are the same every time, and are not lost because
//! another file cannot be written.

use crate::common::program_output::{assert_refused, json, succeed, text};
use bdpm::base::math::Rgb;
use bdpm::image_io::{Image, Layer, Metadata, read_exr, write_exr};
use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};
use tempfile::TempDir;

/// A square under an environment, with a texture.
const SCENE: &str = r#"
[camera]
position = [0, 0, 2]
target = [0, 0, 0]
fov_x_deg = 40

[[mesh]]
file = "square.obj"

[environment]
file = "sky.exr"

[regions]
side-walls = [[0, 0, 1, 1]]
"#;

const OBJ: &str = "mtllib square.mtl\nusemtl wood\nv -1 -1 0\nv 1 -1 0\nv 1 1 0\nv -1 1 0\n\
                   vt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\nf 1/1 2/2 3/3 4/4\n";

const SMALL: [&str; 8] =
    ["--accel", "bvh", "--resolution", "16x12", "--light-paths", "300", "--camera-paths", "2"];

struct Desk(TempDir);

impl Desk {
    /// A folder with the scene `model`, noise and times of it.
    fn new() -> Self {
        let desk = Self(tempfile::tempdir().unwrap());
        let at = |name: &str| desk.at("model").join(name);
        fs::create_dir(desk.at("model")).unwrap();
        fs::write(at("scene.toml"), SCENE).unwrap();
        fs::write(at("square.obj"), OBJ).unwrap();
        fs::write(at("square.mtl"), "newmtl wood\nmap_Kd wood.png\nmap_Ke sky.terms.png\n")
            .unwrap();
        picture(&at("wood.png"), 1, |writer| writer.write_image_data(&[200]).unwrap());
        picture(&at("sky.terms.png"), 1, |writer| writer.write_image_data(&[0]).unwrap());
        let layers = vec![Layer::rgb("", &[Rgb::ONE; 2])];
        let sky = Image { width: 2, height: 1, layers, metadata: Metadata::new() };
        write_exr(&at("sky.exr"), &sky).unwrap();
        desk
    }

    fn at(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    /// Runs it in the folder.
    fn bdpm(&self, arguments: &[&str]) -> Output {
        self.command(arguments).output().unwrap()
    }

    fn command(&self, arguments: &[&str]) -> Command {
        let mut command = Command::new(env!("CARGO_BIN_EXE_bdpm"));
        command.current_dir(self.0.path()).args(arguments).stdin(Stdio::null());
        command
    }

    fn render(&self, more: &[&str]) -> Output {
        self.bdpm(&[&["render", "model"], &SMALL[..], more].concat())
    }

    /// All files by name, but for those that begin with a dot.
    fn files(&self) -> BTreeMap<PathBuf, Vec<u8>> {
        let mut found = BTreeMap::new();
        let mut folders = vec![self.0.path().to_owned()];
        while let Some(folder) = folders.pop() {
            for entry in fs::read_dir(folder).unwrap() {
                let path = entry.unwrap().path();
                match path.is_dir() {
                    true => folders.push(path),
                    false => _ = found.insert(path.clone(), fs::read(path).unwrap()),
                }
            }
        }
        found
    }
}

/// A gray PNG file of so many pixels along each side, from another program.
fn picture(path: &Path, size: u32, fill: impl FnOnce(&mut png::Writer<fs::File>)) {
    let mut encoder = png::Encoder::new(fs::File::create(path).unwrap(), size, size);
    encoder.set_color(png::ColorType::Grayscale);
    fill(&mut encoder.write_header().unwrap());
}

#[test]
fn no_command_replaces_what_it_has_read() {
    let desk = Desk::new();
    let noise = ["--output", "noise.exr", "--iterations", "32", "--quiet"];
    succeed(&desk.bdpm(&[&["analyze", "model"], &SMALL[..], &noise].concat()));
    succeed(&desk.bdpm(&[
        "calibrate",
        "model",
        "--accel",
        "bvh",
        "--resolution",
        "16x12",
        "--output",
        "t.json",
        "--time",
        "1ms",
        "--quiet",
    ]));
    succeed(&desk.render(&[
        "--output",
        "old.exr",
        "--iterations",
        "1",
        "--checkpoint",
        "old.ckpt",
    ]));
    fs::hard_link(desk.at("model/square.mtl"), desk.at("hard.mtl")).unwrap();
    fs::hard_link(desk.at("model/sky.exr"), desk.at("hard.exr")).unwrap();
    #[cfg(unix)]
    {
        std::os::unix::fs::symlink("model", desk.at("soft")).unwrap();
        std::os::unix::fs::symlink("noise.exr", desk.at("soft.exr")).unwrap();
    }
    let before = desk.files();
    let refused = |arguments: &[&str], problem: &str| {
        let output = desk.bdpm(arguments);
        assert_refused(&output, problem, "give");
        assert!(!text(&output.stderr).contains("rendering"), "{}", text(&output.stderr));
        assert_eq!(desk.files(), before, "{arguments:?}");
    };
    let replace = "would replace a file that was read";
    let render = |more: &[&str], problem: &str| {
        let common = ["render", "model", "--accel", "bvh", "--time", "10days"];
        refused(&[&common[..], more].concat(), problem);
    };
    for to in ["model/sky.exr", "./model/../model/sky.exr", "hard.exr", "soft/sky.exr"] {
        render(&["--output", to, "--light-paths", "9"], "--output would replace");
        render(&["--output", "new.exr", "--noise", to], "--noise would replace");
    }
    for to in ["scene.toml", "square.obj", "square.mtl", "wood.png"] {
        let to = format!("model/{to}");
        render(&["--output", "new.exr", "--checkpoint", &to], "--checkpoint would replace");
    }
    render(&["--output", "new.exr", "--checkpoint", "hard.mtl"], replace);
    let full = desk.at("model/scene.toml");
    render(&["--output", "new.exr", "--checkpoint", full.to_str().unwrap()], "as model/scene.toml");
    render(&["--plan", "old.exr", "--output", "./old.exr"], replace);
    render(&["--timings", "t.json", "--output", "new.exr", "--checkpoint", "t.json"], replace);
    render(&["--resume", "old.ckpt", "--output", "new.exr", "--noise", "model/sky.exr"], replace);

    let analyze = ["analyze", "model", "--accel", "bvh", "--time", "10days", "--output"];
    refused(&[&analyze[..], &["hard.exr"]].concat(), "--output would replace");
    let pictures = ["model/sky.exr", "model/sky.EXR"];
    refused(&[&analyze[..], &pictures[..1]].concat(), replace);
    refused(&[&analyze[..], &pictures[1..]].concat(), "the picture of the terms would replace");

    let optimize = ["optimize", "noise.exr", "--timings", "t.json", "--output"];
    for to in ["noise.exr", "soft.exr"] {
        refused(&[&optimize[..], &[to]].concat(), "--output would replace");
    }
    refused(&["convert", "model", "soft", "--force"], "the copy would replace");
    let output = desk.bdpm(&["reproduce", "model", "--output", "soft"]);
    assert_refused(&output, "an input of the scene", "use another folder");
    assert_eq!(desk.files(), before);
}

#[test]
fn a_checkpoint_goes_on_in_its_own_file() {
    let desk = Desk::new();
    let part = ["--output", "a.exr", "--iterations", "2", "--checkpoint", "a.ckpt"];
    succeed(&desk.render(&part));
    let rest = ["--resume", "a.ckpt", "--checkpoint", "./a.ckpt", "--iterations", "3"];
    succeed(&desk.render(&[&rest[..], &["--output", "a.exr"]].concat()));
    let whole = ["--output", "b.exr", "--iterations", "3", "--checkpoint", "b.ckpt"];
    succeed(&desk.render(&whole));
    let files = desk.files();
    for kind in ["exr", "png", "ckpt"] {
        let [a, b] = ["a", "b"].map(|name| &files[&desk.at(&format!("{name}.{kind}"))]);
        assert!(a == b, "{kind}");
    }
}

#[test]
fn a_preview_moves_aside_for_another_picture() {
    let desk = Desk::new();
    // A texture of the model, and a picture that is never read.
    picture(&desk.at("photo.png"), 1, |writer| writer.write_image_data(&[7]).unwrap());
    let before = desk.files();
    for name in ["model/wood", "photo"] {
        let (exr, preview) = (format!("{name}.exr"), format!("{name}.preview.png"));
        for _ in 0..2 {
            let output = desk.render(&["--output", &exr, "--iterations", "1", "--json"]);
            assert_eq!(json(&output)["png"], preview);
            let note = format!("the preview is {preview}, since {name}.png is not a preview");
            assert!(text(&output.stderr).contains(&note), "{}", text(&output.stderr));
        }
        assert!(desk.at(&preview).exists());
    }
    let after = desk.files();
    assert!(before.iter().all(|(path, content)| after[path] == *content));
    assert_eq!(after.len(), before.len() + 4);

    fs::copy(desk.at("photo.png"), desk.at("photo.preview.png")).unwrap();
    let refused = desk.render(&["--output", "photo.exr", "--iterations", "1"]);
    assert_refused(
        &refused,
        "photo.png: neither this file nor photo.preview.png is a preview",
        "--output",
    );
    // A file without content, and our own, are replaced.
    fs::write(desk.at("new.png"), "").unwrap();
    for _ in 0..2 {
        let output = desk.render(&["--output", "new.exr", "--iterations", "1", "--json"]);
        assert_eq!(json(&output)["png"], "new.png");
    }
}

#[test]
fn two_outputs_are_two_files() {
    let desk = Desk::new();
    fs::create_dir(desk.at("out")).unwrap();
    for (more, problem) in [
        (["--output", "a.exr", "--noise", "out/../a.exr"], "--noise and --output are the same"),
        (["--output", "a.exr", "--checkpoint", "./a.png"], "and the preview of --output are the"),
    ] {
        assert_refused(&desk.render(&more), problem, "different names");
    }
    let plot = ["optimize", "--coefficients", "1,1,1", "--output", "a.exr", "--plot", "a.svg"];
    assert_refused(&desk.bdpm(&plot), "needs more than coefficients", "--output");
    assert_eq!(fs::read_dir(desk.at("out")).unwrap().count(), 0);
}

#[test]
fn equal_runs_give_equal_files() {
    let desk = Desk::new();
    let kinds = ["exr", "png", "n.exr", "ckpt"];
    let fixed = |name: &str| {
        let [exr, _, noise, checkpoint] = kinds.map(|kind| format!("{name}.{kind}"));
        let more = ["--output", &exr, "--noise", &noise, "--checkpoint", &checkpoint];
        succeed(&desk.render(&[&more[..], &["--iterations", "34", "--quiet"]].concat()));
        kinds.map(|kind| fs::read(desk.at(&format!("{name}.{kind}"))).unwrap())
    };
    let (first, second) = (fixed("a"), fixed("b"));
    for ((kind, a), b) in kinds.iter().zip(&first).zip(&second) {
        assert!(a == b, "{kind} files differ");
    }
    let analyze = |name: &str| {
        let more = ["--output", name, "--iterations", "32", "--quiet"];
        succeed(&desk.bdpm(&[&["analyze", "model"], &SMALL[..], &more].concat()));
        let beside = ["exr", "terms.png", "rms.png"].map(|kind| desk.at(name).with_extension(kind));
        beside.map(|path| fs::read(path).unwrap())
    };
    assert!(analyze("m.exr") == analyze("n.exr"));

    let chosen = ["--accel", "bvh", "--resolution", "16x12", "--time", "300ms", "--no-denoise"];
    let name = ["--output", "c.exr", "--quiet"];
    succeed(&desk.bdpm(&[&["render", "model"], &chosen[..], &name].concat()));
    let planned = |name: &str| {
        let plan = ["--plan", "c.exr", "--output", name, "--quiet"];
        succeed(&desk.bdpm(&[&["render", "model"], &plan[..]].concat()));
        fs::read(desk.at(name)).unwrap()
    };
    assert!(planned("d.exr") == planned("e.exr"));
    // The chosen image states its error, which plans do not estimate.
    let [chosen, planned] = ["c.exr", "d.exr"].map(|name| read_exr(&desk.at(name)).unwrap());
    assert!(planned.layers == chosen.layers);
}

#[test]
fn stale_temporary_files_are_removed() {
    let desk = Desk::new();
    fs::write(desk.at(".bdpm-a1B2c3.tmp"), "half of an image").unwrap();
    fs::write(desk.at(".bdpm-notes"), "mine").unwrap();
    succeed(&desk.render(&["--output", "a.exr", "--iterations", "1", "--quiet"]));
    let mut names: Vec<_> = desk.files().into_keys().collect();
    names.retain(|path| path.parent() == Some(desk.0.path()));
    assert_eq!(names, [".bdpm-notes", "a.exr", "a.png"].map(|name| desk.at(name)));
}

/// Runs it where no file may exceed so many KiB, as on a full disk.
#[cfg(unix)]
fn limited(desk: &Desk, kib: u32, arguments: &[&str]) -> Output {
    let mut command = Command::new("sh");
    // In units of 512 bytes
    let script = format!("ulimit -f {}; exec \"$0\" \"$@\"", 2 * kib);
    command.current_dir(desk.0.path()).args(["-c", &script, env!("CARGO_BIN_EXE_bdpm")]);
    command.args(arguments).stdin(Stdio::null()).output().unwrap()
}

#[cfg(target_os = "linux")]
#[test]
fn unwritable_file_costs_no_other_output() {
    let desk = Desk::new();
    let render = ["render", "model", "--accel", "bvh", "--resolution", "60x40", "--light-paths"];
    let counts = ["300", "--camera-paths", "2", "--iterations", "3", "--output", "a.exr"];
    let others = ["--noise", "n.exr", "--checkpoint", "a.ckpt"];
    let all = [&render[..], &counts, &others].concat();
    succeed(&desk.bdpm(&all));
    let size = |name: &str| desk.at(name).metadata().unwrap().len();
    // Shells count in units of 512 or of 1024 bytes.
    let limit = 48;
    let (small, large) = (["a.exr", "a.png"].map(size), ["a.ckpt", "n.exr"].map(size));
    assert!(small.iter().all(|size| *size < limit * 1024), "{small:?}");
    assert!(large.iter().all(|size| *size > limit * 2048), "{large:?}");
    let image = fs::read(desk.at("a.exr")).unwrap();
    for name in ["a.exr", "a.png", "a.ckpt", "n.exr"] {
        fs::remove_file(desk.at(name)).unwrap();
    }
    let output = limited(&desk, limit as u32, &all);
    let shown = text(&output.stderr);
    assert_eq!(output.status.code(), Some(1), "{shown}");
    assert!(shown.contains("written: a.exr, a.png\n"), "{shown}");
    for name in ["n.exr", "a.ckpt"] {
        assert!(shown.contains(&format!("error: {name}: cannot write: File too large")), "{shown}");
        assert!(!desk.at(name).exists());
    }
    assert!(fs::read(desk.at("a.exr")).unwrap() == image);
    assert!(desk.at("a.png").exists());
    // Nothing half written either.
    assert_eq!(fs::read_dir(desk.0.path()).unwrap().count(), 3);
}
