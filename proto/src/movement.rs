//! Conversions of how NPCs move and what workers predict of them.

use crate::convert::{self, FieldError, WireEnum};
use crate::wire_enum;
use crate::world::v1 as wire;
use surefoot_world::{Ability, Locomotion, MovePhase, POSE_TICKS, Pace, Pose, TakeOff, Tick, Trajectory, Vec3};

wire_enum!(Pace = wire::Pace: Idle Turn Walk Run Stop);
wire_enum!(MovePhase = wire::MovePhase: WindUp Flight Landing);

/// Numbers of a pose in [`wire::CarriedPrediction::poses`].
const POSE_LEN: usize = 4;

/// Converts how an NPC moves, with the prediction that was made at a tick.
pub fn movement_to_wire(locomotion: &Locomotion, prediction: Option<(Tick, Trajectory)>) -> wire::Movement {
    let pose = |pose: Pose| wire::Pose { position: Some(convert::to_wire(pose.feet)), yaw: pose.yaw };
    let prediction = prediction.map(|(tick, trajectory)| {
        let [in_20_ticks, in_40_ticks, in_60_ticks] = trajectory.poses.map(|it| it.map(pose));
        wire::Prediction { tick: tick.0, in_20_ticks, in_40_ticks, in_60_ticks }
    });
    wire::Movement {
        pace: locomotion.pace.to_wire().into(),
        phase: locomotion.phase.map_or(wire::MovePhase::Unspecified, MovePhase::to_wire).into(),
        ability: locomotion.ability.to_wire().into(),
        stride_m: locomotion.stride_m,
        stride_phase: locomotion.stride_phase,
        prediction,
        step_offset_m: locomotion.steps.offset_m,
    }
}

/// Converts what a worker predicts of an NPC in an attempt.
pub fn prediction_to_wire(npc_id: u64, attempt: u32, trajectory: &Trajectory) -> wire::CarriedPrediction {
    let values = |pose: Pose| pose.feet.to_array().into_iter().chain([pose.yaw]);
    let take_off = trajectory.take_off;
    wire::CarriedPrediction {
        npc_id,
        attempt,
        poses: convert::pack(trajectory.poses.into_iter().map_while(|pose| pose).flat_map(values)),
        take_off_ticks: take_off.map_or(0, |it| it.ticks.into()),
        take_off_ability: take_off.map_or(wire::Ability::Unspecified, |it| it.ability.to_wire()).into(),
    }
}

/// Reads what a worker predicts.
pub fn trajectory(prediction: &wire::CarriedPrediction) -> Result<Trajectory, FieldError> {
    const POSES: &str = "actions.predictions.poses";
    let count = prediction.poses.len() / (POSE_LEN * size_of::<f32>());
    let limit = POSE_TICKS.len();
    if count > limit {
        return Err(FieldError::Count { field: POSES, what: "poses", found: count, limit });
    }
    let values = convert::unpack(&prediction.poses, count * POSE_LEN, POSES)?;
    if !values.iter().all(|value| value.is_finite()) {
        return Err(FieldError::NotFinite(POSES));
    }
    let mut trajectory = Trajectory::default();
    for (pose, &[x, y, z, yaw]) in trajectory.poses.iter_mut().zip(values.as_chunks::<POSE_LEN>().0) {
        *pose = Some(Pose { feet: Vec3::new(x, y, z), yaw });
    }
    if let Some(ability) = Ability::from_wire(prediction.take_off_ability) {
        let most = f64::from(POSE_TICKS[limit - 1]);
        let ticks = f64::from(prediction.take_off_ticks);
        let ticks = convert::in_range(ticks, 0.0, most, "actions.predictions.take_off_ticks")? as u8;
        trajectory.take_off = Some(TakeOff { ticks, ability });
    }
    Ok(trajectory)
}
