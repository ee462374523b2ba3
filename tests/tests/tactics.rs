//! Questions about many places at a time, over real sockets.

use e2e::stage::level;
use e2e::{build_graph, build_to_end, distance, planner_client, small_graph, start_planner};
use surefoot_planner_service::PlannerConfig;
use surefoot_proto::planner::v1 as wire;
use surefoot_proto::planner::v1::planner_service_client::PlannerServiceClient;
use surefoot_proto::world::v1::map_service_client::MapServiceClient;
use surefoot_proto::world::v1::{Ability, Coordinates, ImportMapRequest, MapFormat, Vec3};
use tonic::Code;
use tonic::transport::Channel;

type Client = PlannerServiceClient<Channel>;

const LEVEL: i32 = Coordinates::Level as i32;

async fn vertices(client: &mut Client, graph_id: &str) -> Vec<Vec3> {
    let request = wire::GetGraphRequest { graph_id: graph_id.to_owned(), ..Default::default() };
    client.get_graph(request).await.unwrap().into_inner().vertices
}

/// What FindPath promises for the same query.
async fn alone(client: &mut Client, graph_id: &str, query: wire::PathQuery) -> wire::Plan {
    let request = wire::FindPathRequest { graph_id: graph_id.to_owned(), query: Some(query), ..Default::default() };
    client.find_path(request).await.unwrap().into_inner().plan.unwrap()
}

fn is_close(one: f32, other: f32) -> bool {
    (one - other).abs() <= 1.0e-3 * (1.0 + one.abs())
}

#[tokio::test(flavor = "multi_thread")]
async fn ranked_places_have_the_plans_of_find_path_from_one_and_to_one() {
    let cache = tempfile::tempdir().unwrap();
    let planner = start_planner(cache.path(), PlannerConfig::default());
    let mut client = planner_client(&planner).await;
    let (graph_id, _) = build_graph(&mut client, 7).await;
    let mut places = vertices(&mut client, &graph_id).await;
    let here = places[3];
    places.push(Vec3 { y: here.y + 60.0, ..here });
    let whole = wire::PathQuery::default();
    let on_foot = wire::PathQuery { without: vec![Ability::Jump.into()], ..Default::default() };
    let bold = wire::PathQuery { caution: Some(0.0), ..Default::default() };
    for options in [whole, on_foot, bold] {
        for is_start in [true, false] {
            let with = |other: Option<Vec3>| {
                let (start, goal) = if is_start { (Some(here), other) } else { (other, Some(here)) };
                wire::PathQuery { start, goal, ..options.clone() }
            };
            let request = wire::RankPlacesRequest {
                graph_id: graph_id.clone(),
                query: Some(with(None)),
                places: places.clone(),
                ..Default::default()
            };
            let ranked = client.rank_places(request.clone()).await.unwrap().into_inner();
            let count = places.len() as u32;
            assert_eq!((ranked.places.len() as u32, ranked.considered, ranked.fitting), (count, count, count));
            assert!(ranked.revision > 0 && !ranked.interim);
            for place in &ranked.places {
                assert_eq!(place.place, Some(places[place.index as usize]));
                let plan = alone(&mut client, &graph_id, with(place.place)).await;
                assert_eq!((place.found, place.reason), (plan.found, plan.reason));
                if place.found {
                    assert!(is_close(place.seconds, plan.seconds), "{} s, alone {} s", place.seconds, plan.seconds);
                    assert!(is_close(place.chance, plan.chance) && is_close(place.death_chance, plan.death_chance));
                    assert!(is_close(place.arrival_chance, plan.arrival_chance));
                }
            }
            let found = ranked.places.iter().filter(|place| place.found).count();
            assert!(ranked.places[..found].is_sorted_by(|one, other| one.cost <= other.cost));
            assert!(found > 2 && !ranked.places[found..].iter().any(|place| place.found));
            let by = wire::RankBy::Seconds.into();
            let quickest = client.rank_places(wire::RankPlacesRequest { by, best: 5, ..request }).await.unwrap();
            let quickest = quickest.into_inner().places;
            assert!(quickest.len() == 5 && quickest.is_sorted_by(|one, other| one.seconds <= other.seconds));
            assert!(ranked.places[..found].iter().all(|place| place.seconds >= quickest[0].seconds));
        }
    }
    planner.stop().await;
}

/// The graph of a floor of 60 x 60 m with a wall across it, 20 m high, from one side to 10 m before the other.
async fn walled(planner: &e2e::Running, client: &mut Client) -> String {
    let mut maps = MapServiceClient::connect(planner.uri.clone()).await.unwrap();
    let boxes = [("floor", [0.0, 0.0, 0.0], [60.0, 1.0, 60.0]), ("wall", [29.5, 1.0, 0.0], [30.5, 21.0, 50.0])];
    let request = ImportMapRequest {
        name: "walled".to_owned(),
        format: MapFormat::Obj.into(),
        file: level(&boxes),
        ..Default::default()
    };
    let map_hash = maps.import_map(request).await.unwrap().into_inner().map.unwrap().map_hash;
    let request = wire::StartBuildRequest { map_hash, settings: Some(small_graph()), ..Default::default() };
    build_to_end(client, request).await.graph_id
}

/// Whether the wall hides two places of its level from each other; `None` within half a metre of its end.
fn is_walled_off(eye: Vec3, place: Vec3) -> Option<bool> {
    if (place.x - 30.0) * (eye.x - 30.0) >= 0.0 {
        return Some(false);
    }
    let crossing = eye.z + (place.z - eye.z) * (30.0 - eye.x) / (place.x - eye.x);
    ((crossing - 50.0).abs() > 0.5).then_some(crossing < 50.0)
}

#[tokio::test(flavor = "multi_thread")]
async fn cover_is_behind_the_wall_and_the_quickest_comes_first() {
    let cache = tempfile::tempdir().unwrap();
    let planner = start_planner(cache.path(), PlannerConfig::default());
    let mut client = planner_client(&planner).await;
    let graph_id = walled(&planner, &mut client).await;
    let at = |x: f32, y: f32, z: f32| Vec3 { x, y, z };
    let (npc, guard) = (at(24.0, 1.0, 44.0), at(15.0, 2.6, 25.0));
    let request = |hidden_from: Vec<Vec3>, sees: Vec<Vec3>| wire::RankPlacesRequest {
        graph_id: graph_id.clone(),
        query: Some(wire::PathQuery { start: Some(npc), ..Default::default() }),
        around: Some(wire::Around { centre: Some(npc), radius: 20.0, count: 120 }),
        hidden_from,
        sees,
        coordinates: LEVEL,
        ..Default::default()
    };
    let all = client.rank_places(request(vec![], vec![])).await.unwrap().into_inner();
    assert!(all.considered > 60 && all.places.len() as u32 == all.considered && all.fitting == all.considered);
    let hidden = client.rank_places(request(vec![guard], vec![])).await.unwrap().into_inner();
    let seen = client.rank_places(request(vec![], vec![guard])).await.unwrap().into_inner();
    assert_eq!((hidden.considered, hidden.fitting + seen.fitting), (all.considered, all.considered));
    assert!(hidden.fitting > 10 && seen.fitting > 10, "{} hidden, {} in sight", hidden.fitting, seen.fitting);
    for (ranking, is_hidden) in [(&hidden, true), (&seen, false)] {
        assert_eq!(ranking.places.len() as u32, ranking.fitting);
        for place in &ranking.places {
            let at = place.place.unwrap();
            assert!(distance(at, npc) <= 20.5 && (at.y - 1.0).abs() < 0.2, "{at:?}");
            assert!(is_walled_off(guard, at).is_none_or(|is_walled_off| is_walled_off == is_hidden), "{at:?}");
        }
    }
    // A guard on each side: nothing is hidden from both that one of them sees.
    let both = vec![guard, at(45.0, 2.6, 25.0)];
    let neither = client.rank_places(request(both, vec![])).await.unwrap().into_inner();
    assert!(neither.fitting < hidden.fitting);
    planner.stop().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn more_is_reached_in_more_time() {
    let cache = tempfile::tempdir().unwrap();
    let planner = start_planner(cache.path(), PlannerConfig::default());
    let mut client = planner_client(&planner).await;
    let graph_id = walled(&planner, &mut client).await;
    let start = Vec3 { x: 22.0, y: 1.0, z: 12.0 };
    let request = |seconds: f32| wire::FindReachableRequest {
        graph_id: graph_id.clone(),
        query: Some(wire::PathQuery { start: Some(start), ..Default::default() }),
        seconds,
        resolution: 2.0,
        coordinates: LEVEL,
    };
    let mut before: Option<wire::FindReachableResponse> = None;
    for seconds in [1.0, 3.0, 6.0, 600.0] {
        let reach = client.find_reachable(request(seconds)).await.unwrap().into_inner();
        let times = reach.vertices.iter().map(|it| it.seconds).chain(reach.cells.iter().map(|it| it.seconds));
        assert!(times.into_iter().all(|time| time <= seconds) && reach.revision > 0);
        if let Some(before) = before {
            assert!(reach.cells.len() > before.cells.len() && reach.vertices.len() >= before.vertices.len());
            let is_kept = |old: &wire::ReachedVertex| reach.vertices.iter().any(|new| new == old);
            assert!(before.vertices.iter().all(is_kept), "a vertex gets no other time");
        }
        before = Some(reach);
    }
    let all = before.unwrap();
    assert!(all.vertices.len() > 30, "{} of the vertices", all.vertices.len());
    let bare = wire::FindReachableRequest { resolution: 0.0, ..request(600.0) };
    let bare = client.find_reachable(bare).await.unwrap().into_inner();
    assert_eq!((bare.vertices, bare.cells.len()), (all.vertices, 0));
    planner.stop().await;
}

fn at(x: f32) -> Option<Vec3> {
    Some(Vec3 { x, y: 40.0, z: 50.0 })
}

fn here() -> Vec3 {
    Vec3 { x: 50.0, y: 40.0, z: 50.0 }
}

fn from(start: Option<Vec3>, goal: Option<Vec3>) -> Option<wire::PathQuery> {
    Some(wire::PathQuery { start, goal, ..Default::default() })
}

fn reckless() -> wire::PathQuery {
    wire::PathQuery { start: at(50.0), caution: Some(2.0), ..Default::default() }
}

fn around(centre: Option<Vec3>, radius: f32, count: u32) -> Option<wire::Around> {
    Some(wire::Around { centre, radius, count })
}

#[tokio::test(flavor = "multi_thread")]
async fn senseless_questions_are_refused() {
    let cache = tempfile::tempdir().unwrap();
    let planner = start_planner(cache.path(), PlannerConfig { max_queries: 300, ..PlannerConfig::default() });
    let mut client = planner_client(&planner).await;
    let (graph_id, _) = build_graph(&mut client, 7).await;
    let rank = wire::RankPlacesRequest {
        graph_id: graph_id.clone(),
        query: from(at(50.0), None),
        places: vec![here()],
        ..Default::default()
    };
    client.rank_places(rank.clone()).await.unwrap();
    type Change = fn(&mut wire::RankPlacesRequest);
    let cases: [(Change, Code, &str); 22] = [
        (|it| it.query = None, Code::InvalidArgument, "query is missing"),
        (|it| it.query = from(None, None), Code::InvalidArgument, "query.start or query.goal"),
        (|it| it.query = from(at(1.0), at(2.0)), Code::InvalidArgument, "exclude each other"),
        (|it| it.query = Some(reckless()), Code::InvalidArgument, "query.caution"),
        (|it| it.query = from(at(900.0), None), Code::InvalidArgument, "query.start is"),
        (|it| it.query = from(None, at(900.0)), Code::InvalidArgument, "query.goal is"),
        (|it| it.places.clear(), Code::InvalidArgument, "are both missing"),
        (|it| it.places[0].x = f32::NAN, Code::InvalidArgument, "places is not finite"),
        (|it| it.places[0].x = 900.0, Code::InvalidArgument, "places is"),
        (|it| it.places = vec![here(); 301], Code::OutOfRange, "--max-queries"),
        (|it| it.around = around(at(1.0), 9.0, 300), Code::OutOfRange, "--max-queries"),
        (|it| it.around = around(at(1.0), 9.0, u32::MAX), Code::OutOfRange, "--max-queries"),
        (|it| it.around = around(None, 9.0, 1), Code::InvalidArgument, "around.centre is missing"),
        (|it| it.around = around(at(900.0), 9.0, 1), Code::InvalidArgument, "around.centre is"),
        (|it| it.around = around(at(1.0), 0.0, 1), Code::InvalidArgument, "around.radius"),
        (|it| it.around = around(at(1.0), 201.0, 1), Code::InvalidArgument, "around.radius"),
        (|it| it.hidden_from = vec![here(); 17], Code::InvalidArgument, "at most 16"),
        (|it| it.sees = vec![Vec3 { y: f32::MAX, ..here() }], Code::InvalidArgument, "sees is"),
        (|it| it.eye_height = Some(f32::NAN), Code::InvalidArgument, "eye_height"),
        (|it| it.by = 9, Code::InvalidArgument, "by has the unknown value"),
        (|it| it.coordinates = 9, Code::InvalidArgument, "coordinates"),
        (|it| it.graph_id = "0".repeat(64), Code::NotFound, "StartBuild"),
    ];
    for (change, code, words) in cases {
        let mut request = rank.clone();
        change(&mut request);
        let status = client.rank_places(request).await.expect_err(words);
        assert!(status.code() == code && status.message().contains(words), "{status} instead of {words}");
    }
    let reach = wire::FindReachableRequest {
        graph_id,
        query: from(at(50.0), None),
        seconds: 5.0,
        resolution: 2.0,
        ..Default::default()
    };
    client.find_reachable(reach.clone()).await.unwrap();
    for (query, seconds, resolution, words) in [
        (None, 5.0, 2.0, "query is missing"),
        (from(None, at(1.0)), 5.0, 2.0, "query.start is missing"),
        (from(at(1.0), at(1.0)), 5.0, 2.0, "exclude each other"),
        (from(at(-90.0), None), 5.0, 2.0, "query.start is"),
        (from(at(1.0), None), 0.0, 2.0, "seconds"),
        (from(at(1.0), None), 601.0, 2.0, "seconds"),
        (from(at(1.0), None), f32::NAN, 2.0, "seconds"),
        (from(at(1.0), None), 5.0, 0.1, "resolution"),
        (from(at(1.0), None), 5.0, f32::INFINITY, "resolution"),
    ] {
        let request = wire::FindReachableRequest { query, seconds, resolution, ..reach.clone() };
        let status = client.find_reachable(request).await.expect_err(words);
        assert!(status.code() == Code::InvalidArgument && status.message().contains(words), "{status} for {words}");
    }
    planner.stop().await;
}
