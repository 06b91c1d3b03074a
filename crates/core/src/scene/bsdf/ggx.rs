//! The GGX distribution of microfacet normals, isotropic, with the heights of neighbors correlated,
//! and the energy that its single-scattering model loses.
//!
//! Directions are local: the surface's normal is z. Walter et al. 2007 (distribution), Heitz 2014
//! (masking), Dupuy and Benyoub 2023 (sampling), Kulla and Conty 2017 (energy).

use crate::base::math::sin_cos_turns;
use glam::{DVec2, Vec2, Vec3};
use serde::Serialize;
use std::f32::consts::PI;
use std::sync::LazyLock;

/// Microfacets of slope deviation `alpha / sqrt(2)`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Ggx {
    /// Width, above 0 up to 1.
    pub alpha: f32,
}

impl Ggx {
    /// Density of normals `m` over the surface, 1/sr.
    /// theory.md (25), like the next functions.
    #[inline]
    pub fn d(&self, m: Vec3) -> f32 {
        let alpha2 = self.alpha * self.alpha;
        // cos^2 (1 + tan^2/alpha^2), without the cancellation of 1 - cos^2 near the normal.
        let stretched = (m.x * m.x + m.y * m.y) / alpha2 + m.z * m.z;
        (PI * alpha2 * stretched * stretched).recip()
    }

    /// Smith's Lambda: the hidden over the visible share of facets that look toward `w`.
    #[inline]
    fn lambda(&self, w: Vec3) -> f32 {
        let tan2 = (w.x * w.x + w.y * w.y) / (w.z * w.z);
        0.5 * ((1.0 + self.alpha * self.alpha * tan2).sqrt() - 1.0)
    }

    /// Share of the facets that is visible from `w`.
    #[inline]
    pub fn g1(&self, w: Vec3) -> f32 {
        (1.0 + self.lambda(w)).recip()
    }

    /// Share of the facets that is visible from both directions.
    #[inline]
    pub fn g2(&self, wo: Vec3, wi: Vec3) -> f32 {
        (1.0 + self.lambda(wo) + self.lambda(wi)).recip()
    }

    /// A visible normal as seen from `wo`. The surface squeezed by `alpha` is a hemisphere, whose
    /// mirrored directions of a beam fill a spherical cap uniformly.
    #[inline]
    pub fn sample_visible(&self, wo: Vec3, [u, v]: [f32; 2]) -> Vec3 {
        let squeeze = |w: Vec3| Vec3::new(self.alpha * w.x, self.alpha * w.y, w.z).normalize();
        let beam = squeeze(wo);
        let z = (1.0 - u) * (1.0 + beam.z) - beam.z;
        let ring = (1.0 - z * z).max(0.0).sqrt();
        let (sin, cos) = sin_cos_turns(v);
        squeeze(Vec3::new(ring * cos, ring * sin, z) + beam)
    }

    /// Share of the light from the cosine `cos` that leaves perfectly reflecting facets after one
    /// reflection, from a table.
    #[inline]
    pub fn single_albedo(&self, cos: f32) -> f32 {
        TABLE.albedos(self.alpha, cos).x
    }

    /// [`Self::single_albedo`], and [`Self::schlick_albedo`] of facets that reflect nothing at
    /// normal incidence.
    #[inline]
    pub(super) fn albedos(&self, cos: f32) -> Vec2 {
        TABLE.albedos(self.alpha, cos)
    }

    /// The mean of [`Self::single_albedo`] under diffuse light.
    pub fn mean_single_albedo(&self) -> f32 {
        TABLE.means(self.alpha).x
    }

    /// [`Self::single_albedo`] of facets that reflect by Schlick's approximation, with the share
    /// `normal` at normal incidence.
    #[inline]
    pub fn schlick_albedo(&self, cos: f32, normal: f32) -> f32 {
        by_schlick(TABLE.albedos(self.alpha, cos), normal)
    }

    /// The mean of [`Self::schlick_albedo`] under diffuse light.
    #[inline]
    pub fn mean_schlick_albedo(&self, normal: f32) -> f32 {
        by_schlick(TABLE.means(self.alpha), normal)
    }

    /// Albedos by integration over the visible normals, with `n` times `n` midpoints; denser near
    /// flat normals, `u -> 1`, where narrow lobes have their losses.
    fn integrate_albedos(&self, cos: f32, n: u16) -> Vec2 {
        let wo = Vec3::new((1.0 - cos * cos).max(0.0).sqrt(), 0.0, cos);
        let midpoint = |i: u16| (f32::from(i) + 0.5) / f32::from(n);
        let mut sum = DVec2::ZERO;
        for i in 0..n {
            let t = midpoint(i);
            for j in 0..n {
                let m = self.sample_visible(wo, [1.0 - t * t, midpoint(j)]);
                let wi = reflect(wo, m);
                if wi.z > 0.0 {
                    let weight = 2.0 * t * self.g2(wo, wi) / self.g1(wo);
                    let grazing = (1.0 - wo.dot(m)).max(0.0).powi(5);
                    sum += DVec2::new(f64::from(weight), f64::from(weight * grazing));
                }
            }
        }
        (sum / (f64::from(n) * f64::from(n))).as_vec2()
    }
}

/// The albedo of facets that reflect the share `normal` at normal incidence.
#[inline]
pub(super) fn by_schlick(albedos: Vec2, normal: f32) -> f32 {
    normal * albedos.x + (1.0 - normal) * albedos.y
}

/// The mirror image of `w` in the facet of normal `m`.
#[inline]
pub fn reflect(w: Vec3, m: Vec3) -> Vec3 {
    2.0 * w.dot(m) * m - w
}

/// Nodes of the table along each axis.
const NODES: usize = 33;

/// Albedos over cosine and width, interpolated linearly: `x` for facets that reflect all light, `y`
/// for facets that reflect the share `(1 - cos)^5`, the variable term of Schlick's approximation.
struct Table {
    /// Rows have `alpha = (row / 32)^2`, columns `cos = (column / 32)^2`: albedos change most for
    /// narrow lobes and near the horizon.
    albedos: Vec<[Vec2; NODES]>,
    /// Means under diffuse light.
    means: [Vec2; NODES],
}

static TABLE: LazyLock<Table> = LazyLock::new(Table::new);

impl Table {
    fn new() -> Self {
        let square = |node: usize| (node as f32 / (NODES - 1) as f32).powi(2);
        let row = |row: usize| -> [Vec2; NODES] {
            let ggx = Ggx { alpha: square(row) };
            std::array::from_fn(|column| match (row, column) {
                (0, _) => Vec2::new(1.0, (1.0 - square(column)).powi(5)), // smooth
                (_, 0) => ggx.integrate_albedos(1e-4, 48),
                _ => ggx.integrate_albedos(square(column), 48),
            })
        };
        let mut table = Self { albedos: (0..NODES).map(row).collect(), means: [Vec2::ZERO; NODES] };
        table.means = std::array::from_fn(|row| {
            let mean = |cos| table.albedos(square(row), cos).extend(0.0);
            super::fresnel::diffuse_mean(mean).truncate()
        });
        table
    }

    #[inline]
    fn albedos(&self, alpha: f32, cos: f32) -> Vec2 {
        if alpha == 0.0 {
            return Vec2::new(1.0, (1.0 - cos).max(0.0).powi(5));
        }
        let (row, a) = node(alpha);
        let (column, b) = node(cos);
        let along = |row: &[Vec2; NODES]| row[column] + b * (row[column + 1] - row[column]);
        let (low, high) = (along(&self.albedos[row]), along(&self.albedos[row + 1]));
        low + a * (high - low)
    }

    fn means(&self, alpha: f32) -> Vec2 {
        if alpha == 0.0 {
            return Vec2::new(1.0, 1.0 / 21.0); // theory.md (24)
        }
        let (row, a) = node(alpha);
        self.means[row] + a * (self.means[row + 1] - self.means[row])
    }
}

/// Node at or below `x`, and the position between it and the next, in [0, 1].
#[inline]
fn node(x: f32) -> (usize, f32) {
    let position = x.clamp(0.0, 1.0).sqrt() * (NODES - 1) as f32;
    let low = (position as usize).min(NODES - 2);
    (low, position - low as f32)
}

#[cfg(test)]
mod tests {
    use super::super::{FacetModel, Facets};
    use super::*;
    use crate::base::math::uniform_sphere;
    use crate::base::rng::{Rng, Stream, StreamKey};

    fn rng(seed: u64) -> Rng {
        StreamKey::new(seed, Stream::Test, 0).rng(0)
    }

    #[test]
    fn facets_cover_the_surface_and_its_projection() {
        // integral D (m.n) dm = 1 and integral G1 max(0, w.m) D dm = w.n, over slopes: those of the
        // facets, tan = alpha sqrt(u / (1 - u)), have the density 1/(pi alpha^2 (1 + u/(1-u))^2).
        for alpha in [0.1, 0.3, 1.0] {
            let ggx = Ggx { alpha };
            for w in [Vec3::Z, Vec3::new(0.8, 0.0, 0.6), Vec3::new(0.0, 0.995, 0.0998)] {
                let w = w.normalize();
                let n = 300;
                let (mut area, mut projected) = (0.0, 0.0);
                for i in 0..n {
                    let u = (i as f32 + 0.5) / n as f32;
                    let tan = alpha * (u / (1.0 - u)).sqrt();
                    let slopes = (1.0 - u).powi(2) / (PI * alpha * alpha);
                    for j in 0..n {
                        let (y, x) = (2.0 * PI * (j as f32 + 0.5) / n as f32).sin_cos();
                        let m = Vec3::new(tan * x, tan * y, 1.0).normalize();
                        // dm = cos^3 d(slopes)
                        let weight = ggx.d(m) * m.z.powi(3) / slopes / (n * n) as f32;
                        area += m.z * weight;
                        projected += ggx.g1(w) * w.dot(m).max(0.0) * weight;
                    }
                }
                assert!((area - 1.0).abs() < 1e-3, "{alpha}: {area}");
                assert!((projected / w.z - 1.0).abs() < 0.03, "{alpha} {w}: {projected}");
            }
        }
    }

    #[test]
    fn visible_normals_have_their_density() {
        // Means of 1/pdf over a cap of normals give its solid angle.
        let mut rng = rng(1);
        for alpha in [0.05, 0.4, 1.0] {
            let ggx = Ggx { alpha };
            let facets = Facets { model: FacetModel::Correlated, alpha };
            let wo = Vec3::new(0.3, -0.2, 0.8).normalize();
            let cap = 1.0 - 0.5 * alpha.min(0.6); // cosine of its edge
            let expected = std::f64::consts::TAU * f64::from(1.0 - cap);
            let n = 200_000;
            let (mut sum, mut square) = (0.0, 0.0);
            for _ in 0..n {
                let m = ggx.sample_visible(wo, rng.next_2d());
                let x = if m.z > cap { 1.0 / f64::from(facets.visible_pdf_w(wo, m)) } else { 0.0 };
                sum += x / f64::from(n);
                square += x * x / f64::from(n);
            }
            let error = ((square - sum * sum) / f64::from(n)).sqrt();
            assert!((sum - expected).abs() < 4.0 * error, "{alpha}: {sum} +- {error} {expected}");
            assert!(error < 0.05 * expected, "{alpha}: {error}");
        }
    }

    #[test]
    fn table_of_albedos_matches_integration() {
        let mut rng = rng(2);
        for _ in 0..200 {
            let ggx = Ggx { alpha: 0.02 + 0.98 * rng.next_1d() };
            let cos = uniform_sphere(rng.next_2d()).z.abs().max(0.01);
            let fine = ggx.integrate_albedos(cos, 200);
            let table = TABLE.albedos(ggx.alpha, cos);
            let off = (table - fine).abs().max_element();
            assert!(off < 4e-3, "{ggx:?} {cos}: {table}, not {fine}");
        }
        // Narrow lobes lose nothing, wide ones much.
        assert!(Ggx { alpha: 0.01 }.mean_single_albedo() > 0.999);
        assert!(Ggx { alpha: 1.0 }.mean_single_albedo() < 0.7);
    }
}
