//! Indices: of triangles that share edges with earlier ones, or any sequence.

use super::{CUT_OFF, Problem, TOO_LONG, take_byte, unzigzag};

/// The last sixteen items, the newest one first.
struct Recent<T> {
    items: [T; 16],
    next: usize,
}

impl<T: Copy + Default> Recent<T> {
    fn new() -> Self {
        Self { items: [T::default(); 16], next: 0 }
    }

    fn push(&mut self, item: T) {
        self.items[self.next % 16] = item;
        self.next = (self.next + 1) % 16;
    }

    fn get(&self, age: u8) -> T {
        self.items[(self.next + 15 - usize::from(age)) % 16]
    }
}

/// A number of up to five bytes, seven bits each, the lowest first.
fn number(data: &mut &[u8]) -> Result<u32, Problem> {
    let mut value: u32 = 0;
    for place in 0..5 {
        let byte = take_byte(data)?;
        value |= u32::from(byte & 127) << (7 * place);
        if byte < 128 {
            return Ok(value);
        }
    }
    Err("its compressed data have a number of more than 32 bits")
}

/// Appends an index as 2 or 4 bytes.
fn push(content: &mut Vec<u8>, index: u32, stride: usize) {
    content.extend_from_slice(&index.to_le_bytes()[..stride]);
}

fn check_stride(stride: usize) -> Result<(), Problem> {
    if matches!(stride, 2 | 4) { Ok(()) } else { Err("byteStride of indices is neither 2 nor 4") }
}

/// What triangles refer to.
struct Triangles<'a> {
    data: &'a [u8],
    /// The index after the largest one so far.
    next: u32,
    /// The last index that was given by its difference.
    last: u32,
    edges: Recent<[u32; 2]>,
    vertices: Recent<u32>,
}

impl Triangles<'_> {
    fn new_index(&mut self) -> u32 {
        let own = self.next;
        self.next = self.next.wrapping_add(1);
        own
    }

    fn given_index(&mut self) -> Result<u32, Problem> {
        self.last = self.last.wrapping_add(unzigzag(number(&mut self.data)?));
        Ok(self.last)
    }

    /// The third corner at a recent edge.
    fn at_edge(&mut self, age: u8, code: u8) -> Result<[u32; 3], Problem> {
        let [a, b] = self.edges.get(age);
        let c = match code {
            0 => self.new_index(),
            13 | 14 => {
                self.last = self.last.wrapping_add(if code == 13 { u32::MAX } else { 1 });
                self.last
            }
            15 => self.given_index()?,
            age => self.vertices.get(age),
        };
        if !(1..13).contains(&code) {
            self.vertices.push(c);
        }
        self.edges.push([c, b]);
        self.edges.push([a, c]);
        Ok([a, b, c])
    }

    /// A triangle of its own. Both later corners are new, given, or recent by one more than their
    /// age.
    fn alone(&mut self, is_given: bool, corners: u8) -> Result<[u32; 3], Problem> {
        let a = if is_given { self.given_index()? } else { self.new_index() };
        let codes = [corners >> 4, corners & 15];
        let mut others = [0; 2];
        for (other, code) in others.iter_mut().zip(codes) {
            *other = match code {
                0 => self.new_index(),
                15 => self.given_index()?,
                _ => self.vertices.get(code - 1),
            };
        }
        let [b, c] = others;
        self.vertices.push(a);
        for (other, code) in others.into_iter().zip(codes) {
            if matches!(code, 0 | 15) {
                self.vertices.push(other);
            }
        }
        [[b, a], [c, b], [a, c]].into_iter().for_each(|edge| self.edges.push(edge));
        Ok([a, b, c])
    }
}

/// Decodes `count` indices of triangles as numbers of `stride` bytes.
pub(super) fn triangles(stream: &[u8], count: usize, stride: usize) -> Result<Vec<u8>, Problem> {
    check_stride(stride)?;
    if !count.is_multiple_of(3) {
        return Err("its count is no multiple of 3");
    }
    let [0xe1, data @ ..] = stream else {
        return Err("its compressed data are of an unknown version");
    };
    let (codes, data) = data.split_at_checked(count / 3).ok_or(CUT_OFF)?;
    let (data, table) = data.split_last_chunk::<16>().ok_or(CUT_OFF)?;
    let (edges, vertices) = (Recent::new(), Recent::new());
    let mut state = Triangles { data, next: 0, last: 0, edges, vertices };
    let mut content = Vec::with_capacity(count * stride);
    for code in codes {
        let corners = match (code >> 4, code & 15) {
            (15, own @ (14 | 15)) => {
                let corners = take_byte(&mut state.data)?;
                if corners == 0 {
                    state.next = 0;
                }
                state.alone(own == 15, corners)?
            }
            (15, place) => {
                let corners = table[usize::from(place)];
                if corners >> 4 == 15 || corners & 15 == 15 {
                    return Err("its compressed data have a wrong table");
                }
                state.alone(false, corners)?
            }
            (age, own) => state.at_edge(age, own)?,
        };
        corners.into_iter().for_each(|index| push(&mut content, index, stride));
    }
    if state.data.is_empty() { Ok(content) } else { Err(TOO_LONG) }
}

/// Decodes `count` indices, each by its difference to one of two earlier ones, as numbers of
/// `stride` bytes.
pub(super) fn sequence(stream: &[u8], count: usize, stride: usize) -> Result<Vec<u8>, Problem> {
    check_stride(stride)?;
    let [0xd1, data @ ..] = stream else {
        return Err("its compressed data are of an unknown version");
    };
    let (mut data, _) = data.split_last_chunk::<4>().ok_or(CUT_OFF)?;
    if count > data.len() {
        return Err(CUT_OFF);
    }
    let mut last = [0_u32; 2];
    let mut content = Vec::with_capacity(count * stride);
    for _ in 0..count {
        let code = number(&mut data)?;
        let own = &mut last[(code & 1) as usize];
        *own = own.wrapping_add(unzigzag(code >> 1));
        push(&mut content, *own, stride);
    }
    if data.is_empty() { Ok(content) } else { Err(TOO_LONG) }
}
