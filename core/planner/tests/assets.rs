//! Links as assets: every format holds every link, on its own axes, and stays what it is.

use proptest::prelude::*;
use serde_json::Value;
use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;
use surefoot_planner::EdgeKey;
use surefoot_planner::assets::{AssetFormat, Axes, Connected, Leap, Link, LinkSet, Passage};
use surefoot_world::map::{LevelFrame, UpAxis};
use surefoot_world::{Ability, DVec3, Vec3};

/// A double jump up a ledge, and a drop down with a walk over ground that no NavMesh has.
fn tiny() -> LinkSet {
    let up = Leap {
        ability: Ability::DOUBLE_JUMP,
        take_off: Vec3::new(4.0, 0.0, 2.5),
        apex: Vec3::new(5.25, 4.5, 2.5),
        landing: Vec3::new(7.0, 3.0, 2.5),
        seconds: 1.25,
        speed: 6.0,
        second_jump: Some(0.5),
    };
    let down = Leap {
        ability: Ability::WALK,
        take_off: Vec3::new(7.0, 3.0, 4.0),
        apex: Vec3::new(7.0, 3.0, 4.0),
        landing: Vec3::new(5.0, 0.0, 4.0),
        seconds: 0.75,
        speed: 3.0,
        second_jump: None,
    };
    let link = |edge_idx, key: (u32, u32), leap: Leap, end, driven| Link {
        edge_idx,
        edge: EdgeKey::new(key.0, key.1),
        passage: Passage { start: leap.take_off, end, leaps: vec![leap], seconds: leap.seconds, driven },
        ability: leap.ability,
        chance: 0.875,
        cost_seconds: 2.0,
    };
    LinkSet {
        links: vec![link(3, (0, 1), up, up.landing, 0.75), link(8, (1, 0), down, down.landing - Vec3::X, 1.0)],
        radius: 0.25,
        speed: 10.0,
        connected: Connected { without: 0.25, with: 1.0 },
        frame: Some(LevelFrame { origin: DVec3::new(2.0, 1.0, 3.5), ..LevelFrame::default() }),
        moves: Arc::default(),
    }
}

fn json(format: AssetFormat) -> Value {
    serde_json::from_str(&format.write(&tiny())).unwrap()
}

/// The point on our axes, m, that is at `point` on these axes.
fn on_ours(axes: Axes, [x, y, z]: [f32; 3]) -> Vec3 {
    match axes {
        Axes::Ours => Vec3::new(x, y, z),
        Axes::Unity => Vec3::new(-x, y, z),
        Axes::Unreal => Vec3::new(x, z, y) / axes.units_per_metre(),
    }
}

fn numbers<const N: usize>(values: [&Value; N]) -> [f32; N] {
    values.map(|value| value.as_f64().unwrap() as f32)
}

fn array(value: &Value) -> [f32; 3] {
    numbers([&value[0], &value[1], &value[2]])
}

/// The start and the end of each link of a format, on our axes.
fn ends(format: AssetFormat) -> Vec<[Vec3; 2]> {
    let document = json(format);
    let of_links =
        |ends: &dyn Fn(&Value) -> [Vec3; 2]| document["links"].as_array().unwrap().iter().map(ends).collect();
    match format {
        AssetFormat::Detour => {
            let numbers = document["offMeshConVerts"].as_array().unwrap();
            let ends = numbers
                .chunks(3)
                .map(|at| Vec3::from_array(at.iter().map(as_f32).collect::<Vec<_>>().try_into().unwrap()));
            ends.collect::<Vec<_>>().chunks(2).map(|pair| [pair[0], pair[1]]).collect()
        }
        AssetFormat::Unity => of_links(&|link| {
            ["startPoint", "endPoint"]
                .map(|end| on_ours(Axes::Unity, numbers([&link[end]["x"], &link[end]["y"], &link[end]["z"]])))
        }),
        AssetFormat::Unreal => of_links(&|link| {
            ["Left", "Right"]
                .map(|end| on_ours(Axes::Unreal, numbers([&link[end]["X"], &link[end]["Y"], &link[end]["Z"]])))
        }),
        AssetFormat::Landmass => {
            of_links(&|link| ["start_edge", "end_edge"].map(|edge| Vec3::from_array(array(&link[edge][0]))))
        }
        AssetFormat::Links => of_links(&|link| ["start", "end"].map(|end| Vec3::from_array(array(&link[end])))),
        AssetFormat::Godot => unreachable!("a scene is no JSON"),
    }
}

fn as_f32(value: &Value) -> f32 {
    value.as_f64().unwrap() as f32
}

fn expected_ends() -> Vec<[Vec3; 2]> {
    tiny().links.iter().map(|link| [link.passage.start, link.passage.end]).collect()
}

#[test]
fn every_json_format_has_the_same_ends_once_its_axes_are_undone() {
    for format in AssetFormat::ALL.iter().copied().filter(|format| *format != AssetFormat::Godot) {
        assert_eq!(ends(format), expected_ends(), "{}", format.name());
    }
}

#[test]
fn hints_are_on_the_axes_of_their_format() {
    let apex = tiny().links[0].passage.leaps[0].apex;
    for (format, axes) in
        [(AssetFormat::Unity, Axes::Unity), (AssetFormat::Unreal, Axes::Unreal), (AssetFormat::Landmass, Axes::Ours)]
    {
        let about = if format == AssetFormat::Unreal { "About" } else { "about" };
        let leap = &json(format)["links"][0][about]["leaps"][0];
        assert_eq!(on_ours(axes, array(&leap["apex"])), apex, "{}", format.name());
        assert_eq!(as_f32(&leap["speed"]), 6.0 * axes.units_per_metre());
    }
}

#[test]
fn costs_say_how_far_a_walk_as_long_would_be() {
    // 2 s at 10 m/s.
    assert_eq!(json(AssetFormat::Landmass)["links"][1]["cost"], 20.0);
    assert_eq!(json(AssetFormat::Unreal)["links"][1]["EnteringCost"], 2000.0);
    let modifier = as_f32(&json(AssetFormat::Unity)["links"][1]["costModifier"]);
    let [start, end] = expected_ends()[1];
    assert!((modifier * start.distance(end) - 20.0).abs() < 1.0e-4);
}

/// The nodes of a scene: each with its fields.
fn nodes(scene: &str) -> Vec<(String, BTreeMap<String, String>)> {
    let mut nodes: Vec<(String, BTreeMap<String, String>)> = Vec::new();
    for line in scene.lines().filter(|line| !line.is_empty()) {
        if let Some(heading) = line.strip_prefix('[') {
            nodes.push((heading.strip_suffix(']').expect("a closed heading").to_owned(), BTreeMap::new()));
            continue;
        }
        let (name, value) = line.split_once(" = ").expect("a field");
        let fields = &mut nodes.last_mut().expect("fields follow a heading").1;
        assert!(fields.insert(name.to_owned(), value.to_owned()).is_none(), "{name} is given once");
    }
    nodes
}

fn vector(text: &str) -> Vec3 {
    let inner = text.strip_prefix("Vector3(").and_then(|rest| rest.strip_suffix(')')).expect("a Vector3");
    let numbers: Vec<f32> = inner.split(", ").map(|number| number.parse().unwrap()).collect();
    Vec3::from_array(numbers.try_into().unwrap())
}

#[test]
fn a_godot_scene_is_read_back() {
    let nodes = nodes(&AssetFormat::Godot.write(&tiny()));
    assert_eq!(nodes[0].0, "gd_scene format=3");
    assert_eq!(nodes[1].0, "node name=\"SurefootLinks\" type=\"Node3D\"");
    assert_eq!(nodes.len(), 4);
    for ((idx, [start, end]), (heading, fields)) in expected_ends().into_iter().enumerate().zip(&nodes[2..]) {
        assert_eq!(*heading, format!("node name=\"Link{idx}\" type=\"NavigationLink3D\" parent=\".\""));
        assert_eq!([vector(&fields["start_position"]), vector(&fields["end_position"])], [start, end]);
        let number = |name: &str| fields[name].parse::<f32>().unwrap();
        let cost = number("enter_cost") + number("travel_cost") * start.distance(end);
        assert!((cost - 20.0).abs() < 1.0e-4, "{cost}");
        assert_eq!(fields["bidirectional"], "false");
    }
    assert_eq!(nodes[2].1["metadata/ability"], "\"double_jump\"");
    assert_eq!(vector(&nodes[2].1["metadata/apex"]), Vec3::new(5.25, 4.5, 2.5));
    assert!(nodes[2].1["metadata/leaps"].contains("\"second_jump\": 0.5"));
}

#[test]
fn formats_stay_what_they_are() {
    // A deliberate change of a format replaces these files. A change in the meaning of a field increments the version.
    let golden = [
        (AssetFormat::Detour, include_str!("golden/links.detour.json")),
        (AssetFormat::Godot, include_str!("golden/links.godot.tscn")),
        (AssetFormat::Unity, include_str!("golden/links.unity.json")),
        (AssetFormat::Unreal, include_str!("golden/links.unreal.json")),
        (AssetFormat::Landmass, include_str!("golden/links.landmass.json")),
        (AssetFormat::Links, include_str!("golden/links.links.json")),
    ];
    let changed = golden.into_iter().filter(|(format, text)| format.write(&tiny()) != *text);
    let changed: Vec<String> =
        changed.map(|(format, _)| format!("=== {}\n{}", format.name(), format.write(&tiny()))).collect();
    assert!(changed.is_empty(), "these formats have changed:\n{}===", changed.join(""));
}

#[test]
fn files_say_where_a_level_lies_that_is_far_from_its_origin() {
    let frame = LevelFrame { origin: DVec3::new(-512_345.25, 2.0, 5_400_123.5), scale: 0.01, up: UpAxis::Z };
    let set = LinkSet { frame: Some(frame), ..tiny() };
    let document = |format: AssetFormat| serde_json::from_str::<Value>(&format.write(&set)).unwrap();
    for format in [AssetFormat::Links, AssetFormat::Landmass, AssetFormat::Detour] {
        let document = document(format);
        assert_eq!(document["origin"], serde_json::json!([-512_345.25, 2.0, 5_400_123.5]), "{}", format.name());
        assert_eq!(document["scale"], 0.01, "{}", format.name());
        assert_eq!(document["up"], "z", "{}", format.name());
    }
    assert_eq!(document(AssetFormat::Unity)["origin"]["z"], 5_400_123.5);
    assert_eq!(document(AssetFormat::Unreal)["origin"]["Y"], 540_012_350.0);
    let scene = nodes(&AssetFormat::Godot.write(&set));
    assert_eq!(scene[1].1["metadata/origin"], "Vector3(-512345.25, 2, 5400123.5)");
    assert_eq!((scene[1].1["metadata/scale"].as_str(), scene[1].1["metadata/up"].as_str()), ("0.01", "\"z\""));
}

proptest! {
    #[test]
    fn points_come_back_from_every_engine(x in -1.0e3f32..1.0e3, y in -1.0e3f32..1.0e3, z in -1.0e3f32..1.0e3) {
        let point = Vec3::new(x, y, z);
        for axes in [Axes::Ours, Axes::Unity, Axes::Unreal] {
            prop_assert!(on_ours(axes, axes.point(point)).distance(point) < 1.0e-3, "{axes:?}");
        }
    }
}

#[test]
fn up_stays_up_and_hands_change() {
    let determinant = |axes: Axes| {
        let [x, y, z] = [Vec3::X, Vec3::Y, Vec3::Z].map(|axis| Vec3::from_array(axes.point(axis)));
        x.cross(y).dot(z)
    };
    assert!(determinant(Axes::Ours) > 0.0 && determinant(Axes::Unity) < 0.0 && determinant(Axes::Unreal) < 0.0);
    assert_eq!(Axes::Unity.point(Vec3::Y), [0.0, 1.0, 0.0]);
    assert_eq!(Axes::Unreal.point(Vec3::Y), [0.0, 0.0, 100.0]);
}

#[test]
fn pairs_are_ordered_and_links_lead_one_way() {
    let islands = [Some(0), Some(0), Some(7), None];
    let alone = Connected::of(&islands, std::iter::empty());
    assert!((alone.without - 2.0 / 6.0).abs() < 1.0e-12 && alone.with == alone.without);
    let down = Connected::of(&islands, [(Some(0), Some(7)), (None, Some(0))].into_iter());
    assert!((down.with - 4.0 / 6.0).abs() < 1.0e-12);
    let both = Connected::of(&islands, [(Some(0), Some(5)), (Some(5), Some(7)), (Some(7), Some(0))].into_iter());
    assert_eq!(both.with, 1.0, "an island without vertices may lie between");
    assert_eq!(Connected::of(&[None], std::iter::empty()), Connected::default());
}

proptest! {
    #![proptest_config(ProptestConfig {
        cases: 200,
        rng_seed: proptest::test_runner::RngSeed::Fixed(1),
        failure_persistence: None,
        ..ProptestConfig::default()
    })]

    #[test]
    fn shares_are_those_of_a_walk_from_every_vertex(
        islands in prop::collection::vec(prop::option::weighted(0.9, 0..12u32), 0..40),
        joins in prop::collection::vec(prop::array::uniform2(prop::option::weighted(0.9, 0..15u32)), 0..25),
    ) {
        let joins: Vec<(Option<u32>, Option<u32>)> = joins.into_iter().map(|[from, to]| (from, to)).collect();
        let connected = Connected::of(&islands, joins.iter().copied());
        let vertices: Vec<u32> = islands.iter().copied().flatten().collect();
        let share = |joins: &[(Option<u32>, Option<u32>)]| {
            let joined = vertices.iter().map(|from| {
                let mut reached = BTreeSet::from([*from]);
                let joins = || joins.iter().filter_map(|(from, to)| from.zip(*to));
                while joins().any(|(from, to)| reached.contains(&from) && reached.insert(to)) {}
                vertices.iter().filter(|to| reached.contains(to)).count() - 1
            });
            joined.sum::<usize>() as f64 / (vertices.len() * vertices.len().saturating_sub(1)).max(1) as f64
        };
        prop_assert_eq!(connected, Connected { without: share(&[]), with: share(&joins) });
    }
}
