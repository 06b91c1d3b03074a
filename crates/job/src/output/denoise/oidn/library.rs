//! The functions of the library, loaded at run time, so that renders without denoising do not need
//! it.
//!
//! The few declarations are written by hand from the reference of Open Image Denoise 2, since the
//! package of the library has no header.

use bdpm_core::base::error::{Error, Result};
use libloading::Library;
use std::env;
use std::ffi::{OsString, c_char, c_int, c_void};
use std::path::{Path, PathBuf};

/// Handle of a device or a filter.
pub type Handle = *mut c_void;

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

/// Loads the library from `OIDN_DIR` if it is set, else from `.oidn` in a folder that contains the
/// executable, in the checkout, or from the folders of the system.
///
/// # Errors
/// If the library is not installed or cannot be loaded, with advice.
pub fn load() -> Result<Functions> {
    let program = env::current_exe().unwrap_or_default();
    let around = program.ancestors().skip(1).chain([Path::new(CHECKOUT)]);
    let prefixes: Vec<PathBuf> = around.map(|folder| folder.join(PREFIX)).collect();
    load_from(env::var_os("OIDN_DIR"), &prefixes)
}

fn load_from(folder: Option<OsString>, prefixes: &[PathBuf]) -> Result<Functions> {
    let inside = |folder: &Path| -> Vec<PathBuf> {
        ["lib", "lib64", "bin", ""].map(|sub| folder.join(sub).join(NAME)).into()
    };
    let first = |places: Vec<PathBuf>| places.into_iter().find(|place| place.exists());
    let place = match &folder {
        Some(folder) => first(inside(Path::new(folder))).ok_or_else(|| {
            Error::new(
                format!(
                    "OIDN_DIR is {}, but it does not contain {NAME}",
                    Path::new(folder).display()
                ),
                "set it to the folder whose lib folder has the library, or unset it",
            )
        })?,
        None => {
            let places = prefixes.iter().flat_map(|prefix| inside(prefix)).collect();
            first(places).unwrap_or_else(|| NAME.into())
        }
    };
    // SAFETY: loading runs the library's initializers, which do nothing but set it up, and so do
    // its finalizers.
    let library = unsafe { Library::new(&place) };
    library.and_then(Functions::of).map_err(|e| {
        let help = "run `make denoiser`, or set OIDN_DIR to the folder whose lib folder has Open Image Denoise 2";
        if place == Path::new(NAME) {
            return Error::new(format!("Open Image Denoise is not installed: no {NAME}"), help);
        }
        Error::new(format!("Open Image Denoise cannot be loaded: {e}"), help).at(place)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn missing_library_is_an_error_with_advice() {
        let folder = tempfile::tempdir().unwrap();
        let shown =
            load_from(Some(folder.path().into()), &[folder.path().into()]).unwrap_err().to_string();
        assert!(shown.contains("OIDN_DIR is ") && shown.contains("\nhelp: "), "{shown}");
        std::fs::write(folder.path().join(NAME), "no library").unwrap();
        for own in [Some(folder.path().into()), None] {
            let shown = load_from(own, &[folder.path().into()]).unwrap_err().to_string();
            assert!(
                shown.contains("cannot be loaded") && shown.contains("make denoiser"),
                "{shown}"
            );
        }
    }
}
