//! The back end for rapier: agents see its colliders, and characters move by its kinematic character controller.
//!
//! The controller carries out one wish for each step of the physics, so that physics must run in `FixedUpdate`:
//! `RapierPhysicsPlugin::<NoUserData>::default().in_fixed_schedule()`.

use crate::agent::{AgentAction, AgentState, GoalSight, Sight, SurefootAgent};
use crate::character::SurefootCharacter;
use crate::{SurefootSurface, SurefootSystems};
use bevy_app::{App, FixedUpdate, Plugin};
use bevy_ecs::prelude::*;
use bevy_rapier3d::control::{
    CharacterAutostep, CharacterLength, KinematicCharacterController, KinematicCharacterControllerOutput,
};
use bevy_rapier3d::geometry::{Collider, CollisionGroups};
use bevy_rapier3d::pipeline::QueryFilter;
use bevy_rapier3d::plugin::{PhysicsSet, ReadRapierContext};
use bevy_time::{Fixed, Time};
use bevy_transform::components::Transform;
use surefoot_world::mesh::Surface;
use surefoot_world::sense::RAY_RANGE_M;

/// Casts the rays of agents with rapier, and moves each [`SurefootCharacter`].
#[derive(Debug, Clone, Copy, Default)]
pub struct SurefootRapierPlugin;

/// Which colliders an agent sees; all others without this component. Rays pass through all agents in any case.
#[derive(Component, Debug, Clone, Copy)]
pub struct RapierSight(pub CollisionGroups);

/// What a character wished in the last tick.
#[derive(Component, Debug, Clone, Copy, Default)]
struct Wish(bevy_math::Vec3);

impl Plugin for SurefootRapierPlugin {
    fn build(&self, app: &mut App) {
        app.configure_sets(FixedUpdate, SurefootSystems::Move.before(PhysicsSet::SyncBackend))
            .add_systems(FixedUpdate, (equip, sense).chain().in_set(SurefootSystems::Sense))
            .add_systems(FixedUpdate, look.in_set(SurefootSystems::Look))
            .add_systems(FixedUpdate, walk.in_set(SurefootSystems::Move));
    }
}

type Unequipped<'w, 's> = Query<
    'w,
    's,
    (Entity, &'static SurefootAgent, Has<Collider>, Option<&'static mut KinematicCharacterController>),
    (With<SurefootCharacter>, Without<Wish>),
>;

/// Gives new characters what rapier's controller needs. One that has a controller keeps its filters.
fn equip(mut characters: Unequipped<'_, '_>, mut commands: Commands<'_, '_>) {
    for (entity, agent, has_collider, own) in &mut characters {
        let body = &agent.body;
        let mut equipped = commands.entity(entity);
        if !has_collider {
            equipped.insert(Collider::capsule_y(0.5 * body.height - body.radius, body.radius));
        }
        let controller = KinematicCharacterController {
            max_slope_climb_angle: body.max_slope,
            min_slope_slide_angle: body.max_slope,
            autostep: Some(CharacterAutostep {
                max_height: CharacterLength::Absolute(body.step_height),
                min_width: CharacterLength::Absolute(0.5 * body.radius),
                include_dynamic_bodies: false,
            }),
            ..own.map_or_else(Default::default, |own| own.clone())
        };
        equipped.insert((controller, Wish::default()));
    }
}

type Moved<'w, 's> = Query<
    'w,
    's,
    (
        &'static SurefootAgent,
        &'static Transform,
        &'static mut Wish,
        Option<&'static KinematicCharacterControllerOutput>,
        &'static mut SurefootCharacter,
        &'static mut AgentState,
    ),
>;

/// Records what became of the last wish.
fn sense(mut characters: Moved<'_, '_>, time: Res<'_, Time<Fixed>>) {
    for (agent, transform, mut wish, output, mut character, mut state) in &mut characters {
        let wish = std::mem::take(&mut wish.0);
        if let Some(output) = output.filter(|_| wish != bevy_math::Vec3::ZERO) {
            let moves = (wish, output.effective_translation);
            character.note_move(&agent.body, moves, output.grounded, time.timestep().as_secs_f32());
        }
        *state = character.state(transform, &agent.body);
    }
}

fn look(
    mut agents: Query<'_, '_, (&mut Sight, &mut GoalSight, Option<&RapierSight>), With<SurefootAgent>>,
    surfaces: Query<'_, '_, &SurefootSurface>,
    bodies: Query<'_, '_, (), With<SurefootAgent>>,
    context: ReadRapierContext<'_, '_>,
) {
    let Ok(context) = context.single() else { return };
    let is_seen = |entity: Entity, _: &_| !bodies.contains(entity);
    let surface_of = |entity| surfaces.get(entity).map_or(Surface::Ground, |surface| surface.0);
    for (mut sight, mut goal_sight, groups) in &mut agents {
        if let Some(lines) = goal_sight.lines {
            let filter = QueryFilter { groups: groups.map(|groups| groups.0), ..QueryFilter::default() };
            context.with_query_pipeline(filter.exclude_sensors().predicate(&is_seen), |space| {
                goal_sight.is_blocked = lines.iter().any(|line| {
                    let found = space.cast_ray(line.from, line.direction, line.length, false);
                    found.is_some_and(|(entity, _)| surface_of(entity).is_solid())
                });
            });
        }
        if !sight.is_wanted {
            continue;
        }
        let Sight { origin, directions, hits, .. } = &mut *sight;
        let filter =
            QueryFilter { groups: groups.map(|groups| groups.0), ..QueryFilter::default() }.predicate(&is_seen);
        context.with_query_pipeline(filter, |space| {
            for (hit, direction) in hits.iter_mut().zip(directions) {
                let found = space.cast_ray(*origin, *direction, RAY_RANGE_M, false);
                *hit = found.map(|(entity, distance)| (distance, surface_of(entity)));
            }
        });
    }
}

type Wishing<'w, 's> = Query<
    'w,
    's,
    (
        &'static SurefootAgent,
        &'static AgentAction,
        &'static mut SurefootCharacter,
        &'static mut Transform,
        &'static mut Wish,
        &'static mut KinematicCharacterController,
    ),
>;

fn walk(mut characters: Wishing<'_, '_>, time: Res<'_, Time<Fixed>>) {
    let seconds = time.timestep().as_secs_f32();
    for (agent, action, mut character, mut transform, mut wish, mut controller) in &mut characters {
        if character.is_halted {
            controller.translation = None;
            continue;
        }
        character.steer(&agent.body, action, seconds);
        wish.0 = character.velocity * seconds;
        controller.translation = Some(wish.0);
        transform.rotation = character.rotation();
    }
}
