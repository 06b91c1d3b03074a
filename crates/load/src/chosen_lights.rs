//! Scenes with some of their light sources, which are chosen by name.

use bdpm_core::base::error::{Error, Result};
use bdpm_core::scene::{LightSource, Scene};

/// Tests whether a pattern stands for a name: `*` is any number of characters.
pub fn matches(pattern: &str, name: &str) -> bool {
    let Some((start, rest)) = pattern.split_once('*') else { return pattern == name };
    let Some(mut name) = name.strip_prefix(start) else { return false };
    let (middle, end) = rest.rsplit_once('*').unwrap_or(("", rest));
    for part in middle.split('*') {
        let Some(at) = name.find(part) else { return false };
        name = &name[at + part.len()..];
    }
    name.ends_with(end)
}

/// The light sources whose names one of the patterns stands for, in the order of the scene. Names
/// are those of [`Scene::light_sources`].
///
/// # Errors
/// If a pattern stands for no light source. Names them all.
pub fn chosen(scene: &Scene, patterns: &[String]) -> Result<Vec<LightSource>> {
    let all = scene.light_sources();
    for pattern in patterns {
        if !all.iter().any(|(_, name)| matches(pattern, name)) {
            let mut names: Vec<&str> = all.iter().map(|(_, name)| &name[..]).collect();
            names.dedup();
            let problem = format!("the scene has no light source `{pattern}`");
            return Err(Error::new(problem, format!("give one of: {}", names.join(", "))));
        }
    }
    let is_chosen = |name: &str| patterns.iter().any(|pattern| matches(pattern, name));
    Ok(all.into_iter().filter(|(_, name)| is_chosen(name)).map(|(source, _)| source).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn stars_stand_for_any_characters() {
        for (pattern, name, expected) in [
            ("lamp", "lamp", true),
            ("lamp", "lamps", false),
            ("lamp*", "lamp", true),
            ("lamp*", "lamp 2", true),
            ("*lamp", "left lamp", true),
            ("*lamp", "lamp 2", false),
            ("*", "", true),
            ("l*p*2", "lamp 2", true),
            ("l*p*2", "lp2", true),
            ("l*p*2", "l2p", false),
            ("a*a", "a", false),
            ("*a*a*", "ba", false),
            ("**ü**", "lüster", true),
        ] {
            assert_eq!(matches(pattern, name), expected, "{pattern} {name}");
        }
    }
}
