//! Every combination of options that a render refuses, and every one in which an option does less
//! than alone: one table.
//!
//! Whoever renders checks it by [`check`], the program prints the rows that apply by [`notes`], and
//! the reference has a page made from it. No other code refuses a combination of options.

use super::{Bias, Direct, PartialSettings, Settings, Strategy};
use bdpm_base::error::{Error, Result};
use std::fmt;

/// What a render is asked for, as far as combinations of options matter.
#[derive(Clone, Debug)]
pub struct Request<'a> {
    /// The settings of the image, before any of them is chosen.
    pub settings: &'a Settings,
    /// The settings that the user gave.
    pub given: PartialSettings,
    /// Options beside the settings.
    pub job: JobOptions,
    /// The scene.
    pub scene: SceneFacts,
}

/// Options of a render beside its settings. The default is a render without any.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct JobOptions {
    /// Path counts are chosen during the render, and what is open before it.
    pub is_automatic: bool,
    /// A plan is rendered, or an image is continued.
    pub is_continued: bool,
    /// One of several parts of an image is rendered.
    pub is_part: bool,
    /// Nothing would keep the part.
    pub loses_part: bool,
    /// The number of iterations is known.
    pub has_iterations: bool,
    /// The number of iterations was given, not taken from a plan.
    pub gives_iterations: bool,
    /// Times of iterations are known.
    pub has_times: bool,
    /// The noise of single pixels is kept.
    pub has_pixel_noise: bool,
    /// Several processes render together.
    pub has_ranks: bool,
    /// Groups of light sources are rendered in turn.
    pub has_light_groups: bool,
}

/// What decides in a scene about options. The default is a scene in which all of them work.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SceneFacts {
    /// No medium scatters light that photons of caustics alone would lack.
    pub allows_caustics_alone: bool,
    /// Media scatter light.
    pub any_medium_scatters: bool,
    /// A material disperses light.
    pub any_disperses: bool,
    /// Pixels are meters.
    pub has_meters: bool,
}

impl Default for SceneFacts {
    fn default() -> Self {
        Self {
            allows_caustics_alone: true,
            any_medium_scatters: true,
            any_disperses: true,
            has_meters: false,
        }
    }
}

impl<'a> Request<'a> {
    /// A render of these settings, given as a whole, in any scene.
    pub fn of(settings: &'a Settings) -> Self {
        let given = PartialSettings::from(settings);
        Self { settings, given, job: JobOptions::default(), scene: SceneFacts::default() }
    }
}

/// Makes the error of a combination.
type Refusal = fn(&Request) -> Error;

/// What becomes of a combination.
#[derive(Clone, Copy)]
pub enum Outcome {
    /// The render is refused with an error.
    Refused(Refusal),
    /// The command line is refused as a wrong usage: the first option conflicts with those of these
    /// settings or fields.
    Usage(&'static [&'static str]),
    /// The first option does less than alone.
    Weakened,
}

/// A combination of options and what becomes of it.
pub struct Combination {
    /// Both sides, as the command line spells them; alternatives are separated by `|`.
    pub options: [&'static str; 2],
    /// What becomes of it.
    pub outcome: Outcome,
    /// A sentence: what happens, and why.
    pub why: &'static str,
    applies: fn(&Request) -> bool,
}

const fn refused(
    options: [&'static str; 2],
    why: &'static str,
    applies: fn(&Request) -> bool,
    error: Refusal,
) -> Combination {
    Combination { options, outcome: Outcome::Refused(error), why, applies }
}

const fn usage(
    options: [&'static str; 2],
    others: &'static [&'static str],
    why: &'static str,
) -> Combination {
    Combination { options, outcome: Outcome::Usage(others), why, applies: |_| false }
}

const fn weakened(
    options: [&'static str; 2],
    why: &'static str,
    applies: fn(&Request) -> bool,
) -> Combination {
    Combination { options, outcome: Outcome::Weakened, why, applies }
}

/// All combinations. The first that is refused makes the error.
pub const COMBINATIONS: &[Combination] = &[
    refused(
        ["--strategy mis|cut-mis", "--merge-vertex"],
        "The weights are those of merges at vertices 1 and 2: only the merge vertex 2 is accepted.",
        |asked| asked.settings.strategy.merges_twice() && asked.settings.merge_vertex != 2,
        |asked| {
            let problem = format!(
                "strategies `mis` and `cut-mis` merge at vertices 1 and 2, but the merge vertex is {}",
                asked.settings.merge_vertex
            );
            Error::new(problem, "use the merge vertex 2")
        },
    ),
    refused(
        ["--light-paths", "--sobol-set"],
        "The light paths of an iteration are whole sets: their number is a multiple of the size of the sets.",
        |asked| check_whole_sets(asked.settings.light_paths, asked.settings.sobol_set).is_err(),
        |asked| uneven_sets(asked.settings.light_paths, asked.settings.sobol_set),
    ),
    refused(
        ["--strategy path-caustics|gather-caustics", "a medium that scatters"],
        "Light that media scatter is that of photons, and these strategies have those of caustics alone.",
        |asked| asked.settings.strategy.has_only_caustics() && !asked.scene.allows_caustics_alone,
        |asked| {
            let problem = format!("{} in a medium that scatters", asked.weighted_name());
            Error::new(problem, "use the strategy `mis`, `single` or `path`")
        },
    ),
    refused(
        ["--strategy gather|gather-caustics", "meters"],
        "What the cache adds is known for parts of an image, not for a single meter.",
        |asked| asked.settings.has_cache() && asked.scene.has_meters,
        |_| {
            let problem = "a cache of light at meters";
            Error::new(problem, "use the strategy `path`, or leave it open")
        },
    ),
    refused(
        ["--part", "path counts that are chosen"],
        "Each part would choose others, and blocks of different counts cannot be merged.",
        |asked| asked.job.is_part && asked.job.is_automatic,
        |_| {
            Error::new(
                "parts of an image cannot choose their path counts, which must be equal",
                "fix the number of iterations, or use the plan of an image that chose its path counts",
            )
        },
    ),
    refused(
        ["--part", "an open number of iterations"],
        "A part is a share of the iterations.",
        |asked| asked.job.is_part && !asked.job.has_iterations,
        |_| {
            let advice =
                "give the number of iterations of all parts together, or the plan of an image";
            Error::new("parts of an image need a fixed number of iterations", advice)
        },
    ),
    refused(
        ["--part", "no --checkpoint"],
        "`bdpm merge` reads the checkpoints of the parts.",
        |asked| asked.job.loses_part,
        |_| {
            Error::new(
                "a part needs a checkpoint, which `bdpm merge` reads",
                "give a file by --checkpoint, such as --checkpoint part.ckpt",
            )
        },
    ),
    refused(
        ["--light-groups", "several processes"],
        "Groups are rendered in turn by one process: the others know a single image.",
        |asked| asked.job.has_light_groups && asked.job.has_ranks,
        |_| {
            let problem = "several processes cannot render groups of light sources in turn";
            Error::new(problem, "render them by --lights, and mix the images")
        },
    ),
    refused(
        ["--noise", "--light-paths 1"],
        "Coefficients are estimated from pairs of light paths.",
        |asked| asked.measures_pixels() && asked.settings.light_paths < 2,
        |asked| too_few(asked.settings.light_paths, ["light path", "light paths"]),
    ),
    refused(
        ["--noise", "--camera-paths 1"],
        "Coefficients are estimated from pairs of camera paths.",
        |asked| asked.measures_pixels() && asked.settings.camera_paths < 2,
        |asked| {
            too_few(
                asked.settings.camera_paths,
                ["camera path per pixel", "camera paths per pixel"],
            )
        },
    ),
    usage(
        ["--plan", "--light-paths|--camera-paths"],
        &["light_paths", "camera_paths"],
        "A plan has path counts.",
    ),
    usage(["--plan", "--resume"], &["resume"], "The checkpoint of an image has its plan."),
    usage(
        ["--plan", "--timings"],
        &["timings"],
        "Nothing is chosen by times where a plan has the path counts.",
    ),
    usage(
        ["--part", "--target-error|--target-rms"],
        &["target_error", "target_rms"],
        "No part knows the error of the image.",
    ),
    usage(["--part", "--timings"], &["timings"], "A part chooses nothing."),
    usage(
        [
            "--light-groups",
            "--plan|--resume|--checkpoint|--part|--noise|--report|--view|--timings|--dry-run",
        ],
        &["plan", "resume", "checkpoint", "part", "noise", "report", "view", "timings", "dry_run"],
        "Each group is an image of its own: render it by --lights.",
    ),
    weakened(
        ["--noise", "path counts that are chosen"],
        "Counts are equal in all pixels: coefficients of single pixels belong to one pair of counts.",
        |asked| asked.job.has_pixel_noise && asked.job.is_automatic,
    ),
    weakened(
        ["--timings", "settings that are chosen"],
        "Only path counts are chosen: known times hold for the settings that they were measured with.",
        |asked| asked.job.has_times && asked.job.is_automatic,
    ),
    weakened(
        ["several processes", "settings that are chosen"],
        "The image never starts again with better settings: the other processes know only those of the start.",
        |asked| asked.job.has_ranks && asked.job.is_automatic,
    ),
    weakened(
        ["--iterations", "settings that are chosen"],
        "Nothing is chosen: an image of a known number of iterations has the settings given, or the defaults.",
        |asked| asked.job.gives_iterations && !asked.job.is_continued,
    ),
    weakened(
        ["--light-paths|--camera-paths", "settings that are chosen"],
        "Nothing is chosen, other path counts neither: they would not fit the one that was given.",
        |asked| {
            let PartialSettings { light_paths, camera_paths, .. } = asked.given;
            (light_paths.is_some() || camera_paths.is_some()) && !asked.job.is_continued
        },
    ),
    weakened(
        ["--radius", "--caustic-radius"],
        "The bias is kept: with both radii given, the image is the mean of the paper's estimator.",
        |asked| {
            let PartialSettings { radius, caustic_radius, bias, .. } = asked.given;
            let both = radius.is_some() && caustic_radius.is_some();
            both && bias.is_none() && asked.job.is_automatic
        },
    ),
    weakened(
        ["--merge-vertex", "a strategy that is chosen"],
        "The strategy is not chosen: only `single` merges at any vertex.",
        |asked| {
            asked.given.merge_vertex.is_some()
                && asked.given.strategy.is_none()
                && asked.job.is_automatic
        },
    ),
    weakened(
        ["--direct photon-map", "--strategy path|path-caustics|gather|gather-caustics"],
        "Direct light is connected: no photon comes straight from a light source.",
        |asked| asked.connects_anyway() && asked.settings.direct == Direct::PhotonMap,
    ),
    weakened(["--bias reduce", "--strategy path"], "There is no merge bias to reduce.", |asked| {
        asked.shares_nothing() && asked.settings.bias == Bias::Reduce
    }),
    weakened(
        [
            "--radius|--caustic-radius|--kernel|--merge-vertex|--guide|--sobol-set|--splitting|--light-paths",
            "--strategy path",
        ],
        "It has no effect: there are neither light paths nor merges.",
        |asked| asked.shares_nothing() && asked.gives_photons(),
    ),
    weakened(
        ["--radius|--merge-vertex", "--strategy path-caustics"],
        "It has no effect: photons are those of caustics, which are merged at all vertices.",
        |asked| {
            let PartialSettings { radius, merge_vertex, strategy, .. } = &asked.given;
            let gives = radius.is_some() || merge_vertex.is_some();
            *strategy == Some(Strategy::PathCaustics) && gives
        },
    ),
    weakened(
        ["--splitting", "--strategy path-caustics|gather-caustics"],
        "It has no effect: light paths end at their first diffuse vertex.",
        |asked| {
            let has_caustics = matches!(
                asked.settings.strategy,
                Strategy::PathCaustics | Strategy::GatherCaustics
            );
            has_caustics && asked.given.splitting.is_some()
        },
    ),
    weakened(
        ["--caustic-radius|--kernel|--guide|--sobol-set|--splitting", "--strategy gather"],
        "It has no effect: there are neither photons nor merges.",
        |asked| asked.given.strategy == Some(Strategy::Gather) && asked.gives_merges(),
    ),
    weakened(
        ["--medium-scale|--medium-share|--medium-query", "a scene without media that scatter"],
        "It has no effect: no photon is stored in a medium.",
        |asked| {
            let PartialSettings { medium_scale, medium_share, medium_query, .. } = asked.given;
            let is_given = medium_scale.or(medium_share).is_some() || medium_query.is_some();
            is_given && !asked.scene.any_medium_scatters
        },
    ),
    weakened(
        ["--wavelength-width", "a scene without dispersion"],
        "It has no effect: no path has a wavelength.",
        |asked| asked.given.wavelength_width.is_some() && !asked.scene.any_disperses,
    ),
];

impl fmt::Display for Combination {
    /// `--noise with path counts that are chosen: Counts are ...`.
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        let [first, second] = self.options;
        write!(f, "{first} with {second}: {}", self.why)
    }
}

impl Request<'_> {
    /// The strategy in words, as errors name it.
    fn weighted_name(&self) -> String {
        format!("the strategy `{}`", self.settings.strategy.name())
    }

    /// Tests whether every iteration measures single pixels at the given counts.
    fn measures_pixels(&self) -> bool {
        self.job.has_pixel_noise && !self.job.is_automatic
    }

    /// Tests whether the user wants a strategy that connects direct light in any case.
    fn connects_anyway(&self) -> bool {
        let merges = |own: Strategy| own.has_photons() && !own.has_only_caustics();
        self.given.strategy.is_some_and(|strategy| !merges(strategy))
    }

    /// Tests whether the user wants pixels to share no light.
    fn shares_nothing(&self) -> bool {
        self.given.strategy.is_some_and(|strategy| !strategy.shares_light())
    }

    /// Tests whether the user gave a setting of light paths or merges.
    fn gives_photons(&self) -> bool {
        let PartialSettings { radius, merge_vertex, light_paths, .. } = &self.given;
        let shared = radius.is_some() || merge_vertex.is_some() || light_paths.is_some();
        shared || self.gives_merges()
    }

    /// Tests whether the user gave a setting of photons alone.
    fn gives_merges(&self) -> bool {
        let PartialSettings { caustic_radius, kernel, guide, .. } = &self.given;
        let PartialSettings { sobol_set, splitting, .. } = &self.given;
        let numbers = [guide, sobol_set, splitting];
        let merges = caustic_radius.is_some() || kernel.is_some();
        merges || numbers.iter().any(|number| number.is_some())
    }
}

fn too_few(count: u32, [singular, plural]: [&str; 2]) -> Error {
    Error::new(
        format!("cannot measure the noise with {count} {singular}"),
        format!("use at least 2 {plural}; the result predicts the noise at 1 as well"),
    )
}

fn uneven_sets(light_paths: u32, size: u32) -> Error {
    let below = light_paths / size * size;
    let near = if below == 0 { size.to_string() } else { format!("{below} or {}", below + size) };
    Error::new(
        format!("{light_paths} light paths in sets of {size}"),
        format!("give {near} light paths, or another size of sets (`sobol_set`)"),
    )
}

/// Refuses a number of light paths that is no multiple of the size of their sets.
pub(crate) fn check_whole_sets(light_paths: u32, size: u32) -> Result<()> {
    if light_paths.is_multiple_of(size) { Ok(()) } else { Err(uneven_sets(light_paths, size)) }
}

/// Refuses combinations of options.
///
/// # Errors
/// That of the first row that applies.
pub fn check(asked: &Request) -> Result<()> {
    let mut refusals = COMBINATIONS.iter().filter_map(|row| match row.outcome {
        Outcome::Refused(error) if (row.applies)(asked) => Some(error(asked)),
        _ => None,
    });
    refusals.next().map_or(Ok(()), Err)
}

/// The rows in which an option does less than alone.
pub fn notes<'a>(asked: &'a Request) -> impl Iterator<Item = &'static Combination> + 'a {
    let weakened = |row: &&Combination| matches!(row.outcome, Outcome::Weakened);
    COMBINATIONS.iter().filter(weakened).filter(|row| (row.applies)(asked))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::settings::Length;

    fn settings(change: fn(&mut PartialSettings)) -> (Settings, PartialSettings) {
        let mut given = PartialSettings::default();
        change(&mut given);
        // Not `Settings::resolve`, which checks.
        let plain = PartialSettings::default();
        let mut settings = Settings::resolve(&plain, &plain, 1.0).unwrap();
        settings.strategy = given.strategy.unwrap_or(settings.strategy);
        settings.merge_vertex = given.merge_vertex.unwrap_or(settings.merge_vertex);
        settings.direct = given.direct.unwrap_or(settings.direct);
        (settings, given)
    }

    #[test]
    fn rows_apply_to_what_they_name_alone() {
        let (settings, given) = settings(|given| {
            given.strategy = Some(Strategy::Mis);
            given.merge_vertex = Some(1);
        });
        let asked = Request { given, ..Request::of(&settings) };
        let error = check(&asked).unwrap_err().to_string();
        assert!(error.contains("the merge vertex is 1"), "{error}");
        assert_eq!(notes(&asked).count(), 0);
    }

    #[test]
    fn path_tracing_names_what_it_ignores() {
        let (settings, given) = settings(|given| {
            given.strategy = Some(Strategy::Path);
            given.direct = Some(Direct::PhotonMap);
            given.radius = Some(Length::Units(0.1));
        });
        let asked = Request { given, ..Request::of(&settings) };
        check(&asked).unwrap();
        let found: Vec<_> = notes(&asked).map(|row| row.options[0]).collect();
        assert!(found.len() == 2 && found[0] == "--direct photon-map", "{found:?}");
    }
}
