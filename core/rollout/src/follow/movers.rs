//! What a follower does about movers: it waits before a leg, rides, calls lifts, and waits where movers bar all ways.

use super::scene::{MoverResponse, Scene};
use super::{Follower, Step};
use surefoot_planner::needs::{Needs, Ride};
use surefoot_planner::{LegKey, Stop};
use surefoot_world::{End, TICKS_PER_SECOND, Vec3};

/// Decisions for which an NPC waits for a mover before the leg counts as failed: 40 s.
const MAX_STAY: u32 = 240;
/// Decisions for which an NPC waits for movers that bar all ways before the goal counts as unreachable: 30 s.
const MAX_BARRED: u32 = 180;
/// Decisions after which a barred NPC looks for another way once more.
const BARRED_RETRY: u32 = 30;
/// Distance within which a barred NPC waits, m.
const BARRED_WITHIN_M: f32 = 1.5;
/// Speed at which an NPC gets to a mover in any case, m/s.
const UNHURRIED_M_PER_S: f32 = 5.0;

impl Follower {
    /// Looks at the movers before a decision, with the feet at `feet`, m. Drops the plan if movers have barred a leg
    /// ahead, or have opened a way where all were barred. A body in the air or on a ride cannot turn back and keeps its
    /// plan.
    pub fn watch_movers(&mut self, scene: Scene<'_>, feet: Vec3, is_grounded: bool) {
        let stops = scene.stops_ahead();
        let has_changed = stops != self.movers.stops;
        self.movers.stops = stops;
        let former = std::mem::replace(&mut self.movers.response, MoverResponse::Go);
        self.movers.call = None;
        if self.movers.is_barred {
            return self.look_for_a_way(former, feet, is_grounded, has_changed);
        }
        let Some(plan) = &self.plan else { return };
        let ride = plan.needs_of(self.leg).and_then(|needs| needs.ride);
        if has_changed && is_grounded && ride.is_none() {
            let is_met = |needs: &Needs| needs.are_met(&self.movers.stops);
            let is_barred = plan.needs.iter().any(|(leg, needs)| *leg >= self.leg && !is_met(needs));
            if is_barred || plan.nearest.is_some() {
                self.plan = None;
                return;
            }
        }
        let Some(needs) = plan.needs_of(self.leg).copied() else { return };
        match ride {
            Some(ride) => self.ride(scene, ride, feet, is_grounded),
            None => self.wait_before_leg(scene, &needs, former, feet),
        }
    }

    /// Drops the plan of a barred NPC, so that it plans again, when movers have changed or after a while.
    fn look_for_a_way(&mut self, former: MoverResponse, feet: Vec3, is_grounded: bool, has_changed: bool) {
        if is_grounded && (has_changed || self.movers.barred.is_multiple_of(BARRED_RETRY)) {
            // Legs that failed while the way was barred may succeed now.
            self.failures.forgive();
            (self.plan, self.movers.is_barred) = (None, false);
        } else {
            self.movers.response = former.stay_or(feet, BARRED_WITHIN_M);
        }
    }

    fn ride(&mut self, scene: Scene<'_>, ride: Ride, feet: Vec3, is_grounded: bool) {
        let Some(plan) = &self.plan else { return };
        let end = plan.waypoints[self.leg];
        if is_grounded && scene.is_missed(ride, feet, end) {
            // The NPC stands where the mover will be, and must not wait there.
            let key = LegKey { from: Stop::Start, to: plan.legs[self.leg].key.from };
            self.plan = None;
            self.failures.add(key, true);
            self.replans += 1;
            return;
        }
        self.movers.response = scene.ride(ride, feet, end);
        self.movers.call = scene.call_of_ride(ride, feet, end);
    }

    fn wait_before_leg(&mut self, scene: Scene<'_>, needs: &Needs, former: MoverResponse, feet: Vec3) {
        let Some(plan) = &self.plan else { return };
        let waypoint = plan.waypoints[self.leg];
        let boards = plan.needs_of(self.leg + 1).is_some_and(|next| next.ride.is_some());
        let is_at_start = self.movers.stayed > 0 || self.decisions_on_leg == 0;
        if !(is_at_start || boards && scene.is_gone(needs, feet, waypoint)) {
            return;
        }
        // The duration of the leg includes the usual wait.
        let ticks = feet.distance(waypoint) / UNHURRIED_M_PER_S * TICKS_PER_SECOND as f32;
        self.movers.response = scene.before_leg(needs, feet, ticks as u32);
        if let MoverResponse::Stay { within, .. } = self.movers.response {
            // The leg's first vertex is clear of the mover.
            let begin = self.leg.checked_sub(1).map_or(feet, |before| plan.waypoints[before]);
            self.movers.response = former.stay_or(begin, within);
            self.movers.call = scene.call_before_leg(needs);
        }
    }

    /// The step of an NPC that movers bar; `None` if none does.
    pub(super) fn wait_until_unbarred(&mut self) -> Option<Step> {
        if !self.movers.is_barred {
            return None;
        }
        self.movers.barred += 1;
        Some(if self.movers.barred > MAX_BARRED { Step::End(End::Unreachable) } else { Step::Keep })
    }

    /// The step of an NPC that stays for a mover on its leg.
    pub(super) fn stay_on_leg(&mut self) -> Step {
        self.movers.stayed += 1;
        if self.movers.stayed <= MAX_STAY { Step::Keep } else { self.plan_or_wait() }
    }

    /// Lets the NPC wait where no way leads on, if movers bar some and its patience lasts; returns whether it waits.
    pub fn wait_for_a_way(&mut self) -> bool {
        let movers = &mut self.movers;
        movers.is_barred = !movers.stops.is_empty() && movers.barred < MAX_BARRED;
        if movers.is_barred {
            movers.barred += 1;
            self.plan = None;
        }
        movers.is_barred
    }
}
