//! Where a graph comes from: its map, body, settings and policy, and the level of its layers.

use surefoot_net::levels::{BaseMap, MapSource};
use surefoot_planner::edits::Edited;
use surefoot_planner::live::LiveEvidence;
use surefoot_planner::store::LevelId;
use surefoot_planner::{BuildSettings, GraphId, Router};
use surefoot_policy::Policy;
use surefoot_world::{CharacterProfile, Vec3};

/// Distance from the map within which starts and goals may lie, m: characters fall and fly out of maps.
pub const MARGIN_M: f32 = 50.0;

/// Where a graph comes from, and what editing and searching it needs.
#[derive(Debug, Clone)]
pub struct Origin {
    pub id: GraphId,
    pub source: MapSource,
    pub body: CharacterProfile,
    pub settings: BuildSettings,
    /// Content hash of the map, 64 hexadecimal digits.
    pub map_hash: String,
    /// Size of the map, m.
    pub extent: Vec3,
    /// Policy that proved the graph.
    pub policy: Policy,
    pub thread_count: usize,
    /// Largest number of vertices at which the router gets hub labels at once.
    pub label_limit: usize,
}

impl Origin {
    /// Returns the level that layers belong to. The name of an imported level identifies it, so that its layers
    /// outlive changes of its map; the spec identifies a generated map.
    pub fn level(&self) -> LevelId {
        match self.source.base() {
            BaseMap::Spec(spec) => LevelId::of_spec(spec),
            BaseMap::Level(level) => LevelId::of(level.name.as_bytes()),
        }
    }

    /// Prepares an edited graph for queries, with live evidence.
    pub fn router(&self, edited: &Edited, live: &LiveEvidence) -> Router {
        let router = Router::new(live.apply_to(&edited.graph), self.label_limit, self.thread_count);
        router.forbidding(edited.forbidden.iter().copied())
    }
}
