//! Finds and loads Embree's library when it is first used, so that programs start wherever they and
//! it are.

use crate::Functions;
use libloading::Library;
use std::env;
use std::fmt;
use std::path::{Path, PathBuf};
use std::sync::OnceLock;

/// Names of the library of version 4. The second is that of installations for developers, where the
/// first may be another: packages that carry the library rename it.
const NAMES: &[&str] = if cfg!(windows) {
    &["embree4.dll"]
} else if cfg!(target_os = "macos") {
    &["libembree4.4.dylib", "libembree4.dylib"]
} else {
    &["libembree4.so.4", "libembree4.so"]
};

/// Folder of the library that this crate was built with, absolute.
const BUILT_WITH: Option<&str> = option_env!("EMBREE4_SYS_LIB");

/// Embree's library cannot be loaded.
#[derive(Clone, Debug)]
pub struct LoadError {
    /// What the system reports.
    problem: String,
    /// The file that was found but not loaded, if there is one.
    file: Option<PathBuf>,
}

impl fmt::Display for LoadError {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        if let Some(file) = &self.file {
            write!(f, "{}: ", file.display())?;
        }
        f.write_str(&self.problem)
    }
}

impl std::error::Error for LoadError {}

static FUNCTIONS: OnceLock<Result<Functions, LoadError>> = OnceLock::new();

/// Loads the library, if that was not done before: from `EMBREE_DIR`, if that is set, else from the
/// folder of the executable, from where it was when this crate was built, or from the folders of
/// the system. No other folder is searched: a library runs code, and folders above a program may
/// hold files of anybody.
///
/// # Errors
/// If there is none, or it lacks functions of the header.
pub fn load() -> Result<(), LoadError> {
    load_checked(|_| Ok(()))
}

/// Loads the library as [`load`] does, if `check` accepts its file. A library in the folders of the
/// system is not checked.
///
/// # Errors
/// As [`load`], or the problem that `check` reports.
pub fn load_checked(check: impl FnOnce(&Path) -> Result<(), String>) -> Result<(), LoadError> {
    FUNCTIONS.get_or_init(|| find_and_load(check)).as_ref().map(|_| ()).map_err(Clone::clone)
}

/// The functions of the library.
///
/// # Panics
/// If it cannot be loaded: see [`load`].
#[inline]
pub(crate) fn functions() -> &'static Functions {
    match FUNCTIONS.get() {
        Some(Ok(functions)) => functions,
        _ => load_or_panic(),
    }
}

#[cold]
fn load_or_panic() -> &'static Functions {
    match FUNCTIONS.get_or_init(|| find_and_load(|_| Ok(()))) {
        Ok(functions) => functions,
        Err(error) => panic!("Embree 4 cannot be loaded: {error}"),
    }
}

fn find_and_load(check: impl FnOnce(&Path) -> Result<(), String>) -> Result<Functions, LoadError> {
    let prefix = env::var_os("EMBREE_DIR").filter(|prefix| !prefix.is_empty());
    match find(prefix.as_deref().map(Path::new), env::current_exe().ok().as_deref())? {
        Some(file) => check(&file)
            .and_then(|()| load_from(&file))
            .map_err(|problem| LoadError { problem, file: Some(file) }),
        None => {
            let mut all = NAMES.iter().map(|name| load_from(Path::new(name)));
            let first = all.next().expect("there is a name");
            first.or_else(|problem| {
                all.find_map(Result::ok).ok_or(LoadError { problem, file: None })
            })
        }
    }
}

/// The file of the library: in the prefix of `EMBREE_DIR`, beside `program`, or where this crate
/// was built. `None` if the system has to find it.
fn find(prefix: Option<&Path>, program: Option<&Path>) -> Result<Option<PathBuf>, LoadError> {
    let inside =
        |folder: &Path| NAMES.iter().map(|name| folder.join(name)).find(|file| file.exists());
    let found = match prefix {
        Some(prefix) => {
            let arch = format!("lib/{}-linux-gnu", env::consts::ARCH);
            let folders = [arch.as_str(), "lib64", "lib", "bin"];
            let found = folders.iter().find_map(|folder| inside(&prefix.join(folder)));
            Some(found.ok_or_else(|| LoadError {
                problem: format!(
                    "EMBREE_DIR is {}, but its folder `lib` does not contain {}",
                    prefix.display(),
                    NAMES[0]
                ),
                file: None,
            })?)
        }
        None => {
            let program = program.map(|program| program.canonicalize().unwrap_or(program.into()));
            let beside = program.as_deref().and_then(Path::parent);
            beside.into_iter().chain(BUILT_WITH.map(Path::new)).find_map(inside)
        }
    };
    // A link's own folder may lack the libraries that this one needs.
    Ok(found.map(|file| file.canonicalize().unwrap_or(file)))
}

fn load_from(place: &Path) -> Result<Functions, String> {
    // SAFETY: loading runs the library's initializers, which set it up and do nothing else, and so
    // do its finalizers.
    let library = unsafe { Library::new(place) };
    // SAFETY: the types are those of the library's header. The version of the loaded library is for
    // the caller to check, as with a library that is linked.
    let functions = library.and_then(|library| unsafe { Functions::of(library) });
    functions.map_err(|error| error.to_string())
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fs;

    #[test]
    fn library_is_found_in_the_prefix_and_beside_the_program_only() {
        let root = env::temp_dir().join(format!("embree4-sys-{}", std::process::id()));
        let bin = root.join("a/bin");
        fs::create_dir_all(&bin).unwrap();
        let root = root.canonicalize().unwrap();
        let (bin, program) = (root.join("a/bin"), root.join("a/bin/program"));
        // Libraries in folders above the program, and in folders of these
        for folder in ["a", ".embree/lib", "a/.embree/lib", "a/lib", "a/bin/.embree/lib"] {
            fs::create_dir_all(root.join(folder)).unwrap();
            fs::write(root.join(folder).join(NAMES[0]), "no library").unwrap();
        }
        let found = find(None, Some(&program)).unwrap();
        assert!(found.is_none_or(|found| !found.starts_with(&root)));
        fs::write(bin.join(NAMES[0]), "no library").unwrap();
        assert_eq!(find(None, Some(&program)).unwrap(), Some(bin.join(NAMES[0])));
        let prefix = root.join("a");
        assert_eq!(find(Some(&prefix), None).unwrap(), Some(root.join("a/lib").join(NAMES[0])));
        // The system is not asked: the user's word is final.
        let problem = find(Some(&root), Some(&program)).unwrap_err().to_string();
        assert!(problem.starts_with("EMBREE_DIR is ") && problem.contains(NAMES[0]), "{problem}");
        fs::remove_dir_all(&root).unwrap();
    }
}
