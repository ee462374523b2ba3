//! NPCs that look at something while they rest, tick by tick, without sockets.

use std::f32::consts::{FRAC_PI_2, PI};
use std::sync::Arc;
use surefoot_server::hosted::{GoalOrder, HostedWorld, NpcError, NpcStatus, Pursuit, Target, TimeMode};
use surefoot_server::ids::{NpcId, WorldId};
use surefoot_server::quota::Quota;
use surefoot_server::registry::Registry;
use surefoot_world::map::{MapSize, Placed};
use surefoot_world::mesh::{Surface, Triangle};
use surefoot_world::{CharacterProfile, Map, Player, PlayerContact, TICKS_PER_SECOND, Vec3};

const CENTRE: Vec3 = Vec3::new(20.0, 1.0, 20.0);
/// The slack of a look and its tolerance, with the rounding of angles, rad.
const SLACK: f32 = 0.36;
const TOLERANCE: f32 = 0.036;

/// A floor of 40 x 40 m with NPCs at the centre and 5 m beside it, which face +z.
fn stage(mode: TimeMode) -> (HostedWorld, [NpcId; 2]) {
    let [a, b, c, d] = [[0.0, 0.0], [0.0, 40.0], [40.0, 40.0], [40.0, 0.0]].map(|[x, z]| Vec3::new(x, 1.0, z));
    let triangles = [[a, b, c], [a, c, d]].into_iter().filter_map(|t| Triangle::new(t, Surface::Ground)).collect();
    let map = Map::from_parts(MapSize { width: 40, height: 10, depth: 40 }, triangles, Placed::default());
    let mut world = HostedWorld::new(WorldId(1), Arc::new(map), mode, Arc::new(Registry::default()));
    let quota = Quota::new(8, "NPCs");
    let mut spawn = |at| world.spawn(at, 0.0, 8, quota.grant("test")).unwrap();
    let npcs = [spawn(CENTRE), spawn(CENTRE + 5.0 * Vec3::X)];
    (0..30).for_each(|_| world.step());
    (world, npcs)
}

fn yaw(world: &HostedWorld, npc: NpcId) -> f32 {
    world.npc(npc).unwrap().yaw
}

/// The angle from one heading to another, rad.
fn between(from: f32, to: f32) -> f32 {
    (to - from + PI).rem_euclid(2.0 * PI) - PI
}

/// A place 10 m from the centre at a heading, rad.
fn towards(heading: f32) -> Vec3 {
    CENTRE + 10.0 * Vec3::new(heading.sin(), 0.0, heading.cos())
}

#[test]
fn a_body_at_rest_turns_at_its_turn_speed_to_what_it_looks_at() {
    let (mut world, [npc, other]) = stage(TimeMode::Realtime);
    world.look_at(npc, Some(Target::Npc(other))).unwrap();
    let in_tick = CharacterProfile::default().turn_speed / TICKS_PER_SECOND as f32;
    let mut ticks = 0;
    while between(yaw(&world, npc), FRAC_PI_2).abs() > TOLERANCE {
        let before = yaw(&world, npc);
        world.step();
        let turned = between(before, yaw(&world, npc));
        assert!(ticks == 0 || turned > 0.0 && turned <= in_tick + 1.0e-5, "{turned} rad in tick {ticks}");
        ticks += 1;
        assert!(ticks < 60, "it turns to the right NPC");
    }
    let feet = world.npc(npc).unwrap().position;
    (0..60).for_each(|_| world.step());
    let now = world.npc(npc).unwrap();
    assert!(now.position.distance(feet) < 1.0e-3 && between(now.yaw, FRAC_PI_2).abs() < TOLERANCE, "{now:?}");
    assert_eq!((now.status, now.looks_at), (NpcStatus::Idle, Some(Target::Npc(other))));
}

#[test]
fn a_body_does_not_twitch_after_a_target_that_moves() {
    let (mut world, [npc, _]) = stage(TimeMode::Realtime);
    let player =
        Player { feet: towards(0.0), velocity: Vec3::ZERO, radius: 0.4, height: 1.8, contact: PlayerContact::Ghost };
    let player = world.spawn_player(player).unwrap();
    world.look_at(npc, Some(Target::Player(player))).unwrap();
    let (mut turns, mut was_turning, mut worst) = (0, false, 0.0f32);
    for tick in 0..1200u16 {
        // To and fro by 15 degrees for ten seconds, then once around in ten seconds.
        let time = f32::from(tick) / 60.0;
        let heading = if tick < 600 { 0.26 * (2.0 * time).sin() } else { (time - 10.0) * 0.2 * PI };
        world.move_players(&[(player, towards(heading), Vec3::ZERO)]).unwrap();
        let before = yaw(&world, npc);
        world.step();
        let is_turning = yaw(&world, npc) != before;
        assert!(tick >= 600 || !is_turning, "it turns after a target that is 15 degrees off");
        turns += u32::from(is_turning && !was_turning);
        was_turning = is_turning;
        worst = worst.max(between(yaw(&world, npc), heading).abs());
    }
    assert!(worst < SLACK + 0.06, "{worst} rad off");
    // Each turn makes up for 18 degrees and for what the target moves in the meantime.
    assert!((12..=20).contains(&turns), "{turns} turns");
}

#[test]
fn targets_that_are_gone_are_forgotten_and_those_that_are_down_are_not() {
    let (mut world, [npc, other]) = stage(TimeMode::Realtime);
    world.look_at(npc, Some(Target::Npc(other))).unwrap();
    world.despawn(other).unwrap();
    world.step();
    assert_eq!(world.npc(npc).unwrap().looks_at, None);

    let player =
        Player { feet: towards(1.0), velocity: Vec3::ZERO, radius: 0.4, height: 1.8, contact: PlayerContact::Ghost };
    let slot = world.spawn_player(player).unwrap();
    world.look_at(npc, Some(Target::Player(slot))).unwrap();
    world.remove_player(slot).unwrap();
    // The next player gets the number of the former one.
    assert_eq!(world.spawn_player(player), Ok(slot));
    assert_eq!(world.npc(npc).unwrap().looks_at, None);

    for (target, error) in
        [(Target::Npc(other), NpcError::Unknown(other)), (Target::Npc(npc), NpcError::OwnTarget(npc))]
    {
        assert_eq!(world.look_at(npc, Some(target)), Err(error));
    }
    assert_eq!(world.look_at(other, None), Err(NpcError::Unknown(other)));
    world.look_at(npc, Some(Target::at(towards(2.0)))).unwrap();
    world.look_at(npc, None).unwrap();
    (0..30).for_each(|_| world.step());
    assert_eq!(yaw(&world, npc), 0.0, "it looks at nothing any more");
}

#[test]
fn the_heading_of_a_goal_comes_first_and_without_one_an_npc_looks_again() {
    let (mut world, [npc, _]) = stage(TimeMode::Realtime);
    world.look_at(npc, Some(Target::at(towards(FRAC_PI_2)))).unwrap();
    let goal =
        |keeps, facing| GoalOrder { goal: Some(CENTRE), pursuit: Pursuit { keeps, facing, ..Pursuit::default() } };
    for (keeps, facing, heading) in
        [(false, Some(-1.0), -1.0), (false, None, FRAC_PI_2), (true, Some(2.5), 2.5), (true, None, FRAC_PI_2)]
    {
        world.set_goal(npc, goal(keeps, facing)).unwrap();
        (0..120).for_each(|_| world.step());
        let seen = yaw(&world, npc);
        assert!(between(seen, heading).abs() < TOLERANCE, "keeps {keeps}, facing {facing:?}: {seen} rad");
        let before = seen;
        (0..60).for_each(|_| world.step());
        assert_eq!(yaw(&world, npc), before, "keeps {keeps}, facing {facing:?}: it stands still");
    }
    // A target that an NPC forgets while it turns leaves no turn behind.
    world.look_at(npc, Some(Target::at(towards(-2.0)))).unwrap();
    (0..5).for_each(|_| world.step());
    world.set_goal(npc, goal(true, None)).unwrap();
    world.look_at(npc, None).unwrap();
    (0..60).for_each(|_| world.step());
    let before = yaw(&world, npc);
    (0..60).for_each(|_| world.step());
    assert_eq!(yaw(&world, npc), before);
}

#[test]
fn a_lockstep_world_goes_on_until_its_npcs_look_at_their_targets() {
    let (mut world, [npc, _]) = stage(TimeMode::Lockstep);
    assert!(!world.is_ready());
    world.look_at(npc, Some(Target::at(towards(FRAC_PI_2)))).unwrap();
    assert!(world.is_ready(), "it has to turn");
    let mut ticks = 0;
    while world.is_ready() {
        world.step();
        ticks += 1;
        assert!(ticks < 120, "it comes to rest");
    }
    assert!(between(yaw(&world, npc), FRAC_PI_2).abs() < TOLERANCE);
}
