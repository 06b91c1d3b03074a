//! `bdpm glare IMAGE`, or of a scene: [`room_glare`].

use super::{json, room_glare};
use bdpm::base::error::{Error, Result};
use bdpm::base::math::Rgb;
use bdpm::image_io::Metadata;
use bdpm::import::{RadianceImage, read_radiance};
use bdpm::light::glare::{Glare, LuminanceImage, PEAK, SEARCH_ANGLE, SourceSearch, THRESHOLD};
use bdpm::output::recorded_camera::RecordedCamera;
use bdpm::scene::FisheyeProjection;
use bdpm::settings::provenance::Provenance;
use serde::Serialize;
use std::path::PathBuf;

#[derive(clap::Args)]
pub struct Args {
    /// Read this fisheye image, an .exr or .hdr file, or this scene with luminaires
    #[arg(value_name = "IMAGE|SCENE")]
    image: PathBuf,
    /// Take this projection [default: that of the file, or equidistant]
    #[arg(long)]
    projection: Option<Projection>,
    /// Take this full angle of the circle [default: that of the file, or 180 degrees]
    #[arg(long, value_name = "DEGREES")]
    fov: Option<f64>,
    /// Count pixels above this luminance as glare sources, cd/m2
    #[arg(long, value_name = "CD/M2", default_value_t = THRESHOLD)]
    threshold: f64,
    /// Extract pixels above this luminance from their source, as the sun, cd/m2
    #[arg(long, value_name = "CD/M2", default_value_t = PEAK)]
    peak: f64,
    /// Join sources within this angle, radians
    #[arg(long, value_name = "RADIANS", default_value_t = SEARCH_ANGLE)]
    search_angle: f64,
    /// Take this many lumens for a watt of luminance 1: 179 for images of Radiance
    #[arg(long, value_name = "LM/W", default_value_t = 683.0)]
    efficacy: f64,
    /// Print the result as one JSON object on stdout
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    room: room_glare::Args,
}

#[derive(Clone, Copy, Debug, clap::ValueEnum)]
enum Projection {
    /// The distance from the center is proportional to the angle
    Equidistant,
    /// All pixels show the same solid angle
    Equisolid,
}

impl From<Projection> for FisheyeProjection {
    fn from(projection: Projection) -> Self {
        match projection {
            Projection::Equidistant => Self::Equidistant,
            Projection::Equisolid => Self::Equisolid,
        }
    }
}

#[derive(Serialize)]
struct GlareReport<'a> {
    image: String,
    luminance_unit: &'static str,
    illuminance_unit: &'static str,
    /// Why there are no uncertainties, if there are none.
    without_uncertainty: Option<&'static str>,
    #[serde(flatten)]
    glare: &'a Glare,
}

pub fn run(args: &Args) -> Result<String> {
    if room_glare::is_scene(&args.image) {
        return room_glare::run(&args.image, &args.room, args.json);
    }
    args.room.require_none()?;
    let in_range = |value: f64, from: f64, to: f64| value > from && value <= to;
    if let Some(fov) = args.fov.filter(|fov| !in_range(*fov, 0.0, 360.0)) {
        let problem = format!("the field of view is {fov} degrees");
        return Err(Error::new(problem, "give an angle above 0, of at most 360 degrees"));
    }
    if ![args.threshold, args.peak, args.efficacy].iter().all(|own| in_range(*own, 0.0, f64::MAX)) {
        let problem = "the threshold, the peak or the efficacy is not above 0";
        return Err(Error::new(problem, "give numbers above 0"));
    }
    if !in_range(args.search_angle, 0.0, std::f64::consts::PI) {
        let problem = format!("the angle is {} radians", args.search_angle);
        return Err(Error::new(problem, "give an angle above 0, of at most pi"));
    }
    let RadianceImage { size, mut pixels, noise, metadata } = read_radiance(&args.image)?;
    let lens = check_finite(size, &pixels).and_then(|()| lens(args, &metadata));
    let (projection, fov) = lens.map_err(|error| error.at(&args.image))?;
    // Images in other units of luminance
    let scale = (args.efficacy / 683.0) as f32;
    pixels.iter_mut().for_each(|pixel| *pixel *= scale);
    let mut image = LuminanceImage::new(size, &pixels, projection, fov.to_radians());
    let (noise, without_uncertainty) = match independent_noise(noise, &metadata) {
        Ok(noise) => (Some(noise), None),
        Err(reason) => (None, Some(reason)),
    };
    if let Some(mut noise) = noise {
        noise.iter_mut().for_each(|own| *own *= scale);
        image = image.with_noise(&noise);
    }
    let search =
        SourceSearch { threshold: args.threshold, peak: args.peak, angle: args.search_angle };
    let glare = Glare::new(&image, &search);
    if args.json {
        let image = args.image.display().to_string();
        let units = ("cd/m2", "lx");
        return Ok(json(&GlareReport {
            image,
            luminance_unit: units.0,
            illuminance_unit: units.1,
            without_uncertainty,
            glare: &glare,
        }));
    }
    Ok(text(&glare, without_uncertainty))
}

/// The standard errors of pixels if they are independent, or why they are not known.
fn independent_noise(
    noise: Option<Vec<f32>>,
    metadata: &Metadata,
) -> std::result::Result<Vec<f32>, &'static str> {
    let noise = noise.ok_or("the image has no layer `rms`")?;
    let made_by = Provenance::from_metadata(metadata);
    let made_by = made_by.map_err(|_| "the image does not state its settings")?;
    match made_by.settings.has_photons() {
        true => Err("pixels share photons; render with --strategy path for uncertainties"),
        false => Ok(noise),
    }
}

/// Refuses pixels that are not finite: a single one makes the rating wrong.
fn check_finite((width, _): (u32, u32), pixels: &[Rgb]) -> Result<()> {
    let is_bad = |(_, pixel): &(usize, &Rgb)| !pixel.is_finite();
    let mut bad = pixels.iter().enumerate().filter(is_bad).map(|(index, _)| index);
    let Some(first) = bad.next() else { return Ok(()) };
    let (x, y) = (first % width as usize, first / width as usize);
    let problem = match 1 + bad.count() {
        1 => format!("the pixel ({x}, {y}) is not finite"),
        count => format!("{count} pixels are not finite; the first is ({x}, {y})"),
    };
    Err(Error::new(problem, "render the image again, or replace these pixels"))
}

/// Projection and full angle of the image circle, degrees: those of the file if it states its
/// camera.
fn lens(args: &Args, metadata: &Metadata) -> Result<(FisheyeProjection, f64)> {
    let requested = args.projection.map(FisheyeProjection::from);
    let (projection, fov) = match RecordedCamera::read(metadata)? {
        None => {
            let projection = requested.unwrap_or(FisheyeProjection::Equidistant);
            return Ok((projection, args.fov.unwrap_or(180.0)));
        }
        Some(RecordedCamera::Fisheye { projection, field_of_view }) => (projection, field_of_view),
        Some(RecordedCamera::Other(name)) => {
            let problem = format!("this is no fisheye image: its camera is of type \"{name}\"");
            return Err(Error::new(problem, "render the scene with a camera of type \"fisheye\""));
        }
    };
    let made_by = Provenance::from_metadata(metadata);
    if made_by.is_ok_and(|made_by| made_by.settings.crop.is_some()) {
        let problem = "this is only a window of a fisheye image";
        return Err(Error::new(problem, "render the whole image, without --crop"));
    }
    if let Some(other) = requested.filter(|requested| *requested != projection) {
        let (other, own) = (other.name(), projection.name());
        let problem = format!("the image has the projection {own}, not {other}");
        return Err(Error::new(problem, "leave out --projection"));
    }
    if let Some(other) = args.fov.filter(|requested| *requested as f32 != fov) {
        let problem = format!("the image circle spans {fov} degrees, not {other}");
        return Err(Error::new(problem, "leave out --fov"));
    }
    Ok((projection, fov.into()))
}

fn text(glare: &Glare, without_uncertainty: Option<&str>) -> String {
    let expanded = glare.expanded;
    let range = |own: Option<f64>, digits: usize| {
        own.map_or_else(String::new, |own| format!(" +- {own:.digits$}"))
    };
    let ugr = glare.ugr.map_or("none: no source above the threshold".into(), |ugr| {
        format!("{ugr:.1}{}", range(expanded.and_then(|own| own.ugr), 1))
    });
    let mut text = format!(
        "DGP  {:.3}{}\nUGR  {ugr}\nvertical illuminance  {:.1}{} lx\nbackground            {:.1} cd/m2\n",
        glare.dgp,
        range(expanded.map(|own| own.dgp), 3),
        glare.vertical_illuminance,
        range(expanded.map(|own| own.vertical_illuminance), 1),
        glare.background_luminance
    );
    if let Some(reason) = without_uncertainty {
        text += &format!("without uncertainties: {reason}\n");
    }
    for source in &glare.sources {
        text += &format!(
            "source: {:.0} cd/m2, {:.5} sr, position index {:.2}, {:.1} lx\n",
            source.luminance, source.solid_angle, source.position_index, source.illuminance
        );
    }
    text
}
