//! Players among NPCs: they block, push or pass, and push nobody off a ledge.

use crate::stage::{FORWARD, NPC, STAND, feet, player, run};
use rand::rngs::ChaCha8Rng;
use rand::{RngExt, SeedableRng};
use std::f32::consts::TAU;
use std::sync::Arc;
use surefoot_world::map::{MapSize, Placed};
use surefoot_world::mesh::{Surface, Triangle};
use surefoot_world::replay::Recording;
use surefoot_world::{Body, CharacterProfile, Map, Player, PlayerContact, PlayerSlot, TaskConfig, Tick, Vec3, World};

const DECK: f32 = 10.0;

/// A deck of 20 x 20 m, 10 m above nothing.
fn world() -> World {
    let [a, b, c, d] = [[20.0, 20.0], [20.0, 40.0], [40.0, 40.0], [40.0, 20.0]].map(|[x, z]| Vec3::new(x, DECK, z));
    let deck = [[a, b, c], [a, c, d]].into_iter().filter_map(|corners| Triangle::new(corners, Surface::Ground));
    let map = Map::from_parts(MapSize { width: 60, height: 30, depth: 60 }, deck.collect(), Placed::default());
    World::new(Arc::new(map), CharacterProfile::default(), TaskConfig::default())
}

#[test]
fn an_npc_goes_around_a_player_in_its_way_and_through_a_ghost() {
    for (contact, aside) in [(PlayerContact::Block, true), (PlayerContact::Push, true), (PlayerContact::Ghost, false)] {
        let mut world = world();
        world.spawn(Vec3::new(30.0, DECK, 24.0), 0.0);
        world.spawn_player(player(Vec3::new(30.0, DECK, 28.0), contact));
        let mut nearest = f32::INFINITY;
        for _ in 0..18 {
            world.decide(NPC, FORWARD);
            for _ in 0..10 {
                world.tick();
                nearest = nearest.min(feet(&world).distance(Vec3::new(30.0, DECK, 28.0)));
            }
            if feet(&world).z > 31.0 {
                break;
            }
        }
        assert!(feet(&world).z > 31.0, "{contact:?}: it gets past, {}", feet(&world));
        assert_eq!((feet(&world).x - 30.0).abs() > 0.3, aside, "{contact:?}");
        assert_eq!(nearest > 0.5, aside, "{contact:?}: {nearest}");
    }
}

#[test]
fn a_player_that_walks_into_a_standing_npc_moves_it_only_if_it_pushes() {
    for (contact, moves) in [(PlayerContact::Block, false), (PlayerContact::Push, true), (PlayerContact::Ghost, false)]
    {
        let mut world = world();
        world.spawn(Vec3::new(30.0, DECK, 30.0), 0.0);
        run(&mut world, STAND, 2);
        let slot = world.spawn_player(player(Vec3::new(30.0, DECK, 27.0), contact));
        for tick in 0..120 {
            let at = Vec3::new(30.0, DECK, 27.0 + tick as f32 * 0.03);
            assert!(world.move_player(slot, at, Vec3::new(0.0, 0.0, 1.8)));
            world.tick();
        }
        let moved = feet(&world).distance(Vec3::new(30.0, DECK, 30.0));
        assert_eq!(moved > 0.5, moves, "{contact:?}: {moved}");
    }
}

#[test]
fn in_a_thousand_encounters_no_player_pushes_an_npc_off_a_ledge() {
    let mut rng = ChaCha8Rng::seed_from_u64(20);
    let mut world = world();
    let mut pushed = 0;
    for encounter in 0..1000 {
        // It stands 0.3 to 1.5 m from one of the edges, and players come from anywhere on the deck, also two at once.
        let from_edge = rng.random_range(0.3..1.5);
        let along = rng.random_range(22.0..38.0);
        let place = match encounter % 4 {
            0 => Vec3::new(20.0 + from_edge, DECK, along),
            1 => Vec3::new(40.0 - from_edge, DECK, along),
            2 => Vec3::new(along, DECK, 20.0 + from_edge),
            _ => Vec3::new(along, DECK, 40.0 - from_edge),
        };
        let slot = world.spawn(place, rng.random_range(0.0..TAU));
        let players: Vec<(PlayerSlot, Vec3, Vec3)> = (0..1 + encounter % 2)
            .map(|_| {
                let direction = Body::at(place, rng.random_range(0.0..TAU)).facing();
                let start = place - direction * 2.0;
                let contact = if encounter % 5 == 0 { PlayerContact::Block } else { PlayerContact::Push };
                (world.spawn_player(player(start, contact)), start, direction * rng.random_range(1.0..9.0))
            })
            .collect();
        for tick in 0..60 {
            for (slot, start, velocity) in &players {
                world.move_player(*slot, *start + *velocity * (tick as f32 / 60.0), *velocity);
            }
            world.tick();
        }
        let npc = world.npc(slot).expect("it is there");
        assert!(npc.harm.is_none() && npc.body.feet.y > DECK - 0.1, "encounter {encounter}: {}", npc.body.feet);
        pushed += u32::from(npc.body.feet.distance(place) > 0.2);
        world.despawn(slot);
        players.iter().for_each(|(slot, ..)| assert!(world.remove_player(*slot)));
    }
    assert!(pushed > 300, "they do push: {pushed}");
}

#[test]
fn players_are_recorded_replayed_saved_and_restored() {
    let run = |world: &mut World, ticks: std::ops::Range<u32>| {
        for tick in ticks {
            if tick % 10 == 0 {
                world.decide(NPC, FORWARD);
            }
            world.move_player(PlayerSlot(0), Vec3::new(30.0, DECK, 27.0 + tick as f32 * 0.02), Vec3::Z * 1.2);
            world.tick();
        }
    };
    let begin = || {
        let mut world = world();
        world.spawn(Vec3::new(30.1, DECK, 24.0), 0.0);
        world.spawn_player(player(Vec3::new(30.0, DECK, 27.0), PlayerContact::Block));
        world
    };
    let mut whole = world();
    whole.start_recording();
    whole.spawn(Vec3::new(30.1, DECK, 24.0), 0.0);
    whole.spawn_player(player(Vec3::new(30.0, DECK, 27.0), PlayerContact::Block));
    run(&mut whole, 0..90);
    let mut half = begin();
    run(&mut half, 0..45);
    let mut restored = world();
    restored.restore(half.save());
    run(&mut restored, 45..90);
    assert_eq!(whole.save().hash(), restored.save().hash());
    let recording = Recording::decode(&whole.finish_recording().expect("it records").encode()).expect("sound");
    assert_eq!(recording.replay(whole.map().clone(), Some(Tick(50))).expect("the same").hash(), whole.save().hash());
}

#[test]
fn a_player_with_a_number_that_makes_no_sense_stays_where_it_is() {
    let mut world = world();
    let place = Vec3::new(30.0, DECK, 27.0);
    let slot = world.spawn_player(player(place, PlayerContact::Block));
    assert!(!world.move_player(slot, Vec3::new(f32::NAN, 0.0, 0.0), Vec3::ZERO));
    assert!(!world.move_player(slot, place, Vec3::new(0.0, f32::INFINITY, 0.0)));
    assert!(!world.move_player(PlayerSlot(7), place, Vec3::ZERO));
    assert_eq!(world.players().map(|(_, player)| player.feet).collect::<Vec<_>>(), [place]);
    assert!(world.remove_player(slot) && !world.remove_player(slot));
    for spoilt in [
        Player { radius: 0.0, ..player(place, PlayerContact::Block) },
        Player { height: 0.5, ..player(place, PlayerContact::Block) },
        Player { height: f32::NAN, ..player(place, PlayerContact::Block) },
    ] {
        assert!(!spoilt.is_sound());
    }
}
