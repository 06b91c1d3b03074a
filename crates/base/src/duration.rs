//! Times as users write them.

use crate::error::{Error, Result};
use std::time::Duration;

const ADVICE: &str = "give a time above 0: seconds such as 30, or with units such as 2m or 1h 30m";

/// Reads a time above 0: a plain number of seconds such as `5` or `0.5`, or numbers with units such
/// as `30s`, `2m` or `1h 30m`.
///
/// # Errors
/// If the text is no such time.
pub fn positive_time(text: &str) -> Result<Duration> {
    let time = match text.trim().parse::<f64>() {
        Ok(seconds) if seconds < 0.0 => {
            return Err(Error::new(format!("`{text}` is a negative time"), ADVICE));
        }
        Ok(seconds) => {
            let time = Duration::try_from_secs_f64(seconds);
            time.map_err(|_| Error::new(format!("`{text}` is too long or no number"), ADVICE))?
        }
        Err(_) => humantime::parse_duration(text)
            .map_err(|error| Error::new(format!("`{text}` is no time: {error}"), ADVICE))?,
    };
    if time.is_zero() {
        return Err(Error::new("nothing can be done in a time of 0", ADVICE));
    }
    Ok(time)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn plain_numbers_are_seconds() {
        let time = |text| positive_time(text).unwrap();
        for five in ["5", " 5 ", "5.0", "5e0", "5s", "5000ms"] {
            assert_eq!(time(five), Duration::from_secs(5), "{five}");
        }
        assert_eq!(time(".25"), Duration::from_millis(250));
        assert_eq!(time("1m 5s"), Duration::from_secs(65));
        assert_eq!(time("1.5h"), Duration::from_secs(5400));
    }

    #[test]
    fn other_texts_are_refused_with_advice() {
        for zero in ["0", "0.0", "-0", "1e-12", "0s", "0ms", "0h 0m"] {
            let shown = positive_time(zero).unwrap_err().to_string();
            assert!(shown.contains("time of 0\nhelp: give a time above 0"), "{zero}: {shown}");
        }
        let bad = ["", " ", "soon", "5 lightyears", "-5", "-5s", "nan", "inf", "1e300", "5,5"];
        for bad in bad {
            let shown = positive_time(bad).unwrap_err().to_string();
            assert!(shown.contains(&format!("`{bad}` is ")), "{bad}: {shown}");
            assert!(shown.contains("help: give a time above 0: seconds such as 30"), "{shown}");
        }
    }
}
