//! Discs of meters, which collect the photons that cross them.

use bdpm_core::scene::Meter;
use glam::Vec3;
use std::collections::HashMap;

/// Number of nested radii of each disc.
pub const RADII: usize = 5;

/// Ratio of neighboring radii.
pub const RATIO: f32 = 0.5;

/// Maximum difference of unit normals in a plane of discs.
const SAME_NORMAL: f32 = 1e-5;

/// Discs around meters, with their normals.
#[derive(Clone, Debug)]
pub struct MeterDiscs {
    /// Largest radius, scene units.
    radius: f32,
    planes: Vec<Plane>,
}

/// Discs in one plane, by square cells of the diameter.
#[derive(Clone, Debug)]
struct Plane {
    normal: Vec3,
    /// Product of the normal with the points of the plane.
    height: f32,
    axes: [Vec3; 2],
    /// Meters and their centers in the plane.
    cells: HashMap<[i32; 2], Vec<(u32, [f32; 2])>>,
}

impl MeterDiscs {
    /// Discs of this largest radius around the meters.
    pub fn new(meters: &[Meter], radius: f32) -> Self {
        let mut planes: Vec<Plane> = Vec::new();
        for (index, meter) in (0..).zip(meters) {
            let height = meter.normal.dot(meter.position);
            let tolerance = 1e-3 * radius;
            let is_same = |plane: &&mut Plane| {
                plane.normal.distance(meter.normal) < SAME_NORMAL
                    && (plane.height - height).abs() < tolerance
            };
            // Meters of a grid follow each other.
            let plane = match planes.iter_mut().rev().take(4).find(is_same) {
                Some(plane) => plane,
                None => {
                    let (x, y) = meter.normal.any_orthonormal_pair();
                    let cells = HashMap::new();
                    planes.push(Plane { normal: meter.normal, height, axes: [x, y], cells });
                    planes.last_mut().expect("just pushed")
                }
            };
            let center = plane.axes.map(|axis| axis.dot(meter.position));
            plane.cells.entry(cell(center, radius)).or_default().push((index, center));
        }
        Self { radius, planes }
    }

    /// Area of the disc of the nested radius of this number, from 0, scene units squared.
    pub fn area(&self, level: usize) -> f64 {
        let radius = f64::from(self.radius * RATIO.powi(level as i32));
        std::f64::consts::PI * radius * radius
    }

    /// Calls `crossed` with each meter whose disc a segment crosses against its normal, with the
    /// number of nested discs that it crosses, and with the distance. The segment starts at
    /// `origin` and has the length `end` along the unit vector `direction`.
    pub fn cross(
        &self,
        origin: Vec3,
        direction: Vec3,
        end: f32,
        mut crossed: impl FnMut(u32, usize, f32),
    ) {
        for plane in &self.planes {
            let slope = -plane.normal.dot(direction);
            let above = plane.normal.dot(origin) - plane.height;
            if slope <= 0.0 || above < 0.0 || above > slope * end {
                continue;
            }
            let distance = above / slope;
            let at = origin + distance * direction;
            let at = plane.axes.map(|axis| axis.dot(at));
            let middle = cell(at, self.radius);
            for x in -1..=1 {
                for y in -1..=1 {
                    let key = [middle[0].saturating_add(x), middle[1].saturating_add(y)];
                    for (meter, center) in plane.cells.get(&key).into_iter().flatten() {
                        let levels = self.levels((at[0] - center[0]).hypot(at[1] - center[1]));
                        if levels > 0 {
                            crossed(*meter, levels, distance);
                        }
                    }
                }
            }
        }
    }

    /// Number of nested discs that contain a point at this distance from their center.
    fn levels(&self, distance: f32) -> usize {
        (0..RADII).take_while(|level| distance < self.radius * RATIO.powi(*level as i32)).count()
    }
}

/// The cell of a point of a plane. Cells are as wide as the radius.
fn cell(point: [f32; 2], radius: f32) -> [i32; 2] {
    point.map(|x| (x / radius).floor() as i32)
}

#[cfg(test)]
mod tests {
    use super::*;
    use bdpm_core::base::rng::{Stream, StreamKey};

    /// Discs by cells against all discs one by one.
    #[test]
    fn segments_cross_the_same_discs_as_by_brute_force() {
        let mut rng = StreamKey::new(4, Stream::Test, 0).rng(0);
        let mut unit = || 2.0 * rng.next_1d() - 1.0;
        let mut meters = Vec::new();
        for index in 0..300 {
            let normal = if index < 200 { Vec3::Y } else { Vec3::new(unit(), unit(), unit()) };
            let height = if index < 200 { 0.25 } else { unit() };
            let position = Vec3::new(unit(), height, unit());
            meters.push(Meter::irradiance(position, normal).unwrap());
        }
        let radius = 0.2;
        let discs = MeterDiscs::new(&meters, radius);
        let mut count = 0;
        for _ in 0..2000 {
            let [from, to] = [(); 2].map(|()| Vec3::new(unit(), unit(), unit()));
            let (direction, end) = ((to - from).normalize(), from.distance(to));
            let mut found = Vec::new();
            discs.cross(from, direction, end, |meter, levels, _| found.push((meter, levels)));
            found.sort_unstable();
            let mut expected = Vec::new();
            for (index, meter) in (0..).zip(&meters) {
                let above = meter.normal.dot(from - meter.position);
                let below = meter.normal.dot(to - meter.position);
                if above > 1e-5 && below < -1e-5 {
                    let at = from + above / (above - below) * (to - from);
                    let distance = at.distance(meter.position);
                    let levels = [1.0, 0.5, 0.25, 0.125].map(|share| distance < share * radius);
                    let levels = levels.iter().filter(|is_inside| **is_inside).count();
                    expected.extend((levels > 0).then_some((index, levels)));
                }
            }
            // A crossing on the very edge may differ by rounding.
            let off = found.iter().filter(|own| !expected.contains(own)).count();
            assert!(off + found.len().abs_diff(expected.len()) <= 1, "{found:?} {expected:?}");
            count += expected.len();
        }
        assert!(count > 500, "{count}");
    }
}
