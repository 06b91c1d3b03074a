//! The shell of the hall: floor, walls, gallery, entablature, apse, and the coffered vault.

use super::super::mesh::{Mesh, Vertex};
use super::super::obj::Model;
use super::super::profile::{self, arc, line};
use super::super::shapes::{Side, cuboid_without, extruded, lathe, lathe_part};
use super::measures::*;
use glam::{DVec2, DVec3, dvec2, dvec3};

/// Everything that is there once.
pub fn shell() -> Model {
    Model::new("The hall without what is there many times. Meters.")
        .decimals(3, 4)
        .part("floor-light", "marble-light", tiles(0))
        .part("floor-dark", "marble-dark", tiles(1))
        .part("walls", "plaster", walls())
        .part("partitions", "plaster", partitions())
        .part("gallery", "stone", both_sides(&gallery()))
        .part("entablature", "stone", both_sides(&entablature()))
        .part("rails", "stone", rails())
        .part("apse", "azure", apse())
        .part("archivolt", "stone", archivolt())
        .part("roof", "plaster", roof())
}

/// Every other tile of the floor, and of the apse's.
fn tiles(which: usize) -> Mesh {
    let (columns, rows) = (24, 56);
    let (width, depth) = (2.0 * WALL / columns as f64, 2.0 * END / rows as f64);
    let extra = (APSE / depth).ceil() as usize;
    let mut mesh = Mesh::default();
    for j in 0..rows + extra {
        for i in 0..columns {
            let (x, z) = (i as f64 * width - WALL, END - j as f64 * depth);
            // Under the apse only as wide as it is.
            let needed = j < rows || (x + width > -APSE && x < APSE);
            if (i + j) % 2 == which && needed {
                mesh.push(flat([x, x + width], [z - depth, z], 0.0));
            }
        }
    }
    mesh
}

/// A level rectangle, its front up.
fn flat([x0, x1]: [f64; 2], [z0, z1]: [f64; 2], y: f64) -> Mesh {
    Mesh::polygon(&[dvec3(x0, y, z1), dvec3(x1, y, z1), dvec3(x1, y, z0), dvec3(x0, y, z0)])
}

/// The outer walls along the hall, the wall behind the camera, and the one with the apse's arch.
fn walls() -> Mesh {
    let height = SPRINGING + NAVE + 0.5;
    let along = extruded(&[dvec2(-WALL, height), dvec2(-WALL, 0.0)], -END, END).flipped();
    let near = Mesh::polygon(&[
        dvec3(WALL, 0.0, END),
        dvec3(-WALL, 0.0, END),
        dvec3(-WALL, height, END),
        dvec3(WALL, height, END),
    ]);
    // Around the arch, from its outline outward: behind the vault the wall may end as it likes.
    let inner = arch_outline();
    let outer: Vec<DVec3> = inner
        .iter()
        .map(|p| {
            let d = *p - dvec3(0.0, 4.0, p.z);
            let x = WALL / d.x.abs().max(1e-9);
            let y = (height - 4.0) / d.y.max(1e-9);
            let reach = if d.y <= 0.0 { x } else { x.min(y) };
            if p.y == 0.0 { dvec3(WALL * p.x.signum(), 0.0, p.z) } else { *p + (reach - 1.0) * d }
        })
        .collect();
    let rows = [inner, outer].map(|row| row.into_iter().map(Vertex::flat).collect::<Vec<_>>());
    let far = Mesh::rows(&rows, false);
    let along = Mesh::join([along.clone(), along.turned_y(180.0)]);
    Mesh::join([along.flipped(), near, far])
}

/// Up the left side of the apse's opening, over its arch and down the right.
fn arch_outline() -> Vec<DVec3> {
    let mut points = vec![dvec3(-APSE, 0.0, -END), dvec3(-APSE, 3.0, -END)];
    for i in 0..=32 {
        let angle = (180.0 * f64::from(i) / 32.0).to_radians();
        points.push(dvec3(-APSE * angle.cos(), APSE_HEIGHT + APSE * angle.sin(), -END));
    }
    points.extend([dvec3(APSE, 3.0, -END), dvec3(APSE, 0.0, -END)]);
    points
}

/// A half cylinder under a quarter of a ball, hollow to the hall.
fn apse() -> Mesh {
    let mut hollow = line(dvec2(APSE, 0.0), dvec2(APSE, APSE_HEIGHT));
    hollow.pop();
    hollow.extend(arc(dvec2(0.0, APSE_HEIGHT), APSE, 0.0, 90.0, 12));
    lathe_part(&hollow, 32, 90.0, 270.0).flipped().moved(0.0, 0.0, -END)
}

/// The molding around the apse's opening.
fn archivolt() -> Mesh {
    let section = [
        (0.0, -0.02),
        (0.0, 0.10),
        (0.12, 0.14),
        (0.30, 0.14),
        (0.34, 0.20),
        (0.46, 0.20),
        (0.46, -0.02),
    ];
    let outline = arch_outline();
    let center = dvec3(0.0, APSE_HEIGHT, -END);
    let row = |p: &DVec3| -> Vec<Vertex> {
        let away = if p.y < APSE_HEIGHT {
            dvec3(p.x.signum(), 0.0, 0.0)
        } else {
            (*p - center).normalize()
        };
        let point =
            |&(out, up): &(f64, f64)| Vertex::flat(*p + (out - 0.03) * away + up * DVec3::Z);
        section.iter().map(point).collect()
    };
    Mesh::rows(&outline.iter().map(row).collect::<Vec<_>>(), false).flipped()
}

/// The walls between the bays, on both floors.
fn partitions() -> Mesh {
    let wall = |i: usize, [bottom, top]: [f64; 2]| {
        let z = i as f64 * BAY - END;
        let (min, max) =
            (dvec3(PARTITION, bottom, z - PARTITION_HALF), dvec3(WALL, top, z + PARTITION_HALF));
        cuboid_without(min, max, &[Side::Bottom, Side::Top, Side::Right])
    };
    let floors = [[0.0, GALLERY], [GALLERY_FLOOR, ENTABLATURE]];
    let right = Mesh::join((1..BAYS).flat_map(|i| floors.map(|floor| wall(i, floor))));
    both_sides(&right)
}

fn both_sides(right: &Mesh) -> Mesh {
    Mesh::join([right.clone(), right.clone().scaled(-1.0, 1.0, 1.0)])
}

/// Ceiling of the lower alcoves, edge and floor of the gallery.
fn gallery() -> Mesh {
    let line = [
        (WALL, GALLERY),
        (4.68, GALLERY),
        (4.68, 4.62),
        (4.64, 4.64),
        (4.64, 4.80),
        (4.58, 4.86),
        (4.50, 4.88),
        (4.50, 4.95),
        (4.53, GALLERY_FLOOR),
        (WALL, GALLERY_FLOOR),
    ];
    molding(&line)
}

/// Ceiling of the gallery, and the entablature that carries the vault.
fn entablature() -> Mesh {
    let line = [
        (WALL, ENTABLATURE),
        (4.72, ENTABLATURE),
        (4.72, 9.15),
        (4.69, 9.16),
        (4.69, 9.32),
        (4.63, 9.36),
        (4.70, 9.38),
        (4.70, 9.68),
        (4.62, 9.72),
        (4.56, 9.80),
        (4.40, 9.82),
        (4.40, 9.91),
        (4.33, 9.97),
        (4.33, SPRINGING),
        (5.1, SPRINGING + 0.001),
    ];
    molding(&line)
}

/// A molding along the right side of the hall, drawn from below to above.
fn molding(line: &[(f64, f64)]) -> Mesh {
    let line: Vec<DVec2> = line.iter().map(|&(x, y)| dvec2(x, y)).collect();
    extruded(&line, -END, END).flipped()
}

/// Foot and hand rails of the balustrades, through the columns.
fn rails() -> Mesh {
    let rail = |half: f64, bottom: f64, top: f64| {
        let (min, max) = (dvec3(NAVE - half, bottom, -END), dvec3(NAVE + half, top, END));
        cuboid_without(min, max, &[Side::Front, Side::Back])
    };
    let (y, low) = (GALLERY_FLOOR, Side::Bottom);
    let foot =
        cuboid_without(dvec3(NAVE - 0.11, y, -END), dvec3(NAVE + 0.11, y + 0.12, END), &[low]);
    both_sides(&Mesh::join([foot, rail(0.09, y + 0.86, y + 0.9), rail(0.12, y + 0.9005, y + 0.98)]))
}

/// Behind the vault, so that no light is lost through its seams.
fn roof() -> Mesh {
    flat([-WALL, WALL], [-END, END], SPRINGING + NAVE + 0.5).flipped()
}

/// The length of a ring of coffers along the hall, and their number around.
pub const COFFER: f64 = 1.4;
const COFFERS: usize = 12;

/// One ring of coffers, along z from 0 to [`COFFER`]; axis y = 0.
pub fn vault() -> Model {
    let (mut ribs, mut panels, mut roses) = (Mesh::default(), Mesh::default(), Mesh::default());
    for i in 0..COFFERS {
        let step = 180.0 / COFFERS as f64;
        let from = step * i as f64 - 90.0;
        // Around the coffer, in shares of the cell: from its border by two steps to its panel.
        let frames = [(0.0, 0.0), (0.11, 0.0), (0.12, 0.10), (0.17, 0.10), (0.18, 0.2)];
        for pair in frames.windows(2) {
            ribs.push(frame(from, step, pair[0], pair[1]));
        }
        let (inset, depth) = frames[4];
        let angle = |u: f64| from + step * (inset + u * (1.0 - 2.0 * inset));
        let z = |v: f64| COFFER * (inset + v * (1.0 - 2.0 * inset));
        panels.push(Mesh::patch(3, 1, |u, v| Vertex::flat(on_vault(angle(u), z(v), depth))));
        let line = [(0.0, 0.0), (0.09, 0.05), (0.14, 0.02), (0.17, 0.1), (0.16, 0.14)];
        let line = profile::smooth(&line.map(|(x, y)| dvec2(x, y)), 2);
        let rose = lathe(&line, 14).moved(0.0, NAVE + depth - 0.138, 0.5 * COFFER);
        roses.push(rose.turned_z(-(from + 0.5 * step)));
    }
    Model::new("A ring of coffers of the vault about the z axis, 1.4 long.")
        .decimals(3, 3)
        .part("ribs", "vault", ribs)
        .part("panels", "azure", panels)
        .part("roses", "gilt", roses)
}

/// A point of the vault: degrees from the crown toward +x, distance along z, depth behind its face.
fn on_vault(degrees: f64, z: f64, depth: f64) -> DVec3 {
    let (sin, cos) = degrees.to_radians().sin_cos();
    (NAVE + depth) * dvec3(sin, cos, 0.0) + z * DVec3::Z
}

/// The strip of a coffer between two insets, each with its depth.
fn frame(from: f64, step: f64, outer: (f64, f64), inner: (f64, f64)) -> Mesh {
    // Around the cell, three pieces along each arc.
    let around = [
        (0.0, 0.0),
        (1.0, 0.0),
        (2.0, 0.0),
        (3.0, 0.0),
        (3.0, 1.0),
        (2.0, 1.0),
        (1.0, 1.0),
        (0.0, 1.0),
    ];
    let row = |(inset, depth): (f64, f64)| -> Vec<Vertex> {
        let place = |&(u, v): &(f64, f64)| {
            let share = |t: f64| inset + t * (1.0 - 2.0 * inset);
            Vertex::flat(on_vault(from + step * share(u / 3.0), COFFER * share(v), depth))
        };
        around.iter().map(place).collect()
    };
    Mesh::rows(&[row(outer), row(inner)], true)
}
