//! Plots with logarithmic axes, as SVG. A style sheet gives the colors and dashes of each class.

use maud::{Markup, PreEscaped, html};

/// Width and height, small enough that labels are readable on a phone.
const SIZE: [f64; 2] = [560.0, 360.0];

/// Margins for labels: left, right, top, bottom.
const MARGINS: [f64; 4] = [92.0, 18.0, 16.0, 56.0];

/// Distance between the lines of the legend, which is below the plot and covers no curve.
const LEGEND_LINE: f64 = 24.0;

/// Width of a character of the legend, about, and of the mark before its label with the space
/// around it.
const LEGEND_CHARACTER: f64 = 9.0;
const LEGEND_MARK: f64 = 44.0;

/// Maximum number of ticks of an axis.
const MAX_TICKS: usize = 6;

/// Minimum ratio of the ends of an axis.
const MIN_RATIO: f64 = 1.5;

/// Increasing numbers with their labels, for the ends of an axis. Those outside the axis and those
/// without room are left out.
pub type Ticks<'a> = &'a dyn Fn([f64; 2]) -> Vec<(f64, String)>;

/// A plot of positive numbers against positive numbers.
pub struct LogPlot<'a> {
    /// Text alternative of the plot.
    pub alt: &'a str,
    /// Name of each axis.
    pub names: [&'a str; 2],
    /// Ticks of each axis.
    pub ticks: [Ticks<'a>; 2],
    /// Curves, in the order of drawing.
    pub curves: Vec<Curve<'a>>,
    /// Marks, drawn over the curves.
    pub marks: Vec<Mark<'a>>,
    /// Class and label of each entry of the legend below the plot.
    pub legend: Vec<(&'a str, String)>,
}

/// Points that a line joins.
pub struct Curve<'a> {
    /// Class in the style sheet.
    pub class: &'a str,
    /// Points, from left to right.
    pub points: Vec<[f64; 2]>,
}

/// A point of interest.
pub struct Mark<'a> {
    /// Class in the style sheet.
    pub class: &'a str,
    /// Its place.
    pub at: [f64; 2],
}

/// One axis: its end values, and their coordinates in the picture.
struct Axis {
    ends: [f64; 2],
    coordinates: [f64; 2],
}

impl Axis {
    fn coordinate(&self, value: f64) -> f64 {
        let [low, high] = self.ends.map(f64::ln);
        let [from, to] = self.coordinates;
        from + (to - from) * (value.ln() - low) / (high - low)
    }

    /// The ticks inside the axis. If there are too many, every n-th of them.
    fn shown(&self, ticks: Ticks) -> Vec<(f64, String)> {
        let [low, high] = self.ends;
        let all = ticks(self.ends).into_iter();
        let inside: Vec<_> = all.filter(|(at, _)| (low..=high).contains(at)).collect();
        let step = inside.len().div_ceil(MAX_TICKS).max(1);
        inside.into_iter().step_by(step).collect()
    }
}

impl LogPlot<'_> {
    /// The SVG element, for pages that have styles for its classes. Points that are not positive
    /// and finite are left out; `None` if no point remains.
    pub fn svg(&self) -> Option<Markup> {
        self.draw(None, None)
    }

    /// The SVG element with a class and its style sheet, which is also a complete SVG file.
    pub fn svg_with_style(&self, class: &str, style: &str) -> Option<Markup> {
        self.draw(Some(class), Some(style))
    }

    fn draw(&self, class: Option<&str>, style: Option<&str>) -> Option<Markup> {
        let [left, right, top, bottom] = MARGINS;
        let [width, height] = SIZE;
        let x = Axis { ends: self.ends(0)?, coordinates: [left, width - right] };
        let y = Axis { ends: self.ends(1)?, coordinates: [height - bottom, top] };
        let at = |value: f64| format!("{value:.1}");
        let (legend, lines) = self.legend_places();
        let total = height + LEGEND_LINE * f64::from(lines);
        Some(html! {
            svg viewBox=(format!("0 0 {width} {total}")) role="img" aria-label=(self.alt)
                xmlns=[style.map(|_| "http://www.w3.org/2000/svg")] class=[class] {
                @if let Some(style) = style { style { (PreEscaped(style)) } }
                @for (value, label) in x.shown(self.ticks[0]) {
                    @let place = x.coordinate(value);
                    line .mesh x1=(at(place)) x2=(at(place)) y1=(at(top)) y2=(at(height - bottom)) {}
                    text x=(at(place)) y=(at(height - bottom + 20.0)) text-anchor="middle" { (label) }
                }
                @for (value, label) in y.shown(self.ticks[1]) {
                    @let place = y.coordinate(value);
                    line .mesh x1=(at(left)) x2=(at(width - right)) y1=(at(place)) y2=(at(place)) {}
                    text x=(at(left - 8.0)) y=(at(place + 5.0)) text-anchor="end" { (label) }
                }
                path .axis fill="none" d=(format!(
                    "M{left:.1},{top:.1} V{:.1} H{:.1}", height - bottom, width - right
                )) {}
                text .name x=(at(0.5 * (left + width - right))) y=(at(height - 8.0)) text-anchor="middle" {
                    (self.names[0])
                }
                text .name text-anchor="middle"
                    transform=(format!("translate(20 {:.1}) rotate(-90)", 0.5 * (top + height - bottom))) {
                    (self.names[1])
                }
                @for Curve { class, points } in &self.curves {
                    @let inside: Vec<_> = points.iter().filter(|point| is_shown(point)).collect();
                    @if inside.len() > 1 {
                        polyline class=(class) fill="none" points=(inside.iter().map(|[a, b]| {
                            format!("{:.1},{:.1}", x.coordinate(*a), y.coordinate(*b))
                        }).collect::<Vec<_>>().join(" ")) {}
                    }
                }
                @for Mark { class, at: [a, b] } in self.marks.iter().filter(|mark| is_shown(&mark.at)) {
                    circle class=(class) cx=(at(x.coordinate(*a))) cy=(at(y.coordinate(*b))) r="6" {}
                }
                @for ((class, label), (column, line)) in self.legend.iter().zip(&legend) {
                    @let place = height + LEGEND_LINE * (f64::from(*line) + 0.4);
                    circle class=(class) cx=(at(left + column + 8.0)) cy=(at(place)) r="6" {}
                    text x=(at(left + column + 22.0)) y=(at(place + 6.0)) { (label) }
                }
            }
        })
    }

    /// Distance from the left end of the plot and line of each entry of the legend, and the number
    /// of lines.
    fn legend_places(&self) -> (Vec<(f64, u32)>, u32) {
        let room = SIZE[0] - MARGINS[0] - MARGINS[1];
        let (mut column, mut line) = (0.0, 0);
        let place = |(_, label): &(&str, String)| {
            let width = LEGEND_MARK + LEGEND_CHARACTER * label.chars().count() as f64;
            if column > 0.0 && column + width > room {
                (column, line) = (0.0, line + 1);
            }
            column += width;
            (column - width, line)
        };
        let places: Vec<_> = self.legend.iter().map(place).collect();
        let lines = places.last().map_or(0, |(_, line)| line + 1);
        (places, lines)
    }

    /// The ends of an axis that contains all points.
    fn ends(&self, axis: usize) -> Option<[f64; 2]> {
        let points = self.curves.iter().flat_map(|curve| &curve.points);
        let all = points.chain(self.marks.iter().map(|mark| &mark.at));
        let shown = all.filter(|point| is_shown(point)).map(|point| point[axis]);
        let [low, high] = shown
            .fold([f64::INFINITY, 0.0f64], |[low, high], value| [low.min(value), high.max(value)]);
        if low > high {
            return None;
        }
        let spare = (MIN_RATIO / (high / low)).max(1.0).sqrt() * 1.06;
        Some([low / spare, high * spare])
    }
}

fn is_shown(point: &[f64; 2]) -> bool {
    point.iter().all(|value| *value > 0.0 && value.is_finite())
}

/// Ticks from `low` to `high`: powers of 10, or steps between them if these are fewer than 3.
pub fn decimal_ticks([low, high]: [f64; 2], label: impl Fn(f64) -> String) -> Vec<(f64, String)> {
    let decades = |values: &'static [f64]| {
        let (first, last) = (low.log10().floor() as i32, high.log10().ceil() as i32);
        let all = (first..=last).flat_map(move |n| values.iter().map(move |v| v * 10f64.powi(n)));
        all.filter(move |value| (low..=high).contains(value)).collect::<Vec<f64>>()
    };
    const FINE: &[f64] =
        &[1.0, 1.2, 1.4, 1.6, 1.8, 2.0, 2.5, 3.0, 3.5, 4.0, 5.0, 6.0, 7.0, 8.0, 9.0];
    const STEPS: [&[f64]; 4] = [&[1.0], &[1.0, 2.0, 5.0], &[1.0, 1.5, 2.0, 3.0, 5.0, 7.0], FINE];
    let enough = STEPS.into_iter().map(decades).find(|ticks| ticks.len() >= 3);
    let ticks = enough.unwrap_or_else(|| decades(FINE));
    ticks.into_iter().map(|value| (value, label(value))).collect()
}

/// Ticks of a time axis, seconds, in steps of a factor of 3 or less.
pub fn time_ticks([low, high]: [f64; 2]) -> Vec<(f64, String)> {
    const UNITS: [(f64, &str, f64); 5] = [
        (1e-3, "ms", 1000.0),
        (1.0, "s", 60.0),
        (60.0, "min", 60.0),
        (3600.0, "h", 24.0),
        (86400.0, "d", 1000.0),
    ];
    const STEPS: [&[f64]; 2] = [
        &[1.0, 3.0, 10.0, 30.0, 100.0, 300.0],
        &[
            1.0, 1.5, 2.0, 3.0, 4.0, 5.0, 7.0, 10.0, 15.0, 20.0, 30.0, 45.0, 100.0, 200.0, 300.0,
            500.0,
        ],
    ];
    let ticks = |steps: &'static [f64]| -> Vec<(f64, String)> {
        let of = |(unit, name, next): (f64, &'static str, f64)| {
            let steps = steps.iter().filter(move |step| **step < next);
            steps.map(move |step| (unit * step, format!("{step} {name}")))
        };
        let all = UNITS.into_iter().flat_map(of);
        all.filter(|(time, _)| (low..=high).contains(time)).collect()
    };
    let [coarse, fine] = STEPS.map(ticks);
    if coarse.len() < 3 { fine } else { coarse }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn plot(points: Vec<[f64; 2]>) -> Option<String> {
        let decimal = |ends: [f64; 2]| decimal_ticks(ends, |value| value.to_string());
        let plot = LogPlot {
            alt: "a < b",
            names: ["time", "error"],
            ticks: [&time_ticks, &decimal],
            curves: vec![Curve { class: "measured", points }],
            marks: Vec::new(),
            legend: Vec::new(),
        };
        plot.svg().map(|svg| svg.into_string())
    }

    #[test]
    fn power_law_is_a_straight_line() {
        let points = (0..5).map(|n| [4f64.powi(n), 2f64.powi(-n)]).collect();
        let svg = plot(points).unwrap();
        let line = svg.split("points=\"").nth(1).unwrap().split('"').next().unwrap();
        let places: Vec<Vec<f64>> = line
            .split(' ')
            .map(|pair| pair.split(',').map(|number| number.parse().unwrap()).collect())
            .collect();
        for three in places.windows(3) {
            let ends = three[0].iter().zip(&three[2]);
            for ((from, to), middle) in ends.zip(&three[1]) {
                assert!((from - 2.0 * middle + to).abs() < 0.3, "{places:?}");
            }
        }
        assert!(
            places.iter().all(|p| (92.0..=542.0).contains(&p[0]) && (12.0..=304.0).contains(&p[1]))
        );
        assert!(svg.contains("a &lt; b"));
    }

    #[test]
    fn legend_is_below_the_plot_in_lines_that_fit() {
        let decimal = |ends: [f64; 2]| decimal_ticks(ends, |value| value.to_string());
        let label = |n: usize| ("series", "x".repeat(n));
        let plot = LogPlot {
            alt: "",
            names: ["", ""],
            ticks: [&decimal, &decimal],
            curves: vec![Curve { class: "", points: vec![[1.0, 1.0], [2.0, 2.0]] }],
            marks: Vec::new(),
            legend: [8, 9, 40, 7].map(label).into(),
        };
        let (places, lines) = plot.legend_places();
        assert_eq!(places.iter().map(|(_, line)| *line).collect::<Vec<_>>(), [0, 0, 1, 2]);
        assert_eq!((lines, places[0].0, places[2].0, places[3].0), (3, 0.0, 0.0, 0.0));
        assert!(places[1].0 > 8.0 * LEGEND_CHARACTER);
        let svg = plot.svg().unwrap().into_string();
        assert!(svg.contains(&format!("0 0 560 {}", 360.0 + 3.0 * LEGEND_LINE)), "{svg}");
        for circle in svg.split("cy=\"").skip(1) {
            let y: f64 = circle.split('"').next().unwrap().parse().unwrap();
            assert!(y > SIZE[1], "{svg}");
        }
    }

    #[test]
    fn points_without_logarithm_are_left_out() {
        assert!(plot(vec![[0.0, 1.0], [1.0, -1.0], [f64::NAN, 1.0]]).is_none());
        let one = plot(vec![[1.0, 1.0], [2.0, f64::INFINITY]]).unwrap();
        assert!(!one.contains("NaN") && !one.contains("polyline"));
    }

    #[test]
    fn axis_of_any_range_has_ticks() {
        let count = |low: f64, high: f64| decimal_ticks([low, high], |v| v.to_string()).len();
        for (low, high) in [(1.0, 1.5), (0.013, 0.02), (0.9, 1.4), (1.0, 1e4), (0.3, 40.0)] {
            assert!((2..=15).contains(&count(low, high)), "{low} {high}: {}", count(low, high));
        }
        for (low, high) in [(0.02, 0.05), (1.0, 3.0), (10.0, 75.0), (3.0, 4000.0), (1e-3, 1e7)] {
            let ticks = time_ticks([low, high]);
            assert!(ticks.len() >= 2 && ticks.windows(2).all(|two| two[0].0 < two[1].0), "{low}");
        }
    }
}
