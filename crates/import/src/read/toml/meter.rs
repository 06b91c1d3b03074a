//! `[[meter]]` of a scene file: points, grids and directions whose light is measured.

use super::keys::{Point, Position};
use bdpm_core::base::error::{Error, Result};
use bdpm_core::scene::{Meter, MeterKind, MeterSet};
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
}

impl MeterTable {
    /// The meters in a scene whose origin is at this point. `number` counts the tables of the file
    /// from 1 and names those without a name.
    pub fn set(&self, number: usize, origin: DVec3) -> Result<MeterSet> {
        let name = self.name.clone().unwrap_or_else(|| format!("meter {number}"));
        let has_grid = self.edges.is_some() || self.columns.is_some() || self.rows.is_some();
        match (self.position, self.corner) {
            (Some(position), None) if !has_grid => self.single(name, position, origin),
            (None, Some(corner)) => self.grid(name, corner.relative_to(origin)),
            _ => Err(Error::new(
                "the meter is neither a point nor a grid",
                "give a `position`, or `corner`, `edges`, `columns` and `rows`",
            )),
        }
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
        let (Some(FixedArray(edges)), Some(columns), Some(rows)) =
            (&self.edges, self.columns, self.rows)
        else {
            let advice = "give `edges = [[4, 0, 0], [0, 3, 0]]`, `columns` and `rows`";
            return Err(Error::new("the grid of meters is not complete", advice));
        };
        let normal = self.normal.map(|normal| normal.0);
        MeterSet::grid(name, corner, [edges[0].0, edges[1].0], [columns, rows], normal)
    }
}
