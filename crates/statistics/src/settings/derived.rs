//! Facts that follow from the settings: sizes, counts, and which techniques they need.

use super::{AllowedLightPaths, Bias, Direct, MisScales, Settings};

impl Settings {
    /// The larger merge radius, scene units: photons are looked up within it.
    #[inline]
    pub fn reach(&self) -> f32 {
        let [caustic, diffuse] = self.merge_radii();
        caustic.max(diffuse)
    }

    /// Merge radii by class of photons, scene units. Where all photons are those of caustics, their
    /// radius is that of every merge.
    #[inline]
    pub fn merge_radii(&self) -> [f32; 2] {
        let only_caustics = self.strategy.has_only_caustics();
        [self.caustic_radius, if only_caustics { self.caustic_radius } else { self.radius }]
    }

    /// Tests whether light paths are traced, and their photons merged.
    #[inline]
    pub fn has_photons(&self) -> bool {
        self.strategy.has_photons()
    }

    /// Tests whether camera paths end where a cache knows the light.
    #[inline]
    pub fn has_cache(&self) -> bool {
        self.strategy.has_cache()
    }

    /// Tests whether pixels share the light of photons or of a cache.
    #[inline]
    pub fn shares_light(&self) -> bool {
        self.strategy.shares_light()
    }

    /// Tests whether the bias of merges or of a cache is measured and corrected: without them there
    /// is none.
    #[inline]
    pub fn corrects_bias(&self) -> bool {
        self.bias == Bias::Reduce && self.shares_light()
    }

    /// Tests whether diffuse vertices are connected with light sources.
    #[inline]
    pub fn connects(&self) -> bool {
        let may_merge = self.has_photons() && !self.strategy.has_only_caustics();
        self.direct == Direct::Connect || !may_merge
    }

    /// Continuations of a light path from its first diffuse vertex, where it survives: `splitting`,
    /// unless light paths end there.
    #[inline]
    pub fn continuations(&self) -> u32 {
        if self.strategy.has_only_caustics() { 1 } else { self.splitting }
    }

    /// Number of independent samples that some light paths are: their sets, or the halves that fill
    /// a cache. theory.md (40e): `M`.
    #[inline]
    pub fn light_samples(&self, light_paths: u32) -> u32 {
        if self.has_cache() { light_paths.min(2) } else { light_paths / self.sobol_set }
    }

    /// Light paths of each of [`Self::light_samples`].
    #[inline]
    pub fn light_sample_size(&self, light_paths: u32) -> f64 {
        match self.has_cache() {
            true => f64::from(light_paths) / f64::from(self.light_samples(light_paths)),
            false => f64::from(self.sobol_set),
        }
    }

    /// The numbers of light paths that an iteration may have, up to `most`.
    pub fn allowed_light_paths(&self, most: u32) -> AllowedLightPaths {
        AllowedLightPaths::new(self.sobol_set, most)
    }

    /// Constants of MIS weights.
    #[inline]
    pub fn mis_scales(&self) -> MisScales {
        self.mis_scales.unwrap_or_else(|| MisScales::new(self.light_paths, self.camera_paths))
    }

    /// Width and height, pixels.
    #[inline]
    pub fn resolution(&self) -> (u32, u32) {
        (self.width, self.height)
    }

    /// Width and height of the full image, pixels. Only a window of it may be rendered.
    #[inline]
    pub fn full_resolution(&self) -> [u32; 2] {
        self.crop.map_or([self.width, self.height], |crop| crop.full)
    }

    /// Number of pixels.
    #[inline]
    pub fn pixels(&self) -> usize {
        self.width as usize * self.height as usize
    }

    /// Tests whether noise coefficients can be measured, which takes two independent samples of
    /// light paths and two camera paths.
    #[inline]
    pub fn can_measure(&self) -> bool {
        self.light_samples(self.light_paths) >= 2 && self.camera_paths >= 2
    }

    /// All settings by name.
    pub fn to_map(&self) -> serde_json::Map<String, serde_json::Value> {
        // Through text, which keeps an f32 such as 0.1 short.
        let text = serde_json::to_string(self).expect("plain numbers and names");
        serde_json::from_str(&text).expect("what was just written")
    }
}
