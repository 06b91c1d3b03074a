//! Keys of cells: a position on a grid, a class of normals and a side of the surface in one word.
//! The keys of the cells in a larger cell have the key of the larger one as their prefix.

use glam::{UVec3, Vec3};

/// Bits of each coordinate.
const BITS: u32 = 19;

/// Largest coordinate.
const MOST: f32 = ((1 << BITS) - 1) as f32;

/// Classes of normals along each side of the faces of a cube. The number is odd, so that normals
/// along the axes are in the middle of a class.
const CLASSES: u32 = 3;

/// A vertex, as cells tell it from others.
#[derive(Clone, Copy, Debug, Default)]
pub struct CellPoint {
    /// Where it is.
    pub position: Vec3,
    /// Unit shading normal on the side that is seen.
    pub normal: Vec3,
    /// Whether the front of the surface is seen. The inside of a thin body lies next to the outside
    /// of its other face, with the same normal, and light does not come from one to the other.
    pub front: bool,
}

/// Key of the smallest cell around a position.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct CellKey(u64);

impl CellKey {
    /// The key of a vertex, its position in widths of the smallest cells. Positions outside of the
    /// grid belong to its border.
    #[inline]
    pub fn new(CellPoint { position, normal, front }: CellPoint) -> Self {
        // Casts of floating-point numbers saturate, and NaN becomes 0.
        let at = position.clamp(Vec3::ZERO, Vec3::splat(MOST)).as_uvec3();
        let UVec3 { x, y, z } = at;
        let place = spread(x) | spread(y) << 1 | spread(z) << 2;
        let surface = class(normal) << 1 | u32::from(front);
        Self(u64::from(surface) << (3 * BITS) | place)
    }

    /// Key of the cell of this level around it.
    #[inline]
    pub fn at_level(self, level: usize) -> u64 {
        self.0 >> (3 * level)
    }
}

/// Moves the bits of a coordinate apart, to every third place.
#[inline]
fn spread(x: u32) -> u64 {
    let mut x = u64::from(x);
    x = (x | x << 32) & 0x001f_0000_0000_ffff;
    x = (x | x << 16) & 0x001f_0000_ff00_00ff;
    x = (x | x << 8) & 0x100f_00f0_0f00_f00f;
    x = (x | x << 4) & 0x10c3_0c30_c30c_30c3;
    (x | x << 2) & 0x1249_2492_4924_9249
}

/// Class of a normal: a part of a face of the cube around it.
#[inline]
fn class(normal: Vec3) -> u32 {
    let size = normal.abs();
    let (face, along, [u, v]) = if size.x >= size.y && size.x >= size.z {
        (0, normal.x, [normal.y, normal.z])
    } else if size.y >= size.z {
        (2, normal.y, [normal.x, normal.z])
    } else {
        (4, normal.z, [normal.x, normal.y])
    };
    let face = face + u32::from(along < 0.0);
    let part = |across: f32| {
        let share = 0.5 + 0.5 * across / along.abs();
        ((share * CLASSES as f32) as u32).min(CLASSES - 1)
    };
    (face * CLASSES + part(u)) * CLASSES + part(v)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn larger_cells_hold_the_smaller_ones() {
        let point = |position: Vec3, front| CellPoint { position, normal: Vec3::Y, front };
        let key = |x: f32, y: f32, z: f32| CellKey::new(point(Vec3::new(x, y, z), true));
        let own = key(8.5, 3.0, 21.0);
        assert_eq!(own, key(8.0, 3.9, 21.7));
        assert_ne!(own, key(9.0, 3.0, 21.0));
        assert_eq!(own.at_level(1), key(9.9, 2.0, 20.0).at_level(1));
        assert_ne!(own.at_level(1), key(10.0, 3.0, 21.0).at_level(1));
        assert_eq!(own.at_level(2), key(11.0, 0.0, 20.0).at_level(2));
        let behind = CellKey::new(point(Vec3::new(8.5, 3.0, 21.0), false));
        assert!((0..4).all(|level| own.at_level(level) != behind.at_level(level)));
        let far = 2.0 * MOST;
        assert_eq!(key(-1.0, far, 0.0), key(0.0, MOST, f32::NAN));
    }

    #[test]
    fn normals_of_one_class_are_alike() {
        let mut all = std::collections::HashMap::<u32, Vec<Vec3>>::new();
        let steps = 24;
        for i in 0..steps * steps {
            let (phi, z) = (i % steps, i / steps);
            let z = (z as f32 + 0.5) * 2.0 / steps as f32 - 1.0;
            let phi = phi as f32 * std::f32::consts::TAU / steps as f32;
            let across = (1.0 - z * z).sqrt();
            let normal = Vec3::new(across * phi.cos(), across * phi.sin(), z);
            all.entry(class(normal)).or_default().push(normal);
        }
        assert_eq!(all.len() as u32, 6 * CLASSES * CLASSES);
        for normals in all.values() {
            for one in normals {
                assert!(normals.iter().all(|other| one.dot(*other) > 0.5));
            }
        }
        for axis in [Vec3::X, Vec3::NEG_Y, Vec3::Z] {
            let tilted = (axis + Vec3::new(0.1, -0.1, 0.1)).normalize();
            assert_eq!(class(axis), class(tilted));
        }
    }
}
