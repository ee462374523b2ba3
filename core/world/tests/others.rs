//! What NPCs see of each other and of players.

use crate::stage::player;
use std::sync::Arc;
use surefoot_world::map::mover::cuboid;
use surefoot_world::map::{MapSize, Placed};
use surefoot_world::mesh::{Surface, Triangle};
use surefoot_world::sense::{
    Found, OTHERS_LEN, RAY_COUNT, RAY_SIDE, RayCone, Seen, SenseContext, mirror_observation, observe_found,
};
use surefoot_world::{
    Action, CharacterProfile, Map, NpcSlot, OBSERVATION_LEN, OBSERVATION_WITH_OTHERS_LEN, Player, PlayerContact,
    TaskConfig, Vec3, World, WorldConfig,
};

const SIDE_M: f32 = 60.0;
const SIZE: MapSize = MapSize { width: 60, depth: 60, height: 20 };
const EYE: Vec3 = Vec3::new(30.0, 1.0, 20.0);
const GOAL: Vec3 = Vec3::new(30.0, 1.0, 50.0);
/// Values of each described body.
const VALUES: usize = (OTHERS_LEN - RAY_COUNT) / 4;

fn boxed(low: [f32; 3], high: [f32; 3]) -> Vec<Triangle> {
    let corners = cuboid(Vec3::from(low), Vec3::from(high));
    corners.into_iter().filter_map(|corners| Triangle::new(corners, Surface::Ground)).collect()
}

/// A floor, and a wall 8 m ahead and to the left of an NPC that stands at [`EYE`] and looks along z.
fn world(npc_collision: bool) -> World {
    let floor = boxed([0.0, 0.0, 0.0], [SIDE_M, 1.0, SIDE_M]);
    let wall = boxed([31.0, 1.0, 28.0], [45.0, 5.0, 28.5]);
    let map = Map::from_parts(SIZE, [floor, wall].concat(), Placed::default());
    let profiles = vec![CharacterProfile::default()];
    World::with_config(Arc::new(map), WorldConfig { profiles, task: TaskConfig::default(), npc_collision })
}

/// Adds the NPC that looks along z from [`EYE`].
fn looker(world: &mut World) -> NpcSlot {
    let slot = world.spawn(EYE, 0.0);
    world.set_waypoint(slot, GOAL);
    slot
}

/// The part of an NPC's observation about other bodies: the rays, and the described bodies.
fn others(world: &World, slot: NpcSlot) -> (Vec<f32>, Vec<Vec<f32>>) {
    let mut row = vec![f32::NAN; OBSERVATION_WITH_OTHERS_LEN];
    assert!(world.observe(slot, &mut row));
    let (rays, bodies) = row[OBSERVATION_LEN..].split_at(RAY_COUNT);
    (rays.to_vec(), bodies.chunks_exact(VALUES).map(<[f32]>::to_vec).collect())
}

#[test]
fn an_npc_sees_solid_npcs_and_players_where_they_are() {
    let mut world = world(true);
    let slot = looker(&mut world);
    let runner = world.spawn(EYE + Vec3::new(-0.7, 0.0, 6.0), std::f32::consts::FRAC_PI_2);
    world.spawn_player(player(EYE + Vec3::new(-3.0, 0.0, 3.0), PlayerContact::Block));
    world.spawn_player(player(EYE + Vec3::new(0.0, 0.0, 2.0), PlayerContact::Ghost));
    world.decide(runner, Action { forward: 1.0, ..Action::default() });
    (0..3).for_each(|_| world.tick());

    let (rays, bodies) = others(&world, slot);
    let npc = world.npc(runner).unwrap().body;
    // The ray 7 degrees to the right and 5 degrees down meets the runner; the one to the left would meet the ghost.
    let ahead = 4 * RAY_SIDE + 4;
    let distance = (1.0 - rays[ahead]) * 30.0;
    assert!((5.3..6.2).contains(&distance), "{distance} m to the runner");
    assert_eq!(rays[ahead - 1], 0.0, "ghosts are not seen");
    assert!(rays[4 * RAY_SIDE + 6] > 0.85, "the player, at 45 degrees to the right");

    // The player is nearer than the runner. Right is -x for who looks along z.
    let [player, seen] = [&bodies[0], &bodies[1]];
    for (value, metres) in player.iter().zip([3.0, 0.0, 3.0]) {
        assert!((value * 12.0 - metres).abs() < 0.01, "{player:?}");
    }
    assert!((seen[2] * 12.0 - 6.0).abs() < 0.1 && (seen[0] * 12.0 - 0.7).abs() < 0.2, "{seen:?}");
    assert!((seen[3] * 12.0 + npc.velocity.x).abs() < 0.01 && npc.velocity.x > 0.5, "{seen:?} and {npc:?}");
    assert!((seen[6] - (1.0 - npc.feet.distance(EYE) / 12.0)).abs() < 0.01);
    assert!(bodies[2].iter().chain(&bodies[3]).all(|value| *value == 0.0), "there are no more");

    let sight = world.sight(slot);
    assert_eq!(sight.ends[ahead].1, Some(Seen::Body));
    assert!((sight.ends[ahead].0.distance(sight.eye) - distance).abs() < 0.01);
}

#[test]
fn nobody_is_seen_through_a_wall_or_in_a_world_of_ghosts() {
    for (npc_collision, feet) in [(true, Vec3::new(35.0, 1.0, 29.5)), (false, EYE + Vec3::new(0.0, 0.0, 4.0))] {
        let mut world = world(npc_collision);
        let slot = looker(&mut world);
        world.spawn(feet, 0.0);
        let (rays, bodies) = others(&world, slot);
        assert!(rays.iter().chain(bodies.iter().flatten()).all(|value| *value == 0.0), "{rays:?} {bodies:?}");
        assert!(world.sight(slot).ends.iter().all(|(_, seen)| *seen != Some(Seen::Body)));
    }
}

#[test]
fn the_first_part_of_an_observation_knows_no_others() {
    let mut world = world(true);
    let slot = looker(&mut world);
    let mut alone = vec![0.0; OBSERVATION_LEN];
    world.observe(slot, &mut alone);
    world.spawn(EYE + Vec3::new(0.3, 0.0, 3.0), 0.0);
    let mut row = vec![0.0; OBSERVATION_WITH_OTHERS_LEN];
    world.observe(slot, &mut row);
    assert_eq!(row[..OBSERVATION_LEN], alone);
    assert!(row[OBSERVATION_LEN..].iter().any(|value| *value != 0.0));
}

#[test]
fn the_mirror_image_of_an_observation_is_that_of_the_mirrored_place() {
    let seen = |side: f32| {
        let mut world = world(true);
        let slot = looker(&mut world);
        let mover = Player {
            velocity: Vec3::new(side * 2.0, 0.0, 1.0),
            ..player(EYE + Vec3::new(side * 2.0, 0.5, 4.0), PlayerContact::Push)
        };
        world.spawn_player(mover);
        let mut row = vec![0.0; OBSERVATION_WITH_OTHERS_LEN];
        world.observe(slot, &mut row);
        row
    };
    let (left, mut right) = (seen(1.0), seen(-1.0));
    mirror_observation(&mut right);
    for (one, other) in left[OBSERVATION_LEN..].iter().zip(&right[OBSERVATION_LEN..]) {
        assert!((one - other).abs() < 1.0e-4, "{one} and {other}");
    }
}

#[test]
fn a_body_of_another_world_sees_the_same_from_what_its_rays_found() {
    let mut world = world(true);
    let slot = looker(&mut world);
    for (x, z, yaw) in [(-0.7, 6.0, 0.4), (0.6, 3.0, 1.0), (2.0, 5.0, 2.0), (-3.0, 4.0, 0.0), (-2.0, 8.0, 0.0)] {
        let other = world.spawn(EYE + Vec3::new(x, 0.0, z), yaw);
        world.decide(other, Action { forward: 1.0, ..Action::default() });
    }
    (0..4).for_each(|_| world.tick());
    let mut expected = vec![0.0; OBSERVATION_WITH_OTHERS_LEN];
    world.observe(slot, &mut expected);

    let npc = world.npc(slot).unwrap();
    let profile = world.profile_of(npc);
    let mut hits = [None; RAY_COUNT];
    RayCone::default().cast(world.map(), profile, &npc.body, |idx, distance, surface| {
        hits[idx] = Some((distance, surface));
    });
    let body_hits: [f32; RAY_COUNT] = std::array::from_fn(|idx| match expected[OBSERVATION_LEN + idx] {
        0.0 => f32::INFINITY,
        proximity => (1.0 - proximity) * 30.0,
    });
    // All others are in sight, and the farthest is not among the four that are described.
    let others: Vec<(Vec3, Vec3)> = world
        .npcs()
        .filter(|(other, _)| *other != slot)
        .map(|(_, other)| (other.body.feet, other.body.velocity))
        .collect();
    let mut row = vec![f32::NAN; OBSERVATION_WITH_OTHERS_LEN];
    let context = SenseContext { placed: world.map().placed(), profile, task: world.task() };
    let found = Found { hits: &hits, body_hits: &body_hits, others: &others };
    observe_found(context, found, (&npc.body, &npc.episode.unwrap(), &npc.last), &mut row);
    let bodies = OBSERVATION_LEN..OBSERVATION_LEN + RAY_COUNT;
    assert_eq!(row[..bodies.start], expected[..bodies.start]);
    assert_eq!(row[bodies.end..], expected[bodies.end..]);
    assert!(expected[bodies.end + 6..].iter().step_by(VALUES).all(|proximity| *proximity > 0.0), "four are described");
    for (one, other) in row[bodies.clone()].iter().zip(&expected[bodies]) {
        assert!((one - other).abs() < 1.0e-6, "{one} instead of {other}");
    }
}
