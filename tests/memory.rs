//! Memory does not grow with the number of iterations. Alone in its process: it counts all of it.
#![cfg(target_os = "linux")]

mod common;

use bdpm::Renderer;
use bdpm::noise::Measure;
use common::{accel, furnished_box, settings};

/// Memory of this process, bytes.
fn resident() -> u64 {
    let text = std::fs::read_to_string("/proc/self/status").unwrap();
    let line = text.lines().find_map(|line| line.strip_prefix("VmRSS:")).unwrap();
    1024 * line.trim().strip_suffix("kB").unwrap().trim().parse::<u64>().unwrap()
}

#[test]
fn memory_does_not_grow_with_the_number_of_iterations() {
    let scene = furnished_box();
    let accel = accel(&scene);
    let mut renderer = Renderer::new(&scene, &accel, settings(16, 16)).unwrap();
    // Buffers reach their sizes: which threads work on tiles, and how many photons there are,
    // varies.
    let mut iterate = |count| {
        for index in 0..count {
            renderer.iterate(if index % 8 == 0 { Measure::Pairs } else { Measure::Off });
        }
        resident()
    };
    let early = iterate(200);
    let late = iterate(8000);
    // 131 bytes in each iteration would be too many.
    assert!(late < early + (1 << 20), "from {early} to {late} bytes");
}
