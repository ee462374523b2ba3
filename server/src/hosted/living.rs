//! Calls about the movers and players of a world.

use super::world::HostedWorld;
use crate::ids::WorldId;
use std::collections::BTreeSet;
use surefoot_world::map::{Mover, MoverKind};
use surefoot_world::player::MAX_PLAYERS;
use surefoot_world::{MoverId, MoverOrder, MoverState, PACE_RANGE, Player, PlayerSlot, StopIdx, Vec3};

/// Why a mover or a player cannot be changed.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[expect(missing_docs, reason = "the texts say what the variants mean")]
pub enum LivingError {
    #[error("world {0} has no mover `{1}`: ListMovers names them")]
    NoSuchMover(WorldId, String),
    #[error("{field}: {message}")]
    Order { field: &'static str, message: String },
    #[error("world {0} has no player {1}")]
    NoSuchPlayer(WorldId, u32),
    #[error("world {0} has {MAX_PLAYERS} players, the most allowed: remove one first")]
    TooManyPlayers(WorldId),
    #[error("{field} lies outside the map, which spans {span}")]
    Outside { field: &'static str, span: String },
}

/// Destination of a mover.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Destination {
    /// A stop, by its index.
    Stop(u32),
    /// Opens or closes a door; makes a floor appear or vanish.
    Open(bool),
    /// All stops in turn.
    Cycle,
}

impl HostedWorld {
    /// The movers of the map.
    pub fn movers(&self) -> &[Mover] {
        self.world.map().movers()
    }

    /// States of the movers, in the order of the map.
    pub fn mover_states(&self) -> &[MoverState] {
        self.world.movers()
    }

    /// Sets the destination and the pace (in multiples of the default) of a mover. Returns its index and state. An
    /// invalid order changes nothing.
    pub fn set_mover(
        &mut self,
        name: &str,
        destination: Option<Destination>,
        pace: Option<f32>,
    ) -> Result<(usize, MoverState), LivingError> {
        let known = self.movers().iter().position(|mover| mover.name == name);
        let idx = known.ok_or_else(|| LivingError::NoSuchMover(self.id, name.to_owned()))?;
        if let Some(pace) = pace.filter(|pace| !PACE_RANGE.contains(pace)) {
            let message = format!("a pace is {} to {}, not {pace}", PACE_RANGE.start(), PACE_RANGE.end());
            return Err(LivingError::Order { field: "pace", message });
        }
        let order = destination.map(|destination| order_of(&self.movers()[idx], destination)).transpose()?;
        for order in order.into_iter().chain(pace.map(MoverOrder::Pace)) {
            // The order was checked.
            self.world.order(MoverId(idx as u16), order);
        }
        Ok((idx, self.mover_states()[idx]))
    }

    /// Adds a valid player, and returns its id.
    pub fn spawn_player(&mut self, player: Player) -> Result<PlayerSlot, LivingError> {
        self.check_on_map(player.feet, "position")?;
        if self.world.players().count() >= MAX_PLAYERS {
            return Err(LivingError::TooManyPlayers(self.id));
        }
        Ok(self.world.spawn_player(player))
    }

    /// Moves players: id, position of the feet, m, and velocity, m/s. If one of them does not exist or leaves the map,
    /// no player is moved.
    pub fn move_players(&mut self, moves: &[(PlayerSlot, Vec3, Vec3)]) -> Result<(), LivingError> {
        let players: BTreeSet<PlayerSlot> = self.world.players().map(|(slot, _)| slot).collect();
        for (slot, feet, _) in moves {
            self.check_on_map(*feet, "moves.position")?;
            if !players.contains(slot) {
                return Err(LivingError::NoSuchPlayer(self.id, slot.0));
            }
        }
        for (slot, feet, velocity) in moves {
            self.world.move_player(*slot, *feet, *velocity);
        }
        Ok(())
    }

    /// Removes a player.
    pub fn remove_player(&mut self, slot: PlayerSlot) -> Result<(), LivingError> {
        if !self.world.remove_player(slot) {
            return Err(LivingError::NoSuchPlayer(self.id, slot.0));
        }
        // Another player may get the same slot before the next tick.
        self.look_around();
        Ok(())
    }

    fn check_on_map(&self, point: Vec3, field: &'static str) -> Result<(), LivingError> {
        self.within_map(point).map_err(|span| LivingError::Outside { field, span })
    }
}

fn order_of(mover: &Mover, destination: Destination) -> Result<MoverOrder, LivingError> {
    let count = mover.stops.len();
    match destination {
        Destination::Stop(stop) if (stop as usize) < count => Ok(MoverOrder::GoTo(StopIdx(stop as u8))),
        Destination::Stop(stop) => {
            let message = format!("`{}` has the stops 0 to {}, but no stop {stop}", mover.name, count - 1);
            Err(LivingError::Order { field: "stop", message })
        }
        // A floor is present at stop 0.
        Destination::Open(open) if mover.kind == MoverKind::Door => Ok(MoverOrder::GoTo(StopIdx(u8::from(open)))),
        Destination::Open(open) if mover.kind == MoverKind::Floor => Ok(MoverOrder::GoTo(StopIdx(u8::from(!open)))),
        Destination::Open(_) => {
            let message = format!("`{}` is neither a door nor a floor: set stop instead", mover.name);
            Err(LivingError::Order { field: "open", message })
        }
        Destination::Cycle if count > 1 => Ok(MoverOrder::Cycle),
        Destination::Cycle => {
            Err(LivingError::Order { field: "cycle", message: format!("`{}` has only one stop", mover.name) })
        }
    }
}
