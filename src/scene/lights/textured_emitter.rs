//! Triangles that emit by a picture.

use super::{Emission, LightSample};
use crate::base::math::{Rgb, cosine_hemisphere, luminance, uniform_triangle};
use crate::base::rng::Rng;
use crate::scene::triangle::interpolate;
use crate::scene::{Emitter, Texture, Triangle};
use glam::{DVec3, Vec2, Vec3};
use std::f32::consts::PI;
use std::sync::Arc;

/// Least and most steps along a side where a mean radiance is found.
const STEPS: [f32; 2] = [4.0, 2048.0];
/// About so many points are looked at for all triangles of a mesh.
const POINTS: f32 = 16e6;
/// So much the mean of the whole picture counts for each part of it: wherever a triangle emits, it is
/// chosen at times.
const OVERALL: f32 = 1e-3;

/// What the triangles of a mesh emit by a picture.
pub(in crate::scene) struct TextureEmission<'a> {
    texture: &'a Arc<Texture>,
    factor: Rgb,
    overall: Rgb,
    most_steps: f32,
}

impl<'a> TextureEmission<'a> {
    /// `factor` times the texture's color, W/(m^2 sr), from so many triangles.
    pub fn new(texture: &'a Arc<Texture>, factor: Rgb, triangles: usize) -> Self {
        let most_steps = (POINTS / triangles as f32).sqrt().clamp(STEPS[0], STEPS[1]);
        Self { texture, factor, overall: texture.mean_color(), most_steps }
    }

    /// A triangle of these texture coordinates.
    pub fn emitter(&self, shape: Triangle, uvs: [Vec2; 3]) -> Emitter {
        let own = mean_color(self.texture, uvs, self.most_steps);
        let mean = self.factor * own.lerp(self.overall, OVERALL);
        let (texture, factor) = (self.texture.clone(), self.factor);
        Emitter::Textured(Box::new(TexturedTriangle { shape, uvs, texture, factor, mean }))
    }
}

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
    /// Mean radiance over its area, about, W/(m^2 sr).
    mean: Rgb,
}

impl TexturedTriangle {
    /// Mean radiance over its area, about, W/(m^2 sr).
    pub fn mean(&self) -> Rgb {
        self.mean
    }

    /// Radiance at barycentric weights of the second and third corner, W/(m^2 sr).
    fn radiance(&self, at: [f32; 2]) -> Rgb {
        self.factor * self.texture.color(interpolate(self.uvs, at))
    }

    pub(in crate::scene) fn emit(&self, prob: f32, [a, b, c, d]: [f32; 4]) -> Emission {
        let (shape, at) = (&self.shape, uniform_triangle([a, b]));
        Emission {
            origin: shape.point(at) + shape.normal * shape.offset,
            direction: cosine_hemisphere(shape.normal, [c, d]),
            flux: self.radiance(at) * (PI * shape.area() / prob),
        }
    }

    pub(in crate::scene) fn connect(
        &self,
        from: Vec3,
        prob: f32,
        rng: &mut Rng,
    ) -> Option<LightSample> {
        let mut radiance = Rgb::ZERO;
        let at_point = |at| {
            radiance = self.radiance(at);
            radiance
        };
        let sample = self.shape.connect(from, at_point, prob, rng)?;
        let relative = luminance(radiance) / luminance(self.mean);
        (sample.irradiance != Rgb::ZERO).then_some(LightSample { relative, ..sample })
    }
}

/// Mean color of a picture over a triangle: at the centers of equal parts, each at most half a texel
/// long if that takes no more than `most_steps` along a side.
fn mean_color(texture: &Texture, uvs: [Vec2; 3], most_steps: f32) -> Rgb {
    let [width, height] = texture.size().map(|size| size as f32);
    let [a, b, c] = uvs.map(|uv| uv * Vec2::new(width, height));
    let longest = (b - a).length().max((c - a).length()).max((c - b).length());
    // Coordinates may be too large for numbers.
    let steps = (2.0 * longest).ceil().min(most_steps).max(STEPS[0]) as u32;
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
        let mean = |uvs| mean_color(&texture, uvs, STEPS[1]);
        let mean = 0.5 * (mean([o, u, v]) + mean([u + v, v, u]));
        assert!((texture.mean_color() - expected).abs().max_element() < 1e-6);
        assert!((mean - expected).abs().max_element() < 2e-3, "{mean} {expected}");
    }

    #[test]
    fn wherever_it_emits_it_is_chosen_at_times() {
        // The one bright texel is away from these triangles, or hard to find between the steps.
        let texels = (0..4096).map(|i| if i == 77 { [255; 4] } else { [0, 0, 0, 255] }).collect();
        let texture = Arc::new(Texture::new(64, 64, texels));
        let shape = Triangle::new([Vec3::ZERO, Vec3::X, Vec3::Y], 0);
        for count in [1, 10_000_000] {
            for uvs in [
                [Vec2::ZERO, Vec2::ZERO, Vec2::ZERO],
                [Vec2::ZERO, Vec2::X, Vec2::Y],
                [Vec2::ZERO, f32::MAX * Vec2::X, -f32::MAX * Vec2::ONE],
            ] {
                let emitter = TextureEmission::new(&texture, Rgb::ONE, count).emitter(shape, uvs);
                let power = emitter.power();
                assert!(power.is_finite() && power.min_element() > 0.0, "{uvs:?}: {power}");
            }
        }
    }
}
