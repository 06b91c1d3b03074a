//! A sensor that receives light through a disc, behind lenses of the scene.

use crate::accel::Ray;
use crate::base::math::{disc_area, uniform_disc};
use glam::Vec3;

/// The disc in front of a sensor.
#[derive(Clone, Copy, Debug)]
pub(super) struct Disc {
    /// From the sensor's center to that of the disc.
    center: Vec3,
    /// Radii to the right and up.
    radii: [Vec3; 2],
    /// Product of its area, the squared distance of the planes, and the exposure.
    weight: f32,
}

impl Disc {
    /// The disc at a distance along the unit vector `forward` in the plane of the unit vectors
    /// `axes`, exposed for so many seconds.
    pub fn new(forward: Vec3, distance: f32, axes: [Vec3; 2], radius: f32, exposure: f32) -> Self {
        // theory.md (6), with the next use of `weight`
        let weight = exposure * disc_area(radius) * distance * distance;
        Self { center: distance * forward, radii: axes.map(|axis| radius * axis), weight }
    }

    /// The ray from the point `to_pixel` of the sensor with its center at `position` through the
    /// point of the disc that `sample` selects, and the weight of its radiance.
    pub fn ray(&self, position: Vec3, to_pixel: Vec3, sample: [f32; 2]) -> (Ray, f32) {
        let ([u, v], [x, y]) = (uniform_disc(sample), self.radii);
        let across = self.center + u * x + v * y - to_pixel;
        // Irradiance from a disc of area A in a plane at distance d: the mean over the disc
        // of L cos^2(theta) A / s^2, and cos(theta) = d/s.
        let s2 = across.length_squared();
        (Ray::new(position + to_pixel, across.normalize()), self.weight / (s2 * s2))
    }
}

#[cfg(test)]
mod tests {
    use crate::scene::camera::{Camera, Optics};
    use glam::Vec3;
    use std::f32::consts::PI;

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
            assert!(
                (ray.direction * (disc_distance / ray.direction.z)).truncate().length()
                    < disc_radius * 1.000_01
            );
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
}
