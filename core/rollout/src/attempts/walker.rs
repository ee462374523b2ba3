//! One NPC with its attempt, and what is measured of it.

use crate::attempt::Attempt;
use crate::decision::DecidingNpc;
use crate::follow::{Fault, FollowConfig, Follower};
use crate::goals::Goal;
use crate::motion::{Foresight, Motion, Sample, Trace};
use crate::rehearse::NoiseStream;
use crate::style::Style;
use serde::{Deserialize, Serialize};
use surefoot_world::{Action, End, Vec3, World};

/// Result of one attempt.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct AttemptResult {
    /// How the attempt ended.
    pub end: End,
    /// Number of decisions.
    pub decisions: u32,
    /// Number of re-plans.
    pub replans: u32,
    /// Length of the path from decision to decision, m.
    pub length: f32,
    /// Number of plans that were taken: 1 if the first plan went through.
    #[serde(default)]
    pub plans: u32,
    /// Chance of arriving as planned that the first plan gave; `None` without a plan that leads to the goal.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub promised: Option<f32>,
    /// Chance of arriving, re-plans included, that the first plan gave.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub promised_arrival: Option<f32>,
    /// Why the attempt failed; `None` if it succeeded or did not follow a plan.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub fault: Option<Fault>,
}

impl AttemptResult {
    /// An attempt without plans.
    pub fn without_plans(end: End, decisions: u32, length: f32) -> Self {
        let (promised, promised_arrival, fault) = Default::default();
        Self { end, decisions, replans: 0, length, plans: 0, promised, promised_arrival, fault }
    }
}

/// Measures one attempt while it runs.
#[derive(Debug)]
pub struct Measured {
    /// Position of the feet at the last decision, m.
    pub feet: Vec3,
    /// How the attempt ended, once it has.
    pub end: Option<End>,
    decisions: u32,
    length: f32,
    /// Chances of arriving as planned, and with re-plans, that the first plan gave.
    promised: Option<(f32, f32)>,
}

impl Measured {
    /// Begins at `start`, m.
    pub fn begin(start: Vec3) -> Self {
        Self { feet: start, end: None, decisions: 0, length: 0.0, promised: None }
    }

    /// Records the chances that the first plan gives.
    pub fn record_first_plan(&mut self, follower: &Follower) {
        self.promised = follower.promised();
    }

    /// Records where a decision led, m.
    pub fn record_decision(&mut self, feet: Vec3) {
        self.decisions += 1;
        self.length += self.feet.distance(feet);
        self.feet = feet;
    }

    /// The result of an attempt that has ended.
    ///
    /// # Panics
    /// If it has not.
    pub fn result(&self, follower: Option<&Follower>) -> AttemptResult {
        let end = self.end.expect("every attempt ends");
        let failed = follower.filter(|_| end != End::Reached);
        AttemptResult {
            replans: follower.map_or(0, Follower::replans),
            plans: follower.map_or(0, Follower::plans),
            promised: self.promised.map(|it| it.0),
            promised_arrival: self.promised.map(|it| it.1),
            fault: failed.map(|follower| follower.fault(end.is_harm())),
            ..AttemptResult::without_plans(end, self.decisions, self.length)
        }
    }
}

/// Positions of the feet of one NPC, m: the start, then the position after each decision.
pub type Track = Vec<Vec3>;

/// An attempt with its track and actions.
#[derive(Debug, Clone, PartialEq)]
pub struct Played {
    /// Result of the attempt.
    pub attempt: AttemptResult,
    /// Where the NPC was.
    pub track: Track,
    /// Its action in each decision.
    pub actions: Vec<Action>,
}

/// One NPC with its running attempt.
pub(super) struct Walker {
    pub(super) deciding: DecidingNpc,
    pub(super) noise: NoiseStream,
    /// The attempt by plan; `None` if the NPC heads straight for its goal.
    pub(super) attempt: Option<Attempt>,
    pub(super) measured: Measured,
    /// Whether the attempt goes on after the NPC has arrived.
    pub(super) keeps: bool,
    /// Whether the NPC keeps to its goal and is there.
    pub(super) rests: bool,
    pub(super) track: Track,
    pub(super) actions: Vec<Action>,
    pub(super) trace: Trace,
    foresight: Foresight,
}

impl Walker {
    /// Spawns an NPC that follows plans if there are any, and otherwise heads straight for the goal.
    pub fn start(
        world: &mut World,
        goal: &Goal,
        noise: NoiseStream,
        (config, has_plans): (FollowConfig, bool),
    ) -> Self {
        let slot = world.spawn(goal.start, goal.yaw);
        world.head_for(slot, goal.goal, config.arrival);
        Self {
            deciding: DecidingNpc::of(slot),
            noise,
            attempt: has_plans.then(|| Attempt::new(Follower::new(goal.goal, config))),
            measured: Measured::begin(goal.start),
            keeps: false,
            rests: false,
            track: vec![goal.start],
            actions: Vec::new(),
            trace: Trace::begin(Sample::of(world.npc(slot).expect("just spawned"))),
            foresight: Foresight::default(),
        }
    }

    /// Whether the NPC decides.
    pub fn acts(&self) -> bool {
        self.measured.end.is_none() && !self.rests
    }

    pub fn follower(&self) -> Option<&Follower> {
        self.attempt.as_ref().map(|attempt| &attempt.follower)
    }

    pub fn style(&self, world: &World) -> Style {
        let npc = world.npc(self.deciding.slot).expect("a running NPC");
        self.attempt.as_ref().map_or(Style::Free, |it| it.style(world.map(), world.profile_of(npc), &npc.body))
    }

    /// Records what is predicted before a decision.
    pub fn predict(&mut self, world: &World) {
        let npc = world.npc(self.deciding.slot).expect("a running NPC");
        if let Some(attempt) = &self.attempt {
            self.foresight.predict(attempt, &npc.body);
        }
    }

    /// Records one decision.
    pub fn record(&mut self, world: &World, action: Action, motion: &mut Motion) {
        let npc = world.npc(self.deciding.slot).expect("a running NPC");
        let ability = self.attempt.as_ref().and_then(|attempt| attempt.follower.ability());
        motion.note(&mut self.trace, &Sample::of(npc), ability);
        self.foresight.check(npc.body.feet, motion);
        self.actions.push(action);
        self.track.push(npc.body.feet);
        self.measured.record_decision(npc.body.feet);
    }

    /// Whether the NPC decides again; otherwise it comes to rest if it `stays`, or leaves the world.
    pub fn is_running(&self, world: &mut World, stays: bool) -> bool {
        match self.measured.end {
            Some(_) if stays => world.clear_waypoint(self.deciding.slot),
            Some(_) => _ = world.despawn(self.deciding.slot),
            None => {}
        }
        self.measured.end.is_none()
    }

    pub fn finish(self) -> Played {
        let attempt = self.measured.result(self.follower());
        Played { attempt, track: self.track, actions: self.actions }
    }
}
