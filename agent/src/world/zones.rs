//! The zones of a world and the tags of its NPCs: what plans respect, and when NPCs need other plans.

use super::npc::Npc;
use std::collections::{BTreeMap, BTreeSet};
use surefoot_planner::{Tags, Zones};
use surefoot_world::Vec3;

/// Changes of zones and tags.
#[derive(Debug, Clone, Default)]
pub(crate) struct ZoneNews {
    /// All zones; `None` if they have not changed.
    pub zones: Option<Zones>,
    /// NPCs with their new tags.
    pub tags: Vec<(u64, Tags)>,
}

/// The zones of a world, and the tags of its NPCs.
#[derive(Default)]
pub(super) struct ZoneRules {
    pub zones: Zones,
    /// Tags of the NPCs that have any.
    tags: BTreeMap<u64, Tags>,
    /// Grows with each change. Plans of an earlier revision are not taken.
    pub revision: u32,
    /// Whether the rules have changed since the last decision: plans are then urgent.
    pub are_new: bool,
}

impl ZoneRules {
    /// The tags of an NPC.
    pub fn tags_of(&self, npc: u64) -> Tags {
        self.tags.get(&npc).cloned().unwrap_or_default()
    }

    /// Whether a zone bars an NPC from a way between two places, m.
    pub fn bar(&self, npc: u64, way: [Vec3; 2]) -> bool {
        !self.zones.is_empty() && self.zones.bars(&self.tags_of(npc), way)
    }

    /// Whether no zone is on the way between two places, m, whomever it concerns.
    pub fn are_far_from(&self, from: Vec3, to: Vec3) -> bool {
        self.zones.iter().all(|zone| zone.shape.length_inside(from, to).is_none())
    }

    /// Whether a zone bars an NPC at `feet`, m, from any leg of its plan ahead.
    pub fn bar_plan(&self, id: u64, feet: Vec3, npc: &Npc) -> bool {
        let ends = npc.attempt.follower.waypoints_ahead();
        let starts = std::iter::once(&feet).chain(ends);
        starts.zip(ends).any(|(start, end)| self.bar(id, [*start, *end]))
    }

    /// Forgets the tags of released NPCs.
    pub fn release(&mut self, npcs: &[u64]) {
        npcs.iter().for_each(|npc| _ = self.tags.remove(npc));
    }

    /// Takes over changes. Returns the NPCs that they concern; `None`: all of them.
    pub fn change(&mut self, ZoneNews { zones, tags }: ZoneNews) -> Option<BTreeSet<u64>> {
        let mut concerned = BTreeSet::new();
        for (npc, tags) in tags {
            if self.tags_of(npc) != tags {
                concerned.insert(npc);
                self.tags.insert(npc, tags);
            }
        }
        let zones = zones.filter(|zones| *zones != self.zones);
        let concerns_all = zones.is_some();
        if concerns_all || !concerned.is_empty() {
            (self.revision, self.are_new) = (self.revision.wrapping_add(1), true);
        }
        if let Some(zones) = zones {
            self.zones = zones;
        }
        (!concerns_all).then_some(concerned)
    }
}
