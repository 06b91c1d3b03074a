//! Accessors: typed items in the bytes of buffers. All offsets and counts are checked when an
//! accessor is opened, so that reading an item cannot fail.

use super::buffers::{Buffers, ViewBytes};
use super::json::{Accessor, Sparse, get};
use super::malformed;
use bdpm_core::base::error::{Error, Result};
use std::fmt::Display;

/// A number's type, by the code that OpenGL has for it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum ComponentType {
    I8,
    U8,
    I16,
    U16,
    U32,
    F32,
}

impl ComponentType {
    fn from_code(code: u64, element: impl Display) -> Result<Self> {
        Ok(match code {
            5120 => Self::I8,
            5121 => Self::U8,
            5122 => Self::I16,
            5123 => Self::U16,
            5125 => Self::U32,
            5126 => Self::F32,
            _ => return Err(malformed(element, format!("unknown componentType {code}"))),
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

    /// Refuses types that indices may not have.
    fn check_index(self, element: impl Display) -> Result<()> {
        match self {
            Self::U8 | Self::U16 | Self::U32 => Ok(()),
            _ => Err(malformed(element, "indices must be unsigned integers")),
        }
    }

    /// The number in the first bytes.
    fn number(self, bytes: &[u8], normalized: bool) -> f32 {
        // Integers of up to 16 bits fit.
        let (value, largest) = match self {
            Self::I8 => (f32::from(bytes[0] as i8), 127.0),
            Self::U8 => (f32::from(bytes[0]), 255.0),
            Self::I16 => (f32::from(i16::from_le_bytes([bytes[0], bytes[1]])), 32_767.0),
            Self::U16 => (f32::from(u16::from_le_bytes([bytes[0], bytes[1]])), 65_535.0),
            Self::U32 => (u32_at(bytes) as f32, u32::MAX as f32),
            Self::F32 => return f32::from_bits(u32_at(bytes)),
        };
        if normalized { (value / largest).max(-1.0) } else { value }
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

/// Number of items and bytes of one item.
#[derive(Clone, Copy)]
struct ItemLayout {
    count: u64,
    size: usize,
}

/// Items at equal distances in a slice that holds them all.
#[derive(Clone, Copy)]
struct Items<'a> {
    bytes: &'a [u8],
    stride: usize,
}

impl<'a> Items<'a> {
    /// Items from byte `offset` of the view on.
    fn new(
        view: ViewBytes<'a>,
        offset: u64,
        ItemLayout { count, size }: ItemLayout,
        element: impl Display,
    ) -> Result<Self> {
        let stride = view.stride.unwrap_or(size as u64);
        if stride < size as u64 {
            let problem = format!("byteStride is {stride}, less than an element's {size} bytes");
            return Err(malformed(element, problem));
        }
        let length = match count {
            0 => Some(0),
            _ => (count - 1).checked_mul(stride).and_then(|bytes| bytes.checked_add(size as u64)),
        };
        let held = view.bytes.len();
        let end = length.and_then(|length| length.checked_add(offset));
        if end.is_none_or(|end| end > held as u64) {
            let problem = format!(
                "{count} elements of {size} bytes, {stride} apart, from byte {offset} on exceed the \
                 {held} bytes of the view"
            );
            return Err(malformed(element, problem));
        }
        // Offset and stride fit the slice, unless there is a single item at most.
        let bytes = &view.bytes[(offset as usize).min(held)..];
        Ok(Self { bytes, stride: usize::try_from(stride).unwrap_or(usize::MAX) })
    }

    fn at(&self, index: usize) -> &'a [u8] {
        &self.bytes[index * self.stride..]
    }
}

/// An open accessor.
pub(super) struct AccessorReader<'a> {
    component: ComponentType,
    normalized: bool,
    /// Number of items.
    pub count: u64,
    /// The JSON element that refers to it, for error messages.
    element: String,
    /// All numbers are 0 if there is no base.
    base: Option<Items<'a>>,
    sparse: Option<SparseItems<'a>>,
}

/// Items of a sparse accessor that differ from the base.
struct SparseItems<'a> {
    /// In ascending order.
    indices: Vec<u64>,
    values: Items<'a>,
}

impl<'a> SparseItems<'a> {
    fn new(
        buffers: &'a Buffers,
        sparse: &Sparse,
        ItemLayout { count, size }: ItemLayout,
        element: &str,
    ) -> Result<Self> {
        if sparse.count > count {
            let problem = format!("count is {}, more than the {count} elements", sparse.count);
            return Err(malformed(element, problem));
        }
        let own = format!("{element}.indices");
        let index_type = ComponentType::from_code(sparse.indices.component_type, &own)?;
        index_type.check_index(&own)?;
        let view = buffers.view(sparse.indices.buffer_view, format!("{own}.bufferView"))?;
        let layout = ItemLayout { count: sparse.count, size: index_type.size() };
        let indices = Items::new(view, sparse.indices.byte_offset, layout, &own)?;
        let own = format!("{element}.values");
        let view = buffers.view(sparse.values.buffer_view, format!("{own}.bufferView"))?;
        let layout = ItemLayout { count: sparse.count, size };
        let values = Items::new(view, sparse.values.byte_offset, layout, own)?;
        // A slice holds the items, so that their number fits.
        let index = |rank| index_type.index(indices.at(rank)).into();
        let indices: Vec<u64> = (0..sparse.count as usize).map(index).collect();
        if !indices.is_sorted_by(|a, b| a < b) || indices.last().is_some_and(|last| *last >= count)
        {
            let problem = format!("indices must ascend and be less than {count}");
            return Err(malformed(format!("{element}.indices"), problem));
        }
        Ok(Self { indices, values })
    }

    /// The item of this index, if it is replaced.
    fn find(&self, index: u64) -> Option<&'a [u8]> {
        self.indices.binary_search(&index).ok().map(|rank| self.values.at(rank))
    }
}

impl<'a> AccessorReader<'a> {
    /// Opens the accessor of this index, to which `element` refers. Its items must be of the type
    /// `kind`, such as `VEC3`.
    pub fn open(
        buffers: &'a Buffers,
        index: usize,
        kind: &str,
        element: impl Into<String>,
    ) -> Result<Self> {
        let element = element.into();
        let accessor = get(&buffers.document.accessors, "accessors", index, &element)?;
        let own = format!("accessors[{index}]");
        if accessor.kind != kind {
            let found: String = accessor.kind.chars().take(20).collect();
            return Err(malformed(element, format!("{own} holds {found}, not {kind}")));
        }
        let component = ComponentType::from_code(accessor.component_type, &own)?;
        let width = match kind {
            "SCALAR" => 1,
            "VEC2" => 2,
            "VEC4" => 4,
            "MAT4" => 16,
            _ => 3,
        };
        let Accessor { count, byte_offset, normalized, .. } = *accessor;
        let layout = ItemLayout { count, size: width * component.size() };
        let base = accessor.buffer_view.map(|view| {
            let view = buffers.view(view, format!("{own}.bufferView"))?;
            Items::new(view, byte_offset, layout, &own)
        });
        let base = base.transpose()?;
        let sparse = accessor.sparse.as_ref();
        let sparse = sparse
            .map(|sparse| SparseItems::new(buffers, sparse, layout, &format!("{own}.sparse")));
        Ok(Self { component, normalized, count, element, base, sparse: sparse.transpose()? })
    }

    /// A problem with the items, named after the element that refers to the accessor.
    pub fn error(&self, problem: impl Display) -> Error {
        malformed(&self.element, problem)
    }

    /// Refuses types that vertex indices may not have.
    pub fn check_index(&self) -> Result<()> {
        self.component.check_index(&self.element)
    }

    /// The bytes of an item; `None` if they are all zero.
    fn item(&self, index: u64) -> Option<&'a [u8]> {
        let replaced = self.sparse.as_ref().and_then(|sparse| sparse.find(index));
        replaced.or_else(|| Some(self.base.as_ref()?.at(index as usize)))
    }

    /// The vertex index at `index`, which is less than the count.
    pub fn index(&self, index: u64) -> u32 {
        self.item(index).map_or(0, |bytes| self.component.index(bytes))
    }

    /// The numbers at `index`, which is less than the count. `N` is their number in the accessor's
    /// type.
    pub fn numbers<const N: usize>(&self, index: impl Into<u64>) -> [f32; N] {
        let Some(bytes) = self.item(index.into()) else { return [0.0; N] };
        let size = self.component.size();
        std::array::from_fn(|i| self.component.number(&bytes[i * size..], self.normalized))
    }
}
