//! Follows a plan waypoint by waypoint, and asks for another plan when a leg fails.
//!
//! A [`Follower`] neither senses nor searches. A driver reports each decision of the NPC and does what the [`Step`]
//! says. The parts are [`scene`] (what a follower sees of movers), `movers` (waiting, riding and calling), `failures`
//! (legs to avoid), `planning` (queries and their answers), `manner` (how the NPC moves), `prepare` (what is changed
//! in a new plan, with `review`, `clearance` and `shortcuts`) and `detour` (the way back after a push).

mod clearance;
mod detour;
mod failures;
mod ground;
mod manner;
mod movers;
mod moves;
mod planning;
mod prepare;
mod review;
pub mod scene;
mod shortcuts;
mod ways;

use clearance::Clearance;
use detour::Detour;
use failures::Failures;
pub use ground::Ground;
use moves::SteeredMoves;
use review::Review;
use scene::{MoverResponse, MoverWatch};
use serde::{Deserialize, Serialize};
use shortcuts::Shortcuts;
use surefoot_planner::evidence::TryEnd;
use surefoot_planner::live::Traversal;
use surefoot_planner::{Attach, LegKey, Plan, Traffic};
use surefoot_world::{Ability, Arrival, CharacterProfile, End, Gait, Map, MoverAt, Vec3};
use ways::way_of;

/// Decisions after a waypoint during which harm is attributed to the switch to the next waypoint.
const SWITCH_DECISIONS: u32 = 3;

/// Constants of plan following.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FollowConfig {
    /// Decisions without coming closer to the waypoint that cause a re-plan (paper: 50).
    pub replan_after: u32,
    /// Decisions without any progress that end the attempt (paper: 300).
    pub patience: u32,
    /// Most re-plans of an attempt (paper: no limit).
    pub max_replans: u32,
    /// Whether further plans of the attempt avoid legs that failed (paper: no).
    pub remembers: bool,
    /// How plans join start and goal to the graph (paper: to the nearest vertex).
    pub attach: Attach,
    /// Whether NPCs move composed on legs on which a rehearsal has arrived.
    pub composes: bool,
    /// What counts as having arrived at the goal (paper: a touch).
    pub arrival: Arrival,
    /// How the NPC goes where it can walk, until [`Follower::set_gait`] changes it.
    pub gait: Gait,
}

impl Default for FollowConfig {
    fn default() -> Self {
        let (remembers, attach) = (true, Attach::Several);
        let (arrival, gait) = (Arrival::Stand, Gait::DEFAULT);
        Self { replan_after: 50, patience: 300, max_replans: 16, remembers, attach, composes: true, arrival, gait }
    }
}

impl FollowConfig {
    /// The paper's rules, with its limits read as decisions.
    pub fn of_paper() -> Self {
        let (remembers, attach) = (false, Attach::Nearest);
        let (arrival, gait, max_replans) = (Arrival::Touch, Gait::DEFAULT, u32::MAX);
        Self { replan_after: 50, patience: 300, max_replans, remembers, attach, composes: false, arrival, gait }
    }
}

/// What the driver of an attempt does next.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Step {
    /// Keep heading for the current waypoint.
    Keep,
    /// Head for this waypoint from now on, m.
    HeadFor(Vec3),
    /// Plan with [`Follower::query`] and pass the plan to [`Follower::take_plan`].
    Plan,
    /// End the attempt: the NPC is at the goal or harmed, its patience or re-plans have run out ([`End::NoProgress`]),
    /// or no path leads to the goal and the NPC is at the nearest place that it can reach ([`End::Unreachable`]).
    End(End),
}

/// Why an attempt failed: what the NPC was doing at the time.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize, strum::IntoStaticStr)]
#[serde(rename_all = "snake_case")]
#[strum(serialize_all = "snake_case")]
pub enum Fault {
    /// The graph had no path to the goal.
    Unreachable,
    /// The NPC was on an unproved leg to the first vertex or from the last.
    Attachment,
    /// The NPC had just switched to the next waypoint.
    WaypointSwitch,
    /// The NPC was on an edge of the graph.
    Edge,
    /// The NPC came to no harm, but the attempt ran out of patience or re-plans.
    Timeout,
}

impl Fault {
    /// All faults, in a fixed order.
    pub const ALL: [Fault; 5] =
        [Fault::Unreachable, Fault::Attachment, Fault::WaypointSwitch, Fault::Edge, Fault::Timeout];

    /// Lower-case name as used in reports.
    pub fn name(self) -> &'static str {
        self.into()
    }
}

/// How close an NPC has come to a place.
#[derive(Debug, Clone, Copy)]
struct Approach {
    /// Smallest distance so far, m.
    best_m: f32,
    /// Decisions since then.
    stalled: u32,
}

impl Approach {
    const NONE: Self = Self { best_m: f32::INFINITY, stalled: 0 };

    /// Records a distance, m, which counts as closer if it is smaller by more than `least`, m.
    fn record(&mut self, distance_m: f32, least: f32) {
        self.stalled += 1;
        if distance_m < self.best_m - least {
            *self = Self { best_m: distance_m, stalled: 0 };
        }
    }
}

/// An attempt of one NPC to reach one goal by plan.
#[derive(Debug, Clone)]
pub struct Follower {
    config: FollowConfig,
    goal: Vec3,
    /// The goal for which the plan was made, m.
    planned_goal: Vec3,
    /// Where the NPC was when its goal moved and it had moved itself, m.
    moved_from: Vec3,
    plan: Option<Plan>,
    /// Index of the current leg in the plan: on a shortcut, that of its last leg.
    leg: usize,
    shortcuts: Shortcuts,
    clearance: Clearance,
    steered_moves: SteeredMoves,
    review: Review,
    /// Whether the next plan may use jumps although the NPC avoids them, because no other way leads to the goal.
    accepts_jumps: bool,
    /// Whether a way around a wall has failed in a rehearsal, on a leg that no proof covers.
    distrusts_ways: bool,
    /// Where the NPC was last, m.
    feet: Vec3,
    to_waypoint: Approach,
    to_goal: Approach,
    decisions_on_leg: u32,
    /// The legs of the plan before which the NPC moves freely, is not steered, and is steered without cutting corners.
    free_until: usize,
    unsteered_until: usize,
    exact_until: usize,
    /// Leaps of the plan before which the NPC comes to rest.
    from_rest: Vec<LegKey>,
    /// Legs of the plan that no proof covers, and that are neither walks nor leaps over one gap.
    doubtful: Vec<LegKey>,
    plans: u32,
    replans: u32,
    failures: Failures,
    movers: MoverWatch,
    detour: Detour,
    traversals: Vec<Traversal>,
}

impl Follower {
    /// Starts an attempt at `goal`, m, without a plan.
    pub fn new(goal: Vec3, config: FollowConfig) -> Self {
        Self {
            config,
            goal,
            planned_goal: goal,
            moved_from: goal,
            plan: None,
            leg: 0,
            shortcuts: Shortcuts::default(),
            clearance: Clearance::default(),
            steered_moves: SteeredMoves::default(),
            review: Review::default(),
            accepts_jumps: false,
            distrusts_ways: false,
            feet: goal,
            to_waypoint: Approach::NONE,
            to_goal: Approach::NONE,
            decisions_on_leg: 0,
            free_until: 0,
            unsteered_until: 0,
            exact_until: 0,
            from_rest: Vec::new(),
            doubtful: Vec::new(),
            plans: 0,
            replans: 0,
            failures: Failures::default(),
            movers: MoverWatch::default(),
            detour: Detour::default(),
            traversals: Vec::new(),
        }
    }

    /// A follower with the same goal and a plan of one straight leg, for NPCs without a plan.
    pub fn straight(&self) -> Self {
        let mut straight = Self::new(self.goal, FollowConfig { composes: false, ..self.config });
        straight.take_plan(Plan::straight(self.goal));
        straight
    }

    /// A copy that starts its leg again and counts it as failed after `replan_after` decisions without coming closer.
    pub fn rehearsing(&self, replan_after: u32) -> Self {
        let mut copy = Self { config: FollowConfig { replan_after, ..self.config }, ..self.clone() };
        copy.start_leg(self.leg);
        copy.to_goal.stalled = 0;
        copy
    }

    /// By how much a distance must shrink to count as progress, m. A body that is steered into a wall creeps along it.
    fn least_progress(&self) -> f32 {
        if self.config.composes { 0.01 } else { 0.0 }
    }

    // The current plan and leg.

    /// The plan that the NPC follows, if it has one.
    pub fn current_plan(&self) -> Option<&Plan> {
        self.plan.as_ref()
    }

    /// Current waypoint, m; `None` without a plan.
    pub fn waypoint(&self) -> Option<Vec3> {
        self.plan.as_ref().map(|plan| self.detour.via.unwrap_or(plan.waypoints[self.leg]))
    }

    /// What counts as having arrived at the current waypoint: waypoints before the goal are passed, unless the NPC
    /// leaps from rest there.
    pub fn arrival(&self) -> Arrival {
        match self.config.arrival {
            Arrival::Touch => Arrival::Touch,
            arrival if self.is_last_leg() => arrival,
            Arrival::Pass | Arrival::Stand if self.rests_after(self.leg) => Arrival::Stand,
            Arrival::Pass | Arrival::Stand => Arrival::Pass,
        }
    }

    /// Whether the NPC comes to rest at the end of a leg of its plan, for the leap after it.
    fn rests_after(&self, leg: usize) -> bool {
        let next = self.plan.as_ref().and_then(|plan| plan.legs.get(leg + 1));
        self.detour.via.is_none() && next.is_some_and(|next| self.from_rest.contains(&next.key))
    }

    /// The waypoints from the current one on, m; none without a plan.
    pub fn waypoints_ahead(&self) -> &[Vec3] {
        self.plan.as_ref().map_or(&[], |plan| &plan.waypoints[self.leg..])
    }

    /// The places for which the NPC heads one after another until it has to rest at one, m; none without a plan.
    pub fn way_ahead(&self) -> Vec<Vec3> {
        let Some(plan) = &self.plan else { return Vec::new() };
        let mut way = Vec::from_iter(self.detour.via);
        let mut leg = self.leg;
        loop {
            way.push(plan.waypoints[leg]);
            let next = self.shortcuts.end(leg + 1);
            if next >= plan.waypoints.len() || self.rests_after(leg) {
                return way;
            }
            leg = next;
        }
    }

    /// The ability that the current leg needs; `None` without a plan.
    pub fn ability(&self) -> Option<Ability> {
        self.plan.as_ref().map(|plan| plan.legs[self.leg].ability)
    }

    /// Index of the current leg in the plan.
    pub fn leg_idx(&self) -> usize {
        self.leg
    }

    /// The current leg; `None` without a plan.
    pub fn leg_key(&self) -> Option<LegKey> {
        self.plan.as_ref().map(|plan| plan.legs[self.leg].key)
    }

    /// Whether the current waypoint is the last one of the plan.
    pub fn is_last_leg(&self) -> bool {
        self.detour.via.is_none() && self.plan.as_ref().is_some_and(|plan| self.leg + 1 == plan.waypoints.len())
    }

    /// Whether the plan leads to the nearest reachable place because no path leads to the goal.
    pub fn is_second_best(&self) -> bool {
        self.plan.as_ref().is_some_and(|plan| plan.nearest.is_some())
    }

    /// Chances of arriving as planned, and with re-plans, that the plan gives; `None` without a plan that leads to the
    /// goal.
    pub fn promised(&self) -> Option<(f32, f32)> {
        let plan = self.plan.as_ref().filter(|plan| plan.no_path.is_none())?;
        Some((plan.as_planned_chance().get() as f32, plan.arrival_chance().get() as f32))
    }

    /// Number of plans that were taken so far.
    pub fn plans(&self) -> u32 {
        self.plans
    }

    /// Number of re-plans so far.
    pub fn replans(&self) -> u32 {
        self.replans
    }

    /// Adds the legs ahead of the NPC, which is at `feet`, m, to `traffic`.
    pub fn add_to(&self, traffic: &mut Traffic, feet: Vec3) {
        if let Some(plan) = &self.plan {
            traffic.add_plan(feet, plan, self.leg);
        }
    }

    // How the NPC moves.

    /// Keeps the way of a rehearsal, to return to it after a push.
    pub fn set_rehearsed_way(&mut self, way: impl Iterator<Item = Vec3>) {
        self.detour.set_rehearsed_way(way);
    }

    /// Turns an NPC that was pushed, with the feet at `feet`, m, back to its way: where a wall lies between it and the
    /// end of a leg that is walked, it heads for a rehearsed place first. Plans with movers are left alone. Returns the
    /// waypoint, m, if it has changed.
    pub fn return_to_way(&mut self, map: &Map, body: &CharacterProfile, feet: Vec3) -> Option<Vec3> {
        let plan = self.plan.as_ref().filter(|plan| plan.needs.is_empty())?;
        let leg = (plan.legs[self.leg].ability, plan.waypoints[self.leg]);
        let former = self.waypoint();
        self.detour.update(map, body, feet, leg);
        self.waypoint().filter(|waypoint| former != Some(*waypoint))
    }

    /// The lift or platform that the NPC calls, if it waits for one.
    pub fn call(&self) -> Option<MoverAt> {
        self.movers.call
    }

    /// Whether movers bar all ways and the NPC waits until one opens.
    pub fn is_barred(&self) -> bool {
        self.movers.is_barred
    }

    // Progress.

    /// Records one decision: the position of the feet, m, and how the way to the waypoint ended, if it did.
    pub fn record_decision(&mut self, feet: Vec3, leg_end: Option<End>) -> Step {
        self.feet = feet;
        if let Some(harm) = leg_end.filter(|end| end.is_harm()) {
            self.record_harm();
            return Step::End(harm);
        }
        let is_there = leg_end == Some(End::Reached);
        if is_there && self.is_last_leg() && !self.is_second_best() {
            return Step::End(End::Reached);
        }
        if let Some(step) = self.wait_until_unbarred() {
            return step;
        }
        let Some(plan) = &self.plan else {
            return if self.has_used_up_replans() { self.give_up() } else { Step::Plan };
        };
        self.decisions_on_leg += 1;
        if self.movers.response != MoverResponse::Go {
            return self.stay_on_leg();
        }
        self.to_goal.record(feet.distance(self.goal), self.least_progress());
        let is_back = is_there && self.detour.via.take().is_some();
        if is_there && !is_back {
            if self.leg + 1 < plan.waypoints.len() {
                let next = plan.waypoints[self.shortcuts.end(self.leg + 1)];
                self.end_leg(TryEnd::Arrived);
                self.start_leg(self.leg + 1);
                self.to_goal.stalled = 0;
                return Step::HeadFor(next);
            }
            // The last place of a plan that leads to the nearest place.
            self.end_leg(TryEnd::Arrived);
            return if self.wait_for_a_way() { Step::Keep } else { Step::End(End::Unreachable) };
        }
        let waypoint = plan.waypoints[self.leg];
        self.to_waypoint.record(feet.distance(waypoint), self.least_progress());
        if self.to_goal.stalled >= self.config.patience {
            return self.give_up();
        }
        if self.to_waypoint.stalled < self.config.replan_after {
            return if is_back { Step::HeadFor(waypoint) } else { Step::Keep };
        }
        if self.replans >= self.config.max_replans {
            return self.give_up();
        }
        self.end_leg(TryEnd::Failed);
        self.replans += 1;
        self.plan_or_wait()
    }

    fn start_leg(&mut self, leg: usize) {
        self.leg = self.shortcuts.end(leg);
        self.to_waypoint = Approach::NONE;
        self.decisions_on_leg = 0;
        self.detour.end();
        self.movers.start_leg();
    }

    fn end_leg(&mut self, end: TryEnd) {
        let Some(plan) = &self.plan else { return };
        // An NPC that takes its time, or another way, says nothing about an edge.
        let is_on_way = way_of(plan, self.leg).count() > 1;
        let has_moved = is_on_way || self.shortcuts.contain(self.leg) || self.clearance.changes(self.leg);
        let is_usual = self.config.gait == Gait::DEFAULT && !has_moved;
        if let Some(edge) = plan.legs[self.leg].key.edge().filter(|_| is_usual) {
            self.traversals.push(Traversal { edge, end, decisions: self.decisions_on_leg });
        }
    }

    /// Records that the NPC came to harm, which ends the attempt on the current leg.
    pub fn record_harm(&mut self) {
        self.end_leg(TryEnd::Died);
    }

    /// Returns the traversals of edges that ended since the last call.
    pub fn take_traversals(&mut self) -> Vec<Traversal> {
        std::mem::take(&mut self.traversals)
    }

    /// Replaces the traversals: rehearsals say nothing about the edges of a game.
    pub fn set_traversals(&mut self, traversals: Vec<Traversal>) {
        self.traversals = traversals;
    }

    // Failure.

    /// The fault if the attempt failed now, either by harm or by running out of patience or re-plans.
    pub fn fault(&self, by_harm: bool) -> Fault {
        let Some(plan) = &self.plan else { return Fault::Timeout };
        let leg = plan.legs[self.leg];
        if plan.no_path.is_some() {
            Fault::Unreachable
        } else if !by_harm {
            Fault::Timeout
        } else if self.decisions_on_leg <= SWITCH_DECISIONS && self.leg > 0 {
            Fault::WaypointSwitch
        } else if leg.key.edge().is_none() {
            Fault::Attachment
        } else {
            Fault::Edge
        }
    }

    /// Whether the attempt ends instead of another plan.
    pub fn has_used_up_replans(&self) -> bool {
        self.replans > self.config.max_replans
    }

    /// How an attempt ends whose patience or re-plans have run out. Where every way has failed, the goal counts as
    /// unreachable.
    fn give_up(&self) -> Step {
        Step::End(if self.failures.chances_given() > 0 { End::Unreachable } else { End::NoProgress })
    }

    /// Drops the plan because a rehearsal of the leg `key` failed, by harm or for want of progress. The rehearsal is a
    /// try of the leg, which counts once in an attempt: an NPC that is stuck cannot close a bridge for all others.
    pub fn avoid(&mut self, key: LegKey, is_harm: bool) -> Step {
        if self.plan.as_ref().is_some_and(|plan| plan.no_path.is_some() && plan.nearest.is_none()) {
            // No vertex is reachable: the plan was the straight way to the goal, and there is no other.
            return Step::End(End::Unreachable);
        }
        let is_usual = self.config.gait == Gait::DEFAULT && self.is_rehearsed_from_its_start(key);
        if let Some(edge) = key.edge().filter(|edge| is_usual && self.failures.is_first_report(*edge)) {
            let end = if is_harm { TryEnd::Died } else { TryEnd::Failed };
            self.traversals.push(Traversal { edge, end, decisions: 0 });
        }
        // Where movers may open a way, every leg is worth as many tries as any other.
        let is_doubtful = self.movers.stops.is_empty() && self.doubtful.contains(&key);
        self.plan = None;
        plan_again(self.config.remembers && self.failures.add_rehearsed(key, is_harm, is_doubtful))
    }

    /// Whether a rehearsal of the leg `key` began where the leg does, and not on the way.
    fn is_rehearsed_from_its_start(&self, key: LegKey) -> bool {
        let is_current = self.leg_key() == Some(key);
        !is_current || self.decisions_on_leg <= SWITCH_DECISIONS && self.detour.via.is_none()
    }

    /// Drops the plan because there was no progress on its leg.
    fn plan_or_wait(&mut self) -> Step {
        let Some(key) = self.leg_key() else { return Step::Plan };
        self.plan = None;
        match plan_again(self.config.remembers && self.failures.add_run(key)) {
            Step::End(_) if self.wait_for_a_way() => Step::Keep,
            step => step,
        }
    }
}

/// Plans again, unless the NPC `is_near`: as near to the goal as paths lead.
fn plan_again(is_near: bool) -> Step {
    if is_near { Step::End(End::Unreachable) } else { Step::Plan }
}
