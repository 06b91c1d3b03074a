//! What the judge finds, and how it says it.

use crate::job::{AuditedRegion, MIN_HITS, named_regions};
use bdpm_core::accel::Intersect;
use bdpm_core::noise::difference::{Cells, Difference, MeanDifference, ScaleDifference, TileMap};
use bdpm_core::render::audit::{AuditSums, Audited};
use bdpm_core::scene::Scene;
use bdpm_core::settings::Settings;
use serde::Serialize;
use std::fmt::Write;
use std::time::Duration;

/// Probability that a right image is called wrong.
pub const RISK: f64 = 0.05;

/// Standard deviations of the normal distribution below which 95 % of the values lie.
const UPPER: f64 = 1.645;

/// Maximum number of regions that are named.
const MAX_REGIONS: usize = 5;

/// Share of the squared difference that an explanation must remove.
const EXPLAINED: f64 = 0.5;

/// Smallest shift that is named, pixels.
const LEAST_SHIFT: f64 = 0.05;

/// Verdict on an image.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum JudgeVerdict {
    /// No difference, and all that are larger than the precision are excluded.
    Right,
    /// A difference that a right image has with a probability of 5 % at most.
    Wrong,
    /// No difference, but the time did not suffice to exclude all of them.
    Undecided,
}

/// Where the noise of the image is known from.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum NoiseSource {
    /// From the difference of two images.
    TwoImages,
    /// From the differences of neighboring pixels of one image.
    Neighbors,
}

/// Result of a judge.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Judgment {
    /// Verdict.
    pub verdict: JudgeVerdict,
    /// Probability that a right image is called wrong.
    pub risk: f64,
    /// Mean luminance of the image over that of the estimate.
    pub mean: Option<MeanDifference>,
    /// Squared relative difference by scale.
    pub scales: Vec<ScaleDifference>,
    /// Score from which on the difference at a scale, or that of the means, is significant.
    pub threshold: f64,
    /// Score of a single tile from which on it differs, corrected for the number of tiles.
    pub tile_threshold: f64,
    /// Largest magnitude of the score of a tile.
    pub largest_tile_score: f64,
    /// Parts that differ, the most important first.
    pub regions: Vec<AuditedRegion>,
    /// Relative difference, in squares of `agreement_side` pixels, below which the true one lies
    /// with 95 % probability.
    pub agreement: f64,
    /// See `agreement`, pixels.
    pub agreement_side: u32,
    /// Where the noise of the image is known from.
    pub noise: NoiseSource,
    /// Share of the light of the estimate that only photons find.
    pub only_photons: f64,
    /// The image lacks that light, and agrees otherwise.
    pub lacks_it: bool,
    /// Path tracing would hardly find the light by which the image exceeds the estimate.
    pub is_hardly_found: bool,
    /// The image is right but for this factor.
    pub factor: Option<f64>,
    /// Shift of the image to the right and down that explains most of the difference, pixels.
    pub shift: Option<[f64; 2]>,
    /// Camera paths of the estimate.
    pub paths: f64,
    /// Time of the judge, seconds.
    pub seconds: f64,
    /// Relative difference that had to be excluded before the image is right.
    pub precision: f64,
    /// Scores of the tiles.
    pub map: TileMap,
}

/// One look at the images.
pub struct Findings {
    audited: Audited,
    lacks_it: bool,
    looks: u32,
    factor: Option<f64>,
    shift: Option<[f64; 2]>,
    noise: NoiseSource,
}

/// Whether a difference is significant in one of several looks. Half of the risk belongs to single
/// tiles.
fn is_different(difference: &Difference, looks: u32) -> bool {
    let threshold = difference.threshold(0.5 * RISK, looks);
    let tile = difference.tile_threshold(0.5 * RISK / f64::from(looks));
    difference.strongest().score() > threshold
        || difference.mean_score() > threshold
        || largest_score(difference) > tile
}

fn largest_score(difference: &Difference) -> f64 {
    difference.map.scores.iter().map(|score| f64::from(score.abs())).fold(0.0, f64::max)
}

impl Findings {
    /// Compares images of this size with an estimate. `None` if they are too small.
    pub fn new(
        sums: &AuditSums,
        (images, size): (&[Vec<f64>], (u32, u32)),
        brightest: f64,
        looks: u32,
    ) -> Option<Self> {
        let compare =
            |images: &[Vec<f64>], all: bool| sums.compare_images(images, size, (all, brightest));
        let mut audited = compare(images, true)?;
        let mut lacks_it = false;
        if is_different(&audited.difference, looks) && audited.not_audited > 0.0 {
            let without = compare(images, false)?;
            if !is_different(&without.difference, looks) {
                (audited, lacks_it) = (without, true);
            }
        }
        let (mut factor, mut shift) = (None, None);
        if is_different(&audited.difference, looks) {
            let ratio = audited.difference.mean.map_or(1.0, |mean| mean.ratio);
            let scaled = |image: &Vec<f64>| image.iter().map(|own| own / ratio).collect();
            let scaled: Vec<Vec<f64>> = images.iter().map(scaled).collect();
            let again = compare(&scaled, !lacks_it)?;
            factor = (!is_different(&again.difference, looks)).then_some(ratio);
            shift = shift_of(sums, images, size).filter(|_| factor.is_none());
        }
        let noise = if images.len() == 2 { NoiseSource::TwoImages } else { NoiseSource::Neighbors };
        Some(Self { audited, lacks_it, looks, factor, shift, noise })
    }

    /// Whether the image has more light where path tracing would hardly find it, and no other
    /// difference.
    fn is_hardly_found(&self) -> bool {
        let Audited { difference, expected_hits, .. } = &self.audited;
        is_different(difference, self.looks)
            && difference.excess() > 0.0
            && *expected_hits < MIN_HITS
    }

    /// Whether the image is wrong.
    pub fn is_wrong(&self) -> bool {
        is_different(&self.audited.difference, self.looks) && !self.is_hardly_found()
    }

    /// Whether differences of this size are excluded.
    pub fn is_right(&self, precision: f64) -> bool {
        let difference = &self.audited.difference;
        let mean = difference.mean.map_or(0.0, |mean| UPPER * mean.error);
        !is_different(difference, self.looks) && self.agreement() <= precision && mean <= precision
    }

    fn agreement(&self) -> f64 {
        let at_map = self.audited.difference.at_map();
        (at_map.square.max(0.0) + UPPER * at_map.error).sqrt()
    }

    /// The judgment after this time.
    pub fn judgment(
        self,
        (scene, accel, settings): (&Scene, &dyn Intersect, &Settings),
        precision: f64,
        time: Duration,
    ) -> Judgment {
        let verdict = if self.is_wrong() {
            JudgeVerdict::Wrong
        } else if self.is_right(precision) {
            JudgeVerdict::Right
        } else {
            JudgeVerdict::Undecided
        };
        let (agreement, is_hardly_found) = (self.agreement(), self.is_hardly_found());
        let Self { audited, lacks_it, looks, factor, shift, noise } = self;
        let Audited { difference, not_audited, paths, .. } = audited;
        let tile_risk = 0.5 * RISK / f64::from(looks);
        let mut regions = match verdict {
            JudgeVerdict::Wrong => difference.regions(tile_risk),
            _ => Vec::new(),
        };
        regions.truncate(MAX_REGIONS);
        Judgment {
            verdict,
            risk: RISK,
            mean: difference.mean,
            threshold: difference.threshold(0.5 * RISK, looks),
            tile_threshold: difference.tile_threshold(tile_risk),
            largest_tile_score: largest_score(&difference),
            regions: named_regions(regions, &difference.map, (scene, accel, settings)),
            agreement,
            agreement_side: difference.map.side,
            noise,
            only_photons: not_audited,
            lacks_it,
            is_hardly_found,
            factor,
            shift,
            paths,
            seconds: time.as_secs_f64(),
            precision,
            scales: difference.scales,
            map: difference.map,
        }
    }
}

/// The shift of the images by which their difference from the estimate is least, pixels to the
/// right and down; `None` unless it explains most of the difference. theory.md (98i)
fn shift_of(sums: &AuditSums, images: &[Vec<f64>], size: (u32, u32)) -> Option<[f64; 2]> {
    let (image, audit, variance) = sums.means(images, size)?;
    let Cells { width, height, side } = sums.cells;
    let (width, height) = (width as usize, height as usize);
    let floor = 0.01 * (image.iter().sum::<f64>() / image.len() as f64).powi(2);
    // Of the differences: their squares, and their products with the gradients.
    let (mut squares, mut noise, mut products, mut normal) = (0.0, 0.0, [0.0; 2], [0.0; 3]);
    for (x, y) in (1..height - 1).flat_map(|y| (1..width - 1).map(move |x| (x, y))) {
        let cell = y * width + x;
        let weight = (image[cell].powi(2) + floor).recip();
        let per_pixel = f64::from(2 * side);
        let [right, down] =
            [1, width].map(|step| (image[cell + step] - image[cell - step]) / per_pixel);
        let difference = image[cell] - audit[cell];
        squares += weight * difference * difference;
        noise += weight * variance[cell];
        products[0] += weight * difference * right;
        products[1] += weight * difference * down;
        normal[0] += weight * right * right;
        normal[1] += weight * right * down;
        normal[2] += weight * down * down;
    }
    let determinant = normal[0] * normal[2] - normal[1] * normal[1];
    if determinant <= 1e-12 * (normal[0] + normal[2]).powi(2) {
        return None;
    }
    // The image is the right one at a point that is shifted back: its difference is minus the shift
    // times the gradient.
    let along = [
        -(products[0] * normal[2] - products[1] * normal[1]) / determinant,
        -(products[1] * normal[0] - products[0] * normal[1]) / determinant,
    ];
    let explained = -(along[0] * products[0] + along[1] * products[1]);
    let is_large = along[0].hypot(along[1]) > LEAST_SHIFT;
    (is_large && explained > EXPLAINED * (squares - noise)).then_some(along)
}

impl Judgment {
    /// Time after which the noise of the estimate would exclude differences of this size, seconds.
    fn seconds_to(&self, precision: f64) -> f64 {
        self.seconds * (self.agreement / precision).powi(2).max(1.0)
    }

    /// The judgment in a few lines.
    pub fn describe(&self) -> String {
        let percent = |share: f64| format!("{:.2} %", 100.0 * share);
        let mut text = match self.verdict {
            JudgeVerdict::Right => format!(
                "right within {} in squares of {} pixels, by path tracing",
                percent(self.agreement),
                self.agreement_side
            ),
            JudgeVerdict::Wrong => format!(
                "wrong: it differs from path tracing; a right image is called wrong with a \
                 probability of at most {:.0} %",
                100.0 * self.risk
            ),
            JudgeVerdict::Undecided if self.is_hardly_found => {
                "undecided: the image has light that path tracing would hardly find".into()
            }
            JudgeVerdict::Undecided => format!(
                "undecided: no difference was found, but one of less than {} in squares of {} pixels \
                 would not have been; allow about {} s, or judge images with less noise",
                percent(self.agreement),
                self.agreement_side,
                self.seconds_to(self.precision).ceil()
            ),
        };
        text += "\n";
        let mut row = |name: &str, value: String| {
            writeln!(text, "{name:<19} {value}").expect("strings take everything");
        };
        if let Some(MeanDifference { ratio, error }) = self.mean {
            row("mean ratio", format!("{ratio:.5} +- {error:.5}"));
        }
        for scale in &self.scales {
            let name = format!("squares of {} pixels", scale.side);
            row(&name, format!("squared difference {:.2e} +- {:.1e}", scale.square, scale.error));
        }
        row(
            "worst square",
            format!(
                "{:.1} standard errors of {} pixels; {:.1} are significant among {}",
                self.largest_tile_score,
                self.map.side,
                self.tile_threshold,
                self.map.scores.len()
            ),
        );
        self.causes().iter().for_each(|(name, value)| row(name, value.clone()));
        for region in &self.regions {
            row("differs", region.describe());
        }
        let noise = match self.noise {
            NoiseSource::TwoImages => "from the difference of both images",
            NoiseSource::Neighbors => "estimated from neighboring pixels of the one image",
        };
        row("noise of the image", noise.into());
        row("estimate", format!("{:.0} camera paths in {:.1} s", self.paths, self.seconds));
        text
    }

    /// Explanations of the difference, and light that is not judged.
    fn causes(&self) -> Vec<(&'static str, String)> {
        let mut all = Vec::new();
        if let Some(factor) = self.factor {
            all.push(("cause", format!("the whole image is {factor:.5} times too bright")));
        }
        if let Some([right, down]) = self.shift {
            let text = format!("shifted by {right:.2} pixels to the right and {down:.2} down");
            all.push(("cause", text));
        }
        let only_photons = 100.0 * self.only_photons;
        if self.lacks_it {
            let text = format!("the image lacks {only_photons:.1} % that no path tracer finds");
            all.push(("point lights", text));
        } else if self.only_photons > 0.0005 {
            let text =
                format!("{only_photons:.1} % of the light through glass, judged less exactly");
            all.push(("point lights", text));
        }
        all
    }
}
