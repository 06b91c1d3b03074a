//! Triangles that emit by a picture.

use super::light::{Emission, LightSample};
use super::{Texture, Triangle, interpolate};
use crate::math::{Rgb, cosine_hemisphere, uniform_triangle};
use crate::rng::Rng;
use glam::{DVec3, Vec2, Vec3};
use std::f32::consts::PI;
use std::sync::Arc;

/// Least and most steps along a side where the mean radiance is found: what is dark at all of them is
/// never chosen.
const STEPS: [f32; 2] = [4.0, 2048.0];

/// A triangle of which each point emits the texture's radiance from the front to all sides. It is
/// chosen by its mean radiance, points on it as on any triangle.
#[derive(Clone, Debug, PartialEq)]
pub struct TexturedTriangle {
    /// Its geometry.
    pub shape: Triangle,
    /// Texture coordinates of its corners.
    uvs: [Vec2; 3],
    texture: Arc<Texture>,
    /// What the texture is multiplied with, W/(m^2 sr).
    factor: Rgb,
    /// Mean radiance over its area, W/(m^2 sr).
    mean: Rgb,
}

impl TexturedTriangle {
    /// A triangle that emits `factor` times the texture's color, W/(m^2 sr).
    pub fn new(shape: Triangle, uvs: [Vec2; 3], texture: Arc<Texture>, factor: Rgb) -> Self {
        let mean = factor * mean_color(&texture, uvs);
        Self { shape, uvs, texture, factor, mean }
    }

    /// Mean radiance over its area, W/(m^2 sr).
    pub fn mean(&self) -> Rgb {
        self.mean
    }

    /// Radiance at barycentric weights of the second and third corner, W/(m^2 sr).
    fn radiance(&self, at: [f32; 2]) -> Rgb {
        self.factor * self.texture.color(interpolate(self.uvs, at))
    }

    #[inline(never)] // keeps the loop over other lights short
    pub(super) fn emit(&self, prob: f32, rng: &mut Rng) -> Emission {
        let (shape, at) = (&self.shape, uniform_triangle(rng.next_2d()));
        Emission {
            origin: shape.point(at) + shape.normal * shape.offset,
            direction: cosine_hemisphere(shape.normal, rng.next_2d()),
            flux: self.radiance(at) * (PI * shape.area() / prob),
        }
    }

    #[inline(never)] // as above
    pub(super) fn connect(&self, from: Vec3, prob: f32, rng: &mut Rng) -> Option<LightSample> {
        let sample = self.shape.connect(from, |at| self.radiance(at), prob, rng)?;
        (sample.irradiance != Rgb::ZERO).then_some(sample)
    }
}

/// Mean color of a picture over a triangle: at the centers of equal parts, each at most half a texel
/// long where the picture is not too large.
fn mean_color(texture: &Texture, uvs: [Vec2; 3]) -> Rgb {
    let [width, height] = texture.size().map(|size| size as f32);
    let [a, b, c] = uvs.map(|uv| uv * Vec2::new(width, height));
    let longest = (b - a).length().max((c - a).length()).max((c - b).length());
    let steps = (2.0 * longest).ceil().clamp(STEPS[0], STEPS[1]) as u32;
    let mut sum = DVec3::ZERO;
    for i in 0..steps {
        for j in 0..steps - i {
            // A part as the whole lies, and beside it one that is turned around, but at the edge.
            let turned = (i + j + 1 < steps).then_some(2.0 / 3.0);
            for inside in [Some(1.0 / 3.0), turned].into_iter().flatten() {
                let at = [i, j].map(|k| (k as f32 + inside) / steps as f32);
                sum += texture.color(interpolate(uvs, at)).as_dvec3();
            }
        }
    }
    (sum / (f64::from(steps) * f64::from(steps))).as_vec3()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_mean_of_a_picture_is_that_of_its_texels() {
        // Repeated, each texel of the picture counts alike over two triangles that make a square.
        let texels: Vec<[u8; 4]> = (0..35).map(|i| [7 * i, 255 - 5 * i, 3, 255]).collect();
        let texture = Texture::new(7, 5, texels.clone());
        let lone = |texel: [u8; 4]| Texture::new(1, 1, vec![texel]).color(Vec2::ZERO);
        let expected: Rgb = texels.into_iter().map(lone).sum::<Rgb>() / 35.0;
        let [o, u, v] = [Vec2::ZERO, 3.0 * Vec2::X, 2.0 * Vec2::Y];
        let mean = 0.5 * (mean_color(&texture, [o, u, v]) + mean_color(&texture, [u + v, v, u]));
        assert!((mean - expected).abs().max_element() < 2e-3, "{mean} {expected}");
    }
}
