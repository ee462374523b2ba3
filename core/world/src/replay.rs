//! Replays: a recorded run is repeated bit for bit; a replay that diverges reports the tick.

use crate::Tick;
use crate::map::{Map, Piece};
use crate::npc::{NpcSlot, WorldConfig, WorldState};
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
        let map = holding(&map, Tick(0), &self.pieces)?;
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
                apply(&mut world, tick, input)?;
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

fn holding(map: &Arc<Map>, tick: Tick, pieces: &[Piece]) -> Result<Arc<Map>, ReplayError> {
    map.holding(pieces).map_err(|error| ReplayError::NoSuchEdit { tick, why: error.to_string() })
}

fn apply(world: &mut World, tick: Tick, input: &Input) -> Result<(), ReplayError> {
    match input {
        Input::Spawn(profile, feet, yaw) => _ = world.spawn_as(*profile, *feet, *yaw),
        Input::Order(mover, order) => {
            let obeyed = world.order(*mover, *order);
            return if obeyed { Ok(()) } else { Err(ReplayError::NoSuchMover { tick, mover: *mover }) };
        }
        Input::SpawnPlayer(player) => _ = world.spawn_player(*player),
        Input::MovePlayer(player, feet, velocity) => {
            let moved = world.move_player(*player, *feet, *velocity);
            return if moved { Ok(()) } else { Err(ReplayError::NoSuchPlayer { tick, player: player.0 }) };
        }
        Input::RemovePlayer(player) => {
            let removed = world.remove_player(*player);
            return if removed { Ok(()) } else { Err(ReplayError::NoSuchPlayer { tick, player: player.0 }) };
        }
        Input::Edit(pieces) => {
            let map = holding(world.map(), tick, pieces)?;
            let edited = world.edit(map);
            edited.map_err(|error| ReplayError::NoSuchEdit { tick, why: error.to_string() })?;
        }
        // Recordings of version 0.2 contain calls that removed nothing.
        Input::Despawn(slot) => _ = world.despawn(*slot),
        Input::Reprofile(idx, profile) => {
            let changed = world.reprofile(*idx, profile.as_ref().clone());
            return if changed { Ok(()) } else { Err(ReplayError::Invalid("a profile changes that NPCs have")) };
        }
        Input::Teleport(slot, feet, yaw) => {
            check_npc(world, tick, *slot, "teleport")?;
            world.teleport(*slot, *feet, *yaw);
        }
        Input::SetWaypoint(slot, goal) => {
            check_npc(world, tick, *slot, "set waypoint")?;
            world.set_waypoint(*slot, *goal);
        }
        Input::ClearWaypoint(slot) => {
            check_npc(world, tick, *slot, "clear waypoint")?;
            world.clear_waypoint(*slot);
        }
        Input::Decide(slot, action) => {
            check_npc(world, tick, *slot, "decide")?;
            world.decide(*slot, *action);
        }
        Input::Close(slot) => {
            check_npc(world, tick, *slot, "close decision")?;
            world.close_decision(*slot);
        }
    }
    Ok(())
}

fn check_npc(world: &World, tick: Tick, slot: NpcSlot, input: &'static str) -> Result<(), ReplayError> {
    world.npc(slot).map(|_| ()).ok_or(ReplayError::Inconsistent { tick, input, slot: slot.0 })
}
