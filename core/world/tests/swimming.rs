//! Water that bodies swim in.

use super::stage::NPC;
use std::sync::Arc;
use surefoot_world::character::bodies::NamedBody;
use surefoot_world::crossings::crossings;
use surefoot_world::map::mover::cuboid;
use surefoot_world::map::{Liquid, MapSize, Outline, Placed, Pool};
use surefoot_world::mesh::{Surface, Triangle};
use surefoot_world::reach::{Means, Reach};
use surefoot_world::{Ability, AbilitySet, Action, CharacterProfile, End, Map, TaskConfig, Vec3, World};

/// Height of the banks, m.
const BANK: f32 = 6.0;
const AHEAD: Action = Action { forward: 1.0, strafe: 0.0, turn: 0.0, jump: -1.0 };
const STILL: Action = Action { forward: 0.0, ..AHEAD };

fn block(low: [f32; 3], high: [f32; 3]) -> Vec<Triangle> {
    cuboid(low.into(), high.into()).into_iter().filter_map(|it| Triangle::new(it, Surface::Ground)).collect()
}

/// Two banks with a canal of 20 m between them, whose water is so far below them, m.
fn canal(below: f32) -> Map {
    let floor = block([0.0, 0.0, 0.0], [24.0, 1.0, 40.0]);
    let banks = [(0.0, 10.0), (30.0, 40.0)].map(|(from, to)| block([0.0, 1.0, from], [24.0, BANK, to]));
    let outline = Outline::Rectangle { half_x: 12.0, half_z: 10.0 };
    let centre = Vec3::new(12.0, BANK - below, 20.0);
    let pool = Pool { centre, outline, depth: BANK - below - 1.0, liquid: Liquid::Water };
    let placed = Placed { pools: vec![pool], ..Placed::default() };
    Map::from_parts(MapSize { width: 24, height: 20, depth: 40 }, [floor, banks.concat()].concat(), placed)
}

/// A world with a body on the near bank that faces the canal.
fn world(map: Map, profile: CharacterProfile) -> World {
    let mut world = World::new(Arc::new(map), profile, TaskConfig::default());
    world.spawn(Vec3::new(12.0, BANK, 8.0), 0.0);
    world
}

/// Lets the body act for so many decisions. Returns what it used.
fn act(world: &mut World, action: Action, decisions: u32) -> AbilitySet {
    (0..decisions).fold(AbilitySet::default(), |used, _| {
        world.decide(NPC, action);
        world.tick_decision();
        used.union(world.npc(NPC).unwrap().used_abilities)
    })
}

#[test]
fn a_body_that_swims_crosses_a_canal_and_gets_out_on_the_other_bank() {
    let agile = NamedBody::find("agile").unwrap().profile();
    let swimmer = CharacterProfile::default().with(|it| it.swim_speed = 2.5).unwrap();
    for profile in [agile, swimmer] {
        for below in [0.1, 0.3, 0.5] {
            let mut world = world(canal(below), profile.clone());
            let mut used = AbilitySet::default();
            let is_over = |world: &World| world.npc(NPC).unwrap().body.feet.z > 31.0;
            for _ in 0..80 {
                if !is_over(&world) {
                    used = used.union(act(&mut world, AHEAD, 1));
                }
            }
            let npc = world.npc(NPC).unwrap();
            assert!(is_over(&world) && npc.body.is_grounded() && npc.harm.is_none(), "{:?}", npc.body);
            assert!(used.contains(Ability::SWIM), "{used:?}");
        }
    }
}

#[test]
fn a_body_that_swims_floats_for_as_long_as_it_likes_with_its_head_above_the_water() {
    let mut world = world(canal(0.5), NamedBody::find("agile").unwrap().profile());
    act(&mut world, AHEAD, 12);
    act(&mut world, STILL, 12);
    for _ in 0..60 {
        act(&mut world, STILL, 1);
        let npc = world.npc(NPC).unwrap();
        let depth = BANK - 0.5 - npc.body.feet.y;
        assert!((depth - 0.75 * 1.8).abs() < 0.1 && npc.harm.is_none(), "{depth} m");
    }
}

#[test]
fn other_bodies_sink_and_drown() {
    let mut world = world(canal(0.5), CharacterProfile::default());
    let used = act(&mut world, AHEAD, 12).union(act(&mut world, STILL, 60));
    assert_eq!(world.npc(NPC).unwrap().harm, Some(End::Drowned));
    assert!(!used.contains(Ability::SWIM));
}

#[test]
fn the_survey_joins_the_banks_for_bodies_that_swim() {
    let (map, agile) = (canal(0.3), NamedBody::find("agile").unwrap().profile());
    let found = crossings(&map, &agile);
    assert!(found.iter().any(|it| it.by == Ability::SWIM && it.from.z < 11.0 && it.to.z > 29.0), "{found:?}");
    assert!(found.iter().any(|it| it.by == Ability::SWIM && it.from.z > 29.0 && it.to.z < 11.0), "{found:?}");
    let links = Reach::survey(&map, &agile, 1).links;
    assert!(links.iter().any(|link| link.means == Means::Swim), "{links:?}");
    assert_eq!(crossings(&map, &CharacterProfile::default()), []);
}
