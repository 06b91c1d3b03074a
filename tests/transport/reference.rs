//! The renderer against the path tracer, which shares nothing of the transport with it. The other
//! materials are in `tests/check/reference.rs`.

use crate::common::boxes::{self, SIDE};
use crate::common::images::{Difference, Subject};
use crate::common::strategies::{ALL, assert_same};
use crate::common::table::Table;
use crate::common::*;
use bdpm::Settings;
use bdpm::settings::Direct::{Connect, PhotonMap};

#[test]
fn diffuse_surfaces_under_a_point_and_a_panel() {
    assert_same("box", &ALL);
}

#[test]
fn a_ball_of_glass_and_one_of_rough_metal_under_a_panel() {
    for name in ["glass-ball", "rough-metal-ball"] {
        assert_same(name, &[(Connect, 2), (PhotonMap, 1), (Connect, MIS)]);
    }
}

#[test]
fn a_glossy_ball_under_a_point() {
    assert_same("gloss-under-a-point", &[(Connect, 1), (PhotonMap, 2), (Connect, MIS)]);
}

#[test]
fn pictures_of_everything_in_a_box() {
    assert_same("pictures", &[(Connect, 2), (Connect, MIS)]);
}

/// The tables are what the path tracer finds.
#[test]
fn path_tracer_reproduces_its_tables() {
    for name in ["box", "glass-ball", "window"] {
        let scene = &boxes::named(name);
        let settings = &Settings { seed: 7, ..settings(SIDE, SIDE) };
        let subject = Subject { scene, accel: &accel(scene), settings, region: &[] };
        let table = Table::of(name, scene, [SIDE; 2]);
        let difference = subject.traced(2048).against(&table.pixels(&[]));
        println!("{name}: {difference}");
        let Difference { off, error, z2, .. } = difference;
        assert!(error < 0.005 && off.abs() < 4.0 * error && z2 < 2.0, "{name}: {difference}");
    }
}
