//! The players of a world.

use super::World;
use crate::Vec3;
use crate::player::{Player, PlayerSlot};
use crate::recording::Input;
use crate::slot::BodySlot;

impl World {
    /// Adds a player and returns its slot.
    ///
    /// # Panics
    /// If the player is not sound.
    pub fn spawn_player(&mut self, player: Player) -> PlayerSlot {
        assert!(player.is_sound(), "a player of an allowed size");
        self.note(Input::SpawnPlayer(player));
        let free = self.players.iter().position(Option::is_none).unwrap_or_else(|| {
            self.players.push(None);
            self.players.len() - 1
        });
        self.players[free] = Some(player);
        let slot = PlayerSlot(free as u32);
        self.list(BodySlot::Player(slot));
        slot
    }

    /// Moves a player; `feet` is in m, `velocity` in m/s. Returns false, and changes nothing, if the player does not
    /// exist or a number is not finite.
    pub fn move_player(&mut self, slot: PlayerSlot, feet: Vec3, velocity: Vec3) -> bool {
        let Some(player) = self.player(slot) else { return false };
        let moved = Player { feet, velocity, ..*player };
        if !moved.is_sound() {
            return false;
        }
        self.unlist(BodySlot::Player(slot));
        self.players[slot.0 as usize] = Some(moved);
        self.list(BodySlot::Player(slot));
        self.note(Input::MovePlayer(slot, feet, velocity));
        true
    }

    /// Removes a player; false if it does not exist.
    pub fn remove_player(&mut self, slot: PlayerSlot) -> bool {
        if self.player(slot).is_none() {
            return false;
        }
        self.unlist(BodySlot::Player(slot));
        self.players[slot.0 as usize] = None;
        self.note(Input::RemovePlayer(slot));
        true
    }

    /// The player in a slot, if there is one.
    pub fn player(&self, slot: PlayerSlot) -> Option<&Player> {
        self.players.get(slot.0 as usize).and_then(Option::as_ref)
    }

    /// All players with their slots, in ascending order.
    pub fn players(&self) -> impl Iterator<Item = (PlayerSlot, &Player)> {
        let listed = (0..).zip(&self.players);
        listed.filter_map(|(slot, player)| player.as_ref().map(|player| (PlayerSlot(slot), player)))
    }
}
