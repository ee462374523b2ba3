//! The cost of rapier3d and parry3d on our maps: the reference for our own simulation.
//!
//! One [`TriMesh`] of the map's solid triangles serves all three measurements: parry's rays, rapier's kinematic
//! character controller and rapier's dynamic bodies. Wherever there is a choice, the reference gets the cheaper option:
//! no autostep, no continuous collision detection, no contacts between NPCs, merged vertices.

use super::median;
use parry3d::query::{Ray, RayCast};
use parry3d::shape::{Capsule, SharedShape, TriMesh, TriMeshFlags};
use rand::{Rng, RngExt};
use rapier3d::control::KinematicCharacterController;
use rapier3d::dynamics::RigidBodyBuilder;
use rapier3d::geometry::{ColliderBuilder, Group, InteractionGroups, InteractionTestMode};
use rapier3d::math::Pose;
use rapier3d::pipeline::PhysicsWorld;
use std::hint::black_box;
use std::time::{Duration, Instant};
use surefoot_world::sense::{RAY_COUNT, RAY_RANGE_M, RayCone};
use surefoot_world::{CharacterProfile, Map, TICK_SECONDS, TICKS_PER_DECISION, Vec3};

/// Height above the feet from which an NPC's rays start, m.
const EYE_M: f32 = 1.53;
/// Number of rounds; each casts the rays of every start once.
const RAY_ROUNDS: usize = 31;
/// Number of running NPCs, for either kind of motion.
const NPCS: usize = 256;
/// Ticks before the timed ones, after which caches are warm and the NPCs are running.
const WARM_UP_TICKS: usize = 15;
/// Number of timed ticks.
const TICKS: usize = 240;
/// Largest change of an NPC's heading in one tick, rad.
const SWERVE: f32 = 0.1;
/// Probability of a jump in one tick on the ground.
const JUMP_CHANCE: f64 = 1.0 / 60.0;
/// Height above the ground at which an NPC starts, m: just out of contact.
const LIFT_M: f32 = 0.05;
/// Vertical speed below which a dynamic body may jump, m/s: rapier does not report whether it stands on something.
const STANDING_SPEED: f32 = 1.0;

/// Measures rapier and parry on the solid triangles of `map`, with NPCs that run from `starts`.
///
/// Returns decisions per second on one core, each of ten kinematic moves and 64 rays, and three times: of one ray
/// against parry's triangle mesh, and of one tick of one running NPC, moved by rapier's kinematic character controller
/// or as a dynamic rapier body with locked rotations. Each time is the median over rounds or ticks of the mean in one
/// round or tick, us.
///
/// Takes a few seconds on one core. Casts rays from every start; the NPCs are distributed over the starts.
///
/// # Panics
/// If `starts` is empty or the map has no solid triangle.
pub fn measure(map: &Map, profile: &CharacterProfile, starts: &[Vec3], rng: &mut impl Rng) -> [f64; 4] {
    assert!(!starts.is_empty(), "the reference needs at least one start");
    let mesh = solid_mesh(map);
    let ray_us = ray_us(&mesh, starts, rng);
    let ground = SharedShape::new(mesh);
    let kinematic_move_us = kinematic_move_us(map, profile, ground.clone(), walkers(starts, NPCS, rng), rng);
    let dynamic_move_us = dynamic_move_us(map, profile, ground, walkers(starts, NPCS, rng), rng);
    let decision_us = f64::from(TICKS_PER_DECISION) * kinematic_move_us + RAY_COUNT as f64 * ray_us;
    [1.0e6 / decision_us, ray_us, kinematic_move_us, dynamic_move_us]
}

fn solid_mesh(map: &Map) -> TriMesh {
    let vertices: Vec<Vec3> = map
        .mesh()
        .triangles()
        .iter()
        .filter(|triangle| triangle.surface().is_solid())
        .flat_map(|triangle| triangle.corners())
        .collect();
    let indices = (0..vertices.len() as u32 / 3).map(|idx| [3 * idx, 3 * idx + 1, 3 * idx + 2]).collect();
    TriMesh::with_flags(vertices, indices, TriMeshFlags::MERGE_DUPLICATE_VERTICES)
        .expect("every map has solid triangles, and an empty mesh is the only error")
}

fn ray_us(mesh: &TriMesh, starts: &[Vec3], rng: &mut impl Rng) -> f64 {
    let cone = RayCone::default();
    let rounds = (0..RAY_ROUNDS).map(|_| {
        let mut rays = Vec::with_capacity(starts.len() * RAY_COUNT);
        for start in starts {
            let (sin, cos) = random_yaw(rng).sin_cos();
            rays.extend(cone.directions().iter().map(|local| {
                let direction = Vec3::new(sin * local.z - cos * local.x, local.y, cos * local.z + sin * local.x);
                Ray::new(*start + Vec3::Y * EYE_M, direction)
            }));
        }
        let begin = Instant::now();
        for ray in &rays {
            black_box(mesh.cast_local_ray(ray, RAY_RANGE_M, true));
        }
        micros_each(begin.elapsed(), rays.len())
    });
    median(rounds.collect())
}

fn kinematic_move_us(
    map: &Map,
    profile: &CharacterProfile,
    ground: SharedShape,
    mut walkers: Vec<Walker>,
    rng: &mut impl Rng,
) -> f64 {
    let mut world = PhysicsWorld::new();
    world.insert_collider(ColliderBuilder::new(ground), None);
    // Queries find the ground only once it is in the broad phase.
    world.detect_collisions(&(), &());
    let queries = world.query_pipeline();
    let controller = KinematicCharacterController {
        max_slope_climb_angle: profile.max_slope,
        min_slope_slide_angle: profile.max_slope,
        ..KinematicCharacterController::default()
    };
    let capsule = Capsule::new_y(half_length(profile), profile.radius);
    let mut feet: Vec<Vec3> = walkers.iter().map(|walker| walker.start).collect();
    let mut support: Vec<Support> = vec![Support::default(); walkers.len()];

    let ticks = (0..WARM_UP_TICKS + TICKS).map(|_| {
        walkers.iter_mut().for_each(|walker| walker.steer(rng));
        let begin = Instant::now();
        for ((walker, feet), support) in walkers.iter().zip(&mut feet).zip(&mut support) {
            if support.grounded {
                support.rise = if walker.wants_jump { profile.jump_speed } else { 0.0 };
            }
            support.rise -= profile.gravity * TICK_SECONDS;
            let wish = (walker.run(profile) + Vec3::Y * support.rise) * TICK_SECONDS;
            let centre = Pose::from_translation(*feet + Vec3::Y * (0.5 * profile.height));
            let moved = controller.move_shape(TICK_SECONDS, &queries, &capsule, &centre, wish, |_| {});
            *feet += moved.translation;
            support.grounded = moved.grounded && support.rise <= 0.0;
            if map.is_outside(*feet) {
                *feet = walker.start;
                *support = Support::default();
            }
        }
        micros_each(begin.elapsed(), walkers.len())
    });
    median(ticks.skip(WARM_UP_TICKS).collect())
}

fn dynamic_move_us(
    map: &Map,
    profile: &CharacterProfile,
    ground: SharedShape,
    mut walkers: Vec<Walker>,
    rng: &mut impl Rng,
) -> f64 {
    const GROUND: Group = Group::GROUP_1;
    const NPC: Group = Group::GROUP_2;
    let mut world = PhysicsWorld::new();
    world.gravity = Vec3::Y * -profile.gravity;
    world.integration_parameters.dt = TICK_SECONDS;
    // Rapier would sweep bodies at this speed, which costs 50 % more; no body falls through the ground without it.
    world.integration_parameters.max_ccd_substeps = 0;
    world.insert_collider(
        ColliderBuilder::new(ground).collision_groups(InteractionGroups::new(GROUND, NPC, InteractionTestMode::And)),
        None,
    );
    let to_centre = Vec3::Y * (0.5 * profile.height);
    let bodies: Vec<_> = walkers
        .iter()
        .map(|walker| {
            let body = RigidBodyBuilder::dynamic().translation(walker.start + to_centre).lock_rotations();
            let capsule = ColliderBuilder::capsule_y(half_length(profile), profile.radius)
                .friction(0.0)
                .collision_groups(InteractionGroups::new(NPC, GROUND, InteractionTestMode::And));
            world.insert(body.can_sleep(false), capsule).0
        })
        .collect();

    let ticks = (0..WARM_UP_TICKS + TICKS).map(|_| {
        walkers.iter_mut().for_each(|walker| walker.steer(rng));
        let begin = Instant::now();
        for (walker, &handle) in walkers.iter().zip(&bodies) {
            let body = &mut world.bodies[handle];
            if map.is_outside(body.translation() - to_centre) {
                body.set_translation(walker.start + to_centre, true);
                body.set_linvel(Vec3::ZERO, true);
            }
            let rise = body.linvel().y;
            let jumps = walker.wants_jump && rise.abs() < STANDING_SPEED;
            let rise = if jumps { profile.jump_speed } else { rise };
            body.set_linvel(walker.run(profile) + Vec3::Y * rise, true);
        }
        world.step();
        micros_each(begin.elapsed(), walkers.len())
    });
    median(ticks.skip(WARM_UP_TICKS).collect())
}

/// An NPC that runs ahead, swerves a little and sometimes jumps.
struct Walker {
    start: Vec3,
    yaw: f32,
    wants_jump: bool,
}

impl Walker {
    fn steer(&mut self, rng: &mut impl Rng) {
        self.yaw += rng.random_range(-SWERVE..SWERVE);
        self.wants_jump = rng.random_bool(JUMP_CHANCE);
    }

    fn run(&self, profile: &CharacterProfile) -> Vec3 {
        let (sin, cos) = self.yaw.sin_cos();
        Vec3::new(sin, 0.0, cos) * profile.forward_speed
    }
}

/// The vertical motion of a kinematic NPC, which rapier leaves to its caller.
#[derive(Clone, Default)]
struct Support {
    rise: f32,
    grounded: bool,
}

fn walkers(starts: &[Vec3], count: usize, rng: &mut impl Rng) -> Vec<Walker> {
    let starts = starts.iter().cycle().take(count);
    starts.map(|&start| Walker { start: start + Vec3::Y * LIFT_M, yaw: random_yaw(rng), wants_jump: false }).collect()
}

fn random_yaw(rng: &mut impl Rng) -> f32 {
    rng.random_range(-std::f32::consts::PI..std::f32::consts::PI)
}

/// Half the length of the capsule's straight part, m.
fn half_length(profile: &CharacterProfile) -> f32 {
    0.5 * profile.height - profile.radius
}

fn micros_each(elapsed: Duration, count: usize) -> f64 {
    elapsed.as_secs_f64() * 1.0e6 / count as f64
}
