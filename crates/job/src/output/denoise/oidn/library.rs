//! The functions of the library, loaded at run time, so that renders without denoising do not need
//! it.
//!
//! The few declarations are written by hand from the reference of Open Image Denoise 2, since the
//! package of the library has no header.

use bdpm_core::accel::shared_library;
use bdpm_core::base::error::{Error, Result};
use libloading::Library;
use std::env;
use std::ffi::{c_char, c_int, c_void};
use std::path::{Path, PathBuf};

/// Handle of a device or a filter.
pub type Handle = *mut c_void;

/// A function that the library calls while a filter runs, with the pointer that was given with it
/// and the share that is done. If it returns false, the library cancels the filter.
pub type ProgressMonitor = unsafe extern "C" fn(*mut c_void, f64) -> bool;

/// Declares functions, and looks them up in a library by their names.
macro_rules! functions {
    ($($(#[$what:meta])* $field:ident = $name:literal: fn($($argument:ty),*) $(-> $result:ty)?;)*) => {
        /// Functions of the library, which stays loaded for the lifetime of this value.
        #[derive(Debug)]
        pub struct Functions {
            $($(#[$what])* pub $field: unsafe extern "C" fn($($argument),*) $(-> $result)?,)*
            _library: Library,
        }

        impl Functions {
            fn of(library: Library) -> std::result::Result<Self, libloading::Error> {
                Ok(Self {
                    $($field: {
                        // SAFETY: the type is that of this function of Open Image Denoise 2, whose
                        // binary interface does not change within a major version; the name of the
                        // library holds that version. The pointer is not used after the library,
                        // which is kept beside it.
                        *unsafe { library.get::<unsafe extern "C" fn($($argument),*) $(-> $result)?>($name) }?
                    },)*
                    _library: library,
                })
            }
        }
    };
}

functions! {
    new_device = b"oidnNewDevice\0": fn(c_int) -> Handle;
    set_device_int = b"oidnSetDeviceInt\0": fn(Handle, *const c_char, c_int);
    set_device_bool = b"oidnSetDeviceBool\0": fn(Handle, *const c_char, bool);
    get_device_int = b"oidnGetDeviceInt\0": fn(Handle, *const c_char) -> c_int;
    commit_device = b"oidnCommitDevice\0": fn(Handle);
    release_device = b"oidnReleaseDevice\0": fn(Handle);
    /// Takes the first error of the calling thread; the text lives until the next call.
    get_device_error = b"oidnGetDeviceError\0": fn(Handle, *mut *const c_char) -> c_int;
    new_filter = b"oidnNewFilter\0": fn(Handle, *const c_char) -> Handle;
    /// Data, format, width, height, and offset and strides in bytes, where 0 means packed.
    set_shared_filter_image = b"oidnSetSharedFilterImage\0":
        fn(Handle, *const c_char, *mut c_void, c_int, usize, usize, usize, usize, usize);
    set_filter_bool = b"oidnSetFilterBool\0": fn(Handle, *const c_char, bool);
    set_filter_int = b"oidnSetFilterInt\0": fn(Handle, *const c_char, c_int);
    set_filter_progress_monitor = b"oidnSetFilterProgressMonitorFunction\0":
        fn(Handle, ProgressMonitor, *mut c_void);
    commit_filter = b"oidnCommitFilter\0": fn(Handle);
    execute_filter = b"oidnExecuteFilter\0": fn(Handle);
    release_filter = b"oidnReleaseFilter\0": fn(Handle);
}

/// Name of the library of version 2.
const NAME: &str = if cfg!(windows) {
    "OpenImageDenoise.dll"
} else if cfg!(target_os = "macos") {
    "libOpenImageDenoise.2.dylib"
} else {
    "libOpenImageDenoise.so.2"
};

/// Folder in which `make denoiser` installs the library, in the checkout.
const PREFIX: &str = ".oidn";

/// The checkout that this was built in, for programs that `cargo install` copies elsewhere.
const CHECKOUT: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../..");

/// Loads the library from `OIDN_DIR` if it is set, else from the folder of the executable, from
/// `.oidn` in the checkout that this was built in, or from the folders of the system. No other
/// folder is searched: a library runs code, and folders above a program may hold files of anybody.
///
/// # Errors
/// If the library is not installed, incomplete, or cannot be loaded, with advice.
pub fn load() -> Result<Functions> {
    let prefix = env::var_os("OIDN_DIR").filter(|prefix| !prefix.is_empty());
    let found = find(
        prefix.as_deref().map(Path::new),
        env::current_exe().ok().as_deref(),
        &Path::new(CHECKOUT).join(PREFIX),
    )?;
    load_from(found.as_deref())
}

/// The file of the library: in the prefix of `OIDN_DIR`, beside `program`, or in the prefix of the
/// checkout. `None` if the system has to find it.
fn find(prefix: Option<&Path>, program: Option<&Path>, checkout: &Path) -> Result<Option<PathBuf>> {
    let inside = |prefix: &Path| {
        let folders = ["lib", "lib64", "bin", ""].map(|folder| prefix.join(folder));
        folders.into_iter().map(|folder| folder.join(NAME)).find(|file| file.exists())
    };
    if let Some(prefix) = prefix {
        return inside(prefix).map(Some).ok_or_else(|| {
            Error::new(
                format!("OIDN_DIR is {}, but it does not contain {NAME}", prefix.display()),
                "set it to the folder whose lib folder has the library, or unset it",
            )
        });
    }
    let program = program.map(|program| program.canonicalize().unwrap_or(program.into()));
    let beside = program.as_deref().and_then(Path::parent).map(|folder| folder.join(NAME));
    Ok(beside.filter(|file| file.exists()).or_else(|| inside(checkout)))
}

fn load_from(file: Option<&Path>) -> Result<Functions> {
    let help = "run `make denoiser`, or set OIDN_DIR to the folder whose lib folder has Open Image Denoise 2";
    if let Some(file) = file {
        shared_library::check(file, &["libOpenImageDenoise", "libtbb"]).map_err(|problem| {
            Error::new(format!("Open Image Denoise cannot be loaded: {problem}"), help).at(file)
        })?;
    }
    // SAFETY: loading runs the library's initializers, which do nothing but set it up, and so do
    // its finalizers.
    let library = unsafe { Library::new(file.unwrap_or(Path::new(NAME))) };
    library.and_then(Functions::of).map_err(|e| match file {
        None => Error::new(format!("Open Image Denoise is not installed: no {NAME}"), help),
        Some(file) => {
            Error::new(format!("Open Image Denoise cannot be loaded: {e}"), help).at(file)
        }
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fs;

    #[test]
    fn missing_library_is_an_error_with_advice() {
        let folder = tempfile::tempdir().unwrap();
        let folder = folder.path();
        let shown = find(Some(folder), None, folder).unwrap_err().to_string();
        assert!(shown.contains("OIDN_DIR is ") && shown.contains("\nhelp: "), "{shown}");
        // A file that is no library, and the start of one whose header states more
        let mut start = vec![0; 64];
        start[..6].copy_from_slice(b"\x7fELF\x02\x01");
        start[32] = 64;
        start[54] = 56;
        start[56] = 1;
        for (bytes, problem) in
            [(&b"no library"[..], "cannot be loaded"), (&start, "is incomplete")]
        {
            fs::write(folder.join(NAME), bytes).unwrap();
            for found in [find(Some(folder), None, folder), find(None, None, folder)] {
                let shown = load_from(found.unwrap().as_deref()).unwrap_err().to_string();
                let has_advice = shown.contains("make denoiser");
                assert!(shown.contains(problem) && has_advice, "{shown}");
            }
        }
    }

    #[test]
    fn folders_above_the_program_are_not_searched() {
        let root = tempfile::tempdir().unwrap();
        let root = root.path().canonicalize().unwrap();
        let at = |name: &str| root.join(name);
        let checkout = at("checkout");
        for folder in [".oidn/lib", "a/.oidn/lib", "a/bin/.oidn/lib", "a/lib", "a"] {
            fs::create_dir_all(at(folder)).unwrap();
            fs::write(at(folder).join(NAME), "").unwrap();
        }
        let program = at("a/bin/bdpm");
        assert_eq!(find(None, Some(&program), &checkout).unwrap(), None);
        let beside = at("a/bin").join(NAME);
        fs::write(&beside, "").unwrap();
        assert_eq!(find(None, Some(&program), &checkout).unwrap(), Some(beside));
    }
}
