//! Boxes, discs, balls, bars and turned things.

use super::mesh::{Corner, Mesh, Vertex};
use super::profile::{ProfilePoint, arc};
use glam::{DVec2, DVec3, dvec3};

/// The sides of a box: left is -x, bottom -y, back -z.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Side {
    Left,
    Right,
    Bottom,
    Top,
    Back,
    Front,
}

/// A box whose fronts look outward.
pub fn cuboid(min: DVec3, max: DVec3) -> Mesh {
    cuboid_without(min, max, &[])
}

/// A box without some sides: those that stand on something or are never seen.
pub fn cuboid_without(min: DVec3, max: DVec3, missing: &[Side]) -> Mesh {
    // Bits of a corner's number: 1 for right, 2 for top, 4 for front.
    let corner = |i: usize| {
        let pick = |bit, low, high| if i & bit == 0 { low } else { high };
        dvec3(pick(1, min.x, max.x), pick(2, min.y, max.y), pick(4, min.z, max.z))
    };
    let sides = [
        (Side::Left, [0, 4, 6, 2]),
        (Side::Right, [1, 3, 7, 5]),
        (Side::Bottom, [0, 1, 5, 4]),
        (Side::Top, [2, 6, 7, 3]),
        (Side::Back, [0, 2, 3, 1]),
        (Side::Front, [4, 5, 7, 6]),
    ];
    let there = sides.into_iter().filter(|(side, _)| !missing.contains(side));
    let face = |(_, corners): (_, [usize; 4])| {
        corners.map(|position| Corner { position, normal: None }).to_vec()
    };
    Mesh {
        positions: (0..8).map(corner).collect(),
        normals: Vec::new(),
        faces: there.map(face).collect(),
    }
}

/// A surface of revolution about the y axis. The front is to the right of the profile's direction,
/// in a drawing with the radius to the right and y upward: that of a profile that goes up looks
/// outward, and a closed body's profile runs counterclockwise, from the axis below around to the
/// axis above. Points of radius 0 are poles. For an edge in the surface, join two surfaces of
/// revolution.
pub fn lathe(profile: &[ProfilePoint], segments: usize) -> Mesh {
    let row = |point: &ProfilePoint| ring(point, segments, 0.0, 360.0, true);
    Mesh::rows(&profile.iter().map(row).collect::<Vec<_>>(), true)
}

/// The part of a surface of revolution between two angles about the y axis, degrees from +z toward
/// +x.
pub fn lathe_part(profile: &[ProfilePoint], segments: usize, from: f64, to: f64) -> Mesh {
    let row = |point: &ProfilePoint| ring(point, segments, from, to, false);
    Mesh::rows(&profile.iter().map(row).collect::<Vec<_>>(), false)
}

fn ring(point: &ProfilePoint, segments: usize, from: f64, to: f64, closed: bool) -> Vec<Vertex> {
    let pole = point.at.x == 0.0;
    let points = if pole { 1 } else { segments + usize::from(!closed) };
    let vertex = |i: usize| {
        let angle = (from + (to - from) * i as f64 / segments as f64).to_radians();
        let turn = |v: DVec2| dvec3(v.x * angle.sin(), v.y, v.x * angle.cos());
        let along = |normal: DVec2| DVec2::new(0.0, normal.y.signum());
        let normal = point.normal.map(|n| turn(if pole { along(n) } else { n }));
        Vertex { position: turn(point.at), normal }
    };
    (0..points).map(vertex).collect()
}

/// A smooth ball about the origin, of `rings` quads from pole to pole and `segments` around.
pub fn sphere(radius: f64, rings: usize, segments: usize) -> Mesh {
    lathe(&arc(DVec2::ZERO, radius, -90.0, 90.0, rings), segments)
}

/// A flat disc in the plane y = 0, its front up.
pub fn disc(radius: f64, segments: usize) -> Mesh {
    let rim = (0..segments).map(|i| on_circle(radius, i, segments)).collect::<Vec<_>>();
    Mesh::polygon(&rim)
}

/// A flat ring in the plane y = 0, its front up.
pub fn annulus(inner: f64, outer: f64, segments: usize) -> Mesh {
    let ring = |radius| {
        (0..segments).map(|i| Vertex::flat(on_circle(radius, i, segments))).collect::<Vec<_>>()
    };
    Mesh::rows(&[ring(outer), ring(inner)], true)
}

fn on_circle(radius: f64, i: usize, segments: usize) -> DVec3 {
    let angle = (360.0 * i as f64 / segments as f64).to_radians();
    dvec3(radius * angle.sin(), 0.0, radius * angle.cos())
}

/// A line in the xy plane drawn along z, such as a molding or a step: flat strips between its
/// points from `from` to `to`, which is greater. The front is to the right of the line's direction
/// seen from +z.
pub fn extruded(line: &[DVec2], from: f64, to: f64) -> Mesh {
    let strip = |pair: &[DVec2]| {
        let at = |p: DVec2, z| dvec3(p.x, p.y, z);
        Mesh::polygon(&[at(pair[0], to), at(pair[0], from), at(pair[1], from), at(pair[1], to)])
    };
    Mesh::join(line.windows(2).map(strip))
}
