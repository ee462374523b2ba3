//! A decision of all characters in one call: ten ticks, placements, and what is seen then.

use crate::world::{BodyState, Command, GameWorld, Hit};
use surefoot_world::sense::{RAY_COUNT, RAY_RANGE_M, RayCone};
use surefoot_world::{Action, Body, CharacterProfile, TICKS_PER_DECISION, Vec3};

/// Ticks of a decision.
pub(crate) const TICKS: usize = TICKS_PER_DECISION as usize;

/// What happens to characters.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Decision<'a> {
    /// What characters do for ten ticks, ascending. If there are none, no time passes.
    pub actions: &'a [(usize, Action)],
    /// Where characters are put after that, ascending: feet, m, and heading, rad.
    pub placements: &'a [(usize, Vec3, f32)],
}

/// A character, and what each of its rays hits.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Sighting {
    pub state: BodyState,
    pub hits: [Hit; RAY_COUNT],
}

/// How a decision of a character went: its state after each tick, and what its rays hit after the last.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Acted {
    pub ticks: [BodyState; TICKS],
    pub hits: [Hit; RAY_COUNT],
}

/// How a decision went, in the order of its actions and of its placements.
#[derive(Debug, Clone, PartialEq, Default)]
pub(crate) struct Decided {
    pub acted: Vec<Acted>,
    pub placed: Vec<Sighting>,
}

/// The characters of a game, wherever it runs.
pub(crate) trait Bodies: Send {
    /// Carries out a decision.
    ///
    /// # Errors
    /// Says in a sentence why the game cannot go on.
    fn decide(&mut self, decision: Decision<'_>) -> Result<Decided, String>;
}

/// The eyes of all characters.
#[derive(Debug, Clone)]
pub(crate) struct Eyes {
    pub profile: CharacterProfile,
    pub cone: RayCone,
}

impl Eyes {
    /// The eyes of characters with this body.
    pub fn of(profile: &CharacterProfile) -> Self {
        Self { profile: profile.clone(), cone: RayCone::default() }
    }

    /// Origin, m, and unit directions of the rays of a character.
    fn rays(&self, state: &BodyState) -> (Vec3, [Vec3; RAY_COUNT]) {
        let body = Body::at(state.feet, state.yaw);
        (RayCone::eye(&self.profile, &body), self.cone.directions_of(&body))
    }
}

/// A game in this process, tick by tick.
pub(crate) struct Ticked {
    pub world: Box<dyn GameWorld>,
    pub eyes: Eyes,
}

impl Ticked {
    fn look(&self, state: &BodyState) -> [Hit; RAY_COUNT] {
        let (origin, directions) = self.eyes.rays(state);
        self.world.cast(origin, &directions, RAY_RANGE_M)
    }

    /// Runs ten ticks; characters that came to harm are left alone.
    fn act(&mut self, actions: &[(usize, Action)]) -> Vec<[BodyState; TICKS]> {
        let begin = |(character, _): &(usize, Action)| [self.world.state(*character); TICKS];
        let mut acted: Vec<[BodyState; TICKS]> = actions.iter().map(begin).collect();
        for tick in 0..TICKS {
            let before = |states: &[BodyState; TICKS]| states[tick.saturating_sub(1)];
            let moving = actions.iter().zip(&acted).filter(|(_, states)| before(states).harm.is_none());
            let command = |(character, action): (usize, Action)| (character, Command { action, is_first: tick == 0 });
            let commands: Vec<(usize, Command)> = moving.map(|(action, _)| command(*action)).collect();
            self.world.tick(&commands);
            for ((character, _), states) in actions.iter().zip(&mut acted) {
                let before = before(states);
                states[tick] = if before.harm.is_none() { self.world.state(*character) } else { before };
            }
        }
        acted
    }
}

impl Bodies for Ticked {
    fn decide(&mut self, Decision { actions, placements }: Decision<'_>) -> Result<Decided, String> {
        let acted = if actions.is_empty() { Vec::new() } else { self.act(actions) };
        let acted = acted.into_iter().map(|ticks| Acted { hits: self.look(&ticks[TICKS - 1]), ticks }).collect();
        for (character, feet, yaw) in placements {
            self.world.place(*character, *feet, *yaw);
        }
        let sight = |(character, ..): &(usize, Vec3, f32)| {
            let state = self.world.state(*character);
            Sighting { hits: self.look(&state), state }
        };
        Ok(Decided { acted, placed: placements.iter().map(sight).collect() })
    }
}
