//! Samples of navigable ground: places where the simulated body can stand.
//!
//! This is the paper's `f_navmesh`. A sample is a place where the capsule, when dropped, comes to rest on walkable
//! ground, clear of geometry, devices and liquids. The place may still be cut off from the rest of the map; such goals
//! count in the success rate.

use crate::character::{Action, Body, CharacterProfile, MoveScratch, is_clear};
use crate::map::CollisionMap;
use crate::{TICKS_PER_SECOND, Vec3};
use rand::{Rng, RngExt};

/// Draws after which a map counts as having no navigable ground.
const MAX_TRIES: usize = 10_000;
/// Distance kept from the rim of the map, m.
const RIM_M: f32 = 2.0;
/// Largest horizontal drift of a body that comes to rest where it was placed, m.
const MAX_DRIFT_M: f32 = 0.25;
/// Greatest number of floors in one column.
const MAX_FLOORS: usize = 8;

/// The map has no place where the character can stand.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error("no navigable ground found in {MAX_TRIES} samples: the map has no place where this character can stand")]
pub struct NoGround;

/// Draws one place to stand, uniformly over the map's area.
///
/// # Errors
/// [`NoGround`] after ten thousand draws without success.
pub fn sample(
    map: &CollisionMap,
    profile: &CharacterProfile,
    rng: &mut impl Rng,
    scratch: &mut MoveScratch,
) -> Result<Vec3, NoGround> {
    Ok(sample_where(map, profile, rng, scratch, |_| true)?.expect("every place fits"))
}

/// Draws one place to stand; `None` if `fits` rejects it. `fits` gets a point less than 0.5 m from the place, before
/// the costly tests.
///
/// # Errors
/// Same as [`sample`].
pub fn sample_where(
    map: &CollisionMap,
    profile: &CharacterProfile,
    rng: &mut impl Rng,
    scratch: &mut MoveScratch,
    fits: impl Fn(Vec3) -> bool,
) -> Result<Option<Vec3>, NoGround> {
    let extent = map.extent();
    // Imported levels may be as narrow as a wall.
    let inner = |extent: f32| {
        let rim = RIM_M.min(extent / 4.0);
        (extent > 0.0).then_some(rim..extent - rim).ok_or(NoGround)
    };
    let (along_x, along_z) = (inner(extent.x)?, inner(extent.z)?);
    for _ in 0..MAX_TRIES {
        let x = rng.random_range(along_x.clone());
        let z = rng.random_range(along_z.clone());
        let (floors, floor_count) = floors(map, profile, x, z);
        if floor_count == 0 {
            continue;
        }
        let (floor, _) = floors[rng.random_range(0..floor_count)];
        if !fits(floor) {
            return Ok(None);
        }
        if let Some(feet) = rest_on(map, profile, floor, scratch) {
            return Ok(Some(feet));
        }
    }
    Err(NoGround)
}

/// Draws `count` places to stand.
///
/// # Errors
/// Same as [`sample`].
pub fn sample_many(
    map: &CollisionMap,
    profile: &CharacterProfile,
    count: usize,
    rng: &mut impl Rng,
) -> Result<Vec<Vec3>, NoGround> {
    let mut scratch = MoveScratch::default();
    (0..count).map(|_| sample(map, profile, rng, &mut scratch)).collect()
}

/// The place where the character stands on the floor nearest to `point`; `None` if it cannot stand there, or the floor
/// is more than `rise` metres higher or lower.
pub fn stand_at(
    map: &CollisionMap,
    profile: &CharacterProfile,
    point: Vec3,
    rise: f32,
    scratch: &mut MoveScratch,
) -> Option<Vec3> {
    rest_on(map, profile, nearest_floor(map, profile, point, rise)?, scratch)
}

/// The point of the floor nearest to `point` where the character has room, off devices and out of liquids; `None` if
/// there is none there, or the floor is more than `rise` metres higher or lower. Simulates no body, so that it takes
/// a fraction of the time of [`stand_at`].
pub fn room_at(
    map: &CollisionMap,
    profile: &CharacterProfile,
    point: Vec3,
    rise: f32,
    scratch: &mut MoveScratch,
) -> Option<Vec3> {
    let floor = nearest_floor(map, profile, point, rise)?;
    let has_room = is_clear(map.mesh(), profile, above(floor, profile), 0.01, scratch)
        && map.liquid_at(floor, -0.1).is_none()
        && map.device_at(floor).is_none();
    has_room.then_some(floor)
}

/// The floor nearest to `point`, at most `rise` metres higher or lower.
pub(crate) fn nearest_floor(map: &CollisionMap, profile: &CharacterProfile, point: Vec3, rise: f32) -> Option<Vec3> {
    let extent = map.extent();
    if !(0.0..extent.x).contains(&point.x) || !(0.0..extent.z).contains(&point.z) {
        return None;
    }
    let (floors, floor_count) = floors(map, profile, point.x, point.z);
    let offset = |floor: &Vec3| (floor.y - point.y).abs();
    let nearest =
        floors[..floor_count].iter().map(|(floor, _)| *floor).min_by(|a, b| offset(a).total_cmp(&offset(b)))?;
    (offset(&nearest) <= rise).then_some(nearest)
}

/// The nearest place to stand among sixteen candidates around `point`: `reach` or half of `reach` metres away
/// horizontally, and at most `rise` metres higher or lower.
pub fn stand_near(
    map: &CollisionMap,
    profile: &CharacterProfile,
    point: Vec3,
    reach: f32,
    rise: f32,
    scratch: &mut MoveScratch,
) -> Option<Vec3> {
    let mut best: Option<(f32, Vec3)> = None;
    for idx in 0..16 {
        // Two rings, rotated relative to each other and to the lattice.
        let (ring, spoke) = (idx / 8, idx % 8);
        let radius = reach * if ring == 0 { 0.5 } else { 1.0 };
        let angle = std::f32::consts::FRAC_PI_4 * (spoke as f32 + 0.37 * ring as f32 + 0.13);
        let (x, z) = (point.x + radius * libm::cosf(angle), point.z + radius * libm::sinf(angle));
        if x < RIM_M || z < RIM_M || x > map.extent().x - RIM_M || z > map.extent().z - RIM_M {
            continue;
        }
        let (floors, floor_count) = floors(map, profile, x, z);
        for (floor, _) in &floors[..floor_count] {
            let distance = floor.distance_squared(point);
            if (floor.y - point.y).abs() <= rise
                && best.is_none_or(|(least, _)| distance < least)
                && let Some(feet) = rest_on(map, profile, *floor, scratch)
            {
                best = Some((distance, feet));
            }
        }
    }
    best.map(|(_, feet)| feet)
}

/// Down, slightly off vertical, so that no ray runs exactly along an edge of the lattice.
pub const DOWN: Vec3 = Vec3::new(0.000_31, -0.999_999_9, 0.000_23);

/// Points on the walkable floors at (`x`, `z`) with their normals, from top to bottom, and their number.
pub fn floors(map: &CollisionMap, profile: &CharacterProfile, x: f32, z: f32) -> ([(Vec3, Vec3); MAX_FLOORS], usize) {
    let mut found = [(Vec3::ZERO, Vec3::Y); MAX_FLOORS];
    let mut count = 0;
    let limit = libm::cosf(profile.max_slope);
    let mut origin = Vec3::new(x, map.extent().y - 0.01, z);
    // Number of solids that the ray is inside: ground inside a building is not a floor.
    let mut solids_around = 0;
    while count < MAX_FLOORS {
        let Some(hit) = map.mesh().cast_ray(origin, DOWN, map.extent().y) else { break };
        origin += DOWN * (hit.distance + 0.02);
        if !hit.surface.is_solid() {
            continue;
        }
        let normal = map.mesh().triangles()[hit.triangle_idx as usize].normal();
        if normal.y >= limit && solids_around == 0 {
            found[count] = (origin - DOWN * 0.02, normal);
            count += 1;
        }
        solids_around = if normal.dot(DOWN) < 0.0 { solids_around + 1 } else { (solids_around - 1).max(0) };
    }
    (found, count)
}

/// The feet of a body that was put on the floor at `floor`. A capsule on a slope touches beside its lowest point, so
/// they are a little higher than the floor.
fn above(floor: Vec3, profile: &CharacterProfile) -> Vec3 {
    let clearance = profile.radius * (1.0 / libm::cosf(profile.max_slope) - 1.0) + 0.02;
    floor + Vec3::new(0.0, clearance, 0.0)
}

/// Simulates a body until it rests on the floor at `floor`; `None` if it cannot stand there.
fn rest_on(map: &CollisionMap, profile: &CharacterProfile, floor: Vec3, scratch: &mut MoveScratch) -> Option<Vec3> {
    let start = above(floor, profile);
    if !is_clear(map.mesh(), profile, start, 0.01, scratch) {
        return None;
    }
    let mut body = Body::at(start, 0.0);
    for _ in 0..TICKS_PER_SECOND / 2 {
        body.tick(map, profile, &Action::default(), scratch);
    }
    let drift = Vec3::new(body.feet.x - floor.x, 0.0, body.feet.z - floor.z).length();
    let stands = body.is_grounded()
        && drift <= MAX_DRIFT_M
        && (body.feet.y - floor.y).abs() < 0.5
        && !map.is_outside(body.feet)
        && map.liquid_at(body.feet, -0.1).is_none()
        && map.device_at(body.feet).is_none()
        && is_clear(map.mesh(), profile, body.feet, 0.01, scratch)
        && map.mesh().solid_depth_at(body.feet + Vec3::new(0.0, 0.5 * profile.least_height(), 0.0)) == 0;
    stands.then_some(body.feet)
}
