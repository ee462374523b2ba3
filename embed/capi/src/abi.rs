//! The structs that C and Rust share, field by field as in the header. `tests/header.rs` compares the two.
//!
//! Enums of the header are plain integers here: an unknown number must not become a Rust enum.

#![expect(missing_docs, reason = "the header documents the fields")]

use std::ffi::{c_char, c_void};
use std::mem::offset_of;
use surefoot_world as world;
use surefoot_world::map::{LevelFrame, UpAxis};
use surefoot_world::mesh::Surface;

/// Version of the binary interface: when it changes, programs must be compiled again.
pub const ABI_VERSION: u32 = 1;
/// Length of an error's text, including the zero at its end.
pub const MESSAGE_LEN: usize = 256;
/// Rays of an agent.
pub const RAY_COUNT: usize = world::RAY_COUNT;
/// Most other bodies in a state.
pub const MAX_OTHERS: usize = 64;
/// Start of a query, as the end of a leg.
pub const STOP_START: u32 = u32::MAX;
/// Goal of a query, as the end of a leg.
pub const STOP_GOAL: u32 = u32::MAX - 1;
/// Coordinates of the map.
pub const COORDINATES_MAP: i32 = 0;
/// Coordinates of the level.
pub const COORDINATES_LEVEL: i32 = 1;

/// `sf_error`: why a call failed.
#[repr(C)]
#[derive(Debug, Clone, Copy)]
pub struct Error {
    pub code: i32,
    pub message: [c_char; MESSAGE_LEN],
}

/// `sf_vec3`: a place, m, or a velocity, m/s.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Vec3 {
    pub x: f32,
    pub y: f32,
    pub z: f32,
}

/// `sf_place`: a place of a level, in its own coordinates.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Place {
    pub x: f64,
    pub y: f64,
    pub z: f64,
}

/// `sf_frame`: how a level's own coordinates relate to the map's.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Frame {
    pub origin: Place,
    pub scale: f64,
    pub z_up: i32,
}

/// `sf_ray`.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Ray {
    pub origin: Vec3,
    pub direction: Vec3,
}

/// `sf_hit`: the hit of a ray.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Hit {
    pub distance: f32,
    pub body_distance: f32,
    pub surface: i32,
}

/// `sf_action`.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Action {
    pub forward: f32,
    pub strafe: f32,
    pub turn: f32,
    pub jump: f32,
}

/// `sf_other`: a body that an agent sees.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Other {
    pub feet: Vec3,
    pub velocity: Vec3,
}

/// `sf_device`: a device of the level.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Device {
    pub kind: i32,
    pub two_way: i32,
    pub from: Vec3,
    pub to: Vec3,
}

/// `sf_body`: the body of a character.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Body {
    pub struct_size: u32,
    pub height: f32,
    pub radius: f32,
    pub forward_speed: f32,
    pub side_speed_share: f32,
    pub turn_speed: f32,
    pub jump_speed: f32,
    pub gravity: f32,
    pub max_slope: f32,
    pub step_height: f32,
    pub ground_acceleration: f32,
    pub air_acceleration: f32,
    pub zip_line_speed: f32,
    pub jetpack_acceleration: f32,
    pub jetpack_climb_speed: f32,
    pub extra_jumps: u32,
    pub coyote_ticks: u32,
    pub uses_zip_lines: i32,
    pub uses_jetpacks: i32,
    pub climb_speed: f32,
    pub mantle_height: f32,
    pub swim_speed: f32,
    pub crouch_height: f32,
    pub dash_speed: f32,
    pub wall_run_seconds: f32,
    pub slide_seconds: f32,
    pub dive_seconds: f32,
}

/// `sf_state`: where a body is and how it moves.
#[repr(C)]
#[derive(Debug, Clone, Copy)]
pub struct State {
    pub struct_size: u32,
    pub flags: u32,
    pub feet: Vec3,
    pub velocity: Vec3,
    pub yaw: f32,
    pub breath_used: f32,
    pub jetpack_seconds: f32,
    pub other_count: u32,
    pub others: *const Other,
}

/// `sf_state`'s flags.
pub const GROUNDED: u32 = 1;
/// The body can jump now, from the ground or in the air.
pub const CAN_JUMP: u32 = 2;
/// The body rides a zip line.
pub const RIDES: u32 = 4;

/// `sf_locomotion`: how a body moves.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Locomotion {
    pub struct_size: u32,
    pub pace: i32,
    pub phase: i32,
    pub ability: i32,
    pub stride: f32,
    pub stride_phase: f32,
    pub ticks: u32,
    pub was_thrown: i32,
    pub step_offset: f32,
    pub feet_height: f32,
    pub rise: f32,
    pub was_grounded: i32,
}

/// `sf_progress`: the progress of an agent.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Progress {
    pub struct_size: u32,
    pub reached: i32,
    pub best_distance: f32,
    pub stalled_decisions: u32,
    pub decisions: u32,
}

/// `sf_query`: a request for a plan.
#[repr(C)]
#[derive(Debug, Clone, Copy)]
pub struct Query {
    pub struct_size: u32,
    pub without: u32,
    pub start: Vec3,
    pub goal: Vec3,
    pub caution: f32,
    pub avoid_count: u32,
    pub avoid: *const LegKey,
}

/// `sf_leg_key`: the ends of a leg.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct LegKey {
    pub from: u32,
    pub to: u32,
}

/// `sf_leg`: a leg of a plan.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Leg {
    pub waypoint: Vec3,
    pub key: LegKey,
    pub ability: i32,
    pub seconds: f32,
    pub chance: f32,
    pub death_chance: f32,
}

/// `sf_plan`: a whole plan.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Plan {
    pub first_leg: u32,
    pub leg_count: u32,
    pub seconds: f32,
    pub chance: f32,
    pub arrival_chance: f32,
    pub death_chance: f32,
    pub no_path: i32,
    pub leads_near: i32,
}

/// `sf_edge`: a proved edge.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Edge {
    pub key: LegKey,
    pub ability: i32,
    pub is_open: i32,
    pub seconds: f32,
    pub chance: f32,
    pub death_chance: f32,
    pub cost: f32,
}

/// `sf_graph_info`.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct GraphInfo {
    pub struct_size: u32,
    pub vertex_count: u32,
    pub edge_count: u32,
    pub island_count: u32,
}

/// Lengths of the texts of an `sf_ability_info`, their zeros included.
pub const ABILITY_NAME_LEN: usize = 36;
pub const ANIMATION_LEN: usize = 132;

/// `sf_ability_info`: an ability of the body of a graph.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct AbilityInfo {
    pub struct_size: u32,
    pub name: [c_char; ABILITY_NAME_LEN],
    pub animation: [c_char; ANIMATION_LEN],
}

/// `sf_edit`: a designer's change.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Edit {
    pub kind: i32,
    pub value: f32,
    pub from: Vec3,
    pub to: Vec3,
}

/// `sf_traversal`: one traversal of an edge.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Traversal {
    pub key: LegKey,
    pub decisions: u32,
    pub end: i32,
}

/// `sf_step`: the next step of a follower.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Step {
    pub struct_size: u32,
    pub kind: i32,
    pub waypoint: Vec3,
    pub leg: u32,
    pub leg_count: u32,
    pub plans: u32,
    pub stands: i32,
}

/// `sf_gait`: how an NPC goes where it can walk.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Gait {
    pub struct_size: u32,
    pub speed: f32,
    pub acceleration: f32,
    pub turn_rate: f32,
    pub wall_distance: f32,
    pub avoids_jumps: i32,
}

/// `sf_block`: an upright box that a game has put into its level.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Block {
    pub foot: Vec3,
    pub width: f32,
    pub depth: f32,
    pub height: f32,
    pub yaw: f32,
}

/// `sf_outcome`: the outcome of a decision.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Outcome {
    pub reward: f32,
    pub end: i32,
}

/// `sf_cast_rays`: casts rays in the caller's world.
pub type CastRays = unsafe extern "C" fn(user: *mut c_void, rays: *const Ray, ray_count: usize, hits: *mut Hit);

/// A struct that may grow: its size comes first.
pub trait Growing: Copy {
    /// Name in the header.
    const NAME: &'static str;
    /// Size in the first library with this ABI version, bytes; later fields are 0 for callers that lack them.
    const FIRST_SIZE: usize;
}

macro_rules! growing {
    ($($kind:ident $name:literal $first_size:expr;)*) => {
        $(impl Growing for $kind {
            const NAME: &'static str = $name;
            const FIRST_SIZE: usize = $first_size;
        })*
    };
}

growing! {
    Body "sf_body" size_of::<Body>();
    State "sf_state" size_of::<State>();
    Progress "sf_progress" size_of::<Progress>();
    Query "sf_query" size_of::<Query>();
    GraphInfo "sf_graph_info" size_of::<GraphInfo>();
    AbilityInfo "sf_ability_info" size_of::<AbilityInfo>();
    Step "sf_step" offset_of!(Step, stands);
    Gait "sf_gait" size_of::<Gait>();
    Locomotion "sf_locomotion" offset_of!(Locomotion, step_offset);
}

impl From<world::Vec3> for Vec3 {
    fn from(world::Vec3 { x, y, z }: world::Vec3) -> Self {
        Self { x, y, z }
    }
}

impl From<world::DVec3> for Place {
    fn from(world::DVec3 { x, y, z }: world::DVec3) -> Self {
        Self { x, y, z }
    }
}

impl From<&LevelFrame> for Frame {
    fn from(LevelFrame { origin, scale, up }: &LevelFrame) -> Self {
        Self { origin: (*origin).into(), scale: *scale, z_up: (*up == UpAxis::Z).into() }
    }
}

impl From<world::Action> for Action {
    fn from(world::Action { forward, strafe, turn, jump }: world::Action) -> Self {
        Self { forward, strafe, turn, jump }
    }
}

/// The number of a surface.
pub fn surface_number(surface: Surface) -> i32 {
    surface as i32 + 1
}

impl Body {
    /// The values of a profile.
    pub fn of(raw: &world::RawCharacterProfile) -> Self {
        Self {
            struct_size: size_of::<Self>() as u32,
            height: raw.height,
            radius: raw.radius,
            forward_speed: raw.forward_speed,
            side_speed_share: raw.side_speed_share,
            turn_speed: raw.turn_speed,
            jump_speed: raw.jump_speed,
            gravity: raw.gravity,
            max_slope: raw.max_slope,
            step_height: raw.step_height,
            ground_acceleration: raw.ground_acceleration,
            air_acceleration: raw.air_acceleration,
            zip_line_speed: raw.zip_line_speed,
            jetpack_acceleration: raw.jetpack_acceleration,
            jetpack_climb_speed: raw.jetpack_climb_speed,
            extra_jumps: raw.extra_jumps.into(),
            coyote_ticks: raw.coyote_ticks.into(),
            uses_zip_lines: raw.uses_zip_lines.into(),
            uses_jetpacks: raw.uses_jetpacks.into(),
            climb_speed: raw.climb_speed,
            mantle_height: raw.mantle_height,
            swim_speed: raw.swim_speed,
            crouch_height: raw.crouch_height,
            dash_speed: raw.dash_speed,
            wall_run_seconds: raw.wall_run_seconds,
            slide_seconds: raw.slide_seconds,
            dive_seconds: raw.dive_seconds,
        }
    }
}
