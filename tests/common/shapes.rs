//! Meshes and rays that the tests and benches of the intersection backends share.
#![allow(dead_code)] // each of them uses a part

use bdpm::accel::{Ray, TriangleMesh};
use glam::Vec3;
use std::f32::consts::{PI, TAU};

/// An owned triangle mesh.
#[derive(Default)]
pub struct Mesh {
    pub positions: Vec<Vec3>,
    pub triangles: Vec<[u32; 3]>,
}

impl Mesh {
    pub fn view(&self) -> TriangleMesh<'_> {
        TriangleMesh { positions: &self.positions, triangles: &self.triangles }
    }

    /// The surface of an axis-aligned box turned by `angle` around z: 12 triangles, closed.
    pub fn cuboid(center: Vec3, half: Vec3, angle: f32) -> Self {
        let corner = |i: u32| {
            let sign = |bit: u32| if i >> bit & 1 == 1 { 1.0 } else { -1.0 };
            let p = half * Vec3::new(sign(0), sign(1), sign(2));
            let (sin, cos) = angle.sin_cos();
            center + Vec3::new(p.x * cos - p.y * sin, p.x * sin + p.y * cos, p.z)
        };
        let faces =
            [[0, 1, 3, 2], [4, 5, 7, 6], [0, 1, 5, 4], [2, 3, 7, 6], [0, 2, 6, 4], [1, 3, 7, 5]];
        Self {
            positions: (0..8).map(corner).collect(),
            triangles: faces.iter().flat_map(|&[a, b, c, d]| [[a, b, c], [a, c, d]]).collect(),
        }
    }

    /// A closed, bumpy ball of radius about 0.9, with `2 * n * (n - 1)` triangles.
    pub fn bumpy_ball(n: u32) -> Self {
        let mut positions = vec![];
        for row in 0..=n {
            for column in 0..n {
                let (theta, phi) = (PI * row as f32 / n as f32, TAU * column as f32 / n as f32);
                let radius = 0.9 + 0.05 * (9.0 * theta).sin() * (7.0 * phi).sin();
                let ring = if row == 0 || row == n { 0.0 } else { theta.sin() };
                let direction = Vec3::new(ring * phi.cos(), ring * phi.sin(), theta.cos());
                positions.push(radius * direction);
            }
        }
        // At the poles all columns meet in one point; use its first name.
        let name = |row, column| {
            if row == 0 || row == n { row * n } else { row * n + column % n }
        };
        let mut triangles = vec![];
        for row in 0..n {
            for column in 0..n {
                let [a, b] = [name(row, column), name(row, column + 1)];
                let [c, d] = [name(row + 1, column), name(row + 1, column + 1)];
                if row > 0 {
                    triangles.push([a, b, c]);
                }
                if row < n - 1 {
                    triangles.push([b, d, c]);
                }
            }
        }
        Self { positions, triangles }
    }

    /// Unconnected triangles of all sizes in the unit cube around the origin.
    pub fn soup(count: u32, random: &mut Random) -> Self {
        let mut mesh = Self::default();
        for i in 0..count {
            let center = random.point();
            let size = 10_f32.powf(-3.0 * random.unit());
            mesh.positions.extend((0..3).map(|_| center + size * random.point()));
            mesh.triangles.push([3 * i, 3 * i + 1, 3 * i + 2]);
        }
        mesh
    }
}

/// A closed room with two blocks in it, as in the Cornell box: 36 triangles in 3 meshes.
pub fn room() -> Vec<Mesh> {
    vec![
        Mesh::cuboid(Vec3::ZERO, Vec3::ONE, 0.0),
        Mesh::cuboid(Vec3::new(-0.35, 0.3, -0.4), Vec3::new(0.3, 0.3, 0.6), 0.3),
        Mesh::cuboid(Vec3::new(0.35, -0.3, -0.7), Vec3::splat(0.3), -0.3),
    ]
}

/// SplitMix64: small, seeded, and independent of the code under test.
pub struct Random(pub u64);

impl Random {
    pub fn bits(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let z = (self.0 ^ (self.0 >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    /// In [0, 1).
    pub fn unit(&mut self) -> f32 {
        (self.bits() >> 40) as f32 / (1 << 24) as f32
    }

    /// In the cube from -1 to 1.
    pub fn point(&mut self) -> Vec3 {
        2.0 * Vec3::new(self.unit(), self.unit(), self.unit()) - 1.0
    }

    /// Uniform on the unit sphere.
    pub fn direction(&mut self) -> Vec3 {
        let z = 2.0 * self.unit() - 1.0;
        let (sin, cos) = (TAU * self.unit()).sin_cos();
        let ring = (1.0 - z * z).max(0.0).sqrt();
        Vec3::new(ring * cos, ring * sin, z)
    }

    /// From anywhere in the unit cube to anywhere, with directions of all lengths, a part of them
    /// along an axis, a part of them bounded.
    pub fn ray(&mut self) -> Ray {
        let mut direction = self.direction() * 10_f32.powf(4.0 * self.unit() - 2.0);
        if self.unit() < 0.1 {
            direction *= [Vec3::X, Vec3::Y, Vec3::Z][(self.bits() % 3) as usize];
            if direction == Vec3::ZERO {
                direction = Vec3::X;
            }
        }
        let ray = Ray::new(0.95 * self.point(), direction);
        let length = direction.length();
        match self.bits() % 4 {
            0 => Ray { t_far: 2.0 * self.unit() / length, ..ray },
            1 => Ray { t_near: self.unit() / length, ..ray },
            _ => ray,
        }
    }

    /// As diffuse bounces are: unrelated neighbors, all inside the unit cube.
    pub fn incoherent_rays(&mut self, count: usize) -> Vec<Ray> {
        (0..count).map(|_| Ray::new(0.95 * self.point(), self.direction())).collect()
    }
}

/// As camera rays are: from one point through neighboring pixels, in 4 by 4 blocks.
pub fn coherent_rays(count: usize) -> Vec<Ray> {
    let width = (count as f32).sqrt().ceil() as usize / 4 * 4 + 4;
    let pixel = |i: usize| {
        let (block, inside) = (i / 16, i % 16);
        let blocks = width / 4;
        let x = (block % blocks * 4 + inside % 4) as f32 / width as f32 - 0.5;
        let y = (block / blocks * 4 + inside / 4) as f32 / width as f32 - 0.5;
        Ray::new(Vec3::new(0.05, -0.95, 0.02), Vec3::new(x, 1.0, y))
    };
    (0..count).map(pixel).collect()
}
