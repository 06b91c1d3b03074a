//! IterationSet that decide: when to measure, when to choose counts again, and when enough is known.
//!
//! None changes what is estimated, only how soon and how well. Each tells where it comes from: "by
//! trial" means the middle of a range within which `examples/optimum_table.rs` shows no difference beyond
//! its noise.

// --- When to measure -----------------------------------------------------------------------------

/// Of the first iterations of an automatic render, one in so many: times come from the others.
pub const MEASURE_FIRST_EVERY: u64 = 2;

// --- Learning where light paths start ------------------------------------------------------------

/// Light paths of an iteration that learns: enough that rounds know more than the one before.
pub const LEARNING_LIGHT_PATHS: u32 = 8192;

/// Its pixels, about, and camera paths in each.
pub const LEARNING_PIXELS: f64 = 4096.0;
/// See [`LEARNING_PIXELS`].
pub const LEARNING_CAMERA_PATHS: u32 = 2;

/// Iterations after which what was learned is used to learn more, and after twice as many again.
pub const LEARNING_ROUND: u32 = 4;

// --- Choosing counts -----------------------------------------------------------------------------

/// Blocks that a render of automatic counts may come to: each keeps its sums in memory.
pub const MOST_BLOCKS: usize = 7;

/// Fewest iterations that should fit in the time after a choice of counts in `bdpm render`, which still
/// measures among them and may choose again.
pub const LEAST_ITERATIONS_AFTER_CHOICE: f64 = 64.0;

/// Fewest iterations of each of several processes that share them: so that none ends long before another.
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

// --- Taking off the merge bias --------------------------------------------------------------------

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
