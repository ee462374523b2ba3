//! The structs that C and Rust share, field by field as in the header. `tests/header.rs` compares the two.
//!
//! Enums of the header are plain integers here: an unknown number must not become a Rust enum.

use std::ffi::{c_char, c_void};
use surefoot_world as world;
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

/// `sf_error`: why a call failed.
#[repr(C)]
#[derive(Debug, Clone, Copy)]
pub struct Error {
    /// The status that the call returned.
    pub code: i32,
    /// Text in UTF-8.
    pub message: [c_char; MESSAGE_LEN],
}

/// `sf_vec3`: a place, m, or a velocity, m/s.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Vec3 {
    /// To the left of a body with yaw 0.
    pub x: f32,
    /// Up.
    pub y: f32,
    /// Ahead of a body with yaw 0.
    pub z: f32,
}

/// `sf_ray`.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Ray {
    /// Origin, m.
    pub origin: Vec3,
    /// Unit vector.
    pub direction: Vec3,
}

/// `sf_hit`: the hit of a ray.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Hit {
    /// Distance to the surface, m.
    pub distance: f32,
    /// Distance to another body, m; 0 for none.
    pub body_distance: f32,
    /// One of the surfaces; 0 for none.
    pub surface: i32,
}

/// `sf_action`.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Action {
    /// Ahead, or back, -1 to 1.
    pub forward: f32,
    /// To the right, or left, -1 to 1.
    pub strafe: f32,
    /// To the left, or right, -1 to 1.
    pub turn: f32,
    /// A jump if above 0.
    pub jump: f32,
}

/// `sf_other`: a body that an agent sees.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Other {
    /// Lowest point, m.
    pub feet: Vec3,
    /// Velocity, m/s.
    pub velocity: Vec3,
}

/// `sf_device`: a device of the level.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Device {
    /// One of the surfaces that are devices.
    pub kind: i32,
    /// 1 for a teleporter that works in both directions.
    pub two_way: i32,
    /// Its centre, or its entrance, m.
    pub from: Vec3,
    /// Its exit, m.
    pub to: Vec3,
}

/// `sf_body`: the body of a character.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Body {
    /// Size of the struct.
    pub struct_size: u32,
    /// Height, m.
    pub height: f32,
    /// Radius, m.
    pub radius: f32,
    /// Top speed ahead, m/s.
    pub forward_speed: f32,
    /// Top speed sideways and back as a share of `forward_speed`.
    pub side_speed_share: f32,
    /// Top turning speed, rad/s.
    pub turn_speed: f32,
    /// Upward speed of a jump, m/s.
    pub jump_speed: f32,
    /// Gravity, m/s2.
    pub gravity: f32,
    /// Steepest slope, rad.
    pub max_slope: f32,
    /// Highest step, m.
    pub step_height: f32,
    /// Acceleration on the ground, m/s2.
    pub ground_acceleration: f32,
    /// Acceleration in the air, m/s2.
    pub air_acceleration: f32,
    /// Speed along zip lines, m/s.
    pub zip_line_speed: f32,
    /// Acceleration of a jetpack, m/s2.
    pub jetpack_acceleration: f32,
    /// Upward speed at which a jetpack stops pushing, m/s.
    pub jetpack_climb_speed: f32,
    /// Jumps in the air, 0 to 255.
    pub extra_jumps: u32,
    /// Ticks after leaving the ground in which a jump counts as a jump from the ground, 0 to 254.
    pub coyote_ticks: u32,
    /// Whether it can use zip lines.
    pub uses_zip_lines: i32,
    /// Whether it can use jetpacks.
    pub uses_jetpacks: i32,
}

/// `sf_state`: where a body is and how it moves.
#[repr(C)]
#[derive(Debug, Clone, Copy)]
pub struct State {
    /// Size of the struct.
    pub struct_size: u32,
    /// Sum of flags.
    pub flags: u32,
    /// Lowest point, m.
    pub feet: Vec3,
    /// Velocity, m/s.
    pub velocity: Vec3,
    /// Heading, rad.
    pub yaw: f32,
    /// Share of the breath used, 0 to 1.
    pub breath_used: f32,
    /// Thrust left in a jetpack, s.
    pub jetpack_seconds: f32,
    /// Number of `others`.
    pub other_count: u32,
    /// Bodies in sight.
    pub others: *const Other,
}

/// `sf_state`'s flags.
pub const GROUNDED: u32 = 1;
/// The body can jump now, from the ground or in the air.
pub const CAN_JUMP: u32 = 2;
/// The body rides a zip line.
pub const RIDES: u32 = 4;

/// `sf_progress`: the progress of an agent.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Progress {
    /// Size of the struct.
    pub struct_size: u32,
    /// Whether it has reached its goal.
    pub reached: i32,
    /// Smallest distance to the goal so far, m.
    pub best_distance: f32,
    /// Decisions since `best_distance` shrank.
    pub stalled_decisions: u32,
    /// Decisions towards this goal.
    pub decisions: u32,
}

/// `sf_query`: a request for a plan.
#[repr(C)]
#[derive(Debug, Clone, Copy)]
pub struct Query {
    /// Size of the struct.
    pub struct_size: u32,
    /// Sum of abilities that the plan must not use.
    pub without: u32,
    /// Start, m.
    pub start: Vec3,
    /// Goal, m.
    pub goal: Vec3,
    /// 0 bold to 1 careful.
    pub caution: f32,
    /// Number of `avoid`.
    pub avoid_count: u32,
    /// Legs that the plan must not use.
    pub avoid: *const LegKey,
}

/// `sf_leg_key`: the ends of a leg.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct LegKey {
    /// A vertex, or the start.
    pub from: u32,
    /// A vertex, or the goal.
    pub to: u32,
}

/// `sf_leg`: a leg of a plan.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Leg {
    /// End of the leg, m.
    pub waypoint: Vec3,
    /// Its ends.
    pub key: LegKey,
    /// Index of its most demanding ability.
    pub ability: i32,
    /// Expected duration, s.
    pub seconds: f32,
    /// Chance of success.
    pub chance: f32,
    /// Chance of dying.
    pub death_chance: f32,
}

/// `sf_plan`: a whole plan.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Plan {
    /// Index of its first leg.
    pub first_leg: u32,
    /// Number of its legs.
    pub leg_count: u32,
    /// Expected duration, s.
    pub seconds: f32,
    /// Chance that every leg succeeds.
    pub chance: f32,
    /// Chance of arriving, including re-plans after failed legs.
    pub arrival_chance: f32,
    /// Chance of dying.
    pub death_chance: f32,
    /// Why there is no path; 0 if there is one.
    pub no_path: i32,
    /// 1 if there is no path, and the plan leads to the nearest place to the goal.
    pub leads_near: i32,
}

/// `sf_edge`: a proved edge.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Edge {
    /// Its vertices.
    pub key: LegKey,
    /// Index of its most demanding ability.
    pub ability: i32,
    /// 0 if it is closed.
    pub is_open: i32,
    /// Expected duration, s.
    pub seconds: f32,
    /// Chance of success.
    pub chance: f32,
    /// Chance of dying.
    pub death_chance: f32,
    /// Current cost in a careful search, in decisions.
    pub cost: f32,
}

/// `sf_graph_info`.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct GraphInfo {
    /// Size of the struct.
    pub struct_size: u32,
    /// Number of vertices.
    pub vertex_count: u32,
    /// Number of edges.
    pub edge_count: u32,
    /// Number of islands.
    pub island_count: u32,
}

/// `sf_edit`: a designer's change.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Edit {
    /// One of the kinds of edits.
    pub kind: i32,
    /// Seconds of a forced edge, or factor of a price.
    pub value: f32,
    /// Place of the edge's first vertex, m.
    pub from: Vec3,
    /// Place of the edge's last vertex, m.
    pub to: Vec3,
}

/// `sf_traversal`: one traversal of an edge.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Traversal {
    /// The edge.
    pub key: LegKey,
    /// Number of decisions.
    pub decisions: u32,
    /// 0 arrived, 1 failed, 2 died.
    pub end: i32,
}

/// `sf_step`: the next step of a follower.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Step {
    /// Size of the struct.
    pub struct_size: u32,
    /// One of the kinds of steps.
    pub kind: i32,
    /// The waypoint, m, if there is a plan.
    pub waypoint: Vec3,
    /// Index of the current leg.
    pub leg: u32,
    /// Number of legs of the plan; 0 without a plan.
    pub leg_count: u32,
    /// Number of plans so far.
    pub plans: u32,
}

/// `sf_outcome`: the outcome of a decision.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Outcome {
    /// Reward.
    pub reward: f32,
    /// One of the ends; 0 while the attempt is running.
    pub end: i32,
}

/// `sf_cast_rays`: casts rays in the caller's world.
pub type CastRays = unsafe extern "C" fn(user: *mut c_void, rays: *const Ray, ray_count: usize, hits: *mut Hit);

/// A struct that may grow: its size comes first.
pub trait Growing: Copy {
    /// Name in the header.
    const NAME: &'static str;
    /// The struct's size in the caller's version.
    fn struct_size(&self) -> u32;
}

macro_rules! growing {
    ($($kind:ident $name:literal),*) => {
        $(impl Growing for $kind {
            const NAME: &'static str = $name;

            fn struct_size(&self) -> u32 {
                self.struct_size
            }
        })*
    };
}

growing!(
    Body "sf_body", State "sf_state", Progress "sf_progress", Query "sf_query", GraphInfo "sf_graph_info",
    Step "sf_step"
);

impl From<world::Vec3> for Vec3 {
    fn from(world::Vec3 { x, y, z }: world::Vec3) -> Self {
        Self { x, y, z }
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
        }
    }
}
