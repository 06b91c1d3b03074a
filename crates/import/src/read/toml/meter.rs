//! `[[meter]]` of a scene file: points, grids and directions whose light is measured.

use super::keys::{Point, Position};
use bdpm_core::base::error::{Error, Result};
use bdpm_core::scene::{Meter, MeterKind, MeterSet, Requirement, standard_grid};
use bdpm_core::settings::FixedArray;
use glam::{DVec3, Vec3};
use serde::Deserialize;

/// `[[meter]]`
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MeterTable {
    name: Option<String>,
    /// Position of a single meter.
    position: Option<Position>,
    /// Normal of the plane of illuminance.
    normal: Option<Point>,
    /// Axis of the cone of luminance.
    direction: Option<Point>,
    /// A point on the axis of the cone of luminance, instead of its direction.
    target: Option<Position>,
    /// Full opening angle of the cone.
    opening_deg: Option<f32>,
    /// Corner of a grid.
    corner: Option<Position>,
    /// Edges of a grid from its corner: along its columns and along its rows.
    edges: Option<FixedArray<Point, 2>>,
    columns: Option<u32>,
    rows: Option<u32>,
    /// Least mean after the maintenance factor, in the unit of the meter.
    required_mean: Option<f64>,
    /// Least value of each meter after the maintenance factor.
    required_minimum: Option<f64>,
    /// Least uniformity of a grid.
    required_uniformity: Option<f64>,
    /// Least minimum over maximum of a grid.
    required_diversity: Option<f64>,
    /// Most that the unified glare rating of eyes at the meters may be.
    required_ugr: Option<f64>,
    /// Target and minimum of the daylight factor, percent.
    required_daylight_factor: Option<FixedArray<f64, 2>>,
    maintenance_factor: Option<f64>,
}

impl MeterTable {
    /// The meters in a scene whose origin is at this point. `number` counts the tables of the file
    /// from 1 and names those without a name.
    pub fn set(&self, number: usize, origin: DVec3) -> Result<MeterSet> {
        let name = self.name.clone().unwrap_or_else(|| format!("meter {number}"));
        let has_grid = self.edges.is_some() || self.columns.is_some() || self.rows.is_some();
        let set = match (self.position, self.corner) {
            (Some(position), None) if !has_grid => self.single(name, position, origin),
            (None, Some(corner)) => self.grid(name, corner.relative_to(origin)),
            _ => Err(Error::new(
                "the meter is neither a point nor a grid",
                "give a `position`, or `corner` and `edges`",
            )),
        }?;
        let requirement = self.requirement(&set)?;
        Ok(set.requiring(requirement))
    }

    fn requirement(&self, set: &MeterSet) -> Result<Requirement> {
        let even = [
            ("required_uniformity", self.required_uniformity),
            ("required_diversity", self.required_diversity),
        ];
        let key = even.iter().find(|(_, value)| value.is_some()).filter(|_| !set.is_grid());
        if let Some((key, _)) = key {
            let advice = format!("remove `{key}`, or measure a grid");
            return Err(Error::new("a single meter has no uniformity", advice));
        }
        if self.required_ugr.is_some() && set.kind == MeterKind::Radiance {
            let problem = "a meter of luminance has no glare rating";
            let advice = "give the direction in which an eye looks as `normal`";
            return Err(Error::new(problem, advice));
        }
        Requirement {
            mean: self.required_mean,
            minimum: self.required_minimum,
            uniformity: self.required_uniformity,
            diversity: self.required_diversity,
            ugr: self.required_ugr,
            daylight_factor: self.required_daylight_factor.as_ref().map(|own| own.0),
            maintenance: self.maintenance_factor.unwrap_or(1.0),
        }
        .checked()
    }

    fn single(&self, name: String, in_file: Position, origin: DVec3) -> Result<MeterSet> {
        let position = in_file.relative_to(origin);
        let axis = match (self.direction, self.target) {
            (Some(direction), None) => Some(direction.0),
            (None, Some(target)) => Some(in_file.vector_to(target, origin)),
            (None, None) => None,
            _ => {
                let problem = "the meter has both a `direction` and a `target`";
                return Err(Error::new(problem, "remove one of them"));
            }
        };
        match (self.normal, axis, self.opening_deg) {
            (Some(normal), None, None) => {
                let meter = Meter::irradiance(position, normal.0)?;
                Ok(MeterSet::single(name, MeterKind::Irradiance, meter))
            }
            (None, Some(axis), opening) => {
                let half = (0.5 * opening.unwrap_or(0.0)).to_radians();
                let meter = Meter::radiance(position, axis, half)?;
                Ok(MeterSet::single(name, MeterKind::Radiance, meter))
            }
            _ => Err(Error::new(
                "the meter measures neither illuminance nor luminance",
                "give a `normal` for illuminance, or a `direction` or `target` for luminance",
            )),
        }
    }

    fn grid(&self, name: String, corner: Vec3) -> Result<MeterSet> {
        let single = [self.direction.is_some(), self.target.is_some(), self.opening_deg.is_some()];
        if single.contains(&true) {
            let problem = "the grid has a key that only a meter of luminance has";
            return Err(Error::new(problem, "remove `direction`, `target` and `opening_deg`"));
        }
        let Some(FixedArray(edges)) = &self.edges else {
            let advice = "give `edges = [[4, 0, 0], [0, 3, 0]]`";
            return Err(Error::new("the grid of meters is not complete", advice));
        };
        let edges = [edges[0].0, edges[1].0];
        let grid = match (self.columns, self.rows) {
            (Some(columns), Some(rows)) => [columns, rows],
            (None, None) => standard_grid(edges.map(|edge| f64::from(edge.length()))),
            _ => {
                let problem = "the grid of meters has columns or rows alone";
                let advice =
                    "give both `columns` and `rows`, or none of them for the grid of EN 12464-1";
                return Err(Error::new(problem, advice));
            }
        };
        let normal = self.normal.map(|normal| normal.0);
        MeterSet::grid(name, corner, edges, grid, normal)
    }
}
