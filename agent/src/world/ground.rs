//! The copy of a world in which its NPCs rehearse.

use super::batch::Batch;
use crate::maps::{Arrival, Maps, Pace};
use std::sync::Arc;
use std::time::{Duration, Instant};
use surefoot_policy::Policy;
use surefoot_rollout::rehearse::{Forecast, Rehearsal, RehearsalFailure, RehearsalStart};
use surefoot_world::{CharacterProfile, Map, MoverState, NPC_STATE_VERSION, Npc as State, TaskConfig};
use tokio::sync::watch;
use tokio::task::JoinError;

/// Longest wait for the map: NPCs that act without rehearsals die where ground ends.
const MAP_LIMIT: Duration = Duration::from_secs(120);

/// The map on which a world's NPCs rehearse.
pub(crate) struct RehearsalMap {
    /// The worker's maps, and the pace that all realtime worlds share.
    pub maps: Arc<Maps>,
    pub map: watch::Receiver<Arrival>,
    /// When the map was requested.
    pub requested: Instant,
    /// The body of the NPCs.
    pub body: CharacterProfile,
}

/// Where a world's NPCs rehearse.
pub(super) struct RehearsalGround {
    policy: Policy,
    is_lockstep: bool,
    /// `None` if NPCs do not rehearse.
    source: Option<RehearsalMap>,
    /// Made once the map has arrived.
    rehearsal: Option<Rehearsal>,
}

impl RehearsalGround {
    pub fn new(policy: Policy, is_lockstep: bool, source: Option<RehearsalMap>) -> Self {
        Self { policy, is_lockstep, source, rehearsal: None }
    }

    /// Rehearses on another map from now on.
    pub fn change_map(&mut self, map: watch::Receiver<Arrival>) {
        if let Some(source) = &mut self.source {
            (source.map, source.requested) = (map, Instant::now());
            self.rehearsal = None;
        }
    }

    /// Whether NPCs can rehearse now.
    pub fn is_ready(&self) -> bool {
        self.rehearsal.is_some()
    }

    /// Whether NPCs will never rehearse.
    pub fn is_absent(&self) -> bool {
        self.source.is_none()
    }

    /// Whether NPCs stand still because the map is on its way.
    pub fn awaits_map(&self) -> bool {
        let is_awaited = |source: &RehearsalMap| {
            matches!(*source.map.borrow(), Arrival::Awaited) && source.requested.elapsed() < MAP_LIMIT
        };
        !self.is_lockstep && self.source.as_ref().is_some_and(is_awaited)
    }

    /// The map, once it has arrived.
    pub fn map(&self) -> Option<&Arc<Map>> {
        self.rehearsal.as_ref().map(Rehearsal::map)
    }

    /// The body of the NPCs.
    pub fn body(&self) -> Option<&CharacterProfile> {
        self.source.as_ref().map(|source| &source.body)
    }

    /// The states of the movers of a batch; none if there are none, or the map has not arrived.
    pub fn movers(&self, bytes: &[u8]) -> Vec<MoverState> {
        self.map().and_then(|map| MoverState::unpack(bytes, map)).unwrap_or_default()
    }

    /// Unpacks the states of a batch's NPCs as soon as the map has arrived. A lockstep world waits for the map.
    pub async fn read_states(&mut self, batch: &mut Batch) {
        if batch.state_version != NPC_STATE_VERSION {
            return;
        }
        self.prepare().await;
        let Some(map) = self.map() else { return };
        let zip_line_count = map.placed().zip_lines.len();
        for (seen, bytes) in batch.sightings.iter_mut().zip(&batch.states) {
            seen.state = State::from_bytes(bytes, 1, zip_line_count);
        }
    }

    async fn prepare(&mut self) {
        let Some(source) = self.source.as_mut().filter(|_| self.rehearsal.is_none()) else { return };
        if self.is_lockstep {
            let arrived = source.map.wait_for(|arrival| !matches!(arrival, Arrival::Awaited));
            let _ = tokio::time::timeout(MAP_LIMIT, arrived).await;
        }
        let arrival = source.map.borrow().clone();
        match arrival {
            Arrival::Here(held) => {
                let (map, body) = (held.map().clone(), source.body.clone());
                self.rehearsal = Some(Rehearsal::new(map, body, TaskConfig::default(), &self.policy));
            }
            Arrival::Awaited if !self.is_lockstep => {}
            Arrival::Awaited | Arrival::Never => self.source = None,
        }
    }

    /// How many rehearsals the world can afford now.
    pub fn affordable(&self) -> usize {
        self.pace().map_or(usize::MAX, Pace::affordable)
    }

    fn pace(&self) -> Option<&Pace> {
        self.source.as_ref().filter(|_| !self.is_lockstep).map(|source| &source.maps.pace)
    }

    /// Runs rehearsals on a blocking thread; none if NPCs cannot rehearse.
    pub async fn run(
        &mut self,
        starts: Vec<RehearsalStart>,
        movers: &[MoverState],
    ) -> Result<Vec<Result<Forecast, RehearsalFailure>>, JoinError> {
        let Some(mut rehearsal) = self.rehearsal.take() else { return Ok(Vec::new()) };
        let (policy, movers) = (self.policy.clone(), movers.to_vec());
        let started = Instant::now();
        let task = tokio::task::spawn_blocking(move || {
            let results = rehearsal.run(&policy, starts, &movers);
            (rehearsal, results)
        });
        let (returned, results) = task.await?;
        self.rehearsal = Some(returned);
        if let Some(pace) = self.pace() {
            pace.spend(started.elapsed());
        }
        Ok(results)
    }

    /// Observes NPCs in these states; no rows if NPCs cannot rehearse.
    pub fn observe(&mut self, states: &[State], movers: &[MoverState]) -> Vec<f32> {
        self.rehearsal.as_mut().map(|rehearsal| rehearsal.observe(states, movers)).unwrap_or_default()
    }

    /// Lets the observation of an NPC show its new waypoint.
    pub fn aim_at(&self, state: &State, waypoint: surefoot_world::Vec3, row: &mut [f32]) {
        if let Some(rehearsal) = &self.rehearsal {
            rehearsal.aim_at(state, waypoint, row);
        }
    }
}
