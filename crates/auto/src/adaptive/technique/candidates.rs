//! The techniques that the pilot tries, by what is open and by the scene.

use super::{FreeParameters, Technique};
use bdpm_core::render::Renderer;
use bdpm_core::render::photon_only_light::{has_rare_sunlight, placed_materials};
use bdpm_core::scene::{Emitter, Material, Media};
use bdpm_core::settings::{Direct, MediumQuery, Settings, Strategy};

/// Optical thickness of a scene full of its densest medium from which on merging around points is
/// tried, too. In thin media, segments have far less noise for the same time: 50 times less
/// variance in scenes/smoke (docs/how-to/media.md).
const DENSE: f32 = 4.0;

/// Properties of a scene that decide about candidates.
#[derive(Clone, Copy, Debug, Default)]
pub struct SceneTraits {
    /// Camera paths cannot find all light, or hardly: light sources that no ray can hit, or a sun
    /// in a map, may show in mirrors or through glass.
    pub needs_photons: bool,
    /// Mirrors or glass may cast caustics.
    pub has_casters: bool,
    /// Media scatter light.
    pub media_scatter: bool,
    /// They may scatter it several times.
    pub media_are_dense: bool,
    /// The image is denoised.
    pub is_denoised: bool,
    /// Pixels are meters.
    pub has_meters: bool,
}

impl SceneTraits {
    /// Traits of the scene of a renderer.
    pub fn new(renderer: &Renderer, is_denoised: bool) -> Self {
        let (scene, _) = renderer.scene_and_accel();
        let has_delta_lights = scene.lights().emitters().iter().any(Emitter::is_delta);
        let is_smooth = |own: &Material| {
            let passes = own.bsdf.passes_through() && !own.bsdf.has_rough();
            // Connections pass boundaries of media.
            passes && !own.is_index_matched_boundary()
        };
        let has_casters = placed_materials(scene).any(is_smooth);
        let is_dense = |media: &Media| media.largest_extinction() * scene.size() > DENSE;
        Self {
            needs_photons: has_delta_lights && has_casters || has_rare_sunlight(scene),
            has_casters,
            media_scatter: scene.media().is_some_and(Media::any_scatters),
            media_are_dense: scene.media().is_some_and(is_dense),
            is_denoised,
            has_meters: scene.meters().is_some(),
        }
    }

    /// Strategies that may be chosen, with their merge vertices.
    fn strategies(&self) -> Vec<(Strategy, u32)> {
        let Self { needs_photons, has_casters, .. } = *self;
        // Most light in media that scatter does not come from surfaces.
        let may_cache = !self.media_scatter && !self.has_meters;
        let of_caustics = !self.media_scatter && (needs_photons || has_casters);
        let all = [
            (Strategy::Single, 1, true),
            (Strategy::Mis, 2, true),
            (Strategy::CutMis, 2, true),
            // Where several techniques are weighted, they have less noise; but a denoiser removes
            // more of what is gathered by paths of single pixels.
            (Strategy::Single, 2, self.is_denoised || self.media_scatter),
            (Strategy::Path, 2, !needs_photons),
            (Strategy::Gather, 2, !needs_photons && may_cache),
            (Strategy::PathCaustics, 2, of_caustics),
            (Strategy::GatherCaustics, 2, of_caustics && may_cache),
        ];
        let sensible = all.into_iter().filter(|(_, _, is_sensible)| *is_sensible);
        sensible.map(|(strategy, merge_vertex, _)| (strategy, merge_vertex)).collect()
    }
}

impl Technique {
    /// All techniques that may be chosen instead of that of `settings`, for an image that needs
    /// only `traits`.
    pub(super) fn candidates(
        settings: &Settings,
        open: FreeParameters,
        traits: SceneTraits,
    ) -> Vec<Self> {
        let own = Self::of(settings);
        let strategies = match open.strategy {
            true => traits.strategies(),
            false => vec![(own.strategy, own.merge_vertex)],
        };
        let direct = if open.direct { Direct::Connect } else { own.direct };
        let mut ways: Vec<_> = strategies.into_iter().map(|strategy| (strategy, direct)).collect();
        // Direct light from the photon map pays only where all light is merged at the first vertex.
        let first = (Strategy::Single, 1);
        if open.direct && ways.iter().any(|(strategy, _)| *strategy == first) {
            ways.push((first, Direct::PhotonMap));
        }
        let mut all = Vec::new();
        for ((strategy, merge_vertex), direct) in ways {
            let splitting = if open.splitting { 1 } else { own.splitting };
            let plain = Self { strategy, merge_vertex, direct, splitting, ..own };
            let of = |query| Self { medium_query: Some(query), ..plain };
            match traits.media_scatter && strategy.has_photons() {
                false => all.push(plain),
                true if !open.medium_query => all.push(of(settings.medium_query)),
                true if traits.media_are_dense => {
                    all.extend([MediumQuery::Points, MediumQuery::Beams].map(of));
                }
                true => all.push(of(MediumQuery::Beams)),
            }
        }
        all
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::test_scene::TestScene;
    use std::path::Path;

    fn settings() -> Settings {
        Settings::resolve(&Default::default(), &Default::default(), 1.0).unwrap()
    }

    /// Strategies that are tried in this scene.
    fn strategies(scene: impl AsRef<Path>) -> Vec<Strategy> {
        let scene = TestScene::new(scene, [16, 16]);
        let traits = SceneTraits::new(&scene.renderer(&scene.settings), false);
        let all = Technique::candidates(&scene.settings, FreeParameters::ALL, traits);
        all.iter().map(|technique| technique.strategy).collect()
    }

    #[test]
    fn path_tracing_is_no_candidate_where_it_would_miss_light() {
        // The first lacks glass and mirrors, the second lights that no ray can hit.
        for (name, is_candidate) in
            [("cornell-box", true), ("caustic-sphere", true), ("materials", false), ("hall", false)]
        {
            let all = strategies(name);
            assert_eq!(all.contains(&Strategy::Path), is_candidate, "{name}");
            // Where it would miss light, photons of caustics find that.
            let has_casters = name != "cornell-box";
            for of_caustics in [Strategy::PathCaustics, Strategy::GatherCaustics] {
                assert_eq!(all.contains(&of_caustics), has_casters, "{name}");
            }
        }
    }

    /// Path tracing finds the light that a sun sends through a pane by single rays that hit the
    /// sun. Through an opening, and with a sky alone, every vertex is connected.
    #[test]
    fn path_tracing_is_no_candidate_for_the_sun_behind_a_pane() {
        let sun = "sun_direction = [-0.7, 0.6, 0.2]";
        let overcast = "model = 'cie'\ncie_type = 1\ndiffuse_lx = 10000";
        let cases = [
            (sun, "type = 'thin-dielectric'\nior = 1.5", false),
            (sun, "type = 'lambertian'\nalbedo = 0.5", true),
            (overcast, "type = 'thin-dielectric'\nior = 1.5", true),
        ];
        for (sky, pane, is_candidate) in cases {
            let folder = tempfile::tempdir().unwrap();
            let quad = "v -1 0 0\nv 1 0 0\nv 1 2 0\nv -1 2 0\nf 1 2 3\nf 1 3 4\n";
            std::fs::write(folder.path().join("pane.obj"), quad).unwrap();
            let camera = "[camera]\nposition = [0, 1, 4]\ntarget = [0, 1, 0]\nfov_x_deg = 60\n";
            let mesh = "[[mesh]]\nfile = 'pane.obj'\nmaterial = 'pane'\n";
            let scene = format!("{camera}{mesh}[materials.pane]\n{pane}\n[sky]\n{sky}\n");
            std::fs::write(folder.path().join("scene.toml"), scene).unwrap();
            let found = strategies(folder.path()).contains(&Strategy::Path);
            assert_eq!(found, is_candidate, "{sky}, {pane}");
        }
    }

    #[test]
    fn final_gathering_is_tried_where_the_image_is_denoised() {
        let gathers = |is_denoised| {
            let traits = SceneTraits { is_denoised, ..Default::default() };
            let all = Technique::candidates(&settings(), FreeParameters::ALL, traits);
            let is_gathering =
                |own: &&Technique| (own.strategy, own.merge_vertex) == (Strategy::Single, 2);
            all.iter().filter(is_gathering).count()
        };
        assert_eq!([false, true].map(gathers), [0, 1]);
    }

    /// Where photons in media are merged is a choice in dense media only. Path tracing merges none.
    #[test]
    fn dense_media_are_merged_around_points_as_well() {
        let all = |medium_query, media_scatter: bool, media_are_dense| {
            let open = FreeParameters { medium_query, ..FreeParameters::ALL };
            let traits = SceneTraits { media_scatter, media_are_dense, ..Default::default() };
            Technique::candidates(&settings(), open, traits)
        };
        let count =
            |all: &[Technique], query| all.iter().filter(|own| own.medium_query == query).count();
        let [points, beams] = [MediumQuery::Points, MediumQuery::Beams].map(Some);
        let dense = all(true, true, true);
        assert!(count(&dense, points) >= 2 && count(&dense, points) == count(&dense, beams));
        for some in [&dense, &all(true, true, false)] {
            let without: Vec<_> = some.iter().filter(|own| own.medium_query.is_none()).collect();
            assert!(without.len() == 1 && without[0].strategy == Strategy::Path);
        }
        assert_eq!(count(&all(true, true, false), points), 0);
        assert_eq!(count(&all(false, true, true), points), 0, "beams are the default");
        let clear = all(true, false, false);
        assert_eq!(count(&clear, None), clear.len());
    }
}
