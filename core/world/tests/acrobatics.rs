//! Runs along walls, slides, dives, and moves that bodies bring along.

use surefoot_world::character::bodies::NamedBody;
use surefoot_world::character::{MoveScratch, OwnMotion, OwnMove, RawCharacterProfile};
use surefoot_world::crossings::crossings;
use surefoot_world::map::mover::cuboid;
use surefoot_world::map::{Liquid, MapSize, Outline, Placed, Pool, Spot};
use surefoot_world::mesh::{Surface, Triangle};
use surefoot_world::reach::{Means, Reach};
use surefoot_world::{Ability, AbilitySet, Action, Body, CharacterProfile, Map, Vec3};

const FLOOR: f32 = 12.0;
const SIZE: MapSize = MapSize { width: 40, height: 30, depth: 24 };
const AHEAD: Action = Action { forward: 1.0, strafe: 0.0, turn: 0.0, jump: -1.0 };
const JUMPING: Action = Action { jump: 1.0, ..AHEAD };

fn block(low: [f32; 3], high: [f32; 3]) -> Vec<Triangle> {
    let faces = cuboid(low.into(), high.into()).into_iter();
    faces.filter_map(|corners| Triangle::new(corners, Surface::Ground)).collect()
}

fn map_of(blocks: &[([f32; 3], [f32; 3])], placed: Placed) -> Map {
    Map::from_parts(SIZE, blocks.iter().flat_map(|(low, high)| block(*low, *high)).collect(), placed)
}

/// Two decks with a gap of so many metres between them, and a wall along both if there `is` one.
fn chasm(gap: f32, is: bool, placed: Placed) -> Map {
    let decks = [([0.0, 0.0, 0.0], [12.0, FLOOR, 24.0]), ([12.0 + gap, 0.0, 0.0], [40.0, FLOOR, 24.0])];
    let wall = ([2.0, FLOOR, 14.0], [38.0, FLOOR + 6.0, 15.0]);
    map_of(&if is { vec![decks[0], decks[1], wall] } else { decks.to_vec() }, placed)
}

fn acrobat() -> CharacterProfile {
    NamedBody::find("acrobat").unwrap().profile()
}

/// Lets a body that looks along x act for at most so many seconds, until `is_done`.
fn act(
    map: &Map,
    profile: &CharacterProfile,
    from: Vec3,
    seconds: u32,
    action: impl Fn(&Body) -> Action,
    is_done: impl Fn(&Body) -> bool,
) -> (Body, AbilitySet) {
    let mut scratch = MoveScratch::default();
    let mut body = Body::at(from, std::f32::consts::FRAC_PI_2);
    let mut used = AbilitySet::default();
    let mut current = AHEAD;
    for tick in 0..60 * seconds {
        if tick % 10 == 0 {
            current = action(&body);
            body.begin_decision(&current);
        }
        used = used.union(body.tick(map, profile, &current, &mut scratch));
        if is_done(&body) {
            break;
        }
    }
    (body, used)
}

#[test]
fn a_body_runs_along_a_wall_over_a_gap_that_is_too_wide_to_jump() {
    let run = |map: &Map, profile: &CharacterProfile| {
        let from = Vec3::new(7.0, FLOOR, 14.0 - profile.radius - 0.02);
        let jump = |body: &Body| if body.is_grounded() && body.feet.x > 11.4 { JUMPING } else { AHEAD };
        // A little into the wall, which is on the left.
        let into = |body: &Body| Action { strafe: 0.15, ..jump(body) };
        act(map, profile, from, 5, into, |body| body.feet.y < FLOOR - 1.0 || body.is_grounded() && body.feet.x > 20.0)
    };
    let (body, used) = run(&chasm(8.0, true, Placed::default()), &acrobat());
    assert!(body.is_grounded() && body.feet.x > 20.0, "{body:?}");
    assert!(used.contains(Ability::WALL_RUN) && !used.contains(Ability::DOUBLE_JUMP));
    for (map, profile) in [
        (chasm(8.0, false, Placed::default()), acrobat()),
        (chasm(8.0, true, Placed::default()), acrobat().with(|it| it.wall_run_seconds = 0.0).unwrap()),
        (chasm(8.0, true, Placed::default()), acrobat().with(|it| it.wall_run_seconds = 0.2).unwrap()),
    ] {
        assert!(run(&map, &profile).0.feet.y < FLOOR - 1.0);
    }
}

#[test]
fn runs_along_walls_are_crossings_and_links() {
    let walled = chasm(8.0, true, Placed::default());
    let found = crossings(&walled, &acrobat());
    let there = |it: &&surefoot_world::crossings::Crossing| it.from.x < 12.0 && it.to.x > 20.0;
    assert!(found.iter().any(|it| there(&it) && it.by == Ability::WALL_RUN), "{found:?}");
    assert!(found.iter().any(|it| it.from.x > 20.0 && it.to.x < 12.0 && it.by == Ability::WALL_RUN), "{found:?}");
    let links = Reach::survey(&walled, &acrobat(), 1).links;
    assert!(links.iter().any(|link| link.means == Means::WallRun), "{links:?}");
    assert_eq!(crossings(&chasm(8.0, false, Placed::default()), &acrobat()), []);
}

/// A passage of so many metres, 1 m high.
fn vent(length: f32) -> Map {
    let floor = ([0.0, 0.0, 0.0], [40.0, FLOOR, 24.0]);
    map_of(&[floor, ([14.0, FLOOR + 1.0, 0.0], [14.0 + length, FLOOR + 4.0, 24.0])], Placed::default())
}

#[test]
fn a_body_that_runs_slides_under_what_is_low_and_crouches_when_the_slide_ends() {
    let ticks_through = |profile: &CharacterProfile, length: f32| {
        let ticks = std::cell::Cell::new(0);
        let count = |body: &Body| {
            ticks.set(ticks.get() + u32::from(body.crouches));
            body.feet.x > 16.0 + length
        };
        let (body, used) = act(&vent(length), profile, Vec3::new(8.0, FLOOR, 12.0), 20, |_| AHEAD, count);
        assert!(body.feet.x > 16.0 + length && !body.crouches, "{body:?}");
        (ticks.get(), used)
    };
    let walks = acrobat().with(|it| it.slide_seconds = 0.0).unwrap();
    let ((slow, crouched), (fast, slid)) = (ticks_through(&walks, 4.0), ticks_through(&acrobat(), 4.0));
    assert!(fast * 3 < slow * 2, "{fast} ticks instead of {slow}");
    assert!(crouched.contains(Ability::CROUCH) && !crouched.contains(Ability::SLIDE));
    assert!(slid.contains(Ability::SLIDE) && !slid.contains(Ability::CROUCH));
    let (_, both) = ticks_through(&acrobat(), 10.0);
    assert!(both.contains(Ability::SLIDE) && both.contains(Ability::CROUCH));
}

/// A canal with a wall across it that leaves a way of 2 m at the bottom.
fn sump() -> Map {
    let deep = FLOOR - 5.0;
    let blocks = [
        ([0.0, 0.0, 0.0], [12.0, FLOOR, 24.0]),
        ([12.0, 0.0, 0.0], [28.0, deep, 24.0]),
        ([28.0, 0.0, 0.0], [40.0, FLOOR, 24.0]),
        ([18.0, deep + 2.0, 0.0], [21.0, FLOOR + 6.0, 24.0]),
    ];
    let outline = Outline::Rectangle { half_x: 8.0, half_z: 12.0 };
    let pool = Pool { centre: Vec3::new(20.0, FLOOR - 0.4, 12.0), outline, depth: 5.0, liquid: Liquid::Water };
    map_of(&blocks, Placed { pools: vec![pool], ..Placed::default() })
}

#[test]
fn a_body_dives_under_what_reaches_into_the_water_as_long_as_it_has_breath() {
    let map = sump();
    let swim = |profile: &CharacterProfile| {
        let is_done = |body: &Body| body.is_grounded() && body.feet.x > 28.0 || body.is_out_of_breath(profile);
        act(&map, profile, Vec3::new(10.0, FLOOR, 12.0), 30, |_| AHEAD, is_done)
    };
    let (body, used) = swim(&acrobat());
    assert!(body.is_grounded() && body.feet.x > 28.0, "{body:?}");
    assert!(used.contains(Ability::DIVE) && used.contains(Ability::SWIM));
    let (body, used) = swim(&acrobat().with(|it| it.dive_seconds = 0.0).unwrap());
    assert!(body.feet.x < 18.0 && !used.contains(Ability::DIVE), "{body:?}");
    let short = acrobat().with(|it| it.dive_seconds = 0.8).unwrap();
    assert!(swim(&short).0.is_out_of_breath(&short));
    let by = |profile: &CharacterProfile| crossings(&map, profile).iter().any(|it| it.by == Ability::DIVE);
    assert!(by(&acrobat()) && !by(&short));
}

/// The tag of a spot, its place, and its end, m.
type At<'a> = (&'a str, [f32; 3], Option<[f32; 3]>);

fn spots(spots: &[At<'_>]) -> Placed {
    let spot = |(tag, from, to): &At<'_>| Spot {
        tag: (*tag).to_owned(),
        from: (*from).into(),
        to: to.map(Vec3::from),
        two_way: false,
    };
    Placed { spots: spots.iter().map(spot).collect(), ..Placed::default() }
}

#[test]
fn a_body_pulls_itself_to_an_anchor_and_lands_beyond_it() {
    let map = chasm(12.0, false, spots(&[("anchor", [18.0, FLOOR + 6.0, 12.0], None)]));
    let fly = |profile: &CharacterProfile| {
        let jump = |body: &Body| if body.own.is_none() && body.feet.x < 17.0 { JUMPING } else { AHEAD };
        let is_done = |body: &Body| body.feet.y < FLOOR - 1.0 || body.is_grounded() && body.feet.x > 24.0;
        act(&map, profile, Vec3::new(9.0, FLOOR, 12.0), 5, jump, is_done)
    };
    let grapple = acrobat().move_named("grapple").unwrap();
    assert_eq!(acrobat().move_name(grapple), "grapple");
    let (body, used) = fly(&acrobat());
    assert!(body.is_grounded() && body.feet.x > 24.0 && used.contains(grapple), "{body:?}");
    assert!(fly(&NamedBody::find("agile").unwrap().profile()).0.feet.y < FLOOR - 1.0);
    let found = crossings(&map, &acrobat());
    assert!(found.iter().any(|it| it.from.x < 12.0 && it.to.x > 24.0 && it.by == grapple), "{found:?}");
}

#[test]
fn a_body_follows_the_curve_of_its_move_in_one_direction() {
    let rope = OwnMove { speed: 8.0, rise: 2.0, ..OwnMove::new("rope", OwnMotion::Curve) };
    let body = CharacterProfile::default().with(|it| it.moves = [rope].into()).unwrap();
    let map = chasm(12.0, false, spots(&[("rope", [11.0, FLOOR, 12.0], Some([26.0, FLOOR, 12.0]))]));
    let ability = body.move_named("rope").unwrap();
    let top = std::cell::Cell::new(0.0_f32);
    let walk = |from: f32, profile: &CharacterProfile, yaw: f32| {
        let turn = |body: &Body| Action { turn: (yaw - body.yaw).clamp(-1.0, 1.0), ..AHEAD };
        act(&map, profile, Vec3::new(from, FLOOR, 12.0), 5, turn, |body| {
            top.set(top.get().max(body.feet.y - FLOOR));
            body.feet.y < FLOOR - 1.0 || body.is_grounded() && body.feet.x > 24.0
        })
    };
    let along = std::f32::consts::FRAC_PI_2;
    let (there, used) = walk(8.0, &body, along);
    assert!(there.is_grounded() && there.feet.x > 24.0 && used.contains(ability), "{there:?}");
    assert!((1.8..2.1).contains(&top.get()), "{} m", top.get());
    assert!(walk(8.0, &CharacterProfile::default().with(|it| it.extra_jumps = 0).unwrap(), along).0.feet.y < FLOOR);
    let found = crossings(&map, &body);
    assert!(found.iter().all(|it| it.from.x < 12.0 && it.by == ability) && found.len() == 1, "{found:?}");
    let links = Reach::survey(&map, &body, 1).links;
    assert!(links.iter().any(|link| link.means == Means::OwnMove), "{links:?}");
}

#[test]
fn bad_moves_are_refused_with_the_field_that_is_wrong() {
    let rope = || OwnMove::new("rope", OwnMotion::Curve);
    let with = |moves: Vec<OwnMove>| {
        let raw = RawCharacterProfile { moves: moves.into(), ..RawCharacterProfile::default() };
        CharacterProfile::try_from(raw).unwrap_err().to_string()
    };
    let name = "must be 1 to 32 lower-case letters, digits and `_`, a letter first";
    let cases = [
        (vec![OwnMove { speed: f32::NAN, ..rope() }], "body.moves[0].speed is NaN, but must be 0.1 to 40".to_owned()),
        (vec![OwnMove { speed: 0.0, ..rope() }], "body.moves[0].speed is 0, but must be 0.1 to 40".to_owned()),
        (vec![OwnMove { rise: 1.0e9, ..rope() }], "body.moves[0].rise is 1000000000, but must be -20 to 20".to_owned()),
        (vec![OwnMove { id: "Rope!".to_owned(), ..rope() }], format!("body.moves[0].id is `Rope!`, but {name}")),
        (vec![rope(), rope()], "body.moves[1].id is `rope`, which is the name of another move".to_owned()),
        (
            vec![OwnMove { id: "jump".to_owned(), ..rope() }],
            "body.moves[0].id is `jump`, which is the name of another move".to_owned(),
        ),
        (vec![rope(); 1_000_000], "body.moves has 1000000 entries, but at most 16 fit".to_owned()),
    ];
    for (moves, message) in cases {
        assert_eq!(with(moves), message);
    }
    let error = CharacterProfile::default().with(|it| it.slide_seconds = 1.0).unwrap_err();
    assert_eq!(error.to_string(), "body.slide_seconds needs body.crouch_height, which is 0");
}
