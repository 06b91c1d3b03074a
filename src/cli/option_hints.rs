//! Names the options that an error's advice is about. The library names quantities, since programs
//! that use it have no command line.

use clap::Command;

/// Quantities in the advice of errors, and their options. Phrases are whole words, longer ones
/// before their parts.
const OPTIONS: &[(&str, &str)] = &[
    ("light paths", "light-paths"),
    ("light path", "light-paths"),
    ("camera paths", "camera-paths"),
    ("camera path", "camera-paths"),
    ("resolution", "resolution"),
    ("crop", "crop"),
    ("merge radius", "radius"),
    ("merge radii", "radius"),
    ("iterations", "iterations"),
    ("time", "time"),
    ("target RMS", "target-rms"),
    ("threads", "threads"),
    ("backend", "accel"),
    ("place the camera", "look-at"),
    ("camera", "camera"),
    ("environment", "environment"),
    ("default light", "no-fallback-light"),
    ("strict", "strict"),
    ("region", "region"),
    ("plan", "plan"),
    ("parts", "part"),
    ("layers", "layers"),
    ("noise file", "noise"),
    ("denoising", "denoise"),
    ("checkpoint", "resume"),
    ("memory limit", "max-memory"),
    ("table of meters", "meters"),
];

/// Appends a line with the options of `command` that change the quantities in the advice of a shown
/// error. An error that names an option already is unchanged.
pub fn with_options(error: &str, command: &Command) -> String {
    let has_option = |name: &str| {
        let mut options = command.get_arguments();
        options.any(|option| option.get_long() == Some(name) && !option.is_hide_set())
    };
    let advice: Vec<&str> = error.lines().filter_map(|line| line.strip_prefix("help: ")).collect();
    let mut advice = without_quoted(&advice.join("\n"));
    let mut options: Vec<String> = Vec::new();
    for (quantity, option) in OPTIONS {
        let option_text = format!("--{option}");
        if !has_words(&advice, quantity) {
            continue;
        }
        // A camera path is no camera
        advice = advice.replace(quantity, "");
        if has_option(option) && !options.contains(&option_text) {
            options.push(option_text);
        }
    }
    if options.is_empty() || names_option(error) {
        return error.to_owned();
    }
    let noun = if options.len() == 1 { "option" } else { "options" };
    format!("{error}\n{noun}: {}", options.join(", "))
}

fn names_option(text: &str) -> bool {
    text.split(|c: char| c.is_whitespace() || "`(".contains(c)).any(|word| {
        word.strip_prefix("--").is_some_and(|name| name.starts_with(|c: char| c.is_alphabetic()))
    })
}

/// The text outside backticks, which hold keys of files and commands.
fn without_quoted(text: &str) -> String {
    text.split('`').step_by(2).collect()
}

/// Returns true if `text` contains `words`, not as a part of longer words.
fn has_words(text: &str, words: &str) -> bool {
    let is_inside = |c: Option<char>| c.is_some_and(|c| c.is_alphanumeric() || "-_".contains(c));
    text.match_indices(words).any(|(start, found)| {
        let (before, after) = (&text[..start], &text[start + found.len()..]);
        !is_inside(before.chars().next_back()) && !is_inside(after.chars().next())
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cli::Cli;
    use clap::CommandFactory;

    fn shown(advice: &str, command: &str) -> String {
        let cli = Cli::command();
        with_options(&format!("it failed\nhelp: {advice}"), cli.find_subcommand(command).unwrap())
    }

    #[test]
    fn advice_about_quantities_is_followed_by_their_options() {
        let found = shown("use fewer light paths or a lower resolution", "render");
        assert!(found.ends_with("resolution\noptions: --light-paths, --resolution"), "{found}");
        let found = shown("give at least 1 camera path per pixel", "render");
        assert!(found.ends_with("\noption: --camera-paths"), "{found}");
        let found = shown("load the scene without strict checking", "info");
        assert!(found.ends_with("\noption: --strict"), "{found}");
    }

    #[test]
    fn options_of_other_commands_words_in_backticks_and_longer_words_are_not_hinted() {
        for (advice, command) in [
            ("use a lower resolution", "compare"),
            ("use fewer light paths", "calibrate"),
            ("use one of `camera`, `time`", "render"),
            ("make it sometimes strictly planar", "render"),
            ("check the path", "render"),
        ] {
            assert!(!shown(advice, command).contains("option"), "{advice}");
        }
    }

    #[test]
    fn errors_that_name_an_option_are_unchanged() {
        let found = shown("give --time 1s or more", "render");
        assert!(found.ends_with("give --time 1s or more"), "{found}");
    }

    #[test]
    fn every_hinted_option_exists_in_a_command() {
        let cli = Cli::command();
        for (_, option) in OPTIONS {
            let has = |command: &Command| {
                command.get_arguments().any(|argument| argument.get_long() == Some(option))
            };
            assert!(cli.get_subcommands().any(has), "{option}");
        }
    }
}
