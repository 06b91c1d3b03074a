//! Generated OBJ files: any of what both readers know, and any way of writing it.

use proptest::prelude::*;
use proptest::sample::{Index, select};
use std::iter::Cycle;
use std::slice::Iter;

pub(super) const MATERIALS: [&str; 3] = ["stone", "my  red", "é"];

/// What a file holds.
#[derive(Clone, Debug)]
pub(super) enum Step {
    /// Positions on an ellipse, counterclockwise, divided by a weight.
    Ring { count: usize, weight: Option<f32> },
    /// So many texture coordinates and normals.
    Attributes([usize; 2]),
    /// A convex polygon: those of a ring's positions that are kept, or all if those are too few.
    Polygon { ring: Index, kept: [bool; 8], turned: usize, is_reversed: bool, corners: Corners },
    /// A triangle of any positions.
    Triangle { positions: [Index; 3], corners: Corners },
    /// A record that needs no other.
    Record(&'static str, &'static str),
}

/// What the corners of a face have besides positions.
#[derive(Clone, Debug)]
pub(super) struct Corners {
    /// Texture coordinates, normals.
    shares: [Share; 2],
    each: [Corner; 8],
}

/// Which corners have something.
#[derive(Clone, Copy, Debug)]
enum Share {
    None,
    Some,
    All,
}

/// Whether a corner is among those that have texture coordinates and normals where but some have, which
/// it has then, and whether its position and those are numbered from the newest.
type Corner = ([bool; 2], [Index; 2], [bool; 3]);

pub(super) fn step() -> impl Strategy<Value = Step> {
    let share = || select(vec![Share::None, Share::Some, Share::All, Share::All]);
    let corners = move || {
        let shares = [share(), share()];
        (shares, any::<[Corner; 8]>()).prop_map(|(shares, each)| Corners { shares, each })
    };
    let weight = select(vec![None, None, Some(1.0), Some(2.0), Some(0.3)]);
    let polygon = (any::<Index>(), any::<[bool; 8]>(), 0..8_usize, any::<bool>(), corners());
    let record = select(vec![
        ("o", "a"),
        ("o", "left  leg"),
        ("g", "a"),
        ("g", "é #1"),
        ("usemtl", MATERIALS[0]),
        ("usemtl", MATERIALS[1]),
        ("usemtl", MATERIALS[2]),
        ("s", "off"),
        ("p", "1"),
        ("l", "1 2"),
        ("f", "1 2"),
        ("vp", "0 1"),
    ]);
    prop_oneof![
        3 => (3..=8_usize, weight).prop_map(|(count, weight)| Step::Ring { count, weight }),
        2 => [0..4_usize, 0..4].prop_map(Step::Attributes),
        8 => polygon.prop_map(|(ring, kept, turned, is_reversed, corners)| {
            Step::Polygon { ring, kept, turned, is_reversed, corners }
        }),
        3 => (any::<[Index; 3]>(), corners())
            .prop_map(|(positions, corners)| Step::Triangle { positions, corners }),
        4 => record.prop_map(|(keyword, rest)| Step::Record(keyword, rest)),
    ]
}

/// A file of such steps.
pub(super) struct File<'a> {
    pub text: String,
    /// Of each triangle, whether it has texture coordinates and normals.
    pub layouts: Vec<[bool; 2]>,
    /// White space, line ends, forms of numbers: chosen by these, over and over.
    choices: Cycle<Iter<'a, u8>>,
    /// Whether it may be written in ways that `tobj` does not know.
    is_dialect: bool,
    /// The first position of each ring, and how many it has.
    rings: Vec<(usize, usize)>,
    /// Numbers of positions, texture coordinates and normals.
    defined: [usize; 3],
}

impl<'a> File<'a> {
    pub fn new(steps: &[Step], choices: &'a [u8], is_dialect: bool) -> Self {
        let mut file = Self {
            text: String::new(),
            layouts: Vec::new(),
            choices: choices.iter().cycle(),
            is_dialect,
            rings: Vec::new(),
            defined: [0; 3],
        };
        // Before all uses, or else `tobj` takes materials for undefined.
        file.record("mtllib", "a.mtl");
        // No file lacks faces, or positions for those to come.
        file.step(&Step::Ring { count: 3, weight: None });
        file.words("f", &["1", "2", "3"].map(str::to_owned));
        file.layouts.push([false; 2]);
        steps.iter().for_each(|step| file.step(step));
        file
    }

    fn step(&mut self, step: &Step) {
        match step {
            Step::Ring { count, weight } => {
                self.rings.push((self.defined[0], *count));
                for i in 0..*count {
                    self.position(i as f32 / *count as f32, *weight);
                }
            }
            Step::Attributes([uvs, normals]) => {
                (0..*uvs).for_each(|_| self.uv());
                (0..*normals).for_each(|_| self.normal());
            }
            Step::Polygon { ring, kept, turned, is_reversed, corners } => {
                let (first, count) = *ring.get(&self.rings);
                let mut positions: Vec<usize> = (0..count).filter(|i| kept[*i]).collect();
                if positions.len() < 3 {
                    positions = (0..count).collect();
                }
                let count = positions.len();
                positions.rotate_left(turned % count);
                if *is_reversed {
                    positions.reverse();
                }
                positions.iter_mut().for_each(|position| *position += first);
                self.face(&positions, corners);
            }
            Step::Triangle { positions, corners } => {
                self.face(&positions.map(|position| position.index(self.defined[0])), corners);
            }
            Step::Record(keyword, rest) => self.record(keyword, rest),
        }
    }

    /// So far along the newest ring. No two positions are the same.
    fn position(&mut self, along: f32, weight: Option<f32>) {
        let (sin, cos) = (along * std::f32::consts::TAU).sin_cos();
        let ring = self.rings.len() as f32;
        let mut numbers = vec![cos + ring.sin(), sin - 0.3 * ring, 0.1 * ring * cos + ring.cos()];
        if self.is_dialect && weight.is_none() {
            // `tobj` knows colors, but not of some positions only.
            numbers.extend(self.choose(&[&[][..], &[0.1, 0.2, 0.3], &[1.0, 0.5, 0.0, 1.0]]));
        }
        numbers.extend(weight);
        self.numbers("v", &numbers);
        self.defined[0] += 1;
    }

    fn uv(&mut self) {
        let i = self.defined[1] as f32;
        let uv = [i.sin(), 1.0 / (1.0 + i), 0.5];
        let count = self.choose(&[2, 3]);
        self.numbers("vt", &uv[..count]);
        self.defined[1] += 1;
    }

    fn normal(&mut self) {
        let i = self.defined[2] as f32;
        self.numbers("vn", &[i.cos(), i.sin(), 0.1 * i]);
        self.defined[2] += 1;
    }

    fn face(&mut self, positions: &[usize], corners: &Corners) {
        let defined = self.defined;
        let has = |corner: usize, kind: usize| match corners.shares[kind] {
            _ if defined[1 + kind] == 0 => false,
            Share::None => false,
            Share::Some => corners.each[corner].0[kind],
            Share::All => true,
        };
        let mut words = Vec::new();
        for (i, position) in positions.iter().enumerate() {
            let (_, indices, is_relative) = corners.each[i];
            let number = |kind: usize, index: usize| match is_relative[kind] {
                true => (index as i64 - defined[kind] as i64).to_string(),
                false => (index + 1).to_string(),
            };
            let [uv, normal] = [0, 1].map(|kind| match has(i, kind) {
                true => number(kind + 1, indices[kind].index(defined[kind + 1])),
                false => String::new(),
            });
            let word = format!("{}/{uv}/{normal}", number(0, *position));
            // The slashes of what is missing may be missing too.
            let short = word.trim_end_matches('/');
            words.push(self.choose(&[short, &word]).to_owned());
        }
        let layout = [0, 1].map(|kind| (0..positions.len()).all(|corner| has(corner, kind)));
        self.layouts.extend(vec![layout; positions.len() - 2]);
        self.words("f", &words);
    }

    fn numbers(&mut self, keyword: &str, numbers: &[f32]) {
        let mut words = Vec::new();
        for number in numbers {
            words.push(match self.choose(&[0, 1, 2, 3]) {
                0 => format!("{number}"),
                1 => format!("{number:e}"),
                2 => format!("{number:+}"),
                _ => format!("{number:.60}"),
            });
        }
        self.words(keyword, &words);
    }

    fn words(&mut self, keyword: &str, words: &[String]) {
        self.put(&["", "", " ", "\t"]);
        self.text += keyword;
        let spaces = [" ", " ", "  ", "\t", " \\\n", "\\\r\n\t"];
        for word in words {
            self.put(&spaces[..if self.is_dialect { 6 } else { 4 }]);
            self.text += word;
        }
        let comments = ["", "", " # why not", " #f 1 2 3"];
        self.put(&comments[..if self.is_dialect { 4 } else { 2 }]);
        self.end();
    }

    /// A record of which all that follows the keyword is a name.
    fn record(&mut self, keyword: &str, name: &str) {
        self.put(if self.is_dialect { &["", " \t"] } else { &[""] });
        self.text += keyword;
        self.put(if self.is_dialect { &[" ", "\t", " \\\n"] } else { &[" "] });
        self.text += name;
        self.end();
    }

    fn end(&mut self) {
        self.put(&["", "", " ", "\t "]);
        self.put(&["\n", "\n", "\r\n", "\n\n", "\n# f 1 \\\n", "\n#\n"]);
    }

    fn put(&mut self, from: &[&str]) {
        let text = self.choose(from);
        self.text += text;
    }

    fn choose<T: Copy>(&mut self, from: &[T]) -> T {
        from[usize::from(*self.choices.next().unwrap_or(&0)) % from.len()]
    }
}
