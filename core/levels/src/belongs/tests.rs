//! Levels with and without what does not belong to them.

use super::*;

type Faces = Vec<[DVec3; 3]>;

fn at(x: f64, y: f64, z: f64) -> DVec3 {
    DVec3::new(x, y, z)
}

fn node(name: &str, triangles: Faces) -> Node<DVec3> {
    Node { name: name.to_owned(), triangles, ..Node::default() }
}

fn quad([a, b, c, d]: [DVec3; 4]) -> Faces {
    vec![[a, b, c], [a, c, d]]
}

/// A box with its fronts outside.
fn cuboid(low: DVec3, high: DVec3) -> Faces {
    let corner = |idx: usize| at([low, high][idx & 1].x, [low, high][idx >> 1 & 1].y, [low, high][idx >> 2].z);
    let sides = [[0, 4, 6, 2], [1, 3, 7, 5], [0, 1, 5, 4], [2, 6, 7, 3], [0, 2, 3, 1], [4, 5, 7, 6]];
    sides.into_iter().flat_map(|side| quad(side.map(corner))).collect()
}

/// A point on a circle around the y axis; `share` is the share of a full turn.
fn round(radius: f64, y: f64, share: f64) -> DVec3 {
    let (sin, cos) = libm::sincos(share * std::f64::consts::TAU);
    at(radius * cos, y, radius * sin)
}

/// A surface of revolution around the y axis through (radius, y).
fn turned(profile: &[(f64, f64)], segment_count: usize) -> Faces {
    let mut faces = Faces::new();
    for edge in profile.windows(2) {
        for segment in 0..segment_count {
            let [one, other] = [segment, segment + 1].map(|it| (it % segment_count) as f64 / segment_count as f64);
            let [(r, y), (s, z)] = [edge[0], edge[1]];
            faces.extend(quad([round(r, y, one), round(s, z, one), round(s, z, other), round(r, y, other)]));
        }
    }
    faces.retain(|[a, b, c]| (*b - *a).cross(*c - *a).length() > 0.0);
    faces
}

/// A dome from `from` to the top, as shares of half a turn: 0 makes a sphere of it.
fn dome(radius: f64, from: f64) -> Faces {
    let point = |row: u32| {
        let (sin, cos) = libm::sincos((from + (1.0 - from) * f64::from(row) / 12.0) * std::f64::consts::PI);
        (radius * sin, -radius * cos)
    };
    turned(&(0..=12).map(point).collect::<Vec<_>>(), 24)
}

fn plane(side: f64, y: f64) -> Faces {
    let half = side / 2.0;
    quad([at(-half, y, -half), at(-half, y, half), at(half, y, half), at(half, y, -half)])
}

/// Nine houses on 60 x 60 m, without ground.
fn houses() -> Vec<Node<DVec3>> {
    let house = |idx: u32| {
        let low = at(f64::from(idx % 3) * 24.0 - 30.0, 0.0, f64::from(idx / 3) * 24.0 - 30.0);
        node("House", cuboid(low, low + at(12.0, 6.0, 12.0)))
    };
    (0..9).map(house).collect()
}

/// The houses on ground of 80 x 80 m.
fn village() -> Vec<Node<DVec3>> {
    let mut nodes = houses();
    nodes.push(node("Ground", cuboid(at(-40.0, -1.0, -40.0), at(40.0, 0.0, 40.0))));
    nodes
}

fn with(mut nodes: Vec<Node<DVec3>>, more: impl IntoIterator<Item = Node<DVec3>>) -> Vec<Node<DVec3>> {
    nodes.extend(more);
    nodes
}

/// All nodes as one.
fn joined(nodes: &[Node<DVec3>]) -> Vec<Node<DVec3>> {
    vec![node("Level", nodes.iter().flat_map(|node| node.triangles.clone()).collect())]
}

fn moved(mut nodes: Vec<Node<DVec3>>, by: DVec3, times: f64) -> Vec<Node<DVec3>> {
    nodes
        .iter_mut()
        .for_each(|node| node.triangles.iter_mut().flatten().for_each(|point| *point = *point * times + by));
    nodes
}

fn findings(nodes: &[Node<DVec3>]) -> Vec<Finding> {
    judge(nodes, &vec![true; nodes.len()], false)
}

/// The findings as texts.
fn texts(nodes: &[Node<DVec3>]) -> Vec<String> {
    findings(nodes).iter().map(|finding| finding.text(&nodes[finding.node].name)).collect()
}

/// The box of what remains.
fn remaining(mut nodes: Vec<Node<DVec3>>) -> Bounds {
    let found = findings(&nodes);
    apply(&mut nodes, &found);
    Bounds::around(nodes.iter().flat_map(|node| node.triangles.iter().flatten().copied()))
}

#[test]
fn skies_are_left_out() {
    let skybox = |half: f64| cuboid(at(-half, -half, -half), at(half, half, half));
    let mut open_box = skybox(150.0);
    open_box.retain(|triangle| triangle.iter().any(|point| point.y > 0.0));
    for sky in [dome(95.0, 0.0), dome(480.0, 0.0), dome(75.0, 0.5), dome(300.0, 0.45), skybox(90.0), open_box] {
        for times in [1.0, 100.0] {
            let nodes = moved(with(village(), [node("Object_7", sky.clone())]), at(50.0, 7.0, -1000.0), times);
            let own = Bounds::around(sky.iter().flatten().copied());
            assert_eq!(texts(&nodes), ["Object_7 was left out: it is a sky around the level"], "{own:?}, {times}");
            let bounds = Bounds::around(village().iter().flat_map(|node| node.triangles.iter().flatten().copied()));
            let rest = remaining(joined(&nodes));
            assert!((rest.size() - times * bounds.size()).abs() < 1e-6, "{rest:?}");
        }
    }
}

#[test]
fn a_sky_of_six_cards_is_left_out() {
    let cards = cuboid(DVec3::splat(-400.0), DVec3::splat(400.0));
    let cards = cards.chunks(2).map(|card| node("Plane", card.to_vec()));
    assert_eq!(texts(&with(village(), cards)), ["Plane was left out: it is a backdrop far outside the level"; 6]);
}

#[test]
fn skies_within_skies_go_and_the_ground_between_is_clipped() {
    let outer = [
        node("a", dome(5000.0, 0.0)),
        node("b", dome(4500.0, 0.5)),
        node("c", plane(3000.0, -0.1)),
        node("d", dome(900.0, 0.5)),
    ];
    let found = texts(&with(village(), outer));
    let clipped = "c was clipped to 120 x 120 m: it is a plane that reaches far beyond the level";
    let sky = |name: &str| format!("{name} was left out: it is a sky around the level");
    assert_eq!(found, [sky("a"), sky("b"), clipped.to_owned(), sky("d")]);
}

#[test]
fn the_name_of_a_sky_helps() {
    // It cuts the ground, or is hardly larger than the level.
    for (name, is_out) in [("SkyDome_01", true), ("sky", true), ("SkyLounge", false), ("Dome", false)] {
        let nodes = with(village(), [node(name, dome(50.0, 0.4))]);
        assert_eq!(findings(&nodes).len(), usize::from(is_out), "{name}");
    }
    // Ground reaches beyond the sky.
    let nodes = with(village(), [node("Terrain", hills(1500.0)), node("Skybox", dome(400.0, 0.0))]);
    assert_eq!(texts(&nodes), ["Skybox was left out: it is a sky around the level"]);
    // A bridge encloses nothing.
    let nodes = with(village(), [node("Sky_Bridge", cuboid(at(-60.0, 20.0, -3.0), at(60.0, 21.0, 3.0)))]);
    assert_eq!(texts(&nodes), [""; 0]);
    let parent = Node { name: "skybox".to_owned(), ..Node::default() };
    let below = Node { parent: Some(0), ..node("Object_3", dome(50.0, 0.4)) };
    let nodes = with(vec![parent, below], village());
    assert_eq!(texts(&nodes), ["Object_3 was left out: it is a sky around the level"]);
}

/// A terrain of small triangles with hills, lowest in the middle.
fn hills(side: f64) -> Faces {
    let height =
        |x: f64, z: f64| 0.04 * (libm::hypot(x, z) - 60.0).max(0.0) + libm::sin(x / 40.0) * libm::cos(z / 50.0);
    let step = side / 60.0;
    let corner = |x: u32, z: u32| {
        let (x, z) = (f64::from(x) * step - side / 2.0, f64::from(z) * step - side / 2.0);
        at(x, height(x, z), z)
    };
    let cell = |x: u32, z: u32| quad([corner(x, z), corner(x, z + 1), corner(x + 1, z + 1), corner(x + 1, z)]);
    (0..60).flat_map(|x| (0..60).flat_map(move |z| cell(x, z))).collect()
}

#[test]
fn rooms_halls_and_valleys_stay() {
    let room = || node("Room", cuboid(at(-60.0, 0.0, -60.0), at(60.0, 30.0, 60.0)));
    let table = |x: f64, y: f64| node("Table", cuboid(at(x, y, 2.0), at(x + 6.0, y + 1.0, 7.0)));
    let statue = moved(vec![node("Statue", dome(1.0, 0.0))], at(0.0, 1.0, 0.0), 1.0);
    let wall = |radius: f64| turned(&[(radius, 0.0), (radius, 12.0)], 32);
    let floor = |radius: f64| turned(&[(0.0, 0.0), (radius, 0.0)], 32);
    let ring = |from: f64| turned(&[(from, -1.0), (2.0 * from, 30.0), (5.0 * from, 120.0)], 48);
    let hull = || node("Hull", cuboid(at(-200.0, 0.0, -200.0), at(200.0, 90.0, 200.0)));
    let lamps = [table(-20.0, 26.0), table(-12.0, 26.0)];
    let levels = [
        vec![room()],
        with(vec![room()], [table(0.0, 0.0), table(20.0, 0.0)]),
        with(vec![room()], [table(-5.0, 2.0)]),
        with(vec![room()], lamps),
        // A church in a hall.
        with(vec![hull(), room()], [table(0.0, 0.0)]),
        // Walls three times as large as what is between them.
        with(houses(), [node("Wall", wall(120.0)), node("Floor", floor(120.0))]),
        with(houses(), [node("Arena", [wall(120.0), floor(120.0)].concat())]),
        with(houses(), [node("Dome", dome(120.0, 0.5)), node("Floor", floor(120.0))]),
        with(statue, [node("Wall", wall(100.0)), node("Floor", floor(100.0))]),
        // Mountains whose feet are the village's edge.
        with(village(), [node("Mountains", ring(40.0))]),
        with(village(), [node("Terrain", hills(3000.0))]),
        with(village(), [node("Plane", plane(300.0, 0.0))]),
    ];
    for (idx, level) in levels.into_iter().enumerate() {
        for nodes in [joined(&level), level] {
            assert_eq!(texts(&nodes), [""; 0], "level {idx}, {} nodes", nodes.len());
        }
    }
}

#[test]
fn islands_far_apart_stay() {
    let arena = |half: f64| cuboid(at(-half, 0.0, -half), at(half, 1.0, half));
    let small_room = cuboid(at(700.0, 0.0, 0.0), at(706.0, 4.0, 5.0));
    let far = |nodes: Vec<Node<DVec3>>| moved(nodes, at(300.0, 20.0, 0.0), 1.0);
    for nodes in [
        with(village(), far(village())),
        with(village(), far(vec![node("Arena", arena(100.0))])),
        with(vec![node("Arena", arena(20.0))], far(vec![node("Arena", arena(70.0))])),
        with(village(), [node("Cell", small_room)]),
        // Platforms in a row.
        (0..30).flat_map(|idx| moved(vec![node("", arena(2.0))], at(f64::from(idx * idx), 0.0, 0.0), 1.0)).collect(),
    ] {
        assert_eq!(texts(&nodes), [""; 0]);
        assert_eq!(texts(&joined(&nodes)), [""; 0]);
    }
}

#[test]
fn platforms_float_in_a_sky() {
    let platform = |idx: u32| {
        let low = at(f64::from(idx % 5) * 12.0 - 30.0, f64::from(idx) * 2.0, f64::from(idx / 5) * 9.0 - 18.0);
        node("Platform", cuboid(low, low + at(5.0, 0.5, 5.0)))
    };
    let nodes =
        with((0..20).map(platform).collect(), [node("Cube", cuboid(DVec3::splat(-120.0), DVec3::splat(120.0)))]);
    assert_eq!(texts(&nodes), ["Cube was left out: it is a sky around the level"]);
}

#[test]
fn ground_of_two_kilometres_is_clipped_to_the_houses() {
    for level in [houses(), village()] {
        let nodes = with(level, [node("Plane", plane(2048.0, -0.05))]);
        assert_eq!(texts(&nodes).len(), 1);
        assert!(texts(&nodes)[0].starts_with("Plane was clipped to 1"), "{:?}", texts(&nodes));
        for nodes in [joined(&nodes), nodes] {
            let bounds = remaining(nodes);
            assert!(bounds.low.x <= -50.0 && bounds.high.z >= 50.0 && bounds.side() <= 130.0, "{bounds:?}");
            assert_eq!(bounds.low.y.max(-0.05), -0.05);
        }
    }
}

#[test]
fn backdrops_are_left_out() {
    let card = |idx: u32| {
        let place = |share: f64, y: f64| round(900.0, y, (f64::from(idx) + share) / 16.0);
        node("Card", quad([place(0.1, -30.0), place(0.1, 120.0), place(0.8, 120.0), place(0.8, -30.0)]))
    };
    let nodes = with(village(), (0..16).map(card));
    assert_eq!(texts(&nodes), ["Card was left out: it is a backdrop far outside the level"; 16]);
    let clouds = with(village(), [node("Layer", plane(4000.0, 300.0))]);
    assert_eq!(texts(&clouds), ["Layer was left out: it is a backdrop far outside the level"]);
    // A strip around the level, open above.
    let nodes = with(village(), [node("Horizon", turned(&[(2000.0, -50.0), (2000.0, 200.0)], 64))]);
    assert_eq!(texts(&nodes), ["Horizon was left out: it is a backdrop far outside the level"]);
}

#[test]
fn strays_are_left_out_by_their_triangles() {
    let stray = [at(9000.0, 0.0, 0.0), at(9000.1, 0.0, 0.0), at(9000.0, 0.0, 0.1)];
    let point = [at(0.0, -7000.0, 100.0); 3];
    let nodes = with(village(), [node("Debris", vec![stray, point])]);
    assert_eq!(texts(&nodes), ["Debris was left out: it is far from the rest of the level"]);
    let one = joined(&nodes);
    assert_eq!(texts(&one), ["2 triangles of Level were left out: it is far from the rest of the level"]);
    assert_eq!(findings(&one)[0].triangles, Some(vec![120, 121]));
    assert_eq!(remaining(one).size(), remaining(village()).size());
    // One triangle of many things.
    let sky = node("Stuff", [dome(480.0, 0.0), vec![stray]].concat());
    assert_eq!(
        texts(&with(village(), [sky])),
        [
            "552 triangles of Stuff were left out: it is a sky around the level",
            "1 triangles of Stuff were left out: it is far from the rest of the level",
        ]
    );
}

#[test]
fn figures_need_more_than_a_name() {
    let figure = |name: &str, parent: Option<usize>, is_skinned: bool| Node {
        parent,
        is_skinned,
        ..node(name, cuboid(at(5.0, 0.0, 5.0), at(5.6, 1.8, 5.6)))
    };
    let group = |name: &str| Node { name: name.to_owned(), ..Node::default() };
    let last = |nodes: Vec<Node<DVec3>>| {
        let nodes = with(village(), nodes);
        texts(&nodes)
    };
    let is_figure = |found: Vec<String>| found.iter().filter(|text| text.contains("a figure")).count();
    assert_eq!(is_figure(last(vec![figure("Player", None, true)])), 1);
    assert_eq!(is_figure(last(vec![figure("PlayerCapsule", None, false)])), 1);
    assert_eq!(is_figure(last(vec![figure("Character_Statue", None, false)])), 0);
    assert_eq!(is_figure(last(vec![figure("Tree", None, true)])), 0);
    let rig = vec![group("Hero"), figure("Body", Some(10), true), figure("Blade", Some(10), false)];
    assert_eq!(is_figure(last(rig)), 2);
    let held = last(vec![group("Camera"), figure("Arms", Some(10), true)]);
    assert_eq!(held, ["Arms was left out: it is held before a camera"]);
    assert_eq!(last(vec![group("Security_Camera"), figure("Mount", Some(10), false)]), [""; 0]);
    assert_eq!(last(vec![figure("weapon_rack", None, false)]), [""; 0]);
    // A bridge with bones is no figure, and neither is ground.
    let ground =
        Node { is_skinned: true, ..node("player_platform", cuboid(at(-40.0, 0.0, 50.0), at(40.0, 1.0, 90.0))) };
    assert_eq!(last(vec![ground]), [""; 0]);
}

#[test]
fn a_level_is_never_left_empty() {
    let sky = || node("Skybox", dome(480.0, 0.0));
    let figure = Node { is_skinned: true, ..node("Player", cuboid(DVec3::ZERO, at(0.5, 1.8, 0.5))) };
    for nodes in [vec![sky()], vec![sky(), sky()], vec![figure], vec![node("", vec![[DVec3::ONE; 3]])], Vec::new()] {
        assert_eq!(texts(&nodes), [""; 0]);
    }
    // What is no longer judged does not count.
    let nodes = with(village(), [sky()]);
    let solid: Vec<bool> = nodes.iter().map(|node| node.name != "Skybox").collect();
    assert_eq!(judge(&nodes, &solid, false), []);
}

#[test]
fn the_node_that_makes_a_level_too_large_is_named() {
    let nodes = with(village(), [node("Terrain_far", hills(3000.0))]);
    let largest = largest(&nodes, &vec![true; nodes.len()]);
    assert_eq!(largest, Some(nodes.len() - 1));
    let kept: Vec<bool> = nodes.iter().map(|node| node.name == "House").collect();
    assert_eq!(super::largest(&nodes, &kept), None);
    assert_eq!(super::largest(&nodes[..1], &[true]), None);
}
