//! The surfaces of a scene as areas ask for them.

use super::pilot;
use super::{Areas, Hole, Surfaces};
use crate::accel::{Instance, Intersect, TriangleMesh};
use crate::base::math::Frame;
use crate::scene::{Mesh, Placement, Scene};
use glam::{Vec2, Vec3};
use std::f32::consts::TAU;
use std::sync::Arc;

/// Maximum size of the areas that are kept, bytes: some hundred for each cell. The hall, of 1.5
/// million triangles, takes half of it.
const BUDGET: usize = 1 << 30;

/// Points of a disc at which the opacity of a cut-out is asked for.
const SAMPLES: u16 = 64;

/// Turn from one of these points to the next: by the golden ratio, so that they spread evenly.
const GOLDEN_TURN: f32 = 0.381_966_01;

struct SceneSurfaces {
    scene: Arc<Scene>,
    places: Vec<Instance>,
}

impl Areas {
    /// Areas of all surfaces of a scene, in spheres of up to `radius`, scene units. A pilot traces
    /// light paths to find the sides that light reaches. It does not depend on settings or the
    /// number of threads.
    pub fn of_scene(scene: &Arc<Scene>, accel: &dyn Intersect, radius: f32) -> Self {
        let surfaces =
            SceneSurfaces { scene: Arc::clone(scene), places: scene.geometry().instances };
        let sides = pilot::reached(scene, accel, &surfaces);
        Self::new(Box::new(surfaces), sides, radius, BUDGET)
    }
}

impl SceneSurfaces {
    fn placement(&self, place: u32) -> &Placement {
        &self.scene.placements()[place as usize]
    }
}

impl Surfaces for SceneSurfaces {
    fn meshes(&self) -> Vec<TriangleMesh<'_>> {
        self.scene.meshes().iter().map(Mesh::as_triangles).collect()
    }

    fn mesh(&self, mesh: u32) -> TriangleMesh<'_> {
        self.scene.meshes()[mesh as usize].as_triangles()
    }

    fn places(&self) -> &[Instance] {
        &self.places
    }

    fn normal(&self, place: u32, triangle: u32) -> Vec3 {
        self.scene.placed_normal(place, triangle)
    }

    fn merges(&self, place: u32) -> bool {
        self.scene.materials()[self.placement(place).material as usize].bsdf.merges()
    }

    fn has_holes(&self, place: u32) -> bool {
        self.scene.materials()[self.placement(place).material as usize].alpha_mask().is_some()
    }

    fn opacity(&self, hole: &Hole) -> f32 {
        let placement = self.placement(hole.place);
        let material = &self.scene.materials()[placement.material as usize];
        let Some(alpha_mask) = material.alpha_mask() else { return 1.0 };
        let triangle = self.scene.placed_triangle(hole.place, hole.triangle);
        let mesh = self.scene.mesh(placement);
        let corners = mesh.triangles[hole.triangle as usize];
        // In the order of the placed triangle's corners, which mirroring turns around.
        let corners = placement.transform.map_or(corners, |transform| transform.ordered(corners));
        let [a, b, c] =
            corners.map(|index| mesh.uvs.get(index as usize).copied().unwrap_or_default());
        let weights = match placement.transform {
            None => hole.at,
            Some(transform) => transform.weights(hole.at),
        };
        let middle = a + weights[0] * (b - a) + weights[1] * (c - a);
        // From steps in the triangle's plane to those of the weights, by the dual of its edges.
        let dual1 = triangle.edge2.cross(triangle.normal);
        let dual1 = dual1 / dual1.dot(triangle.edge1);
        let dual2 = triangle.edge1.cross(triangle.normal);
        let dual2 = dual2 / dual2.dot(triangle.edge2);
        let plane = Frame::new(triangle.normal);
        let uv = |step: Vec3| dual1.dot(step) * (b - a) + dual2.dot(step) * (c - a);
        let [along_x, along_y] = [Vec3::X, Vec3::Y].map(|axis| uv(plane.to_world(axis)));
        let opacities = (0..SAMPLES).map(|i| {
            let distance = hole.radius * ((f32::from(i) + 0.5) / f32::from(SAMPLES)).sqrt();
            let turn = Vec2::from_angle(TAU * (f32::from(i) * GOLDEN_TURN).fract()) * distance;
            alpha_mask.opacity(middle + turn.x * along_x + turn.y * along_y)
        });
        opacities.sum::<f32>() / f32::from(SAMPLES)
    }
}
