//! Renders a scene for five seconds: `cargo run --release --example first_render`.

use bdpm::image_io::write_png;
use bdpm::settings::PartialSettings;
use bdpm::{RenderJob, Stop};
use std::path::Path;
use std::time::Duration;

fn main() -> bdpm::Result<()> {
    let scene = bdpm::load("scenes/cornell-box")?;
    let settings = PartialSettings { resolution: Some([256, 256]), ..Default::default() };
    let job = RenderJob::new(&scene).settings(settings).stop(Stop::time(Duration::from_secs(5)));
    let result = job.render()?;
    let (width, height) = result.resolution;
    write_png(Path::new("first-render.png"), width, height, &result.image)?;
    println!("{width}x{height} pixels, error {:?}", result.error.map(|error| error.total));
    Ok(())
}
