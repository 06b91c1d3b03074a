//! A folder where the program renders.

use bdpm::image_io::read_exr;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use tempfile::TempDir;

pub struct Desk(TempDir);

impl Desk {
    pub fn new() -> Self {
        Self(tempfile::tempdir().unwrap())
    }

    pub fn path(&self) -> &Path {
        self.0.path()
    }

    pub fn at(&self, name: &str) -> PathBuf {
        self.path().join(name)
    }

    /// A program that runs here, without input.
    pub fn program(&self, name: &str) -> Command {
        let mut command = Command::new(name);
        command.current_dir(self.path()).stdin(Stdio::null());
        command
    }

    /// Every channel of a layer of an image.
    pub fn values(&self, name: &str, layer: &str) -> Vec<f32> {
        let image = read_exr(&self.at(name)).unwrap();
        let channels = &image.layer(layer).unwrap().channels;
        channels.iter().flat_map(|(_, values)| values.clone()).collect()
    }

    /// That two images differ in the last place at most.
    #[track_caller]
    pub fn assert_same_image(&self, one: &str, other: &str) {
        for (a, b) in self.values(one, "").iter().zip(self.values(other, "")) {
            assert!(a.to_bits().abs_diff(b.to_bits()) <= 1, "{a} {b}");
        }
    }
}
