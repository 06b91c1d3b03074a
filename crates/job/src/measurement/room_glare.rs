//! Unified glare rating straight from the luminaires and the room, without an image (CIE 117:1995):
//!
//! `UGR = 8 log10(0.25 / L_b  sum L^2 omega / p^2)`
//!
//! The sum over luminaires is an integral over the visible half space of the eye, by rays: edges of
//! luminaires cross no pixels, and large luminaires have their position index everywhere. The
//! background `L_b` is the indirect vertical illuminance at the eye over pi, which a meter
//! measures.

use super::extremes::Estimated;
use super::reading::Reading;
use super::{MeasureJob, Measurement};
use bdpm_core::accel::{Coherence, Hit, Intersect, Ray};
use bdpm_core::base::error::{Error, Result};
use bdpm_core::base::math::luminance;
use bdpm_core::base::photometry::LUMENS_PER_WATT;
use bdpm_core::base::quantiles::student_95;
use bdpm_core::base::rng::{Rng, Stream, StreamKey};
use bdpm_core::scene::backend;
use bdpm_core::scene::{Emitter, Meter, MeterKind, MeterSet, Scene};
use bdpm_light::glare::position_index;
use glam::{DMat3, DVec3};
use rayon::prelude::*;
use serde::Serialize;
use std::collections::BTreeMap;
use std::f64::consts::{LN_10, PI, TAU};
use std::ops::ControlFlow;

/// Independent sets of rays, whose spread is the uncertainty of the sum.
const SETS: u64 = 8;

/// Rays of a set along each of both coordinates of the half space, for a single eye.
const SIDE: u32 = 512;

/// The same for each eye of a grid.
const GRID_SIDE: u32 = 256;

/// Glare of the luminaires of a room for an eye.
#[derive(Clone, Debug, Serialize)]
pub struct RoomGlare {
    /// Unified glare rating, with half of the width of its interval with a probability of 95 %;
    /// `None` without a luminaire in view or without a background.
    pub ugr: Option<Estimated>,
    /// Luminance of the background, cd/m^2.
    pub background_luminance: Estimated,
    /// Vertical illuminance at the eye, lx.
    pub vertical_illuminance: Reading,
    /// Luminaires in view by their names, the strongest first.
    pub luminaires: Vec<LuminaireGlare>,
    /// Number of lights without a surface, which have no luminance.
    pub points: usize,
    /// Light that the measurement cannot include.
    pub notes: Vec<String>,
}

/// All visible surfaces of an emissive material.
#[derive(Clone, Debug, Serialize)]
pub struct LuminaireGlare {
    /// Name of the material or the luminaire.
    pub name: String,
    /// Mean luminance toward the eye, cd/m^2.
    pub luminance: f64,
    /// Visible solid angle in front of the eye, sr.
    pub solid_angle: f64,
    /// Mean position index: the single one with which the luminaire has the same glare.
    pub position_index: f64,
    /// Illuminance at the eye, lx.
    pub illuminance: f64,
}

/// Integrals over the visible part of a material.
#[derive(Clone, Copy, Debug, Default)]
struct Integrals {
    solid_angle: f64,
    /// Integral of the luminance.
    flux: f64,
    /// Integral of the luminance times the cosine.
    illuminance: f64,
    /// Integral of the squared luminance.
    square: f64,
    /// Integral of the squared luminance over the squared position index.
    glare: f64,
}

impl Integrals {
    fn add(&mut self, other: &Self, weight: f64) {
        self.solid_angle += weight * other.solid_angle;
        self.flux += weight * other.flux;
        self.illuminance += weight * other.illuminance;
        self.square += weight * other.square;
        self.glare += weight * other.glare;
    }
}

impl MeasureJob {
    /// Rates the glare of the luminaires for an eye at the camera of the scene, which looks along
    /// its direction. The end of the measurement applies to the vertical illuminance.
    ///
    /// # Errors
    /// Those of [`Self::run`], except that the scene needs no meters.
    pub fn rate_glare(self) -> Result<RoomGlare> {
        let scene = std::sync::Arc::clone(&self.loaded.scene);
        let camera = &scene.camera;
        let accel = backend::build(self.backend, &scene)?;
        let eye = Meter::irradiance(camera.position(), camera.direction())?;
        let view = Eye::new(&eye, camera.up(), SIDE);
        let integrate = || view.integrate(&scene, &*accel);
        let sets = match &self.threads {
            Some(threads) => threads.install(integrate),
            None => integrate(),
        };
        let eye = MeterSet::single("eye", MeterKind::Irradiance, eye);
        let measured = self.meters(vec![eye]).run(|_| ControlFlow::Continue(()))?;
        rating(&scene, &sets, &measured)
    }
}

/// Unified glare ratings of eyes at the meters of a set, which look along their normals with their
/// readings as vertical illuminance; `None` for eyes with no luminaire in view. Up is that of the
/// camera.
pub(super) fn ratings(
    scene: &Scene,
    accel: &dyn Intersect,
    meters: &[Meter],
    readings: &[Reading],
) -> Vec<Option<Estimated>> {
    let rate = |(meter, reading): (&Meter, &Reading)| {
        let eye = Eye::new(meter, scene.camera.up(), GRID_SIDE);
        let sum = glare_sum(&eye.integrate(scene, accel));
        (sum.value > 0.0).then(|| unified(sum, background(reading)).unwrap_or(Estimated::UNKNOWN))
    };
    meters.iter().zip(readings).map(rate).collect()
}

/// An eye: its position, and unit vectors to the right, up and along its view direction.
struct Eye {
    position: glam::Vec3,
    axes: DMat3,
    /// Rays along each of both coordinates of the half space.
    side: u32,
}

impl Eye {
    /// An eye that looks along the normal of a meter. Where `up` is that direction as well, it is
    /// turned anyhow.
    fn new(meter: &Meter, up: glam::Vec3, side: u32) -> Self {
        let along = meter.normal.as_dvec3();
        let right = along.cross(up.as_dvec3());
        let right = right.try_normalize().unwrap_or_else(|| along.any_orthonormal_vector());
        let axes = DMat3::from_cols(right, right.cross(along), along);
        Self { position: meter.position, axes, side }
    }

    /// Integrals over each emissive material in view, by its index, in independent sets of rays.
    fn integrate(&self, scene: &Scene, accel: &dyn Intersect) -> Vec<BTreeMap<u32, Integrals>> {
        let set = |set: u64| {
            let key = StreamKey::new(1, Stream::Glare, set);
            let row = |row: u32| self.row(scene, accel, row, key.rng(row.into()));
            let mut all: BTreeMap<u32, Integrals> = BTreeMap::new();
            let rows: Vec<_> = (0..self.side).into_par_iter().map(row).collect();
            for (material, own) in rows.iter().flatten() {
                all.entry(*material).or_default().add(own, 1.0);
            }
            all
        };
        (0..SETS).map(set).collect()
    }

    /// Integrals over a band of polar angles, by one ray in each cell of equal solid angle.
    fn row(
        &self,
        scene: &Scene,
        accel: &dyn Intersect,
        row: u32,
        mut rng: Rng,
    ) -> BTreeMap<u32, Integrals> {
        let side = f64::from(self.side);
        let mut locals = Vec::with_capacity(self.side as usize);
        for column in 0..self.side {
            let [u, v] = [rng.next_f64(), rng.next_f64()];
            let cos = 1.0 - (f64::from(row) + u) / side;
            let (sin, (y, x)) =
                ((1.0 - cos * cos).sqrt(), (TAU * (f64::from(column) + v) / side).sin_cos());
            locals.push(DVec3::new(sin * x, sin * y, cos));
        }
        let ray = |local: &DVec3| {
            Ray::new(self.position, (self.axes * *local).as_vec3().normalize_or_zero())
        };
        let rays: Vec<Ray> = locals.iter().map(ray).collect();
        let mut hits = vec![Hit::MISS; rays.len()];
        accel.closest_hits(&rays, &mut hits, Coherence::Coherent);
        let solid_angle = TAU / (side * side);
        let mut all: BTreeMap<u32, Integrals> = BTreeMap::new();
        for ((ray, hit), local) in rays.iter().zip(&hits).zip(&locals) {
            if hit.is_miss() {
                continue;
            }
            let surface = scene.surface(ray, hit);
            let own = f64::from(LUMENS_PER_WATT) * f64::from(luminance(surface.emission()));
            if own <= 0.0 {
                continue;
            }
            let index = position_index(*local);
            let material = scene.placements()[hit.mesh as usize].material;
            let square = own * own * solid_angle;
            let integrals = Integrals {
                solid_angle,
                flux: own * solid_angle,
                illuminance: own * solid_angle * local.z,
                square,
                glare: square / (index * index),
            };
            all.entry(material).or_default().add(&integrals, 1.0);
        }
        all
    }
}

/// The rating by the integrals of all sets and the light at the eye.
fn rating(
    scene: &Scene,
    sets: &[BTreeMap<u32, Integrals>],
    measured: &Measurement,
) -> Result<RoomGlare> {
    let count = sets.len() as f64;
    let mut materials: BTreeMap<u32, Integrals> = BTreeMap::new();
    for (material, own) in sets.iter().flatten() {
        materials.entry(*material).or_default().add(own, 1.0 / count);
    }
    let mut luminaires: Vec<(f64, LuminaireGlare)> = materials
        .iter()
        .map(|(material, own)| {
            let name = scene.materials()[*material as usize].name.clone();
            let luminaire = LuminaireGlare {
                name,
                luminance: own.flux / own.solid_angle,
                solid_angle: own.solid_angle,
                position_index: (own.square / own.glare).sqrt(),
                illuminance: own.illuminance,
            };
            (own.glare, luminaire)
        })
        .collect();
    luminaires.sort_by(|(a, _), (b, _)| b.total_cmp(a));
    let eye = measured.sets.first().and_then(|set| set.readings.first()).copied();
    let eye = eye.ok_or_else(|| Error::new("the eye has no reading", "report this as a bug"))?;
    let background = background(&eye);
    Ok(RoomGlare {
        ugr: unified(glare_sum(sets), background),
        background_luminance: background,
        vertical_illuminance: eye,
        luminaires: luminaires.into_iter().map(|(_, own)| own).collect(),
        points: scene.lights().emitters().iter().filter(|own| has_no_surface(own)).count(),
        notes: measured.warnings.clone(),
    })
}

/// Sum of the squared luminance over the squared position index, by independent sets of rays.
fn glare_sum(sets: &[BTreeMap<u32, Integrals>]) -> Estimated {
    let count = sets.len() as f64;
    let total = |set: &BTreeMap<u32, Integrals>| set.values().map(|own| own.glare).sum::<f64>();
    let totals: Vec<f64> = sets.iter().map(total).collect();
    let value = totals.iter().sum::<f64>() / count;
    let squares: f64 = totals.iter().map(|total| (total - value).powi(2)).sum();
    let expanded = student_95(count - 1.0) * (squares / (count * (count - 1.0))).sqrt();
    Estimated { value, expanded }
}

/// Luminance of the background of an eye with this vertical illuminance, cd/m^2.
fn background(eye: &Reading) -> Estimated {
    Estimated { value: eye.indirect() / PI, expanded: eye.expanded / PI }
}

/// The unified glare rating; `None` without a luminaire in view or without a background.
fn unified(sum: Estimated, background: Estimated) -> Option<Estimated> {
    (sum.value > 0.0 && background.value > 0.0).then(|| Estimated {
        value: 8.0 * (0.25 / background.value * sum.value).log10(),
        expanded: 8.0 / LN_10
            * (sum.expanded / sum.value).hypot(background.expanded / background.value),
    })
}

/// Whether a light in the room has no surface. The sun is not in the room.
fn has_no_surface(emitter: &Emitter) -> bool {
    emitter.is_delta() && !matches!(emitter, Emitter::Directional(_))
}
