//! IES profiles (`EXT_lights_ies`): points whose nadir is -z of their node and whose C0 is +x. The
//! scale of the node has no effect.

use super::buffers::{self, Buffers};
use super::json::{self, get};
use super::light::NamedLight;
use super::nodes::SceneNode;
use super::{first_name, malformed};
use crate::light;
use crate::luminaires::frame;
use crate::warnings::Warning;
use bdpm_core::base::error::Result;
use bdpm_core::base::math::Rgb;
use bdpm_core::base::photometry::LUMENS_PER_WATT;
use bdpm_core::scene::{AimedDistribution, Emitter, IntensityDistribution, PointLuminaire};
use bdpm_light::photometry::LuminaireFile;
use glam::DVec3;
use std::collections::{BTreeSet, HashMap};
use std::path::Path;
use std::sync::Arc;

/// Largest accepted profile, bytes.
const MAX_FILE: u64 = 64 << 20;

/// The IES profiles of a file, each read with its first use.
pub(super) struct IesProfiles<'a> {
    buffers: &'a Buffers<'a>,
    path: &'a Path,
    /// By index, and whether the transform of the node mirrors it.
    read: HashMap<(usize, bool), Arc<IntensityDistribution>>,
    notes: BTreeSet<String>,
}

impl<'a> IesProfiles<'a> {
    /// The profiles of the file at `path`.
    pub fn new(buffers: &'a Buffers<'a>, path: &'a Path) -> Self {
        Self { buffers, path, read: HashMap::new(), notes: BTreeSet::new() }
    }

    /// Notes about all profiles that were read.
    pub fn warnings(self) -> impl Iterator<Item = Warning> {
        self.notes.into_iter().map(Warning::chosen)
    }

    /// The luminaire of a node, if it has one that is not dark.
    pub fn luminaire(&mut self, node: &SceneNode) -> Result<Option<NamedLight>> {
        let Some(own) = &node.json.extensions.luminaire else { return Ok(None) };
        let element = format!("nodes[{}].extensions.EXT_lights_ies", node.index);
        let profiles = &self.buffers.document.extensions.ies.lights;
        let profile = get(profiles, "lights", own.light, format!("{element}.light"))?;
        let is_mirrored = node.map.matrix3.determinant() < 0.0;
        let distribution = self.profile(own.light, profile, is_mirrored)?;
        let color = Rgb::from_array(own.color.unwrap_or([1.0; 3])).clamp(Rgb::ZERO, Rgb::ONE);
        let factor = color * (own.multiplier.unwrap_or(1.0) / LUMENS_PER_WATT);
        // Written so that NaN fails.
        if !(factor.is_finite() && factor.min_element() >= 0.0) {
            return Err(malformed(element, "its multiplier is negative or not finite"));
        }
        let position = node.map.translation;
        let position = light::position(position).map_err(|e| malformed(&element, e.problem()))?;
        let along = |axis: DVec3| node.map.transform_vector3(axis).normalize_or_zero();
        let axes = frame(Some(along(DVec3::NEG_Z)), Some(along(DVec3::X)), 0.0);
        let axes = axes.map_err(|_| {
            malformed(&element, "the node's transform leaves the light no direction")
        })?;
        if factor == Rgb::ZERO || distribution.flux() <= 0.0 {
            return Ok(None);
        }
        let aimed = AimedDistribution::new(distribution, axes, factor);
        let emitter = Emitter::Luminaire(Box::new(PointLuminaire { position, aimed }));
        let names = [&node.json.name[..], &profile.name];
        let name = first_name(names, || format!("nodes[{}]", node.index));
        Ok(Some(NamedLight { name, emitter }))
    }

    fn profile(
        &mut self,
        index: usize,
        profile: &json::IesProfile,
        is_mirrored: bool,
    ) -> Result<Arc<IntensityDistribution>> {
        if is_mirrored && !self.read.contains_key(&(index, true)) {
            let mirrored = self.profile(index, profile, false)?.mirrored().ok_or_else(|| {
                let element = format!("extensions.EXT_lights_ies.lights[{index}]");
                malformed(element, "its angles are too close together")
            })?;
            self.read.insert((index, true), Arc::new(mirrored));
        }
        if let Some(read) = self.read.get(&(index, is_mirrored)) {
            return Ok(Arc::clone(read));
        }
        let element = format!("extensions.EXT_lights_ies.lights[{index}]");
        let folder = self.path.parent().unwrap_or(Path::new(""));
        let bytes = match (&profile.uri, profile.buffer_view) {
            (Some(uri), _) => {
                let element = format!("{element}.uri");
                buffers::read(uri, folder, MAX_FILE, &element)?
            }
            (None, Some(view)) => {
                self.buffers.view(view, format!("{element}.bufferView"))?.bytes.to_vec()
            }
            (None, None) => return Err(malformed(element, "it has neither uri nor bufferView")),
        };
        let file = match profile.uri.as_deref() {
            Some(uri) if !uri.starts_with("data:") => folder.join(uri),
            _ => self.path.to_owned(),
        };
        let read = LuminaireFile::parse_ies(&file, &bytes)?;
        self.notes.extend(read.notes.iter().map(|note| format!("{}: {note}", file.display())));
        let distribution = Arc::new(read.distribution);
        self.read.insert((index, false), Arc::clone(&distribution));
        Ok(distribution)
    }
}
