//! What is committed is what is made, and it is sound.

use crate::mesh::Mesh;
use crate::{folders, obj, profile, scenes, shapes};
use bdpm::scene::load;
use glam::{DVec3, dvec2, dvec3};

/// Whether two files have the same words, but for the last digits of numbers: another libm may
/// round a sine otherwise.
fn same(a: &str, b: &str) -> bool {
    let words =
        |text: &str| -> Vec<String> { text.split_whitespace().map(str::to_owned).collect() };
    let (a, b) = (words(a), words(b));
    let alike = |(a, b): (&String, &String)| {
        let strip = |word: &str| word.trim_matches(['[', ']', ',']).parse::<f64>();
        match (strip(a), strip(b)) {
            (Ok(a), Ok(b)) => (a - b).abs() <= 2e-4,
            _ => a == b,
        }
    };
    a.len() == b.len() && a.iter().zip(&b).all(alike)
}

#[test]
fn the_committed_scenes_are_those_that_are_made() {
    for folder in folders() {
        for (name, made) in &folder.files {
            let path = scenes().join(folder.name).join(name);
            let committed = std::fs::read_to_string(&path).unwrap();
            assert!(same(&committed, made), "{}: make it again", path.display());
        }
    }
}

#[test]
fn made_scenes_load_without_a_note() {
    for folder in folders() {
        let loaded = load(&scenes().join(folder.name)).unwrap_or_else(|e| panic!("{e}"));
        assert_eq!(loaded.notes, Vec::<String>::new(), "{}", folder.name);
        assert!(loaded.scene.triangles().iter().all(|t| t.area() > 0.0));
    }
}

/// The volume that fronts enclose: positive if they look outward.
fn volume(mesh: &Mesh) -> f64 {
    let cone = |a: DVec3, b: DVec3, c: DVec3| a.dot(b.cross(c)) / 6.0;
    let at = |face: &[crate::mesh::Corner], i: usize| mesh.positions[face[i].position];
    let fan =
        |f: &Vec<_>| (2..f.len()).map(|i| cone(at(f, 0), at(f, i - 1), at(f, i))).sum::<f64>();
    mesh.faces.iter().map(fan).sum()
}

#[test]
fn fronts_look_outward() {
    let box_volume = volume(&shapes::cuboid(dvec3(1.0, 2.0, 3.0), dvec3(2.0, 4.0, 6.0)));
    assert!((box_volume - 6.0).abs() < 1e-12);
    let ball = shapes::sphere(1.0, 40, 80);
    assert!((volume(&ball) / (4.0 / 3.0 * std::f64::consts::PI) - 1.0).abs() < 0.01);
    assert!(ball.positions.iter().zip(&ball.normals).all(|(p, n)| (*p - *n).length() < 1e-12));
    let mirrored = ball.clone().scaled(-1.0, 2.0, 1.0);
    assert!((volume(&mirrored) / volume(&ball) - 2.0).abs() < 1e-12);
    assert!(mirrored.positions.iter().zip(&mirrored.normals).all(|(p, n)| p.dot(*n) > 0.0));
    // A pot: up outside, over the rim, down inside.
    let line = [(0.0, 0.0), (1.0, 0.0), (1.0, 2.0), (0.9, 2.0), (0.9, 0.1), (0.0, 0.1)];
    let runs = profile::edges(&line.map(|(x, y)| dvec2(x, y)));
    let pot = Mesh::join(runs.iter().map(|run| shapes::lathe(run, 64)));
    let solid = std::f64::consts::PI * (2.0 - 0.81 * 1.9);
    assert!((volume(&pot) / solid - 1.0).abs() < 0.01, "{}", volume(&pot));
    // Lids on a tube.
    let tube = shapes::lathe(&profile::line(dvec2(1.0, -0.5), dvec2(1.0, 0.5)), 64);
    let lid = shapes::disc(1.0, 64).moved(0.0, 0.5, 0.0);
    let bottom = shapes::annulus(0.5, 1.0, 64).turned_x(180.0).moved(0.0, -0.5, 0.0);
    assert!(bottom.faces.len() == 64 && bottom.triangles() == 128);
    let all = Mesh::join([tube, lid.clone(), lid.turned_x(180.0)]);
    assert!((volume(&all) / std::f64::consts::PI - 1.0).abs() < 0.01);
}

#[test]
fn numbers_are_short() {
    let texts = [(-0.00001, "0"), (1.5, "1.5"), (-2.0, "-2"), (100.0, "100"), (0.12346, "0.1235")];
    for (value, text) in texts {
        assert_eq!(obj::number(value, 4), text);
    }
    assert_eq!(obj::number(1200.0, 0), "1200");
}
