//! Light of a scene that path tracing does not find, or hardly.

use crate::scene::casters::casts_caustics;
use crate::scene::{Emitter, LightSource, Material, Placement, Scene};

/// Solid angle, sr, below which the light of an environment counts as that of a sun. A diffuse ray
/// hits such a sun, of 1 degree around, with a probability below `1e-3/pi`.
const SUN: f64 = 1e-3;

/// Whether a scene may have light that only photons find: of lights that no ray can hit, through
/// glass or mirrors.
pub fn has_photon_only_light(scene: &Scene) -> bool {
    let is_single = |own: &Material| own.bsdf.passes_through() && !own.is_index_matched_boundary();
    scene.lights().emitters().iter().any(Emitter::is_delta)
        && placed_materials(scene).any(is_single)
}

/// Light that a scene may have and no camera path finds: of lights that no ray can hit, or of a
/// small sun, through glass or off mirrors.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct CausticLight {
    /// Names of the lights.
    pub lights: Vec<String>,
    /// Names of the materials that pass their light on.
    pub casters: Vec<String>,
}

impl CausticLight {
    /// Such light of a scene; `None` if there is none.
    pub fn of(scene: &Scene) -> Option<Self> {
        let rare_sun = has_rare_sunlight(scene);
        let emitters = scene.lights().emitters();
        let is_such = |source: &LightSource| match source {
            LightSource::Light(index) => emitters.get(*index).is_some_and(Emitter::is_delta),
            LightSource::Material(_) => false,
            LightSource::Environment => rare_sun,
        };
        let sources = scene.light_sources().into_iter();
        let lights = sources.filter(|(source, _)| is_such(source)).map(|(_, name)| name).collect();
        let mut casters: Vec<String> = placed_materials(scene)
            .filter(|own| casts_caustics(own))
            .map(|own| own.name.clone())
            .collect();
        casters.sort();
        casters.dedup();
        let own = Self { lights, casters };
        (!own.lights.is_empty() && !own.casters.is_empty()).then_some(own)
    }

    /// The light in words.
    pub fn describe(&self) -> String {
        let names = |names: &[String]| match names {
            [first, second, third, rest @ ..] if !rest.is_empty() => {
                format!("`{first}`, `{second}`, `{third}` and {} more", rest.len())
            }
            names => format!("`{}`", names.join("`, `")),
        };
        format!("light of {} by way of {}", names(&self.lights), names(&self.casters))
    }
}

/// The materials that surfaces have.
pub fn placed_materials(scene: &Scene) -> impl Iterator<Item = &Material> {
    let material = |placement: &Placement| &scene.materials()[placement.material as usize];
    scene.placements().iter().map(material)
}

/// Whether a scene may have light that path tracing finds too rarely to know its noise: of a sun in
/// an environment map, through clear glass or by mirrors. At the back of a room behind a pane of
/// thin glass, 1280 lx +- 3 % were read instead of 2300 lx
/// (`docs/measurements/meter-intervals.md`).
pub fn has_rare_sunlight(scene: &Scene) -> bool {
    let is_clear = |own: &Material| {
        let is_single = own.bsdf.passes_through() && !own.bsdf.has_rough() && !own.bsdf.merges();
        is_single && !own.is_index_matched_boundary()
    };
    let environment = scene.lights().environment();
    placed_materials(scene).any(is_clear)
        && environment.is_some_and(|map| map.effective_solid_angle() < SUN)
}
