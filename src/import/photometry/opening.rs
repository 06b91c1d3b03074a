//! Shapes of luminous openings, and their surfaces as meshes.

use crate::scene::Mesh;
use glam::{DMat3, DVec3};
use std::f64::consts::{PI, TAU};

/// Largest accepted dimension, m.
const LARGEST: f64 = 1000.0;
/// Dimensions below this are 0, m.
const SMALLEST: f64 = 1e-5;
/// Breadth of an opening that has only a length, m.
const LINE_BREADTH: f64 = 1e-3;
/// Sides of the polygon that stands for an ellipse. It has the ellipse's area.
const SIDES: usize = 24;
/// Rings of the polyhedron that stands for an ellipsoid.
const RINGS: usize = 8;

/// Shape of a luminous opening with its dimensions along x (C0), y (C90) and z (up), m. Its center is the photometric
/// center.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum OpeningShape {
    /// No extent.
    Point,
    /// A box, or a rectangle if one dimension is 0.
    Box([f64; 3]),
    /// An upright elliptic cylinder, or an ellipse if the height is 0.
    Cylinder([f64; 3]),
    /// An ellipsoid.
    Ellipsoid([f64; 3]),
}

/// Accepts dimensions of at most [`LARGEST`].
fn checked(size: [f64; 3]) -> Result<[f64; 3], String> {
    match size.iter().find(|size| size.abs() > LARGEST) {
        Some(large) => Err(format!("the luminous opening has a dimension of {large} m")),
        None => Ok(size.map(|size| if size.abs() < SMALLEST { 0.0 } else { size })),
    }
}

impl OpeningShape {
    /// The shape for width, length and height of an IES file of a version from this `year`, m. Their signs encode it.
    ///
    /// # Errors
    /// If no version of the format defines the signs; the text is a problem without a full stop.
    pub(super) fn from_lm63(year: u32, size: [f64; 3]) -> Result<Self, String> {
        let [width, length, height] = checked(size)?;
        let [w, l, h] = [width, length, height].map(f64::abs);
        let shape = if w == 0.0 && l == 0.0 && h == 0.0 {
            Self::Point
        } else if height < 0.0 {
            match (width < 0.0, length < 0.0) {
                // A vertical disc has two of them. Horizontal cylinders become boxes.
                (true, false) if length == 0.0 => Self::Ellipsoid([w, w, h]),
                (false, true) if width == 0.0 => Self::Box([l, w, h]),
                (true, true) => Self::Ellipsoid([l, w, h]),
                (true, false) | (false, true) if year >= 2002 => Self::Box([l, w, h]),
                (true, false) | (false, true) => Self::Ellipsoid([l, w, h]),
                (false, false) if l > 0.0 && w == 0.0 => Self::Box([l, h, h]),
                (false, false) if l == 0.0 && w > 0.0 => Self::Box([h, w, h]),
                (false, false) => {
                    let signs = "only the height of the luminous opening is negative";
                    return Err(signs.into());
                }
            }
        } else if width < 0.0 || length < 0.0 {
            let [w, l] = [if w == 0.0 { l } else { w }, if l == 0.0 { w } else { l }];
            Self::Cylinder([l, w, h])
        } else {
            Self::Box([l, w, h])
        };
        Ok(shape)
    }

    /// The shape for length, width and height of an EULUMDAT file, m. The length is along C90; a width of 0 marks a disc.
    pub(super) fn from_eulumdat(size: [f64; 3]) -> Result<Self, String> {
        let [length, width, height] = checked(size)?;
        if let Some(negative) = [length, width, height].into_iter().find(|size| *size < 0.0) {
            return Err(format!("the luminous area has a dimension of {negative} m"));
        }
        Ok(match (length > 0.0, width > 0.0) {
            (false, false) => Self::Point,
            (true, false) => Self::Cylinder([length, length, height]),
            _ => Self::Box([width, length, height]),
        })
    }

    /// Dimensions of the circumscribed box, m.
    pub fn size(&self) -> [f64; 3] {
        match *self {
            Self::Point => [0.0; 3],
            Self::Box(size) | Self::Cylinder(size) | Self::Ellipsoid(size) => size,
        }
    }

    /// Width, length and height as an IES file of 2002 or 2019 encodes them, m.
    pub(super) fn to_lm63(self) -> [f64; 3] {
        match self {
            Self::Point => [0.0; 3],
            Self::Box([l, w, h]) => [w, l, h],
            Self::Cylinder([l, w, h]) => [-w, -l, h],
            Self::Ellipsoid([l, w, h]) => [-w, -l, -h],
        }
    }

    /// Surface of the opening around `position` with these axes, a scene unit being a meter; and whether it is a plane
    /// that emits from both sides. `None` for a point.
    pub fn surface(&self, axes: DMat3, position: DVec3) -> Option<(Mesh, bool)> {
        let (points, triangles, is_flat) = match *self {
            Self::Point => return None,
            Self::Box(size) => box_surface(size),
            Self::Cylinder([x, y, z]) => cylinder([x, y], z),
            Self::Ellipsoid(size) => {
                let (points, triangles) = ellipsoid(size);
                (points, triangles, false)
            }
        };
        let placed = |point: &DVec3| (position + axes * *point).as_vec3();
        let positions = points.iter().map(placed).collect();
        Some((Mesh { positions, triangles, ..Mesh::default() }, is_flat))
    }
}

type Surface = (Vec<DVec3>, Vec<[u32; 3]>, bool);

fn box_surface(mut size: [f64; 3]) -> Surface {
    let zeros = size.iter().filter(|size| **size == 0.0).count();
    if zeros > 1 {
        // A line keeps its height of 0, if it has one.
        let narrow = size.iter().position(|size| *size == 0.0).expect("two are 0");
        size[narrow] = LINE_BREADTH;
    }
    let half = size.map(|size| 0.5 * size);
    let corner = |signs: [f64; 3]| DVec3::from_array([0, 1, 2].map(|i| signs[i] * half[i]));
    if let Some(thin) = size.iter().position(|size| *size == 0.0) {
        let (a, b) = ((thin + 1) % 3, (thin + 2) % 3);
        let points = [[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]].map(|[u, v]| {
            let mut signs = [0.0; 3];
            (signs[a], signs[b]) = (u, v);
            corner(signs)
        });
        return (points.to_vec(), vec![[0, 1, 2], [0, 2, 3]], true);
    }
    let points = (0..8)
        .map(|bits| corner([0, 1, 2].map(|axis| if bits >> axis & 1 == 1 { 1.0 } else { -1.0 })));
    // Counterclockwise as seen from outside
    let faces: [[u32; 4]; 6] =
        [[0, 4, 6, 2], [1, 3, 7, 5], [0, 1, 5, 4], [2, 6, 7, 3], [0, 2, 3, 1], [4, 5, 7, 6]];
    let triangles = faces.iter().flat_map(|[a, b, c, d]| [[*a, *b, *c], [*a, *c, *d]]).collect();
    (points.collect(), triangles, false)
}

/// Factor of the radii of a regular polygon that has the area of its ellipse.
fn polygon_factor() -> f64 {
    let n = SIDES as f64;
    (PI / (0.5 * n * (TAU / n).sin())).sqrt()
}

fn cylinder([x, y]: [f64; 2], height: f64) -> Surface {
    let n = SIDES as u32;
    let radii = [0.5 * x, 0.5 * y].map(|radius| radius * polygon_factor());
    let ring = |z: f64| {
        (0..SIDES).map(move |i| {
            let (sin, cos) = (TAU * i as f64 / SIDES as f64).sin_cos();
            DVec3::new(radii[0] * cos, radii[1] * sin, z)
        })
    };
    if height == 0.0 {
        let fan = (1..n - 1).map(|i| [0, i, i + 1]).collect();
        return (ring(0.0).collect(), fan, true);
    }
    let points = ring(-0.5 * height).chain(ring(0.5 * height)).collect();
    let mut triangles = Vec::new();
    for i in 0..n {
        let next = (i + 1) % n;
        triangles.extend([[i, next, n + next], [i, n + next, n + i]]);
    }
    for i in 1..n - 1 {
        triangles.extend([[0, i + 1, i], [n, n + i, n + i + 1]]);
    }
    (points, triangles, false)
}

fn ellipsoid(size: [f64; 3]) -> (Vec<DVec3>, Vec<[u32; 3]>) {
    let radii = DVec3::from_array(size.map(|size| 0.5 * size.max(LINE_BREADTH)));
    let n = SIDES as u32;
    let mut points = vec![DVec3::NEG_Z * radii];
    for ring in 1..RINGS {
        let (across, z) = (PI * ring as f64 / RINGS as f64).sin_cos();
        points.extend((0..SIDES).map(|i| {
            let (sin, cos) = (TAU * i as f64 / SIDES as f64).sin_cos();
            DVec3::new(across * cos, across * sin, -z) * radii
        }));
    }
    points.push(DVec3::Z * radii);
    let last = points.len() as u32 - 1;
    let at = |ring: u32, i: u32| 1 + ring * n + i % n;
    let mut triangles = Vec::new();
    for i in 0..n {
        triangles.push([0, at(0, i + 1), at(0, i)]);
        for ring in 0..RINGS as u32 - 2 {
            let [a, b] = [at(ring, i), at(ring, i + 1)];
            let [c, d] = [at(ring + 1, i), at(ring + 1, i + 1)];
            triangles.extend([[a, b, d], [a, d, c]]);
        }
        let top = RINGS as u32 - 2;
        triangles.push([last, at(top, i), at(top, i + 1)]);
    }
    (points, triangles)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::Mesh;

    /// Volume inside a closed surface whose normals point outward, and its area.
    fn volume_and_area(mesh: &Mesh) -> [f64; 2] {
        let mut sums = [0.0; 2];
        for indices in &mesh.triangles {
            let [a, b, c] = indices.map(|i| mesh.positions[i as usize].as_dvec3());
            sums[0] += a.dot(b.cross(c)) / 6.0;
            sums[1] += 0.5 * (b - a).cross(c - a).length();
        }
        sums
    }

    #[test]
    fn surfaces_have_the_stated_size() {
        let surface = |shape: OpeningShape| shape.surface(DMat3::IDENTITY, DVec3::ZERO).unwrap();
        let (mesh, is_flat) = surface(OpeningShape::Box([2.0, 3.0, 0.5]));
        let [volume, area] = volume_and_area(&mesh);
        assert!(!is_flat && (volume - 3.0).abs() < 1e-6 && (area - 17.0).abs() < 1e-6);
        for thin in 0..3 {
            let mut size = [2.0, 2.0, 2.0];
            size[thin] = 0.0;
            let (mesh, is_flat) = surface(OpeningShape::Box(size));
            assert!(is_flat && (volume_and_area(&mesh)[1] - 4.0).abs() < 1e-6);
        }
        let (mesh, is_flat) = surface(OpeningShape::Cylinder([2.0, 4.0, 0.0]));
        assert!(is_flat && (volume_and_area(&mesh)[1] - 2.0 * PI).abs() < 1e-5);
        let (mesh, _) = surface(OpeningShape::Cylinder([2.0, 4.0, 3.0]));
        assert!((volume_and_area(&mesh)[0] - 6.0 * PI).abs() < 1e-4);
        let (mesh, _) = surface(OpeningShape::Ellipsoid([2.0, 2.0, 2.0]));
        let [volume, _] = volume_and_area(&mesh);
        assert!((volume / (4.0 / 3.0 * PI) - 1.0).abs() < 0.08, "{volume}");
        assert!(OpeningShape::Point.surface(DMat3::IDENTITY, DVec3::ZERO).is_none());
    }

    #[test]
    fn signs_of_dimensions_encode_the_shape() {
        let shape = |year, size| OpeningShape::from_lm63(year, size).unwrap();
        assert_eq!(shape(2002, [0.0; 3]), OpeningShape::Point);
        assert_eq!(shape(2002, [0.6, 1.2, 0.0]), OpeningShape::Box([1.2, 0.6, 0.0]));
        assert_eq!(shape(1986, [-0.2, 0.0, 0.0]), OpeningShape::Cylinder([0.2, 0.2, 0.0]));
        assert_eq!(shape(2002, [-0.2, -0.3, 0.1]), OpeningShape::Cylinder([0.3, 0.2, 0.1]));
        assert_eq!(shape(2002, [-0.2; 3]), OpeningShape::Ellipsoid([0.2; 3]));
        assert_eq!(shape(1995, [-0.2, 0.0, -0.2]), OpeningShape::Ellipsoid([0.2; 3]));
        assert_eq!(shape(1995, [0.0, 1.0, -0.1]), OpeningShape::Box([1.0, 0.1, 0.1]));
        assert_eq!(shape(2002, [-0.1, 1.0, -0.1]), OpeningShape::Box([1.0, 0.1, 0.1]));
        assert!(OpeningShape::from_lm63(2002, [0.1, 0.1, -0.1]).is_err());
        assert!(OpeningShape::from_lm63(2002, [1e4, 1.0, 0.0]).is_err());
        for shape in [
            OpeningShape::Point,
            OpeningShape::Box([1.2, 0.6, 0.1]),
            OpeningShape::Cylinder([0.3, 0.2, 0.0]),
            OpeningShape::Ellipsoid([0.3, 0.2, 0.1]),
        ] {
            assert_eq!(OpeningShape::from_lm63(2002, shape.to_lm63()), Ok(shape));
        }
    }
}
