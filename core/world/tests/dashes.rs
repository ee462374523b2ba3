//! Dashes in the air.

use super::stage::NPC;
use std::sync::Arc;
use surefoot_world::character::bodies::NamedBody;
use surefoot_world::map::mover::cuboid;
use surefoot_world::map::{MapSize, Placed};
use surefoot_world::mesh::{Surface, Triangle};
use surefoot_world::reach::{Means, Reach};
use surefoot_world::{Ability, AbilitySet, Action, CharacterProfile, Map, TaskConfig, Vec3, World};

const FLOOR: f32 = 6.0;
const AHEAD: Action = Action { forward: 1.0, strafe: 0.0, turn: 0.0, jump: -1.0 };
const JUMP: Action = Action { jump: 1.0, ..AHEAD };

/// Two platforms with a gap of so many metres between them.
fn gap(width: f32) -> Map {
    let platforms = [(0.0, 20.0), (20.0 + width, 44.0)];
    let triangles =
        platforms.into_iter().flat_map(|(from, to)| cuboid(Vec3::new(0.0, 4.0, from), Vec3::new(20.0, FLOOR, to)));
    let triangles = triangles.filter_map(|corners| Triangle::new(corners, Surface::Ground)).collect();
    Map::from_parts(MapSize { width: 20, height: 20, depth: 44 }, triangles, Placed::default())
}

/// Lets a body run, and jump and dash so far from the rim, m. Returns whether it reached the other platform, and what
/// it used.
fn leap(map: Map, profile: CharacterProfile, [jump_at, dash_at]: [f32; 2]) -> (bool, AbilitySet) {
    let mut world = World::new(Arc::new(map), profile, TaskConfig::default());
    world.spawn(Vec3::new(10.0, FLOOR, 10.0), 0.0);
    let (mut used, mut jumps) = (AbilitySet::default(), 0);
    for _ in 0..40 {
        let body = &world.npc(NPC).unwrap().body;
        let due = [jump_at, dash_at].into_iter().filter(|at| body.feet.z > 20.0 + at).count();
        let action = if due > jumps { JUMP } else { AHEAD };
        jumps = due;
        world.decide(NPC, action);
        world.tick_decision();
        used = used.union(world.npc(NPC).unwrap().used_abilities);
        let body = &world.npc(NPC).unwrap().body;
        if body.is_grounded() && body.feet.z > 21.0 {
            return (true, used);
        }
    }
    (false, used)
}

#[test]
fn a_dash_carries_a_body_over_a_gap_that_it_cannot_jump() {
    let dasher = NamedBody::find("dasher").unwrap().profile();
    let agile = NamedBody::find("agile").unwrap().profile();
    let at = [-1.0, 2.0];
    let (is_over, used) = leap(gap(9.0), dasher.clone(), at);
    assert!(is_over && used.contains(Ability::DASH), "{used:?}");
    assert!(!leap(gap(9.0), agile, at).0);
    // One dash a leap.
    assert!(!leap(gap(18.0), dasher, at).0);
}

#[test]
fn the_survey_dashes() {
    let links = |name: &str| Reach::survey(&gap(9.0), &NamedBody::find(name).unwrap().profile(), 1).links;
    let dashes = |name: &str| links(name).iter().any(|link| link.means == Means::Dash);
    assert!(dashes("dasher"), "{:?}", links("dasher"));
    assert!(!dashes("agile"));
    assert!(links("agile").is_empty());
}
