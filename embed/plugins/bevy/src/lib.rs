//! NPCs that get there, for Bevy: a trained policy moves each character over short distances, and a graph whose edges
//! were proved by running that very policy leads it further. docs/guides/bevy.md is the introduction.
//!
//! An app adds [`SurefootPlugin`] and one back end, [`avian::SurefootAvianPlugin`] or [`rapier::SurefootRapierPlugin`],
//! and spawns entities with [`SurefootAgent`] and [`Goal`], optionally with a [`SurefootGraph`]. With
//! [`SurefootCharacter`] the back end moves them, too. An app with its own controller or rays writes [`AgentState`] in
//! [`SurefootSystems::Sense`], fills [`Sight`] and [`GoalSight`] in [`SurefootSystems::Look`], and carries out
//! [`AgentAction`] in [`SurefootSystems::Move`]. [`AgentPlan`] and the events of [`events`] report how attempts go,
//! and [`AgentLocomotion`] says how an agent moves, for its animation.
//!
//! The crate has no physics of its own, and depends on none of Surefoot's servers. Agents observe, follow plans,
//! rehearse and decide with the same code as the server's NPCs.

mod agent;
mod aim;
#[cfg(feature = "asset")]
pub mod assets;
#[cfg(feature = "avian")]
pub mod avian;
mod character;
mod decide;
mod error;
pub mod events;
mod graph;
mod level;
mod mind;
mod motion;
mod policy;
#[cfg(feature = "rapier")]
pub mod rapier;
mod stage;

pub use agent::{
    AgentAction, AgentPlan, AgentState, AgentStatus, Failure, Goal, GoalRadius, GoalSight, Sight, SurefootAgent,
};
pub use character::{Jump, SurefootCharacter};
pub use error::SurefootError;
pub use graph::SurefootGraph;
pub use level::{LevelFormat, SurefootLevel, SurfaceMesh};
pub use motion::AgentLocomotion;
pub use policy::{DefaultPolicy, SurefootPolicy};
pub use stage::SurefootBlock;
pub use surefoot_planner::{AbilitySet, Caution, Leg, LegKey, NoPath, Plan, Stop, VertexId};
pub use surefoot_world::arrival::Line;
pub use surefoot_world::map::Placed;
pub use surefoot_world::mesh::Surface;
pub use surefoot_world::sense::{RAY_COUNT, RAY_RANGE_M};
pub use surefoot_world::{Ability, Action, CharacterProfile, Locomotion, MovePhase, Pace, Steps};

use bevy_app::{App, FixedLast, FixedUpdate, Plugin};
use bevy_ecs::prelude::*;

/// What agents need in any app. Without a policy of its own they have the shipped `general-reactive`.
#[derive(Debug, Clone, Default)]
pub struct SurefootPlugin {
    /// The policy of agents that have none as a component.
    pub policy: Option<SurefootPolicy>,
}

/// What happens in a fixed tick, in this order.
#[derive(SystemSet, Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum SurefootSystems {
    /// Controllers write [`AgentState`].
    Sense,
    /// Attempts begin and end, plans are made, and agents that are about to decide request their rays in [`Sight`].
    Aim,
    /// Back ends cast the rays of each [`Sight`] that is wanted, and of each [`GoalSight`].
    Look,
    /// Agents at their goals end their attempts, and all others that are due decide in one batch, into [`AgentAction`].
    Decide,
    /// Controllers carry out [`AgentAction`].
    Move,
}

/// What a collider is made of, to the eyes of agents; [`Surface::Ground`] without this component.
#[derive(Component, Debug, Clone, Copy, PartialEq, Eq)]
pub struct SurefootSurface(pub Surface);

/// Pads, zip lines, teleporters and jetpacks that agents sense from afar, in the coordinates of the scene.
#[derive(Resource, Debug, Clone, Default)]
pub struct SurefootDevices(pub Placed);

impl Plugin for SurefootPlugin {
    fn build(&self, app: &mut App) {
        use SurefootSystems::{Aim, Decide, Look, Move, Sense};
        let policy = self.policy.clone().unwrap_or_default();
        app.insert_resource(DefaultPolicy(policy))
            .init_resource::<SurefootDevices>()
            .init_resource::<decide::Batches>()
            .init_resource::<aim::Clock>()
            .configure_sets(FixedUpdate, (Sense, Aim, Look, Decide, Move).chain())
            .add_systems(FixedUpdate, (aim::wind, aim::aim).chain().in_set(Aim))
            .add_systems(FixedUpdate, (aim::arrive, decide::decide).chain().in_set(Decide))
            .add_systems(FixedLast, motion::follow)
            .add_observer(aim::note_death);
    }
}
