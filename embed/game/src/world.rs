//! What a game implements: characters that move by ticks and see by rays.

use surefoot_world::mesh::Surface;
use surefoot_world::sense::RAY_COUNT;
use surefoot_world::{AbilitySet, Action, End, Vec3};

/// What a ray hit: the distance, m, and the surface.
pub type Hit = Option<(f32, Surface)>;

/// A character of a game.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct BodyState {
    /// Lowest point of the body, m; y is up.
    pub feet: Vec3,
    /// Velocity, m/s.
    pub velocity: Vec3,
    /// Heading, rad: at 0 the body faces +z, at pi/2 it faces +x.
    pub yaw: f32,
    /// Whether it stands on ground on which it can walk.
    pub is_grounded: bool,
    /// Whether a jump wanted now would be made, from the ground or in the air.
    pub can_jump: bool,
    /// Whether it rides a zip line.
    pub rides: bool,
    /// Seconds of jetpack thrust left.
    pub fuel: f32,
    /// Whether it is in water.
    pub is_in_water: bool,
    /// How it came to harm, if it did: it fell out of the level, burnt or drowned. It is then ignored until it is
    /// placed again.
    pub harm: Option<End>,
    /// Abilities that it used in the last tick.
    pub used_abilities: AbilitySet,
}

/// What a character does in a tick.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Command {
    /// Forward, strafe (positive to the right), turn (positive as yaw grows) and jump, each -1 to 1.
    pub action: Action,
    /// Whether this is the first of the ten ticks for which the action holds. If `action.jump` is above 0, the
    /// character jumps once in these ticks, as soon as it can.
    pub is_first: bool,
}

/// A level of a game with its characters, which count from 0 and do not get in each other's way.
pub trait GameWorld: Send {
    /// Puts a character there, at rest, unharmed and with nothing left of what it did; `feet` is in m, `yaw` in rad.
    fn place(&mut self, character: usize, feet: Vec3, yaw: f32);

    /// Advances the world by a tick of 1/60 s. The characters in `commands`, in ascending order, carry out their
    /// actions. All others may be ignored.
    fn tick(&mut self, commands: &[(usize, Command)]);

    /// The state of a character.
    fn state(&self, character: usize) -> BodyState;

    /// Casts rays of at most `range` m from `origin`, m, in these unit directions. Rays pass through characters.
    fn cast(&self, origin: Vec3, directions: &[Vec3; RAY_COUNT], range: f32) -> [Hit; RAY_COUNT];
}
