//! Prints the squared merge bias of both kernels at four radii as a table.
//!
//! ```sh
//! cargo run --release --example kernel_table                     # all, a quarter of an hour
//! cargo run --release --example kernel_table -- cornell-box 4    # one scene, 4 iterations in a batch
//! ```

#[path = "../tests/common/true_bias.rs"]
mod true_bias;

use bdpm::load::load;
use bdpm::scene::backend::{Backend, build};
use bdpm::settings::Kernel;
use std::path::Path;
use true_bias::{Batches, Square, TINY, biases, reference, settings};

type Result<T> = std::result::Result<T, Box<dyn std::error::Error>>;

const SCENES: [&str; 4] = ["cornell-box", "cornell-box-classic", "caustic-sphere", "materials"];
/// Shares of the scene size.
const RADII: [f32; 4] = [0.005, 0.01, 0.02, 0.04];
/// Iterations in each of the 16 batches, unless the command says otherwise.
const ITERATIONS: u64 = 20;

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
        let accel = &build(Backend::default(), scene)?;
        let tiny = settings(scene, defaults, TINY, Kernel::Area);
        let reference: Batches = reference(scene, accel, tiny, iterations);
        for radius in RADII {
            let [disc, area] = [Kernel::Disc, Kernel::Area].map(|kernel| {
                let settings = settings(scene, defaults, radius, kernel);
                biases(scene, accel, settings, &reference, iterations)
            });
            let text = |Square { value, error }| match value {
                0.0 => "hidden".into(),
                _ => format!("{:.0} +- {:.0}", 1e6 * value, 1e6 * error),
            };
            let all = [disc.real, area.real, disc.estimated, area.estimated].map(text);
            println!("| {name} | {} % | {} |", 100.0 * radius, all.join(" | "));
        }
    }
    Ok(())
}
