//! Decoding of attributes: elements of a fixed length, stored as differences from their predecessors.

use crate::meshopt::bytes::{Bytes, unfolded};

/// Longest element, bytes.
const MAX_STRIDE: usize = 256;
/// Most elements of a block, and the elements of a group in it.
const MAX_BLOCK: usize = 256;
const GROUP: usize = 16;
/// Most bytes of the elements of a block.
const MAX_BLOCK_BYTES: usize = 8192;
/// Bytes of a channel: neighbouring bytes of an element whose differences are combined.
const CHANNEL: usize = 4;

/// How the differences of one byte position are stored in a block.
#[derive(Clone, Copy)]
enum Control {
    /// All are 0, and nothing is stored.
    Zero,
    /// One byte each.
    Bytes,
    /// In groups, each with one of these widths, in bits.
    Groups([u32; 4]),
}

/// How a difference changes the previous value of a channel.
#[derive(Clone, Copy)]
enum Change {
    /// It is added byte by byte.
    Bytes,
    /// It is added as two 16-bit numbers.
    Words,
    /// It flips bits, after a rotation to the right by this many bits.
    Flip(u32),
}

/// Decodes `count` elements of `stride` bytes each.
pub(super) fn attributes(count: usize, stride: usize, bytes: &[u8]) -> Option<Vec<u8>> {
    if stride == 0 || stride > MAX_STRIDE || !stride.is_multiple_of(CHANNEL) {
        return None;
    }
    let (header, rest) = bytes.split_first()?;
    let channel_count = stride / CHANNEL;
    // The blocks are followed by the element before the first one, and by the channels' kinds. Padding precedes both.
    let (tail_len, min_tail_len) = match header {
        0xa0 => (stride, 32),
        0xa1 => (stride + channel_count, 24),
        _ => return None,
    };
    let blocks_len = rest.len().checked_sub(tail_len.max(min_tail_len))?;
    let (last, kinds) = rest[rest.len() - tail_len..].split_at(stride);
    let change = |idx: usize| kinds.get(idx).map_or(Some(Change::Bytes), |kind| Change::of(*kind));
    let changes = (0..channel_count).map(change).collect::<Option<_>>()?;
    let bytes = Bytes(&rest[..blocks_len]);
    let mut state = Blocks { bytes, is_version_0: *header == 0xa0, changes, last: last.to_vec() };

    let most = (MAX_BLOCK_BYTES / stride / GROUP * GROUP).min(MAX_BLOCK);
    // Each block has at least a byte for each channel.
    if count.div_ceil(most).saturating_mul(channel_count) > blocks_len {
        return None;
    }
    let mut elements = vec![0; count.checked_mul(stride)?];
    for block in elements.chunks_mut(most * stride) {
        state.decode(block)?;
    }
    state.bytes.0.is_empty().then_some(elements)
}

/// The state from which the next block is decoded.
struct Blocks<'a> {
    bytes: Bytes<'a>,
    is_version_0: bool,
    /// For each channel of an element.
    changes: Vec<Change>,
    /// The element before the next block.
    last: Vec<u8>,
}

impl Blocks<'_> {
    /// Decodes a block. Its differences are stored by byte position: those of all first bytes come first.
    fn decode(&mut self, block: &mut [u8]) -> Option<()> {
        let stride = self.last.len();
        let count = block.len() / stride;
        let controls = if self.is_version_0 { &[] } else { self.bytes.take(self.changes.len())? };
        let mut planes = [[0; MAX_BLOCK]; CHANNEL];
        for (channel, change) in self.changes.iter().enumerate() {
            for (at, plane) in planes.iter_mut().enumerate() {
                let control = controls.get(channel).map_or(Control::VERSION_0, |bits| Control::of(bits >> (2 * at)));
                read_plane(&mut self.bytes, control, count, plane)?;
            }
            let at = channel * CHANNEL;
            let last = self.last[at..].first_chunk_mut()?;
            for (idx, element) in block.chunks_exact_mut(stride).enumerate() {
                *last = change.apply(*last, std::array::from_fn(|at| planes[at][idx]));
                element[at..at + CHANNEL].copy_from_slice(last);
            }
        }
        Some(())
    }
}

impl Control {
    const VERSION_0: Self = Self::Groups([0, 2, 4, 8]);

    /// What the lowest two bits stand for.
    fn of(bits: u8) -> Self {
        match bits & 3 {
            0 => Self::Groups([0, 1, 2, 4]),
            1 => Self::Groups([1, 2, 4, 8]),
            2 => Self::Zero,
            _ => Self::Bytes,
        }
    }
}

impl Change {
    /// What a kind of channel stands for.
    fn of(kind: u8) -> Option<Self> {
        match kind {
            0 => Some(Self::Bytes),
            1 => Some(Self::Words),
            _ if kind & 15 == 2 => Some(Self::Flip(u32::from(kind >> 4))),
            _ => None,
        }
    }

    fn apply(self, last: [u8; CHANNEL], difference: [u8; CHANNEL]) -> [u8; CHANNEL] {
        match self {
            Self::Bytes => std::array::from_fn(|at| last[at].wrapping_add(unfolded(difference[at].into()) as u8)),
            Self::Words => {
                let word = |bytes: [u8; CHANNEL], at: usize| u16::from_le_bytes([bytes[at], bytes[at + 1]]);
                let sum = |at| word(last, at).wrapping_add(unfolded(word(difference, at).into()) as u16).to_le_bytes();
                let ([a, b], [c, d]) = (sum(0), sum(2));
                [a, b, c, d]
            }
            Self::Flip(by) => {
                (u32::from_le_bytes(last) ^ u32::from_le_bytes(difference).rotate_right(by)).to_le_bytes()
            }
        }
    }
}

/// Reads the differences of one byte position of `count` elements.
fn read_plane(bytes: &mut Bytes<'_>, control: Control, count: usize, plane: &mut [u8; MAX_BLOCK]) -> Option<()> {
    match control {
        Control::Zero => plane[..count].fill(0),
        Control::Bytes => plane[..count].copy_from_slice(bytes.take(count)?),
        Control::Groups(widths) => {
            let group_count = count.div_ceil(GROUP);
            let chosen = bytes.take(group_count.div_ceil(4))?;
            for (number, group) in plane.as_chunks_mut().0[..group_count].iter_mut().enumerate() {
                let width = widths[usize::from(chosen[number / 4] >> (2 * (number % 4)) & 3)];
                *group = read_group(bytes, width)?;
            }
        }
    }
    Some(())
}

/// Reads the differences of a group, of 0, 1, 2, 4 or 8 bits each. For those of 1, 2 or 4 bits that are all ones, a
/// byte follows after the group.
fn read_group(bytes: &mut Bytes<'_>, width: u32) -> Option<[u8; GROUP]> {
    let mut differences = [0; GROUP];
    let packed = bytes.take(GROUP * width as usize / 8)?;
    match width {
        0 => return Some(differences),
        8 => return packed.first_chunk().copied(),
        _ => {}
    }
    let (per_byte, most) = (8 / width, (1 << width) - 1);
    for (idx, difference) in (0..).zip(&mut differences) {
        // Single bits begin with the lowest one of a byte, wider ones with the highest ones.
        let place = if width == 1 { idx % 8 } else { per_byte - 1 - idx % per_byte };
        *difference = packed[(idx / per_byte) as usize] >> (width * place) & most;
        if *difference == most {
            *difference = bytes.byte()?;
        }
    }
    Some(differences)
}
