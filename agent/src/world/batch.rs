//! Batches of observations and actions on the wire: the only wire code of a world's task.

use super::npc::Npcs;
use super::standing::Standing;
use prost::Message;
use std::collections::BTreeSet;
use surefoot_proto::convert::{self, WireEnum};
use surefoot_proto::movement::prediction_to_wire;
use surefoot_proto::plans::npc_plan_to_wire;
use surefoot_proto::wire_enum;
use surefoot_proto::world::v1 as wire;
use surefoot_world::{Action, Arrival, End, Gait, MoverAt, Npc as State, Trajectory, Vec3};

/// Largest answer in one message, bytes; servers accept 1 MiB unless configured.
pub(super) const MAX_ANSWER_BYTES: usize = 512 * 1024;
/// Bytes of a field's tag and length, at most.
const FIELD_BYTES: usize = 6;
/// Bytes of an NPC id and an attempt's number, at most.
const ID_BYTES: usize = 15;

wire_enum!(Standing = wire::Standing: AwaitsMap AwaitsGraph AwaitsPlan AwaitsRehearsal AwaitsMover Barred);

/// The server sent a batch of another shape.
#[derive(Debug, thiserror::Error)]
#[error("the server sent a malformed batch")]
pub(crate) struct Malformed;

/// An NPC that decides.
pub(super) struct Sighting {
    pub id: u64,
    /// Number of its attempt.
    pub attempt: u32,
    /// Position of the feet, m.
    pub feet: Vec3,
    pub goal: Vec3,
    /// What counts as having arrived there.
    pub arrival: Arrival,
    /// How it goes where it can walk.
    pub gait: Gait,
    /// Whether it reached its waypoint since its last decision.
    pub has_reached: bool,
    pub is_grounded: bool,
    /// State of its body and episode; `None` while the map is not known.
    pub state: Option<State>,
}

/// The NPCs that decide together.
pub(super) struct Batch {
    pub tick: u64,
    pub sightings: Vec<Sighting>,
    /// One row for each NPC; empty if the worker observes them itself.
    pub observations: Vec<f32>,
    /// Packed states of the movers.
    pub movers: Vec<u8>,
    /// Packed states of the NPCs, which only a map can unpack.
    pub states: Vec<Vec<u8>>,
    pub state_version: u32,
}

impl Batch {
    /// Decodes a batch with observations of `observation_len` values.
    pub fn decode(batch: wire::ObservationBatch, observation_len: usize) -> Result<Self, Malformed> {
        let count = batch.npc_ids.len();
        let malformed = |_| Malformed;
        let positions = convert::unpack_points(&batch.positions, count, "positions").map_err(malformed)?;
        let goals = convert::unpack_points(&batch.goals, count, "goals").map_err(malformed)?;
        let len = if batch.observations.is_empty() { 0 } else { count * observation_len };
        let observations = convert::unpack(&batch.observations, len, "observations").map_err(malformed)?;
        let gaits: Vec<Gait> = batch.gaits.iter().map(convert::gait).collect::<Result<_, _>>().map_err(malformed)?;
        let sighting = |(idx, &id)| Sighting {
            id,
            attempt: batch.attempts.get(idx).copied().unwrap_or(0),
            feet: positions[idx],
            goal: goals[idx],
            arrival: if batch.touches.get(idx) == Some(&true) { Arrival::Pass } else { Arrival::Stand },
            gait: gaits.get(idx).copied().unwrap_or_default(),
            has_reached: batch.waypoint_reached.get(idx).copied().unwrap_or(false),
            is_grounded: batch.grounded.get(idx).copied().unwrap_or(true),
            state: None,
        };
        let sightings = batch.npc_ids.iter().enumerate().map(sighting).collect();
        let wire::ObservationBatch { tick, movers, states, state_version, .. } = batch;
        Ok(Self { tick, sightings, observations, movers, states, state_version })
    }
}

/// The answer to a batch.
#[derive(Default)]
pub(super) struct Answer {
    /// NPCs that give up their attempts, and why.
    pub gave_up: Vec<(u64, u32, End)>,
    pub calls: BTreeSet<MoverAt>,
    /// One for each NPC of the batch.
    pub actions: Vec<Action>,
    /// Why each NPC of the batch stands.
    pub standings: Vec<Option<Standing>>,
    /// What is predicted of each NPC of the batch.
    pub trajectories: Vec<Trajectory>,
    /// Whether the worker observes these NPCs itself from now on.
    pub observes: bool,
}

impl Answer {
    /// Encodes the answer of a world's task to `batch`, with the new waypoints and plans of its NPCs, in messages of
    /// limited length.
    pub fn encode(self, world_id: u64, batch: &Batch, npcs: &mut Npcs, plans_failed: u32) -> Vec<wire::WorkRequest> {
        let mut answer = wire::ActionBatch {
            world_id,
            tick: batch.tick,
            npc_ids: batch.sightings.iter().map(|seen| seen.id).collect(),
            attempts: batch.sightings.iter().map(|seen| seen.attempt).collect(),
            actions: convert::pack(self.actions.iter().flat_map(|action| action.to_array())),
            plans_failed,
            standings: pack(&self.standings),
            observes: self.observes,
            ..wire::ActionBatch::default()
        };
        for (&Sighting { id: npc_id, attempt, .. }, trajectory) in batch.sightings.iter().zip(&self.trajectories) {
            if !trajectory.is_empty() {
                answer.predictions.push(prediction_to_wire(npc_id, attempt, trajectory));
            }
            let Some(npc) = npcs.get_mut(&npc_id) else { continue };
            if let Some(waypoint) = npc.news.waypoint.take() {
                let position = Some(convert::to_wire(waypoint));
                let stands = npc.attempt.follower.arrival() == Arrival::Stand;
                answer.waypoints.push(wire::Waypoint { npc_id, position, attempt, stands });
            }
            if std::mem::take(&mut npc.news.has_plan) {
                let plan = npc.attempt.follower.current_plan().map(npc_plan_to_wire);
                answer.plans.extend(plan.map(|plan| wire::CarriedPlan { npc_id, plan: Some(plan), attempt }));
            }
        }
        let given_up = |(npc_id, attempt, end)| wire::GivenUp { npc_id, attempt, unreachable: end == End::Unreachable };
        answer.gave_up.extend(self.gave_up.into_iter().map(given_up));
        let call = |call: MoverAt| wire::MoverCall { mover: call.mover.0.into(), stop: call.stop.0.into() };
        answer.mover_calls.extend(self.calls.into_iter().map(call));
        let request = |part| wire::WorkRequest { message: Some(wire::work_request::Message::Actions(part)) };
        split(answer, MAX_ANSWER_BYTES).into_iter().map(request).collect()
    }
}

/// Packs why NPCs stand; empty if none does.
fn pack(standings: &[Option<Standing>]) -> Vec<u8> {
    if standings.iter().all(Option::is_none) {
        return Vec::new();
    }
    let byte = |reason: &Option<Standing>| reason.map_or(wire::Standing::Unspecified, Standing::to_wire) as u8;
    standings.iter().map(byte).collect()
}

/// Splits an answer into messages of at most about `limit` bytes each. A single plan is never larger than that.
fn split(mut answer: wire::ActionBatch, limit: usize) -> Vec<wire::ActionBatch> {
    if answer.encoded_len() <= limit {
        return vec![answer];
    }
    let (world_id, tick, observes) = (answer.world_id, answer.tick, answer.observes);
    let empty = || wire::ActionBatch { world_id, tick, observes, ..wire::ActionBatch::default() };
    let mut parts = Vec::new();
    let mut part = empty();
    let mut part_len = 0;
    let mut make_room = |part: &mut wire::ActionBatch, len: usize| {
        if part_len + len > limit && part_len > 0 {
            parts.push(std::mem::replace(part, empty()));
            part_len = 0;
        }
        part_len += len;
    };
    for plan in std::mem::take(&mut answer.plans) {
        make_room(&mut part, plan.encoded_len() + FIELD_BYTES);
        part.plans.push(plan);
    }
    for waypoint in std::mem::take(&mut answer.waypoints) {
        make_room(&mut part, waypoint.encoded_len() + FIELD_BYTES);
        part.waypoints.push(waypoint);
    }
    for prediction in std::mem::take(&mut answer.predictions) {
        make_room(&mut part, prediction.encoded_len() + FIELD_BYTES);
        part.predictions.push(prediction);
    }
    for given_up in std::mem::take(&mut answer.gave_up) {
        make_room(&mut part, given_up.encoded_len() + FIELD_BYTES);
        part.gave_up.push(given_up);
    }
    let action_bytes = answer.actions.len() / answer.npc_ids.len().max(1);
    for (idx, (&npc_id, &attempt)) in answer.npc_ids.iter().zip(&answer.attempts).enumerate() {
        make_room(&mut part, action_bytes + ID_BYTES + 1);
        part.npc_ids.push(npc_id);
        part.attempts.push(attempt);
        part.actions.extend_from_slice(&answer.actions[idx * action_bytes..][..action_bytes]);
        part.standings.extend(answer.standings.get(idx));
    }
    part.plans_failed = answer.plans_failed;
    part.mover_calls = answer.mover_calls;
    parts.push(part);
    parts
}

#[cfg(test)]
mod tests {
    use super::*;
    use surefoot_world::Body;

    #[test]
    fn a_large_answer_is_split_and_nothing_is_lost() {
        let count = 4096_u64;
        let plan = wire::NpcPlan { waypoints: vec![wire::Vec3 { x: 1.0, y: 2.0, z: 3.0 }; 40], ..Default::default() };
        let answer = wire::ActionBatch {
            world_id: 7,
            tick: 9,
            npc_ids: (0..count).map(|id| u64::MAX - id).collect(),
            actions: (0..count * 16).map(|byte| byte as u8).collect(),
            attempts: (0..count as u32).collect(),
            waypoints: (0..count)
                .map(|npc_id| wire::Waypoint { npc_id, position: None, attempt: 1, stands: true })
                .collect(),
            plans: (0..count)
                .map(|npc_id| wire::CarriedPlan { npc_id, plan: Some(plan.clone()), attempt: 1 })
                .collect(),
            gave_up: vec![wire::GivenUp { npc_id: 1, attempt: 1, unreachable: true }],
            plans_failed: 3,
            mover_calls: vec![wire::MoverCall { mover: 2, stop: 1 }],
            standings: (0..count).map(|idx| idx as u8 % 9).collect(),
            predictions: (0..count)
                .map(|npc_id| prediction_to_wire(npc_id, 1, &Trajectory::at_rest(&Body::default())))
                .collect(),
            observes: true,
        };
        assert!(answer.encoded_len() > 2 << 20);
        let parts = split(answer.clone(), MAX_ANSWER_BYTES);
        assert!(parts.len() > 3 && parts.iter().all(|part| part.encoded_len() <= MAX_ANSWER_BYTES));
        let mut whole = parts[0].clone();
        for part in &parts[1..] {
            assert_eq!((part.world_id, part.tick, part.observes), (7, 9, true));
            whole.npc_ids.extend(&part.npc_ids);
            whole.actions.extend(&part.actions);
            whole.attempts.extend(&part.attempts);
            whole.waypoints.extend(part.waypoints.iter().cloned());
            whole.plans.extend(part.plans.iter().cloned());
            whole.gave_up.extend(part.gave_up.iter().cloned());
            whole.plans_failed += part.plans_failed;
            whole.mover_calls.extend(&part.mover_calls);
            whole.standings.extend(&part.standings);
            whole.predictions.extend(part.predictions.iter().cloned());
        }
        assert_eq!(whole, answer);
        assert_eq!(split(parts[0].clone(), MAX_ANSWER_BYTES), [parts[0].clone()], "a small one stays whole");
    }
}
