//! Lamps whose radiance depends on the direction: `spotlight`, and the distributions of luminaires
//! that `ies2rad` writes (`brightdata` and `colordata` with functions of `source.cal`).
//!
//! Radiance gives such a surface the radiance `L(w)` in the direction `w`. It becomes a luminous
//! opening of the intensity `I(w)`, the integral of `L(w) cos` over the sides that `w` sees.

use super::data::DataFile;
use super::materials::{Definition, emitted};
use super::patterns::{Coordinate, Correction, Pattern, is_distribution};
use super::tokens::Primitive;
use bdpm_core::base::error::{Error, Result};
use bdpm_core::base::math::{Rgb, luminance};
use bdpm_core::scene::{
    AimedDistribution, IntensityDistribution, LuminousOpening, Mesh, Photometry,
};
use glam::{DAffine3, DMat3, DVec3};
use std::collections::HashMap;
use std::path::{Path, PathBuf};
use std::rc::Rc;
use std::sync::Arc;

/// Largest step between nodes of a distribution, degrees: a cosine is linear within 1e-4.
const STEP: f64 = 1.5;

/// Angles this close are one node, degrees.
const SAME: f64 = 1e-6;

/// Lengths of the direction of a spotlight up to this have no effect, scene units.
const NO_FOCUS: f64 = 1e-3;

/// Nodes of a distribution, at most.
const MAX_NODES: usize = 1 << 22;

/// Distributions and data files so far.
#[derive(Default)]
pub struct Lamps {
    files: HashMap<PathBuf, Rc<DataFile>>,
    /// Intensity of a surface of area 1 and of white light by all that it depends on.
    distributions: HashMap<String, Arc<IntensityDistribution>>,
}

/// The emission of a material that depends on the direction.
pub struct Emission {
    /// Radiance of a factor of 1, W/(m^2 sr).
    color: Rgb,
    cone: Option<Cone>,
    patterns: Vec<Pattern>,
}

/// The cone of a `spotlight`.
struct Cone {
    axis: DVec3,
    /// Half of the opening angle, degrees.
    half: f64,
    /// Length of the direction, scene units.
    focus: f64,
}

impl Lamps {
    /// The emission of a material with its patterns; `None` if it is equal in all directions.
    ///
    /// # Errors
    /// If its numbers, or data files, are not those of its kind.
    pub fn emission(
        &mut self,
        material: &Definition,
        patterns: &[Rc<Definition>],
        find: impl Fn(&Path, &str) -> Result<PathBuf>,
    ) -> Result<Option<Emission>> {
        let own = &material.primitive;
        let [r, g, b] = own.at_least()?;
        let cone = (own.kind == "spotlight").then(|| Cone::of(own, material.map)).transpose()?;
        let distributions = patterns.iter().filter(|own| is_distribution(&own.primitive));
        let patterns: Vec<Pattern> = distributions
            .map(|pattern| Pattern::new(pattern, |name| self.data(find(&pattern.file, name)?)))
            .collect::<Result<_>>()?;
        let color = emitted([r, g, b].map(|own| own.max(0.0)));
        let depends = cone.is_some() || !patterns.is_empty();
        Ok(depends.then_some(Emission { color, cone, patterns }))
    }

    /// A data file, which is read once.
    fn data(&mut self, path: PathBuf) -> Result<Rc<DataFile>> {
        if let Some(own) = self.files.get(&path) {
            return Ok(Rc::clone(own));
        }
        let own = Rc::new(DataFile::read(&path)?);
        self.files.insert(path, Rc::clone(&own));
        Ok(own)
    }

    /// The luminous opening `mesh` of a surface in the scene, which is `exact` for its intensity.
    ///
    /// # Errors
    /// If the emission is too large for numbers.
    pub fn opening(
        &mut self,
        emission: &Emission,
        exact: &Mesh,
        mesh: &Mesh,
    ) -> Result<Option<LuminousOpening>> {
        let surface = Surface::new(exact);
        let white = luminance(emission.color);
        if surface.area <= 0.0 || white <= 0.0 {
            return Ok(None);
        }
        let axes = emission.axes();
        let key = emission.key(&surface, axes);
        let distribution = match self.distributions.get(&key) {
            Some(own) => Arc::clone(own),
            None => {
                let own = Arc::new(emission.distribution(&surface, axes)?);
                self.distributions.insert(key, Arc::clone(&own));
                own
            }
        };
        if distribution.flux() <= 0.0 {
            return Ok(None);
        }
        let factor = emission.hue(&surface, axes, &distribution) * surface.area as f32;
        if !(factor * distribution.flux() as f32).is_finite() {
            let problem = "the flux of a lamp overflows";
            return Err(Error::new(problem, "reduce its radiance or its data"));
        }
        let aimed = AimedDistribution::new(distribution, axes, factor);
        Ok(Some(LuminousOpening::new(aimed, mesh, false)))
    }
}

impl Cone {
    fn of(own: &Primitive, map: DAffine3) -> Result<Self> {
        let [_, _, _, degrees, x, y, z] = own.at_least()?;
        let direction = map.transform_vector3(DVec3::new(x, y, z));
        let (half, focus) = (0.5 * degrees.min(360.0), direction.length());
        let axis = direction.try_normalize().filter(|_| degrees > 0.0);
        axis.map(|axis| Self { axis, half, focus }).ok_or_else(|| {
            own.error("has no angle or no direction", "give degrees above 0 and a vector")
        })
    }
}

/// The sides of a surface.
struct Surface {
    /// Unit normal and share of the area of each side.
    sides: Vec<(DVec3, f64)>,
    area: f64,
}

impl Surface {
    fn new(mesh: &Mesh) -> Self {
        let mut sides: Vec<(DVec3, f64)> = Vec::new();
        for corners in &mesh.triangles {
            let [a, b, c] = corners.map(|index| mesh.positions[index as usize].as_dvec3());
            let normal = (b - a).cross(c - a);
            let Some(unit) = normal.try_normalize() else { continue };
            let area = 0.5 * normal.length();
            match sides.iter_mut().find(|(other, _)| other.dot(unit) > 1.0 - 1e-9) {
                Some((_, sum)) => *sum += area,
                None => sides.push((unit, area)),
            }
        }
        let area = sides.iter().map(|(_, area)| area).sum();
        sides.iter_mut().for_each(|(_, own)| *own /= area);
        Self { sides, area }
    }
}

impl Emission {
    /// Whether Radiance lowers the light near the lamp: there it falls with the distance from a
    /// focus that is behind the lamp by the length of the direction. No lamp of constant power does
    /// that, as the focus is not where the cone begins.
    pub fn has_focus(&self) -> bool {
        self.cone.as_ref().is_some_and(|cone| cone.focus > NO_FOCUS)
    }

    /// Axes of the frame of the distribution: that of the cone, or of the first pattern.
    fn axes(&self) -> DMat3 {
        match (&self.cone, self.patterns.first()) {
            (Some(cone), _) => {
                let (x, _) = cone.axis.any_orthonormal_pair();
                DMat3::from_cols(x, x.cross(cone.axis), -cone.axis)
            }
            (None, Some(pattern)) => pattern.frame,
            (None, None) => DMat3::IDENTITY,
        }
    }

    /// All that the distribution of a surface of area 1 depends on.
    fn key(&self, surface: &Surface, axes: DMat3) -> String {
        let rounded = |own: DVec3| own.to_array().map(|x| (1e7 * x).round() as i64);
        let patterns: Vec<_> = self.patterns.iter().map(|own| &own.key).collect();
        let frames: Vec<_> = self.patterns.iter().map(|own| rounded_all(axes, own.frame)).collect();
        let sides: Vec<_> = surface
            .sides
            .iter()
            .map(|(normal, share)| (rounded(axes.transpose() * *normal), (1e7 * share) as i64))
            .collect();
        let half = self.cone.as_ref().map(|cone| cone.half);
        format!("{half:?} {patterns:?} {frames:?} {sides:?}")
    }

    /// Intensity over area in a unit direction, of a channel.
    fn intensity(&self, surface: &Surface, to: DVec3, channel: usize) -> f64 {
        let factors = self.patterns.iter().map(|own| own.factor(to, channel));
        let is_flat = |own: &&Pattern| own.correction == Correction::Flat;
        let flat = self.patterns.iter().filter(is_flat).count() as i32;
        let seen = surface.sides.iter().map(|(normal, share)| {
            let cos = normal.dot(to);
            // Nodes may be in the plane of a side, from which they see its front.
            if cos < -1e-9 { 0.0 } else { share * cos.max(1e-12).powi(1 - flat) }
        });
        (factors.product::<f64>() * seen.sum::<f64>()).max(0.0)
    }

    /// The distribution of a surface of area 1.
    fn distribution(&self, surface: &Surface, axes: DMat3) -> Result<IntensityDistribution> {
        let [polar, azimuth] = self.nodes(surface, axes);
        let too_many = || {
            let problem = "the distribution of a lamp has too many angles";
            Error::new(problem, format!("give data of at most {MAX_NODES} values"))
        };
        if polar.len().saturating_mul(azimuth.len()) > MAX_NODES {
            return Err(too_many());
        }
        let mut values = Vec::with_capacity(polar.len() * azimuth.len());
        for theta in &polar {
            for phi in &azimuth {
                let to = axes * direction(*theta, *phi);
                // The luminance of the channels, as Radiance weighs them.
                let channels = [0.265, 0.670, 0.065].into_iter().enumerate();
                let value = if self.is_colored() {
                    channels.map(|(own, weight)| weight * self.intensity(surface, to, own)).sum()
                } else {
                    self.intensity(surface, to, 0)
                };
                values.push(value);
            }
        }
        let radians = |all: Vec<f64>| all.into_iter().map(f64::to_radians).collect();
        let own =
            IntensityDistribution::new(Photometry::C, radians(polar), radians(azimuth), values);
        own.ok_or_else(|| {
            Error::new("the emission of a lamp is no number", "check its data and numbers")
        })
    }

    /// Whether channels have data of their own.
    fn is_colored(&self) -> bool {
        self.patterns.iter().any(|own| own.data.len() > 1)
    }

    /// Radiance of a factor of 1, with the hue of the flux.
    fn hue(&self, surface: &Surface, axes: DMat3, own: &IntensityDistribution) -> Rgb {
        if !self.is_colored() {
            return self.color;
        }
        let mut sums = [0.0; 4];
        let columns = own.azimuth().len();
        for (row, theta) in own.polar().iter().enumerate() {
            for (column, phi) in own.azimuth().iter().enumerate() {
                let to = axes * direction(theta.to_degrees(), phi.to_degrees());
                for (channel, sum) in sums[..3].iter_mut().enumerate() {
                    *sum += theta.sin() * self.intensity(surface, to, channel);
                }
                sums[3] += theta.sin() * own.values()[row * columns + column];
            }
        }
        let [r, g, b, all] = sums;
        let hue = Rgb::new((r / all) as f32, (g / all) as f32, (b / all) as f32);
        self.color * hue
    }

    /// Polar angles and azimuths of the grid, degrees: those of the data, and steps between them.
    /// The grid ends where a flat surface along or across its axis ends to be seen, and with the
    /// cone.
    fn nodes(&self, surface: &Surface, axes: DMat3) -> [Vec<f64>; 2] {
        let (mut polar, mut azimuth) = (vec![0.0, 90.0, 180.0], vec![0.0, 90.0, 180.0, 270.0]);
        if let (None, Some(pattern)) = (&self.cone, self.patterns.first()) {
            for (axis, (coordinate, offset)) in
                pattern.data[0].axes.iter().zip(&pattern.coordinates)
            {
                let nodes = axis.iter().map(|node| node - offset);
                match coordinate {
                    Coordinate::Theta => polar.extend(nodes),
                    // Mirror images, by the folds and by transforms.
                    Coordinate::Phi(_) => azimuth.extend(nodes.flat_map(|own| {
                        [own, 180.0 - own, 180.0 + own, 360.0 - own]
                            .map(|own| own.rem_euclid(360.0))
                    })),
                    _ => {}
                }
            }
        }
        let [mut first, mut last] = [0.0, 180.0];
        let [mut from, mut to] = [0.0, 360.0];
        if let [(normal, _)] = surface.sides[..] {
            let own = axes.transpose() * normal;
            let turn = own.y.atan2(own.x).to_degrees();
            match own.z {
                z if z < -1.0 + 1e-9 => last = 90.0,
                z if z > 1.0 - 1e-9 => first = 90.0,
                z if z.abs() < 1e-9 => [from, to] = [turn - 90.0, turn + 90.0],
                _ => {}
            }
        }
        if let Some(cone) = &self.cone {
            last = cone.half.min(last).max(first + SAME);
        }
        let polar = subdivided(polar, [first, last]);
        if self.is_round(surface, axes) {
            return [polar, vec![from, to]];
        }
        let all_turns: Vec<f64> =
            azimuth.iter().flat_map(|own| [own - 360.0, *own, own + 360.0]).collect();
        [polar, subdivided(all_turns, [from, to])]
    }

    /// Whether the intensity does not depend on the azimuth.
    fn is_round(&self, surface: &Surface, axes: DMat3) -> bool {
        let [(normal, _)] = surface.sides[..] else { return false };
        let is_along = |own: DVec3| own.dot(axes.z_axis).abs() > 1.0 - 1e-9;
        let is_round = |own: &Pattern| {
            is_along(own.frame.z_axis)
                && !matches!(own.correction, Correction::Box(_))
                && own.coordinates.iter().all(|(one, _)| *one == Coordinate::Theta)
        };
        is_along(normal) && self.patterns.iter().all(is_round)
    }
}

/// Ascending nodes within these limits, which are nodes, with steps of at most [`STEP`] between
/// them.
fn subdivided(mut nodes: Vec<f64>, [first, last]: [f64; 2]) -> Vec<f64> {
    nodes.retain(|node| *node > first + SAME && *node < last - SAME);
    nodes.extend([first, last]);
    nodes.sort_by(f64::total_cmp);
    nodes.dedup_by(|next, own| *next - *own < SAME);
    let mut all = vec![nodes[0]];
    for pair in nodes.windows(2) {
        let steps = ((pair[1] - pair[0]) / STEP).ceil().max(1.0);
        all.extend((1..=steps as usize).map(|step| {
            if step as f64 == steps {
                pair[1]
            } else {
                pair[0] + (pair[1] - pair[0]) * step as f64 / steps
            }
        }));
    }
    all
}

/// Unit direction of a polar angle from -z and an azimuth, degrees.
fn direction(theta: f64, phi: f64) -> DVec3 {
    let ((sin, cos), (y, x)) = (theta.to_radians().sin_cos(), phi.to_radians().sin_cos());
    DVec3::new(sin * x, sin * y, -cos)
}

/// One frame in another, rounded.
fn rounded_all(axes: DMat3, frame: DMat3) -> [i64; 9] {
    (axes.transpose() * frame).to_cols_array().map(|x| (1e7 * x).round() as i64)
}
