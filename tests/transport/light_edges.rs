//! Edges of light sources that the camera sees: theory.md (42a).

use crate::common::*;
use bdpm::Settings;
use bdpm::scene::{Camera, FieldOfView, Mesh};
use glam::Vec3;

const SIDE: u32 = 64;
const ITERATIONS: u64 = 400;

/// A lamp of the radiance 1 in the plane `z = 0`, between these columns and these rows of an image
/// of [`SIDE`] pixels.
fn lamp([left, right]: [f32; 2], [top, bottom]: [f32; 2]) -> Mesh {
    // From `z = 1`, 90 degrees show two units.
    let at = |pixels: f32| 2.0 * pixels / SIDE as f32 - 1.0;
    let corner = |x: f32, y: f32| Vec3::new(at(x), -at(y), 0.0);
    let positions =
        vec![corner(left, top), corner(left, bottom), corner(right, bottom), corner(right, top)];
    Mesh { positions, ..square(Vec3::ZERO, Vec3::Z, 1.0, 0) }
}

/// Means and standard errors of the pixels of an image of some meshes.
fn image(meshes: Vec<Mesh>) -> Vec<[f64; 2]> {
    let eye = Camera::look(Vec3::Z, -Vec3::Z, Vec3::Y, FieldOfView::X(90.0)).unwrap();
    let scene = scene(meshes, vec![gray(0.0, 1.0), gray(0.0, 0.0)], vec![], eye);
    let settings = Settings { camera_paths: 1, light_paths: 2, ..settings(SIDE, SIDE) };
    pixel_means(&scene, settings, ITERATIONS)
}

/// Length of the part of a pixel of this number within an interval.
fn covered(pixel: u32, [first, last]: [f32; 2]) -> f64 {
    let (start, end) = (f64::from(pixel), f64::from(pixel + 1));
    (end.min(last.into()) - start.max(first.into())).max(0.0)
}

/// Every pixel has the radiance of the share that the lamp covers, also lamps within a pixel, with
/// at most half of the variance of single hits, `p (1 - p)`. Without strata, 16 rays would have a
/// sixteenth of it, and strata have less.
#[test]
fn pixels_at_edges_see_the_share_that_a_lamp_covers() {
    for (columns, rows) in [([33.3, 39.8], [35.6, 38.25]), ([37.2, 37.5], [34.4, 34.9])] {
        let mut expected = [0.0; 2];
        for (index, [mean, error]) in image(vec![lamp(columns, rows)]).into_iter().enumerate() {
            let index = index as u32;
            let share = covered(index % SIDE, columns) * covered(index / SIDE, rows);
            let single = share * (1.0 - share);
            // A pixel that was always hit, or never, has no standard error.
            let bound = 4.0 * error.max((single / 16.0 / ITERATIONS as f64).sqrt()) + 1e-6;
            assert!((mean - share).abs() < bound, "{columns:?} {index}: {mean} {share}");
            expected[0] += error * error * ITERATIONS as f64;
            expected[1] += single;
        }
        assert!(expected[0] < expected[1] / 14.0, "{columns:?}: {expected:?}");
    }
}

/// Where another surface hides the lamp, its edges emit nothing.
#[test]
fn hidden_edges_are_dark() {
    let blocker = square(0.2 * Vec3::Z, Vec3::Z, 0.7, 1);
    let all = image(vec![lamp([33.3, 39.8], [35.6, 38.25]), blocker]);
    assert!(all.iter().all(|own| *own == [0.0; 2]));
    // The edge of what hides a part of it is not that of a lamp, and has the noise of single hits.
    let half = Mesh { material: 1, ..lamp([0.0, 35.4], [0.0, SIDE as f32]) };
    let positions = half.positions.iter().map(|own| *own * 0.9 + 0.1 * Vec3::Z).collect();
    let all = image(vec![lamp([33.3, 42.8], [33.6, 40.25]), Mesh { positions, ..half }]);
    let [mean, error] = all[37 * SIDE as usize + 35];
    assert!((mean - 0.6).abs() < 4.0 * error && error > 0.02, "{mean} {error}");
    let [mean, error] = all[37 * SIDE as usize + 42];
    assert!((mean - 0.8).abs() < 4.0 * error.max(0.01 / 20.0), "{mean} {error}");
}
