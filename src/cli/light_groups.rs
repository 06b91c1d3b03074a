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
use bdpm::load::matches;
use bdpm::measurement::light_groups;
use bdpm::mpi::Ranks;
use bdpm::output::light_mix::LightImages;
use bdpm::scene::{LightSource, Scene};
use std::path::Path;
use std::sync::Arc;
use std::time::{Duration, Instant};

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

/// Renders all groups, each for its share of the time, and writes their sum. After an interrupt it
/// is the sum of those that were rendered.
pub fn render(args: &Args, groups: &LightGroups, ranks: &dyn Ranks) -> Result<Output> {
    let start = Instant::now();
    if ranks.count() > 1 {
        let problem = "several processes cannot render groups of light sources in turn";
        return Err(Error::new(problem, "render them by --lights, and mix the images"));
    }
    let mut files = Outputs::new(args)?;
    let input = SceneInput::load(&args.session)?;
    files.spare_inputs(args)?;
    let groups = groups.of(&input.loaded.scene)?;
    let beside = folder(&files.exr);
    let temporary = tempfile::tempdir_in(&beside).map_err(|e| Error::io("write", &beside, e))?;
    let (mut images, count) = (Vec::new(), groups.len());
    let (mut failure, mut missing) = (None, Vec::new());
    for (number, (name, sources)) in groups.into_iter().enumerate() {
        if failure.is_some() {
            missing.push(name);
            continue;
        }
        if !args.session.quiet {
            say(&format!("light group {} of {count}: {name}", number + 1));
        }
        let file = temporary.path().join(format!("{number}.exr"));
        let left = |time: Duration| {
            let left = time.saturating_sub(start.elapsed()) / (count - number) as u32;
            left.max(LEAST_TIME) // An image has at least one iteration.
        };
        let own = args.of_group((&name, number as u64), &input, (&file, left));
        let scene = Arc::new(input.loaded.scene.with_only(&sources)?);
        let input = input.with_scene(scene);
        match render_loaded(Rendering::new(&own, &input)?, ranks) {
            Ok((output, is_interrupted)) => {
                images.push((name, image_io::read_exr(&file)?));
                let stopped = is_interrupted.then(|| {
                    Error::new("interrupted", "render the light sources that are missing")
                });
                failure = output.failure.or(stopped);
            }
            Err(error) if images.is_empty() => return Err(error),
            Err(error) => {
                failure = Some(error);
                missing.push(name);
            }
        }
    }
    if !missing.is_empty() {
        say(&format!("warning: the image lacks the light of {}", missing.join(", ")));
    }
    let report =
        mix::write(&LightImages::new(images)?, &[], (&files.exr, &files.png), &args.files)?;
    let form = (args.session.scene.json, args.session.quiet);
    let text = reported(form, &report, || report.text());
    // An interrupt in the last group leaves a whole image, as that of a render without groups.
    Ok(Output { text, failure: failure.filter(|_| !missing.is_empty()), ..Output::default() })
}

impl Args {
    /// The arguments of a group of this name and number, whose image is written to `file` after the
    /// time that is `left`. Groups share no random numbers, so that their errors are independent.
    fn of_group(
        &self,
        (name, number): (&str, u64),
        input: &SceneInput,
        (file, left): (&Path, impl Fn(Duration) -> Duration),
    ) -> Self {
        let mut own = self.clone();
        (own.light_groups, own.output) = (None, Some(file.to_owned()));
        own.session.time = self.session.time.map(left);
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
