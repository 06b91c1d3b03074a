//! `bdpm render --light-groups`: an image for each group of light sources, and their sum.
//!
//! Groups are rendered one after the other, as scenes of their own: each with the technique that is
//! best for its light, and with random numbers of its own, so that the error of any mixture is
//! known.

use super::mix;
use super::render::{Args, Rendering, render_loaded};
use super::render_files::Outputs;
use super::scene_input::SceneInput;
use super::{Output, reported, say};
use bdpm::base::error::{Error, Result};
use bdpm::base::file_id::folder;
use bdpm::image_io;
use bdpm::load::{Loaded, matches};
use bdpm::measurement::light_groups;
use bdpm::mpi::Ranks;
use bdpm::output::light_layers::check_names;
use bdpm::output::light_mix::LightImages;
use bdpm::scene::{LightSource, Scene};
use bdpm::settings::combinations::{self, JobOptions, Request};
use bdpm::settings::{PartialSettings, Settings};
use std::sync::Arc;
use std::time::{Duration, Instant};

/// Time to read the image of a group and to write its layers, for each pixel.
const WRITE_GROUP_PIXEL: Duration = Duration::from_nanos(300);

/// Least time of a group.
const LEAST_TIME: Duration = Duration::from_millis(1);

/// Groups by the names of their light sources; without any, each name is a group.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct LightGroups(Vec<(String, Vec<String>)>);

/// Reads groups such as `key=lamp*+window,sky=environment`.
pub fn parse(text: &str) -> Result<LightGroups> {
    let wrong = |part: &str| {
        let advice = "give names and light sources, such as key=lamp*+window,sky=environment";
        Error::new(format!("`{part}` is not a group of light sources"), advice)
    };
    let group = |part: &str| {
        let (name, lights) = part.split_once('=').ok_or_else(|| wrong(part))?;
        let lights: Vec<String> = lights.split('+').map(|own| own.trim().to_owned()).collect();
        let is_empty = name.trim().is_empty() || lights.iter().any(String::is_empty);
        if is_empty { Err(wrong(part)) } else { Ok((name.trim().to_owned(), lights)) }
    };
    let parts = text.split(',').filter(|_| !text.is_empty());
    parts.map(group).collect::<Result<_>>().map(LightGroups)
}

impl LightGroups {
    /// The groups of a scene, with their light sources. Every light source is in one of them.
    fn of(&self, scene: &Scene) -> Result<Vec<(String, Vec<LightSource>)>> {
        let named = light_groups(scene);
        if self.0.is_empty() {
            return Ok(named);
        }
        let mut groups: Vec<(String, Vec<LightSource>)> =
            self.0.iter().map(|(name, _)| (name.clone(), Vec::new())).collect();
        for (light, sources) in named {
            let has = |(_, patterns): &(String, Vec<String>)| {
                patterns.iter().any(|pattern| matches(pattern, &light))
            };
            let own: Vec<usize> = (0..self.0.len()).filter(|&group| has(&self.0[group])).collect();
            let [group] = own[..] else {
                let count = if own.is_empty() { "no group" } else { "several groups" };
                let problem = format!("the light source `{light}` is in {count}");
                return Err(Error::new(problem, "name it in one group, such as rest=*"));
            };
            groups[group].1.extend(sources);
        }
        if let Some((name, _)) = groups.iter().find(|(_, sources)| sources.is_empty()) {
            let problem = format!("the group `{name}` has no light source of the scene");
            return Err(Error::new(problem, "`bdpm info` shows the names of light sources"));
        }
        Ok(groups)
    }
}

/// Renders all groups, each for its share of the time, and writes their sum. After an interrupt or
/// a failure it is the sum of those that were rendered.
pub fn render(args: &Args, groups: &LightGroups, ranks: &dyn Ranks) -> Result<Output> {
    let start = Instant::now();
    check_ranks(ranks)?;
    let mut files = Outputs::new(args)?;
    let input = SceneInput::load(&args.session)?;
    files.spare_inputs(args)?;
    let groups = groups.of(&input.loaded.scene)?;
    check_names(groups.iter().map(|(name, _)| &name[..]))?;
    let beside = folder(&files.exr);
    let temporary = tempfile::tempdir_in(&beside).map_err(|e| Error::io("write", &beside, e))?;
    let reserved = WRITE_GROUP_PIXEL * groups.len() as u32 * pixels(args, &input)?;
    let (mut images, count) = (Vec::new(), groups.len());
    let (mut failure, mut is_stopped, mut missing) = (None, false, Vec::new());
    for (number, (name, sources)) in groups.into_iter().enumerate() {
        if is_stopped || failure.is_some() {
            missing.push(name);
            continue;
        }
        if !args.session.quiet {
            say(&format!("light group {} of {count}: {name}", number + 1));
        }
        let file = temporary.path().join(format!("{number}.exr"));
        let share = |time: Duration| {
            let left = time.saturating_sub(start.elapsed() + reserved) / (count - number) as u32;
            left.max(LEAST_TIME) // An image has at least one iteration.
        };
        let mut own = args.of_group(&name, number as u64, &input);
        (own.output, own.session.time) = (Some(file.clone()), args.session.time.map(share));
        let scene = Arc::new(input.loaded.scene.with_only(&sources)?);
        match render_loaded(Rendering::new(&own, &input.with_scene(scene))?, ranks) {
            Ok((output, is_interrupted)) => {
                images.push((name, image_io::read_exr(&file)?));
                (failure, is_stopped) = (output.failure, is_interrupted);
            }
            Err(error) if images.is_empty() => return Err(error),
            Err(error) => {
                failure = Some(error);
                missing.push(name);
            }
        }
    }
    let written = LightImages::new(images)
        .and_then(|lights| mix::write(&lights, &[], (&files.exr, &files.png), &args.files));
    let report = written.inspect_err(|_| {
        let kept = temporary.keep();
        say(&format!("the images of the light groups are in {}", kept.display()));
    })?;
    if is_stopped && !missing.is_empty() {
        let problem = format!("interrupted before the light of {}", missing.join(", "));
        failure = failure.or(Some(Error::new(problem, "render it by --lights, and mix both")));
    } else if !missing.is_empty() && !args.session.quiet {
        say(&format!("warning: the image lacks the light of {}", missing.join(", ")));
    }
    let form = (args.session.scene.json, args.session.quiet);
    let text = reported(form, &report, || report.text());
    Ok(Output { text, failure, ..Output::default() })
}

/// Refuses several processes.
fn check_ranks(ranks: &dyn Ranks) -> Result<()> {
    let plain = PartialSettings::default();
    let settings = Settings::resolve(&plain, &plain, 1.0)?;
    let has_ranks = ranks.count() > 1;
    let job = JobOptions { has_light_groups: true, has_ranks, ..JobOptions::default() };
    combinations::check(&Request { job, ..Request::of(&settings) })
}

/// Pixels of the image.
fn pixels(args: &Args, input: &SceneInput) -> Result<u32> {
    let Loaded { scene, defaults, .. } = &input.loaded;
    Ok(Settings::resolve(&args.settings(), defaults, scene.size())?.pixels() as u32)
}

impl Args {
    /// The arguments of a group of this name and number. Groups share no random numbers, so that
    /// their errors are independent.
    fn of_group(&self, name: &str, number: u64, input: &SceneInput) -> Self {
        let mut own = self.clone();
        own.light_groups = None;
        let scene = &mut own.session.scene;
        let seed = scene.settings.seed.or(input.loaded.defaults.seed).unwrap_or(1);
        scene.settings.seed = Some(seed.wrapping_add(number));
        (scene.light.lights, scene.json) = (vec![name.to_owned()], false);
        own
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn groups_have_names_and_light_sources() {
        assert_eq!(parse("").unwrap(), LightGroups::default());
        let lights = |all: &[&str]| all.iter().map(|own| (*own).to_owned()).collect::<Vec<_>>();
        let expected = vec![
            ("key".to_owned(), lights(&["lamp*", "a b"])),
            ("sky".to_owned(), lights(&["environment"])),
        ];
        assert_eq!(parse("key=lamp*+a b, sky = environment").unwrap(), LightGroups(expected));
        for text in ["key", "=lamp", "key=", "key=a++b", "key=a,"] {
            assert!(parse(text).unwrap_err().to_string().contains("is not a group"), "{text}");
        }
    }
}
