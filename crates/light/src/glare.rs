//! Discomfort glare in a fisheye luminance image: daylight glare probability (DGP) and unified
//! glare rating (UGR).
//!
//! Glare sources are found as by `evalglare` (Wienold and Christoffersen 2006) with its defaults:
//! pixels above a luminance join the nearest source within an angle, else they begin another one.
//! Pixels above a higher luminance, such as those of the sun, leave their source and join each
//! other likewise.

mod uncertainty;

pub use uncertainty::Expanded;

use bdpm_core::base::math::{Rgb, luminance};
use bdpm_core::base::photometry::LUMENS_PER_WATT;
use bdpm_core::scene::FisheyeProjection;
use glam::DVec3;
use std::f64::consts::{FRAC_PI_2, PI};
use uncertainty::{Noise, Totals};

/// Luminance above which pixels are glare sources unless given, cd/m^2.
pub const THRESHOLD: f64 = 2000.0;
/// Luminance above which pixels are extracted from their source unless given, cd/m^2.
pub const PEAK: f64 = 50_000.0;
/// Angle within which pixels belong to one source unless given, radians.
pub const SEARCH_ANGLE: f64 = 0.2;
/// Largest position index: a source there has no effect.
const MAX_INDEX: f64 = 16.0;

/// A square image of luminances around the view direction. +x is right, +y up and +z the view
/// direction.
#[derive(Clone, Debug)]
pub struct LuminanceImage {
    /// Direction, solid angle in sr and luminance in cd/m^2 of each pixel in the image circle in
    /// front of the eye.
    pixels: Vec<(DVec3, f64, f64)>,
    /// The noise of `pixels`.
    noise: Noise,
    /// Index in `pixels` of each pixel of the image, row by row; [`OUTSIDE`] for others.
    index: Vec<u32>,
    width: usize,
}

/// Index of pixels outside of the image circle.
const OUTSIDE: u32 = u32::MAX;

impl LuminanceImage {
    /// The pixels of a fisheye image, W/(m^2 sr), whose circle spans the full angle
    /// `field_of_view`, radians. The circle touches the shorter sides of the image.
    pub fn new(
        (width, height): (u32, u32),
        pixels: &[Rgb],
        projection: FisheyeProjection,
        field_of_view: f64,
    ) -> Self {
        let radius = 0.5 * f64::from(width.min(height));
        let edge = 0.5 * field_of_view;
        // Angle from the axis at a share of the radius, and its derivative
        let angle = |share: f64| match projection {
            FisheyeProjection::Equidistant => (share * edge, edge),
            FisheyeProjection::Equisolid => {
                let scale = (0.5 * edge).sin();
                let sine = (share * scale).min(1.0);
                (2.0 * sine.asin(), 2.0 * scale / (1.0 - sine * sine).sqrt())
            }
        };
        let pixel = |(index, pixel): (usize, &Rgb)| {
            let (column, row) = (index as u32 % width, index as u32 / width);
            let x = (f64::from(column) + 0.5 - 0.5 * f64::from(width)) / radius;
            let y = (0.5 * f64::from(height) - f64::from(row) - 0.5) / radius;
            let share = x.hypot(y);
            let (theta, slope) = angle(share);
            if share > 1.0 || theta >= FRAC_PI_2 {
                return None;
            }
            let (sin, cos) = theta.sin_cos();
            // Area of a pixel in radii squared, times the solid angle of that area
            let stretch = if share > 0.0 { sin / share * slope } else { slope * slope };
            let solid_angle = stretch / (radius * radius);
            let across = if share > 0.0 { sin / share } else { slope };
            let direction = DVec3::new(x * across, y * across, cos);
            let value = f64::from(LUMENS_PER_WATT) * f64::from(luminance(*pixel));
            Some((direction, solid_angle, value))
        };
        let all: Vec<_> = pixels.iter().enumerate().map(pixel).collect();
        let mut count = 0;
        let number = |own: &Option<_>| {
            let index = if own.is_some() { count } else { OUTSIDE };
            count += u32::from(own.is_some());
            index
        };
        let index = all.iter().map(number).collect();
        let pixels = all.into_iter().flatten().collect();
        Self { pixels, noise: Noise::Unknown, index, width: width as usize }
    }

    /// Calls `visit` with the index of each pixel and those of its neighbors, at most eight.
    fn neighborhoods(&self, mut visit: impl FnMut(usize, &[usize])) {
        let (width, height) = (self.width, self.index.len() / self.width.max(1));
        for (at, own) in self.index.iter().enumerate().filter(|(_, own)| **own != OUTSIDE) {
            let (x, y) = (at % width, at / width);
            let (mut near, mut count) = ([0; 8], 0);
            for row in y.saturating_sub(1)..=(y + 1).min(height - 1) {
                for column in x.saturating_sub(1)..=(x + 1).min(width - 1) {
                    let other = self.index[row * width + column];
                    if (row, column) != (y, x) && other != OUTSIDE {
                        near[count] = other as usize;
                        count += 1;
                    }
                }
            }
            visit(*own as usize, &near[..count]);
        }
    }
}

/// A glare source.
#[derive(Clone, Copy, Debug, serde::Serialize)]
pub struct GlareSource {
    /// Mean luminance, cd/m^2.
    pub luminance: f64,
    /// sr.
    pub solid_angle: f64,
    /// Position index, [`position_index`].
    pub position_index: f64,
    /// Unit direction of its center: right, up, view direction.
    pub direction: [f64; 3],
    /// Illuminance at the eye, lx.
    pub illuminance: f64,
}

/// Glare of an image.
#[derive(Clone, Debug, serde::Serialize)]
pub struct Glare {
    /// Daylight glare probability, in [0, 1].
    pub dgp: f64,
    /// Unified glare rating; `None` without a source or background.
    pub ugr: Option<f64>,
    /// Vertical illuminance at the eye, lx.
    pub vertical_illuminance: f64,
    /// Uncertainties by the noise of the image; `None` if that of its pixels is unknown.
    pub expanded: Option<Expanded>,
    /// Luminance of the background that gives the illuminance at the eye without the sources,
    /// cd/m^2.
    pub background_luminance: f64,
    /// All glare sources, the strongest first.
    pub sources: Vec<GlareSource>,
    /// Index in `sources` of each pixel of the image, row by row; `None` for those of no source.
    #[serde(skip)]
    pub source_of_pixel: Vec<Option<usize>>,
}

/// Sums over the pixels of a source.
#[derive(Clone, Copy, Debug, Default)]
struct Sums {
    solid_angle: f64,
    /// Luminance times solid angle.
    weight: f64,
    illuminance: f64,
    /// Directions times weights.
    direction: DVec3,
}

impl Sums {
    fn add(&mut self, (direction, solid_angle, luminance): (DVec3, f64, f64)) {
        let weight = luminance * solid_angle;
        self.solid_angle += solid_angle;
        self.weight += weight;
        self.illuminance += weight * direction.z;
        self.direction += weight * direction;
    }

    fn merge(&mut self, other: &Self) {
        self.solid_angle += other.solid_angle;
        self.weight += other.weight;
        self.illuminance += other.illuminance;
        self.direction += other.direction;
    }

    fn center(&self) -> DVec3 {
        self.direction.normalize_or_zero()
    }
}

/// Position index of a unit direction: Guth's by the formula of the IES lighting handbook above the
/// view direction, and Iwata's in the form of the CIE (2010) below, as `evalglare` has them.
pub fn position_index(direction: DVec3) -> f64 {
    let DVec3 { x, y, z } = direction;
    // Angle between the vertical and the plane through the source and the view direction, and the
    // angle from the latter
    let tau = x.abs().atan2(y).to_degrees();
    let sigma = x.hypot(y).atan2(z).to_degrees();
    let exponent = if y >= 0.0 {
        let linear = 35.2 - 0.31889 * tau - 1.22 * (-2.0 * tau / 9.0).exp();
        let square = 21.0 + 0.26667 * tau - 0.002963 * tau * tau;
        1e-3 * linear * sigma + 1e-5 * square * sigma * sigma
    } else {
        let cos = tau.to_radians().cos();
        let beta =
            (sigma.to_radians().tan() * (1.0 + 0.3225 * cos * cos).sqrt()).atan().to_degrees();
        6.49e-3 * beta + 21e-5 * beta * beta
    };
    exponent.exp().min(MAX_INDEX)
}

/// Bounds by which glare sources are found.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SourceSearch {
    /// Luminance above which pixels are glare sources, cd/m^2.
    pub threshold: f64,
    /// Luminance above which pixels are extracted from their source, cd/m^2.
    pub peak: f64,
    /// Angle within which pixels and sources join, radians.
    pub angle: f64,
}

impl Default for SourceSearch {
    fn default() -> Self {
        Self { threshold: THRESHOLD, peak: PEAK, angle: SEARCH_ANGLE }
    }
}

impl SourceSearch {
    /// Numbers of the sources of all pixels of an image.
    fn sources(&self, image: &LuminanceImage) -> (Vec<Option<usize>>, usize) {
        let lit = |luminance: f64| luminance > self.threshold;
        let (mut owner, count) = self.joined(image, lit);
        let (peaks, peak_count) = self.joined(image, |luminance| luminance > self.peak);
        for (owner, peak) in owner.iter_mut().zip(peaks) {
            *owner = peak.map(|peak| count + peak).or(*owner);
        }
        (owner, count + peak_count)
    }

    /// Sources of the pixels whose luminance is `wanted`.
    fn joined(
        &self,
        image: &LuminanceImage,
        wanted: impl Fn(f64) -> bool,
    ) -> (Vec<Option<usize>>, usize) {
        let mut all: Vec<Sums> = Vec::new();
        let near = self.angle.cos();
        let mut owner = vec![None; image.pixels.len()];
        let pixels = image.pixels.iter().zip(&mut owner);
        for (pixel, owner) in pixels.filter(|((_, _, luminance), _)| wanted(*luminance)) {
            let cosines = all.iter().map(|sums| sums.center().dot(pixel.0)).enumerate();
            let nearest = cosines.max_by(|(_, a), (_, b)| a.total_cmp(b));
            let nearest = nearest.filter(|(_, cosine)| *cosine > near);
            let index = nearest.map_or(all.len(), |(index, _)| index);
            if index == all.len() {
                all.push(Sums::default());
            }
            all[index].add(*pixel);
            *owner = Some(index);
        }
        // Sources whose centers approached each other are one.
        let mut names: Vec<usize> = (0..all.len()).collect();
        let mut left = names.clone();
        let mut index = 0;
        while index < left.len() {
            let center = all[left[index]].center();
            let is_near = |other: &usize| all[left[*other]].center().dot(center) > near;
            match (index + 1..left.len()).find(is_near) {
                Some(other) => {
                    let (kept, removed) = (left[index], left.remove(other));
                    let sums = all[removed];
                    all[kept].merge(&sums);
                    names.iter_mut().filter(|name| **name == removed).for_each(|name| *name = kept);
                    index = 0;
                }
                None => index += 1,
            }
        }
        owner.iter_mut().flatten().for_each(|owner| *owner = names[*owner]);
        (owner, all.len())
    }
}

/// Luminances and solid angles of sources whose edges cross pixels: `[L, omega]`. The luminance is
/// that of the pixels whose neighbors all belong to the source. The solid angle gives the
/// illuminance of all pixels with any part of the source; outside of it, the part is what exceeds
/// the darker neighbors.
fn with_edges(image: &LuminanceImage, owner: &[Option<usize>], count: usize) -> Vec<[f64; 2]> {
    let mut inner = vec![Sums::default(); count];
    let mut weight = vec![0.0; count];
    image.neighborhoods(|own, near| {
        let (_, solid, luminance) = image.pixels[own];
        if let Some(source) = owner[own] {
            weight[source] += luminance * solid;
            if near.iter().all(|other| owner[*other] == Some(source)) {
                inner[source].add(image.pixels[own]);
            }
            return;
        }
        let source = near.iter().find_map(|other| owner[*other]);
        let outside = near.iter().filter(|other| owner[**other].is_none());
        let darkest = outside.map(|other| image.pixels[*other].2).fold(luminance, f64::min);
        if let Some(source) = source {
            weight[source] += (luminance - darkest) * solid;
        }
    });
    let of_source = |(inner, weight): (&Sums, &f64)| {
        let luminance = inner.weight / inner.solid_angle;
        [luminance, weight / luminance]
    };
    inner.iter().zip(&weight).map(of_source).collect()
}

impl Glare {
    /// Glare of an image.
    pub fn new(image: &LuminanceImage, search: &SourceSearch) -> Self {
        let vertical: f64 = image.pixels.iter().map(|(w, solid, l)| w.z * solid * l).sum();
        let (owner, count) = search.sources(image);
        let mut all = vec![Sums::default(); count];
        for (pixel, owner) in image.pixels.iter().zip(&owner) {
            if let Some(owner) = owner {
                all[*owner].add(*pixel);
            }
        }
        let edges = with_edges(image, &owner, count);
        // Sources that joined others have no pixels.
        let used: Vec<usize> = (0..count).filter(|own| all[*own].solid_angle > 0.0).collect();
        let source = |sums: &Sums| GlareSource {
            luminance: sums.weight / sums.solid_angle,
            solid_angle: sums.solid_angle,
            position_index: position_index(sums.center()),
            direction: sums.center().to_array(),
            illuminance: sums.illuminance,
        };
        let mut sources: Vec<(usize, GlareSource)> =
            used.into_iter().map(|own| (own, source(&all[own]))).collect();
        let strength = |source: &GlareSource| {
            source.luminance.powi(2) * source.solid_angle / source.position_index.powi(2)
        };
        let sum: f64 = sources.iter().map(|(_, source)| strength(source)).sum();
        // Squares of luminances lose the pixels that a source covers in part.
        let whole = |(number, source): &(usize, GlareSource)| {
            let [luminance, solid_angle] = edges[*number];
            let own = luminance.powi(2) * solid_angle / source.position_index.powi(2);
            if own.is_finite() { own } else { strength(source) }
        };
        let sum_of_whole: f64 = sources.iter().map(whole).sum();
        sources.sort_by(|(_, a), (_, b)| strength(b).total_cmp(&strength(a)));
        let mut rank = vec![None; count];
        for (place, (number, _)) in sources.iter().enumerate() {
            rank[*number] = Some(place);
        }
        let source_of_pixel = |index: &u32| owner.get(*index as usize)?.and_then(|own| rank[own]);
        let direct: f64 = sources.iter().map(|(_, source)| source.illuminance).sum();
        let background = (vertical - direct).max(0.0) / PI;
        let is_rated = sum > 0.0 && background > 0.0;
        let ugr = is_rated.then(|| 8.0 * (0.25 / background * sum_of_whole).log10());
        let totals = Totals { vertical, background, sum };
        Self {
            expanded: totals.expanded(image, &owner, &all, ugr.is_some()),
            dgp: probability(vertical, sum),
            ugr,
            vertical_illuminance: vertical,
            background_luminance: background,
            source_of_pixel: image.index.iter().map(source_of_pixel).collect(),
            sources: sources.into_iter().map(|(_, source)| source).collect(),
        }
    }
}

/// DGP by the vertical illuminance, lx, and the sum of `L^2 omega/P^2` over the sources (Wienold
/// and Christoffersen 2006), without a correction for low light.
fn probability(vertical: f64, sum: f64) -> f64 {
    if vertical <= 0.0 {
        return 0.0;
    }
    let contrast = (1.0 + sum / vertical.powf(1.87)).log10();
    (5.87e-5 * vertical + 9.18e-2 * contrast + 0.16).min(1.0)
}

#[cfg(test)]
mod tests;
