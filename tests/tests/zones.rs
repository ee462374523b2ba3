//! Zones as game clients use them: NPCs and plans pay in them or keep out, from one decision to the next.

use e2e::stage::{Stage, level, start_planning_worker, world_of};
use e2e::{build_graph, planner_client, set_goal, spawn, start_planner, start_server, watch_until, world_client};
use surefoot_planner_service::PlannerConfig;
use surefoot_proto::planner::v1 as plan;
use surefoot_proto::reason::Reason;
use surefoot_proto::world::v1 as wire;
use surefoot_proto::world::v1::zone::{Rule, Shape};
use surefoot_server::ServerConfig;
use tokio_stream::StreamExt;
use tonic::{Code, Status, Streaming};

/// Ticks of one decision.
const DECISION: u64 = 10;

fn boxed(name: &str, low: wire::Vec3, high: wire::Vec3, rule: Rule) -> wire::Zone {
    let shape = Some(Shape::Box(wire::ZoneBox { low: Some(low), high: Some(high) }));
    wire::Zone { name: name.to_owned(), shape, rule: Some(rule), for_tags: Vec::new() }
}

async fn set_zones(stage: &mut Stage, put: Vec<wire::Zone>, remove: &[&str]) -> Result<wire::SetZonesResponse, Status> {
    let remove = remove.iter().map(|&name| name.to_owned()).collect();
    let request = wire::SetZonesRequest { world_id: stage.world_id, put, remove, ..Default::default() };
    stage.client.set_zones(request).await.map(|response| response.into_inner())
}

async fn list_zones(stage: &mut Stage) -> Vec<wire::Zone> {
    let request = wire::ListZonesRequest { world_id: stage.world_id, ..Default::default() };
    stage.client.list_zones(request).await.unwrap().into_inner().zones
}

/// A floor of 80 x 40 m with a wall at 56 m that has two gaps: one on the straight way, one 22 m beside it.
fn two_gaps() -> Vec<u8> {
    level(&[
        ("floor", [0.0, -1.0, 0.0], [80.0, 0.0, 40.0]),
        ("wall_a", [56.0, 0.0, -14.0], [57.0, 9.0, 5.0]),
        ("wall_b", [56.0, 0.0, 11.0], [57.0, 9.0, 27.0]),
        ("wall_c", [56.0, 0.0, 33.0], [57.0, 9.0, 54.0]),
    ])
}

/// The gap on the straight way, with some metres before and behind it.
fn gap(stage: &Stage, rule: Rule) -> wire::Zone {
    boxed("gap", stage.at([53.0, -1.0, 3.0]), stage.at([60.0, 5.0, 13.0]), rule)
}

fn is_in(zone: &wire::Zone, place: wire::Vec3) -> bool {
    let Some(Shape::Box(wire::ZoneBox { low: Some(low), high: Some(high) })) = zone.shape else { panic!("a box") };
    [(low.x, place.x, high.x), (low.y, place.y, high.y), (low.z, place.z, high.z)]
        .iter()
        .all(|(low, at, high)| (low..=high).contains(&at))
}

/// Whether a plan from `from` passes a zone.
fn passes(zone: &wire::Zone, from: wire::Vec3, waypoints: &[wire::Vec3]) -> bool {
    let way: Vec<wire::Vec3> = std::iter::once(from).chain(waypoints.iter().copied()).collect();
    way.windows(2).any(|leg| {
        let at = |share: f32| wire::Vec3 {
            x: leg[0].x + (leg[1].x - leg[0].x) * share,
            y: leg[0].y + (leg[1].y - leg[0].y) * share,
            z: leg[0].z + (leg[1].z - leg[0].z) * share,
        };
        (0..=100).any(|step| is_in(zone, at(step as f32 / 100.0)))
    })
}

/// Sends an NPC from `here` to `there` with the gap open, and returns the number of its attempt once its plan leads
/// through the gap.
async fn set_out(
    stage: &mut Stage,
    steps: &mut Streaming<wire::FollowNpcResponse>,
    (npc_id, here, there): (u64, wire::Vec3, wire::Vec3),
    open: &wire::Zone,
) -> u32 {
    let goal = wire::SetGoalRequest { npc_id, goal: Some(there), ..Default::default() };
    let attempt = stage.client.set_goal(goal).await.unwrap().into_inner().attempt;
    let mut plan = Vec::new();
    while plan.is_empty() {
        let step = steps.next().await.unwrap().unwrap();
        plan = step.plan.map_or(plan, |plan| plan.waypoints);
    }
    assert!(passes(open, here, &plan), "the straight way leads through the gap: {plan:?}");
    attempt
}

/// Closes the gap while the NPC of a lockstep world is on its way to it, and returns the number of its attempt and the
/// tick. Such a world runs as fast as it can: if the NPC may be through the gap before the call arrives, it begins
/// again.
async fn close_ahead(
    stage: &mut Stage,
    (npc_id, here, there): (u64, wire::Vec3, wire::Vec3),
    closed: &wire::Zone,
) -> (u32, u64) {
    for _ in 0..64 {
        let back = wire::TeleportNpcRequest { npc_id, position: Some(here), ..Default::default() };
        stage.client.teleport_npc(back).await.unwrap();
        // The response to any change has the tick.
        let aside = boxed("aside", stage.at([0.0, -1.0, 0.0]), stage.at([1.0, 1.0, 1.0]), Rule::Price(2.0));
        let began = set_zones(stage, vec![aside], &[]).await.unwrap().tick;
        let goal = wire::SetGoalRequest { npc_id, goal: Some(there), ..Default::default() };
        let attempt = stage.client.set_goal(goal).await.unwrap().into_inner().attempt;
        let set = set_zones(stage, vec![closed.clone()], &[]).await.unwrap();
        assert_eq!(set.zone_count, 2);
        // 49 m at 11 m/s take 267 ticks.
        if set.tick - began <= 200 {
            return (attempt, set.tick);
        }
        set_zones(stage, Vec::new(), &["gap"]).await.unwrap();
    }
    panic!("the gap was never closed in time");
}

async fn a_zone_closes_the_route(mode: wire::TimeMode) {
    let cache = tempfile::tempdir().unwrap();
    let server = start_server(ServerConfig::default());
    let planner = start_planner(cache.path(), PlannerConfig::default());
    let worker = start_planning_worker(&server, &planner);
    let mut stage = world_of(&server, two_gaps(), mode).await;
    let (here, there) = (stage.at([4.0, 0.0, 8.0]), stage.at([76.0, 0.0, 8.0]));
    let npc_id = spawn(&mut stage.client, stage.world_id, here).await;
    let follow = wire::FollowNpcRequest { npc_id, rate_hz: 60.0, rays: false, ..Default::default() };
    let mut steps = stage.client.follow_npc(follow).await.unwrap().into_inner();
    let closed = gap(&stage, Rule::Never(true));
    let way = (npc_id, here, there);
    let (attempt, set_tick) = if mode == wire::TimeMode::Lockstep {
        close_ahead(&mut stage, way, &closed).await
    } else {
        let attempt = set_out(&mut stage, &mut steps, way, &closed).await;
        (attempt, set_zones(&mut stage, vec![closed.clone()], &[]).await.unwrap().tick)
    };

    let (mut due, mut is_diverted) = (set_tick + DECISION, false);
    let mut waypoints = Vec::new();
    let outcome = loop {
        let step = steps.next().await.unwrap().unwrap();
        let npc = step.npc.unwrap();
        if step.tick < set_tick {
            continue;
        }
        let place = npc.position.unwrap();
        if let Some(plan) = step.plan {
            if waypoints.is_empty() {
                // The first plan may have been on its way when the zone closed.
                due = due.max(step.tick + DECISION);
            }
            waypoints = plan.waypoints;
        }
        assert!(!is_in(&closed, place), "{place:?} is closed");
        if npc.support() == wire::Support::Air && !is_diverted {
            // An NPC in the air cannot turn back.
            due = step.tick + DECISION;
        }
        if mode == wire::TimeMode::Lockstep && step.tick > due && !is_diverted {
            assert!(!passes(&closed, place, &waypoints), "{waypoints:?} at tick {} of {set_tick}", step.tick);
            is_diverted = true;
        }
        if npc.attempts_ended == attempt {
            break npc.last_outcome();
        }
    };
    assert_eq!(outcome, wire::Outcome::Reached, "through the other gap");

    // A goal in the zone is reached again once the zone is gone.
    let inside = stage.at([58.5, 0.0, 8.0]);
    set_goal(&mut stage.client, npc_id, inside).await;
    let (outcome, place) = stage.end_of(attempt + 1).await;
    assert_eq!(outcome, wire::Outcome::Unreachable, "at {place:?}");
    set_zones(&mut stage, Vec::new(), &["gap"]).await.unwrap();
    set_goal(&mut stage.client, npc_id, inside).await;
    assert_eq!(stage.end_of(attempt + 2).await.0, wire::Outcome::Reached);
    worker.stop().await;
    planner.stop().await;
    server.stop().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn npcs_in_lockstep_take_another_route_within_a_decision_after_a_zone_closes_theirs() {
    a_zone_closes_the_route(wire::TimeMode::Lockstep).await;
}

#[tokio::test(flavor = "multi_thread")]
async fn npcs_in_realtime_take_another_route_after_a_zone_closes_theirs() {
    a_zone_closes_the_route(wire::TimeMode::Realtime).await;
}

#[tokio::test(flavor = "multi_thread")]
async fn zones_and_tags_survive_a_restart_and_a_key_opens_a_zone() {
    let (cache, state) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
    let config = || ServerConfig { state: Some(state.path().to_owned()), ..ServerConfig::default() };
    let server = start_server(config());
    let planner = start_planner(cache.path(), PlannerConfig::default());
    let mut stage = world_of(&server, two_gaps(), wire::TimeMode::Lockstep).await;
    let (here, there) = (stage.at([46.0, 0.0, 8.0]), stage.at([68.0, 0.0, 8.0]));
    // Both gaps: there is no other way.
    let door = boxed("door", stage.at([54.0, -1.0, -20.0]), stage.at([59.0, 12.0, 60.0]), only_with("key"));
    set_zones(&mut stage, vec![door.clone()], &[]).await.unwrap();
    let npc_id = spawn(&mut stage.client, stage.world_id, here).await;
    let tag = |tags: &[&str]| wire::SetNpcTagsRequest {
        npcs: vec![wire::NpcTags { npc_id, tags: tags.iter().map(|tag| (*tag).to_owned()).collect() }],
    };
    let tagged = stage.client.set_npc_tags(tag(&["key"])).await.unwrap().into_inner();
    assert_eq!(tagged.results, [wire::ItemResult { error: None }]);
    server.stop().await;

    let server = start_server(config());
    stage.client = world_client(&server).await;
    let worker = start_planning_worker(&server, &planner);
    assert_eq!(list_zones(&mut stage).await, [door]);
    let world_id = stage.world_id;
    let world = stage.client.get_world(wire::GetWorldRequest { world_id }).await.unwrap().into_inner().world.unwrap();
    assert_eq!(world.zone_count, 1);
    set_goal(&mut stage.client, npc_id, there).await;
    assert_eq!(stage.end_of(1).await.0, wire::Outcome::Reached, "it has the key");
    stage.client.set_npc_tags(tag(&[])).await.unwrap();
    set_goal(&mut stage.client, npc_id, here).await;
    let (outcome, place) = stage.end_of(2).await;
    assert_eq!(outcome, wire::Outcome::Unreachable, "it has lost the key, at {place:?}");
    worker.stop().await;
    planner.stop().await;
    server.stop().await;
}

fn only_with(tag: &str) -> Rule {
    Rule::OnlyWithTag(tag.to_owned())
}

#[tokio::test(flavor = "multi_thread")]
async fn zones_that_are_not_valid_are_refused_and_change_nothing() {
    let server = start_server(ServerConfig::default());
    let mut stage = world_of(&server, two_gaps(), wire::TimeMode::Realtime).await;
    let known = gap(&stage, Rule::Price(2.5));
    set_zones(&mut stage, vec![known.clone()], &[]).await.unwrap();
    let named = |idx: usize, zone: &wire::Zone| wire::Zone { name: format!("zone {idx}"), ..zone.clone() };
    let cases = [
        (wire::Zone { rule: Some(Rule::Price(0.0)), ..known.clone() }, "put"),
        (wire::Zone { rule: Some(Rule::Price(f32::NAN)), ..known.clone() }, "put"),
        (wire::Zone { rule: Some(Rule::Never(false)), ..known.clone() }, "zone.rule"),
        (wire::Zone { shape: None, ..known.clone() }, "zone.shape"),
        (wire::Zone { name: String::new(), ..known.clone() }, "put"),
        (wire::Zone { for_tags: vec![String::new()], ..known.clone() }, "zone.for_tags"),
        (boxed("flat", stage.at([0.0; 3]), stage.at([1.0, 0.0, 1.0]), Rule::Never(true)), "put"),
    ];
    for (zone, field) in cases {
        let status = set_zones(&mut stage, vec![zone], &[]).await.unwrap_err();
        assert_eq!((status.code(), Reason::of(&status)), (Code::InvalidArgument, Some(Reason::InvalidField)));
        assert!(status.message().contains(field), "{}", status.message());
    }
    let many = (0..256).map(|idx| named(idx, &known)).collect();
    let status = set_zones(&mut stage, many, &[]).await.unwrap_err();
    assert_eq!(Reason::of(&status), Some(Reason::TooManyZones), "{}", status.message());
    let status = set_zones(&mut stage, Vec::new(), &["gap", "nothing"]).await.unwrap_err();
    assert_eq!(Reason::of(&status), Some(Reason::ZoneNotFound), "{}", status.message());
    assert_eq!(list_zones(&mut stage).await, [known]);
    let unknown = wire::NpcTags { npc_id: 1, tags: vec!["key".to_owned()] };
    let tagged = stage.client.set_npc_tags(wire::SetNpcTagsRequest { npcs: vec![unknown] }).await.unwrap().into_inner();
    assert!(tagged.results[0].error.is_some());
    watch_until(&mut stage.client, stage.world_id, |_| true).await;
    server.stop().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn plans_respect_the_zones_of_queries_and_of_batches() {
    let cache = tempfile::tempdir().unwrap();
    let planner = start_planner(cache.path(), PlannerConfig::default());
    let mut client = planner_client(&planner).await;
    let (graph_id, _) = build_graph(&mut client, 7).await;
    let get = plan::GetGraphRequest { graph_id: graph_id.clone(), ..Default::default() };
    let vertices = client.get_graph(get).await.unwrap().into_inner().vertices;
    let around = |at: wire::Vec3, rule: Rule| {
        let bottom = Some(wire::Vec3 { y: at.y - 2.0, ..at });
        let shape = Some(Shape::Cylinder(wire::ZoneCylinder { bottom, radius: 2.0, height: 4.0 }));
        wire::Zone { name: "zone".to_owned(), shape, rule: Some(rule), for_tags: Vec::new() }
    };
    let mut diverted = 0;
    for idx in 0..vertices.len() {
        let (start, goal) = (vertices[idx], vertices[(idx * 7 + 11) % vertices.len()]);
        let query = plan::PathQuery { start: Some(start), goal: Some(goal), ..Default::default() };
        let mut find = async |query: plan::PathQuery, shared: Vec<wire::Zone>| {
            let single = plan::PathQuery { zones: [shared.clone(), query.zones.clone()].concat(), ..query.clone() };
            let (id, queries) = (graph_id.clone(), vec![query]);
            let one = plan::FindPathRequest { graph_id: id.clone(), query: Some(single), ..Default::default() };
            let many = plan::FindPathsRequest { graph_id: id, queries, zones: shared, ..Default::default() };
            let one = client.find_path(one).await.unwrap().into_inner().plan.unwrap();
            assert_eq!(client.find_paths(many).await.unwrap().into_inner().plans, std::slice::from_ref(&one));
            one
        };
        let free = find(query.clone(), Vec::new()).await;
        let Some(&middle) = free.waypoints[..free.waypoints.len() - 1].get(1).filter(|_| free.found) else { continue };
        let distance = |place: wire::Vec3| e2e::distance(place, middle);
        if distance(start) < 4.0 || distance(goal) < 4.0 {
            continue;
        }
        let never = find(query.clone(), vec![around(middle, Rule::Never(true))]).await;
        assert!(!never.waypoints.contains(&middle), "{never:?}");
        diverted += usize::from(never.found);
        let keyed = plan::PathQuery { tags: vec!["key".to_owned()], ..query.clone() };
        assert_eq!(find(keyed.clone(), vec![around(middle, only_with("key"))]).await, free, "it has the key");
        let mut only_red = around(middle, Rule::Never(true));
        only_red.for_tags = vec!["red".to_owned()];
        assert_eq!(find(keyed, vec![only_red]).await, free, "the zone does not concern it");
        let closed = plan::PathQuery { zones: vec![around(goal, Rule::Never(true))], ..query };
        let at_goal = find(closed, vec![around(middle, Rule::Price(0.1))]).await;
        assert_eq!((at_goal.found, at_goal.reason()), (false, plan::NoPath::GoalInZone));
    }
    assert!(diverted > 5, "{diverted} plans lead around");
    let start = Some(vertices[0]);
    let zones = vec![around(vertices[0], Rule::Price(9.0)); 257];
    let query = Some(plan::PathQuery { start, goal: start, zones, ..Default::default() });
    let request = plan::FindPathRequest { graph_id, query, ..Default::default() };
    let status = client.find_path(request).await.unwrap_err();
    assert!(status.code() == Code::InvalidArgument && status.message().contains("query.zones"), "{status}");
    planner.stop().await;
}
