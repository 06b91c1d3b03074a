//! All comparisons with the published values, and the reasons of differences.

use super::findings::{Comparison, Finding, Topic, Verdict};
use super::implied;
use super::optimum::{Optima, implied_over_least, over_least, rescaled};
use super::published::{
    BEST_LIGHT_PATHS, CAMERA_PATHS, FIGURE_2, FIGURE_3, LIGHT_PATHS, TABLE_1, TABLE_1_CAMERA_PATHS,
    TABLE_2, Table2Column,
};
use super::tables::{Cell, find};
use super::terms::{Terms, corrected, mean_rms, quotient, share};
use bdpm_auto::adaptive::optimize::predict::Predicted;
use bdpm_auto::timing::TimeModel;
use bdpm_core::noise::image::NoiseImage;

/// The data that the findings rest on.
pub struct Evidence<'a> {
    /// The noise of every pixel at `N_B = 25` and `100`.
    pub noise: [&'a NoiseImage; 2],
    /// Pixels of the region.
    pub region: &'a [usize],
    /// The terms at these counts.
    pub terms: &'a [Terms; 2],
    /// The cells of the tables.
    pub cells: &'a [Cell],
    /// Times here.
    pub model: &'a TimeModel,
    /// The minima.
    pub optima: &'a Optima,
}

/// All findings.
pub fn findings(evidence: &Evidence) -> Vec<Finding> {
    let all = [formula(evidence), terms(evidence), halving(evidence), light_paths(evidence)];
    all.into_iter().flatten().chain(minimum(evidence)).collect()
}

/// The reason if the paper's own numbers imply another value.
fn by_its_own_numbers(verdict: Verdict, how: &str) -> String {
    match verdict {
        Verdict::AsImplied => format!("the printed value is not what {how}; this is"),
        Verdict::Same => String::new(),
        _ => format!("neither the printed value nor what {how}"),
    }
}

fn formula(evidence: &Evidence) -> Vec<Finding> {
    let here = evidence.terms[0].ratio;
    let Terms { formula, sampled, iterations, .. } = &evidence.terms[0];
    let why = |_| {
        format!(
            "region means {:.5} by formula, {:.5} sampled, from the same {iterations} iterations",
            formula.value, sampled.value
        )
    };
    let printed = FIGURE_2[1] / FIGURE_2[0];
    let name = "RMS by formula over RMS sampled, N_B = 25".to_owned();
    let topic = Topic::Formula;
    let comparison = Comparison { topic, name, printed, implied: None, here, tolerance: 0.003 };
    let mut all = vec![comparison.judge(why)];
    // Independent: the coefficients of one run against the samples of others.
    for n_camera in CAMERA_PATHS {
        if let Some(cell) = find(evidence.cells, LIGHT_PATHS, n_camera) {
            let name =
                format!("RMS by formula over RMS sampled in an independent run, N_B = {n_camera}");
            let here = quotient(cell.formula, cell.sampled);
            let why = |_| format!("sampled in {} iterations", cell.iterations);
            let implied = None;
            let comparison = Comparison { topic, name, printed, implied, here, tolerance: 0.03 };
            all.push(comparison.judge(why));
        }
    }
    all
}

fn terms(evidence: &Evidence) -> Vec<Finding> {
    let counts = [f64::from(LIGHT_PATHS), f64::from(CAMERA_PATHS[0])];
    // `f` is more certain the more camera paths meet each light path.
    let f = share(evidence.noise[1], evidence.region, 2, counts);
    let [c, b, _] = evidence.terms[0].shares;
    let all = [("C", c, 0.01), ("B", b, 0.004), ("F", f, 0.003)];
    let one = |(k, (name, here, tolerance)): (usize, (&str, Predicted, f64))| {
        let printed = FIGURE_3[0].roots[k] / FIGURE_3[0].total;
        let why = |verdict| match verdict {
            Verdict::Same if k == 2 => "coefficients measured at N_B = 100".into(),
            Verdict::Same => String::new(),
            _ => format!("{:+.1} % from the printed value", percent(here.value, printed)),
        };
        let name = format!("{name} term over the total, N_B = 25");
        Comparison { topic: Topic::Terms, name, printed, implied: None, here, tolerance }.judge(why)
    };
    all.into_iter().enumerate().map(one).collect()
}

fn halving(evidence: &Evidence) -> Vec<Finding> {
    let [few, many] = evidence.terms;
    let [n_few, n_many] = CAMERA_PATHS.map(f64::from);
    let implied = implied::coefficients();
    let root_of = |k: usize, n: f64| implied.paper_terms(LIGHT_PATHS.into(), n)[k].sqrt();
    let topic = Topic::Halving;
    let mut all = Vec::new();
    for (k, name) in ["C term", "B term", "F term"].into_iter().enumerate() {
        let printed = FIGURE_3[1].roots[k] / FIGURE_3[0].roots[k];
        let implied = Some(root_of(k, n_many) / root_of(k, n_few));
        let here = quotient(many.roots[k], few.roots[k]);
        let name = format!("{name}, N_B = 100 over 25");
        // The F term is 1/60 of the others: less certain, and with more room.
        let tolerance = if k == 2 { 0.05 } else { 0.005 };
        let why = |verdict| by_its_own_numbers(verdict, "formula (1) gives from N_B = 25");
        all.push(Comparison { topic, name, printed, implied, here, tolerance }.judge(why));
    }
    let printed = FIGURE_3[1].total / FIGURE_3[0].total;
    let rms = |n_camera| implied::rms(LIGHT_PATHS.into(), n_camera);
    let implied = Some(rms(n_many) / rms(n_few));
    let why = |verdict| by_its_own_numbers(verdict, "formula (1) gives from N_B = 25");
    for (name, here) in [
        ("total by formula", quotient(many.formula, few.formula)),
        ("total sampled", quotient(many.sampled, few.sampled)),
    ] {
        let name = format!("{name}, N_B = 100 over 25");
        all.push(Comparison { topic, name, printed, implied, here, tolerance: 0.005 }.judge(why));
    }
    all
}

fn light_paths(evidence: &Evidence) -> Vec<Finding> {
    let n_camera = f64::from(CAMERA_PATHS[0]);
    let [reference, others @ ..] = &TABLE_2;
    let n_first = f64::from(reference.light_paths);
    let one = |row: &Table2Column| {
        let n = f64::from(row.light_paths);
        let here = corrected(evidence.noise[0].statistic(evidence.region, |pixels| {
            mean_rms(pixels, n, n_camera) / mean_rms(pixels, n_first, n_camera)
        }));
        let implied = Some(implied::rms(n, n_camera) / implied::rms(n_first, n_camera));
        let limit = implied::rms(f64::INFINITY, n_camera) / implied::rms(n_first, n_camera);
        let printed = row.rms / reference.rms;
        let why = |verdict| match verdict {
            Verdict::AsImplied if printed < limit => format!(
                "the printed value lies below {limit:.4}, which by Figure 3 even infinitely many \
                 light paths do not undercut; it comes from {} iterations",
                row.iterations
            ),
            _ => by_its_own_numbers(verdict, "formula (1) gives from Figure 3"),
        };
        let name = format!("RMS at N_F = {} over N_F = {}", row.light_paths, reference.light_paths);
        let topic = Topic::LightPaths;
        Comparison { topic, name, printed, implied, here, tolerance: 0.005 }.judge(why)
    };
    others.iter().map(one).collect()
}

/// The image in which light paths take the share of the time that they take in the paper.
struct LargerImage {
    model: TimeModel,
    /// Pixels along each side.
    side: f64,
    /// Its best number of light paths.
    best: f64,
}

fn minimum(evidence: &Evidence) -> Vec<Finding> {
    let optima = evidence.optima;
    let model = rescaled(*evidence.model);
    let (side, best) = (model.pixels.sqrt(), optima.rescaled.light_paths.value);
    let larger = LargerImage { model, side, best };
    let mut all = vec![minimum_position(evidence, &larger)];
    all.extend(beside_the_minimum(evidence, &larger));
    all.extend(camera_paths_at_the_minimum(evidence, &larger));
    all
}

/// RMS here with `n` light paths over the least.
fn here_over_least(evidence: &Evidence, n: f64) -> Predicted {
    let Evidence { noise, region, model, optima, .. } = *evidence;
    over_least(noise[0], region, model, optima.here.light_paths.value, n)
}

/// Ratios of the factors of the best number of light paths, here over implied: by the times, and by
/// the noise.
fn factors(optima: &Optima) -> [f64; 2] {
    [0, 1].map(|i| optima.here.factors[i] / optima.implied.factors[i])
}

fn minimum_position(evidence: &Evidence, larger: &LargerImage) -> Finding {
    let optima = evidence.optima;
    let ([by_times, by_noise], &LargerImage { side, best, .. }) = (factors(optima), larger);
    let decomposed = format!(
        "the best N_F is {:.0} here and {:.0} by the printed numbers: {by_times:.2} times as many \
         by the times (an iteration without light paths over one light path), {by_noise:.2} times \
         by the noise; it would be {best:.0} in an image of {side:.0} by {side:.0} pixels, where \
         light paths take the share of the time that they take in Table 2",
        optima.here.light_paths.value, optima.implied.light_paths.value,
    );
    let position = Comparison {
        topic: Topic::Minimum,
        name: format!("RMS at the published minimum, N_F = {BEST_LIGHT_PATHS}, over the least"),
        printed: 1.0,
        implied: Some(implied_over_least(BEST_LIGHT_PATHS)),
        here: here_over_least(evidence, BEST_LIGHT_PATHS),
        tolerance: 0.01,
    };
    position.judge(|_| decomposed.clone())
}

/// Away from the minimum: fewer light paths cost noise, more of them time.
fn beside_the_minimum(evidence: &Evidence, larger: &LargerImage) -> Vec<Finding> {
    let Evidence { noise, region, optima, .. } = *evidence;
    let &LargerImage { ref model, side, best } = larger;
    let [_, by_noise] = factors(optima);
    let column = TABLE_1_CAMERA_PATHS.iter().position(|&n| n == CAMERA_PATHS[0]).unwrap_or(0);
    let least = TABLE_1.iter().map(|(_, cells)| cells[column]).fold(f64::INFINITY, f64::min);
    let finding = |(n_light, cells): (u32, [f64; 4])| {
        let n = f64::from(n_light);
        let why = |verdict| match verdict {
            Verdict::Same => String::new(),
            _ if n < BEST_LIGHT_PATHS => format!(
                "with few light paths the noise decides: sqrt(p/q) is {by_noise:.2} times the \
                 printed one"
            ),
            _ => format!(
                "with many light paths the time decides: an iteration without light paths takes as \
                 long as {:.0} thousand light paths here, {:.0} thousand by Table 2; in an image of \
                 {side:.0} by {side:.0} pixels, where they take the share of the time that they \
                 take there, it would be {:.3}",
                1e-3 * optima.here.factors[0].powi(2),
                1e-3 * optima.implied.factors[0].powi(2),
                over_least(noise[0], region, model, best, n).value,
            ),
        };
        let comparison = Comparison {
            topic: Topic::Minimum,
            name: format!("RMS at N_F = {n_light} over the least, N_B = 25"),
            printed: cells[column] / least,
            implied: Some(implied_over_least(n)),
            here: here_over_least(evidence, n),
            tolerance: 0.03,
        };
        comparison.judge(why)
    };
    [TABLE_1[0], TABLE_1[4], TABLE_1[5]].map(finding).into()
}

/// Fewer and more camera paths in the same time; `None` if the experiment has no such cells.
fn camera_paths_at_the_minimum(evidence: &Evidence, larger: &LargerImage) -> Option<Finding> {
    let [first, .., last] = TABLE_1_CAMERA_PATHS;
    let few = find(evidence.cells, LIGHT_PATHS, first)?;
    let many = find(evidence.cells, LIGHT_PATHS, last)?;
    let here = quotient(few.model_after, many.model_after);
    // The two predictions are from the same coefficients: their errors nearly cancel.
    let here = Predicted { error: Some(0.0), ..here };
    let alone = |model: &TimeModel| {
        let [fixed, light, ..] = model.parts(LIGHT_PATHS.into(), first.into());
        100.0 * (fixed + light) / model.iteration(LIGHT_PATHS.into(), first.into())
    };
    let why = |_| {
        let side = larger.side;
        format!(
            "an iteration spends {:.1} % of its time on what camera paths do not change here at \
             N_B = {first}, {:.1} % by Table 2, and {:.1} % in an image of {side:.0} by {side:.0} \
             pixels; measured without the formula the ratio is {:.3}",
            alone(evidence.model),
            alone(&implied::time_model()),
            alone(&larger.model),
            few.after.value / many.after.value,
        )
    };
    let (_, cells) = TABLE_1[1];
    let (printed, implied) = (cells[0] / cells[3], None);
    let topic = Topic::Minimum;
    let name = format!("RMS after a time at N_B = {first} over {last}, N_F = {LIGHT_PATHS}");
    Some(Comparison { topic, name, printed, implied, here, tolerance: 0.02 }.judge(why))
}

fn percent(a: f64, b: f64) -> f64 {
    100.0 * (a / b - 1.0)
}
