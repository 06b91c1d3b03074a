//! Transforms of meshes: affine maps that preserve front sides.

use super::Triangle;
use crate::accel::{TriangleMesh, instance_transform};
use crate::base::error::{Error, Result};
use glam::{DAffine3, DMat3, DMat4, DVec3, Vec3};

/// Maximum coordinate, scene units: the limit of the intersection backends.
pub const MAX_COORDINATE: f32 = TriangleMesh::MAX_COORDINATE;

/// An invertible affine map, kept in f64 so that only the result is rounded.
#[derive(Clone, Copy, Debug)]
pub struct Transform {
    map: DAffine3,
    /// Inverse transpose of its matrix.
    normals: DMat3,
    /// Determinant of its matrix; negative if it mirrors.
    determinant: f64,
    /// Factor by which the map and its inverse magnify rounding errors of coordinates, component by
    /// component: 1 for translation and scaling along the axes.
    magnification: f64,
    /// If true, the order of a triangle's corners is reversed.
    reverse: bool,
}

impl Transform {
    /// The identity.
    pub const IDENTITY: Self = Self {
        map: DAffine3::IDENTITY,
        normals: DMat3::IDENTITY,
        determinant: 1.0,
        magnification: 1.0,
        reverse: false,
    };

    /// Scales, then rotates about the x, y and z axis of the scene in this order (counterclockwise,
    /// degrees), then translates.
    ///
    /// # Errors
    /// If the map is not invertible.
    pub fn from_parts(translate: DVec3, rotate_deg: DVec3, scale: DVec3) -> Result<Self> {
        let [x, y, z] = rotate_deg.to_array().map(sin_cos);
        let about_x =
            DMat3::from_cols_array_2d(&[[1.0, 0.0, 0.0], [0.0, x.1, x.0], [0.0, -x.0, x.1]]);
        let about_y =
            DMat3::from_cols_array_2d(&[[y.1, 0.0, -y.0], [0.0, 1.0, 0.0], [y.0, 0.0, y.1]]);
        let about_z =
            DMat3::from_cols_array_2d(&[[z.1, z.0, 0.0], [-z.0, z.1, 0.0], [0.0, 0.0, 1.0]]);
        let rotation = about_z * about_y * about_x;
        Self::new(DAffine3::from_mat3_translation(
            rotation * DMat3::from_diagonal(scale),
            translate,
        ))
    }

    /// The transform of a matrix, given by rows, that multiplies column vectors.
    ///
    /// # Errors
    /// If it is not affine or not invertible.
    pub fn from_rows(rows: [[f64; 4]; 4]) -> Result<Self> {
        if rows[3] != [0.0, 0.0, 0.0, 1.0] {
            return Err(Error::new(
                "the last row of the matrix is not [0, 0, 0, 1]",
                "give an affine matrix, row by row, with the translation in the last column",
            ));
        }
        let matrix = DMat4::from_cols_array_2d(&rows).transpose();
        Self::new(DAffine3::from_mat4(matrix))
    }

    /// The rows of the matrix that multiplies column vectors.
    pub fn rows(&self) -> [[f64; 4]; 4] {
        DMat4::from(self.map).transpose().to_cols_array_2d()
    }

    /// Returns true if front and back sides are swapped, apart from mirroring.
    pub fn is_flipped(&self) -> bool {
        self.reverse != (self.determinant < 0.0)
    }

    /// The transform of an invertible map; refuses others.
    pub fn new(map: DAffine3) -> Result<Self> {
        let determinant = map.matrix3.determinant();
        if !(map.is_finite() && determinant.is_finite() && determinant != 0.0) {
            return Err(Error::new(
                "the transform flattens the mesh or is not finite",
                "give finite numbers and a scale other than 0 along each axis",
            ));
        }
        let inverse = map.matrix3.inverse();
        let abs = |m: DMat3| DMat3::from_cols(m.x_axis.abs(), m.y_axis.abs(), m.z_axis.abs());
        let magnification = (abs(map.matrix3) * (abs(inverse) * DVec3::ONE)).max_element();
        let (normals, reverse) = (inverse.transpose(), determinant < 0.0);
        Ok(Self { map, normals, determinant, magnification, reverse })
    }

    /// Additionally swaps front and back sides if `flip` is true.
    #[must_use]
    pub fn flipped(self, flip: bool) -> Self {
        Self { reverse: self.reverse != flip, ..self }
    }

    /// Transforms a point; `None` if the result exceeds [`MAX_COORDINATE`].
    pub fn point(&self, point: Vec3) -> Option<Vec3> {
        let moved = self.map.transform_point3(point.as_dvec3()).as_vec3() + Vec3::ZERO;
        // Written so that NaN fails.
        (moved.abs().cmple(Vec3::splat(MAX_COORDINATE)).all()).then_some(moved)
    }

    /// Transforms a normal with its surface, to unit length; zero stays zero. If front sides are
    /// swapped, so is the normal.
    pub(crate) fn normal(&self, normal: Vec3) -> Vec3 {
        self.turn(normal).0
    }

    /// The transformed unit normal, and its length before normalization.
    #[inline]
    fn turn(&self, normal: Vec3) -> (Vec3, f64) {
        let turned = self.normals * normal.as_dvec3();
        let length = turned.length();
        let swapped = self.reverse != (self.determinant < 0.0);
        let unit = if swapped { -length } else { length }.recip();
        // Infinite for zero, and for lengths below the smallest normal number.
        let turned = if unit.is_finite() { (turned * unit).as_vec3() } else { Vec3::ZERO };
        // Adding 0 makes zeros positive: the identity changes no bit.
        (turned + Vec3::ZERO, length)
    }

    /// Transforms a tangent with its surface, to unit length; zero stays zero.
    pub(crate) fn tangent(&self, tangent: Vec3) -> Vec3 {
        (self.map.matrix3 * tangent.as_dvec3()).normalize_or_zero().as_vec3()
    }

    /// Orders a triangle's corners, or data of them, so that its front stays in front.
    pub(crate) fn ordered<T>(&self, [a, b, c]: [T; 3]) -> [T; 3] {
        if self.reverse { [a, c, b] } else { [a, b, c] }
    }

    /// Barycentric weights of the second and third corner, in the order of
    /// [`ordered`](Self::ordered).
    pub(crate) fn weights(&self, [u, v]: [f32; 2]) -> [f32; 2] {
        if self.reverse { [v, u] } else { [u, v] }
    }

    /// The map, without a swap of sides.
    pub(crate) fn map(&self) -> DAffine3 {
        self.map
    }

    /// Returns true if an instance can have the transform: its numbers are in range, and rounding
    /// errors of rays stay close to those of the coordinates.
    pub fn suits_instances(&self) -> bool {
        instance_transform(self.map).is_ok() && self.magnification < 100.0
    }

    /// Transforms a point in double precision.
    pub fn point_exact(&self, point: DVec3) -> DVec3 {
        self.map.transform_point3(point)
    }

    /// This transform for a mesh whose positions are relative to `origin`, a point in the
    /// coordinates that the transform is for.
    #[must_use]
    pub fn relative_from(&self, origin: DVec3) -> Self {
        if origin == DVec3::ZERO {
            return *self;
        }
        let translation = self.map.transform_point3(origin);
        Self { map: DAffine3 { translation, ..self.map }, ..*self }
    }

    /// This transform with results relative to `origin`.
    #[must_use]
    pub fn relative_to(&self, origin: DVec3) -> Self {
        let translation = self.map.translation - origin;
        Self { map: DAffine3 { translation, ..self.map }, ..*self }
    }

    /// Transforms a triangle. Its offset covers the rounding errors of rays that an instance
    /// transforms: the largest coordinate counts for all axes.
    pub(crate) fn triangle(&self, stored: &Triangle) -> Triangle {
        let Triangle { origin, edge1, edge2, normal, area, .. } = *stored;
        let edge = |edge: Vec3| (self.map.matrix3 * edge.as_dvec3()).as_vec3();
        let [origin, edge1, edge2] = self.ordered([
            self.map.transform_point3(origin.as_dvec3()).as_vec3(),
            edge(edge1),
            edge(edge2),
        ]);
        let (normal, stretch) = self.turn(normal);
        let area = f64::from(area) * self.determinant.abs() * stretch;
        let largest = Triangle::largest([origin, origin + edge1, origin + edge2]);
        let reach = f64::from(largest.max_element()).max(self.map.translation.abs().max_element());
        Triangle {
            origin,
            edge1,
            edge2,
            normal,
            offset: Triangle::offset(normal, Vec3::splat((reach * self.magnification) as f32)),
            area: area as f32,
            ..*stored
        }
    }
}

/// Normalizes with a single rounding; zero stays zero.
pub fn normalized(vector: Vec3) -> Vec3 {
    vector.as_dvec3().normalize_or_zero().as_vec3()
}

/// The vector from one point to another. Far from the origin, positions in single precision have
/// steps larger than their distance: the vector is then that of the points in double precision.
pub fn vector_between(from: DVec3, to: DVec3) -> Vec3 {
    /// Maximum error of the difference of rounded positions, as a share of its length.
    const MAX_ERROR: f32 = 1e-4;
    let (rounded, exact) = (to.as_vec3() - from.as_vec3(), (to - from).as_vec3());
    if rounded.distance(exact) <= MAX_ERROR * exact.length() { rounded } else { exact }
}

/// Sine and cosine of an angle in degrees, exact for multiples of 90.
fn sin_cos(degrees: f64) -> (f64, f64) {
    let quarters = degrees / 90.0;
    if quarters.fract() == 0.0 {
        return [(0.0, 1.0), (1.0, 0.0), (0.0, -1.0), (-1.0, 0.0)]
            [quarters.rem_euclid(4.0) as usize];
    }
    degrees.to_radians().sin_cos()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parts(translate: [f64; 3], rotate: [f64; 3], scale: [f64; 3]) -> Transform {
        Transform::from_parts(translate.into(), rotate.into(), scale.into()).unwrap()
    }

    #[test]
    fn vectors_between_far_points_are_exact_and_others_those_of_rounded_points() {
        let between = |from: f64, to: f64| {
            vector_between(DVec3::new(from, 0.1, 0.0), DVec3::new(to, 0.3, 0.0))
        };
        assert_eq!(between(0.1, 0.7), Vec3::new(0.7f32 - 0.1, 0.3f32 - 0.1, 0.0));
        for far in [1e8, -1e12] {
            let exact = DVec3::new((far + 3.0) - far, 0.3 - 0.1, 0.0).as_vec3();
            assert_eq!(between(far, far + 3.0), exact);
        }
        assert_eq!(vector_between(DVec3::splat(1e8), DVec3::splat(1e8)), Vec3::ZERO);
    }

    #[test]
    fn from_parts_applies_scale_x_y_z_translate() {
        let scaled = parts([0.0; 3], [90.0, 0.0, 0.0], [2.0, 3.0, 4.0]);
        assert_eq!(scaled.point(Vec3::Y), Some(Vec3::new(0.0, 0.0, 3.0)));
        // About x first: +y goes to +z; then about y: +z goes to +x; then about z: +x goes to +y.
        let turned = parts([10.0, 20.0, 30.0], [90.0, 90.0, 90.0], [1.0; 3]);
        assert_eq!(turned.point(Vec3::Y), Some(Vec3::new(10.0, 21.0, 30.0)));
    }

    #[test]
    fn normals_turn_with_their_surfaces() {
        // A plane along (1, -1, 0) is stretched to one along (1, -2, 0).
        let stretched = parts([5.0; 3], [0.0; 3], [1.0, 2.0, 1.0]);
        let expected = Vec3::new(2.0, 1.0, 0.0).normalize();
        assert!((stretched.normal(Vec3::new(1.0, 1.0, 0.0)) - expected).length() < 1e-6);
        assert!((stretched.flipped(true).normal(Vec3::ONE - Vec3::Z) + expected).length() < 1e-6);
        // Mirrored with its surface a normal stays in front.
        let mirrored = parts([0.0; 3], [0.0; 3], [-1.0, 1.0, 1.0]);
        assert_eq!(mirrored.normal(Vec3::X), -Vec3::X);
        assert_eq!(mirrored.normal(Vec3::ZERO), Vec3::ZERO);
    }

    #[test]
    fn angles_turn_counterclockwise_and_quarters_are_exact() {
        let turned = |degrees| parts([0.0; 3], [0.0, 0.0, degrees], [1.0; 3]).point(Vec3::X);
        let exact = [(90.0, Vec3::Y), (-90.0, -Vec3::Y), (540.0, -Vec3::X), (-360.0, Vec3::X)];
        for (degrees, expected) in exact {
            assert_eq!(turned(degrees), Some(expected), "{degrees}");
        }
        let expected = Vec3::new(0.75_f32.sqrt(), 0.5, 0.0);
        assert!((turned(30.0).unwrap() - expected).length() < 1e-6);
        let huge = parts([0.0; 3], [1e300, -1e300, 0.0], [1.0; 3]).point(Vec3::X).unwrap();
        assert!((huge.length() - 1.0).abs() < 1e-6);
    }

    #[test]
    fn identity_changes_no_bit() {
        let point = Vec3::new(0.1, -1e11, 1e-30);
        assert_eq!(Transform::IDENTITY.point(point), Some(point));
        assert_eq!(parts([0.0; 3], [0.0; 3], [1.0; 3]).point(point), Some(point));
        assert_eq!(Transform::IDENTITY.ordered([1, 2, 3]), [1, 2, 3]);
    }

    #[test]
    fn from_rows_reads_a_matrix_row_by_row() {
        let rows = [
            [0.0, -1.0, 0.0, 5.0],
            [1.0, 0.0, 0.0, 6.0],
            [0.0, 0.0, 1.0, 7.0],
            [0.0, 0.0, 0.0, 1.0],
        ];
        let matrix = Transform::from_rows(rows).unwrap();
        assert_eq!(matrix.point(Vec3::X), Some(Vec3::new(5.0, 7.0, 7.0)));
        let same = parts([5.0, 6.0, 7.0], [0.0, 0.0, 90.0], [1.0; 3]);
        assert_eq!(matrix.point(Vec3::X), same.point(Vec3::X));
        let mut projective = rows;
        projective[3][0] = 0.1;
        assert!(Transform::from_rows(projective).unwrap_err().to_string().contains("last row"));
    }

    #[test]
    fn mirrors_keep_the_front_in_front() {
        // A triangle in the plane z = 0 whose front looks to +z: so it must after mirroring x.
        let corners = [Vec3::ZERO, Vec3::X, Vec3::Y];
        for (scale, flip, up) in [
            ([-1.0, 1.0, 1.0], false, 1.0),
            ([-1.0, 1.0, 1.0], true, -1.0),
            ([-1.0, -1.0, 1.0], false, 1.0),
            ([1.0, 1.0, 1.0], true, -1.0),
        ] {
            let mirror = parts([0.0; 3], [0.0; 3], scale).flipped(flip);
            let [a, b, c] =
                mirror.ordered([0, 1, 2]).map(|i| mirror.point(corners[i as usize]).unwrap());
            assert_eq!((b - a).cross(c - a).z, up, "{scale:?} {flip}");
        }
    }

    #[test]
    fn singular_and_overflowing_transforms_are_refused() {
        let bad = |scale: f64| Transform::from_parts(DVec3::ZERO, DVec3::ZERO, DVec3::splat(scale));
        for scale in [0.0, f64::NAN, f64::INFINITY, 1e200] {
            assert!(bad(scale).is_err(), "{scale}");
        }
        assert_eq!(parts([0.0; 3], [0.0; 3], [1e20; 3]).point(Vec3::ONE), None);
    }
}
