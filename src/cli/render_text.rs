//! What `bdpm render` tells at the end, for people.

use super::human_time;
use super::render::Report;
use bdpm::goal::StoppedBy;

/// The report in a few lines.
pub fn text(report: &Report) -> String {
    let run = &report.run;
    let stopped = if run.stopped_by == StoppedBy::Interrupt { ", interrupted" } else { "" };
    let rms = match (report.rms, report.relative_rms) {
        (Some(rms), Some(share)) => format!(", RMS {rms:.4} ({:.2} %)", 100.0 * share),
        _ => String::new(),
    };
    let mut text = format!(
        "{} and {}: {} iterations in {}, {:.1} Mray/s, mean luminance {:.4}{rms}{stopped}\n",
        report.exr,
        report.png,
        run.iterations,
        human_time(run.seconds.render),
        run.rays_per_second / 1e6,
        run.mean_luminance
    );
    text += &choice(report);
    if let Some(bias) = &report.merge_bias
        && bias.share_beyond_noise >= 0.01
    {
        text += &format!(
            "warning: the merge bias exceeds the noise in {:.0} % of the image, up to {:.1} times\n\
             help: lower --radius; the bias falls as its square\n",
            100.0 * bias.share_beyond_noise,
            bias.worst_over_noise
        );
    }
    text
}

/// The counts that were chosen, and how what was promised compares to what came.
fn choice(report: &Report) -> String {
    let (Some(promise), Some(last)) = (&report.promise, report.blocks.last()) else {
        return String::new();
    };
    let camera = if last.least_camera_paths == last.most_camera_paths {
        last.least_camera_paths.to_string()
    } else {
        let (least, most) = (last.least_camera_paths, last.most_camera_paths);
        format!("{:.2} ({least} to {most})", last.camera_paths)
    };
    let mut text = format!(
        "chosen: {} light paths, {camera} camera paths per pixel; one light path and one camera \
         path per pixel would take {:.2} times as long\n",
        last.light_paths, promise.gain_over_one_each
    );
    if let Some(rms) = report.rms {
        text += &format!(
            "promised after {}: RMS {:.4} in {}; came: {rms:.4} in {}\n",
            human_time(promise.said_after),
            promise.rms,
            human_time(promise.seconds),
            human_time(report.run.seconds.render),
        );
    }
    text
}
