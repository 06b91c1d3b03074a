//! Lenses in the renderer and beside it: their meshes, their images' moments, and exact rays.

mod objective;
mod sequential;

use crate::common::*;
use crate::make_scenes::mesh;
use bdpm::scene::Mesh;
use glam::{DVec2, dvec2};

/// A mesh of the scenes' generator as the renderer takes it.
pub fn loaded(made: &mesh::Mesh, material: u32) -> Mesh {
    let mut mesh = Mesh { name: "made".into(), material, ..Mesh::default() };
    for corner in made.faces.iter().flat_map(|f| (2..f.len()).flat_map(|i| [f[0], f[i - 1], f[i]]))
    {
        mesh.positions.push(made.positions[corner.position].as_vec3());
        // The length zero stands for the triangle's own.
        mesh.normals
            .push(corner.normal.map_or_else(Default::default, |n| made.normals[n].as_vec3()));
    }
    mesh.triangles =
        (0..mesh.positions.len() as u32 / 3).map(|i| [0, 1, 2].map(|c| 3 * i + c)).collect();
    mesh
}

/// A square picture on a plane: each pixel's mean and standard error, row by row from the top left.
pub struct Picture {
    pub pixels: Vec<[f64; 2]>,
    /// Their number across.
    pub side: usize,
    /// Width of a pixel.
    pub pitch: f64,
}

/// Energy, place and size of a spot in a picture, with standard errors.
#[derive(Clone, Copy, Debug)]
pub struct Spot {
    /// Integral over the plane.
    pub energy: Estimate,
    /// Mean place, x to the right and y up; its error holds for both.
    pub place: DVec2,
    pub place_error: f64,
    /// Mean square of the distance from the mean place.
    pub spread: Estimate,
}

impl Picture {
    /// The spot of all pixels whose centers are closer to `center` than `reach`, in x and in y.
    pub fn spot(&self, center: DVec2, reach: f64) -> Spot {
        let at = |index: usize| {
            let place = |i: usize| self.pitch * (i as f64 + 0.5 - 0.5 * self.side as f64);
            dvec2(place(index % self.side), -place(index / self.side))
        };
        let near = |place: DVec2| (place - center).abs().max_element() < reach;
        let all = || {
            let places = self.pixels.iter().enumerate().map(|(i, pixel)| (at(i), pixel));
            places.filter(|(place, _)| near(*place))
        };
        let area = self.pitch * self.pitch;
        let energy: f64 = all().map(|(_, [mean, _])| mean * area).sum();
        let place = all().map(|(at, [mean, _])| at * *mean).sum::<DVec2>() * area / energy;
        let square = |at: DVec2| at.distance_squared(place);
        let spread = all().map(|(at, [mean, _])| square(at) * mean).sum::<f64>() * area / energy;
        // Pixels are independent.
        let error = |weight: &dyn Fn(DVec2) -> f64| {
            all().map(|(at, [_, e])| (weight(at) * e * area).powi(2)).sum::<f64>().sqrt()
        };
        Spot {
            energy: Estimate { mean: energy, error: error(&|_| 1.0) },
            place,
            place_error: error(&|at| square(at).sqrt()) / energy,
            spread: Estimate { mean: spread, error: error(&|at| square(at) - spread) / energy },
        }
    }
}
