//! Whether strategies make the path tracer's image of the scenes in a box.

use crate::common::boxes::{self, SIDE};
use crate::common::images::{Difference, Subject};
use crate::common::table::Table;
use crate::common::{MIS, accel, by_way, settings};
use bdpm::settings::{Direct, Settings};

use Direct::{Connect, PhotonMap};

/// By connection and from the photon map, merging at the first vertex, at the second and weighted
/// at both.
pub const ALL: [(Direct, u32); 6] =
    [(Connect, 1), (Connect, 2), (Connect, MIS), (PhotonMap, 1), (PhotonMap, 2), (PhotonMap, MIS)];

/// Asserts it of each pixel and of the whole image, after the merge bias has been taken out by two
/// radii.
pub fn assert_same(name: &str, strategies: &[(Direct, u32)]) {
    assert_same_guided(name, strategies, 0);
}

/// Asserts equal means with light paths that learn for `guide` iterations where to start.
pub fn assert_same_guided(name: &str, strategies: &[(Direct, u32)], guide: u32) {
    let scene = &boxes::named(name);
    let accel = accel(scene);
    let expected = Table::of(name, scene, [SIDE; 2]).pixels(&[]);
    for &(direct, merge_vertex) in strategies {
        let settings = by_way(Settings {
            direct,
            merge_vertex,
            light_paths: 40_000,
            camera_paths: 16,
            radius: 0.04,
            caustic_radius: 0.04,
            seed: 3,
            guide,
            ..settings(SIDE, SIDE)
        });
        let subject = Subject { scene, accel: &accel, settings: &settings, region: &[] };
        let found = subject.extrapolated(30);
        let difference = found.against(&expected);
        let what = format!("{name} {direct:?} k = {merge_vertex}: {difference}");
        println!("{what}");
        let Difference { off, error, z2, .. } = difference;
        assert!(error < 0.008, "says little: {what}");
        // Along edges the kernel loses area in proportion to the radius, which two radii do not
        // take out: about 0.2 (sqrt(2) - 1) times the share of the surfaces within a radius.
        assert!(off.abs() < 4.0 * error + 5e-3, "{what}");
        // Heavy tails: 144 squares of about 1 scatter by more than their 0.12.
        assert!(z2 < 2.0, "{what}");
    }
}
