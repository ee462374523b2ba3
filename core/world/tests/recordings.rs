//! Recordings with a correct checksum that cannot have happened are rejected, and are never replayed for hours.

use std::sync::Arc;
use surefoot_world::character::Ride;
use surefoot_world::map::{MapSize, Piece, Placed};
use surefoot_world::mesh::{Surface, Triangle};
use surefoot_world::replay::{Input, REPLAY_VERSION, Recording, ReplayError};
use surefoot_world::{
    Action, Arrival, CharacterProfile, Map, MapSpec, MoverState, Npc, NpcSlot, Player, ProfileIdx, RawCharacterProfile,
    TaskConfig, Tick, Vec3, World,
};

fn floor() -> Arc<Map> {
    let corners = [Vec3::Y, Vec3::new(0.0, 1.0, 20.0), Vec3::new(20.0, 1.0, 20.0)];
    let triangles = Triangle::new(corners, Surface::Ground).into_iter().collect();
    Arc::new(Map::from_parts(MapSize { width: 20, height: 10, depth: 20 }, triangles, Placed::default()))
}

/// Makes the parts of a recording impossible; receives a place on the map.
type Corrupt = fn(&mut Parts, Vec3);

/// The fields of a recording's file, for tests to corrupt before the file is sealed.
struct Parts {
    profiles: Vec<RawCharacterProfile>,
    task: TaskConfig,
    start_tick: u64,
    npcs: Vec<Option<Npc>>,
    inputs: Vec<(u64, Input)>,
    checks: Vec<(u64, u64, [u8; 32])>,
    end_tick: u64,
}

impl Parts {
    /// A recording of one NPC that stands still for ten ticks.
    fn new(map: &Arc<Map>) -> Self {
        let mut world = World::new(map.clone(), CharacterProfile::default(), TaskConfig::default());
        let slot = world.spawn(Vec3::new(5.0, 1.0, 15.0), 0.0);
        world.set_waypoint(slot, Vec3::new(9.0, 1.0, 15.0));
        let npcs = vec![world.npc(slot).copied()];
        world.tick_decision();
        Self {
            profiles: vec![RawCharacterProfile::default()],
            task: TaskConfig::default(),
            start_tick: 0,
            npcs,
            inputs: Vec::new(),
            checks: vec![(10, 0, world.save().hash())],
            end_tick: 10,
        }
    }

    fn npc(&mut self) -> &mut Npc {
        self.npcs[0].as_mut().expect("it was spawned")
    }

    fn replay(&self, map: &Arc<Map>) -> Result<(), ReplayError> {
        let none: (Vec<MoverState>, Vec<Option<Player>>) = Default::default();
        let state = (self.start_tick, &self.npcs, &none);
        let config = (&self.profiles, &self.task, true);
        let pieces: Vec<Piece> = Vec::new();
        let content = (map.hash(), pieces, None::<MapSpec>, config, state, &self.inputs, &self.checks, self.end_tick);
        let content = postcard::to_stdvec(&content).expect("plain data");
        let mut bytes = [&b"SFREPLAY"[..], &REPLAY_VERSION.to_le_bytes()].concat();
        bytes.extend(blake3::hash(&content).as_bytes());
        bytes.extend(content);
        Recording::decode(&bytes)?.replay(map.clone(), None).map(|_| ())
    }
}

#[test]
fn what_cannot_have_happened_is_refused() {
    let map = floor();
    assert_eq!(Parts::new(&map).replay(&map), Ok(()));
    let at = Vec3::new(10.0, 1.0, 10.0);
    let cases: [(&str, Corrupt); 23] = [
        ("character profile", |parts, _| parts.profiles.clear()),
        ("character profile", |parts, _| parts.profiles[0].forward_speed = f32::INFINITY),
        ("character profile", |parts, _| parts.profiles = vec![RawCharacterProfile::default(); 257]),
        ("character profile", |parts, _| parts.profiles[0].coyote_ticks = 255),
        ("constant of its task", |parts, _| parts.task.patience = 0),
        ("constant of its task", |parts, _| parts.task.lambda = 0.0),
        ("constant of its task", |parts, _| parts.task.goal_radius = f32::NAN),
        ("initial state", |parts, _| parts.npc().profile = ProfileIdx(1)),
        ("initial state", |parts, _| parts.npc().body.feet.x = f32::NAN),
        ("initial state", |parts, _| parts.npc().body.feet.x = 1.0e30),
        // A body moves in steps of 22 cm.
        ("initial state", |parts, _| parts.npc().body.velocity.z = 1.0e30),
        ("initial state", |parts, _| parts.npc().last.ticks_in_water = u32::MAX),
        ("initial state", |parts, _| {
            parts.npc().episode.iter_mut().for_each(|episode| episode.decisions = u32::MAX);
        }),
        ("zip lines or movers that the map does not have", |parts, _| {
            parts.npc().body.ride = Some(Ride { line_idx: 0, distance: 0.0 });
        }),
        ("profile that does not exist", |parts, at| parts.inputs.push((3, Input::Spawn(ProfileIdx(1), at, 0.0)))),
        ("teleport for NPC 7", |parts, at| parts.inputs.push((3, Input::Teleport(NpcSlot(7), at, 0.0)))),
        ("a profile changes that NPCs have", |parts, _| {
            parts.inputs.push((3, Input::Reprofile(ProfileIdx(0), Box::default())));
        }),
        ("a profile changes that NPCs have", |parts, _| {
            parts.inputs.push((3, Input::Reprofile(ProfileIdx(1), Box::default())));
        }),
        ("not in order", |parts, _| parts.start_tick = 11),
        ("not in order", |parts, at| {
            parts.inputs = [5, 4].map(|tick| (tick, Input::HeadFor(NpcSlot(0), at, Arrival::Touch))).to_vec();
        }),
        ("not in order", |parts, _| parts.inputs.push((11, Input::ClearWaypoint(NpcSlot(0))))),
        ("too few state hashes", |parts, _| parts.end_tick = u64::MAX),
        ("too few state hashes", |parts, _| parts.checks.clear()),
    ];
    for (expected, corrupt) in cases {
        let mut parts = Parts::new(&map);
        corrupt(&mut parts, at);
        let error = parts.replay(&map).expect_err(expected).to_string();
        assert!(error.contains(expected), "`{error}` does not say `{expected}`");
    }
}

#[test]
fn a_state_that_is_never_compared_is_a_difference() {
    let map = floor();
    let mut parts = Parts::new(&map);
    // The check claims to come after one input, but there is none.
    parts.checks[0].1 = 1;
    assert_eq!(parts.replay(&map), Err(ReplayError::Diverged { tick: Tick(10), agreed: Tick(0) }));
    let mut parts = Parts::new(&map);
    let state = parts.checks[0];
    parts.checks.push(state);
    assert_eq!(parts.replay(&map), Ok(()), "the same state twice is still that state");
    parts.checks[1].2 = [0; 32];
    assert_eq!(parts.replay(&map), Err(ReplayError::Diverged { tick: Tick(10), agreed: Tick(10) }));
}

#[test]
fn an_npc_that_gave_up_far_outside_the_map_does_not_stop_a_replay() {
    let map = floor();
    let mut parts = Parts::new(&map);
    let far = Vec3::new(3.0e38, 1.0, -3.0e38);
    // The attempt ends before its first tick, so nothing notices that the NPC left the map.
    parts.inputs =
        vec![(0, Input::Spawn(ProfileIdx(0), far, 0.0)), (0, Input::HeadFor(NpcSlot(1), Vec3::ONE, Arrival::Touch))];
    parts.inputs.extend((0..TaskConfig::default().patience).map(|_| (0, Input::Close(NpcSlot(1)))));
    parts.inputs.push((0, Input::Decide(NpcSlot(1), Action::default())));
    parts.checks[0].1 = parts.inputs.len() as u64;
    assert!(matches!(parts.replay(&map), Err(ReplayError::Diverged { .. })), "it ran to the end");
}

#[test]
fn a_despawn_of_an_empty_slot_changes_nothing_and_can_be_replayed() {
    let map = floor();
    let mut world = World::new(map.clone(), CharacterProfile::default(), TaskConfig::default());
    let slot = world.spawn(Vec3::new(5.0, 1.0, 15.0), 0.0);
    world.start_recording();
    assert!(world.despawn(slot));
    assert!(!world.despawn(slot) && !world.despawn(NpcSlot(7)) && !world.despawn(NpcSlot(u32::MAX)));
    (0..5).for_each(|_| world.tick());
    let recording = world.finish_recording().unwrap();
    assert_eq!(recording.input_count(), 1, "a call that removes nothing is no input");
    assert_eq!(recording.replay(map.clone(), Some(Tick(2))).unwrap().hash(), world.save().hash());

    // Older recordings hold such calls.
    let mut parts = Parts::new(&map);
    parts.inputs = [7, u32::MAX].map(|slot| (0, Input::Despawn(NpcSlot(slot)))).to_vec();
    parts.checks[0].1 = 2;
    assert_eq!(parts.replay(&map), Ok(()));
}

#[test]
fn profiles_that_no_npc_has_make_room_and_the_run_can_be_repeated() {
    let map = floor();
    let body = |height: f32| CharacterProfile::default().with(|it| it.height = height).unwrap();
    let mut world = World::new(map.clone(), body(1.8), TaskConfig::default());
    world.start_recording();
    let at = Vec3::new(5.0, 1.0, 15.0);
    let spawn = |world: &mut World, height: f32| {
        let profile = world.profile_idx(&body(height), 3).unwrap();
        world.spawn_as(profile, at, 0.0)
    };
    let (one, other) = (spawn(&mut world, 1.0), spawn(&mut world, 2.0));
    assert_eq!(world.profile_idx(&body(3.0), 3), None, "all have NPCs, or are the world's first");
    world.despawn(one);
    let third = spawn(&mut world, 3.0);
    assert_eq!(world.profile_idx(&body(1.0), 3), None);
    assert_eq!(world.config().profiles, [body(1.8), body(3.0), body(2.0)]);
    for (slot, height) in [(third, 3.0), (other, 2.0)] {
        assert_eq!(world.profile_of(world.npc(slot).unwrap()), &body(height));
    }
    for slot in [third, other] {
        world.set_waypoint(slot, Vec3::new(1.0, 1.0, 18.0));
        world.decide(slot, Action { forward: 1.0, ..Action::default() });
    }
    (0..30).for_each(|_| world.tick());
    let recording = Recording::decode(&world.finish_recording().unwrap().encode()).unwrap();
    assert_eq!(recording.replay(map, Some(Tick(7))).unwrap().hash(), world.save().hash());
}
