//! The deterministic simulation: maps, character physics, sensing and the navigation task.
//!
//! This crate takes time only as ticks and randomness only as seeds. It knows no clock, no file, no
//! socket, no async runtime, no neural network and no wire format: everything above it (training,
//! probing, serving, evaluation) calls the same [`World`] and therefore sees the same physics.
//!
//! Start reading at [`World`] (many NPCs on one map), then [`character`] (one body, one tick),
//! [`sense`] (what an NPC sees) and [`map`] (the ground).
//!
//! Conventions: right-handed, y up, metres, seconds, radians. Yaw 0 faces +z and grows counter-clockwise
//! seen from above, so +x is to the *left* of an NPC with yaw 0.

mod aabb;
mod ability;
pub mod around;
pub mod arrival;
pub mod cells;
pub mod character;
mod crates;
pub mod crossings;
mod crowd;
pub mod csr;
mod editing;
pub mod fleeing;
pub mod float;
pub mod formation;
mod gait;
mod locomotion;
pub mod map;
pub mod mesh;
mod movers;
pub mod navigable;
mod neighbours;
mod npc;
pub mod parallel;
pub mod player;
mod posed;
pub mod reach;
mod recording;
pub mod reliance;
pub mod replay;
pub mod sealed;
pub mod sense;
mod slot;
mod steps;
pub mod task;
mod trajectory;
mod units;
mod world;

pub use aabb::Aabb;
pub use ability::{Ability, AbilitySet, MAX_OWN_MOVES, MOVES, Motion, Move};
pub use arrival::Arrival;
pub use character::{Action, Body, CharacterProfile, ProfileError, RawCharacterProfile};
pub use crates::CrateState;
pub use editing::Enclosed;
pub use gait::{GAITS, Gait, NamedGait};
pub use glam::{DVec3, Vec3};
pub use locomotion::{Locomotion, MovePhase, Pace};
pub use map::{Map, MapHash, MapSpec, RawMapSpec, SpecError};
pub use movers::{MoverOrder, MoverState, PACE_RANGE};
pub use npc::{NPC_STATE_VERSION, Npc, NpcSlot, ProfileIdx, WorldConfig, WorldState};
pub use player::{Player, PlayerContact, PlayerSlot};
pub use sense::{OBSERVATION_LEN, OBSERVATION_WITH_OTHERS_LEN, RAY_COUNT};
pub use steps::Steps;
pub use task::{End, Episode, TaskConfig};
pub use trajectory::{POSE_TICKS, Pose, TakeOff, Trajectory};
pub use units::{Chance, Decisions, MoverAt, MoverId, Seconds, Seed, StopIdx, StopSet, Tick};
pub use world::{DecisionOutcome, World};

/// Physics ticks per second (the paper: "60 times per second").
pub const TICKS_PER_SECOND: u32 = 60;
/// Length of one tick in seconds.
pub const TICK_SECONDS: f32 = 1.0 / TICKS_PER_SECOND as f32;
/// Ticks for which an action is held (the paper decides every 10 time steps and repeats the action).
pub const TICKS_PER_DECISION: u32 = 10;
/// Length of one decision in seconds.
pub const DECISION_SECONDS: f32 = TICK_SECONDS * TICKS_PER_DECISION as f32;
