//! `bdpm glare IMAGE`.

use super::json;
use bdpm::base::error::{Error, Result};
use bdpm::import::read_radiance;
use bdpm::output::glare::{Glare, LuminanceImage, SEARCH_ANGLE, THRESHOLD};
use bdpm::scene::FisheyeProjection;
use serde::Serialize;
use std::path::PathBuf;

#[derive(clap::Args)]
pub struct Args {
    /// Read this fisheye image, an EXR file of `render` or an .hdr file
    image: PathBuf,
    /// Take this projection of the fisheye image
    #[arg(long, default_value = "equidistant")]
    projection: Projection,
    /// Take this full angle of the image circle, degrees
    #[arg(long, value_name = "DEGREES", default_value_t = 180.0)]
    fov: f64,
    /// Count pixels above this luminance as glare sources, cd/m2
    #[arg(long, value_name = "CD/M2", default_value_t = THRESHOLD)]
    threshold: f64,
    /// Join sources within this angle, radians
    #[arg(long, value_name = "RADIANS", default_value_t = SEARCH_ANGLE)]
    search_angle: f64,
    /// Take this many lumens for a watt of luminance 1: 179 for images of Radiance
    #[arg(long, value_name = "LM/W", default_value_t = 683.0)]
    efficacy: f64,
    /// Print the result as one JSON object on stdout
    #[arg(long)]
    json: bool,
}

#[derive(Clone, Copy, Debug, clap::ValueEnum)]
enum Projection {
    /// The distance from the center is proportional to the angle
    Equidistant,
    /// All pixels show the same solid angle
    Equisolid,
}

#[derive(Serialize)]
struct GlareReport<'a> {
    image: String,
    luminance_unit: &'static str,
    illuminance_unit: &'static str,
    #[serde(flatten)]
    glare: &'a Glare,
}

pub fn run(args: &Args) -> Result<String> {
    let in_range = |value: f64, from: f64, to: f64| value > from && value <= to;
    if !in_range(args.fov, 0.0, 360.0) {
        let problem = format!("the field of view is {} degrees", args.fov);
        return Err(Error::new(problem, "give an angle above 0, of at most 360 degrees"));
    }
    if !(in_range(args.threshold, 0.0, f64::MAX) && in_range(args.efficacy, 0.0, f64::MAX)) {
        return Err(Error::new("the threshold or efficacy is not above 0", "give numbers above 0"));
    }
    if !in_range(args.search_angle, 0.0, std::f64::consts::PI) {
        let problem = format!("the angle is {} radians", args.search_angle);
        return Err(Error::new(problem, "give an angle above 0, of at most pi"));
    }
    let (width, height, mut pixels) = read_radiance(&args.image)?;
    // Images in other units of luminance
    let scale = (args.efficacy / 683.0) as f32;
    pixels.iter_mut().for_each(|pixel| *pixel *= scale);
    let projection = match args.projection {
        Projection::Equidistant => FisheyeProjection::Equidistant,
        Projection::Equisolid => FisheyeProjection::Equisolid,
    };
    let image = LuminanceImage::new((width, height), &pixels, projection, args.fov.to_radians());
    let glare = Glare::new(&image, args.threshold, args.search_angle);
    if args.json {
        let image = args.image.display().to_string();
        let units = ("cd/m2", "lx");
        return Ok(json(&GlareReport {
            image,
            luminance_unit: units.0,
            illuminance_unit: units.1,
            glare: &glare,
        }));
    }
    Ok(text(&glare))
}

fn text(glare: &Glare) -> String {
    let ugr =
        glare.ugr.map_or("none: no source above the threshold".into(), |ugr| format!("{ugr:.1}"));
    let mut text = format!(
        "DGP  {:.3}\nUGR  {ugr}\nvertical illuminance  {:.1} lx\nbackground            {:.1} cd/m2\n",
        glare.dgp, glare.vertical_illuminance, glare.background_luminance
    );
    for source in &glare.sources {
        text += &format!(
            "source: {:.0} cd/m2, {:.5} sr, position index {:.2}, {:.1} lx\n",
            source.luminance, source.solid_angle, source.position_index, source.illuminance
        );
    }
    text
}
