//! A sheet with matrices that depend on both angles, reciprocal and unlike from both sides.

use bdpm::scene::bsdf::{AngleBasis, Bsdf, Klems, KlemsMatrices};
use glam::Vec3;
use std::f32::consts::TAU;

/// A sheet that scatters at most `share` of the light, most of it through.
pub fn uneven(share: f32, up: Vec3) -> Bsdf {
    let basis = AngleBasis::named("LBNL/Klems Quarter").unwrap();
    // A factor of each patch that the opposite one has as well.
    let mut factors = Vec::new();
    for (index, band) in basis.bands().iter().enumerate() {
        for patch in 0..band.patches {
            let azimuth = TAU * patch as f32 / band.patches as f32;
            factors.push((0.5 + 0.1 * index as f32) * (1.0 + 0.5 * (2.0 * azimuth).cos()));
        }
    }
    let matrix = |scale: f32| {
        let row = |to: &f32| factors.iter().map(move |from| scale * to * from).collect::<Vec<_>>();
        Some(factors.iter().flat_map(row).collect::<Vec<f32>>())
    };
    let scaled = |scale: f32| {
        let values = [[matrix(0.2 * scale), matrix(scale)], [matrix(0.1 * scale), None]];
        KlemsMatrices::new(basis.clone(), values)
    };
    let unit = scaled(0.01).unwrap();
    let most = (0..factors.len()).map(|column| unit.scattered(true, column)).fold(0.0, f32::max);
    Bsdf::Klems(Klems::new(scaled(0.01 * share / most).unwrap().shared(), up))
}
