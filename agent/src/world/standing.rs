//! Why NPCs stand, for clients.

use super::npc::Npc;

/// Why an NPC stands, as far as its worker knows.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Standing {
    AwaitsMap,
    AwaitsGraph,
    AwaitsPlan,
    AwaitsRehearsal,
    AwaitsMover,
    Barred,
}

impl Npc {
    /// Why the NPC stands after its decision; `None` if it moves. `awaits_map` and `awaits_graph` are whether the map
    /// and the graph of its world are on their way.
    pub fn standing(&self, awaits_map: bool, awaits_graph: bool) -> Option<Standing> {
        let follower = &self.attempt.follower;
        if follower.is_barred() {
            return Some(Standing::Barred);
        }
        if !self.hold.holds {
            return follower.stay().map(|_| Standing::AwaitsMover);
        }
        Some(if awaits_map {
            Standing::AwaitsMap
        } else if self.has_waypoint() {
            Standing::AwaitsRehearsal
        } else if awaits_graph {
            Standing::AwaitsGraph
        } else {
            Standing::AwaitsPlan
        })
    }
}
