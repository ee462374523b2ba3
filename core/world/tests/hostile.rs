//! Numbers at the edges of what files and messages may hold: every accepted value can be stepped, seen and surveyed.

use crate::stage::cases;
use proptest::prelude::*;
use std::sync::Arc;
use surefoot_world::map::mover::cuboid;
use surefoot_world::map::{Liquid, MapSize, Mover, MoverKind, MoverStop, Outline, Piece, PieceShape, Placed, Pool};
use surefoot_world::mesh::{Surface, Triangle};
use surefoot_world::reach::Reach;
use surefoot_world::{
    Action, CharacterProfile, CrateState, Map, MoverAt, MoverId, MoverOrder, MoverState, NpcSlot,
    OBSERVATION_WITH_OTHERS_LEN, RawCharacterProfile, StopIdx, TaskConfig, Vec3, World, WorldConfig,
};

const SIDE_M: f32 = 20.0;

fn floor() -> Map {
    let corner = |x: f32, z: f32| Vec3::new(x * SIDE_M, 1.0, z * SIDE_M);
    let [a, b, c, d] = [corner(0.0, 0.0), corner(0.0, 1.0), corner(1.0, 1.0), corner(1.0, 0.0)];
    let triangles = [[a, b, c], [a, c, d]].into_iter().filter_map(|it| Triangle::new(it, Surface::Ground));
    Map::from_parts(MapSize { width: 20, height: 10, depth: 20 }, triangles.collect(), Placed::default())
}

/// Numbers of the size of a map, and now and then some at the edges.
fn number() -> impl Strategy<Value = f32> {
    let edges = vec![
        f32::NAN,
        f32::INFINITY,
        f32::MAX,
        -f32::MAX,
        f32::MIN_POSITIVE,
        -0.0,
        1.0e4,
        -1.0e4,
        600.0,
        1.0e-6,
        1.0,
        0.0,
    ];
    prop_oneof![40 => 0.0..SIDE_M, 10 => -2.0..2.0f32, 2 => prop::sample::select(edges), 1 => any::<f32>()]
}

fn point() -> impl Strategy<Value = Vec3> {
    (number(), number(), number()).prop_map(Vec3::from)
}

fn mover() -> impl Strategy<Value = Mover> {
    let stop = || {
        (point(), number(), prop::bool::weighted(0.9)).prop_map(|(offset, yaw, is_there)| MoverStop {
            offset: offset * 0.3,
            yaw: yaw * 0.2,
            is_there,
        })
    };
    let many = |count| prop::collection::vec(stop(), count);
    let stops = prop_oneof![many(1..2_usize), many(2..3), many(2..18)];
    let times = (number(), number()).prop_map(|(travel_s, dwell_s)| (travel_s * 10.0, dwell_s * 0.02));
    let kind = prop::sample::select(MoverKind::ALL.to_vec());
    (kind, (point(), point(), point()), stops, any::<u8>(), times, any::<bool>(), point()).prop_map(
        |(kind, (low, size, pivot), stops, start, (travel_s, dwell_s), cycles, belt)| Mover {
            name: "it".to_owned(),
            kind,
            triangles: cuboid(low, low + size.abs() * 0.2),
            pivot,
            start: StopIdx(start % stops.len() as u8),
            stops,
            travel_s,
            dwell_s,
            cycles,
            belt: if kind == MoverKind::Conveyor { belt * 0.3 } else { Vec3::ZERO },
        },
    )
}

fn state() -> impl Strategy<Value = MoverState> {
    let lies = (point(), number(), point(), number(), any::<u8>(), any::<bool>()).prop_map(
        |(offset, yaw, velocity, spin, rested, is_there)| CrateState {
            offset: offset * 0.2,
            yaw: yaw * 0.2,
            velocity: velocity * 0.2,
            spin: spin * 0.5,
            rested,
            is_there,
        },
    );
    let counts = prop::sample::select(vec![0, 1, u32::MAX - 1, u32::MAX]);
    let stop = || prop_oneof![9 => 0..2_u8, 1 => any::<u8>()].prop_map(StopIdx);
    let paces = (prop_oneof![9 => 0.0..=1.0f32, 1 => number()], prop_oneof![9 => 0.0..=4.0f32, 1 => number()]);
    ((stop(), stop(), prop::option::of(stop())), paces, (counts.clone(), counts), any::<bool>(), lies).prop_map(
        |((from, to, told), (progress, pace), (stood, blocked), is_returning, lies)| MoverState {
            from,
            to,
            progress,
            stood,
            ordered_stop: told,
            pace,
            is_returning,
            blocked,
            crate_state: Some(lies),
        },
    )
}

fn order() -> impl Strategy<Value = MoverOrder> {
    prop_oneof![
        any::<u8>().prop_map(|stop| MoverOrder::GoTo(StopIdx(stop))),
        Just(MoverOrder::Cycle),
        number().prop_map(MoverOrder::Pace)
    ]
}

fn piece() -> impl Strategy<Value = PieceShape> {
    // Most heights within the map.
    let point = || point().prop_map(|at| Vec3::new(at.x, at.y * 0.4, at.z));
    let block = (point(), number(), number(), number(), number()).prop_map(|(foot, x, z, height, yaw)| {
        PieceShape::Block { foot, half: [x * 0.2, z * 0.2], height: height * 0.2, yaw }
    });
    let plank = (point(), point(), number(), number()).prop_map(|(from, to, width, thickness)| PieceShape::Plank {
        from,
        to,
        width: width * 0.2,
        thickness,
    });
    let pool = (point(), number(), number(), any::<bool>()).prop_map(|(centre, radius, depth, burns)| {
        let liquid = if burns { Liquid::Lava } else { Liquid::Water };
        PieceShape::Pool(Pool { centre, outline: Outline::Round { radius }, depth, liquid })
    });
    prop_oneof![block, plank, pool]
}

/// A profile with three of its numbers at an edge of their ranges or beyond.
fn profile() -> impl Strategy<Value = RawCharacterProfile> {
    let edges =
        prop::sample::select(vec![0.0, 0.1, 0.15, 1.0, 1.4, 4.0, 20.0, 30.0, 40.0, 100.0, 200.0, 1000.0, 254.0, 255.0]);
    prop::collection::vec((0..17_usize, edges), 3).prop_map(|changes| {
        let mut raw = RawCharacterProfile::default();
        for (field, value) in changes {
            match field {
                0 => raw.height = value,
                1 => raw.radius = value,
                2 => raw.forward_speed = value,
                3 => raw.side_speed_share = value,
                4 => raw.turn_speed = value,
                5 => raw.jump_speed = value,
                6 => raw.gravity = value,
                7 => raw.extra_jumps = value as u8,
                8 => raw.max_slope = value,
                9 => raw.step_height = value,
                10 => raw.ground_acceleration = value,
                11 => raw.air_acceleration = value,
                12 => raw.coyote_ticks = value as u8,
                13 => raw.zip_line_speed = value,
                14 => raw.jetpack_acceleration = value,
                15 => raw.jetpack_climb_speed = value,
                _ => raw.uses_jetpacks = value < 1.0,
            }
        }
        raw
    })
}

/// Steps NPCs on all parts of a map, and lets them look.
fn live(map: &Arc<Map>, profile: CharacterProfile, movers: Option<MoverState>, orders: &[MoverOrder]) {
    let mut world = World::with_config(map.clone(), WorldConfig::new(profile, TaskConfig::default(), true));
    if let Some(state) = movers {
        world.set_movers(vec![state]);
    }
    for (slot, share) in (0..).zip([0.2, 0.5, 0.5, 0.9]) {
        world.spawn(Vec3::new(share, 0.1 + 0.3 * share, 1.0 - share) * SIDE_M, share);
        world.set_waypoint(NpcSlot(slot), Vec3::splat(SIDE_M * share));
    }
    let mut row = vec![0.0; OBSERVATION_WITH_OTHERS_LEN];
    for step in 0..8 {
        for slot in (0..4).map(NpcSlot) {
            world.decide(slot, Action { forward: 1.0, strafe: 0.3, turn: 0.4, jump: (step % 2) as f32 });
        }
        if let Some(order) = orders.get(step) {
            world.order(MoverId(0), *order);
        }
        world.tick_decision();
        world.call(MoverAt { mover: MoverId(0), stop: StopIdx(1) });
        for slot in (0..4).map(NpcSlot) {
            world.observe(slot, &mut row);
            world.close_decision(slot);
            let body = world.npc(slot).expect("it was spawned").body;
            assert!(body.feet.is_finite() && body.velocity.is_finite(), "{body:?}");
        }
    }
}

proptest! {
    #![proptest_config(cases(3000))]

    #[test]
    fn movers_that_are_accepted_can_be_stepped_from_every_state_that_fits(
        mover in mover(), state in state(), orders in prop::collection::vec(order(), 0..8), surveyed in 0..40_u32,
    ) {
        let Ok(map) = floor().with_movers(vec![mover]) else { return Ok(()) };
        let map = Arc::new(map);
        let lies = state.crate_state.filter(|_| map.movers()[0].kind == MoverKind::Crate);
        let state = MoverState { crate_state: lies, ..state };
        live(&map, CharacterProfile::default(), state.fits(&map.movers()[0]).then_some(state), &orders);
        if surveyed == 0 {
            Reach::survey(&map, &CharacterProfile::default(), 1);
        }
    }

    #[test]
    fn pieces_that_are_accepted_can_be_lived_on(shapes in prop::collection::vec(piece(), 1..5), surveyed in 0..40_u32) {
        let piece = |(idx, shape): (usize, PieceShape)| Piece { name: idx.to_string(), shape };
        let plain = floor();
        let pieces = shapes.into_iter().enumerate().map(piece).filter(|it| plain.with_pieces(vec![it.clone()]).is_ok());
        let map = Arc::new(plain.with_pieces(pieces.collect()).expect("each of them is valid"));
        live(&map, CharacterProfile::default(), None, &[]);
        if surveyed == 0 {
            Reach::survey(&map, &CharacterProfile::default(), 1);
        }
    }

    #[test]
    fn bodies_that_are_accepted_can_be_moved(raw in profile()) {
        let Ok(profile) = CharacterProfile::try_from(raw) else { return Ok(()) };
        live(&Arc::new(floor()), profile, None, &[]);
    }
}
