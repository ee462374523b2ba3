//! Views that meshoptimizer compressed: the extensions `EXT_meshopt_compression` and `KHR_meshopt_compression`, as far
//! as positions and indices need them. The formats are those of the extension's specification: attributes of version 0,
//! triangles and indices of versions 0 and 1. Every read is checked, because the bytes are not trusted.

use gltf::json::buffer::View;
use serde::Deserialize;

/// Names of the extension.
pub(super) const EXTENSIONS: [&str; 2] = ["EXT_meshopt_compression", "KHR_meshopt_compression"];
/// Longest element that is decoded, bytes.
const MAX_STRIDE: usize = 64;
const NEWER: &str = "vertices that a newer meshoptimizer compressed: use EXT_meshopt_compression \
                     (gltfpack -c or -cc), or no compression";
const DAMAGED: &str =
    "compressed data that cannot be decoded: the file is damaged; export it again, or without compression";

/// How a view is compressed.
#[derive(Debug, Deserialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct Compression {
    /// Buffer of the compressed bytes.
    pub buffer: usize,
    #[serde(default)]
    pub byte_offset: u64,
    pub byte_length: u64,
    byte_stride: usize,
    count: usize,
    mode: Mode,
    #[serde(default)]
    filter: Filter,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "UPPERCASE")]
enum Mode {
    Attributes,
    Triangles,
    Indices,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Deserialize)]
#[serde(rename_all = "UPPERCASE")]
enum Filter {
    #[default]
    None,
    Exponential,
    /// Those of directions, colours and rotations.
    #[serde(other)]
    Other,
}

impl Compression {
    /// How a view is compressed; `None` if it is not.
    ///
    /// # Errors
    /// What is wrong with the description.
    pub fn of(view: &View) -> Result<Option<Self>, &'static str> {
        let Some(extensions) = &view.extensions else { return Ok(None) };
        let Some(found) = EXTENSIONS.iter().find_map(|name| extensions.others.get(*name)) else { return Ok(None) };
        let parsed = Self::deserialize(found);
        parsed.map(Some).map_err(|_| "compressed data of an unknown kind: export the level without compression")
    }

    /// Number of bytes before compression.
    pub fn decoded_len(&self) -> usize {
        self.count.saturating_mul(self.byte_stride)
    }

    /// The elements as they were before compression. Takes [`decoded_len`](Self::decoded_len) bytes of memory.
    ///
    /// # Errors
    /// What is wrong with the bytes or their description.
    pub fn decode(&self, bytes: &[u8]) -> Result<Vec<u8>, &'static str> {
        match (self.mode, self.byte_stride) {
            (Mode::Attributes, stride) => {
                let mut decoded = attributes(self.count, stride, bytes)?;
                match self.filter {
                    Filter::None => {}
                    Filter::Exponential => decoded.as_chunks_mut::<4>().0.iter_mut().for_each(apply_exponent),
                    Filter::Other => {
                        return Err(
                            "positions that were compressed like directions: export the level without compression",
                        );
                    }
                }
                Ok(decoded)
            }
            (Mode::Triangles, stride @ (2 | 4)) if self.count.is_multiple_of(3) => {
                triangles(self.count / 3, stride, bytes).ok_or(DAMAGED)
            }
            (Mode::Indices, stride @ (2 | 4)) => indices(self.count, stride, bytes).ok_or(DAMAGED),
            _ => Err(DAMAGED),
        }
    }
}

/// Bytes that are read one after another.
struct Bytes<'a>(&'a [u8]);

impl<'a> Bytes<'a> {
    fn take(&mut self, count: usize) -> Option<&'a [u8]> {
        let (taken, rest) = self.0.split_at_checked(count)?;
        self.0 = rest;
        Some(taken)
    }

    fn byte(&mut self) -> Option<u8> {
        self.take(1).map(|taken| taken[0])
    }

    /// A number of up to five groups of seven bits, the lowest first.
    fn number(&mut self) -> Option<u32> {
        let mut number = 0;
        for shift in [0, 7, 14, 21, 28] {
            let group = self.byte()?;
            number |= u32::from(group & 127) << shift;
            if group < 128 {
                break;
            }
        }
        Some(number)
    }

    /// An index, as the difference from another one.
    fn index_after(&mut self, last: u32) -> Option<u32> {
        self.number().map(|number| last.wrapping_add(unfolded(number)))
    }
}

/// The difference that was stored as 2 d or, below 0, as -2 d - 1.
fn unfolded(number: u32) -> u32 {
    (number >> 1) ^ (number & 1).wrapping_neg()
}

/// Turns a number with a mantissa of 24 bits and an exponent of 8, both signed, into an `f32`.
fn apply_exponent(word: &mut [u8; 4]) {
    let (mantissa, exponent) = (i32::from_le_bytes(*word) << 8 >> 8, i32::from_le_bytes(*word) >> 24);
    let scale = f32::from_bits(((exponent + 127) as u32) << 23);
    *word = (scale * mantissa as f32).to_le_bytes();
}

/// Most elements of a block of attributes, and the elements of a group in it.
const MAX_BLOCK: usize = 256;
const GROUP: usize = 16;
/// Most bytes of the elements of a block.
const MAX_BLOCK_BYTES: usize = 8192;
/// Least bytes after the blocks of attributes, which end with what the first element is a difference from.
const MIN_TAIL: usize = 32;

/// Decodes `count` elements of `stride` bytes each.
fn attributes(count: usize, stride: usize, bytes: &[u8]) -> Result<Vec<u8>, &'static str> {
    if stride > MAX_STRIDE {
        return Err("compressed vertices of more than 64 bytes: export the level without compression");
    }
    match bytes.first() {
        Some(0xa0) if stride > 0 && stride.is_multiple_of(4) => {}
        Some(header) if header & 0xf0 == 0xa0 && *header != 0xa0 => return Err(NEWER),
        _ => return Err(DAMAGED),
    }
    let blocks = bytes[1..].len().checked_sub(stride.max(MIN_TAIL)).ok_or(DAMAGED)?;
    let mut blocks = Bytes(&bytes[1..=blocks]);
    let mut last = [0; MAX_STRIDE];
    let last = &mut last[..stride];
    last.copy_from_slice(&bytes[bytes.len() - stride..]);
    let most = (MAX_BLOCK_BYTES / stride / GROUP * GROUP).min(MAX_BLOCK);
    // Each header byte stands for at most four groups of bytes.
    if count.saturating_mul(stride) / (4 * GROUP) > blocks.0.len() {
        return Err(DAMAGED);
    }
    let mut elements = vec![0; count * stride];
    for block in elements.chunks_mut(most * stride) {
        attribute_block(&mut blocks, block, last).ok_or(DAMAGED)?;
    }
    if blocks.0.is_empty() { Ok(elements) } else { Err(DAMAGED) }
}

/// Decodes a block of elements. They are stored by byte position: all first bytes come first, each as the difference
/// from that byte of the previous element. `last` is the element before the first, and then the last one.
fn attribute_block(bytes: &mut Bytes<'_>, block: &mut [u8], last: &mut [u8]) -> Option<()> {
    let stride = last.len();
    let group_count = (block.len() / stride).div_ceil(GROUP);
    for (at, last) in last.iter_mut().enumerate() {
        let widths = bytes.take(group_count.div_ceil(4))?;
        for (number, group) in block.chunks_mut(GROUP * stride).enumerate() {
            let differences = differences(bytes, widths[number / 4] >> (2 * (number % 4)) & 3)?;
            for (element, difference) in group.chunks_mut(stride).zip(differences) {
                *last = last.wrapping_add(unfolded(difference.into()) as u8);
                element[at] = *last;
            }
        }
    }
    Some(())
}

/// Reads the differences of a group, of 0, 2, 4 or 8 bits each. For those of 2 or 4 bits that are all ones, a byte
/// follows after the group.
fn differences(bytes: &mut Bytes<'_>, width: u8) -> Option<[u8; GROUP]> {
    let mut differences = [0; GROUP];
    let bits: u32 = match width {
        0 => return Some(differences),
        3 => {
            differences.copy_from_slice(bytes.take(GROUP)?);
            return Some(differences);
        }
        width => 2 * u32::from(width),
    };
    let packed = bytes.take(GROUP * bits as usize / 8)?;
    let (per_byte, most) = ((8 / bits) as usize, (1 << bits) - 1);
    for (idx, difference) in differences.iter_mut().enumerate() {
        let shift = 8 - bits * (1 + (idx % per_byte) as u32);
        *difference = packed[idx / per_byte] >> shift & most;
        if *difference == most {
            *difference = bytes.byte()?;
        }
    }
    Some(differences)
}

/// The last 16 of something.
struct Recent<T>([T; 16], usize);

impl<T: Copy> Recent<T> {
    /// The one that was pushed `ago` pushes before the last one.
    fn get(&self, ago: u8) -> T {
        self.0[self.1.wrapping_sub(1 + usize::from(ago)) % 16]
    }

    fn push(&mut self, it: T) {
        self.0[self.1] = it;
        self.1 = (self.1 + 1) % 16;
    }
}

/// The state from which the corners of the next triangle are decoded.
struct Corners<'a> {
    bytes: Bytes<'a>,
    /// Recent corners, and edges, each as its ends.
    corners: Recent<u32>,
    edges: Recent<[u32; 2]>,
    /// The first index that no triangle had yet, and the last one that was stored as a difference.
    next: u32,
    last: u32,
}

impl Corners<'_> {
    fn next(&mut self) -> u32 {
        let next = self.next;
        self.next = next.wrapping_add(1);
        next
    }

    fn free(&mut self) -> Option<u32> {
        self.last = self.bytes.index_after(self.last)?;
        Some(self.last)
    }

    /// The third corner of a triangle that has an edge with a recent one.
    fn third(&mut self, code: u8, first_free: u8) -> Option<u32> {
        let corner = match code {
            0 => self.next(),
            _ if code < first_free => return Some(self.corners.get(code)),
            15 => self.free()?,
            _ => {
                // 13 is one less than the last one, and 14 one more.
                self.last = if code == 13 { self.last.wrapping_sub(1) } else { self.last.wrapping_add(1) };
                self.last
            }
        };
        self.corners.push(corner);
        Some(corner)
    }

    /// The corners of a triangle without such an edge.
    fn apart(&mut self, codes: [u8; 3]) -> Option<[u32; 3]> {
        // Corners that come next are counted before any that is stored as a difference.
        let known = codes.map(|code| match code {
            0 => self.next(),
            15 => 0,
            code => self.corners.get(code - 1),
        });
        let mut corners = known;
        for (corner, code) in corners.iter_mut().zip(codes) {
            *corner = if code == 15 { self.free()? } else { *corner };
        }
        for (corner, code) in corners.into_iter().zip(codes) {
            if code == 0 || code == 15 {
                self.corners.push(corner);
            }
        }
        Some(corners)
    }
}

/// Decodes triangles whose indices have `stride` bytes.
fn triangles(count: usize, stride: usize, bytes: &[u8]) -> Option<Vec<u8>> {
    let (header, rest) = bytes.split_first()?;
    let (codes, rest) = rest.split_at_checked(count)?;
    let (data, table) = rest.split_last_chunk::<16>()?;
    let first_free = match header {
        0xe0 => 15,
        0xe1 => 13,
        _ => return None,
    };
    let (corners, edges) = (Recent([u32::MAX; 16], 0), Recent([[u32::MAX; 2]; 16], 0));
    let mut state = Corners { bytes: Bytes(data), corners, edges, next: 0, last: 0 };
    let mut decoded = Vec::with_capacity(3 * count * stride);
    for code in codes {
        let [a, b, c] = if *code < 0xf0 {
            let [a, b] = state.edges.get(code >> 4);
            [a, b, state.third(code & 15, first_free)?]
        } else {
            let pair = if *code < 0xfe { table[usize::from(code & 15)] } else { state.bytes.byte()? };
            if *code >= 0xfe && pair == 0 {
                state.next = 0;
            }
            let corners = state.apart([if *code == 0xff { 15 } else { 0 }, pair >> 4, pair & 15])?;
            state.edges.push([corners[1], corners[0]]);
            corners
        };
        state.edges.push([c, b]);
        state.edges.push([a, c]);
        decoded.extend([a, b, c].iter().flat_map(|corner| corner.to_le_bytes().into_iter().take(stride)));
    }
    state.bytes.0.is_empty().then_some(decoded)
}

/// Decodes indices of `stride` bytes.
fn indices(count: usize, stride: usize, bytes: &[u8]) -> Option<Vec<u8>> {
    const TAIL: usize = 4;
    let (0xd0 | 0xd1, rest) = bytes.split_first()? else { return None };
    let mut data = Bytes(rest.split_at_checked(rest.len().checked_sub(TAIL)?)?.0);
    if data.0.len() < count {
        return None;
    }
    let mut last = [0_u32; 2];
    let mut decoded = Vec::with_capacity(count * stride);
    for _ in 0..count {
        // The lowest bit says which of two indices it is a difference from.
        let number = data.number()?;
        let last = &mut last[(number & 1) as usize];
        *last = last.wrapping_add(unfolded(number >> 1));
        decoded.extend(last.to_le_bytes().into_iter().take(stride));
    }
    data.0.is_empty().then_some(decoded)
}

#[cfg(test)]
mod tests {
    use super::*;
    use meshopt_rs::index::IndexEncodingVersion;
    use meshopt_rs::index::buffer::{encode_index_buffer, encode_index_buffer_bound};
    use meshopt_rs::index::sequence::{encode_index_sequence, encode_index_sequence_bound};
    use meshopt_rs::vertex::VertexEncodingVersion;
    use meshopt_rs::vertex::buffer::{encode_vertex_buffer, encode_vertex_buffer_bound};
    use meshopt_rs::vertex::filter::decode_filter_exp;
    use proptest::prelude::*;
    use proptest::test_runner::RngSeed;

    fn of(mode: Mode, byte_stride: usize, count: usize) -> Compression {
        Compression { buffer: 0, byte_offset: 0, byte_length: 0, byte_stride, count, mode, filter: Filter::None }
    }

    /// Encodes elements of `N` bytes, cut from `content`.
    fn encoded<const N: usize>(content: &[u8]) -> Vec<u8> {
        let (elements, _) = content.as_chunks::<N>();
        let mut bytes = vec![0; encode_vertex_buffer_bound(elements.len(), N)];
        let len = encode_vertex_buffer(&mut bytes, elements, VertexEncodingVersion::V0).unwrap();
        bytes.truncate(len);
        bytes
    }

    fn version(is_new: bool) -> IndexEncodingVersion {
        if is_new { IndexEncodingVersion::V1 } else { IndexEncodingVersion::V0 }
    }

    /// Bytes of which neighbours differ by little, by much, or not at all, so that groups of every width occur.
    fn content() -> impl Strategy<Value = Vec<u8>> {
        let run = prop_oneof![
            (any::<u8>(), 1..400_usize).prop_map(|(byte, len)| vec![byte; len]),
            (1..8_u8, prop::collection::vec(any::<u8>(), 1..400))
                .prop_map(|(most, bytes)| bytes.into_iter().map(|byte| byte % most).collect()),
            prop::collection::vec(any::<u8>(), 1..400),
        ];
        prop::collection::vec(run, 0..12).prop_map(|runs| runs.concat())
    }

    /// Indices of neighbouring triangles, with jumps.
    fn corners() -> impl Strategy<Value = Vec<u32>> {
        let near = (0..2000_u32).prop_flat_map(|first| prop::collection::vec(first..first + 20, 3..60));
        let far = prop::collection::vec(0..1_u32 << 24, 3..6);
        let strip = (0..5000_u32, 1..40_u32)
            .prop_map(|(first, len)| (first..first + len).flat_map(|at| [at, at + 1, at + 2]).collect::<Vec<u32>>());
        prop::collection::vec(prop_oneof![near, far, strip], 0..8).prop_map(|runs| {
            let mut all = runs.concat();
            all.truncate(all.len() / 3 * 3);
            all
        })
    }

    proptest! {
        #![proptest_config(ProptestConfig {
            cases: 400, rng_seed: RngSeed::Fixed(1), failure_persistence: None, ..ProptestConfig::default()
        })]

        #[test]
        fn attributes_are_those_that_were_encoded(content in content(), stride in 1..=16_usize) {
            macro_rules! encoded_by_length {
                ($($length:literal)*) => {
                    match 4 * stride { $($length => encoded::<$length>(&content),)* _ => unreachable!() }
                };
            }
            let bytes = encoded_by_length!(4 8 12 16 20 24 28 32 36 40 44 48 52 56 60 64);
            let stride = 4 * stride;
            let count = content.len() / stride;
            prop_assert_eq!(of(Mode::Attributes, stride, count).decode(&bytes).unwrap(), &content[..count * stride]);
        }

        #[test]
        fn triangles_are_those_that_were_encoded(corners in corners(), is_new in any::<bool>()) {
            let mut bytes = vec![0; encode_index_buffer_bound(corners.len(), 1 << 24)];
            let len = encode_index_buffer(&mut bytes, &corners, version(is_new)).unwrap();
            let decoded = of(Mode::Triangles, 4, corners.len()).decode(&bytes[..len]).unwrap();
            let decoded: Vec<u32> = decoded.as_chunks::<4>().0.iter().map(|it| u32::from_le_bytes(*it)).collect();
            // The encoder turns triangles.
            for (one, other) in corners.chunks(3).zip(decoded.chunks(3)) {
                let is_turned = |turn: usize| (0..3).all(|at| one[(at + turn) % 3] == other[at]);
                prop_assert!((0..3).any(is_turned), "{one:?} {other:?}");
            }
        }

        #[test]
        fn indices_are_those_that_were_encoded(corners in corners(), is_new in any::<bool>()) {
            let mut bytes = vec![0; encode_index_sequence_bound(corners.len(), 1 << 24)];
            let len = encode_index_sequence(&mut bytes, &corners, version(is_new));
            let decoded = of(Mode::Indices, 4, corners.len()).decode(&bytes[..len]).unwrap();
            prop_assert_eq!(decoded, corners.iter().flat_map(|it| it.to_le_bytes()).collect::<Vec<u8>>());
            let short = of(Mode::Indices, 2, corners.len()).decode(&bytes[..len]).unwrap();
            prop_assert_eq!(short, corners.iter().flat_map(|it| (*it as u16).to_le_bytes()).collect::<Vec<u8>>());
        }

        #[test]
        fn exponents_are_applied_as_by_the_reference(words in prop::collection::vec(any::<u32>(), 1..40)) {
            let mut own: Vec<[u8; 4]> = words.iter().map(|word| word.to_le_bytes()).collect();
            own.iter_mut().for_each(apply_exponent);
            // The reference overflows there.
            let mut words: Vec<u32> = words.into_iter().map(|word| if word >> 24 == 0x80 { 0 } else { word }).collect();
            decode_filter_exp(&mut words);
            for (own, word) in own.into_iter().zip(words).filter(|(_, word)| *word != 0) {
                prop_assert_eq!(u32::from_le_bytes(own), word);
            }
        }

        #[test]
        fn damaged_bytes_give_a_value_or_an_error(
            (content, corners) in (content(), corners()),
            hits in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 0..6),
            cut in prop::option::of(any::<prop::sample::Index>()),
            (count, stride) in (0..3000_usize, 0..70_usize),
            noise in prop::collection::vec(any::<u8>(), 0..300),
        ) {
            let mut triangles = vec![0; encode_index_buffer_bound(corners.len(), 1 << 24)];
            let len = encode_index_buffer(&mut triangles, &corners, IndexEncodingVersion::V1).unwrap();
            triangles.truncate(len);
            let kinds = [Mode::Attributes, Mode::Triangles, Mode::Indices];
            let headed = [0xa0, 0xe1, 0xd1].map(|header| [&[header][..], &noise].concat());
            for mut bytes in [encoded::<12>(&content), triangles].into_iter().chain(headed) {
                for (at, byte) in &hits {
                    let at = at.index(bytes.len());
                    bytes[at] = *byte;
                }
                if let Some(cut) = cut {
                    bytes.truncate(cut.index(bytes.len()));
                }
                for mode in kinds {
                    for (count, stride) in [(count, stride), (content.len() / 12, 12), (corners.len(), 4)] {
                        if let Ok(decoded) = of(mode, stride, count).decode(&bytes) {
                            prop_assert_eq!(decoded.len(), count * stride);
                        }
                    }
                }
            }
        }
    }
}
