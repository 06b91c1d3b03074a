//! Audits of images by `bdpm render`, and the judge of `bdpm compare --scene`.

use crate::common::program_output::{json, succeed};
use bdpm::image_io::{Value, read_exr, write_exr};
use std::path::Path;
use std::process::{Command, Output};

const SCENE: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/scenes/cornell-box-classic");

fn bdpm(arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_bdpm")).args(arguments).output().unwrap()
}

fn text(path: &Path) -> &str {
    path.to_str().unwrap()
}

#[test]
fn audit_is_in_the_report_and_in_the_image() {
    let folder = tempfile::tempdir().unwrap();
    let image = folder.path().join("a.exr");
    let render = |more: &[&str]| {
        let fixed = ["render", SCENE, "--accel", "bvh", "--resolution", "48x48", "--json"];
        let chosen = ["--strategy", "single", "--output", text(&image)];
        bdpm(&[&fixed[..], &chosen, more].concat())
    };
    // Counts are fixed where a verdict is expected: what an audit of some seconds finds depends
    // on how many paths the machine computes in them.
    let many = ["--iterations", "200", "--light-paths", "2000", "--camera-paths", "1"];
    let report = json(&render(&[&many[..], &["--audit", "20%"]].concat()));
    let audit = &report["audit"];
    assert_eq!(audit["verdict"], "agrees", "{audit}");
    assert!(audit["paths"].as_f64().unwrap() > 1000.0 && audit["not_audited"] == 0.0, "{audit}");
    let scales = audit["scales"].as_array().unwrap();
    assert!(scales.len() >= 3 && scales[0]["side"] == 2, "{audit}");
    let attributes = read_exr(&image).unwrap().metadata;
    assert_eq!(attributes["audit"], Value::Text("agrees".into()));

    assert!(json(&render(&["--time", "2s"]))["audit"]["paths"].as_f64().unwrap() > 0.0);
    assert!(json(&render(&["--time", "1s", "--audit", "0"]))["audit"].is_null());
    assert!(!read_exr(&image).unwrap().metadata.contains_key("audit"));
    let fixed = ["--iterations", "8", "--light-paths", "1000", "--camera-paths", "1"];
    assert!(json(&render(&fixed))["audit"].is_null());
    let asked = json(&render(&[&fixed[..], &["--audit", "50%"]].concat()));
    assert!(asked["audit"]["paths"].as_f64().unwrap() > 0.0, "{asked}");
    let refused = render(&["--audit", "60%"]);
    let shown = String::from_utf8(refused.stderr).unwrap();
    assert!(!refused.status.success() && shown.contains("at most 50%"), "{shown}");
}

/// Path tracing hardly finds the sun behind a pane: there is no audit, and the report says why.
#[test]
fn a_sun_behind_glass_is_the_reason_without_an_audit() {
    let folder = tempfile::tempdir().unwrap();
    let write = |name: &str, text: &str| std::fs::write(folder.path().join(name), text).unwrap();
    write("pane.obj", "v -1 0 0\nv 1 0 0\nv 1 2 0\nv -1 2 0\nf 1 2 3\nf 1 3 4\n");
    write("floor.obj", "v -3 0 -3\nv -3 0 3\nv 3 0 3\nv 3 0 -3\nf 1 2 3\nf 1 3 4\n");
    write(
        "scene.toml",
        "[camera]\nposition = [0, 1, 4]\ntarget = [0, 1, 0]\nfov_x_deg = 60\n\
         [[mesh]]\nfile = 'pane.obj'\nmaterial = 'pane'\n\
         [[mesh]]\nfile = 'floor.obj'\nmaterial = 'floor'\n\
         [materials.pane]\ntype = 'thin-dielectric'\nior = 1.5\n\
         [materials.floor]\ntype = 'lambertian'\nalbedo = 0.5\n\
         [sky]\nsun_direction = [-0.7, 0.6, 0.2]\n",
    );
    let image = folder.path().join("a.exr");
    let render = |scene: &str, more: &[&str]| {
        let fixed = ["render", scene, "--accel", "bvh", "--resolution", "48x48", "--time", "1s"];
        bdpm(&[&fixed[..], &["--strategy", "mis", "--output", text(&image)], more].concat())
    };
    let scene = text(folder.path());
    let report = json(&render(scene, &["--json"]));
    assert!(report["audit"].is_null(), "{report}");
    assert!(report["without_audit"].as_str().unwrap().contains("small sun"), "{report}");
    let shown = render(scene, &[]);
    succeed(&shown);
    let all = [shown.stdout, shown.stderr].concat();
    assert!(String::from_utf8(all).unwrap().contains("not audited: a small sun"));
    assert!(json(&render(SCENE, &["--json"]))["without_audit"].is_null());
}

/// Path tracing cannot find the light of a point through glass: its image lacks it, and says so.
#[test]
fn light_that_was_never_seen_opens_the_interval_of_the_error() {
    let folder = tempfile::tempdir().unwrap();
    let image = folder.path().join("a.exr");
    let scene = concat!(env!("CARGO_MANIFEST_DIR"), "/scenes/point-caustic");
    let fixed = ["render", scene, "--accel", "bvh", "--resolution", "32x32", "--iterations", "16"];
    // Renders at given counts state an error if one could end them.
    let counts = ["--camera-paths", "4", "--target-error", "0.1%", "--output", text(&image)];
    let render = |strategy: &str, light_paths: &str, more: &[&str]| {
        let own = ["--strategy", strategy, "--light-paths", light_paths];
        bdpm(&[&fixed[..], &counts, &own, more].concat())
    };
    let path = json(&render("path", "2", &["--json"]));
    assert!(path["unseen_light"].as_str().unwrap().contains("by way of"), "{path}");
    let interval = &path["error"]["interval"];
    assert!(interval["low"].as_f64().unwrap() > 0.0 && interval["high"].is_null(), "{path}");
    let page = folder.path().join("a.html");
    let shown = render("path", "2", &["--report", text(&page)]);
    succeed(&shown);
    let page = std::fs::read_to_string(page).unwrap();
    assert!(page.contains("at least") && page.contains("no photon has shown light of"), "{page}");
    let all = String::from_utf8([shown.stdout, shown.stderr].concat()).unwrap();
    assert!(all.contains("no photon has shown any light of") && all.contains("(at least"), "{all}");
    let merged = json(&render("single", "4000", &["--json"]));
    assert!(merged["unseen_light"].is_null(), "{merged}");
}

#[test]
fn judge_tells_a_brighter_image_from_a_right_one() {
    let folder = tempfile::tempdir().unwrap();
    let [first, second, bright] = ["a.exr", "b.exr", "c.exr"].map(|name| folder.path().join(name));
    for (path, seed) in [(&first, "1"), (&second, "2")] {
        let fixed = ["render", SCENE, "--accel", "bvh", "--strategy", "path", "--quiet"];
        let counts = ["--iterations", "32", "--light-paths", "2", "--camera-paths", "4"];
        let own = ["--resolution", "48x48", "--seed", seed, "--output", text(path)];
        succeed(&bdpm(&[&fixed[..], &counts, &own].concat()));
    }
    let mut image = read_exr(&first).unwrap();
    for (_, values) in image.layers.iter_mut().flat_map(|layer| &mut layer.channels) {
        values.iter_mut().for_each(|value| *value *= 1.2);
    }
    write_exr(&bright, &image).unwrap();
    let judge = |images: &[&Path]| {
        let images: Vec<&str> = images.iter().map(|path| text(path)).collect();
        let own = ["--scene", SCENE, "--time", "2s", "--json"];
        json(&bdpm(&[&["compare"][..], &images, &own].concat()))
    };
    let right = judge(&[&first, &second]);
    let [ratio, error] = ["ratio", "error"].map(|name| right["mean"][name].as_f64().unwrap());
    assert!((ratio - 1.0).abs() < 6.0 * error && right["noise"] == "two-images", "{right}");
    let wrong = judge(&[&bright]);
    assert!(wrong["verdict"] == "wrong" && wrong["noise"] == "neighbors", "{wrong}");
    assert!((wrong["factor"].as_f64().unwrap() - 1.2).abs() < 0.05, "{wrong}");
    let lacking = bdpm(&["compare", text(&first)]);
    assert!(!lacking.status.success(), "without --scene there is a second image");
}
