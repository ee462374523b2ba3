//! Crates: boxes that bodies push. Rapier's solver lets them slide, fall and stack. They rotate about the y axis only,
//! so they always stand level.
//!
//! A tick of the crates depends only on the state of the world: each tick builds rapier's sets from the crates that are
//! awake and their surroundings. So the state contains no solver cache, and a restored world continues with the same
//! bits.

use crate::map::mover::{MAX_MOVER_SPEED, Mover};
use crate::map::{Map, MoverKind, MoverStop};
use crate::mesh::Triangle;
use crate::posed::Posed;
use crate::{TICK_SECONDS, Vec3};
use rapier3d::dynamics::{RigidBodyBuilder, RigidBodyHandle};
use rapier3d::geometry::ColliderBuilder;
use rapier3d::math::{Pose, Rotation};
use rapier3d::pipeline::PhysicsWorld;
use serde::{Deserialize, Serialize};

/// Density of crates, kg/m3.
const DENSITY: f32 = 50.0;
/// Coefficient of friction of crates and the ground.
const FRICTION: f32 = 0.4;
/// Greatest force of a body's push, N: it moves a crate of 2.5 m3 over level ground.
const PUSH_N: f32 = 500.0;
/// Speed of a pushed crate as a share of the speed that the body wants.
const PUSH_SPEED_SHARE: f32 = 0.5;
/// A body nearer to a crate than this touches it, m.
const TOUCH_M: f32 = 0.06;
/// Largest vertical part of a push's direction, so that a body that stands on a crate does not push it.
const MAX_PUSH_RISE: f32 = 0.5;
/// A crate slower than this, m/s and rad/s, is at rest. It sleeps after so many ticks at rest.
const REST_SPEED: f32 = 0.05;
const ASLEEP_AFTER: u8 = 30;
/// A crate with more triangles is simulated as a box.
const MAX_HULL_TRIANGLES: usize = 64;
/// Objects farther from a crate than this do not touch it within a tick, m.
const NEAR_M: f32 = 0.3;

/// Position and motion of a crate.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct CrateState {
    /// Displacement from its modelled position, m.
    pub offset: Vec3,
    /// Rotation about the y axis through its pivot, rad.
    pub yaw: f32,
    /// Velocity, m/s.
    pub velocity: Vec3,
    /// Angular velocity about the y axis, rad/s.
    pub spin: f32,
    /// Ticks at rest; after 30 it sleeps until something touches it.
    pub rested: u8,
    /// Whether it is on the map. A crate that has fallen off the map is absent until an order brings it back.
    pub is_there: bool,
}

impl CrateState {
    /// The state of a crate at its modelled position.
    pub(crate) const START: Self =
        Self { offset: Vec3::ZERO, yaw: 0.0, velocity: Vec3::ZERO, spin: 0.0, rested: 0, is_there: true };

    /// Current pose.
    pub(crate) fn pose(&self) -> MoverStop {
        MoverStop { offset: self.offset, yaw: self.yaw, is_there: self.is_there }
    }

    /// Whether the numbers are possible for a crate on a map.
    pub(crate) fn is_sound(&self, farthest: f32) -> bool {
        // These comparisons are false for NaN.
        self.offset.abs().cmple(Vec3::splat(farthest)).all()
            && self.yaw.abs() <= std::f32::consts::TAU
            && self.velocity.length() <= 1.001 * MAX_MOVER_SPEED
            && self.spin.abs() <= MAX_MOVER_SPEED
    }

    /// The same crate without motion.
    pub(crate) fn halted(self) -> Self {
        Self { velocity: Vec3::ZERO, spin: 0.0, ..self }
    }

    fn is_awake(&self) -> bool {
        self.is_there && self.rested < ASLEEP_AFTER
    }

    fn is_at_rest(&self) -> bool {
        self.velocity.length_squared() < REST_SPEED * REST_SPEED && self.spin.abs() < REST_SPEED
    }
}

/// An upright capsule that pushes and blocks crates.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Pusher {
    pub feet: Vec3,
    pub radius: f32,
    pub height: f32,
    /// Velocity that it would have without obstacles, m/s.
    pub wish: Vec3,
}

impl Pusher {
    fn bounds(&self) -> (Vec3, Vec3) {
        let aside = Vec3::new(self.radius, 0.0, self.radius);
        (self.feet - aside, self.feet + aside + Vec3::Y * self.height)
    }
}

/// A crate of the map with its state. A held crate ignores pushes.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Crate {
    /// Index of its mover.
    pub idx: usize,
    pub state: CrateState,
    pub is_held: bool,
}

/// Moves the crates of a map by one tick. The other movers have moved already.
pub(crate) fn step(map: &Map, posed: &[Posed], crates: &mut [Crate], pushers: &[Pusher]) {
    for it in &mut *crates {
        for pusher in pushers {
            push(&map.movers()[it.idx], &posed[it.idx], it, pusher);
        }
        it.state.rested = if is_disturbed(map, posed, it) { 0 } else { it.state.rested };
    }
    wake_beside(posed, crates);
    let awake = |it: &Crate| it.state.is_awake() && !it.is_held;
    if !crates.iter().any(awake) {
        return;
    }
    let mut physics = CratePhysics::default();
    let mut moving = Vec::new();
    for (number, it) in crates.iter().enumerate().filter(|(_, it)| it.state.is_there) {
        if awake(it) {
            moving.push((number, physics.add_crate(&map.movers()[it.idx], it.state)));
        }
    }
    let boxes: Vec<(Vec3, Vec3)> = moving.iter().map(|(number, _)| reach_of(posed, &crates[*number])).collect();
    let is_near = |low: Vec3, high: Vec3| boxes.iter().any(|(a, b)| a.cmple(high).all() && b.cmpge(low).all());
    physics.add_ground(map, &boxes);
    for (idx, at) in posed.iter().enumerate().filter(|(_, at)| is_near(at.low, at.high)) {
        if !moving.iter().any(|(number, _)| crates[*number].idx == idx) {
            physics.add_mover(&map.movers()[idx], at);
        }
    }
    for pusher in pushers {
        let (low, high) = pusher.bounds();
        if is_near(low, high) {
            physics.add_capsule(pusher);
        }
    }
    physics.world.step();
    for (number, body) in moving {
        let it = &mut crates[number];
        it.state = physics.read(body, &map.movers()[it.idx], it.state);
        let (low, high) = map.movers()[it.idx].bounds_at(0);
        it.state.is_there = !map.is_outside((low + high) * 0.5 + it.state.offset);
    }
}

/// The box within which objects may touch a crate in a tick, m.
fn reach_of(posed: &[Posed], it: &Crate) -> (Vec3, Vec3) {
    let (at, travel) = (&posed[it.idx], it.state.velocity.abs() * TICK_SECONDS + Vec3::splat(NEAR_M));
    (at.low - travel, at.high + travel)
}

/// Applies the push of a body to a crate that it touches.
fn push(mover: &Mover, at: &Posed, it: &mut Crate, pusher: &Pusher) {
    let (low, high) = pusher.bounds();
    let reach = Vec3::splat(TOUCH_M);
    if it.is_held || pusher.wish == Vec3::ZERO || !at.touches(low - reach, high + reach) {
        return;
    }
    let foot = pusher.feet + Vec3::Y * pusher.radius;
    let contact = |triangle: &Triangle| {
        triangle.capsule_contact(foot, pusher.height - 2.0 * pusher.radius, pusher.radius + TOUCH_M)
    };
    let deepest = at.triangles.iter().filter_map(contact).max_by(|a, b| a.depth.total_cmp(&b.depth));
    let Some(contact) = deepest.filter(|contact| contact.normal.y.abs() < MAX_PUSH_RISE) else { return };
    let towards = -Vec3::new(contact.normal.x, 0.0, contact.normal.z).normalize_or_zero();
    let gain = PUSH_SPEED_SHARE * pusher.wish.dot(towards) - it.state.velocity.dot(towards);
    if gain <= 0.0 {
        return;
    }
    let (least, most) = mover.bounds_at(0);
    let mass = DENSITY * (most - least).element_product().max(0.01);
    let change = (PUSH_N * TICK_SECONDS / mass).min(gain);
    it.state.velocity += towards * change;
    // A push beside the middle rotates the crate like a plate of its extent.
    let arm = contact.point - ((least + most) * 0.5 + it.state.offset);
    let inertia = ((most - least) * (most - least) * Vec3::new(1.0, 0.0, 1.0)).element_sum() / 12.0;
    it.state.spin += (arm.z * towards.x - arm.x * towards.z) * change / inertia.max(0.01);
    it.state.rested = 0;
}

/// Whether a moving mover touches a crate, or a mover has vanished.
fn is_disturbed(map: &Map, posed: &[Posed], it: &Crate) -> bool {
    let (low, high) = (posed[it.idx].low - Vec3::splat(TOUCH_M), posed[it.idx].high + Vec3::splat(TOUCH_M));
    map.movers().iter().zip(posed).any(|(mover, at)| {
        let has_gone = at.former.is_there && !at.pose.is_there;
        let moves = at.pose != at.former || mover.belt != Vec3::ZERO;
        mover.kind != MoverKind::Crate && (has_gone || (moves && at.touches(low, high)))
    })
}

/// Wakes the crates that touch a moving crate, and those that touch them.
fn wake_beside(posed: &[Posed], crates: &mut [Crate]) {
    let mut moving: Vec<usize> = (0..crates.len())
        .filter(|number| crates[*number].state.is_awake() && !crates[*number].state.is_at_rest())
        .collect();
    while let Some(number) = moving.pop() {
        let at = &posed[crates[number].idx];
        let (low, high) = (at.low - Vec3::splat(TOUCH_M), at.high + Vec3::splat(TOUCH_M));
        for (other, it) in crates.iter_mut().enumerate() {
            if !it.state.is_awake() && it.state.is_there && posed[it.idx].touches(low, high) {
                it.state.rested = 0;
                moving.push(other);
            }
        }
    }
}

/// The physics of one tick: the crates that are awake and their surroundings.
#[derive(Default)]
struct CratePhysics {
    world: PhysicsWorld,
}

fn turned_by(yaw: f32) -> Rotation {
    let (sin, cos) = libm::sincosf(0.5 * yaw);
    Rotation::from_xyzw(0.0, sin, 0.0, cos)
}

impl CratePhysics {
    fn add_crate(&mut self, mover: &Mover, state: CrateState) -> RigidBodyHandle {
        let body = RigidBodyBuilder::dynamic()
            .pose(Pose::from_parts(mover.pivot + state.offset, turned_by(state.yaw)))
            .linvel(state.velocity)
            .angvel(Vec3::Y * state.spin)
            .enabled_rotations(false, true, false)
            .can_sleep(false);
        let corners: Vec<Vec3> = mover.triangles.iter().flatten().map(|corner| *corner - mover.pivot).collect();
        let (low, high) = mover.bounds_at(0);
        let (middle, half) = ((low + high) * 0.5 - mover.pivot, (high - low) * 0.5);
        let hull =
            if mover.triangles.len() > MAX_HULL_TRIANGLES { None } else { ColliderBuilder::convex_hull(&corners) };
        let shape = hull.unwrap_or_else(|| ColliderBuilder::cuboid(half.x, half.y, half.z).translation(middle));
        self.world.insert(body, shape.density(DENSITY).friction(FRICTION)).0
    }

    fn add_triangles(&mut self, body: RigidBodyBuilder, triangles: &[Triangle]) {
        let vertices: Vec<Vec3> = triangles.iter().flat_map(Triangle::corners).collect();
        let indices = (0..triangles.len() as u32).map(|idx| [3 * idx, 3 * idx + 1, 3 * idx + 2]).collect();
        // It fails only for a mesh without triangles.
        if let Ok(shape) = ColliderBuilder::trimesh(vertices, indices) {
            self.world.insert(body, shape.friction(FRICTION));
        }
    }

    /// Adds the ground of the map inside these boxes.
    fn add_ground(&mut self, map: &Map, boxes: &[(Vec3, Vec3)]) {
        let (mut all, mut found) = (Vec::new(), Vec::new());
        for (low, high) in boxes {
            map.mesh().gather_solids(*low, *high, &mut found);
            all.extend_from_slice(&found);
        }
        all.sort_unstable();
        all.dedup();
        let triangles: Vec<Triangle> = all.iter().map(|idx| map.mesh().triangles()[*idx as usize]).collect();
        self.add_triangles(RigidBodyBuilder::fixed(), &triangles);
    }

    /// Adds a mover, which carries the crates on it.
    fn add_mover(&mut self, mover: &Mover, at: &Posed) {
        let velocity = (at.pose.offset - at.former.offset) / TICK_SECONDS + mover.belt;
        self.add_triangles(RigidBodyBuilder::kinematic_velocity_based().linvel(velocity), &at.triangles);
    }

    fn add_capsule(&mut self, pusher: &Pusher) {
        let half = 0.5 * pusher.height - pusher.radius;
        let at = pusher.feet + Vec3::Y * (0.5 * pusher.height);
        let shape = ColliderBuilder::capsule_y(half, pusher.radius).friction(0.0);
        self.world.insert(RigidBodyBuilder::fixed().translation(at), shape);
    }

    /// State of a crate after the tick.
    fn read(&self, body: RigidBodyHandle, mover: &Mover, former: CrateState) -> CrateState {
        let body = &self.world.bodies[body];
        let rotation = body.rotation();
        let state = CrateState {
            offset: body.translation() - mover.pivot,
            yaw: 2.0 * libm::atan2f(rotation.y, rotation.w),
            velocity: body.linvel().clamp_length_max(MAX_MOVER_SPEED),
            spin: body.angvel().y.clamp(-MAX_MOVER_SPEED, MAX_MOVER_SPEED),
            ..former
        };
        if !(state.offset.is_finite() && state.velocity.is_finite() && state.yaw.is_finite() && state.spin.is_finite())
        {
            return former.halted();
        }
        let rested = if state.is_at_rest() { former.rested.saturating_add(1) } else { 0 };
        let asleep = rested >= ASLEEP_AFTER;
        CrateState { rested, ..if asleep { state.halted() } else { state } }
    }
}
