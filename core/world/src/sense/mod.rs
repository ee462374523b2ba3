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
//! | 320..369 | the state vector, see [`FIELDS`] |
//! | 369..433 | proximity of each ray that ends on another body, 0 where it ends on none |
//! | 433..461 | the four nearest bodies in sight within 12 m, 7 values each; zeros where there are fewer |
//!
//! The values of a body are 0..3 the position of its feet from the observer's / 12 m, 3..6 its velocity less the
//! observer's / 12 m/s, and 6 its proximity `1 - d / 12 m`.
//!
//! Rays are ordered row by row from the lowest elevation, each row from left to right. Vectors are in the body's frame
//! (x right, y up, z forward). Rows of [`OBSERVATION_LEN`] values lack the last two parts, rows of
//! [`OBSERVATION_WITH_OTHERS_LEN`] values have them. They are zeros where only the map obstructs an NPC. To rays,
//! bodies are upright cylinders.

mod cone;
mod fields;
mod others;

pub use cone::{RAY_COUNT, RAY_RANGE_M, RAY_SIDE, RayCone, eye_height};
pub use fields::{FIELDS, Field, field_idx, state_vector};
pub use others::OTHERS_LEN;
#[cfg(test)]
pub(crate) use others::observe as observe_others;
pub(crate) use others::{Other, REACH_M};

use crate::character::{Body, CharacterProfile};
use crate::map::{Map, Placed};
use crate::mesh::Surface;
use crate::movers::Movers;
use crate::slot::BodySlot;
use crate::task::TaskConfig;
use crate::{Episode, Vec3};
use serde::{Deserialize, Serialize};

/// Values per ray.
pub const RAY_CHANNELS: usize = 5;
/// Index of the first value of the state vector in an observation.
pub const STATE_BEGIN: usize = RAY_COUNT * RAY_CHANNELS;
/// Length of the state vector.
pub const STATE_LEN: usize = FIELDS.len();
/// Length of an observation without others.
pub const OBSERVATION_LEN: usize = STATE_BEGIN + STATE_LEN;
/// Length of an observation with other bodies.
pub const OBSERVATION_WITH_OTHERS_LEN: usize = OBSERVATION_LEN + OTHERS_LEN;
/// Length of an observation, with or without other bodies.
pub const fn observation_len(sees_others: bool) -> usize {
    if sees_others { OBSERVATION_WITH_OTHERS_LEN } else { OBSERVATION_LEN }
}

/// Changes whenever the meaning of an observation changes; stored in checkpoints.
pub const OBSERVATION_VERSION: u32 = 3;

/// A thing that a ray hit.
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
    /// End of each ray, m, and the thing that it hit. A ray that hits nothing ends at its full range.
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

/// The previous decision, as far as the state vector reports it.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct LastDecision {
    /// Velocity at the start of the decision, m/s.
    pub velocity: Vec3,
    /// Forward, strafe, turn and jump, each in [-1, 1].
    pub action: [f32; 4],
    /// Ticks in water, which count down again outside water.
    pub ticks_in_water: u32,
}

/// Writes a whole observation into `row`. `others` lists the bodies that may be visible; it is called only if the row
/// has room for them.
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

/// Results of ray casts and the visible bodies, from a game's own physics.
#[derive(Debug, Clone, Copy)]
pub struct Found<'a> {
    /// Distance, m, and surface at which each ray ended, in the order of an observation; `None` if it hit nothing. Rays
    /// pass through other bodies.
    pub hits: &'a [Option<(f32, Surface)>; RAY_COUNT],
    /// Distance, m, at which each ray hits another body; infinite if it hits none.
    pub body_hits: &'a [f32; RAY_COUNT],
    /// Feet, m, and velocity, m/s, of the bodies in sight, in any order.
    pub others: &'a [(Vec3, Vec3)],
}

/// Writes an observation like [`World::observe`](crate::World::observe), for a body in a game's own physics. Allocates
/// nothing.
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

/// Splits an observation into its rays, which become zeros, its state vector, and the part about other bodies, which
/// may be empty.
fn parts(row: &mut [f32]) -> (&mut [f32], &mut [f32], &mut [f32]) {
    assert!([OBSERVATION_LEN, OBSERVATION_WITH_OTHERS_LEN].contains(&row.len()), "the length of an observation");
    let (own, social) = row.split_at_mut(OBSERVATION_LEN);
    let (rays, state) = own.split_at_mut(STATE_BEGIN);
    rays.fill(0.0);
    (rays, state, social)
}

/// Writes a ray that ended on `surface` after `distance`, m, into the rays of an observation, which are zeros.
fn note_ray(rays: &mut [f32], idx: usize, distance: f32, surface: Surface) {
    rays[idx] = 1.0 - distance / RAY_RANGE_M;
    if let Some((channel, value)) = surface_channel(surface) {
        rays[channel * RAY_COUNT + idx] = value;
    }
}

/// Ray channel and value that represent `surface`; `None` for ground.
pub fn surface_channel(surface: Surface) -> Option<(usize, f32)> {
    match surface {
        // To the eyes of the policy, what bodies climb is a wall.
        Surface::Ground | Surface::Climb => None,
        Surface::Water => Some((1, 1.0)),
        Surface::Lava => Some((2, 1.0)),
        Surface::Pad => Some((3, 1.0)),
        Surface::ZipLine => Some((4, 1.0)),
        Surface::Teleporter => Some((4, 0.7)),
        Surface::Jetpack => Some((4, 0.4)),
    }
}

/// Surface on which ray `ray` of an observation ended; ground if no channel shows another one.
pub fn ray_surface(observation: &[f32], ray: usize) -> Surface {
    let shows = |&surface: &Surface| {
        surface_channel(surface)
            .is_some_and(|(channel, value)| (observation[channel * RAY_COUNT + ray] - value).abs() < 0.1)
    };
    Surface::ALL.iter().copied().find(shows).unwrap_or(Surface::Ground)
}

/// Hides zip lines and teleporters from an observation, as if none were near.
pub fn hide_transports(row: &mut [f32]) {
    const FIRST: usize = STATE_BEGIN + field_idx("entrance_x");
    const LAST: usize = STATE_BEGIN + field_idx("exit_proximity");
    row[FIRST..=LAST].fill(0.0);
}

/// Mirrors an observation left to right, in place; its own inverse.
pub fn mirror_observation(row: &mut [f32]) {
    let (own, social) = row.split_at_mut(OBSERVATION_LEN);
    if !social.is_empty() {
        others::mirror(social);
    }
    let (rays, state) = own.split_at_mut(STATE_BEGIN);
    for ray_row in rays.chunks_mut(RAY_SIDE) {
        ray_row.reverse();
    }
    for (value, _) in state.iter_mut().zip(&FIELDS).filter(|(_, field)| field.flips) {
        *value = -*value;
    }
}

/// Mirrors an action left to right, in place; its own inverse.
pub fn mirror_action(action: &mut [f32]) {
    action[1] = -action[1];
    action[2] = -action[2];
}
