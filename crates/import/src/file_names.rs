//! Finds files by names that programs of other systems wrote.

use std::ffi::OsStr;
use std::path::{Path, PathBuf};

/// Finds the file of a name that [`decoded`](super::text::decoded) returns. The name may
///
/// - have the separators of another system, or quotes around it,
/// - come from bytes that are not UTF-8,
/// - differ in case, as on Windows,
/// - begin at the root of another computer. Then the end of its path counts.
pub fn find(folder: &Path, name: &str) -> Option<PathBuf> {
    find_exact(folder, name).or_else(|| by_parts(folder, &in_slashes(name)))
}

/// Finds the file of a name as [`find`] does, but only in `folder` and in folders in it.
pub fn find_inside(folder: &Path, name: &str) -> Option<PathBuf> {
    let slashed = in_slashes(name);
    if leaves(name) {
        return None;
    }
    let exact = if slashed.starts_with('/') { None } else { find_exact(folder, name) };
    exact.or_else(|| by_parts(folder, &slashed))
}

/// Returns true if a name leads out of the folder that it is relative to. A name that begins at a
/// root leads out if it has any `..`, since [`find_inside`] takes only the end of its path.
pub fn leaves(name: &str) -> bool {
    let name = in_slashes(name);
    if name.starts_with('/') || name.as_bytes().get(1) == Some(&b':') {
        return name.split('/').any(|part| part == "..");
    }
    let mut depth = 0i64;
    name.split('/').any(|part| {
        depth += match part {
            "" | "." => 0,
            ".." => -1,
            _ => 1,
        };
        depth < 0
    })
}

/// The name without quotes around it, with `/` as the separator.
fn in_slashes(name: &str) -> String {
    name.trim().trim_matches(['"', '\'']).replace('\\', "/")
}

/// Finds the file of a name as [`find`] does, but only one of exactly this name.
pub fn find_exact(folder: &Path, name: &str) -> Option<PathBuf> {
    let unquoted = name.trim().trim_matches(['"', '\'']);
    let names = [name.to_owned(), unquoted.to_owned(), in_slashes(name)];
    let as_text = names.iter().map(PathBuf::from);
    let as_bytes = names.iter().filter_map(|name| latin1_path(name));
    as_text.chain(as_bytes).map(|name| folder.join(name)).find(|path| path.exists())
}

/// Whether `found`, the result of [`find`], has a path that the user may not expect for this name.
pub fn is_guess(folder: &Path, name: &str, found: &Path) -> bool {
    found != folder.join(in_slashes(name))
        && latin1_path(name).is_none_or(|own| found != folder.join(own))
}

/// Finds a path with `/` as the separator, in any case. Of an absolute path, as many parts at its
/// end as possible have to match.
fn by_parts(folder: &Path, name: &str) -> Option<PathBuf> {
    let mut parts: Vec<&str> = name.split('/').filter(|part| !matches!(*part, "" | ".")).collect();
    let is_drive = parts.first().is_some_and(|first| first.len() == 2 && first.ends_with(':'));
    let is_absolute = is_drive || name.starts_with('/');
    if is_drive {
        parts.remove(0);
    }
    let starts = if is_absolute { parts.len() } else { usize::from(!parts.is_empty()) };
    (0..starts).find_map(|start| {
        let step = |path: PathBuf, part: &&str| in_any_case(&path, part);
        parts[start..].iter().try_fold(folder.to_owned(), step)
    })
}

/// The file of this name in a folder: the exact name, else the first one by order that differs in
/// case.
fn in_any_case(folder: &Path, name: &str) -> Option<PathBuf> {
    let exact = folder.join(name);
    if exact.exists() {
        return Some(exact);
    }
    let folder = if folder == Path::new("") { Path::new(".") } else { folder };
    let lower = name.to_lowercase();
    let is_same = |own: &OsStr| own.to_str().is_some_and(|own| own.to_lowercase() == lower);
    let names = std::fs::read_dir(folder).ok()?.filter_map(|entry| Some(entry.ok()?.file_name()));
    names.filter(|own| is_same(own)).min().map(|own| folder.join(own))
}

/// The name as bytes of Latin-1, if they differ from its UTF-8.
#[cfg(unix)]
fn latin1_path(name: &str) -> Option<PathBuf> {
    use std::os::unix::ffi::OsStringExt;
    let bytes: Option<Vec<u8>> = name.chars().map(|c| u8::try_from(u32::from(c)).ok()).collect();
    let bytes = bytes.filter(|bytes| !bytes.is_ascii())?;
    Some(std::ffi::OsString::from_vec(bytes).into())
}

#[cfg(not(unix))]
fn latin1_path(_: &str) -> Option<PathBuf> {
    None
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fs;

    #[test]
    fn names_of_other_systems_are_found() {
        let folder = tempfile::tempdir().unwrap();
        let root = folder.path();
        fs::create_dir(root.join("tex")).unwrap();
        for name in ["wood.png", "tex/wood.png", "wood tile.jpg", "A.png", "a.png"] {
            fs::write(root.join(name), name).unwrap();
        }
        for (name, expected, guess) in [
            ("wood.png", "wood.png", false),
            ("Wood.PNG", "wood.png", true),
            ("\"wood tile.jpg\"", "wood tile.jpg", false),
            ("'wood.png'", "wood.png", false),
            ("tex\\wood.png", "tex/wood.png", false),
            (".\\TEX\\Wood.png", "tex/wood.png", true),
            ("C:\\tex\\wood.png", "tex/wood.png", true),
            ("d:/models/a/wood tile.jpg", "wood tile.jpg", true),
            ("/home/somebody/wood.png", "wood.png", true),
            ("\\\\server\\share\\A.PNG", "A.png", true),
        ] {
            let found = find(root, name).unwrap_or_else(|| panic!("{name}"));
            assert_eq!(fs::read_to_string(&found).unwrap(), expected, "{name}");
            assert_eq!(is_guess(root, name, &found), guess, "{name}");
        }
        // The end of a relative path is another file.
        for name in ["other/wood.png", "gone.png", "", "C:", "/"] {
            assert!(find(root, name).is_none_or(|found| found.is_dir()), "{name}");
        }
    }

    #[test]
    fn names_inside_do_not_leave_the_folder() {
        let root = tempfile::tempdir().unwrap();
        let folder = root.path().join("scene");
        fs::create_dir_all(folder.join("tex")).unwrap();
        for name in ["secret", "scene/tex/wood.png"] {
            fs::write(root.path().join(name), "").unwrap();
        }
        let absolute = root.path().join("secret");
        let absolute = absolute.to_str().unwrap();
        for name in ["tex/wood.png", "tex/../tex/wood.png", "C:\\tex\\wood.png", "/x/tex/wood.png"]
        {
            assert!(!leaves(name) && find_inside(&folder, name).is_some(), "{name}");
        }
        for name in ["../secret", "tex/../../secret", "..\\secret", "'../secret'", "/x/../secret"] {
            assert!(leaves(name) && find_inside(&folder, name).is_none(), "{name}");
            assert!(find(&folder, name).is_some() || name.starts_with('/'), "{name}");
        }
        assert_eq!(find_inside(&folder, absolute), None);
        assert_eq!(find_inside(&folder, &format!("\"{absolute}\"")), None);
        assert!(find(&folder, absolute).is_some());
    }
}
