//! `render --report`: a page that is complete at any moment, agrees with the program, and loads
//! nothing else.

use crate::common::desk::Desk;
use crate::common::html::{assert_whole, percent, pictures};
use crate::common::program_output::{assert_refused, json, succeed, text};
use std::fs;
use std::process::{Child, Command, Output, Stdio};

const SCENE: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/scenes/cornell-box");

impl Desk {
    fn command(&self, more: &[&str]) -> Command {
        let mut command = self.program(env!("CARGO_BIN_EXE_bdpm"));
        command.args(["render", SCENE, "--accel", "bvh"]);
        command.args(["--resolution", "40x30", "--json", "--output", "a.exr"]);
        command.args(["--report", "a page.html"]).args(more);
        command
    }

    fn render(&self, more: &[&str]) -> Output {
        self.command(more).output().unwrap()
    }

    /// The page as it is, if it is there; whole at any moment.
    fn page(&self) -> Option<String> {
        let html = fs::read_to_string(self.at("a page.html")).ok()?;
        assert_whole(&html);
        Some(html)
    }

    /// The page of a render that is over.
    fn last_page(&self, state: &str) -> String {
        let html = self.page().unwrap();
        assert!(html.contains(&format!(">{state}</span>")), "{state}");
        assert!(!html.contains("data-reload") && !html.contains("http-equiv=\"refresh\""));
        let found = pictures(&html);
        assert_eq!(found[0].0, "the picture of cornell-box");
        assert!(found[0].1 == fs::read(self.at("a.png")).unwrap(), "the picture is the preview");
        html
    }
}

#[test]
fn page_of_an_automatic_render_agrees_with_the_program() {
    let desk = Desk::new();
    let output = desk.render(&["--target-error", "12%", "--threads", "2"]);
    let found = json(&output);
    assert_eq!(found["report"], "a page.html");
    let html = desk.last_page("done");
    assert!(html.contains("default-src 'none'"));
    let error = &found["error"];
    for share in ["total", "noise", "bias"].map(|name| &error[name]) {
        assert!(html.contains(&percent(share)), "{share}");
    }
    for share in ["low", "high"].map(|name| &error["interval"][name]) {
        assert!(html.contains(&percent(share)), "{share}");
    }
    let candidates = found["technique"]["candidates"].as_array().unwrap();
    assert_eq!(
        html.matches("data-label=\"error\"").count(),
        if candidates.len() > 1 { candidates.len() } else { 0 }
    );
    for candidate in candidates.iter().filter(|_| candidates.len() > 1) {
        assert!(html.contains(&percent(&candidate["error"])), "{candidate}");
    }
    let promise = &found["promise"]["error"];
    assert!(html.contains(&percent(promise)), "{promise}");
    // The measured curve, and the end of the promised one.
    assert!(
        html.contains("polyline class=\"measured\"") && html.contains("circle class=\"promised\"")
    );
    let command = "bdpm render ";
    assert!(html.contains(command) && html.contains("--report 'a page.html'"));
    for fact in ["fingerprint", "light_paths", "camera_paths", "a/(N_F N_B)", "f/N_F"] {
        assert!(html.contains(fact), "{fact}");
    }
    assert_eq!(html.matches("<img ").count(), html.matches("alt=\"").count());
    assert!(pictures(&html).iter().any(|(alt, _)| alt == "RMS noise of each pixel"));
    let shown = text(&output.stderr);
    assert!(!shown.contains("warning"), "{shown}");
}

#[test]
fn every_kind_of_render_has_a_page() {
    let desk = Desk::new();
    let counts = ["--light-paths", "500", "--camera-paths", "2", "--iterations"];
    let fixed = |more: &[&str]| {
        succeed(&desk.render(&[&counts[..], more].concat()));
        desk.last_page("done")
    };
    // A single iteration knows its noise by its own pairs of paths, but not where it is.
    let html = fixed(&["1"]);
    assert!(!html.contains("is not known yet") && html.contains("after the second iteration"));
    assert_eq!(pictures(&html).len(), 2, "the picture, and where its noise comes from");
    let html = fixed(&["40", "--checkpoint", "a.ckpt", "--objective", "pooled"]);
    assert!(html.contains("No technique was tried") && html.contains("mean brightness"));
    assert!(pictures(&html).iter().any(|(alt, _)| alt == "RMS noise of each pixel"));

    succeed(&desk.render(&["--resume", "a.ckpt", "--iterations", "44"]));
    assert!(desk.last_page("done").contains("<dd>44<"));
    fs::rename(desk.at("a.exr"), desk.at("plan.exr")).unwrap();
    succeed(&desk.render(&["--plan", "plan.exr"]));
    assert!(desk.last_page("done").contains("<dd>44<"));
    // Measured at all iterations from the 8th on, seldom: the bias of each part takes 32.
    let html = fixed(&["260"]);
    assert!(pictures(&html).iter().any(|(alt, _)| alt == "merge bias of each pixel"));
}

/// The page once it shows a picture of a render under way.
#[cfg(unix)]
fn page_under_way(desk: &Desk, child: &mut Child) -> String {
    loop {
        if let Some(html) = desk.page().filter(|html| html.contains("polyline class=\"measured\""))
        {
            return html;
        }
        assert!(child.try_wait().unwrap().is_none(), "it ended before");
        std::thread::sleep(std::time::Duration::from_millis(20));
    }
}

#[cfg(unix)]
#[test]
fn the_page_is_renewed_until_the_render_is_stopped() {
    let desk = Desk::new();
    let mut command = desk.command(&["--time", "10m", "--quiet"]);
    let mut child = command.stdout(Stdio::null()).stderr(Stdio::null()).spawn().unwrap();
    let html = page_under_way(&desk, &mut child);
    assert!(html.contains(">rendering</span>"));
    // At least 2 s; longer where a page takes long.
    let (_, reload) = html.split_once("data-reload=\"").expect("it reloads");
    let seconds: u32 = reload.split('"').next().unwrap().parse().unwrap();
    assert!(seconds >= 2, "{seconds}");
    let refresh =
        format!("<noscript><meta http-equiv=\"refresh\" content=\"{seconds}\"></noscript>");
    assert!(html.contains(&refresh));
    assert!(html.contains("<progress") && html.contains("10m"));
    let stop = format!("kill -TERM {}", child.id());
    assert!(Command::new("sh").args(["-c", &stop]).status().unwrap().success());
    assert!(child.wait().unwrap().success());
    desk.last_page("stopped by Ctrl-C");
}

#[test]
fn pages_that_cannot_be_written_are_found_before_rendering() {
    let desk = Desk::new();
    let refused = |page: &str, problem: &str, advice: &str| {
        let mut command = Command::new(env!("CARGO_BIN_EXE_bdpm"));
        command.current_dir(desk.path()).args(["render", SCENE, "--output", "a.exr"]);
        let output = command.args(["--time", "10days", "--report", page]).output().unwrap();
        assert_refused(&output, problem, advice);
    };
    refused("a.htm", "does not end in .html", "name it a.html");
    refused("no/a.html", "folder does not exist", "mkdir -p");
    fs::create_dir(desk.at("b.html")).unwrap();
    refused("b.html", "it is a folder", "name of a file");
    assert!(!desk.at("a.exr").exists());
}
