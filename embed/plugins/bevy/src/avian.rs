//! The back end for avian: agents see its colliders, and characters move by its move and slide.
//!
//! Physics may run in any schedule that it likes; agents act in `FixedUpdate`.

mod slide;

use crate::agent::{AgentAction, AgentState, GoalSight, Sight, SurefootAgent};
use crate::character::SurefootCharacter;
use crate::{SurefootSurface, SurefootSystems};
use avian3d::prelude::{Collider, MoveAndSlide, Sensor, SpatialQuery, SpatialQueryFilter};
use bevy_app::{App, FixedUpdate, Plugin};
use bevy_ecs::prelude::*;
use bevy_math::{Dir3, Vec3};
use bevy_time::{Fixed, Time};
use bevy_transform::components::Transform;
use slide::{Slide, Walk};
use surefoot_world::mesh::Surface;
use surefoot_world::sense::{RAY_COUNT, RAY_RANGE_M};

/// Casts the rays of agents with avian, and moves each [`SurefootCharacter`].
#[derive(Debug, Clone, Copy, Default)]
pub struct SurefootAvianPlugin;

/// Which colliders an agent sees, and which its character collides with. Without this component, it sees and
/// collides with all of them. Rays always pass through agents.
#[derive(Component, Debug, Clone, Default)]
pub struct AvianFilter {
    /// What rays hit.
    pub sight: SpatialQueryFilter,
    /// What the character collides with. Sensors are left out in any case.
    pub motion: SpatialQueryFilter,
}

impl Plugin for SurefootAvianPlugin {
    fn build(&self, app: &mut App) {
        app.add_systems(FixedUpdate, sense.in_set(SurefootSystems::Sense))
            .add_systems(FixedUpdate, look.in_set(SurefootSystems::Look))
            .add_systems(FixedUpdate, walk.in_set(SurefootSystems::Move));
    }
}

fn sense(mut characters: Query<'_, '_, (&SurefootCharacter, &SurefootAgent, &Transform, &mut AgentState)>) {
    for (character, agent, transform, mut state) in &mut characters {
        *state = character.state(transform, &agent.body);
    }
}

fn look(
    mut agents: Query<'_, '_, (&mut Sight, &mut GoalSight, Option<&AvianFilter>), With<SurefootAgent>>,
    surfaces: Query<'_, '_, &SurefootSurface>,
    bodies: Query<'_, '_, (), With<SurefootAgent>>,
    sensors: Query<'_, '_, (), With<Sensor>>,
    space: SpatialQuery<'_, '_>,
) {
    let everything = SpatialQueryFilter::default();
    let is_solid = |entity| surfaces.get(entity).map_or(Surface::Ground, |surface| surface.0).is_solid();
    agents.par_iter_mut().for_each(|(mut sight, mut goal_sight, filter)| {
        let filter = filter.map_or(&everything, |filter| &filter.sight);
        if let Some(lines) = goal_sight.lines {
            goal_sight.is_blocked = lines.iter().any(|line| {
                let direction = Dir3::new_unchecked(line.direction);
                let is_met = |entity| !bodies.contains(entity) && !sensors.contains(entity);
                let found = space.cast_ray_predicate(line.from, direction, line.length, false, filter, &is_met);
                found.is_some_and(|found| is_solid(found.entity))
            });
        }
        if sight.is_wanted {
            let Sight { origin, directions, hits, .. } = &mut *sight;
            cast(&space, (filter, &|entity| !bodies.contains(entity)), &surfaces, *origin, directions, hits);
        }
    });
}

/// Casts rays of [`RAY_RANGE_M`] from `origin`, m, at the colliders that `filter` and `is_seen` let pass.
pub fn cast(
    space: &SpatialQuery<'_, '_>,
    (filter, is_seen): (&SpatialQueryFilter, &dyn Fn(Entity) -> bool),
    surfaces: &Query<'_, '_, &SurefootSurface>,
    origin: Vec3,
    directions: &[Vec3; RAY_COUNT],
    hits: &mut [Option<(f32, Surface)>; RAY_COUNT],
) {
    for (hit, direction) in hits.iter_mut().zip(directions) {
        let direction = Dir3::new_unchecked(*direction);
        let found = space.cast_ray_predicate(origin, direction, RAY_RANGE_M, false, filter, is_seen);
        let surface_of = |entity| surfaces.get(entity).map_or(Surface::Ground, |surface| surface.0);
        *hit = found.map(|found| (found.distance, surface_of(found.entity)));
    }
}

type Characters<'w, 's> = Query<
    'w,
    's,
    (
        Entity,
        &'static SurefootAgent,
        &'static AgentAction,
        &'static mut SurefootCharacter,
        &'static mut Transform,
        Option<&'static Collider>,
        Option<&'static AvianFilter>,
    ),
>;

fn walk(mut characters: Characters<'_, '_>, space: MoveAndSlide<'_, '_>, time: Res<'_, Time<Fixed>>) {
    let delta = time.timestep();
    characters.par_iter_mut().for_each(|(entity, agent, action, mut character, mut transform, own, filter)| {
        if character.is_halted {
            return;
        }
        let body = &agent.body;
        let capsule = own.is_none().then(|| Collider::capsule(body.radius, body.height - 2.0 * body.radius));
        let mut filter = filter.map(|filter| filter.motion.clone()).unwrap_or_default();
        filter.excluded_entities.insert(entity);
        let Some(shape) = own.or(capsule.as_ref()) else { return };
        let slide = Slide { space: &space, shape, filter: &filter, body };
        character.steer(body, action, delta.as_secs_f32());
        let (from, velocity) = (transform.translation, character.velocity);
        let Walk { centre, is_grounded } = slide.walk(from, velocity, character.is_grounded, delta);
        let wish: Vec3 = velocity * delta.as_secs_f32();
        character.note_move(body, (wish, centre - from), is_grounded, delta.as_secs_f32());
        (transform.translation, transform.rotation) = (centre, character.rotation());
    });
}
