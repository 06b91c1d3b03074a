//! What `bdpm render` goes on with, plans and times: whether they fit.

use super::loaded_scene::LoadedScene;
use super::render::Args;
use bdpm::adaptive::plan::Plan;
use bdpm::adaptive::stopping::Goal;
use bdpm::base::error::{Error, Result};
use bdpm::film::aov::AovSelection;
use bdpm::film::counts::Counts;
use bdpm::image_io;
use bdpm::noise::film::BatchGrain;
use bdpm::render::block::Block;
use bdpm::settings::Settings;
use bdpm::settings::provenance::Provenance;
use bdpm::timing::{TimeModel, Timings};
use std::path::Path;

/// Where the counts come from.
pub enum Counting {
    Fixed,
    Automatic,
    Replay(Plan),
}

/// Reads a plan with what it belongs to. Where its iterations are open, seed and version are as well.
pub fn read_plan(path: &Path, args: &Args) -> Result<(Plan, Provenance)> {
    let image = image_io::read_exr(path)?;
    let plan = Plan::read_from(&image).map_err(|e| e.at(path))?;
    let mut origin = Provenance::from_metadata(&image.metadata).map_err(|e| e.at(path))?;
    let Settings { width, height, .. } = origin.settings;
    if (image.width, image.height) != (width, height) {
        let size = format!("{}x{}", image.width, image.height);
        return Err(Error::new(
            format!("the image has {size} pixels, but says that it was made with {width}x{height}"),
            "give the file as bdpm wrote it",
        )
        .at(path));
    }
    if plan.iterations().is_none() {
        origin.version = env!("CARGO_PKG_VERSION").into();
        origin.settings.seed = args.session.scene.wishes.seed.unwrap_or(origin.settings.seed);
    }
    Ok((plan, origin))
}

/// The model of times that belong to this scene and these settings.
pub fn fitting(times: &Timings, path: &Path, prepared: &LoadedScene) -> Result<TimeModel> {
    let Settings { width, height, .. } = prepared.origin.settings;
    let facts = prepared.origin.to_metadata();
    times.check_fits(&facts, width, height).map_err(|e| e.at(path))?;
    Ok(times.model)
}

/// The counts of all iterations, where they are the same and their number is open.
pub fn fixed_counts(counting: &Counting, prepared: &LoadedScene) -> Option<Counts> {
    let Settings { light_paths, camera_paths, .. } = prepared.origin.settings;
    match counting {
        Counting::Fixed => Some(Counts::uniform(light_paths, camera_paths)),
        Counting::Replay(plan) if plan.iterations().is_none() => Some(plan.steps[0].counts.clone()),
        Counting::Replay(_) | Counting::Automatic => None,
    }
}

/// Refuses to go on to fewer iterations than there are.
pub fn check_goal(goal: Goal, blocks: &[Block]) -> Result<()> {
    let done: u64 = blocks.iter().map(|block| block.film.iterations).sum();
    match goal.iterations {
        Some(wanted) if wanted < done => Err(Error::new(
            format!("the checkpoint holds {done} iterations, more than {wanted}"),
            format!("give --iterations {done} or more, or --time"),
        )),
        _ => Ok(()),
    }
}

/// Refuses to write coefficients by pixel of which a checkpoint has only sums by tile.
pub fn check_grain(args: &Args, blocks: &[Block]) -> Result<()> {
    let Some(path) = &args.noise else { return Ok(()) };
    let by_tile = |block: &Block| {
        block.statistics.noise.as_ref().is_some_and(|noise| noise.grain() == BatchGrain::Tile)
    };
    if blocks.iter().any(by_tile) {
        return Err(Error::new(
            "the checkpoint was begun without --noise and lacks the batches of single pixels",
            "resume without --noise, or begin anew with it",
        )
        .at(path));
    }
    Ok(())
}

/// Refuses what a checkpoint did not keep.
pub fn check_kept(args: &Args, kept: AovSelection) -> Result<()> {
    let wanted = args.kept();
    let lacks = if args.denoise && !kept.folds {
        "--denoise"
    } else if args.layers.is_empty() {
        return Ok(());
    } else if wanted.light && !kept.light || wanted.features && !kept.features {
        "these --layers"
    } else {
        return Ok(());
    };
    Err(Error::new(
        format!("the checkpoint was begun without {lacks}"),
        "resume without that, or begin anew with it",
    ))
}
