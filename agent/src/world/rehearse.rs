//! Rehearsals of a world's NPCs: of the next legs of their plans, and of the straight way to the goal while they have
//! no plan.

use super::batch::{Answer, Batch, Sighting};
use super::npc::Npc;
use super::planning::PlanRequest;
use super::{WorldError, WorldTask};
use std::cmp::Reverse;
use std::collections::BTreeSet;
use std::time::Instant;
use surefoot_rollout::attempt::AfterRehearsal;
use surefoot_rollout::rehearse::RehearsalStart;
use surefoot_world::{End, MoverState, Npc as State};

/// Decisions for which NPCs of realtime worlds stand still while their first plan is on its way.
const PLAN_DECISIONS: u32 = 3;
/// Decisions for which NPCs stand still while the graph is on its way.
const GRAPH_DECISIONS: u32 = 60;
/// Distance of a goal, m, to which NPCs set out at once, after a rehearsal of the straight way.
const NEAR_M: f32 = 8.0;
/// Decisions for which NPCs of realtime worlds stand still until it is their turn to rehearse.
const TURN_DECISIONS: u32 = 9;
/// Decisions after which an NPC that came to harm without a plan, in a rehearsal, tries again.
const RETRY_DECISIONS: u32 = 12;

impl WorldTask {
    /// Rehearses the next legs of all NPCs that are due, until nothing goes wrong any more. In realtime the pace limits
    /// the number, and the age of the observations how often a rehearsal that failed is followed by another; the rest
    /// has its turn at a later decision.
    pub(super) async fn rehearse(
        &mut self,
        batch: &Batch,
        movers: &[MoverState],
        answer: &mut Answer,
    ) -> Result<(), WorldError> {
        if !self.ground.is_ready() {
            return Ok(());
        }
        self.check_forecasts(batch);
        let mut due = self.choose_due(batch);
        let chosen = due.clone();
        self.review(&due).await;
        while !due.is_empty() && !self.is_late() {
            let starts: Vec<RehearsalStart> = due
                .iter()
                .map(|seen| {
                    let npc = self.npcs.get_mut(&seen.id).expect("seen in this batch");
                    npc.attempt.rehearsal(seen.state.expect("due NPCs have a state"), npc.memory.clone(), npc.noise)
                })
                .collect();
            let mut results = self.ground.run(starts, movers).await?.into_iter();
            let (mut requests, mut replanned) = (Vec::new(), Vec::new());
            due.retain(|seen| {
                let npc = self.npcs.get_mut(&seen.id).expect("seen in this batch");
                let result = results.next().expect("a result for each rehearsal");
                // Its next plan is on its way, so a failure of the present one is no reason to give up or plan again.
                if npc.planning.is_requested && result.is_err() {
                    seen.state.iter().for_each(|state| npc.wait_for_turn(state));
                    return false;
                }
                match npc.attempt.record_rehearsal(result, &mut npc.noise) {
                    AfterRehearsal::Act => false,
                    AfterRehearsal::Rehearse => true,
                    AfterRehearsal::Plan => {
                        requests.push(PlanRequest { npc_id: seen.id, attempt: npc.number, feet: seen.feet });
                        replanned.push(*seen);
                        true
                    }
                    AfterRehearsal::End => {
                        answer.gave_up.push((seen.id, npc.number, End::Unreachable));
                        false
                    }
                }
            });
            self.planning.request(&requests, &mut self.npcs, true).await;
            self.review(&replanned).await;
            due.retain(|seen| self.npcs.get(&seen.id).is_some_and(|npc| npc.has_waypoint()));
        }
        for seen in due {
            if let Some((state, npc)) = seen.state.zip(self.npcs.get_mut(&seen.id)) {
                npc.attempt.defer_rehearsals();
                npc.wait_for_turn(&state);
            }
        }
        for seen in chosen {
            if let Some((state, npc)) = seen.state.zip(self.npcs.get_mut(&seen.id)) {
                npc.news.waypoint = npc.attempt.changed_waypoint(&state).or(npc.news.waypoint);
            }
        }
        Ok(())
    }

    /// Whether a realtime world must answer now, and leave the rehearsals that remain to the next decision.
    fn is_late(&self) -> bool {
        !self.is_lockstep && Instant::now() >= self.planning.wait_until
    }

    /// Reviews the new plans of NPCs, and requests the further ones that the reviews ask for.
    async fn review(&mut self, new: &[&Sighting]) {
        let mut new = new.to_vec();
        while !new.is_empty() {
            let Some((map, body)) = self.ground.map().zip(self.ground.body()) else { return };
            let rules = &self.planning.rules;
            let mut requests = Vec::new();
            new.retain(|seen| {
                let Some((state, npc)) = seen.state.zip(self.npcs.get_mut(&seen.id)) else { return false };
                let may_cross = |from, to| rules.are_far_from(from, to);
                let asks = npc.attempt.review(map, body, &state.body, may_cross);
                if asks {
                    requests.push(PlanRequest { npc_id: seen.id, attempt: npc.number, feet: seen.feet });
                }
                asks
            });
            self.planning.request(&requests, &mut self.npcs, true).await;
        }
    }

    /// Compares the NPCs with their forecasts. An NPC off its forecast returns to its way, and rehearses again.
    fn check_forecasts(&mut self, batch: &Batch) {
        let (map, body) = (self.ground.map(), self.ground.body());
        for seen in &batch.sightings {
            let (Some(state), Some(npc)) = (&seen.state, self.npcs.get_mut(&seen.id)) else { continue };
            if npc.attempt.check_forecast(&state.body) || !npc.has_waypoint() {
                continue;
            }
            if let Some((map, body)) = map.zip(body).filter(|_| state.body.is_grounded()) {
                let waypoint = npc.attempt.follower.return_to_way(map, body, state.body.feet);
                npc.news.waypoint = waypoint.or(npc.news.waypoint);
            }
        }
    }

    /// The NPCs that rehearse before this decision. An NPC that stands still waits for its turn, but not for ever: most
    /// legs go well without.
    fn choose_due<'b>(&mut self, batch: &'b Batch) -> Vec<&'b Sighting> {
        if let Some((map, profile)) = self.ground.map().zip(self.ground.body()) {
            for seen in &batch.sightings {
                if let Some((state, npc)) = seen.state.zip(self.npcs.get_mut(&seen.id)) {
                    npc.attempt.skip_plain_rehearsal(map, profile, &state.body);
                }
            }
        }
        // An NPC whose next plan is on its way follows the present one, and would move freely without a forecast.
        let awaits_plan = |npc: &Npc| npc.planning.is_requested && !npc.attempt.must_rehearse_from_here();
        let is_due = |seen: &&Sighting| {
            let npc = seen.state.and_then(|_| self.npcs.get(&seen.id));
            npc.is_some_and(|npc| npc.attempt.is_due() && !awaits_plan(npc))
        };
        let mut due: Vec<&Sighting> = batch.sightings.iter().filter(is_due).collect();
        // NPCs that have waited longest come first, so that every NPC has a turn.
        due.sort_by_key(|seen| Reverse(self.npcs[&seen.id].hold.turn_waited));
        due.truncate(self.ground.affordable());
        let turns: BTreeSet<u64> = due.iter().map(|seen| seen.id).collect();
        for seen in &batch.sightings {
            let (Some(state), Some(npc)) = (&seen.state, self.npcs.get_mut(&seen.id)) else { continue };
            if turns.contains(&seen.id) {
                npc.attempt.begin_rehearsals();
                (npc.hold.holds, npc.hold.turn_waited) = (false, 0);
            } else if npc.attempt.must_rehearse_from_here() {
                npc.wait_for_turn(state);
            }
        }
        due
    }

    /// Lets NPCs without a plan head straight for their goals. They first stand still for a while to get a plan, and
    /// where a rehearsal of the straight way ends in harm they stand still until they have one.
    pub(super) async fn rehearse_straight(&mut self, batch: &Batch, movers: &[MoverState]) -> Result<(), WorldError> {
        let plan_decisions = if self.is_lockstep { 0 } else { PLAN_DECISIONS };
        let awaits_graph = self.planning.awaits_graph();
        let patience = if awaits_graph { GRAPH_DECISIONS } else { plan_decisions };
        let is_ready = self.ground.is_ready();
        let mut rehearsed: Vec<(u64, RehearsalStart)> = Vec::new();
        for seen in &batch.sightings {
            let npc = self.npcs.get_mut(&seen.id).expect("seen in this batch");
            let goal = npc.attempt.follower.goal();
            let has_open_way = npc.has_waypoint() || !self.planning.rules.bar(seen.id, [seen.feet, goal]);
            if npc.attempt.follower.is_barred() || !has_open_way {
                npc.hold.holds = true;
                continue;
            }
            if npc.has_waypoint() {
                npc.hold.holds &= npc.attempt.is_due() && is_ready;
                continue;
            }
            npc.hold.unplanned = npc.hold.unplanned.saturating_add(1);
            let is_near = npc.feet.distance(goal) <= NEAR_M;
            if npc.hold.unplanned <= patience && !(is_near && is_ready) {
                npc.hold.holds = true;
            } else if npc.hold.unplanned >= npc.hold.next_try {
                // Without a state there is nothing to rehearse.
                (npc.hold.holds, npc.hold.next_try) = (false, u32::MAX);
                rehearsed.extend(seen.state.map(|state| (seen.id, npc.straight_rehearsal(state))));
            }
        }
        if rehearsed.is_empty() {
            return Ok(());
        }
        let (ids, starts): (Vec<u64>, Vec<RehearsalStart>) = rehearsed.into_iter().unzip();
        for (id, result) in ids.into_iter().zip(self.ground.run(starts, movers).await?) {
            if let (Some(npc), Err(failure)) = (self.npcs.get_mut(&id), result)
                && failure.is_harm
            {
                (npc.hold.holds, npc.hold.next_try) = (true, npc.hold.unplanned + RETRY_DECISIONS);
            }
        }
        Ok(())
    }
}

impl Npc {
    /// Lets an NPC in this state wait for a later decision to rehearse.
    fn wait_for_turn(&mut self, state: &State) {
        self.hold.turn_waited = self.hold.turn_waited.saturating_add(1);
        self.hold.holds = state.body.is_at_rest() && self.hold.turn_waited <= TURN_DECISIONS;
    }

    /// The rehearsal of the straight way to the goal, with other noise each time.
    fn straight_rehearsal(&mut self, npc: State) -> RehearsalStart {
        self.noise.change();
        let (hidden, noise) = (self.memory.clone(), self.noise);
        RehearsalStart { npc, follower: self.attempt.follower.straight(), hidden, noise, forecast: None }
    }
}
