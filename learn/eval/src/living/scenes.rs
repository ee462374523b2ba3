//! The levels of the living suite: made of boxes, with their movers, and the goals of the NPCs in them.

use rand::rngs::ChaCha8Rng;
use rand::{RngExt, SeedableRng};
use surefoot_rollout::goals::{Goal, random_yaw};
use surefoot_world::map::mover::cuboid;
use surefoot_world::map::{Map, MapSize, Mover, MoverKind, MoverStop, Placed};
use surefoot_world::mesh::{Surface, Triangle};
use surefoot_world::{StopIdx, Vec3};

/// Height of all floors, m: what falls below 0 has left the map.
pub const FLOOR: f32 = 10.0;
/// Height of walls, which no jump gets over, m.
const WALL: f32 = 9.0;
/// Distance between NPCs at the start, and between their goals, m.
const APART: f32 = 1.7;

/// A closed way, m, that a runner goes round.
pub struct Way(pub Vec<Vec3>);

impl Way {
    /// The place after `run` metres.
    pub fn at(&self, run: f32) -> Vec3 {
        let mut left = run.rem_euclid(self.length());
        for (from, to) in self.legs() {
            let length = from.distance(to);
            if left <= length {
                return from.lerp(to, left / length.max(f32::EPSILON));
            }
            left -= length;
        }
        self.0[0]
    }

    /// Length of the shorter part of the way from the place after `run` metres to the place nearest to `target`, m;
    /// negative backwards.
    pub fn towards(&self, run: f32, target: Vec3) -> f32 {
        /// m.
        const STEP: f32 = 0.5;
        let half = 0.5 * self.length();
        let steps = (half / STEP) as i32;
        let ahead = (-steps..=steps).map(|step| step as f32 * STEP);
        let gap = |ahead: f32| self.at(run + ahead).distance(target);
        ahead.min_by(|one, other| gap(*one).total_cmp(&gap(*other))).expect("a way has places")
    }

    fn length(&self) -> f32 {
        self.legs().map(|(from, to)| from.distance(to)).sum()
    }

    fn legs(&self) -> impl Iterator<Item = (Vec3, Vec3)> {
        self.0.iter().copied().zip(self.0.iter().copied().cycle().skip(1))
    }
}

/// A level made of boxes.
#[derive(Default)]
struct Blocks {
    triangles: Vec<Triangle>,
    movers: Vec<Mover>,
}

impl Blocks {
    /// Adds a box; heights are above the floor, m.
    fn solid(&mut self, low: [f32; 3], high: [f32; 3]) {
        let up = |[x, y, z]: [f32; 3]| Vec3::new(x, y + FLOOR, z);
        let faces = cuboid(up(low), up(high));
        self.triangles.extend(faces.into_iter().filter_map(|corners| Triangle::new(corners, Surface::Ground)));
    }

    /// Adds a ground of 1 m below the floor.
    fn ground(&mut self, [x0, z0]: [f32; 2], [x1, z1]: [f32; 2]) {
        self.solid([x0, -1.0, z0], [x1, 0.0, z1]);
    }

    /// Adds a wall on the floor.
    fn wall(&mut self, [x0, z0]: [f32; 2], [x1, z1]: [f32; 2]) {
        self.solid([x0, -1.0, z0], [x1, WALL, z1]);
    }

    /// Adds a mover that is a box, with its further stops.
    fn mover(&mut self, kind: MoverKind, low: [f32; 3], high: [f32; 3], offsets: &[Vec3], travel_s: f32) -> &mut Mover {
        let up = |[x, y, z]: [f32; 3]| Vec3::new(x, y + FLOOR, z);
        let here = MoverStop { offset: Vec3::ZERO, yaw: 0.0, is_there: true };
        let stops = offsets.iter().map(|offset| MoverStop { offset: *offset, ..here });
        self.movers.push(Mover {
            name: format!("mover_{}", self.movers.len()),
            kind,
            triangles: cuboid(up(low), up(high)),
            pivot: up(low),
            stops: std::iter::once(here).chain(stops).collect(),
            start: StopIdx(0),
            travel_s,
            dwell_s: 4.0,
            cycles: false,
            belt: Vec3::ZERO,
        });
        self.movers.last_mut().expect("just added")
    }

    fn map(self, width: u32, depth: u32) -> Map {
        let size = MapSize { width, height: 60, depth };
        let map = Map::from_parts(size, self.triangles, Placed::default());
        map.with_movers(self.movers).expect("the movers of a scene are valid")
    }
}

/// Places in rows on a rectangle of the floor, in an order that the seed shuffles, m.
fn rows([x0, z0]: [f32; 2], [x1, z1]: [f32; 2], count: usize, rng: &mut ChaCha8Rng) -> Vec<Vec3> {
    let per_row = ((x1 - x0) / APART) as usize;
    let at = |idx: usize| {
        let place = Vec3::new(x0 + (idx % per_row) as f32 * APART, FLOOR, z0 + (idx / per_row) as f32 * APART);
        assert!(place.z <= z1, "the rectangle holds all of them");
        place
    };
    let mut places: Vec<Vec3> = (0..count).map(at).collect();
    for idx in (1..count).rev() {
        places.swap(idx, rng.random_range(0..=idx));
    }
    places
}

fn pair(starts: Vec<Vec3>, goals: Vec<Vec3>, rng: &mut ChaCha8Rng) -> Vec<Goal> {
    starts.into_iter().zip(goals).map(|(start, goal)| Goal { start, yaw: random_yaw(rng), goal }).collect()
}

/// A hall 22 m deep between walls, from x = 2 m to `end`.
fn hall(end: f32) -> Blocks {
    let mut blocks = Blocks::default();
    blocks.ground([2.0, 2.0], [end, 24.0]);
    blocks.wall([1.0, 1.0], [end + 1.0, 2.0]);
    blocks.wall([1.0, 24.0], [end + 1.0, 25.0]);
    blocks.wall([1.0, 2.0], [2.0, 24.0]);
    blocks.wall([end, 2.0], [end + 1.0, 24.0]);
    blocks
}

/// Two rooms with one door of 1.2 m between them.
pub fn two_rooms() -> Map {
    let mut blocks = hall(44.0);
    blocks.wall([22.8, 2.0], [23.2, 12.4]);
    blocks.wall([22.8, 13.6], [23.2, 24.0]);
    blocks.map(46, 26)
}

/// 64 NPCs in the one room of [`two_rooms`], whose goals are in the other.
pub fn through_the_door(seed: u64) -> Vec<Goal> {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let starts = rows([4.0, 6.0], [18.0, 20.0], 64, &mut rng);
    let goals = rows([28.0, 6.0], [42.0, 20.0], 64, &mut rng);
    pair(starts, goals, &mut rng)
}

/// A corridor 4 m wide and 60 m long between two rooms.
pub fn corridor() -> Map {
    let mut blocks = hall(104.0);
    blocks.wall([23.0, 2.0], [83.0, 11.0]);
    blocks.wall([23.0, 15.0], [83.0, 24.0]);
    blocks.map(106, 26)
}

/// A stream of 64 NPCs along [`corridor`], and another one the other way if `both`.
pub fn streams(seed: u64, both: bool) -> Vec<Goal> {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let rooms = [([4.0, 4.0], [19.0, 22.0]), ([86.0, 4.0], [101.0, 22.0])];
    let mut places = |room: usize| rows(rooms[room].0, rooms[room].1, 64, &mut rng);
    let (starts, goals) = (places(0), places(1));
    let mut streams: Vec<(Vec3, Vec3)> = starts.into_iter().zip(goals).collect();
    if both {
        // Goals between the starts of the others.
        let aside = Vec3::new(0.5 * APART, 0.0, 0.5 * APART);
        let (starts, goals) = (places(1), places(0));
        streams.extend(starts.into_iter().zip(goals).map(|(start, goal)| (start + aside, goal + aside)));
    }
    let mut rng = ChaCha8Rng::seed_from_u64(seed + 1);
    streams.into_iter().map(|(start, goal)| Goal { start, yaw: random_yaw(&mut rng), goal }).collect()
}

/// Rooms of 10 m in four rows of four, with a door of 1.6 m between all neighbours. Doors are open at first.
pub fn rooms() -> Map {
    const SIDE: f32 = 10.0;
    let mut blocks = Blocks::default();
    blocks.ground([2.0, 2.0], [42.0, 42.0]);
    for line in 0..=4 {
        let at = 2.0 + line as f32 * SIDE;
        for room in 0..4 {
            let (low, high) = (2.0 + room as f32 * SIDE, 2.0 + (room + 1) as f32 * SIDE);
            let (left, right) = (low + 4.2, low + 5.8);
            if line == 0 || line == 4 {
                blocks.wall([low - 0.2, at - 0.2], [high + 0.2, at + 0.2]);
                blocks.wall([at - 0.2, low - 0.2], [at + 0.2, high + 0.2]);
                continue;
            }
            for (from, to) in [(low, left), (right, high)] {
                blocks.wall([from, at - 0.2], [to, at + 0.2]);
                blocks.wall([at - 0.2, from], [at + 0.2, to]);
            }
            let aside = right - left;
            blocks
                .mover(MoverKind::Door, [left, 0.0, at - 0.1], [right, WALL, at + 0.1], &[Vec3::X * aside], 0.8)
                .start = StopIdx(1);
            blocks
                .mover(MoverKind::Door, [at - 0.1, 0.0, left], [at + 0.1, WALL, right], &[Vec3::Z * aside], 0.8)
                .start = StopIdx(1);
        }
    }
    blocks.map(44, 44)
}

/// A deck 9 m above the floor, to which only a lift leads: one that cycles, or one that is called.
pub fn deck_with_lift(cycles: bool) -> Map {
    let mut blocks = Blocks::default();
    blocks.ground([2.0, 2.0], [52.0, 42.0]);
    blocks.solid([22.0, -1.0, 12.0], [38.0, 9.0, 32.0]);
    let lift = blocks.mover(MoverKind::Lift, [18.9, -0.1, 20.0], [21.95, 0.1, 24.0], &[Vec3::Y * 8.95], 3.0);
    lift.cycles = cycles;
    blocks.map(54, 44)
}

/// Length of the way from the floor of [`deck_with_lift`] over the lift to the deck, m.
pub const LIFT_WAY: f32 = 26.0;
/// Where that way gets to the lift, stands on it, and leaves it, m.
pub const LIFT_STOPS: [f32; 3] = [10.0, 12.5, 15.0];

/// The place on that way after `run` metres, m, while the lift is `lift_m` above its place on the floor.
pub fn on_the_lift_way(run: f32, lift_m: f32) -> Vec3 {
    let x = 8.0 + run;
    let height = if x < 18.9 {
        0.0
    } else if x <= 21.95 {
        lift_m + 0.1
    } else {
        9.0
    };
    Vec3::new(x, FLOOR + height, 22.0)
}

/// A hall with a doorway of 3 m, and beyond it stairs up to a deck of 3 m whose far side is a ledge.
pub fn course() -> Map {
    let mut blocks = hall(64.0);
    blocks.wall([22.8, 2.0], [23.2, 11.5]);
    blocks.wall([22.8, 14.5], [23.2, 24.0]);
    for step in 0..20 {
        let (begin, top) = (30.0 + 0.3 * step as f32, 0.15 * (step + 1) as f32);
        blocks.solid([begin, -1.0, 3.0], [36.0, top, 8.0]);
    }
    blocks.solid([36.0, -1.0, 3.0], [48.0, 3.0, 8.0]);
    blocks.map(66, 26)
}

/// Distance from the begin of [`round_the_course`] to the doorway, m.
pub const DOORWAY_AT: f32 = 18.0;

/// Round the hall: through the doorway, up the stairs, down the ledge, and back.
pub fn round_the_course() -> Way {
    let way = [
        [6.0, 0.0, 6.0],
        [20.0, 0.0, 13.0],
        [26.0, 0.0, 13.0],
        [29.0, 0.0, 5.5],
        [30.0, 0.0, 5.5],
        [36.0, 3.0, 5.5],
        [48.5, 3.0, 5.5],
        [49.0, 0.0, 5.5],
        [54.0, 0.0, 10.0],
        [50.0, 0.0, 19.0],
        [26.0, 0.0, 13.0],
        [20.0, 0.0, 13.0],
        [6.0, 0.0, 19.0],
    ];
    on_the_floor(&way)
}

/// Places of the course in the order in which a group visits them: in both halls and on the deck, m.
pub fn across_the_course() -> Vec<Vec3> {
    on_the_floor(&[[54.0, 0.0, 16.0], [42.0, 3.0, 5.5], [8.0, 0.0, 12.0]]).0
}

/// Round six of the rooms of [`rooms`], with the doors on the way: their movers and middles, m.
pub fn round_the_rooms() -> (Way, Vec<(usize, Vec3)>) {
    let middle = |[x, z]: [usize; 2]| [7.0 + 10.0 * x as f32, 0.0, 7.0 + 10.0 * z as f32];
    let rooms = [[0, 0], [1, 0], [2, 0], [2, 1], [1, 1], [0, 1]];
    let next = rooms.iter().copied().cycle().skip(1);
    let doors = rooms.iter().copied().zip(next).map(|([x, z], [to_x, to_z])| {
        let (line, room, kind) = if z == to_z { (x.max(to_x), z, 1) } else { (z.max(to_z), x, 0) };
        let at = Vec3::from(middle([x, z])).midpoint(Vec3::from(middle([to_x, to_z])));
        (2 * (4 * (line - 1) + room) + kind, at + Vec3::Y * FLOOR)
    });
    (on_the_floor(&rooms.map(middle)), doors.collect())
}

/// A hall of 44 x 44 m around a block of 24 x 24 m.
pub fn block() -> Map {
    let mut blocks = Blocks::default();
    blocks.ground([2.0, 2.0], [46.0, 46.0]);
    blocks.wall([12.0, 12.0], [36.0, 36.0]);
    for (low, high) in [([1.0, 1.0], [47.0, 2.0]), ([1.0, 46.0], [47.0, 47.0])] {
        blocks.wall(low, high);
        blocks.wall([low[1], low[0]], [high[1], high[0]]);
    }
    blocks.map(48, 48)
}

/// Round the block of [`block`].
pub fn round_the_block() -> Way {
    on_the_floor(&[[7.0, 0.0, 7.0], [41.0, 0.0, 7.0], [41.0, 0.0, 41.0], [7.0, 0.0, 41.0]])
}

/// A way whose heights are above the floor, m.
fn on_the_floor(way: &[[f32; 3]]) -> Way {
    Way(way.iter().map(|place| Vec3::from(*place) + Vec3::Y * FLOOR).collect())
}

/// Two islands over a void, 26 m apart, with a platform that goes to and fro.
pub fn ferry() -> Map {
    let mut blocks = Blocks::default();
    blocks.ground([2.0, 2.0], [32.0, 32.0]);
    blocks.ground([62.0, 2.0], [92.0, 32.0]);
    let platform = blocks.mover(MoverKind::Platform, [32.1, -0.3, 15.0], [36.1, 0.0, 19.0], &[Vec3::X * 25.8], 6.5);
    platform.cycles = true;
    blocks.map(94, 34)
}

/// Two islands over a void with a bridge of three floors, 5 m wide and 4 m long each, that vanish and come back in
/// turn.
pub fn vanishing_bridge() -> Map {
    let mut blocks = Blocks::default();
    blocks.ground([2.0, 2.0], [32.0, 32.0]);
    blocks.ground([44.0, 2.0], [74.0, 32.0]);
    for tile in 0..3 {
        let x = 32.0 + 4.0 * tile as f32;
        let floor = blocks.mover(MoverKind::Floor, [x, -0.4, 14.5], [x + 4.0, 0.0, 19.5], &[Vec3::ZERO], 0.5);
        floor.stops[1].is_there = false;
        (floor.cycles, floor.dwell_s) = (true, 4.0 + 0.7 * tile as f32);
    }
    blocks.map(76, 34)
}

/// Ways between two rectangles, every other one back, m; heights are above the floor.
pub fn to_and_fro(
    one: ([f32; 2], [f32; 2], f32),
    other: ([f32; 2], [f32; 2], f32),
    count: usize,
    seed: u64,
) -> Vec<Goal> {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let mut place = |(low, high, height): ([f32; 2], [f32; 2], f32)| {
        let [x, z] = [0, 1].map(|axis| rng.random_range(low[axis]..high[axis]));
        Vec3::new(x, FLOOR + height, z)
    };
    let ways: Vec<(Vec3, Vec3)> = (0..count)
        .map(|idx| if idx % 2 == 0 { (place(one), place(other)) } else { (place(other), place(one)) })
        .collect();
    ways.into_iter().map(|(start, goal)| Goal { start, yaw: random_yaw(&mut rng), goal }).collect()
}

/// Ways between random places of [`rooms`], from one room to another.
pub fn between_rooms(count: usize, seed: u64) -> Vec<Goal> {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let mut goals = Vec::with_capacity(count);
    while goals.len() < count {
        let mut place = || {
            let room = rng.random_range(0..16);
            let at = |room: u32, within: f32| 2.0 + room as f32 * 10.0 + within;
            let (x, z) = (rng.random_range(1.5..8.5), rng.random_range(1.5..8.5));
            (room, Vec3::new(at(room % 4, x), FLOOR, at(room / 4, z)))
        };
        let ((from, start), (to, goal)) = (place(), place());
        if from != to {
            goals.push(Goal { start, yaw: random_yaw(&mut rng), goal });
        }
    }
    goals
}
