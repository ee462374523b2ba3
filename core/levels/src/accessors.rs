//! The data of a glTF: its container, its buffers, and the numbers in them.
//!
//! Every index, offset and length is checked on use.

use crate::faults::ImportError;
use crate::meshopt::Compression;
use base64::Engine;
use base64::alphabet::STANDARD;
use base64::engine::general_purpose::{GeneralPurpose, NO_PAD};
use gltf::json::accessor::ComponentType;
use gltf::json::validation::Checked;
use gltf::json::{self, Root};
use std::borrow::Cow;
use std::cell::{Cell, OnceCell};
use surefoot_world::Vec3;

/// Most bytes of compressed views that are decoded for a level: those of three million triangles, several times over.
const MAX_DECODED_BYTES: usize = 256 << 20;
const DATA_URI: &str = "data:";
const BASE64_MARK: &str = ";base64,";
/// Base64 with the standard alphabet (RFC 4648, section 4). Padding is cut off before; leftover bits are ignored.
const BASE64: GeneralPurpose = GeneralPurpose::new(&STANDARD, NO_PAD.with_decode_allow_trailing_bits(true));

/// Splits a `.glb` into its JSON chunk and its binary chunk.
pub(super) fn split_glb(bytes: &[u8]) -> Result<(&[u8], Option<&[u8]>), ImportError> {
    let header: &[u8; 12] = bytes.first_chunk().ok_or(ImportError::Container("its header is cut off"))?;
    let number = |at: usize| u32::from_le_bytes([header[at], header[at + 1], header[at + 2], header[at + 3]]);
    if number(4) != 2 {
        return Err(ImportError::GltfVersion(number(4).to_string()));
    }
    let contents = bytes.get(12..number(8) as usize).ok_or(ImportError::Container("it is cut off"))?;
    let json = Chunk::first(contents)?;
    if json.kind != b"JSON" {
        return Err(ImportError::Container("it does not begin with JSON"));
    }
    if json.rest.is_empty() {
        return Ok((json.content, None));
    }
    let binary = Chunk::first(json.rest)?;
    Ok((json.content, (binary.kind == b"BIN\0").then_some(binary.content)))
}

/// A chunk of a `.glb`, and the bytes that follow it.
struct Chunk<'a> {
    kind: &'a [u8; 4],
    content: &'a [u8],
    rest: &'a [u8],
}

impl<'a> Chunk<'a> {
    fn first(bytes: &'a [u8]) -> Result<Self, ImportError> {
        let chunk = bytes.split_first_chunk::<4>().and_then(|(len, rest)| {
            let (kind, rest) = rest.split_first_chunk::<4>()?;
            let (content, rest) = rest.split_at_checked(u32::from_le_bytes(*len) as usize)?;
            Some(Self { kind, content, rest })
        });
        chunk.ok_or(ImportError::Container("one of its chunks is cut off"))
    }
}

/// The data of a glTF.
pub(super) struct Source<'a> {
    pub(super) root: &'a Root,
    buffers: Vec<Cow<'a, [u8]>>,
    /// Decoded content of compressed views, filled on the first read.
    decoded: Vec<OnceCell<Vec<u8>>>,
    /// Bytes that may still be decoded.
    decoding_budget: Cell<usize>,
}

impl<'a> Source<'a> {
    /// Opens the buffers; `binary` is the binary chunk of a `.glb`.
    pub(super) fn new(root: &'a Root, binary: Option<&'a [u8]>) -> Result<Self, ImportError> {
        let buffers = root.buffers.iter().enumerate().map(|(idx, buffer)| read_buffer(idx, buffer, binary));
        let decoded = root.buffer_views.iter().map(|_| OnceCell::new()).collect();
        Ok(Self {
            root,
            buffers: buffers.collect::<Result<_, _>>()?,
            decoded,
            decoding_budget: Cell::new(MAX_DECODED_BYTES),
        })
    }

    /// The elements of an accessor, checked to lie within its view and buffer.
    pub(super) fn elements(
        &self,
        mesh: &str,
        accessor_idx: usize,
        layout: Layout,
    ) -> Result<Elements<'_>, ImportError> {
        let reference = |to, idx| ImportError::Reference { from: mesh.to_owned(), to, idx };
        let accessor = self.root.accessors.get(accessor_idx).ok_or_else(|| reference("accessor", accessor_idx))?;
        if accessor.sparse.is_some() {
            return Err(data_error(mesh, "sparse accessors, which are not supported: export it without them"));
        }
        let (number_count, problem) = match layout {
            Layout::Positions => (3, "positions that are neither floats nor quantized: export it again"),
            Layout::Indices => (1, "indices that are not unsigned integers: export it again"),
            Layout::Floats(count) => (count, "keys that are no numbers of its kind: export the level again"),
        };
        let (Checked::Valid(kind), Checked::Valid(component)) = (accessor.type_, accessor.component_type) else {
            return Err(data_error(mesh, problem));
        };
        let is_integer = matches!(component.0, ComponentType::U8 | ComponentType::U16 | ComponentType::U32);
        let is_right = if layout == Layout::Indices { is_integer } else { component.0 != ComponentType::U32 };
        if kind.multiplicity() != number_count || !is_right {
            return Err(data_error(mesh, problem));
        }
        let width = number_count * component.0.size();
        let encoding = Encoding { component: component.0, is_normalized: accessor.normalized };
        let no_data = || data_error(mesh, "no vertex data: export it without compression");
        let view_idx = accessor.buffer_view.ok_or_else(no_data)?.value();
        let view = self.root.buffer_views.get(view_idx).ok_or_else(|| reference("buffer view", view_idx))?;
        let stride = view.byte_stride.map_or(width, |stride| stride.0);
        let count = accessor.count.0;
        let bytes = self.view(mesh, view_idx, view)?.and_then(|view| {
            let len = match count.checked_sub(1) {
                Some(gaps) => gaps.checked_mul(stride as u64)?.checked_add(width as u64)?,
                None => 0,
            };
            view.get(range(accessor.byte_offset.map_or(0, |offset| offset.0), len)?)
        });
        let too_short = || data_error(mesh, "data that lies outside its buffer: the file is damaged; export it again");
        let bytes = bytes.filter(|_| stride >= width).ok_or_else(too_short)?;
        // The bytes exist, so the count fits into a usize.
        Ok(Elements { bytes, stride, width, count: count as usize, encoding })
    }

    /// The bytes of a view; `None` if they lie outside its buffer.
    fn view(&self, mesh: &str, view_idx: usize, view: &json::buffer::View) -> Result<Option<&[u8]>, ImportError> {
        let part = |buffer_idx: usize, offset: u64, len: u64| {
            let reference = || ImportError::Reference { from: mesh.to_owned(), to: "buffer", idx: buffer_idx };
            let buffer = self.buffers.get(buffer_idx).ok_or_else(reference)?;
            Ok(range(offset, len).and_then(|range| buffer.get(range)))
        };
        let failed = |problem| data_error(mesh, problem);
        let Some(compression) = Compression::of(view).map_err(failed)? else {
            return part(view.buffer.value(), view.byte_offset.map_or(0, |offset| offset.0), view.byte_length.0);
        };
        let decoded = &self.decoded[view_idx];
        if let Some(known) = decoded.get() {
            return Ok(Some(known));
        }
        let Some(bytes) = part(compression.buffer, compression.byte_offset, compression.byte_length)? else {
            return Ok(None);
        };
        let left = self.decoding_budget.get().checked_sub(compression.decoded_len());
        self.decoding_budget.set(left.ok_or(ImportError::TooManyTriangles)?);
        let content = compression.decode(bytes).map_err(failed)?;
        Ok(Some(decoded.get_or_init(|| content)))
    }
}

fn read_buffer<'a>(idx: usize, buffer: &json::Buffer, binary: Option<&'a [u8]>) -> Result<Cow<'a, [u8]>, ImportError> {
    let bytes = match (&buffer.uri, binary) {
        (None, Some(binary)) if idx == 0 => Cow::Borrowed(binary),
        // A fallback buffer has no data, which is an error only if something reads it.
        (None, _) => return Ok(Cow::Borrowed(&[])),
        (Some(uri), _) if uri.starts_with(DATA_URI) => {
            let text = uri.split_once(BASE64_MARK).map(|(_, text)| text.trim_end_matches('='));
            Cow::Owned(text.and_then(|text| BASE64.decode(text).ok()).ok_or(ImportError::Base64 { buffer: idx })?)
        }
        (Some(uri), _) => return Err(ImportError::ExternalBuffer { uri: uri.chars().take(200).collect() }),
    };
    let (len, expected) = (bytes.len(), buffer.byte_length.0);
    if (len as u64) < expected { Err(ImportError::ShortBuffer { buffer: idx, len, expected }) } else { Ok(bytes) }
}

pub(super) fn data_error(mesh: &str, problem: &'static str) -> ImportError {
    ImportError::Data { mesh: mesh.to_owned(), problem }
}

fn range(offset: u64, len: u64) -> Option<std::ops::Range<usize>> {
    let end = offset.checked_add(len)?;
    Some(usize::try_from(offset).ok()?..usize::try_from(end).ok()?)
}

/// Kind of data that an accessor is read as.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Layout {
    Positions,
    Indices,
    /// This many numbers each.
    Floats(usize),
}

/// Checked elements: `count` elements of `width` bytes, `stride` bytes apart; the last one is complete.
pub(super) struct Elements<'a> {
    bytes: &'a [u8],
    stride: usize,
    width: usize,
    pub(super) count: usize,
    encoding: Encoding,
}

/// How the components of a position are stored.
#[derive(Debug, Clone, Copy)]
struct Encoding {
    component: ComponentType,
    is_normalized: bool,
}

impl Encoding {
    /// A component in little-endian `bytes` of its size.
    fn decode(self, bytes: &[u8]) -> Option<f32> {
        let (value, most) = match self.component {
            ComponentType::I8 => (f32::from(*bytes.first()? as i8), f32::from(i8::MAX)),
            ComponentType::U8 => (f32::from(*bytes.first()?), f32::from(u8::MAX)),
            ComponentType::I16 => (f32::from(i16::from_le_bytes(*bytes.first_chunk()?)), f32::from(i16::MAX)),
            ComponentType::U16 => (f32::from(u16::from_le_bytes(*bytes.first_chunk()?)), f32::from(u16::MAX)),
            ComponentType::F32 => return Some(f32::from_le_bytes(*bytes.first_chunk()?)),
            ComponentType::U32 => return None,
        };
        // glTF 2.0, section 3.6.2.2: the most negative number stands for -1 as well.
        Some(if self.is_normalized { (value / most).max(-1.0) } else { value })
    }
}

impl Elements<'_> {
    fn element(&self, idx: usize) -> Option<&[u8]> {
        (idx < self.count).then(|| &self.bytes[idx * self.stride..idx * self.stride + self.width])
    }

    pub(super) fn position(&self, idx: usize) -> Option<Vec3> {
        self.floats(idx, 3).map(|[x, y, z, _]| Vec3::new(x, y, z))
    }

    /// The first `width` numbers at `idx`, at most 4, followed by zeros.
    pub(super) fn floats(&self, idx: usize, width: usize) -> Option<[f32; 4]> {
        let mut components = self.element(idx)?.chunks_exact(self.width / width);
        let mut values = [0.0; 4];
        for value in &mut values[..width] {
            *value = self.encoding.decode(components.next()?)?;
        }
        Some(values)
    }

    /// The vertex index at `idx`, which must be below `count`.
    pub(super) fn index(&self, idx: usize) -> u32 {
        let bytes = self.element(idx).unwrap_or_default();
        bytes.iter().rev().fold(0, |value, &byte| value << 8 | u32::from(byte))
    }
}
