//! Cameras: rays through uniform points of a pixel (box filter) and of the aperture.

use crate::accel::Ray;
use crate::base::error::{Error, Result};
use crate::base::math::{disc_area, uniform_disc};
use crate::scene::projection::{FisheyeProjection, panorama_direction};
use crate::settings::Settings;
use crate::simd::{LANES, Vec3s};
use glam::{Vec2, Vec3};

/// A camera: its position, orientation and optics.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Camera {
    position: Vec3,
    forward: Vec3,
    right: Vec3,
    up: Vec3,
    optics: Optics,
    /// Shift of the image to the right and up, in its widths and heights.
    shift: [f32; 2],
    /// Direction and up vector as given: a copy of the camera from them has the same frame bit by bit.
    aim: [Vec3; 2],
}

/// The optics of a camera.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Optics {
    /// A pinhole at the position. A pixel's value is the mean radiance along its rays.
    Pinhole(FieldOfView),
    /// An ideal lens with its center at the position, perpendicular to the direction. A pixel's value
    /// is the mean radiance over the pixel and the aperture.
    ThinLens {
        /// Field of view of the pinhole in its center.
        field_of_view: FieldOfView,
        /// Radius of the aperture, scene units.
        aperture_radius: f32,
        /// Distance of the plane that is sharp, along the direction, scene units.
        focus_distance: f32,
    },
    /// A sensor with its center at the position, facing the direction, behind real lenses in the scene. It
    /// receives light through a disc in front of it, such as the rear element of the objective. A pixel's
    /// value is its mean radiant exposure, J/m^2; at an exposure of 1 s that is its irradiance, W/m^2.
    Sensor {
        /// Width, scene units; the height follows from square pixels.
        width: f32,
        /// Distance of the disc's center along the direction, scene units.
        disc_distance: f32,
        /// Radius of the disc, scene units.
        disc_radius: f32,
        /// Exposure time, seconds.
        exposure: f32,
    },
    /// Parallel rays along the direction, from a plane through the position. A pixel's value is the mean radiance
    /// along its rays, as for all following optics.
    Orthographic(Extent),
    /// All directions in longitude and latitude: the direction is in the center, `up` at the upper edge. Pixels at
    /// the same height show the same solid angle.
    Panorama,
    /// A fisheye lens, whose image circle touches the nearer edges of the image. Pixels outside the circle are black.
    Fisheye {
        /// Projection of the lens.
        projection: FisheyeProjection,
        /// Full opening angle across the image circle, degrees; up to 360.
        field_of_view: f32,
    },
}

/// Size of the visible part of a scene across the image, scene units.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Extent {
    /// Across the image's width.
    X(f32),
    /// Across the image's height.
    Y(f32),
}

impl Extent {
    /// Side of a pixel, scene units.
    fn pixel(self, width: f32, height: f32) -> f32 {
        match self {
            Self::X(across) => across / width,
            Self::Y(across) => across / height,
        }
    }
}

/// Full opening angle across the image, degrees.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum FieldOfView {
    /// Across the image's width.
    X(f32),
    /// Across the image's height.
    Y(f32),
}

impl FieldOfView {
    /// Side of a pixel at distance 1.
    fn pixel(self, width: f32, height: f32) -> f32 {
        let across = |degrees: f32| 2.0 * (0.5 * degrees).to_radians().tan();
        match self {
            Self::X(degrees) => across(degrees) / width,
            Self::Y(degrees) => across(degrees) / height,
        }
    }
}

impl Optics {
    /// Refuses impossible optics.
    fn validate(&self) -> Result<()> {
        if let Self::Pinhole(field_of_view) | Self::ThinLens { field_of_view, .. } = self {
            let (FieldOfView::X(degrees) | FieldOfView::Y(degrees)) = *field_of_view;
            if !(degrees > 0.0 && degrees < 180.0) {
                return Err(Error::new(
                    format!("the camera's field of view is {degrees} degrees"),
                    "give an angle between 0 and 180 degrees",
                ));
            }
        }
        if let Self::Fisheye { field_of_view, .. } = *self
            && !(field_of_view > 0.0 && field_of_view <= 360.0)
        {
            return Err(Error::new(
                format!("the fisheye camera's field of view is {field_of_view} degrees"),
                "give an angle above 0, and at most 360 degrees",
            ));
        }
        let lengths: &[(&str, f32)] = match self {
            Self::Pinhole(_) | Self::Panorama | Self::Fisheye { .. } => &[],
            Self::Orthographic(Extent::X(across)) => &[("width", *across)],
            Self::Orthographic(Extent::Y(across)) => &[("height", *across)],
            Self::ThinLens { aperture_radius, focus_distance, .. } => {
                &[("aperture_radius", *aperture_radius), ("focus_distance", *focus_distance)]
            }
            Self::Sensor { width, disc_distance, disc_radius, exposure } => &[
                ("sensor_width", *width),
                ("disc_distance", *disc_distance),
                ("disc_radius", *disc_radius),
                ("exposure", *exposure),
            ],
        };
        match lengths.iter().find(|(_, value)| !(*value > 0.0 && value.is_finite())) {
            None => Ok(()),
            Some((name, value)) => Err(Error::new(
                format!("the camera's {name} is {value}"),
                format!("give {name} as a positive number"),
            )),
        }
    }
}

impl Camera {
    /// A pinhole camera at `position` that looks along `direction` (any length) with `up` toward the
    /// image's top. The frame is right-handed: looking along +z with +y up, +x is on the left.
    ///
    /// # Errors
    /// As [`Self::with_optics`].
    pub fn look(
        position: Vec3,
        direction: Vec3,
        up: Vec3,
        field_of_view: FieldOfView,
    ) -> Result<Self> {
        Self::with_optics(position, direction, up, Optics::Pinhole(field_of_view))
    }

    /// A camera with any optics.
    ///
    /// # Errors
    /// If a vector is not finite, `direction` and `up` are parallel or zero, an angle is not between
    /// 0 and 180 degrees, or a length is not positive.
    pub fn with_optics(position: Vec3, direction: Vec3, up: Vec3, optics: Optics) -> Result<Self> {
        if !(position.is_finite() && direction.is_finite() && up.is_finite()) {
            return Err(Error::new(
                "the camera has a coordinate that is not finite",
                "give finite numbers for its position, direction and up vector",
            ));
        }
        optics.validate()?;
        let aim = [direction, up];
        let forward = direction.normalize_or_zero();
        let right = forward.cross(up.normalize_or_zero()).normalize_or_zero();
        if right == Vec3::ZERO {
            return Err(Error::new(
                "the camera's direction and up vector are parallel or zero",
                "give a target other than the position and an up vector off the line of sight",
            ));
        }
        let up = right.cross(forward);
        Ok(Self { position, forward, right, up, optics, shift: [0.0; 2], aim })
    }

    /// The camera with its image shifted to the right and up in its plane, in widths and heights of the image, as
    /// shift lenses do. A shift also renders a part of an image alone.
    ///
    /// # Errors
    /// If a number is not finite, the camera is a sensor, whose lenses are in the scene, or it is a panorama.
    pub fn shifted(self, shift: [f32; 2]) -> Result<Self> {
        if !shift.iter().all(|share| share.is_finite()) {
            let problem = format!("the camera's shift is {shift:?}");
            return Err(Error::new(problem, "give two finite numbers"));
        }
        if matches!(self.optics, Optics::Sensor { .. }) && shift != [0.0; 2] {
            let advice = "move its position instead";
            return Err(Error::new("a camera of type \"sensor\" has no `shift`", advice));
        }
        if self.optics == Optics::Panorama && shift != [0.0; 2] {
            let advice = "turn its direction instead";
            return Err(Error::new("a camera of type \"panorama\" has no `shift`", advice));
        }
        Ok(Self { shift, ..self })
    }

    /// The pinhole, or the center of the lens or the sensor.
    pub fn position(&self) -> Vec3 {
        self.position
    }

    /// Unit vector through the image's center.
    pub fn direction(&self) -> Vec3 {
        self.forward
    }

    /// Unit vector toward the image's top, perpendicular to [`Self::direction`].
    pub fn up(&self) -> Vec3 {
        self.up
    }

    /// Direction and up vector as given.
    pub(crate) fn aim(&self) -> [Vec3; 2] {
        self.aim
    }

    /// Shift of the image to the right and up, in its widths and heights.
    pub fn shift(&self) -> [f32; 2] {
        self.shift
    }

    /// The camera's optics.
    pub fn optics(&self) -> Optics {
        self.optics
    }

    /// The camera with square pixels on an image of `width` times `height` pixels.
    pub fn view(&self, width: u32, height: u32) -> View {
        let (w, h) = (width as f32, height as f32);
        let disc = |radius: f32| [radius * self.right, radius * self.up];
        // Distance of the plane of the pixels along the direction, and the side of a pixel there. A sensor
        // is behind its lenses, which turn the image upside down.
        let (distance, pixel, imaging) = match self.optics {
            Optics::Pinhole(field_of_view) => (1.0, field_of_view.pixel(w, h), Imaging::Pinhole),
            Optics::ThinLens { field_of_view, aperture_radius, focus_distance } => (
                focus_distance,
                focus_distance * field_of_view.pixel(w, h),
                Imaging::Lens(disc(aperture_radius)),
            ),
            Optics::Sensor { width, disc_distance, disc_radius, exposure } => {
                let [x, y] = disc(disc_radius);
                let center = disc_distance * self.forward;
                // theory.md (6), with the next use of `weight`
                let weight = exposure * disc_area(disc_radius) * disc_distance * disc_distance;
                (0.0, -width / w, Imaging::Disc { center, x, y, weight })
            }
            Optics::Orthographic(extent) => {
                (0.0, extent.pixel(w, h), Imaging::Parallel(self.forward))
            }
            Optics::Panorama => (0.0, w.recip(), Imaging::Panorama([self.right, self.up])),
            Optics::Fisheye { projection, field_of_view } => {
                let edge = (0.5 * field_of_view).to_radians();
                (0.0, 2.0 / w.min(h), Imaging::Fisheye([self.right, self.up], projection, edge))
            }
        };
        let is_panorama = self.optics == Optics::Panorama;
        let pixel_height = if is_panorama { h.recip() } else { pixel };
        let (dx, dy) = (self.right * pixel, -self.up * pixel_height);
        let [right, up] = self.shift;
        let corner = distance * self.forward + w * (right - 0.5) * dx - h * (up + 0.5) * dy;
        View { position: self.position, corner, dx, dy, stride: 1.0, imaging }
    }

    /// The camera with the pixels of an image of these settings, which may be a window of the full image.
    pub fn view_of(&self, settings: &Settings) -> View {
        let [width, height] = settings.full_resolution();
        let view = self.view(width, height);
        match settings.crop {
            None => view,
            Some(crop) => {
                let [x, y] = crop.origin.map(|pixels| pixels as f32);
                View { corner: view.corner + x * view.dx + y * view.dy, ..view }
            }
        }
    }
}

/// A camera bound to a resolution.
#[derive(Clone, Copy, Debug)]
pub struct View {
    /// Position of the camera, scene units.
    pub position: Vec3,
    /// From the position to the top left corner of the plane of the pixels.
    corner: Vec3,
    /// One pixel to the right.
    dx: Vec3,
    /// One pixel down.
    dy: Vec3,
    /// One pixel of each square of `stride` by `stride` pixels is taken.
    stride: f32,
    imaging: Imaging,
}

/// Selects the ray of a point in the plane of the pixels.
#[derive(Clone, Copy, Debug)]
enum Imaging {
    /// From the position through the point.
    Pinhole,
    /// A disc around the position, given by two radii; the plane of the pixels is in focus.
    Lens([Vec3; 2]),
    /// A disc in front of the plane of the pixels, given by its center and two radii. The weight is the product
    /// of its area, the squared distance of the planes, and the exposure.
    Disc { center: Vec3, x: Vec3, y: Vec3, weight: f32 },
    /// From the point along this direction.
    Parallel(Vec3),
    /// From the position by longitude and latitude. The plane of the pixels has unit sides to the right and up, given by
    /// their unit vectors.
    Panorama([Vec3; 2]),
    /// From the position by the projection of a fisheye lens, which shows directions up to this angle from the axis,
    /// radians. The plane of the pixels has an image circle of radius 1.
    Fisheye([Vec3; 2], FisheyeProjection, f32),
}

impl View {
    /// The view of one pixel, of unchanged size, in each square of `stride` by `stride` pixels. The pixels form a
    /// rotated grid that has as many in each row as in each column: a regular grid could miss objects that are one
    /// pixel wide.
    #[must_use]
    pub fn every(self, stride: u32) -> Self {
        Self { stride: stride as f32, ..self }
    }

    /// A point of the image in the view of all pixels; bit by bit the same point at a stride of 1.
    #[inline(always)]
    pub(super) fn full_image_point(&self, x: f32, y: f32) -> [f32; 2] {
        let stride = self.stride;
        if stride == 1.0 {
            return [x, y];
        }
        let (column, row) = (x.floor(), y.floor());
        let within = |n: f32| n - stride * (n / stride).floor();
        [x + (stride - 1.0) * column + within(row), y + (stride - 1.0) * row + within(column)]
    }

    /// Returns true if all rays start at the position and have the weight 1, so that [`Self::pinhole_directions`] are
    /// those of [`Self::ray`].
    #[inline]
    pub fn is_pinhole(&self) -> bool {
        matches!(self.imaging, Imaging::Pinhole)
    }

    /// The ray for the point `(x, y)`, in pixels from the image's top left corner. It has a unit direction and
    /// passes the point of the aperture that `lens` in [0, 1)^2 selects. Also returns the weight of its radiance in
    /// the pixel's value: 0 outside the image circle of a fisheye, where nothing is visible.
    /// theory.md (5).
    pub fn ray(&self, x: f32, y: f32, lens: [f32; 2]) -> (Ray, f32) {
        let [x, y] = self.full_image_point(x, y);
        let to_pixel = self.corner + x * self.dx + y * self.dy;
        match self.imaging {
            Imaging::Pinhole => (Ray::new(self.position, to_pixel.normalize()), 1.0),
            _ => self.ray_through(to_pixel, lens),
        }
    }

    /// Unit directions of [`Self::ray`] for points `(x, y)`, if the camera is a pinhole.
    #[inline(always)] // part of a vector loop
    pub fn pinhole_directions(&self, x: &[f32; LANES], y: &[f32; LANES]) -> Vec3s {
        let mut directions = Vec3s::default();
        for lane in 0..LANES {
            let [x, y] = self.full_image_point(x[lane], y[lane]);
            let to_pixel = self.corner + x * self.dx + y * self.dy;
            directions.set(lane, to_pixel.normalize());
        }
        directions
    }

    /// [`Self::ray`] for the point `to_pixel` from the position, for all cameras.
    #[inline(never)]
    fn ray_through(&self, to_pixel: Vec3, lens: [f32; 2]) -> (Ray, f32) {
        // Coordinates in the plane of the pixels, and directions of the space with +z forward.
        let within = |[right, up]: [Vec3; 2]| Vec2::new(to_pixel.dot(right), to_pixel.dot(up));
        let turned = |[right, up]: [Vec3; 2], local: Vec3| {
            let forward = up.cross(right);
            (local.x * right + local.y * up + local.z * forward).normalize()
        };
        match self.imaging {
            Imaging::Pinhole => (Ray::new(self.position, to_pixel.normalize()), 1.0),
            Imaging::Lens([right, up]) => {
                let [u, v] = uniform_disc(lens);
                let through = u * right + v * up;
                (Ray::new(self.position + through, (to_pixel - through).normalize()), 1.0)
            }
            Imaging::Disc { center, x, y, weight } => {
                let [u, v] = uniform_disc(lens);
                let across = center + u * x + v * y - to_pixel;
                // Irradiance from a disc of area A in a plane at distance d: the mean over the disc
                // of L cos^2(theta) A / s^2, and cos(theta) = d/s.
                let s2 = across.length_squared();
                (Ray::new(self.position + to_pixel, across.normalize()), weight / (s2 * s2))
            }
            Imaging::Parallel(direction) => (Ray::new(self.position + to_pixel, direction), 1.0),
            Imaging::Panorama(axes) => {
                let direction = turned(axes, panorama_direction(within(axes)));
                (Ray::new(self.position, direction), 1.0)
            }
            Imaging::Fisheye(axes, projection, edge) => {
                match projection.direction(within(axes), edge) {
                    Some(local) => (Ray::new(self.position, turned(axes, local)), 1.0),
                    None => (Ray::new(self.position, turned(axes, Vec3::Z)), 0.0),
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::HashSet;
    use std::f32::consts::PI;

    /// Direction toward a point of the image of a pinhole camera.
    fn direction(view: &View, x: f32, y: f32) -> Vec3 {
        view.ray(x, y, [0.5; 2]).0.direction
    }

    #[test]
    fn strided_view_has_the_rays_of_its_pixels() {
        let camera = Camera::look(Vec3::ZERO, Vec3::Z, Vec3::Y, FieldOfView::X(60.0)).unwrap();
        let (all, some) = (camera.view(12, 8), camera.view(12, 8).every(4));
        for (x, y, at) in [(0.25, 0.5, [0.25, 0.5]), (2.75, 1.0, [9.75, 6.0])] {
            let off = direction(&some, x, y) - direction(&all, at[0], at[1]);
            assert!(off.length() < 1e-6, "{off}");
        }
        let same = camera.view(12, 8).every(1);
        // 16 by 16 pixels have one in each row and each column.
        let grid = camera.view(16, 16).every(4);
        let pixels = (0..16).map(|i| grid.full_image_point((i % 4) as f32, (i / 4) as f32));
        let (columns, rows): (HashSet<_>, HashSet<_>) =
            pixels.map(|[x, y]| (x as u32, y as u32)).unzip();
        assert_eq!((columns.len(), rows.len()), (16, 16));
        assert_eq!(direction(&same, 7.3, 2.9), direction(&all, 7.3, 2.9));
    }

    #[test]
    fn pinhole_projects_a_known_point_to_its_pixel() {
        // The paper's camera: +x on the left; tan(39.3077 deg / 2) = 0.025 / 0.07.
        let fov = FieldOfView::X(39.3077);
        let camera = Camera::look(Vec3::new(278.0, 273.0, -800.0), Vec3::Z, Vec3::Y, fov).unwrap();
        let view = camera.view(100, 50);
        assert!((direction(&view, 50.0, 25.0) - Vec3::Z).length() < 1e-6);
        let left = direction(&view, 0.0, 25.0);
        assert!((left.x / left.z - 0.025 / 0.07).abs() < 1e-5, "{left}");
        let top = direction(&view, 50.0, 0.0);
        assert!((top.y / top.z - 0.5 * 0.025 / 0.07).abs() < 1e-5, "{top}");
    }

    #[test]
    fn shifted_camera_shows_the_adjacent_image() {
        let camera = Camera::look(Vec3::ZERO, -Vec3::Z, Vec3::Y, FieldOfView::X(60.0)).unwrap();
        let (view, shifted) =
            (camera.view(40, 20), camera.shifted([0.25, -0.5]).unwrap().view(40, 20));
        for (x, y) in [(0.0, 0.0), (20.0, 10.0), (33.0, 4.0)] {
            let off = direction(&shifted, x, y) - direction(&view, x + 10.0, y + 10.0);
            assert!(off.length() < 1e-6, "{off}");
        }
        assert!(camera.shifted([f32::NAN, 0.0]).is_err());
        let (width, disc_distance, disc_radius, exposure) = (1.0, 1.0, 1.0, 1.0);
        let optics = Optics::Sensor { width, disc_distance, disc_radius, exposure };
        let sensor = Camera::with_optics(Vec3::ZERO, Vec3::Z, Vec3::Y, optics).unwrap();
        assert!(sensor.shifted([0.1, 0.0]).is_err() && sensor.shifted([0.0; 2]).is_ok());
    }

    #[test]
    fn vertical_field_of_view_spans_the_height() {
        let camera = Camera::look(Vec3::ZERO, -Vec3::Z, Vec3::Y, FieldOfView::Y(90.0)).unwrap();
        let top = direction(&camera.view(30, 20), 15.0, 0.0);
        assert!((top.y / -top.z - 1.0).abs() < 1e-5, "{top}");
        let right = direction(&camera.view(30, 20), 30.0, 10.0);
        assert!((right.x / -right.z - 1.5).abs() < 1e-5, "{right}");
    }

    /// Points all over the unit square, the lens's edge among them.
    fn lens_points() -> impl Iterator<Item = [f32; 2]> {
        let steps = || (0..16).map(|i| i as f32 / 15.0 * 0.999_999);
        steps().flat_map(move |u| steps().map(move |v| [u, v]))
    }

    /// The point where a ray crosses the plane at `z`.
    fn at(ray: &Ray, z: f32) -> Vec3 {
        ray.origin + (z - ray.origin.z) / ray.direction.z * ray.direction
    }

    #[test]
    fn thin_lens_is_sharp_at_its_focus_and_blurs_by_the_circle_of_confusion() {
        let (aperture_radius, focus_distance) = (0.25, 4.0);
        let field_of_view = FieldOfView::X(40.0);
        let thin = Optics::ThinLens { field_of_view, aperture_radius, focus_distance };
        let camera = Camera::with_optics(Vec3::ZERO, Vec3::Z, Vec3::Y, thin).unwrap();
        let pinhole = Camera::look(Vec3::ZERO, Vec3::Z, Vec3::Y, field_of_view).unwrap();
        let (view, pinhole) = (camera.view(40, 30), pinhole.view(40, 30));
        assert!(!view.is_pinhole() && pinhole.is_pinhole());
        for (x, y) in [(20.0, 15.0), (0.0, 0.0), (33.0, 8.0)] {
            let (center, _) = pinhole.ray(x, y, [0.0; 2]);
            for (z, radius) in [(4.0, 0.0), (8.0, 0.25), (2.0, 0.125), (12.0, 0.5)] {
                // By similar triangles: aperture radius times |z - focus| / focus.
                let mut widest: f32 = 0.0;
                for lens in lens_points() {
                    let (ray, weight) = view.ray(x, y, lens);
                    assert_eq!(weight, 1.0);
                    assert!((ray.direction.length() - 1.0).abs() < 1e-6);
                    widest = widest.max((at(&ray, z) - at(&center, z)).length());
                }
                assert!((widest - radius).abs() < 1e-4, "{x} {y} {z}: {widest}");
            }
        }
    }

    #[test]
    fn sensor_before_a_uniform_disc_has_the_irradiance_of_the_formula() {
        // On the axis, E = pi L R^2 / (R^2 + d^2).
        let (disc_distance, disc_radius) = (2.0, 1.5);
        let sensor = Optics::Sensor { width: 1e-6, disc_distance, disc_radius, exposure: 3.0 };
        let view = Camera::with_optics(Vec3::ZERO, Vec3::Z, Vec3::Y, sensor).unwrap().view(1, 1);
        let n = 200;
        let midpoints = || (0..n).map(|i| (i as f32 + 0.5) / n as f32);
        let mut sum = 0.0;
        for lens in midpoints().flat_map(|u| midpoints().map(move |v| [u, v])) {
            let (ray, weight) = view.ray(0.5, 0.5, lens);
            assert!(at(&ray, disc_distance).truncate().length() < disc_radius * 1.000_01);
            sum += f64::from(weight);
        }
        let mean = sum / f64::from(n * n);
        let (r2, d2) = (disc_radius * disc_radius, disc_distance * disc_distance);
        let expected = f64::from(3.0 * PI * r2 / (r2 + d2));
        assert!((mean / expected - 1.0).abs() < 1e-4, "{mean} {expected}");
    }

    #[test]
    fn image_of_a_sensor_is_upright() {
        let sensor =
            Optics::Sensor { width: 0.4, disc_distance: 1.0, disc_radius: 1e-4, exposure: 1.0 };
        let view = Camera::with_optics(Vec3::ZERO, Vec3::Z, Vec3::Y, sensor).unwrap().view(20, 10);
        // The top of the image is the lower edge of the sensor, whose light comes from above.
        let (top, _) = view.ray(10.0, 0.0, [0.5; 2]);
        assert!((top.origin - Vec3::new(0.0, -0.1, 0.0)).length() < 1e-6, "{top:?}");
        assert!(top.direction.y > 0.0);
        // The left of the image looks toward +x, as a pinhole camera's does.
        let (left, _) = view.ray(0.0, 5.0, [0.5; 2]);
        assert!((left.origin - Vec3::new(-0.2, 0.0, 0.0)).length() < 1e-6, "{left:?}");
        assert!(left.direction.x > 0.0);
    }

    /// Mean of a function of the rays' directions over the pixels, times the solid angle of all directions that the
    /// image shows in the given projection: its integral over these directions.
    fn integral(view: &View, [w, h]: [u32; 2], density: impl Fn(Vec3) -> f64) -> f64 {
        let mut sum = 0.0;
        for (i, j) in (0..h).flat_map(|j| (0..w).map(move |i| (i, j))) {
            let (ray, weight) = view.ray(i as f32 + 0.5, j as f32 + 0.5, [0.5; 2]);
            assert!((ray.direction.length() - 1.0).abs() < 1e-5);
            sum += f64::from(weight) * density(ray.direction);
        }
        sum
    }

    #[test]
    fn solid_angles_of_pixels_of_panoramas_and_fisheyes_add_up() {
        let size = [512, 512];
        let [w, h] = size.map(f64::from);
        let look = |optics| {
            Camera::with_optics(Vec3::ONE, Vec3::new(1.0, 2.0, 3.0), Vec3::Y, optics).unwrap()
        };
        let panorama = look(Optics::Panorama);
        let (forward, up) = (panorama.direction(), panorama.up());
        let view = panorama.view(512, 512);
        // A pixel of a panorama has the solid angle 2 pi^2 cos(latitude) / (w h).
        let pixel = |d: Vec3| {
            let sine = f64::from(d.dot(up));
            2.0 * f64::from(PI).powi(2) * (1.0 - sine * sine).max(0.0).sqrt() / (w * h)
        };
        let all = integral(&view, size, pixel);
        assert!((all / f64::from(4.0 * PI) - 1.0).abs() < 1e-4, "{all}");
        // The irradiance of a surface that faces forward under radiance 1 from in front is pi.
        let cosine = |d: Vec3| f64::from(d.dot(forward).max(0.0));
        let irradiance = integral(&view, size, |d| pixel(d) * cosine(d));
        assert!((irradiance / f64::from(PI) - 1.0).abs() < 1e-4, "{irradiance}");

        // A pixel of side s, in radii, of a fisheye has the solid angle s^2 sin(t)/r dt/dr.
        let s2 = (2.0 / w) * (2.0 / h);
        for edge in [0.5, 0.5 * f64::from(PI), f64::from(PI)] {
            let field_of_view = (2.0 * edge).to_degrees() as f32;
            for projection in FisheyeProjection::ALL {
                let view = look(Optics::Fisheye { projection, field_of_view }).view(512, 512);
                let pixel = |d: Vec3| {
                    let angle = f64::from(d.dot(forward).clamp(-1.0, 1.0)).acos();
                    match projection {
                        FisheyeProjection::Equidistant => {
                            s2 * edge * edge * (angle.sin() / angle.max(1e-9))
                        }
                        FisheyeProjection::Equisolid => s2 * 4.0 * (0.5 * edge).sin().powi(2),
                    }
                };
                let all = integral(&view, size, pixel);
                let expected = 2.0 * f64::from(PI) * (1.0 - edge.cos());
                assert!((all / expected - 1.0).abs() < 2e-3, "{projection:?} {edge}: {all}");
            }
        }
    }

    #[test]
    fn orthographic_rays_are_parallel_and_span_the_extent() {
        let optics = Optics::Orthographic(Extent::X(6.0));
        let camera = Camera::with_optics(Vec3::ONE, -Vec3::Z, Vec3::Y, optics).unwrap();
        let view = camera.view(30, 20);
        for (x, y, from) in [(0.0, 0.0, [-2.0, 3.0, 1.0]), (30.0, 20.0, [4.0, -1.0, 1.0])] {
            let (ray, weight) = view.ray(x, y, [0.3; 2]);
            assert!((ray.origin - Vec3::from(from)).length() < 1e-5, "{ray:?}");
            assert_eq!((ray.direction, weight), (-Vec3::Z, 1.0));
        }
        let tall = Optics::Orthographic(Extent::Y(6.0));
        let tall = Camera::with_optics(Vec3::ONE, -Vec3::Z, Vec3::Y, tall).unwrap();
        let (ray, _) = tall.view(30, 20).ray(0.0, 0.0, [0.5; 2]);
        assert!((ray.origin - Vec3::new(-3.5, 4.0, 1.0)).length() < 1e-5, "{ray:?}");
        // The adjacent image, half its width away.
        let (ray, _) = camera.shifted([0.5, 0.0]).unwrap().view(30, 20).ray(0.0, 0.0, [0.5; 2]);
        assert!((ray.origin - Vec3::new(1.0, 3.0, 1.0)).length() < 1e-5, "{ray:?}");
    }

    #[test]
    fn panoramas_and_fisheyes_look_along_their_direction_with_up_on_top() {
        let fisheye =
            Optics::Fisheye { projection: FisheyeProjection::Equidistant, field_of_view: 180.0 };
        for optics in [Optics::Panorama, fisheye] {
            let camera = Camera::with_optics(Vec3::ZERO, -Vec3::Z, Vec3::Y, optics).unwrap();
            let view = camera.view(64, 64);
            for (x, y, expected) in [
                (32.0, 32.0, -Vec3::Z),
                (32.0, 0.001, Vec3::Y),
                (32.0, 63.999, -Vec3::Y),
                (if optics == fisheye { 63.999 } else { 48.0 }, 32.0, Vec3::X),
            ] {
                let found = direction(&view, x, y);
                assert!((found - expected).length() < 1e-3, "{optics:?}: {found}, {expected}");
            }
        }
        let camera = Camera::with_optics(Vec3::ZERO, -Vec3::Z, Vec3::Y, fisheye).unwrap();
        assert_eq!(camera.view(64, 64).ray(1.0, 1.0, [0.5; 2]).1, 0.0, "outside the image circle");
    }

    #[test]
    fn impossible_cameras_are_refused() {
        let look = |d, up, degrees| Camera::look(Vec3::ZERO, d, up, FieldOfView::X(degrees));
        assert!(look(Vec3::Y, Vec3::Y, 40.0).is_err());
        assert!(look(Vec3::ZERO, Vec3::Y, 40.0).is_err());
        assert!(look(Vec3::new(f32::NAN, 0.0, 1.0), Vec3::Y, 40.0).is_err());
        for degrees in [0.0, -1.0, 180.0, f32::NAN] {
            assert!(look(Vec3::Z, Vec3::Y, degrees).is_err(), "{degrees}");
        }
        let field_of_view = FieldOfView::Y(40.0);
        let lens = |aperture_radius, focus_distance| {
            let optics = Optics::ThinLens { field_of_view, aperture_radius, focus_distance };
            Camera::with_optics(Vec3::ZERO, Vec3::Z, Vec3::Y, optics)
        };
        lens(0.1, 1.0).unwrap();
        for (radius, distance) in [(0.0, 1.0), (-0.1, 1.0), (0.1, 0.0), (f32::INFINITY, 1.0)] {
            let shown = lens(radius, distance).unwrap_err().to_string();
            assert!(shown.contains("as a positive number"), "{shown}");
        }
        let any = |optics| Camera::with_optics(Vec3::ZERO, Vec3::Z, Vec3::Y, optics);
        assert!(any(Optics::Orthographic(Extent::X(0.0))).is_err());
        assert!(any(Optics::Orthographic(Extent::Y(f32::NAN))).is_err());
        assert!(any(Optics::Panorama).unwrap().shifted([0.1, 0.0]).is_err());
        for field_of_view in [0.0, 361.0, f32::NAN] {
            let projection = FisheyeProjection::Equisolid;
            assert!(any(Optics::Fisheye { projection, field_of_view }).is_err(), "{field_of_view}");
        }
    }
}
