//! How an NPC moves on the legs of its plan: steered, composed or freely.

use super::Follower;
use super::moves::SteeredMove;
use super::scene::MoverResponse;
use crate::cross::Cross;
use crate::leap::Leap;
use crate::steer::Course;
use crate::style::Style;
use surefoot_planner::LegKey;
use surefoot_world::{Ability, Gait, Motion};

impl Follower {
    /// How the NPC moves on the current leg, if a rehearsal of it has arrived.
    pub fn style(&self) -> Style {
        if let Some(stay) = self.stay() {
            return stay;
        }
        let Some(ability) = self.ability().filter(|_| self.composes(self.leg)) else { return Style::Free };
        let Some(course) = self.course() else { return Style::for_leg(ability) };
        match self.steered_move(self.leg) {
            Some(SteeredMove::Leap(rims)) => Style::Leap(Leap { rims, course }),
            Some(SteeredMove::Cross(approach)) => Style::Cross(Cross { approach, course }),
            None => Style::Walk(course),
        }
    }

    /// Ability of the next leap or ride, on the current leg or the one after it; [`Ability::WALK`] if there is none.
    pub fn next_ability(&self) -> Ability {
        let legs = self.plan.as_ref().map_or(&[][..], |plan| &plan.legs[self.leg..]);
        let mut abilities = legs.iter().take(2).map(|leg| leg.ability);
        abilities.find(|ability| *ability != Ability::WALK).unwrap_or_default()
    }

    /// The course of the current leg, if the NPC is steered there.
    fn course(&self) -> Option<Course> {
        let plan = self.plan.as_ref().filter(|_| self.steers(self.leg))?;
        if self.detour.via.is_some() {
            return None;
        }
        let next = self.shortcuts.end(self.leg + 1);
        let then = plan.waypoints.get(next).filter(|_| self.steers(next) && !self.rests_after(self.leg));
        let around = self.clearance.corner(plan, self.leg, &self.shortcuts);
        Some(Course {
            to: plan.waypoints[self.leg],
            then: then.copied(),
            cuts: self.leg >= self.exact_until && plan.needs.is_empty(),
            gait: self.config.gait,
            around: around.filter(|_| self.leg >= self.exact_until),
        })
    }

    /// Whether the NPC is steered on a leg of its plan: one on which it goes straight ahead, or that has a controller.
    fn steers(&self, leg: usize) -> bool {
        let motion = self.plan.as_ref().map(|plan| plan.legs[leg].ability.motion());
        let goes_ahead = matches!(
            motion,
            Some(Motion::Walk | Motion::Pull | Motion::Swim | Motion::Dive | Motion::Crouch | Motion::Slide)
        ) || self.steered_move(leg).is_some();
        self.composes(leg) && leg >= self.unsteered_until && goes_ahead
    }

    /// How the NPC is steered on a leg of the plan that cannot be walked, if it is.
    fn steered_move(&self, leg: usize) -> Option<SteeredMove> {
        self.plan.as_ref().and_then(|plan| self.steered_moves.on(plan.legs[leg].key))
    }

    /// How the NPC goes where it can walk.
    pub fn gait(&self) -> Gait {
        self.config.gait
    }

    /// Lets the NPC move composed on legs on which a rehearsal has arrived.
    pub fn compose(&mut self) {
        self.config.composes = true;
    }

    /// Changes how the NPC goes; returns whether that differs from before.
    pub fn set_gait(&mut self, gait: Gait) -> bool {
        std::mem::replace(&mut self.config.gait, gait) != gait
    }

    /// How the NPC stays where it is, if it waits for a mover or rides on one. This needs no rehearsal.
    pub fn stay(&self) -> Option<Style> {
        match self.movers.response {
            MoverResponse::Go => None,
            MoverResponse::Stay { at, within } => Some(Style::Stay { at, within }),
        }
    }

    /// Whether the NPC moves composed on a leg of its plan.
    fn composes(&self, leg: usize) -> bool {
        self.config.composes && leg >= self.free_until
    }

    /// Lets the NPC move in another way up to the end of the leg `key` of its plan: with the waypoints that the planner
    /// gave, without shortcuts, from rest before a leap, as proofs begin, steered without cutting corners, without ways
    /// around, then by its policy, composed, and then freely. False if it already did.
    pub fn move_freely_on(&mut self, key: LegKey) -> bool {
        let Some(plan) = &self.plan else { return false };
        let leg = plan.legs.iter().rposition(|leg| leg.key == key).unwrap_or(self.leg);
        if self.move_waypoints_back(leg) {
            return true;
        }
        if self.remove_shortcut(leg) {
            return true;
        }
        let Some(plan) = &self.plan else { return false };
        let leaps = Ability::JUMPS.contains(&plan.legs[leg].ability) && plan.needs.is_empty();
        if leaps && leg > self.leg && !self.from_rest.contains(&key) {
            self.from_rest.push(key);
            return true;
        }
        if (self.leg..=leg).any(|leg| self.steers(leg)) {
            // Cutting a corner may lead into a wall, down a rim, or off a platform.
            let is_walk = self.steered_move(leg).is_none();
            let cuts = is_walk && self.exact_until <= leg && leg + 1 < plan.legs.len() && plan.needs.is_empty();
            if !cuts && self.remove_way(leg) {
                return true;
            }
            *(if cuts { &mut self.exact_until } else { &mut self.unsteered_until }) = leg + 1;
            return true;
        }
        let composed =
            (self.leg..=leg).any(|leg| self.composes(leg) && Style::for_leg(plan.legs[leg].ability) != Style::Free);
        if composed {
            self.free_until = leg + 1;
        }
        composed
    }
}
