//! The committed scenes are those that this program makes, and they are sound.

use super::mesh::{Corner, Mesh};
use super::random::Random;
use super::{folders, obj, profile, scenes, shapes};
use bdpm::accel::{Intersect, Ray};
use bdpm::load::load;
use bdpm::scene::Scene;
use bdpm::scene::backend;
use glam::{DVec3, Vec3, dvec2, dvec3};

/// Whether two files have the same words, but for the last digit of numbers: another libm may round
/// a sine otherwise.
fn same(a: &str, b: &str) -> bool {
    let alike = |(a, b): (&str, &str)| {
        let bare = |word: &str| word.trim_matches(['[', ']', ',']).to_owned();
        let (a, b) = (bare(a), bare(b));
        let decimals = |word: &str| word.split_once('.').map_or(0, |(_, tail)| tail.len() as i32);
        let last_digit = 0.1_f64.powi(decimals(&a).max(decimals(&b)));
        match (a.parse::<f64>(), b.parse::<f64>()) {
            (Ok(x), Ok(y)) if a.contains('.') || b.contains('.') => {
                (x - y).abs() < 1.1 * last_digit
            }
            _ => a == b,
        }
    };
    let words = || a.split_whitespace().zip(b.split_whitespace());
    a.split_whitespace().count() == b.split_whitespace().count() && words().all(alike)
}

#[test]
fn committed_scenes_equal_those_that_are_made() {
    for folder in folders() {
        for (name, made) in &folder.files {
            let path = scenes().join(folder.name).join(name);
            let committed = std::fs::read_to_string(&path).unwrap();
            assert!(same(&committed, made), "{}: make it again", path.display());
        }
    }
}

/// Walks a scene like light in a room of nothing but diffuse surfaces. Returns where it came, with
/// normals, and how often it got lost. A box open toward +z may lose walks there.
fn walk(scene: &Scene, accel: &dyn Intersect, open: bool) -> (Vec<(Vec3, Vec3)>, usize) {
    let mut random = Random(1);
    let (mut places, mut lost) = (Vec::new(), 0);
    let mut sphere = || {
        let (z, turn) = (random.between(-1.0, 1.0), random.between(0.0, std::f64::consts::TAU));
        let radius = (1.0 - z * z).sqrt();
        dvec3(radius * turn.cos(), radius * turn.sin(), z).as_vec3()
    };
    let start = scene.camera.position() + scene.camera.direction() * if open { 9.0 } else { 0.5 };
    for _ in 0..5000 {
        let (mut position, mut direction) = (start, sphere());
        for _ in 0..8 {
            let ray = Ray::new(position, direction);
            let hit = accel.closest_hit(&ray);
            if hit.t.is_infinite() {
                lost += usize::from(!(open && direction.z > 0.0));
                break;
            }
            let surface = scene.surface(&ray, &hit);
            places.push((surface.position, surface.normal));
            direction = (surface.normal + sphere()).normalize_or(surface.normal);
            position = surface.start(direction);
        }
    }
    (places, lost)
}

/// Number of places that lie on two faces at once, where a renderer takes either at random.
fn coincident(scene: &Scene, places: &[(Vec3, Vec3)]) -> usize {
    let close = 5e-6 * scene.size();
    let mut faces = vec![0; places.len()];
    for t in scene.triangles() {
        let cross = t.edge1.cross(t.edge2);
        let scale = 1.0 / cross.length_squared();
        for ((position, normal), faces) in places.iter().zip(&mut faces) {
            let from = *position - t.origin;
            if t.normal.dot(from).abs() < close && t.normal.dot(*normal).abs() > 0.9999 {
                let u = from.cross(t.edge2).dot(cross) * scale;
                let v = t.edge1.cross(from).dot(cross) * scale;
                // Well inside: neighbors share their edges.
                *faces += usize::from(u.min(v).min(1.0 - u - v) > 0.01);
            }
        }
    }
    faces.into_iter().filter(|&n| n > 1).count()
}

#[test]
fn made_scenes_load_without_a_note_are_closed_and_no_faces_coincide() {
    for folder in folders() {
        let name = folder.name;
        let loaded = load(scenes().join(name)).unwrap_or_else(|e| panic!("{e}"));
        let scene = &loaded.scene;
        assert_eq!(loaded.warnings_text(), "", "{name}");
        assert!(scene.triangles().iter().all(|t| t.area() > 0.0), "{name}");
        let accel = backend::build(backend::Backend::default(), scene).unwrap();
        let (mut places, lost) = walk(scene, &*accel, name == "caustic-sphere");
        assert_eq!(lost, 0, "{name}: lost walks");
        let every = places.len() / 500;
        places = places.into_iter().step_by(every.max(1)).collect();
        assert_eq!(coincident(scene, &places), 0, "{name}: faces in one place");
    }
}

/// The lamps of the hall are closed bodies that emit outward.
#[test]
fn flames_shine_outward() {
    let loaded = load(scenes().join("hall")).unwrap();
    let scene = &loaded.scene;
    let lamps = scene
        .placements()
        .iter()
        .filter(|placement| scene.materials()[placement.material as usize].emission != Vec3::ZERO)
        .map(|placement| scene.mesh(placement));
    let mut count = 0;
    for mesh in lamps {
        let corner = |i: u32| (mesh.positions[i as usize] - mesh.positions[0]).as_dvec3();
        let cone = |&[a, b, c]: &[u32; 3]| corner(a).dot(corner(b).cross(corner(c)));
        assert!(mesh.triangles.iter().map(cone).sum::<f64>() > 0.0, "{}", mesh.name);
        count += 1;
    }
    assert!(count > 100, "{count}");
}

/// The volume that fronts enclose: positive if they look outward.
fn volume(mesh: &Mesh) -> f64 {
    let cone = |a: DVec3, b: DVec3, c: DVec3| a.dot(b.cross(c)) / 6.0;
    let at = |face: &[Corner], i: usize| mesh.positions[face[i].position];
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
    assert!((volume(&ball.clone().flipped()) + volume(&ball)).abs() < 1e-12);
    // A pot: up outside, over the rim, down inside.
    let line = [(0.0, 0.0), (1.0, 0.0), (1.0, 2.0), (0.9, 2.0), (0.9, 0.1), (0.0, 0.1)];
    let runs = profile::edges(&line.map(|(x, y)| dvec2(x, y)));
    let pot = Mesh::join(runs.iter().map(|run| shapes::lathe(run, 64)));
    let solid = std::f64::consts::PI * (2.0 - 0.81 * 1.9);
    assert!((volume(&pot) / solid - 1.0).abs() < 0.01, "{}", volume(&pot));
    // A pipe with thick walls and the ends they need.
    let wall = |r: f64, up: f64| profile::line(dvec2(r, -0.5 * up), dvec2(r, 0.5 * up));
    let end = shapes::annulus(0.5, 1.0, 64).moved(0.0, 0.5, 0.0);
    let walls = [shapes::lathe(&wall(1.0, 1.0), 64), shapes::lathe(&wall(0.5, -1.0), 64)];
    let pipe = Mesh::join(walls.into_iter().chain([end.clone(), end.turned_x(180.0)]));
    assert!((volume(&pipe) / (0.75 * std::f64::consts::PI) - 1.0).abs() < 0.01);
    let lid = shapes::disc(1.0, 64);
    assert!(lid.moved(0.0, 1.0, 0.0).faces.len() == 1);
}

#[test]
fn curves_run_through_their_points_and_are_straight_along_lines() {
    let points = [(0.0, 0.0), (1.0, 0.5), (1.2, 2.0), (0.4, 3.0)].map(|(x, y)| dvec2(x, y));
    for curve in [profile::smooth, profile::spline] {
        let points_of = curve(&points, 8);
        assert!(points.iter().zip(points_of.iter().step_by(8)).all(|(p, c)| *p == c.at));
        // Normals are to the right of the way.
        for pair in points_of.windows(2) {
            let (way, normal) = ((pair[1].at - pair[0].at).normalize(), pair[0].normal.unwrap());
            assert!(normal.dot(way).abs() < 0.15 && normal.perp_dot(way) > 0.9);
        }
        let straight = curve(&[dvec2(1.0, 0.0), dvec2(1.0, 1.0), dvec2(1.0, 4.0)], 4);
        assert!(straight.iter().all(|p| (p.at.x - 1.0).abs() < 1e-12));
    }
}

#[test]
fn numbers_are_short() {
    let texts = [(-0.00001, "0"), (1.5, "1.5"), (-2.0, "-2"), (100.0, "100"), (0.12346, "0.1235")];
    for (value, text) in texts {
        assert_eq!(obj::number(value, 4), text);
    }
    assert_eq!(obj::number(1200.0, 0), "1200");
}
