//! Luminous intensity distributions: the usual polar plot as SVG.

use bdpm_core::base::names::for_display;
use bdpm_core::image_io::{number, tick_step};
use bdpm_core::scene::IntensityDistribution;
use std::fmt::Write;

/// Steps of the curves, degrees.
const STEP: f64 = 0.1;

/// Width and height of the plot.
const SIZE: f64 = 480.0;
const MARGIN: f64 = 44.0;

/// A half-plane and its opposite: the intensity at an angle from the nadir, degrees, in (-180,
/// 180]. Positive angles are in the plane `c`, degrees, negative ones in `c` + 180.
fn profile(own: &IntensityDistribution, c: f64, angle: f64) -> f64 {
    let plane = if angle < 0.0 { c + 180.0 } else { c };
    own.intensity(own.direction(angle.abs().to_radians(), plane.to_radians()))
}

/// A complete SVG file: the intensity over the angle from the nadir, in the planes C0-C180 (solid)
/// and C90-C270 (dashed).
pub fn polar_plot(own: &IntensityDistribution, title: &str) -> String {
    let center = [0.5 * SIZE, 0.5 * SIZE];
    let radius = 0.5 * SIZE - MARGIN;
    let steps = (180.0 / STEP) as i32;
    let all = || (-steps..=steps).map(|step| f64::from(step) * STEP);
    let peak = [0.0, 90.0]
        .iter()
        .flat_map(|c| all().map(|angle| profile(own, *c, angle)))
        .fold(0.0, f64::max);
    let peak = if peak > 0.0 { peak } else { 1.0 };
    let ring = tick_step(peak, 5.0);
    let rings = (peak / ring - 1e-9).ceil().max(1.0);
    let scale = radius / (rings * ring);
    // The nadir is below, positive angles are to the right.
    let place = |angle: f64, intensity: f64| {
        let (sin, cos) = angle.to_radians().sin_cos();
        [center[0] + scale * intensity * sin, center[1] + scale * intensity * cos]
    };
    let title: String = for_display(title).chars().filter(|c| !"<>&".contains(*c)).collect();
    let mut svg = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {SIZE} {height}\" \
         font-family=\"sans-serif\" font-size=\"13\">\n<rect width=\"{SIZE}\" height=\"{height}\" \
         fill=\"white\"/>\n",
        height = SIZE + 24.0
    );
    // Writing to strings cannot fail.
    let mesh = "fill=\"none\" stroke=\"#bbb\"";
    for i in 1..=rings as u32 {
        let own = f64::from(i) * ring;
        let _ = writeln!(
            svg,
            "<circle cx=\"{}\" cy=\"{}\" r=\"{:.2}\" {mesh}/>\n<text x=\"{}\" y=\"{:.2}\">{}</text>",
            center[0],
            center[1],
            own * scale,
            center[0] + 3.0,
            center[1] + own * scale - 3.0,
            number(own)
        );
    }
    for angle in (-150..=180).step_by(30).map(f64::from) {
        let [x, y] = place(angle, rings * ring);
        let [tx, ty] = place(angle, (rings * ring) * (1.0 + 18.0 / radius));
        let _ = writeln!(
            svg,
            "<line x1=\"{}\" y1=\"{}\" x2=\"{x:.2}\" y2=\"{y:.2}\" {mesh}/>\n<text x=\"{tx:.2}\" \
             y=\"{:.2}\" text-anchor=\"middle\">{}°</text>",
            center[0],
            center[1],
            ty + 4.0,
            angle.abs()
        );
    }
    for (c, dashes) in [(0.0, ""), (90.0, " stroke-dasharray=\"6 4\"")] {
        let points: Vec<String> = all()
            .map(|angle| place(angle, profile(own, c, angle)))
            .map(|[x, y]| format!("{x:.2},{y:.2}"))
            .collect();
        let _ = writeln!(
            svg,
            "<polyline fill=\"none\" stroke=\"#b00020\" stroke-width=\"2\"{dashes} points=\"{}\"/>",
            points.join(" ")
        );
    }
    let _ = writeln!(
        svg,
        "<text x=\"{}\" y=\"{}\" text-anchor=\"middle\">{title}, cd: C0-C180 solid, C90-C270 \
         dashed</text>",
        center[0],
        SIZE + 12.0
    );
    svg + "</svg>\n"
}

#[cfg(test)]
mod tests {
    use super::*;
    use bdpm_core::scene::Photometry;
    use std::f64::consts::{PI, TAU};

    fn round(intensity: impl Fn(f64) -> f64) -> IntensityDistribution {
        let polar: Vec<f64> = (0..=360).map(|i| PI * f64::from(i) / 360.0).collect();
        let values = polar.iter().flat_map(|angle| [intensity(*angle); 2]).collect();
        IntensityDistribution::new(Photometry::C, polar, vec![0.0, TAU], values).unwrap()
    }

    #[test]
    fn polar_plot_has_rings_up_to_the_peak() {
        let svg = polar_plot(&round(|angle| 420.0 * angle.cos().max(0.0)), "a <lamp>");
        assert!(
            svg.starts_with("<svg") && svg.contains("a lamp, cd") && svg.contains(">500</text>")
        );
        assert_eq!(svg.matches("<polyline").count(), 2);
        assert!(!svg.contains("NaN"));
    }
}
