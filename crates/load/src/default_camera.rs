//! The camera of scenes without one: in front of an object, but inside of a closed room.

use super::camera_change::CameraChange;
use super::sight::Sight;
use bdpm_core::accel::Intersect;
use bdpm_core::scene::backend::{Backend, build};
use bdpm_core::scene::{Camera, FieldOfView, Scene};
use bdpm_import::{WHOLE_VIEW_DEGREES, Warning};
use glam::Vec3;
use rayon::prelude::*;
use std::f32::consts::{PI, TAU};
use std::path::Path;
use std::sync::Arc;

/// Opening angle of a camera inside of a room across the image's height, degrees.
const ROOM_DEGREES: f32 = 60.0;
/// Positions that are tried along each horizontal axis of the box around the scene.
const POSITIONS: u32 = 6;
/// Heights that are tried, as shares of the height of that box.
const HEIGHTS: [f32; 3] = [0.4, 0.55, 0.7];
/// Directions that are looked along from a position.
const DIRECTIONS: u32 = 256;
/// Minimum share of the directions in which a room is closed.
const MIN_CLOSED: f32 = 0.95;
/// Minimum share of the positions that are closed in. Rooms fill the box around them: 59 % to 100 %
/// in three public rooms and in those of this repository. The back of a box with an open front does
/// not (13 % in a Cornell box), nor does the inside of a goblet (26 %).
const MIN_INSIDE: f32 = 0.4;
/// Minimum share of the surfaces seen from inside that cannot be seen from outside. An object that
/// is only a shell has none.
const MIN_HIDDEN: f32 = 0.05;
/// Minimum mean distance to the surfaces of a room, over the diagonal of the box around the scene.
/// Cavities of a machine, or a house in a landscape, are smaller.
const MIN_SIZE: f32 = 0.12;
/// Minimum distance of a surface in view, over that diagonal.
const MIN_NEAR: f32 = 0.03;

/// Maximum number of triangles of scenes that are searched for rooms. Their acceleration structure
/// takes about a second to build.
const MAX_TRIANGLES: usize = 1_000_000;

/// Maximum coordinate and maximum size of scenes that are searched, and their minimum size. Squares
/// of larger numbers overflow, and the builder of the acceleration structure then may not end.
const MAX_COORDINATE: f32 = 1e15;
const MIN_SCENE_SIZE: f32 = 1e-15;

/// Places the camera of a scene whose file has none: inside of a closed room, else where the reader
/// put it. Returns a warning about the place, and the acceleration structure of the scene if it was
/// searched for rooms.
pub(super) fn place(
    scene: &mut Scene,
    change: &CameraChange,
    file: &Path,
) -> (Warning, Option<Arc<dyn Intersect>>) {
    // Embree first: the builder of the other backend takes 84 s for 64,000 equal triangles.
    let built = || build(Backend::default(), scene).or_else(|_| build(Backend::Bvh, scene)).ok();
    let accel = is_searched(scene).then(built).flatten();
    let inside = accel.as_deref().and_then(|accel| inside(scene, accel));
    let (place, own) = match inside {
        Some(_) => (" inside of the closed room", ROOM_DEGREES),
        None => ("", WHOLE_VIEW_DEGREES),
    };
    let advice = match inside {
        Some(_) => "place the camera yourself if it shows the wrong side",
        None => "place the camera yourself, for example inside of a room",
    };
    scene.camera = inside.unwrap_or(scene.camera);
    let (file, position) = (file.display(), scene.in_file(scene.camera.position()));
    let degrees = change.fov.unwrap_or(own);
    let text = format!("{file}: no camera; added one{place} at {position}, {degrees} degrees high");
    (Warning { advice: Some(advice), ..Warning::chosen(text) }, accel)
}

/// Whether a scene is searched for rooms: it is small, and its coordinates are not extreme.
fn is_searched(scene: &Scene) -> bool {
    let (min, max) = (scene.bounds().min, scene.bounds().max);
    // Not for NaN either
    let is_usual = |corner: Vec3| corner.abs().max_element() <= MAX_COORDINATE;
    let size = (max - min).max_element();
    scene.triangle_count() <= MAX_TRIANGLES
        && is_usual(min)
        && is_usual(max)
        && (MIN_SCENE_SIZE..=MAX_COORDINATE).contains(&size)
}

/// A camera inside of the scene if that is a closed room, such as one with walls, a ceiling and
/// furniture. `None` for all others: a camera in front of them shows them.
fn inside(scene: &Scene, accel: &dyn Intersect) -> Option<Camera> {
    let (bounds, sight) = (scene.bounds(), Sight { scene, accel });
    let size = bounds.max - bounds.min;
    let diagonal = size.length();
    let position = |index: u32| {
        let (x, rest) = (index % POSITIONS, index / POSITIONS);
        let share = |i: u32| (i as f32 + 0.5) / POSITIONS as f32;
        let height = HEIGHTS[(rest / POSITIONS) as usize];
        bounds.min + size * Vec3::new(share(x), height, share(rest % POSITIONS))
    };
    let count = POSITIONS * POSITIONS * HEIGHTS.len() as u32;
    let rooms: Vec<Surroundings> = (0..count)
        .into_par_iter()
        .filter_map(|i| Surroundings::of(position(i), &sight, diagonal))
        .collect();
    if (rooms.len() as f32) < MIN_INSIDE * count as f32 {
        return None;
    }
    let views: Vec<View> =
        rooms.par_iter().filter_map(|room| room.view(&sight, diagonal)).collect();
    // The first of equal ones, so that the choice does not depend on threads.
    let best = views.into_iter().reduce(|a, b| if b.distance > a.distance { b } else { a })?;
    Camera::look(best.position, best.direction, Vec3::Y, FieldOfView::Y(ROOM_DEGREES)).ok()
}

/// What surrounds a position that is closed in.
struct Surroundings {
    position: Vec3,
    /// Directions in which there is a surface, and its distance, scene units.
    closed: Vec<(Vec3, f32)>,
}

/// The view from a position in a room.
struct View {
    position: Vec3,
    direction: Vec3,
    /// Mean distance of what it shows, scene units.
    distance: f32,
}

impl Surroundings {
    /// What surrounds `position`; `None` unless that is closed in by surfaces far enough away.
    fn of(position: Vec3, sight: &Sight, diagonal: f32) -> Option<Self> {
        let looks = (0..DIRECTIONS).map(direction).map(|d| (d, sight.distance(position, d)));
        let closed: Vec<_> = looks.filter(|(_, distance)| distance.is_finite()).collect();
        let share = closed.len() as f32 / DIRECTIONS as f32;
        let mean = closed.iter().map(|(_, distance)| distance).sum::<f32>() / DIRECTIONS as f32;
        (share >= MIN_CLOSED && mean >= MIN_SIZE * diagonal).then_some(Self { position, closed })
    }

    /// The view that shows most; `None` if everything around can be seen from outside as well.
    fn view(&self, sight: &Sight, diagonal: f32) -> Option<View> {
        let Self { position, closed } = self;
        let is_hidden = |(d, distance): &&(Vec3, f32)| {
            let behind = *position + (distance + 1e-3 * diagonal) * *d;
            sight.is_hidden(behind, *d)
        };
        let some = || closed.iter().step_by(4);
        if (some().filter(is_hidden).count() as f32) < MIN_HIDDEN * some().count() as f32 {
            return None;
        }
        let view = |turn: u32| {
            let (sin, cos) = (TAU * turn as f32 / 16.0).sin_cos();
            let direction = Vec3::new(cos, -0.15, sin).normalize();
            let cone = (0.6 * ROOM_DEGREES).to_radians().cos();
            let seen = closed.iter().filter(|(d, _)| d.dot(direction) >= cone);
            let [sum, count, near] = seen.fold([0.0, 0.0, f32::MAX], |[sum, count, near], own| {
                [sum + own.1, count + 1.0, near.min(own.1)]
            });
            (near >= MIN_NEAR * diagonal).then_some(View {
                position: *position,
                direction,
                distance: sum / count,
            })
        };
        (0..16).filter_map(view).reduce(|a, b| if b.distance > a.distance { b } else { a })
    }
}

/// Evenly spread unit vectors: a spiral of equal steps in height and of golden angles.
fn direction(index: u32) -> Vec3 {
    let height = 1.0 - (2.0 * index as f32 + 1.0) / DIRECTIONS as f32;
    let (sin, cos) = (PI * (3.0 - 5.0_f32.sqrt()) * index as f32).sin_cos();
    let across = (1.0 - height * height).sqrt();
    Vec3::new(across * cos, height, across * sin)
}

#[cfg(test)]
mod tests {
    use super::*;
    use bdpm_core::scene::bsdf::Bsdf;
    use bdpm_core::scene::{Emitter, Material, Mesh};

    /// A box whose front is outside.
    fn add_box(mesh: &mut Mesh, low: [f32; 3], high: [f32; 3]) {
        let first = mesh.positions.len() as u32;
        let corner =
            |i: u32| Vec3::from(std::array::from_fn(|k| [low, high][((i >> k) & 1) as usize][k]));
        mesh.positions.extend((0..8).map(corner));
        let faces =
            [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
        for [a, b, c, d] in faces.map(|face| face.map(|i| first + i)) {
            mesh.triangles.extend([[a, b, c], [a, c, d]]);
        }
    }

    fn scene_of(boxes: &[([f32; 3], [f32; 3])]) -> Scene {
        let mut mesh = Mesh::default();
        boxes.iter().for_each(|(low, high)| add_box(&mut mesh, *low, *high));
        let camera = Camera::look(Vec3::ONE, Vec3::Z, Vec3::Y, FieldOfView::Y(40.0)).unwrap();
        let gray = Material::new("gray", Bsdf::diffuse(Vec3::splat(0.5)));
        let lamp = Emitter::Point { position: Vec3::ONE, intensity: Vec3::ONE };
        Scene::new("s".into(), vec![mesh], vec![gray], vec![lamp], camera, vec![]).unwrap()
    }

    fn inside_of(boxes: &[([f32; 3], [f32; 3])]) -> Option<Camera> {
        let scene = scene_of(boxes);
        let accel = build(Backend::Bvh, &scene).unwrap();
        inside(&scene, &*accel)
    }

    #[test]
    fn scenes_with_extreme_coordinates_are_not_searched() {
        let (zero, walls) = ([0.0; 3], ([0.0; 3], [5.0, 3.0, 4.0]));
        assert!(is_searched(&scene_of(&[walls])));
        for far in [1e16, 1e-16] {
            assert!(!is_searched(&scene_of(&[(zero, [far; 3])])), "{far}");
        }
        assert!(!is_searched(&scene_of(&[([-2e15; 3], [-1e15; 3])])));
    }

    #[test]
    fn camera_is_inside_of_closed_rooms_and_in_front_of_other_scenes() {
        let walls = ([0.0, 0.0, 0.0], [5.0, 3.0, 4.0]);
        let wardrobe = ([0.2, 0.0, 0.2], [1.2, 2.0, 1.0]);
        let table = ([2.0, 0.0, 2.2], [3.5, 0.8, 3.4]);
        let bed = ([3.0, 0.0, 0.2], [4.8, 0.5, 1.8]);
        let furnished = inside_of(&[walls, wardrobe, table, bed]).expect("it is a room");
        let position = furnished.position();
        assert!(position.cmpgt(Vec3::ZERO).all() && position.cmplt(Vec3::new(5.0, 3.0, 4.0)).all());
        // Walls of two sides hide their inner side, also if nothing stands in the room.
        let outer = ([-0.2, -0.2, -0.2], [5.2, 3.2, 4.2]);
        assert!(inside_of(&[walls, outer]).is_some());
        // A closed box, furniture on a floor, and a room in a large landscape.
        let floor = ([0.0, -0.1, 0.0], [5.0, 0.0, 4.0]);
        let land = ([-40.0, -0.4, -40.0], [40.0, -0.3, 40.0]);
        assert!(inside_of(&[walls]).is_none());
        assert!(inside_of(&[floor, wardrobe, table, bed]).is_none());
        assert!(inside_of(&[land, outer, walls]).is_none());
    }

    #[test]
    fn box_with_an_open_front_is_seen_from_outside() {
        // Walls with two sides, and two blocks, as in a Cornell box. Few positions at the back are
        // closed in nearly all directions.
        let walls = [
            ([0.0, -0.1, 0.0], [5.6, 0.0, 5.6]),
            ([0.0, 5.5, 0.0], [5.6, 5.6, 5.6]),
            ([-0.1, 0.0, 0.0], [0.0, 5.5, 5.6]),
            ([5.6, 0.0, 0.0], [5.7, 5.5, 5.6]),
            ([0.0, 0.0, 0.0], [5.6, 5.5, 0.1]),
        ];
        let blocks = [([0.8, 0.0, 1.0], [2.4, 3.3, 2.6]), ([3.0, 0.0, 2.5], [4.6, 1.6, 4.1])];
        let open = [&walls[..], &blocks].concat();
        assert!(inside_of(&open).is_none());
        let front = ([0.0, 0.0, 5.5], [5.6, 5.5, 5.6]);
        assert!(inside_of(&[&open[..], &[front]].concat()).is_some());
    }
}
