//! Which materials and placements [`Scene::coated_vertices`](super::Scene::coated_vertices) shades.

use super::bsdf::coated_base::{CoatedBase, MetalRow, metal_of};
use super::bsdf::{Bsdf, Glossy};
use super::{Material, Mesh, Placement};
use crate::base::math::Rgb;
use std::sync::Arc;

/// Hits of these materials may be shaded by
/// [`Scene::coated_vertices`](super::Scene::coated_vertices). Those of others emit, vary in
/// roughness although they are not [`Glossy`], disperse, or bound media.
pub(super) fn coated_base(material: &Material) -> CoatedBase {
    let is_plain = material.emission == Rgb::ZERO
        && material.luminous_opening.is_none()
        && material.dispersion.is_none()
        && material.boundary.is_none();
    match (&material.bsdf, &material.metallic_roughness_texture) {
        _ if !is_plain => CoatedBase::default(),
        (bsdf, None) => CoatedBase::of(bsdf),
        (bsdf @ Bsdf::Glossy(_), Some(_)) => CoatedBase::of_metal(bsdf),
        (_, Some(_)) => CoatedBase::default(),
    }
}

/// Tables for [`Scene::coated_vertices`](super::Scene::coated_vertices).
#[derive(Clone, Debug)]
pub(super) struct Coated {
    /// For each material its base and coat.
    pub bases: Arc<[CoatedBase]>,
    /// For each material the surface whose coat may be metal. It means nothing for others.
    pub metals: Arc<[(Glossy, MetalRow)]>,
    /// For each material whether the parameters of such a surface vary over it.
    pub varies: Arc<[bool]>,
    /// For each placement whether it has neither a transform nor a mesh with colors.
    pub is_plain: Arc<[bool]>,
    /// For each placement by a transform the kind of its material, which stored triangles do not
    /// know; `None` for others.
    pub placed: Arc<[Option<Kind>]>,
}

/// How hits of a material are shaded.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Kind {
    /// One by one.
    Alone,
    /// Together; their coats are no metal.
    Coated,
    /// Together; their coats may be metal.
    Metal,
}

impl Kind {
    pub fn of(base: &CoatedBase) -> Self {
        match (base.flags & CoatedBase::IS_BASE != 0, base.flags & CoatedBase::IS_METAL != 0) {
            (false, _) => Self::Alone,
            (true, false) => Self::Coated,
            (true, true) => Self::Metal,
        }
    }
}

impl Coated {
    pub fn new(materials: &[Material], placements: &[Placement], meshes: &[Mesh]) -> Self {
        let plain = |placed: &Placement| is_plain(placed, &meshes[placed.mesh as usize]);
        let metal = |material: &Material| {
            let any = Glossy::new(Rgb::ZERO, 0.0, 1.0, 0.0);
            let own = metal_of(&material.bsdf).unwrap_or(any);
            (own, MetalRow::of(&own))
        };
        let varies = |material: &Material| {
            let Material { albedo_texture, metallic_roughness_texture, .. } = material;
            albedo_texture.is_some() || metallic_roughness_texture.is_some()
        };
        let bases: Arc<[_]> = materials.iter().map(coated_base).collect();
        let placed =
            |own: &Placement| own.transform.map(|_| Kind::of(&bases[own.material as usize]));
        Self {
            placed: placements.iter().map(placed).collect(),
            bases: Arc::clone(&bases),
            metals: materials.iter().map(metal).collect(),
            varies: materials.iter().map(varies).collect(),
            is_plain: placements.iter().map(plain).collect(),
        }
    }
}

pub(super) fn is_plain(placement: &Placement, mesh: &Mesh) -> bool {
    placement.transform.is_none() && mesh.colors.is_empty()
}
