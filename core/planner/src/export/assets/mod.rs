//! Links as assets: the parts of edges that a NavMesh cannot walk, in files that engines import. A link leads from the
//! take-off of a body to its landing. Bodies walk the rest of the edge on the NavMesh.
//!
//! [`LinkSet::of`] makes links of a graph and the measured [`Shape`]s of its edges; `formats` and `godot` write them.
//! Callers measure the shapes. docs/guides/links.md describes the formats.

mod axes;
mod connected;
mod formats;
mod godot;

pub use axes::Axes;
pub use connected::Connected;

use crate::export::links::{NavMesh, expected_seconds};
use crate::graph::{Edge, NavGraph};
use crate::ids::EdgeKey;
use crate::price::{Caution, price};
use std::collections::BTreeMap;
use std::sync::Arc;
use strum::VariantArray;
use surefoot_world::character::OwnMove;
use surefoot_world::map::LevelFrame;
use surefoot_world::{Ability, Chance, DECISION_SECONDS, Decisions, Vec3};

/// One leap: off the ground by one move, until the body stands again.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Leap {
    /// The ability by which the body leaves the ground and flies; [`Ability::WALK`] for a drop.
    pub ability: Ability,
    /// Last position of the feet on the ground, m, or the centre of a device.
    pub take_off: Vec3,
    /// Highest position of the feet, m.
    pub apex: Vec3,
    /// First position of the feet on the ground again, m.
    pub landing: Vec3,
    /// Duration, s.
    pub seconds: f32,
    /// Horizontal speed at take-off, m/s.
    pub speed: f32,
    /// Time from take-off to a jump in the air, s; `None` if there is none.
    pub second_jump: Option<f32>,
}

/// A part of a run along an edge that a NavMesh cannot walk: leaps, with ground between them that is not on the
/// NavMesh.
#[derive(Debug, Clone, PartialEq)]
pub struct Passage {
    /// Position of the feet at the start, m.
    pub start: Vec3,
    /// Position of the feet at the end, m.
    pub end: Vec3,
    /// The leaps, in order; empty if the body walks on ground that is not on the NavMesh.
    pub leaps: Vec<Leap>,
    /// Duration, s.
    pub seconds: f32,
    /// Share of the tries of a plain scripted controller that got through, in [0, 1].
    pub driven: f32,
}

impl Passage {
    /// A passage that has just begun at `start`, m.
    pub fn begin(start: Vec3) -> Self {
        Self { start, end: start, leaps: Vec::new(), seconds: 0.0, driven: 0.0 }
    }

    /// The most demanding ability of the leaps.
    pub fn ability(&self) -> Ability {
        self.leaps.iter().map(|leap| leap.ability).max().unwrap_or_default()
    }
}

/// The parts of a run along an edge that are not a walk on the NavMesh.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Shape {
    /// The passages, in order; none if the NavMesh walks the whole edge.
    pub passages: Vec<Passage>,
}

impl Shape {
    /// Estimated chance that a plain scripted controller gets through all passages, in [0, 1].
    pub fn driven(&self) -> f32 {
        self.passages.iter().map(|passage| passage.driven).product()
    }
}

/// An edge with its shape.
#[derive(Debug, Clone)]
pub struct ShapedEdge<'g> {
    /// The edge.
    pub edge: &'g Edge,
    /// The shape of a run along it.
    pub shape: Shape,
}

/// A link of a NavMesh; it leads one way.
#[derive(Debug, Clone, PartialEq)]
pub struct Link {
    /// Index of its edge in the graph's JSON export.
    pub edge_idx: u32,
    /// The edge.
    pub edge: EdgeKey,
    /// The part of the run that the link replaces.
    pub passage: Passage,
    /// The most demanding ability.
    pub ability: Ability,
    /// Estimated chance that an NPC with the policy gets through, in (0, 1].
    pub chance: f64,
    /// The cost that a search should minimise, s: the expected duration with the cost of failures and a term for
    /// risk, times the designers' factor.
    pub cost_seconds: f64,
}

impl Link {
    /// The cost as the length of a walk at `speed`, m/s, that takes as long; m.
    fn cost_metres(&self, speed: f32) -> f32 {
        self.cost_seconds as f32 * speed
    }

    /// The ratio of this length to the distance between the ends of the link.
    fn cost_ratio(&self, speed: f32) -> f32 {
        const SHORTEST_M: f32 = 0.1;
        self.cost_metres(speed) / self.passage.start.distance(self.passage.end).max(SHORTEST_M)
    }
}

/// The links of a graph.
#[derive(Debug, Clone, PartialEq)]
pub struct LinkSet {
    /// The links, by edge, and in the order of a run along the edge.
    pub links: Vec<Link>,
    /// Radius of the agents, m.
    pub radius: f32,
    /// Speed of the agents, m/s.
    pub speed: f32,
    /// The shares of pairs that the links connect.
    pub connected: Connected,
    /// How the level's own coordinates relate to the map's, if known.
    pub frame: Option<LevelFrame>,
    /// Moves of the body's own.
    pub moves: Arc<[OwnMove]>,
}

/// Floor for edges that no trial drove: 8 tries cannot show less than 1/16.
const LEAST_DRIVEN: f64 = 1.0 / 16.0;

impl LinkSet {
    /// Makes links of the edges among `shaped` that are worth one at `max_detour` ([`NavMesh::spanner`]); without
    /// `max_detour`, of all. `island_at` returns the island of the NavMesh at a place.
    pub fn of(
        graph: &NavGraph,
        shaped: &[ShapedEdge<'_>],
        nav_mesh: NavMesh<'_>,
        max_detour: Option<f64>,
        island_at: &dyn Fn(Vec3) -> Option<u32>,
    ) -> Self {
        let kept: Vec<&ShapedEdge<'_>> = match max_detour {
            None => shaped.iter().collect(),
            Some(max_detour) => {
                let candidates: Vec<(EdgeKey, f64)> = shaped.iter().map(|it| (it.edge.key, it.seconds())).collect();
                let kept = nav_mesh.spanner(graph, &candidates, max_detour);
                shaped.iter().filter(|it| kept.contains(&it.edge.key)).collect()
            }
        };
        let idx_of: BTreeMap<EdgeKey, u32> = graph.edges().map(|edge| edge.key).zip(0..).collect();
        let links: Vec<Link> = kept.iter().flat_map(|it| it.links(idx_of[&it.edge.key])).collect();
        let joins = links.iter().map(|link| (island_at(link.passage.start), island_at(link.passage.end)));
        let connected = Connected::of(nav_mesh.islands, joins);
        Self {
            links,
            radius: nav_mesh.radius,
            speed: nav_mesh.speed,
            connected,
            frame: None,
            moves: graph.moves().clone(),
        }
    }
}

impl ShapedEdge<'_> {
    /// The cost of following the edge by script, s: its expected duration, divided by the share of a plain
    /// controller's tries that get through.
    fn seconds(&self) -> f64 {
        expected_seconds(self.edge) / f64::from(self.shape.driven()).max(LEAST_DRIVEN)
    }

    /// A link for each passage; they share the edge's chances evenly.
    fn links(&self, edge_idx: u32) -> Vec<Link> {
        let Self { edge, shape } = self;
        let evidence = &edge.evidence;
        let share = 1.0 / shape.passages.len().max(1) as f64;
        let part = |chance: f64| libm::pow(chance, share);
        let chance = part(evidence.chance().get());
        let death_chance = (1.0 - part(1.0 - evidence.death_chance())).min(1.0 - chance);
        let link = |passage: &Passage| {
            let decisions = Decisions(f64::from(passage.seconds) / f64::from(DECISION_SECONDS));
            let cost = price(decisions, Chance::new(chance), death_chance, Caution::CAREFUL);
            Link {
                edge_idx,
                edge: edge.key,
                passage: passage.clone(),
                ability: passage.ability(),
                chance,
                cost_seconds: f64::from(evidence.price_factor) * cost * f64::from(DECISION_SECONDS),
            }
        };
        shape.passages.iter().map(link).collect()
    }
}

/// Format of a file of links.
#[derive(Debug, Clone, Copy, PartialEq, Eq, strum::VariantArray, strum::IntoStaticStr)]
#[strum(serialize_all = "lowercase")]
pub enum AssetFormat {
    /// Off-mesh connections as JSON, in the fields of Detour.
    Detour,
    /// A Godot 4 scene with `NavigationLink3D` nodes.
    Godot,
    /// JSON for `NavMeshLink` components of Unity.
    Unity,
    /// JSON for simple links of a `NavLinkProxy` of Unreal Engine.
    Unreal,
    /// JSON with the fields of `AnimationLink` of the crate landmass.
    Landmass,
    /// All fields of the links, as JSON.
    Links,
}

impl AssetFormat {
    /// All formats.
    pub const ALL: &[Self] = Self::VARIANTS;

    /// Returns the name that commands use.
    pub fn name(self) -> &'static str {
        self.into()
    }

    /// Writes links in this format.
    pub fn write(self, set: &LinkSet) -> String {
        match self {
            Self::Detour => formats::detour(set),
            Self::Godot => godot::scene(set),
            Self::Unity => formats::unity(set),
            Self::Unreal => formats::unreal(set),
            Self::Landmass => formats::landmass(set),
            Self::Links => formats::plain(set),
        }
    }
}
