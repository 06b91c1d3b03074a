//! Bisection of positive numbers.

/// Two numbers from `low` to `high`, closer than the relative `width`, between which `holds`
/// changes from false to true; the same bound twice where it never changes.
pub fn bisect([low, high]: [f64; 2], width: f64, holds: impl Fn(f64) -> bool) -> [f64; 2] {
    if holds(low) {
        return [low, low];
    }
    if !holds(high) {
        return [high, high];
    }
    let (mut no, mut yes) = (low, high);
    while yes > no * (1.0 + width) {
        let middle = no * (yes / no).sqrt();
        *(if holds(middle) { &mut yes } else { &mut no }) = middle;
    }
    [no, yes]
}
