//! `render --view`: the packets that tev receives; a viewer that does not listen neither delays nor
//! fails a render.

use crate::common::program_output::{json, text};
use bdpm::image_io::read_exr;
use std::io::Read;
use std::net::{TcpListener, TcpStream};
use std::path::Path;
use std::process::{Command, Output, Stdio};

const SCENE: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/scenes/cornell-box");

fn render(folder: &Path, view: &str, iterations: &str) -> Output {
    let mut command = Command::new(env!("CARGO_BIN_EXE_bdpm"));
    command.current_dir(folder).args(["render", SCENE, "--accel", "bvh", "--json"]);
    command.args(["--resolution", "24x18", "--light-paths", "500", "--camera-paths", "2"]);
    command.args(["--iterations", iterations, "--output", "a.exr", view]);
    command.stdin(Stdio::null()).output().unwrap()
}

/// A packet by tev's documentation: its length including the length itself, a type, then fields.
/// Numbers are little-endian, texts end with 0.
#[derive(Debug)]
enum Packet {
    Create { name: String, size: [u32; 2], channels: Vec<String> },
    Update { name: String, channels: Vec<String>, area: [u32; 4], values: Vec<Vec<f32>> },
}

struct Fields<'a>(&'a [u8]);

impl Fields<'_> {
    fn bytes<const N: usize>(&mut self) -> [u8; N] {
        let (first, rest) = self.0.split_first_chunk().unwrap();
        self.0 = rest;
        *first
    }

    fn u32(&mut self) -> u32 {
        u32::from_le_bytes(self.bytes())
    }

    fn text(&mut self) -> String {
        let end = self.0.iter().position(|byte| *byte == 0).unwrap();
        let text = String::from_utf8(self.0[..end].to_vec()).unwrap();
        self.0 = &self.0[end + 1..];
        text
    }

    fn packet(&mut self) -> Packet {
        let [kind, _focus] = self.bytes();
        let name = self.text();
        match kind {
            4 => {
                let size = [self.u32(), self.u32()];
                let count = self.u32();
                Packet::Create { name, size, channels: (0..count).map(|_| self.text()).collect() }
            }
            6 => {
                let count = self.u32() as usize;
                let channels = (0..count).map(|_| self.text()).collect();
                let area = [(); 4].map(|()| self.u32());
                let mut list = || -> Vec<usize> {
                    (0..count).map(|_| u64::from_le_bytes(self.bytes()) as usize).collect()
                };
                let (offsets, strides) = (list(), list());
                let pixels = area[2] as usize * area[3] as usize;
                let value =
                    |at: usize| f32::from_le_bytes(self.0[4 * at..][..4].try_into().unwrap());
                let channel = |(offset, stride): (&usize, &usize)| {
                    (0..pixels).map(|pixel| value(offset + pixel * stride)).collect()
                };
                let values = offsets.iter().zip(&strides).map(channel).collect();
                let last = offsets.iter().zip(&strides).map(|(o, s)| o + (pixels - 1) * s + 1);
                assert_eq!(self.0.len(), 4 * last.max().unwrap(), "as many values as are named");
                Packet::Update { name, channels, area, values }
            }
            kind => panic!("packet of type {kind}"),
        }
    }
}

/// All packets until the program hangs up.
fn packets(mut stream: TcpStream) -> Vec<Packet> {
    let mut bytes = Vec::new();
    stream.read_to_end(&mut bytes).unwrap();
    let (mut rest, mut found) = (&bytes[..], Vec::new());
    while !rest.is_empty() {
        let length = u32::from_le_bytes(rest[..4].try_into().unwrap()) as usize;
        let (packet, after) = rest.split_at(length);
        found.push(Fields(&packet[4..]).packet());
        rest = after;
    }
    found
}

#[test]
fn tev_receives_the_image_as_it_is_written() {
    let folder = tempfile::tempdir().unwrap();
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let view = format!("--view={}", listener.local_addr().unwrap());
    let tev = std::thread::spawn(move || packets(listener.accept().unwrap().0));
    let output = render(folder.path(), &view, "30");
    assert_eq!(json(&output)["iterations"], 30);
    let mut received = tev.join().unwrap().into_iter();

    let names = ["R", "G", "B", "rms.Y"];
    let Some(Packet::Create { name, size, channels }) = received.next() else { panic!("no image") };
    assert_eq!((&name[..], size), ("a.exr", [24, 18]));
    assert_eq!(channels, names);
    let updates: Vec<Packet> = received.collect();
    assert!(updates.len() >= 2, "the first and the last");
    let Some(Packet::Update { name, channels, area, values }) = updates.last() else { panic!() };
    assert_eq!((&name[..], *area), ("a.exr", [0, 0, 24, 18]));
    assert_eq!(*channels, names);
    let image = read_exr(&folder.path().join("a.exr")).unwrap();
    for (name, values) in names.iter().zip(values) {
        let (layer, channel) = name.split_once('.').unwrap_or(("", name));
        assert_eq!(image.layer(layer).unwrap().channel(channel).unwrap(), values, "{name}");
    }
}

#[test]
fn unresponsive_viewer_fails_no_render_and_is_reported_once() {
    let folder = tempfile::tempdir().unwrap();
    let told = |output: &Output| {
        assert_eq!(json(output)["iterations"], 30);
        text(&output.stderr).matches("warning: cannot show the image in tev").count()
    };
    // Nothing listens to port 1. A port that was free a moment ago may be that of another test.
    assert_eq!(told(&render(folder.path(), "--view=127.0.0.1:1", "30")), 1);
    // A viewer that goes away at once: only the packet after the one that was lost reports it.
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let view = format!("--view={}", listener.local_addr().unwrap());
    let gone = std::thread::spawn(move || drop(listener.accept().unwrap()));
    assert!(told(&render(folder.path(), &view, "30")) <= 1);
    gone.join().unwrap();
}

#[test]
fn pictures_in_a_terminal_need_a_terminal() {
    let folder = tempfile::tempdir().unwrap();
    let output = render(folder.path(), "--view=terminal", "2");
    json(&output);
    let shown = text(&output.stderr);
    assert!(shown.contains("note: --view=terminal shows nothing") && !shown.contains('\u{2580}'));
    let output = render(folder.path(), "--view=nowhere", "2");
    assert_eq!(output.status.code(), Some(2));
    assert!(text(&output.stderr).contains("give tev's address"));
}
