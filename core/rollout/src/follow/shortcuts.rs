//! Shortcuts: walk legs in a row are walked as one where the body could walk straight, so that NPCs do not zigzag from
//! vertex to vertex.
//!
//! No proof covers a shortcut. Its rehearsal shows whether the NPC arrives, and where it does not, the NPC takes the
//! legs of the plan.

use std::ops::RangeInclusive;
use surefoot_planner::Plan;
use surefoot_world::{Ability, Vec3};

/// Most legs of a shortcut.
const MAX_LEGS: usize = 8;
/// Longest shortcut, m.
const MAX_LENGTH_M: f32 = 40.0;

/// The shortcuts of a plan: ranges of legs, in ascending order.
#[derive(Debug, Clone, Default)]
pub(super) struct Shortcuts {
    ranges: Vec<RangeInclusive<usize>>,
}

impl Shortcuts {
    /// Looks for shortcuts in a new plan from `feet`, m, to be walked where `is_lane` says that a body could walk from
    /// one place to another.
    pub fn find(plan: &Plan, feet: Vec3, is_lane: impl Fn(Vec3, Vec3) -> bool) -> Self {
        let mut ranges = Vec::new();
        let walks = |leg: &usize| plan.legs[*leg].ability == Ability::WALK;
        let (mut from, mut leg) = (feet, 0);
        while leg < plan.legs.len() {
            let last = (leg..plan.legs.len()).take(MAX_LEGS).take_while(walks).last().unwrap_or(leg);
            let is_good = |end: &usize| {
                let to = plan.waypoints[*end];
                from.distance(to) <= MAX_LENGTH_M && is_lane(from, to)
            };
            let end = (leg + 1..=last).rev().find(is_good).unwrap_or(leg);
            if end > leg {
                ranges.push(leg..=end);
            }
            (from, leg) = (plan.waypoints[end], end + 1);
        }
        Self { ranges }
    }

    /// The last leg of the shortcut that contains `leg`; `leg` itself if there is none.
    pub fn end(&self, leg: usize) -> usize {
        self.containing(leg).map_or(leg, |at| *self.ranges[at].end())
    }

    /// The first leg of the shortcut that contains `leg`; `leg` itself if there is none.
    pub fn begin(&self, leg: usize) -> usize {
        self.containing(leg).map_or(leg, |at| *self.ranges[at].start())
    }

    /// Whether a leg is part of a shortcut.
    pub fn contain(&self, leg: usize) -> bool {
        self.containing(leg).is_some()
    }

    fn containing(&self, leg: usize) -> Option<usize> {
        self.ranges.iter().position(|range| range.contains(&leg))
    }

    /// Forgets shortcuts with one of these legs of a plan, which become the last of them.
    pub fn merge(&mut self, legs: &RangeInclusive<usize>) {
        let fewer = legs.end() - legs.start();
        self.ranges.retain(|range| range.end() < legs.start() || range.start() > legs.end());
        for range in self.ranges.iter_mut().filter(|range| range.start() > legs.end()) {
            *range = range.start() - fewer..=range.end() - fewer;
        }
    }

    /// Removes the shortcut that contains `leg`, and returns its legs.
    pub fn remove(&mut self, leg: usize) -> Option<RangeInclusive<usize>> {
        self.containing(leg).map(|at| self.ranges.remove(at))
    }
}
