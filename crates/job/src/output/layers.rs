//! Layers of an image file.

use bdpm_core::base::math::Rgb;
use bdpm_core::film::aov::AovSelection;
use bdpm_core::film::light_components::LightComponents;
use bdpm_core::image_io::Layer;
use bdpm_core::render::accumulators::SharedStatistics;
use bdpm_core::render::block::CombinedImage;
use glam::Vec3;
use std::ops::Range;

/// Name of a layer, or of all or no layers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LayerName {
    /// All layers.
    All,
    /// No layer.
    None,
    /// Color of the first surface that is neither a mirror nor clear glass.
    Albedo,
    /// Shading normal of the first surface that is neither a mirror nor clear glass, in world
    /// space.
    Normal,
    /// Distance of the first surface along the axis of the camera.
    Depth,
    /// Position of the first surface, in world space.
    Position,
    /// Share of the camera paths that hit a surface.
    Alpha,
    /// Light sources, seen directly or through mirrors and clear glass.
    Emission,
    /// Light with one bounce.
    Direct,
    /// Light with several bounces.
    Indirect,
    /// Light with one bounce that passed mirrors or glass.
    Caustics,
}

impl LayerName {
    /// All names.
    pub const ALL: [Self; 11] = [
        Self::All,
        Self::None,
        Self::Albedo,
        Self::Normal,
        Self::Depth,
        Self::Position,
        Self::Alpha,
        Self::Emission,
        Self::Direct,
        Self::Indirect,
        Self::Caustics,
    ];

    /// The layer's name in files.
    pub fn name(self) -> &'static str {
        match self {
            Self::All => "all",
            Self::None => "none",
            Self::Albedo => "albedo",
            Self::Normal => "normal",
            Self::Depth => "depth",
            Self::Position => "position",
            Self::Alpha => "alpha",
            Self::Emission => "emission",
            Self::Direct => "direct",
            Self::Indirect => "indirect",
            Self::Caustics => "caustics",
        }
    }

    /// The layer of this name.
    pub fn named(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|layer| layer.name() == name)
    }

    /// A description for users.
    pub fn describe(self) -> &'static str {
        match self {
            Self::All => "All layers",
            Self::None => "No layer",
            Self::Albedo => "Color of the first surface that is neither a mirror nor clear glass",
            Self::Normal => "Shading normal of the same surface, in world space",
            Self::Depth => "Distance of the first surface along the axis of the camera",
            Self::Position => "Position of the first surface, in world space",
            Self::Alpha => "Share of the camera paths that hit a surface",
            Self::Emission => "Light sources, seen directly or through mirrors and clear glass",
            Self::Direct => "Light with one bounce",
            Self::Indirect => "Light with several bounces",
            Self::Caustics => "Light with one bounce that passed mirrors or glass",
        }
    }

    fn is_light(self) -> bool {
        matches!(self, Self::Emission | Self::Direct | Self::Indirect | Self::Caustics)
    }
}

/// The layers that the user selected.
#[derive(Clone, Debug)]
pub struct LayerSelection(Vec<LayerName>);

impl LayerSelection {
    /// Selects these layers, or all layers if there are none.
    pub fn new(names: &[LayerName]) -> Self {
        let names = if names.is_empty() { &[LayerName::All] } else { names };
        Self(names.to_vec())
    }

    fn has(&self, name: LayerName) -> bool {
        self.0.contains(&name) || self.0.contains(&LayerName::All)
    }

    /// Statistics that a job must accumulate for these layers.
    pub fn aovs(&self) -> AovSelection {
        let all = self.0.contains(&LayerName::All);
        let light = all || self.0.iter().any(|name| name.is_light());
        let features =
            all || self.0.iter().any(|name| !name.is_light() && *name != LayerName::None);
        AovSelection { light, features, folds: false, halves: false }
    }

    /// The selected layers of some rows of an image, as far as their statistics were accumulated.
    /// `pixels` are the image's pixels in these rows; the sum of the light layers is equal to them.
    pub fn layers(
        &self,
        shared: &SharedStatistics,
        image: &CombinedImage,
        rows: Range<u32>,
        pixels: &[Rgb],
    ) -> Vec<Layer> {
        let mut layers = self.first_hit_layers(shared, image, rows.clone());
        if self.aovs().light
            && let Some(light) = image.light_rows(shared, rows)
        {
            layers.extend(self.light_layers(&light, pixels));
        }
        layers
    }

    fn first_hit_layers(
        &self,
        shared: &SharedStatistics,
        image: &CombinedImage,
        rows: Range<u32>,
    ) -> Vec<Layer> {
        let Some(features) = shared.features.as_ref().filter(|_| self.aovs().features) else {
            return Vec::new();
        };
        let hit: &dyn Fn(usize) -> ((Vec3, f32), f32) =
            match (&shared.first_hits, &shared.compact_hits) {
                (Some(hits), _) => &|at| (hits.mean_hit(at), hits.coverage(at)),
                (None, Some(hits)) => &|at| (hits.mean_hit(at), hits.coverage(at)),
                (None, None) => return Vec::new(),
            };
        type Look = (Vec3, Vec3, Vec3, [f32; 2]);
        let look = |at: usize| -> Look {
            let (guide, ((position, depth), coverage)) = (features.mean(at, |_| true), hit(at));
            (guide.albedo, guide.normal, position, [depth, coverage])
        };
        let seen: Vec<Look> = rows.flat_map(|y| image.indices_of_row(y)).map(look).collect();
        let three = |name: &str, of: fn(&Look) -> Vec3, channels: [&str; 3]| {
            let channel = |axis: usize| seen.iter().map(|seen| of(seen)[axis]).collect();
            let channels = channels.iter().enumerate();
            let channels = channels.map(|(axis, &name)| (name.to_owned(), channel(axis)));
            Layer { name: name.into(), channels: channels.collect() }
        };
        let (rgb, xyz) = (["R", "G", "B"], ["X", "Y", "Z"]);
        let mut layers = Vec::new();
        let mut add = |name, layer: &dyn Fn() -> Layer| {
            if self.has(name) {
                layers.push(layer());
            }
        };
        add(LayerName::Albedo, &|| three("albedo", |seen| seen.0, rgb));
        add(LayerName::Normal, &|| three("normal", |seen| seen.1, xyz));
        add(LayerName::Position, &|| three("position", |seen| seen.2, xyz));
        let one = |name: &str, of: usize, channel: &str| {
            let values = seen.iter().map(|seen| seen.3[of]).collect();
            Layer { name: name.into(), channels: vec![(channel.into(), values)] }
        };
        add(LayerName::Depth, &|| one("depth", 0, "Z"));
        add(LayerName::Alpha, &|| one("alpha", 1, "Y"));
        layers
    }

    fn light_layers(&self, light: &[LightComponents], pixels: &[Rgb]) -> Vec<Layer> {
        let mut layers = Vec::new();
        let mut add = |name, of: &dyn Fn(&LightComponents, Rgb) -> Rgb, layer: &str| {
            if self.has(name) {
                let values: Vec<Rgb> =
                    light.iter().zip(pixels).map(|(light, pixel)| of(light, *pixel)).collect();
                layers.push(Layer::rgb(layer, &values));
            }
        };
        add(LayerName::Emission, &|light, _| light.emission.as_vec3(), "emission");
        add(LayerName::Direct, &|light, _| light.direct.as_vec3(), "direct");
        // Rounding errors are not light.
        let rest = |light: &LightComponents, pixel: Rgb| {
            let others = light.emission + light.direct + light.caustics;
            (pixel.as_dvec3() - others).as_vec3().max(Rgb::ZERO)
        };
        add(LayerName::Indirect, &rest, "indirect");
        add(LayerName::Caustics, &|light, _| light.caustics.as_vec3(), "caustics");
        layers
    }
}
