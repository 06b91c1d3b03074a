//! Data files of Radiance: values at the nodes of a grid, linear between them.

use bdpm_core::base::error::{Error, Result};
use bdpm_core::base::input::{decoded, read_bytes};
use std::path::Path;

/// Largest accepted file, bytes.
const MAX_FILE: u64 = 64 << 20;

/// Values of a file, at most.
const MAX_VALUES: usize = 1 << 23;

/// A table of values.
#[derive(Clone, Debug, PartialEq)]
pub struct DataFile {
    /// Nodes of each dimension, ascending or descending, at least two.
    pub axes: Vec<Vec<f64>>,
    /// Values, the last dimension fastest.
    values: Vec<f64>,
}

impl DataFile {
    /// Reads a file with one or two dimensions.
    ///
    /// # Errors
    /// Names the file if it cannot be read, or is malformed.
    pub fn read(path: &Path) -> Result<Self> {
        let bytes = read_bytes(path, MAX_FILE + 1)?;
        if bytes.len() as u64 > MAX_FILE {
            let problem = format!("the data file is larger than {} MiB", MAX_FILE >> 20);
            return Err(Error::new(problem, "give fewer values").at(path));
        }
        let text = decoded(&bytes);
        Self::parse(&text).map_err(|(error, offset)| error.at(path).at_offset(&text, offset))
    }

    /// Errors have the offset of the word.
    fn parse(text: &str) -> std::result::Result<Self, (Error, usize)> {
        let mut words = Words { text, at: 0 };
        let dimensions = words.count("the number of dimensions")?;
        if !(1..=2).contains(&dimensions) {
            let problem = format!("the data have {dimensions} dimensions");
            return Err((Error::new(problem, "give data of 1 or 2 dimensions"), 0));
        }
        let (mut axes, mut size) = (Vec::new(), 1usize);
        for _ in 0..dimensions {
            let axis = words.axis()?;
            size = size.saturating_mul(axis.len());
            axes.push(axis);
        }
        if size > MAX_VALUES {
            let problem = format!("the data have {size} values");
            return Err((Error::new(problem, format!("give at most {MAX_VALUES}")), words.at));
        }
        let values: std::result::Result<_, _> =
            (0..size).map(|_| words.number("a value")).collect();
        Ok(Self { axes, values: values? })
    }

    /// The value at a point of so many coordinates as there are dimensions. Outside of the grid it
    /// goes on linearly for one interval, then falls in inverse proportion to the distance, as in
    /// Radiance.
    pub fn value(&self, at: &[f64]) -> f64 {
        value(&self.axes, &self.values, at)
    }
}

fn value(axes: &[Vec<f64>], values: &[f64], at: &[f64]) -> f64 {
    let (Some((axis, axes)), Some((at, rest))) = (axes.split_first(), at.split_first()) else {
        return values[0];
    };
    let is_rising = axis[0] < axis[1];
    let below = axis.partition_point(|node| (node <= at) == is_rising || node == at);
    let index = below.clamp(1, axis.len() - 1) - 1;
    let size = values.len() / axis.len();
    let node = |index: usize| value(axes, &values[index * size..(index + 1) * size], rest);
    let [low, high] = [node(index), node(index + 1)];
    let place = (at - axis[index]) / (axis[index + 1] - axis[index]);
    if place > 2.0 {
        return (2.0 * high - low) / (place + 1.0);
    }
    if place < -1.0 {
        return (2.0 * low - high) / -place;
    }
    low + place * (high - low)
}

/// The words of a file. Errors have their offset.
struct Words<'a> {
    text: &'a str,
    at: usize,
}

impl Words<'_> {
    fn number(&mut self, what: &str) -> std::result::Result<f64, (Error, usize)> {
        let rest = &self.text[self.at..];
        let mut start = rest.len() - rest.trim_start().len();
        // Comments go to the end of their line.
        while rest[start..].starts_with('#') {
            start += rest[start..].find('\n').unwrap_or(rest.len() - start);
            start += rest[start..].len() - rest[start..].trim_start().len();
        }
        let rest = &rest[start..];
        let word = &rest[..rest.find(char::is_whitespace).unwrap_or(rest.len())];
        self.at += start;
        let offset = self.at;
        self.at += word.len();
        if word.is_empty() {
            let problem = format!("the file ends before {what}");
            return Err((Error::new(problem, "give as many values as the sizes say"), offset));
        }
        let number = word.parse().ok().filter(|number: &f64| number.is_finite());
        number.ok_or_else(|| {
            let shown: String = word.chars().take(40).collect();
            (Error::new(format!("`{shown}` stands for {what}"), "give a number"), offset)
        })
    }

    fn count(&mut self, what: &str) -> std::result::Result<usize, (Error, usize)> {
        let number = self.number(what)?;
        if number.fract() == 0.0 && (1.0..=MAX_VALUES as f64).contains(&number) {
            return Ok(number as usize);
        }
        let advice = format!("give a whole number from 1 to {MAX_VALUES}");
        Err((Error::new(format!("{what} is {number}"), advice), self.at))
    }

    /// The nodes of a dimension: its ends and their number, or 0 0, their number and each of them.
    fn axis(&mut self) -> std::result::Result<Vec<f64>, (Error, usize)> {
        let [start, end] =
            [self.number("the start of an axis")?, self.number("the end of an axis")?];
        let count = self.count("the number of nodes of an axis")?;
        let nodes: Vec<f64> = if start == end {
            (0..count)
                .map(|_| self.number("a node of an axis"))
                .collect::<std::result::Result<_, _>>()?
        } else {
            let at = |index: usize| start + (end - start) * index as f64 / (count - 1) as f64;
            (0..count).map(at).collect()
        };
        let ascends = nodes.windows(2).all(|pair| pair[0] < pair[1]);
        let descends = nodes.windows(2).all(|pair| pair[0] > pair[1]);
        if count < 2 || !(ascends || descends) {
            let problem = "the nodes of an axis do not ascend or descend";
            return Err((Error::new(problem, "give at least two, in order"), self.at));
        }
        Ok(nodes)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_are_linear_between_nodes_and_fall_outside() {
        let own = DataFile::parse("# two axes\n2 0 10 2\n0 0 3 0 1 4\n1 2 3\n5 6 7\n").unwrap();
        for (at, expected) in
            [([0.0, 0.0], 1.0), ([10.0, 4.0], 7.0), ([5.0, 0.5], 3.5), ([0.0, 2.5], 2.5)]
        {
            assert!((own.value(&at) - expected).abs() < 1e-12, "{at:?} {}", own.value(&at));
        }
        // One interval further, and then in inverse proportion to the distance.
        assert!((own.value(&[0.0, -1.0]) - 0.0).abs() < 1e-12);
        assert!((own.value(&[20.0, 0.0]) - 9.0).abs() < 1e-12);
        assert!((own.value(&[40.0, 0.0]) - 9.0 / 5.0).abs() < 1e-12, "{}", own.value(&[40.0, 0.0]));
        let falling = DataFile::parse("1 0 0 3 4 2 0 1 5 9").unwrap();
        assert!((falling.value(&[1.0]) - 7.0).abs() < 1e-12, "{}", falling.value(&[1.0]));
        assert!((falling.value(&[4.0]) - 1.0).abs() < 1e-12);
    }

    #[test]
    fn bad_files_are_refused() {
        for bad in [
            "",
            "3 0 1 2",
            "1 0 1 1 5",
            "1 0 0 2 1 1 5 6",
            "1 0 1 2 5",
            "1 0 1 2 5 x",
            "2 0 1 1e6 0 1 1e6",
        ] {
            assert!(DataFile::parse(bad).is_err(), "{bad}");
        }
    }
}
