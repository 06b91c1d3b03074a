//! The result of an audit: theory.md, section 22b.

use bdpm_auto::adaptive::error_interval::SquaredPart;
use bdpm_core::accel::Intersect;
use bdpm_core::noise::difference::{DifferentRegion, MeanDifference, ScaleDifference, TileMap};
use bdpm_core::render::audit::Audited;
use bdpm_core::scene::Scene;
use bdpm_core::settings::Settings;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// Probability that the image of a right technique is called different at any look.
pub const RISK: f64 = 0.01;

/// Number of hits that must be expected before light counts as missed by nothing but a fault.
pub(crate) const MIN_HITS: f64 = 10.0;

/// Standard deviations of the normal distribution below which 95 % of the values lie.
const UPPER: f64 = 1.645;

/// Maximum number of regions that are reported.
const MAX_REGIONS: usize = 3;

/// Points across and down in each tile at which surfaces are named.
const POINTS: u32 = 3;

/// Result of the comparison of an image with its audit.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Verdict {
    /// No difference beyond the bias that the image knows.
    Agrees,
    /// The technique of the image is wrong somewhere.
    Differs,
    /// The image has light that path tracing would hardly find, or may lack light that neither has
    /// seen.
    Unclear,
}

/// A part of the image that differs from the audit.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct AuditedRegion {
    /// Place and size of the difference.
    #[serde(flatten)]
    pub region: DifferentRegion,
    /// Objects that are seen there, that with the largest relative difference first.
    pub objects: Vec<String>,
    /// Their materials.
    pub materials: Vec<String>,
}

/// Comparison of an image with its audit.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct AuditReport {
    /// Result.
    pub verdict: Verdict,
    /// Squared relative difference beyond noise, at the scale where it stands out most; negative
    /// values are noise.
    pub square: f64,
    /// Standard error of `square`.
    pub square_error: f64,
    /// Side of the squares of pixels at that scale.
    pub side: u32,
    /// Relative difference, in squares of `agreement_side` pixels, below which the true one lies
    /// with 95 % probability.
    pub agreement: f64,
    /// See `agreement`, pixels.
    pub agreement_side: u32,
    /// Share of the light of the image that is not audited, since only photons find it.
    pub not_audited: f64,
    /// Number of paths that should have found the light by which the image exceeds the audit.
    pub expected_hits: f64,
    /// Camera paths of the audit.
    pub paths: f64,
    /// Light that neither the image nor the audit can have seen, in words, if there may be any.
    pub unseen: Option<String>,
    /// Share of the rendering time that the audit took.
    pub share_of_time: f64,
    /// Mean luminance of the image over that of the audit.
    pub mean: Option<MeanDifference>,
    /// Squared relative difference by scale.
    pub scales: Vec<ScaleDifference>,
    /// Parts that differ, the most important first.
    pub regions: Vec<AuditedRegion>,
    /// Differences of the tiles.
    #[serde(skip, default = "no_tiles")]
    pub map: TileMap,
}

/// Agreement above which an audit is too noisy to be called one.
const NOISY: f64 = 0.25;

fn no_tiles() -> TileMap {
    let (scores, differences, luminances) = Default::default();
    TileMap { side: 1, width: 0, height: 0, scores, differences, luminances }
}

impl AuditReport {
    /// A report on an image whose squared bias is known to be `bias`, as one of several `looks` at
    /// it.
    pub(super) fn new(
        audited: &Audited,
        bias: SquaredPart,
        looks: u32,
        share_of_time: f64,
        ((scene, accel), settings): ((&Scene, &dyn Intersect), &Settings),
    ) -> Self {
        let Audited { difference, not_audited, expected_hits, paths } = audited;
        let threshold = difference.threshold(RISK, looks);
        let strongest = *difference.strongest();
        // The bias that the image itself reports is no fault.
        let beyond = strongest.score() - bias.value / strongest.error;
        let mean_beyond = difference
            .mean
            .map_or(0.0, |mean| ((mean.ratio - 1.0).abs() - bias.value.sqrt()) / mean.error);
        let is_different = beyond > threshold || mean_beyond > threshold;
        let regions = if is_different { difference.regions(RISK) } else { Vec::new() };
        let is_bright = difference.excess() > 0.0
            && regions.first().map_or(difference.is_brighter(threshold), |own| own.ratio > 1.0);
        let verdict = match is_different {
            false => Verdict::Agrees,
            true if is_bright && *expected_hits < MIN_HITS => Verdict::Unclear,
            true => Verdict::Differs,
        };
        let mut regions = regions;
        regions.truncate(MAX_REGIONS);
        let at_map = difference.at_map();
        // A difference of the means is one at all scales.
        let of_mean = difference.mean.filter(|_| beyond <= threshold && is_different);
        let square = of_mean
            .map_or(strongest.square - strongest.tolerated, |mean| (mean.ratio - 1.0).powi(2));
        let square_error =
            of_mean.map_or(strongest.error, |mean| 2.0 * (mean.ratio - 1.0).abs() * mean.error);
        Self {
            verdict,
            square,
            square_error,
            side: strongest.side,
            agreement: (at_map.square.max(0.0) + UPPER * at_map.error).sqrt(),
            agreement_side: at_map.side,
            not_audited: *not_audited,
            expected_hits: *expected_hits,
            paths: *paths,
            unseen: None,
            share_of_time,
            mean: difference.mean,
            scales: difference.scales.clone(),
            regions: named_regions(regions, &difference.map, (scene, accel, settings)),
            map: difference.map.clone(),
        }
    }

    /// The report if there may be light that neither the image nor the audit has seen: agreement
    /// then says nothing.
    #[must_use]
    pub(super) fn with_unseen(self, unseen: Option<String>) -> Self {
        let verdict = match self.verdict {
            Verdict::Agrees if unseen.is_some() => Verdict::Unclear,
            own => own,
        };
        Self { verdict, unseen, ..self }
    }

    /// The squared error that the difference stands for; `None` if the image does not differ.
    pub fn error(&self) -> Option<SquaredPart> {
        let differs = self.verdict == Verdict::Differs;
        let (value, deviation) = (self.square.max(0.0), self.square_error);
        differs.then_some(SquaredPart { value, deviation })
    }

    /// The result in a sentence.
    pub fn describe(&self) -> String {
        let percent = |share: f64| format!("{:.1} %", 100.0 * share);
        let rest = match self.not_audited > 0.0005 {
            true => format!(
                "; {} is light that only photons find and was not audited",
                percent(self.not_audited)
            ),
            false => String::new(),
        };
        let paths = format!("audit of {:.0} camera paths", self.paths);
        let size = format!("squares of {} pixels", self.agreement_side);
        match self.verdict {
            Verdict::Agrees if self.agreement > NOISY => format!(
                "{paths}: no difference from path tracing was seen, whose noise hides differences of \
                 up to {} in {size}{rest}",
                percent(self.agreement)
            ),
            Verdict::Agrees => format!(
                "{paths}: {} of the image agrees with path tracing within {} in {size}{rest}",
                percent(1.0 - self.not_audited),
                percent(self.agreement)
            ),
            Verdict::Unclear if let Some(unseen) = &self.unseen => format!(
                "not audited: neither photons nor path tracing have seen any {unseen}{rest}"
            ),
            Verdict::Unclear => format!(
                "{paths}: the image has light that path tracing hardly finds, so that {:.1} hits of it \
                 would be expected; it was not audited{rest}",
                self.expected_hits
            ),
            Verdict::Differs => format!(
                "{paths}: the image differs from path tracing by {} in squares of {} pixels, {:.1} \
                 standard errors{rest}",
                percent(self.square.max(0.0).sqrt()),
                self.side,
                self.square / self.square_error
            ),
        }
    }

    /// The difference and its place; `None` if the image does not differ.
    pub fn finding(&self) -> Option<String> {
        if self.verdict != Verdict::Differs {
            return None;
        }
        let places: Vec<String> = self.regions.iter().map(AuditedRegion::describe).collect();
        let places = match places.is_empty() {
            true => self.mean.map_or(String::new(), |mean| {
                format!("; its mean luminance is {:.3} times that of path tracing", mean.ratio)
            }),
            false => format!("; it is {}", places.join(", ")),
        };
        Some(format!("{}{places}", self.describe()))
    }

    /// A warning that names the place of the difference; `None` if the image does not differ.
    pub fn warning(&self) -> Option<String> {
        self.finding().map(|finding| {
            format!(
                "{finding}\nhelp: photons leak or are lost there; use `--strategy path`, `--kernel area` \
                 or a smaller --radius"
            )
        })
    }
}

impl AuditedRegion {
    /// Place, size of the difference, and names of what is seen there.
    pub fn describe(&self) -> String {
        let [left, top, right, bottom] = self.region.pixels;
        let name = |kind: &str, names: &[String]| match names {
            [] => String::new(),
            names => format!(", {kind} `{}`", names.join("`, `")),
        };
        format!(
            "{:.2} times as bright in columns {left} to {}, rows {top} to {}{}{}",
            self.region.ratio,
            right - 1,
            bottom - 1,
            name("object", &self.objects),
            name("material", &self.materials)
        )
    }
}

/// Names what is seen in regions of a map.
pub(crate) fn named_regions(
    regions: Vec<DifferentRegion>,
    map: &TileMap,
    (scene, accel, settings): (&Scene, &dyn Intersect, &Settings),
) -> Vec<AuditedRegion> {
    regions.into_iter().map(|region| named(region, map, scene, accel, settings)).collect()
}

/// Names what is seen in a region: the objects and materials of at least a fifth of its difference,
/// those with the largest relative difference first. A surface that is too bright also brightens
/// what it lights, but by less of its luminance.
fn named(
    region: DifferentRegion,
    map: &TileMap,
    scene: &Scene,
    accel: &dyn Intersect,
    settings: &Settings,
) -> AuditedRegion {
    let view = scene.camera.view_of(settings);
    let (mut objects, mut materials) = (BTreeMap::new(), BTreeMap::new());
    let mut all = 0.0;
    for tile in &region.tiles {
        let (column, row) = (*tile as u32 % map.width, *tile as u32 / map.width);
        let size = f64::from(map.differences[*tile].abs());
        let luminance = f64::from(map.luminances[*tile]);
        for point in 0..POINTS * POINTS {
            let at = |tile: u32, part: u32| {
                map.side as f32 * (tile as f32 + (part as f32 + 0.5) / POINTS as f32)
            };
            let (x, y) = (at(column, point % POINTS), at(row, point / POINTS));
            let (ray, _) = scene.camera_ray(&view, x, y, [0.5; 2]);
            let hit = scene.first_visible(accel, &ray, accel.closest_hit(&ray));
            if hit.is_miss() {
                continue;
            }
            let placement = &scene.placements()[hit.mesh as usize];
            let material = &scene.materials()[placement.material as usize];
            for (names, name) in
                [(&mut objects, &scene.mesh(placement).name), (&mut materials, &material.name)]
            {
                let sums: &mut [f64; 2] = names.entry(name.clone()).or_default();
                *sums = [sums[0] + size, sums[1] + luminance];
            }
            all += size;
        }
    }
    let most = |sums: BTreeMap<String, [f64; 2]>| {
        let mut sums: Vec<_> = sums.into_iter().filter(|(_, own)| own[0] > 0.2 * all).collect();
        let share = |[size, luminance]: [f64; 2]| size / luminance.max(1e-30);
        sums.sort_by(|one, other| share(other.1).total_cmp(&share(one.1)));
        sums.into_iter().map(|(name, _)| name).filter(|name| !name.is_empty()).collect()
    };
    AuditedRegion { region, objects: most(objects), materials: most(materials) }
}
