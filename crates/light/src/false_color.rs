//! Maps of a quantity in false colors with a legend, as PNG.
//!
//! The map knows nothing about the renderer: it shows a grid of numbers with a unit.

use bdpm_core::base::error::Result;
use bdpm_core::image_io::{Canvas, number, tick_step};
use colorgrad::Gradient;
use std::path::Path;

/// Minimum of pixels along the longer side of a map; smaller grids are magnified.
const SIDE: u32 = 512;
const MARGIN: u32 = 12;
/// Breadth of the legend's bar, pixels.
const BAR: u32 = 20;
/// Characters of the numbers beside a vertical axis.
const AXIS_CHARACTERS: u32 = 6;
/// Color of cells without a number.
const MISSING: [u8; 3] = [128; 3];
/// Share of the positive values that a range covers on either side.
const COVERED: f64 = 0.995;
/// This share of a logarithmic scale, which shows much brighter values at little cost.
const COVERED_BY_DECADES: f64 = 0.998;
/// Decades of the longest logarithmic range that is chosen.
const DECADES: f64 = 4.0;

/// Numbers row by row from the top left. Cells without a number are NaN.
#[derive(Clone, Copy, Debug)]
pub struct ValueGrid<'a> {
    width: u32,
    height: u32,
    values: &'a [f64],
}

impl<'a> ValueGrid<'a> {
    /// A grid of `width * height` values.
    ///
    /// # Panics
    /// If their number differs.
    pub fn new(width: u32, height: u32, values: &'a [f64]) -> Self {
        assert_eq!(values.len(), width as usize * height as usize, "one value per cell");
        Self { width, height, values }
    }

    /// Cells across and down.
    pub fn size(&self) -> [u32; 2] {
        [self.width, self.height]
    }

    /// Value of a cell.
    pub fn at(&self, x: u32, y: u32) -> f64 {
        self.values[y as usize * self.width as usize + x as usize]
    }
}

/// Assignment of colors to numbers.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum ColorScale {
    /// Even steps from the first number to the second.
    Linear([f64; 2]),
    /// Even ratios from the first number, which is above 0, to the second.
    Logarithmic([f64; 2]),
}

impl ColorScale {
    /// From 0 to a value that nearly all cells do not exceed.
    pub fn linear(grid: ValueGrid) -> Self {
        let positive = sorted_positive(grid);
        Self::Linear([0.0, at_share(&positive, COVERED).unwrap_or(1.0)])
    }

    /// Over nearly all positive values, one to four decades. Small bright lamps are shown as well.
    pub fn logarithmic(grid: ValueGrid) -> Self {
        let positive = sorted_positive(grid);
        let high = at_share(&positive, COVERED_BY_DECADES).unwrap_or(1.0);
        let low = at_share(&positive, 1.0 - COVERED).unwrap_or(0.1);
        Self::Logarithmic([low.clamp(high * 10f64.powf(-DECADES), 0.1 * high), high])
    }

    /// Both ends.
    pub fn range(&self) -> [f64; 2] {
        match *self {
            Self::Linear(range) | Self::Logarithmic(range) => range,
        }
    }

    /// Place of a number on the scale: 0 and 1 at its ends.
    pub fn share(&self, value: f64) -> f64 {
        match *self {
            Self::Linear([low, high]) => (value - low) / (high - low),
            Self::Logarithmic([low, high]) => (value / low).ln() / (high / low).ln(),
        }
    }

    /// Round numbers along the scale, ascending.
    pub fn ticks(&self) -> Vec<f64> {
        match *self {
            Self::Linear([low, high]) => {
                let step = tick_step(high - low, 10.0);
                let first = (low / step - 1e-9).ceil() as i64;
                let last = (high / step + 1e-9).floor() as i64;
                (first..=last).map(|tick| tick as f64 * step).collect()
            }
            Self::Logarithmic([low, high]) => {
                let decades = low.log10().floor() as i32..=high.log10().ceil() as i32;
                let factors: &[f64] = if high / low > 1e3 { &[1.0, 3.0] } else { &[1.0, 2.0, 5.0] };
                let all = decades.flat_map(|decade| {
                    factors.iter().map(move |factor| factor * 10f64.powi(decade))
                });
                all.filter(|tick| (low * (1.0 - 1e-9)..=high * (1.0 + 1e-9)).contains(tick))
                    .collect()
            }
        }
    }
}

fn sorted_positive(grid: ValueGrid) -> Vec<f64> {
    let mut positive: Vec<f64> =
        grid.values.iter().copied().filter(|value| *value > 0.0 && value.is_finite()).collect();
    positive.sort_unstable_by(f64::total_cmp);
    positive
}

fn at_share(sorted: &[f64], share: f64) -> Option<f64> {
    sorted.get((share * sorted.len().saturating_sub(1) as f64).round() as usize).copied()
}

/// Color of a place on the scale, sRGB: dark blue at 0, yellow at 1 (turbo).
pub fn color(share: f64) -> [u8; 3] {
    if share.is_nan() {
        return MISSING;
    }
    let [r, g, b, _] = colorgrad::preset::turbo().at(share.clamp(0.0, 1.0) as f32).to_rgba8();
    [r, g, b]
}

/// A map with its captions.
#[derive(Clone, Debug)]
pub struct FalseColorMap<'a> {
    /// The numbers.
    pub grid: ValueGrid<'a>,
    /// Colors of the numbers.
    pub scale: ColorScale,
    /// Unit of the numbers, for the legend.
    pub unit: &'a str,
    /// Lines below the map.
    pub captions: &'a [String],
    /// Size of a cell across and down, meters: the map has these proportions and axes from its
    /// corner. Without it cells are square.
    pub cell: Option<[f64; 2]>,
}

impl FalseColorMap<'_> {
    /// Writes the map with a legend beside it and the captions below.
    ///
    /// # Errors
    /// If the file cannot be written; names it.
    pub fn write_png(&self, path: &Path) -> Result<()> {
        self.canvas().write_png(path)
    }

    /// Pixels of a cell across and down.
    fn magnification(&self) -> [u32; 2] {
        let size = self.grid.size();
        let cell = self.cell.unwrap_or([1.0; 2]);
        let side = |axis: usize| f64::from(size[axis]) * cell[axis];
        let scale = f64::from(SIDE) / side(0).max(side(1));
        let rounded = cell.map(|own| (scale * own).round().max(1.0) as u32);
        // Square cells stay so.
        if cell[0] == cell[1] { [SIDE.div_ceil(size[0].max(size[1])).max(1); 2] } else { rounded }
    }

    fn canvas(&self) -> Canvas {
        let Self { grid, scale, unit, captions, cell } = self;
        let [columns, rows] = grid.size();
        let [across, down] = self.magnification();
        let [width, height] = [columns * across, rows * down];
        let plot_height = height.max(12 * Canvas::LINE);
        let labels = 12 * Canvas::CHARACTER;
        // Room for the numbers of the axes
        let [beside_axis, below_axis] = match cell {
            Some(_) => [AXIS_CHARACTERS * Canvas::CHARACTER, Canvas::LINE],
            None => [0; 2],
        };
        let corner = (MARGIN + beside_axis, MARGIN + Canvas::LINE);
        let text = captions.iter().map(|line| line.chars().count() as u32).max().unwrap_or(0);
        let beside = 3 * MARGIN + BAR + labels;
        let full = (beside_axis + width + beside).max(text * Canvas::CHARACTER + 2 * MARGIN);
        let lines = captions.len() as u32 * Canvas::LINE;
        let below = corner.1 + plot_height.max(height + below_axis) + MARGIN;
        let mut canvas = Canvas::new(full, below + lines + MARGIN, [255; 3]);
        for y in 0..rows {
            for x in 0..columns {
                let place = (corner.0 + x * across, corner.1 + y * down);
                let color = color(scale.share(grid.at(x, y)));
                canvas.fill(place, (across, down), color);
            }
        }
        if let Some([cell_width, cell_height]) = cell {
            let extent = [width, height];
            let meter = [f64::from(across) / cell_width, f64::from(down) / cell_height];
            axes(&mut canvas, corner, extent, meter);
        }
        let left = corner.0 + width + MARGIN;
        canvas.text((left, MARGIN), unit);
        for y in 0..plot_height {
            let share = 1.0 - (f64::from(y) + 0.5) / f64::from(plot_height);
            canvas.fill((left, corner.1 + y), (BAR, 1), color(share));
        }
        for value in scale.ticks() {
            let share = scale.share(value).clamp(0.0, 1.0);
            let y = corner.1 + ((1.0 - share) * f64::from(plot_height - 1)).round() as u32;
            canvas.fill((left + BAR, y), (5, 1), [0; 3]);
            canvas.text((left + BAR + 9, y.saturating_sub(8)), &number(value));
        }
        for (line, caption) in (0..).zip(*captions) {
            canvas.text((MARGIN, below + line * Canvas::LINE), caption);
        }
        canvas
    }
}

/// Ticks with numbers of meters below a map and to its left, from its corner at the top left.
/// `meter` are the pixels of a meter across and down.
fn axes(canvas: &mut Canvas, corner: (u32, u32), extent: [u32; 2], meter: [f64; 2]) {
    const TICK: u32 = 5;
    let ticks = |axis: usize| {
        let length = f64::from(extent[axis]) / meter[axis];
        // Numbers do not touch each other.
        let step = tick_step(length, (f64::from(extent[axis]) / 60.0).clamp(1.0, 5.0));
        let last = (length / step + 1e-9).floor() as u32;
        (0..=last).map(move |tick| {
            let value = f64::from(tick) * step;
            (value, (value * meter[axis]).round() as u32)
        })
    };
    canvas.text((MARGIN, MARGIN), "m");
    for (value, x) in ticks(0) {
        let (label, bottom) = (number(value), corner.1 + extent[1]);
        let half = label.chars().count() as u32 * Canvas::CHARACTER / 2;
        canvas.fill((corner.0 + x, bottom), (1, TICK), [0; 3]);
        canvas.text((corner.0 + x - half, bottom + TICK), &label);
    }
    for (value, y) in ticks(1) {
        let label = number(value);
        let wide = label.chars().count() as u32 * Canvas::CHARACTER;
        let right = corner.0 - TICK - 2;
        canvas.fill((corner.0 - TICK, corner.1 + y), (TICK, 1), [0; 3]);
        canvas.text((right.saturating_sub(wide), (corner.1 + y).saturating_sub(8)), &label);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn scales_place_their_ends_at_0_and_1_and_have_round_ticks() {
        let linear = ColorScale::Linear([0.0, 420.0]);
        assert_eq!(linear.ticks(), [0.0, 50.0, 100.0, 150.0, 200.0, 250.0, 300.0, 350.0, 400.0]);
        assert_eq!([0.0, 210.0, 420.0].map(|x| linear.share(x)), [0.0, 0.5, 1.0]);
        let logarithmic = ColorScale::Logarithmic([1.0, 100.0]);
        let ticks = logarithmic.ticks();
        assert_eq!(ticks.len(), 7);
        assert!((ticks[3] - 10.0).abs() < 1e-9 && (logarithmic.share(10.0) - 0.5).abs() < 1e-12);
    }

    #[test]
    fn chosen_ranges_leave_out_rare_values() {
        let mut values: Vec<f64> = (1..=1000).map(f64::from).collect();
        values[0] = 1e9;
        values[1] = f64::NAN;
        let grid = ValueGrid::new(100, 10, &values);
        let [low, high] = ColorScale::linear(grid).range();
        assert!(low == 0.0 && (990.0..=1000.0).contains(&high), "{high}");
        let [low, high] = ColorScale::logarithmic(grid).range();
        assert!((3.0..15.0).contains(&low) && (990.0..=1000.0).contains(&high), "{low} {high}");
        let nothing = ValueGrid::new(1, 1, &[0.0]);
        assert_eq!(ColorScale::linear(nothing).range(), [0.0, 1.0]);
        assert_eq!(ColorScale::logarithmic(nothing).range(), [0.1, 1.0]);
    }

    #[test]
    fn maps_show_values_in_the_colors_of_their_legend() {
        let values = [0.0, 100.0, f64::NAN, 50.0];
        let map = FalseColorMap {
            grid: ValueGrid::new(2, 2, &values),
            scale: ColorScale::Linear([0.0, 100.0]),
            unit: "lx",
            captions: &["a caption".into()],
            cell: None,
        };
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("map.png");
        map.write_png(&path).unwrap();
        let picture = image::open(&path).unwrap().to_rgb8();
        let top = MARGIN + Canvas::LINE;
        let cell = |x: u32, y: u32| picture.get_pixel(MARGIN + 256 * x + 9, top + 256 * y + 9).0;
        assert_eq!([cell(0, 0), cell(1, 0)], [color(0.0), color(1.0)]);
        assert_eq!([cell(0, 1), cell(1, 1)], [MISSING, color(0.5)]);
        // The middle of the bar
        assert_eq!(picture.get_pixel(2 * MARGIN + 512 + 3, top + 255).0, color(0.5 + 0.5 / 512.0));
    }

    #[test]
    fn maps_of_a_plane_have_its_proportions_and_axes_in_meters() {
        let values = [0.0, 100.0];
        let map = FalseColorMap {
            grid: ValueGrid::new(2, 1, &values),
            scale: ColorScale::Linear([0.0, 100.0]),
            unit: "lx",
            captions: &[],
            // Four meters by half a meter
            cell: Some([2.0, 0.5]),
        };
        assert_eq!(map.magnification(), [256, 64]);
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("map.png");
        map.write_png(&path).unwrap();
        let picture = image::open(&path).unwrap().to_rgb8();
        let (x, y) = (MARGIN + AXIS_CHARACTERS * Canvas::CHARACTER, MARGIN + Canvas::LINE);
        let seen = |right: u32, down: u32| picture.get_pixel(x + right, y + down).0;
        assert_eq!([seen(9, 60), seen(265, 60)], [color(0.0), color(1.0)]);
        // Ticks below the map at each meter, and none between
        let is_tick = |right| seen(right, 64 + 2) == [0; 3];
        assert_eq!([0, 64, 128, 384, 512].map(is_tick), [true, false, true, true, true]);
    }
}
