//! Commands that make surfaces: boxes and prisms.

use super::tokens::Primitive;
use bdpm_core::base::error::{Error, Result};

/// Surfaces, and notes about options that have no effect, with the names.
pub type Generated = (Vec<Primitive>, Vec<(&'static str, String)>);

/// Corners of a prism, at most.
const MAX_CORNERS: usize = 100_000;

/// What the notes of both say.
const SHARP: &str = "sharp edges instead of round ones or bevels of";

/// `genbox modifier name x y z [-i] [-r radius] [-b bevel]`.
pub fn genbox(words: std::vec::IntoIter<String>) -> Result<Generated> {
    let words: Vec<String> = words.collect();
    let usage = || {
        let advice = "give genbox MODIFIER NAME XSIZE YSIZE ZSIZE";
        Error::new("`genbox` is incomplete", advice)
    };
    let [modifier, name] = [words.first(), words.get(1)].map(|own| own.cloned());
    let (Some(modifier), Some(name)) = (modifier, name) else { return Err(usage()) };
    let mut size = [0.0; 3];
    for (axis, size) in size.iter_mut().enumerate() {
        let given = words.get(axis + 2).and_then(|word| word.parse().ok());
        *size = given.filter(|size: &f64| size.is_finite() && *size > 0.0).ok_or_else(usage)?;
    }
    let options = &words[5..];
    let is_inside = options.iter().any(|word| word == "-i");
    let is_round = options.iter().any(|word| word == "-r" || word == "-b");
    let notes = is_round.then(|| (SHARP, name.clone()));
    let [x, y, z] = size;
    let corner = |index: usize| {
        let bit = |axis: usize, size: f64| if index >> axis & 1 == 1 { size } else { 0.0 };
        [bit(0, x), bit(1, y), bit(2, z)]
    };
    // Counterclockwise as seen from outside.
    let sides =
        [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
    let side = |mut corners: [usize; 4]| {
        if is_inside {
            corners.reverse();
        }
        Primitive {
            modifier: modifier.clone(),
            kind: "polygon".into(),
            name: name.clone(),
            numbers: corners.into_iter().flat_map(corner).collect(),
            ..Primitive::default()
        }
    };
    Ok((sides.map(side).into(), notes.into_iter().collect()))
}

/// `genprism modifier name count x1 y1 x2 y2 ... [-l x y z] [-r radius] [-c] [-e]`.
pub fn genprism(words: std::vec::IntoIter<String>) -> Result<Generated> {
    let words: Vec<String> = words.collect();
    let usage = || {
        let advice =
            "give genprism MODIFIER NAME COUNT X1 Y1 X2 Y2 ... [-l X Y Z] [-c] [-e], or run it";
        Error::new("`genprism` is incomplete, or reads its corners from elsewhere", advice)
    };
    let number = |index: usize| {
        let given = words.get(index).and_then(|word| word.parse().ok());
        given.filter(|number: &f64| number.is_finite()).ok_or_else(usage)
    };
    let [modifier, name] = [words.first(), words.get(1)].map(|own| own.cloned());
    let (Some(modifier), Some(name)) = (modifier, name) else { return Err(usage()) };
    let count = words.get(2).and_then(|word| word.parse().ok());
    let count = count.filter(|count| (3..=MAX_CORNERS).contains(count)).ok_or_else(usage)?;
    let mut corners = Vec::new();
    for corner in 0..count {
        corners.push([number(3 + 2 * corner)?, number(4 + 2 * corner)?]);
    }
    let (mut length, mut has_ends, mut is_closed) = ([0.0, 0.0, 1.0], true, true);
    let mut notes = Vec::new();
    let mut at = 3 + 2 * count;
    while let Some(word) = words.get(at) {
        match &word[..] {
            "-l" => {
                length = [number(at + 1)?, number(at + 2)?, number(at + 3)?];
                at += 3;
            }
            "-r" => {
                number(at + 1)?;
                notes.push((SHARP, name.clone()));
                at += 1;
            }
            "-e" => has_ends = !has_ends,
            "-c" => is_closed = !is_closed,
            _ => return Err(usage()),
        }
        at += 1;
    }
    if length[2] == 0.0 {
        let advice = "give a vector with a third number that is not 0";
        return Err(Error::new("the length of `genprism` is in the plane of its corners", advice));
    }
    let polygon = |points: Vec<[f64; 3]>| Primitive {
        modifier: modifier.clone(),
        kind: "polygon".into(),
        name: name.clone(),
        numbers: points.into_flattened(),
        ..Primitive::default()
    };
    let faces = prism(&corners, length, has_ends, is_closed);
    Ok((faces.into_iter().map(polygon).collect(), notes))
}

/// The faces of a prism from these corners along a vector, with its ends and its last side.
fn prism(
    corners: &[[f64; 2]],
    length: [f64; 3],
    has_ends: bool,
    is_closed: bool,
) -> Vec<Vec<[f64; 3]>> {
    let count = corners.len();
    let bottom = |corner: usize| [corners[corner][0], corners[corner][1], 0.0];
    let top = |corner: usize| [0, 1, 2].map(|axis| bottom(corner)[axis] + length[axis]);
    let mut all = Vec::new();
    if has_ends {
        all.push((0..count).map(bottom).collect());
        all.push((0..count).rev().map(top).collect());
    }
    for corner in 0..if is_closed { count } else { count - 1 } {
        let next = (corner + 1) % count;
        all.push(vec![bottom(corner), top(corner), top(next), bottom(next)]);
    }
    all
}

#[cfg(test)]
mod tests {
    use super::*;

    fn words(text: &str) -> std::vec::IntoIter<String> {
        text.split_whitespace().map(str::to_owned).collect::<Vec<_>>().into_iter()
    }

    /// Corners that are clockwise as seen from above face outside, as in Radiance.
    #[test]
    fn prisms_have_ends_and_sides() {
        let (all, notes) = genprism(words("m p 4 0 0 0 1 1 1 1 0 -l 0 0 2")).unwrap();
        assert!(all.len() == 6 && notes.is_empty());
        let third = |own: &Primitive| own.numbers.iter().skip(2).step_by(3).sum::<f64>();
        assert_eq!([third(&all[0]), third(&all[1]), third(&all[2])], [0.0, 8.0, 4.0]);
        assert_eq!(all[2].numbers, [0.0, 0.0, 0.0, 0.0, 0.0, 2.0, 0.0, 1.0, 2.0, 0.0, 1.0, 0.0]);
        let (all, notes) = genprism(words("m p 3 0 0 1 0 0 1 -e -c -r .1")).unwrap();
        assert_eq!((all.len(), notes.len()), (2, 1));
        for bad in
            ["m p", "m p 2 0 0 1 1", "m p file", "m p 3 0 0 1 0 0 1 -l 1 0 0", "m p 3 0 0 1 0"]
        {
            assert!(genprism(words(bad)).is_err(), "{bad}");
        }
    }
}
