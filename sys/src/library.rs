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

/// Folder of an Embree in a checkout, which `make setup` installs.
const CHECKOUT_PREFIX: &str = ".embree";

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

/// Loads the library, if that was not done before: from `EMBREE_DIR`, if that is set; beside the
/// executable or one of its folders, with `.embree` and `lib` below them; where the system finds
/// it; or where it was when this crate was built.
///
/// # Errors
/// If there is none, or it lacks functions of the header.
pub fn load() -> Result<(), LoadError> {
    FUNCTIONS.get_or_init(find_and_load).as_ref().map(|_| ()).map_err(Clone::clone)
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
    match FUNCTIONS.get_or_init(find_and_load) {
        Ok(functions) => functions,
        Err(error) => panic!("Embree 4 cannot be loaded: {error}"),
    }
}

fn find_and_load() -> Result<Functions, LoadError> {
    let file = candidates().into_iter().find(|file| file.exists());
    // A link's own folder may lack the libraries that this one needs.
    match file.map(|file| file.canonicalize().unwrap_or(file)) {
        Some(file) => load_from(&file).map_err(|problem| LoadError { problem, file: Some(file) }),
        None => {
            let of_system = NAMES.iter().map(PathBuf::from);
            let built_with =
                NAMES.iter().filter_map(|name| Some(Path::new(BUILT_WITH?).join(name)));
            let mut all = of_system.chain(built_with).map(|file| load_from(&file));
            let first = all.next().expect("there is a name");
            first.or_else(|problem| {
                all.find_map(Result::ok).ok_or(LoadError { problem, file: None })
            })
        }
    }
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

/// Files that may be the library, in the order of preference.
fn candidates() -> Vec<PathBuf> {
    let inside = |folder: &Path| NAMES.iter().map(|name| folder.join(name)).collect::<Vec<_>>();
    let in_prefix = |prefix: &Path| {
        let arch = format!("lib/{}-linux-gnu", env::consts::ARCH);
        let folders = [arch.as_str(), "lib64", "lib", "bin"].map(|folder| prefix.join(folder));
        folders.iter().flat_map(|folder| inside(folder)).collect::<Vec<_>>()
    };
    if let Some(prefix) = env::var_os("EMBREE_DIR").filter(|prefix| !prefix.is_empty()) {
        return in_prefix(Path::new(&prefix));
    }
    let Ok(program) = env::current_exe() else { return Vec::new() };
    let program = program.canonicalize().unwrap_or(program);
    let folders = program.ancestors().skip(1);
    let around = |folder: &Path| {
        let mut all = inside(folder);
        all.extend(in_prefix(&folder.join(CHECKOUT_PREFIX)));
        all
    };
    let installed = program.parent().and_then(Path::parent).map(in_prefix);
    folders.flat_map(around).chain(installed.into_iter().flatten()).collect()
}
