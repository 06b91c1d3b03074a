//! A camera at a resolution.

use super::FisheyeProjection;
use super::panorama::panorama_direction;
use super::perspective::lens_ray;
use super::sensor::Disc;
use crate::accel::Ray;
use crate::simd::{LANES, Vec3s};
use glam::{Mat3, Vec2, Vec3};

/// Depth of the nearest point of a segment that is projected, over that of its farthest.
const NEAREST: f32 = 1e-4;

/// A camera bound to a resolution.
#[derive(Clone, Copy, Debug)]
pub struct View {
    /// Position of the camera, scene units.
    pub position: Vec3,
    /// From the position to the top left corner of the plane of the pixels.
    pub(super) corner: Vec3,
    /// One pixel to the right.
    pub(super) dx: Vec3,
    /// One pixel down.
    pub(super) dy: Vec3,
    /// One pixel of each square of `stride` by `stride` pixels is taken.
    pub(super) stride: f32,
    pub(super) imaging: Imaging,
}

/// The plane of the pixels.
pub(super) struct PixelPlane {
    /// Distance from the position along the direction.
    pub distance: f32,
    /// Width and height of a pixel there.
    pub pixel: [f32; 2],
    pub imaging: Imaging,
}

/// Selects the ray of a point in the plane of the pixels.
#[derive(Clone, Copy, Debug)]
pub(super) enum Imaging {
    /// From the position through the point.
    Pinhole,
    /// From a disc around the position, given by two radii; the plane of the pixels is in focus.
    Lens([Vec3; 2]),
    /// Through a disc in front of the plane of the pixels.
    Disc(Disc),
    /// From the point along this direction.
    Parallel(Vec3),
    /// From the position by longitude and latitude. The plane of the pixels has unit sides to the
    /// right and up, given by their unit vectors.
    Panorama([Vec3; 2]),
    /// From the position by the projection of a fisheye lens, which shows directions up to this
    /// angle from the axis, radians. The plane of the pixels has an image circle of radius 1.
    Fisheye([Vec3; 2], FisheyeProjection, f32),
}

impl View {
    /// The view of one pixel, of unchanged size, in each square of `stride` by `stride` pixels. The
    /// pixels form a rotated grid that has as many in each row as in each column: a regular grid
    /// could miss objects that are one pixel wide.
    #[must_use]
    pub fn every(self, stride: u32) -> Self {
        Self { stride: stride as f32, ..self }
    }

    /// The view of squares of `side` by `side` pixels instead of pixels.
    #[must_use]
    pub fn binned(self, side: u32) -> Self {
        Self { dx: self.dx * side as f32, dy: self.dy * side as f32, ..self }
    }

    /// A point of the image in the view of all pixels; bit by bit the same point at a stride of 1.
    #[inline(always)]
    pub(in crate::scene) fn full_image_point(&self, x: f32, y: f32) -> [f32; 2] {
        let stride = self.stride;
        if stride == 1.0 {
            return [x, y];
        }
        let (column, row) = (x.floor(), y.floor());
        let within = |n: f32| n - stride * (n / stride).floor();
        [x + (stride - 1.0) * column + within(row), y + (stride - 1.0) * row + within(column)]
    }

    /// Returns true if all pixels are taken.
    pub fn is_of_all_pixels(&self) -> bool {
        self.stride == 1.0
    }

    /// The part of a segment in front of a pinhole camera of all pixels, from one point of the
    /// image to another, pixels from its top left corner; `None` if all of it is behind.
    pub fn projected_segment(&self, ends: [Vec3; 2]) -> Option<[Vec2; 2]> {
        let [from, to] = ends.map(|end| self.in_image(end));
        let nearest = NEAREST * from.z.abs().max(to.z.abs());
        if from.z.max(to.z) <= nearest {
            return None;
        }
        let in_front = |own: Vec3, other: Vec3| {
            let share = (nearest - own.z) / (other.z - own.z);
            let own = if own.z < nearest { own.lerp(other, share) } else { own };
            own.truncate() / own.z
        };
        Some([in_front(from, to), in_front(to, from)])
    }

    /// The point of a segment that is seen at a point of the image on its projection.
    pub fn point_on_segment(&self, ends: [Vec3; 2], at: Vec2) -> Vec3 {
        let [from, to] = ends.map(|end| self.in_image(end));
        // `from + share (to - from)` is a multiple of `(at, 1)`.
        let (over, along) = (from.truncate() - from.z * at, to.z * at - to.truncate());
        let along = along + over;
        let share = over.dot(along) / along.length_squared();
        let share = if share.is_finite() { share.clamp(0.0, 1.0) } else { 0.5 };
        ends[0].lerp(ends[1], share)
    }

    /// A point as `(depth x, depth y, depth)`, where it is seen at `(x, y)`.
    fn in_image(&self, point: Vec3) -> Vec3 {
        Mat3::from_cols(self.dx, self.dy, self.corner).inverse() * (point - self.position)
    }

    /// The ray of a pinhole camera through a point of the scene.
    pub fn ray_to(&self, point: Vec3) -> Ray {
        Ray::new(self.position, (point - self.position).normalize())
    }

    /// Returns true if all rays start at the position and have the weight 1, so that
    /// [`Self::pinhole_directions`] are those of [`Self::ray`].
    #[inline]
    pub fn is_pinhole(&self) -> bool {
        matches!(self.imaging, Imaging::Pinhole)
    }

    /// The ray for the point `(x, y)`, in pixels from the image's top left corner. It has a unit
    /// direction and passes the point of the aperture that `lens` in [0, 1)^2 selects. Also returns
    /// the weight of its radiance in the pixel's value: 0 outside the image circle of a fisheye,
    /// where nothing is visible. theory.md (5).
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
            Imaging::Lens(radii) => (lens_ray(self.position, to_pixel, radii, lens), 1.0),
            Imaging::Disc(disc) => disc.ray(self.position, to_pixel, lens),
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
    use super::super::tests::direction;
    use super::*;
    use crate::scene::camera::{Camera, FieldOfView, Optics};
    use std::collections::HashSet;
    use std::f32::consts::PI;

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
    fn binned_view_has_the_rays_of_squares_of_pixels() {
        let camera = Camera::look(Vec3::ZERO, Vec3::Z, Vec3::Y, FieldOfView::X(60.0)).unwrap();
        let (all, binned) = (camera.view(12, 8), camera.view(12, 8).binned(4));
        for (x, y) in [(0.0, 0.0), (1.25, 1.5), (2.75, 0.5)] {
            let off = direction(&binned, x, y) - direction(&all, 4.0 * x, 4.0 * y);
            assert!(off.length() < 1e-6, "{off}");
        }
    }

    /// Mean of a function of the rays' directions over the pixels, times the solid angle of all
    /// directions that the image shows in the given projection: its integral over these directions.
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
}
