//! Rehearsals of a worker's NPCs: of the next legs of their plans, and of the way straight to the goal while they have none.

use super::{Graph, MAX_QUERIES, Npc, Stage, State, WorldError, WorldTask};
use crate::ahead::{Arrival, Pace};
use std::collections::BTreeSet;
use std::sync::Arc;
use std::time::{Duration, Instant};
use surefoot_rollout::Style;
use surefoot_rollout::rehearse::{Actor, Ghost, Mishap, Next, Rehearsal, Tally};
use surefoot_world::{MoverState, NPC_STATE_VERSION, TaskConfig};

/// Longest wait for the map: NPCs that go without having rehearsed die where ground ends.
const MAP_LIMIT: Duration = Duration::from_secs(120);
/// Decisions for which NPCs of realtime worlds stand still while their first plan is on its way.
const PLAN_DECISIONS: u32 = 3;
/// The same while the graph is on its way.
const GRAPH_DECISIONS: u32 = 60;
/// Decisions for which NPCs of realtime worlds stand still until it is their turn to rehearse.
const TURN_DECISIONS: u32 = 9;
/// Decisions after which an NPC that came to harm without a plan, in a rehearsal, tries again.
const RETRY_DECISIONS: u32 = 12;

impl WorldTask {
    /// The states of a batch's NPCs, if there is something to rehearse on.
    pub(super) async fn states(&mut self, npc_ids: &[u64], bytes: &[Vec<u8>], version: u32) -> Vec<(u64, State)> {
        let Some(stage) = self.stage.as_mut().filter(|_| version == NPC_STATE_VERSION) else {
            return Vec::new();
        };
        if self.rehearsal.is_none() {
            if self.is_lockstep {
                let arrived = stage.map.wait_for(|arrival| !matches!(arrival, Arrival::Awaited));
                let _ = tokio::time::timeout(MAP_LIMIT, arrived).await;
            }
            let arrival = stage.map.borrow().clone();
            match arrival {
                Arrival::Here(held) => {
                    let (map, body) = (held.map().clone(), stage.body.clone());
                    self.rehearsal = Some(Rehearsal::new(map, body, TaskConfig::default(), &self.policy));
                }
                Arrival::Awaited if !self.is_lockstep => return Vec::new(),
                Arrival::Awaited | Arrival::Never => {
                    self.stage = None;
                    return Vec::new();
                }
            }
        }
        let zip_line_count = self.rehearsal.as_ref().map_or(0, |it| it.map().placed().zip_lines.len());
        let states = npc_ids.iter().zip(bytes);
        states.filter_map(|(&id, bytes)| Some((id, State::from_bytes(bytes, 1, zip_line_count)?))).collect()
    }

    /// Rehearses the next legs of all NPCs that are due, until nothing goes wrong any more. In realtime only as many as the pace allows;
    /// the rest has its turn at a later decision. Adds NPCs that find no way to `gave_up`, with their attempts.
    pub(super) async fn rehearse(
        &mut self,
        states: &[(u64, State)],
        movers: &[MoverState],
        gave_up: &mut Vec<(u64, u32)>,
    ) -> Result<(), WorldError> {
        if self.rehearsal.is_none() {
            return Ok(());
        }
        let map = self.rehearsal.as_ref().map(|rehearsal| rehearsal.map().clone());
        let body = self.stage.as_ref().map(|stage| stage.body.clone());
        for (id, state) in states {
            let npc = self.npc(*id);
            let was_foretold = npc.ghost.as_mut().is_some_and(|ghost| ghost.foretold(&state.body));
            if !was_foretold && npc.follower.waypoint().is_some() && !npc.follower.is_barred() {
                (npc.ghost, npc.rehearses_next) = (None, true);
                let around = map.as_ref().zip(body.as_ref()).filter(|_| state.body.is_grounded());
                let regained = around.and_then(|(map, body)| npc.follower.regain(map, body, state.body.feet));
                npc.new_waypoint = regained.or(npc.new_waypoint);
            }
        }
        let pace = self.stage.as_ref().map(|stage| &stage.maps.pace).filter(|_| !self.is_lockstep);
        let affordable = pace.map_or(usize::MAX, Pace::affordable);
        let is_due = |id: &u64| {
            self.npcs
                .get(id)
                .is_some_and(|npc| npc.rehearses_next && !npc.is_planning && npc.follower.waypoint().is_some())
        };
        let mut due: Vec<(u64, State)> = states.iter().filter(|(id, _)| is_due(id)).copied().collect();
        // Those who have waited longest come first, so that everybody has a turn however many there are.
        due.sort_by_key(|(id, _)| std::cmp::Reverse(self.npcs[id].waited));
        due.truncate(affordable);
        let turns: BTreeSet<u64> = due.iter().map(|(id, _)| *id).collect();
        for (id, state) in states {
            let npc = self.npc(*id);
            if turns.contains(id) {
                (npc.rehearses_next, npc.holds, npc.waited) = (false, false, 0);
            } else if npc.rehearses_next && npc.ghost.is_none() {
                npc.waited = npc.waited.saturating_add(1);
                // One that stands still does so until its turn, but not for ever: most legs go well without.
                npc.holds = state.body.is_at_rest() && npc.waited <= TURN_DECISIONS;
            }
        }
        let mut waiting: Vec<(State, u64, Tally)> =
            due.into_iter().map(|(id, state)| (state, id, Tally::default())).collect();
        while !waiting.is_empty() {
            let actors: Vec<Actor> = waiting.iter().map(|(state, id, _)| self.npc(*id).actor(state)).collect();
            let Some(rehearsal) = self.rehearsal.take() else { return Ok(()) };
            let results = self.perform(rehearsal, actors, movers).await?;
            let mut queries = Vec::new();
            let mut results = results.into_iter();
            waiting.retain_mut(|(state, id, tally)| {
                let npc = self.npcs.get_mut(id).expect("met in this batch");
                match results.next().expect("a result for each actor") {
                    Ok(ghost) => {
                        npc.follower.learn_way(ghost.way());
                        npc.ghost = Some(ghost);
                        false
                    }
                    Err(mishap) => {
                        match tally.note(mishap, &mut npc.follower).take(&mut npc.follower, &mut npc.noise) {
                            Next::Again => true,
                            Next::Plan => {
                                queries.push((*id, npc.attempt, state.body.feet));
                                true
                            }
                            Next::Wait => false,
                            Next::Stop => {
                                gave_up.push((*id, npc.attempt));
                                false
                            }
                        }
                    }
                }
            });
            for queries in queries.chunks(MAX_QUERIES) {
                self.request_plans(queries.to_vec(), true).await;
            }
            waiting.retain(|(_, id, _)| {
                let npc = self.npcs.get_mut(id).expect("met in this batch");
                npc.rehearses_next = false;
                npc.follower.waypoint().is_some()
            });
        }
        Ok(())
    }

    /// Whether NPCs stand still because the map is on its way.
    pub(super) fn awaits_map(&self) -> bool {
        let awaited = |stage: &Stage| {
            matches!(*stage.map.borrow(), Arrival::Awaited) && stage.awaited_since.elapsed() < MAP_LIMIT
        };
        !self.is_lockstep && self.stage.as_ref().is_some_and(awaited)
    }

    /// NPCs without a plan head straight for their goals. Before, they wait for the plan, for a while; and where a rehearsal ends in harm,
    /// they stand still until there is one.
    pub(super) async fn rehearse_straight(
        &mut self,
        states: &[(u64, State)],
        movers: &[MoverState],
        npc_ids: &[u64],
    ) -> Result<(), WorldError> {
        let takes_interim = self.takes_interim();
        let is_awaited = |graph: &Arc<Graph>| graph.id_for_plans(takes_interim).is_empty() && !graph.is_resting();
        let awaits_graph = self.graph.as_ref().is_some_and(is_awaited);
        let plan_decisions = if self.is_lockstep { 0 } else { PLAN_DECISIONS };
        let mut begun = BTreeSet::new();
        for id in npc_ids {
            let npc = self.npcs.get_mut(id).expect("met in this batch");
            if npc.follower.is_barred() {
                npc.holds = true;
                continue;
            }
            if npc.follower.waypoint().is_some() {
                npc.holds &= npc.rehearses_next && self.rehearsal.is_some();
                continue;
            }
            npc.unplanned = npc.unplanned.saturating_add(1);
            let patience = if awaits_graph { GRAPH_DECISIONS } else { plan_decisions };
            if npc.unplanned <= patience {
                npc.holds = true;
            } else if npc.unplanned >= npc.next_try {
                begun.insert(*id);
            }
        }
        if begun.is_empty() {
            return Ok(());
        }
        let actors: Vec<(u64, Actor)> = states
            .iter()
            .filter(|(id, _)| begun.contains(id))
            .map(|(id, state)| {
                let npc = self.npcs.get_mut(id).expect("met in this batch");
                npc.noise.change();
                let (hidden, noise) = (npc.memory.clone(), npc.noise);
                (*id, Actor { npc: *state, follower: npc.follower.straight(), hidden, noise, ghost: None })
            })
            .collect();
        // Without a map there is nothing to rehearse on.
        for &id in &begun {
            let npc = self.npc(id);
            (npc.holds, npc.next_try) = (false, u32::MAX);
        }
        let Some(rehearsal) = self.rehearsal.take() else { return Ok(()) };
        let (ids, actors): (Vec<u64>, Vec<Actor>) = actors.into_iter().unzip();
        for (id, result) in ids.into_iter().zip(self.perform(rehearsal, actors, movers).await?) {
            if result.is_err_and(|mishap| mishap.is_harm) {
                let npc = self.npc(id);
                (npc.holds, npc.next_try) = (true, npc.unplanned + RETRY_DECISIONS);
            }
        }
        Ok(())
    }

    /// How each NPC moves in this decision, with its state; `None` for one that moves freely.
    pub(super) fn styles(&self, npc_ids: &[u64], states: &[(u64, State)]) -> Vec<Option<(Style, State)>> {
        // The states are those of some of these NPCs, in the same order.
        let mut states = states.iter().peekable();
        let style = |id: &u64| {
            let (_, state) = states.next_if(|(other, _)| other == id)?;
            let npc = self.npcs.get(id)?;
            let is_known = npc.follower.stays().is_some() || npc.ghost.as_ref().is_some_and(Ghost::is_ahead);
            is_known.then(|| (npc.follower.style(), *state))
        };
        npc_ids.iter().map(style).collect()
    }

    /// Runs rehearsals on a blocking thread, and records what they took.
    async fn perform(
        &mut self,
        mut rehearsal: Rehearsal,
        actors: Vec<Actor>,
        movers: &[MoverState],
    ) -> Result<Vec<Result<Ghost, Mishap>>, WorldError> {
        let (policy, movers) = (self.policy.clone(), movers.to_vec());
        let started = Instant::now();
        let task = tokio::task::spawn_blocking(move || {
            let results = rehearsal.run(&policy, actors, &movers);
            (rehearsal, results)
        });
        let (returned, results) = task.await?;
        self.rehearsal = Some(returned);
        if let Some(stage) = self.stage.as_ref().filter(|_| !self.is_lockstep) {
            stage.maps.pace.spend(started.elapsed());
        }
        Ok(results)
    }

    /// Lets NPCs that have a new waypoint see it in this very decision.
    pub(super) fn aim(&self, states: &[(u64, State)], npc_ids: &[u64], observations: &mut [f32]) {
        let Some(rehearsal) = &self.rehearsal else { return };
        let mut states = states.iter();
        for (id, row) in npc_ids.iter().zip(observations.chunks_exact_mut(self.policy.observation_len())) {
            let Some(waypoint) = self.npcs.get(id).and_then(|npc| npc.new_waypoint) else { continue };
            if let Some((_, state)) = states.find(|(other, _)| other == id) {
                rehearsal.aim(state, waypoint, row);
            }
        }
    }
}

impl Npc {
    fn actor(&mut self, state: &State) -> Actor {
        let ghost = self.ghost.take();
        let (follower, hidden) = (self.follower.clone(), self.memory.clone());
        Actor { npc: *state, follower, hidden, noise: self.noise, ghost }
    }
}
