//! The side of the game: an app that runs a fixed tick when it is called to.

use crate::calls::{Call, Moved, Sight as Seen};
use avian3d::prelude::{Collider, PhysicsPlugins, RigidBody, Sensor, SpatialQuery, SpatialQueryFilter, TrimeshFlags};
use bevy::app::FixedUpdate;
use bevy::ecs::prelude::*;
use bevy::ecs::system::SystemId;
use bevy::prelude::{App, AppExit, IntoScheduleConfigs, MinimalPlugins, TransformPlugin};
use bevy::time::{Fixed, Time, TimeUpdateStrategy};
use bevy::transform::components::Transform;
use bevy_surefoot::avian::{SurefootAvianPlugin, cast};
use bevy_surefoot::{
    AgentAction, AgentState, Jump, RAY_COUNT, Sight, SurefootAgent, SurefootCharacter, SurefootLevel, SurefootSurface,
    SurefootSystems,
};
use std::collections::HashMap;
use std::sync::Arc;
use std::sync::mpsc::Receiver;
use surefoot_game::{BodyState, CharacterProfile, Command, End};
use surefoot_world::map::Liquid;
use surefoot_world::sense::RayCone;
use surefoot_world::{Ability, Body, Map, TICKS_PER_SECOND};

/// Depth of a liquid above the feet from which a body is in it, m.
const WADING_DEPTH_M: f32 = 0.25;

/// The map, which knows where liquids are.
#[derive(Resource)]
struct Terrain(Arc<Map>);

/// Whether characters look around after this tick.
#[derive(Resource, Default)]
struct Looks(bool);

/// An app in a level, which carries out `calls` until there can be none.
pub fn app(level: &SurefootLevel, calls: Receiver<Call>) -> App {
    use SurefootSystems::{Aim, Look, Move, Sense};
    let mut app = App::new();
    app.add_plugins((MinimalPlugins, TransformPlugin, PhysicsPlugins::default(), SurefootAvianPlugin))
        .insert_resource(Time::<Fixed>::from_hz(f64::from(TICKS_PER_SECOND)))
        .insert_resource(TimeUpdateStrategy::FixedTimesteps(1))
        .insert_resource(Terrain(level.map().clone()))
        .init_resource::<Looks>()
        // Characters move first, with decisions made elsewhere. Then they sense and cast their rays.
        .configure_sets(FixedUpdate, (Move, Sense, Aim, Look).chain())
        .add_systems(FixedUpdate, look_around.in_set(Aim));
    for mesh in level.meshes() {
        let shape = Collider::trimesh_with_config(mesh.corners, mesh.indices, TrimeshFlags::FIX_INTERNAL_EDGES);
        // The game has the coordinates of the map.
        let place = Transform::from_translation(level.origin());
        let mut spawned = app.world_mut().spawn((RigidBody::Static, shape, place, SurefootSurface(mesh.surface)));
        if !mesh.is_solid {
            spawned.insert(Sensor);
        }
    }
    app.set_runner(move |app| run(app, &calls));
    app
}

fn run(mut app: App, calls: &Receiver<Call>) -> AppExit {
    app.finish();
    app.cleanup();
    // Colliders are found only once physics has run.
    app.update();
    let mut characters = Characters::new(app.world_mut());
    while let Ok(call) = calls.recv() {
        characters.carry_out(&mut app, call);
    }
    AppExit::Success
}

/// The entities of characters, by number.
struct Characters {
    entities: HashMap<usize, Entity>,
    next: usize,
    see: SystemId<In<Box<Seen>>, Box<Seen>>,
}

/// Casts the rays of a character that was just placed.
fn see(
    In(mut sight): In<Box<Seen>>,
    space: SpatialQuery<'_, '_>,
    surfaces: Query<'_, '_, &SurefootSurface>,
) -> Box<Seen> {
    let Seen { origin, directions, hits } = &mut *sight;
    cast(&space, (&SpatialQueryFilter::default(), &|_| true), &surfaces, *origin, directions, hits);
    sight
}

impl Characters {
    fn new(world: &mut World) -> Self {
        Self { entities: HashMap::new(), next: 0, see: world.register_system(see) }
    }

    /// Who asked may have gone meanwhile; answers to them are dropped.
    fn carry_out(&mut self, app: &mut App, call: Call) {
        match call {
            Call::Open { body, count, reply } => {
                let opened = (0..count).map(|_| self.spawn(app.world_mut(), &body)).collect();
                let _ = reply.send(opened);
            }
            Call::Close { characters } => {
                for entity in characters.iter().filter_map(|character| self.entities.remove(character)) {
                    app.world_mut().despawn(entity);
                }
            }
            Call::Place { character, feet, yaw } => {
                let mut placed = app.world_mut().entity_mut(self.entities[&character]);
                let body = placed.get::<SurefootAgent>().expect("a character is an agent").body.clone();
                let character = SurefootCharacter::facing(yaw).halted();
                placed.insert((character, SurefootCharacter::standing_at(feet, &body)));
            }
            Call::Tick { commands, looks, reply } => {
                let _ = reply.send(self.tick(app, &commands, looks));
            }
            Call::Cast { sight, reply } => {
                let _ = reply.send(app.world_mut().run_system_with(self.see, sight).expect("the app has physics"));
            }
        }
    }

    fn spawn(&mut self, world: &mut World, body: &CharacterProfile) -> usize {
        let character = SurefootCharacter::default().halted();
        let agent = SurefootAgent { body: body.clone(), ..SurefootAgent::default() };
        let entity = world.spawn((agent, character)).id();
        self.next += 1;
        self.entities.insert(self.next, entity);
        self.next
    }

    /// Runs a fixed tick in which the characters of `commands` move.
    fn tick(&self, app: &mut App, commands: &[(usize, Command)], looks: bool) -> Vec<Moved> {
        let world = app.world_mut();
        world.resource_mut::<Looks>().0 = looks;
        for (character, Command { action, is_first }) in commands {
            let mut told = world.entity_mut(self.entities[character]);
            told.insert(AgentAction { action: *action, is_first: *is_first });
            told.get_mut::<SurefootCharacter>().expect("it was spawned as one").is_halted = false;
        }
        app.update();
        let world = app.world_mut();
        let moved = |(character, _): &(usize, Command)| {
            let mut entity = world.entity_mut(self.entities[character]);
            entity.get_mut::<SurefootCharacter>().expect("it was spawned as one").is_halted = true;
            let state = *entity.get::<AgentState>().expect("agents have a state");
            let jump = entity.get::<SurefootCharacter>().and_then(|character| character.jump);
            let seen = entity
                .get::<Sight>()
                .filter(|_| looks)
                .map(|sight| Box::new(Seen { origin: sight.origin, directions: sight.directions, hits: sight.hits }));
            let state = report(&world.resource::<Terrain>().0, &state, jump);
            Moved { state, sight: seen }
        };
        commands.iter().map(moved).collect()
    }
}

/// What Surefoot hears of a character.
fn report(map: &Map, state: &AgentState, jump: Option<Jump>) -> BodyState {
    let harm = if map.is_outside(state.feet) {
        Some(End::Fell)
    } else {
        (map.liquid_at(state.feet, 0.0) == Some(Liquid::Lava)).then_some(End::Burnt)
    };
    BodyState {
        feet: state.feet,
        velocity: state.velocity,
        yaw: state.yaw,
        is_grounded: state.is_grounded,
        can_jump: state.can_jump,
        is_in_water: map.liquid_at(state.feet, WADING_DEPTH_M) == Some(Liquid::Water),
        harm,
        used_abilities: jump
            .into_iter()
            .map(|jump| if jump == Jump::Ground { Ability::JUMP } else { Ability::DOUBLE_JUMP })
            .collect(),
        ..BodyState::default()
    }
}

/// Says which rays characters need that have moved.
fn look_around(
    looks: Res<'_, Looks>,
    mut agents: Query<'_, '_, (&SurefootAgent, &SurefootCharacter, &AgentState, &mut Sight)>,
    cone: Local<'_, RayCone>,
) {
    for (agent, character, state, mut sight) in &mut agents {
        sight.is_wanted = looks.0 && !character.is_halted;
        if sight.is_wanted {
            let body = Body::at(state.feet, state.yaw);
            (sight.origin, sight.directions) = (RayCone::eye(&agent.body, &body), cone.directions_of(&body));
            sight.hits = [None; RAY_COUNT];
        }
    }
}
