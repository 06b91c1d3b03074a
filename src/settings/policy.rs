//! Numbers that decide: when to measure, when to choose counts again, and when enough is known.
//!
//! None changes what is estimated, only how soon and how well. Each tells where it comes from: "by
//! trial" means the middle of a range within which `examples/optimum_table.rs` shows no difference beyond
//! its noise.

// --- When to measure -----------------------------------------------------------------------------

/// Iterations that are measured at the beginning of a render at fixed counts: the least that batches
/// of two iterations tell anything about.
pub const FIXED_PILOT: u64 = 8;

/// Of the iterations after the pilot, one in so many is measured: with a million light paths one takes
/// one and a half times as long as another (`docs/performance.md`), so that this costs 6 % at most.
pub const MEASURE_EVERY: u64 = 8;

/// Of the pilot's own iterations, one in so many: times come from the others.
pub const MEASURE_PILOT_EVERY: u64 = 2;

// --- The pilot of automatic counts ---------------------------------------------------------------

/// Camera paths per pixel in the two blocks of the pilot: few, but more than the two that measuring
/// takes, as their sample variance has one degree of freedom less.
pub const PILOT_CAMERA_PATHS: [u32; 2] = [3, 6];

/// Light paths in the second block over those in the first. Times at two sizes of either kind tell
/// what is paid per path and what is paid anyway.
pub const PILOT_RATIO: u32 = 16;

/// Iterations of each block of the pilot at the least, where no time is given.
pub const PILOT_LEAST: u64 = 8;

/// The same where a time is given: two that are measured and one that is not.
pub const PILOT_LEAST_IN_HASTE: u64 = 3;

/// Iterations of each block of the pilot at the most: far past the point where more would change the
/// counts.
pub const PILOT_MOST: u64 = 512;

/// Share of the time that each block of the pilot takes where the time is given: by trial.
pub const PILOT_SHARE: f64 = 0.04;

/// The most seconds of a block of the pilot where the time is given.
pub const PILOT_LONGEST: f64 = 5.0;

/// Seconds of each block of the pilot where no time is given.
pub const PILOT_TIME: f64 = 1.0;

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

/// Iterations at chosen counts before anything is promised or chosen anew: enough for a sample variance
/// of the pooled noise within a few percent.
pub const FIRST_ITERATIONS: u64 = 12;

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

/// Standard errors from an estimate up to its upper 90 % bound.
pub const UPPER_BOUND: f64 = 1.2816;

/// Standard errors by which a bias must stand out to count.
pub const BIAS_CERTAINTY: f64 = 2.0;
