//! A game with foreign physics: rapier's kinematic character controller moves characters on rapier's colliders, and
//! parry casts their rays.
//!
//!   cargo run --release -p surefoot-game --example rapier -- level.glb 127.0.0.1:7700
//!   surefoot graph export level.glb --world http://127.0.0.1:7700 --format json --out level.json
//!   surefoot eval --maps level.glb --world http://127.0.0.1:7700 --graph level.json
//!
//! The level is a file in a format that Surefoot reads (.glb, .gltf, .obj, .sfmap). Its geometry becomes colliders;
//! water and lava become areas. Pads, zip lines, teleporters and jetpacks have no effect here: use levels without them.

use anyhow::{Context, bail};
use rapier3d::control::{CharacterAutostep, CharacterLength, KinematicCharacterController};
use rapier3d::geometry::{BoundingVolume, ColliderBuilder, ContactManifold};
use rapier3d::math::Pose;
use rapier3d::parry::query::{DefaultQueryDispatcher, PersistentQueryDispatcher, Ray};
use rapier3d::parry::shape::{Capsule, CompositeShapeRef, SharedShape, TriMesh, TriMeshFlags};
use rapier3d::pipeline::{PhysicsWorld, QueryPipeline};
use std::path::Path;
use std::sync::Arc;
use surefoot_game::{
    Ability, AbilitySet, Action, BodyState, CharacterProfile, Command, End, GameWorld, Hit, Level, Surface,
    TICK_SECONDS, Vec3,
};
use surefoot_levels::{ImportOptions, NoFiles};
use surefoot_world::map::Liquid;
use surefoot_world::sense::RAY_COUNT;
use surefoot_world::{Map, navigable};

/// Terminal speed of a fall, m/s.
const MAX_FALL_SPEED: f32 = 45.0;
/// Depth of a liquid above the feet from which a body is in it, m.
const WADING_DEPTH_M: f32 = 0.25;
/// Distance up to which a body touches a face, m. It matches the controller, which keeps 1 % of the height clear and
/// tolerates 5 cm more.
const TOUCH_M: f32 = 0.07;
/// Environments at a time.
const ENVS: usize = 16;

fn main() -> anyhow::Result<()> {
    let mut args = std::env::args().skip(1);
    let (Some(level), Some(address)) = (args.next(), args.next()) else {
        bail!("usage: rapier LEVEL ADDRESS, such as: rapier level.glb 127.0.0.1:7700");
    };
    let map = load(Path::new(&level)).with_context(|| format!("cannot use {level}"))?;
    println!("rapier runs {level} at http://{address}");
    surefoot_game::serve_blocking(Scene::new(map), address.parse()?, ENVS)?;
    Ok(())
}

fn load(path: &Path) -> anyhow::Result<Map> {
    let bytes = std::fs::read(path)?;
    let options = ImportOptions::default();
    Ok(match path.extension().and_then(|extension| extension.to_str()) {
        Some("glb" | "gltf") => surefoot_levels::import_gltf(&bytes, None, &options, &NoFiles)?.map,
        Some("obj") => surefoot_levels::import_obj(&bytes, None, &options)?.map,
        _ => surefoot_levels::decode(&bytes)?,
    })
}

/// The level, shared by all worlds.
struct Scene {
    map: Arc<Map>,
    /// What bodies collide with.
    ground: SharedShape,
    /// What rays hit, with the surface of each triangle.
    sight: Arc<(TriMesh, Vec<Surface>)>,
}

impl Scene {
    fn new(map: Map) -> Self {
        let mesh = |is_wanted: fn(Surface) -> bool, flags| {
            let triangles = map.mesh().triangles().iter().filter(|triangle| is_wanted(triangle.surface()));
            let surfaces: Vec<Surface> = triangles.clone().map(|triangle| triangle.surface()).collect();
            let corners: Vec<Vec3> = triangles.flat_map(|triangle| triangle.corners()).collect();
            let indices = (0..surfaces.len() as u32).map(|idx| [3 * idx, 3 * idx + 1, 3 * idx + 2]).collect();
            (TriMesh::with_flags(corners, indices, flags).expect("a level has triangles"), surfaces)
        };
        let ground = SharedShape::new(mesh(Surface::is_solid, TriMeshFlags::FIX_INTERNAL_EDGES).0);
        Self { sight: Arc::new(mesh(|_| true, TriMeshFlags::empty())), ground, map: Arc::new(map) }
    }
}

impl Level for Scene {
    fn open(&self, body: &CharacterProfile, count: usize) -> Result<Box<dyn GameWorld>, String> {
        let mut physics = PhysicsWorld::new();
        physics.insert_collider(ColliderBuilder::new(self.ground.clone()), None);
        // Queries find the ground only once it is in the broad phase.
        physics.detect_collisions(&(), &());
        let controller = KinematicCharacterController {
            max_slope_climb_angle: body.max_slope,
            min_slope_slide_angle: body.max_slope,
            autostep: Some(CharacterAutostep {
                max_height: CharacterLength::Absolute(body.step_height),
                min_width: CharacterLength::Absolute(0.5 * body.radius),
                include_dynamic_bodies: false,
            }),
            ..KinematicCharacterController::default()
        };
        Ok(Box::new(RapierWorld {
            map: self.map.clone(),
            sight: self.sight.clone(),
            physics,
            controller,
            capsule: Capsule::new_y(0.5 * body.height - body.radius, body.radius),
            profile: body.clone(),
            characters: vec![Character::default(); count],
        }))
    }

    fn places(&self, body: &CharacterProfile, seed: u64) -> Result<Vec<Vec3>, String> {
        use rand::SeedableRng;
        let mut rng = rand::rngs::ChaCha8Rng::seed_from_u64(seed);
        navigable::sample_many(&self.map, body, 1000, &mut rng).map_err(|error| error.to_string())
    }
}

#[derive(Debug, Clone, Copy, Default)]
struct Character {
    state: BodyState,
    air_jumps_left: u8,
    ticks_in_air: u8,
    is_jump_pending: bool,
}

struct RapierWorld {
    map: Arc<Map>,
    sight: Arc<(TriMesh, Vec<Surface>)>,
    physics: PhysicsWorld,
    controller: KinematicCharacterController,
    capsule: Capsule,
    profile: CharacterProfile,
    characters: Vec<Character>,
}

impl GameWorld for RapierWorld {
    fn place(&mut self, character: usize, feet: Vec3, yaw: f32) {
        let state = BodyState { feet, yaw, ..BodyState::default() };
        self.characters[character] = Character { state, ..Character::default() };
    }

    fn tick(&mut self, commands: &[(usize, Command)]) {
        let Self { map, physics, controller, capsule, profile, characters, .. } = self;
        let queries = physics.query_pipeline();
        for (idx, Command { action, is_first }) in commands {
            let character = &mut characters[*idx];
            if *is_first {
                character.is_jump_pending = action.jump > 0.0;
            }
            character.steer(profile, action);
            let wish = character.state.velocity * TICK_SECONDS;
            let centre = Pose::from_translation(character.state.feet + Vec3::Y * (0.5 * profile.height));
            let moved = controller.move_shape(TICK_SECONDS, &queries, capsule, &centre, wish, |_| {});
            let there = Pose::from_translation(centre.translation + moved.translation);
            // The controller calls every face ground that is not upright.
            let touched = match moved.grounded {
                true if stands(&queries, capsule, &there, profile.max_slope) => Touched::Ground,
                true => Touched::Steep,
                false => Touched::Nothing,
            };
            character.note_move(profile, wish, moved.translation, touched);
            character.note_hazards(map);
        }
    }

    fn state(&self, character: usize) -> BodyState {
        let Character { state, air_jumps_left, ticks_in_air, .. } = self.characters[character];
        let can_jump = state.is_grounded || ticks_in_air <= self.profile.coyote_ticks || air_jumps_left > 0;
        BodyState { can_jump, ..state }
    }

    fn cast(&self, origin: Vec3, directions: &[Vec3; RAY_COUNT], range: f32) -> [Hit; RAY_COUNT] {
        let (mesh, surfaces) = &*self.sight;
        directions.map(|direction| {
            let hit = CompositeShapeRef(mesh).cast_local_ray(&Ray::new(origin, direction), range, false);
            hit.map(|(triangle, distance)| (distance, surfaces[triangle as usize]))
        })
    }
}

/// What a body has below it after a move.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Touched {
    Nothing,
    /// Faces that are too steep to stand on.
    Steep,
    Ground,
}

/// Whether a body whose centre is there touches a face of at most `max_slope`, rad.
fn stands(queries: &QueryPipeline<'_>, capsule: &Capsule, centre: &Pose, max_slope: f32) -> bool {
    let bounds = capsule.aabb(centre).loosened(TOUCH_M);
    queries.intersect_aabb_conservative(bounds).any(|(_, collider)| {
        let mut manifolds: Vec<ContactManifold> = Vec::new();
        let collider_in_body = centre.inv_mul(collider.position());
        let shape = collider.shape();
        // No manifolds are no contact.
        let _ = DefaultQueryDispatcher.contact_manifolds(
            &collider_in_body,
            capsule,
            shape,
            TOUCH_M,
            &mut manifolds,
            &mut None,
        );
        manifolds.iter().any(|manifold| {
            let up = -(centre.rotation * manifold.local_n1).y;
            up >= max_slope.cos() - 1.0e-3 && manifold.points.iter().any(|point| point.dist <= TOUCH_M)
        })
    })
}

impl Character {
    /// Turns the body, and changes its velocity as the action wants and gravity does.
    fn steer(&mut self, profile: &CharacterProfile, action: &Action) {
        let state = &mut self.state;
        state.used_abilities = AbilitySet::default();
        state.yaw += action.turn * profile.turn_speed * TICK_SECONDS;
        let (sin, cos) = state.yaw.sin_cos();
        let (forward, right) =
            (action.forward.max(-profile.side_speed_share), action.strafe * profile.side_speed_share);
        let wish = Vec3::new(sin * forward - cos * right, 0.0, cos * forward + sin * right).clamp_length_max(1.0);
        let limit = if state.is_grounded { profile.ground_acceleration } else { profile.air_acceleration };
        let change = wish * profile.forward_speed - Vec3::new(state.velocity.x, 0.0, state.velocity.z);
        state.velocity += change.clamp_length_max(limit * TICK_SECONDS);
        state.velocity.y = (state.velocity.y - profile.gravity * TICK_SECONDS).max(-MAX_FALL_SPEED);
        if self.is_jump_pending && profile.jump_speed > 0.0 {
            self.jump(profile);
        }
    }

    fn jump(&mut self, profile: &CharacterProfile) {
        if self.state.is_grounded || self.ticks_in_air <= profile.coyote_ticks {
            self.state.used_abilities.insert(Ability::JUMP);
        } else if self.air_jumps_left > 0 {
            self.air_jumps_left -= 1;
            self.state.used_abilities.insert(Ability::DOUBLE_JUMP);
        } else {
            return;
        }
        self.state.velocity.y = profile.jump_speed;
        self.state.is_grounded = false;
        (self.ticks_in_air, self.is_jump_pending) = (u8::MAX, false);
    }

    /// Takes note of what the controller made of the wish, m.
    fn note_move(&mut self, profile: &CharacterProfile, wish: Vec3, moved: Vec3, touched: Touched) {
        let state = &mut self.state;
        state.feet += moved;
        state.is_grounded = touched == Touched::Ground && state.velocity.y <= 0.0;
        // Walls stop a body, and so do ceilings; steps do not make it faster.
        let run = Vec3::new(moved.x, 0.0, moved.z) / TICK_SECONDS;
        let most = Vec3::new(wish.x, 0.0, wish.z).length() / TICK_SECONDS;
        let run = run.clamp_length_max(most);
        let is_stopped = state.is_grounded || wish.y > 0.0 && moved.y < 0.5 * wish.y;
        // Down a steep face a body is as fast as the face lets it.
        let slides = touched == Touched::Steep && state.velocity.y < 0.0;
        let climb = if slides { state.velocity.y.max(moved.y / TICK_SECONDS).min(0.0) } else { state.velocity.y };
        state.velocity = Vec3::new(run.x, if is_stopped { 0.0 } else { climb }, run.z);
        if state.is_grounded {
            (self.air_jumps_left, self.ticks_in_air) = (profile.extra_jumps, 0);
        } else {
            self.ticks_in_air = self.ticks_in_air.saturating_add(1);
        }
    }

    fn note_hazards(&mut self, map: &Map) {
        let state = &mut self.state;
        state.is_in_water = map.liquid_at(state.feet, WADING_DEPTH_M) == Some(Liquid::Water);
        if map.is_outside(state.feet) {
            state.harm = Some(End::Fell);
        } else if map.liquid_at(state.feet, 0.0) == Some(Liquid::Lava) {
            state.harm = Some(End::Burnt);
        }
    }
}
