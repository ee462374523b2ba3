//! Replays: a recorded run is repeated bit for bit; a replay that diverges reports the tick.

use crate::map::Map;
use crate::npc::{WorldConfig, WorldState};
pub use crate::recording::{CHECK_EVERY_TICKS, Input, REPLAY_VERSION, Recording, ReplayError};
use crate::world::World;
use std::sync::Arc;

impl Recording {
    /// Runs the recording again on `map`, compares the state with the recorded one at every check and at the end, and returns
    /// the final state. For tests, the world is saved at tick `restore_at` and the replay continues in a new world restored
    /// from that state.
    ///
    /// # Errors
    /// If the map is another one, a state differs, or an NPC or zip line that is named does not exist.
    pub fn replay(&self, map: Arc<Map>, restore_at: Option<u64>) -> Result<WorldState, ReplayError> {
        if map.hash() != self.map {
            return Err(ReplayError::OtherMap { expected: self.map, found: map.hash() });
        }
        if !self.start.fits(self.profiles.len(), &map) {
            return Err(ReplayError::Senseless("it needs zip lines or movers that the map does not have"));
        }
        let config =
            WorldConfig { profiles: self.profiles.clone(), task: self.task.clone(), npc_collision: self.npc_collision };
        let mut world = World::with_config(map.clone(), config.clone());
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
                apply(&mut world, tick, *input)?;
            }
            if tick >= self.end_tick {
                // What is left names a past tick, or a state after inputs that do not exist.
                let is_done = inputs.peek().is_none() && checks.peek().is_none();
                return if is_done { Ok(world.save()) } else { Err(ReplayError::Diverged { tick, agreed }) };
            }
            if restore_at == Some(tick) {
                let state = world.save();
                world = World::with_config(map.clone(), config.clone());
                world.restore(state);
            }
            world.tick();
        }
    }
}

fn apply(world: &mut World, tick: u64, input: Input) -> Result<(), ReplayError> {
    let (slot, name) = match input {
        Input::Spawn(profile, feet, yaw) => {
            world.spawn_as(profile, feet, yaw);
            return Ok(());
        }
        Input::Order(mover, order) => {
            let obeyed = world.order(mover, order);
            return if obeyed { Ok(()) } else { Err(ReplayError::NoSuchMover { tick, mover }) };
        }
        Input::SpawnPlayer(player) => {
            world.spawn_player(player);
            return Ok(());
        }
        Input::MovePlayer(player, feet, velocity) => {
            let moved = world.move_player(player, feet, velocity);
            return if moved { Ok(()) } else { Err(ReplayError::NoSuchPlayer { tick, player: player.0 }) };
        }
        Input::RemovePlayer(player) => {
            let removed = world.remove_player(player);
            return if removed { Ok(()) } else { Err(ReplayError::NoSuchPlayer { tick, player: player.0 }) };
        }
        Input::Despawn(slot) => (slot, "despawn"),
        Input::Teleport(slot, ..) => (slot, "teleport"),
        Input::SetGoal(slot, _) => (slot, "set goal"),
        Input::ClearGoal(slot) => (slot, "clear goal"),
        Input::Decide(slot, _) => (slot, "decide"),
        Input::Close(slot) => (slot, "close decision"),
    };
    if world.npc(slot).is_none() {
        return Err(ReplayError::Inconsistent { tick, input: name, slot: slot.0 });
    }
    match input {
        Input::Spawn(..)
        | Input::Order(..)
        | Input::SpawnPlayer(_)
        | Input::MovePlayer(..)
        | Input::RemovePlayer(_) => {}
        Input::Despawn(_) => _ = world.despawn(slot),
        Input::Teleport(_, feet, yaw) => world.teleport(slot, feet, yaw),
        Input::SetGoal(_, goal) => world.set_goal(slot, goal),
        Input::ClearGoal(_) => world.clear_goal(slot),
        Input::Decide(_, action) => world.decide(slot, action),
        Input::Close(_) => _ = world.close_decision(slot),
    }
    Ok(())
}
