//! Measures how NPCs move, as a viewer sees it, decision by decision.

use crate::attempt::Attempt;
use crate::style::angle;
use serde::{Deserialize, Serialize};
use std::collections::VecDeque;
use surefoot_world::float::{heading, hypot};
use surefoot_world::{Ability, AbilitySet, Body, DECISION_SECONDS, Npc, POSE_TICKS, TICKS_PER_DECISION, Vec3};

/// Width of a bin of the angle between facing and motion, degrees.
const BIN_DEG: f32 = 1.0;
const BINS: usize = 180;
/// Horizontal speed below which a body has no direction, m/s.
const SLOW: f32 = 0.5;
/// How far a heading must turn back for a reversal, rad.
const BACK: f32 = 0.087;
/// Error of a prediction up to which it counts as close, m.
const CLOSE_M: f32 = 0.15;

/// Sums over the decisions of many NPCs.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct Motion {
    /// Number of decisions.
    pub decisions: u64,
    /// Number of times a heading turned back by five degrees or more.
    pub reversals: u64,
    /// Decisions of moving bodies by the angle between facing and motion, one bin per degree; empty if none moved.
    pub facing: Vec<u64>,
    /// Sum of the changes of horizontal acceleration, m/s3.
    pub jerk: f64,
    /// On all legs.
    pub all: Gait,
    /// On legs of plans that can be walked.
    pub walk: Gait,
    /// Decisions with a prediction of the place a second later, of NPCs that still followed the same plan then.
    #[serde(default)]
    pub predicted: u64,
    /// Those whose prediction was within 0.15 m.
    #[serde(default)]
    pub close: u64,
}

/// Sums of motion.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct Gait {
    /// Number of decisions.
    pub decisions: u64,
    /// Number of decisions that ended in the air.
    pub in_air: u64,
    /// Number of jumps, including jumps in the air.
    pub jumps: u64,
    /// Distance covered, m.
    pub metres: f64,
}

/// What was predicted of one NPC in its last decisions.
#[derive(Debug, Default)]
pub(crate) struct Foresight {
    /// Place a second after each of these decisions, m, the oldest one first.
    places: VecDeque<Option<Vec3>>,
    /// Plans that the NPC had taken by then.
    plans: u32,
}

impl Foresight {
    /// Adds the prediction before a decision of an NPC with this `body`.
    pub fn predict(&mut self, attempt: &Attempt, body: &Body) {
        let plans = attempt.follower.plans();
        if plans != self.plans {
            *self = Self { plans, places: VecDeque::new() };
        }
        let [.., last] = attempt.trajectory(body).poses;
        self.places.push_back(last.map(|pose| pose.feet));
    }

    /// Compares the prediction of a second ago with the place after a decision, m.
    pub fn check(&mut self, feet: Vec3, motion: &mut Motion) {
        let second = (POSE_TICKS[2] / TICKS_PER_DECISION) as usize;
        if self.places.len() == second
            && let Some(place) = self.places.pop_front().flatten()
        {
            motion.predicted += 1;
            motion.close += u64::from(place.distance(feet) <= CLOSE_M);
        }
    }
}

/// A body at the end of a decision, as far as motion is measured.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Sample {
    /// Position of the feet, m.
    pub feet: Vec3,
    /// Heading, rad.
    pub yaw: f32,
    /// Velocity, m/s.
    pub velocity: Vec3,
    /// Whether the body is off the ground.
    pub in_air: bool,
    /// Whether a device or mover carries the body: its heading is not measured against its motion.
    pub is_carried: bool,
    /// Abilities that were used in the decision.
    pub used: AbilitySet,
}

impl Sample {
    /// What an NPC shows.
    pub fn of(npc: &Npc) -> Self {
        let body = &npc.body;
        Self {
            feet: body.feet,
            yaw: body.yaw,
            velocity: body.velocity,
            in_air: !body.is_grounded(),
            is_carried: body.is_carried(),
            used: npc.used_abilities,
        }
    }
}

/// The last decision of one NPC.
#[derive(Debug, Clone, Copy, Default)]
pub struct Trace {
    /// Side to which the heading turns; 0 before the first turn.
    side: f32,
    /// How far the heading has turned back, rad.
    back: f32,
    last: Sample,
    acceleration: Vec3,
}

impl Trace {
    /// The trace of a body before its first decision.
    pub fn begin(start: Sample) -> Self {
        Self { last: start, ..Self::default() }
    }

    /// Adds a turn of the heading, rad; true if the heading has now turned back.
    fn turn(&mut self, turn: f32) -> bool {
        if self.side == 0.0 {
            self.side = if turn == 0.0 { 0.0 } else { turn.signum() };
            return false;
        }
        self.back = (self.back - turn * self.side).max(0.0);
        let has_turned_back = self.back > BACK;
        if has_turned_back {
            (self.side, self.back) = (-self.side, 0.0);
        }
        has_turned_back
    }
}

impl Motion {
    /// The motion along a track: the start, then the body after each decision.
    pub fn of_track(track: &[Sample]) -> Self {
        let mut motion = Self::default();
        if let [start, decisions @ ..] = track {
            let mut trace = Trace::begin(*start);
            decisions.iter().for_each(|sample| motion.note(&mut trace, sample, None));
        }
        motion
    }

    /// Adds a decision that ended with `now`, on a leg that needs `ability`, if the NPC follows a plan.
    pub fn note(&mut self, trace: &mut Trace, now: &Sample, ability: Option<Ability>) {
        let Trace { last, .. } = *trace;
        let mut gait = Gait { decisions: 1, ..Gait::default() };
        gait.in_air = u64::from(now.in_air);
        gait.jumps = Ability::JUMPS.map(|jump| u64::from(now.used.contains(jump))).iter().sum();
        gait.metres =
            if now.used.contains(Ability::TELEPORTER) { 0.0 } else { f64::from(now.feet.distance(last.feet)) };
        self.all.add(&gait);
        if ability == Some(Ability::WALK) {
            self.walk.add(&gait);
        }
        self.decisions += 1;
        self.reversals += u64::from(trace.turn(angle(now.yaw - last.yaw)));
        if hypot(now.velocity.x, now.velocity.z) > SLOW && !now.is_carried {
            let off = angle(heading(now.velocity) - now.yaw).abs().to_degrees();
            self.facing.resize(BINS, 0);
            self.facing[((off / BIN_DEG) as usize).min(BINS - 1)] += 1;
        }
        let acceleration = (now.velocity - last.velocity) / DECISION_SECONDS;
        let change = acceleration - trace.acceleration;
        self.jerk += f64::from(hypot(change.x, change.z) / DECISION_SECONDS);
        (trace.last, trace.acceleration) = (*now, acceleration);
    }

    /// Adds the sums of others.
    pub fn add(&mut self, other: &Self) {
        self.decisions += other.decisions;
        self.reversals += other.reversals;
        self.jerk += other.jerk;
        self.facing.resize(self.facing.len().max(other.facing.len()), 0);
        self.facing.iter_mut().zip(&other.facing).for_each(|(sum, count)| *sum += count);
        self.all.add(&other.all);
        self.walk.add(&other.walk);
        self.predicted += other.predicted;
        self.close += other.close;
    }

    /// Share of the predictions a second ahead that were within 0.15 m; `None` if nothing was predicted.
    pub fn close_share(&self) -> Option<f64> {
        (self.predicted > 0).then(|| self.close as f64 / self.predicted as f64)
    }

    /// Reversals of the heading per second.
    pub fn reversals_per_s(&self) -> f64 {
        self.reversals as f64 / (self.decisions.max(1) as f64 * f64::from(DECISION_SECONDS))
    }

    /// Reversals of the heading per 100 m; 0 without any distance.
    pub fn reversals_per_100m(&self) -> f64 {
        if self.all.metres > 0.0 { self.reversals as f64 / self.all.metres * 100.0 } else { 0.0 }
    }

    /// Quantile `share` of the angle between facing and motion over the decisions of moving bodies, degrees; 0 if none
    /// moved.
    pub fn facing_deg(&self, share: f64) -> f64 {
        let total: u64 = self.facing.iter().sum();
        let mut seen = 0;
        let bin = self.facing.iter().position(|count| {
            seen += count;
            seen as f64 >= share * total as f64
        });
        bin.filter(|_| total > 0).map_or(0.0, |bin| (bin as f64 + 1.0) * f64::from(BIN_DEG))
    }

    /// Mean change of horizontal acceleration, m/s3.
    pub fn mean_jerk(&self) -> f64 {
        self.jerk / self.decisions.max(1) as f64
    }
}

impl Gait {
    fn add(&mut self, other: &Self) {
        self.decisions += other.decisions;
        self.in_air += other.in_air;
        self.jumps += other.jumps;
        self.metres += other.metres;
    }

    /// Jumps per 100 m; 0 without any distance.
    pub fn jumps_per_100m(&self) -> f64 {
        if self.metres > 0.0 { self.jumps as f64 / self.metres * 100.0 } else { 0.0 }
    }

    /// Share of the decisions that ended in the air.
    pub fn air_share(&self) -> f64 {
        self.in_air as f64 / self.decisions.max(1) as f64
    }
}
