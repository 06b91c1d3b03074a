//! No file of Radiance's makes the loader panic: good ones with pieces deleted, doubled or
//! replaced. `PROPTEST_CASES=100000` tries far more.

use crate::common::mutate::{apply, change, fuzz_config, load_soundly};
use proptest::collection::vec;
use proptest::prelude::*;

const ROOM: &[u8] = include_bytes!("../data/radiance/room.rad");
const COLUMN: &[u8] = include_bytes!("../data/radiance/column.rad");
const BALL: &[u8] = include_bytes!("../data/radiance/ball.rtm");
const FROZEN: &[u8] = include_bytes!("../data/radiance/frozen.oct");
const LAMP: &[u8] = include_bytes!("../data/radiance/box.rad");
const DATA: &[u8] = include_bytes!("../data/radiance/box.dat");
const VIEW: &[u8] = include_bytes!("../data/radiance/room.vf");

/// Loads a scene of these files: it must be fit for rendering, or refused with advice.
fn check(room: &[u8], column: &[u8], view: &[u8]) {
    let folder = tempfile::tempdir().unwrap();
    for (name, content) in [("room.rad", room), ("column.rad", column), ("room.vf", view)] {
        std::fs::write(folder.path().join(name), content).unwrap();
    }
    load_soundly(&folder.path().join("room.rad"));
}

/// Loads a scene with a compiled mesh, a frozen octree and a luminaire.
fn check_compiled(parts: [&[u8]; 4]) {
    let folder = tempfile::tempdir().unwrap();
    let names = ["ball.rtm", "frozen.oct", "box.rad", "box.dat"];
    for (name, content) in names.into_iter().zip(parts) {
        std::fs::write(folder.path().join(name), content).unwrap();
    }
    let text = "void mesh ball 1 ball.rtm 0 0\nvoid instance it 1 frozen.oct 0 0\n!xform box.rad\n";
    let path = folder.path().join("a.rad");
    std::fs::write(&path, text).unwrap();
    load_soundly(&path);
}

proptest! {
    #![proptest_config(fuzz_config(300))]

    #[test]
    fn changed_scenes_load_or_are_refused(changes in vec(change(), 1..6)) {
        let mut room = ROOM.to_vec();
        changes.iter().for_each(|change| apply(&mut room, change));
        check(&room, COLUMN, VIEW);
    }

    #[test]
    fn changed_parts_and_views_load_or_are_refused(changes in vec(change(), 1..6)) {
        let (mut column, mut view) = (COLUMN.to_vec(), VIEW.to_vec());
        for change in &changes {
            apply(&mut column, change);
            apply(&mut view, change);
        }
        check(ROOM, &column, VIEW);
        check(ROOM, COLUMN, &view);
    }

    #[test]
    fn changed_compiled_files_load_or_are_refused(
        which in 0usize..4,
        changes in vec(change(), 1..6),
    ) {
        let mut own = [BALL, FROZEN, LAMP, DATA][which].to_vec();
        changes.iter().for_each(|change| apply(&mut own, change));
        let mut parts = [BALL, FROZEN, LAMP, DATA];
        parts[which] = &own;
        check_compiled(parts);
    }
}
