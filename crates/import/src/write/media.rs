//! `[media.NAME]`, and the keys that name media.

use super::numbers::{color, number};
use bdpm_core::base::names::{Names, for_line};
use bdpm_core::scene::{Medium, MediumBoundary, Scene};
use std::fmt::Write;
use std::sync::Arc;

/// All media, with unique names.
pub(super) struct MediumTables<'a> {
    media: &'a [Arc<Medium>],
    names: Vec<String>,
}

impl<'a> MediumTables<'a> {
    pub fn new(scene: &'a Scene) -> Self {
        let media = scene.media().map_or(&[][..], |media| media.media());
        let mut names = Names::default();
        let name = |medium: &Arc<Medium>| names.unique(for_line(&medium.name, "medium"));
        Self { media, names: media.iter().map(name).collect() }
    }

    /// A line `KEY = "NAME"`, or nothing without a medium.
    pub fn key(&self, key: &str, medium: Option<&Arc<Medium>>) -> String {
        let index = medium.and_then(|medium| self.media.iter().position(|own| own == medium));
        index.map_or(String::new(), |index| format!("{key} = \"{}\"\n", self.names[index]))
    }

    /// The keys of the media on both sides of a material.
    pub fn keys(&self, boundary: Option<&MediumBoundary>) -> String {
        let Some(MediumBoundary { interior, exterior }) = boundary else { return String::new() };
        self.key("interior", interior.as_ref()) + &self.key("exterior", exterior.as_ref())
    }

    /// All tables.
    pub fn tables(&self) -> String {
        let mut text = String::new();
        for (medium, name) in self.media.iter().zip(&self.names) {
            let Medium { absorption, scattering, asymmetry, priority, .. } = **medium;
            let _ = write!(text, "\n[media.\"{name}\"]\nabsorption = {}\n", color(absorption));
            if medium.scatters() {
                let _ = writeln!(text, "scattering = {}", color(scattering));
            }
            if asymmetry != 0.0 {
                let _ = writeln!(text, "asymmetry = {}", number(asymmetry));
            }
            if priority != 0 {
                let _ = writeln!(text, "priority = {priority}");
            }
        }
        text
    }
}
