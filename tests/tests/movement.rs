//! How NPCs move and where they will be, as a client that animates them reads it.

use e2e::stage::{Services, Stage, level, world_of};
use e2e::{LIMIT, set_goal, spawn};
use std::collections::BTreeMap;
use surefoot_proto::world::v1::{self as wire, MovePhase, Pace};
use tokio_stream::StreamExt;

/// Error of a prediction that an animation does not show, m.
const CLOSE_M: f32 = 0.15;
/// Ticks to the last pose of a prediction.
const SECOND: u64 = 60;

/// The states of the only NPC by tick, from the start of attempt `attempt` until a second after its end.
async fn watch_attempt(stage: &mut Stage, attempt: u32) -> BTreeMap<u64, wire::Npc> {
    let request =
        wire::WatchWorldRequest { world_id: stage.world_id, rate_hz: 60.0, movement: true, ..Default::default() };
    let mut snapshots = stage.client.watch_world(request).await.unwrap().into_inner();
    let watching = async {
        let (mut seen, mut ended) = (BTreeMap::new(), None);
        loop {
            let snapshot = snapshots.next().await.expect("an endless stream").unwrap();
            let npc = snapshot.npcs[0];
            seen.insert(snapshot.tick, npc);
            if npc.attempts_ended == attempt && snapshot.tick > *ended.get_or_insert(snapshot.tick) + SECOND {
                assert_eq!(npc.last_outcome(), wire::Outcome::Reached);
                return seen;
            }
        }
    };
    tokio::time::timeout(LIMIT, watching).await.expect("the attempt ends")
}

fn movement(npc: &wire::Npc) -> wire::Movement {
    npc.movement.expect("it was requested")
}

fn distance(a: wire::Vec3, b: wire::Vec3) -> f32 {
    [a.x - b.x, a.y - b.y, a.z - b.z].map(|it| it * it).iter().sum::<f32>().sqrt()
}

/// Where the NPC was at a tick, m, between the snapshots around it; `None` if they are more than 4 ticks apart.
fn place_at(seen: &BTreeMap<u64, wire::Npc>, tick: u64) -> Option<wire::Vec3> {
    let (before, from) = seen.range(..=tick).next_back()?;
    let (after, to) = seen.range(tick..).next()?;
    let (from, to) = (from.position?, to.position?);
    let share = (tick - before) as f32 / (after - before).max(1) as f32;
    let between = |from: f32, to: f32| from + share * (to - from);
    let place = wire::Vec3 { x: between(from.x, to.x), y: between(from.y, to.y), z: between(from.z, to.z) };
    (after - before <= 4).then_some(place)
}

/// The errors of what was predicted since an attempt began, m, a third of a second ahead, two thirds, and a second.
fn errors(seen: &BTreeMap<u64, wire::Npc>, attempt: u32) -> [Vec<f32>; 3] {
    let of_attempt = seen.values().filter(|npc| npc.attempts_begun == attempt);
    let predictions = of_attempt.filter_map(|npc| movement(npc).prediction);
    let by_tick: BTreeMap<u64, wire::Prediction> = predictions.map(|made| (made.tick, made)).collect();
    let mut errors = [const { Vec::new() }; 3];
    for made in by_tick.values() {
        let poses = [made.in_20_ticks, made.in_40_ticks, made.in_60_ticks];
        for (errors, (ticks, pose)) in errors.iter_mut().zip([20, 40, SECOND].into_iter().zip(poses)) {
            let then = pose.and_then(|pose| Some(distance(pose.position?, place_at(seen, made.tick + ticks)?)));
            errors.extend(then);
        }
    }
    errors
}

#[tokio::test(flavor = "multi_thread")]
async fn predictions_hold_and_moves_have_their_phases() {
    let services = Services::start();
    let ground = [("floor", [0.0, -1.0, 0.0], [24.0, 0.0, 12.0]), ("ledge", [24.0, -1.0, 0.0], [48.0, 1.2, 12.0])];
    let mut stage = world_of(&services.server, level(&ground), wire::TimeMode::Realtime).await;
    let ends = [[3.0, 0.0, 6.0], [44.0, 1.2, 6.0]].map(|place| stage.at(place));
    let npc_id = spawn(&mut stage.client, stage.world_id, ends[0]).await;

    let (mut all, mut decisions) = ([const { Vec::new() }; 3], 0);
    for attempt in 1..=4 {
        set_goal(&mut stage.client, npc_id, ends[attempt as usize % 2]).await;
        let seen = watch_attempt(&mut stage, attempt).await;
        if attempt % 2 == 1 {
            assert_phases(&seen);
        }
        decisions += seen.values().filter(|npc| npc.status() == wire::NpcStatus::Seeking).count() / 10;
        all.iter_mut().zip(errors(&seen, attempt)).for_each(|(all, errors)| all.extend(errors));
    }
    for (errors, (ticks, least)) in all.iter().zip([(20, 50), (40, 30), (SECOND, 15)]) {
        let close = errors.iter().filter(|error| **error <= CLOSE_M).count();
        let share = close as f32 / errors.len() as f32;
        let count = errors.len();
        println!("{count} predictions over {ticks} ticks in {decisions} decisions: {share:.3} within {CLOSE_M} m");
        assert!(count >= least && share >= 0.9, "{share} of {count} predictions over {ticks} ticks: {errors:?}");
    }
    services.stop().await;
}

/// Checks the phases of an attempt with a jump: it runs, winds up, flies and lands, and stops at last.
fn assert_phases(seen: &BTreeMap<u64, wire::Npc>) {
    let states = seen.values().map(|npc| (movement(npc).phase(), movement(npc).pace()));
    let mut states: Vec<(MovePhase, Pace)> = states.collect();
    states.dedup();
    let position = |wanted: MovePhase, after: usize| {
        let found = states[after..].iter().position(|(phase, _)| *phase == wanted);
        after + found.unwrap_or_else(|| panic!("{wanted:?} after {after} of {states:?}"))
    };
    let wind_up = position(MovePhase::WindUp, 0);
    let run = (MovePhase::Unspecified, Pace::Run);
    assert!(states[..wind_up].contains(&run), "{states:?}");
    let flight = position(MovePhase::Flight, wind_up);
    let landing = position(MovePhase::Landing, flight);
    assert!(states[landing..].contains(&run), "{states:?}");
    assert_eq!(states.last(), Some(&(MovePhase::Unspecified, Pace::Idle)), "{states:?}");
    let jumps = seen.values().map(movement).filter(|movement| movement.phase() == MovePhase::Flight);
    assert!(jumps.clone().any(|movement| movement.ability() == wire::Ability::Jump));
    let running =
        seen.values().map(movement).filter(|movement| movement.pace() == Pace::Run && movement.stride_m > 0.0);
    assert!(running.clone().count() > 20);
    assert!(running.clone().all(|movement| (0.0..1.0).contains(&movement.stride_phase)));
}

#[tokio::test(flavor = "multi_thread")]
async fn readers_get_movement_where_they_want_it_and_a_teleport_ends_predictions() {
    let services = Services::start();
    let mut stage =
        world_of(&services.server, level(&[("floor", [0.0, -1.0, 0.0], [60.0, 0.0, 12.0])]), wire::TimeMode::Realtime)
            .await;
    let ends = [[4.0, 0.0, 6.0], [54.0, 0.0, 6.0]].map(|place| stage.at(place));
    let npc_id = spawn(&mut stage.client, stage.world_id, ends[0]).await;
    set_goal(&mut stage.client, npc_id, ends[1]).await;
    let follow = wire::FollowNpcRequest { npc_id, rate_hz: 60.0, ..Default::default() };
    let mut steps = stage.client.follow_npc(follow).await.unwrap().into_inner();
    let under_way = async {
        loop {
            let npc = steps.next().await.expect("an endless stream").unwrap().npc.unwrap();
            if movement(&npc).pace() == Pace::Run && movement(&npc).prediction.is_some() {
                return;
            }
        }
    };
    tokio::time::timeout(LIMIT, under_way).await.expect("it runs");

    let position = Some(ends[0]);
    let teleport = wire::TeleportNpcRequest { npc_id, position, ..Default::default() };
    stage.client.teleport_npc(teleport).await.unwrap();
    let one = wire::GetNpcRequest { npc_id, ..Default::default() };
    let npc = stage.client.get_npc(one).await.unwrap().into_inner().npc.unwrap();
    if let Some(pose) = movement(&npc).prediction.and_then(|made| made.in_60_ticks) {
        assert!(distance(pose.position.unwrap(), ends[0]) < 0.1, "{pose:?}");
    }
    let batch = wire::BatchGetNpcsRequest { npc_ids: vec![npc_id], ..Default::default() };
    let results = stage.client.batch_get_npcs(batch).await.unwrap().into_inner().results;
    let Some(wire::get_npc_result::Result::Npc(npc)) = results[0].result else { panic!("{results:?}") };
    assert_eq!(movement(&npc).pace(), Pace::Idle);

    // Others do not pay for it.
    let world_id = stage.world_id;
    let listed = stage.client.list_npcs(wire::ListNpcsRequest { world_id, ..Default::default() }).await.unwrap();
    assert_eq!(listed.into_inner().npcs[0].movement, None);
    for movement in [false, true] {
        let request = wire::WatchWorldRequest { world_id, movement, delta: true, ..Default::default() };
        let mut snapshots = stage.client.watch_world(request).await.unwrap().into_inner();
        let first = snapshots.next().await.unwrap().unwrap();
        assert_eq!(first.npcs[0].movement.is_some(), movement);
    }
    services.stop().await;
}
