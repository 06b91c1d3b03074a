//! Scattering of windows, blinds and prismatic sheets by matrices over patches of directions
//! (Klems 1994), as WINDOW and genBSDF write them. theory.md (27c), (27d)

use super::model::{Describe, Lobes, Model, TextureValues, Traits, Transmission, values_by_class};
use super::{Bsdf, BsdfSample, Lobe, LobeSet, LobeValue, Transport, Vertex};
use crate::base::math::{Frame, Rgb};
use crate::base::rng::Rng;
use glam::Vec3;
use serde::Serialize;
use std::f32::consts::{PI, TAU};
use std::sync::Mutex;

/// Maximum number of patches of a hemisphere.
pub const MAX_PATCHES: usize = 1000;

/// A band of polar angles.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct AngleBand {
    /// Largest polar angle, degrees; the smallest is that of the band before, or 0.
    pub upper_deg: f32,
    /// Number of patches of equal azimuth, 1 or even; the first is centered on x.
    pub patches: usize,
}

/// The patches of a hemisphere of directions.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct AngleBasis {
    bands: Vec<AngleBand>,
    /// Square of the sine of the largest angle of each band.
    squares: Vec<f32>,
    /// Index of the first patch of each band, and the number of all.
    first: Vec<usize>,
}

impl AngleBasis {
    /// The patches of these bands; `None` unless they are in ascending order from 0 to 90 degrees,
    /// with 1 or an even number of patches each and at most [`MAX_PATCHES`] in all.
    pub fn new(bands: Vec<AngleBand>) -> Option<Self> {
        let mut first = vec![0];
        let mut lower = 0.0;
        for band in &bands {
            let is_even = band.patches == 1 || band.patches.is_multiple_of(2);
            let is_wide = band.upper_deg > lower && band.upper_deg <= 90.0;
            let next = first[first.len() - 1] + band.patches.min(MAX_PATCHES + 1);
            if !is_even || band.patches == 0 || !is_wide || next > MAX_PATCHES {
                return None;
            }
            first.push(next);
            lower = band.upper_deg;
        }
        let squares = bands.iter().map(|band| band.upper_deg.to_radians().sin().powi(2)).collect();
        (lower == 90.0).then_some(Self { bands, squares, first })
    }

    /// One of the three bases of WINDOW: `LBNL/Klems Full`, `Half` and `Quarter`.
    pub fn named(name: &str) -> Option<Self> {
        let (angles, counts): (&[f32], &[usize]) = match name.trim().to_ascii_lowercase().as_str() {
            "lbnl/klems full" => (
                &[5.0, 15.0, 25.0, 35.0, 45.0, 55.0, 65.0, 75.0, 90.0],
                &[1, 8, 16, 20, 24, 24, 24, 16, 12],
            ),
            "lbnl/klems half" => {
                (&[6.5, 19.5, 32.5, 46.5, 61.5, 76.5, 90.0], &[1, 8, 12, 16, 20, 12, 4])
            }
            "lbnl/klems quarter" => (&[9.0, 27.0, 46.0, 66.0, 90.0], &[1, 8, 12, 12, 8]),
            _ => return None,
        };
        let bands = angles.iter().zip(counts);
        Self::new(bands.map(|(&upper_deg, &patches)| AngleBand { upper_deg, patches }).collect())
    }

    /// The bands, from the normal to the horizon.
    pub fn bands(&self) -> &[AngleBand] {
        &self.bands
    }

    /// Number of patches.
    pub fn patches(&self) -> usize {
        self.first[self.bands.len()]
    }

    /// The band of a patch.
    fn band_of(&self, patch: usize) -> usize {
        self.first.partition_point(|first| *first <= patch) - 1
    }

    /// Squares of the sine of the smallest and the largest angle of a band.
    fn bounds(&self, band: usize) -> [f32; 2] {
        [if band == 0 { 0.0 } else { self.squares[band - 1] }, self.squares[band]]
    }

    /// Projected solid angle of a patch, sr.
    pub fn projected(&self, patch: usize) -> f32 {
        let band = self.band_of(patch);
        let [lower, upper] = self.bounds(band);
        PI * (upper - lower) / self.bands[band].patches as f32
    }

    /// The patch of a unit direction, on either side of the surface.
    fn patch(&self, w: Vec3) -> usize {
        let square = w.x * w.x + w.y * w.y;
        let band = self.squares.partition_point(|upper| *upper <= square);
        let band = band.min(self.bands.len() - 1);
        let count = self.bands[band].patches;
        let turn = w.y.atan2(w.x) / TAU * count as f32;
        // Azimuths from half a patch before x on.
        let index = (turn + 0.5).floor().rem_euclid(count as f32) as usize;
        self.first[band] + index.min(count - 1)
    }

    /// The patch at the same polar angle and the opposite azimuth.
    fn opposite(&self, patch: usize) -> usize {
        let band = self.band_of(patch);
        let (first, count) = (self.first[band], self.bands[band].patches);
        first + (patch - first + count / 2) % count
    }

    /// A direction on the front side, evenly by projected solid angle within a patch.
    fn direction(&self, patch: usize, [u, v]: [f32; 2]) -> Vec3 {
        let band = self.band_of(patch);
        let [lower, upper] = self.bounds(band);
        let square = lower + (upper - lower) * u;
        let index = (patch - self.first[band]) as f32 + v - 0.5;
        let (sin, cos) = (TAU * index / self.bands[band].patches as f32).sin_cos();
        let radius = square.sqrt();
        Vec3::new(cos * radius, sin * radius, (1.0 - square).max(1e-12).sqrt())
    }
}

/// Light from one side: scattered back to it, and on to the other side.
pub type SideValues = [Option<Vec<f32>>; 2];

/// Scattering at a sheet between patches of directions, the same for all colors.
///
/// Rows are patches into which light is scattered; columns are those from which it comes, each
/// named by the patch into which it would go straight on, or by which a mirror would send it.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct KlemsMatrices {
    basis: AngleBasis,
    /// Values, 1/sr, for light from the front and from the back.
    values: [[Vec<f32>; 2]; 2],
    /// Sums of the probabilities of patches on the own and on the other side, for each side and
    /// patch of the known direction. theory.md (27d)
    #[serde(skip)]
    sums: [Vec<f32>; 2],
    /// Shares of diffuse light from the front and from the back: reflected, transmitted.
    #[serde(skip)]
    shares: [[f32; 2]; 2],
}

/// Largest scattered share of the light from a direction that is taken for the rounding of a
/// simulation.
const MAX_SCATTERED: f32 = 1.05;

impl KlemsMatrices {
    /// Matrices with the values of light from the front and from the back; negative values become
    /// 0. A missing transmission is that of the other side in reverse; missing reflections are 0.
    ///
    /// # Errors
    /// If a matrix has not the square of the number of patches as finite values, all are missing,
    /// or more than 1.05 of the light from some direction is scattered.
    pub fn new(basis: AngleBasis, values: [SideValues; 2]) -> Result<Self, String> {
        let patches = basis.patches();
        if values.iter().flatten().all(Option::is_none) {
            return Err("there is no matrix".to_owned());
        }
        let sizes = values.iter().flatten().flatten().map(Vec::len);
        if let Some(wrong) = sizes.into_iter().find(|size| *size != patches * patches) {
            return Err(format!("a matrix has {wrong} values, not {patches} x {patches}"));
        }
        if !values.iter().flatten().flatten().flatten().all(|value| value.is_finite()) {
            return Err("a value is not finite".to_owned());
        }
        let [[reflects, forth], [reflects_back, back]] = values;
        let reversed = |own: &Vec<f32>| basis.reversed(own);
        let forth_or = forth.clone().or_else(|| back.as_ref().map(reversed));
        let back_or = back.or_else(|| forth.as_ref().map(reversed));
        let own = |own: Option<Vec<f32>>| {
            let mut own = own.unwrap_or_else(|| vec![0.0; patches * patches]);
            own.iter_mut().for_each(|value| *value = value.max(0.0));
            own
        };
        let values = [[own(reflects), own(forth_or)], [own(reflects_back), own(back_or)]];
        let sums = [Vec::new(), Vec::new()];
        let mut matrices = Self { basis, values, sums, shares: Default::default() };
        let most = [true, false].map(|front| {
            (0..patches).map(|from| matrices.scattered(front, from)).fold(0.0, f32::max)
        });
        let most = most[0].max(most[1]);
        if most > MAX_SCATTERED {
            return Err(format!("the sheet scatters {most} of the light from some direction"));
        }
        matrices.sums = [true, false].map(|front| matrices.cumulative(front));
        matrices.shares = [true, false].map(|front| matrices.diffuse_shares(front));
        Ok(matrices)
    }

    /// These matrices for the rest of the program: a BSDF is copied at each hit, so it refers to
    /// them. Equal ones are kept once.
    pub fn shared(self) -> &'static Self {
        static ALL: Mutex<Vec<&'static KlemsMatrices>> = Mutex::new(Vec::new());
        let mut all = ALL.lock().unwrap_or_else(|broken| broken.into_inner());
        if let Some(same) = all.iter().find(|other| ***other == self) {
            return same;
        }
        let own: &'static Self = Box::leak(Box::new(self));
        all.push(own);
        own
    }

    /// The patches of both hemispheres.
    pub fn basis(&self) -> &AngleBasis {
        &self.basis
    }

    /// Values of one side, 1/sr: reflected, transmitted.
    pub fn values(&self, front: bool) -> &[Vec<f32>; 2] {
        &self.values[usize::from(!front)]
    }

    /// Share of the light of a column that is scattered to both sides.
    pub fn scattered(&self, front: bool, column: usize) -> f32 {
        let patches = self.basis.patches();
        let to = |values: &Vec<f32>| -> f32 {
            (0..patches).map(|row| values[row * patches + column] * self.basis.projected(row)).sum()
        };
        self.values(front).iter().map(to).sum()
    }

    /// Share of diffuse light from one side that is scattered: reflected, transmitted.
    fn diffuse_shares(&self, front: bool) -> [f32; 2] {
        let (basis, patches) = (&self.basis, self.basis.patches());
        [0, 1].map(|transmits| {
            let values = &self.values(front)[transmits];
            let pair = |index: usize| {
                let areas = basis.projected(index / patches) * basis.projected(index % patches);
                f64::from(values[index]) * f64::from(areas)
            };
            ((0..patches * patches).map(pair).sum::<f64>() / std::f64::consts::PI) as f32
        })
    }

    /// The value of light that comes from `from` and leaves toward `to`, both patches of their
    /// directions away from the sheet.
    fn value(&self, (from_front, from): (bool, usize), (to_front, to): (bool, usize)) -> f32 {
        let values = &self.values(from_front)[usize::from(from_front != to_front)];
        values[to * self.basis.patches() + self.basis.opposite(from)]
    }

    /// The sums of one side of the known direction. theory.md (27d)
    fn cumulative(&self, front: bool) -> Vec<f32> {
        let patches = self.basis.patches();
        let mut all = Vec::with_capacity(2 * patches * patches);
        for known in 0..patches {
            let start = all.len();
            let mut sum = 0.0;
            for index in 0..2 * patches {
                let [known, other] =
                    [(front, known), ((index < patches) == front, index % patches)];
                let mean = 0.5 * (self.value(known, other) + self.value(other, known));
                sum += mean * self.basis.projected(other.1);
                all.push(sum);
            }
            if sum > 0.0 {
                all[start..].iter_mut().for_each(|own| *own /= sum);
            }
        }
        all
    }

    /// The sums of a known direction.
    fn sums(&self, (front, known): (bool, usize)) -> &[f32] {
        let row = 2 * self.basis.patches();
        &self.sums[usize::from(!front)][known * row..(known + 1) * row]
    }

    /// Probability of sampling a patch, given a known one.
    fn prob(&self, known: (bool, usize), (front, patch): (bool, usize)) -> f32 {
        let index = if front == known.0 { patch } else { self.basis.patches() + patch };
        let sums = self.sums(known);
        sums[index] - if index == 0 { 0.0 } else { sums[index - 1] }
    }
}

impl AngleBasis {
    /// The matrix of transmission from the other side: light takes the same way back.
    fn reversed(&self, values: &[f32]) -> Vec<f32> {
        let patches = self.patches();
        let opposite: Vec<usize> = (0..patches).map(|patch| self.opposite(patch)).collect();
        let pair =
            |index: usize| values[opposite[index % patches] * patches + opposite[index / patches]];
        (0..patches * patches).map(pair).collect()
    }
}

/// A sheet that scatters by [`KlemsMatrices`]: all of its light merges and connects.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Klems {
    matrices: &'static KlemsMatrices,
    /// Direction, of any length, whose part along the sheet is the y axis of the matrices. z is the
    /// front, and x is to the right of those who look at the front.
    up: Vec3,
}

impl Klems {
    /// A sheet with this side up, in scene space. Where `up` is along the normal, the azimuths of
    /// the matrices begin anywhere.
    pub fn new(matrices: &'static KlemsMatrices, up: Vec3) -> Self {
        Self { matrices, up }
    }

    /// The matrices.
    pub fn matrices(&self) -> &'static KlemsMatrices {
        self.matrices
    }

    /// The direction that is up.
    pub fn up(&self) -> Vec3 {
        self.up
    }

    /// Shares of diffuse light from the front or the back: reflected, transmitted.
    pub fn diffuse_shares(&self, front: bool) -> [f32; 2] {
        self.matrices.shares[usize::from(!front)]
    }

    fn frame(&self, at: &Vertex) -> Frame {
        let front = if at.front { at.normal } else { -at.normal };
        Frame::with_tangent(front, self.up.cross(front))
    }

    /// Side and patch of a local direction.
    fn place(&self, w: Vec3) -> (bool, usize) {
        (w.z > 0.0, self.matrices.basis.patch(w))
    }

    /// Value for light that arrives from `wi` and leaves along the path, 1/sr. theory.md (27c)
    pub fn eval(&self, at: &Vertex, wi: Vec3) -> Rgb {
        if at.wo.dot(at.normal) <= 0.0 {
            return Rgb::ZERO;
        }
        let frame = self.frame(at);
        let [wo, wi] = [at.wo, wi].map(|w| self.place(frame.to_local(w)));
        Rgb::splat(self.matrices.value(wi, wo))
    }

    /// Density of sampling `wi`, 1/sr, for either quantity that paths carry. theory.md (27d)
    pub fn pdf_w(&self, at: &Vertex, wi: Vec3) -> f32 {
        if at.wo.dot(at.normal) <= 0.0 {
            return 0.0;
        }
        let frame = self.frame(at);
        let (wo, wi) = (self.place(frame.to_local(at.wo)), frame.to_local(wi));
        let place = self.place(wi);
        self.matrices.prob(wo, place) / self.matrices.basis.projected(place.1) * wi.z.abs()
    }

    /// Samples a direction on either side.
    pub fn sample(&self, at: &Vertex, transport: Transport, rng: &mut Rng) -> Option<BsdfSample> {
        if at.wo.dot(at.normal) <= 0.0 {
            return None;
        }
        let frame = self.frame(at);
        let known = self.place(frame.to_local(at.wo));
        let (sums, patches) = (self.matrices.sums(known), self.matrices.basis.patches());
        let u = rng.next_1d();
        // Sums end at 1 but for rounding, or are all 0.
        let index = sums.partition_point(|sum| *sum <= u);
        let other = (known.0 == (index < patches), index % patches);
        let within = rng.next_2d();
        if index == sums.len() {
            return None;
        }
        let basis = &self.matrices.basis;
        let front = basis.direction(other.1, within);
        let wi = if other.0 { front } else { front * Vec3::new(1.0, 1.0, -1.0) };
        let value = match transport {
            Transport::Radiance => self.matrices.value(other, known),
            Transport::Flux => self.matrices.value(known, other),
        };
        let prob = self.matrices.prob(known, other);
        if prob <= 0.0 {
            return None;
        }
        let weight = Rgb::splat(value * basis.projected(other.1) / prob);
        Some(BsdfSample { wi: frame.to_world(wi), weight, lobe: Lobe::Wide })
    }
}

impl Describe for Klems {
    #[inline]
    fn traits(&self) -> Traits {
        Traits {
            classes: Lobes::of(Lobe::Wide),
            transmission: Transmission::Diffuse,
            depends_on_tangent: false,
            albedo_bound: Rgb::ONE,
        }
    }

    fn textured(&self, _texture: &TextureValues) -> Option<Bsdf> {
        None
    }

    fn color(&self, front: bool) -> Rgb {
        Rgb::splat(self.diffuse_shares(front).iter().sum())
    }
}

/// In a frame of its own, that of the matrices.
impl Model for Klems {
    fn eval(&self, _lobe: Option<Lobe>, at: &Vertex, wi: Vec3) -> Rgb {
        self.eval(at, wi)
    }

    fn pdf_w(&self, _lobe: Lobe, at: &Vertex, wi: Vec3) -> f32 {
        self.pdf_w(at, wi)
    }

    fn values(&self, at: &Vertex, wi: Vec3) -> [LobeValue; 2] {
        values_by_class(self, at, wi)
    }

    #[inline]
    fn pass_prob(&self, _at: &Vertex) -> f32 {
        0.0
    }

    fn sample(
        &self,
        at: &Vertex,
        transport: Transport,
        _wanted: LobeSet,
        rng: &mut Rng,
    ) -> Option<BsdfSample> {
        self.sample(at, transport, rng)
    }
}

#[cfg(test)]
#[path = "klems_tests.rs"]
mod tests;
