//! An attempt: one NPC on its way to one goal by plan, with rehearsals of what lies ahead.
//!
//! An [`Attempt`] is a state machine without a world. For each decision its driver
//! 1. shows it the movers ([`Follower::watch_movers`]),
//! 2. rehearses: [`review`](Attempt::review), [`is_due`](Attempt::is_due),
//!    [`begin_rehearsals`](Attempt::begin_rehearsals), then [`rehearsal`](Attempt::rehearsal) and
//!    [`record_rehearsal`](Attempt::record_rehearsal) until one ends well or the attempt ends, which may change the
//!    waypoint,
//! 3. acts in the attempt's [`style`](Attempt::style),
//! 4. compares the body with the [`forecast`](Attempt::check_forecast) and records the decision
//!    ([`Follower::record_decision`]), which says where to head, when to plan and when to end.

use crate::follow::{Follower, Ground, Step};
use crate::leap;
use crate::rehearse::{Forecast, NoiseStream, RehearsalFailure, RehearsalStart};
use crate::style::Style;
use surefoot_planner::{Plan, Query};
use surefoot_world::arrival::Rims;
use surefoot_world::character::Body;
use surefoot_world::crossings::{Approach, approach_between};
use surefoot_world::{Ability, Arrival, CharacterProfile, Gait, Map, Npc, Trajectory, Vec3, around, arrival};

/// Rehearsals that end in harm, with other noise each time, before the NPC takes another way.
const HARM_DRAWS: u32 = 3;
/// Rehearsals without progress, with other noise each time, before the NPC takes another way.
const STALL_DRAWS: u32 = 2;
/// Distance of a goal up to which a straight walk to it may do without a rehearsal, m.
const STRAIGHT_M: f32 = 8.0;
/// Distance on both sides of a straight walk at which it must be as plain, so that it needs no rehearsal, m.
const MARGIN_M: f32 = 1.0;
/// Most rehearsals before one decision.
const MAX_REHEARSALS: u32 = 96;

/// An attempt of one NPC.
#[derive(Debug, Clone)]
pub struct Attempt {
    /// The plan and the progress along it.
    pub follower: Follower,
    /// How the NPC will be after the legs that were rehearsed last.
    forecast: Option<Forecast>,
    /// Distance between a body and its forecast up to which the forecast holds, m; at 0 they must be the same.
    slack_m: f32,
    must_rehearse: bool,
    retries: RetryBudget,
    /// Whether the next decision continues the rehearsals of this one.
    are_deferred: bool,
}

/// What follows a rehearsal.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum AfterRehearsal {
    /// The NPC acts: the rehearsal ended well, or the NPC waits until a mover opens a way.
    Act,
    /// The NPC rehearses the same legs again.
    Rehearse,
    /// The NPC takes another plan, and rehearses that.
    Plan,
    /// The attempt ends as unreachable.
    End,
}

impl Attempt {
    /// Starts an attempt, which rehearses before its first decision.
    pub fn new(follower: Follower) -> Self {
        Self {
            follower,
            forecast: None,
            slack_m: 0.0,
            must_rehearse: false,
            retries: RetryBudget::default(),
            are_deferred: false,
        }
    }

    /// The same attempt in another simulation, where forecasts hold while the body keeps within `slack_m`, m.
    #[must_use]
    pub fn with_slack(self, slack_m: f32) -> Self {
        Self { slack_m, ..self }
    }

    /// Takes a plan and returns its first waypoint, m.
    pub fn take_plan(&mut self, plan: Plan) -> Vec3 {
        self.forget_forecast();
        self.follower.take_plan(plan)
    }

    /// Plans from `feet`, m, with `search`, and returns the first waypoint of the plan, m.
    pub fn plan(&mut self, feet: Vec3, search: impl FnMut(&Query) -> Plan) -> Vec3 {
        self.forget_forecast();
        self.follower.plan(feet, search)
    }

    /// Follows a goal that may have moved, m, with the feet at `feet`, m. Returns the waypoint, m, if it has changed,
    /// and rehearses the way to it.
    pub fn follow_goal(&mut self, goal: Vec3, feet: Vec3, has_arrived: bool) -> Option<Vec3> {
        let waypoint = self.follower.move_goal(goal, feet, has_arrived);
        if waypoint.is_some() {
            self.forget_forecast();
        }
        waypoint
    }

    /// Changes how the NPC goes, and rehearses its way again if that differs from before. Returns whether the NPC needs
    /// another plan, because it would take another way; until then it follows the plan that it has.
    pub fn set_gait(&mut self, gait: Gait) -> bool {
        let former = self.follower.gait();
        if !self.follower.set_gait(gait) || self.follower.waypoint().is_none() {
            return false;
        }
        self.forget_forecast();
        !gait.goes_like(former)
    }

    /// How the NPC moves in the next decision: composed only where a rehearsal has shown that it arrives so, or where
    /// it could walk straight to a goal at which it must stand.
    pub fn style(&self, map: &Map, profile: &CharacterProfile, body: &Body) -> Style {
        let style = self.follower.style();
        let is_shown = self.is_forecast() || self.follower.stay().is_some();
        let walks = matches!(style, Style::Walk(_)) || style == Style::for_leg(Ability::WALK);
        if is_shown || walks && self.walks_straight(map, profile, body) { style } else { Style::Free }
    }

    /// Whether the body could walk straight to a goal nearby at which it must stand.
    fn walks_straight(&self, map: &Map, profile: &CharacterProfile, body: &Body) -> bool {
        self.near_goal(body).is_some_and(|goal| arrival::walks_straight(map, profile, body.feet, goal))
    }

    /// The goal, m, if it is next, near a body on the ground, and the body must stand there.
    fn near_goal(&self, body: &Body) -> Option<Vec3> {
        let goal = self.follower.waypoint().filter(|_| self.follower.arrival() == Arrival::Stand)?;
        (body.is_grounded() && goal.distance(body.feet) <= STRAIGHT_M).then_some(goal)
    }

    /// Reviews a new plan on the map, for ways between two places, m, that `may_cross` allows. True if the driver makes
    /// another plan, for another review.
    pub fn review(
        &mut self,
        map: &Map,
        profile: &CharacterProfile,
        body: &Body,
        may_cross: impl Fn(Vec3, Vec3) -> bool,
    ) -> bool {
        self.follower.review(body.feet, &OnMap { map, profile, may_cross })
    }

    /// The waypoint, m, if reviews and rehearsals have changed it: if `npc` heads for another one, or arrives there in
    /// another way.
    pub fn changed_waypoint(&self, npc: &Npc) -> Option<Vec3> {
        let heads_for = npc.episode.map(|episode| (episode.goal, episode.arrival));
        self.follower.waypoint().filter(|waypoint| heads_for != Some((*waypoint, self.follower.arrival())))
    }

    /// Lets the NPC act without a rehearsal where it must stand at a goal nearby, and the way there and both sides of
    /// that way are plain ground.
    pub fn skip_plain_rehearsal(&mut self, map: &Map, profile: &CharacterProfile, body: &Body) {
        let Some(goal) = self.near_goal(body).filter(|_| self.is_due()) else { return };
        let ahead = (goal - body.feet).with_y(0.0).normalize_or_zero() * MARGIN_M;
        let is_plain = [Vec3::ZERO, ahead.cross(Vec3::Y), Vec3::Y.cross(ahead)]
            .into_iter()
            .all(|side| arrival::is_plain(map, profile, body.feet + side, goal + side));
        self.must_rehearse = !is_plain;
    }

    /// Whether a rehearsal has shown the next decision.
    pub fn is_forecast(&self) -> bool {
        self.forecast.as_ref().is_some_and(Forecast::is_ahead)
    }

    /// What the NPC with this `body` will do in the next second, as far as it was rehearsed.
    pub fn trajectory(&self, body: &Body) -> Trajectory {
        let ability = self.follower.next_ability();
        self.forecast.as_ref().map(|forecast| forecast.trajectory(body, ability)).unwrap_or_default()
    }

    /// Whether the NPC has to rehearse before its next decision.
    pub fn is_due(&self) -> bool {
        self.must_rehearse && self.follower.waypoint().is_some()
    }

    /// Whether the NPC has to rehearse and has no forecast to continue from.
    pub fn must_rehearse_from_here(&self) -> bool {
        self.must_rehearse && self.forecast.is_none()
    }

    /// Lets the NPC rehearse the legs that are new before its next decision.
    pub fn extend_forecast(&mut self) {
        self.must_rehearse = true;
    }

    /// Lets the NPC rehearse from where it is before its next decision.
    pub fn forget_forecast(&mut self) {
        (self.forecast, self.must_rehearse) = (None, true);
    }

    /// Compares the body after a decision with the forecast. Where they differ, the forecast is void; returns whether
    /// it holds.
    pub fn check_forecast(&mut self, body: &Body) -> bool {
        let slack_m = self.slack_m;
        let holds = self.forecast.as_mut().is_some_and(|forecast| forecast.matches(body, slack_m));
        if !holds && self.follower.waypoint().is_some() {
            self.forget_forecast();
        }
        holds
    }

    /// Takes a forecast that was made some decisions ago, and compares the body with it.
    pub fn catch_up(&mut self, decisions: u32, body: &Body) {
        if let Some(forecast) = self.forecast.as_mut().filter(|_| decisions > 0) {
            forecast.skip(decisions - 1);
            self.check_forecast(body);
        }
    }

    /// Begins the rehearsals before a decision, whose retries are counted together, with those of the decision before
    /// if that deferred some.
    pub fn begin_rehearsals(&mut self) {
        self.must_rehearse = false;
        if !std::mem::take(&mut self.are_deferred) {
            self.retries = RetryBudget::default();
        }
    }

    /// Lets the NPC go on with its rehearsals at its next decision.
    pub fn defer_rehearsals(&mut self) {
        self.forget_forecast();
        self.are_deferred = true;
    }

    /// The rehearsal of an NPC in this state, with its row of the policy's hidden state.
    pub fn rehearsal(&mut self, npc: Npc, hidden: Vec<f32>, noise: NoiseStream) -> RehearsalStart {
        RehearsalStart { npc, follower: self.follower.clone(), hidden, noise, forecast: self.forecast.take() }
    }

    /// Records how a rehearsal ended. After a failure the NPC first moves freely, then draws other noise, then takes
    /// another way.
    pub fn record_rehearsal(
        &mut self,
        result: Result<Forecast, RehearsalFailure>,
        noise: &mut NoiseStream,
    ) -> AfterRehearsal {
        let failure = match result {
            Ok(forecast) => {
                self.follower.set_rehearsed_way(forecast.way());
                (self.forecast, self.must_rehearse) = (Some(forecast), false);
                return AfterRehearsal::Act;
            }
            Err(failure) => failure,
        };
        match self.retries.spend(failure, &mut self.follower) {
            Recovery::MoveFreely => AfterRehearsal::Rehearse,
            Recovery::ChangeNoise => {
                noise.change();
                AfterRehearsal::Rehearse
            }
            Recovery::Avoid(RehearsalFailure { leg, is_harm }) if self.follower.avoid(leg, is_harm) == Step::Plan => {
                AfterRehearsal::Plan
            }
            Recovery::Avoid(_) | Recovery::Stop if self.follower.wait_for_a_way() => AfterRehearsal::Act,
            Recovery::Avoid(_) | Recovery::Stop => AfterRehearsal::End,
        }
    }
}

/// The ground of a map for a body, which may leave its legs where `may_cross` allows.
struct OnMap<'a, F> {
    map: &'a Map,
    profile: &'a CharacterProfile,
    may_cross: F,
}

impl<F: Fn(Vec3, Vec3) -> bool> Ground for OnMap<'_, F> {
    fn is_walk(&self, from: Vec3, to: Vec3) -> bool {
        arrival::walks_straight(self.map, self.profile, from, to)
    }

    fn is_lane(&self, from: Vec3, to: Vec3, margin: f32) -> bool {
        (self.may_cross)(from, to) && arrival::is_lane(self.map, self.profile, [from, to], margin)
    }

    fn is_way(&self, from: Vec3, to: Vec3) -> bool {
        (self.may_cross)(from, to) && self.is_walk(from, to)
    }

    fn is_walled(&self, from: Vec3, to: Vec3) -> bool {
        arrival::is_walled(self.map, self.profile, from, to)
    }

    fn walk_around(&self, from: Vec3, to: Vec3) -> Option<Vec<Vec3>> {
        let way = around::walk_around(self.map, self.profile, [from, to])?;
        let starts = std::iter::once(&from).chain(&way);
        starts.zip(&way).all(|(from, to)| (self.may_cross)(*from, *to)).then_some(way)
    }

    fn rims(&self, from: Vec3, to: Vec3) -> Option<Rims> {
        arrival::rims(self.map, self.profile, [from, to]).filter(|rims| leap::is_possible(rims, to, self.profile))
    }

    fn approach(&self, ends: [Vec3; 2], by: Ability) -> Option<Approach> {
        approach_between(self.map, self.profile, ends, Some(by))
    }

    fn with_room(&self, at: Vec3, margin: f32) -> Vec3 {
        arrival::with_room(self.map, self.profile, at, margin)
    }
}

/// What an NPC does after a rehearsal that failed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Recovery {
    /// Rehearse the same legs once more, moving freely.
    MoveFreely,
    /// Rehearse the same legs once more, with other noise.
    ChangeNoise,
    /// Take another way, without the leg that failed.
    Avoid(RehearsalFailure),
    /// Stop: no way is left.
    Stop,
}

/// The rehearsals that have failed before one decision.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct RetryBudget {
    of_plan: u32,
    in_all: u32,
}

impl RetryBudget {
    /// Counts a failure and returns what the NPC does.
    pub fn spend(&mut self, failure: RehearsalFailure, follower: &mut Follower) -> Recovery {
        if follower.move_freely_on(failure.leg) {
            return Recovery::MoveFreely;
        }
        self.of_plan += 1;
        self.in_all += 1;
        let draws = if failure.is_harm { HARM_DRAWS } else { STALL_DRAWS };
        if self.in_all >= MAX_REHEARSALS {
            Recovery::Stop
        } else if self.of_plan < draws {
            Recovery::ChangeNoise
        } else {
            self.of_plan = 0;
            Recovery::Avoid(failure)
        }
    }
}
