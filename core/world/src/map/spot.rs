//! [`Spot`]: a place of a map with a meaning: for the moves that bodies define, an anchor or the two ends of a way, or
//! where play begins.

use crate::Vec3;
use serde::{Deserialize, Serialize};

/// Longest tag of a spot and longest name of a move, bytes.
pub const MAX_TAG_LEN: usize = 32;
/// Tag of the places to which bodies pull themselves.
pub const ANCHOR: &str = "anchor";
/// Tag of the places where play begins.
pub const SPAWN: &str = "spawn";

/// A place for moves that bodies define, or where play begins.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Spot {
    /// What moves call it, as [`is_tag`] allows.
    pub tag: String,
    /// The place, or where a way begins, m.
    pub from: Vec3,
    /// Where a way ends, m; `None` for a single place.
    pub to: Option<Vec3>,
    /// Whether the way can be taken from its end as well.
    pub two_way: bool,
}

impl Spot {
    /// Its ways: from where to where, m. A single place has none.
    pub fn ways(&self) -> impl Iterator<Item = [Vec3; 2]> {
        let back = self.to.filter(|_| self.two_way).map(|to| [to, self.from]);
        self.to.map(|to| [self.from, to]).into_iter().chain(back)
    }

    /// Its places, m: one or two.
    pub fn ends(&self) -> impl Iterator<Item = Vec3> {
        std::iter::once(self.from).chain(self.to)
    }
}

/// Whether a text can be a tag, or the name of a move: 1 to [`MAX_TAG_LEN`] lower-case letters, digits and `_`, a
/// letter first.
pub fn is_tag(text: &str) -> bool {
    let is_part = |letter: u8| letter.is_ascii_lowercase() || letter.is_ascii_digit() || letter == b'_';
    (1..=MAX_TAG_LEN).contains(&text.len())
        && text.starts_with(|letter: char| letter.is_ascii_lowercase())
        && text.bytes().all(is_part)
}
