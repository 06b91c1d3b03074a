//! Meters in the dark: a proof that no light can arrive, or a bound of light that no path saw.
//!
//! A value of 0 is certain if no light arrives straight, and if no surface above the meter's plane
//! sends light on. Otherwise many paths without light bound it: events that none of `n` trials had
//! have, with a probability of 95 %, at most the probability `3/n` (the rule of three). theory.md
//! (5f)

use super::reading::{RULE_OF_THREE, Reading};
use super::render_meters::OfSet;
use bdpm_core::accel::{Intersect, Ray};
use bdpm_core::base::math::{Bounds, Rgb};
use bdpm_core::render::audit::brightest_path;
use bdpm_core::scene::{Emitter, Horizon, Meter, MeterKind, Scene, StraightLight};
use std::collections::HashMap;
use std::f32::consts::FRAC_PI_2;
use std::f64::consts::PI;
use std::ops::Range;

/// Minimum number of camera paths of a meter before none of them with light bounds its light.
const DARK_PATHS: f64 = 16384.0;

/// Paths of a render job so far.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct TracedPaths {
    /// Camera paths of a meter.
    pub camera_paths: f64,
    /// Irradiance of a surface where the light of a single photon is merged, W/m^2; 0 without
    /// photons.
    pub of_one_photon: f64,
}

/// What decides whether meters are dark, and meters for which it was decided.
pub(super) struct Darkness<'a> {
    scene: &'a Scene,
    accel: &'a dyn Intersect,
    kind: MeterKind,
    meters: &'a [Meter],
    /// Boxes of surfaces that send light on.
    boxes: Vec<Bounds>,
    /// Polar angles from which the environment shines.
    latitudes: Vec<[f32; 2]>,
    /// True if light scatters between surfaces, so that it may arrive from anywhere.
    is_hazy: bool,
    /// True if surfaces let rays pass at random, so that a ray that is blocked proves nothing.
    passes_at_random: bool,
    /// The brightest contribution of a path, in the unit of the kind for 1 W.
    brightest: f64,
    decided: HashMap<usize, bool>,
}

impl<'a> Darkness<'a> {
    /// Decides nothing yet. The scene has the meters.
    pub fn new(scene: &'a Scene, accel: &'a dyn Intersect) -> Self {
        let meters = scene.meters().expect("a scene with meters");
        let environment = scene.lights().environment();
        let factor = match meters.kind {
            MeterKind::Irradiance => PI,
            MeterKind::Radiance => 1.0,
        };
        Self {
            scene,
            accel,
            kind: meters.kind,
            meters: &meters.list,
            boxes: scene.boxes_of_scattering_surfaces(),
            latitudes: environment.map(|own| own.lit_latitudes()).unwrap_or_default(),
            is_hazy: scene.media().is_some_and(|media| media.any_scatters()),
            passes_at_random: scene.materials().iter().any(|own| own.is_translucent()),
            brightest: factor * brightest_path(scene),
            decided: HashMap::new(),
        }
    }

    /// The readings, where those without light are 0 with an interval, or unknown. `columns` are
    /// the meters of each set.
    pub fn complete(
        &mut self,
        sets: &[OfSet],
        columns: &[Range<usize>],
        traced: TracedPaths,
    ) -> Vec<OfSet> {
        let of_set = |((readings, mean), columns): (&OfSet, &Range<usize>)| {
            let own: Vec<Reading> = readings
                .iter()
                .zip(columns.clone())
                .map(|(reading, meter)| self.complete_one(reading, meter, traced))
                .collect();
            let mean = mean_of(mean, readings, &own);
            (own, mean)
        };
        sets.iter().zip(columns).map(of_set).collect()
    }

    fn complete_one(&mut self, reading: &Reading, meter: usize, traced: TracedPaths) -> Reading {
        // Corrected means may be below 0, and unknown ones are NaN.
        if reading.value != 0.0 {
            return *reading;
        }
        if self.is_proven(meter) {
            return Reading::default();
        }
        if traced.camera_paths < DARK_PATHS || !reading.has_uncertainty() {
            return Reading::unknown();
        }
        let of_camera_paths = self.brightest / traced.camera_paths;
        Reading::dark(RULE_OF_THREE * (of_camera_paths + traced.of_one_photon), reading)
    }

    /// Returns true if no light can arrive at a meter.
    fn is_proven(&mut self, meter: usize) -> bool {
        if let Some(decided) = self.decided.get(&meter) {
            return *decided;
        }
        let is_dark = self.is_dark(&self.meters[meter]);
        self.decided.insert(meter, is_dark);
        is_dark
    }

    fn is_dark(&self, meter: &Meter) -> bool {
        if self.is_hazy {
            return false;
        }
        let is_radiance = self.kind == MeterKind::Radiance;
        if is_radiance && meter.half_angle == 0.0 {
            return self.sees_black(meter);
        }
        // Wider cones see more than half of all directions.
        if is_radiance && meter.half_angle > FRAC_PI_2 {
            return false;
        }
        let horizon = Horizon::new(meter.position, meter.normal);
        let is_lit = self.boxes.iter().any(|own| horizon.may_show(own))
            || self.latitudes.iter().any(|own| horizon.may_show_latitudes(*own))
            || self
                .scene
                .lights()
                .emitters()
                .iter()
                .any(|own| self.may_shine(own, meter, &horizon));
        !is_lit
    }

    /// Returns true if light of an emitter may arrive straight at a meter.
    fn may_shine(&self, emitter: &Emitter, meter: &Meter, horizon: &Horizon) -> bool {
        // Meters of luminance do not see lights without a surface.
        if self.kind == MeterKind::Radiance && emitter.is_delta() {
            return false;
        }
        match emitter.straight_light(horizon) {
            StraightLight::None => false,
            StraightLight::OfSurface => true,
            StraightLight::From(_) if self.passes_at_random => true,
            StraightLight::From(target) => {
                !self.accel.is_occluded(&Ray::segment(target, meter.position))
            }
        }
    }

    /// Returns true if a meter of a single direction sees nothing, or a black surface.
    fn sees_black(&self, meter: &Meter) -> bool {
        if self.passes_at_random {
            return false;
        }
        let ray = Ray::new(meter.position, meter.normal);
        let hit = self.accel.closest_hit(&ray);
        if hit.is_miss() {
            let environment = self.scene.lights().environment();
            return environment.is_none_or(|own| own.radiance(meter.normal) == Rgb::ZERO);
        }
        let surface = self.scene.surface(&ray, &hit);
        surface.bsdf.albedo() == Rgb::ZERO && surface.emission() == Rgb::ZERO
    }
}

/// The mean of a set whose readings were completed: that of all, with the light that the dark ones
/// may have. It is unknown if nothing was seen and a reading is unknown.
fn mean_of(mean: &Reading, raw: &[Reading], completed: &[Reading]) -> Reading {
    let is_seen = mean.value != 0.0;
    let dark = raw.iter().zip(completed).filter(|(raw, _)| raw.value == 0.0);
    let missed = dark.map(|(_, own)| own.expanded).filter(|own| !is_seen || own.is_finite());
    let missed = missed.sum::<f64>() / raw.len() as f64;
    match (is_seen, missed.is_finite()) {
        (true, _) => Reading { expanded: mean.expanded + missed, ..*mean },
        (false, true) => Reading { expanded: missed, ..Reading::default() },
        (false, false) => Reading::unknown(),
    }
}

/// Returns true if no light was seen.
pub(super) fn are_dark(sets: &[OfSet]) -> bool {
    // Unknown values are NaN.
    sets.iter().flat_map(|(readings, _)| readings).all(|own| own.value.is_nan() || own.value == 0.0)
}

/// Returns true if it is certain that no light arrives.
pub(super) fn are_certainly_dark(sets: &[OfSet]) -> bool {
    sets.iter().flat_map(|(readings, _)| readings).all(|own| *own == Reading::default())
}

#[cfg(test)]
mod tests;
