//! Accessors: typed elements in the bytes of buffers. All offsets and counts are checked when one is
//! opened, so that reading an element cannot fail.

use super::buffers::{Buffers, View};
use super::fault;
use super::json::{Accessor, Document, Sparse, get};
use crate::base::error::Result;
use std::fmt::Display;

/// A number's type, by the code that OpenGL has for it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Component {
    I8,
    U8,
    I16,
    U16,
    U32,
    F32,
}

impl Component {
    fn from_code(code: u64, place: impl Display) -> Result<Self> {
        Ok(match code {
            5120 => Self::I8,
            5121 => Self::U8,
            5122 => Self::I16,
            5123 => Self::U16,
            5125 => Self::U32,
            5126 => Self::F32,
            _ => return Err(fault(place, format!("unknown componentType {code}"))),
        })
    }

    /// Bytes.
    fn size(self) -> usize {
        match self {
            Self::I8 | Self::U8 => 1,
            Self::I16 | Self::U16 => 2,
            Self::U32 | Self::F32 => 4,
        }
    }

    /// Whether indices may have this type.
    fn counts(self) -> bool {
        matches!(self, Self::U8 | Self::U16 | Self::U32)
    }

    /// The number in the first bytes.
    fn number(self, bytes: &[u8], normalized: bool) -> f32 {
        // Integers of up to 16 bits fit.
        let (value, most) = match self {
            Self::I8 => (f32::from(bytes[0] as i8), 127.0),
            Self::U8 => (f32::from(bytes[0]), 255.0),
            Self::I16 => (f32::from(i16::from_le_bytes([bytes[0], bytes[1]])), 32_767.0),
            Self::U16 => (f32::from(u16::from_le_bytes([bytes[0], bytes[1]])), 65_535.0),
            Self::U32 => (u32_at(bytes) as f32, u32::MAX as f32),
            Self::F32 => return f32::from_bits(u32_at(bytes)),
        };
        if normalized { (value / most).max(-1.0) } else { value }
    }

    /// The index in the first bytes.
    fn index(self, bytes: &[u8]) -> u32 {
        match self {
            Self::U8 => bytes[0].into(),
            Self::U16 => u16::from_le_bytes([bytes[0], bytes[1]]).into(),
            _ => u32_at(bytes),
        }
    }
}

fn u32_at(bytes: &[u8]) -> u32 {
    u32::from_le_bytes([bytes[0], bytes[1], bytes[2], bytes[3]])
}

/// Elements at equal distances in a slice that holds them all.
#[derive(Clone, Copy)]
struct Elements<'a> {
    bytes: &'a [u8],
    stride: usize,
}

impl<'a> Elements<'a> {
    /// `count` elements of `size` bytes, the first `offset` bytes into the view.
    fn new(
        view: View<'a>,
        offset: u64,
        count: u64,
        size: usize,
        place: impl Display,
    ) -> Result<Self> {
        let stride = view.stride.unwrap_or(size as u64);
        if stride < size as u64 {
            let problem = format!("byteStride is {stride}, less than an element's {size} bytes");
            return Err(fault(place, problem));
        }
        let length = match count {
            0 => Some(0),
            _ => (count - 1).checked_mul(stride).and_then(|bytes| bytes.checked_add(size as u64)),
        };
        let end = length.and_then(|length| length.checked_add(offset));
        if end.is_none_or(|end| end > view.bytes.len() as u64) {
            let held = view.bytes.len();
            let problem = format!(
                "{count} elements of {size} bytes, {stride} apart, from byte {offset} on reach beyond \
                 the {held} bytes of the view"
            );
            return Err(fault(place, problem));
        }
        // Both fit the slice, unless there is a single element at most.
        let bytes = &view.bytes[(offset as usize).min(view.bytes.len())..];
        Ok(Self { bytes, stride: usize::try_from(stride).unwrap_or(usize::MAX) })
    }

    fn at(&self, index: usize) -> &'a [u8] {
        &self.bytes[index * self.stride..]
    }
}

/// An open accessor.
pub(super) struct Reader<'a> {
    component: Component,
    normalized: bool,
    /// Number of elements.
    pub count: u64,
    /// Without these all numbers are 0.
    base: Option<Elements<'a>>,
    replaced: Option<Replaced<'a>>,
}

/// Elements of a sparse accessor that differ from the base.
struct Replaced<'a> {
    count: usize,
    /// In ascending order.
    indices: Elements<'a>,
    index_type: Component,
    values: Elements<'a>,
}

impl<'a> Replaced<'a> {
    fn index(&self, place: usize) -> u64 {
        self.index_type.index(self.indices.at(place)).into()
    }

    /// The element of this index, if it is replaced.
    fn find(&self, index: u64) -> Option<&'a [u8]> {
        let (mut low, mut high) = (0, self.count);
        while low < high {
            let middle = low + (high - low) / 2;
            match self.index(middle).cmp(&index) {
                std::cmp::Ordering::Equal => return Some(self.values.at(middle)),
                std::cmp::Ordering::Less => low = middle + 1,
                std::cmp::Ordering::Greater => high = middle,
            }
        }
        None
    }
}

impl<'a> Reader<'a> {
    /// Opens the accessor that `place` refers to; its elements must be of the type `kind`, such as
    /// `VEC3`.
    pub fn open(
        document: &Document,
        buffers: &'a Buffers,
        index: usize,
        kind: &str,
        place: impl Display,
    ) -> Result<Self> {
        let accessor = get(&document.accessors, "accessors", index, &place)?;
        let own = format!("accessors[{index}]");
        if accessor.kind != kind {
            let problem = format!("accessors[{index}] holds {}, not {kind}", short(&accessor.kind));
            return Err(fault(place, problem));
        }
        let component = Component::from_code(accessor.component_type, &own)?;
        let width = match kind {
            "SCALAR" => 1,
            "VEC2" => 2,
            "VEC4" => 4,
            "MAT4" => 16,
            _ => 3,
        };
        let size = width * component.size();
        let Accessor { count, byte_offset, normalized, .. } = *accessor;
        let base = accessor.buffer_view.map(|view| {
            let view = buffers.view(view, format!("{own}.bufferView"))?;
            Elements::new(view, byte_offset, count, size, &own)
        });
        let replaced = accessor.sparse.as_ref().map(|sparse| {
            let own = format!("{own}.sparse");
            Self::replaced(buffers, sparse, count, size, &own)
        });
        Ok(Self {
            component,
            normalized,
            count,
            base: base.transpose()?,
            replaced: replaced.transpose()?,
        })
    }

    fn replaced(
        buffers: &'a Buffers,
        sparse: &Sparse,
        count: u64,
        size: usize,
        place: &str,
    ) -> Result<Replaced<'a>> {
        if sparse.count > count {
            let problem = format!("count is {}, more than the {count} elements", sparse.count);
            return Err(fault(place, problem));
        }
        let own = format!("{place}.indices");
        let index_type = Component::from_code(sparse.indices.component_type, &own)?;
        if !index_type.counts() {
            return Err(fault(own, "indices must be unsigned integers"));
        }
        let view = buffers.view(sparse.indices.buffer_view, format!("{own}.bufferView"))?;
        let offset = sparse.indices.byte_offset;
        let indices = Elements::new(view, offset, sparse.count, index_type.size(), &own)?;
        let own = format!("{place}.values");
        let view = buffers.view(sparse.values.buffer_view, format!("{own}.bufferView"))?;
        let values = Elements::new(view, sparse.values.byte_offset, sparse.count, size, own)?;
        // As many as there are elements in a slice.
        let replaced = Replaced { count: sparse.count as usize, indices, index_type, values };
        let ascends = (1..replaced.count).all(|i| replaced.index(i - 1) < replaced.index(i));
        if !ascends || (replaced.count > 0 && replaced.index(replaced.count - 1) >= count) {
            let problem = format!("indices must ascend and be less than {count}");
            return Err(fault(format!("{place}.indices"), problem));
        }
        Ok(replaced)
    }

    /// Whether its elements can be vertex indices.
    pub fn counts(&self) -> bool {
        self.component.counts()
    }

    /// The element's bytes; `None` if they are all zero.
    fn element(&self, index: u64) -> Option<&'a [u8]> {
        let replaced = self.replaced.as_ref().and_then(|replaced| replaced.find(index));
        replaced.or_else(|| Some(self.base.as_ref()?.at(index as usize)))
    }

    /// The vertex index at `index`, which is less than the count.
    pub fn index(&self, index: u64) -> u32 {
        self.element(index).map_or(0, |bytes| self.component.index(bytes))
    }

    /// The numbers at `index`, which is less than the count; `N` as many as its type has.
    pub fn numbers<const N: usize>(&self, index: u64) -> [f32; N] {
        let Some(bytes) = self.element(index) else { return [0.0; N] };
        let size = self.component.size();
        std::array::from_fn(|i| self.component.number(&bytes[i * size..], self.normalized))
    }
}

fn short(name: &str) -> String {
    name.chars().take(20).collect()
}
