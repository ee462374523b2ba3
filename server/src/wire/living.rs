//! Movers and players on the wire.

use crate::hosted::Destination;
use surefoot_net::status;
use surefoot_proto::convert::{self, FieldError, WireEnum, enum_or};
use surefoot_proto::world::v1 as wire;
use surefoot_world::map::{Mover, MoverStop};
use surefoot_world::player::{PLAYER_HEIGHT_M, PLAYER_RADIUS_M};
use surefoot_world::{MoverState, Player, PlayerContact, PlayerSlot, Vec3};
use tonic::Status;

/// Default size of a player, m.
const DEFAULT_RADIUS_M: f32 = 0.3;
const DEFAULT_HEIGHT_M: f32 = 1.8;

pub fn mover_to_wire(mover: &Mover) -> wire::Mover {
    wire::Mover {
        name: mover.name.clone(),
        kind: mover.kind.to_wire().into(),
        positions: convert::pack(mover.triangles.iter().flatten().flat_map(|corner| corner.to_array())),
        pivot: Some(convert::to_wire(mover.pivot)),
        stops: mover.stops.iter().copied().map(stop_to_wire).collect(),
        travel_s: mover.travel_s,
        dwell_s: mover.dwell_s,
        belt: Some(convert::to_wire(mover.belt)),
    }
}

fn stop_to_wire(stop: MoverStop) -> wire::MoverStop {
    wire::MoverStop { offset: Some(convert::to_wire(stop.offset)), yaw: stop.yaw, is_there: stop.is_there }
}

/// Converts the state of the mover with index `idx`, which is at `pose`.
pub fn mover_state_to_wire(idx: usize, state: &MoverState, pose: MoverStop) -> wire::MoverState {
    wire::MoverState {
        mover: idx as u32,
        from_stop: state.from.0.into(),
        to_stop: state.to.0.into(),
        progress: state.progress,
        told_stop: state.ordered_stop.map(|stop| stop.0.into()),
        pace: state.pace,
        blocked: state.blocked > 0,
        pose: Some(stop_to_wire(pose)),
    }
}

pub fn destination(request: &wire::SetMoverRequest) -> Result<Option<Destination>, Status> {
    use wire::set_mover_request::Where;
    Ok(match request.r#where {
        None => None,
        Some(Where::Stop(stop)) => Some(Destination::Stop(stop)),
        Some(Where::Open(open)) => Some(Destination::Open(open)),
        Some(Where::Cycle(true)) => Some(Destination::Cycle),
        Some(Where::Cycle(false)) => return Err(status::invalid("cycle", "cycle must be true: give a stop to end it")),
    })
}

pub fn player_to_wire(slot: PlayerSlot, player: &Player) -> wire::Player {
    wire::Player {
        player_id: slot.0,
        position: Some(convert::to_wire(player.feet)),
        velocity: Some(convert::to_wire(player.velocity)),
        radius: player.radius,
        height: player.height,
        contact: player.contact.to_wire().into(),
    }
}

pub fn player(request: &wire::SpawnPlayerRequest) -> Result<Player, Status> {
    let usual = |value: f32, usual: f32| if value == 0.0 { usual } else { value };
    let size = |value: f32, range: std::ops::RangeInclusive<f32>, field| {
        let (least, most) = (f64::from(*range.start()), f64::from(*range.end()));
        convert::in_range(f64::from(value), least - 1.0e-6, most + 1.0e-6, field).map(|_| value)
    };
    let radius = size(usual(request.radius, DEFAULT_RADIUS_M), PLAYER_RADIUS_M, "radius")?;
    let height = size(usual(request.height, DEFAULT_HEIGHT_M), PLAYER_HEIGHT_M, "height")?;
    let contact = enum_or(request.contact, PlayerContact::Block, "contact")?;
    let feet = convert::point(request.position.as_ref(), "position")?;
    let player = Player { feet, velocity: Vec3::ZERO, radius, height, contact };
    if player.is_sound() {
        Ok(player)
    } else {
        Err(status::invalid(
            "height",
            format!("height is {height} m, but a player is at least twice as high as its radius"),
        ))
    }
}

pub fn player_move(request: &wire::PlayerMove) -> Result<(PlayerSlot, Vec3, Vec3), FieldError> {
    let feet = convert::point(request.position.as_ref(), "moves.position")?;
    let velocity = request.velocity.as_ref().map(|velocity| convert::point(Some(velocity), "moves.velocity"));
    Ok((PlayerSlot(request.player_id), feet, velocity.transpose()?.unwrap_or(Vec3::ZERO)))
}
