//! Decoding of indices: those of triangles, and others.

use crate::meshopt::bytes::{Bytes, unfolded};

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
        self.last = self.last.wrapping_add(unfolded(self.bytes.number()?));
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
pub(super) fn triangles(count: usize, stride: usize, bytes: &[u8]) -> Option<Vec<u8>> {
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
pub(super) fn indices(count: usize, stride: usize, bytes: &[u8]) -> Option<Vec<u8>> {
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
