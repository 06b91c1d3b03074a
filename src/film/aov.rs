//! What is kept of a pixel beside its value: light by kind, what is seen there, and parts of the image.
//!
//! All sums are stored as those of the image are: tile after tile, rows within a tile.

mod merge;

use super::radiance::Tile;
use crate::base::math::Rgb;
use glam::{DVec3, Vec3};
use serde::{Deserialize, Serialize};

/// Parts that iterations are dealt out to in turn, so that an image may be compared with what it was not made of.
pub const PARTS: usize = 8;

/// What is to be kept.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct AovSelection {
    /// Light by kind: [`LightComponents`].
    pub light: bool,
    /// What is seen: [`FeatureBuffers`].
    pub features: bool,
    /// Radiance, albedo and normals of each of [`PARTS`] parts.
    pub parts: bool,
}

impl AovSelection {
    /// Bytes of a pixel in each block, and beside the blocks: in memory, and as layers that are written or denoised.
    pub fn bytes_per_pixel(self) -> (usize, usize) {
        let light = if self.light { size_of::<LightComponents>() } else { 0 };
        let radiance = if self.parts { PARTS * size_of::<Rgb>() } else { 0 };
        let guides = if self.parts { PARTS } else { 1 } * size_of::<Guide>() + size_of::<Place>();
        let features = if self.features || self.parts { guides } else { 0 };
        let written = if self.any() { 2 * 20 * size_of::<f32>() } else { 0 };
        // Luminances of parts and of what is left, their moments, and a denoiser's workspace.
        let denoising = if self.parts { PARTS * 5 * size_of::<f64>() + 400 } else { 0 };
        (light + radiance, features + written + denoising)
    }

    /// Whether camera paths have to tell anything.
    pub fn any(self) -> bool {
        self.light || self.features || self.parts
    }
}

/// What one iteration, or one camera path, adds to a pixel.
#[derive(Clone, Copy, Debug, Default)]
pub struct LayerValue {
    /// Of the light.
    pub light: LightComponents,
    /// For a denoiser.
    pub guide: Guide,
    /// Where the first surface is.
    pub place: Place,
}

/// Sums of radiance by kind, W/(m^2 sr). All light that is none of these is indirect.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct LightComponents {
    /// Seen directly, or by mirrors and glass alone.
    pub emission: DVec3,
    /// Of one bounce off what is neither.
    pub direct: DVec3,
    /// The same of light that came through mirrors and glass.
    pub caustics: DVec3,
}

/// Sums of what guides a denoiser: of the first surface that is no mirror and no clear glass.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Guide {
    /// Albedo, tinted by the mirrors and glass before it.
    pub albedo: Rgb,
    /// Unit shading normal on the side that is seen, in world space.
    pub normal: Vec3,
}

/// Sums of where the first surface is, whatever it is made of.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Place {
    /// Scene units.
    pub position: DVec3,
    /// Distance along the camera's axis, scene units.
    pub depth: f64,
    /// Share of the camera paths that hit any surface.
    pub hits: f64,
}

impl LayerValue {
    /// Adds `share` of another.
    #[inline]
    pub fn add(&mut self, other: &Self, share: f64) {
        self.light.add(&other.light, share);
        self.guide.albedo += other.guide.albedo * share as f32;
        self.guide.normal += other.guide.normal * share as f32;
        self.place.add(&other.place, share);
    }

    /// Whether all numbers are finite.
    pub fn is_finite(&self) -> bool {
        let Self { light, guide, place } = self;
        light.emission.is_finite()
            && light.direct.is_finite()
            && light.caustics.is_finite()
            && guide.albedo.is_finite()
            && guide.normal.is_finite()
            && place.position.is_finite()
            && place.depth.is_finite()
    }
}

impl LightComponents {
    /// Adds `share` of others.
    #[inline]
    pub fn add(&mut self, other: &Self, share: f64) {
        self.emission += other.emission * share;
        self.direct += other.direct * share;
        self.caustics += other.caustics * share;
    }
}

impl Place {
    #[inline]
    fn add(&mut self, other: &Self, share: f64) {
        self.position += other.position * share;
        self.depth += other.depth * share;
        self.hits += other.hits * share;
    }
}

/// Distance that is told where no camera path hits anything, as compositing programs have it.
pub const FAR: f32 = 1e10;

/// What is seen in each pixel: over all iterations, whatever their counts.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct FeatureBuffers {
    /// Parts that guides are kept of: one, or [`PARTS`].
    parts: u32,
    /// Of each pixel those of all parts.
    guides: Vec<Guide>,
    places: Vec<Place>,
    /// Iterations of each part.
    iterations: Vec<u64>,
}

/// FeatureBuffers of a tile under way.
#[derive(Debug)]
pub struct FeatureTile<'a> {
    parts: usize,
    part: usize,
    guides: &'a mut [Guide],
    places: &'a mut [Place],
}

impl FeatureTile<'_> {
    /// Adds an iteration's values to the pixel of this number within the tile.
    #[inline]
    pub fn add(&mut self, pixel: usize, value: &LayerValue) {
        let guide = &mut self.guides[pixel * self.parts + self.part];
        guide.albedo += value.guide.albedo;
        guide.normal += value.guide.normal;
        self.places[pixel].add(&value.place, 1.0);
    }
}

impl FeatureBuffers {
    /// Of no iteration.
    pub fn new(pixels: usize, in_parts: bool) -> Self {
        let parts = if in_parts { PARTS } else { 1 };
        Self {
            parts: parts as u32,
            guides: vec![Guide::default(); pixels * parts],
            places: vec![Place::default(); pixels],
            iterations: vec![0; parts],
        }
    }

    /// Whether guides of parts are told apart.
    pub fn is_in_parts(&self) -> bool {
        self.parts as usize == PARTS
    }

    /// Whether it fits an image of so many pixels (it may come from a file).
    pub fn fits(&self, pixels: usize) -> bool {
        let parts = self.parts as usize;
        (parts == 1 || parts == PARTS)
            && self.iterations.len() == parts
            && self.places.len() == pixels
            && self.guides.len() == pixels * parts
    }

    /// Tiles to add the iteration of this number to.
    pub(crate) fn tiles_mut(
        &mut self,
        tiles: impl Iterator<Item = Tile>,
        iteration: u64,
    ) -> Vec<FeatureTile<'_>> {
        let parts = self.parts as usize;
        let part = (iteration % parts as u64) as usize;
        let (mut guides, mut places) = (&mut self.guides[..], &mut self.places[..]);
        let take = |tile: Tile| FeatureTile {
            parts,
            part,
            guides: guides.split_off_mut(..tile.len() * parts).expect("there are as many"),
            places: places.split_off_mut(..tile.len()).expect("there are as many"),
        };
        tiles.map(take).collect()
    }

    /// Takes note that all tiles have it.
    pub(crate) fn end_iteration(&mut self, iteration: u64) {
        let parts = self.iterations.len();
        self.iterations[(iteration % parts as u64) as usize] += 1;
    }

    /// Means over the parts that are taken of a pixel, by its number among those that are stored.
    pub fn guide(&self, pixel: usize, takes: impl Fn(usize) -> bool) -> Guide {
        let parts = self.parts as usize;
        let (mut sum, mut count) = (Guide::default(), 0);
        for part in (0..parts).filter(|&part| takes(part)) {
            let own = &self.guides[pixel * parts + part];
            sum.albedo += own.albedo;
            sum.normal += own.normal;
            count += self.iterations[part];
        }
        let scale = (count.max(1) as f32).recip();
        Guide { albedo: sum.albedo * scale, normal: sum.normal * scale }
    }

    /// Share of a pixel's camera paths that hit any surface.
    pub fn coverage(&self, pixel: usize) -> f32 {
        let iterations: u64 = self.iterations.iter().sum();
        (self.places[pixel].hits / iterations.max(1) as f64) as f32
    }

    /// Means over the camera paths that hit any surface: the position, and the distance along the camera's axis,
    /// [`FAR`] where none does.
    pub fn place(&self, pixel: usize) -> (Vec3, f32) {
        let Place { position, depth, hits } = self.places[pixel];
        if hits > 0.0 {
            ((position / hits).as_vec3(), (depth / hits) as f32)
        } else {
            (Vec3::ZERO, FAR)
        }
    }
}

/// Radiance of the parts of a block's iterations, W/(m^2 sr).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Parts {
    /// Of each pixel those of all parts.
    sums: Vec<Rgb>,
    /// Iterations of each.
    iterations: [u64; PARTS],
}

/// Parts of a tile under way.
#[derive(Debug)]
pub struct PartTile<'a> {
    part: usize,
    sums: &'a mut [Rgb],
}

impl PartTile<'_> {
    /// Adds an iteration's value to the pixel of this number within the tile.
    #[inline]
    pub fn add(&mut self, pixel: usize, value: DVec3) {
        self.sums[pixel * PARTS + self.part] += value.as_vec3();
    }
}

impl Parts {
    /// Of no iteration.
    pub fn new(pixels: usize) -> Self {
        Self { sums: vec![Rgb::ZERO; pixels * PARTS], iterations: [0; PARTS] }
    }

    /// Whether it fits an image of so many pixels.
    pub fn fits(&self, pixels: usize) -> bool {
        self.sums.len() == pixels * PARTS
    }

    /// Tiles to add the iteration of this number, among those of all blocks, to.
    pub(crate) fn tiles_mut(
        &mut self,
        tiles: impl Iterator<Item = Tile>,
        iteration: u64,
    ) -> Vec<PartTile<'_>> {
        let part = (iteration % PARTS as u64) as usize;
        let mut rest = &mut self.sums[..];
        let take = |tile: Tile| {
            let sums = rest.split_off_mut(..tile.len() * PARTS).expect("there are as many");
            PartTile { part, sums }
        };
        tiles.map(take).collect()
    }

    /// Takes note that all tiles have it.
    pub(crate) fn end_iteration(&mut self, iteration: u64) {
        self.iterations[(iteration % PARTS as u64) as usize] += 1;
    }

    /// Iterations of each part.
    pub fn iterations(&self) -> &[u64; PARTS] {
        &self.iterations
    }

    /// Sums of a pixel, by its number among those that are stored.
    pub fn of(&self, pixel: usize) -> &[Rgb] {
        &self.sums[pixel * PARTS..][..PARTS]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::film::radiance::Film;

    #[test]
    fn parts_take_turns_and_features_tell_means() {
        let film = Film::new(20, 3);
        let mut parts = Parts::new(60);
        let mut features = [FeatureBuffers::new(60, false), FeatureBuffers::new(60, true)];
        for iteration in 0..11 {
            let value = iteration as f64;
            for tile in &mut parts.tiles_mut(film.tiles(), iteration) {
                tile.add(1, DVec3::splat(value));
            }
            parts.end_iteration(iteration);
            for features in &mut features {
                for tile in &mut features.tiles_mut(film.tiles(), iteration) {
                    let guide = Guide { albedo: Rgb::splat(value as f32), normal: Vec3::X };
                    let hits = f64::from(u8::from(iteration > 5));
                    let place = Place { position: DVec3::Y * hits, depth: 3.0 * hits, hits };
                    tile.add(1, &LayerValue { guide, place, ..LayerValue::default() });
                }
                features.end_iteration(iteration);
            }
        }
        assert_eq!(parts.iterations(), &[2, 2, 2, 1, 1, 1, 1, 1]);
        // The second pixel of the first tile.
        let sums: Vec<f32> = parts.of(1).iter().map(|sum| sum.x).collect();
        assert_eq!(sums, [8.0, 10.0, 12.0, 3.0, 4.0, 5.0, 6.0, 7.0]);
        assert_eq!(parts.of(0), [Rgb::ZERO; PARTS]);
        for features in &features {
            assert!(features.fits(60) && !features.fits(59));
            let Guide { albedo, normal } = features.guide(1, |_| true);
            assert_eq!((albedo, normal), (Rgb::splat(5.0), Vec3::X));
            assert_eq!(features.place(1), (Vec3::Y, 3.0));
            assert_eq!(features.place(0), (Vec3::ZERO, FAR));
            assert_eq!((features.coverage(0), features.coverage(1)), (0.0, 5.0 / 11.0));
        }
        let one = features[1].guide(1, |part| part == 2);
        assert_eq!(one.albedo, Rgb::splat(6.0));
    }
}
