//! Discomfort glare in a fisheye luminance image: daylight glare probability (DGP) and unified
//! glare rating (UGR).
//!
//! Glare sources are found as by `evalglare` (Wienold and Christoffersen 2006) with its defaults:
//! pixels above a luminance join the nearest source within an angle, else they begin another one.

use bdpm_core::base::math::{Rgb, luminance};
use bdpm_core::base::photometry::LUMENS_PER_WATT;
use bdpm_core::scene::FisheyeProjection;
use glam::DVec3;
use std::f64::consts::{FRAC_PI_2, PI};

/// Luminance above which pixels are glare sources unless given, cd/m^2.
pub const THRESHOLD: f64 = 2000.0;
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
}

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
        Self { pixels: pixels.iter().enumerate().filter_map(pixel).collect() }
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
    /// Luminance of the background that gives the illuminance at the eye without the sources,
    /// cd/m^2.
    pub background_luminance: f64,
    /// All glare sources, the strongest first.
    pub sources: Vec<GlareSource>,
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

impl Glare {
    /// Glare of an image with sources above a luminance, cd/m^2, that join within an angle,
    /// radians.
    pub fn new(image: &LuminanceImage, threshold: f64, search_angle: f64) -> Self {
        let vertical: f64 = image.pixels.iter().map(|(w, solid, l)| w.z * solid * l).sum();
        let mut all: Vec<Sums> = Vec::new();
        let near = search_angle.cos();
        for pixel in image.pixels.iter().filter(|(_, _, luminance)| *luminance > threshold) {
            let cosines = all.iter().map(|sums| sums.center().dot(pixel.0)).enumerate();
            let nearest = cosines.max_by(|(_, a), (_, b)| a.total_cmp(b));
            match nearest.filter(|(_, cosine)| *cosine > near) {
                Some((index, _)) => all[index].add(*pixel),
                None => {
                    let mut sums = Sums::default();
                    sums.add(*pixel);
                    all.push(sums);
                }
            }
        }
        // Sources whose centers approached each other are one.
        let mut index = 0;
        while index < all.len() {
            let center = all[index].center();
            let is_near = |other: &usize| all[*other].center().dot(center) > near;
            match (index + 1..all.len()).find(is_near) {
                Some(other) => {
                    let removed = all.remove(other);
                    all[index].merge(&removed);
                    index = 0;
                }
                None => index += 1,
            }
        }
        let source = |sums: &Sums| GlareSource {
            luminance: sums.weight / sums.solid_angle,
            solid_angle: sums.solid_angle,
            position_index: position_index(sums.center()),
            direction: sums.center().to_array(),
            illuminance: sums.illuminance,
        };
        let mut sources: Vec<GlareSource> = all.iter().map(source).collect();
        let strength = |source: &GlareSource| {
            source.luminance.powi(2) * source.solid_angle / source.position_index.powi(2)
        };
        sources.sort_by(|a, b| strength(b).total_cmp(&strength(a)));
        let sum: f64 = sources.iter().map(strength).sum();
        let direct: f64 = sources.iter().map(|source| source.illuminance).sum();
        let background = (vertical - direct).max(0.0) / PI;
        let ugr = (sum > 0.0 && background > 0.0).then(|| 8.0 * (0.25 / background * sum).log10());
        Self {
            dgp: probability(vertical, sum),
            ugr,
            vertical_illuminance: vertical,
            background_luminance: background,
            sources,
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
mod tests {
    use super::*;

    /// An image of the whole half-space in front of the eye with this luminance, cd/m^2.
    fn image(projection: FisheyeProjection, luminance: impl Fn(DVec3) -> f64) -> LuminanceImage {
        let side = 600;
        let black = vec![Rgb::ZERO; side * side];
        let mut own = LuminanceImage::new((side as u32, side as u32), &black, projection, PI);
        own.pixels.iter_mut().for_each(|(direction, _, value)| *value = luminance(*direction));
        own
    }

    #[test]
    fn uniform_image_has_pi_times_its_luminance_and_no_source() {
        for projection in FisheyeProjection::ALL {
            let own = image(projection, |_| 500.0);
            let solid: f64 = own.pixels.iter().map(|(_, solid, _)| solid).sum();
            assert!((solid / (2.0 * PI) - 1.0).abs() < 2e-3, "{projection:?}: {solid}");
            let glare = Glare::new(&own, THRESHOLD, SEARCH_ANGLE);
            assert!((glare.vertical_illuminance / (500.0 * PI) - 1.0).abs() < 2e-3);
            assert!(glare.sources.is_empty() && glare.ugr.is_none());
            let expected = 5.87e-5 * glare.vertical_illuminance + 0.16;
            assert!((glare.dgp - expected).abs() < 1e-12, "{}", glare.dgp);
        }
    }

    #[test]
    fn disc_of_a_source_has_its_solid_angle_and_rating() {
        // A disc of 4 degrees at 20 degrees to the right, of 20,000 cd/m^2 before 100 cd/m^2
        let (sin, cos) = 20f64.to_radians().sin_cos();
        let center = DVec3::new(sin, 0.0, cos);
        let half = 2f64.to_radians();
        let own = image(FisheyeProjection::Equidistant, |w| {
            if w.dot(center) > half.cos() { 20_000.0 } else { 100.0 }
        });
        let glare = Glare::new(&own, THRESHOLD, SEARCH_ANGLE);
        let [source] = &glare.sources[..] else { panic!("{} sources", glare.sources.len()) };
        let solid = 2.0 * PI * (1.0 - half.cos());
        assert!((source.solid_angle / solid - 1.0).abs() < 0.05, "{}", source.solid_angle);
        assert!((source.luminance - 20_000.0).abs() < 1e-6);
        // tau = 90 degrees and sigma = 20 degrees
        let linear: f64 = 35.2 - 0.31889 * 90.0 - 1.22 * (-20.0f64).exp();
        let square = 21.0 + 0.26667 * 90.0 - 0.002963 * 8100.0;
        let index = (1e-3 * linear * 20.0 + 1e-5 * square * 400.0).exp();
        assert!((source.position_index / index - 1.0).abs() < 1e-3);
        let background = 100.0 * (PI - solid * cos) / PI;
        assert!((glare.background_luminance / background - 1.0).abs() < 2e-3);
        let ugr = 8.0 * (0.25 / background * 4e8 * solid / (index * index)).log10();
        assert!((glare.ugr.unwrap() - ugr).abs() < 0.2, "{:?} {ugr}", glare.ugr);
    }

    /// Sources: degrees to the right and up, radius in degrees, luminance in cd/m^2.
    type Sources<'a> = &'a [[f64; 4]];

    /// Background and sources of images, and DGP, UGR, vertical illuminance and background by
    /// evalglare 3.06: `scripts/radiance_check.py glare`.
    const BY_EVALGLARE: [(f64, Sources, [f64; 4]); 5] = [
        (300.0, &[[25.0, 10.0, 12.0, 6000.0]], [0.2936, 25.277, 1635.6, 288.39]),
        (
            1500.0,
            &[[-10.0, 15.0, 10.0, 15_000.0], [30.0, 5.0, 4.0, 40_000.0]],
            [0.5699, 27.617, 6451.7, 1455.2],
        ),
        (30.0, &[[15.0, 20.0, 3.0, 8000.0]], [0.2625, 24.058, 156.31, 29.905]),
        (
            200.0,
            &[[5.0, -20.0, 5.0, 10_000.0], [-40.0, 30.0, 6.0, 5000.0]],
            [0.2781, 26.078, 958.12, 197.80],
        ),
        (
            80.0,
            &[[0.0, 35.0, 4.0, 5000.0], [-25.0, 40.0, 4.0, 5000.0], [25.0, 40.0, 4.0, 5000.0]],
            [0.2009, 17.109, 416.52, 79.030],
        ),
    ];

    #[test]
    fn ratings_are_those_of_evalglare() {
        for (background, sources, [dgp, ugr, vertical, lum_backg]) in BY_EVALGLARE {
            let own = image(FisheyeProjection::Equidistant, |w| {
                let lit = sources.iter().rev().find(|[right, up, radius, _]| {
                    let ((sx, cx), (sy, cy)) =
                        (right.to_radians().sin_cos(), up.to_radians().sin_cos());
                    w.dot(DVec3::new(sx * cy, sy, cx * cy)) > radius.to_radians().cos()
                });
                lit.map_or(background, |[_, _, _, luminance]| *luminance)
            });
            let glare = Glare::new(&own, THRESHOLD, SEARCH_ANGLE);
            println!("{} {:?} {glare:?}", glare.dgp, glare.ugr);
            // The pictures of evalglare have three digits, and its pixels other edges.
            assert!((glare.dgp - dgp).abs() < 5e-3, "{} {dgp}", glare.dgp);
            assert!((glare.ugr.unwrap() - ugr).abs() < 0.2, "{:?} {ugr}", glare.ugr);
            assert!((glare.vertical_illuminance / vertical - 1.0).abs() < 0.01);
            assert!((glare.background_luminance / lum_backg - 1.0).abs() < 0.02);
        }
    }

    #[test]
    fn distant_parts_are_sources_of_their_own_and_near_ones_join() {
        let at = |degrees: f64| {
            let (sin, cos) = degrees.to_radians().sin_cos();
            DVec3::new(sin, 0.0, cos)
        };
        let lit = |w: DVec3| [at(-30.0), at(10.0), at(16.0)].iter().any(|c| w.dot(*c) > 0.9995);
        let own = image(FisheyeProjection::Equisolid, |w| if lit(w) { 1e4 } else { 50.0 });
        assert_eq!(Glare::new(&own, THRESHOLD, SEARCH_ANGLE).sources.len(), 2);
        assert_eq!(Glare::new(&own, THRESHOLD, 0.05).sources.len(), 3);
        assert_eq!(Glare::new(&own, 2e4, SEARCH_ANGLE).sources.len(), 0);
    }

    #[test]
    fn position_index_grows_away_from_the_view_direction() {
        let at = |up: f64, right: f64| position_index(DVec3::new(right, up, 1.0).normalize());
        assert!((at(0.0, 0.0) - 1.0).abs() < 1e-9);
        assert!(at(0.3, 0.0) < at(0.6, 0.0) && at(0.0, 0.3) < at(0.0, 0.6));
        // beta = atan(0.5 sqrt(1.3225)) = 29.899 degrees
        let below = (6.49e-3 * 29.899 + 21e-5 * 29.899f64.powi(2)).exp();
        assert!((at(-0.5, 0.0) - below).abs() < 1e-4, "{}", at(-0.5, 0.0));
        assert!(at(5.0, 0.0) <= MAX_INDEX);
    }
}
