//! Where in a scene no surface is near, so that no ball of a merge reaches one.

use crate::base::math::Bounds;
use crate::scene::{Scene, Triangle};
use glam::{UVec3, Vec3};

/// Maximum number of cells along the longest side of the scene.
const MOST_CELLS: f32 = 96.0;

/// Cells of a scene, and which of them have a surface within a distance.
#[derive(Clone, Debug)]
pub struct Clearance {
    /// Distance within which a surface is near, scene units.
    distance: f32,
    corner: Vec3,
    inverse_cell: f32,
    size: UVec3,
    /// Along x, then y, then z.
    is_near: Vec<bool>,
}

impl Clearance {
    /// Finds the cells that have a surface within `distance`, scene units.
    pub fn of_scene(scene: &Scene, distance: f32) -> Self {
        let Bounds { min, max } = *scene.bounds();
        let cell = ((max - min).max_element() / MOST_CELLS).max(0.5 * distance);
        // Nothing is near positions outside of the grid.
        let corner = min - distance;
        let size = (((max - min + 2.0 * distance) / cell).ceil().as_uvec3()).max(UVec3::ONE);
        let mut own = Self {
            distance,
            corner,
            inverse_cell: cell.recip(),
            size,
            is_near: vec![false; size.element_product() as usize],
        };
        // From the center of a cell to its corners
        let reach = distance + 0.5 * 3f32.sqrt() * cell;
        for triangle in scene.triangles() {
            let Triangle { origin: a, edge1, edge2, normal, .. } = triangle;
            let [b, c] = [a + edge1, a + edge2];
            let first = own.cell(a.min(b).min(c) - distance);
            let last = own.cell(a.max(b).max(c) + distance);
            for z in first.z..=last.z {
                for y in first.y..=last.y {
                    for x in first.x..=last.x {
                        let at = UVec3::new(x, y, z);
                        let center = corner + (at.as_vec3() + 0.5) * cell;
                        if normal.dot(center - a).abs() <= reach {
                            let index = own.index(at);
                            own.is_near[index] = true;
                        }
                    }
                }
            }
        }
        own
    }

    /// Returns true if no surface is within the distance of a position. False is no proof of the
    /// contrary.
    #[inline]
    pub fn is_free(&self, position: Vec3) -> bool {
        let at = (position - self.corner) * self.inverse_cell;
        let inside = at.cmpge(Vec3::ZERO).all() && at.cmplt(self.size.as_vec3()).all();
        !inside || !self.is_near[self.index(at.as_uvec3())]
    }

    /// Distance within which a surface is near, scene units.
    pub fn distance(&self) -> f32 {
        self.distance
    }

    /// The cell of a position, or the nearest one.
    fn cell(&self, position: Vec3) -> UVec3 {
        // Negative numbers become 0.
        ((position - self.corner) * self.inverse_cell).as_uvec3().min(self.size - 1)
    }

    fn index(&self, cell: UVec3) -> usize {
        let [x, y, z] = cell.to_array().map(|along| along as usize);
        let [across, down, _] = self.size.to_array().map(|along| along as usize);
        (z * down + y) * across + x
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::rng::{Stream, StreamKey};
    use crate::scene::bsdf::Bsdf;
    use crate::scene::{Camera, FieldOfView, Material, Mesh};

    /// Distance from a point to a triangle by brute force over points on it.
    fn distance_to(corners: [Vec3; 3], position: Vec3) -> f32 {
        let [a, b, c] = corners;
        let steps = 200;
        let mut least = f32::INFINITY;
        for i in 0..=steps {
            for j in 0..=steps - i {
                let [u, v] = [i, j].map(|step| step as f32 / steps as f32);
                least = least.min(position.distance(a + u * (b - a) + v * (c - a)));
            }
        }
        least
    }

    #[test]
    fn free_positions_have_no_surface_within_the_distance() {
        let corners = [Vec3::ZERO, Vec3::new(2.0, 0.3, 0.0), Vec3::new(0.4, 1.5, 1.0)];
        let (positions, triangles) = (corners.to_vec(), vec![[0, 1, 2]]);
        let mesh = Mesh { positions, triangles, ..Mesh::default() };
        let camera = Camera::look(Vec3::Z, -Vec3::Z, Vec3::Y, FieldOfView::X(60.0)).unwrap();
        let materials = vec![Material::new("white", Bsdf::diffuse(Vec3::ONE))];
        let scene =
            Scene::new("one".into(), vec![mesh], materials, vec![], camera, vec![]).unwrap();
        let clearance = Clearance::of_scene(&scene, 0.2);
        let mut rng = StreamKey::new(1, Stream::Test, 0).rng(0);
        let (mut free, mut near) = (0, 0);
        for _ in 0..400 {
            let position = 3.0 * Vec3::new(rng.next_1d(), rng.next_1d(), rng.next_1d()) - 0.5;
            let distance = distance_to(corners, position);
            if clearance.is_free(position) {
                free += 1;
                assert!(distance > 0.2, "{position} {distance}");
            } else {
                near += u32::from(distance <= 0.2);
            }
        }
        assert!(free > 50 && near > 5, "{free} {near}");
        // Outside of the grid
        assert!(clearance.is_free(Vec3::splat(50.0)));
    }
}
