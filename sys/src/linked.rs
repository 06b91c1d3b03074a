//! The library was linked with the program, and the system has loaded it.

use std::convert::Infallible;

/// The library cannot fail to load.
pub type LoadError = Infallible;

/// Does nothing: the library is loaded.
///
/// # Errors
/// Never.
pub fn load() -> Result<(), LoadError> {
    Ok(())
}
