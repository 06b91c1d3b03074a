//! Camera and film.

use super::params::Params;
use super::textures::Textures;
use crate::sensor;
use bdpm_core::base::error::Result;
use bdpm_core::scene::{Camera, Extent, FieldOfView, Optics};
use glam::{DAffine3, DMat3, DVec3};

/// A camera before the scene is mirrored to it.
pub(super) struct CameraSource {
    pub params: Params,
    /// From the camera's space, with +x to the right, +y up and +z forward, to the world.
    pub to_world: DAffine3,
}

/// Size of the image, and the factor of all light.
pub(super) struct FilmSource {
    size: [u32; 2],
    /// Left, right, upper and lower edge of the rendered part, pixels.
    part: [u32; 4],
    pub scale: f32,
    /// Diagonal, millimeters.
    diagonal: f64,
}

impl FilmSource {
    /// The film of scenes that define none.
    pub fn new() -> Self {
        Self { size: [1280, 720], part: [0, 1280, 0, 720], scale: 1.0, diagonal: 35.0 }
    }

    pub fn read(params: &Params, textures: &mut Textures) -> Result<Self> {
        let whole = |name: &str, default: f64| {
            params.float_in(name, default, [1.0, 65_536.0]).map(|pixels| pixels as u32)
        };
        let size = [whole("xresolution", 1280.0)?, whole("yresolution", 720.0)?];
        let limits = [size[0], size[0], size[1], size[1]].map(f64::from);
        let mut part = [0.0, limits[0], 0.0, limits[2]];
        if let [x0, x1, y0, y1] = *params.numbers("cropwindow") {
            part = [x0, x1, y0, y1];
            // Pixels are rounded up, as pbrt does.
            part.iter_mut().zip(limits).for_each(|(edge, size)| *edge = (*edge * size).ceil());
        }
        if let [x0, x1, y0, y1] = *params.numbers("pixelbounds") {
            part = [x0, x1, y0, y1];
        }
        let part: [f64; 4] = std::array::from_fn(|i| part[i].clamp(0.0, limits[i]));
        if !(part[0] < part[1] && part[2] < part[3]) {
            return Err(params.error("the crop window is empty", "give a larger one"));
        }
        let sensor = params.text("sensor")?.unwrap_or("cie1931");
        if sensor != "cie1931" {
            let phrase = "used the sensor `cie1931` without a white balance for";
            textures.warnings.skipped(phrase, sensor);
        }
        if params.float_or("whitebalance", 0.0)? != 0.0 && sensor == "cie1931" {
            textures.warnings.skipped("left out the white balance of", "the film");
        }
        let exposure = params.float_in("exposuretime", 1.0, [1e-12, 1e12])?;
        let iso = params.float_in("iso", 100.0, [1e-6, 1e9])?;
        let diagonal = params.float_in("diagonal", 35.0, [1e-3, 1e6])?;
        let part = part.map(|edge| edge as u32);
        Ok(Self { size, part, scale: (exposure * iso / 100.0) as f32, diagonal })
    }

    /// Width and height of the rendered part, pixels.
    pub fn resolution(&self) -> [u32; 2] {
        let [left, right, top, bottom] = self.part;
        [right - left, bottom - top]
    }
}

impl CameraSource {
    /// Whether its image is the mirror image of ours.
    pub fn is_mirrored(&self) -> bool {
        let is_spherical = self.params.kind == "spherical";
        (self.to_world.matrix3.determinant() > 0.0) != is_spherical
    }

    /// The camera in a scene that `world` transforms.
    pub fn camera(
        &self,
        world: DAffine3,
        film: &FilmSource,
        textures: &mut Textures,
    ) -> Result<Camera> {
        let params = &self.params;
        for name in ["shutteropen", "shutterclose"] {
            let _ = params.float(name)?;
        }
        let map = world * self.to_world;
        let screen = self.screen(film)?;
        let (mut forward, mut shift) = (DVec3::Z, screen.shift());
        let half_angle = || -> Result<f64> {
            let fov = params.float_in("fov", 90.0, [1e-3, 179.99])?;
            Ok((0.5 * fov).to_radians().tan())
        };
        let across = |half: f64| {
            FieldOfView::X(2.0 * (0.5 * screen.width() * half).atan().to_degrees() as f32)
        };
        let optics = match &params.kind[..] {
            "perspective" => {
                let field_of_view = across(half_angle()?);
                let radius = params.float_in("lensradius", 0.0, [0.0, 1e30])?;
                let distance = params.float_in("focaldistance", 1e6, [1e-30, 1e30])?;
                let scale = unit_length(map.matrix3);
                let [aperture_radius, focus_distance] =
                    [radius * scale, distance * scale].map(|length| length as f32);
                match radius {
                    0.0 => Optics::Pinhole(field_of_view),
                    _ => Optics::ThinLens { field_of_view, aperture_radius, focus_distance },
                }
            }
            "orthographic" => {
                for name in ["lensradius", "focaldistance"] {
                    let _ = params.float(name)?;
                }
                let width = screen.width() * map.matrix3.x_axis.length();
                Optics::Orthographic(Extent::X(width as f32))
            }
            "spherical" => {
                if params.text("mapping")?.unwrap_or("equalarea") != "equirectangular" {
                    let phrase = "used longitude and latitude instead of the equal-area mapping of";
                    textures.warnings.skipped(phrase, "the camera");
                }
                (forward, shift) = (DVec3::NEG_X, [0.0; 2]);
                Optics::Panorama
            }
            "realistic" => Optics::Pinhole(across(self.realistic(film, &screen, textures)?)),
            other => {
                let problem = format!("cameras of type `{other}` are unknown");
                let advice = "use perspective, orthographic, spherical or realistic";
                return Err(params.location.error(problem, advice));
            }
        };
        let camera = sensor::camera(map, forward, optics, shift.map(|share| share as f32));
        camera.map_err(|error| params.location.place(error))
    }

    /// Tangent of half the field of view of a unit of the screen: that of a pinhole in place of
    /// lenses.
    fn realistic(
        &self,
        film: &FilmSource,
        screen: &Screen,
        textures: &mut Textures,
    ) -> Result<f64> {
        let params = &self.params;
        let lens = params.text("lensfile")?.unwrap_or_default();
        let focal = focal_length(lens).unwrap_or(50.0);
        let phrase = format!("used a pinhole of {focal} mm focal length instead of the lenses of");
        textures.warnings.skipped(phrase, lens);
        for name in ["aperturediameter", "focusdistance"] {
            let _ = params.float(name)?;
        }
        let _ = params.text("aperture")?;
        let [width, height] = film.size.map(f64::from);
        // The screen is 2 high or wide along its shorter side.
        Ok(film.diagonal * width / width.hypot(height) / focal / screen.full_width)
    }

    /// The part of the screen that the image shows.
    fn screen(&self, film: &FilmSource) -> Result<Screen> {
        let params = &self.params;
        let [width, height] = film.size.map(f64::from);
        let aspect = params.float_in("frameaspectratio", width / height, [1e-4, 1e4])?;
        let mut window = if aspect > 1.0 {
            [-aspect, aspect, -1.0, 1.0]
        } else {
            [-1.0, 1.0, -1.0 / aspect, 1.0 / aspect]
        };
        if let [x0, x1, y0, y1] = *params.numbers("screenwindow") {
            window = [x0, x1, y0, y1];
        }
        let [x0, x1, y0, y1] = window;
        if !(x1 > x0 && y1 > y0) {
            return Err(params.error("the screen window is empty", "give a larger one"));
        }
        let [left, right, top, bottom] = film.part.map(f64::from);
        let x = |pixel: f64| x0 + (x1 - x0) * pixel / width;
        let y = |pixel: f64| y1 - (y1 - y0) * pixel / height;
        Ok(Screen { x: [x(left), x(right)], y: [y(bottom), y(top)], full_width: x1 - x0 })
    }
}

/// A rectangle of the plane at distance 1, in tangents of half the field of view.
struct Screen {
    x: [f64; 2],
    y: [f64; 2],
    /// Width of the full image.
    full_width: f64,
}

impl Screen {
    fn width(&self) -> f64 {
        self.x[1] - self.x[0]
    }

    /// Offset of the center, in widths and heights of the rectangle.
    fn shift(&self) -> [f64; 2] {
        [self.x, self.y].map(|[low, high]| {
            let shift = 0.5 * (low + high) / (high - low);
            if shift.abs() < 1e-12 { 0.0 } else { shift }
        })
    }
}

/// The mean factor of lengths.
fn unit_length(matrix: DMat3) -> f64 {
    matrix.determinant().abs().cbrt()
}

/// The focal length in the name of a lens file, such as `wide.22mm.dat`.
fn focal_length(name: &str) -> Option<f64> {
    let parts = name.split(|c: char| !(c.is_ascii_alphanumeric()));
    let mut lengths = parts.filter_map(|part| part.strip_suffix("mm")?.parse::<f64>().ok());
    lengths.find(|length| (1.0..=2000.0).contains(length))
}
