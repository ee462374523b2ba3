//! What OBJ files hold: the syntax that exporters write, polygons of any shape, and faults by line.

use super::{PLAIN, corners, obj_box, obj_level, refusal};
use glam::{DQuat, DVec2, DVec3};
use proptest::prelude::*;
use std::f64::consts::TAU;
use surefoot_levels::{ImportError, ImportOptions, Imported};
use surefoot_world::Vec3;
use surefoot_world::map::{Liquid, Outline};

/// Imports a level whose faces keep their sides.
fn import(text: impl AsRef<[u8]>) -> Result<Imported, ImportError> {
    surefoot_levels::import_obj(text.as_ref(), None, &ImportOptions { keep_sides: true, ..PLAIN })
}

// Syntax.

/// The same text with each line changed that begins with `keyword`.
fn with_lines(text: &str, keyword: char, change: impl Fn(&str) -> String) -> String {
    let changed = |line: &str| if line.starts_with(keyword) { change(line) } else { line.to_owned() };
    text.lines().map(|line| changed(line) + "\n").collect()
}

/// The same text with references that count from the first vertex.
fn with_absolute_references(text: &str) -> String {
    let mut vertex_count = 0;
    let mut absolute = |line: &str| {
        vertex_count += i32::from(line.starts_with("v "));
        let Some(corners) = line.strip_prefix("f ") else { return format!("{line}\n") };
        let number = |corner: &str| vertex_count + 1 + corner.parse::<i32>().expect("a negative number");
        format!("f{}\n", corners.split(' ').map(|corner| format!(" {}", number(corner))).collect::<String>())
    };
    text.lines().map(&mut absolute).collect()
}

/// The same text with all vertices at its end.
fn with_vertices_last(text: &str) -> String {
    let absolute = with_absolute_references(text);
    let (vertices, others): (Vec<&str>, Vec<&str>) = absolute.lines().partition(|line| line.starts_with("v "));
    [others, vertices].concat().join("\n")
}

#[test]
fn the_same_level_is_read_however_it_is_written() {
    let level = obj_level();
    let with_parts = |line: &str| {
        let parts = ["/", "/9", "//9", "/9/9", "/99999999999/"];
        let corners = line.split(' ').skip(1).zip(parts);
        format!("f{}", corners.map(|(corner, part)| format!(" {corner}{part}")).collect::<String>())
    };
    let (before, after) = level.split_once("north").expect("a part of a name");
    let cases: Vec<(&str, Vec<u8>)> = vec![
        ("byte-order mark", format!("\u{feff}{level}").into()),
        ("CR LF", level.replace('\n', "\r\n").into()),
        ("CR", level.replace('\n', "\r").into()),
        ("tabs", level.replace(' ', "\t").into()),
        ("indented lines", level.replace('\n', " \n  ").into()),
        ("no line break at the end", level.trim_end().into()),
        ("comments at line ends", level.replace('\n', " # f 1 2\n").into()),
        ("comments after vertices", with_lines(&level, 'v', |line| format!("{line}#1")).into()),
        ("comments after faces", with_lines(&level, 'f', |line| format!("{line}#1")).into()),
        ("continued lines", level.replace(' ', " \\\n").into()),
        ("continued lines with CR LF", level.replace(' ', "\\\r\n").into()),
        ("a comment that ends with a backslash", format!("# C:\\levels\\\n{level}").into()),
        ("weights", with_lines(&level, 'v', |line| format!("{line} 2.0")).into()),
        ("colours", with_lines(&level, 'v', |line| format!("{line} 0.5 0.25 1")).into()),
        ("exponents", level.replace("40", "+4.0E1").into()),
        ("references that count from the first vertex", with_absolute_references(&level).into()),
        ("faces before vertices", with_vertices_last(&level).into()),
        ("missing texture coordinates and normals", with_lines(&level, 'f', with_parts).into()),
        ("elements of too few corners", format!("{level}f\nf 1\nf 1 2\nf 1 1 2 2\nl 1\np 1 2\ncurv 0 1 1 2\n").into()),
        ("materials", level.replace("o Lava", "usemtl\nmtllib a b.mtl\nvt 0\nvn x\ns off\nusemtl a#b\no Lava").into()),
        ("a name that is not UTF-8", [before.as_bytes(), b"\xff\xe9", after.as_bytes()].concat()),
    ];
    let plain = import(&level).expect("a valid level").map.hash();
    for (name, text) in cases {
        assert_eq!(import(text).unwrap_or_else(|error| panic!("{name}: {error}")).map.hash(), plain, "{name}");
    }
}

#[test]
fn objects_and_groups_are_nodes() {
    let floor = obj_box("floor", [0.0, -1.0, 0.0], [40.0, 0.0, 40.0]);
    let pad = |x: f32| obj_box("pad", [x, 0.0, 5.0], [x + 1.0, 0.1, 6.0]);
    let pad_count = |text: String| import(floor.clone() + &text).expect("a valid level").map.placed().pads.len();
    assert_eq!(pad_count(pad(5.0) + &obj_box("crate", [9.0, 0.0, 9.0], [10.0, 1.0, 10.0]) + &pad(12.0)), 2);
    // The latest name counts, and a name without faces is no node.
    assert_eq!(pad_count(pad(5.0).replace("o pad", "o crates\ng pad")), 1);
    assert_eq!(pad_count(pad(5.0).replace("o pad", "g pad\no crates")), 0);
    assert_eq!(pad_count(pad(5.0) + "o pad\np 1\n"), 1);
}

#[test]
fn polylines_are_not_solid_but_give_features_their_size() {
    let floor = obj_box("floor", [0.0, -1.0, 0.0], [40.0, 0.0, 40.0]);
    let solid_count = |text: &str| import(text).expect("a valid level").map.mesh().triangles().len();
    let rail = "o rail\nv 1 1 1\nv 9 1 1\nv 9 1 9\nv 1 1 9\nl -4 -3 -2 -1\n";
    assert_eq!(solid_count(&format!("{floor}{rail}")), solid_count(&floor));
    let pool = "o water\nv 5 0 5\nv 15 0.5 25\nl -2/1 -1/2\n";
    let map = import(format!("{floor}{pool}")).expect("a valid level").map;
    let pools: Vec<_> = map.placed().pools.iter().map(|pool| (pool.liquid, pool.outline)).collect();
    assert_eq!(pools, [(Liquid::Water, Outline::Rectangle { half_x: 5.0, half_z: 10.0 })]);
}

#[test]
fn levels_far_from_the_origin_keep_their_millimetres() {
    let level = |offset: DVec3| {
        let at = |x: f64, y: f64, z: f64| {
            let corner = offset + DVec3::new(x, y, z);
            format!("v {:.3} {:.3} {:.3}\n", corner.x, corner.y, corner.z)
        };
        let quad = [at(0.0, 0.0, 0.0), at(0.125, 0.251, 20.003), at(20.007, 0.502, 20.004), at(20.009, 0.253, 0.001)];
        let map = import(format!("{}f 1 2 3 4\n", quad.concat())).expect("a valid level").map;
        corners(&map)
    };
    let near = level(DVec3::ZERO);
    let far = level(DVec3::new(612_345.678, 317.25, -5_876_543.21));
    assert_eq!((near.len(), far.len()), (2, 2));
    for (near, far) in near.as_flattened().iter().zip(far.as_flattened()) {
        assert!(near.distance(*far) < 1.0e-3, "{near} {far}");
    }
}

// Polygons.

fn shoelace(outline: &[DVec2]) -> f64 {
    let edges = outline.iter().zip(outline.iter().cycle().skip(1));
    0.5 * edges.map(|(from, to)| from.perp_dot(*to)).sum::<f64>()
}

/// One face with corners at `points`.
fn face(points: impl ExactSizeIterator<Item = DVec3>) -> String {
    let corners: String = (1..=points.len()).map(|corner| format!(" {corner}")).collect();
    let vertices: String = points.map(|point| format!("v {} {} {}\n", point.x, point.y, point.z)).collect();
    format!("{vertices}f{corners}\n")
}

/// The corners of an outline on the ground: one that runs counter-clockwise faces up.
fn on_floor(outline: &[DVec2]) -> impl ExactSizeIterator<Item = DVec3> {
    outline.iter().map(|point| DVec3::new(point.y, 0.0, point.x))
}

/// Areas of the triangles of a floor, seen from above, and negative if they face down.
fn floor_areas(floor: impl ExactSizeIterator<Item = DVec3>) -> Vec<f64> {
    let map = import(face(floor)).expect("a valid level").map;
    let area = |[a, b, c]: [Vec3; 3]| 0.5 * f64::from((b - a).cross(c - a).y);
    corners(&map).into_iter().map(area).collect()
}

/// Concave outlines that run counter-clockwise.
fn concave_outlines() -> Vec<(&'static str, Vec<DVec2>)> {
    let outline =
        |points: &[[i32; 2]]| points.iter().map(|[x, y]| DVec2::new((*x).into(), (*y).into())).collect::<Vec<_>>();
    vec![
        ("dart", outline(&[[0, 0], [4, 1], [8, 0], [4, 8]])),
        ("pit", outline(&[[0, 0], [9, 0], [9, 9], [6, 9], [6, 3], [3, 3], [3, 9], [0, 9]])),
        (
            "pit with straight corners",
            outline(&[[0, 0], [5, 0], [9, 0], [9, 4], [9, 9], [7, 9], [6, 9], [6, 3], [4, 3], [3, 3], [3, 9], [0, 9]]),
        ),
        ("stairwell", outline(&[[0, 0], [9, 0], [9, 9], [0, 9], [0, 0], [3, 3], [3, 6], [6, 6], [6, 3], [3, 3]])),
        (
            "two holes at one corner",
            outline(&[
                [0, 0],
                [3, 3],
                [3, 5],
                [5, 5],
                [5, 3],
                [3, 3],
                [0, 0],
                [7, 2],
                [7, 4],
                [9, 4],
                [9, 2],
                [7, 2],
                [0, 0],
                [20, 0],
                [20, 10],
                [0, 10],
            ]),
        ),
        ("hole at the rim", outline(&[[0, 0], [9, 0], [9, 9], [5, 9], [6, 6], [3, 6], [5, 9], [0, 9]])),
    ]
}

#[test]
fn concave_polygons_and_holes_stay_open() {
    for (name, outline) in concave_outlines() {
        for start in 0..outline.len() {
            let mut outline = outline.clone();
            outline.rotate_left(start);
            let expected = shoelace(&outline);
            let up = floor_areas(on_floor(&outline));
            assert!(up.iter().all(|area| *area > 0.0), "{name} from {start}: {up:?}");
            assert!((up.iter().sum::<f64>() - expected).abs() < 1.0e-3, "{name} from {start}: {up:?}");
            outline.reverse();
            let down = floor_areas(on_floor(&outline));
            assert!(down.iter().all(|area| *area < 0.0), "{name} from {start}: {down:?}");
            assert!((down.iter().sum::<f64>() + expected).abs() < 1.0e-3, "{name} from {start}: {down:?}");
        }
    }
}

#[test]
fn polygons_that_are_not_plane_are_split_along_their_normal() {
    for (name, outline) in concave_outlines().into_iter().take(2) {
        let lifted = on_floor(&outline).enumerate().map(|(idx, point)| point + DVec3::Y * [0.0, 0.2, 0.1][idx % 3]);
        let areas = floor_areas(lifted);
        assert!(areas.iter().all(|area| *area > 0.0), "{name}: {areas:?}");
        assert!((areas.iter().sum::<f64>() - shoelace(&outline)).abs() < 1.0e-3, "{name}: {areas:?}");
    }
}

#[test]
fn the_fan_of_earlier_versions_is_kept_where_it_is_right() {
    let hexagon =
        [[0, 0], [4, 0], [8, 0], [8, 6], [4, 9], [0, 6]].map(|[x, y]: [i32; 2]| DVec2::new(x.into(), y.into()));
    // The concave corner comes first.
    let dart = [[4, 1], [8, 0], [4, 8], [0, 0]].map(|[x, y]: [i32; 2]| DVec2::new(x.into(), y.into()));
    for outline in [&hexagon[..], &dart[..]] {
        let level = |faces: &str| {
            let text = face(on_floor(outline));
            let vertices = text.split_once('f').expect("a face").0;
            import(format!("{vertices}{faces}")).expect("a valid level").map.hash()
        };
        let corners: String = (1..=outline.len()).map(|corner| format!(" {corner}")).collect();
        let fan: String = (2..outline.len()).map(|corner| format!("f 1 {corner} {}\n", corner + 1)).collect();
        assert_eq!(level(&format!("f{corners}")), level(&fan));
    }
}

#[test]
fn a_face_may_have_thousands_of_corners_but_not_any_number() {
    let comb = |teeth: usize| {
        let mut outline = vec![DVec2::ZERO, DVec2::new(teeth as f64 * 0.02, 0.0)];
        outline.extend((0..teeth).rev().map(|idx| DVec2::new(idx as f64 * 0.02, [1.0, 9.0][idx % 2])));
        outline
    };
    let outline = comb(2000);
    let areas = floor_areas(on_floor(&outline));
    assert!((areas.iter().sum::<f64>() / shoelace(&outline) - 1.0).abs() < 1.0e-3);
    let outline = comb(99_998);
    let error = refusal(import(face(on_floor(&outline))), "too many");
    assert!(error.contains("line 100001: face 1 has 100000 corners, too many"), "{error}");
    let result = import(format!("v 0 0 0\nv 1 0 0\nf{}\n", " 1 2".repeat(2_000_002)));
    assert!(matches!(result, Err(ImportError::TooManyTriangles)));
}

/// Corners at `radii` around the origin, in equal steps.
fn ring(radii: &[f64]) -> Vec<DVec2> {
    let angle = |idx: usize| TAU * idx as f64 / radii.len() as f64;
    radii.iter().enumerate().map(|(idx, radius)| *radius * DVec2::from_angle(angle(idx))).collect()
}

proptest! {
    #![proptest_config(ProptestConfig {
        cases: 200,
        rng_seed: proptest::test_runner::RngSeed::Fixed(1),
        failure_persistence: None,
        ..ProptestConfig::default()
    })]

    #[test]
    fn triangles_cover_a_polygon_exactly_and_face_its_way(
        radii in prop::collection::vec(2.0f64..10.0, 3..60),
        hole in prop::option::of(prop::collection::vec(0.2f64..0.9, 3..60)),
        start in 0..200usize,
        turns in prop::array::uniform2(-3.0f64..3.0),
    ) {
        let mut outline = ring(&radii);
        if let Some(radii) = hole {
            let hole = ring(&radii);
            outline.extend([outline[0], hole[0]]);
            outline.extend(hole.iter().rev());
        }
        let expected = shoelace(&outline);
        let start = start % outline.len();
        outline.rotate_left(start);
        let turn = DQuat::from_rotation_x(turns[0]) * DQuat::from_rotation_y(turns[1]);
        let map = import(face(outline.iter().map(|point| turn * point.extend(0.0)))).expect("a valid level").map;
        let normal = (turn * DVec3::Z).as_vec3();
        let mut area = 0.0;
        for [a, b, c] in corners(&map) {
            let facing = 0.5 * (b - a).cross(c - a);
            area += f64::from(facing.length());
            // The normals of slivers are rounding errors.
            prop_assert!(facing.length() < 1.0e-3 || facing.normalize().dot(normal) > 0.99, "{a} {b} {c}");
        }
        prop_assert!((area / expected - 1.0).abs() < 1.0e-3, "{area} of {expected} m2");
    }

    #[test]
    fn faces_of_any_shape_are_read(
        points in prop::collection::vec(prop::array::uniform3(-3i32..4), 12),
        faces in prop::collection::vec(prop::collection::vec(1..13u32, 0..16), 1..8),
    ) {
        let vertices: String = points.iter().map(|[x, y, z]| format!("v {x} {y} {z}\n")).collect();
        let face = |corners: &Vec<u32>| corners.iter().map(|corner| format!(" {corner}")).collect::<String>();
        let faces: String = faces.iter().map(|corners| format!("f{}\n", face(corners))).collect();
        let result = import(vertices + &faces);
        prop_assert!(matches!(result, Ok(_) | Err(ImportError::Empty)), "{result:?}");
    }
}

// Faults.

#[test]
fn each_fault_of_an_obj_level_has_its_own_message() {
    let floor = obj_box("floor", [0.0, -1.0, 0.0], [40.0, 0.0, 40.0]);
    let not_three = "line 9: a `v` line does not begin with three finite numbers";
    let not_there = "line 10: face 1 refers to vertex 99, but the file has only 8: export the level again";
    let cases = [
        (String::new(), "it has no faces"),
        ("\u{feff}".to_owned(), "it has no faces"),
        (floor.replace("v 40 0 40", "v 40 x 40"), not_three),
        (floor.replace("v 40 0 40", "v 40 0"), not_three),
        (floor.replace("v 40 0 40", "v 40 0 # 40"), not_three),
        (floor.replace("v 40 0 40", "v 40 NaN 40"), not_three),
        (floor.replace("v 40 0 40", "v 40 inf 40"), not_three),
        (floor.replace("v 40 0 40", "v 40 1e999 40"), not_three),
        (floor.replace("v 40 0 40", "v 4000 0 40"), "the level is 4000 x 1 x 40 m"),
        (floor.replace("v 40 0 40", "v 40 199 40"), "the level is 40 x 200 x 40 m"),
        (floor.replace("f -8", "f 99"), not_there),
        (floor.replace("f -8", "f 99").replace('\n', "\r"), not_there),
        (floor.replace("f -8", "f 99").replace('\n', "\r\n"), not_there),
        (floor.replace("f -8", "f \\\n99"), not_there),
        (floor.replace("f -8", "f 0"), "face 1 refers to vertex 0, but the first vertex is 1"),
        (floor.replace("f -8", "f -99"), "face 1 refers to vertex -99, but only 8 come before it"),
        (format!("f -1 1 2\n{floor}"), "line 1: face 1 refers to vertex -1, but only 0 come before it"),
        (format!("{floor}l 1 9\n"), "line 16: the polyline refers to vertex 9, but the file has only 8"),
        (floor.replace("f -8", "f one"), "line 10: face 1 does not hold vertex numbers"),
        (floor.replace("f -8", "f /1"), "line 10: face 1 does not hold vertex numbers"),
        (floor.replace("floor", "water"), "no solid triangles"),
    ];
    for (text, expected) in cases {
        let error = refusal(surefoot_levels::import_obj(text.as_bytes(), None, &PLAIN), expected);
        assert!(error.contains(expected), "`{expected}` is not in `{error}`");
    }
    for text in [&b"\xff\xfev\0 \0"[..], b"\xfe\xff\0v\0 "] {
        assert!(refusal(import(text), "UTF-16").contains("save it as UTF-8"));
    }
}
