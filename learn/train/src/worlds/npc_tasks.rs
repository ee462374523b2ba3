//! Starts, goals and ends of the attempts of one environment's NPCs.
//!
//! The rules are those of the collector. But a game carries out a new start one step later, so an NPC whose attempt has
//! ended waits for one step. The row of that step is a boundary.

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

/// Most waypoints of a route.
const MAX_WAYPOINTS: usize = 8;

/// The NPCs of one environment.
pub(super) struct NpcTasks {
    arena: Arena,
    config: CollectorConfig,
    task: TaskConfig,
    tasks: Vec<NpcTask>,
    rng: ChaCha8Rng,
}

/// One NPC.
struct NpcTask {
    /// Waypoints in order, the current one first.
    waypoints: VecDeque<Vec3>,
    /// Start of the attempt at the current waypoint; `None` if the NPC was in the air.
    from: Option<Vec3>,
    episode: Episode,
    /// Waypoints of the route that were passed before the last step.
    passed: u32,
    /// The route that begins after the next step; the row of that step is a boundary.
    leaving: Option<Route>,
}

/// A step as the replay buffer stores it.
pub(super) struct Settled {
    pub kinds: Vec<RowKind>,
    pub rewards: Vec<f32>,
    /// NPCs at a new start, whose memory is reset.
    pub fresh: Vec<usize>,
    pub stats: CollectorStats,
}

impl NpcTasks {
    /// Draws the first attempts of all NPCs.
    pub fn new(arena: Arena, config: &CollectorConfig, rng: ChaCha8Rng) -> (Self, Vec<Goal>) {
        let (task, tasks) = (TaskConfig::default(), Vec::new());
        let mut drawn = Self { arena, config: config.clone(), task, tasks, rng };
        let goals = (0..config.npcs_per_world).map(|npc_idx| {
            let start = drawn.arena.random_point(&mut drawn.rng);
            let goal = drawn.draw_goal(start);
            let yaw = random_yaw(&mut drawn.rng);
            let task = NpcTask {
                waypoints: VecDeque::from([goal]),
                from: Some(start),
                episode: Episode::new(goal, start),
                passed: 0,
                leaving: None,
            };
            debug_assert_eq!(npc_idx, drawn.tasks.len());
            drawn.tasks.push(task);
            Goal { start, yaw, goal }
        });
        let goals = goals.collect();
        (drawn, goals)
    }

    /// Routes that go with the next step.
    pub fn routes(&self) -> Vec<Route> {
        self.tasks.iter().filter_map(|task| task.leaving.clone()).collect()
    }

    /// Processes a step, and draws new attempts for the NPCs whose attempts have ended.
    pub fn settle(&mut self, state: &EnvState) -> Settled {
        let count = self.tasks.len();
        let mut settled = Settled {
            kinds: Vec::with_capacity(count),
            rewards: Vec::with_capacity(count),
            fresh: Vec::new(),
            stats: CollectorStats::default(),
        };
        for npc_idx in 0..count {
            let is_waiting = self.tasks[npc_idx].leaving.is_some();
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

    /// Begins an NPC's new route, unless it came to harm meanwhile. Returns whether the NPC is at a new start.
    fn arrive(&mut self, npc_idx: usize, state: &EnvState) -> bool {
        let route = self.tasks[npc_idx].leaving.take().expect("a waiting NPC");
        let is_harmed = state.ended[npc_idx].is_some_and(End::is_harm);
        if route.start.is_none() && is_harmed {
            self.respawn(npc_idx);
            return false;
        }
        let feet = state.positions[npc_idx];
        let from = is_grounded(state, npc_idx).then_some(feet);
        let task = &mut self.tasks[npc_idx];
        task.from = route.start.map(|(start, _)| start).or(from);
        task.waypoints = route.waypoints.into();
        task.episode = Episode::new(task.waypoints[0], feet);
        task.passed = state.passed[npc_idx];
        route.start.is_some()
    }

    /// Processes the step of an NPC that acted.
    fn note(&mut self, npc_idx: usize, state: &EnvState, stats: &mut CollectorStats) -> RowKind {
        let feet = state.positions[npc_idx];
        let task = &mut self.tasks[npc_idx];
        let before = std::mem::replace(&mut task.passed, state.passed[npc_idx]);
        task.episode.note_tick(feet, &self.task);
        task.episode.close_decision(&self.task);
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
            None if task.passed > before && task.waypoints.len() > 1 => {
                stats.episodes += 1;
                stats.reached += 1;
                task.waypoints.pop_front();
                task.from = is_grounded(state, npc_idx).then_some(feet);
                task.episode = Episode::new(task.waypoints[0], feet);
                RowKind::Terminated
            }
            None if task.episode.stalled_decisions < self.config.give_up_after => {
                if self.config.redirect_chance > 0.0 && self.rng.random_bool(self.config.redirect_chance) {
                    let waypoints = self.draw_waypoints(feet);
                    self.tasks[npc_idx].leaving = Some(Route { npc_idx, start: None, waypoints });
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
        let (start, waypoints) = match self.arena.draw_retry(&self.config, &mut self.rng) {
            Some((start, goal)) => (start, vec![goal]),
            None => {
                let start = self.arena.random_point(&mut self.rng);
                (start, self.draw_waypoints(start))
            }
        };
        self.tasks[npc_idx].leaving = Some(Route { npc_idx, start: Some((start, yaw)), waypoints });
    }

    /// Draws the waypoints of an NPC at `from`.
    fn draw_waypoints(&mut self, from: Vec3) -> Vec<Vec3> {
        let mut waypoints = vec![self.draw_goal(from)];
        while waypoints.len() < MAX_WAYPOINTS && self.rng.random_bool(self.config.switch_chance) {
            waypoints.push(self.draw_goal(waypoints[waypoints.len() - 1]));
        }
        waypoints
    }

    fn draw_goal(&mut self, from: Vec3) -> Vec3 {
        self.arena.goal(from, &self.config, &mut self.rng)
    }

    /// Stores the running attempt for a retry, if it began on the ground.
    fn note_failure(&mut self, npc_idx: usize) {
        let task = &self.tasks[npc_idx];
        if let Some(from) = task.from {
            self.arena.note_failure((from, task.waypoints[0]), &mut self.rng);
        }
    }
}

fn is_grounded(state: &EnvState, npc_idx: usize) -> bool {
    npc_of(seen(state, npc_idx)).body.is_grounded()
}
