//! Makes the images of the path tracer that tests hold the renderer against: the tables of
//! `tests/data/reference/`.
//!
//! ```sh
//! cargo run --release --example reference_tables                 # all, in an hour of one core
//! cargo run --release --example reference_tables -- box hall     # some of them
//! cargo run --release --example reference_tables -- --fingerprints   # their scenes' fingerprints
//! ```
//!
//! The last writes the fingerprints into the tables that are there: for a change of what a
//! fingerprint is, and of no scene.

#[path = "../tests/common/mod.rs"]
mod common;

use bdpm::{Scene, Settings};
use common::images::Subject;
use common::{boxes, committed, table};
use std::sync::Arc;

/// Paths in each pixel, with the name of the scene.
fn paths(name: &str) -> u32 {
    match name {
        // A path tracer seldom finds their lamps.
        "keyhole" | "hall" => 1 << 18,
        _ => 1 << 16,
    }
}

/// All scenes, with the resolution of their images.
fn subjects() -> Vec<(&'static str, Arc<Scene>, Settings)> {
    let side = boxes::SIDE;
    let boxes = boxes::all().into_iter();
    let mut all: Vec<_> =
        boxes.map(|(name, scene)| (name, scene, common::settings(side, side))).collect();
    for name in committed::TRACED {
        let (scene, settings) = committed::small(name);
        all.push((name, committed::compared(name, &scene).unwrap_or(scene), settings));
    }
    all
}

fn main() -> std::io::Result<()> {
    let wanted: Vec<String> = std::env::args().skip(1).collect();
    let subjects = subjects();
    if wanted == ["--fingerprints"] {
        return subjects.iter().try_for_each(|(name, scene, _)| table::renew(name, scene));
    }
    if let Some(name) = wanted.iter().find(|name| subjects.iter().all(|s| s.0 != *name)) {
        let names: Vec<_> = subjects.iter().map(|subject| subject.0).collect();
        eprintln!("there is no scene {name}; there are {}", names.join(", "));
        std::process::exit(1);
    }
    for (name, scene, settings) in &subjects {
        if !wanted.is_empty() && !wanted.iter().any(|wanted| wanted == name) {
            continue;
        }
        let accel = &common::accel(scene);
        let paths = paths(name);
        let pixels = Subject { scene, accel, settings, region: &[] }.traced(paths);
        let path = table::path(name);
        let resolution = [settings.width, settings.height];
        std::fs::write(&path, table::text(name, scene, resolution, paths.into(), &pixels))?;
        let total = pixels.mean.iter().sum::<f64>();
        let each = pixels.variance.iter().map(|v| v.sqrt()).sum::<f64>() / total;
        let whole = pixels.variance_of_sum.sqrt() / total;
        println!("{}: +- {whole:.5}, a pixel +- {each:.4}", path.display());
    }
    Ok(())
}
