//! Participating media: homogeneous ones.

use super::params::Params;
use super::spectra::{self, ColorSpace};
use super::textures::Textures;
use crate::spectrum::ColorUse;
use bdpm_core::base::error::Result;
use bdpm_core::base::math::Rgb;
use bdpm_core::scene::{Medium, MediumBoundary};
use std::collections::HashMap;
use std::sync::Arc;

/// Coefficients of a medium without any, 1/scene unit.
const DEFAULT_ABSORPTION: Rgb = Rgb::new(0.0011, 0.0024, 0.014);
const DEFAULT_SCATTERING: Rgb = Rgb::new(2.55, 3.21, 3.77);

/// The media of a scene by their names; `None` for those of other types.
#[derive(Default)]
pub(super) struct NamedMedia(HashMap<String, Option<Arc<Medium>>>);

impl NamedMedia {
    /// Reads the parameters of `MakeNamedMedium`.
    pub fn define(
        &mut self,
        params: &Params,
        space: ColorSpace,
        textures: &mut Textures,
    ) -> Result<()> {
        let kind = params.text("type")?.unwrap_or("homogeneous");
        let has_preset = params.text("preset")?.is_some();
        if kind != "homogeneous" || has_preset {
            let what = if has_preset { "presets" } else { "other types than `homogeneous`" };
            textures.warnings.skipped(format!("left out media of {what}:"), &params.kind);
            self.0.insert(params.kind.clone(), None);
            return Ok(());
        }
        if params.get("Le").is_some() {
            textures.warnings.skipped("left out the emission of the medium", &params.kind);
        }
        let scale = params.float_in("scale", 1.0, [0.0, 1e9])? as f32;
        let coefficient = |name: &str, default: Rgb| -> Result<Rgb> {
            let own = params.get(name);
            let own =
                own.map(|own| spectra::color(own, ColorUse::Unbounded, space, &textures.folder));
            Ok(scale * own.transpose()?.unwrap_or(default).max(Rgb::ZERO))
        };
        let medium = Medium {
            name: params.kind.clone(),
            absorption: coefficient("sigma_a", DEFAULT_ABSORPTION)?,
            scattering: coefficient("sigma_s", DEFAULT_SCATTERING)?,
            asymmetry: params.float_in("g", 0.0, [-0.999, 0.999])? as f32,
            priority: 0,
        };
        textures.warn_of_unused(params, |_| true, &params.kind);
        self.0.insert(params.kind.clone(), Some(Arc::new(medium)));
        Ok(())
    }

    /// The medium of a name, if there is one that is supported.
    pub fn named(&self, name: &str) -> Option<Arc<Medium>> {
        self.0.get(name).cloned().flatten()
    }

    /// The media of these names inside and outside of a shape. Empty names are of no medium.
    ///
    /// # Errors
    /// If there is none of a name.
    pub fn boundary(&self, names: &[String; 2], params: &Params) -> Result<Option<MediumBoundary>> {
        let side = |name: &String| {
            if name.is_empty() {
                return Ok(None);
            }
            self.0.get(name).cloned().ok_or_else(|| {
                let advice = "define it by MakeNamedMedium before its first use";
                params.error(format!("there is no medium `{name}`"), advice)
            })
        };
        let [interior, exterior] = names;
        let boundary = MediumBoundary { interior: side(interior)?, exterior: side(exterior)? };
        Ok((boundary != MediumBoundary::default()).then_some(boundary))
    }
}
