//! Triangles that emit by a texture.

use super::{Emission, LightSample};
use crate::base::math::{Rgb, luminance};
use crate::base::rng::Draw;
use crate::scene::triangle::interpolate;
use crate::scene::{Emitter, Texture, Triangle};
use glam::{DVec3, Vec2, Vec3};

use std::sync::Arc;

/// Minimum and maximum number of steps along a side for the mean radiance of a triangle.
const STEPS: [f32; 2] = [4.0, 2048.0];
/// Approximate number of texture lookups for all triangles of a mesh.
const POINTS: f32 = 16e6;
/// Weight of the mean of the whole texture in the mean of a triangle: each triangle that emits is
/// chosen with positive probability, also if the steps miss its bright texels.
const OVERALL: f32 = 1e-3;

/// Emission of a mesh by a texture.
pub(crate) struct TextureEmission<'a> {
    texture: &'a Arc<Texture>,
    factor: Rgb,
    overall: Rgb,
    most_steps: f32,
}

impl<'a> TextureEmission<'a> {
    /// Radiance `factor` times the texture's color, W/(m^2 sr), of a mesh of `triangles` triangles.
    pub fn new(texture: &'a Arc<Texture>, factor: Rgb, triangles: usize) -> Self {
        let most_steps = (POINTS / triangles as f32).sqrt().clamp(STEPS[0], STEPS[1]);
        Self { texture, factor, overall: texture.mean_color(), most_steps }
    }

    /// The emitter of a triangle with these texture coordinates.
    pub fn emitter(&self, shape: Triangle, uvs: [Vec2; 3]) -> Emitter {
        let own = mean_color(self.texture, uvs, self.most_steps);
        let mean = self.factor * own.lerp(self.overall, OVERALL);
        let (texture, factor) = (self.texture.clone(), self.factor);
        Emitter::Textured(Box::new(TexturedTriangle { shape, uvs, texture, factor, mean }))
    }
}

/// A triangle that emits the radiance of a texture from its front. It is chosen by its mean
/// radiance; points on it are chosen uniformly.
#[derive(Clone, Debug, PartialEq)]
pub struct TexturedTriangle {
    /// Its geometry.
    pub shape: Triangle,
    /// Texture coordinates of its corners.
    uvs: [Vec2; 3],
    texture: Arc<Texture>,
    /// Factor of the texture's color, W/(m^2 sr).
    factor: Rgb,
    /// Approximate mean radiance over the triangle, W/(m^2 sr).
    mean: Rgb,
}

impl TexturedTriangle {
    /// Approximate mean radiance over the triangle, W/(m^2 sr).
    pub fn mean(&self) -> Rgb {
        self.mean
    }

    /// Radiance at barycentric weights of the second and third corner, W/(m^2 sr).
    fn radiance(&self, at: [f32; 2]) -> Rgb {
        self.factor * self.texture.color(interpolate(self.uvs, at))
    }

    pub(super) fn emit(&self, prob: f32, numbers: [f32; 4]) -> Emission {
        self.shape.emit(|at| self.radiance(at), prob, numbers)
    }

    pub(super) fn connect(
        &self,
        from: Vec3,
        prob: f32,
        rng: &mut impl Draw,
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

/// Mean color of a texture over a triangle, from the centers of equal parts. Each part is at most
/// half a texel long if that takes at most `most_steps` steps along a side.
fn mean_color(texture: &Texture, uvs: [Vec2; 3], most_steps: f32) -> Rgb {
    let [width, height] = texture.size().map(|size| size as f32);
    let [a, b, c] = uvs.map(|uv| uv * Vec2::new(width, height));
    let longest = (b - a).length().max((c - a).length()).max((c - b).length());
    // The length may overflow.
    let steps = (2.0 * longest).ceil().min(most_steps).max(STEPS[0]) as u32;
    let mut sum = DVec3::ZERO;
    for i in 0..steps {
        for j in 0..steps - i {
            // A part in the orientation of the whole, and beside it, but at the edge, one that is
            // turned around.
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
    fn mean_color_of_a_texture_is_the_mean_of_its_texels() {
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
    fn triangles_with_rare_bright_texels_have_positive_mean() {
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
