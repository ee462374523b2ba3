//! Pieces that are put onto a map: rays, contacts, the survey and saved maps know them, and NPCs make room for them.

use crate::stage::{FORWARD, NPC, cases};
use proptest::prelude::*;
use rand::rngs::ChaCha8Rng;
use rand::{RngExt, SeedableRng};
use std::collections::BTreeSet;
use std::sync::{Arc, LazyLock};
use surefoot_world::map::{Features, Liquid, MapSize, Outline, Piece, PieceShape, Placed, Pool};
use surefoot_world::mesh::{Surface, Triangle};
use surefoot_world::reach::Reach;
use surefoot_world::replay::Recording;
use surefoot_world::{CharacterProfile, End, Map, MapSpec, NpcSlot, OBSERVATION_LEN, TaskConfig, Tick, Vec3, World};

const GROUND: f32 = 1.0;

fn terrain() -> Map {
    let spec = MapSpec::with_side(5, 100).unwrap().with(|spec| spec.features = Features::all()).unwrap();
    surefoot_generate::generate(&spec)
}

/// Two floors of 18 x 40 m with a gap of 4 m between them, over a void.
fn floors() -> Map {
    let floor = |from: f32, to: f32| {
        let [a, b, c, d] = [[0.0, from], [0.0, to], [40.0, to], [40.0, from]].map(|[x, z]| Vec3::new(x, GROUND, z));
        [[a, b, c], [a, c, d]].into_iter().filter_map(|corners| Triangle::new(corners, Surface::Ground))
    };
    let triangles = floor(0.0, 18.0).chain(floor(22.0, 40.0)).collect();
    Map::from_parts(MapSize { width: 40, height: 30, depth: 40 }, triangles, Placed::default())
}

/// A floor of two triangles.
fn floor() -> Map {
    let [a, b, c, d] = [[0.0, 0.0], [0.0, 40.0], [40.0, 40.0], [40.0, 0.0]].map(|[x, z]| Vec3::new(x, GROUND, z));
    let triangles = [[a, b, c], [a, c, d]].into_iter().filter_map(|corners| Triangle::new(corners, Surface::Ground));
    Map::from_parts(MapSize { width: 40, height: 30, depth: 40 }, triangles.collect(), Placed::default())
}

fn piece(name: &str, shape: PieceShape) -> Piece {
    Piece { name: name.to_owned(), shape }
}

fn block(name: &str, foot: Vec3, half: f32, height: f32) -> Piece {
    piece(name, PieceShape::Block { foot, half: [half, half], height, yaw: 0.3 })
}

fn bridge() -> Piece {
    let (from, to) = (Vec3::new(20.0, GROUND + 0.1, 17.0), Vec3::new(20.0, GROUND + 0.1, 23.0));
    piece("bridge", PieceShape::Plank { from, to, width: 4.0, thickness: 0.3 })
}

fn lava(centre: Vec3) -> Piece {
    let pool = Pool { centre, outline: Outline::Round { radius: 2.0 }, depth: 1.0, liquid: Liquid::Lava };
    piece("lava", PieceShape::Pool(pool))
}

fn some(extent: Vec3) -> Vec<Piece> {
    let mut rng = ChaCha8Rng::seed_from_u64(4);
    let mut place = || {
        Vec3::new(
            rng.random_range(10.0..extent.x - 10.0),
            rng.random_range(20.0..50.0),
            rng.random_range(10.0..extent.z - 10.0),
        )
    };
    let mut pieces: Vec<Piece> = (0..12).map(|idx| block(&format!("block {idx}"), place(), 3.0, 4.0)).collect();
    for idx in 0..6 {
        let (from, to) = (place(), place());
        pieces.push(piece(&format!("plank {idx}"), PieceShape::Plank { from, to, width: 3.0, thickness: 0.4 }));
    }
    pieces
}

/// The map rebuilt from all its triangles.
fn rebuilt(map: &Map) -> Map {
    let solid = map.mesh().triangles().iter().filter(|triangle| triangle.surface().is_solid()).copied();
    Map::from_parts(map.size(), solid.collect(), map.placed().clone())
}

#[test]
fn an_edited_map_is_that_of_all_its_triangles() {
    let plain = terrain();
    let edited = plain.with_pieces(some(plain.extent())).unwrap();
    let whole = rebuilt(&edited);
    assert_eq!(edited.mesh().triangles().len(), whole.mesh().triangles().len());
    let mut rng = ChaCha8Rng::seed_from_u64(9);
    let (mut hits, mut others) = (0, 0);
    for _ in 0..6000 {
        let from = Vec3::new(rng.random_range(0.0..100.0), rng.random_range(5.0..60.0), rng.random_range(0.0..100.0));
        let way =
            Vec3::new(rng.random_range(-1.0..1.0f32), rng.random_range(-1.0..1.0f32), rng.random_range(-1.0..1.0f32));
        let ray = |map: &Map| map.mesh().cast_ray(from, way.normalize(), 60.0).map(|hit| (hit.distance, hit.surface));
        match (ray(&edited), ray(&whole)) {
            (Some((one, on)), Some((other, of))) => {
                assert!((one - other).abs() < 1.0e-3 && on == of, "{one} and {other} m from {from:?}");
                hits += 1;
            }
            (one, other) => assert_eq!(one.is_some(), other.is_some(), "from {from:?} along {way:?}"),
        }
        others += usize::from(ray(&plain) != ray(&edited));
        assert_eq!(edited.mesh().solid_depth_at(from), whole.mesh().solid_depth_at(from), "{from:?}");
    }
    assert!(hits > 2000 && others > 200, "{hits} hits, {others} of them on pieces");

    // Bodies move, and see, as they do there.
    let worlds = [Arc::new(edited), Arc::new(whole)].map(|map| {
        let mut world = World::new(map.clone(), CharacterProfile::default(), TaskConfig::default());
        let mut rng = ChaCha8Rng::seed_from_u64(2);
        let places = surefoot_world::navigable::sample_many(&map, &CharacterProfile::default(), 64, &mut rng).unwrap();
        for (idx, place) in (0..).zip(places) {
            let slot = world.spawn(place, idx as f32);
            world.set_waypoint(slot, place + Vec3::X);
            world.decide(slot, FORWARD);
        }
        (0..300).for_each(|_| world.tick());
        world
    });
    let mut rows = [vec![0.0; OBSERVATION_LEN], vec![0.0; OBSERVATION_LEN]];
    for (slot, npc) in worlds[0].npcs() {
        assert_eq!(npc.body.feet, worlds[1].npc(slot).unwrap().body.feet);
        rows.iter_mut().zip(&worlds).for_each(|(row, world)| _ = world.observe(slot, row));
        let farthest = rows[0].iter().zip(&rows[1]).map(|(one, other)| (one - other).abs()).fold(0.0, f32::max);
        assert!(farthest < 1.0e-4, "NPC {} sees something else, by {farthest}", slot.0);
    }
}

/// The maps of the properties, from two triangles to thousands.
static MAPS: LazyLock<[Map; 4]> = LazyLock::new(|| {
    let small = MapSpec::with_side(8, 60).unwrap().with(|spec| spec.features = Features::all()).unwrap();
    [floor(), floors(), surefoot_generate::generate(&small), terrain()]
});

/// A place in or just outside of a map, as shares of its extent.
fn share() -> impl Strategy<Value = Vec3> {
    // Half of them at the height of the floors.
    let height = prop_oneof![Just(GROUND / 30.0), -0.02..1.02f32];
    (-0.02..1.02f32, height, -0.02..1.02f32).prop_map(Vec3::from)
}

/// Blocks and planks at shares of a map's extent.
fn shapes() -> impl Strategy<Value = Vec<PieceShape>> {
    let side = || prop::sample::select(vec![0.05f32, 0.2, 1.0, 2.0, 5.0, 17.0]);
    let yaw = prop::sample::select(vec![0.0, 0.3, 1.0, std::f32::consts::FRAC_PI_4, -2.5]);
    let block = (share(), side(), side(), side(), yaw).prop_map(|(foot, x, z, height, yaw)| PieceShape::Block {
        foot,
        half: [x, z],
        height,
        yaw,
    });
    let plank = (share(), share(), side(), side()).prop_map(|(from, to, width, thickness)| PieceShape::Plank {
        from,
        to,
        width,
        thickness,
    });
    prop::collection::vec(prop_oneof![2 => block, 1 => plank], 1..14)
}

/// The pieces of these shapes that fit onto a map.
fn pieces_on(map: &Map, shapes: Vec<PieceShape>) -> Vec<Piece> {
    let place = |share: Vec3| share * map.extent();
    let shapes = shapes.into_iter().map(|shape| match shape {
        PieceShape::Block { foot, half, height, yaw } => PieceShape::Block { foot: place(foot), half, height, yaw },
        PieceShape::Plank { from, to, width, thickness } => {
            PieceShape::Plank { from: place(from), to: place(to), width, thickness }
        }
        shape @ PieceShape::Pool(_) => shape,
    });
    let named = shapes.enumerate().map(|(idx, shape)| piece(&idx.to_string(), shape));
    named.filter(|piece| map.with_pieces(vec![piece.clone()]).is_ok()).collect()
}

type Corners = [[u32; 3]; 3];

/// The triangles that a map gathers for a box and that pass through it, by the bits of their corners, which must be
/// each once.
fn gathered(map: &Map, low: Vec3, high: Vec3) -> Vec<Corners> {
    let mut found = vec![u32::MAX; 3];
    map.mesh().gather_solids(low, high, &mut found);
    assert!(found.is_sorted_by(|one, other| one < other), "{found:?}");
    let triangles = found.iter().map(|idx| map.mesh().triangles()[*idx as usize]);
    let mut corners: Vec<Corners> = triangles
        .filter(|triangle| passes_through(triangle, low, high))
        .map(|triangle| triangle.corners().map(|corner| corner.to_array().map(f32::to_bits)))
        .collect();
    corners.sort_unstable();
    corners
}

/// Whether the plane of a triangle passes through the part of a box that lies in the triangle's bounds.
fn passes_through(triangle: &Triangle, low: Vec3, high: Vec3) -> bool {
    let corners = triangle.corners();
    let bounds = (corners[0].min(corners[1]).min(corners[2]), corners[0].max(corners[1]).max(corners[2]));
    let (low, high) = (low.max(bounds.0), high.min(bounds.1));
    let (middle, half) = ((low + high) * 0.5, (high - low) * 0.5);
    let reach = triangle.normal().abs().dot(half);
    low.cmple(high).all() && triangle.normal().dot(middle - corners[0]).abs() <= reach
}

proptest! {
    #![proptest_config(cases(200))]

    #[test]
    fn an_edited_map_gathers_what_a_map_built_of_the_same_triangles_gathers(
        map in prop::sample::select(vec![0, 0, 0, 0, 1, 1, 2, 3]),
        shapes in shapes(),
        boxes in prop::collection::vec((share(), any::<prop::sample::Index>(), 0.0..2.0f32), 1..40),
        rays in prop::collection::vec((share(), share()), 1..20),
    ) {
        let plain = &MAPS[map];
        let pieces = pieces_on(plain, shapes);
        let edited = plain.with_pieces(pieces).unwrap();
        let whole = rebuilt(&edited);
        let solid = || edited.mesh().triangles().iter().filter(|triangle| triangle.surface().is_solid());
        let triangles: Vec<&Triangle> = solid().collect();
        for (at, triangle, half) in boxes {
            // Somewhere, and where a body would stand.
            let [a, b, c] = triangles[triangle.index(triangles.len())].corners();
            let middle = if half < 0.5 { at * plain.extent() } else { a + (b - a) * at.x + (c - b) * (at.x * at.z) };
            let (low, high) = (middle - half, middle + half);
            let expected: BTreeSet<Corners> = solid()
                .filter(|triangle| passes_through(triangle, low, high))
                .map(|triangle| triangle.corners().map(|corner| corner.to_array().map(f32::to_bits)))
                .collect();
            let found = gathered(&edited, low, high);
            prop_assert_eq!(&found, &gathered(&whole, low, high));
            prop_assert_eq!(found.into_iter().collect::<BTreeSet<_>>(), expected);
        }
        for (from, to) in rays {
            // What reaches out of a map is not seen from its border or from outside.
            let inside = |share: Vec3| share.clamp(Vec3::splat(0.001), Vec3::splat(0.999)) * plain.extent();
            let [from, to] = [from, to].map(inside);
            let Some(direction) = (to - from).try_normalize() else { continue };
            let most = to.distance(from);
            let ray = |map: &Map| map.mesh().cast_ray(from, direction, most).filter(|hit| hit.surface.is_solid());
            match (ray(&edited), ray(&whole)) {
                (Some(one), Some(other)) => prop_assert!((one.distance - other.distance).abs() < 1.0e-3),
                (one, other) => prop_assert!(one.is_some() == other.is_some(), "{one:?} and {other:?} from {from}"),
            }
        }
    }
}

#[test]
fn bodies_stand_on_a_block_that_lies_on_a_floor_of_two_triangles() {
    let middle = Vec3::new(20.0, GROUND, 20.0);
    for yaw in [0.0, 0.3, std::f32::consts::FRAC_PI_4, 1.0] {
        let shape = PieceShape::Block { foot: middle, half: [5.0, 5.0], height: 0.2, yaw };
        let map = Arc::new(floor().with_pieces(vec![piece("block", shape)]).unwrap());
        let mut world = World::new(map, CharacterProfile::default(), TaskConfig::default());
        let (sin, cos) = libm::sincosf(yaw);
        for idx in 0..144 {
            let [x, z] = [idx % 12, idx / 12].map(|step| (step as f32 - 5.5) * 0.8);
            world.spawn(middle + Vec3::new(x * cos + z * sin, 0.2, z * cos - x * sin), 0.0);
        }
        (0..120).for_each(|_| world.tick());
        for (slot, npc) in world.npcs() {
            let height = npc.body.feet.y - GROUND;
            assert!((height - 0.2).abs() < 0.01, "NPC {} at {height} m, yaw {yaw}, {}", slot.0, npc.body.feet);
        }
    }
}

#[test]
fn pieces_come_and_go_and_the_hash_tells() {
    let plain = terrain();
    let pieces = some(plain.extent());
    let edited = plain.with_pieces(pieces.clone()).unwrap();
    let backwards = plain.with_pieces(pieces.iter().rev().cloned().collect()).unwrap();
    assert_eq!(edited.hash(), backwards.hash());
    assert_ne!(edited.hash(), plain.hash());
    assert_eq!(edited.built_hash(), plain.hash());
    assert_ne!(edited.with_pieces(pieces[1..].to_vec()).unwrap().hash(), edited.hash());
    let restored = edited.with_pieces(Vec::new()).unwrap();
    assert_eq!((restored.hash(), restored.mesh().triangles().len()), (plain.hash(), plain.mesh().triangles().len()));

    let decoded = surefoot_levels::decode(&surefoot_levels::encode(&edited)).unwrap();
    assert_eq!((decoded.hash(), decoded.pieces()), (edited.hash(), edited.pieces()));
}

#[test]
fn the_survey_goes_over_a_bridge_and_round_a_wall() {
    let profile = CharacterProfile::default();
    let islands = |map: &Map| Reach::survey(map, &profile, 1).ground.islands().len();
    let plain = floors();
    assert_eq!(islands(&plain), 2);
    assert_eq!(islands(&plain.with_pieces(vec![bridge()]).unwrap()), 1);
    let wall = PieceShape::Block { foot: Vec3::new(20.0, GROUND, 10.0), half: [20.0, 0.3], height: 12.0, yaw: 0.0 };
    let walled = plain.with_pieces(vec![piece("wall", wall)]).unwrap();
    assert!(Reach::survey(&walled, &profile, 1).share_on_foot() < 0.4, "one floor in two parts, besides the other");
}

#[test]
fn lava_that_is_poured_out_burns() {
    let plain = Arc::new(floors());
    let mut world = World::new(plain.clone(), CharacterProfile::default(), TaskConfig::default());
    let at = Vec3::new(10.0, GROUND, 10.0);
    world.spawn(at, 0.0);
    (0..30).for_each(|_| world.tick());
    assert_eq!(world.npc(NPC).unwrap().harm, None);
    world.edit(Arc::new(plain.with_pieces(vec![lava(at + Vec3::Y * 0.3)]).unwrap())).unwrap();
    world.tick();
    assert_eq!(world.npc(NPC).unwrap().harm, Some(End::Burnt));
}

#[test]
fn who_would_be_enclosed_steps_aside_and_the_run_can_be_repeated() {
    let plain = Arc::new(floors());
    let mut world = World::new(plain.clone(), CharacterProfile::default(), TaskConfig::default());
    let spots = [Vec3::new(10.0, GROUND, 10.0), Vec3::new(11.0, GROUND, 10.5), Vec3::new(30.0, GROUND, 30.0)];
    for spot in spots {
        let slot = world.spawn(spot, 0.0);
        world.set_waypoint(slot, Vec3::new(20.0, GROUND, 36.0));
    }
    (0..20).for_each(|_| world.tick());
    world.start_recording();
    let built = block("block", spots[0], 1.5, 3.0);
    let edited = Arc::new(plain.with_pieces(vec![built.clone(), bridge()]).unwrap());
    assert_eq!(world.edit(edited.clone()).unwrap(), [NpcSlot(0), NpcSlot(1)]);
    for (slot, npc) in world.npcs().take(2) {
        assert!(edited.mesh().solid_depth_at(npc.body.feet + Vec3::Y) == 0, "NPC {} is enclosed", slot.0);
        assert!(npc.body.feet.distance(spots[slot.0 as usize]) < 5.0 && npc.episode.is_some());
    }
    for slot in 0..3 {
        world.decide(NpcSlot(slot), FORWARD);
    }
    (0..700).for_each(|_| world.tick());
    world.edit(plain.clone()).unwrap();
    (0..20).for_each(|_| world.tick());
    let recording = world.finish_recording().unwrap();
    let recording = Recording::decode(&recording.encode()).unwrap();
    let end = recording.replay(plain.clone(), Some(Tick(300))).unwrap();
    assert_eq!(end.hash(), world.save().hash());

    // A recording that begins on an edited map is repeated on the map that it was made of.
    world.edit(edited).unwrap();
    world.start_recording();
    (0..20).for_each(|_| world.tick());
    let recording = world.finish_recording().unwrap();
    recording.replay(plain, None).unwrap();
}

#[test]
fn nobody_is_walled_in() {
    let plain = Arc::new(floors());
    let mut world = World::new(plain.clone(), CharacterProfile::default(), TaskConfig::default());
    world.spawn(Vec3::new(20.0, GROUND, 8.0), 0.0);
    // As high as the map: there is no place on top of it.
    let huge = PieceShape::Block { foot: Vec3::new(20.0, GROUND, 8.0), half: [9.0, 7.5], height: 29.6, yaw: 0.0 };
    let before = world.save();
    let refused = world.edit(Arc::new(plain.with_pieces(vec![piece("huge", huge)]).unwrap())).unwrap_err();
    assert!(refused.to_string().contains("NPC 0"), "{refused}");
    assert_eq!((world.save(), world.map().hash()), (before, plain.hash()));
}

#[test]
fn pieces_that_cannot_be_are_refused() {
    let plain = floors();
    let at = Vec3::new(10.0, GROUND, 10.0);
    let refuse = |pieces: Vec<Piece>, expected: &str| {
        let error = plain.with_pieces(pieces).expect_err(expected).to_string();
        assert!(error.contains(expected), "{error}");
    };
    refuse(vec![block("", at, 1.0, 1.0)], "1 to 64 bytes");
    refuse(vec![block("twin", at, 1.0, 1.0), block("twin", at, 2.0, 1.0)], "two pieces `twin`");
    refuse(vec![block("flat", at, 1.0, f32::NAN)], "the height of the piece `flat` is NaN");
    refuse(vec![block("thin", at, 0.0, 1.0)], "the width of the piece `thin` is 0");
    refuse(vec![block("nowhere", at.with_x(f32::NAN), 1.0, 1.0)], "not a finite number");
    refuse(vec![block("far", at.with_x(400.0), 1.0, 1.0)], "reaches out of the map");
    for depth in [1.1e3, 1.0e30, 3.0e38] {
        let shape = PieceShape::Plank { from: at.with_y(-depth), to: at + Vec3::X, width: 1.0, thickness: 0.2 };
        refuse(vec![piece("deep", shape)], "reaches out of the map");
        let pool = Pool { centre: at, outline: Outline::Round { radius: 2.0 }, depth: 1.0, liquid: Liquid::Lava };
        refuse(vec![piece("pool", PieceShape::Pool(Pool { centre: at.with_y(-depth), ..pool }))], "reaches out");
    }
    let shape = PieceShape::Plank { from: at, to: at + Vec3::Y * 5.0, width: 1.0, thickness: 0.2 };
    refuse(vec![piece("upright", shape)], "horizontal length of the piece `upright`");
    let wide = |idx: u32| {
        let shape = PieceShape::Block { foot: Vec3::new(500.0, 1.0, 500.0), half: [500.0; 2], height: 1.0, yaw: 0.0 };
        piece(&idx.to_string(), shape)
    };
    let size = MapSize { width: 1000, height: 30, depth: 1000 };
    let large = Map::from_parts(size, Vec::new(), Placed::default());
    assert!(large.with_pieces((0..20).map(wide).collect()).is_ok());
    let error = large.with_pieces((0..21).map(wide).collect()).unwrap_err().to_string();
    assert!(error.contains("21000000 m2"), "{error}");
    refuse((0..1025).map(|idx| block(&idx.to_string(), at, 1.0, 1.0)).collect(), "1025 pieces");
}
