//! Environments whose episodes are renewed at once or on call, in rows of the caller.

use std::sync::Arc;
use surefoot_rollout::env::{Draw, Env, Episodes, Renewal, Route};
use surefoot_world::map::MapKind;
use surefoot_world::{Action, CharacterProfile, Map, MapSpec, Vec3};

const NPCS: usize = 12;
const BAND: (f32, f32) = (2.0, 8.0);

fn map() -> Arc<Map> {
    let spec = MapSpec::with_side(3, 60).unwrap().with(|spec| spec.kind = MapKind::Islands).unwrap();
    Arc::new(surefoot_generate::generate(&spec))
}

fn env(map: &Arc<Map>, renewal: Renewal) -> Env {
    let episodes = Episodes::Endless { npc_count: NPCS, band: BAND, seed: 5 };
    Env::new(map.clone(), CharacterProfile::default(), false, episodes).unwrap().renewed(renewal)
}

fn actions() -> Vec<Action> {
    let turn = |npc: usize| Action::from_array([1.0, 0.0, npc as f32 / NPCS as f32 - 0.5, -1.0]).unwrap();
    (0..NPCS).map(turn).collect()
}

#[test]
fn an_npc_on_call_rests_with_its_last_observation_until_it_is_renewed() {
    let map = map();
    let (mut at_once, mut on_call) = (env(&map, Renewal::AtOnce), env(&map, Renewal::OnCall));
    let mut rows = on_call.observations().to_vec();
    let len = on_call.observation_len();
    let first = loop {
        let (ended, same) = (on_call.step_into(&actions(), &mut rows), at_once.step(&actions()));
        assert_eq!(ended, same, "both end alike");
        if let Some(first) = ended.into_iter().next() {
            break first;
        }
        assert_eq!(rows, at_once.observations(), "rows of the caller hold what the environment's own would");
    };
    let row = first.npc_idx * len..(first.npc_idx + 1) * len;
    assert!(on_call.rests()[first.npc_idx]);
    assert_eq!(rows[row.clone()], first.final_observation);
    on_call.step_into(&actions(), &mut rows);
    assert_eq!(on_call.rewards()[first.npc_idx], 0.0);
    assert_eq!(rows[row.clone()], first.final_observation, "it rests");
    let goal = on_call.goals()[first.npc_idx];
    on_call.renew(first.npc_idx, &mut rows);
    assert!(!on_call.rests()[first.npc_idx]);
    assert_ne!(on_call.goals()[first.npc_idx], goal);
    assert_ne!(rows[row], first.final_observation);
}

#[test]
fn a_draw_gives_the_episodes_of_an_environment() {
    let map = map();
    let env = env(&map, Renewal::AtOnce);
    let mut draw = Draw::on(&map, &CharacterProfile::default(), BAND, 5).unwrap();
    let drawn: Vec<_> = (0..NPCS).map(|_| draw.goal()).collect();
    assert_eq!(drawn.iter().map(|goal| goal.goal).collect::<Vec<_>>(), env.goals());
    assert_eq!(drawn.iter().map(|goal| goal.start).collect::<Vec<_>>(), env.positions().collect::<Vec<_>>());
}

#[test]
#[should_panic(expected = "one route for each NPC")]
fn an_npc_has_one_route_in_a_step_so_that_the_start_that_is_announced_is_the_one_that_is_used() {
    let route = |x: f32| Route { npc_idx: 3, start: Some((Vec3::X * x, 0.0)), waypoints: vec![Vec3::ONE] };
    env(&map(), Renewal::AtOnce).step_and_redirect(&actions(), &[route(1.0), route(2.0)]);
}
