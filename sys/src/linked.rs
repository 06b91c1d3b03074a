//! The library was linked with the program, and the system has loaded it.

use std::convert::Infallible;
use std::path::Path;

/// The library cannot fail to load.
pub type LoadError = Infallible;

/// Does nothing: the library is loaded.
///
/// # Errors
/// Never.
pub fn load() -> Result<(), LoadError> {
    Ok(())
}

/// Does nothing: the library is loaded.
///
/// # Errors
/// Never.
pub fn load_checked(_: impl FnOnce(&Path) -> Result<(), String>) -> Result<(), LoadError> {
    Ok(())
}
