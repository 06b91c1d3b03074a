//! Groups and order of the options in help texts of commands that render.

use bdpm::Settings;
use clap::{Arg, Command};

/// Options of a group by their ids.
struct Group {
    heading: &'static str,
    /// Options that `-h` shows.
    common: &'static [&'static str],
    /// Options that only `--help` shows.
    other: &'static [&'static str],
}

/// All groups, in the order of help texts.
const GROUPS: &[Group] = &[
    Group { heading: "Main options", common: &["output", "time", "resolution"], other: &[] },
    Group {
        heading: "Scene",
        common: &["camera", "environment", "sky", "lights"],
        other: &["look_at", "fov", "camera_from", "no_fallback_light", "strict"],
    },
    Group {
        heading: "Image",
        common: &["crop", "denoise"],
        other: &[
            "no_denoise",
            "layers",
            "tonemap",
            "exposure",
            "exr_compression",
            "half",
            "photometric",
        ],
    },
    Group {
        heading: "When to stop",
        common: &["target_error", "quick"],
        other: &["target_rms", "iterations", "audit"],
    },
    Group {
        heading: "Output",
        common: &["report", "view", "verbose", "dry_run"],
        other: &["noise", "region", "json", "progress", "quiet"],
    },
    Group {
        heading: "Continue and distribute",
        common: &["checkpoint", "resume"],
        other: &["checkpoint_every", "plan", "part", "light_groups"],
    },
    // After the settings that are in no group.
    Group {
        heading: EXPERT,
        common: &[],
        other: &["objective", "estimator", "timings", "accel", "threads"],
    },
];

/// Heading of the options that few people need.
const EXPERT: &str = "Expert";

/// Last line of short help texts.
const MORE: &str = "`--help` shows all options.";

/// Position of an option in help texts, its heading, and whether `-h` shows it. Positional
/// arguments precede all groups, options outside of the groups follow them.
fn place(argument: &Arg) -> (usize, Option<&'static str>, bool) {
    let id = argument.get_id().as_str();
    let mut position = 1;
    for Group { heading, common, other } in GROUPS {
        if *heading == EXPERT {
            position += Settings::NAMES.len();
        }
        let mut options = common.iter().chain(*other);
        if let Some(index) = options.position(|option| *option == id) {
            return (position + index, Some(heading), index < common.len());
        }
        position += common.len() + other.len();
    }
    if let Some(index) = Settings::NAMES.iter().position(|setting| *setting == id) {
        let others = GROUPS.last().map_or(0, |group| group.other.len());
        return (position - others - Settings::NAMES.len() + index, Some(EXPERT), false);
    }
    (if argument.is_positional() { 0 } else { position }, None, true)
}

/// Groups the options of each subcommand that has settings of an image.
pub fn with_groups(mut command: Command) -> Command {
    let has_settings = |command: &Command| {
        command.get_arguments().any(|argument| argument.get_id() == "merge_vertex")
    };
    let names = command.get_subcommands().filter(|command| has_settings(command));
    let names: Vec<_> = names.map(|command| command.get_name().to_owned()).collect();
    for name in names {
        command = command.mut_subcommand(name, grouped);
    }
    command
}

/// Sorts the options by group, since headings appear in the order of their first options.
fn grouped(command: Command) -> Command {
    let mut arguments: Vec<Arg> = command.get_arguments().cloned().collect();
    arguments.sort_by_key(|argument| place(argument).0);
    let mut arguments = arguments.into_iter().map(|argument| {
        let (position, heading, is_common) = place(&argument);
        argument.help_heading(heading).display_order(position).hide_short_help(!is_common)
    });
    let command = command.mut_args(|_| arguments.next().expect("as many as before"));
    command.after_help(MORE).after_long_help("")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cli::definition;

    fn subcommand(name: &str) -> Command {
        definition().find_subcommand(name).unwrap().clone()
    }

    #[test]
    fn every_option_of_render_is_in_a_group() {
        let names = [
            "render",
            "info",
            "analyze",
            "calibrate",
            #[cfg(feature = "paper")]
            "reproduce",
        ];
        for name in names {
            for argument in subcommand(name).get_arguments() {
                let has_group = argument.get_help_heading().is_some();
                assert!(has_group || argument.is_positional(), "{name}: {}", argument.get_id());
            }
        }
    }

    #[test]
    fn every_grouped_option_exists_in_a_command() {
        let command = definition();
        for id in GROUPS.iter().flat_map(|group| group.common.iter().chain(group.other)) {
            let has = |command: &Command| command.get_arguments().any(|a| a.get_id() == *id);
            assert!(command.get_subcommands().any(has), "{id}");
        }
    }

    #[test]
    fn short_help_has_few_options_and_names_the_long_one() {
        let short = subcommand("render").render_help().to_string();
        let long = subcommand("render").render_long_help().to_string();
        let count =
            |text: &str| text.lines().filter(|line| line.trim_start().starts_with('-')).count();
        assert!((10..=17).contains(&count(&short)), "{short}");
        assert!(count(&long) > 35 && !long.contains(MORE), "{long}");
        assert!(short.trim_end().ends_with(MORE), "{short}");
    }
}
