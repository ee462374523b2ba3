//! Growth of a world's work with the number of NPCs. The ground grows as well, so the density stays the same.

use super::{Case, timed};
use anyhow::Context;
use rand::rngs::ChaCha8Rng;
use rand::{RngExt, SeedableRng};
use std::sync::Arc;
use surefoot_world::map::{MapSize, Placed};
use surefoot_world::mesh::{Surface, Triangle};
use surefoot_world::{CharacterProfile, Map, NpcSlot, OBSERVATION_LEN, TaskConfig, Vec3, World, WorldConfig};

/// Ground for each NPC, m2: as in a dense crowd.
const AREA_M2: f32 = 4.0;

/// A flat square with this side, m.
pub(super) fn floor(side_m: f32) -> anyhow::Result<Map> {
    let [a, b, c, d] = [[0.0, 0.0], [0.0, side_m], [side_m, side_m], [side_m, 0.0]].map(|[x, z]| Vec3::new(x, 1.0, z));
    let triangles = [[a, b, c], [a, c, d]].map(|corners| Triangle::new(corners, Surface::Ground));
    let triangles = triangles.into_iter().collect::<Option<Vec<_>>>().context("the floor has an area")?;
    let side = side_m.ceil() as u32;
    Ok(Map::from_parts(MapSize { width: side, height: 20, depth: side }, triangles, Placed::default()))
}

/// A world of solid NPCs that see one another.
fn crowd(count: usize) -> anyhow::Result<World> {
    let side_m = (count as f32 * AREA_M2).sqrt();
    let config = WorldConfig::new(CharacterProfile::default(), TaskConfig::default(), true);
    let mut world = World::with_config(Arc::new(floor(side_m)?), config);
    let mut rng = ChaCha8Rng::seed_from_u64(5);
    let mut place = || Vec3::new(rng.random_range(0.5..side_m - 0.5), 1.0, rng.random_range(0.5..side_m - 0.5));
    for _ in 0..count {
        let slot = world.spawn(place(), 0.0);
        world.set_waypoint(slot, place());
    }
    Ok(world)
}

pub(super) fn cases() -> Vec<Case> {
    vec![
        Case::new("observe", "NPCs that see one another", 1024, |count| {
            let world = crowd(count)?;
            let mut row = vec![0.0; OBSERVATION_LEN.max(1024)];
            Ok(timed(|| (0..count).for_each(|idx| _ = world.observe(NpcSlot(idx as u32), &mut row[..OBSERVATION_LEN]))))
        }),
        Case::new("tick", "NPCs that see one another", 1024, |count| {
            let mut world = crowd(count)?;
            Ok(timed(|| world.tick_decision()))
        }),
    ]
}
