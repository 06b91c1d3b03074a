//! Figure 4: RMS after a time against the number of light paths, as SVG that takes its colors from
//! the page.

use crate::paper::published::{TABLE_1_CAMERA_PATHS, TABLE_2};
use plotters::coord::Shift;
use plotters::prelude::*;
use std::error::Error as Failure;
use std::fmt;

/// Width and height; narrow, so that labels are readable on a phone.
const SIZE: (u32, u32) = (560, 440);

/// Text and axes; the style sheet replaces it in the dark.
pub const INK: RGBColor = RGBColor(17, 17, 17);

/// Lines of the mesh; the style sheet replaces it in the dark.
pub const MESH: RGBColor = RGBColor(221, 221, 221);

/// One for each number of camera paths: colors that color-blind people can tell apart (Okabe and Ito
/// 2008).
pub const COLORS: [RGBColor; 4] =
    [RGBColor(0, 114, 178), RGBColor(213, 94, 0), RGBColor(0, 158, 115), RGBColor(204, 121, 167)];

/// What a plot shows; RMS over the least one.
pub struct Plot<'a> {
    /// RMS by formula at a number of light paths and of camera paths.
    pub curve: &'a dyn Fn(f64, u32) -> f64,
    /// IterationSet of camera paths that have a curve.
    pub curves: &'a [u32],
    /// `N_F`, `N_B`, the RMS and its standard error.
    pub points: &'a [(f64, u32, f64, f64)],
    /// `N_F` of the least RMS.
    pub minimum: f64,
    /// Largest RMS that is shown.
    pub top: f64,
}

/// Which color and shape a number of camera paths has.
pub fn index(n_camera: u32) -> usize {
    TABLE_1_CAMERA_PATHS.iter().position(|&n| n == n_camera).unwrap_or(0)
}

impl Plot<'_> {
    /// The SVG element.
    ///
    /// # Panics
    /// If numbers are not finite.
    pub fn svg(&self) -> String {
        let mut svg = String::new();
        let root = SVGBackend::with_string(&mut svg, SIZE).into_drawing_area();
        self.draw(&root).expect("drawing to memory does not fail");
        drop(root);
        svg
    }

    fn draw<B: DrawingBackend>(&self, root: &DrawingArea<B, Shift>) -> Result<(), Box<dyn Failure>>
    where
        B::ErrorType: 'static,
    {
        let (least, most) = (80.0, f64::from(TABLE_2[TABLE_2.len() - 1].light_paths) * 1.3);
        let mut chart = ChartBuilder::on(root)
            .margin(8)
            .margin_right(20)
            .x_label_area_size(58)
            .y_label_area_size(62)
            .build_cartesian_2d((least..most).log_scale(), 0.95..self.top)?;
        chart
            .configure_mesh()
            .x_desc("light paths per iteration, N_F")
            .y_desc("RMS over the least")
            .label_style(("sans-serif", 18, &INK))
            .axis_desc_style(("sans-serif", 19, &INK))
            .axis_style(INK)
            .x_label_formatter(&|n| power_of_ten(*n))
            .y_label_formatter(&|rms| format!("{rms:.1}"))
            .y_labels(6)
            .max_light_lines(0)
            .bold_line_style(MESH)
            .draw()?;
        for &n_camera in self.curves {
            let color = COLORS[index(n_camera)];
            let step = |i: u32| least * (most / least).powf(f64::from(i) / 100.0);
            let points = (0..=100).map(|i| (step(i), (self.curve)(step(i), n_camera)));
            let inside = points.filter(|(_, rms)| *rms <= self.top);
            chart.draw_series(LineSeries::new(inside, color.stroke_width(2)))?;
        }
        for &(n_light, n_camera, rms, error) in self.points.iter().filter(|p| p.2 <= self.top) {
            let style = COLORS[index(n_camera)].stroke_width(2);
            let (low, high) = ((rms - error).max(0.95), (rms + error).min(self.top));
            let bar = ErrorBar::new_vertical(n_light, low, rms, high, style.filled(), 0);
            chart.draw_series([bar])?;
            let at = (n_light, rms);
            match index(n_camera) {
                0 => chart.draw_series([Circle::new(at, 5, style)])?,
                1 => chart.draw_series([TriangleMarker::new(at, 7, style)])?,
                2 => chart.draw_series([Circle::new(at, 5, style.filled())])?,
                _ => chart.draw_series([Cross::new(at, 5, style)])?,
            };
        }
        let n_camera = TABLE_1_CAMERA_PATHS[2];
        let marked = (self.minimum, (self.curve)(self.minimum, n_camera));
        chart.draw_series([Circle::new(marked, 10, INK.stroke_width(2))])?;
        chart.draw_series([PathElement::new(
            [(self.minimum, 0.95), (self.minimum, marked.1)],
            INK.stroke_width(1),
        )])?;
        root.present()?;
        Ok(())
    }
}

fn power_of_ten(n: f64) -> String {
    if n < 1e4 { format!("{n:.0}") } else { format!("{n:.0e}") }
}

/// The marker of a number of camera paths, as in the plot, for the legend.
pub struct Marker(pub u32);

impl fmt::Display for Marker {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let RGBColor(r, g, b) = COLORS[index(self.0)];
        let color = format!("#{r:02X}{g:02X}{b:02X}");
        let shape = match index(self.0) {
            0 => format!(r#"<circle cx="16" cy="8" r="5" fill="none" stroke="{color}"/>"#),
            1 => format!(r#"<polygon points="16,2 22,13 10,13" fill="none" stroke="{color}"/>"#),
            2 => format!(r#"<circle cx="16" cy="8" r="5" fill="{color}" stroke="{color}"/>"#),
            _ => format!(r#"<path d="M11,3 21,13 M21,3 11,13" stroke="{color}"/>"#),
        };
        write!(
            f,
            r#"<svg class="marker" width="32" height="16" viewBox="0 0 32 16" stroke-width="2" aria-hidden="true"><path d="M0,8 H32" stroke="{color}"/>{shape}</svg>"#
        )
    }
}
