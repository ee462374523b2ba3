//! Maps as bytes: saved, imported and exported maps, and the errors for bytes that are none of these.

mod compressed;
mod meanings;
mod obj_files;
mod reading;

use rand::rngs::ChaCha8Rng;
use rand::{RngExt, SeedableRng};
use serde_json::{Value, json};
use std::sync::Arc;
use surefoot_levels::{
    GeometryCounts, ImportError, ImportOptions, Imported, NoFiles, Role, UpAxis, Warning, role_counts,
};
use surefoot_world::map::mover::cuboid;
use surefoot_world::map::{Jetpack, Liquid, MapSize, MoverKind, Outline, Pad, Placed, Pool, Spot, Teleporter, ZipLine};
use surefoot_world::mesh::{Surface, Triangle};
use surefoot_world::{Action, CharacterProfile, End, Map, MapSpec, TaskConfig, Vec3, World};

const PLAIN: ImportOptions =
    ImportOptions { scale: 1.0, up: UpAxis::Y, keep_sides: false, ignore_names: false, all_scenes: false };

fn generated(seed: u64) -> Map {
    surefoot_generate::generate(&MapSpec::with_side(seed, 60).unwrap())
}

/// A floor of 30 x 30 m at a height of 1 m, with two features of every kind.
fn small_map() -> Map {
    let [a, b, c, d] = [[0.0, 0.0], [0.0, 30.0], [30.0, 30.0], [30.0, 0.0]].map(|[x, z]| Vec3::new(x, 1.0, z));
    let triangles = [[a, b, c], [a, c, d]].into_iter().filter_map(|t| Triangle::new(t, Surface::Ground)).collect();
    let at = |x: f32, z: f32| Vec3::new(x, 1.0, z);
    let rectangle = Outline::Rectangle { half_x: 2.0, half_z: 1.5 };
    let spot = |tag: &str, from, to, two_way| Spot { tag: tag.to_owned(), from, to, two_way };
    let teleporter = |x: f32, two_way| Teleporter { from: at(x, 10.0), to: at(x, 14.0), two_way };
    let placed = Placed {
        pools: vec![
            Pool { centre: at(5.0, 5.0), outline: rectangle, depth: 0.5, liquid: Liquid::Water },
            Pool { centre: at(12.0, 5.0), outline: Outline::Round { radius: 2.5 }, depth: 0.75, liquid: Liquid::Lava },
        ],
        pads: vec![Pad { centre: at(20.0, 5.0), speed: 23.7 }, Pad { centre: at(25.0, 5.0), speed: 15.0 }],
        zip_lines: vec![
            ZipLine { from: at(3.0, 20.0), to: at(9.0, 20.0) },
            ZipLine { from: at(3.0, 24.0), to: at(9.0, 24.0) },
        ],
        teleporters: vec![teleporter(5.0, false), teleporter(10.0, true)],
        jetpacks: vec![Jetpack { centre: at(20.0, 20.0), fuel: 2.5 }, Jetpack { centre: at(25.0, 20.0), fuel: 4.25 }],
        spots: vec![
            spot("anchor", at(15.0, 25.0), None, false),
            spot("spawn", at(16.0, 26.0), None, false),
            spot("rope_slide", at(15.0, 20.0), Some(at(18.0, 24.0)), true),
            spot("vault", at(10.0, 26.0), Some(at(12.0, 26.0)), false),
        ],
        ..Placed::default()
    };
    Map::from_parts(MapSize { width: 30, height: 25, depth: 30 }, triangles, placed)
}

/// The message of the error that is expected.
fn refusal<T, E: std::fmt::Display>(result: Result<T, E>, expected: &str) -> String {
    match result {
        Ok(_) => panic!("accepted, but `{expected}` was expected"),
        Err(error) => error.to_string(),
    }
}

// Saved maps.

#[test]
fn a_saved_map_comes_back_with_the_same_bits() {
    for map in [generated(3), small_map()] {
        let bytes = surefoot_levels::encode(&map);
        let back = surefoot_levels::decode(&bytes).expect("what was just saved");
        assert_eq!(back.hash(), map.hash());
        assert_eq!(back.spec(), map.spec());
        assert_eq!(back.size(), map.size());
        assert_eq!(back.placed(), map.placed());
        for (one, other) in back.mesh().triangles().iter().zip(map.mesh().triangles()) {
            assert_eq!(format!("{one:?}"), format!("{other:?}"));
        }
        assert_eq!(surefoot_levels::encode(&back), bytes);
    }
}

#[test]
fn a_cut_off_or_changed_saved_map_is_refused() {
    let bytes = surefoot_levels::encode(&generated(3));
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    let ends = (0..80).chain((0..100).map(|_| rng.random_range(0..bytes.len()))).collect::<Vec<_>>();
    for end in ends {
        let error = refusal(surefoot_levels::decode(&bytes[..end]), "cut off");
        assert!(error.contains("cut off") || end == 0, "{end}: {error}");
    }
    let places = (0..60).chain((0..200).map(|_| rng.random_range(0..bytes.len()))).collect::<Vec<_>>();
    for place in places {
        let mut flipped = bytes.clone();
        flipped[place] ^= 1 << rng.random_range(0..8);
        assert!(surefoot_levels::decode(&flipped).is_err(), "byte {place} changed");
    }
}

/// A saved map of one triangle, as the format describes it, for tests to corrupt before it is sealed.
struct Saved {
    magic: &'static [u8],
    version: u32,
    description: Vec<u8>,
    vertex_count: u32,
    triangle_count: u32,
    vertices: Vec<f32>,
    corners: Vec<u32>,
    surfaces: Vec<u8>,
    trailing: usize,
}

impl Saved {
    fn new(size: MapSize, placed: &Placed) -> Self {
        Self {
            magic: b"SFMAP\r\n\x1a",
            version: 1,
            description: postcard::to_stdvec(&(None::<MapSpec>, size, placed)).expect("plain data"),
            vertex_count: 3,
            triangle_count: 1,
            vertices: vec![1.0, 1.0, 1.0, 1.0, 1.0, 9.0, 9.0, 1.0, 1.0],
            corners: vec![0, 1, 2],
            surfaces: vec![0],
            trailing: 0,
        }
    }

    fn bytes(&self) -> Vec<u8> {
        let mut payload = vec![0u8; 32];
        payload.extend((self.description.len() as u32).to_le_bytes());
        payload.extend(&self.description);
        payload.extend(self.vertex_count.to_le_bytes());
        payload.extend(self.triangle_count.to_le_bytes());
        payload.extend(self.vertices.iter().flat_map(|value| value.to_le_bytes()));
        payload.extend(self.corners.iter().flat_map(|value| value.to_le_bytes()));
        payload.extend(&self.surfaces);
        let mut bytes = self.magic.to_vec();
        bytes.extend(self.version.to_le_bytes());
        bytes.extend((payload.len() as u64).to_le_bytes());
        bytes.extend(blake3::hash(&payload).as_bytes());
        bytes.extend(payload);
        bytes.extend(vec![0; self.trailing]);
        bytes
    }
}

#[test]
fn maps_of_release_0_2_are_read() {
    let spec = MapSpec::with_side(3, 50).unwrap();
    let map = surefoot_generate::generate(&spec);
    let bytes = surefoot_levels::encode(&map);
    let (header, payload) = bytes.split_at(8 + 4 + 8 + 32);
    let (mut header, mut payload) = (header.to_vec(), payload.to_vec());
    // The spec comes first in the description. Its last 26 bytes are the kind, the densities of movers and the choice
    // of repair. The last bytes of the description are those of no movers and no pieces, the frame,
    // and no spots.
    let spec_len = postcard::to_stdvec(&Some(spec)).unwrap().len();
    let description_len = u32::from_le_bytes(payload[32..36].try_into().unwrap());
    let frame_len = postcard::to_stdvec(map.frame()).unwrap().len();
    payload.drain(36 + description_len as usize - 3 - frame_len..36 + description_len as usize);
    payload.drain(36 + spec_len - 26..36 + spec_len);
    payload[32..36].copy_from_slice(&(description_len - 29 - frame_len as u32).to_le_bytes());
    header[8..12].copy_from_slice(&1u32.to_le_bytes());
    header[12..20].copy_from_slice(&(payload.len() as u64).to_le_bytes());
    header[20..].copy_from_slice(blake3::hash(&payload).as_bytes());
    let read = surefoot_levels::decode(&[header, payload].concat()).unwrap();
    assert_eq!((read.hash(), read.spec()), (map.hash(), Some(&spec)));
}

#[test]
fn each_fault_of_a_saved_map_has_its_own_message() {
    const SIZE: MapSize = MapSize { width: 10, height: 10, depth: 10 };
    let plain = || Saved::new(SIZE, &Placed::default());
    let sized = |width, height| Saved::new(MapSize { width, height, depth: 10 }, &Placed::default());
    let with_pads = |pads| Saved::new(SIZE, &Placed { pads, ..Placed::default() });
    let pad = Pad { centre: Vec3::ONE, speed: 20.0 };
    let endless = Pad { centre: Vec3::new(0.0, f32::INFINITY, 0.0), speed: 20.0 };
    let cases = [
        (Saved { magic: b"GIF89a\x1a\x0a", ..plain() }, "not a saved map"),
        (Saved { version: 8, ..plain() }, "format 8, this program reads format 7"),
        (Saved { version: 4, ..plain() }, "format 4, this program reads format 7"),
        (Saved { trailing: 7, ..plain() }, "followed by 7 bytes"),
        (Saved { description: vec![9; 3], ..plain() }, "description"),
        (Saved { vertex_count: u32::MAX, ..plain() }, "claims 51539607553 bytes of geometry"),
        (Saved { triangle_count: u32::MAX, ..plain() }, "claims"),
        (sized(0, 10), "0 x 10 x 10 m"),
        (sized(1001, 10), "1001 x 10 x 10 m, but must be 1 x 1 x 1 to 1000 x 200 x 1000 m"),
        (sized(10, 201), "10 x 201 x 10 m"),
        (Saved { vertices: vec![1.0, 1.0, 1.0, 1.0, f32::NAN, 9.0, 9.0, 1.0, 1.0], ..plain() }, "vertex 1"),
        (Saved { vertices: vec![1.0, 1.0, 1.0, 1.0, 1.0, 1.0e9, 9.0, 1.0, 1.0], ..plain() }, "vertex 1"),
        (Saved { corners: vec![0, 1, 3], ..plain() }, "refers to vertex 3, but there are 3"),
        (Saved { corners: vec![0, 1, 1], ..plain() }, "no area"),
        (Saved { surfaces: vec![99], ..plain() }, "unknown surface 99"),
        (with_pads(vec![pad, endless]), "pad 1"),
        (with_pads(vec![pad; 20_001]), "20001 pools, devices and spots"),
        (plain(), "was saved as 0000000000000000"),
    ];
    for (saved, expected) in cases {
        let error = refusal(surefoot_levels::decode(&saved.bytes()), expected);
        assert!(error.contains(expected), "`{expected}` is not in `{error}`");
    }
}

// OBJ levels.

/// Six quads of a box with corners `low` and `high`, counter-clockwise from outside.
fn obj_box(name: &str, low: [f32; 3], high: [f32; 3]) -> String {
    let mut text = format!("o {name}\n");
    for i in 0..8 {
        let pick = |axis: usize| if i >> axis & 1 == 1 { high[axis] } else { low[axis] };
        text += &format!("v {} {} {}\n", pick(0), pick(1), pick(2));
    }
    for [a, b, c, d] in [[0, 4, 6, 2], [1, 3, 7, 5], [0, 1, 5, 4], [2, 6, 7, 3], [0, 2, 3, 1], [4, 5, 7, 6]] {
        let [a, b, c, d] = [a, b, c, d].map(|corner: i32| corner - 8);
        text += &format!("f {a} {b} {c} {d}\n");
    }
    text
}

/// A solid floor with its top at 0, lava up to 0.5 m above a part of it, and a pad.
fn obj_level() -> String {
    obj_box("floor", [0.0, -1.0, 0.0], [40.0, 0.0, 40.0])
        + &obj_box("Lava.001", [20.0, 0.0, 20.0], [30.0, 0.5, 30.0])
        + &obj_box("PAD_north", [9.0, 0.0, 29.0], [11.0, 0.1, 31.0])
}

fn obj(text: &str) -> Imported {
    surefoot_levels::import_obj(text.as_bytes(), None, &PLAIN).expect("a valid level")
}

#[test]
fn a_character_lives_on_an_obj_level_and_burns_in_its_lava() {
    let Imported { map, warnings, .. } = obj(&obj_level());
    assert_eq!(warnings, []);
    // A margin of 2 m around; the lowest corner 1 m above 0, so the floor's top is at 2 m.
    assert_eq!(map.size(), MapSize { width: 44, height: 23, depth: 44 });
    let outline = Outline::Rectangle { half_x: 5.0, half_z: 5.0 };
    let lava = Pool { centre: Vec3::new(27.0, 2.5, 27.0), outline, depth: 0.5, liquid: Liquid::Lava };
    assert_eq!(map.placed().pools, [lava]);
    assert_eq!(map.placed().pads, [Pad { centre: Vec3::new(12.0, 2.0, 32.0), speed: 560.0f32.sqrt() }]);

    let mut world = World::new(Arc::new(map), CharacterProfile::default(), TaskConfig::default());
    let slot = world.spawn(Vec3::new(12.0, 4.0, 12.0), 0.0);
    let mut stand = |feet: Vec3| {
        world.teleport(slot, feet, 0.0);
        for _ in 0..6 {
            world.decide(slot, Action::default());
            (0..10).for_each(|_| world.tick());
        }
        let npc = world.npc(slot).expect("it was spawned");
        (npc.body.feet.y, npc.harm)
    };
    let (height, harm) = stand(Vec3::new(12.0, 4.0, 12.0));
    assert!((height - 2.0).abs() < 0.01 && harm.is_none(), "{height} {harm:?}");
    assert_eq!(stand(Vec3::new(27.0, 4.0, 27.0)).1, Some(End::Burnt));
    assert!(stand(Vec3::new(12.0, 2.1, 32.0)).0 > 4.0, "the pad throws");
}

#[test]
fn a_level_in_centimetres_with_z_up_is_the_same_level() {
    let upright = obj(&obj_level()).map;
    let turned: String = obj_level()
        .lines()
        .map(|line| match line.strip_prefix("v ") {
            None => format!("{line}\n"),
            Some(point) => {
                let [x, y, z]: [f32; 3] = point
                    .split(' ')
                    .map(|word| word.parse().expect("a number"))
                    .collect::<Vec<_>>()
                    .try_into()
                    .expect("three");
                format!("v {} {} {}\n", x * 64.0, z * -64.0, y * 64.0)
            }
        })
        .collect();
    let options = ImportOptions { scale: 1.0 / 64.0, up: UpAxis::Z, ..PLAIN };
    let map = surefoot_levels::import_obj(turned.as_bytes(), None, &options).expect("a valid level").map;
    assert_eq!(map.hash(), upright.hash());
}

#[test]
fn the_largest_level_fits_with_smaller_margins() {
    let map = obj(&obj_box("floor", [0.0, -9.0, 0.0], [999.0, 190.0, 30.0])).map;
    assert_eq!(map.size(), MapSize { width: 1000, height: 200, depth: 34 });
    let corner = map.mesh().triangles()[0].corners()[0];
    assert_eq!(corner, Vec3::new(0.5, 1.0, 2.0));
}

#[test]
fn the_report_counts_what_is_odd_about_the_geometry() {
    let quad = "o floor\nv 0 0 0\nv 0 0 9\nv 9 0 9\nv 9 0 0\nf 1 2 3 4\n";
    let counts = GeometryCounts { triangles: 2, open_edges: 4, ..GeometryCounts::default() };
    let cases = [
        (quad.to_owned(), counts),
        (quad.replace("1 2 3 4", "4 3 2 1"), GeometryCounts { turned_shells: 1, ..counts }),
        (
            quad.replace("f 1 2 3 4", "v 0 0 -9\nv 9 0 -9\nf 5 1 4 6\nf 1 2 3\nf 1 4 3\nf 1 1 2"),
            GeometryCounts {
                triangles: 4,
                degenerate: 1,
                open_edges: 6,
                inconsistent_edges: 2,
                turned_triangles: 1,
                ..GeometryCounts::default()
            },
        ),
        (
            format!("{quad}v 0 5 4.5\nf 1 2 5\nf 2 1 5\n"),
            GeometryCounts { triangles: 4, open_edges: 3, crowded_edges: 1, ..counts },
        ),
    ];
    for (text, expected) in cases {
        let imported = obj(&text);
        assert_eq!((imported.geometry, imported.warnings.as_slice()), (expected, &[][..]), "{text}");
    }
    let flat = format!("{}o water\nv 1 1 1\nv 1 1 2\nv 2 1 2\nf -3 -2 -1", obj_box("floor", [0.0; 3], [9.0; 3]));
    assert_eq!(obj(&flat).warnings, [Warning::FlatPools { count: 1 }]);
}

// Sides.

/// The same faces, seen from the other side.
fn inside_out(text: &str) -> String {
    let turn = |line: &str| match line.split_ascii_whitespace().collect::<Vec<_>>()[..] {
        ["f", a, ref rest @ ..] => format!("f {a} {}\n", rest.iter().rev().copied().collect::<Vec<_>>().join(" ")),
        _ => format!("{line}\n"),
    };
    text.lines().map(turn).collect()
}

/// Where a character that appears at `feet` is after a second and a half, if it stands.
fn after_a_while(map: &Arc<Map>, feet: Vec3, yaw: f32, forward: f32) -> Option<Vec3> {
    let mut world = World::new(map.clone(), CharacterProfile::default(), TaskConfig::default());
    let slot = world.spawn(feet, yaw);
    for _ in 0..9 {
        world.decide(slot, Action { forward, ..Action::default() });
        (0..10).for_each(|_| world.tick());
    }
    let body = world.npc(slot).expect("an NPC").body;
    body.is_grounded().then_some(body.feet)
}

/// Whether a character stands at `feet`.
fn stands(map: &Arc<Map>, feet: Vec3) -> bool {
    after_a_while(map, feet, 0.0, 0.0).is_some_and(|after| after.distance(feet) < 0.3)
}

#[test]
fn sides_stay_as_they_were_modelled_where_that_is_wanted() {
    let block = |name: &str, x: f32| inside_out(&obj_box(name, [x, 0.0, 0.0], [x + 5.0, 3.0, 5.0]));
    let blocks = block("a", 0.0) + &block("b", 6.0) + &block("c", 12.0);
    let kept =
        surefoot_levels::import_obj(blocks.as_bytes(), None, &ImportOptions { keep_sides: true, ..PLAIN }).unwrap();
    assert_eq!(kept.warnings, []);
    let turned = obj(&blocks);
    let feet = Vec3::new(4.5, 4.01, 4.5);
    assert!(!stands(&Arc::new(kept.map), feet) && stands(&Arc::new(turned.map), feet));
}

#[test]
fn a_level_in_another_unit_is_asked_about() {
    let block = |side: f32| obj_box("a", [0.0, 0.0, 0.0], [side, 0.1 * side, side]);
    for (side, factor) in [(0.02, 1000.0), (0.3, 100.0), (3.0, 10.0)] {
        let times = obj(&block(side)).warnings.into_iter().find_map(|warning| match warning {
            Warning::Unit { scale, .. } => Some(scale),
            _ => None,
        });
        assert_eq!(times, Some(factor), "{side} m");
    }
    assert_eq!(obj(&block(30.0)).warnings, []);
}

#[test]
fn blocks_that_were_modelled_inside_out_are_solid() {
    let blocks = [("a", 0.0, 3.0), ("b", 6.0, 2.0), ("c", 12.0, 4.0)];
    let block = |(name, x, top): (&str, f32, f32)| obj_box(name, [x, 0.0, 0.0], [x + 5.0, top, 5.0]);
    let right = Arc::new(obj(&blocks.map(block).concat()).map);
    let Imported { map, geometry, .. } = obj(&blocks.map(|it| inside_out(&block(it))).concat());
    assert_eq!(geometry.turned_shells, 3);
    assert_eq!(map.mesh().triangles().len(), right.mesh().triangles().len());
    let wrong = Arc::new(map);
    for (_, x, top) in blocks {
        let feet = Vec3::new(x + 4.5, top + 1.01, 4.5);
        assert!(stands(&wrong, feet) && stands(&right, feet));
        let inside = feet - Vec3::Y * 1.5;
        assert!(wrong.mesh().solid_depth_at(inside) > 0 && right.mesh().solid_depth_at(inside) > 0);
    }
}

#[test]
fn a_room_seen_from_within_stays_a_room_and_what_stands_in_it_is_turned_alone() {
    let room = inside_out(&obj_box("room", [0.0; 3], [20.0, 6.0, 20.0]));
    let Imported { map, warnings, geometry, .. } = obj(&room);
    assert_eq!((warnings, geometry.turned_shells), (vec![], 0), "nothing is wrong with a room");
    let feet = Vec3::new(7.0, 1.01, 7.0);
    assert_eq!(map.mesh().solid_depth_at(feet + Vec3::Y), 0);
    assert!(stands(&Arc::new(map), feet));
    let table = inside_out(&obj_box("table", [12.0, 1.0, 12.0], [14.0, 2.0, 14.0]));
    let Imported { map, geometry, .. } = obj(&format!("{room}{table}"));
    assert_eq!(geometry.turned_shells, 1);
    let map = Arc::new(map);
    assert!(stands(&map, feet) && stands(&map, Vec3::new(15.0, 3.01, 15.0)));
}

#[test]
fn surfaces_without_thickness_hold_from_both_sides() {
    let ground = obj_box("ground", [0.0; 3], [30.0, 1.0, 20.0]);
    // A deck that faces down, 3 m above the ground, and a wall across the level that faces away.
    let deck = "o deck\nv 0 4 0\nv 8 4 0\nv 8 4 20\nv 0 4 20\nf -4 -3 -2 -1\n";
    let wall = "o wall\nv 20 1 0\nv 20 1 20\nv 20 9 20\nv 20 9 0\nf -4 -3 -2 -1\n";
    let Imported { map, geometry, .. } = obj(&[&ground, deck, wall].concat());
    assert_eq!((geometry.open_edges, geometry.plates), (8, 4));
    let map = Arc::new(map);
    assert!(stands(&map, Vec3::new(6.0, 5.07, 12.0)), "on the deck");
    let below = Vec3::new(6.0, 2.01, 12.0);
    assert!(stands(&map, below) && map.mesh().solid_depth_at(below + Vec3::Y) == 0, "below the deck");
    for (x, towards) in [(19.0, 1.0), (25.0, -1.0)] {
        let start = Vec3::new(x, 2.01, 12.0);
        let feet = after_a_while(&map, start, std::f32::consts::FRAC_PI_2 * towards, 1.0).expect("it stands");
        assert!((feet.x - 22.0) * towards < 0.0, "from {x} to {feet}: held by the wall");
        assert!((feet.x - 22.0).abs() < 0.5, "from {x} to {feet}: ran up to the wall");
    }
}

// The sidecar.

#[test]
fn the_sidecar_lists_features_in_the_levels_own_coordinates() {
    let sidecar = json!({
        "pools": [{ "liquid": "water", "min": [100, 3000, 200], "max": [500, 2000, 400] }],
        "pads": [{ "at": [100, 1000, 0], "height": 6.2 }, { "at": [200, 1000, 0] }],
        "zip_lines": [{ "from": [100, 100, 0], "to": [900, 100, 0] }],
        "teleporters": [{ "from": [100, 500, 0], "to": [100, 600, 0], "two_way": true }],
        "jetpacks": [{ "at": [700, 700, 0], "fuel": 1.5 }],
    });
    let floor = obj_box("floor", [0.0, 0.0, -100.0], [4000.0, 4000.0, 0.0]);
    let options = ImportOptions { scale: 0.01, up: UpAxis::Z, ..PLAIN };
    let map =
        surefoot_levels::import_obj(floor.as_bytes(), Some(&sidecar.to_string()), &options).expect("a valid level").map;
    let placed = map.placed();
    // x from 2, z from 2 + 40 downwards, the floor's top at 2.
    let near = |one: Vec3, other: [f32; 3]| assert!(one.distance(other.into()) < 1.0e-4, "{one:?} {other:?}");
    near(placed.pools[0].centre, [5.0, 6.0, 17.0]);
    assert_eq!(placed.pools[0].outline.half_extents(), (2.0, 5.0));
    assert!((placed.pools[0].depth - 2.0).abs() < 1.0e-4 && placed.pools[0].liquid == Liquid::Water);
    near(placed.pads[0].centre, [3.0, 2.0, 32.0]);
    assert_eq!(placed.pads.iter().map(|pad| pad.speed).collect::<Vec<_>>(), [648.0f32.sqrt(), 560.0f32.sqrt()]);
    near(placed.zip_lines[0].from, [3.0, 2.0, 41.0]);
    near(placed.zip_lines[0].to, [11.0, 2.0, 41.0]);
    near(placed.teleporters[0].to, [3.0, 2.0, 36.0]);
    assert!(placed.teleporters[0].two_way);
    near(placed.jetpacks[0].centre, [9.0, 2.0, 35.0]);
    assert_eq!(placed.jetpacks[0].fuel, 1.5);
}

#[test]
fn a_faulty_sidecar_is_refused_by_name() {
    let cases = [
        (json!({ "lava": [] }), "unknown field `lava`"),
        (json!({ "pads": [{ "at": [1, 2, 3], "hight": 4 }] }), "unknown field `hight`"),
        (json!({ "pools": [{ "liquid": "acid", "min": [0, 0, 0], "max": [1, 1, 1] }] }), "unknown variant `acid`"),
        (json!({ "zip_lines": [{ "from": [1, 2, 3] }] }), "missing field `to`"),
        (
            json!({ "pads": [{ "at": [5, 0, 5] }, { "at": [50, 0, 5] }] }),
            "pads[1] of the sidecar lies outside the level",
        ),
        (
            json!({ "pads": [{ "at": [1e39, 0, 5] }] }),
            "pads[0] of the sidecar has a position that is not a finite number",
        ),
        (json!({ "pads": [{ "at": [5, 0, 5], "height": -11 }] }), "pads[0] of the sidecar has height -11"),
        (json!({ "jetpacks": [{ "at": [5, 0, 5], "fuel": 1e9 }] }), "jetpacks[0] of the sidecar has fuel"),
        (
            json!({ "pools": [{ "liquid": "lava", "min": [90, 0, 0], "max": [99, 1, 9] }] }),
            "pools[0] of the sidecar lies",
        ),
        (json!("pads"), "the sidecar cannot be read"),
    ];
    let floor = obj_box("floor", [0.0, -1.0, 0.0], [40.0, 0.0, 40.0]);
    for (sidecar, expected) in cases {
        let error =
            refusal(surefoot_levels::import_obj(floor.as_bytes(), Some(&sidecar.to_string()), &PLAIN), expected);
        assert!(error.contains(expected), "`{expected}` is not in `{error}`");
    }
}

// glTF levels.

/// A `.gltf` with one buffer: a triangle's positions (36 bytes), then the indices 0, 1, 2 as bytes (and one of
/// padding). Its mesh lies in the ground plane, faces up and spans 8 m.
fn gltf_level(nodes: Value) -> Value {
    json!({
        "asset": { "version": "2.0" },
        "scene": 0,
        "scenes": [{ "nodes": (0..nodes.as_array().map_or(0, Vec::len)).collect::<Vec<_>>() }],
        "nodes": nodes,
        "meshes": [{ "name": "flat", "primitives": [{ "attributes": { "POSITION": 0 }, "indices": 1 }] }],
        "accessors": [
            { "bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3", "min": [0, 0, 0], "max": [8, 0, 8] },
            { "bufferView": 1, "componentType": 5121, "count": 3, "type": "SCALAR" },
        ],
        "bufferViews": [
            { "buffer": 0, "byteOffset": 0, "byteLength": 36 },
            { "buffer": 0, "byteOffset": 36, "byteLength": 3 },
        ],
        "buffers": [{
            "byteLength": 40,
            "uri": "data:application/octet-stream;base64,AAAAAAAAAAAAAAAAAAAAAAAAAAAAAABBAAAAQQAAAAAAAAAAAAECAA==",
        }],
    })
}

fn gltf(level: &Value) -> Result<Imported, ImportError> {
    surefoot_levels::import_gltf(level.to_string().as_bytes(), None, &PLAIN, &NoFiles)
}

fn corners(map: &Map) -> Vec<[Vec3; 3]> {
    map.mesh().triangles().iter().filter(|t| t.surface().is_solid()).map(Triangle::corners).collect()
}

#[test]
fn transforms_of_nested_nodes_apply_and_mirrored_meshes_keep_facing_up() {
    // One node is rotated by 90 degrees about the vertical, doubled, and moved; the other one is mirrored.
    let nodes = json!([
        { "name": "arm", "translation": [0, 3, 0], "scale": [2, 2, 2], "children": [1] },
        { "name": "floor", "mesh": 0, "rotation": [0, 0.70710677, 0, 0.70710677] },
        { "name": "mirrored", "mesh": 0, "matrix": [-1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 3, 0, 1] },
    ]);
    let mut level = gltf_level(nodes);
    level["scenes"][0]["nodes"] = json!([0, 2]);
    let map = gltf(&level).expect("a valid level").map;
    // (0,0), (0,8), (8,0) in x and z become (0,0), (16,0), (0,-16), and (0,0), (0,8), (-8,0).
    assert_eq!(map.size(), MapSize { width: 28, height: 21, depth: 28 });
    let found = corners(&map);
    let expected = [
        [[10.0, 1.0, 18.0], [26.0, 1.0, 18.0], [10.0, 1.0, 2.0]],
        [[10.0, 1.0, 18.0], [2.0, 1.0, 18.0], [10.0, 1.0, 26.0]],
    ];
    for (triangle, expected) in found.iter().zip(expected) {
        let same = triangle.iter().zip(expected).all(|(one, other)| one.distance(other.into()) < 1.0e-4);
        assert!(same, "{triangle:?} {expected:?}");
    }
    assert!(map.mesh().triangles().iter().all(|triangle| triangle.normal().y > 0.99));
}

#[test]
fn strips_and_fans_become_triangles_and_lines_are_left_out() {
    // Four corners of a square in the order of a strip: 0 0, 0 8, 8 0, 8 8.
    let square = |mode: u32, order: [usize; 4]| {
        let points = [[0.0f32, 0.0], [0.0, 8.0], [8.0, 0.0], [8.0, 8.0]];
        let bytes: Vec<u8> =
            order.into_iter().flat_map(|i| [points[i][0], 0.0, points[i][1]]).flat_map(f32::to_le_bytes).collect();
        let mut level = gltf_level(json!([{ "mesh": 0 }]));
        level["meshes"][0]["primitives"] = json!([{ "attributes": { "POSITION": 0 }, "mode": mode }]);
        level["accessors"] = json!([{ "bufferView": 0, "componentType": 5126, "count": 4, "type": "VEC3" }]);
        level["bufferViews"] = json!([{ "buffer": 0, "byteLength": 48 }]);
        level["buffers"] = json!([{ "byteLength": 48 }]);
        glb(&level, Some(&bytes))
    };
    for (mode, order) in [(5, [0, 1, 2, 3]), (6, [0, 1, 3, 2])] {
        let imported =
            surefoot_levels::import_gltf(&square(mode, order), None, &PLAIN, &NoFiles).expect("a valid level");
        assert_eq!(imported.map.mesh().triangles().len(), 2);
        assert!(imported.map.mesh().triangles().iter().all(|triangle| triangle.normal().y > 0.99));
        assert_eq!((imported.warnings.as_slice(), imported.geometry.open_edges), (&[][..], 4));
    }
    let lines = surefoot_levels::import_gltf(&square(1, [0, 1, 2, 3]), None, &PLAIN, &NoFiles);
    assert!(matches!(lines, Err(ImportError::Empty)));
}

#[test]
fn quantized_positions_are_those_that_they_stand_for() {
    // A square of 8 m: 16-bit positions, as fractions of the node's scale, then 8-bit ones, as they are.
    let level = |component: u32, bytes: &[u8], stride: usize, normalized: bool, scale: f32| {
        let mut level = gltf_level(json!([{ "mesh": 0, "scale": [scale, scale, scale] }]));
        level["extensionsUsed"] = json!(["KHR_mesh_quantization"]);
        level["extensionsRequired"] = json!(["KHR_mesh_quantization"]);
        level["meshes"][0]["primitives"] = json!([{ "attributes": { "POSITION": 0 }, "mode": 5 }]);
        let accessor = json!({
            "bufferView": 0, "componentType": component, "count": 4, "type": "VEC3", "normalized": normalized
        });
        level["accessors"] = json!([accessor]);
        level["bufferViews"] = json!([{ "buffer": 0, "byteLength": bytes.len(), "byteStride": stride }]);
        level["buffers"] = json!([{ "byteLength": bytes.len() }]);
        surefoot_levels::import_gltf(&glb(&level, Some(bytes)), None, &PLAIN, &NoFiles).expect("a valid level").map
    };
    let strip = [[0u8, 0], [0, 1], [1, 0], [1, 1]];
    let short = |x: u8| if x == 1 { i16::MAX } else { 0 };
    let shorts: Vec<u8> =
        strip.iter().flat_map(|&[x, z]| [short(x), 0, short(z), 0]).flat_map(i16::to_le_bytes).collect();
    let bytes: Vec<u8> = strip.iter().flat_map(|&[x, z]| [8 * x, 0, 8 * z, 0]).collect();
    let (fine, coarse) = (level(5122, &shorts, 8, true, 8.0), level(5121, &bytes, 4, false, 1.0));
    assert_eq!(corners(&fine), corners(&coarse));
    assert_eq!(coarse.size(), MapSize { width: 12, height: 21, depth: 12 });
}

#[test]
fn helpers_are_no_part_of_the_level() {
    let floor = obj_box("floor", [0.0; 3], [20.0, 1.0, 20.0]);
    let names = ["NavMesh_1", "Trigger Volume", "UCX_crate_01", "walls-occonly", "notes-noimp", "yard-navmesh"];
    let helpers = names.map(|name| obj_box(name, [5.0, 1.0, 5.0], [8.0, 4.0, 8.0]));
    let Imported { map, warnings, nodes, .. } = obj(&format!("{floor}{}", helpers.concat()));
    assert_eq!(map.hash(), obj(&floor).map.hash());
    assert_eq!((warnings, role_counts(&nodes)), (vec![], vec![(Role::Solid, 1), (Role::Helper, 6)]));
    let solid = obj(&format!("{floor}{}", obj_box("crate-col", [5.0, 1.0, 5.0], [8.0, 4.0, 8.0])));
    assert_eq!(role_counts(&solid.nodes), [(Role::Solid, 2)]);
}

#[test]
fn the_sidecar_and_extras_say_what_is_solid() {
    let floor = obj_box("Floor", [0.0; 3], [20.0, 1.0, 20.0]);
    let crate_at = |name: &str, x: f32| obj_box(name, [x, 1.0, 5.0], [x + 2.0, 4.0, 8.0]);
    let import = |text: &str, sidecar: &str| surefoot_levels::import_obj(text.as_bytes(), Some(sidecar), &PLAIN);
    let level =
        [floor.clone(), crate_at("FX_smoke", 3.0), crate_at("tree_LOD1", 7.0), crate_at("UCX_rock", 11.0)].concat();

    let left_out = import(&level, r#"{"leave_out": ["fx_*", "*_lod1"]}"#).unwrap();
    assert_eq!(left_out.map.hash(), obj(&floor).map.hash());
    assert_eq!(role_counts(&left_out.nodes), [(Role::Solid, 1), (Role::Helper, 1), (Role::LeftOut, 2)]);

    // What is listed is solid, whatever its name says, and nothing else is.
    let colliders = import(&level, r#"{"colliders": ["floor", "ucx_*"]}"#).unwrap();
    let rock = obj_box("rock", [11.0, 1.0, 5.0], [13.0, 4.0, 8.0]);
    assert_eq!(colliders.map.hash(), obj(&format!("{floor}{rock}")).map.hash());
    assert_eq!(role_counts(&colliders.nodes), [(Role::Solid, 2), (Role::LeftOut, 2)]);

    let nothing = import(&level, r#"{"colliders": ["wall"]}"#).unwrap_err().to_string();
    assert!(nothing.contains("no solid"), "{nothing}");

    let with_extras = |extras: serde_json::Value| {
        gltf(&gltf_level(json!([
            { "name": "Floor", "mesh": 0, "scale": [5, 1, 5] },
            { "name": "trigger", "mesh": 0, "translation": [3, 1, 3], "extras": extras },
        ])))
    };
    let count = |extras| with_extras(extras).unwrap().map.mesh().triangles().len();
    assert!(count(json!({ "solid": true })) > count(json!({})));
    assert_eq!(count(json!({ "solid": 0 })), count(json!({})));
    let refused = with_extras(json!({ "solid": "yes" })).unwrap_err().to_string();
    assert!(refused.contains("solid") && refused.contains("true or false"), "{refused}");
}

#[test]
fn nodes_become_features_by_their_names() {
    let nodes = json!([
        { "name": "Floor", "mesh": 0, "scale": [5, 1, 5] },
        { "name": "pads", "children": [2, 3] },
        { "name": "Pad.002", "translation": [2, 0, 3], "extras": { "height": 0.0 } },
        { "name": "pad_of_parts", "children": [4] },
        { "name": "Cylinder", "mesh": 0, "scale": [0.25, 1, 0.25], "translation": [10, 1, 10] },
        { "name": "zip_line_tower_from", "translation": [5, 8, 5] },
        { "name": "zip_line_tower_to", "translation": [15, 1, 5] },
        { "name": "zip_line:to.001", "translation": [3, 1, 1] },
        { "name": "Zip_Line:From.001", "translation": [1, 2, 1] },
        { "name": "teleporter-a:to", "translation": [4, 0, 4], "extras": { "two_way": 1 } },
        { "name": "teleporter-a:from", "translation": [6, 0, 4] },
        { "name": "JetPack", "translation": [9, 0, 9], "extras": { "fuel": 3, "note": "spare" } },
        { "name": "Camera", "translation": [900, 900, 900] },
    ]);
    let mut level = gltf_level(nodes);
    level["scenes"][0]["nodes"] = json!([0, 1, 5, 6, 7, 8, 9, 10, 11, 12]);
    let map = gltf(&level).expect("a valid level").map;
    let placed = map.placed();
    let at = |x: f32, y: f32, z: f32| Vec3::new(x + 2.0, y + 1.0, z + 2.0);
    assert_eq!(corners(&map).len(), 1, "features are not solid");
    let pads =
        [Pad { centre: at(2.0, 0.0, 3.0), speed: 20.0 }, Pad { centre: at(11.0, 1.0, 11.0), speed: 560.0f32.sqrt() }];
    assert_eq!(placed.pads, pads);
    let lines = [
        ZipLine { from: at(5.0, 8.0, 5.0), to: at(15.0, 1.0, 5.0) },
        ZipLine { from: at(1.0, 2.0, 1.0), to: at(3.0, 1.0, 1.0) },
    ];
    assert_eq!(placed.zip_lines, lines);
    let teleporter = Teleporter { from: at(6.0, 0.0, 4.0), to: at(4.0, 0.0, 4.0), two_way: true };
    assert_eq!(placed.teleporters, [teleporter]);
    assert_eq!(placed.jetpacks, [Jetpack { centre: at(9.0, 0.0, 9.0), fuel: 3.0 }]);
}

/// Wraps a glTF document into a binary container.
fn glb(document: &Value, binary: Option<&[u8]>) -> Vec<u8> {
    let mut json = document.to_string().into_bytes();
    json.resize(json.len().next_multiple_of(4), b' ');
    let chunk = |kind: &[u8; 4], content: &[u8]| [&(content.len() as u32).to_le_bytes(), &kind[..], content].concat();
    let chunks = [chunk(b"JSON", &json), binary.map_or(Vec::new(), |binary| chunk(b"BIN\0", binary))].concat();
    [&b"glTF\x02\0\0\0"[..], &(12 + chunks.len() as u32).to_le_bytes(), &chunks].concat()
}

/// The document and the binary chunk of a binary container.
fn parts(glb: &[u8]) -> (Value, &[u8]) {
    let len = |at: usize| u32::from_le_bytes(glb[at..at + 4].try_into().expect("four bytes")) as usize;
    let end = 20 + len(12);
    let binary = if glb.len() > end { &glb[end + 8..end + 8 + len(end)] } else { &[] };
    (serde_json::from_slice(&glb[20..end]).expect("JSON"), binary)
}

/// A level with one change.
fn changed(pointer: &str, value: Value) -> Vec<u8> {
    let floor = json!([{ "name": "floor", "mesh": 0, "children": [] }, { "name": "other" }]);
    let mut level = gltf_level(floor);
    let (parent, key) = pointer.rsplit_once('/').expect("a pointer");
    let parent = level.pointer_mut(parent).expect("a parent in the level");
    match key.parse::<usize>() {
        Ok(idx) => parent[idx] = value,
        Err(_) => parent[key] = value,
    }
    level.to_string().into_bytes()
}

#[test]
fn each_fault_of_a_gltf_level_has_its_own_message() {
    let extras = |name: &str, extras: Value| changed("/nodes/1", json!({ "name": name, "extras": extras }));
    let buffer = |uri: &str| changed("/buffers/0/uri", json!(uri));
    let nan = "data:application/octet-stream;base64,AADAfwAAAAAAAAAAAAAAAAAAAAAAAABBAAAAQQAAAAAAAAAAAAECAA==";
    let vertex_9 = "data:;base64,AAAAAAAAAAAAAAAAAAAAAAAAAAAAAABBAAAAQQAAAAAAAAAAAAEJAA==";
    let exported = surefoot_levels::export_glb(&small_map());
    let mut version_1 = exported.clone();
    version_1[4] = 1;
    let cases = [
        (b"hello".to_vec(), "the JSON of the glTF cannot be read"),
        (b"glTF".to_vec(), "header is cut off"),
        (exported[..exported.len() - 1].to_vec(), "it is cut off"),
        (version_1, "the file is glTF 1"),
        (changed("/asset/version", json!("1.0")), "the file is glTF 1.0"),
        (changed("/extensionsRequired", json!(["ACME_shapes"])), "extension ACME_shapes"),
        (buffer("level.bin"), "`level.bin`, which cannot be read: only the level itself was sent"),
        (buffer("data:;base64,AAA!"), "no valid base64"),
        (buffer("data:;base64,AAAA"), "buffer 0 has 3 of 40 bytes"),
        (buffer(nan), "mesh `flat` has a position that is not a finite number"),
        (buffer(vertex_9), "mesh `flat` refers to vertex 9, but has only 3"),
        (changed("/accessors/0/count", json!(4)), "mesh `flat` has data that lies outside its buffer"),
        (changed("/accessors/0/count", json!(u64::MAX)), "outside its buffer"),
        (changed("/accessors/1/byteOffset", json!(u64::MAX)), "outside its buffer"),
        (changed("/bufferViews/0/byteStride", json!(u64::MAX)), "outside its buffer"),
        (changed("/bufferViews/0/byteLength", json!(u64::MAX)), "outside its buffer"),
        (changed("/bufferViews/0/byteStride", json!(4)), "outside its buffer"),
        (changed("/accessors/1/count", json!(0)), "no solid triangles"),
        (changed("/accessors/0/componentType", json!(5125)), "positions that are neither floats nor quantized"),
        (changed("/accessors/1/componentType", json!(5126)), "indices that are not unsigned integers"),
        (changed("/accessors/0/bufferView", json!(9)), "mesh `flat` refers to buffer view 9"),
        (changed("/bufferViews/0/buffer", json!(9)), "mesh `flat` refers to buffer 9"),
        (changed("/meshes/0/primitives/0/indices", json!(9)), "mesh `flat` refers to accessor 9"),
        (changed("/meshes/0/primitives/0/attributes/POSITION", json!(9)), "mesh `flat` refers to accessor 9"),
        (changed("/meshes/0/primitives/0/attributes", json!({})), "no solid triangles"),
        (changed("/meshes/0/primitives/0/mode", json!(9)), "unknown primitive mode"),
        (changed("/nodes/0/mesh", json!(9)), "node `floor` refers to mesh 9"),
        (changed("/nodes/0/children", json!([9])), "node `floor` refers to node 9"),
        (changed("/nodes/0/children", json!([0])), "node `floor` is its own ancestor"),
        (changed("/nodes/0/children", json!([1])), "two parents"),
        (changed("/scene", json!(9)), "the file refers to scene 9"),
        (changed("/nodes/0/translation", json!([0, 1e39, 0])), "has a position that is not a finite number"),
        (changed("/nodes/0/scale", json!([200, 1, 1])), "the level is 1600 x 0 x 8 m"),
        (changed("/nodes/0/scale", json!([1, 1, 200])), "at most 1000 x 199 x 1000 m fit:"),
        (changed("/nodes/0/name", json!("lava")), "no solid triangles"),
        (extras("pad", json!({ "height": "tall" })), "node `pad` has height \"tall\": give a number"),
        (extras("pad", json!({ "height": 5000 })), "node `pad` has height 5000"),
        (extras("jetpack", json!({ "fuel": -1 })), "node `jetpack` has fuel -1"),
        (extras("water", json!({ "outline": "oval" })), "node `water` has outline \"oval\""),
        (extras("water", json!({ "outline": "round" })), "node `water` has radius null"),
    ];
    for (bytes, expected) in cases {
        let error = refusal(surefoot_levels::import_gltf(&bytes, None, &PLAIN, &NoFiles), expected);
        assert!(error.contains(expected), "`{expected}` is not in `{error}`");
    }
}

#[test]
fn a_scale_that_is_not_positive_and_finite_is_refused() {
    let floor = obj_box("floor", [0.0, -1.0, 0.0], [40.0, 0.0, 40.0]);
    for scale in [0.0, -1.0, f64::NAN, f64::INFINITY] {
        let result = surefoot_levels::import_obj(floor.as_bytes(), None, &ImportOptions { scale, ..PLAIN });
        assert!(matches!(result, Err(ImportError::Scale(_))), "{scale}");
    }
}

#[test]
fn a_level_that_no_machine_could_hold_is_refused() {
    // Many nodes that use one large mesh.
    let mut level = gltf_level(json!([]));
    let bytes = vec![0u8; 300_000];
    level["nodes"] = (0..1000).map(|_| json!({ "mesh": 0 })).collect();
    level["scenes"][0]["nodes"] = (0..1000).collect();
    level["meshes"][0]["primitives"] = json!([{ "attributes": { "POSITION": 0 } }]);
    level["accessors"] = json!([{ "bufferView": 0, "componentType": 5126, "count": 25_000, "type": "VEC3" }]);
    level["bufferViews"] = json!([{ "buffer": 0, "byteLength": 300_000 }]);
    level["buffers"] = json!([{ "byteLength": 300_000 }]);
    let result = surefoot_levels::import_gltf(&glb(&level, Some(&bytes)), None, &PLAIN, &NoFiles);
    assert!(matches!(result, Err(ImportError::TooManyTriangles)));
    // Many triangles that each span the whole level.
    let mut text = "o floor\nv 0 0 0\nv 0 190 990\nv 990 0 990\n".to_owned();
    text.extend((0..2000).map(|_| "f 1 2 3\n"));
    let result = surefoot_levels::import_obj(text.as_bytes(), None, &PLAIN);
    assert!(matches!(result, Err(ImportError::Overload(_))));
}

#[test]
fn deeply_nested_nodes_do_not_exhaust_the_stack() {
    const DEPTH: usize = 100_000;
    let chain = (1..DEPTH).map(|child| json!({ "children": [child], "translation": [0, 0.001, 0] }));
    let mut level = gltf_level(chain.chain([json!({ "name": "floor", "mesh": 0 })]).collect());
    level["scenes"][0]["nodes"] = json!([0]);
    assert_eq!(corners(&gltf(&level).expect("a valid level").map).len(), 1);
    level["nodes"][DEPTH - 1]["children"] = json!([DEPTH / 2]);
    assert!(matches!(gltf(&level), Err(ImportError::NotATree { .. })));
    let deep = format!("{{\"asset\": {{\"version\": \"2.0\"}}, \"extras\": {}", "[".repeat(DEPTH));
    assert!(matches!(surefoot_levels::import_gltf(deep.as_bytes(), None, &PLAIN, &NoFiles), Err(ImportError::Json(_))));
}

// Export.

fn near(one: Vec3, other: Vec3) -> bool {
    one.distance(other) < 1.0e-4
}

#[test]
fn an_exported_map_is_imported_as_it_was() {
    let all =
        MapSpec::with_side(5, 100).unwrap().with(|it| it.features = surefoot_world::map::Features::all()).unwrap();
    for map in [generated(5), surefoot_generate::generate(&all), small_map()] {
        let back = surefoot_levels::import_gltf(&surefoot_levels::export_glb(&map), None, &PLAIN, &NoFiles)
            .expect("an exported map")
            .map;
        assert_eq!(back.size(), map.size());
        let (solids, expected) = (corners(&back), corners(&map));
        assert_eq!(solids.len(), expected.len());
        let same =
            |(one, other): (&[Vec3; 3], &[Vec3; 3])| one.iter().zip(other).all(|(one, other)| near(*one, *other));
        assert!(solids.iter().zip(&expected).all(same));

        let (one, other) = (back.placed(), map.placed());
        let counts = |placed: &Placed| {
            [
                placed.pools.len(),
                placed.pads.len(),
                placed.zip_lines.len(),
                placed.teleporters.len(),
                placed.jetpacks.len(),
            ]
        };
        assert_eq!(counts(one), counts(other));
        for (one, other) in one.pools.iter().zip(&other.pools) {
            let (half, other_half) = (one.outline.half_extents(), other.outline.half_extents());
            assert!(near(one.centre, other.centre) && one.liquid == other.liquid, "{one:?} {other:?}");
            assert!((half.0 - other_half.0).abs() + (half.1 - other_half.1).abs() < 1.0e-4, "{one:?} {other:?}");
            assert!((one.depth - other.depth).abs() < 1.0e-4, "{one:?} {other:?}");
            assert_eq!(std::mem::discriminant(&one.outline), std::mem::discriminant(&other.outline));
        }
        let pads = one.pads.iter().zip(&other.pads);
        assert!(pads.into_iter().all(|(one, other)| near(one.centre, other.centre) && one.speed == other.speed));
        let lines = one.zip_lines.iter().zip(&other.zip_lines);
        assert!(lines.into_iter().all(|(one, other)| near(one.from, other.from) && near(one.to, other.to)));
        for (one, other) in one.teleporters.iter().zip(&other.teleporters) {
            assert!(near(one.from, other.from) && near(one.to, other.to) && one.two_way == other.two_way);
        }
        assert_eq!(one.spots, other.spots);
        let jetpacks = one.jetpacks.iter().zip(&other.jetpacks);
        assert!(jetpacks.into_iter().all(|(one, other)| near(one.centre, other.centre) && one.fuel == other.fuel));
    }
}

#[test]
fn an_exported_map_that_grew_is_placed_anew() {
    let exported = surefoot_levels::export_glb(&small_map());
    let (mut level, binary) = parts(&exported);
    level["nodes"][0]["scale"] = json!([2, 1, 2]);
    let imported =
        surefoot_levels::import_gltf(&glb(&level, Some(binary)), None, &PLAIN, &NoFiles).expect("a valid level");
    assert_eq!(imported.map.size().width, 64);
    let former = MapSize { width: 30, height: 25, depth: 30 };
    assert!(imported.warnings.contains(&Warning::Outgrown { former }), "{:?}", imported.warnings);
}

#[test]
fn exported_files_obey_the_rules_of_gltf() {
    for map in [generated(5), small_map(), Map::from_parts(small_map().size(), Vec::new(), Placed::default())] {
        let bytes = surefoot_levels::export_glb(&map);
        assert!(bytes.len().is_multiple_of(4));
        assert_eq!(bytes[8..12], (bytes.len() as u32).to_le_bytes());
        if map.mesh().triangles().is_empty() {
            continue;
        }
        let (document, binary) = parts(&bytes);
        assert_eq!(document["buffers"], json!([{ "byteLength": binary.len() }]));
        let list = |name: &str| document[name].as_array().expect("an array");
        let number = |value: &Value| value.as_u64().expect("a whole number") as usize;
        for view in list("bufferViews") {
            let (offset, len) = (number(&view["byteOffset"]), number(&view["byteLength"]));
            assert!(offset.is_multiple_of(4) && offset + len <= binary.len() && view["target"].is_u64());
        }
        // The content of an accessor, in numbers of four bytes.
        let content = |accessor: &Value| {
            let view = &document["bufferViews"][number(&accessor["bufferView"])];
            let (offset, len) = (number(&view["byteOffset"]), number(&view["byteLength"]));
            let width = if accessor["type"] == "VEC3" { 12 } else { 4 };
            assert_eq!(len, width * number(&accessor["count"]));
            binary[offset..offset + len].as_chunks::<4>().0
        };
        for primitive in list("meshes").iter().flat_map(|mesh| mesh["primitives"].as_array().expect("an array")) {
            let accessor = |idx: &Value| &document["accessors"][number(idx)];
            let positions = accessor(&primitive["attributes"]["POSITION"]);
            let points: Vec<Vec3> = content(positions)
                .as_chunks::<3>()
                .0
                .iter()
                .map(|point| point.map(f32::from_le_bytes).into())
                .collect();
            let indices = content(accessor(&primitive["indices"]));
            let is_in_range = |idx: &[u8; 4]| (u32::from_le_bytes(*idx) as usize) < points.len();
            assert!(indices.len().is_multiple_of(3) && indices.iter().all(is_in_range));
            let low = points.iter().copied().reduce(Vec3::min).expect("positions");
            let high = points.iter().copied().reduce(Vec3::max).expect("positions");
            assert_eq!((&positions["min"], &positions["max"]), (&json!(low.to_array()), &json!(high.to_array())));
            assert!(number(&primitive["material"]) < list("materials").len());
        }
        let names: Vec<&str> = list("nodes").iter().filter_map(|node| node["name"].as_str()).collect();
        let mut unique = names.clone();
        unique.sort_unstable();
        unique.dedup();
        assert_eq!(unique.len(), list("nodes").len());
        assert_eq!(names.iter().filter(|name| name.starts_with("building_")).count(), map.placed().buildings.len());
    }
}

// Hostile bytes.

/// Changes some bytes, cuts some out or doubles some.
fn mutate(bytes: &[u8], rng: &mut ChaCha8Rng) -> Vec<u8> {
    let mut mutated = bytes.to_vec();
    for _ in 0..rng.random_range(1..6) {
        let at = rng.random_range(0..mutated.len());
        match rng.random_range(0..6) {
            0 => mutated[at] ^= 1 << rng.random_range(0..8),
            1 => mutated[at] = rng.random_range(0..=255),
            2 => mutated[at] = *b"0919-e[]{},:\""[..].get(rng.random_range(0..13)).expect("a byte"),
            3 if mutated.len() > 1 => drop(mutated.remove(at)),
            3 | 4 => mutated.insert(at, mutated[at]),
            _ => mutated.truncate(at.max(1)),
        }
    }
    mutated
}

#[test]
fn hostile_saved_maps_with_a_right_checksum_never_panic() {
    const HEADER_LEN: usize = 52;
    let saved = surefoot_levels::encode(&small_map());
    let mut rng = ChaCha8Rng::seed_from_u64(11);
    for _ in 0..2000 {
        let payload = mutate(&saved[HEADER_LEN..], &mut rng);
        let mut bytes = saved[..12].to_vec();
        bytes.extend((payload.len() as u64).to_le_bytes());
        bytes.extend(blake3::hash(&payload).as_bytes());
        bytes.extend(payload);
        // The hash reveals changes to content that is still valid, except for the spec.
        if let Ok(map) = surefoot_levels::decode(&bytes) {
            assert_eq!(map.hash(), small_map().hash());
        }
    }
}

#[test]
fn hostile_bytes_never_panic() {
    let exported = surefoot_levels::export_glb(&small_map());
    let json_len = exported.windows(4).position(|window| window == b"BIN\0").expect("a binary chunk") - 24;
    let text = gltf_level(json!([{ "name": "floor", "mesh": 0 }, { "name": "pad" }])).to_string();
    let mut rng = ChaCha8Rng::seed_from_u64(7);
    let (mut imported, mut refused) = (0, 0);
    let mut count = |result: Result<Imported, ImportError>| match result {
        Ok(_) => imported += 1,
        Err(error) => {
            assert!(!error.to_string().is_empty());
            refused += 1;
        }
    };
    for _ in 0..2000 {
        count(surefoot_levels::import_gltf(&mutate(&exported, &mut rng), None, &PLAIN, &NoFiles));
        // The lengths of the container stay intact, so that the parser reaches the content.
        let mut inside = exported.clone();
        for _ in 0..rng.random_range(1..4) {
            let at = 20 + rng.random_range(0..json_len);
            inside[at] = *b"0123456789-e.[]{},: "[..].get(rng.random_range(0..20)).expect("a byte");
        }
        count(surefoot_levels::import_gltf(&inside, None, &PLAIN, &NoFiles));
        count(surefoot_levels::import_gltf(&mutate(text.as_bytes(), &mut rng), None, &PLAIN, &NoFiles));
        count(surefoot_levels::import_obj(&mutate(obj_level().as_bytes(), &mut rng), None, &PLAIN));
    }
    assert!(imported > 200 && refused > 200, "{imported} imported, {refused} refused");
}

/// Times, s, and the values then.
type Keys<'a> = &'a [(f32, &'a [f32])];

/// A level of boxes with a side of 1 m around their nodes' origins, scaled by their nodes; and animations, each with a
/// node, a path, and keys.
fn animated_level(nodes: Value, animations: &[(usize, &str, Keys<'_>)]) -> Vec<u8> {
    let mut binary: Vec<u8> = Vec::new();
    let (mut views, mut accessors) = (Vec::new(), Vec::new());
    let mut put = |kind: &str, rows: &[Vec<f32>]| {
        let bytes: Vec<u8> = rows.iter().flatten().flat_map(|value| value.to_le_bytes()).collect();
        views.push(json!({ "buffer": 0, "byteOffset": binary.len(), "byteLength": bytes.len() }));
        accessors
            .push(json!({ "bufferView": views.len() - 1, "componentType": 5126, "count": rows.len(), "type": kind }));
        binary.extend(bytes);
        accessors.len() - 1
    };
    let corners: Vec<Vec<f32>> = cuboid(Vec3::splat(-0.5), Vec3::splat(0.5))
        .into_iter()
        .flatten()
        .map(|corner| corner.to_array().to_vec())
        .collect();
    put("VEC3", &corners);
    let animations: Vec<Value> = animations
        .iter()
        .map(|(node, path, keys)| {
            let times: Vec<Vec<f32>> = keys.iter().map(|(at, _)| vec![*at]).collect();
            let values: Vec<Vec<f32>> = keys.iter().map(|(_, value)| value.to_vec()).collect();
            let input = put("SCALAR", &times);
            let output = put(if *path == "rotation" { "VEC4" } else { "VEC3" }, &values);
            json!({
                "channels": [{ "sampler": 0, "target": { "node": node, "path": path } }],
                "samplers": [{ "input": input, "output": output }],
            })
        })
        .collect();
    let count = nodes.as_array().expect("nodes").len();
    let document = json!({
        "asset": { "version": "2.0" },
        "scenes": [{ "nodes": (0..count).collect::<Vec<_>>() }],
        "nodes": nodes,
        "meshes": [{ "primitives": [{ "attributes": { "POSITION": 0 } }] }],
        "accessors": accessors,
        "bufferViews": views,
        "buffers": [{ "byteLength": binary.len() }],
        "animations": animations,
    });
    glb(&document, Some(&binary))
}

#[test]
fn animations_move_lifts_platforms_and_doors() {
    let node = |name: &str, translation: [f32; 3], scale: [f32; 3]| {
        let mesh = 0;
        json!({ "name": name, "mesh": mesh, "translation": translation, "scale": scale })
    };
    let nodes = json!([
        node("floor", [0.0, -0.5, 0.0], [60.0, 1.0, 60.0]),
        node("Elevator", [10.0, 0.1, 0.0], [3.0, 0.2, 3.0]),
        node("Cube.017", [-10.0, 2.0, 0.0], [3.0, 0.2, 3.0]),
        node("Door_a", [0.0, 1.1, 10.0], [1.2, 2.2, 0.1]),
        node("Fan", [0.0, 8.0, 0.0], [4.0, 0.1, 0.5]),
        node("Sky", [0.0, 15.0, 0.0], [50.0, 0.1, 50.0]),
    ]);
    let quarter = std::f32::consts::FRAC_1_SQRT_2;
    let bytes = animated_level(
        nodes,
        &[
            (
                1,
                "translation",
                &[
                    (0.0, &[10.0, 0.1, 0.0]),
                    (2.0, &[10.0, 6.1, 0.0]),
                    (5.0, &[10.0, 6.1, 0.0]),
                    (7.0, &[10.0, 0.1, 0.0]),
                ],
            ),
            // It begins elsewhere than it rests.
            (2, "translation", &[(0.0, &[-10.0, 2.0, 6.0]), (4.0, &[-10.0, 2.0, -6.0])]),
            (3, "rotation", &[(0.0, &[0.0, 0.0, 0.0, 1.0]), (1.5, &[0.0, quarter, 0.0, quarter])]),
            (4, "rotation", &[(0.0, &[0.0, 0.0, 0.0, 1.0]), (1.0, &[0.0, 1.0, 0.0, 0.0])]),
            (5, "translation", &[(0.0, &[0.0, 15.0, 0.0]), (9.0, &[20.0, 15.0, 0.0])]),
        ],
    );
    let imported = surefoot_levels::import_gltf(&bytes, None, &ImportOptions::default(), &NoFiles).unwrap();
    let movers = imported.map.movers();
    let found: Vec<_> = movers.iter().map(|it| (it.name.as_str(), it.kind, it.stops.len(), it.cycles)).collect();
    assert_eq!(
        found,
        [
            ("Elevator", MoverKind::Lift, 2, true),
            ("Cube.017", MoverKind::Platform, 2, true),
            ("Door_a", MoverKind::Door, 2, false)
        ],
        "a fan turns, and what is as large as the level stays"
    );
    let [lift, platform, door] = movers else { panic!("three movers") };
    assert_eq!((lift.travel_s, lift.dwell_s), (2.0, 3.0));
    assert!((lift.stops[1].offset - Vec3::Y * 6.0).length() < 1.0e-4, "{:?}", lift.stops);
    let middle = |stop: usize| {
        let (low, high) = platform.bounds_at(stop);
        (low + high) * 0.5 - imported.map.frame().origin.as_vec3()
    };
    assert!(middle(0).distance(Vec3::new(-10.0, 2.0, 6.0)) < 0.01, "{}", middle(0));
    assert!(middle(1).distance(Vec3::new(-10.0, 2.0, -6.0)) < 0.01, "{}", middle(1));
    assert!((door.stops[1].yaw - std::f32::consts::FRAC_PI_2).abs() < 1.0e-3 && door.travel_s == 1.5, "{door:?}");
    assert!(
        (door.pivot - imported.map.frame().origin.as_vec3() - Vec3::new(0.0, 1.1, 10.0)).length() < 1.0e-3,
        "it turns about its origin"
    );
}

#[test]
fn levels_whose_props_are_animated_in_any_way_are_imported() {
    let node =
        |name: &str, at: [f32; 3]| json!({ "name": name, "mesh": 0, "translation": at, "scale": [2.0, 0.3, 2.0] });
    let mut nodes = vec![json!({ "name": "floor", "mesh": 0, "scale": [60.0, 1.0, 60.0] })];
    // No name, equal names, a long one; and a door that flies open.
    let long = "\u{e4}".repeat(60);
    nodes.extend(
        ["", "", "Cube", "Cube", &long]
            .into_iter()
            .zip(0..)
            .map(|(name, idx)| node(name, [idx as f32 * 4.0, 1.0, 0.0])),
    );
    nodes.push(node("Door_fast", [0.0, 2.0, 12.0]));
    let slow: Keys<'_> = &[(0.0, &[0.0, 1.0, 0.0]), (9000.0, &[0.0, 3.0, 0.0]), (20_000.0, &[0.0, 3.0, 0.0])];
    let fast: Keys<'_> = &[(0.0, &[0.0, 0.0, 0.0, 1.0]), (0.01, &[0.0, 1.0, 0.0, 0.1])];
    let mut animations: Vec<(usize, &str, Keys<'_>)> = (1..6).map(|idx| (idx, "translation", slow)).collect();
    animations.push((6, "rotation", fast));
    let imported = surefoot_levels::import_gltf(
        &animated_level(json!(nodes), &animations),
        None,
        &ImportOptions::default(),
        &NoFiles,
    )
    .unwrap();
    let names: Vec<&str> = imported.map.movers().iter().map(|mover| mover.name.as_str()).collect();
    assert_eq!(names.len(), 6, "{names:?}");
    assert_eq!(names[..4], ["animated.1", "animated.2", "Cube", "Cube.4"]);
    assert!(imported.map.movers().iter().all(|mover| mover.travel_s <= 600.0 && mover.dwell_s <= 600.0));
}

#[test]
fn animations_that_cannot_be_read_are_refused_with_the_node() {
    let nodes = || json!([{ "name": "floor", "mesh": 0, "scale": [60.0, 1.0, 60.0] }, { "name": "lift", "mesh": 0 }]);
    let import = |bytes: &[u8]| surefoot_levels::import_gltf(bytes, None, &ImportOptions::default(), &NoFiles);
    let keys: Keys<'_> = &[(0.0, &[0.0, f32::NAN, 0.0]), (1.0, &[0.0, 5.0, 0.0])];
    refusal(import(&animated_level(nodes(), &[(1, "translation", keys)])), "node `lift`");
    // Animations of bones are ignored.
    let bones = json!([{ "name": "floor", "mesh": 0, "scale": [60.0, 1.0, 60.0] }, { "name": "bone" }]);
    assert!(import(&animated_level(bones, &[(1, "translation", keys)])).is_ok());
    let keys: Keys<'_> = &[(0.0, &[0.0, 1.0, 0.0]), (1.0, &[0.0, 5.0, 0.0])];
    let bytes = animated_level(nodes(), &[(1, "translation", keys)]);
    let channel = bytes.windows(11).position(|window| window == b"\"sampler\":0").unwrap();
    let mut foreign = bytes;
    foreign[channel + 10] = b'7';
    refusal(import(&foreign), "sampler");
}
