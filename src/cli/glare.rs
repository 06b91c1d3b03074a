//! `bdpm glare IMAGE`, or of a scene: [`room_glare`].

use super::outputs::{self, Output};
use super::{glare_picture, json, room_glare};
use bdpm::base::error::{Error, Result};
use bdpm::base::math::Rgb;
use bdpm::image_io::Metadata;
use bdpm::import::{RadianceImage, read_radiance};
use bdpm::light::glare::{Glare, LuminanceImage, PEAK, SEARCH_ANGLE, SourceSearch, THRESHOLD};
use bdpm::output::recorded_camera::RecordedCamera;
use bdpm::output::recorded_error::RecordedError;
use bdpm::scene::FisheyeProjection;
use bdpm::settings::provenance::Provenance;
use serde::Serialize;
use std::path::{Path, PathBuf};

#[derive(clap::Args)]
pub struct Args {
    /// Read this fisheye image, an .exr or .hdr file, or this scene with luminaires
    #[arg(value_name = "IMAGE|SCENE")]
    image: PathBuf,
    /// Read more images of this view with other seeds, and rate their mean
    #[arg(value_name = "IMAGE")]
    others: Vec<PathBuf>,
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
    /// Write the view with each source in a color, and the rating below it
    #[arg(long, value_name = "OUT.png")]
    picture: Option<PathBuf>,
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
    /// All images of which the mean is rated.
    images: Vec<String>,
    luminance_unit: &'static str,
    illuminance_unit: &'static str,
    /// Why there are no uncertainties, if there are none.
    without_uncertainty: Option<&'static str>,
    /// Errors that the uncertainties do not include.
    notes: &'a [String],
    #[serde(flatten)]
    glare: &'a Glare,
}

pub fn run(args: &Args) -> Result<String> {
    if room_glare::is_scene(&args.image) {
        if let Some(other) = args.others.first() {
            let problem = format!("{}: one scene is rated at a time", other.display());
            return Err(Error::new(problem, "give one scene, or images of one view"));
        }
        if let Some(picture) = &args.picture {
            let problem = format!("{}: a scene is rated without an image", picture.display());
            return Err(Error::new(problem, "render a fisheye image, and give that"));
        }
        return room_glare::run(&args.image, &args.room, args.json);
    }
    args.room.require_none()?;
    let picture = args.picture.as_deref();
    let output = picture.map(|path| Output::new("--picture", path, Some("png")));
    outputs::check(output.as_slice())?;
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
    let paths: Vec<&Path> =
        [&args.image].into_iter().chain(&args.others).map(|own| &**own).collect();
    let rated = RatedImages::read(args, &paths)?;
    let search =
        SourceSearch { threshold: args.threshold, peak: args.peak, angle: args.search_angle };
    let glare = Glare::new(&rated.image, &search);
    if let Some(path) = picture {
        outputs::spare_inputs(output.as_slice())?;
        glare_picture::write(path, rated.size, &rated.pixels, &glare)?;
    }
    if args.json {
        let images: Vec<String> = paths.iter().map(|path| path.display().to_string()).collect();
        return Ok(json(&GlareReport {
            image: images[0].clone(),
            images,
            luminance_unit: "cd/m2",
            illuminance_unit: "lx",
            without_uncertainty: rated.without_uncertainty,
            notes: &rated.notes,
            glare: &glare,
        }));
    }
    Ok(text(&glare, &rated))
}

/// The image that is rated, which may be the mean of several.
struct RatedImages {
    size: (u32, u32),
    /// W/(m^2 sr).
    pixels: Vec<Rgb>,
    image: LuminanceImage,
    /// Why there are no uncertainties, if there are none.
    without_uncertainty: Option<&'static str>,
    /// Errors that the uncertainties do not include.
    notes: Vec<String>,
}

impl RatedImages {
    /// Reads images of one view.
    ///
    /// # Errors
    /// If one of them is no whole fisheye image, or if they are not of one view with different
    /// seeds. Names the file.
    fn read(args: &Args, paths: &[&Path]) -> Result<Self> {
        let mut all: Vec<RadianceImage> = Vec::new();
        let mut lenses = Vec::new();
        // Images in other units of luminance
        let scale = (args.efficacy / 683.0) as f32;
        for path in paths {
            let mut own = read_radiance(path)?;
            let lens = check_finite(own.size, &own.pixels).and_then(|()| lens(args, &own.metadata));
            lenses.push(lens.map_err(|error| error.at(path))?);
            own.pixels.iter_mut().for_each(|pixel| *pixel *= scale);
            own.noise.iter_mut().flatten().for_each(|noise| *noise *= scale);
            all.push(own);
        }
        for (number, own) in all.iter().enumerate().skip(1) {
            let (earlier, is_same_lens) = (&all[..number], lenses[number] == lenses[0]);
            require_repetition(own, earlier, is_same_lens).map_err(|e| e.at(paths[number]))?;
        }
        let (projection, fov) = lenses[0];
        let new =
            |pixels: &[Rgb]| LuminanceImage::new(all[0].size, pixels, projection, fov.to_radians());
        let (image, without_uncertainty) = match &all[..] {
            [one] => match independent_noise(one) {
                Ok(noise) => (new(&one.pixels).with_noise(noise), None),
                Err(reason) => (new(&one.pixels), Some(reason)),
            },
            _ => {
                let images: Vec<LuminanceImage> = all.iter().map(|own| new(&own.pixels)).collect();
                (LuminanceImage::mean_of(&images), None)
            }
        };
        let notes = if without_uncertainty.is_none() { bias_note(&all) } else { None };
        let mean = |index| all.iter().map(|own| own.pixels[index]).sum::<Rgb>() / all.len() as f32;
        Ok(Self {
            size: all[0].size,
            pixels: (0..all[0].pixels.len()).map(mean).collect(),
            image,
            without_uncertainty,
            notes: notes.into_iter().collect(),
        })
    }
}

/// Refuses an image that does not repeat the earlier ones with other random numbers.
fn require_repetition(
    own: &RadianceImage,
    earlier: &[RadianceImage],
    is_same_lens: bool,
) -> Result<()> {
    let first = &earlier[0];
    if own.size != first.size || !is_same_lens {
        let problem = "this image has another size or lens than the first one";
        return Err(Error::new(problem, "give images of one view"));
    }
    let made_by = |image: &RadianceImage| Provenance::from_metadata(&image.metadata).ok();
    let fingerprint = |image: &RadianceImage| made_by(image).map(|own| own.fingerprint);
    if let (Some(own), Some(first)) = (fingerprint(own), fingerprint(first))
        && own != first
    {
        let problem = "this image is of another scene or view than the first one";
        return Err(Error::new(problem, "give images of one view"));
    }
    let seed = |image: &RadianceImage| made_by(image).map(|own| own.settings.seed);
    let own_seed = seed(own);
    let is_equal = |other: &RadianceImage| {
        other.pixels == own.pixels || own_seed.is_some() && seed(other) == own_seed
    };
    if earlier.iter().any(is_equal) {
        let problem = "this image has the seed or the pixels of another one, so that both have the same errors";
        return Err(Error::new(problem, "render each image with its own --seed"));
    }
    Ok(())
}

/// A note about the merge bias, which all images of a view have in common.
fn bias_note(images: &[RadianceImage]) -> Option<String> {
    let merges = |image: &RadianceImage| {
        let made_by = Provenance::from_metadata(&image.metadata);
        made_by.is_ok_and(|made_by| made_by.settings.shares_light())
    };
    let biases: Vec<Option<f64>> = images
        .iter()
        .filter(|image| merges(image))
        .map(|image| RecordedError::read(&image.metadata).map(|own| own.bias))
        .collect();
    if biases.is_empty() {
        return None;
    }
    let largest = biases.into_iter().collect::<Option<Vec<f64>>>();
    let text = match largest.and_then(|all| all.into_iter().reduce(f64::max)) {
        Some(bias) => format!("the merge bias, {:.2} % (RMS) of the image", 100.0 * bias),
        None => "the merge bias, which not all images state".into(),
    };
    Some(format!("uncertainties do not include {text}"))
}

/// The standard errors of pixels if they are independent, or why they are not known.
fn independent_noise(image: &RadianceImage) -> std::result::Result<&[f32], &'static str> {
    let noise = image
        .noise
        .as_deref()
        .ok_or("the image has no layer `rms`: give several images of the view with other seeds")?;
    let made_by = Provenance::from_metadata(&image.metadata);
    let made_by = made_by.map_err(|_| {
        "the image does not state its settings: give several images of the view with other seeds"
    })?;
    match made_by.settings.shares_light() {
        true => Err(
            "pixels share photons or a cache: give several images of the view, each with its own --seed, or render with --strategy path",
        ),
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

fn text(glare: &Glare, rated: &RatedImages) -> String {
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
    if let Some(reason) = rated.without_uncertainty {
        text += &format!("without uncertainties: {reason}\n");
    }
    for note in &rated.notes {
        text += &format!("note: {note}\n");
    }
    for source in &glare.sources {
        text += &format!(
            "source: {:.0} cd/m2, {:.5} sr, position index {:.2}, {:.1} lx\n",
            source.luminance, source.solid_angle, source.position_index, source.illuminance
        );
    }
    text
}
