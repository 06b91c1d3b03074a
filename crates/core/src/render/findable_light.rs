//! Light of a scene that path tracing does not find, or hardly.

use crate::scene::{Emitter, Material, Placement, Scene};

/// Solid angle, sr, below which the light of an environment counts as that of a sun. A diffuse ray
/// hits such a sun, of 1 degree around, with a probability below `1e-3/pi`.
const SUN: f64 = 1e-3;

/// Whether a scene may have light that only photons find: of lights that no ray can hit, through
/// glass or mirrors.
pub fn has_unfindable_light(scene: &Scene) -> bool {
    let is_single = |own: &Material| own.bsdf.passes_through() && !own.is_index_matched_boundary();
    scene.lights().emitters().iter().any(Emitter::is_delta)
        && placed_materials(scene).any(is_single)
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
