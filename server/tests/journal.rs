//! Journals of a world in a fleet, applied to its last save.

use std::path::Path;
use std::sync::Arc;
use surefoot_planner::{Rule, Shape, Tags, Zone};
use surefoot_server::WorldId;
use surefoot_server::hosted::{
    FleetSave, HostedWorld, Journal, NpcStatus, Route, RouteKind, SavedMap, SpawnOrder, Stop, Target, TimeMode,
    ZonesEdit,
};
use surefoot_server::ids::NpcId;
use surefoot_server::quota::Quota;
use surefoot_server::registry::Registry;
use surefoot_world::{CharacterProfile, Gait, MapSpec, NamedGait, Seed, Vec3};

/// A world whose NPCs stand on its ground, and further places there.
fn world() -> (HostedWorld, Arc<Quota>, Vec<Vec3>) {
    let map = Arc::new(surefoot_generate::generate(&MapSpec::with_side(5, 60).expect("an allowed size")));
    let body = CharacterProfile::default();
    let places = HostedWorld::sample_ground(&map, &body, 16, Seed(1)).expect("ground");
    let mut world = HostedWorld::new(WorldId(7), map, TimeMode::Realtime, Arc::new(Registry::default()));
    world.await_confirmation();
    let quota = Quota::new(64, "NPCs");
    for &position in &places[..4] {
        spawn(&mut world, &quota, position, Some(places[9]));
    }
    (world, quota, places)
}

fn spawn(world: &mut HostedWorld, quota: &Arc<Quota>, position: Vec3, goal: Option<Vec3>) -> NpcId {
    let order = SpawnOrder { position, yaw: 0.5, goal, body: None, tags: Default::default(), gait: Gait::default() };
    world.spawn_to(order, 64, quota.grant("game")).expect("there is room")
}

fn kept(world: &HostedWorld) -> FleetSave {
    let source = SavedMap::of(world.map(), String::new());
    let kept = FleetSave { token: 7, world: world.save("game", source), log: world.save_log() };
    let decoded = FleetSave::decode(&kept.encode(), Path::new("kept")).expect("just encoded");
    assert_eq!(decoded, kept);
    decoded
}

fn restored(FleetSave { world: saved, log, .. }: FleetSave, journals: Vec<Journal>, quota: &Arc<Quota>) -> HostedWorld {
    let map = saved.maps().expect("the same map").map;
    let mut world = HostedWorld::restore(&saved, map, Arc::new(Registry::default()), quota);
    world.resume(log, journals, quota);
    world
}

fn journal(world: &HostedWorld) -> Journal {
    let journal = world.unconfirmed().expect("something happened");
    assert_eq!(Journal::decode(journal.through, &journal.encode()).as_ref(), Ok(&journal));
    journal
}

/// NPCs as clients see them, without their positions.
fn known(world: &HostedWorld) -> Vec<(NpcId, NpcStatus, Option<Vec3>, u32, u32)> {
    world.npcs().map(|npc| (npc.id, npc.status, npc.goal, npc.attempts_begun, npc.attempts_ended)).collect()
}

#[test]
fn what_was_recorded_after_the_save_is_known_to_the_next_server() {
    let (mut world, quota, places) = world();
    (0..30).for_each(|_| world.step());
    let ids: Vec<NpcId> = world.npcs().map(|npc| npc.id).collect();
    let saved = kept(&world);
    world.confirm(saved.log.written());
    assert!(world.unconfirmed().is_none(), "the save has it");
    // One gets another goal, one goes, one arrives, one comes.
    world.set_goal(ids[0], places[10]).unwrap();
    world.despawn(ids[1]).unwrap();
    world.teleport(ids[2], places[9], 0.0).unwrap();
    world.set_goal(ids[2], places[9]).unwrap();
    let new = spawn(&mut world, &quota, places[5], Some(places[11]));
    (0..10).for_each(|_| world.step());
    let first = journal(&world);
    world.set_goal(new, places[12]).unwrap();
    // A journal whose answer was lost is sent again, with later changes.
    let second = journal(&world);
    let told = world.events().written();
    let next = restored(saved, vec![first, second], &quota);
    assert_eq!(known(&next), known(&world));
    assert!(known(&next).iter().any(|&(id, status, ..)| id == ids[2] && status == NpcStatus::Idle), "it has arrived");
    assert_eq!(next.history(ids[2]).unwrap().len(), 1);
    assert_eq!(next.counters().ends, world.counters().ends);
    assert_eq!((next.events().latest(), next.events().written()), (told, told));
    assert!(spawn_id(next, &quota, places[5]) > new, "ids are not given again");
}

fn spawn_id(mut world: HostedWorld, quota: &Arc<Quota>, position: Vec3) -> NpcId {
    spawn(&mut world, quota, position, None)
}

#[test]
fn zones_tags_gaits_and_what_npcs_look_at_are_known_to_the_next_server() {
    let (mut world, quota, places) = world();
    let tags = |tag: &str| Tags::from([tag.to_owned()]);
    let shape = Shape::Cylinder { bottom: places[3], radius: 2.0, height: 3.0 };
    let zone = Zone { name: "vault".to_owned(), shape, rule: Rule::OnlyWith("key".to_owned()), concerns: tags("red") };
    world.set_zones(ZonesEdit { put: vec![zone.clone()], ..ZonesEdit::default() }).unwrap();
    let first = world.npcs().next().unwrap().id;
    world.set_tags(first, tags("key")).unwrap();
    let [careful, jog] = ["careful", "jog"].map(|name| NamedGait::find(name).unwrap().gait);
    world.set_gait(first, careful).unwrap();
    world.look_at(first, Some(Target::at(places[6]))).unwrap();
    let saved = kept(&world);
    world.confirm(saved.log.written());
    let order = SpawnOrder { position: places[5], yaw: 0.5, goal: None, body: None, tags: tags("red"), gait: jog };
    let new = world.spawn_to(order, 64, quota.grant("game")).unwrap();
    world.look_at(new, Some(Target::Npc(first))).unwrap();
    let next = restored(saved, vec![journal(&world)], &quota);
    let looks_at = [first, new].map(|npc| next.npc(npc).unwrap().looks_at);
    assert_eq!(looks_at, [Some(Target::at(places[6])), Some(Target::Npc(first))]);
    assert_eq!(next.zones().collect::<Vec<_>>(), [&zone]);
    assert_eq!([first, new].map(|npc| next.tags(npc).unwrap().clone()), [tags("key"), tags("red")]);
    assert_eq!([first, new].map(|npc| next.npc(npc).unwrap().gait), [careful, jog]);
}

#[test]
fn routes_and_how_far_npcs_have_come_are_known_to_the_next_server() {
    let (mut world, quota, places) = world();
    let route = |first: Vec3| {
        let stops = [first, places[9], places[10]].map(|at| Stop { at, dwell: 600, radius: 1.0, facing: None });
        Some(Route::Patrol { stops: stops.to_vec(), back_and_forth: false })
    };
    let ids: Vec<NpcId> = world.npcs().map(|npc| npc.id).collect();
    ids.iter().for_each(|id| world.clear_goal(*id).unwrap());
    world.set_route(ids[0], route(places[0])).unwrap();
    world.set_route(ids[1], route(places[1])).unwrap();
    let saved = kept(&world);
    world.confirm(saved.log.written());
    // Two arrive where they stand, one gets a route, one loses it.
    world.set_route(ids[2], route(places[2])).unwrap();
    (0..30).for_each(|_| world.step());
    world.set_route(ids[1], None).unwrap();
    let next = restored(saved, vec![journal(&world)], &quota);
    let routes = |world: &HostedWorld| world.npcs().map(|npc| (npc.route, npc.route_stop)).collect::<Vec<_>>();
    let patrol = Some(RouteKind::Patrol);
    assert_eq!(routes(&world), [(patrol, 1), (None, 0), (patrol, 1), (None, 0)]);
    assert_eq!(routes(&next), routes(&world));
    assert_eq!(known(&next), known(&world));
}

#[test]
fn readers_see_what_is_confirmed_and_resume_elsewhere_where_they_were() {
    let (mut world, quota, places) = world();
    assert!(world.events().after(0, 100).unwrap().is_empty(), "nothing is confirmed");
    let first = journal(&world);
    world.confirm(first.through);
    let seen = world.events().after(0, 100).unwrap();
    assert_eq!(seen.len(), 8, "four NPCs came, and four attempts began");
    let saved = kept(&world);
    let id = seen[0].npc;
    world.set_goal(id, places[12]).unwrap();
    let second = journal(&world);
    // The server dies after its readers got the first eight events.
    let mut next = restored(saved, vec![second], &quota);
    let more = next.events().after(seen[7].sequence, 100).unwrap();
    assert_eq!(more.iter().map(|event| event.sequence).collect::<Vec<_>>(), [9, 10]);
    assert!(more.iter().all(|event| event.npc == id));
    next.set_goal(id, places[13]).unwrap();
    assert_eq!(next.events().after(10, 100).unwrap(), [], "not confirmed yet");
    next.confirm(12);
    assert_eq!(next.events().after(10, 100).unwrap().len(), 2);
}

#[test]
fn damaged_saves_and_journals_are_refused() {
    let (world, ..) = world();
    let bytes = kept(&world).encode();
    for at in (0..bytes.len()).step_by(97) {
        let mut damaged = bytes.clone();
        damaged[at] ^= 0x10;
        assert!(FleetSave::decode(&damaged, Path::new("kept")).is_err(), "byte {at}");
    }
    let journal = journal(&world);
    assert!(Journal::decode(journal.through - 1, &journal.encode()).is_err(), "events after its number");
    assert!(Journal::decode(journal.through, &journal.encode()[..9]).is_err());
}
