#!/usr/bin/env bash
# A program of another workspace, which depends on a crate that depends on bdpm, starts and renders without a library path.
set -euo pipefail
root=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
mkdir -p "$work/middle/src" "$work/app/src"

cat >"$work/Cargo.toml" <<END
[workspace]
members = ["app", "middle"]
resolver = "3"
END
cat >"$work/middle/Cargo.toml" <<END
[package]
name = "middle"
version = "0.1.0"
edition = "2024"
[dependencies]
bdpm = { path = "$root", default-features = false, features = ["embree"] }
END
cat >"$work/middle/src/lib.rs" <<'END'
pub fn mean(scene: &str) -> bdpm::Result<f64> {
    let loaded = bdpm::load(scene)?;
    let settings = bdpm::settings::PartialSettings {
        resolution: Some([8, 8]),
        light_paths: Some(100),
        camera_paths: Some(1),
        ..Default::default()
    };
    let job = bdpm::RenderJob::new(&loaded).settings(settings).stop(bdpm::Stop::iterations(1));
    let result = job.render()?;
    assert!(result.state.accel_name.contains("Embree"), "{}", result.state.accel_name);
    Ok(result.state.image().mean_luminance())
}
END
cat >"$work/app/Cargo.toml" <<END
[package]
name = "app"
version = "0.1.0"
edition = "2024"
[dependencies]
middle = { path = "../middle" }
END
cat >"$work/app/src/main.rs" <<'END'
fn main() {
    let scene = std::env::args().nth(1).expect("a scene");
    println!("mean luminance {}", middle::mean(&scene).expect("an image"));
}
END
cat >>"$work/Cargo.toml" <<END
[profile.dev]
opt-level = 0
debug = false
END
cp "$root/Cargo.lock" "$work/Cargo.lock"
cd "$work"
env -u CARGO_TARGET_DIR "${CARGO:-cargo}" build --quiet
cd /
env -u LD_LIBRARY_PATH "$work/target/debug/app" "$root/scenes/cornell-box-classic"
