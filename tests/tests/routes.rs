//! Routes as game clients see them: NPCs that patrol, hold a place and wander by themselves.

use e2e::stage::{Services, Stage, level, start_planning_worker, world_of};
use e2e::{LIMIT, distance, spawn, start_planner, start_server, watch_until, world_client};
use std::collections::BTreeMap;
use surefoot_planner_service::PlannerConfig;
use surefoot_proto::world::v1 as wire;
use surefoot_proto::world::v1::npc_event::Event;
use surefoot_proto::world::v1::route::Kind;
use surefoot_proto::world::v1::wander::Area;
use surefoot_server::ServerConfig;
use tokio_stream::StreamExt;
use tonic::Streaming;

/// Ticks of a second.
const SECOND: u64 = 60;
/// Rest at the stops of [`patrol`], s.
const DWELL_S: f32 = 1.5;

/// A floor of 40 x 30 m with a tower that no NPC climbs.
fn yard() -> Vec<u8> {
    level(&[("floor", [0.0, -1.0, 0.0], [40.0, 0.0, 30.0]), ("tower", [32.0, 0.0, 22.0], [36.0, 16.0, 26.0])])
}

/// Starts the services, with a world of the yard.
async fn begin(mode: wire::TimeMode) -> (Stage, Services) {
    let services = Services::start();
    (world_of(&services.server, yard(), mode).await, services)
}

fn patrol(stage: &Stage, stops: &[[f32; 3]], back_and_forth: bool) -> Kind {
    let stop = |at: &[f32; 3]| wire::PatrolStop {
        position: Some(stage.at(*at)),
        dwell_s: DWELL_S,
        radius: 1.0,
        facing: Some(1.0),
    };
    Kind::Patrol(wire::Patrol { stops: stops.iter().map(stop).collect(), back_and_forth })
}

fn circle(centre: wire::Vec3, radius: f32) -> Kind {
    let area = Area::Circle(wire::WanderCircle { centre: Some(centre), radius });
    Kind::Wander(wire::Wander { area: Some(area), dwell_s: 0.0 })
}

async fn set_routes(stage: &mut Stage, routes: &[(u64, Kind)]) -> Vec<wire::ItemResult> {
    let route = |(npc_id, kind): &(u64, Kind)| wire::NpcRoute {
        npc_id: *npc_id,
        route: Some(wire::Route { kind: Some(kind.clone()) }),
        ..Default::default()
    };
    let request = wire::SetRoutesRequest { routes: routes.iter().map(route).collect() };
    stage.client.set_routes(request).await.unwrap().into_inner().results
}

/// The routes of NPCs.
async fn get_routes(stage: &mut Stage, npcs: &[u64]) -> Vec<Option<Kind>> {
    let request = wire::GetRoutesRequest { npc_ids: npcs.to_vec(), ..Default::default() };
    let results = stage.client.get_routes(request).await.unwrap().into_inner().results;
    let kind = |result: wire::GetRouteResult| match result.result {
        Some(wire::get_route_result::Result::Route(route)) => route.kind,
        other => panic!("{other:?}"),
    };
    results.into_iter().map(kind).collect()
}

/// Sets routes that are valid.
async fn send(stage: &mut Stage, routes: &[(u64, Kind)]) {
    assert!(set_routes(stage, routes).await.iter().all(|result| result.error.is_none()));
}

async fn npc(stage: &mut Stage, npc_id: u64) -> wire::Npc {
    let request = wire::GetNpcRequest { npc_id, ..Default::default() };
    stage.client.get_npc(request).await.unwrap().into_inner().npc.unwrap()
}

/// The events of a world from now on.
struct Events(Streaming<wire::WatchEventsResponse>);

impl Events {
    async fn of(stage: &mut Stage) -> Self {
        let request = wire::WatchEventsRequest { world_id: stage.world_id, ..Default::default() };
        Self(stage.client.watch_events(request).await.unwrap().into_inner())
    }

    /// Reads events until `is_last` accepts one: the tick, the NPC and the event of each.
    async fn until(&mut self, mut is_last: impl FnMut(u64, &Event) -> bool) -> Vec<(u64, u64, Event)> {
        let mut read = Vec::new();
        let reading = async {
            loop {
                let message = self.0.next().await.expect("an endless stream").unwrap();
                let tick = message.tick;
                let events = message.events.into_iter().filter_map(|it| Some((tick, it.npc_id, it.event?)));
                let events: Vec<_> = events.collect();
                let is_done = events.iter().any(|(_, npc, event)| is_last(*npc, event));
                read.extend(events);
                if is_done {
                    return;
                }
            }
        };
        tokio::time::timeout(LIMIT, reading).await.expect("in time");
        read
    }

    /// Reads the next stops of each NPC, until all have reached so many.
    async fn stops(&mut self, npcs: &[u64], count: usize) -> Vec<Vec<u32>> {
        let mut stops: BTreeMap<u64, Vec<u32>> = npcs.iter().map(|npc| (*npc, Vec::new())).collect();
        let note = |npc, event: &Event| {
            if let (Event::StopReached(reached), Some(stops)) = (event, stops.get_mut(&npc)) {
                stops.push(reached.stop);
            }
            stops.values().all(|stops| stops.len() >= count)
        };
        self.until(note).await;
        npcs.iter().map(|npc| stops[npc][..count].to_vec()).collect()
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn patrols_go_around_or_back_and_forth_rest_at_stops_and_turn_there() {
    let (mut stage, services) = begin(wire::TimeMode::Lockstep).await;
    let start = stage.at([15.0, 0.0, 10.0]);
    let npcs = [spawn(&mut stage.client, stage.world_id, start).await, {
        let start = stage.at([12.0, 0.0, 12.0]);
        spawn(&mut stage.client, stage.world_id, start).await
    }];
    let stops = [[5.0, 0.0, 5.0], [25.0, 0.0, 5.0], [15.0, 0.0, 20.0]];
    let mut events = Events::of(&mut stage).await;
    let routes = [(npcs[0], patrol(&stage, &stops, false)), (npcs[1], patrol(&stage, &stops, true))];
    send(&mut stage, &routes).await;
    let reached = events.stops(&npcs, 7).await;
    assert_eq!(reached, [[0, 1, 2, 0, 1, 2, 0], [0, 1, 2, 1, 0, 1, 2]]);
    let rests = |snapshot: &wire::WatchWorldResponse| {
        let npc = &snapshot.npcs[0];
        let stop = stage.at(stops[(npc.route_stop as usize + 2) % 3]);
        npc.standing() == wire::Standing::Rests
            && npc.route() == wire::RouteKind::Patrol
            && npc.status() == wire::NpcStatus::Idle
            && distance(npc.position.unwrap(), stop) <= 1.0
            && (npc.yaw - 1.0).abs() < 0.01
    };
    watch_until(&mut stage.client.clone(), stage.world_id, rests).await;

    // Events of one NPC from one stop to the next.
    let is_stop = |npc: u64, event: &Event| npc == npcs[0] && matches!(event, Event::StopReached(_));
    events.until(is_stop).await;
    let leg = events.until(is_stop).await;
    let mine = || leg.iter().filter(|(_, npc, _)| *npc == npcs[0]);
    let began = mine().find_map(|(tick, _, event)| matches!(event, Event::AttemptBegan(_)).then_some(*tick));
    let (ended, outcome) = mine()
        .find_map(
            |(tick, _, event)| if let Event::AttemptEnded(it) = event { Some((*tick, it.outcome())) } else { None },
        )
        .unwrap();
    assert_eq!(outcome, wire::Outcome::Reached);
    let next = events.until(|npc, event| npc == npcs[0] && matches!(event, Event::AttemptBegan(_))).await;
    assert_eq!(next.last().unwrap().0 - ended, (DWELL_S * SECOND as f32) as u64, "it rests");
    assert!(began.is_some_and(|began| began < ended));
    services.stop().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn goals_of_clients_come_first_and_a_stop_that_is_unreachable_is_skipped() {
    let (mut stage, services) = begin(wire::TimeMode::Lockstep).await;
    let start = stage.at([15.0, 0.0, 10.0]);
    let npc_id = spawn(&mut stage.client, stage.world_id, start).await;
    let mut events = Events::of(&mut stage).await;
    let route = patrol(&stage, &[[5.0, 0.0, 5.0], [34.0, 16.0, 24.0], [15.0, 0.0, 20.0]], false);
    send(&mut stage, &[(npc_id, route)]).await;
    let outcome = |event: &Event| if let Event::AttemptEnded(it) = event { Some(it.outcome()) } else { None };
    let read = events.until(|_, event| outcome(event) == Some(wire::Outcome::Unreachable)).await;
    let failed = read.last().unwrap().0;
    let next = events.until(|_, event| matches!(event, Event::AttemptBegan(_))).await.last().unwrap().0;
    assert_eq!(next - failed, 3 * SECOND);
    assert_eq!(events.stops(&[npc_id], 2).await, [[2, 0]]);

    let goal = stage.at([25.0, 0.0, 12.0]);
    let request = wire::SetGoalRequest { npc_id, goal: Some(goal), ..Default::default() };
    let attempt = stage.client.set_goal(request).await.unwrap().into_inner().attempt;
    let is_end = |event: &Event| matches!(event, Event::AttemptEnded(it) if it.attempt == attempt);
    let read = events.until(|_, event| is_end(event)).await;
    let (_, _, Event::AttemptEnded(ended)) = read.last().unwrap() else { unreachable!() };
    assert_eq!(ended.outcome(), wire::Outcome::Reached, "the goal of the client");
    events.stops(&[npc_id], 1).await;

    let cleared = stage.client.clear_goals(wire::ClearGoalsRequest { npc_ids: vec![npc_id] }).await.unwrap();
    assert_eq!(cleared.into_inner().results, [wire::ItemResult { error: None }]);
    let is_over = |event: &Event| matches!(event, Event::RouteSet(it) if it.kind() == wire::RouteKind::Unspecified);
    events.until(|_, event| is_over(event)).await;
    let npc = npc(&mut stage, npc_id).await;
    assert_eq!((npc.route(), npc.status()), (wire::RouteKind::Unspecified, wire::NpcStatus::Idle));

    // Without a route it stays, and turns.
    let request = wire::SetGoalRequest { goal: Some(start), facing: Some(0.5), ..request };
    stage.client.set_goal(request).await.unwrap();
    let has_turned = |snapshot: &wire::WatchWorldResponse| {
        let npc = &snapshot.npcs[0];
        npc.status() == wire::NpcStatus::Idle && (npc.yaw - 0.5).abs() < 0.01
    };
    watch_until(&mut stage.client, stage.world_id, has_turned).await;
    services.stop().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn an_npc_that_holds_its_place_comes_back_when_a_player_has_pushed_it_away() {
    let (mut stage, services) = begin(wire::TimeMode::Realtime).await;
    let (world_id, post) = (stage.world_id, stage.at([15.0, 0.0, 15.0]));
    let npc_id = spawn(&mut stage.client, world_id, post).await;
    send(&mut stage, &[(npc_id, Kind::Hold(wire::Hold { facing: Some(-2.0), ..Default::default() }))]).await;
    let holds = |snapshot: &wire::WatchWorldResponse| {
        snapshot.npcs.first().is_some_and(|npc| {
            let is_there = distance(npc.position.unwrap(), post) <= 0.6 && (npc.yaw + 2.0).abs() < 0.01;
            is_there && npc.standing() == wire::Standing::Holds && npc.route() == wire::RouteKind::Hold
        })
    };
    watch_until(&mut stage.client, world_id, holds).await;

    let contact = wire::PlayerContact::Push.into();
    let beside = |ticks: u64| wire::Vec3 { x: post.x - 2.0 + 0.05 * ticks as f32, ..post };
    let request = wire::SpawnPlayerRequest { world_id, position: Some(beside(0)), contact, ..Default::default() };
    let player_id = stage.client.spawn_player(request).await.unwrap().into_inner().player_id;
    let (mut begun, mut pushed_m) = (None, 0.0);
    while pushed_m <= 1.2 {
        let tick = watch_until(&mut stage.client, world_id, |_| true).await.tick;
        let ticks = tick - *begun.get_or_insert(tick);
        assert!(ticks < 4 * SECOND, "it was pushed by {pushed_m} m");
        let moves = vec![wire::PlayerMove { player_id, position: Some(beside(ticks)), velocity: None }];
        stage.client.move_players(wire::MovePlayersRequest { world_id, moves, ..Default::default() }).await.unwrap();
        pushed_m = distance(npc(&mut stage, npc_id).await.position.unwrap(), post).max(pushed_m);
    }
    stage.client.remove_player(wire::RemovePlayerRequest { world_id, player_id }).await.unwrap();
    watch_until(&mut stage.client, world_id, holds).await;
    services.stop().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn npcs_wander_within_their_zone_or_circle() {
    let (mut stage, services) = begin(wire::TimeMode::Lockstep).await;
    let (low, high) = (stage.at([3.0, -1.0, 3.0]), stage.at([15.0, 3.0, 12.0]));
    let shape = wire::zone::Shape::Box(wire::ZoneBox { low: Some(low), high: Some(high) });
    let rule = Some(wire::zone::Rule::Price(0.01));
    let zone = wire::Zone { name: "park".to_owned(), shape: Some(shape), rule, for_tags: Vec::new() };
    let put = wire::SetZonesRequest { world_id: stage.world_id, put: vec![zone], ..Default::default() };
    stage.client.set_zones(put.clone()).await.unwrap();
    // Around the tower, on which nothing of the circle lies.
    let centre = stage.at([34.0, 0.0, 18.0]);
    let start = stage.at([9.0, 0.0, 8.0]);
    let npcs = [spawn(&mut stage.client, stage.world_id, start).await, {
        let start = stage.at([30.0, 0.0, 15.0]);
        spawn(&mut stage.client, stage.world_id, start).await
    }];
    let mut events = Events::of(&mut stage).await;
    let park = Kind::Wander(wire::Wander { area: Some(Area::Zone("park".to_owned())), dwell_s: 0.5 });
    send(&mut stage, &[(npcs[0], park), (npcs[1], circle(centre, 6.0))]).await;
    let mut reached = [Vec::new(), Vec::new()];
    let note = |npc: u64, event: &Event| {
        if let Event::AttemptEnded(ended) = event
            && ended.outcome() == wire::Outcome::Reached
        {
            reached[usize::from(npc == npcs[1])].push(ended.goal.unwrap());
        }
        reached.iter().all(|places| places.len() >= 6)
    };
    events.until(note).await;
    let is_in_park = |place: &wire::Vec3| (low.x..=high.x).contains(&place.x) && (low.z..=high.z).contains(&place.z);
    assert!(reached[0].iter().all(is_in_park), "{:?}", reached[0]);
    assert!(reached[1].iter().all(|place| distance(*place, centre) <= 6.1), "{:?}", reached[1]);
    for places in &reached {
        let is_new = |idx: usize| places[..idx].iter().all(|other| distance(places[idx], *other) > 0.5);
        assert!((0..places.len()).filter(|&idx| is_new(idx)).count() >= 3, "{places:?}");
    }

    let remove = wire::SetZonesRequest { put: Vec::new(), remove: vec!["park".to_owned()], ..put.clone() };
    stage.client.set_zones(remove).await.unwrap();
    let lacks_place = |snapshot: &wire::WatchWorldResponse| snapshot.npcs[0].standing() == wire::Standing::NoPlace;
    watch_until(&mut stage.client, stage.world_id, lacks_place).await;
    stage.client.set_zones(put).await.unwrap();
    let begins = |npc: u64, event: &Event| npc == npcs[0] && matches!(event, Event::AttemptBegan(_));
    events.until(begins).await;
    services.stop().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn routes_survive_a_restart_and_patrols_go_on_to_their_next_stop() {
    let (cache, state) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
    let config = || ServerConfig { state: Some(state.path().to_owned()), ..ServerConfig::default() };
    let server = start_server(config());
    let planner = start_planner(cache.path(), PlannerConfig::default());
    let worker = start_planning_worker(&server, &planner);
    let mut stage = world_of(&server, yard(), wire::TimeMode::Lockstep).await;
    let mut npcs = Vec::new();
    for place in [[15.0, 0.0, 10.0], [10.0, 0.0, 10.0], [25.0, 0.0, 10.0]] {
        let place = stage.at(place);
        npcs.push(spawn(&mut stage.client, stage.world_id, place).await);
    }
    let mut events = Events::of(&mut stage).await;
    let around = circle(stage.at([25.0, 0.0, 10.0]), 5.0);
    let stops = [[5.0, 0.0, 5.0], [25.0, 0.0, 5.0], [15.0, 0.0, 20.0]];
    let routes =
        [(npcs[0], patrol(&stage, &stops, false)), (npcs[1], Kind::Hold(wire::Hold::default())), (npcs[2], around)];
    send(&mut stage, &routes).await;
    assert_eq!(events.stops(&npcs[..1], 2).await, [[0, 1]]);
    let former = get_routes(&mut stage, &npcs).await;
    assert_eq!(former[0], Some(routes[0].1.clone()), "as it was set");
    worker.stop().await;
    server.stop().await;

    let server = start_server(config());
    stage.client = world_client(&server).await;
    assert_eq!(get_routes(&mut stage, &npcs).await, former);
    let mut kinds = Vec::new();
    for npc_id in &npcs {
        kinds.push(npc(&mut stage, *npc_id).await.route());
    }
    assert_eq!(kinds, [wire::RouteKind::Patrol, wire::RouteKind::Hold, wire::RouteKind::Wander]);
    let next = npc(&mut stage, npcs[0]).await.route_stop;
    let mut events = Events::of(&mut stage).await;
    let worker = start_planning_worker(&server, &planner);
    assert_eq!(events.stops(&npcs[..1], 3).await, [[next, (next + 1) % 3, (next + 2) % 3]]);
    worker.stop().await;
    planner.stop().await;
    server.stop().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn a_route_that_is_not_valid_is_refused_by_name_and_others_of_the_batch_apply() {
    let server = start_server(ServerConfig::default());
    let mut stage = world_of(&server, yard(), wire::TimeMode::Realtime).await;
    let here = stage.at([15.0, 0.0, 15.0]);
    let npc_id = spawn(&mut stage.client, stage.world_id, here).await;
    let other = spawn(&mut stage.client, stage.world_id, here).await;
    let stops = |change: &dyn Fn(&mut wire::PatrolStop)| {
        let good = wire::PatrolStop { position: Some(here), ..Default::default() };
        let mut bad = good;
        change(&mut bad);
        Kind::Patrol(wire::Patrol { stops: vec![good, bad], back_and_forth: false })
    };
    let one = Kind::Patrol(wire::Patrol { stops: vec![wire::PatrolStop::default()], back_and_forth: false });
    let hold = |hold: wire::Hold| Kind::Hold(hold);
    let in_air = stage.at([20.0, 9.0, 15.0]);
    let in_tower = stage.at([34.0, 4.0, 24.0]);
    let zone = |name: &str| Kind::Wander(wire::Wander { area: Some(Area::Zone(name.to_owned())), dwell_s: 0.0 });
    let cases = [
        (one, "INVALID_FIELD", "patrol.stops is 1"),
        (stops(&|stop| stop.dwell_s = 4000.0), "INVALID_FIELD", "patrol.stops.dwell_s"),
        (stops(&|stop| stop.dwell_s = f32::NAN), "INVALID_FIELD", "patrol.stops.dwell_s"),
        (stops(&|stop| stop.position = None), "INVALID_FIELD", "patrol.stops.position is missing"),
        (
            stops(&|stop| stop.position = Some(wire::Vec3 { x: -5.0, ..here })),
            "INVALID_FIELD",
            "patrol.stops[1].position",
        ),
        (stops(&|stop| stop.position = Some(in_air)), "GOAL_IN_AIR", "patrol.stops[1].position"),
        (stops(&|stop| stop.position = Some(in_tower)), "GOAL_IN_SOLID", "patrol.stops[1].position"),
        (flee(9, 1.0, false), "INVALID_FIELD", "flee.distance"),
        (flee(9, 8.0, false), "PLAYER_NOT_FOUND", "9"),
        (hold(wire::Hold { radius: 0.2, ..Default::default() }), "INVALID_FIELD", "hold.radius"),
        (hold(wire::Hold { facing: Some(f32::NAN), ..Default::default() }), "INVALID_FIELD", "hold.facing"),
        (circle(here, 0.0), "INVALID_FIELD", "wander.circle.radius"),
        (Kind::Wander(wire::Wander::default()), "INVALID_FIELD", "wander.area"),
        (zone("nowhere"), "ZONE_NOT_FOUND", "nowhere"),
    ];
    let mut routes: Vec<(u64, Kind)> = cases.iter().map(|(kind, ..)| (npc_id, kind.clone())).collect();
    routes.push((1, hold(wire::Hold::default())));
    routes.push((other, hold(wire::Hold::default())));
    let results = set_routes(&mut stage, &routes).await;
    for (result, (_, reason, says)) in results.iter().zip(&cases) {
        let error = result.error.as_ref().unwrap_or_else(|| panic!("{says} is refused"));
        assert_eq!(error.reason, *reason, "{}", error.message);
        assert!(error.message.contains(says), "{}", error.message);
    }
    assert_eq!(results[cases.len()].error.as_ref().unwrap().reason, "NPC_NOT_FOUND");
    assert_eq!(results[cases.len() + 1], wire::ItemResult { error: None });
    let routes = [npc(&mut stage, npc_id).await.route(), npc(&mut stage, other).await.route()];
    assert_eq!(routes, [wire::RouteKind::Unspecified, wire::RouteKind::Hold]);
    server.stop().await;
}

fn flee(player_id: u32, distance: f32, hide: bool) -> Kind {
    Kind::Flee(wire::Flee { from: Some(wire::flee::From::FromPlayerId(player_id)), distance, hide })
}

#[tokio::test(flavor = "multi_thread")]
async fn an_npc_flees_from_a_player_that_walks_after_it() {
    let (mut stage, services) = begin(wire::TimeMode::Realtime).await;
    let (world_id, start) = (stage.world_id, stage.at([12.0, 0.0, 15.0]));
    let mut player = stage.at([6.0, 0.0, 15.0]);
    let npc_id = spawn(&mut stage.client, world_id, start).await;
    let request = wire::SpawnPlayerRequest { world_id, position: Some(player), ..Default::default() };
    let player_id = stage.client.spawn_player(request).await.unwrap().into_inner().player_id;
    send(&mut stage, &[(npc_id, flee(player_id, 8.0, false))]).await;
    let is_away = |snapshot: &wire::WatchWorldResponse| {
        snapshot.npcs.iter().all(|npc| distance(npc.position.unwrap(), player) >= 8.0)
    };
    watch_until(&mut stage.client, world_id, is_away).await;

    let mut snapshots = e2e::watch(&mut stage.client, world_id, 20.0).await;
    let mut gaps = Vec::new();
    for _ in 0..300 {
        let snapshot = snapshots.next().await.expect("an endless stream").unwrap();
        let npc = snapshot.npcs[0].position.unwrap();
        let gap = distance(npc, player);
        let step = 3.0 / 20.0 / gap.max(0.1);
        player =
            wire::Vec3 { x: player.x + step * (npc.x - player.x), z: player.z + step * (npc.z - player.z), ..player };
        let moves = vec![wire::PlayerMove { player_id, position: Some(player), ..Default::default() }];
        stage.client.move_players(wire::MovePlayersRequest { world_id, moves, ..Default::default() }).await.unwrap();
        gaps.push(gap);
    }
    let kept = gaps.iter().filter(|gap| **gap >= 2.0).count();
    assert!(10 * kept >= 9 * gaps.len(), "{kept} of {}: {gaps:.1?}", gaps.len());
    let npc = npc(&mut stage, npc_id).await;
    assert_eq!(npc.route(), wire::RouteKind::Flee);
    assert_ne!(npc.status(), wire::NpcStatus::Down);
    services.stop().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn an_npc_hides_behind_a_tower() {
    let (mut stage, services) = begin(wire::TimeMode::Realtime).await;
    let (world_id, start, eyes) = (stage.world_id, stage.at([30.0, 0.0, 18.0]), stage.at([28.0, 0.0, 24.0]));
    let [low, high] = [stage.at([32.0, 0.0, 22.0]), stage.at([36.0, 0.0, 26.0])];
    let npc_id = spawn(&mut stage.client, world_id, start).await;
    let from = Some(wire::flee::From::Position(eyes));
    send(&mut stage, &[(npc_id, Kind::Flee(wire::Flee { from, distance: 5.0, hide: true }))]).await;
    // The tower stands between the eyes and the NPC.
    let is_hidden = |snapshot: &wire::WatchWorldResponse| {
        let at = snapshot.npcs[0].position.unwrap();
        let between = |share: f32| (eyes.x + share * (at.x - eyes.x), eyes.z + share * (at.z - eyes.z));
        let is_within = |(x, z): (f32, f32)| (low.x..high.x).contains(&x) && (low.z..high.z).contains(&z);
        (0..100).map(|step| between(step as f32 / 100.0)).any(is_within)
            && snapshot.npcs[0].status() == wire::NpcStatus::Idle
    };
    watch_until(&mut stage.client, world_id, is_hidden).await;
    let npc = npc(&mut stage, npc_id).await;
    assert_eq!(npc.standing(), wire::Standing::Rests);
    services.stop().await;
}
