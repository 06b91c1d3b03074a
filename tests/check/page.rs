//! `bdpm render --report`: pages of a render under way and of one that is over, which
//! `make check-report` opens in a browser then.

use std::fs;
use std::io::ErrorKind;
use std::path::Path;
use std::process::{Command, Stdio};

#[test]
fn pages_during_and_after_a_render() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("out/page");
    match fs::remove_dir_all(&folder) {
        Err(error) if error.kind() != ErrorKind::NotFound => panic!("{error}"),
        _ => fs::create_dir_all(&folder).unwrap(),
    }
    let at = |name: &str| folder.join(name);
    let scene = Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes/cornell-box");
    let mut command = Command::new(env!("CARGO_BIN_EXE_bdpm"));
    command.arg("render").arg(scene).args(["--resolution", "160x120", "--time", "20s", "--quiet"]);
    command.arg("--output").arg(at("image.exr")).arg("--report").arg(at("after.html"));
    let mut child = command.stdin(Stdio::null()).spawn().unwrap();
    // Everything there is to see, the promise too.
    let is_full = |html: &String| html.contains("polyline class=\"promised\"");
    while !at("during.html").exists() {
        if let Some(html) = fs::read_to_string(at("after.html")).ok().filter(is_full) {
            assert!(html.contains("data-reload"), "it ended before");
            fs::write(at("during.html"), html).unwrap();
        }
        assert!(child.try_wait().unwrap().is_none(), "it promised nothing");
        std::thread::sleep(std::time::Duration::from_millis(50));
    }
    assert!(child.wait().unwrap().success());
    let html = fs::read_to_string(at("after.html")).unwrap();
    assert!(html.contains(">done</span>") && !html.contains("data-reload"));
}
