//! Measured times beside those of the paper's Table 2.

use super::published::{CAMERA_PATHS, TABLE_2};
use crate::timing::TimeModel;
use std::fmt::Write;

/// The model's times at the counts of Table 2 beside the published ones, in seconds and over their
/// own camera time: machines differ, shapes less.
pub fn beside_table_2(model: &TimeModel) -> String {
    let n_camera = f64::from(CAMERA_PATHS[0]);
    let mut text = format!(
        "one iteration at N_B = {n_camera}, the paper's Table 2 on the left, here on \
         the right\n{:>7} | {:^51} | {:^38}\n{:>7} | {:>12} {:>12} {:>12} {:>12} | {:>12} {:>12} \
         {:>12}\n",
        "",
        "seconds",
        "over the camera time",
        "N_F",
        "camera",
        "light",
        "merge",
        "whole",
        "light",
        "merge",
        "whole",
    );
    for row in TABLE_2 {
        let (n_light, [camera, light, merge]) = (f64::from(row.light_paths), row.parts);
        let parts = model.parts(n_light, n_camera);
        let [_, here_light, here_camera, here_merge] = parts;
        let paper = [camera, light, merge, camera + light + merge];
        let here = [here_camera, here_light, here_merge, parts.iter().sum()];
        write!(text, "{n_light:>7}").expect("strings take everything");
        let mut columns = |scales: [f64; 2], first: usize| {
            text.push_str(" |");
            for (paper, here) in paper.iter().zip(here).skip(first) {
                write!(text, " {:>5.2} {:>6.3}", paper / scales[0], here / scales[1])
                    .expect("strings take everything");
            }
        };
        columns([1.0; 2], 0);
        columns([camera, here_camera], 1);
        text.push('\n');
    }
    text
}
