//! Triangles whose emission varies: by a texture, and by the share of rays that meet them.

use super::triangle_points::TrianglePoint;
use super::{Emission, LightSample};
use crate::base::math::{Rgb, luminance};
use crate::scene::alpha_mask::AlphaMask;
use crate::scene::triangle::interpolate;
use crate::scene::{Emitter, Material, Texture, Triangle};
use glam::{DVec3, Vec2};

use std::sync::Arc;

/// Minimum and maximum number of steps along a side for the mean radiance of a triangle.
const STEPS: [f32; 2] = [4.0, 2048.0];
/// Approximate number of texture lookups for all triangles of a mesh.
const POINTS: f32 = 16e6;
/// Weight of the mean of the whole texture in the mean of a triangle: each triangle that emits is
/// chosen with positive probability, also if the steps miss its bright texels.
const OVERALL: f32 = 1e-3;

/// Emission of a mesh that varies, or of one that a share of the rays passes.
pub(crate) struct TextureEmission<'a> {
    texture: Option<&'a Arc<Texture>>,
    opacity: Option<AlphaMask>,
    factor: Rgb,
    overall: Rgb,
    most_steps: f32,
}

impl<'a> TextureEmission<'a> {
    /// The emission of a material on a mesh of `triangles` triangles; `None` if it is uniform.
    pub fn of(material: &'a Material, triangles: usize) -> Option<Self> {
        let texture = material.emission_texture.as_ref();
        let opacity = material.alpha_mask();
        if texture.is_none() && opacity.is_none() {
            return None;
        }
        let most_steps = (POINTS / triangles as f32).sqrt().clamp(STEPS[0], STEPS[1]);
        let overall = texture.map_or(Rgb::ONE, |texture| texture.mean_color());
        let share = opacity.as_ref().and_then(|opacity| opacity.factor).unwrap_or(1.0);
        let overall = share * overall;
        Some(Self { texture, opacity, factor: material.emission, overall, most_steps })
    }

    /// The emitter of a triangle with these texture coordinates.
    pub fn emitter(&self, shape: Triangle, uvs: [Vec2; 3]) -> Emitter {
        let (texture, opacity) = (self.texture.cloned(), self.opacity.clone());
        let mut panel =
            TexturedTriangle { shape, uvs, texture, opacity, factor: self.factor, mean: Rgb::ZERO };
        let own = panel.mean_color(self.most_steps);
        panel.mean = self.factor * own.lerp(self.overall, OVERALL);
        Emitter::Textured(Box::new(panel))
    }
}

/// A triangle whose front emits the radiance of a texture, times the share of rays that meet it. It
/// is chosen by its mean radiance; points on it are chosen uniformly.
#[derive(Clone, Debug, PartialEq)]
pub struct TexturedTriangle {
    /// Its geometry.
    pub shape: Triangle,
    /// Texture coordinates of its corners.
    uvs: [Vec2; 3],
    /// `None` if only the opacity varies.
    texture: Option<Arc<Texture>>,
    /// Share of the rays that meet it; `None` if all do.
    opacity: Option<AlphaMask>,
    /// Factor of the texture's color, W/(m^2 sr).
    factor: Rgb,
    /// Approximate mean radiance over the triangle, W/(m^2 sr).
    mean: Rgb,
}

impl TexturedTriangle {
    /// Approximate mean radiance over the triangle, W/(m^2 sr). A ray that meets the triangle sees
    /// more where not all do.
    pub fn mean(&self) -> Rgb {
        self.mean
    }

    /// Approximate mean radiance that rays see which meet the triangle, W/(m^2 sr).
    pub fn seen_mean(&self) -> Rgb {
        let share = self.opacity.as_ref().and_then(|opacity| opacity.factor).unwrap_or(1.0);
        self.mean / share.max(f32::MIN_POSITIVE)
    }

    /// The back of the triangle.
    pub(in crate::scene) fn flipped(&self) -> Self {
        let [a, b, c] = self.uvs;
        Self { shape: self.shape.flipped(), uvs: [a, c, b], ..self.clone() }
    }

    /// Color at barycentric weights of the second and third corner, times the share of rays that
    /// meet the triangle there.
    fn color(&self, at: [f32; 2]) -> Rgb {
        let uv = interpolate(self.uvs, at);
        let color = self.texture.as_ref().map_or(Rgb::ONE, |texture| texture.color(uv));
        match &self.opacity {
            None => color,
            Some(opacity) => opacity.opacity(uv) * color,
        }
    }

    /// Radiance at barycentric weights of the second and third corner, W/(m^2 sr).
    fn radiance(&self, at: [f32; 2]) -> Rgb {
        self.factor * self.color(at)
    }

    pub(super) fn emit(&self, prob: f32, numbers: [f32; 4]) -> Emission {
        self.shape.emit(|at| self.radiance(at), prob, numbers)
    }

    /// Connects a point of the triangle; the light was chosen with probability `prob`.
    pub(super) fn connect_point(&self, point: &TrianglePoint, prob: f32) -> Option<LightSample> {
        let radiance = self.radiance(point.weights);
        let sample = point.sample(radiance, prob)?;
        let relative = luminance(radiance) / luminance(self.mean);
        (sample.irradiance != Rgb::ZERO).then_some(LightSample { relative, ..sample })
    }

    /// Mean color over the triangle, from the centers of equal parts. Each part is at most half a
    /// texel long if that takes at most `most_steps` steps along a side.
    fn mean_color(&self, most_steps: f32) -> Rgb {
        let mask = self.opacity.as_ref().and_then(|opacity| opacity.texture.as_ref());
        let pictures = [self.texture.as_ref(), mask].into_iter().flatten();
        let size = pictures.fold(Vec2::ZERO, |largest, picture| {
            largest.max(Vec2::from(picture.size().map(|size| size as f32)))
        });
        let [a, b, c] = self.uvs.map(|uv| uv * size);
        let longest = (b - a).length().max((c - a).length()).max((c - b).length());
        // The length may overflow.
        let steps = (2.0 * longest).ceil().min(most_steps).max(STEPS[0]) as u32;
        let mut sum = DVec3::ZERO;
        for i in 0..steps {
            for j in 0..steps - i {
                // A part in the orientation of the whole, and beside it, but at the edge, one that
                // is turned around.
                let turned = (i + j + 1 < steps).then_some(2.0 / 3.0);
                for inside in [Some(1.0 / 3.0), turned].into_iter().flatten() {
                    let at = [i, j].map(|k| (k as f32 + inside) / steps as f32);
                    sum += self.color(at).as_dvec3();
                }
            }
        }
        (sum / (f64::from(steps) * f64::from(steps))).as_vec3()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::bsdf::Bsdf;
    use glam::Vec3;

    /// A material that emits by a texture.
    fn glowing(texture: Arc<Texture>) -> Material {
        let black = Material::new("", Bsdf::diffuse(Rgb::ZERO));
        Material { emission: Rgb::ONE, emission_texture: Some(texture), ..black }
    }

    #[test]
    fn emission_is_in_proportion_to_the_share_of_rays_that_meet_the_surface() {
        let gray = |code| Some(Arc::new(Texture::new(1, 1, vec![[code, code, code, 255]])));
        let black = Material::new("", Bsdf::diffuse(Rgb::ZERO));
        let lamp = Material { emission: Rgb::splat(2.0), ..black };
        let shape = Triangle::new([Vec3::ZERO, Vec3::X, Vec3::Y], 0);
        for (opacity_texture, opacity, share) in [
            (None, Some(0.25), 0.25),
            (gray(51), Some(1.0), 0.2),
            (gray(51), None, 0.0),
            (gray(204), None, 1.0),
        ] {
            let material = Material { opacity_texture, opacity, ..lamp.clone() };
            let emission = TextureEmission::of(&material, 1).unwrap();
            let Emitter::Textured(panel) = emission.emitter(shape, [Vec2::ZERO; 3]) else {
                unreachable!()
            };
            let radiance = panel.radiance([0.3, 0.3]);
            assert!((radiance - 2.0 * share).abs().max_element() < 1e-6, "{radiance}");
            assert!((panel.mean() - 2.0 * share).abs().max_element() < 3e-3, "{}", panel.mean());
            assert_eq!(material.emission_at(Vec2::ZERO), Rgb::splat(2.0), "as rays see it");
        }
        assert!(TextureEmission::of(&lamp, 1).is_none());
    }

    #[test]
    fn mean_color_of_a_texture_is_the_mean_of_its_texels() {
        // Repeated, each texel of the picture counts alike over two triangles that make a square.
        let texels: Vec<[u8; 4]> = (0..35).map(|i| [7 * i, 255 - 5 * i, 3, 255]).collect();
        let texture = Texture::new(7, 5, texels.clone());
        let lone = |texel: [u8; 4]| Texture::new(1, 1, vec![texel]).color(Vec2::ZERO);
        let expected: Rgb = texels.into_iter().map(lone).sum::<Rgb>() / 35.0;
        let [o, u, v] = [Vec2::ZERO, 3.0 * Vec2::X, 2.0 * Vec2::Y];
        let shape = Triangle::new([Vec3::ZERO, Vec3::X, Vec3::Y], 0);
        let material = glowing(Arc::new(texture.clone()));
        let emission = TextureEmission::of(&material, 1).unwrap();
        let mean = |uvs| {
            let Emitter::Textured(panel) = emission.emitter(shape, uvs) else { unreachable!() };
            panel.mean_color(STEPS[1])
        };
        let mean = 0.5 * (mean([o, u, v]) + mean([u + v, v, u]));
        assert!((texture.mean_color() - expected).abs().max_element() < 1e-6);
        assert!((mean - expected).abs().max_element() < 2e-3, "{mean} {expected}");
    }

    #[test]
    fn triangles_with_rare_bright_texels_have_positive_mean() {
        // The one bright texel is away from these triangles, or hard to find between the steps.
        let texels = (0..4096).map(|i| if i == 77 { [255; 4] } else { [0, 0, 0, 255] }).collect();
        let material = glowing(Arc::new(Texture::new(64, 64, texels)));
        let shape = Triangle::new([Vec3::ZERO, Vec3::X, Vec3::Y], 0);
        for count in [1, 10_000_000] {
            for uvs in [
                [Vec2::ZERO, Vec2::ZERO, Vec2::ZERO],
                [Vec2::ZERO, Vec2::X, Vec2::Y],
                [Vec2::ZERO, f32::MAX * Vec2::X, -f32::MAX * Vec2::ONE],
            ] {
                let emission = TextureEmission::of(&material, count).unwrap();
                let emitter = emission.emitter(shape, uvs);
                let power = emitter.power();
                assert!(power.is_finite() && power.min_element() > 0.0, "{uvs:?}: {power}");
            }
        }
    }
}
