//! The transforms of `xform`, with arrays and repetitions.

use bdpm_core::base::error::{Error, Result};
use glam::{DAffine3, DMat3, DVec3};

/// Placements of one command, at most.
const MAX_PLACEMENTS: u64 = 1_000_000;

/// A sequence of transforms in groups. `-i N` repeats those that follow it N times, up to the next
/// `-i` or `-a`. `-a N` places what comes before it N times: as it is, and with the transforms that
/// follow, up to the next `-i` or `-a`, once, twice and so on.
#[derive(Clone, Debug)]
pub struct Transforms {
    groups: Vec<Group>,
}

/// Transforms that are repeated together.
#[derive(Clone, Copy, Debug)]
struct Group {
    /// Number of repetitions, or of copies.
    count: u64,
    is_array: bool,
    map: DAffine3,
}

impl Default for Transforms {
    fn default() -> Self {
        Self { groups: vec![Group { count: 1, is_array: false, map: DAffine3::IDENTITY }] }
    }
}

impl Transforms {
    /// The transforms that words begin with, and the first word that is none.
    ///
    /// # Errors
    /// If a number is missing or malformed.
    pub fn of(words: &[String]) -> Result<(Self, Option<String>)> {
        let (mut words, mut own) = (Vec::from(words).into_iter(), Self::default());
        while own.take(&mut words)? {}
        Ok((own, words.next()))
    }

    /// Takes an option and its numbers from the front of `words`. Returns false for other words.
    ///
    /// # Errors
    /// If a number is missing or malformed.
    pub fn take(&mut self, words: &mut std::vec::IntoIter<String>) -> Result<bool> {
        let Some(word) = words.as_slice().first().cloned() else { return Ok(false) };
        let axis = |name: &str| match name {
            "x" => DVec3::X,
            "y" => DVec3::Y,
            _ => DVec3::Z,
        };
        let number = |words: &mut std::vec::IntoIter<String>| -> Result<f64> {
            let given = words.next().unwrap_or_default();
            let number = given.parse().ok().filter(|number: &f64| number.is_finite());
            number.ok_or_else(|| {
                let problem = format!("`{given}` is not a number of `{word}`");
                Error::new(problem, "give numbers after each option")
            })
        };
        let map = match &word[..] {
            "-t" => {
                words.next();
                let [x, y, z] = [number(words)?, number(words)?, number(words)?];
                DAffine3::from_translation(DVec3::new(x, y, z))
            }
            "-rx" | "-ry" | "-rz" => {
                words.next();
                DAffine3::from_axis_angle(axis(&word[2..]), number(words)?.to_radians())
            }
            "-s" => {
                words.next();
                let scale = number(words)?;
                if scale == 0.0 {
                    return Err(Error::new("the scale of `-s` is 0", "give another number"));
                }
                DAffine3::from_scale(DVec3::splat(scale))
            }
            "-mx" | "-my" | "-mz" => {
                words.next();
                DAffine3::from_mat3(DMat3::from_diagonal(1.0 - 2.0 * axis(&word[2..])))
            }
            "-i" | "-a" => {
                words.next();
                let count = number(words)?;
                // Public scenes have `-i 0` before a transform that is not done.
                let least = if word == "-a" { 1.0 } else { 0.0 };
                if !(least..=MAX_PLACEMENTS as f64).contains(&count) || count.fract() != 0.0 {
                    let problem = format!("{count} is not a number of copies");
                    return Err(Error::new(problem, format!("give {least} to {MAX_PLACEMENTS}")));
                }
                let (count, is_array) = (count as u64, word == "-a");
                self.groups.push(Group { count, is_array, map: DAffine3::IDENTITY });
                return Ok(true);
            }
            _ => return Ok(false),
        };
        // Later options move what earlier ones have moved.
        if let Some(group) = self.groups.last_mut() {
            group.map = map * group.map;
        }
        Ok(true)
    }

    /// The map of each copy.
    ///
    /// # Errors
    /// If there are too many.
    pub fn placements(&self) -> Result<Vec<DAffine3>> {
        let arrays = self.groups.iter().filter(|group| group.is_array);
        let count = arrays.map(|group| group.count).try_fold(1u64, u64::checked_mul);
        if count.is_none_or(|count| count > MAX_PLACEMENTS) {
            let problem = "the arrays have more than a million copies";
            return Err(Error::new(problem, "reduce the numbers of `-a`"));
        }
        let mut all = vec![DAffine3::IDENTITY];
        for Group { count, is_array, map } in &self.groups {
            if !is_array {
                let map = power(*map, *count);
                all.iter_mut().for_each(|own| *own = map * *own);
                continue;
            }
            let (mut next, mut moved) = (Vec::new(), DAffine3::IDENTITY);
            for _ in 0..*count {
                next.extend(all.iter().map(|own| moved * *own));
                moved = *map * moved;
            }
            all = next;
        }
        Ok(all)
    }
}

/// A map so many times.
fn power(map: DAffine3, mut times: u64) -> DAffine3 {
    let (mut all, mut square) = (DAffine3::IDENTITY, map);
    while times > 0 {
        if times % 2 == 1 {
            all = square * all;
        }
        square = square * square;
        times /= 2;
    }
    all
}

#[cfg(test)]
mod tests {
    use super::*;

    fn placed(options: &str) -> Vec<[f64; 3]> {
        let words: Vec<String> = options.split_whitespace().map(str::to_owned).collect();
        let (mut words, mut own) = (words.into_iter(), Transforms::default());
        while own.take(&mut words).unwrap() {}
        assert_eq!(words.len(), 0);
        let at = DVec3::new(1.0, 2.0, 3.0);
        let round = |point: DVec3| point.to_array().map(|x| (1e9 * x).round() / 1e9);
        own.placements().unwrap().iter().map(|map| round(map.transform_point3(at))).collect()
    }

    #[test]
    fn transforms_follow_each_other_and_arrays_repeat_them() {
        assert_eq!(placed("-t 1 0 0 -rz 90"), [[-2.0, 2.0, 3.0]]);
        assert_eq!(placed("-rz 90 -t 1 0 0"), [[-1.0, 1.0, 3.0]]);
        assert_eq!(placed("-s 2 -mx"), [[-2.0, 4.0, 6.0]]);
        assert_eq!(placed("-i 3 -t 1 0 0 -i 1 -t 0 1 0"), [[4.0, 3.0, 3.0]]);
        assert_eq!(placed("-t 0 0 1 -i 0 -t 1 0 0"), [[1.0, 2.0, 4.0]]);
        // An iteration after an array moves all its copies.
        let ring = placed("-t 1 0 -3 -a 2 -rz 180 -i 1 -t 0 0 5");
        assert_eq!(ring, [[2.0, 2.0, 5.0], [-2.0, -2.0, 5.0]]);
        let row = placed("-t 0 0 1 -a 3 -t 10 0 0");
        assert_eq!(row, [[1.0, 2.0, 4.0], [11.0, 2.0, 4.0], [21.0, 2.0, 4.0]]);
        assert_eq!(placed("-a 2 -t 10 0 0 -a 2 -t 0 10 0").len(), 4);
        assert_eq!(placed("-a 2 -t 10 0 0 -a 2 -t 0 10 0")[3], [11.0, 12.0, 3.0]);
    }

    #[test]
    fn bad_options_are_refused() {
        let take = |options: &str| {
            let words: Vec<String> = options.split_whitespace().map(str::to_owned).collect();
            let (mut words, mut own) = (words.into_iter(), Transforms::default());
            while own.take(&mut words)? {}
            own.placements()
        };
        for bad in
            ["-t 1 2", "-s 0", "-a 1e9", "-a -1", "-a 0", "-i -1", "-a 2000 -a 2000", "-rx x"]
        {
            assert!(take(bad).is_err(), "{bad}");
        }
    }
}
