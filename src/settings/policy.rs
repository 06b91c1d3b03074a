//! IterationSet that decide: when to measure, when to choose counts again, and when enough is known.
//!
//! None changes what is estimated, only how soon and how well. Each tells where it comes from: "by
//! trial" means the middle of a range within which `examples/optimum_table.rs` shows no difference beyond
//! its noise.

// --- When to measure -----------------------------------------------------------------------------

/// Of the first iterations of an automatic render, one in so many: times come from the others.
pub const MEASURE_FIRST_EVERY: u64 = 2;

// --- The pilot of techniques ---------------------------------------------------------------------

/// Share of the time that trying techniques takes where the time is given.
pub const TECHNIQUE_SHARE: f64 = 0.08;

/// Seconds that it takes at the least, where that is no more than [`MOST_TECHNIQUE_SHARE`]: less tells too little.
pub const LEAST_TECHNIQUE_TIME: f64 = 0.6;

/// See [`LEAST_TECHNIQUE_TIME`].
pub const MOST_TECHNIQUE_SHARE: f64 = 0.12;

/// Part of that where nothing is open but counts.
pub const CLOSED_SHARE: f64 = 0.5;

/// The most seconds that it takes.
pub const TECHNIQUE_LONGEST: f64 = 8.0;

/// Seconds that it takes at first where no time is given.
pub const TECHNIQUE_TIME: f64 = 0.5;

/// A pilot that may take so many times as long as the first is worth it.
pub const LONGER_PILOT: f64 = 2.0;

/// Shares of the rounds of trials in that: all techniques, the better ones at large radii, the best.
pub const ROUNDS: [f64; 3] = [0.25, 0.5, 0.25];

/// A technique is given up if its squared error, at the best radii by one trial, is so many times the least.
pub const HOPELESS: f64 = 4.0;

/// By how many times its squared error is taken to be more than what is told of a technique that there is no time to
/// try where that tells it, over what trials of others came to more than was expected: of several the best was told too
/// good.
pub const UNTRIED: f64 = 2.0;

/// Techniques that are tried at large radii at the least, whatever the time.
pub const LEAST_WIDENED: u32 = 2;

/// The same of techniques that see lamps in rough surfaces by chance: trials miss most of what they find rarely. Where
/// one was chosen for 11 % relative error, 77 % came (docs/peers.md, `veach-mis`).
pub const SEEN_BY_CHANCE: f64 = 4.0;

/// Pixels that must have found something before a photon map is trusted with direct light: a thin one looks quiet.
pub const ENOUGH_FOUND: f64 = 64.0;

/// Techniques that are tried once more, at their best radii, until the best of all has been; typically.
pub const FINALISTS: f64 = 2.0;

/// The largest radius of trials over that of the settings: the bias shows at a large one, and falls with it as it
/// is known to; between the others noise follows its own law.
pub const LARGE: f32 = 4.0;
/// See [`LARGE`].
pub const SMALL: f32 = 0.5;

/// What equal radii are made to differ by where one class of photons is tried by itself: far less than any bias.
pub const TOLD_APART: f32 = 0.999;

/// Radii that are chosen from: the largest over so many powers of the root of 2.
pub const RADIUS_STEPS: std::ops::Range<i32> = 0..9;

/// Part of all noise that either class of photons has at the least, so that no radius is free.
pub const LEAST_PART: f64 = 0.05;

/// Camera paths per pixel that techniques are compared at.
pub const CAMERA_STEPS: [u32; 15] = [1, 2, 3, 4, 6, 8, 12, 16, 24, 32, 48, 64, 96, 128, 192];

/// Measured iterations of a trial: two in each batch, as standard errors take.
pub const TRIAL_ITERATIONS: u64 = 32;

/// Light paths, and camera paths in all pixels, of an iteration of a trial.
pub const TRIAL_PATHS: std::ops::Range<f64> = 1024.0..16_384.0;

/// Camera paths per pixel of an iteration of a trial: the fewest that are measured, for the most pixels.
pub const TRIAL_CAMERA_PATHS: u32 = 2;

/// A trial that has not come to [`TRIAL_ITERATIONS`] ends after so many times its time.
pub const TRIAL_PATIENCE: f64 = 1.3;

/// Light paths of the timed iterations of a trial: as many as of the others, and so many times as many, at the least
/// and at the most, so that what is paid per path and per merge stands out from what is paid anyway.
pub const TIMED_RATIOS: [u32; 2] = [4, 16];

/// Their camera paths per pixel, for the same reason.
pub const TIMED_CAMERA_PATHS: u32 = 6;

/// Timed iterations of either kind at the least, where they fit in the time.
pub const TRIAL_TIMED: u64 = 2;

/// Share of a trial's time that is measured.
pub const TRIAL_MEASURING: f64 = 0.75;

/// What trials add to the seed.
pub const TRIAL_SEED: u64 = 0x5eed_0ff0_7e57_ab1e;

/// What the bias falls to from a radius to `1/sqrt(2)` of it where that is not seen: the squared bias as the cube
/// of the radius, as along an edge with the kernel by true area.
pub const TYPICAL_FALL: f64 = 0.5946;

/// The same of light that draws sharp edges, caustics and shadows: as the square.
pub const TYPICAL_SHARP_FALL: f64 = std::f64::consts::FRAC_1_SQRT_2;

/// Squared relative bias over the cube of the radius, in widths of what the image shows: what Cornell boxes have,
/// by trial.
pub const TYPICAL_BIAS: f64 = 20.0;

/// Squared relative bias of caustics over the square of the radius, and of direct light, likewise: by trial.
pub const TYPICAL_SHARP_BIAS: [f64; 2] = [5.0, 15.0];

/// By how many times itself the bias of a scene may differ from that, before anything is measured. Errors of what is
/// measured come out too small where light is rare, so that this must not be large.
pub const PRIOR_SPREAD: f64 = 1.0;

/// Part of it that a bias is never taken to be less than, with areas and with discs: along edges what a short trial
/// tells of discs is far too little at times.
pub const LEAST_OF_PRIOR: [f64; 2] = [0.05, 0.3];

/// Blocks of pixels in which the areas of surfaces are tried, and pixels along their sides.
pub const CENSUS_BLOCKS: usize = 96;
/// See [`CENSUS_BLOCKS`].
pub const BLOCK: u32 = 4;

/// The power of the radius that what areas cost goes with at the most: triangles in reach of as many places.
pub const CENSUS_POWER: f64 = 3.0;

/// Share of a pilot that trying areas takes at each radius and vertex, about, at the most.
pub const CENSUS_SHARE: f64 = 0.01;

/// Part of the time that is taken to be left, however long areas take at first.
pub const LEAST_TIME_SHARE: f64 = 0.02;

/// Discs are tried beside areas that take this share of the time before they are known.
pub const DISCS_FROM: f64 = 0.1;

/// Techniques that are tried on discs, too.
pub const MOST_ON_DISCS: usize = 2;

/// Squared bias of discs over that of areas, where nothing is known of it: what Cornell boxes have (docs/kernel.md).
pub const DISC_BIAS: f64 = 20.0;

/// What it falls to from a radius to `1/sqrt(2)` of it: the square as the radius.
pub const DISC_FALL: f64 = 0.8409;

/// Pixels across and down at which the size of what one sees is asked for.
pub const FOOTPRINTS: u32 = 16;

// --- Learning where light paths start ------------------------------------------------------------

/// Light paths of an iteration that learns: enough that rounds know more than the one before.
pub const LEARNING_LIGHT_PATHS: u32 = 8192;

/// Its pixels, about, and camera paths in each.
pub const LEARNING_PIXELS: f64 = 4096.0;
/// See [`LEARNING_PIXELS`].
pub const LEARNING_CAMERA_PATHS: u32 = 2;

/// Iterations after which what was learned is used to learn more, and after twice as many again.
pub const LEARNING_ROUND: u32 = 4;

/// Iterations of learning at the least: the second half tells what the first has learned.
pub const LEAST_LEARNING: u32 = 2 * LEARNING_ROUND;

/// Iterations at the most: the cells are then as small as pays.
pub const MOST_LEARNING: u32 = 64;

/// Share of a pilot that it takes.
pub const LEARNING_SHARE: f64 = 0.2;

/// The least learning may take so many times as long.
pub const LEARNING_PATIENCE: f64 = 2.0;

/// A guide is taken if it leaves at most this share of the second moment of what light paths bring.
pub const WORTHWHILE_GUIDE: f64 = 0.9;

// --- Choosing counts -----------------------------------------------------------------------------

/// Blocks that a render of automatic counts may come to: each keeps its sums in memory.
pub const MOST_BLOCKS: usize = 7;

/// Far more camera paths per pixel than can pay.
pub const MOST_CAMERA_PATHS: u32 = 1 << 16;

/// Among counts whose cost is this close to the best, the shortest iteration is taken: the optimum is
/// flat, and a short iteration ends near the time that was asked for.
pub const NEAR_OPTIMUM: f64 = 0.01;

/// Iterations that should fit in a time of rendering at the least: they average out what a single one
/// finds by chance, and no coefficient of 0 leads to infinite counts.
pub const LEAST_ITERATIONS: f64 = 16.0;

/// The same for the iterations that follow a choice in `bdpm render`, which still measures among them and
/// may choose again.
pub const LEAST_ITERATIONS_AFTER_CHOICE: f64 = 64.0;

/// The same for every one of several processes that share them: so that none ends long before another.
pub const LEAST_ITERATIONS_OF_RANK: f64 = 8.0;

/// [`LEAST_ITERATIONS_AFTER_CHOICE`] of so many processes.
pub fn least_iterations_after_choice(ranks: u32) -> f64 {
    LEAST_ITERATIONS_AFTER_CHOICE.max(LEAST_ITERATIONS_OF_RANK * f64::from(ranks))
}

/// Iterations at chosen counts before anything is promised or chosen anew: enough for a sample variance
/// of the pooled noise within a few percent.
pub const FIRST_ITERATIONS: u64 = 12;

/// Relative standard error of the pooled variance at which the error at the end is promised.
pub const PROMISE_ERROR: f64 = 0.1;

/// Share of the time after which it is promised in any case.
pub const PROMISE_SHARE: f64 = 0.2;

/// A new block must save this share of the time: less is lost by a block's own weight.
pub const WORTHWHILE: f64 = 0.02;

/// Counts per pixel must save this share. They follow the noise of what they are chosen from, which
/// makes them look better than they are.
pub const WORTHWHILE_PER_PIXEL: f64 = 0.05;

/// Degrees of freedom that the mean over a neighborhood counts as beside a pixel's own: estimates
/// of single pixels come from heavy-tailed values. By trial.
pub const PRIOR_FREEDOM: f64 = 200.0;

// --- When enough is known ------------------------------------------------------------------------

/// Iterations at the least before a target counts as reached: a stop on the first low estimate would
/// come too early on average.
pub const LEAST_ITERATIONS_TO_TARGET: u64 = 32;

/// A pixel's own squared luminance says more than that of its neighborhood if noise adds no more than the rest.
pub const PLAIN_SHARE: f64 = 0.9;

/// Share of the squared error asked for that noise may have at the least, if the bias is not less than that.
pub const LEAST_NOISE_SHARE: f64 = 0.1;

/// Standard errors from an estimate up to its upper 90 % bound.
pub const UPPER_BOUND: f64 = 1.2816;

/// Standard errors by which a bias must stand out to count.
pub const BIAS_CERTAINTY: f64 = 2.0;

// --- Taking off the merge bias --------------------------------------------------------------------

/// Share of the pixels, by their weight, that have the bias: where it is taken off, that adds noise to these alone. By
/// trial.
pub const BIASED_PIXELS: f64 = 0.15;

// --- Denoising -----------------------------------------------------------------------------------

/// Share of a time of rendering that denoising takes at the most where its error is found: fewer parts are left out
/// in turn where all would take longer.
pub const DENOISE_SHARE: f64 = 0.25;

/// Iterations of each part at the least before the error of a denoised image is found on the way.
pub const LEAST_PER_PART: u64 = 2;

/// Share of the time that finding the error on the way takes at the most, about.
pub const CHECK_SHARE: f64 = 0.2;

/// Time of rendering from one look at the error to the next, over that before: as the error is expected to fall.
pub const CHECK_GROWTH: std::ops::Range<f64> = 1.1..2.0;

/// The power of the time that the squared error of denoised images is taken to fall with: less than that of noise, which
/// is 1, since the denoiser's bias falls as well, but later. Not from a trial: only when to look next, and promises, depend on it.
pub const DENOISED_FALL: f64 = 0.7;

/// Share of a given time after which the error at its end is promised.
pub const DENOISE_PROMISE_AFTER: f64 = 0.25;

/// Share of the time that this may take.
pub const DENOISE_PROMISE_SHARE: f64 = 0.1;
