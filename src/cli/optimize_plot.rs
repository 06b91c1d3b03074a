//! The paper's Figure 4: RMS after a time against the number of light paths, as SVG.

use bdpm::adaptive::optimize::measured::End;
use bdpm::adaptive::optimize::{Problem, Uniform};
use bdpm::base::atomic::write_atomically;
use bdpm::base::error::{Error, Result};
use plotters::prelude::*;
use std::error::Error as Failure;
use std::ops::RangeInclusive;
use std::path::Path;

/// IterationSet of camera paths per pixel that have a curve, besides the best one.
const CAMERA_PATHS: [u32; 4] = [1, 5, 25, 100];

/// Width and height.
const SIZE: (u32, u32) = (1200, 840);

/// Points of a curve.
const POINTS: u32 = 80;

/// Light paths at both ends over the best number.
const SPREAD: f64 = 50.0;

/// Top of the plot over the least RMS.
const HEIGHT: f64 = 3.5;

/// Colors that color-blind people can tell apart (Okabe and Ito 2008).
const COLORS: [RGBColor; 5] = [
    RGBColor(0, 114, 178),
    RGBColor(213, 94, 0),
    RGBColor(0, 158, 115),
    RGBColor(204, 121, 167),
    RGBColor(86, 180, 233),
];

/// Writes the plot. Without an end it is about one second of rendering.
pub fn plot(
    path: &Path,
    problem: &Problem,
    light_paths: &RangeInclusive<u32>,
    end: End,
) -> Result<()> {
    let best = problem.uniform();
    let time = match end {
        End::Unbounded => 1.0,
        End::Time(time) => time,
        End::Rms(rms) => best.cost / (rms * rms),
    };
    let best_rms = (best.cost / time).sqrt();
    if !(best_rms > 0.0 && best_rms.is_finite()) {
        return Err(Error::new("there is no noise to plot", "leave --plot out").at(path));
    }
    let svg = draw(problem, &best, light_paths, time).map_err(|e| {
        Error::new(format!("cannot plot: {e}"), "leave --plot out and report this as a bug")
    })?;
    write_atomically(path, |file| file.write_all(svg.as_bytes()))
}

fn draw(
    problem: &Problem,
    best: &Uniform,
    light_paths: &RangeInclusive<u32>,
    time: f64,
) -> std::result::Result<String, Box<dyn Failure>> {
    let rms = |found: &Uniform| (found.cost / time).sqrt();
    let at = |n: u32, m: u32| (f64::from(n), rms(&problem.evaluate_uniform(n, m)));
    let center = f64::from(best.light_paths);
    let least = (center / SPREAD).max(f64::from(*light_paths.start()));
    let most = (center * SPREAD).min(f64::from(*light_paths.end())).max(2.0 * least);
    let top = HEIGHT * rms(best);
    let step = |i: u32| (least * (most / least).powf(f64::from(i) / f64::from(POINTS))) as u32;

    let mut svg = String::new();
    {
        let root = SVGBackend::with_string(&mut svg, SIZE).into_drawing_area();
        root.fill(&WHITE)?;
        let mut chart = ChartBuilder::on(&root)
            .margin(24)
            .x_label_area_size(84)
            .y_label_area_size(120)
            .caption(format!("Noise after {}", shown_time(time)), ("sans-serif", 32))
            .build_cartesian_2d((least..most).log_scale(), 0.0..top)?;
        chart
            .configure_mesh()
            .x_desc("light paths per iteration, N_F")
            .y_desc("RMS, W/(m² sr)")
            .label_style(("sans-serif", 23))
            .axis_desc_style(("sans-serif", 27))
            .x_label_formatter(&|n| shown_count(*n))
            .y_label_formatter(&|rms| shown_rms(*rms, top))
            .y_max_light_lines(1)
            .light_line_style(RGBColor(240, 240, 240))
            .bold_line_style(RGBColor(210, 210, 210))
            .draw()?;
        let mut all = CAMERA_PATHS.to_vec();
        if !all.contains(&best.camera_paths) {
            all.push(best.camera_paths);
            all.sort_unstable();
        }
        for (index, (n_camera, color)) in all.into_iter().zip(COLORS).enumerate() {
            let points = (0..=POINTS).map(|i| at(step(i).max(1), n_camera));
            let points = points.filter(|(_, rms)| *rms <= top);
            // Curves that coincide stay visible below each other.
            let style = color.stroke_width(10 - 2 * index as u32);
            chart
                .draw_series(LineSeries::new(points, style))?
                .label(format!("N_B = {n_camera}"))
                .legend(move |(x, y)| PathElement::new([(x, y), (x + 36, y)], style));
        }
        let marked = at(best.light_paths, best.camera_paths);
        let label = format!(
            "least {}: N_F = {}, N_B = {}",
            shown_rms(marked.1, 0.1 * marked.1),
            best.light_paths,
            best.camera_paths
        );
        chart
            .draw_series([Circle::new(marked, 9, BLACK.filled())])?
            .label(label)
            .legend(|(x, y)| Circle::new((x + 18, y), 9, BLACK.filled()));
        chart
            .configure_series_labels()
            .position(SeriesLabelPosition::UpperMiddle)
            .margin(18)
            .legend_area_size(48)
            .background_style(WHITE)
            .border_style(RGBColor(160, 160, 160))
            .label_font(("sans-serif", 23))
            .draw()?;
        root.present()?;
    }
    Ok(svg)
}

/// A time for people, seconds.
fn shown_time(time: f64) -> String {
    if time < 1.0 { format!("{time:.2e} s") } else { super::human_time(time) }
}

/// A power of 10 in short.
fn shown_count(n: f64) -> String {
    if n < 1e5 { format!("{n:.0}") } else { format!("{n:e}") }
}

/// An RMS with as many digits as a scale up to `top` needs.
fn shown_rms(rms: f64, top: f64) -> String {
    let digits = 2.0 - top.log10().floor();
    match digits {
        0.0..=6.0 => format!("{rms:.*}", digits as usize),
        _ if rms == 0.0 => "0".into(),
        _ => format!("{rms:.2e}"),
    }
}
