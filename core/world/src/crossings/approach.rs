//! [`Approach`]: where a crossing begins, where it heads, and where it may end.

use crate::ability::Motion;
use crate::character::{Action, Body, CharacterProfile, OwnMotion};
use crate::float::{heading, horizontal, wrapped};
use crate::mesh::ClimbSpot;
use crate::{Ability, DECISION_SECONDS, Vec3};

/// How far in front of a face, besides its radius, a body stands, and how far behind the face it heads, m.
const BEFORE_M: f32 = 0.4;
const BEHIND_M: f32 = 3.0;
/// How far behind an anchor, on the plane, a body may land, m.
pub(super) const BEYOND_ANCHOR_M: f32 = 12.0;
/// Least height of a climb, m: jumps and steps do what is lower.
pub(super) const LEAST_CLIMB_M: f32 = 1.0;
/// Distance on the plane at which an anchor lets a body go, m, and a little.
const RELEASED_M: f32 = 1.2;
/// How far before the place where it may end a move has ended, m.
const PAST_M: f32 = 0.3;
/// Run-up to a move that needs speed, and how far before a rim a body jumps, m.
const RUN_UP_M: f32 = 3.0;
const RIM_M: f32 = 0.2;

/// A way by a move.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Approach {
    /// Where a body stands before the move, m.
    pub at: Vec3,
    /// Where it heads then, m.
    pub toward: Vec3,
    /// Where it may stand after the move, m.
    pub to: Vec3,
    /// The move.
    pub by: Ability,
}

impl Approach {
    /// Horizontal unit vector from where the move begins to where the body heads; zero if it heads straight up.
    pub fn way(&self) -> Vec3 {
        (self.toward - self.at).with_y(0.0).normalize_or_zero()
    }

    /// Where a body that stands sets out, m: far enough away to gain speed where the move needs it.
    pub fn start(&self) -> Vec3 {
        let run_up = if self.by.motion() == Motion::WallRun { RUN_UP_M } else { 0.0 };
        self.at - self.way() * run_up
    }

    /// How far a place is beyond where the move begins, towards where it heads, m.
    pub fn beyond(&self, feet: Vec3) -> f32 {
        (feet - self.at).dot(self.way())
    }

    /// Whether a place is where the move may end, or beyond.
    pub(super) fn is_past(&self, feet: Vec3) -> bool {
        self.beyond(feet) >= self.beyond(self.to) - PAST_M
    }

    /// How far beside the way from there a place is, m.
    pub fn aside(&self, feet: Vec3) -> f32 {
        horizontal(feet - self.at - self.way() * self.beyond(feet))
    }

    /// Whether a body that makes the move jumps: at its beginning, and until it is pulled to an anchor.
    pub fn wants_jump(&self, body: &Body, profile: &CharacterProfile) -> bool {
        match self.by.motion() {
            // After the next decision it would be too late.
            Motion::WallRun => body.is_grounded() && self.beyond(body.feet + body.velocity * DECISION_SECONDS) > -RIM_M,
            Motion::Own => body.own.is_none() && self.is_tether(profile) && !self.is_past_anchor(body, profile),
            _ => false,
        }
    }

    /// Whether a body that is pulled to an anchor has been there, and flies on.
    pub fn is_past_anchor(&self, body: &Body, profile: &CharacterProfile) -> bool {
        let left = self.beyond(self.toward) - BEYOND_ANCHOR_M - self.beyond(body.feet);
        self.is_tether(profile) && body.own.is_none() && left <= RELEASED_M
    }

    fn is_tether(&self, profile: &CharacterProfile) -> bool {
        profile.own_move(self.by).is_some_and(|it| it.motion == OwnMotion::Tether)
    }

    /// The action of a scripted body that stands where the move begins: straight on.
    pub(super) fn ahead(&self, body: &Body, profile: &CharacterProfile) -> Action {
        let off = wrapped(heading(self.toward - body.feet) - body.yaw);
        let is_far = horizontal(self.toward - body.feet) > BEFORE_M;
        let turn = if is_far { (off / (DECISION_SECONDS * profile.turn_speed)).clamp(-1.0, 1.0) } else { 0.0 };
        let jump = if self.wants_jump(body, profile) { 1.0 } else { -1.0 };
        Action { forward: 1.0, turn, jump, ..Action::default() }
    }
}

/// The climb at a spot, for a body with this radius, m.
pub(super) fn climbed_at(ClimbSpot { at, out, height }: ClimbSpot, radius: f32) -> Approach {
    Approach {
        at: at + out * (radius + BEFORE_M),
        toward: at - out * BEHIND_M,
        to: at - out * radius + Vec3::Y * height,
        by: Ability::CLIMB,
    }
}

/// The way of a spot, by a curve.
pub(super) fn taken([at, to]: [Vec3; 2], by: Ability) -> Approach {
    Approach { at, toward: to, to, by }
}

/// A pull to an anchor from a place, m; the body flies on beyond the anchor.
pub(super) fn tethered([at, anchor]: [Vec3; 2], to: Vec3, by: Ability) -> Approach {
    let way = (anchor - at).with_y(0.0).normalize_or_zero();
    Approach { at, toward: anchor + way * BEYOND_ANCHOR_M, to, by }
}
