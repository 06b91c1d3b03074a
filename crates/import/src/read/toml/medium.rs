//! `[media.NAME]` of a scene file: absorption and scattering inside of objects, or everywhere.

use super::Misplaced;
use super::numbers::{Albedo, Coefficient};
use crate::text::list;
use bdpm_core::base::error::{Error, Result};
use bdpm_core::base::math::Rgb;
use bdpm_core::scene::{Medium, MediumBoundary};
use serde::Deserialize;
use std::collections::BTreeMap;
use std::sync::Arc;
use toml::Spanned;

/// The keys of a medium. Absorption and scattering, or the color that is left after a distance, or
/// the extinction and the share that is scattered.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MediumTable {
    absorption: Option<Coefficient>,
    scattering: Option<Coefficient>,
    /// Share of white light that is left after `distance`.
    color: Option<Albedo>,
    distance: Option<f32>,
    extinction: Option<Coefficient>,
    albedo: Option<Albedo>,
    asymmetry: Option<f32>,
    #[serde(default)]
    priority: i32,
}

/// Largest magnitude of the asymmetry parameter: beyond it nearly all light goes on straight.
const MAX_ASYMMETRY: f32 = 0.99;

impl MediumTable {
    /// The medium.
    ///
    /// # Errors
    /// If the keys do not describe one, or several times.
    pub fn medium(&self, name: &str) -> Result<Medium> {
        let asymmetry = self.asymmetry.unwrap_or(0.0);
        if !(-MAX_ASYMMETRY..=MAX_ASYMMETRY).contains(&asymmetry) {
            let advice = format!("give a mean cosine from -{MAX_ASYMMETRY} to {MAX_ASYMMETRY}");
            return Err(Error::new(format!("`asymmetry` is {asymmetry}"), advice));
        }
        let (absorption, scattering) = self.coefficients()?;
        let priority = self.priority;
        Ok(Medium { name: name.to_owned(), absorption, scattering, asymmetry, priority })
    }

    fn coefficients(&self) -> Result<(Rgb, Rgb)> {
        let Self { absorption, scattering, color, distance, extinction, albedo, .. } = self;
        let scattered = scattering.map_or(Rgb::ZERO, |own| own.0);
        match (absorption, color, distance, extinction, albedo) {
            (Some(absorption), None, None, None, None) => Ok((absorption.0, scattered)),
            (None, None, None, None, None) if scattering.is_some() => Ok((Rgb::ZERO, scattered)),
            (None, Some(color), Some(distance), None, None) => {
                if !(*distance > 0.0 && distance.is_finite()) {
                    let advice = "give a positive number of scene units";
                    return Err(Error::new(format!("`distance` is {distance}"), advice));
                }
                Ok((Medium::absorbing("", color.0, *distance).absorption, scattered))
            }
            (None, None, None, Some(Coefficient(all)), Some(Albedo(albedo)))
                if scattering.is_none() =>
            {
                Ok((*all * (Rgb::ONE - *albedo), *all * *albedo))
            }
            _ => Err(Error::new(
                "the medium is not described, or twice",
                "give `absorption`, `scattering` or both, or `color` and `distance`, or `extinction` and `albedo`",
            )),
        }
    }
}

/// Reads the media of these tables, by their names.
///
/// # Errors
/// With the byte offset of the table that does not describe a medium.
pub fn media(
    tables: &BTreeMap<String, Spanned<MediumTable>>,
) -> std::result::Result<BTreeMap<String, Arc<Medium>>, Misplaced> {
    let read = |(name, table): (&String, &Spanned<MediumTable>)| {
        let medium = table.get_ref().medium(name).map_err(|e| (e, table.span().start))?;
        Ok((name.clone(), Arc::new(medium)))
    };
    tables.iter().map(read).collect()
}

/// The medium that a key names.
///
/// # Errors
/// With the byte offset of the key, if there is no such medium.
pub fn named(
    name: &Spanned<String>,
    media: &BTreeMap<String, Arc<Medium>>,
) -> std::result::Result<Arc<Medium>, Misplaced> {
    media.get(name.get_ref()).cloned().ok_or_else(|| {
        let name_text = name.get_ref();
        let table = format!("define it in a table [media.{name_text}]");
        let advice = match media.len() {
            0 => table,
            _ => format!("use one of {}, or {table}", list(media.keys().map(String::as_str))),
        };
        (Error::new(format!("unknown medium `{name_text}`"), advice), name.span().start)
    })
}

/// The media on both sides of a material, if it names any.
///
/// # Errors
/// As [`named`].
pub fn boundary(
    [interior, exterior]: [&Option<Spanned<String>>; 2],
    media: &BTreeMap<String, Arc<Medium>>,
) -> std::result::Result<Option<MediumBoundary>, Misplaced> {
    let side =
        |name: &Option<Spanned<String>>| name.as_ref().map(|name| named(name, media)).transpose();
    let boundary = MediumBoundary { interior: side(interior)?, exterior: side(exterior)? };
    Ok((boundary != MediumBoundary::default()).then_some(boundary))
}
