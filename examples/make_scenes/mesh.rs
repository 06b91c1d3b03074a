//! Building meshes: flat faces, smooth patches, and what is done to them.
//!
//! Everything is in scene units and f64; only the printed text is rounded. Vertices are shared by
//! construction, never by comparing numbers, so that files do not depend on the last bit of a sine.

use glam::{DAffine3, DMat3, DVec3};

/// A corner of a face: indices of its position and, where the surface is smooth, its normal.
#[derive(Clone, Copy, Debug)]
pub struct Corner {
    pub position: usize,
    pub normal: Option<usize>,
}

/// A point of a smooth patch; without a normal the faces around it are flat.
#[derive(Clone, Copy, Debug)]
pub struct Vertex {
    pub position: DVec3,
    pub normal: Option<DVec3>,
}

impl Vertex {
    pub fn flat(position: DVec3) -> Self {
        Self { position, normal: None }
    }
}

/// Convex polygons whose corners run counterclockwise seen from the front.
#[derive(Clone, Debug, Default)]
pub struct Mesh {
    pub positions: Vec<DVec3>,
    pub normals: Vec<DVec3>,
    pub faces: Vec<Vec<Corner>>,
}

impl Mesh {
    /// One flat convex polygon, counterclockwise seen from its front.
    pub fn polygon(corners: &[DVec3]) -> Self {
        let face = (0..corners.len()).map(|position| Corner { position, normal: None }).collect();
        Self { positions: corners.to_vec(), normals: Vec::new(), faces: vec![face] }
    }

    /// Rows of points, neighbors joined by quads. The front is where
    /// `along a row x to the next row` points. A row of one point is a pole: triangles meet there.
    /// `closed` rows join their last point to their first; all rows but poles are equally long.
    pub fn rows(rows: &[Vec<Vertex>], closed: bool) -> Self {
        let mut mesh = Self::default();
        let corners: Vec<Vec<Corner>> =
            rows.iter().map(|row| row.iter().map(|vertex| mesh.vertex(vertex)).collect()).collect();
        for pair in corners.windows(2) {
            let (here, next) = (&pair[0], &pair[1]);
            let points = here.len().max(next.len());
            for i in 0..if closed { points } else { points - 1 } {
                let j = (i + 1) % points;
                let mut face = Vec::with_capacity(4);
                match (here.len(), next.len()) {
                    (1, _) => face.extend([here[0], next[j], next[i]]),
                    (_, 1) => face.extend([here[i], here[j], next[0]]),
                    _ => face.extend([here[i], here[j], next[j], next[i]]),
                }
                mesh.faces.push(face);
            }
        }
        mesh
    }

    /// A patch of `columns` by `rows` quads over the unit square; its front is where
    /// `d/du x d/dv` points.
    pub fn patch(columns: usize, rows: usize, at: impl Fn(f64, f64) -> Vertex) -> Self {
        let share = |i: usize, n: usize| i as f64 / n as f64;
        let row = |j| (0..=columns).map(|i| at(share(i, columns), share(j, rows))).collect();
        Self::rows(&(0..=rows).map(row).collect::<Vec<_>>(), false)
    }

    fn vertex(&mut self, vertex: &Vertex) -> Corner {
        self.positions.push(vertex.position);
        let normal = vertex.normal.map(|normal| {
            self.normals.push(normal);
            self.normals.len() - 1
        });
        Corner { position: self.positions.len() - 1, normal }
    }

    /// Adds another mesh.
    pub fn push(&mut self, other: Self) {
        let (positions, normals) = (self.positions.len(), self.normals.len());
        self.positions.extend(other.positions);
        self.normals.extend(other.normals);
        self.faces.extend(other.faces.into_iter().map(|face| {
            let moved = |corner: Corner| Corner {
                position: corner.position + positions,
                normal: corner.normal.map(|normal| normal + normals),
            };
            face.into_iter().map(moved).collect()
        }));
    }

    /// Many meshes as one.
    pub fn join(meshes: impl IntoIterator<Item = Self>) -> Self {
        let mut all = Self::default();
        meshes.into_iter().for_each(|mesh| all.push(mesh));
        all
    }

    /// The mesh moved by an affine map; front sides stay in front even if it mirrors.
    #[must_use]
    pub fn transformed(mut self, map: DAffine3) -> Self {
        let normals: DMat3 = map.matrix3.inverse().transpose();
        self.positions.iter_mut().for_each(|p| *p = map.transform_point3(*p));
        self.normals.iter_mut().for_each(|n| *n = (normals * *n).normalize());
        if map.matrix3.determinant() < 0.0 {
            self.faces.iter_mut().for_each(|face| face.reverse());
        }
        self
    }

    #[must_use]
    pub fn moved(self, x: f64, y: f64, z: f64) -> Self {
        self.transformed(DAffine3::from_translation(DVec3::new(x, y, z)))
    }

    /// Scaled about the origin.
    #[must_use]
    pub fn scaled(self, x: f64, y: f64, z: f64) -> Self {
        self.transformed(DAffine3::from_scale(DVec3::new(x, y, z)))
    }

    /// Turned about the x axis, counterclockwise seen from its tip: +y goes toward +z.
    #[must_use]
    pub fn turned_x(self, degrees: f64) -> Self {
        self.transformed(DAffine3::from_rotation_x(degrees.to_radians()))
    }

    /// Turned about the y axis, counterclockwise seen from its tip: +z goes toward +x.
    #[must_use]
    pub fn turned_y(self, degrees: f64) -> Self {
        self.transformed(DAffine3::from_rotation_y(degrees.to_radians()))
    }

    /// Turned about the z axis, counterclockwise seen from its tip: +x goes toward +y.
    #[must_use]
    pub fn turned_z(self, degrees: f64) -> Self {
        self.transformed(DAffine3::from_rotation_z(degrees.to_radians()))
    }

    /// Front and back swapped.
    #[must_use]
    pub fn flipped(mut self) -> Self {
        self.faces.iter_mut().for_each(|face| face.reverse());
        self.normals.iter_mut().for_each(|normal| *normal = -*normal);
        self
    }
}
