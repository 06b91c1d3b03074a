//! The squared merge bias of both kernels at four radii: the table of `docs/kernel.md`.
//!
//! ```sh
//! cargo run --release --example kernel_table                     # all, a quarter of an hour
//! cargo run --release --example kernel_table -- cornell-box 4    # one scene, 4 iterations in a batch
//! ```

#[path = "../tests/common/true_bias.rs"]
mod true_bias;

use bdpm::import::load;
use bdpm::scene::backend::{Backend, build};
use bdpm::settings::{Kernel, PartialSettings};
use bdpm::{Scene, Settings};
use std::path::Path;
use true_bias::{Batches, Square, biases, reference};

type Result<T> = std::result::Result<T, Box<dyn std::error::Error>>;

const SCENES: [&str; 4] = ["cornell-box", "cornell-box-classic", "caustic-sphere", "materials"];
/// Shares of the scene size.
const RADII: [f32; 4] = [0.005, 0.01, 0.02, 0.04];
/// That of the reference.
const TINY: f32 = 0.001;
/// Iterations in each of the 16 batches, unless the command says otherwise.
const ITERATIONS: u64 = 12;

/// Merging at the first vertex, so that the map has all that is indirect.
fn settings(scene: &Scene, defaults: &PartialSettings, radius: f32, kernel: Kernel) -> Settings {
    let wishes = PartialSettings { resolution: Some([64, 64]), ..PartialSettings::default() };
    let settings = Settings::resolve(&wishes, defaults, scene.size()).expect("a committed scene");
    let radius = radius * scene.size();
    Settings {
        kernel,
        radius,
        caustic_radius: radius,
        merge_vertex: 1,
        light_paths: 200_000,
        camera_paths: 8,
        ..settings
    }
}

fn main() -> Result<()> {
    let mut arguments = std::env::args().skip(1);
    let wanted = arguments.next();
    let iterations = arguments.next().map_or(Ok(ITERATIONS), |text| text.parse())?;
    println!("| scene | radius | disc | area | disc, estimated | area, estimated |");
    println!("|---|---|---|---|---|---|");
    for name in SCENES.iter().filter(|name| wanted.as_ref().is_none_or(|wanted| wanted == *name)) {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes").join(name);
        let loaded = load(&path)?;
        let (scene, defaults) = (&loaded.scene, &loaded.defaults);
        let accel = &*build(Backend::default(), scene)?;
        let tiny = settings(scene, defaults, TINY, Kernel::Area);
        let reference: Batches = reference(scene, accel, tiny, iterations);
        for radius in RADII {
            let [disc, area] = [Kernel::Disc, Kernel::Area].map(|kernel| {
                let settings = settings(scene, defaults, radius, kernel);
                biases(scene, accel, settings, &reference, iterations)
            });
            let text =
                |Square { value, error }| format!("{:.0} +- {:.0}", 1e6 * value, 1e6 * error);
            let all = [disc.real, area.real, disc.estimated, area.estimated].map(text);
            println!("| {name} | {} % | {} |", 100.0 * radius, all.join(" | "));
        }
    }
    Ok(())
}
