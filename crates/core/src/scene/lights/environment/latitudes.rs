//! Latitudes from which an environment shines.

use super::Environment;
use crate::base::math::Rgb;
use std::f32::consts::PI;

impl Environment {
    /// Intervals of the polar angle from +y, radians, outside of which the environment is black.
    pub fn lit_latitudes(&self) -> Vec<[f32; 2]> {
        let (width, height) = (self.width as usize, self.height as usize);
        let pixels = self.pixels[..width * height].chunks_exact(width);
        let is_lit = |pixel: &super::Pixel| pixel.radiance != Rgb::ZERO;
        let mut lit: Vec<bool> = pixels.map(|row| row.iter().any(is_lit)).collect();
        if let Some(grid) = self.inset
            && self.pixels[width * height..].iter().any(is_lit)
        {
            let first = grid.first[1] as usize;
            lit[first..first + grid.replaced[1] as usize].fill(true);
        }
        let angle = |row: usize| row as f32 * PI / height as f32;
        let mut intervals: Vec<[f32; 2]> = Vec::new();
        let mut previous = None;
        for (row, _) in lit.iter().enumerate().filter(|(_, lit)| **lit) {
            match intervals.last_mut().filter(|_| row > 0 && previous == Some(row - 1)) {
                Some(last) => last[1] = angle(row + 1),
                None => intervals.push([angle(row), angle(row + 1)]),
            }
            previous = Some(row);
        }
        intervals
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn dark_rows_are_in_no_interval() {
        let mut pixels = vec![Rgb::ZERO; 8 * 4];
        assert!(Environment::new(8, 4, pixels.clone(), 0.0).lit_latitudes().is_empty());
        pixels[3] = Rgb::ONE;
        pixels[8 + 5] = Rgb::ONE;
        pixels[3 * 8] = Rgb::ONE;
        let lit = Environment::new(8, 4, pixels, 0.0).lit_latitudes();
        let expected = [[0.0, PI / 2.0], [0.75 * PI, PI]];
        assert_eq!(lit.len(), 2, "{lit:?}");
        for (own, expected) in lit.iter().flatten().zip(expected.iter().flatten()) {
            assert!((own - expected).abs() < 1e-6, "{lit:?}");
        }
    }
}
