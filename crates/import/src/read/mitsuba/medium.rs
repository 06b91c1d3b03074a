//! Media: homogeneous ones, and grids of a constant.

use super::object::Object;
use super::texture::Paints;
use crate::spectrum::ColorUse;
use bdpm_core::base::error::Result;
use bdpm_core::base::math::Rgb;
use bdpm_core::scene::{Medium, MediumBoundary};
use std::collections::HashMap;
use std::sync::Arc;

/// The media of a scene by element, because many shapes may refer to one.
#[derive(Default)]
pub(super) struct MediumCache {
    known: HashMap<usize, Option<Arc<Medium>>>,
}

impl MediumCache {
    /// The media on both sides of a shape, if it has any.
    pub fn boundary(
        &mut self,
        object: &Object,
        paints: &mut Paints,
    ) -> Result<Option<MediumBoundary>> {
        let mut side = |name: &str| -> Result<Option<Arc<Medium>>> {
            let Some(medium) = object.get(name)?.filter(|own| own.element().tag == "medium") else {
                return Ok(None);
            };
            self.medium(&medium, paints)
        };
        let boundary = MediumBoundary { interior: side("interior")?, exterior: side("exterior")? };
        Ok((boundary != MediumBoundary::default()).then_some(boundary))
    }

    /// The medium around a sensor.
    pub fn around(&mut self, sensor: &Object, paints: &mut Paints) -> Result<Option<Arc<Medium>>> {
        match sensor.all("medium")?.into_iter().next() {
            Some(medium) => self.medium(&medium, paints),
            None => Ok(None),
        }
    }

    fn medium(&mut self, object: &Object, paints: &mut Paints) -> Result<Option<Arc<Medium>>> {
        if let Some(known) = self.known.get(&object.index) {
            return Ok(known.clone());
        }
        let medium = read(object, paints)?.map(Arc::new);
        self.known.insert(object.index, medium.clone());
        Ok(medium)
    }
}

/// Reads a medium; `None` if its kind is not supported.
fn read(object: &Object, paints: &mut Paints) -> Result<Option<Medium>> {
    if !matches!(object.kind(), "homogeneous" | "heterogeneous") {
        paints.skipped("left out media of other types than `homogeneous`:", object);
        return Ok(None);
    }
    let mut coefficient =
        |name: &str, color_use: ColorUse| coefficient(object, name, color_use, paints);
    let extinction = coefficient("sigma_t", ColorUse::Unbounded)?;
    let scattering = coefficient("sigma_s", ColorUse::Unbounded)?;
    let absorption = coefficient("sigma_a", ColorUse::Unbounded)?;
    let albedo = coefficient("albedo", ColorUse::Share)?;
    let coefficients = match (absorption, scattering) {
        (Found::Not, Found::Not) => match (extinction, albedo) {
            (Found::Grid, _) | (_, Found::Grid) => None,
            (extinction, albedo) => {
                let extinction = extinction.or(Rgb::ONE);
                let albedo = albedo.or(Rgb::splat(0.75));
                Some((extinction * (Rgb::ONE - albedo), extinction * albedo))
            }
        },
        (absorption, scattering) => Some((absorption.or(Rgb::ZERO), scattering.or(Rgb::ZERO))),
    };
    let Some((absorption, scattering)) = coefficients else {
        paints.skipped("left out media whose density varies:", object);
        return Ok(None);
    };
    let scale = object.float_in("scale", 1.0, [0.0, 1e9])? as f32;
    let asymmetry = asymmetry(object, paints)?;
    Ok(Some(Medium {
        name: object.label(),
        absorption: scale * absorption,
        scattering: scale * scattering,
        asymmetry,
        priority: 0,
    }))
}

/// A coefficient that may be missing, or vary.
enum Found {
    Not,
    Constant(Rgb),
    Grid,
}

impl Found {
    fn or(self, default: Rgb) -> Rgb {
        match self {
            Self::Constant(value) => value,
            Self::Not | Self::Grid => default,
        }
    }
}

/// The coefficient of this name.
fn coefficient(
    object: &Object,
    name: &str,
    color_use: ColorUse,
    paints: &mut Paints,
) -> Result<Found> {
    let Some(own) = object.get(name)? else { return Ok(Found::Not) };
    let (owner, name) = match (&own.element().tag[..], own.kind()) {
        ("volume", "constvolume") => (own, "value"),
        ("volume", _) => return Ok(Found::Grid),
        _ => (*object, name),
    };
    let value = paints.mean(&owner, name, color_use, Rgb::ZERO)?;
    Ok(Found::Constant(value.max(Rgb::ZERO)))
}

/// The asymmetry parameter of the phase function.
fn asymmetry(object: &Object, paints: &mut Paints) -> Result<f32> {
    let Some(phase) = object.all("phase")?.into_iter().next() else { return Ok(0.0) };
    match phase.kind() {
        "isotropic" => Ok(0.0),
        "hg" => Ok(phase.float_in("g", 0.8, [-0.999, 0.999])? as f32),
        _ => {
            paints.skipped("used isotropic scattering for other phase functions:", &phase);
            Ok(0.0)
        }
    }
}
