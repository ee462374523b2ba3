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
//!
//! Rays are ordered row by row from the lowest elevation, each row from left to right.

use crate::character::{Body, CharacterProfile, RawCharacterProfile};
use crate::map::{DEVICE_RANGE_M, Map};
use crate::mesh::{ConeHit, Elevations, LANES, Surface};
use crate::movers::Movers;
use crate::task::TaskConfig;
use crate::{Episode, Vec3};
use serde::{Deserialize, Serialize};

/// Rays per row and per column of the cone.
pub const RAY_SIDE: usize = LANES;
/// Rays of an observation.
pub const RAY_COUNT: usize = RAY_SIDE * RAY_SIDE;
/// Values per ray.
pub const RAY_CHANNELS: usize = 5;
/// Length of the state vector.
pub const STATE_LEN: usize = 35 + BODY_LEN;
/// Values of the state vector that tell what body the NPC has.
pub const BODY_LEN: usize = 14;
/// Length of an observation.
pub const OBSERVATION_LEN: usize = RAY_COUNT * RAY_CHANNELS + STATE_LEN;
/// Reach of every ray, m.
pub const RAY_RANGE_M: f32 = 30.0;
/// Changes whenever the meaning of an observation changes; stored in checkpoints.
pub const OBSERVATION_VERSION: u32 = 3;

/// Height of the rays' origin as a share of the body's height.
const EYE_HEIGHT_SHARE: f32 = 0.85;
/// Azimuth of each ray of a row, degrees, positive to the right: denser ahead, symmetric for mirroring.
const AZIMUTHS_DEG: [f32; RAY_SIDE] = [-80.0, -45.0, -22.0, -7.0, 7.0, 22.0, 45.0, 80.0];
/// Elevation of each row, degrees.
const ELEVATIONS_DEG: [f32; RAY_SIDE] = [-65.0, -42.0, -26.0, -14.0, -5.0, 6.0, 22.0, 45.0];

/// Cone of rays in the body's frame (x right, y up, z forward).
#[derive(Debug, Clone)]
pub struct RayCone {
    directions: [Vec3; RAY_COUNT],
    elevations: Elevations,
    /// Sine and cosine of each azimuth.
    azimuths: [(f32, f32); RAY_SIDE],
}

impl Default for RayCone {
    fn default() -> Self {
        let elevations = Elevations::new(ELEVATIONS_DEG.map(f32::to_radians), RAY_RANGE_M);
        let azimuths = AZIMUTHS_DEG.map(|azimuth| libm::sincosf(azimuth.to_radians()));
        Self { directions: directions(&elevations, azimuths), elevations, azimuths }
    }
}

impl RayCone {
    /// Unit directions in the body's frame, in the order of an observation.
    pub fn directions(&self) -> &[Vec3; RAY_COUNT] {
        &self.directions
    }

    /// Origin of the rays, m.
    pub fn eye(profile: &CharacterProfile, body: &Body) -> Vec3 {
        body.feet + Vec3::new(0.0, profile.height * EYE_HEIGHT_SHARE, 0.0)
    }

    /// The azimuths in the map's frame, as horizontal unit vectors (x, z).
    fn headings(&self, body: &Body) -> [(f32, f32); RAY_SIDE] {
        let (sin, cos) = libm::sincosf(body.yaw);
        self.azimuths.map(|(right, ahead)| (sin * ahead - cos * right, cos * ahead + sin * right))
    }

    /// Unit directions in the map's frame, in the order of an observation.
    pub fn directions_of(&self, body: &Body) -> [Vec3; RAY_COUNT] {
        directions(&self.elevations, self.headings(body))
    }

    /// Casts the cone from `body` and calls `found` with the index, distance (m) and surface of each ray that hits.
    pub fn cast(&self, map: &Map, profile: &CharacterProfile, body: &Body, mut found: impl FnMut(usize, f32, Surface)) {
        let hits = map.mesh().cast_cone(&self.elevations, Self::eye(profile, body), &self.headings(body));
        for (idx, hit) in hits.as_flattened().iter().enumerate() {
            if let Some(ConeHit { distance, surface }) = *hit {
                found(idx, distance, surface);
            }
        }
    }

    /// Casts the cone from `body` at the map and its movers and calls `found` with the index, distance (m) and surface of each ray that
    /// hits.
    fn cast_with(
        &self,
        map: &Map,
        movers: &Movers,
        profile: &CharacterProfile,
        body: &Body,
        mut found: impl FnMut(usize, f32, Surface),
    ) {
        if movers.is_empty() {
            return self.cast(map, profile, body, found);
        }
        let mut hits: [Option<(f32, Surface)>; RAY_COUNT] = [None; RAY_COUNT];
        self.cast(map, profile, body, |idx, distance, surface| hits[idx] = Some((distance, surface)));
        movers.cast_cone(Self::eye(profile, body), &self.directions_of(body), RAY_RANGE_M, |idx, distance| {
            if hits[idx].is_none_or(|(nearest, _)| distance < nearest) {
                hits[idx] = Some((distance, Surface::Ground));
            }
        });
        for (idx, hit) in hits.into_iter().enumerate() {
            if let Some((distance, surface)) = hit {
                found(idx, distance, surface);
            }
        }
    }

    /// Casts the cone from `body` and returns where every ray ends.
    pub(crate) fn sight(&self, map: &Map, movers: &Movers, profile: &CharacterProfile, body: &Body) -> Sight {
        let eye = Self::eye(profile, body);
        let mut ends: Vec<_> =
            self.directions_of(body).into_iter().map(|direction| (eye + direction * RAY_RANGE_M, None)).collect();
        self.cast_with(map, movers, profile, body, |idx, distance, surface| {
            ends[idx] = (eye + (ends[idx].0 - eye) * (distance / RAY_RANGE_M), Some(surface));
        });
        Sight { eye, ends }
    }
}

/// Unit directions of all rays at these headings, in the order of an observation.
fn directions(elevations: &Elevations, headings: [(f32, f32); RAY_SIDE]) -> [Vec3; RAY_COUNT] {
    let mut directions = [Vec3::ZERO; RAY_COUNT];
    for (column, heading) in headings.into_iter().enumerate() {
        for (row, direction) in elevations.directions(heading).into_iter().enumerate() {
            directions[row * RAY_SIDE + column] = direction;
        }
    }
    directions
}

/// The rays of a body, for display.
#[derive(Debug, Clone, PartialEq)]
pub struct Sight {
    /// Origin of the rays, m.
    pub eye: Vec3,
    /// End of each ray, m, and the surface hit; a ray that hits nothing ends at its full range.
    pub ends: Vec<(Vec3, Option<Surface>)>,
}

/// Inputs of the state vector besides the body and its episode.
#[derive(Debug, Clone, Copy)]
pub struct SenseContext<'a> {
    /// The map that the body is on.
    pub map: &'a Map,
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

/// Writes a whole observation into `row`.
///
/// # Panics
/// If `row` is not [`OBSERVATION_LEN`] long.
pub(crate) fn observe(
    cone: &RayCone,
    context: SenseContext<'_>,
    movers: &Movers,
    body: &Body,
    episode: &Episode,
    last: &LastDecision,
    row: &mut [f32],
) {
    assert_eq!(row.len(), OBSERVATION_LEN);
    let (rays, state) = row.split_at_mut(RAY_COUNT * RAY_CHANNELS);
    rays.fill(0.0);
    cone.cast_with(context.map, movers, context.profile, body, |idx, distance, surface| {
        rays[idx] = 1.0 - distance / RAY_RANGE_M;
        if let Some((channel, value)) = surface_channel(surface) {
            rays[channel * RAY_COUNT + idx] = value;
        }
    });
    state.copy_from_slice(&state_vector(context, body, episode, last));
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
    let (pad_direction, pad_proximity) = bearing(context.map.nearest_pad(body.feet).map(|pad| pad.centre));
    let transport = context.map.best_transport(body.feet, episode.goal);
    let (entrance_direction, entrance_proximity) = bearing(transport.map(|(entrance, _)| entrance));
    let exit_proximity = transport.map_or(0.0, |(_, exit)| proximity(exit.distance(episode.goal)));
    let jetpack = context.map.nearest_jetpack(body.feet).map(|jetpack| jetpack.centre);
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

/// Mirrors an observation left to right, in place; its own inverse.
pub fn mirror_observation(row: &mut [f32]) {
    let (rays, state) = row.split_at_mut(RAY_COUNT * RAY_CHANNELS);
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
