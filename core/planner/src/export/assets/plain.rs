//! All fields of the links, as JSON on our axes: docs/guides/links.md has the schema.

use super::{About, Axes, Connected, LinkSet, VERSION};
use serde::{Deserialize, Serialize};

#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(super) struct PlainLinks {
    version: u32,
    axes: String,
    /// The level's own origin on the map, if known. Subtract it from positions to get the level's coordinates.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    origin: Option<[f32; 3]>,
    agent: Agent,
    connected: Connected,
    links: Vec<PlainLink>,
}

#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
struct Agent {
    /// m.
    radius: f32,
    /// m/s.
    speed: f32,
}

#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
struct PlainLink {
    start: [f32; 3],
    end: [f32; 3],
    bidirectional: bool,
    #[serde(flatten)]
    about: About,
}

impl PlainLinks {
    pub(super) fn of(set: &LinkSet) -> Self {
        let axes = Axes::Ours;
        let links = set.links.iter().map(|link| PlainLink {
            start: axes.point(link.passage.start),
            end: axes.point(link.passage.end),
            bidirectional: false,
            about: About::of(link, axes),
        });
        Self {
            version: VERSION,
            axes: axes.words().to_owned(),
            origin: set.origin_on(axes),
            agent: Agent { radius: set.radius, speed: set.speed },
            connected: set.connected,
            links: links.collect(),
        }
    }
}
