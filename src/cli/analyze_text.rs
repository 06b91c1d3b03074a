//! The table that `bdpm analyze` prints.

use super::analyze::AnalyzeReport;
use super::human_time;
use bdpm::image_io::digits;
use bdpm::noise::Coefficients;
use bdpm::noise::image::Statistic;
use bdpm::noise::summary::{Compared, NoiseSummary};
use std::fmt::Write;

/// Relative errors below this are rounding errors.
const ROUNDING: f64 = 1e-9;

/// `value +- error`, aligned at the sign between them.
pub fn with_error(value: f64, error: Option<f64>) -> String {
    // Exact values have no error, such as a time relative to itself.
    let error = error.filter(|error| error.is_finite() && *error > ROUNDING * value.abs());
    let digits = digits(value, error.unwrap_or(0.0));
    match error {
        Some(error) => format!("{value:>12.digits$} +- {error:<10.digits$}"),
        None => format!("{value:>12.digits$}    {:<10}", ""),
    }
}

fn shown(statistic: &Statistic) -> String {
    with_error(statistic.value, Some(statistic.error))
}

pub fn text(report: &AnalyzeReport) -> String {
    let noise = &report.noise;
    let mut text = format!(
        "noise of one iteration at N_F = {}, N_B = {}, from {} iterations in {}\n\
         region {}, {} pixels; luminances in W/(m^2 sr), standard errors after +-\n\n",
        report.light_paths,
        report.camera_paths,
        report.run.iterations,
        human_time(report.run.seconds.total),
        report.region,
        noise.pixels,
    );
    let mut line = |content: &str| {
        writeln!(text, "{}", content.trim_end()).expect("strings take everything");
    };
    line(&format!(
        "{:<22} {:>12}    {:<10} {:>12}    {:<10} {:>8}",
        "terms of (1)", "mean of roots", "", "pooled root", "", "negative"
    ));
    for (k, name) in ["C, interaction", "B, camera paths", "F, light paths"].iter().enumerate() {
        line(&format!(
            "{name:<22} {} {} {:>8}",
            shown(&noise.mean_root_terms[k]),
            shown(&noise.pooled_terms[k]),
            noise.negative_terms[k]
        ));
    }
    let NoiseSummary { mean_rms, pooled_rms, .. } = noise;
    let mut row = |name: &str, of: fn(&Compared) -> Statistic, negative: String| {
        line(&format!(
            "{name:<22} {} {} {negative:>8}",
            shown(&of(mean_rms)),
            shown(&of(pooled_rms))
        ));
    };
    row("RMS by formula", |c| c.predicted, noise.negative_variances.to_string());
    row("RMS sampled", |c| c.sampled, String::new());
    row("formula / sampled", |c| c.ratio, String::new());
    row("RMS - jackknife bias", corrected, String::new());
    line("");
    bias_lines(noise).iter().for_each(|content| line(content));
    line("");
    match (noise.iterations_for.five_percent, noise.iterations_for.one_percent) {
        (Some(five), Some(one)) => line(&format!(
            "two standard errors of the pooled RMS by formula are 5 % after {five} iterations, 1 % \
             after {one}"
        )),
        _ => line("standard errors need at least 32 iterations"),
    }
    line(&format!(
        "mean a, b and f of the region, for predict and optimize: {}",
        coefficients(&report.coefficients)
    ));
    line("the mean of roots is biased low for few iterations; use the pooled root for comparisons");
    line(&format!("\n{}, {} and {}", report.exr, report.terms_png, report.rms_png));
    text
}

/// Coefficients as the option that takes them. Negative estimates of 0 become 0, as the option
/// needs.
fn coefficients(own: &Coefficients) -> String {
    let [a, b, f] = [own.a, own.b, own.f].map(|value| format!("{:.4e}", value.max(0.0)));
    format!("--coefficients {a},{b},{f}")
}

/// The merge bias and how it stands out from the noise.
fn bias_lines(noise: &NoiseSummary) -> Vec<String> {
    let bias = &noise.bias;
    let mut lines = vec![
        format!("{:<22} {}", "merge bias, mean", shown(&bias.mean)),
        format!("{:<22} {}", "merge bias, RMS", shown(&bias.rms)),
    ];
    if bias.significant {
        lines.push(format!(
            "{:<22} {:>12.4} of the RMS of one iteration, {:.3} % of the mean luminance",
            "  which is",
            bias.rms.value / noise.pooled_rms.predicted.value,
            100.0 * bias.rms.value / bias.mean_luminance
        ));
    } else if bias.upper_bound.is_finite() {
        lines.push(format!(
            "{:<22} hidden by the noise; at most {:.3} % of the mean luminance",
            "",
            100.0 * bias.upper_bound / bias.mean_luminance
        ));
    }
    lines.push(format!("{:<22} {}", "  relative, RMS", shown(&bias.relative)));
    lines
}

fn corrected(compared: &Compared) -> Statistic {
    Statistic { value: compared.predicted.corrected, ..compared.predicted }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn coefficients_are_those_of_the_option() {
        let own = Coefficients { a: 3595.0, b: 37.18, f: -1e-9 };
        let shown = coefficients(&own);
        let value = shown.strip_prefix("--coefficients ").unwrap();
        let read = crate::cli::predict::coefficients(value).unwrap();
        assert_eq!((read.a, read.b, read.f), (3595.0, 37.18, 0.0));
    }

    #[test]
    fn value_with_error_ends_at_the_second_digit_of_the_error() {
        assert_eq!(with_error(1.23456, Some(0.0123)).trim(), "1.235 +- 0.012");
        assert_eq!(with_error(1234.5, Some(210.0)).trim(), "1234 +- 210");
        assert_eq!(with_error(0.5, None).trim(), "0.5000");
        assert_eq!(with_error(1.0, Some(f64::INFINITY)).trim(), "1.000");
        // Exact except for rounding.
        assert_eq!(with_error(0.0, Some(0.0)).trim(), "0.0000");
        assert_eq!(with_error(1.0, Some(2e-16)).trim(), "1.000");
    }
}
