//! Loop subdivision surfaces (Loop 1987; Hoppe et al. 1994 for boundaries), with positions and
//! normals of the limit.

use bdpm_core::scene::Mesh;
use glam::Vec3;
use std::collections::HashMap;
use std::f32::consts::TAU;

/// Peak memory per triangle of the result, bytes: the rings of its vertices and the edges.
pub(super) const TRIANGLE_BYTES: f64 = 700.0;

/// Maximum number of triangles of the result, which take some seconds.
pub(super) const MAX_TRIANGLES: u64 = 1 << 22;

/// Number of triangles after `levels` subdivisions.
pub(super) fn triangle_count(triangles: usize, levels: u32) -> u64 {
    (triangles as u64).saturating_mul(4_u64.saturating_pow(levels))
}

/// Neighbors of each vertex, in order around it, and whether it is on a boundary.
struct Rings {
    neighbors: Vec<Vec<u32>>,
    is_boundary: Vec<bool>,
}

/// The mesh after `levels` subdivisions, its vertices moved to the limit surface; `None` if an edge
/// has more than two triangles or two triangles disagree about its direction.
pub(super) fn limit_surface(
    positions: &[Vec3],
    triangles: &[[u32; 3]],
    levels: u32,
) -> Option<Mesh> {
    let (mut positions, mut triangles) = (positions.to_vec(), triangles.to_vec());
    for _ in 0..levels {
        (positions, triangles) = refined(&positions, &triangles)?;
    }
    let rings = Rings::new(positions.len(), &triangles)?;
    let at = |i: u32| positions[i as usize];
    let mut limit = Vec::with_capacity(positions.len());
    let mut normals = Vec::with_capacity(positions.len());
    for (vertex, ring) in rings.neighbors.iter().enumerate() {
        let own = positions[vertex];
        let is_boundary = rings.is_boundary[vertex];
        limit.push(match (&ring[..], is_boundary) {
            ([], _) => own,
            ([first, .., last], true) => 0.6 * own + 0.2 * (at(*first) + at(*last)),
            ([_], true) => own,
            (ring, false) => {
                let n = ring.len() as f32;
                let gamma = 1.0 / (n + 3.0 / (8.0 * beta(ring.len())));
                ring.iter().fold((1.0 - n * gamma) * own, |sum, i| sum + gamma * at(*i))
            }
        });
        // Tangents of the limit surface: the second eigenvectors.
        let (mut s, mut t) = (Vec3::ZERO, Vec3::ZERO);
        if !is_boundary {
            for (i, neighbor) in ring.iter().enumerate() {
                let (sin, cos) = (TAU * i as f32 / ring.len() as f32).sin_cos();
                s += cos * at(*neighbor);
                t += sin * at(*neighbor);
            }
        }
        normals.push(s.cross(t).normalize_or_zero());
    }
    // Normals at boundaries, and degenerate ones, are the mean of those of the triangles.
    let mut means = vec![Vec3::ZERO; limit.len()];
    for corners in &triangles {
        let [a, b, c] = corners.map(|i| limit[i as usize]);
        let normal = (b - a).cross(c - a);
        corners.iter().for_each(|i| means[*i as usize] += normal);
    }
    for (normal, mean) in normals.iter_mut().zip(means) {
        if *normal == Vec3::ZERO || normal.dot(mean) < 0.0 {
            *normal = mean.normalize_or_zero();
        }
    }
    Some(Mesh { positions: limit, normals, triangles, ..Mesh::default() })
}

fn beta(valence: usize) -> f32 {
    if valence == 3 { 3.0 / 16.0 } else { 3.0 / (8.0 * valence as f32) }
}

impl Rings {
    fn new(count: usize, triangles: &[[u32; 3]]) -> Option<Self> {
        // For each directed edge that leaves a vertex, the third vertex of its triangle.
        let mut next: Vec<HashMap<u32, u32>> = vec![HashMap::new(); count];
        for [a, b, c] in triangles.iter().copied() {
            for (from, to, third) in [(a, b, c), (b, c, a), (c, a, b)] {
                if next[from as usize].insert(to, third).is_some() {
                    return None;
                }
            }
        }
        let mut rings = Self { neighbors: Vec::with_capacity(count), is_boundary: Vec::new() };
        for around in &next {
            // The start of an open fan is a neighbor that no triangle leads to.
            let ends: std::collections::HashSet<u32> = around.values().copied().collect();
            let mut open: Vec<u32> =
                around.keys().copied().filter(|start| !ends.contains(start)).collect();
            open.sort_unstable();
            if open.len() > 1 {
                return None;
            }
            let start = open.first().copied().or_else(|| around.keys().copied().min());
            let mut ring = Vec::with_capacity(around.len() + 1);
            let mut current = start;
            while let Some(vertex) = current {
                if ring.len() > around.len() || (!ring.is_empty() && Some(vertex) == start) {
                    break;
                }
                ring.push(vertex);
                current = around.get(&vertex).copied();
            }
            rings.is_boundary.push(!open.is_empty());
            rings.neighbors.push(ring);
        }
        Some(rings)
    }
}

/// One step of subdivision: each triangle becomes four.
fn refined(positions: &[Vec3], triangles: &[[u32; 3]]) -> Option<(Vec<Vec3>, Vec<[u32; 3]>)> {
    let rings = Rings::new(positions.len(), triangles)?;
    let at = |i: u32| positions[i as usize];
    let mut made: Vec<Vec3> = Vec::with_capacity(4 * positions.len());
    for (vertex, ring) in rings.neighbors.iter().enumerate() {
        let own = positions[vertex];
        made.push(match (&ring[..], rings.is_boundary[vertex]) {
            ([first, .., last], true) => 0.75 * own + 0.125 * (at(*first) + at(*last)),
            (ring, false) if !ring.is_empty() => {
                let (n, weight) = (ring.len() as f32, beta(ring.len()));
                ring.iter().fold((1.0 - n * weight) * own, |sum, i| sum + weight * at(*i))
            }
            _ => own,
        });
    }
    // The third vertices of the triangles at each edge.
    let mut thirds: HashMap<(u32, u32), Vec<u32>> = HashMap::new();
    for [a, b, c] in triangles.iter().copied() {
        for (from, to, third) in [(a, b, c), (b, c, a), (c, a, b)] {
            thirds.entry((from.min(to), from.max(to))).or_default().push(third);
        }
    }
    let mut middles: HashMap<(u32, u32), u32> = HashMap::new();
    let mut finer = Vec::with_capacity(4 * triangles.len());
    for [a, b, c] in triangles.iter().copied() {
        let mut middle = |from: u32, to: u32| {
            let key = (from.min(to), from.max(to));
            *middles.entry(key).or_insert_with(|| {
                made.push(match thirds[&key][..] {
                    [one, other] => 0.375 * (at(from) + at(to)) + 0.125 * (at(one) + at(other)),
                    _ => 0.5 * (at(from) + at(to)),
                });
                made.len() as u32 - 1
            })
        };
        let [ab, bc, ca] = [middle(a, b), middle(b, c), middle(c, a)];
        finer.extend([[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]]);
    }
    Some((made, finer))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn flat_meshes_stay_flat_and_keep_their_normals() {
        // A hexagon around its center: the interior vertex is regular.
        let mut positions = vec![Vec3::ZERO];
        positions.extend((0..6).map(|i| {
            let (sin, cos) = (TAU * i as f32 / 6.0).sin_cos();
            Vec3::new(cos, sin, 0.0)
        }));
        let triangles: Vec<_> = (0..6).map(|i| [0, 1 + i, 1 + (i + 1) % 6]).collect();
        let mesh = limit_surface(&positions, &triangles, 2).unwrap();
        assert_eq!(mesh.triangles.len(), 6 * 16);
        assert!(mesh.positions.iter().all(|point| point.z.abs() < 1e-6));
        assert!(mesh.normals.iter().all(|normal| (*normal - Vec3::Z).length() < 1e-4));
        assert!(mesh.positions[0].length() < 1e-6, "{}", mesh.positions[0]);
    }

    #[test]
    fn limit_points_do_not_depend_on_the_number_of_subdivisions() {
        // An octahedron: the limit of a vertex of the control mesh is known after no step already.
        let axes = [Vec3::X, Vec3::Y, Vec3::Z];
        let positions: Vec<Vec3> = axes.iter().flat_map(|axis| [*axis, -*axis]).collect();
        let triangles = [
            [0, 2, 4],
            [2, 1, 4],
            [1, 3, 4],
            [3, 0, 4],
            [2, 0, 5],
            [1, 2, 5],
            [3, 1, 5],
            [0, 3, 5],
        ];
        let coarse = limit_surface(&positions, &triangles, 0).unwrap();
        for levels in 1..4 {
            let fine = limit_surface(&positions, &triangles, levels).unwrap();
            for (vertex, position) in positions.iter().enumerate() {
                let off = fine.positions[vertex] - coarse.positions[vertex];
                assert!(off.length() < 1e-5, "{levels}: {off}");
                let outward = fine.normals[vertex].dot(*position);
                assert!((outward - 1.0).abs() < 1e-5, "{outward}");
            }
        }
    }

    #[test]
    fn edges_of_three_triangles_are_refused() {
        let positions = vec![Vec3::ZERO, Vec3::X, Vec3::Y, Vec3::Z, Vec3::ONE];
        let triangles = [[0, 1, 2], [0, 1, 3], [0, 1, 4]];
        assert!(limit_surface(&positions, &triangles, 1).is_none());
    }
}
