//! Output of the program, for the tests of its subcommands.

use serde_json::Value;
use std::process::Output;

pub fn text(bytes: &[u8]) -> &str {
    std::str::from_utf8(bytes).unwrap()
}

#[track_caller]
pub fn succeed(output: &Output) -> &str {
    assert!(output.status.success(), "{}", text(&output.stderr));
    text(&output.stdout)
}

#[track_caller]
pub fn json(output: &Output) -> Value {
    serde_json::from_str(succeed(output)).unwrap()
}

/// Asserts exit code 1 with `problem` and then `advice` on stderr.
#[track_caller]
pub fn assert_refused(output: &Output, problem: &str, advice: &str) {
    let shown = text(&output.stderr);
    assert_eq!(output.status.code(), Some(1), "{shown}");
    assert!(output.stdout.is_empty());
    let (found, help) = shown.split_once("\nhelp: ").unwrap_or_else(|| panic!("{shown}"));
    assert!(found.contains(problem) && help.contains(advice), "{shown}");
}
