//! Differences between two records of how something was made, for error messages.

use bdpm_base::error::{Error, Result};
use std::fmt::Display;

/// Facts in which a record differs from another one, each with both values.
#[derive(Debug, Default)]
pub struct Differences(Vec<String>);

impl Differences {
    /// Compares scenes by their fingerprints; their names are only shown.
    pub fn compare_scenes<T: PartialEq>(
        &mut self,
        (this, this_fingerprint): (&str, T),
        (that, that_fingerprint): (&str, T),
    ) {
        if this_fingerprint == that_fingerprint {
            return;
        }
        self.0.push(if this == that {
            format!("scene `{this}` has changed")
        } else {
            format!("scene is `{this}`, not `{that}`")
        });
    }

    /// Compares the values of a fact.
    pub fn compare<T: PartialEq + Display>(&mut self, name: &str, this: T, that: T) {
        if this != that {
            self.0.push(format!("{name} is {this}, not {that}"));
        }
    }

    /// Refuses a record with differences. `whose` stands before each: `its` or `their`.
    ///
    /// # Errors
    /// Names every difference after `problem`.
    pub fn check(self, problem: &str, whose: &str, advice: &str) -> Result<()> {
        if self.0.is_empty() {
            return Ok(());
        }
        let differences = self.0.join(&format!("; {whose} "));
        Err(Error::new(format!("{problem}: {whose} {differences}"), advice))
    }
}
