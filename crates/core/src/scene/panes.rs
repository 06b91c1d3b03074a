//! Clear panes: smooth sheets, and slabs between parallel faces. Light that goes through one keeps
//! its direction, so that a point and a light can be connected through panes.

use super::bsdf::fresnel::PolarizedShares;
use super::bsdf::{Bsdf, Dielectric, fresnel};
use super::polarization::PolarizedLight;
use super::{MediumState, Scene, Surface};
use crate::accel::{Intersect, Ray};
use crate::base::math::Rgb;
use glam::{Mat2, Vec2, Vec3};

/// Maximum sine of the angle between the faces of a slab.
const PARALLEL: f32 = 1e-4;

/// Maximum number of panes between a point and a light.
const MAX_PANES: u32 = 32;

/// Maximum number of steps of the search for the direction toward a point through panes, each of
/// which reduces the error by about the thickness of the slabs over the distance.
const MAX_STEPS: u32 = 32;

/// Change of the displacement in a step at which that search ends, over the distance.
const SHIFT_TOLERANCE: f32 = 1e-6;

/// Light at a pane that it meets in a given direction.
#[derive(Clone, Copy, Debug)]
pub struct PanePassage {
    /// Start of the ray that goes on in the same direction, beyond the pane.
    pub start: Vec3,
    /// Share of the light that goes on. All orders of reflection inside the pane are included.
    pub transmitted: Rgb,
    /// Share of the light that is mirrored, all orders included.
    pub reflected: Rgb,
    /// The medium beyond the pane.
    pub beyond: MediumState,
    /// Shares of the light that goes on, by polarization.
    polarized: PolarizedShares,
    /// Unit normal of the pane.
    normal: Vec3,
    /// Refractive index over that around the pane, and the cosine with the normal.
    pub(super) interface: (f32, f32),
    /// Path inside a slab; `None` for a sheet without thickness.
    slab: Option<SlabPath>,
}

/// The way through a slab.
#[derive(Clone, Copy, Debug)]
struct SlabPath {
    /// From the point where light enters to the point where it leaves, scene units.
    across: Vec3,
    /// Cosine with the normal inside.
    cos_inside: f32,
}

impl PanePassage {
    /// Returns true if the pane has a thickness, so that it displaces light.
    pub fn is_slab(&self) -> bool {
        self.slab.is_some()
    }
}

/// Smallest cosine at which the start of a ray beyond a pane is in its line.
const MIN_COSINE: f32 = 1e-3;

/// A straight line of sight through panes.
#[derive(Clone, Copy, Debug)]
pub struct PaneSight {
    /// Unit direction from the point to the light, outside of all slabs.
    pub direction: Vec3,
    /// Displacement of light by all slabs, across the direction, scene units.
    pub shift: Vec3,
    /// Share of the light that all panes and media on the way transmit.
    pub transmitted: Rgb,
    /// Factor of the irradiance by a point, since slabs shorten its apparent distance: theory.md
    /// (30c).
    pub nearness: f32,
    /// Number of slabs on the way.
    pub slabs: u32,
}

/// The end of a line of sight.
#[derive(Clone, Copy, Debug)]
enum SightEnd {
    /// A direction, at an infinite distance.
    Direction(Vec3),
    /// A point.
    Point(Vec3),
}

impl Scene {
    /// Returns true if any surface may be a clear pane.
    pub fn has_panes(&self) -> bool {
        self.placements.iter().any(|placement| {
            let material = &self.materials[placement.material as usize];
            let is_pane = matches!(material.bsdf, Bsdf::Dielectric(_) | Bsdf::ThinDielectric(_));
            is_pane && material.dispersion.is_none() && !material.is_index_matched_boundary()
        })
    }

    /// The pane that a ray in the medium `around` meets at `surface`; `None` if it is none, or if
    /// the ray arrives from inside a slab. theory.md (30a), (30b)
    pub fn pane_at(
        &self,
        accel: &dyn Intersect,
        surface: &Surface,
        around: MediumState,
    ) -> Option<PanePassage> {
        let cos = surface.normal.dot(surface.wo);
        match surface.bsdf {
            Bsdf::ThinDielectric(sheet) if surface.interpolated.is_none() => {
                let [transmitted, reflected] = sheet.shares(cos);
                Some(PanePassage {
                    start: surface.start(-surface.wo),
                    transmitted,
                    reflected,
                    beyond: around,
                    polarized: sheet.polarized_shares(cos),
                    normal: surface.normal,
                    interface: (sheet.eta, cos),
                    slab: None,
                })
            }
            Bsdf::Dielectric(face) if surface.front && is_face(surface) => {
                self.slab(accel, surface, face, around)
            }
            _ => None,
        }
    }

    /// The slab whose front a ray meets at `surface`.
    fn slab(
        &self,
        accel: &dyn Intersect,
        surface: &Surface,
        face: Dielectric,
        around: MediumState,
    ) -> Option<PanePassage> {
        let Surface { normal, wo, position, .. } = *surface;
        let cos = normal.dot(wo);
        let (_, cos_inside) = fresnel::dielectric(cos, face.eta);
        let inside = ((cos / face.eta - cos_inside) * normal - wo / face.eta).normalize();
        let ray = Ray::new(surface.start(inside), inside);
        let hit = accel.closest_hit(&ray);
        if cos_inside <= 0.0 || hit.is_miss() {
            return None;
        }
        let back = self.surface(&ray, &hit);
        let Bsdf::Dielectric(other) = back.bsdf else { return None };
        let is_parallel = back.normal.cross(normal).length() < PARALLEL;
        if back.front || !is_face(&back) || !is_parallel || other.eta != face.eta {
            return None;
        }
        let across = back.position - position;
        let (mut beyond, mut once) = (around, Rgb::ONE);
        if let Some(media) = self.media() {
            let within = media.after(around, surface, inside);
            if let Some(medium) = media.medium(within) {
                if medium.scatters() {
                    return None;
                }
                once = medium.transmittance(across.length());
            }
            beyond = media.after(within, &back, -wo);
        }
        let [transmitted, reflected] = fresnel::slab(cos, face.eta, once);
        let colors = face.transmittance * other.transmittance;
        Some(PanePassage {
            start: back.start(-wo),
            transmitted: transmitted * colors,
            reflected,
            beyond,
            polarized: PolarizedShares::of_slab(cos, face.eta, once).scaled(colors),
            normal,
            interface: (face.eta, cos),
            slab: Some(SlabPath { across, cos_inside }),
        })
    }

    /// The line of sight from a point to a direction at an infinite distance, through panes only;
    /// `None` if it is blocked.
    pub(crate) fn sight_along(
        &self,
        accel: &dyn Intersect,
        from: Vec3,
        direction: Vec3,
        around: MediumState,
    ) -> Option<PaneSight> {
        self.sight(accel, from, SightEnd::Direction(direction), around)
    }

    /// The line of sight from a point to another, through panes only; `None` if it is blocked.
    /// Slabs displace it: the direction is such that it meets the other point.
    pub(crate) fn sight_to(
        &self,
        accel: &dyn Intersect,
        from: Vec3,
        to: Vec3,
        around: MediumState,
    ) -> Option<PaneSight> {
        let mut sight = self.sight(accel, from, SightEnd::Point(to), around)?;
        for _ in 0..MAX_STEPS {
            let next = self.sight(accel, from, SightEnd::Point(to - sight.shift), around)?;
            let change = next.shift.distance(sight.shift);
            sight = next;
            if change <= SHIFT_TOLERANCE * from.distance(to) {
                break;
            }
        }
        Some(sight)
    }

    fn sight(
        &self,
        accel: &dyn Intersect,
        from: Vec3,
        end: SightEnd,
        around: MediumState,
    ) -> Option<PaneSight> {
        let (direction, distance) = match end {
            SightEnd::Direction(direction) => (direction, f32::INFINITY),
            SightEnd::Point(to) => ((to - from).normalize_or_zero(), from.distance(to)),
        };
        if direction == Vec3::ZERO {
            return None;
        }
        let mut tracer = SightTracer::new(direction, distance);
        let (mut ray, mut within) = (Ray::new(from, direction), around);
        for _ in 0..MAX_PANES {
            let hit = accel.closest_hit(&ray);
            let left = tracer.left();
            let is_free = hit.is_miss() || hit.t >= left * (1.0 - 32.0 * f32::EPSILON);
            let length = if is_free { left } else { hit.t };
            if let Some(medium) = self.media().and_then(|media| media.medium(within)) {
                tracer.transmitted *= medium.transmittance(length);
            }
            if is_free {
                return Some(tracer.end());
            }
            let surface = self.surface(&ray, &hit);
            let start;
            if let Some(media) = self.media().filter(|media| media.is_index_matched(hit.mesh)) {
                within = media.cross(within, hit.mesh, surface.front);
                start = surface.start(direction);
            } else {
                let pane = self.pane_at(accel, &surface, within)?;
                tracer.pass(&pane);
                (start, within) = (pane.start, pane.beyond);
            }
            let start = start + along_ray(&surface, direction);
            // Rays start off surfaces. A lamp must not seem to be nearer than its own distance.
            tracer.covered += (start - ray.origin).dot(direction);
            ray = Ray::new(start, direction);
        }
        None
    }
}

/// Displacement of the start of a ray beyond a flat surface, so that it goes on in its line: off
/// the surface along its direction, not along the normal.
fn along_ray(surface: &Surface, direction: Vec3) -> Vec3 {
    let normal = -surface.normal;
    let offset = surface.off_surface.distance(surface.position);
    let cos = normal.dot(direction).max(MIN_COSINE);
    offset * (direction / cos - normal)
}

/// Returns true if the interface is smooth, flat and without dispersion.
fn is_face(surface: &Surface) -> bool {
    surface.interpolated.is_none() && surface.material.dispersion.is_none()
}

/// A line of sight under construction.
struct SightTracer {
    direction: Vec3,
    distance: f32,
    /// Length along the direction until the start of the current ray.
    covered: f32,
    shift: Vec3,
    /// Share of the light that media outside of slabs transmit.
    transmitted: Rgb,
    /// Light that panes transmit.
    light: PolarizedLight,
    /// Length of the way in slabs, along the direction.
    in_slabs: f32,
    /// Displacement of light per radian by the slabs, in a frame across the direction.
    apparent: Mat2,
    frame: [Vec3; 2],
    slabs: u32,
}

impl SightTracer {
    fn new(direction: Vec3, distance: f32) -> Self {
        let (right, up) = direction.any_orthonormal_pair();
        Self {
            direction,
            distance,
            covered: 0.0,
            shift: Vec3::ZERO,
            transmitted: Rgb::ONE,
            light: PolarizedLight::unpolarized(direction),
            in_slabs: 0.0,
            apparent: Mat2::ZERO,
            frame: [right, up],
            slabs: 0,
        }
    }

    /// Length that is left along the direction.
    fn left(&self) -> f32 {
        self.distance - self.covered
    }

    /// Passes a pane.
    /// theory.md (30c)
    fn pass(&mut self, pane: &PanePassage) {
        let PanePassage { normal, interface: (index, cos), .. } = *pane;
        self.light.pass(normal, &pane.polarized);
        let Some(SlabPath { across, cos_inside }) = pane.slab else { return };
        let along = across.dot(self.direction);
        self.in_slabs += along;
        self.shift += across - along * self.direction;
        self.slabs += 1;
        // Apparent length for small angles across the plane of incidence, and within it.
        let sagittal = across.length() / index;
        let meridional = sagittal * (cos / cos_inside).powi(2);
        let plane = normal - normal.dot(self.direction) * self.direction;
        let axis = Vec2::from_array(self.frame.map(|axis| axis.dot(plane))).normalize_or_zero();
        let outer = Mat2::from_cols(axis * axis.x, axis * axis.y);
        self.apparent += Mat2::IDENTITY * sagittal + outer * (meridional - sagittal);
    }

    fn end(self) -> PaneSight {
        let Self { direction, distance, shift, light, slabs, .. } = self;
        let transmitted = self.transmitted * light.share;
        let mut nearness = 1.0;
        if slabs > 0 && distance.is_finite() {
            let in_air = distance - self.in_slabs;
            let spread = (Mat2::IDENTITY * in_air + self.apparent).determinant();
            nearness = distance * distance / spread;
        }
        PaneSight { direction, shift, transmitted, nearness, slabs }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::backend::{self, Backend};
    use crate::scene::bsdf::ThinDielectric;
    use crate::scene::{Camera, FieldOfView, Material, Mesh};

    /// A square in the plane z = `height` that faces up or down.
    fn face(height: f32, up: bool, material: u32) -> Mesh {
        let corners = [[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]];
        let positions = corners.map(|[x, y]| Vec3::new(50.0 * x, 50.0 * y, height));
        let triangles = if up { vec![[0, 1, 2], [0, 2, 3]] } else { vec![[0, 2, 1], [0, 3, 2]] };
        Mesh { positions: positions.into(), triangles, material, ..Mesh::default() }
    }

    /// Two panes of the index 1.5, one after the other: the mean of the products of each
    /// polarization with all reflections inside.
    #[test]
    fn parallel_panes_pass_each_polarization_on_its_own() {
        let sheets = vec![face(1.0, true, 0), face(2.0, false, 0)];
        let slabs =
            vec![face(1.0, false, 1), face(1.1, true, 1), face(2.0, false, 1), face(2.1, true, 1)];
        let materials = [
            Bsdf::ThinDielectric(ThinDielectric::new(1.5)),
            Bsdf::Dielectric(Dielectric::new(1.5)),
        ];
        for (meshes, slabs) in [(sheets, 0), (slabs, 2)] {
            let materials = materials.map(|bsdf| Material::new("glass", bsdf)).into();
            let camera = Camera::look(Vec3::Z, -Vec3::Z, Vec3::Y, FieldOfView::X(60.0)).unwrap();
            let own = Scene::new("two".into(), meshes, materials, vec![], camera, vec![]).unwrap();
            let accel = backend::build(Backend::Bvh, &own).unwrap();
            for (degrees, expected) in [(0.0f32, 0.8521), (60.0, 0.7413), (75.0, 0.4178)] {
                let (sin, cos) = degrees.to_radians().sin_cos();
                let direction = Vec3::new(sin, 0.0, cos);
                let sight = own.sight_along(&*accel, Vec3::ZERO, direction, MediumState::default());
                let sight = sight.expect("only panes");
                assert_eq!(sight.slabs, slabs);
                let share = sight.transmitted.x;
                assert!((share - expected).abs() < 5e-4, "{degrees} {slabs}: {share}");
                let stack = own.pane_stack(&*accel, Vec3::ZERO, direction, f32::INFINITY);
                assert_eq!(stack.panes, 2);
            }
        }
    }
}
