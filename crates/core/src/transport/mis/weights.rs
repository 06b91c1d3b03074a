//! The equations of the balance heuristic over merges at the first two diffuse vertices,
//! connections from every vertex and emission that camera paths hit.

use crate::base::math::disc_area;
use crate::settings::{MisScales, Settings};
use crate::transport::kernel::ByClass;
use crate::transport::photon::PhotonClass;
use bytemuck::{Pod, Zeroable};

/// Minimum scale of merges. Quotients stay finite, and the only technique of a path still has the
/// weight 1.
const MIN_SCALE: f32 = 1e-12;

/// Constants of the balance heuristic.
#[derive(Clone, Copy, Debug)]
pub struct Balance {
    /// Planned light paths times the area of a merge, scene units squared; 0 without photons.
    /// theory.md (47c), `eta`.
    eta: f32,
    /// Scales of merges of diffuse photons at the first and the second vertex, `c_1` and `c_2`.
    scales: [f32; 2],
    /// Scale of merges of caustic photons over the scale of diffuse ones: `(r_c/r)^2`.
    caustic: f32,
    /// 1, or 0 if all photons are those of caustics: merges at earlier diffuse vertices than the
    /// last one then do not sample a path.
    of_diffuse: f32,
    /// Continuations of light paths from their first diffuse vertex: factor of the density of
    /// merges at all vertices of a camera path but the last. theory.md (47q)
    splitting: f32,
}

/// MIS partial of a camera path after a vertex: densities of merges at earlier vertices, over the
/// density with which the path went on. theory.md (47d)
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct CameraPartial {
    /// Merges before the last diffuse vertex, `a`.
    pub earlier: f32,
    /// Merges of diffuse photons at the last diffuse vertex, `b`.
    pub last: f32,
}

/// MIS partial of a light path after a vertex: densities of techniques at vertices nearer to the
/// light source, over the density with which the light path went on. theory.md (47e)
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct LightPartial {
    /// Connections and hits, `x`.
    pub traced: f32,
    /// Merges at the previous diffuse vertex, `y`, if that is the camera path's second one.
    pub merged: f32,
}

/// MIS partials of a photon for merges at the first and at the second vertex of a camera path. A
/// negative number marks a photon that is not merged there. theory.md (47f)
pub type PhotonPartials = [f32; 2];

/// MIS partials of a gather point: the terms of the weights of merges there, divided by the scale
/// of the vertex. theory.md (47f)
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
#[repr(C)]
pub struct GatherPartials {
    /// Density of merges at the first vertex.
    pub earlier: f32,
    /// Density with which the camera path goes on toward the origin of the photon, 1/sr.
    pub camera: f32,
}

/// Techniques that end a light path straight at a diffuse or rough vertex of a camera path, as
/// multiples of the density of emission there. theory.md (47b)
#[derive(Clone, Copy, Debug, Default)]
pub struct StraightDensities {
    /// Density of connections over the density of emission, `1/l`; 0 if there are none.
    pub connection: f32,
    /// Density with which the camera path goes on toward the light source.
    pub camera: f32,
}

impl Balance {
    /// Connections and hits alone.
    pub const WITHOUT_MERGES: Self =
        Self { eta: 0.0, scales: [0.0; 2], caustic: 1.0, of_diffuse: 1.0, splitting: 1.0 };

    /// The constants of these settings.
    pub fn new(settings: &Settings) -> Self {
        if !settings.has_photons() {
            return Self::WITHOUT_MERGES;
        }
        let MisScales { light_paths, scales } = settings.mis_scales();
        let [caustic, radius] = settings.merge_radii();
        let eta = light_paths as f32 * disc_area(radius);
        let own = Self::with(eta, scales.map(|c| c as f32), caustic / radius);
        let of_diffuse = if settings.strategy.has_only_caustics() { 0.0 } else { 1.0 };
        Self { of_diffuse, splitting: settings.continuations() as f32, ..own }
    }

    /// The constants for scales at both vertices and this quotient of the caustic radius and the
    /// radius.
    fn with(eta: f32, scales: [f32; 2], caustic_radius: f32) -> Self {
        let caustic = (caustic_radius * caustic_radius).max(MIN_SCALE);
        let scales = scales.map(|c| c.max(MIN_SCALE));
        Self { eta, scales, caustic, of_diffuse: 1.0, splitting: 1.0 }
    }

    /// Merges share paths with the other techniques.
    #[inline(always)] // part of vector loops, as the functions below
    pub fn weighs_merges(&self) -> bool {
        self.eta > 0.0
    }

    /// Partial of a camera path that leaves its diffuse vertex number `vertex` with the density
    /// `camera`. `earlier` is the density of merges at earlier vertices. theory.md (47d)
    #[inline(always)]
    pub fn leave(&self, vertex: u32, earlier: f32, camera: f32) -> CameraPartial {
        // Photons of caustics alone are merged at all vertices, with the scale of the second.
        let beyond = self.scales[1] * (1.0 - self.of_diffuse);
        let last = self.scales.get(vertex as usize - 1).copied().unwrap_or(beyond);
        CameraPartial { earlier: earlier / camera, last: last / camera }
    }

    /// Density of merges at earlier vertices where a camera path of this partial arrives at another
    /// diffuse vertex. `light` is the light path's density toward the previous vertex.
    #[inline(always)]
    pub fn arrive(&self, partial: &CameraPartial, light: f32) -> f32 {
        self.of_diffuse * (partial.earlier + partial.last) * light
    }

    /// Partial of a light path that starts from a light source. `inverse_emission` is the
    /// reciprocal of the density of emission, 0 if the light source cannot be hit. theory.md (47e)
    #[inline(always)]
    pub fn start(&self, inverse_emission: f32) -> LightPartial {
        LightPartial { traced: inverse_emission / self.eta, merged: 0.0 }
    }

    /// Density in which a light path leaves the diffuse vertex of this number, the first being 0,
    /// by all its continuations. theory.md (47q)
    #[inline(always)]
    pub fn continuations(&self, diffuse: u32, light: f32) -> f32 {
        if diffuse == 0 { self.splitting * light } else { light }
    }

    /// Partial of a light path that scatters with the density `light` at a diffuse or rough vertex,
    /// where it arrived with the partial `arrived`. `merges` is the class of its photon there, if
    /// that is merged at second vertices. theory.md (47e)
    #[inline(always)]
    pub fn scatter(
        &self,
        arrived: &LightPartial,
        techniques: StraightDensities,
        merges: Option<PhotonClass>,
        light: f32,
    ) -> LightPartial {
        let StraightDensities { connection, camera } = techniques;
        let traced = camera * arrived.traced + connection / self.eta;
        let merged = merges.map_or(0.0, |class| self.scales[1] * self.of_class(class));
        LightPartial { traced: traced / light, merged: merged / light }
    }

    /// Partials of a photon of a light path that arrives after another vertex.
    /// theory.md (47f)
    #[inline(always)]
    pub fn photon(&self, arrived: &LightPartial, class: PhotonClass) -> PhotonPartials {
        let inverse = self.of_class(class).recip();
        [(arrived.traced + arrived.merged) * inverse, arrived.traced * inverse]
    }

    /// Partials of a photon straight from its light source: merged at first vertices only.
    #[inline(always)]
    pub fn straight_photon(&self, arrived: &LightPartial) -> PhotonPartials {
        [arrived.traced / self.caustic, -1.0]
    }

    /// Partials of a gather point at diffuse vertex number `vertex`, 1 or 2. `earlier` is the
    /// density of merges at earlier vertices, `camera` the camera path's density toward the origin
    /// of the photon. theory.md (47f)
    #[inline(always)]
    pub fn gather(&self, vertex: u32, earlier: f32, camera: f32) -> GatherPartials {
        let inverse = self.scales[partial_index(vertex)].recip();
        GatherPartials { earlier: earlier * inverse, camera: camera * inverse }
    }

    /// Scale of merges of a class over the scale of merges of diffuse photons.
    #[inline(always)]
    pub fn of_class(&self, class: PhotonClass) -> f32 {
        match class {
            PhotonClass::Caustic => self.caustic,
            PhotonClass::Diffuse => 1.0,
        }
    }

    /// Factors of the density of merges at the first vertex, beside a merge of a photon of either
    /// class at the second one. That of a caustic would scatter there for the first time.
    #[inline(always)]
    pub fn earlier_factors(&self) -> ByClass<f32> {
        let mut factors = [1.0; 2];
        factors[PhotonClass::Caustic as usize] = self.splitting / self.caustic;
        factors
    }

    /// Density of merges at vertices before the last diffuse one, where light paths scatter for the
    /// first time.
    #[inline(always)]
    pub fn before_last(&self, merges: f32) -> f32 {
        self.splitting * merges
    }

    /// Density of merges at the vertices of a camera path before a light source that is `chain`
    /// vertices that pass light away from the last diffuse vertex. Photons straight from a light
    /// source are not merged at that vertex.
    #[inline(always)]
    pub fn caustic_merges(&self, partial: &CameraPartial) -> f32 {
        self.before_last(partial.earlier) + self.caustic * partial.last
    }

    /// Weight of a connection. `merges` is the density of merges at all vertices of the path, `hit`
    /// the density of hitting the light source over the density of the connection. theory.md (47g)
    #[inline(always)]
    pub fn connection_weight(&self, merges: f32, l: f32, hit: f32) -> f32 {
        (1.0 + hit + self.eta * l * merges).recip()
    }

    /// Weight of emission that a camera path hits. `merges` is the density of merges at all
    /// vertices of the path after division by the density of the hit, `emission` the density of
    /// emission, and `connection` the density of the connection over the density of the hit.
    /// theory.md (47i)
    #[inline(always)]
    pub fn hit_weight(&self, merges: f32, emission: f32, connection: f32) -> f32 {
        (1.0 + connection + self.eta * emission * merges).recip()
    }
}

/// Index of the MIS partial of a photon for merges at a diffuse vertex of this number. Beyond the
/// second one, only photons of caustics are merged, and they have the same for all.
#[inline(always)] // part of the loop over photons
pub fn partial_index(vertex: u32) -> usize {
    vertex.min(2) as usize - 1
}

impl CameraPartial {
    /// The partial after a vertex passed through, where `ratio` is the density of light paths over
    /// that of camera paths.
    #[inline(always)] // part of vector loops
    #[must_use]
    pub fn pass(self, ratio: f32) -> Self {
        Self { earlier: self.earlier * ratio, last: self.last * ratio }
    }
}

impl LightPartial {
    /// The partial after a vertex passed through, where `ratio` is the density of light paths over
    /// that of camera paths.
    #[inline(always)]
    #[must_use]
    pub fn pass(self, ratio: f32) -> Self {
        Self { traced: self.traced / ratio, merged: self.merged / ratio }
    }
}

/// Weight of a merge. `factor` is that of [`Balance::earlier_factors`] for the photon's class.
/// theory.md (47f)
#[inline(always)]
pub fn merge_weight(point: &GatherPartials, factor: f32, photon: f32) -> f32 {
    if photon.is_sign_negative() {
        return 0.0;
    }
    (1.0 + point.earlier * factor + point.camera * photon).recip()
}

#[cfg(test)]
mod tests;
