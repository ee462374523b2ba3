//! What nodes become, what does not belong, and what an import reports.

use crate::{PLAIN, corners, gltf, gltf_level, obj_box};
use serde_json::json;
use surefoot_levels::{ImportOptions, Imported, NoFiles, NodeReport, Role, Warning, role_counts};
use surefoot_world::map::MoverKind;
use surefoot_world::mesh::Surface;
use surefoot_world::{Map, Vec3};

const FLOOR: ([f32; 3], [f32; 3]) = ([0.0, 0.0, 0.0], [60.0, 1.0, 60.0]);

fn import(nodes: &[(&str, [f32; 3], [f32; 3])], sidecar: Option<&str>, options: &ImportOptions) -> Imported {
    let floor = obj_box("Ground", FLOOR.0, FLOOR.1);
    let text: String = nodes.iter().map(|(name, low, high)| obj_box(name, *low, *high)).collect();
    surefoot_levels::import_obj(format!("{floor}{text}").as_bytes(), sidecar, options).expect("a valid level")
}

/// The role of one crate-sized node of this name.
fn role_of(name: &str) -> (Role, Imported) {
    let imported = import(&[(name, [5.0, 1.0, 5.0], [7.0, 3.0, 7.0])], None, &PLAIN);
    (imported.nodes[1].role, imported)
}

#[test]
fn a_name_means_something_only_as_a_whole_word_at_the_start() {
    for (name, expected) in [
        ("water", Role::Water),
        ("Water_01", Role::Water),
        ("WATER.001", Role::Water),
        ("water-deep", Role::Water),
        ("Lava 2", Role::Lava),
        ("lava3", Role::Lava),
        ("Pad_1", Role::Pad),
        ("jetpack", Role::Jetpack),
        ("Door_A", Role::Door),
        ("vanish_2", Role::Floor),
        ("pushable.crate", Role::Crate),
        ("Ladder_2", Role::Ladder),
        ("climb wall", Role::Climb),
        ("trigger_exit", Role::Helper),
        ("UCX_rock_01", Role::Helper),
        ("yard-navmesh", Role::Helper),
        // Further letters, or words that say that it is something else.
        ("Waterfront_Pier", Role::Solid),
        ("Lavatory_Floor", Role::Solid),
        ("Padded_Cell", Role::Solid),
        ("Triggerfish", Role::Solid),
        ("Doorway_3", Role::Solid),
        ("Door_Frame_3", Role::Solid),
        ("Door_Wall_A", Role::Solid),
        ("Water_Tower", Role::Solid),
        ("rainwater", Role::Solid),
        ("move_rope:from", Role::Solid),
        ("Moved_Crate", Role::Solid),
        ("lift_1", Role::Solid),
        ("conveyor", Role::Solid),
    ] {
        let (role, imported) = role_of(name);
        assert_eq!(role, expected, "{name}");
        let is_solid = corners(&imported.map).len() > 12;
        let holds = [Role::Solid, Role::Ladder, Role::Climb].contains(&expected);
        assert_eq!(is_solid, holds, "{name}");
        let reason = &imported.nodes[1].reason;
        let lacks = ["lift_1", "conveyor", "move_rope:from"].contains(&name);
        assert_eq!(reason.is_empty(), expected == Role::Solid && !lacks, "{name}: {reason}");
        let is_near = imported.warnings.iter().any(|warning| matches!(warning, Warning::NearMiss { .. }));
        let is_expected =
            ["Waterfront_Pier", "Lavatory_Floor", "Padded_Cell", "Triggerfish", "Doorway_3"].contains(&name);
        assert_eq!(is_near, is_expected, "{name}: {:?}", imported.warnings);
    }
    let (_, imported) = role_of("Waterfront_Pier");
    assert!(
        imported.warnings[0].to_string().contains("`Waterfront_Pier`")
            && imported.warnings[0].to_string().contains("`water_1`")
    );
}

#[test]
fn play_begins_where_names_and_the_sidecar_say() {
    let point = |name: &'static str, x: f32| (name, [x, 1.0, 5.0], [x + 0.5, 2.8, 5.5]);
    let nodes = [
        point("PlayerStart_1", 5.0),
        point("SpawnPoint", 10.0),
        point("info_player_start", 15.0),
        point("spawn.002", 20.0),
        point("Spawner", 25.0),
        point("Respawn_Room", 30.0),
        ("Spawn_Platform", [40.0, 1.0, 5.0], [44.0, 1.5, 9.0]),
    ];
    let sidecar = r#"{"nodes": {"Respawn*": "spawn"}, "spawns": [{"at": [50, 1, 50]}]}"#;
    let imported = import(&nodes, Some(sidecar), &PLAIN);
    let spots = &imported.map.placed().spots;
    let level = |place: Vec3| imported.map.frame().to_level(place).x.round();
    let spawns = spots.iter().map(|spot| (spot.tag.as_str(), level(spot.from)));
    let mut spawns: Vec<(&str, f64)> = spawns.collect();
    spawns.sort_by(|a, b| a.1.total_cmp(&b.1));
    assert_eq!(spawns, [5.0, 10.0, 15.0, 20.0, 30.0, 50.0].map(|x| ("spawn", x)));
    assert_eq!(corners(&imported.map).len(), 3 * 12, "the ground, a spawner and a platform are solid");
    let exported = surefoot_levels::export_glb(&imported.map);
    let again = surefoot_levels::import_gltf(&exported, None, &PLAIN, &NoFiles).expect("an export is a level");
    assert_eq!(again.map.placed().spots, *spots);
}

#[test]
fn what_is_no_complete_device_stays_solid_with_a_warning() {
    for (name, expected) in [
        ("Teleporter_Base", "does not say which end it is and stays solid"),
        ("zip_line", "call it `zip_line:from` or `zip_line:to`"),
        ("zip_line_1:from", "has no other end and stays solid: add a node `zip_line_1:to`"),
        ("Teleporter_to.007", "add a node `Teleporter_from.007`"),
    ] {
        let (role, imported) = role_of(name);
        let warnings: Vec<String> = imported.warnings.iter().map(ToString::to_string).collect();
        assert!(role == Role::Solid && warnings.iter().any(|it| it.contains(expected)), "{name}: {warnings:?}");
        assert!(corners(&imported.map).len() > 12, "{name}");
    }
    let twice = import(
        &[
            ("teleporter_1:from", [5.0, 1.0, 5.0], [6.0, 2.0, 6.0]),
            ("teleporter_1:to", [25.0, 1.0, 5.0], [26.0, 2.0, 6.0]),
            ("teleporter_1:to", [35.0, 1.0, 5.0], [36.0, 2.0, 6.0]),
        ],
        None,
        &PLAIN,
    );
    assert_eq!(twice.map.placed().teleporters.len(), 1);
    assert_eq!(role_counts(&twice.nodes), [(Role::Solid, 2), (Role::Teleporter, 2)]);
    assert!(twice.warnings[0].to_string().contains("second to end"), "{:?}", twice.warnings);

    let large = import(&[("Pad_Landing_01", [0.0, 1.0, 0.0], [20.0, 2.0, 4.0])], None, &PLAIN);
    assert_eq!((large.nodes[1].role, large.map.placed().pads.len()), (Role::Solid, 0));
    assert!(large.warnings[0].to_string().contains("20 m are too much"), "{:?}", large.warnings);
}

#[test]
fn names_are_turned_off_and_nodes_switched_by_the_sidecar() {
    let nodes = [
        ("water_1", [5.0, 1.0, 5.0], [9.0, 2.0, 9.0]),
        ("Waterfront", [15.0, 1.0, 5.0], [19.0, 2.0, 9.0]),
        ("gate", [25.0, 1.0, 5.0], [29.0, 4.0, 5.2]),
        ("Pad_2", [35.0, 1.0, 5.0], [36.0, 1.2, 6.0]),
        ("fx_smoke", [45.0, 1.0, 5.0], [46.0, 2.0, 6.0]),
    ];
    let roles = |imported: &Imported| imported.nodes[1..].iter().map(|node| node.role).collect::<Vec<_>>();
    let all_solid = [Role::Solid; 5];
    let ignored = import(&nodes, None, &ImportOptions { ignore_names: true, ..PLAIN });
    assert_eq!((roles(&ignored).as_slice(), ignored.warnings.as_slice()), (&all_solid[..], &[][..]));
    assert_eq!(roles(&import(&nodes, Some(r#"{"names": false}"#), &PLAIN)), all_solid);

    let sidecar = r#"{"nodes": {"water*": "lava", "Waterfront": "water", "gate": "door", "pad_2": "solid",
        "fx_*": "leave_out"}}"#;
    let switched = import(&nodes, Some(sidecar), &PLAIN);
    assert_eq!(roles(&switched), [Role::Lava, Role::Water, Role::Door, Role::Solid, Role::LeftOut]);
    assert!(switched.nodes[1..].iter().all(|node| node.reason == "the sidecar says so"));
    assert_eq!(switched.map.movers()[0].kind, MoverKind::Door);
    // With names turned off, the sidecar still counts.
    let both = format!(r#"{{"names": false, {}"#, &sidecar[1..]);
    assert_eq!(roles(&import(&nodes, Some(&both), &PLAIN)), roles(&switched));

    let refused = surefoot_levels::import_obj(b"v 0 0 0\nf 1 1 1", Some(r#"{"nodes": {"a": "swamp"}}"#), &PLAIN);
    let error = refused.expect_err("no such role").to_string();
    assert!(error.contains("swamp") && error.contains("leave_out"), "{error}");
}

#[test]
fn the_report_has_every_node_with_its_box_in_the_levels_own_coordinates() {
    let level = gltf_level(json!([
        { "name": "floor", "mesh": 0, "translation": [100, 5, 0] },
        { "name": "group", "children": [2] },
        { "name": "water_1", "mesh": 0, "translation": [102, 6, 2], "scale": [0.25, 1, 0.25], "children": [3] },
        { "name": "ripples", "mesh": 0, "scale": [0.5, 1, 0.5] },
        { "name": "Camera" },
    ]));
    let mut level = level;
    level["scenes"][0]["nodes"] = json!([0, 1, 4]);
    let Imported { nodes, .. } = gltf(&level).expect("a valid level");
    let short: Vec<(usize, &str, Role, &str, usize)> = nodes
        .iter()
        .map(|NodeReport { index, name, role, reason, triangles, .. }| {
            (*index, name.as_str(), *role, reason.as_str(), *triangles)
        })
        .collect();
    assert_eq!(
        short,
        [
            (0, "floor", Role::Solid, "", 1),
            (1, "group", Role::Empty, "", 0),
            (2, "water_1", Role::Water, "its name begins with `water`", 1),
            (3, "ripples", Role::Water, "it belongs to node `water_1`", 1),
            (4, "Camera", Role::Empty, "", 0),
        ]
    );
    let [low, high] = nodes[0].bounds.expect("it has triangles").map(|corner| corner.to_array());
    assert_eq!((low, high), ([100.0, 5.0, 0.0], [108.0, 5.0, 8.0]));
    let json = serde_json::to_value(&nodes[2]).expect("plain data");
    assert_eq!((&json["role"], &json["bounds"][0]), (&json!("water"), &json!([102.0, 6.0, 2.0])));
}

#[test]
fn doors_may_share_a_name_and_be_wide() {
    let doors = [
        ("Door", [5.0, 1.0, 5.0], [6.0, 3.0, 5.2]),
        ("Door", [15.0, 1.0, 5.0], [16.0, 3.0, 5.2]),
        ("door_hangar", [20.0, 1.0, 5.0], [40.0, 9.0, 5.4]),
    ];
    let imported = import(&doors, None, &PLAIN);
    let names: Vec<&str> = imported.map.movers().iter().map(|mover| mover.name.as_str()).collect();
    assert_eq!(names, ["Door", "Door.2", "door_hangar"]);
    assert_eq!(imported.nodes.iter().map(|node| node.index).collect::<Vec<_>>(), [0, 1, 2, 3]);
    assert!(imported.map.movers()[2].travel_s > 1.5, "no door is faster than movers may be");
}

#[test]
fn what_belongs_to_a_mover_does_not_hide_it_and_what_is_left_out_takes_its_features_along() {
    let mut level = gltf_level(json!([
        { "name": "floor", "mesh": 0, "scale": [5, 1, 5] },
        { "name": "Lift_1", "children": [2, 3] },
        { "name": "cabin", "mesh": 0, "translation": [10, 1, 10], "scale": [0.25, 1, 0.25] },
        { "name": "Lift_1:path", "translation": [10, 6, 10] },
        { "name": "old", "extras": { "solid": false }, "children": [5] },
        { "name": "water_1", "mesh": 0, "translation": [20, 1, 20] },
        { "name": "hidden", "extensions": { "KHR_node_visibility": { "visible": false } }, "children": [7] },
        { "name": "wall", "mesh": 0, "translation": [4, 2, 20] },
    ]));
    level["scenes"][0]["nodes"] = json!([0, 1, 4, 6]);
    let imported = gltf(&level).expect("a valid level");
    let roles: Vec<Role> = imported.nodes.iter().map(|node| node.role).collect();
    let lift = [Role::Lift, Role::Lift, Role::Path];
    assert_eq!(roles[1..4], lift);
    assert_eq!(roles[4..], [Role::LeftOut; 4]);
    assert_eq!((imported.map.movers().len(), imported.map.placed().pools.len()), (1, 0));
}

#[test]
fn ordinary_levels_of_boxes_warn_of_nothing() {
    // Boxes that touch, overlap and stand on each other.
    let boxes = [
        ("a", [5.0, 1.0, 5.0], [9.0, 3.0, 9.0]),
        ("b", [9.0, 1.0, 5.0], [12.0, 3.0, 9.0]),
        ("c", [5.0, 3.0, 5.0], [9.0, 5.0, 9.0]),
        ("d", [8.0, 0.5, 8.0], [20.0, 2.0, 20.0]),
    ];
    let imported = import(&boxes, None, &PLAIN);
    assert_eq!(imported.warnings, []);
    assert_eq!(imported.geometry.triangles, 60);
}

#[test]
fn a_ladder_becomes_its_smallest_upright_box_and_an_export_keeps_it() {
    // Two rails and a rung, turned by 37 degrees.
    let (sin, cos) = (0.6, 0.8);
    let bar = |from: [f64; 2], to: [f64; 2]| {
        let at = |side: f64, depth: f64, y: f64| {
            format!("v {} {y} {}\n", 30.0 + cos * side - sin * depth, 30.0 + sin * side + cos * depth)
        };
        let mut text = String::new();
        for depth in [-0.03, 0.03] {
            for (side, y) in [(from[0], from[1]), (to[0], from[1]), (to[0], to[1]), (from[0], to[1])] {
                text += &at(side, depth, y);
            }
        }
        text + "f -8 -7 -6 -5\nf -4 -3 -2 -1\n"
    };
    let mut text = obj_box("Ground", FLOOR.0, FLOOR.1) + "o ladder\n";
    for (from, to) in [([-0.3, 1.0], [-0.25, 5.0]), ([0.25, 1.0], [0.3, 5.0]), ([-0.3, 2.0], [0.3, 2.05])] {
        text += &bar(from, to);
    }
    let imported = surefoot_levels::import_obj(text.as_bytes(), None, &PLAIN).expect("a valid level");
    assert_eq!(imported.nodes[1].role, Role::Ladder);
    let climbed = |map: &Map| {
        let triangles = map.mesh().triangles().iter().filter(|triangle| triangle.surface() == Surface::Climb);
        triangles.flat_map(|triangle| triangle.corners()).collect::<Vec<_>>()
    };
    let corners = climbed(&imported.map);
    assert_eq!(corners.len(), 36, "a box");
    let widest =
        corners.iter().flat_map(|a| corners.iter().map(|b| (*a - *b).with_y(0.0).length())).fold(0.0, f32::max);
    assert!((widest - 0.603).abs() < 0.01, "{widest} m: it is as wide as the ladder, with its depth");
    let exported = surefoot_levels::export_glb(&imported.map);
    let again = surefoot_levels::import_gltf(&exported, None, &PLAIN, &NoFiles).expect("an export is a level");
    assert_eq!(climbed(&again.map).len(), 36);
}
