//! No file of Radiance's makes the loader panic: good ones with pieces deleted, doubled or
//! replaced. `PROPTEST_CASES=100000` tries far more.

use crate::common::mutate::{apply, change, fuzz_config, load_soundly};
use proptest::collection::vec;
use proptest::prelude::*;

const ROOM: &[u8] = include_bytes!("../data/radiance/room.rad");
const COLUMN: &[u8] = include_bytes!("../data/radiance/column.rad");
const VIEW: &[u8] = include_bytes!("../data/radiance/room.vf");

/// Loads a scene of these files: it must be fit for rendering, or refused with advice.
fn check(room: &[u8], column: &[u8], view: &[u8]) {
    let folder = tempfile::tempdir().unwrap();
    for (name, content) in [("room.rad", room), ("column.rad", column), ("room.vf", view)] {
        std::fs::write(folder.path().join(name), content).unwrap();
    }
    load_soundly(&folder.path().join("room.rad"));
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
}
