//! Connected components of triangles and their sides: triangles that share an edge of two
//! triangles.
//!
//! Triangles of a mesh that share an edge two by two are of one component, and so are triangles of
//! several meshes along edges that are borders of both. Where three or more meet, light may reach
//! one side and not the next, so there they stay apart. Vertices are the same if they are at the
//! same place. Of triangles with the same corners, only the first counts.

use super::surfaces::{Surfaces, corners};
use super::tags::{ComponentBox, tags};
use crate::accel::{Instance, TriangleMesh};
use glam::Vec3;
use rayon::prelude::*;
use std::collections::HashMap;

/// The components of a scene.
#[derive(Debug)]
pub struct Components {
    meshes: Vec<MeshComponents>,
    /// Mesh of each place, and the number of its first component.
    places: Vec<(u32, u32)>,
    /// The component that each is part of after meshes were joined, with the parity in the lowest
    /// bit.
    joined: Vec<u32>,
    /// Tag of each component.
    tags: Vec<u8>,
}

/// A side of a component.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SideId(pub u32);

impl SideId {
    /// Number of the component.
    pub fn component(self) -> u32 {
        self.0 >> 1
    }
}

/// The components of a mesh alone.
#[derive(Debug)]
struct MeshComponents {
    /// Component of each triangle; the lowest bit says whether its front is on the component's
    /// other side.
    of: Vec<u32>,
    /// Which triangles repeat another.
    is_double: Vec<bool>,
    count: u32,
    /// The boxes around the components, in the mesh's space.
    boxes: Vec<ComponentBox>,
    borders: Vec<Border>,
}

/// An edge that no other triangle of the mesh has.
#[derive(Clone, Copy, Debug)]
struct Border {
    triangle: u32,
    /// The edge begins at this corner, and ends at the next.
    corner: u8,
}

/// An edge of one triangle: from the lower to the higher vertex.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
struct Edge {
    vertices: [u32; 2],
    triangle: u32,
    /// Whether the triangle goes around it from the higher to the lower.
    backward: bool,
    /// The edge begins at this corner, and ends at the next.
    corner: u8,
}

impl Edge {
    fn new(from: u32, to: u32, triangle: u32, corner: u8) -> Self {
        Self { vertices: [from.min(to), from.max(to)], triangle, backward: from > to, corner }
    }
}

impl Components {
    /// Finds the components of all meshes at their places.
    pub fn new(surfaces: &dyn Surfaces) -> Self {
        let meshes: Vec<_> = surfaces.meshes().par_iter().map(MeshComponents::new).collect();
        let mut count = 0;
        let place = |place: &Instance| {
            let first = count;
            count += meshes[place.mesh as usize].count;
            (place.mesh, first)
        };
        let places: Vec<_> = surfaces.places().iter().map(place).collect();
        let mut sets = Sets::new(count);
        join_places(surfaces, &meshes, &places, &mut sets);
        let joined = sets.flattened();
        let mut boxes = vec![ComponentBox::EMPTY; joined.len()];
        for (place, &(mesh, first)) in surfaces.places().iter().zip(&places) {
            for (own, number) in meshes[mesh as usize].boxes.iter().zip(first..) {
                boxes[(joined[number as usize] >> 1) as usize].add(&own.placed(place));
            }
        }
        Self { tags: tags(&boxes), joined, meshes, places }
    }

    /// The side as photons hold it: the lowest bit distinguishes the sides of a component, and six
    /// bits are a tag of the component that neighbors do not have.
    #[inline]
    pub fn tag(&self, side: SideId) -> u8 {
        self.tags[side.component() as usize] << 1 | (side.0 & 1) as u8
    }

    /// A side of a triangle.
    pub fn side(&self, place: u32, triangle: u32, front: bool) -> SideId {
        let (mesh, first) = self.places[place as usize];
        let own = self.meshes[mesh as usize].of[triangle as usize];
        let joined = self.joined[(first + (own >> 1)) as usize];
        SideId(joined ^ (own & 1) ^ u32::from(!front))
    }

    /// Whether a triangle repeats another of its mesh.
    pub fn is_double(&self, place: u32, triangle: u32) -> bool {
        let (mesh, _) = self.places[place as usize];
        self.meshes[mesh as usize].is_double[triangle as usize]
    }

    /// Sides that there may be, numbered from 0.
    pub fn sides(&self) -> usize {
        2 * self.joined.len()
    }

    /// Size in bytes.
    pub fn bytes(&self) -> usize {
        let own = |mesh: &MeshComponents| {
            let borders = mesh.borders.capacity() * size_of::<Border>();
            let boxes = mesh.boxes.capacity() * size_of::<ComponentBox>();
            5 * mesh.of.capacity() + borders + boxes
        };
        let meshes: usize = self.meshes.iter().map(own).sum();
        let joined = 4 * self.joined.capacity() + self.tags.capacity();
        meshes + joined + 8 * self.places.capacity()
    }
}

impl MeshComponents {
    fn new(mesh: &TriangleMesh) -> Self {
        let mut numbers = HashMap::with_capacity(mesh.positions.len());
        let vertices: Vec<u32> = mesh.positions.iter().map(|&p| number(&mut numbers, p)).collect();
        let mut sets = Sets::new(mesh.triangles.len() as u32);
        let mut known = HashMap::with_capacity(mesh.triangles.len());
        let mut is_double = vec![false; mesh.triangles.len()];
        let mut edges = Vec::with_capacity(3 * mesh.triangles.len());
        for (indices, triangle) in mesh.triangles.iter().zip(0..) {
            let corners = indices.map(|index| vertices[index as usize]);
            let (sorted, is_odd) = sorted(corners);
            let &mut (first, first_is_odd) = known.entry(sorted).or_insert((triangle, is_odd));
            if first != triangle {
                is_double[triangle as usize] = true;
                sets.join(first, triangle, is_odd != first_is_odd);
                continue;
            }
            edges.extend((0..3).map(|corner| {
                let (from, to) = (corners[corner], corners[(corner + 1) % 3]);
                Edge::new(from, to, triangle, corner as u8)
            }));
        }
        edges.sort_unstable();
        let mut borders = Vec::new();
        for edges in edges.chunk_by(|a, b| a.vertices == b.vertices) {
            match edges {
                [a, b] => sets.join(a.triangle, b.triangle, a.backward == b.backward),
                &[Edge { triangle, corner, .. }] => borders.push(Border { triangle, corner }),
                _ => {}
            }
        }
        let mut of = sets.flattened();
        let mut order = HashMap::new();
        for own in &mut of {
            let next = order.len() as u32;
            *own = *order.entry(*own >> 1).or_insert(next) << 1 | *own & 1;
        }
        let mut boxes = vec![ComponentBox::EMPTY; order.len()];
        for (indices, own) in mesh.triangles.iter().zip(&of) {
            for index in indices {
                let corner = mesh.positions[*index as usize];
                boxes[(own >> 1) as usize].add(&ComponentBox { low: corner, high: corner });
            }
        }
        Self { of, is_double, count: order.len() as u32, boxes, borders }
    }
}

/// Vertices in ascending order, and whether that is the other way around.
fn sorted([a, b, c]: [u32; 3]) -> ([u32; 3], bool) {
    let mut sorted = [a, b, c];
    sorted.sort_unstable();
    let [low, middle, high] = sorted;
    (sorted, ![[a, b, c], [b, c, a], [c, a, b]].contains(&[low, middle, high]))
}

/// The number of a vertex at this position; zeros of both signs are one.
fn number(numbers: &mut HashMap<[u32; 3], u32>, position: Vec3) -> u32 {
    let next = numbers.len() as u32;
    *numbers.entry((position + Vec3::ZERO).to_array().map(f32::to_bits)).or_insert(next)
}

/// Joins components of several places along edges that are borders of two of them.
fn join_places(
    surfaces: &dyn Surfaces,
    meshes: &[MeshComponents],
    places: &[(u32, u32)],
    sets: &mut Sets,
) {
    let mut numbers = HashMap::new();
    let (mut edges, mut members) = (Vec::new(), Vec::new());
    for (index, (place, &(mesh, first))) in (0..).zip(surfaces.places().iter().zip(places)) {
        let MeshComponents { of, borders, .. } = &meshes[mesh as usize];
        for &Border { triangle, corner } in borders {
            let corners = corners(surfaces, place, triangle);
            let around = (corners[1] - corners[0]).cross(corners[2] - corners[0]);
            let reversed = surfaces.normal(index, triangle).as_dvec3().dot(around) < 0.0;
            let welded = corners.map(|corner| number(&mut numbers, corner.as_vec3()));
            let (from, to) = (welded[corner as usize], welded[(corner as usize + 1) % 3]);
            edges.push(Edge::new(from, to, members.len() as u32, corner));
            let own = of[triangle as usize];
            members.push((first + (own >> 1), own & 1 ^ u32::from(reversed)));
        }
    }
    edges.sort_unstable();
    for edges in edges.chunk_by(|a, b| a.vertices == b.vertices) {
        if let [a, b] = edges {
            let [(first, odd), (second, odd_too)] =
                [a, b].map(|edge| members[edge.triangle as usize]);
            sets.join(first, second, (a.backward == b.backward) ^ (odd != odd_too));
        }
    }
}

/// Sets that are joined, each member with a parity against the set's.
#[derive(Debug)]
struct Sets {
    /// Another member of the same set, or itself, with the parity against it in the lowest bit.
    parents: Vec<u32>,
}

impl Sets {
    fn new(count: u32) -> Self {
        Self { parents: (0..count).map(|member| member << 1).collect() }
    }

    /// The member that stands for the set, with the parity against it.
    fn find(&mut self, member: u32) -> u32 {
        let (mut at, mut parity) = (member, 0);
        loop {
            let parent = self.parents[at as usize];
            if parent >> 1 == at {
                return at << 1 | parity;
            }
            // Halves the way of the next.
            let next = self.parents[(parent >> 1) as usize];
            self.parents[at as usize] = next ^ (parent & 1);
            parity ^= self.parents[at as usize] & 1;
            at = self.parents[at as usize] >> 1;
        }
    }

    /// Joins the sets of two members; `opposite` if what is one's front is the other's back.
    fn join(&mut self, a: u32, b: u32, opposite: bool) {
        let (a, b) = (self.find(a), self.find(b));
        let (low, high) = if a >> 1 < b >> 1 { (a, b) } else { (b, a) };
        if low >> 1 != high >> 1 {
            self.parents[(high >> 1) as usize] = low ^ (high & 1) ^ u32::from(opposite);
        }
    }

    /// The representative of each member's set, with the parity.
    fn flattened(mut self) -> Vec<u32> {
        (0..self.parents.len() as u32).map(|member| self.find(member)).collect()
    }
}
