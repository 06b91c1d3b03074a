//! Meters: points in a scene whose illuminance or luminance is measured. They take the place of the
//! camera: each is a pixel, whose camera paths start at it.

use super::transform::normalized;
use super::{Scene, View};
use crate::accel::Ray;
use crate::base::error::{Error, Result};
use crate::base::math::{Frame, cosine_hemisphere};
use crate::base::names::for_display;
use glam::Vec3;
use serde::Serialize;
use std::f32::consts::{PI, TAU};

/// The quantity that a set of meters measures.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize)]
pub enum MeterKind {
    /// Irradiance on a plane: the pixel's value is `pi` times the mean radiance over
    /// cosine-distributed directions of the hemisphere around the normal, W/m^2. Light that arrives
    /// straight from a light source is connected.
    Irradiance,
    /// Mean radiance over a cone, W/(m^2 sr).
    Radiance,
}

/// A meter.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Meter {
    /// Position, scene units. A point on a surface measures the light that arrives at the surface.
    pub position: Vec3,
    /// Unit normal of the plane, or unit axis of the cone.
    pub normal: Vec3,
    /// Half of the opening angle of the cone, radians; 0 is a single direction. Unused for
    /// irradiance.
    pub half_angle: f32,
}

impl Meter {
    /// A meter for irradiance at a position, on the side of the plane of this normal.
    ///
    /// # Errors
    /// If the position is not finite, or the normal has no direction.
    pub fn irradiance(position: Vec3, normal: Vec3) -> Result<Self> {
        Self::radiance(position, normal, 0.0)
    }

    /// A meter for radiance at a position, in a cone around a direction with this half opening
    /// angle, radians.
    ///
    /// # Errors
    /// If the position is not finite, the direction has none, or the angle is not in [0, pi].
    pub fn radiance(position: Vec3, direction: Vec3, half_angle: f32) -> Result<Self> {
        let normal = normalized(direction);
        if !position.is_finite() || normal == Vec3::ZERO {
            let problem = format!("a meter is at {position} and faces {direction}");
            return Err(Error::new(
                problem,
                "give finite numbers, and a direction that is not zero",
            ));
        }
        if !(0.0..=PI).contains(&half_angle) {
            let problem =
                format!("a meter's half opening angle is {} degrees", half_angle.to_degrees());
            return Err(Error::new(problem, "give an opening angle from 0 to 360 degrees"));
        }
        Ok(Self { position, normal, half_angle })
    }

    /// A ray from the meter toward the light that it measures, and the weight of its radiance.
    /// theory.md (5a), (5b)
    fn ray(&self, kind: MeterKind, u: [f32; 2]) -> (Ray, f32) {
        match kind {
            MeterKind::Irradiance => {
                (Ray::new(self.position, cosine_hemisphere(self.normal, u)), PI)
            }
            MeterKind::Radiance => {
                let cos = 1.0 - u[0] * (1.0 - self.half_angle.cos());
                let sin = (1.0 - cos * cos).max(0.0).sqrt();
                let (y, x) = (TAU * u[1]).sin_cos();
                let local = Vec3::new(sin * x, sin * y, cos);
                let direction = Frame::new(self.normal).to_world(local).normalize();
                (Ray::new(self.position, direction), 1.0)
            }
        }
    }
}

/// The meters of a scene.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Meters {
    /// Quantity that all of them measure.
    pub kind: MeterKind,
    /// At least one. Meter `i` is the pixel in column `i` of an image of one row.
    pub list: Vec<Meter>,
    /// True if the scene may have clear panes, through which meters are connected with lights.
    pub(crate) may_have_panes: bool,
}

impl Meters {
    /// The meter of a point of the image. Images that only sample the scene may have other widths:
    /// they repeat meters.
    pub(crate) fn at(&self, view: &View, x: f32, y: f32) -> &Meter {
        let [column, _] = view.full_image_point(x, y);
        &self.list[column as usize % self.list.len()]
    }
}

/// What a set of meters must have, and how it is judged.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Requirement {
    /// Least mean over the set after the maintenance factor, lx or cd/m^2.
    pub mean: Option<f64>,
    /// Least value of each meter after the maintenance factor, lx or cd/m^2.
    pub minimum: Option<f64>,
    /// Least uniformity `U_0`, the minimum over the mean.
    pub uniformity: Option<f64>,
    /// Least diversity `U_d`, the minimum over the maximum.
    pub diversity: Option<f64>,
    /// Most that the unified glare rating of an eye at each meter, which looks along its normal,
    /// may be.
    pub ugr: Option<f64>,
    /// Daylight factors that half of the points and 95 % of them must have, percent (EN 17037).
    pub daylight_factor: Option<[f64; 2]>,
    /// Light at the time of maintenance over that of the new installation, in (0, 1].
    pub maintenance: f64,
}

impl Default for Requirement {
    fn default() -> Self {
        Self {
            mean: None,
            minimum: None,
            uniformity: None,
            diversity: None,
            ugr: None,
            daylight_factor: None,
            maintenance: 1.0,
        }
    }
}

impl Requirement {
    /// Returns the requirement.
    ///
    /// # Errors
    /// If a number is not one that light can have.
    pub fn checked(self) -> Result<Self> {
        let Self { mean, minimum, uniformity, diversity, ugr, daylight_factor, maintenance } = self;
        let positive = "give a positive number, in the unit of the meter";
        let share = "give a ratio above 0, at most 1";
        for (name, value, most, advice) in [
            ("mean", mean, f64::MAX, positive),
            ("minimum", minimum, f64::MAX, positive),
            ("uniformity", uniformity, 1.0, share),
            ("diversity", diversity, 1.0, share),
            ("glare rating", ugr, 100.0, "give a number above 0, such as 19"),
        ] {
            // Written so that NaN fails.
            if let Some(value) = value.filter(|own| !(*own > 0.0 && *own <= most)) {
                return Err(Error::new(format!("the required {name} is {value}"), advice));
            }
        }
        let is_percent = |own: f64| own > 0.0 && own <= 100.0;
        if daylight_factor.is_some_and(|own| !own.into_iter().all(is_percent)) {
            let problem = format!(
                "daylight factors of {:?} % are required",
                daylight_factor.unwrap_or_default()
            );
            return Err(Error::new(
                problem,
                "give the target and the minimum in percent, such as [2.1, 0.7]",
            ));
        }
        if !(maintenance > 0.0 && maintenance <= 1.0) {
            let problem = format!("the maintenance factor is {maintenance}");
            return Err(Error::new(problem, "give a number above 0 and at most 1, such as 0.8"));
        }
        Ok(self)
    }

    /// Returns true if something is required.
    pub fn is_any(&self) -> bool {
        let Self { mean, minimum, uniformity, diversity, ugr, daylight_factor, .. } = self;
        let numbers = [mean, minimum, uniformity, diversity, ugr];
        numbers.iter().any(|own| own.is_some()) || daylight_factor.is_some()
    }
}

/// Named meters of one kind: a single one, or a grid.
#[derive(Clone, Debug, PartialEq)]
pub struct MeterSet {
    /// Name in reports.
    pub name: String,
    /// Quantity that they measure.
    pub kind: MeterKind,
    /// Columns and rows of a grid; `[1, 1]` for a single meter.
    pub grid: [u32; 2],
    /// Corner of a grid, and its edges along the columns and along the rows.
    pub frame: Option<[Vec3; 3]>,
    /// Meters, row by row.
    pub meters: Vec<Meter>,
    /// What is required of their readings.
    pub requirement: Requirement,
}

impl MeterSet {
    /// A set of a single meter.
    pub fn single(name: impl Into<String>, kind: MeterKind, meter: Meter) -> Self {
        let (name, requirement) = (for_display(&name.into()), Requirement::default());
        Self { name, kind, grid: [1, 1], frame: None, meters: vec![meter], requirement }
    }

    /// Irradiance in the centers of the cells of a parallelogram, which starts at `corner`. Columns
    /// follow the first edge, rows the second. The normal is on the side from which the edges turn
    /// counterclockwise, unless it is given.
    ///
    /// # Errors
    /// If there are no columns or rows, or more than [`MAX_METERS`] cells, and those of
    /// [`Meter::irradiance`].
    pub fn grid(
        name: impl Into<String>,
        corner: Vec3,
        edges: [Vec3; 2],
        grid: [u32; 2],
        normal: Option<Vec3>,
    ) -> Result<Self> {
        let cells = u64::from(grid[0]) * u64::from(grid[1]);
        if !(1..=MAX_METERS).contains(&cells) {
            let problem = format!("a grid of meters has {} columns and {} rows", grid[0], grid[1]);
            let advice = format!("give at least one of each, and at most {MAX_METERS} cells");
            return Err(Error::new(problem, advice));
        }
        let normal = normal.unwrap_or_else(|| edges[0].cross(edges[1]));
        let cell = |index: u32| {
            let [column, row] = [index % grid[0], index / grid[0]];
            let [u, v] = [(column, grid[0]), (row, grid[1])]
                .map(|(index, count)| (index as f32 + 0.5) / count as f32);
            Meter::irradiance(corner + u * edges[0] + v * edges[1], normal)
        };
        let meters = (0..cells as u32).map(cell).collect::<Result<_>>()?;
        let frame = Some([corner, edges[0], edges[1]]);
        let (name, requirement) = (for_display(&name.into()), Requirement::default());
        Ok(Self { name, kind: MeterKind::Irradiance, grid, frame, meters, requirement })
    }

    /// The same meters, of which this is required.
    #[must_use]
    pub fn requiring(self, requirement: Requirement) -> Self {
        Self { requirement, ..self }
    }

    /// Returns true if the set is a grid of several meters.
    pub fn is_grid(&self) -> bool {
        self.meters.len() > 1
    }
}

/// Columns and rows of the grid that EN 12464-1 (4.4) wants for an area of this length and width,
/// meters: points `p = 0.2 * 5^log10(d)` apart, at most 10 m. `d` is the longer side, or the
/// shorter one if the longer one is at least twice as long.
pub fn standard_grid([length, width]: [f64; 2]) -> [u32; 2] {
    let (longer, shorter) = (length.max(width), length.min(width));
    let d = if longer >= 2.0 * shorter { shorter } else { longer };
    let p = (0.2 * 5f64.powf(d.log10())).min(10.0);
    // The number along `d` decides how far the points of the other side are apart.
    let p = d / (d / p).round().max(1.0);
    [length, width].map(|side| (side / p).round().clamp(1.0, 65_536.0) as u32)
}

/// Maximum number of meters of a grid.
pub const MAX_METERS: u64 = 1 << 20;

impl Scene {
    /// The scene with meters in the place of its camera. Each is a pixel of an image of one row.
    /// Points on surfaces are moved off them, toward the side of their normal, as the starts of all
    /// rays are.
    ///
    /// # Panics
    /// If there are no meters.
    #[must_use]
    pub fn with_meters(&self, kind: MeterKind, mut list: Vec<Meter>) -> Self {
        assert!(!list.is_empty());
        for meter in &mut list {
            meter.position += self.offset_at(meter.position, meter.normal) * meter.normal;
        }
        let may_have_panes = self.has_panes();
        Self { meters: Some(Meters { kind, list, may_have_panes }.into()), ..self.clone() }
    }

    /// The meters that take the place of the camera, if there are any.
    pub fn meters(&self) -> Option<&Meters> {
        self.meters.as_deref()
    }

    /// The ray of a point of the image, as [`View::ray`], or of the meter of its pixel.
    pub fn camera_ray(&self, view: &View, x: f32, y: f32, lens: [f32; 2]) -> (Ray, f32) {
        match &self.meters {
            None => view.ray(x, y, lens),
            Some(meters) => meters.at(view, x, y).ray(meters.kind, lens),
        }
    }

    /// Returns true if meters measure irradiance, so that they are connected with lights.
    pub(crate) fn measures_irradiance(&self) -> bool {
        self.meters.as_ref().is_some_and(|meters| meters.kind == MeterKind::Irradiance)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::rng::{Stream, StreamKey};

    #[test]
    fn rays_of_a_cone_are_uniform_in_solid_angle_and_stay_inside() {
        let axis = Vec3::new(0.3, -2.0, 0.4);
        let half_angle = 0.4f32;
        let meter = Meter::radiance(Vec3::ONE, axis, half_angle).unwrap();
        let mut rng = StreamKey::new(1, Stream::Test, 0).rng(0);
        let n = 20_000;
        let (mut sum, mut squares) = (0.0, 0.0);
        for _ in 0..n {
            let (ray, weight) = meter.ray(MeterKind::Radiance, rng.next_2d());
            let cos = f64::from(ray.direction.dot(axis.normalize()));
            assert!(weight == 1.0 && cos >= f64::from(half_angle).cos() - 1e-6);
            (sum, squares) = (sum + cos, squares + cos * cos);
        }
        // The cosine is uniform between that of the half angle and 1.
        let mean = sum / f64::from(n);
        let expected = 0.5 * (1.0 + f64::from(half_angle).cos());
        let error = ((squares / f64::from(n) - mean * mean) / f64::from(n)).sqrt();
        assert!((mean - expected).abs() < 4.0 * error, "{mean}, not {expected}");
    }

    #[test]
    fn grid_has_meters_in_the_centers_of_its_cells() {
        let edges = [Vec3::new(4.0, 0.0, 0.0), Vec3::new(0.0, 2.0, 0.0)];
        let set = MeterSet::grid("plane", Vec3::ONE, edges, [4, 2], None).unwrap();
        let positions: Vec<Vec3> = set.meters.iter().map(|meter| meter.position).collect();
        assert_eq!(positions.len(), 8);
        assert_eq!(positions[1], Vec3::new(2.5, 1.5, 1.0));
        assert_eq!(positions[4], Vec3::new(1.5, 2.5, 1.0));
        assert!(set.meters.iter().all(|meter| meter.normal == Vec3::Z));
        let down = MeterSet::grid("plane", Vec3::ONE, edges, [1, 1], Some(Vec3::NEG_Z)).unwrap();
        assert!(down.meters[0].normal == Vec3::NEG_Z && !down.is_grid());
        for grid in [[0, 1], [1, 0], [1 << 16, 1 << 16]] {
            assert!(MeterSet::grid("plane", Vec3::ONE, edges, grid, None).is_err());
        }
        assert!(MeterSet::grid("plane", Vec3::ONE, [Vec3::X; 2], [1, 1], None).is_err());
    }

    /// Sides and numbers of points of the table of EN 12464-1:2011, A.1, which rounds the distances
    /// first.
    #[test]
    fn standard_grids_have_the_points_of_the_standard() {
        let table = [
            (0.4, 3),
            (0.6, 3),
            (1.0, 5),
            (2.0, 6),
            (5.0, 8),
            (10.0, 10),
            (25.0, 12),
            (50.0, 17),
            (100.0, 20),
        ];
        for (side, count) in table {
            let [columns, rows] = standard_grid([side, side]);
            assert!(columns == rows && columns.abs_diff(count) <= 1, "{side}: {columns} {count}");
        }
        // A corridor: its width decides.
        assert_eq!(standard_grid([30.0, 2.0]), [90, 6]);
    }

    #[test]
    fn impossible_requirements_are_refused() {
        let own = Requirement {
            mean: Some(500.0),
            minimum: Some(1.0),
            uniformity: Some(0.6),
            diversity: Some(0.025),
            ugr: Some(19.0),
            daylight_factor: Some([2.1, 0.7]),
            maintenance: 0.8,
        };
        assert!(own.checked().is_ok() && own.is_any());
        assert!(Requirement { mean: Some(0.0), ..own }.checked().is_err());
        assert!(Requirement { mean: Some(f64::NAN), ..own }.checked().is_err());
        assert!(Requirement { uniformity: Some(1.1), ..own }.checked().is_err());
        assert!(Requirement { minimum: Some(-1.0), ..own }.checked().is_err());
        assert!(Requirement { diversity: Some(40.0), ..own }.checked().is_err());
        assert!(Requirement { ugr: Some(0.0), ..own }.checked().is_err());
        assert!(Requirement { ugr: Some(19.0), ..Requirement::default() }.is_any());
        assert!(Requirement { daylight_factor: Some([2.1, -1.0]), ..own }.checked().is_err());
        for maintenance in [0.0, 1.1, f64::NAN] {
            assert!(Requirement { maintenance, ..own }.checked().is_err());
        }
        assert!(!Requirement::default().is_any());
    }

    #[test]
    fn impossible_meters_are_refused() {
        assert!(Meter::irradiance(Vec3::NAN, Vec3::Z).is_err());
        assert!(Meter::irradiance(Vec3::ZERO, Vec3::ZERO).is_err());
        assert!(Meter::radiance(Vec3::ZERO, Vec3::Z, 4.0).is_err());
        assert!(Meter::radiance(Vec3::ZERO, 7.0 * Vec3::Z, 0.0).unwrap().normal == Vec3::Z);
    }
}
