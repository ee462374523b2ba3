//! Pairs the nodes at the two ends of zip lines, teleporters and ways by their names.

use crate::scene::Node;
use std::collections::HashMap;
use surefoot_world::Vec3;
use surefoot_world::map::DeviceKind;

/// An end of a zip line, teleporter or way.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum End {
    From,
    To,
}

impl End {
    pub(super) fn name(self) -> &'static str {
        match self {
            End::From => "from",
            End::To => "to",
        }
    }

    /// The name that the node at the other end should have, of one at this end.
    pub(super) fn name_of_other(self, name: &str) -> String {
        // The end is ASCII and comes last, except for the number of a copy.
        let at = name.to_ascii_lowercase().rfind(self.name()).unwrap_or(name.len());
        let (stem, rest) = name.split_at(at);
        format!("{stem}{}{}", self.other().name(), rest.get(self.name().len()..).unwrap_or_default())
    }

    fn other(self) -> Self {
        match self {
            End::From => End::To,
            End::To => End::From,
        }
    }
}

/// Splits `zip_line_3:from` into its end and `zip_line_3`. A number that a tool appended to a copy (`:from.001`)
/// becomes part of the name of the pair.
pub(super) fn split_end(name: &str) -> Option<(End, String)> {
    let (stem, copy) = match name.rsplit_once('.') {
        Some((stem, digits)) if !digits.is_empty() && digits.bytes().all(|byte| byte.is_ascii_digit()) => {
            (stem, digits)
        }
        _ => (name, ""),
    };
    [End::From, End::To].into_iter().find_map(|end| {
        let stem = stem.strip_suffix(end.name())?.strip_suffix([':', '_', '-', '.', ' '])?;
        Some((end, format!("{stem}.{copy}")))
    })
}

/// Pairs of ends, in the order in which each pair was first seen.
#[derive(Default)]
pub(super) struct Pairs<'a> {
    pairs: Vec<[Option<Half<'a>>; 2]>,
    numbers: HashMap<String, usize>,
}

/// What has two ends.
#[derive(Clone)]
pub(super) enum Paired {
    Device(DeviceKind),
    /// A spot with this tag.
    Spot(String),
}

/// A node at one end.
#[derive(Clone)]
pub(super) struct Half<'a> {
    pub(super) node: &'a Node,
    pub(super) kind: Paired,
    pub(super) at: Vec3,
    pub(super) two_way: bool,
}

impl<'a> Pairs<'a> {
    /// Adds one end of a pair, of which there is only one.
    pub(super) fn add(&mut self, name: String, end: End, half: Half<'a>) {
        let idx = *self.numbers.entry(name).or_insert_with(|| {
            self.pairs.push([const { None }; 2]);
            self.pairs.len() - 1
        });
        self.pairs[idx][end as usize] = Some(half);
    }

    /// The complete pairs, each with its name for messages: what it is, its two places, m, and whether both are
    /// entrances.
    pub(super) fn finish(self) -> impl Iterator<Item = (String, Paired, [Vec3; 2], bool)> {
        self.pairs.into_iter().filter_map(|[from, to]| {
            let (from, to) = from.zip(to)?;
            let name = format!("node `{}` or `{}`", from.node.name, to.node.name);
            Some((name, from.kind, [from.at, to.at], from.two_way || to.two_way))
        })
    }
}
