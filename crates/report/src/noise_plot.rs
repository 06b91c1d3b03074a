//! The paper's Figure 4: RMS against the number of light paths, for several numbers of camera
//! paths.

use super::axes::{Curve, LogPlot, Mark, decimal_ticks};
use maud::Markup;

/// Number of points of a curve.
const STEPS: u32 = 100;

/// Classes of the curves in [`STYLE`], one for each number of camera paths.
const SERIES: [&str; 5] = ["series0", "series1", "series2", "series3", "series4"];

/// Style sheet of the plot. The colors can be distinguished by color-blind people (Okabe and Ito
/// 2008).
const STYLE: &str = "
.noise-plot text { font: 17px sans-serif; fill: #111 }
.noise-plot .mesh { stroke: #ddd } .noise-plot .axis { stroke: #888 }
.noise-plot polyline, .noise-plot circle { stroke-width: 2 }
.noise-plot .series0 { stroke: #0072b2 } .noise-plot circle.series0 { fill: #0072b2 }
.noise-plot .series1 { stroke: #d55e00 } .noise-plot circle.series1 { fill: #d55e00 }
.noise-plot .series2 { stroke: #009e73 } .noise-plot circle.series2 { fill: #009e73 }
.noise-plot .series3 { stroke: #cc79a7 } .noise-plot circle.series3 { fill: #cc79a7 }
.noise-plot .series4 { stroke: #56b4e9 } .noise-plot circle.series4 { fill: #56b4e9 }
.noise-plot .minimum { stroke: #888; fill: none }
";

/// The curves, measured points, and the minimum.
pub struct NoisePlot<'a> {
    /// Description for people who cannot see the plot.
    pub alt: &'a str,
    /// Name of the RMS with its unit.
    pub rms_name: &'a str,
    /// RMS at a number of light paths and of camera paths.
    pub rms: &'a dyn Fn(f64, u32) -> f64,
    /// Numbers of camera paths, at most five, in the order of the legend.
    pub camera_paths: &'a [u32],
    /// Numbers of camera paths that have a curve.
    pub curves: &'a [u32],
    /// Measured values.
    pub points: &'a [NoisePoint],
    /// Path counts with the minimum RMS, and their label in the legend.
    pub minimum: (f64, u32, String),
    /// Numbers of light paths from the left to the right end.
    pub light_paths: [f64; 2],
    /// Lowest and highest RMS that is shown.
    pub limits: [f64; 2],
}

/// A measured RMS.
pub struct NoisePoint {
    /// `N_F`.
    pub light_paths: f64,
    /// `N_B`.
    pub camera_paths: u32,
    /// RMS, in the unit of the plot.
    pub rms: f64,
    /// Standard error of `rms`.
    pub error: f64,
}

impl NoisePlot<'_> {
    /// The plot as an SVG element with its own style sheet, which is also a whole SVG file. `None`
    /// if there is nothing to show.
    pub fn svg(&self) -> Option<Markup> {
        let [bottom, top] = self.limits;
        let [left, right] = self.light_paths;
        let class = |n: u32| {
            SERIES[self.camera_paths.iter().position(|&m| m == n).unwrap_or(0) % SERIES.len()]
        };
        let mut curves = Vec::new();
        for &n_camera in self.curves {
            let step = |i| left * (right / left).powf(f64::from(i) / f64::from(STEPS));
            let points = (0..=STEPS).map(|i| [step(i), (self.rms)(step(i), n_camera)]);
            let points = points.filter(|[_, rms]| *rms <= top).collect();
            curves.push(Curve { class: class(n_camera), points });
        }
        let mut marks = Vec::new();
        for point in self.points.iter().filter(|point| point.rms <= top) {
            let NoisePoint { light_paths, camera_paths, rms, error } = *point;
            let ends = [(rms - error).max(bottom), (rms + error).min(top)];
            let points = ends.map(|end| [light_paths, end]).into();
            curves.push(Curve { class: class(camera_paths), points });
            marks.push(Mark { class: class(camera_paths), at: [light_paths, rms] });
        }
        let (n_light, n_camera, label) = &self.minimum;
        let minimum = [*n_light, (self.rms)(*n_light, *n_camera)];
        curves.push(Curve { class: "minimum", points: vec![[*n_light, bottom], minimum] });
        marks.push(Mark { class: "minimum", at: minimum });
        let legend = self.camera_paths.iter().map(|&n| (class(n), format!("N_B = {n}")));
        let plot = LogPlot {
            alt: self.alt,
            names: ["light paths per iteration, N_F", self.rms_name],
            ticks: [&|ends| decimal_ticks(ends, |n| light_paths_label(n, ends[1])), &|ends| {
                decimal_ticks(ends, |rms| rms_label(rms, top))
            }],
            curves,
            marks,
            legend: legend.chain([("minimum", label.clone())]).collect(),
        };
        plot.svg_with_style("noise-plot", STYLE)
    }
}

/// A number of light paths: with all digits if the axis ends below 100,000, else all numbers of the
/// axis as powers of ten.
fn light_paths_label(n: f64, end: f64) -> String {
    let n = n.round();
    if end < 1e5 { format!("{n:.0}") } else { format!("{n:e}") }
}

/// An RMS with the digits that a scale up to `top` needs.
pub fn rms_label(rms: f64, top: f64) -> String {
    let digits = 2.0 - top.log10().floor();
    if (0.0..=6.0).contains(&digits) {
        format!("{rms:.*}", digits as usize)
    } else {
        format!("{rms:.2e}")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn labels_of_an_axis_have_one_form() {
        let labels = |ends: [f64; 2]| {
            let ticks = decimal_ticks(ends, |n| light_paths_label(n, ends[1]));
            ticks.into_iter().map(|(_, label)| label).collect::<Vec<_>>()
        };
        assert_eq!(labels([90.0, 2e4]), ["100", "1000", "10000"]);
        assert_eq!(labels([900.0, 2e5]), ["1e3", "1e4", "1e5"]);
        assert!(labels([1.1e5, 2.6e5]).contains(&"1.4e5".to_owned()));
    }
}
