//! Observations: 8 x 8 rays and a vector of the NPC's own state, as one flat row of `f32`.
//!
//! Layout of a row (all values roughly in [-1, 1]):
//!
//! | range | meaning |
//! |---|---|
//! | 0..64 | proximity `1 - d / 30 m` of each ray, 0 where nothing is hit |
//! | 64..128 | 1 where the ray ended on water |
//! | 128..192 | 1 where the ray ended on lava |
//! | 192..256 | 1 where the ray ended on a jump pad |
//! | 256..320 | where the ray ended on another device: 1 zip line, 0.7 teleporter, 0.4 jetpack |
//! | 320..369 | the state vector, see [`state_vector`] |
//! | 369..433 | proximity of each ray that ends on another body, 0 where it ends on none |
//! | 433..461 | the four nearest bodies within 12 m that are in sight, 7 values each: 0..3 where its feet are from one's own / 12 m; 3..6 its velocity less one's own / 12 m/s; 6 proximity `1 - d / 12 m`, 0 if there is none |
//!
//! Rays are ordered row by row from the lowest elevation, each row from left to right. Vectors are in the body's frame (x right, y up,
//! z forward). The last two parts are there for whoever asks for [`OBSERVATION_WITH_OTHERS_LEN`] values instead of [`OBSERVATION_LEN`]; they
//! are zeros where nothing but the map gets in an NPC's way. Bodies are upright cylinders to rays.

pub use crate::cone::{RAY_COUNT, RAY_RANGE_M, RAY_SIDE, RayCone};
pub use crate::others::OTHERS_LEN;

use crate::character::{Body, CharacterProfile, RawCharacterProfile};
use crate::map::{DEVICE_RANGE_M, Map, Placed};
use crate::mesh::Surface;
use crate::movers::Movers;
use crate::others::{self, Other};
use crate::slot::BodySlot;
use crate::task::TaskConfig;
use crate::{Episode, Vec3};
use serde::{Deserialize, Serialize};

/// Values per ray.
pub const RAY_CHANNELS: usize = 5;
/// Length of the state vector.
pub const STATE_LEN: usize = 35 + BODY_LEN;
/// Values of the state vector that tell what body the NPC has.
pub const BODY_LEN: usize = 14;
/// Length of an observation without others.
pub const OBSERVATION_LEN: usize = RAY_COUNT * RAY_CHANNELS + STATE_LEN;
/// Length of an observation with what it tells of others.
pub const OBSERVATION_WITH_OTHERS_LEN: usize = OBSERVATION_LEN + OTHERS_LEN;
/// Length of an observation, with what it tells of others or without.
pub const fn observation_len(sees_others: bool) -> usize {
    if sees_others { OBSERVATION_WITH_OTHERS_LEN } else { OBSERVATION_LEN }
}

/// Changes whenever the meaning of an observation changes; stored in checkpoints.
pub const OBSERVATION_VERSION: u32 = 3;

/// What a ray ended on.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Seen {
    /// A surface of the map or a mover.
    Surface(Surface),
    /// Another NPC or a player.
    Body,
}

/// The rays of a body, for display.
#[derive(Debug, Clone, PartialEq)]
pub struct Sight {
    /// Origin of the rays, m.
    pub eye: Vec3,
    /// End of each ray, m, and what it ended on; a ray that hits nothing ends at its full range.
    pub ends: Vec<(Vec3, Option<Seen>)>,
}

impl Sight {
    /// Casts the cone from `body`.
    pub(crate) fn of(
        cone: &RayCone,
        map: &Map,
        movers: &Movers,
        profile: &CharacterProfile,
        body: &Body,
        others: impl Iterator<Item = Other>,
    ) -> Self {
        let eye = RayCone::eye(profile, body);
        let mut hits: [(f32, Option<Seen>); RAY_COUNT] = [(RAY_RANGE_M, None); RAY_COUNT];
        cone.cast_with(map, movers, profile, body, |idx, distance, surface| {
            hits[idx] = (distance, Some(Seen::Surface(surface)));
        });
        others::cast_cone(cone, eye, body, others, |idx, distance| {
            if distance < hits[idx].0 {
                hits[idx] = (distance, Some(Seen::Body));
            }
        });
        let rays = cone.directions_of(body).into_iter().zip(hits);
        Self { eye, ends: rays.map(|(direction, (distance, seen))| (eye + direction * distance, seen)).collect() }
    }
}

/// Inputs of the state vector besides the body and its episode.
#[derive(Debug, Clone, Copy)]
pub struct SenseContext<'a> {
    /// The devices around the body.
    pub placed: &'a Placed,
    /// The body's profile.
    pub profile: &'a CharacterProfile,
    /// Constants of the task.
    pub task: &'a TaskConfig,
}

/// Facts about the previous decision that the state vector reports.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct LastDecision {
    /// Velocity at the start of the decision, m/s.
    pub velocity: Vec3,
    /// Forward, strafe, turn and jump, each in [-1, 1].
    pub action: [f32; 4],
    /// Ticks in water; counts down again outside water.
    pub ticks_in_water: u32,
}

/// Writes a whole observation into `row`. `others` lists the bodies that may be seen; it is not called if the row has no room for them.
///
/// # Panics
/// If `row` is neither [`OBSERVATION_LEN`] nor [`OBSERVATION_WITH_OTHERS_LEN`] long.
pub(crate) fn observe<T: Iterator<Item = (BodySlot, Other)>>(
    cone: &RayCone,
    context: SenseContext<'_>,
    (map, movers): (&Map, &Movers),
    others: impl FnOnce() -> T,
    (body, episode, last): (&Body, &Episode, &LastDecision),
    row: &mut [f32],
) {
    let (rays, state, social) = parts(row);
    cone.cast_with(map, movers, context.profile, body, |idx, distance, surface| note_ray(rays, idx, distance, surface));
    state.copy_from_slice(&state_vector(context, body, episode, last));
    if !social.is_empty() {
        let eye = RayCone::eye(context.profile, body);
        others::observe(cone, (map, movers), (eye, body), others(), &rays[..RAY_COUNT], social);
    }
}

/// What the rays of a body ended on, and the others that it sees, in a world that is not ours.
#[derive(Debug, Clone, Copy)]
pub struct Found<'a> {
    /// What each ray ended on, in the order of an observation, with the distance, m; `None` if it hit nothing. Other bodies are left out.
    pub hits: &'a [Option<(f32, Surface)>; RAY_COUNT],
    /// Distance, m, at which each ray meets another body; infinite if it meets none.
    pub body_hits: &'a [f32; RAY_COUNT],
    /// Feet, m, and velocity, m/s, of the others in sight, in any order.
    pub others: &'a [(Vec3, Vec3)],
}

/// Writes an observation like [`World::observe`](crate::World::observe), for a body that moves in a world that is not ours. Allocates nothing.
///
/// # Panics
/// If `row` is neither [`OBSERVATION_LEN`] nor [`OBSERVATION_WITH_OTHERS_LEN`] long.
pub fn observe_found(
    context: SenseContext<'_>,
    found: Found<'_>,
    (body, episode, last): (&Body, &Episode, &LastDecision),
    row: &mut [f32],
) {
    let (rays, state, social) = parts(row);
    for (idx, hit) in found.hits.iter().enumerate() {
        if let Some((distance, surface)) = hit.filter(|(distance, _)| *distance <= RAY_RANGE_M) {
            note_ray(rays, idx, distance, surface);
        }
    }
    state.copy_from_slice(&state_vector(context, body, episode, last));
    if !social.is_empty() {
        let hits = found.body_hits.iter().copied().enumerate();
        others::observe_found(body, hits, found.others.iter().copied(), &rays[..RAY_COUNT], social);
    }
}

/// The rays of an observation, which become zeros, its state vector, and what it tells of others, if it has room for that.
fn parts(row: &mut [f32]) -> (&mut [f32], &mut [f32], &mut [f32]) {
    assert!([OBSERVATION_LEN, OBSERVATION_WITH_OTHERS_LEN].contains(&row.len()), "a row of an observation");
    let (own, social) = row.split_at_mut(OBSERVATION_LEN);
    let (rays, state) = own.split_at_mut(RAY_COUNT * RAY_CHANNELS);
    rays.fill(0.0);
    (rays, state, social)
}

/// Writes into the rays of an observation, which are zeros, that one ended on `surface` after `distance`, m.
fn note_ray(rays: &mut [f32], idx: usize, distance: f32, surface: Surface) {
    rays[idx] = 1.0 - distance / RAY_RANGE_M;
    if let Some((channel, value)) = surface_channel(surface) {
        rays[channel * RAY_COUNT + idx] = value;
    }
}

/// The ray channel that represents `surface`, and its value; `None` for ground.
pub fn surface_channel(surface: Surface) -> Option<(usize, f32)> {
    match surface {
        Surface::Ground => None,
        Surface::Water => Some((1, 1.0)),
        Surface::Lava => Some((2, 1.0)),
        Surface::Pad => Some((3, 1.0)),
        Surface::ZipLine => Some((4, 1.0)),
        Surface::Teleporter => Some((4, 0.7)),
        Surface::Jetpack => Some((4, 0.4)),
    }
}

/// The surface on which ray `ray` of an observation ended; ground if no channel represents one.
pub fn ray_surface(observation: &[f32], ray: usize) -> Surface {
    let shows = |&surface: &Surface| {
        surface_channel(surface)
            .is_some_and(|(channel, value)| (observation[channel * RAY_COUNT + ray] - value).abs() < 0.1)
    };
    Surface::ALL.into_iter().find(shows).unwrap_or(Surface::Ground)
}

/// Computes the non-visual part of an observation. Vectors are in the body's frame (x right, y up, z forward).
///
/// 0 goal distance / 50 m; 1..4 unit direction to the goal; 4 horizontal goal distance and 5 height of the
/// goal, each / 8 m and clamped; 6..9 velocity / 12 m/s; 9..12 change of velocity over the last decision /
/// 12 m/s; 12..16 previous action; 16 grounded; 17 can jump (again); 18 share of the patience used; 19 share
/// of the breath used; 20..23 unit direction to the nearest pad; 23 its proximity `1 - d / 50 m`; 24..27 unit
/// direction to the entrance of the zip line or teleporter that brings the goal nearest; 27 its proximity; 28 the
/// proximity of its exit to the goal; 29..32 and 32 direction and proximity of the nearest jetpack; 33 jetpack fuel /
/// 5 s; 34 hanging on a zip line; 35..49 the body, see [`body_features`].
pub fn state_vector(
    context: SenseContext<'_>,
    body: &Body,
    episode: &Episode,
    last: &LastDecision,
) -> [f32; STATE_LEN] {
    let goal = body.to_local(episode.goal - body.feet);
    let goal_distance = goal.length();
    let goal_direction = goal / goal_distance.max(1.0e-3);
    let horizontal = (goal.x * goal.x + goal.z * goal.z).sqrt();
    let velocity = body.to_local(body.velocity) / 12.0;
    let acceleration = body.to_local(body.velocity - last.velocity) / 12.0;
    let proximity = |distance: f32| (1.0 - distance / DEVICE_RANGE_M).max(0.0);
    let bearing = |place: Option<Vec3>| {
        place.map_or((Vec3::ZERO, 0.0), |place| {
            let local = body.to_local(place - body.feet);
            let distance = local.length();
            (local / distance.max(1.0e-3), proximity(distance))
        })
    };
    let (pad_direction, pad_proximity) = bearing(context.placed.nearest_pad(body.feet).map(|pad| pad.centre));
    let transport = context.placed.best_transport(body.feet, episode.goal);
    let (entrance_direction, entrance_proximity) = bearing(transport.map(|(entrance, _)| entrance));
    let exit_proximity = transport.map_or(0.0, |(_, exit)| proximity(exit.distance(episode.goal)));
    let jetpack = context.placed.nearest_jetpack(body.feet).map(|jetpack| jetpack.centre);
    let (jetpack_direction, jetpack_proximity) = bearing(jetpack);
    let flag = |on: bool| if on { 1.0 } else { 0.0 };
    let [forward, strafe, turn, jump] = last.action;
    let own: [f32; STATE_LEN - BODY_LEN] = [
        (goal_distance / 50.0).min(4.0),
        goal_direction.x,
        goal_direction.y,
        goal_direction.z,
        (horizontal / 8.0).min(1.5),
        (goal.y / 8.0).clamp(-1.5, 1.5),
        velocity.x,
        velocity.y,
        velocity.z,
        acceleration.x,
        acceleration.y,
        acceleration.z,
        forward,
        strafe,
        turn,
        jump,
        flag(body.is_grounded()),
        flag(body.can_jump(context.profile)),
        episode.patience_used(context.task),
        (last.ticks_in_water as f32 / context.task.drown_ticks as f32).min(1.0),
        pad_direction.x,
        pad_direction.y,
        pad_direction.z,
        pad_proximity,
        entrance_direction.x,
        entrance_direction.y,
        entrance_direction.z,
        entrance_proximity,
        exit_proximity,
        jetpack_direction.x,
        jetpack_direction.y,
        jetpack_direction.z,
        jetpack_proximity,
        (body.fuel / 5.0).min(1.0),
        flag(body.ride.is_some()),
    ];
    let mut state = [0.0; STATE_LEN];
    state[..own.len()].copy_from_slice(&own);
    state[own.len()..].copy_from_slice(&body_features(context.profile));
    state
}

/// Tells what body an NPC has, relative to the default one, whose features are all 0.
///
/// Logarithms of the ratios of 0 height, 1 radius, 2 forward speed, 4 turning speed, 6 gravity and 10 acceleration on the ground;
/// differences of 3 the share of speed sideways, 5 the height of the first jump / 2.5 m, 7 jumps in the air, 8 the steepest slope /
/// 35 degrees, 9 the highest step / 0.3 m, 11 acceleration in the air / 25 m/s2; -1 if the body cannot use 12 zip lines,
/// 13 jetpacks.
pub fn body_features(profile: &CharacterProfile) -> [f32; BODY_LEN] {
    let usual = RawCharacterProfile::default();
    let ratio = |value: f32, usual: f32| libm::logf(value / usual);
    let jump_m = |profile: &RawCharacterProfile| 0.5 * profile.jump_speed * profile.jump_speed / profile.gravity;
    let lack = |can: bool| if can { 0.0 } else { -1.0 };
    [
        ratio(profile.height, usual.height),
        ratio(profile.radius, usual.radius),
        ratio(profile.forward_speed, usual.forward_speed),
        profile.side_speed_share - usual.side_speed_share,
        ratio(profile.turn_speed, usual.turn_speed),
        ((jump_m(profile) - jump_m(&usual)) / 2.5).min(4.0),
        ratio(profile.gravity, usual.gravity),
        f32::from(profile.extra_jumps.min(4)) - f32::from(usual.extra_jumps),
        (profile.max_slope - usual.max_slope) / usual.max_slope,
        (profile.step_height - usual.step_height) / 0.3,
        ratio(profile.ground_acceleration, usual.ground_acceleration),
        ((profile.air_acceleration - usual.air_acceleration) / 25.0).min(4.0),
        lack(profile.uses_zip_lines),
        lack(profile.uses_jetpacks),
    ]
}

/// Makes an observation one of an NPC that is not told where zip lines and teleporters are, as if none were near.
pub fn hide_transports(row: &mut [f32]) {
    row[RAY_COUNT * RAY_CHANNELS + 24..RAY_COUNT * RAY_CHANNELS + 29].fill(0.0);
}

/// Mirrors an observation left to right, in place; its own inverse.
pub fn mirror_observation(row: &mut [f32]) {
    let (own, social) = row.split_at_mut(OBSERVATION_LEN);
    if !social.is_empty() {
        others::mirror(social);
    }
    let (rays, state) = own.split_at_mut(RAY_COUNT * RAY_CHANNELS);
    for ray_row in rays.chunks_mut(RAY_SIDE) {
        ray_row.reverse();
    }
    // goal x, velocity x, acceleration x, strafe, turn, pad x, entrance x, jetpack x
    for idx in [1, 6, 9, 13, 14, 20, 24, 29] {
        state[idx] = -state[idx];
    }
}

/// Mirrors an action left to right, in place; its own inverse.
pub fn mirror_action(action: &mut [f32]) {
    action[1] = -action[1];
    action[2] = -action[2];
}
