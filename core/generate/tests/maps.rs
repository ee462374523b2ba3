//! The content and connectivity of maps, and that a spec always gives the same map.

use std::collections::BTreeMap;
use std::sync::Arc;
use surefoot_generate::Stage;
use surefoot_world::character::bodies::NamedBody;
use surefoot_world::map::{Features, MapKind, MapSize, MoverDensities, MoverKind, Placed};
use surefoot_world::mesh::{Surface, Triangle};
use surefoot_world::reach::{Means, Reach};
use surefoot_world::{
    Action, CharacterProfile, End, Map, MapSpec, MoverId, MoverOrder, StopIdx, TaskConfig, Vec3, World,
};

/// Hashes of the maps that a release generates; a change here changes every map and every graph.
const GOLDEN: [(u64, u32, &str, &str); 4] = [
    (0, 250, "paper", "cd6621b252ba1417"),
    (2000, 250, "paper", "8ed8b3bc750007be"),
    (7, 100, "all", "aa7dcba249c5383d"),
    (3, 50, "none", "a94f9b4ed2b7ec4c"),
];

fn spec(seed: u64, side: u32, features: &str) -> MapSpec {
    MapSpec::with_side(seed, side).unwrap().with(|it| it.features = features.parse().unwrap()).unwrap()
}

#[test]
fn released_specs_have_their_recorded_hashes_on_any_number_of_threads() {
    for (seed, side, features, hash) in GOLDEN {
        for thread_count in [1, 2, 5] {
            let map = surefoot_generate::generate_with(&spec(seed, side, features), thread_count, |_| {});
            assert_eq!(map.hash().to_string(), hash, "seed {seed}, {side} m, {features}, {thread_count} threads");
        }
    }
}

/// The same for the kinds of maps, 120 m wide with all features.
const GOLDEN_KINDS: [(MapKind, &str); 11] = [
    (MapKind::Terrain, "7761cf883d6d139a"),
    (MapKind::Islands, "9852106eb30f9467"),
    (MapKind::Interior, "5fef3889c91126b6"),
    (MapKind::Arena, "4708a80e0f4b684b"),
    (MapKind::Tower, "49b21596e020abe1"),
    (MapKind::Open, "16d614fb089b5ff8"),
    (MapKind::Keep, "aeba1648aa12ff23"),
    (MapKind::Flooded, "9d0984839f16e563"),
    (MapKind::Vents, "dc75cd8cdc09f2b1"),
    (MapKind::Rooftops, "a837f959e8c33cf2"),
    (MapKind::Canyon, "76c345774eade2d0"),
];

fn of_kind(kind: MapKind, seed: u64, side: u32) -> MapSpec {
    spec(seed, side, "all").with(|it| it.kind = kind).unwrap()
}

#[test]
fn each_kind_has_its_recorded_hash_on_any_number_of_threads() {
    let hashes = |threads| {
        GOLDEN_KINDS.map(|(kind, _)| {
            surefoot_generate::generate_with(&of_kind(kind, 11, 120), threads, |_| {}).hash().to_string()
        })
    };
    assert_eq!(hashes(1), GOLDEN_KINDS.map(|(_, hash)| hash.to_owned()));
    assert_eq!(hashes(2), GOLDEN_KINDS.map(|(_, hash)| hash.to_owned()));
}

#[test]
fn maps_of_every_kind_and_size_have_ground_that_is_connected_by_some_means() {
    for kind in MapKind::USUAL {
        for (seed, side, height) in [(1, 50, 40), (2, 140, 80), (3, 140, 200)] {
            let size = MapSize { width: side, height, depth: side };
            let map = surefoot_generate::generate(&of_kind(kind, seed, side).with(|it| it.size = size).unwrap());
            let reach = Reach::survey(&map, &CharacterProfile::default(), 2);
            let share = reach.share_by(|_| true);
            assert!(share > 0.85, "{} {seed}: {share}", kind.name());
        }
    }
}

#[test]
fn courses_are_connected_for_an_acrobat_and_not_without_its_moves() {
    let acrobat = NamedBody::find("acrobat").unwrap().profile();
    let mut shares = Vec::new();
    for kind in MapKind::COURSES {
        for (seed, side) in [(1, 60), (2, 100), (3, 140)] {
            let map = surefoot_generate::generate(&of_kind(kind, seed, side));
            let reach = Reach::survey(&map, &acrobat, 2);
            let share = reach.share_by(|_| true);
            let moves = [Means::Climb, Means::Swim, Means::WallRun, Means::OwnMove];
            let without = match kind {
                // The survey of bodies that cannot crouch knows no vents.
                MapKind::Vents => {
                    let tall = acrobat.with(|it| (it.crouch_height, it.slide_seconds) = (0.0, 0.0)).unwrap();
                    Reach::survey(&map, &tall, 2).share_by(|_| true)
                }
                _ => reach.share_by(|means| !moves.contains(&means)),
            };
            shares.push((kind.name(), seed, share, without));
        }
    }
    assert!(shares.iter().all(|(_, _, share, without)| *share > 0.9 && *without < 0.6), "{shares:#.2?}");
}

#[test]
fn what_walks_off_ground_that_is_not_terrain_falls_for_good() {
    for kind in [MapKind::Islands, MapKind::Tower, MapKind::Open] {
        let map = Arc::new(surefoot_generate::generate(&of_kind(kind, 5, 80)));
        let mut world = World::new(map.clone(), CharacterProfile::default(), TaskConfig::default());
        // Beyond the rim of what stands there.
        let slot = world.spawn(Vec3::new(1.0, map.extent().y, 1.0), 0.0);
        world.set_waypoint(slot, 0.5 * map.extent());
        let end = (0..200).find_map(|_| {
            world.decide(slot, Action::default());
            world.tick_decision();
            world.close_decision(slot).and_then(|outcome| outcome.end)
        });
        assert_eq!(end, Some(End::Fell), "{}", kind.name());
    }
}

#[test]
fn generation_reports_its_stages_in_order() {
    for kind in [MapKind::Terrain, MapKind::Arena] {
        let mut stages = Vec::new();
        surefoot_generate::generate_with(&of_kind(kind, 1, 60), 1, |stage| stages.push(stage));
        assert_eq!(stages, Stage::ALL);
    }
}

#[test]
fn each_feature_can_be_left_out_and_put_in() {
    type Count = fn(&Placed) -> usize;
    let counts: [(&str, Count); 9] = [
        ("plateaus", |placed| placed.plateaus.len()),
        ("buildings", |placed| placed.buildings.len()),
        ("water", |placed| placed.pools.len()),
        ("lava", |placed| placed.pools.len()),
        ("zip_lines", |placed| placed.zip_lines.len()),
        ("ravines", |placed| placed.ravines.len()),
        ("caves", |placed| placed.caves.len()),
        ("teleporters", |placed| placed.teleporters.len()),
        ("jetpacks", |placed| placed.jetpacks.len()),
    ];
    let bare = surefoot_generate::generate(&spec(5, 150, "none"));
    assert_eq!(*bare.placed(), Placed::default());
    for (name, count) in counts {
        let map = surefoot_generate::generate(&spec(5, 150, &format!("none,{name}=2")));
        assert!(count(map.placed()) > 0, "no {name}");
        assert_ne!(map.hash(), bare.hash());
    }
    // Pads are placed at the foot of cliffs and wherever ground is cut off.
    assert!(!surefoot_generate::generate(&spec(5, 150, "none,pads")).placed().pads.is_empty());
}

#[test]
fn lists_of_features_are_read_and_mistakes_named() {
    let read = |text: &str| text.parse::<Features>();
    assert_eq!(read("paper").unwrap(), Features::default());
    assert_eq!(read("none,lava=2").unwrap(), Features { lava: 2.0, ..Features::none() });
    assert_eq!(
        read("all, cave").unwrap_err(),
        "no feature `cave`; there are plateaus, buildings, water, lava, \
        pads, zip_lines, ravines, caves, teleporters, jetpacks"
    );
    assert!(read("all,lava=9").unwrap_err().contains("lava is 9"));
    assert!(read("lava=1,all").unwrap_err().contains("only come first"));
    assert!(read("lava=much").unwrap_err().contains("much"));
}

#[test]
fn most_of_a_map_is_cut_off_on_foot_and_connected_by_all_means() {
    let profile = CharacterProfile::default();
    let mut on_foot = Vec::new();
    for seed in (0..8).chain(1000..1004).chain(2000..2004) {
        let map = surefoot_generate::generate(&MapSpec::new(seed));
        let reach = Reach::survey(&map, &profile, 2);
        let all = reach.share_by(|_| true);
        assert!(all >= 0.95, "map {seed}: {all}");
        on_foot.push(reach.share_on_foot());
    }
    on_foot.sort_by(f64::total_cmp);
    assert!(on_foot[on_foot.len() / 2] <= 0.35, "{on_foot:?}");
}

fn quad(corners: [[f32; 3]; 4]) -> Vec<Triangle> {
    let [a, b, c, d] = corners.map(Vec3::from);
    [[a, b, c], [a, c, d]].into_iter().filter_map(|corners| Triangle::new(corners, Surface::Ground)).collect()
}

/// Two floors side by side, the right one `step` metres higher, `gap` metres apart.
fn two_floors(step: f32, gap: f32) -> Map {
    let (y0, y1) = (10.0, 10.0 + step);
    let (x0, x1) = (25.0, 25.0 + gap);
    let mut triangles = quad([[0.0, y0, 0.0], [0.0, y0, 50.0], [x0, y0, 50.0], [x0, y0, 0.0]]);
    triangles.extend(quad([[x1, y1, 0.0], [x1, y1, 50.0], [50.0, y1, 50.0], [50.0, y1, 0.0]]));
    // The side faces of both floors, down to nothing.
    triangles.extend(quad([[x0, 0.0, 0.0], [x0, y0, 0.0], [x0, y0, 50.0], [x0, 0.0, 50.0]]));
    triangles.extend(quad([[x1, 0.0, 50.0], [x1, y1, 50.0], [x1, y1, 0.0], [x1, 0.0, 0.0]]));
    Map::from_parts(MapSize { width: 50, height: 40, depth: 50 }, triangles, Placed::default())
}

/// The least demanding means that lead from the lower floor to the higher one and back.
fn means(map: &Map, profile: &CharacterProfile) -> (usize, Option<Means>, Option<Means>) {
    let reach = Reach::survey(map, profile, 2);
    let islands = reach.ground.islands().len();
    let at = |x: f32, y: f32| reach.ground.at(Vec3::new(x, y, 25.0)).map(|cell| cell.island);
    let high = (10..=20).find_map(|y| at(40.0, y as f32));
    let (low, high) = (at(10.0, 10.0).unwrap(), high.unwrap());
    let link =
        |from, to| reach.links.iter().filter(|link| (link.from, link.to) == (from, to)).map(|link| link.means).min();
    (islands, link(low, high), link(high, low))
}

#[test]
fn a_jump_counts_only_where_the_body_makes_it() {
    let profile = CharacterProfile::default();
    use Means::{DoubleJump, Drop, Jump};
    let cases = [
        // step, gap: islands, up, down
        (0.05, 0.0, 1, None, None),
        (1.5, 0.0, 2, Some(Jump), Some(Drop)),
        (4.0, 0.0, 2, Some(DoubleJump), Some(Drop)),
        (5.6, 0.0, 2, None, Some(Drop)),
        (0.0, 6.0, 2, Some(Jump), Some(Jump)),
        (0.0, 40.0, 1, None, None),
    ];
    for (step, gap, islands, up, down) in cases {
        if gap > 20.0 {
            continue;
        }
        let found = means(&two_floors(step, gap), &profile);
        assert_eq!(found, (islands, up, down), "step {step}, gap {gap}");
    }
    let weak = CharacterProfile::default().with(|it| it.extra_jumps = 0).unwrap();
    assert_eq!(means(&two_floors(4.0, 0.0), &weak), (2, None, Some(Drop)));
}

#[test]
fn a_map_without_a_place_to_stand_has_nothing_connected() {
    let wall = quad([[25.0, 0.0, 0.0], [25.0, 30.0, 0.0], [25.0, 30.0, 50.0], [25.0, 0.0, 50.0]]);
    let map = Map::from_parts(MapSize { width: 50, height: 40, depth: 50 }, wall, Placed::default());
    let reach = Reach::survey(&map, &CharacterProfile::default(), 2);
    assert_eq!((reach.ground.cells().len(), reach.share_on_foot(), reach.share_by(|_| true)), (0, 0.0, 0.0));
}

/// A spec with movers of all kinds.
fn furnished(kind: MapKind, seed: u64, side: u32) -> MapSpec {
    of_kind(kind, seed, side).with(|it| it.movers = MoverDensities::all()).unwrap()
}

#[test]
fn movers_are_placed_where_there_is_room_and_change_nothing_else() {
    let mut found = BTreeMap::new();
    for kind in MapKind::all() {
        let spec = furnished(kind, 1, 200);
        let map = surefoot_generate::generate_with(&spec, 2, |_| {});
        if kind == MapKind::Arena {
            assert_eq!(map.hash(), surefoot_generate::generate_with(&spec, 1, |_| {}).hash(), "the same on one thread");
        }
        let plain = surefoot_generate::generate_with(&of_kind(kind, 1, 200), 2, |_| {});
        assert_eq!(map.placed(), plain.placed());
        let corners = |map: &Map| map.mesh().triangles().iter().map(|it| it.corners()).collect::<Vec<_>>();
        assert_eq!(corners(&map), corners(&plain));
        for mover in map.movers() {
            *found.entry(mover.kind).or_insert(0) += 1;
            let (low, high) = mover.bounds_at(0);
            let middle = Vec3::new(0.5 * (low.x + high.x), high.y + 0.1, 0.5 * (low.z + high.z));
            assert_eq!(map.mesh().solid_depth_at(middle), 0, "{} of {kind:?} is buried", mover.name);
        }
    }
    for (kind, least) in [
        (MoverKind::Door, 6),
        (MoverKind::Lift, 8),
        (MoverKind::Platform, 2),
        (MoverKind::Floor, 6),
        (MoverKind::Conveyor, 6),
        (MoverKind::Crate, 30),
    ] {
        let count = found.get(&kind).copied().unwrap_or(0);
        assert!(count >= least, "{kind:?}: {count} on all maps");
    }
}

#[test]
fn lifts_that_were_placed_carry_bodies_to_ground_that_is_higher() {
    let map = Arc::new(surefoot_generate::generate(
        &spec(1, 250, "all").with(|it| it.movers = "lifts=2".parse().unwrap()).unwrap(),
    ));
    let profile = CharacterProfile::default();
    let lifts: Vec<usize> = (0..map.movers().len()).filter(|idx| map.movers()[*idx].kind == MoverKind::Lift).collect();
    assert!(!lifts.is_empty());
    let mut world = World::new(map.clone(), profile.clone(), TaskConfig::default());
    let riders: Vec<_> = lifts
        .iter()
        .map(|idx| {
            let (low, high) = map.movers()[*idx].bounds_at(0);
            let middle = (low + high) * 0.5;
            (*idx, world.spawn(Vec3::new(middle.x, high.y + 0.02, middle.z), 0.0))
        })
        .collect();
    for (idx, rider) in riders {
        world.order(MoverId(idx as u16), MoverOrder::GoTo(StopIdx(1)));
        (0..600).for_each(|_| world.tick());
        let (low, high) = map.movers()[idx].bounds_at(1);
        let body = &world.npc(rider).unwrap().body;
        assert!(body.is_grounded() && (body.feet.y - high.y).abs() < 0.1, "{}: {}", map.movers()[idx].name, body.feet);
        let half = 0.5 * (high.x - low.x);
        let mut scratch = surefoot_world::character::MoveScratch::default();
        let ashore = [Vec3::X, Vec3::NEG_X, Vec3::Z, Vec3::NEG_Z].iter().any(|side| {
            let mut beside = [0.5, 1.0, 1.5].iter().map(|gap| body.feet + *side * (half + gap));
            beside.any(|at| surefoot_world::navigable::stand_at(&map, &profile, at, 0.8, &mut scratch).is_some())
        });
        assert!(ashore, "{} leads to ground", map.movers()[idx].name);
    }
}

#[test]
fn maps_that_are_not_repaired_have_no_pads_of_the_repair() {
    let pads = |repair: bool| {
        let spec = spec(1000, 250, "none,zip_lines=0").with(|it| it.repair = repair).unwrap();
        let map = surefoot_generate::generate(&spec);
        let share = Reach::survey(&map, &CharacterProfile::default(), 2).share_by(|_| true);
        (map.placed().pads.len() + map.placed().zip_lines.len(), share)
    };
    let with_pads = |repair: bool| {
        let spec = spec(1000, 250, "none,pads=0.01").with(|it| it.repair = repair).unwrap();
        let map = surefoot_generate::generate(&spec);
        (map.placed().pads.len(), Reach::survey(&map, &CharacterProfile::default(), 2).share_by(|_| true))
    };
    assert_eq!(pads(false).0, 0);
    let (repaired, bare) = (with_pads(true), with_pads(false));
    assert!(repaired.0 > bare.0 && repaired.1 > bare.1, "{repaired:?} {bare:?}");
}
