//! Replays: a recorded run is repeated bit for bit; a replay that diverges reports the tick.

use crate::Tick;
use crate::map::{Map, Piece};
use crate::npc::{WorldConfig, WorldState};
pub use crate::recording::{CHECK_EVERY_TICKS, Input, REPLAY_VERSION, Recording, ReplayError};
use crate::world::World;
use std::sync::Arc;

impl Recording {
    /// Runs the recording again on `map`, compares the state with each recorded hash, and returns the final state. For
    /// tests, the replay saves the world at tick `restore_at` and continues in a new world that is restored from it.
    ///
    /// # Errors
    /// If the map is another one, a state differs, or an input does not fit the world.
    pub fn replay(&self, map: Arc<Map>, restore_at: Option<Tick>) -> Result<WorldState, ReplayError> {
        if map.built_hash() != self.map {
            return Err(ReplayError::OtherMap { expected: self.map, found: map.built_hash() });
        }
        let inconsistent = |tick: Tick| move |why: String| ReplayError::Inconsistent { tick, why };
        let map = with_pieces(&map, &self.pieces).map_err(inconsistent(Tick(0)))?;
        if !self.start.fits(self.profiles.len(), &map) {
            return Err(ReplayError::Invalid("it needs zip lines or movers that the map does not have"));
        }
        let config =
            WorldConfig { profiles: self.profiles.clone(), task: self.task.clone(), npc_collision: self.npc_collision };
        let mut world = World::with_config(map, config);
        world.restore(self.start.clone());
        let (mut inputs, mut checks) = ((0..).zip(&self.inputs).peekable(), self.checks.iter().peekable());
        let mut agreed = world.current_tick();
        loop {
            let tick = world.current_tick();
            loop {
                let made = inputs.peek().map_or(self.inputs.len() as u64, |(nth, _)| *nth);
                while let Some(check) = checks.next_if(|check| check.tick == tick && check.input_count == made) {
                    if world.save().hash() != check.hash {
                        return Err(ReplayError::Diverged { tick, agreed });
                    }
                    agreed = tick;
                }
                let Some((_, (_, input))) = inputs.next_if(|(_, (at, _))| *at == tick) else { break };
                apply(&mut world, input).map_err(inconsistent(tick))?;
            }
            if tick >= self.end_tick {
                // Remaining inputs belong to a past tick; remaining checks, to inputs that do not exist.
                let is_done = inputs.peek().is_none() && checks.peek().is_none();
                return if is_done { Ok(world.save()) } else { Err(ReplayError::Diverged { tick, agreed }) };
            }
            if restore_at == Some(tick) {
                let state = world.save();
                world = World::with_config(world.map().clone(), world.config().clone());
                world.restore(state);
            }
            world.tick();
        }
    }
}

fn with_pieces(map: &Arc<Map>, pieces: &[Piece]) -> Result<Arc<Map>, String> {
    map.holding(pieces).map_err(|error| error.to_string())
}

fn apply(world: &mut World, input: &Input) -> Result<(), String> {
    if let Some(slot) = input.npc().filter(|slot| world.npc(*slot).is_none()) {
        let name: &'static str = input.into();
        return Err(format!("{name} for NPC {}, which does not exist", slot.0));
    }
    let require = |holds: bool, why: &dyn Fn() -> String| if holds { Ok(()) } else { Err(why()) };
    match input {
        Input::Spawn(profile, feet, yaw) => _ = world.spawn_as(*profile, *feet, *yaw),
        Input::Despawn(slot) => _ = world.despawn(*slot),
        Input::Teleport(slot, feet, yaw) => world.teleport(*slot, *feet, *yaw),
        Input::HeadFor(slot, waypoint, arrival) => world.head_for(*slot, *waypoint, *arrival),
        Input::ClearWaypoint(slot) => world.clear_waypoint(*slot),
        Input::Decide(slot, action) => world.decide(*slot, *action),
        Input::Close(slot) => _ = world.close_decision(*slot),
        Input::Order(mover, order) => {
            let obeys = world.order(*mover, *order);
            return require(obeys, &|| format!("mover {} is missing or cannot follow its order", mover.0));
        }
        Input::SpawnPlayer(player) => _ = world.spawn_player(*player),
        Input::MovePlayer(player, feet, velocity) => {
            let moves = world.move_player(*player, *feet, *velocity);
            return require(moves, &|| format!("player {} does not exist", player.0));
        }
        Input::RemovePlayer(player) => {
            return require(world.remove_player(*player), &|| format!("player {} does not exist", player.0));
        }
        Input::Edit(pieces) => {
            let map = with_pieces(world.map(), pieces)?;
            world.edit(map).map_err(|error| error.to_string())?;
        }
        Input::Reprofile(idx, profile) => {
            let changes = world.reprofile(*idx, profile.as_ref().clone());
            return require(changes, &|| "a profile changes that NPCs have".to_owned());
        }
    }
    Ok(())
}
