//! How a body moves, as an animation graph needs it: its pace, its stride, the phase of a leap or a ride, and the
//! height of what is drawn over steps.

use crate::character::Body;
use crate::float::hypot;
use crate::{Ability, AbilitySet, Action, CharacterProfile, Motion, Steps, TICK_SECONDS, TICKS_PER_SECOND};

/// Height of the hip, as a share of the body's height (Winter, Biomechanics and Motor Control of Human Movement, 2009,
/// figure 4.1).
const HIP_SHARE: f32 = 0.53;
/// Gravity for which these formulas hold, m/s2; that of a body is a game's choice.
const GRAVITY: f32 = 9.81;
/// Froude number at which walking turns into running (Alexander, Physiological Reviews 69, 1989).
const RUN_FROUDE: f32 = 0.5;
/// Speed up to which a body stands, as a share of the speed at which it begins to run.
const IDLE_SHARE: f32 = 0.1;
/// Turn, as a share of the greatest one, above which a body that stands turns in place.
const TURN_SHARE: f32 = 0.05;
/// Least ticks in the air (0.1 s) of a fall without an ability; bumps are shorter.
const MIN_FALL_TICKS: u8 = (TICKS_PER_SECOND / 10) as u8;
/// Ticks for which a landing lasts (0.2 s).
const LANDING_TICKS: u8 = (TICKS_PER_SECOND / 5) as u8;

/// What the legs of a body do.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Pace {
    /// The body stands.
    #[default]
    Idle,
    /// The body turns in place.
    Turn,
    /// The body walks: its Froude number is at most 0.5.
    Walk,
    /// The body runs.
    Run,
    /// The body moves, but its action brings it to rest.
    Stop,
}

/// Phase of a leap, a ride or a fall.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum MovePhase {
    /// The body is about to leave the ground by an ability.
    WindUp,
    /// The body is in the air, climbs, swims, or rides a zip line.
    Flight,
    /// The body has come down within the last 0.2 s.
    Landing,
}

/// How a body moves.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Locomotion {
    /// What the legs do; in the air, what they did last.
    pub pace: Pace,
    /// Phase of the leap, ride or fall; `None` while the body simply stands, walks or runs.
    pub phase: Option<MovePhase>,
    /// Ability of that leap or ride; without a phase, [`Ability::CROUCH`] while the body crouches; otherwise
    /// [`Ability::WALK`].
    pub ability: Ability,
    /// Length of a stride, which is two steps, m; 0 unless the body moves on the ground.
    pub stride_m: f32,
    /// Share of the stride done, in [0, 1): one foot is put down at 0, the other at 0.5.
    pub stride_phase: f32,
    /// Ticks in the air, or since the landing.
    pub ticks: u8,
    /// Whether the body is in the air because of an ability.
    pub was_thrown: bool,
    /// Smooths the height of the drawn body over steps.
    pub steps: Steps,
}

impl Locomotion {
    /// Follows a body by one tick, in which it carried out `action` and used the abilities in `used`.
    pub fn advance(&mut self, body: &Body, profile: &CharacterProfile, action: &Action, used: AbilitySet) {
        self.advance_move(body, used);
        self.steps.advance(body, profile, used.contains(Ability::TELEPORTER));
        if !body.is_grounded() {
            self.stride_m = 0.0;
            return;
        }
        let speed = hypot(body.velocity.x, body.velocity.z);
        self.pace = pace(body, profile, action, speed);
        if matches!(self.pace, Pace::Idle | Pace::Turn) {
            (self.stride_m, self.stride_phase) = (0.0, 0.0);
            return;
        }
        self.stride_m = stride_m(profile, speed);
        let phase = self.stride_phase + speed * TICK_SECONDS / self.stride_m;
        self.stride_phase = phase - phase.floor();
    }

    fn advance_move(&mut self, body: &Body, used: AbilitySet) {
        if body.is_grounded() {
            self.was_thrown = false;
            match self.phase {
                Some(MovePhase::Flight) => (self.phase, self.ticks) = (Some(MovePhase::Landing), 0),
                Some(MovePhase::Landing) if self.ticks < LANDING_TICKS => self.ticks += 1,
                _ => self.end_move(),
            }
            if self.phase.is_none() && body.crouches {
                self.ability = Ability::CROUCH;
            }
            return;
        }
        if self.phase == Some(MovePhase::Landing) {
            self.end_move();
        }
        self.ticks = self.ticks.saturating_add(1);
        // A teleporter does not throw bodies, nor does a ceiling.
        let throws = |ability: &Ability| !matches!(ability.motion(), Motion::Teleport | Motion::Crouch | Motion::Slide);
        if let Some(ability) = used.iter().filter(throws).last() {
            (self.ability, self.was_thrown) = (ability, true);
        }
        if self.was_thrown || self.ticks >= MIN_FALL_TICKS {
            self.phase = Some(MovePhase::Flight);
        }
    }

    fn end_move(&mut self) {
        (self.phase, self.ability, self.ticks) = (None, Ability::WALK, 0);
    }

    /// Whether the body came down in the last tick, from a leap, a ride, or a fall of at least 0.1 s.
    pub fn has_landed(&self) -> bool {
        self.phase == Some(MovePhase::Landing) && self.ticks == 0
    }

    /// The same body when it is about to leave the ground by `ability`. One in the air is not.
    #[must_use]
    pub fn winding_up(self, ability: Ability) -> Self {
        match self.phase {
            Some(MovePhase::Flight) => self,
            _ => Self { phase: Some(MovePhase::WindUp), ability, ..self },
        }
    }
}

/// Height of the hip of a body, m.
fn hip_m(profile: &CharacterProfile) -> f32 {
    HIP_SHARE * profile.height
}

/// What the legs of a body on the ground do, whose horizontal speed is `speed`, m/s.
fn pace(body: &Body, profile: &CharacterProfile, action: &Action, speed: f32) -> Pace {
    let run = (RUN_FROUDE * GRAVITY * hip_m(profile)).sqrt();
    let idle = IDLE_SHARE * run;
    if speed <= idle {
        if action.turn.abs() > TURN_SHARE { Pace::Turn } else { Pace::Idle }
    } else if body.wish(profile, action).length() <= idle {
        Pace::Stop
    } else if speed <= run {
        Pace::Walk
    } else {
        Pace::Run
    }
}

/// Length of a stride at `speed`, m/s, which is more than 0: 2.3 hips times the Froude number to the power of 0.3
/// (Alexander, Nature 261, 1976).
fn stride_m(profile: &CharacterProfile, speed: f32) -> f32 {
    let hip = hip_m(profile);
    2.3 * hip * libm::powf(speed * speed / (GRAVITY * hip), 0.3)
}
