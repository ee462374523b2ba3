//! What the NPCs of one environment are told: where they start, for which places they head, and when they give up.
//!
//! The rules are those of the collector in this process; only that a game carries them out one step later, so an NPC whose attempt has
//! ended waits for a step, whose row is a boundary.

use crate::arena::Arena;
use crate::collector::CollectorStats;
use crate::config::CollectorConfig;
use crate::replay::RowKind;
use rand::RngExt;
use rand::rngs::ChaCha8Rng;
use std::collections::VecDeque;
use surefoot_game_client::drive::seen;
use surefoot_game_client::link::EnvState;
use surefoot_rollout::Goal;
use surefoot_rollout::env::Route;
use surefoot_rollout::goals::random_yaw;
use surefoot_rollout::style::npc_of;
use surefoot_world::{End, Episode, TaskConfig, Vec3};

/// Most places of a route.
const MAX_PLACES: usize = 8;

/// The NPCs of one environment.
pub(super) struct Lanes {
    arena: Arena,
    config: CollectorConfig,
    task: TaskConfig,
    lanes: Vec<Lane>,
    rng: ChaCha8Rng,
}

/// One NPC.
struct Lane {
    /// Places for which it heads, one after another, the current one first.
    waypoints: VecDeque<Vec3>,
    /// Where the attempt at the current place began; `None` if the NPC was not on the ground.
    from: Option<Vec3>,
    episode: Episode,
    /// Places of its route that it had passed before the last step.
    passed: u32,
    /// The route that begins after the next step, whose row is a boundary.
    leaving: Option<Route>,
}

/// What a step was like for the replay buffer.
pub(super) struct Settled {
    pub kinds: Vec<RowKind>,
    pub rewards: Vec<f32>,
    /// NPCs that are at a new start, and have forgotten what was before.
    pub fresh: Vec<usize>,
    pub stats: CollectorStats,
}

impl Lanes {
    /// Draws the first attempts of all NPCs.
    pub fn new(arena: Arena, config: &CollectorConfig, rng: ChaCha8Rng) -> (Self, Vec<Goal>) {
        let (task, lanes) = (TaskConfig::default(), Vec::new());
        let mut crew = Self { arena, config: config.clone(), task, lanes, rng };
        let goals = (0..config.npcs_per_world).map(|npc_idx| {
            let start = crew.arena.random_point(&mut crew.rng);
            let goal = crew.draw_goal(start);
            let yaw = random_yaw(&mut crew.rng);
            let lane = Lane {
                waypoints: VecDeque::from([goal]),
                from: Some(start),
                episode: Episode::new(goal, start),
                passed: 0,
                leaving: None,
            };
            debug_assert_eq!(npc_idx, crew.lanes.len());
            crew.lanes.push(lane);
            Goal { start, yaw, goal }
        });
        let goals = goals.collect();
        (crew, goals)
    }

    /// Routes that go with the next step.
    pub fn routes(&self) -> Vec<Route> {
        self.lanes.iter().filter_map(|lane| lane.leaving.clone()).collect()
    }

    /// Takes note of a step, and decides how the NPCs go on.
    pub fn settle(&mut self, state: &EnvState) -> Settled {
        let count = self.lanes.len();
        let mut settled = Settled {
            kinds: Vec::with_capacity(count),
            rewards: Vec::with_capacity(count),
            fresh: Vec::new(),
            stats: CollectorStats::default(),
        };
        for npc_idx in 0..count {
            let is_waiting = self.lanes[npc_idx].leaving.is_some();
            let kind = if is_waiting {
                if self.arrive(npc_idx, state) {
                    settled.fresh.push(npc_idx);
                }
                RowKind::Boundary
            } else {
                settled.stats.decisions += 1;
                settled.stats.reward += f64::from(state.rewards[npc_idx]);
                self.note(npc_idx, state, &mut settled.stats)
            };
            settled.kinds.push(kind);
            settled.rewards.push(if is_waiting { 0.0 } else { state.rewards[npc_idx] });
        }
        settled
    }

    /// An NPC begins its new route, unless it came to harm meanwhile. Returns whether it is at a new start.
    fn arrive(&mut self, npc_idx: usize, state: &EnvState) -> bool {
        let route = self.lanes[npc_idx].leaving.take().expect("a lane that waits");
        let is_harmed = state.ended[npc_idx].is_some_and(End::is_harm);
        if route.start.is_none() && is_harmed {
            self.respawn(npc_idx);
            return false;
        }
        let feet = state.positions[npc_idx];
        let from = is_grounded(state, npc_idx).then_some(feet);
        let lane = &mut self.lanes[npc_idx];
        lane.from = route.start.map(|(start, _)| start).or(from);
        lane.waypoints = route.waypoints.into();
        lane.episode = Episode::new(lane.waypoints[0], feet);
        lane.passed = state.passed[npc_idx];
        route.start.is_some()
    }

    /// Takes note of the step of an NPC that acted.
    fn note(&mut self, npc_idx: usize, state: &EnvState, stats: &mut CollectorStats) -> RowKind {
        let feet = state.positions[npc_idx];
        let lane = &mut self.lanes[npc_idx];
        let before = std::mem::replace(&mut lane.passed, state.passed[npc_idx]);
        lane.episode.note_tick(feet, &self.task);
        lane.episode.close_decision(&self.task);
        match state.ended[npc_idx] {
            Some(end) if !end.is_truncation() => {
                stats.episodes += 1;
                if end == End::Reached {
                    stats.reached += 1;
                } else {
                    self.note_failure(npc_idx);
                }
                self.respawn(npc_idx);
                RowKind::Terminated
            }
            None if lane.passed > before && lane.waypoints.len() > 1 => {
                stats.episodes += 1;
                stats.reached += 1;
                lane.waypoints.pop_front();
                lane.from = is_grounded(state, npc_idx).then_some(feet);
                lane.episode = Episode::new(lane.waypoints[0], feet);
                RowKind::Terminated
            }
            None if lane.episode.stalled_decisions < self.config.give_up_after => {
                if self.config.redirect_chance > 0.0 && self.rng.random_bool(self.config.redirect_chance) {
                    let waypoints = self.draw_places(feet);
                    self.lanes[npc_idx].leaving = Some(Route { npc_idx, start: None, waypoints });
                }
                RowKind::Continues
            }
            _ => {
                stats.episodes += 1;
                self.note_failure(npc_idx);
                self.respawn(npc_idx);
                RowKind::Continues
            }
        }
    }

    /// Sends an NPC to a new start after the next step.
    fn respawn(&mut self, npc_idx: usize) {
        let yaw = random_yaw(&mut self.rng);
        let does_retry = !self.arena.failures.is_empty() && self.rng.random_bool(self.config.retry_share);
        let (start, waypoints) = if does_retry {
            let (start, goal) = self.arena.take_failure(&mut self.rng);
            (start, vec![goal])
        } else {
            let start = self.arena.random_point(&mut self.rng);
            (start, self.draw_places(start))
        };
        self.lanes[npc_idx].leaving = Some(Route { npc_idx, start: Some((start, yaw)), waypoints });
    }

    /// Places for which an NPC at `from` heads, one after another.
    fn draw_places(&mut self, from: Vec3) -> Vec<Vec3> {
        let mut places = vec![self.draw_goal(from)];
        while places.len() < MAX_PLACES && self.rng.random_bool(self.config.switch_chance) {
            places.push(self.draw_goal(places[places.len() - 1]));
        }
        places
    }

    fn draw_goal(&mut self, from: Vec3) -> Vec3 {
        let near = self.rng.random_bool(self.config.near_share);
        let band = if near { self.config.near_goals } else { self.config.far_goals };
        self.arena.goal(from, band, &mut self.rng)
    }

    /// Stores the running attempt for a retry, if it began on the ground.
    fn note_failure(&mut self, npc_idx: usize) {
        let lane = &self.lanes[npc_idx];
        if let Some(from) = lane.from {
            self.arena.note_failure((from, lane.waypoints[0]), &mut self.rng);
        }
    }
}

fn is_grounded(state: &EnvState, npc_idx: usize) -> bool {
    npc_of(seen(state, npc_idx)).body.is_grounded()
}
