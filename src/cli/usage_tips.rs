//! Tips for command lines that cannot be parsed: options of other renderers, and a scene without a
//! subcommand.

use bdpm::import::SCENE_EXTENSIONS;
use clap::Command;
use clap::error::{ContextKind, ContextValue, Error, ErrorKind};
use std::ffi::OsString;
use std::path::Path;

/// Options of other renderers: their names, and the tip. A tip is shown if the subcommand has the
/// options that the tip names.
const FOREIGN_OPTIONS: &[(&[&str], &str)] = &[
    (
        &["--spp", "--samples", "--samples-per-pixel"],
        "use `--time` or `--target-error`; `--camera-paths` fixes the samples per pixel of an iteration",
    ),
    (&["--width", "--height", "--size"], "use `--resolution WxH`, such as --resolution 1280x720"),
];

/// Adds a tip to an error of `arguments`, which start with the name of the program, if there is
/// one.
pub fn with_tip(mut error: Error, program: &Command, arguments: &[OsString]) -> Error {
    let text = |kind| match error.get(kind) {
        Some(ContextValue::String(text)) => text.clone(),
        _ => String::new(),
    };
    let tip = match error.kind() {
        ErrorKind::UnknownArgument => {
            let subcommand = arguments.get(1).and_then(|name| program.find_subcommand(name));
            subcommand.and_then(|subcommand| {
                option_tip(&text(ContextKind::InvalidArg), subcommand).map(str::to_owned)
            })
        }
        ErrorKind::InvalidSubcommand => scene_tip(&text(ContextKind::InvalidSubcommand)),
        _ => None,
    };
    if let Some(tip) = tip {
        // An option of a similar name, and the advice to escape the value, would mislead
        error.remove(ContextKind::SuggestedArg);
        error.remove(ContextKind::SuggestedSubcommand);
        error.insert(ContextKind::Suggested, ContextValue::StyledStrs(vec![tip.into()]));
    }
    error
}

fn option_tip(unknown: &str, subcommand: &Command) -> Option<&'static str> {
    let name = unknown.split('=').next()?;
    let (_, tip) = FOREIGN_OPTIONS.iter().find(|(names, _)| names.contains(&name))?;
    let has = |option: &str| {
        subcommand.get_arguments().any(|argument| argument.get_long() == option.strip_prefix("--"))
    };
    let mut quoted = tip.split('`').skip(1).step_by(2);
    quoted.all(|option| option.split(' ').next().is_some_and(has)).then_some(*tip)
}

/// A scene file in place of the subcommand.
fn scene_tip(unknown: &str) -> Option<String> {
    let path = Path::new(unknown);
    let extension = path.extension().map(|extension| extension.to_string_lossy().to_lowercase());
    let is_scene = extension.is_some_and(|name| SCENE_EXTENSIONS.contains(&&name[..]));
    (is_scene || path.exists()).then(|| format!("did you mean `bdpm render {unknown}`?"))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cli::definition;

    #[test]
    fn tips_name_options_of_the_subcommand() {
        let program = definition();
        let tip = |name, option| option_tip(option, program.find_subcommand(name).unwrap());
        assert!(tip("render", "--spp").is_some_and(|tip| tip.contains("--camera-paths")));
        assert!(tip("render", "--width=640").is_some_and(|tip| tip.contains("--resolution")));
        assert_eq!(tip("info", "--spp"), None);
        assert_eq!(tip("compare", "--width"), None);
        assert_eq!(tip("render", "--wide"), None);
        for (names, _) in FOREIGN_OPTIONS {
            assert!(names.iter().all(|name| tip("render", name).is_some()), "{names:?}");
        }
    }

    #[test]
    fn scene_tip_needs_a_scene_file() {
        assert!(scene_tip("box.GLB").is_some_and(|tip| tip.contains("bdpm render box.GLB")));
        assert_eq!(scene_tip("rendr"), None);
    }
}
