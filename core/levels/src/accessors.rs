//! The numbers of a glTF: buffers, views, and the elements of accessors.
//!
//! Every index, offset and length is checked on use.

use crate::container::{self, Files};
use crate::document::{Accessor, Buffer, Document, Sparse, View};
use crate::faults::ImportError;
use std::borrow::Cow;
use std::cell::{Cell, OnceCell};

/// Most bytes of compressed views that are decoded for a level: those of three million triangles, several times over.
const MAX_DECODED_BYTES: usize = 256 << 20;
/// Bytes that an element of a sparse accessor takes while it is read.
const SPARSE_BYTES: usize = 24;
/// Most bytes of all buffers together.
const MAX_BUFFER_BYTES: usize = 1 << 30;
/// Most numbers of an element: a 4 x 4 matrix.
const MAX_WIDTH: usize = 16;

/// The data of a glTF.
pub(super) struct Source<'a> {
    pub(super) root: &'a Document,
    buffers: Vec<Cow<'a, [u8]>>,
    /// Decoded content of compressed views, filled on the first read.
    decoded: Vec<OnceCell<Vec<u8>>>,
    /// Bytes that may still be decoded.
    decoding_budget: Cell<usize>,
}

impl<'a> Source<'a> {
    /// Opens the buffers; `binary` is the binary chunk of a `.glb`.
    pub(super) fn new(root: &'a Document, binary: Option<&'a [u8]>, files: &dyn Files) -> Result<Self, ImportError> {
        // Files count once for each buffer that names them, so that a small level takes no more than it says.
        let mut budget = MAX_BUFFER_BYTES;
        let buffers = root.buffers.iter().enumerate().map(|(idx, buffer)| {
            let bytes = read_buffer(idx, buffer, binary, files)?;
            budget = budget.checked_sub(bytes.len()).ok_or(ImportError::TooManyTriangles)?;
            Ok::<_, ImportError>(bytes)
        });
        let decoded = root.buffer_views.iter().map(|_| OnceCell::new()).collect();
        Ok(Self {
            root,
            buffers: buffers.collect::<Result<_, _>>()?,
            decoded,
            decoding_budget: Cell::new(MAX_DECODED_BYTES),
        })
    }

    /// Takes bytes from what may still be decoded.
    pub(super) fn spend(&self, len: usize) -> Result<(), ImportError> {
        let left = self.decoding_budget.get().checked_sub(len).ok_or(ImportError::TooManyTriangles)?;
        self.decoding_budget.set(left);
        Ok(())
    }

    /// The elements of an accessor, checked to lie within its view and buffer.
    pub(super) fn elements(
        &self,
        mesh: &str,
        accessor_idx: usize,
        layout: Layout,
    ) -> Result<Elements<'_>, ImportError> {
        let accessor =
            self.root.accessors.get(accessor_idx).ok_or_else(|| reference(mesh, "accessor", accessor_idx))?;
        let encoding = layout.encoding(accessor).ok_or_else(|| data_error(mesh, layout.problem()))?;
        let width = layout.number_count() * encoding.component.size();
        let (bytes, stride) = match (accessor.buffer_view, &accessor.sparse) {
            (Some(view_idx), _) => {
                let view =
                    self.root.buffer_views.get(view_idx).ok_or_else(|| reference(mesh, "buffer view", view_idx))?;
                let stride = view.byte_stride.filter(|stride| *stride > 0).unwrap_or(width);
                let place = Place { view_idx, offset: accessor.byte_offset, stride, width };
                (Some(self.strided(mesh, place, accessor.count)?), stride)
            }
            // The elements are zero where nothing is said (glTF 2.0, section 3.6.2.1).
            (None, _) => (None, width),
        };
        // Indices are 32-bit numbers, so no further elements can be used.
        let count = usize::try_from(accessor.count).unwrap_or(usize::MAX);
        let elements = Elements { bytes, stride, width, count, encoding, changed: Vec::new() };
        match &accessor.sparse {
            Some(sparse) => self.with_changes(mesh, elements, sparse),
            None => Ok(elements),
        }
    }

    /// Adds the elements that a sparse accessor replaces.
    fn with_changes<'b>(
        &'b self,
        mesh: &str,
        elements: Elements<'b>,
        sparse: &Sparse,
    ) -> Result<Elements<'b>, ImportError> {
        let damaged = || data_error(mesh, "sparse data that does not fit: the file is damaged; export it again");
        let component = Component::of(sparse.indices.component_type).filter(|it| it.is_index()).ok_or_else(damaged)?;
        if sparse.count > elements.count as u64 {
            return Err(damaged());
        }
        self.spend(SPARSE_BYTES.saturating_mul(sparse.count as usize))?;
        let (index_width, value_width) = (component.size(), elements.width);
        let at = |view_idx, offset, width| Place { view_idx, offset, stride: width, width };
        let (indices, values) = (&sparse.indices, &sparse.values);
        let indices = self.strided(mesh, at(indices.buffer_view, indices.byte_offset, index_width), sparse.count)?;
        let values = self.strided(mesh, at(values.buffer_view, values.byte_offset, value_width), sparse.count)?;
        let mut changed: Vec<(u32, &[u8])> =
            indices.chunks_exact(index_width).map(little_endian).zip(values.chunks_exact(value_width)).collect();
        // The specification wants them sorted, and each once.
        changed.sort_by_key(|(idx, _)| *idx);
        if changed.last().is_some_and(|(idx, _)| *idx as usize >= elements.count) {
            return Err(damaged());
        }
        Ok(Elements { changed, ..elements })
    }

    /// The bytes from the first to the last of `count` elements.
    fn strided(&self, mesh: &str, place: Place, count: u64) -> Result<&[u8], ImportError> {
        let Place { view_idx, offset, stride, width } = place;
        let view = self.root.buffer_views.get(view_idx).ok_or_else(|| reference(mesh, "buffer view", view_idx))?;
        let bytes = self.view(mesh, view_idx, view)?.and_then(|view| {
            let len = match count.checked_sub(1) {
                Some(gaps) => gaps.checked_mul(stride as u64)?.checked_add(width as u64)?,
                None => 0,
            };
            view.get(range(offset, len)?)
        });
        let too_short = || data_error(mesh, "data that lies outside its buffer: the file is damaged; export it again");
        bytes.filter(|_| stride >= width).ok_or_else(too_short)
    }

    /// The bytes of a view by its index.
    pub(super) fn whole_view(&self, mesh: &str, view_idx: usize) -> Result<&[u8], ImportError> {
        let view = self.root.buffer_views.get(view_idx).ok_or_else(|| reference(mesh, "buffer view", view_idx))?;
        let damaged = || data_error(mesh, "data that lies outside its buffer: the file is damaged; export it again");
        self.view(mesh, view_idx, view)?.ok_or_else(damaged)
    }

    /// The bytes of a view; `None` if they lie outside its buffer.
    fn view(&self, mesh: &str, view_idx: usize, view: &View) -> Result<Option<&[u8]>, ImportError> {
        let part = |buffer_idx: usize, offset: u64, len: u64| {
            let buffer = self.buffers.get(buffer_idx).ok_or_else(|| reference(mesh, "buffer", buffer_idx))?;
            Ok(range(offset, len).and_then(|range| buffer.get(range)))
        };
        let Some(compression) = view.compression() else {
            return part(view.buffer, view.byte_offset, view.byte_length);
        };
        let decoded = &self.decoded[view_idx];
        if let Some(known) = decoded.get() {
            return Ok(Some(known));
        }
        let Some(bytes) = part(compression.buffer, compression.byte_offset, compression.byte_length)? else {
            return Ok(None);
        };
        self.spend(compression.decoded_len())?;
        let content = compression.decode(bytes).map_err(|problem| data_error(mesh, problem))?;
        Ok(Some(decoded.get_or_init(|| content)))
    }
}

fn read_buffer<'a>(
    idx: usize,
    buffer: &Buffer,
    binary: Option<&'a [u8]>,
    files: &dyn Files,
) -> Result<Cow<'a, [u8]>, ImportError> {
    let bytes = match (&buffer.uri, binary) {
        (None, Some(binary)) if idx == 0 => Cow::Borrowed(binary),
        // A fallback buffer has no data, which is an error only if something reads it.
        (None, _) => return Ok(Cow::Borrowed(&[])),
        (Some(uri), _) => Cow::Owned(container::resolve(idx, uri, files)?),
    };
    let (len, expected) = (bytes.len(), buffer.byte_length);
    if (len as u64) < expected { Err(ImportError::ShortBuffer { buffer: idx, len, expected }) } else { Ok(bytes) }
}

pub(super) fn data_error(mesh: &str, problem: &'static str) -> ImportError {
    ImportError::Data { mesh: mesh.to_owned(), problem }
}

pub(super) fn reference(from: &str, to: &'static str, idx: usize) -> ImportError {
    ImportError::Reference { from: from.to_owned(), to, idx }
}

fn range(offset: u64, len: u64) -> Option<std::ops::Range<usize>> {
    let end = offset.checked_add(len)?;
    Some(usize::try_from(offset).ok()?..usize::try_from(end).ok()?)
}

/// Where elements lie.
#[derive(Clone, Copy)]
struct Place {
    view_idx: usize,
    offset: u64,
    stride: usize,
    width: usize,
}

/// Kind of data that an accessor is read as.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Layout {
    Positions,
    /// Whole numbers of one component.
    Indices,
    /// Whole numbers of four components, which name joints.
    Joints,
    /// This many numbers each.
    Floats(usize),
}

impl Layout {
    fn number_count(self) -> usize {
        match self {
            Self::Positions => 3,
            Self::Indices => 1,
            Self::Joints => 4,
            Self::Floats(count) => count,
        }
    }

    fn problem(self) -> &'static str {
        match self {
            Self::Positions => "positions that are neither floats nor quantized: export it again",
            Self::Indices | Self::Joints => "indices that are not unsigned integers: export it again",
            Self::Floats(_) => "keys, weights or matrices that are no numbers of their kind: export the level again",
        }
    }

    /// How the accessor's numbers are stored; `None` if it has other numbers.
    fn encoding(self, accessor: &Accessor) -> Option<Encoding> {
        let component = Component::of(accessor.component_type)?;
        let number_count = match accessor.shape.as_str() {
            "SCALAR" => 1,
            "VEC2" => 2,
            "VEC3" => 3,
            "VEC4" => 4,
            "MAT4" => 16,
            _ => return None,
        };
        let is_right = match self {
            Self::Indices | Self::Joints => component.is_index(),
            Self::Positions | Self::Floats(_) => component != Component::U32,
        };
        (is_right && number_count == self.number_count())
            .then_some(Encoding { component, is_normalized: accessor.normalized })
    }
}

/// Type of a component (glTF 2.0, section 3.6.2.2).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Component {
    I8,
    U8,
    I16,
    U16,
    U32,
    F32,
}

impl Component {
    fn of(number: u32) -> Option<Self> {
        Some(match number {
            5120 => Self::I8,
            5121 => Self::U8,
            5122 => Self::I16,
            5123 => Self::U16,
            5125 => Self::U32,
            5126 => Self::F32,
            _ => return None,
        })
    }

    fn size(self) -> usize {
        match self {
            Self::I8 | Self::U8 => 1,
            Self::I16 | Self::U16 => 2,
            Self::U32 | Self::F32 => 4,
        }
    }

    fn is_index(self) -> bool {
        matches!(self, Self::U8 | Self::U16 | Self::U32)
    }
}

/// How the components of an element are stored.
#[derive(Debug, Clone, Copy)]
struct Encoding {
    component: Component,
    is_normalized: bool,
}

impl Encoding {
    /// A component in little-endian `bytes` of its size.
    fn decode(self, bytes: &[u8]) -> Option<f32> {
        let (value, most) = match self.component {
            Component::I8 => (f32::from(*bytes.first()? as i8), f32::from(i8::MAX)),
            Component::U8 => (f32::from(*bytes.first()?), f32::from(u8::MAX)),
            Component::I16 => (f32::from(i16::from_le_bytes(*bytes.first_chunk()?)), f32::from(i16::MAX)),
            Component::U16 => (f32::from(u16::from_le_bytes(*bytes.first_chunk()?)), f32::from(u16::MAX)),
            Component::F32 => return Some(f32::from_le_bytes(*bytes.first_chunk()?)),
            Component::U32 => return None,
        };
        // glTF 2.0, section 3.6.2.2: the most negative number stands for -1 as well.
        Some(if self.is_normalized { (value / most).max(-1.0) } else { value })
    }
}

fn little_endian(bytes: &[u8]) -> u32 {
    bytes.iter().rev().fold(0, |value, &byte| value << 8 | u32::from(byte))
}

/// Checked elements: `count` elements of `width` bytes, `stride` bytes apart; the last one is complete.
pub(super) struct Elements<'a> {
    /// `None`: all are zero.
    bytes: Option<&'a [u8]>,
    stride: usize,
    width: usize,
    pub(super) count: usize,
    encoding: Encoding,
    /// Elements that have other bytes, by their indices.
    changed: Vec<(u32, &'a [u8])>,
}

impl Elements<'_> {
    /// The bytes at `idx`, which are zeros if there are none; `None` beyond the end.
    fn element(&self, idx: usize) -> Option<&[u8]> {
        const ZEROS: [u8; 4 * MAX_WIDTH] = [0; 4 * MAX_WIDTH];
        if idx >= self.count {
            return None;
        }
        if let Ok(place) = self.changed.binary_search_by_key(&idx, |(idx, _)| *idx as usize) {
            return Some(self.changed[place].1);
        }
        Some(match self.bytes {
            Some(bytes) => &bytes[idx * self.stride..idx * self.stride + self.width],
            None => &ZEROS[..self.width],
        })
    }

    /// The first `N` numbers at `idx`.
    pub(super) fn floats<const N: usize>(&self, idx: usize) -> Option<[f32; N]> {
        let size = self.encoding.component.size();
        let mut components = self.element(idx)?.chunks_exact(size);
        let mut values = [0.0; N];
        for value in &mut values {
            *value = self.encoding.decode(components.next()?)?;
        }
        Some(values)
    }

    /// The whole number at `idx`, which must be below `count`.
    pub(super) fn index(&self, idx: usize) -> u32 {
        little_endian(self.element(idx).unwrap_or_default())
    }

    /// The four whole numbers at `idx`.
    pub(super) fn joints(&self, idx: usize) -> Option<[u32; 4]> {
        let mut numbers = self.element(idx)?.chunks_exact(self.width / 4).map(little_endian);
        let mut joints = [0; 4];
        joints.iter_mut().for_each(|joint| *joint = numbers.next().unwrap_or_default());
        Some(joints)
    }
}
