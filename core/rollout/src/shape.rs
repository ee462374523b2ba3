//! Measures the shapes of edges: runs the policy along each edge a few more times, and records where the body leaves
//! the ground, how high it gets, and where it lands.
//!
//! Of the runs that arrive, the measurement keeps the one that a [plain controller](crate::drive) repeats most
//! reliably, with the share of tries that succeed: scripts that follow links without the policy can rely on it. The
//! same graph gives the same shapes on any number of threads.

use crate::drive::{Driver, PathPoint};
use crate::probe::{ProbeContext, Probes};
use crate::style::Style;
use std::cmp::Ordering::Equal;
use std::f32::consts::TAU;
use surefoot_planner::assets::{Leap, Passage, Shape};
use surefoot_planner::probe::{EdgeRun, Manner, Trial};
use surefoot_planner::threads::map_indices;
use surefoot_planner::{Edge, MoverAt, NavGraph, RideStops};
use surefoot_world::character::{Body, MoveScratch, is_clear};
use surefoot_world::float::hypot;
use surefoot_world::navigable::DOWN;
use surefoot_world::reach::ground::Ground;
use surefoot_world::reliance::Reliance;
use surefoot_world::{
    Ability, AbilitySet, CharacterProfile, DECISION_SECONDS, Map, NpcSlot, TICK_SECONDS, TICKS_PER_SECOND, Vec3, World,
};

/// Composed runs along each edge.
const COMPOSED_RUNS: u32 = 3;
/// Free runs along each edge.
const FREE_RUNS: u32 = 3;
/// Edges that run together.
const CHUNK: usize = 32;
/// Tries of the plain controller along each run.
const DRIVES: usize = 8;
/// Distance from the start of a passage at which the plain controller begins, m.
const AROUND_M: f32 = 1.0;
/// Horizontal distance to the end of a passage at which the plain controller has arrived, m.
const ARRIVED_M: f32 = 0.9;
/// Difference in height at which the plain controller has arrived, m.
const LEVEL_M: f32 = 1.2;
/// Descent up to which a flight counts as a step or a bump, m.
const BUMP_M: f32 = 0.6;
/// A leap is needless if a walk is at most this many times as long, plus [`WALK_MORE_M`].
const WALK_RATIO: f32 = 1.5;
/// Additional length of such a walk, m.
const WALK_MORE_M: f32 = 2.0;

/// Measures the shape of each edge of `graph` on `thread_count` threads, in order; `None` if no run arrived. `ground`
/// is the survey's and shows where a NavMesh leads. Calls `finished` after each edge.
pub fn measure(
    context: &ProbeContext,
    (graph, ground): (&NavGraph, &Ground),
    edges: &[&Edge],
    thread_count: usize,
    finished: &(dyn Fn() + Sync),
) -> Vec<Option<Shape>> {
    let ride_stops = RideStops::on(&context.map, &context.profile);
    let reliance = Reliance::on(&context.map);
    let held = |idx: usize| held(&ride_stops, graph, edges[idx]);
    let mut order: Vec<usize> = (0..edges.len()).collect();
    order.sort_by_key(|&idx| held(idx));
    let alike = order.chunk_by(|&one, &other| held(one) == held(other));
    let chunks: Vec<&[usize]> = alike.flat_map(|alike| alike.chunks(CHUNK)).collect();
    let measured = map_indices(chunks.len(), thread_count, |chunk_idx| {
        let chunk = chunks[chunk_idx];
        let of_chunk: Vec<&Edge> = chunk.iter().map(|&idx| edges[idx]).collect();
        let meter = ShapeMeter { context, reliance: &reliance, graph, ground, held: held(chunk[0]) };
        meter.measure(&of_chunk, finished)
    });
    let mut shapes: Vec<(usize, Option<Shape>)> = order.iter().copied().zip(measured.into_iter().flatten()).collect();
    shapes.sort_unstable_by_key(|(idx, _)| *idx);
    shapes.into_iter().map(|(_, shape)| shape).collect()
}

/// The mover that is held at a stop for runs along an edge that begins or ends on it.
fn held(ride_stops: &RideStops, graph: &NavGraph, edge: &Edge) -> Option<MoverAt> {
    let ride_stop = |vertex| ride_stops.at(graph.position(vertex));
    ride_stop(edge.key.from).or_else(|| ride_stop(edge.key.to))
}

/// The body after a tick.
#[derive(Debug, Clone, Copy)]
struct Moment {
    feet: Vec3,
    stands: bool,
    /// Horizontal speed, m/s.
    speed: f32,
    fuel: f32,
    /// Abilities that the body began to use in the tick.
    used: AbilitySet,
}

impl Moment {
    fn of(body: &Body, used: AbilitySet) -> Self {
        let speed = hypot(body.velocity.x, body.velocity.z);
        Self { feet: body.feet, stands: body.is_grounded(), speed, fuel: body.fuel, used }
    }
}

/// One run along an edge.
struct Runner {
    slot: NpcSlot,
    /// Abilities used in the decision so far.
    seen: AbilitySet,
    track: Vec<Moment>,
}

impl Runner {
    fn note(&mut self, world: &World) {
        let Some(npc) = world.npc(self.slot) else { return };
        let used = npc.used_abilities.difference(self.seen);
        self.seen = npc.used_abilities;
        self.track.push(Moment::of(&npc.body, used));
    }
}

/// Measures edges for which the same mover is held.
struct ShapeMeter<'a> {
    context: &'a ProbeContext,
    reliance: &'a Reliance,
    graph: &'a NavGraph,
    ground: &'a Ground,
    held: Option<MoverAt>,
}

impl ShapeMeter<'_> {
    fn measure(&self, edges: &[&Edge], finished: &(dyn Fn() + Sync)) -> Vec<Option<Shape>> {
        let mut world = self.context.world_for(self.held);
        let tracks = self.run(edges);
        let shapes = edges.iter().zip(tracks).map(|(edge, tracks)| {
            let shape = match edge.evidence.needs.ride {
                Some(_) => Some(self.whole(edge)),
                None => self.best(&mut world, edge, &tracks),
            };
            finished();
            shape
        });
        shapes.collect()
    }

    /// Runs the policy along each edge, and returns the tracks of the runs that arrived.
    fn run(&self, edges: &[&Edge]) -> Vec<Vec<Vec<Moment>>> {
        let mut probes = Probes::new(self.context, self.reliance, 0, self.held);
        let runs_each = (COMPOSED_RUNS + FREE_RUNS) as usize;
        let mut runners = Vec::with_capacity(edges.len() * runs_each);
        for edge in edges.iter().filter(|edge| edge.evidence.needs.ride.is_none()) {
            for attempt in 0..runs_each as u32 {
                let trial = self.trial(edge, attempt);
                let composed = attempt < COMPOSED_RUNS;
                let style = if composed { Style::for_leg(edge.evidence.ability) } else { Style::Free };
                let slot = probes.start_in_style(runners.len(), &trial, style);
                let start = Moment { stands: true, ..Moment::of(&Body::at(trial.start, 0.0), AbilitySet::default()) };
                runners.push(Runner { slot, seen: AbilitySet::default(), track: vec![start] });
            }
        }
        let mut arrived = vec![false; runners.len()];
        while !probes.are_done() {
            runners.iter_mut().for_each(|runner| runner.seen = AbilitySet::default());
            // All runs begin before the first one ends, so no slot is used twice.
            let ended = probes.decide(Some(&mut |worlds: &[World]| {
                runners.iter_mut().for_each(|runner| runner.note(&worlds[0]));
            }));
            ended.into_iter().for_each(|(idx, outcome)| arrived[idx] = outcome.reached);
        }
        let mut runs = runners.into_iter().zip(arrived);
        let tracks_of = |edge: &&Edge| {
            let count = if edge.evidence.needs.ride.is_none() { runs_each } else { 0 };
            runs.by_ref().take(count).filter_map(|(runner, arrived)| arrived.then_some(runner.track)).collect()
        };
        edges.iter().map(tracks_of).collect()
    }

    fn trial(&self, edge: &Edge, attempt: u32) -> Trial {
        let (start, goal) = (self.graph.position(edge.key.from), self.graph.position(edge.key.to));
        Trial {
            held: self.held,
            manner: Manner::of_edge(edge.evidence.ability),
            ..Trial::walk(start, goal, EdgeRun::Shape(attempt).stream(edge.key))
        }
    }

    /// The shape of an edge that is a ride: one passage from its start to its end.
    fn whole(&self, edge: &Edge) -> Shape {
        let (start, end) = (self.graph.position(edge.key.from), self.graph.position(edge.key.to));
        let seconds = edge.evidence.decisions_mean().0 as f32 * DECISION_SECONDS;
        Shape { passages: vec![Passage { start, end, leaps: Vec::new(), seconds, driven: 0.0 }] }
    }

    /// The shape that the plain controller repeats most reliably, with the fewest leaps, in the least time.
    fn best(&self, world: &mut World, edge: &Edge, tracks: &[Vec<Moment>]) -> Option<Shape> {
        let goal = self.graph.position(edge.key.to);
        let shapes = tracks.iter().map(|track| {
            let mut shape = Shape { passages: self.passages(track, goal) };
            shape.passages.iter_mut().for_each(|passage| passage.driven = self.drive(world, passage));
            shape
        });
        shapes.min_by(|one, other| {
            let leaps = |shape: &Shape| shape.passages.iter().map(|passage| passage.leaps.len()).sum::<usize>();
            let seconds = |shape: &Shape| shape.passages.iter().map(|passage| passage.seconds).sum::<f32>();
            let by_reliability = other.driven().total_cmp(&one.driven());
            let by_leaps = leaps(one).cmp(&leaps(other));
            [by_reliability, by_leaps, seconds(one).total_cmp(&seconds(other))]
                .into_iter()
                .find(|order| *order != Equal)
                .unwrap_or(Equal)
        })
    }

    /// The parts of a run outside the NavMesh: its leaps, each with the way between the survey's islands around it.
    fn passages(&self, track: &[Moment], goal: Vec3) -> Vec<Passage> {
        let map = &self.context.map;
        let leaps = leaps(map, track, goal).into_iter().filter(|timed| !self.is_needless(&timed.leap));
        let mut passages: Vec<Passage> = Vec::new();
        let (mut here, mut tick) = (track[0].feet, 0);
        for Timed { leap, pickup, begin, end } in leaps {
            let (entry, entered) = pickup.unwrap_or((leap.take_off, begin));
            if self.is_walked(here, entry) {
                passages.push(Passage::begin(entry));
                tick = entered;
            } else if passages.is_empty() {
                passages.push(Passage::begin(here));
            }
            let passage = passages.last_mut().expect("one has begun");
            passage.seconds += (end - tick) as f32 * TICK_SECONDS;
            passage.end = leap.landing;
            (here, tick) = (leap.landing, end);
            passage.leaps.push(leap);
        }
        if !self.is_walked(here, goal) {
            let seconds = (track.len() - 1 - tick.min(track.len() - 1)) as f32 * TICK_SECONDS;
            match passages.last_mut() {
                Some(passage) => (passage.end, passage.seconds) = (goal, passage.seconds + seconds),
                None => passages.push(Passage { end: goal, seconds, ..Passage::begin(here) }),
            }
        }
        passages
    }

    /// Whether the NavMesh leads from one place to another.
    fn is_walked(&self, from: Vec3, to: Vec3) -> bool {
        let island = |at| self.ground.at(at).map(|cell| cell.island);
        from == to || (island(from).is_some() && island(from) == island(to))
    }

    /// Whether a short walk leads where a leap goes.
    fn is_needless(&self, leap: &Leap) -> bool {
        let is_plain = matches!(leap.ability, Ability::WALK | Ability::JUMP | Ability::DOUBLE_JUMP);
        let metres = WALK_RATIO * leap.take_off.distance(leap.landing) + WALK_MORE_M;
        is_plain && self.ground.walks_within(leap.take_off, leap.landing, metres)
    }

    /// Share of tries, from places around the start, in which the plain controller completes a passage, in [0, 1].
    fn drive(&self, world: &mut World, passage: &Passage) -> f32 {
        let points = path_along(passage);
        let limit = ((2.0 * passage.seconds + 4.0) * TICKS_PER_SECOND as f32) as u32;
        let starts = self.starts(passage.start);
        let mut arrived = 0;
        for (begun, (start, yaw)) in starts.iter().enumerate() {
            // After two failures at the start, more tries are not worth their time.
            if begun == 2 && arrived == 0 {
                return 0.0;
            }
            arrived += u32::from(drive_once(world, &self.context.profile, &points, (*start, *yaw), limit));
        }
        arrived as f32 / starts.len() as f32
    }

    /// Places around the start of a passage with mixed headings; the start itself where the body cannot stand.
    fn starts(&self, centre: Vec3) -> Vec<(Vec3, f32)> {
        let mut scratch = MoveScratch::default();
        let around = (0..DRIVES).map(|idx| {
            let angle = idx as f32 / DRIVES as f32 * TAU;
            let (sin, cos) = libm::sincosf(angle);
            let place = self.stand(centre + Vec3::new(sin, 0.0, cos) * AROUND_M, &mut scratch);
            // Headings lead from behind, from the side and from ahead.
            (place.unwrap_or(centre), angle * 3.0 % TAU - TAU / 2.0)
        });
        around.collect()
    }

    /// The ground near `place` on which the body can stand, clear of liquids and devices.
    fn stand(&self, place: Vec3, scratch: &mut MoveScratch) -> Option<Vec3> {
        let (map, profile): (&Map, _) = (&self.context.map, &self.context.profile);
        let hit = map.mesh().cast_ray(place + Vec3::Y, DOWN, 1.5)?;
        let feet = place + Vec3::Y * (1.0 - hit.distance + 0.1);
        let is_free = map.liquid_at(feet, -0.1).is_none() && map.device_at(feet).is_none();
        (hit.surface.is_solid() && is_free && is_clear(map.mesh(), profile, feet, 0.03, scratch)).then_some(feet)
    }
}

/// The path along a passage, for the plain controller.
fn path_along(passage: &Passage) -> Vec<PathPoint> {
    let mut points = vec![PathPoint { at: passage.start.to_array(), by: Ability::WALK }];
    for leap in &passage.leaps {
        if points.last().is_some_and(|last| last.at != leap.take_off.to_array()) {
            points.push(PathPoint { at: leap.take_off.to_array(), by: Ability::WALK });
        }
        points.push(PathPoint { at: leap.landing.to_array(), by: leap.ability });
    }
    if points.last().is_some_and(|last| last.at != passage.end.to_array()) {
        points.push(PathPoint { at: passage.end.to_array(), by: Ability::WALK });
    }
    points
}

/// Whether the plain controller stands at the end of a path within `limit` ticks, from a start with a heading.
fn drive_once(
    world: &mut World,
    profile: &CharacterProfile,
    points: &[PathPoint],
    (start, yaw): (Vec3, f32),
    limit: u32,
) -> bool {
    let end = Vec3::from_array(points.last().expect("a path has an end").at);
    let slot = world.spawn(start, yaw);
    world.set_waypoint(slot, end);
    let mut driver = Driver::new(points);
    let mut has_arrived = false;
    for _ in 0..limit {
        let npc = world.npc(slot).expect("just spawned");
        let offset = end - npc.body.feet;
        has_arrived = driver.is_on_last_point()
            && npc.body.is_grounded()
            && offset.y.abs() < LEVEL_M
            && hypot(offset.x, offset.z) < ARRIVED_M;
        if has_arrived || npc.harm.is_some() {
            break;
        }
        let Some(action) = driver.steer(&npc.body, profile) else { break };
        world.decide(slot, action);
        world.tick();
    }
    world.despawn(slot);
    has_arrived
}

/// A leap with the ticks of its run at which it begins and ends, and the place and tick at which its jetpack was picked
/// up.
struct Timed {
    leap: Leap,
    pickup: Option<(Vec3, usize)>,
    begin: usize,
    end: usize,
}

/// The leaps of a run towards `goal`: its motion between two places where the body stands, except bumps. A device
/// begins a leap of its own.
fn leaps(map: &Map, track: &[Moment], goal: Vec3) -> Vec<Timed> {
    let mut found = Vec::new();
    let mut open: Option<Flight> = None;
    let mut pickup = None;
    for tick in 1..track.len() {
        let (before, now) = (track[tick - 1], track[tick]);
        if now.fuel > before.fuel {
            pickup = centre_of(map, before.feet).map(|centre| (centre, tick));
        }
        let enters = now.used.meets_device();
        if enters {
            let centre = centre_of(map, before.feet).unwrap_or(before.feet);
            found.extend(open.take().and_then(|flight| flight.land(track, centre, tick - 1, None)));
            open = Some(Flight::begin(centre, tick - 1, before.speed));
        }
        if !now.stands || enters {
            let flight = open.get_or_insert_with(|| Flight::begin(before.feet, tick - 1, before.speed));
            flight.used = flight.used.union(now.used);
            if now.used.contains(Ability::DOUBLE_JUMP) {
                flight.second_jump.get_or_insert(tick);
            }
        } else if let Some(flight) = open.take() {
            let picked = if flight.used.contains(Ability::JETPACK) { pickup.take() } else { None };
            found.extend(flight.land(track, now.feet, tick, picked));
        }
    }
    // A goal may be reached in flight.
    found.extend(open.and_then(|flight| flight.land(track, goal, track.len() - 1, pickup)));
    found
}

/// The centre of the device at a place.
fn centre_of(map: &Map, feet: Vec3) -> Option<Vec3> {
    map.device_at(feet).map(|device| device.from)
}

/// A leap that has not landed yet.
struct Flight {
    take_off: Vec3,
    begin: usize,
    speed: f32,
    used: AbilitySet,
    second_jump: Option<usize>,
}

impl Flight {
    fn begin(take_off: Vec3, begin: usize, speed: f32) -> Self {
        Self { take_off, begin, speed, used: AbilitySet::default(), second_jump: None }
    }

    /// The leap that ends at `landing`; `None` if it was a bump.
    fn land(self, track: &[Moment], landing: Vec3, end: usize, pickup: Option<(Vec3, usize)>) -> Option<Timed> {
        let ability = self.used.most_demanding();
        if ability == Ability::WALK && self.take_off.y - landing.y < BUMP_M {
            return None;
        }
        let seconds = |ticks: usize| ticks as f32 * TICK_SECONDS;
        let passed = track[self.begin..=end].iter().map(|moment| moment.feet).chain([self.take_off, landing]);
        let apex = passed.max_by(|one, other| one.y.total_cmp(&other.y)).expect("not empty");
        let leap = Leap {
            ability,
            take_off: self.take_off,
            apex,
            landing,
            seconds: seconds(end - self.begin),
            speed: self.speed,
            second_jump: self.second_jump.map(|tick| seconds(tick - self.begin)),
        };
        Some(Timed { leap, pickup, begin: self.begin, end })
    }
}
