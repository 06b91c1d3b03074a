//! The environment: a map of radiance over directions, importance sampled.

use super::{Emission, LightSample, below_one};
use crate::base::math::{Bounds, Rgb, luminance, uniform_disc};
use crate::base::rng::Rng;
use glam::Vec3;
use std::f32::consts::{PI, TAU};

/// Radiance that arrives from each direction, uniform in each pixel of a latitude-longitude map. The first row is
/// around +y, the last row around -y. The middle column is toward -z, and columns continue toward +x.
#[derive(Clone, Debug, PartialEq)]
pub struct Environment {
    width: u32,
    height: u32,
    /// W/(m^2 sr), row by row.
    radiance: Vec<Rgb>,
    /// Rotation about +y, in full turns; counterclockwise seen from +y.
    turn: f32,
    /// Upper end of each row's interval of [0, 1].
    rows: Vec<f64>,
    /// Upper end of each pixel's interval of [0, 1] in its row, row by row.
    columns: Vec<f64>,
    /// Integral of the radiance over all directions, W/m^2.
    integral: Rgb,
    /// Center and radius of a sphere around the scene.
    center: Vec3,
    radius: f32,
}

impl Environment {
    /// An environment of `radiance`, W/(m^2 sr), row by row, rotated by `turn_deg` about +y.
    ///
    /// # Panics
    /// If the number of pixels is not `width * height`, or one is negative or not finite.
    pub fn new(width: u32, height: u32, radiance: Vec<Rgb>, turn_deg: f32) -> Self {
        assert_eq!(radiance.len(), width as usize * height as usize);
        assert!(radiance.iter().all(|r| r.is_finite() && r.min_element() >= 0.0));
        let mut environment = Self {
            width,
            height,
            radiance,
            turn: turn_deg / 360.0,
            rows: Vec::new(),
            columns: Vec::new(),
            integral: Rgb::ZERO,
            center: Vec3::ZERO,
            radius: 0.0,
        };
        let mut integral = glam::DVec3::ZERO;
        let mut columns = Vec::with_capacity(environment.radiance.len());
        let mut rows = Vec::with_capacity(height as usize);
        for row in 0..height {
            let solid_angle = environment.solid_angle(row);
            let fluxes = (0..width).map(|column| environment.pixel(column, row) * solid_angle);
            integral += fluxes.clone().map(|flux| flux.as_dvec3()).sum::<glam::DVec3>();
            let own = cumulative(fluxes.map(|flux| f64::from(luminance(flux))), &mut columns);
            rows.push(own);
        }
        environment.columns = columns;
        cumulative(rows.into_iter(), &mut environment.rows);
        environment.integral = integral.as_vec3();
        environment
    }

    /// Sets the sphere to one around `bounds`.
    pub(in crate::scene) fn enclose(&mut self, bounds: &Bounds) {
        self.center = bounds.center();
        self.radius = bounds.enclosing_radius();
    }

    /// Returns true if it emits no light.
    pub fn is_black(&self) -> bool {
        luminance(self.integral) <= 0.0
    }

    /// Integral of the radiance over all directions, W/m^2.
    pub fn integral(&self) -> Rgb {
        self.integral
    }

    /// Radiant power that meets the sphere around the scene, W.
    pub fn power(&self) -> Rgb {
        self.disc() * self.integral
    }

    /// Size, pixels and rotation, for a fingerprint.
    pub(crate) fn parts(&self) -> ([u32; 2], &[Rgb], f32) {
        ([self.width, self.height], &self.radiance, self.turn)
    }

    fn disc(&self) -> f32 {
        PI * self.radius * self.radius
    }

    fn pixel(&self, column: u32, row: u32) -> Rgb {
        self.radiance[row as usize * self.width as usize + column as usize]
    }

    /// Solid angle of a pixel in this row, sr.
    /// theory.md (15).
    fn solid_angle(&self, row: u32) -> f32 {
        // cos(a) - cos(b) without cancellation.
        let step = PI / self.height as f32;
        let middle = (row as f32 + 0.5) * step;
        TAU / self.width as f32 * 2.0 * middle.sin() * (0.5 * step).sin()
    }

    /// Radiance that arrives from a unit direction, W/(m^2 sr).
    pub fn radiance(&self, direction: Vec3) -> Rgb {
        let longitude = direction.x.atan2(-direction.z) / TAU + 0.5 + self.turn;
        let latitude = direction.y.clamp(-1.0, 1.0).acos() / PI;
        let index = |share: f32, count: u32| ((share * count as f32) as u32).min(count - 1);
        let column = index(longitude - longitude.floor(), self.width);
        self.pixel(column, index(latitude, self.height))
    }

    /// A direction in proportion to the luminance, from two uniform numbers. Also returns the radiance from there
    /// over the density, W/m^2, and one over the density, sr.
    /// theory.md (15).
    fn sample(&self, [u, v]: [f64; 2]) -> (Vec3, Rgb, f32) {
        let (row, prob_of_row, v) = choose(&self.rows, v);
        let first = row * self.width as usize;
        let (column, prob, u) = choose(&self.columns[first..first + self.width as usize], u);
        let index = first + column;
        let (column, row) = (column as u32, row as u32);
        // Uniform in solid angle: in longitude and in the cosine.
        let step = PI / self.height as f32;
        let [above, below] = [row, row + 1].map(|row| (row as f32 * step).cos());
        let y = above + v as f32 * (below - above);
        let longitude = TAU * ((column as f32 + u as f32) / self.width as f32 - 0.5 - self.turn);
        let across = (1.0 - y * y).max(0.0).sqrt();
        let (sin, cos) = longitude.sin_cos();
        let direction = Vec3::new(across * sin, y, -across * cos);
        let inverse_pdf_w = self.solid_angle(row) / (prob_of_row * prob) as f32;
        (direction, self.radiance[index] * inverse_pdf_w, inverse_pdf_w)
    }

    /// Starts a light path from four uniform numbers; the environment was chosen with probability `prob`.
    pub(super) fn emit(&self, prob: f32, [a, b, c, d]: [f64; 4]) -> Emission {
        let (toward, radiance, _) = self.sample([a, b]);
        let [u, v] = uniform_disc([c, d].map(below_one));
        let (right, up) = toward.any_orthonormal_pair();
        let origin = self.center + self.radius * (u * right + v * up + toward);
        Emission { origin, direction: -toward, flux: radiance * (self.disc() / prob) }
    }

    /// A direction to connect `position` with; the environment was chosen with probability `prob`.
    pub(super) fn connect(&self, position: Vec3, prob: f32, rng: &mut Rng) -> LightSample {
        let (wi, irradiance, inverse_pdf_w) = self.sample([rng.next_f64(), rng.next_f64()]);
        // Outside the sphere around the scene, for any position in it.
        let distance = 2.0 * self.radius + (position - self.center).length();
        LightSample {
            target: position + distance * wi,
            wi,
            irradiance: irradiance / prob,
            relative: 1.0,
            inverse_pdf_w: inverse_pdf_w / prob,
        }
    }
}

/// Appends the upper end of each weight's interval of [0, 1]; equal intervals if all weights are 0. Returns their sum.
fn cumulative(weights: impl ExactSizeIterator<Item = f64>, ends: &mut Vec<f64>) -> f64 {
    let (first, count, mut sum) = (ends.len(), weights.len(), 0.0);
    ends.extend(weights.map(|weight| {
        sum += weight;
        sum
    }));
    for (index, end) in ends[first..].iter_mut().enumerate() {
        *end = if sum > 0.0 { *end / sum } else { (index + 1) as f64 / count as f64 };
    }
    sum
}

/// The index whose interval contains `u` of [0, 1), its probability, and the position of `u` in it, in [0, 1].
fn choose(ends: &[f64], u: f64) -> (usize, f64, f64) {
    let index = ends.partition_point(|&end| end <= u).min(ends.len() - 1);
    let begin = if index == 0 { 0.0 } else { ends[index - 1] };
    let prob = ends[index] - begin;
    (index, prob, ((u - begin) / prob).clamp(0.0, 1.0))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::rng::{Stream, StreamKey};

    /// An environment of very different pixels.
    fn environment(turn_deg: f32) -> Environment {
        let (width, height) = (12, 7);
        let pixel = |i: u32| {
            let x = (i.wrapping_mul(2_654_435_761) >> 20) as f32 / 4096.0;
            Rgb::new(x, x * x, 0.3) * if i == 40 { 50.0 } else { 1.0 }
        };
        let mut map = Environment::new(width, height, (0..84).map(pixel).collect(), turn_deg);
        map.enclose(&Bounds { min: Vec3::ZERO, max: Vec3::new(2.0, 1.0, 3.0) });
        map
    }

    #[test]
    fn sampled_directions_have_their_pixels_radiance() {
        for turn in [0.0, 35.0, -400.0] {
            let map = environment(turn);
            let mut rng = StreamKey::new(7, Stream::Test, 0).rng(0);
            let (mut sum, mut square) = (Rgb::ZERO, Rgb::ZERO);
            let n = 100_000;
            let mut strayed = 0;
            for _ in 0..n {
                let (direction, value, inverse_pdf_w) =
                    map.sample([rng.next_f64(), rng.next_f64()]);
                let radiance = luminance(value) / inverse_pdf_w;
                assert!((direction.length() - 1.0).abs() < 1e-5);
                // In proportion to the luminance, which is therefore always the same.
                let share = luminance(value) / luminance(map.integral);
                assert!((share - 1.0).abs() < 1e-3, "{share}");
                // The color is that of the pixel in this direction, but for rounding at its edges.
                let ratio = map.radiance(direction) / luminance(map.radiance(direction));
                let same = (ratio * luminance(value) - value).abs().max_element()
                    < 1e-3 * value.max_element();
                let seen = luminance(map.radiance(direction));
                strayed += u32::from(!same || (radiance / seen - 1.0).abs() > 1e-3);
                sum += value / n as f32;
                square += value * value / n as f32;
            }
            assert!(strayed < 20, "{strayed}");
            let error = ((square - sum * sum) / n as f32).max(Rgb::ZERO).map(f32::sqrt);
            let off = (sum - map.integral).abs();
            assert!(off.cmple(4.0 * error + 1e-3 * map.integral).all(), "{sum} {}", map.integral);
        }
    }

    #[test]
    fn integral_matches_midpoint_rule_over_all_directions() {
        // By midpoints over the sphere, independent of the pixels' solid angles.
        let map = environment(35.0);
        let (n, mut sum) = (1200, glam::DVec3::ZERO);
        for i in 0..n {
            let y = 2.0 * (i as f32 + 0.5) / n as f32 - 1.0;
            for j in 0..n {
                let (sin, cos) = (TAU * (j as f32 + 0.5) / n as f32).sin_cos();
                let across = (1.0 - y * y).sqrt();
                let direction = Vec3::new(across * sin, y, across * cos);
                sum += map.radiance(direction).as_dvec3();
            }
        }
        let found = sum * 4.0 * std::f64::consts::PI / f64::from(n * n);
        let off = (found.as_vec3() / map.integral - Rgb::ONE).abs().max_element();
        // The bright pixel is 0.4 high in y: of its edges a midpoint rule misses up to 1/600 each.
        assert!(off < 5e-3, "{off}");
    }

    #[test]
    fn columns_and_rows_have_their_documented_directions() {
        // One bright pixel of 8 by 4 at a time.
        for (index, direction) in [
            (3, Vec3::new(-0.1, 0.99, -0.1)),
            (4 + 8, Vec3::new(0.2, 0.3, -1.0)),
            (6 + 8, Vec3::new(1.0, 0.3, 0.2)),
            (1 + 16, Vec3::new(-1.0, -0.3, 0.2)),
            (24, Vec3::new(-0.1, -0.99, 0.2)),
        ] {
            let mut pixels = vec![Rgb::ZERO; 32];
            pixels[index] = Rgb::ONE;
            let map = Environment::new(8, 4, pixels.clone(), 0.0);
            assert_eq!(map.radiance(direction.normalize()), Rgb::ONE, "{index}");
            // Turned counterclockwise by a quarter, what was ahead (-z) is on the left (-x).
            let turned = Environment::new(8, 4, pixels, 90.0);
            let Vec3 { x, y, z } = direction;
            assert_eq!(turned.radiance(Vec3::new(z, y, -x).normalize()), Rgb::ONE, "{index}");
        }
    }

    #[test]
    fn light_paths_carry_the_power_through_the_sphere() {
        let map = environment(10.0);
        let mut rng = StreamKey::new(8, Stream::Test, 0).rng(0);
        let n = 20_000;
        for _ in 0..n {
            let Emission { origin, direction, flux } =
                map.emit(0.25, [(); 4].map(|()| rng.next_f64()));
            let share = 0.25 * luminance(flux) / luminance(map.power());
            assert!((share - 1.0).abs() < 1e-3, "{share}");
            let from_center = origin - map.center;
            assert!((from_center.dot(direction) + map.radius).abs() < 1e-4);
            let axis = from_center - from_center.dot(direction) * direction;
            assert!(axis.length() <= map.radius * 1.0001);
            let sample = map.connect(Vec3::splat(0.5), 0.25, &mut rng);
            assert!((sample.target - map.center).length() > map.radius);
        }
    }
}
