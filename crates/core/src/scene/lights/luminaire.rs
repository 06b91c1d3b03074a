//! Luminaires: points and luminous openings with a measured intensity distribution.
//!
//! A luminous opening has the intensity `I(w)` of its distribution in every direction `w`. Its
//! radiance is uniform over all of its surface that is seen from that direction:
//! `L(w) = I(w)/A(w)`, where `A(w)` is the area of the surface projected along `w`. The integral of
//! `L cos` over the surface is then `I(w)` exactly. Openings are convex, so that no part of them
//! hides another. Radiance's `source.cal` uses the same model (`flatcorr`, `boxcorr`).
//!
//! Light paths choose a direction in proportion to the intensity, then a point that is uniform over
//! the projected surface. The density is the radiance over the power, so that all light paths carry
//! equal flux.

use super::cluster::Beam;
use super::emitter::toward;
use super::intensity::IntensityDistribution;
use super::solid_angle::SphericalTriangle;
use super::{Emission, LightSample, below_one};
use crate::base::math::{Rgb, uniform_triangle, uniform_triangle_inverse};
use crate::base::rng::Draw;
use crate::scene::{Mesh, Triangle, triangle_area};
use glam::{DMat3, DVec3, Vec3};
use serde::Serialize;
use std::f32::consts::{FRAC_PI_2, PI};
use std::sync::Arc;

/// A distribution with its orientation in the scene.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct AimedDistribution {
    distribution: Arc<IntensityDistribution>,
    /// Unit vectors along x (the plane C0), y (C90) and z (up) of the luminaire.
    axes: DMat3,
    /// Radiant intensity per candela, W/(sr cd).
    factor: Rgb,
}

impl AimedDistribution {
    /// A distribution whose frame has these unit vectors in the scene, times `factor`, W/(sr cd).
    pub fn new(distribution: Arc<IntensityDistribution>, axes: DMat3, factor: Rgb) -> Self {
        Self { distribution, axes, factor }
    }

    /// The distribution in the frame of the luminaire.
    pub fn distribution(&self) -> &IntensityDistribution {
        &self.distribution
    }

    /// Unit vectors along x (the plane C0), y (C90) and z (up) of the luminaire.
    pub fn axes(&self) -> DMat3 {
        self.axes
    }

    /// Radiant intensity per candela, W/(sr cd).
    pub fn factor(&self) -> Rgb {
        self.factor
    }

    /// Radiant power, W.
    pub fn power(&self) -> Rgb {
        self.distribution.flux() as f32 * self.factor
    }

    fn to_local(&self, direction: Vec3) -> DVec3 {
        (self.axes.transpose() * direction.as_dvec3()).normalize_or_zero()
    }

    /// Radiant intensity in a unit direction, W/sr.
    #[inline]
    pub fn intensity(&self, direction: Vec3) -> Rgb {
        self.distribution.intensity(self.to_local(direction)) as f32 * self.factor
    }

    /// A unit direction in proportion to the intensity, from two uniform numbers.
    fn sample(&self, numbers: [f64; 2]) -> Vec3 {
        (self.axes * self.distribution.sample(numbers)).as_vec3().normalize()
    }

    /// Inverse of [`Self::sample`]; `None` where the intensity is 0.
    fn numbers(&self, direction: Vec3) -> [Option<f64>; 2] {
        let numbers = self.distribution.numbers(self.to_local(direction));
        numbers.map_or([None; 2], |numbers| numbers.map(Some))
    }

    /// Bounds of the directions in which it shines, and the intensity that the estimate of
    /// contributions assumes, W/sr.
    pub(super) fn beam(&self) -> (Beam, Rgb) {
        let axis = [DVec3::NEG_Z, DVec3::Z].into_iter().find(|&axis| self.shines_within(axis));
        match axis {
            // Half the sphere, as by Lambert's law with this power
            Some(axis) => {
                let axis = (self.axes * axis).as_vec3().normalize();
                (Beam { axis, spread: 0.0, reach: FRAC_PI_2 }, self.power() / PI)
            }
            None => {
                let all = Beam { axis: Vec3::Z, spread: PI, reach: FRAC_PI_2 };
                (all, self.power() / (4.0 * PI))
            }
        }
    }

    /// Returns true if all cells of the grid with an intensity are in the half of the sphere around
    /// an axis of the luminaire.
    fn shines_within(&self, axis: DVec3) -> bool {
        let own = &self.distribution;
        let (rows, columns) = (own.polar().len(), own.azimuth().len());
        let lit = |i: usize, j: usize| {
            let (rows, columns) = (i.saturating_sub(1)..=i + 1, j.saturating_sub(1)..=j + 1);
            rows.flat_map(|i| columns.clone().map(move |j| (i, j)))
                .filter(|&(i, j)| i < own.polar().len() && j < own.azimuth().len())
                .any(|(i, j)| own.values()[i * own.azimuth().len() + j] > 0.0)
        };
        let is_inside =
            |i: usize, j: usize| own.direction(own.polar()[i], own.azimuth()[j]).dot(axis) >= -1e-9;
        (0..rows).all(|i| (0..columns).all(|j| is_inside(i, j) || !lit(i, j)))
    }
}

/// A point with an intensity distribution.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct PointLuminaire {
    /// Position, scene units.
    pub position: Vec3,
    /// Its intensity.
    pub aimed: AimedDistribution,
}

impl PointLuminaire {
    pub(super) fn emit(&self, prob: f32, numbers: [f64; 2]) -> Emission {
        let flux = self.aimed.power() / prob;
        Emission { origin: self.position, direction: self.aimed.sample(numbers), flux }
    }

    /// Inverse of [`Self::emit`].
    pub(super) fn emission_numbers(&self, direction: Vec3) -> [Option<f64>; 4] {
        let [a, b] = self.aimed.numbers(direction);
        [a, b, None, None]
    }

    pub(super) fn connect(&self, position: Vec3, prob: f32) -> Option<LightSample> {
        let (wi, distance2) = toward(self.position, position);
        let irradiance = self.aimed.intensity(-wi) / (distance2 * prob);
        let reaches = distance2 > 0.0 && irradiance != Rgb::ZERO;
        reaches.then(|| LightSample::of_delta(self.position, wi, irradiance))
    }
}

/// The luminous opening of a luminaire: a convex surface.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct LuminousOpening {
    aimed: AimedDistribution,
    /// Unit normal and area of each plane face, scene units squared. Faces without a thickness have
    /// one side here.
    #[serde(skip)]
    faces: Vec<(Vec3, f32)>,
    is_flat: bool,
}

impl LuminousOpening {
    /// An opening whose surface is `mesh`: closed and convex with normals that point outward, or
    /// `is_flat`, a plane that emits from both sides.
    pub fn new(aimed: AimedDistribution, mesh: &Mesh, is_flat: bool) -> Self {
        let mut faces: Vec<(Vec3, f32)> = Vec::new();
        for indices in &mesh.triangles {
            let corners = indices.map(|index| mesh.positions[index as usize]);
            let (area, normal) = (triangle_area(corners), Triangle::new(corners, 0).normal);
            match faces.iter_mut().find(|(other, _)| other.dot(normal) > 1.0 - 1e-6) {
                Some((_, sum)) => *sum += area,
                None => faces.push((normal, area)),
            }
        }
        Self { aimed, faces, is_flat }
    }

    /// Its intensity.
    pub fn aimed(&self) -> &AimedDistribution {
        &self.aimed
    }

    /// Returns true if the surface is a plane that emits from both sides.
    pub fn is_flat(&self) -> bool {
        self.is_flat
    }

    /// Area projected along a unit direction, scene units squared.
    fn projected_area(&self, direction: Vec3) -> f32 {
        let faces = self.faces.iter();
        faces
            .map(|(normal, area)| {
                let cos = normal.dot(direction);
                area * if self.is_flat { cos.abs() } else { cos.max(0.0) }
            })
            .sum()
    }

    /// Radiance that its surface emits in a unit direction, W/(m^2 sr).
    #[inline]
    pub fn radiance(&self, direction: Vec3) -> Rgb {
        let area = self.projected_area(direction);
        if area > 0.0 { self.aimed.intensity(direction) / area } else { Rgb::ZERO }
    }
}

/// A luminous opening as a light source, with the triangles of its surface.
#[derive(Clone, Debug, PartialEq)]
pub struct OpeningEmitter {
    /// The opening.
    pub opening: Arc<LuminousOpening>,
    /// Triangles that emit from their fronts; a flat opening has each of them twice.
    triangles: Vec<Triangle>,
}

impl OpeningEmitter {
    pub(in crate::scene) fn new(
        opening: Arc<LuminousOpening>,
        mut triangles: Vec<Triangle>,
    ) -> Self {
        if opening.is_flat {
            let backs: Vec<Triangle> = triangles.iter().map(Triangle::flipped).collect();
            triangles.extend(backs);
        }
        Self { opening, triangles }
    }

    /// Triangles that emit from their fronts.
    pub(super) fn triangles(&self) -> &[Triangle] {
        &self.triangles
    }

    /// Index of the triangle that a number of [0, 1) selects in proportion to `weight`, the place
    /// of the number in its interval, and its probability; `None` if all weights are 0.
    pub(super) fn choose(
        &self,
        weight: impl Fn(&Triangle) -> f32,
        u: f64,
    ) -> Option<(usize, f64, f32)> {
        let weights = || self.triangles.iter().map(&weight).map(f64::from);
        let total: f64 = weights().sum();
        let mut rest = u * total;
        let mut last = None;
        for (index, weight) in weights().enumerate().filter(|(_, weight)| *weight > 0.0) {
            let prob = (weight / total) as f32;
            if rest < weight {
                return Some((index, rest / weight, prob));
            }
            rest -= weight;
            last = Some((index, 1.0f64.next_down(), prob));
        }
        last
    }

    /// The triangle with a positive weight that a point is on, or next to.
    fn locate(&self, point: Vec3, weight: impl Fn(&Triangle) -> f32) -> Option<usize> {
        let distance = |triangle: &Triangle| {
            let [u, v] = triangle.weights(point);
            let outside = (-u).max(-v).max(u + v - 1.0).max(0.0);
            let off = (point - triangle.origin).dot(triangle.normal).abs();
            off + outside * (triangle.edge1.length() + triangle.edge2.length())
        };
        let lit = self.triangles.iter().enumerate().filter(|(_, triangle)| weight(triangle) > 0.0);
        let nearest = lit.map(|(index, triangle)| (index, distance(triangle)));
        nearest.min_by(|(_, a), (_, b)| a.total_cmp(b)).map(|(index, _)| index)
    }

    pub(super) fn emit(&self, prob: f32, [a, b, c, d]: [f64; 4]) -> Emission {
        let aimed = &self.opening.aimed;
        let direction = aimed.sample([c, d]);
        let chosen = self.choose(|triangle| projected(triangle, direction), a);
        // In the plane of a flat opening there is no triangle to choose.
        let (index, place, _) = chosen.unwrap_or((0, a, 1.0));
        let triangle = &self.triangles[index];
        let at = triangle.point(uniform_triangle([place, b].map(below_one)));
        let origin = at + triangle.normal * triangle.offset;
        Emission { origin, direction, flux: aimed.power() / prob }
    }

    /// Inverse of [`Self::emit`].
    pub(super) fn emission_numbers(&self, origin: Vec3, direction: Vec3) -> [Option<f64>; 4] {
        let [c, d] = self.opening.aimed.numbers(direction);
        let weight = |triangle: &Triangle| projected(triangle, direction);
        let Some(index) = self.locate(origin, weight) else { return [None, None, c, d] };
        let weights = || self.triangles.iter().map(weight).map(f64::from);
        let (before, total): (f64, f64) = (weights().take(index).sum(), weights().sum());
        let triangle = &self.triangles[index];
        let [place, b] = uniform_triangle_inverse(triangle.weights(origin)).map(f64::from);
        let a = (before + place * f64::from(weight(triangle))) / total;
        [Some(a), Some(b), c, d]
    }

    pub(super) fn connect(
        &self,
        position: Vec3,
        prob: f32,
        rng: &mut impl Draw,
    ) -> Option<LightSample> {
        let chosen = self.choose(|triangle| seen(triangle, position), rng.next_f64());
        let (index, _, own) = chosen?;
        let triangle = &self.triangles[index];
        let point = triangle.point_to_light(position, rng.next_2d());
        let sample = point.sample(self.opening.radiance(-point.wi), prob * own)?;
        (sample.irradiance != Rgb::ZERO).then_some(sample)
    }

    /// Reciprocal of the density in solid angle of connections of `position` with the point
    /// `origin`, sr; `direction` leads from it to `position`. `None` if it cannot be connected.
    pub(super) fn inverse_pdf_w(
        &self,
        origin: Vec3,
        direction: Vec3,
        position: Vec3,
    ) -> Option<f32> {
        let weight = |triangle: &Triangle| seen(triangle, position);
        let index = self.locate(origin, weight)?;
        let triangle = &self.triangles[index];
        let total: f32 = self.triangles.iter().map(weight).sum();
        Some(triangle.inverse_pdf_w(origin, direction, position) * (total / weight(triangle)))
    }
}

/// Area of the front of a triangle projected along a unit direction, scene units squared.
fn projected(triangle: &Triangle, direction: Vec3) -> f32 {
    triangle.area() * triangle.normal.dot(direction).max(0.0)
}

/// Solid angle of the front of a triangle as seen from a point, approximate if the point is far
/// away, sr.
fn seen(triangle: &Triangle, position: Vec3) -> f32 {
    let height = (position - triangle.origin).dot(triangle.normal);
    if height <= 0.0 {
        return 0.0;
    }
    match SphericalTriangle::if_near(triangle, position) {
        Some(near) => near.solid_angle(),
        None => {
            let distance2 = triangle.point([1.0 / 3.0; 2]).distance_squared(position);
            triangle.area() * height / (distance2 * distance2.sqrt())
        }
    }
}

#[cfg(test)]
pub(super) mod tests;
