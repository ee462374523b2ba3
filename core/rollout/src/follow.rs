//! Follows a plan waypoint by waypoint, and asks for a new plan when a leg fails.
//!
//! A [`Follower`] is pure state and neither senses nor searches. Workers feed it from the network, evaluation from a world.

use crate::scene::{Call, Conduct, Scene};
use crate::style::Style;
use serde::{Deserialize, Serialize};
use surefoot_planner::evidence::TryEnd;
use surefoot_planner::live::Traversal;
use surefoot_planner::{Attach, LegKey, Plan, Query, Stop, Traffic};
use surefoot_world::{Ability, TICKS_PER_SECOND, Vec3};

/// Constants of plan following.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FollowConfig {
    /// Decisions without coming closer to the waypoint that cause a re-plan (paper: 50).
    pub replan_after: u32,
    /// Decisions without any progress that end the attempt (paper: 300).
    pub patience: u32,
    /// Most re-plans of an attempt (paper: no limit).
    pub max_replans: u32,
    /// Whether legs that failed are avoided by further plans of the attempt (paper: no).
    pub remembers: bool,
    /// How plans join start and goal to the graph (paper: to the nearest vertex).
    pub attach: Attach,
    /// Whether NPCs compose themselves on legs on which they were seen to arrive so.
    pub composes: bool,
}

impl Default for FollowConfig {
    fn default() -> Self {
        let (remembers, attach) = (true, Attach::Several);
        Self { replan_after: 50, patience: 300, max_replans: 16, remembers, attach, composes: true }
    }
}

impl FollowConfig {
    /// The paper's rules, with its limits read as decisions.
    pub fn of_paper() -> Self {
        let (remembers, attach) = (false, Attach::Nearest);
        Self { replan_after: 50, patience: 300, max_replans: u32::MAX, remembers, attach, composes: false }
    }
}

/// What the NPC does next.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Step {
    /// Keep heading for the current waypoint.
    Keep,
    /// Head for this waypoint from now on, m.
    Head(Vec3),
    /// Plan with [`Follower::query`] and pass the plan to [`Follower::take_plan`].
    Plan,
    /// End the attempt: patience or re-plans have run out.
    GiveUp,
    /// End the attempt: no path leads to the goal, and the NPC is at the nearest place that it can reach.
    Unreachable,
}

/// Why an attempt failed: what the NPC was doing at the time.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
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
        match self {
            Fault::Unreachable => "unreachable",
            Fault::Attachment => "attachment",
            Fault::WaypointSwitch => "waypoint_switch",
            Fault::Edge => "edge",
            Fault::Timeout => "timeout",
        }
    }
}

/// An attempt of one NPC to reach one goal by plan.
#[derive(Debug, Clone)]
pub struct Follower {
    config: FollowConfig,
    goal: Vec3,
    plan: Option<Plan>,
    leg: usize,
    /// Smallest distance to the current waypoint, m.
    best_leg_distance: f32,
    /// Smallest distance to the goal, m.
    best_goal_distance: f32,
    stalled_on_leg: u32,
    stalled: u32,
    plans: u32,
    replans: u32,
    failed_legs: Vec<FailedLeg>,
    /// Legs to the goal itself that failed.
    failed_arrivals: u32,
    /// How often legs that failed were given another chance.
    chances: u32,
    decisions_on_leg: u32,
    /// The leg of the plan before which the NPC moves freely.
    free_until: usize,
    traversals: Vec<Traversal>,
    /// The stops at which movers stand sooner or later, as they were seen last.
    stops: Vec<u16>,
    /// What the NPC does about movers.
    conduct: Conduct,
    /// Decisions for which it has stayed on this leg.
    stayed: u32,
    /// Whether it waits, where no way leads on, for a mover that bars one.
    is_barred: bool,
    /// Decisions for which it has done so.
    barred: u32,
    call: Option<Call>,
    /// Places along the legs that were rehearsed, m.
    way: Vec<Vec3>,
    /// Where it heads for first, m, because it was pushed off its way.
    aside: Option<Vec3>,
    /// Whether it was pushed where a wall lies between it and the end of its leg.
    is_lost: bool,
}

/// A leg that failed.
#[derive(Debug, Clone, Copy)]
struct FailedLeg {
    key: LegKey,
    /// Whether the NPC, or its ghost, came to harm; otherwise it made no progress.
    is_harm: bool,
}

/// Decisions after a waypoint during which harm is attributed to the switch to the next waypoint.
const SWITCH_DECISIONS: u32 = 3;
/// Legs to the goal that fail, each from another vertex, until the goal counts as unreachable.
const MAX_FAILED_ARRIVALS: u32 = 5;
/// The same where they only failed in rehearsals, which cost no time.
const MAX_AVOIDED_ARRIVALS: u32 = 12;
/// How often legs on which there was no progress are given another chance, where no other way is left.
const MAX_CHANCES: u32 = 3;
/// Decisions for which an NPC waits for a mover before the leg counts as failed: 40 s.
const MAX_STAY: u32 = 240;
/// Decisions for which it waits for a mover that bars all ways before the goal counts as unreachable: 30 s.
const MAX_BARRED: u32 = 180;
/// Speed at which an NPC gets to a mover in any case, m/s.
const UNHURRIED: f32 = 5.0;
/// Decisions after which it looks for another way once more.
const BARRED_RETRY: u32 = 30;
/// Distance within which an NPC waits where paths lead no further, m.
const BARRED_WITHIN_M: f32 = 1.5;

/// Most failed legs kept for an attempt; the oldest is dropped first.
const MAX_FAILED_LEGS: usize = 48;

impl Follower {
    /// Starts an attempt at `goal`, m, without a plan.
    pub fn new(goal: Vec3, config: FollowConfig) -> Self {
        Self {
            config,
            goal,
            plan: None,
            leg: 0,
            best_leg_distance: f32::INFINITY,
            best_goal_distance: f32::INFINITY,
            stalled_on_leg: 0,
            stalled: 0,
            plans: 0,
            replans: 0,
            failed_legs: Vec::new(),
            failed_arrivals: 0,
            chances: 0,
            decisions_on_leg: 0,
            free_until: 0,
            traversals: Vec::new(),
            stops: Vec::new(),
            conduct: Conduct::Go,
            stayed: 0,
            is_barred: false,
            barred: 0,
            call: None,
            way: Vec::new(),
            aside: None,
            is_lost: false,
        }
    }

    /// Adds what the NPC, which is at `feet`, m, has before it to `traffic`.
    pub fn add_to(&self, traffic: &mut Traffic, feet: Vec3) {
        if let Some(plan) = &self.plan {
            traffic.add_plan(feet, plan, self.leg);
        }
    }

    /// Returns the traversals of edges that ended since the last call.
    pub fn take_traversals(&mut self) -> Vec<Traversal> {
        std::mem::take(&mut self.traversals)
    }

    /// Records that the NPC came to harm, which ends the attempt on the current leg.
    pub fn note_harm(&mut self) {
        self.end_leg(TryEnd::Died);
    }

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

    fn end_leg(&mut self, end: TryEnd) {
        let Some(plan) = &self.plan else { return };
        if let Some(edge) = plan.legs[self.leg].key.edge() {
            self.traversals.push(Traversal { edge, end, decisions: self.decisions_on_leg });
        }
    }

    /// Current waypoint, m; `None` without a plan.
    pub fn waypoint(&self) -> Option<Vec3> {
        self.leg_end().map(|end| self.aside.unwrap_or(end))
    }

    /// Where the current leg ends, m.
    fn leg_end(&self) -> Option<Vec3> {
        self.plan.as_ref().map(|plan| plan.waypoints[self.leg])
    }

    /// The ability that the current leg needs; `None` without a plan.
    pub fn ability(&self) -> Option<Ability> {
        self.plan.as_ref().map(|plan| plan.legs[self.leg].ability)
    }

    /// How the NPC moves on the current leg, if that was rehearsed.
    pub fn style(&self) -> Style {
        if let Some(stay) = self.stays() {
            return stay;
        }
        self.ability().filter(|_| self.composes(self.leg)).map_or(Style::Free, Style::for_leg)
    }

    /// How the NPC stays where it is, if it waits for a mover or rides on it, which needs no rehearsal.
    pub fn stays(&self) -> Option<Style> {
        match self.conduct {
            Conduct::Go => None,
            Conduct::Stay { at, within } => Some(Style::Stay { at, within }),
        }
    }

    /// Whether the NPC waits, where no way leads on, for a mover that bars one.
    pub fn is_barred(&self) -> bool {
        self.is_barred
    }

    /// The lift or platform that the NPC calls, if it waits for one.
    pub fn call(&self) -> Option<Call> {
        self.call
    }

    /// Looks at the movers before a decision, with the feet at `feet`, m. Drops the plan if movers have barred one of the legs that lie
    /// ahead, or freed the way where all ways were barred; not while the NPC is in the air or rides, when it cannot turn back.
    pub fn look(&mut self, scene: Scene<'_>, feet: Vec3, is_grounded: bool) {
        let stops = scene.stops_ahead();
        let has_changed = stops != self.stops;
        self.stops = stops;
        let former = std::mem::replace(&mut self.conduct, Conduct::Go);
        self.call = None;
        if self.is_barred {
            // What failed while the way was barred may succeed now.
            let is_free = has_changed || self.barred.is_multiple_of(BARRED_RETRY);
            if is_free && is_grounded {
                self.failed_legs.retain(|leg| leg.is_harm);
                (self.plan, self.is_barred, self.failed_arrivals) = (None, false, 0);
            } else {
                self.conduct = stay_where_it_was(former, feet, BARRED_WITHIN_M);
            }
            return;
        }
        let Some(plan) = &self.plan else { return };
        let ride = plan.needs_of(self.leg).and_then(|needs| needs.ride);
        if has_changed && is_grounded && ride.is_none() {
            let is_barred = plan.needs.iter().any(|(leg, needs)| *leg >= self.leg && !needs.are_met(&self.stops));
            if is_barred || plan.nearest.is_some() {
                self.plan = None;
                return;
            }
        }
        let Some(needs) = plan.needs_of(self.leg) else { return };
        let boards = plan.needs_of(self.leg + 1).is_some_and(|next| next.ride.is_some());
        if let Some(ride) = ride {
            let end = plan.waypoints[self.leg];
            if is_grounded && scene.is_missed(ride, feet, end) {
                // It stands where the mover will be, but must not wait there.
                let berth = plan.legs[self.leg].key.from;
                let leg = FailedLeg { key: LegKey { from: Stop::Start, to: berth }, is_harm: true };
                self.plan = None;
                self.remember(leg);
                self.replans += 1;
                return;
            }
            self.conduct = scene.ride(ride, feet, end);
            self.call = scene.call_of_ride(ride, feet, end);
        } else if self.stayed > 0
            || self.decisions_on_leg == 0
            || boards && scene.is_gone(needs, feet, plan.waypoints[self.leg])
        {
            // The duration of the leg includes the usual wait.
            let ticks = feet.distance(plan.waypoints[self.leg]) / UNHURRIED * TICKS_PER_SECOND as f32;
            self.conduct = scene.gate(needs, feet, ticks as u32);
            if let Conduct::Stay { within, .. } = self.conduct {
                // At the vertex where the leg begins, nobody is in the way of the mover.
                let begin = self.leg.checked_sub(1).map_or(feet, |former| plan.waypoints[former]);
                self.conduct = stay_where_it_was(former, begin, within);
                self.call = scene.call_of_gate(needs);
            }
        }
    }

    /// The ability of the current leg, and where it ends, m; `None` without a plan, and where movers matter.
    pub(crate) fn pace(&self) -> Option<(Ability, Vec3)> {
        let plan = self.plan.as_ref().filter(|plan| plan.needs.is_empty())?;
        Some((plan.legs[self.leg].ability, plan.waypoints[self.leg]))
    }

    /// Takes note of the way along which a rehearsal went. One that began off the way is of no use to get back to it.
    pub fn learn_way(&mut self, way: impl Iterator<Item = Vec3>) {
        if !self.is_lost || self.way.is_empty() {
            self.way.clear();
            self.way.extend(way);
        }
    }

    /// Places along the legs that were rehearsed last, m.
    pub(crate) fn rehearsed_way(&self) -> &[Vec3] {
        &self.way
    }

    /// Heads for this place first, m, or for the end of the leg again.
    pub(crate) fn turn_aside(&mut self, is_lost: bool, aside: Option<Vec3>) {
        (self.is_lost, self.aside) = (is_lost, aside);
    }

    /// Whether the NPC composes itself on a leg of its plan.
    fn composes(&self, leg: usize) -> bool {
        self.config.composes && leg >= self.free_until
    }

    /// Lets the NPC move freely up to the end of the leg `key` of its plan; false if it already did.
    pub fn loosen(&mut self, key: LegKey) -> bool {
        let Some(plan) = &self.plan else { return false };
        let leg = plan.legs.iter().position(|leg| leg.key == key).unwrap_or(self.leg);
        let composed =
            (self.leg..=leg).any(|leg| self.composes(leg) && Style::for_leg(plan.legs[leg].ability) != Style::Free);
        if composed {
            self.free_until = leg + 1;
        }
        composed
    }

    /// Index of the current leg in the plan.
    pub fn leg_idx(&self) -> usize {
        self.leg
    }

    /// A copy that begins its leg anew and counts it as failed after `replan_after` decisions without coming closer.
    pub fn rehearsing(&self, replan_after: u32) -> Self {
        let mut copy = Self { config: FollowConfig { replan_after, ..self.config }, ..self.clone() };
        copy.start_leg(self.leg);
        copy.stalled = 0;
        copy
    }

    /// A follower that heads straight for the goal, as NPCs do that have no plan.
    pub fn straight(&self) -> Self {
        let mut straight = Self::new(self.goal, FollowConfig { composes: false, ..self.config });
        straight.take_plan(Plan::straight(self.goal));
        straight
    }

    /// The current leg; `None` without a plan.
    pub fn leg_key(&self) -> Option<LegKey> {
        self.plan.as_ref().map(|plan| plan.legs[self.leg].key)
    }

    /// Whether the current waypoint is the last one of the plan.
    pub fn is_last_leg(&self) -> bool {
        self.aside.is_none() && self.plan.as_ref().is_some_and(|plan| self.leg + 1 == plan.waypoints.len())
    }

    /// Chances of arriving as planned, and with re-plans, that the plan gives; `None` without a plan that leads to the goal.
    pub fn promised(&self) -> Option<(f32, f32)> {
        let plan = self.plan.as_ref().filter(|plan| plan.no_path.is_none())?;
        Some((plan.as_planned_chance().get() as f32, plan.arrival_chance().get() as f32))
    }

    /// Number of plans that were taken so far.
    pub fn plans(&self) -> u32 {
        self.plans
    }

    /// Whether the plan leads elsewhere than to the goal, because no path leads there.
    pub fn is_second_best(&self) -> bool {
        self.plan.as_ref().is_some_and(|plan| plan.nearest.is_some())
    }

    /// Number of re-plans so far.
    pub fn replans(&self) -> u32 {
        self.replans
    }

    /// The query for a plan from `feet`, m, that avoids the failed legs.
    pub fn query(&self, feet: Vec3) -> Query {
        let avoid = self.failed_legs.iter().map(|leg| leg.key).collect();
        Query { avoid, stops: self.stops.clone(), attach: self.config.attach, ..Query::new(feet, self.goal) }
    }

    /// Whether to plan again instead of taking `plan`, which leads elsewhere than to the goal: legs on which there was no progress get
    /// another chance, since other noise may help.
    pub fn reconsiders(&mut self, plan: &Plan) -> bool {
        let count = self.failed_legs.len();
        if plan.no_path.is_none() || self.chances >= MAX_CHANCES {
            return false;
        }
        self.failed_legs.retain(|leg| leg.is_harm);
        let reconsiders = self.failed_legs.len() < count;
        self.chances += u32::from(reconsiders);
        reconsiders
    }

    /// Plans from `feet`, m, with `search`, starts to follow the plan, and returns its first waypoint, m.
    pub fn plan(&mut self, feet: Vec3, mut search: impl FnMut(&Query) -> Plan) -> Vec3 {
        loop {
            let plan = search(&self.query(feet));
            if !self.reconsiders(&plan) {
                return self.take_plan(plan);
            }
        }
    }

    /// The waypoints from the current one on, m; none without a plan.
    pub fn waypoints_ahead(&self) -> &[Vec3] {
        self.plan.as_ref().map_or(&[], |plan| &plan.waypoints[self.leg..])
    }

    /// Starts to follow a plan and returns its first waypoint, m.
    pub fn take_plan(&mut self, plan: Plan) -> Vec3 {
        let first = plan.waypoints[0];
        self.plan = Some(plan);
        self.plans = self.plans.saturating_add(1);
        self.free_until = 0;
        self.start_leg(0);
        first
    }

    /// Drops the plan because its graph has changed; the leg does not count as failed.
    pub fn forget_plan(&mut self) {
        self.plan = None;
        (self.is_lost, self.aside) = (false, None);
        self.conduct = Conduct::Go;
    }

    fn start_leg(&mut self, leg: usize) {
        self.leg = leg;
        self.best_leg_distance = f32::INFINITY;
        self.stalled_on_leg = 0;
        self.decisions_on_leg = 0;
        self.stayed = 0;
        (self.is_lost, self.aside) = (false, None);
        self.conduct = Conduct::Go;
    }

    /// Records one decision: the position of the feet, m, and whether the waypoint was reached during the decision.
    pub fn note(&mut self, feet: Vec3, waypoint_reached: bool) -> Step {
        if self.is_barred {
            self.barred += 1;
            return if self.barred > MAX_BARRED { Step::Unreachable } else { Step::Keep };
        }
        let Some(plan) = &self.plan else {
            return if self.has_replanned_enough() { self.end() } else { Step::Plan };
        };
        if self.conduct != Conduct::Go {
            self.decisions_on_leg += 1;
            self.stayed += 1;
            if self.stayed <= MAX_STAY {
                return Step::Keep;
            }
            let key = plan.legs[self.leg].key;
            return self.plan_or_wait(key);
        }
        let goal_distance = feet.distance(self.goal);
        self.stalled += 1;
        self.stalled_on_leg += 1;
        self.decisions_on_leg += 1;
        if goal_distance < self.best_goal_distance {
            self.best_goal_distance = goal_distance;
            self.stalled = 0;
        }
        let last_leg = plan.waypoints.len() - 1;
        let is_back = waypoint_reached && self.aside.take().is_some();
        let waypoint_reached = waypoint_reached && !is_back;
        if waypoint_reached && self.leg == last_leg && plan.nearest.is_some() {
            self.end_leg(TryEnd::Arrived);
            return if self.waits_for_a_way() { Step::Keep } else { Step::Unreachable };
        }
        if waypoint_reached && self.leg < last_leg {
            let next = plan.waypoints[self.leg + 1];
            self.end_leg(TryEnd::Arrived);
            self.start_leg(self.leg + 1);
            self.stalled = 0;
            return Step::Head(next);
        }
        let leg_distance = feet.distance(plan.waypoints[self.leg]);
        if leg_distance < self.best_leg_distance {
            self.best_leg_distance = leg_distance;
            self.stalled_on_leg = 0;
        }
        if self.stalled >= self.config.patience {
            return self.end();
        }
        if self.stalled_on_leg < self.config.replan_after {
            return if is_back { Step::Head(plan.waypoints[self.leg]) } else { Step::Keep };
        }
        if self.replans >= self.config.max_replans {
            return self.end();
        }
        let key = plan.legs[self.leg].key;
        self.end_leg(TryEnd::Failed);
        self.replans += 1;
        self.plan_or_wait(key)
    }

    /// Lets the NPC wait where no way leads on, if movers bar some and its patience lasts; returns whether it does.
    pub fn waits_for_a_way(&mut self) -> bool {
        self.is_barred = !self.stops.is_empty() && self.barred < MAX_BARRED;
        if self.is_barred {
            self.barred += 1;
            self.plan = None;
        }
        self.is_barred
    }

    /// Whether the attempt ends instead of another plan.
    pub fn has_replanned_enough(&self) -> bool {
        self.replans > self.config.max_replans
    }

    /// How an attempt ends whose patience or re-plans have run out: where every way has failed, the goal cannot be reached, as far as
    /// anyone can tell.
    fn end(&self) -> Step {
        if self.chances > 0 { Step::Unreachable } else { Step::GiveUp }
    }

    /// Drops the plan because a rehearsal of the leg `key` failed, by harm or for want of progress.
    pub fn avoid(&mut self, key: LegKey, is_harm: bool) -> Step {
        if self.plan.as_ref().is_some_and(|plan| plan.no_path.is_some() && plan.nearest.is_none()) {
            // No vertex is reachable: the plan was the straight way to the goal, and there is no other.
            return Step::Unreachable;
        }
        self.plan_without(FailedLeg { key, is_harm }, MAX_AVOIDED_ARRIVALS)
    }

    /// Drops the plan because there was no progress on its leg `key`.
    fn plan_or_wait(&mut self, key: LegKey) -> Step {
        match self.plan_without(FailedLeg { key, is_harm: false }, MAX_FAILED_ARRIVALS) {
            Step::Unreachable if self.waits_for_a_way() => Step::Keep,
            step => step,
        }
    }

    /// Keeps a leg that failed, so that further plans do without it.
    fn remember(&mut self, leg: FailedLeg) {
        let is_harm = leg.is_harm || self.failed_legs.iter().any(|known| known.key == leg.key && known.is_harm);
        self.failed_legs.retain(|known| known.key != leg.key);
        self.failed_legs.push(FailedLeg { is_harm, ..leg });
        if self.failed_legs.len() > MAX_FAILED_LEGS {
            self.failed_legs.remove(0);
        }
    }

    fn plan_without(&mut self, leg: FailedLeg, max_failed_arrivals: u32) -> Step {
        self.plan = None;
        if !self.config.remembers {
            return Step::Plan;
        }
        self.remember(leg);
        self.failed_arrivals += u32::from(leg.key.to == Stop::Goal);
        if self.failed_arrivals >= max_failed_arrivals {
            // As near as paths lead.
            return Step::Unreachable;
        }
        Step::Plan
    }
}

/// The conduct of staying where the NPC already stays, or at `feet`, m.
fn stay_where_it_was(former: Conduct, feet: Vec3, within: f32) -> Conduct {
    match former {
        Conduct::Stay { at, .. } => Conduct::Stay { at, within },
        Conduct::Go => Conduct::Stay { at: feet, within },
    }
}
