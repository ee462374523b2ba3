//! Chases: NPCs that keep to a runner, or to each other, while doors open, lifts move and the way turns.

use super::scenes::{self, FLOOR, Way};
use super::{Level, SceneReport, Suite};
use crate::config::EvalError;
use crate::report::Rate;
use rand::rngs::ChaCha8Rng;
use rand::{RngExt, SeedableRng};
use std::collections::BTreeMap;
use std::time::Instant;
use surefoot_rollout::Rollout;
use surefoot_rollout::attempts::{Chase, Chased, Errand};
use surefoot_rollout::goals::{Goal, random_yaw};
use surefoot_world::arrival::KEEP_SLACK_M;
use surefoot_world::fleeing::Danger;
use surefoot_world::float::distance_to_segment;
use surefoot_world::formation::{Formation, LEADER_SPEED, Shape};
use surefoot_world::{
    Arrival, CharacterProfile, DECISION_SECONDS, Gait, MoverId, MoverOrder, NpcSlot, StopIdx, TaskConfig, Vec3, World,
};

/// Length of a chase, decisions: one minute.
const CHASE: u32 = 360;
/// Distance from a target at which an NPC is in contact with it, m.
const CONTACT_M: f32 = 3.0;
/// Distance from a target at which an NPC stands, m: the radius of goals unless a client says otherwise.
const RADIUS_M: f32 = 1.0;
/// Distance from a target at which a chaser has caught it, m.
const CATCH_M: f32 = 1.5;
/// NPCs of a column.
const COLUMN: usize = 16;
/// NPCs of a wedge with their leader, and the distance between them, m.
const WEDGE: usize = 9;
const WEDGE_SPACING_M: f32 = 1.7;
/// Speed of a player that walks, m/s.
const RUNNER_SPEED: f32 = 3.0;
/// Decisions for which a player stays at each end of its way by a lift: 5 s.
const LIFT_DWELL: u32 = 30;
/// Speed of the runner that is cut off, m/s; NPCs run at 11 m/s.
const CUT_OFF_SPEED: f32 = 12.0;
/// Distances of its chasers behind it on its way at first, m: the second one is nearer if it goes to meet it.
const BEHIND_M: [f32; 2] = [8.0, 90.0];
/// Distance from a hunter that an NPC keeps, and within which it is in danger, m.
const FLEE_M: f32 = 8.0;
const DANGER_M: f32 = 5.0;
/// Distance of the hunter from the NPC at first, m.
const HUNTER_AT_M: f32 = 4.0;
/// Decisions from one look at the hunter to the next: 0.5 s.
const LOOK: u32 = 3;
/// Distance from a door within which the player opens it, m, and time after which it shuts behind him, decisions.
const DOOR_M: f32 = 3.0;
const DOOR_OPEN: u32 = 12;

/// How long NPCs were with their targets.
#[derive(Default)]
struct Contact {
    /// Decisions in contact, of the decisions since the first contact.
    near: usize,
    counted: usize,
    /// Time until the first contact, decisions, summed over the NPCs that had one.
    first: u64,
    /// NPCs that had contact, and all NPCs.
    met: usize,
    npcs: usize,
    died: usize,
    runs_without_deaths: u64,
    runs: u64,
    /// Time of the machine, s, in which NPCs took so many decisions.
    cpu: (f64, u64),
}

/// Contact of the NPCs of one run: the decision of the first one.
struct Watch(Vec<Option<u32>>);

impl Contact {
    /// Watches the distances of NPCs from their targets before a decision, m.
    fn watch(&mut self, watch: &mut Watch, decision: u32, gaps: impl Iterator<Item = f32>) {
        for (gap, first) in gaps.zip(&mut watch.0) {
            if gap <= CONTACT_M && first.is_none() {
                *first = Some(decision);
                self.met += 1;
                self.first += u64::from(decision);
            }
            self.counted += usize::from(first.is_some());
            self.near += usize::from(first.is_some() && gap <= CONTACT_M);
        }
    }

    fn end_run(&mut self, chased: &Chased, seconds: f64) {
        let died = chased.harm.iter().flatten().count();
        self.npcs += chased.harm.len();
        self.died += died;
        self.runs += 1;
        self.runs_without_deaths += u64::from(died == 0);
        self.cpu = (self.cpu.0 + seconds, self.cpu.1 + chased.decided);
    }

    /// The report; `standing` is the time that a decision takes on the way to a goal that does not move, s.
    fn report(&self, about: String, target: &str, standing: Option<f64>) -> SceneReport {
        let (seconds, decided) = self.cpu;
        SceneReport {
            name: String::new(),
            about,
            target: target.to_owned(),
            runs: self.runs,
            success: Rate::of(self.near, self.counted),
            ends: BTreeMap::from([("in contact".to_owned(), self.met as u64), ("died".to_owned(), self.died as u64)]),
            deadlocks: None,
            seconds_mean: self.first as f64 / self.met.max(1) as f64 * f64::from(DECISION_SECONDS),
            seconds_last: 0.0,
            runs_complete: self.runs_without_deaths,
            reference: None,
            cpu_ratio: standing.map(|standing| seconds / decided.max(1) as f64 / standing),
        }
    }
}

impl Suite<'_> {
    fn rollout(&self, level: &Level, seed: u64, solid: bool) -> Rollout {
        let mut rollout = Rollout::new(level.map.clone(), CharacterProfile::default(), TaskConfig::default());
        (rollout.seed, rollout.solid, rollout.follow.arrival) = (seed, solid, Arrival::Stand);
        rollout
    }

    /// Runs a chase of `decisions` decisions and adds to `contact`. `targets` moves the goals before a decision, and
    /// returns where the NPCs' targets are, m.
    fn watch(
        &self,
        contact: &mut Contact,
        (level, rollout): (&Level, &Rollout),
        (starts, decisions): (&[Goal], u32),
        mut targets: impl FnMut(&mut World, u32, &mut [Errand]) -> Vec<Vec3>,
    ) {
        let mut watch = Watch(vec![None; starts.len()]);
        let started = Instant::now();
        let chased = self.chase(rollout, level, decisions).run(starts, |world, decision, errands| {
            let targets = targets(world, decision, errands);
            contact.watch(&mut watch, decision, gaps(world, &targets));
        });
        contact.end_run(&chased, started.elapsed().as_secs_f64());
    }

    fn chase<'a>(&'a self, rollout: &'a Rollout, level: &'a Level, decisions: u32) -> Chase<'a> {
        Chase { rollout, policy: self.policy, router: &level.router, radius: RADIUS_M, decisions }
    }

    /// One NPC after a player that goes round the course at `speed`, m/s; its goal is set so many times a second, and
    /// moves on in between if updates have a velocity.
    pub(super) fn pursuit(&self, speed: f32, updates_hz: f32, has_velocity: bool) -> Result<SceneReport, EvalError> {
        let level = self.level(scenes::course())?;
        let way = scenes::round_the_course();
        let mut contact = Contact::default();
        for seed in 0..self.config.runs {
            let mut rng = ChaCha8Rng::seed_from_u64(seed);
            let begin = rng.random_range(0.0..100.0);
            let start = Goal { start: way.at(begin + 30.0), yaw: random_yaw(&mut rng), goal: way.at(begin) };
            let rollout = self.rollout(&level, seed, false);
            self.watch(&mut contact, (&level, &rollout), (&[start], CHASE), |_, decision, errands| {
                let time = decision as f32 * DECISION_SECONDS;
                let player = way.at(begin + speed * time);
                let since = (time * updates_hz + 1.0e-3).fract() / updates_hz;
                let [before, known] = [0.05, 0.0].map(|ago| way.at(begin + speed * (time - since) - ago));
                let velocity = (known - before).normalize_or_zero() * speed;
                errands[0].goal = if has_velocity { known + velocity * since } else { known };
                vec![player]
            });
        }
        let standing = self.seconds_per_decision(&level, &way);
        let about = format!(
            "a player at {speed} m/s over a ledge, up stairs and through a doorway, {updates_hz} updates/s{}",
            if has_velocity { " with velocities" } else { "" }
        );
        Ok(contact.report(
            about,
            if speed <= RUNNER_SPEED { "within 3 m for 95 %" } else { "no deaths" },
            Some(standing),
        ))
    }

    /// Time that a decision of one NPC takes on the way to goals that do not move, s.
    fn seconds_per_decision(&self, level: &Level, way: &Way) -> f64 {
        let (mut seconds, mut decisions) = (0.0, 0);
        for seed in 0..self.config.runs.max(1) * 4 {
            let mut rng = ChaCha8Rng::seed_from_u64(seed);
            let [from, to] = [0.0, 50.0].map(|ahead| way.at(ahead + rng.random_range(0.0..100.0)));
            let goal = Goal { start: from, yaw: random_yaw(&mut rng), goal: to };
            let started = Instant::now();
            let attempts = self.rollout(level, seed, false).live(self.policy, &level.router, &[goal], |_, _| {});
            seconds += started.elapsed().as_secs_f64();
            decisions += attempts[0].decisions;
        }
        seconds / f64::from(decisions.max(1))
    }

    /// NPCs in a column, each after the one ahead, the first one after a player.
    pub(super) fn column(&self) -> Result<SceneReport, EvalError> {
        let level = self.level(scenes::course())?;
        let way = scenes::round_the_course();
        let mut contact = Contact::default();
        for seed in 0..self.config.runs {
            let mut rng = ChaCha8Rng::seed_from_u64(seed);
            let row = |idx: usize| Vec3::new(20.0 - (idx % 8) as f32 * 1.7, FLOOR, 11.0 + (idx / 8) as f32 * 1.7);
            let starts: Vec<Goal> =
                (0..COLUMN).map(|idx| Goal { start: row(idx), yaw: random_yaw(&mut rng), goal: row(idx) }).collect();
            let rollout = self.rollout(&level, seed, true);
            self.watch(&mut contact, (&level, &rollout), (&starts, CHASE), |world, decision, errands| {
                let mut targets = vec![way.at(scenes::DOORWAY_AT + RUNNER_SPEED * decision as f32 * DECISION_SECONDS)];
                targets.extend((1..COLUMN).map(|idx| feet(world, idx - 1).unwrap_or(errands[idx].goal)));
                errands.iter_mut().zip(&targets).for_each(|(errand, target)| errand.goal = *target);
                targets
            });
        }
        let about = format!("a column of {COLUMN} solid NPCs behind a player at 3 m/s");
        Ok(contact.report(about, "within 3 m for 95 %", None))
    }

    /// A wedge of NPCs behind one that goes from place to place of the course.
    pub(super) fn wedge(&self) -> Result<SceneReport, EvalError> {
        let level = self.level(scenes::course())?;
        let goals = scenes::across_the_course();
        let mut contact = Contact::default();
        for seed in 0..self.config.runs {
            let mut rng = ChaCha8Rng::seed_from_u64(seed);
            let row = |idx: usize| Vec3::new(14.0 - (idx % 3) as f32 * 1.7, FLOOR, 11.0 + (idx / 3) as f32 * 1.7);
            let starts: Vec<Goal> =
                (0..WEDGE).map(|idx| Goal { start: row(idx), yaw: random_yaw(&mut rng), goal: row(idx) }).collect();
            let rollout = self.rollout(&level, seed, true);
            let mut next = goals.iter().cycle();
            let mut goal = *next.next().expect("it never ends");
            let mut formation = Formation::new(Shape::Wedge, WEDGE_SPACING_M, starts[0].start, goal);
            let slots: Vec<NpcSlot> = (1..WEDGE as u32).map(NpcSlot).collect();
            self.watch(&mut contact, (&level, &rollout), (&starts, CHASE), |world, _, errands| {
                let leader = feet(world, 0).unwrap_or(errands[0].goal);
                if leader.distance(goal) <= RADIUS_M + KEEP_SLACK_M {
                    goal = *next.next().expect("it never ends");
                }
                errands[0].goal = goal;
                if world.npc(NpcSlot(WEDGE as u32 - 1)).is_some() {
                    let orders = formation.update(world, NpcSlot(0), &slots);
                    errands[0].waits = orders.leader_waits;
                    errands[0].gait = Gait::default().at_most(LEADER_SPEED);
                    for (errand, place) in errands[1..].iter_mut().zip(orders.places) {
                        errand.goal = place.unwrap_or(errand.goal);
                    }
                }
                let mut targets = vec![leader];
                targets.extend(errands[1..].iter().map(|errand| errand.goal));
                targets
            });
        }
        let about = format!("a wedge of {WEDGE} solid NPCs through a doorway and up stairs");
        Ok(contact.report(about, "within 3 m for 95 %", None))
    }

    /// One NPC after a player that opens doors, which shut behind him.
    pub(super) fn pursuit_through_doors(&self) -> Result<SceneReport, EvalError> {
        let level = self.level(scenes::rooms())?;
        let (way, doors) = scenes::round_the_rooms();
        let mut contact = Contact::default();
        for seed in 0..self.config.runs {
            let mut rng = ChaCha8Rng::seed_from_u64(seed);
            let begin = 10.0 * rng.random_range(0..4) as f32;
            let start = Goal { start: way.at(begin - 4.0), yaw: random_yaw(&mut rng), goal: way.at(begin) };
            let rollout = self.rollout(&level, seed, false);
            let mut shuts_at = vec![0; level.map.movers().len()];
            self.watch(&mut contact, (&level, &rollout), (&[start], CHASE), |world, decision, errands| {
                let player = way.at(begin + RUNNER_SPEED * decision as f32 * DECISION_SECONDS);
                errands[0].goal = player;
                for (idx, middle) in &doors {
                    if middle.distance(player) <= DOOR_M {
                        shuts_at[*idx] = decision + DOOR_OPEN;
                    }
                }
                for (idx, shuts) in shuts_at.iter().enumerate() {
                    order(world, idx, u8::from(decision < *shuts));
                }
                vec![player]
            });
        }
        let about = "a player at 3 m/s through six doors that shut 2 s after him".to_owned();
        Ok(contact.report(about, "within 3 m for 95 %", None))
    }

    /// One NPC after a player that goes up and down by a lift.
    pub(super) fn pursuit_onto_a_lift(&self) -> Result<SceneReport, EvalError> {
        let level = self.level(scenes::deck_with_lift(false))?;
        let mut contact = Contact::default();
        for seed in 0..self.config.runs {
            let mut rng = ChaCha8Rng::seed_from_u64(seed);
            let place = Vec3::new(rng.random_range(4.0..12.0), FLOOR, rng.random_range(6.0..38.0));
            let start = Goal { start: place, yaw: random_yaw(&mut rng), goal: place };
            let rollout = self.rollout(&level, seed, false);
            let mut rider = Rider::default();
            self.watch(&mut contact, (&level, &rollout), (&[start], 2 * CHASE), |world, _, errands| {
                errands[0].goal = rider.step(world);
                vec![errands[0].goal]
            });
        }
        let about = "a player that rides a lift up and down, with 5 s at each end".to_owned();
        Ok(contact.report(about, "no deaths", None))
    }

    /// One NPC that flees from a hunter, which goes after it round a block.
    pub(super) fn flight(&self, hides: bool) -> Result<SceneReport, EvalError> {
        let level = self.level(scenes::block())?;
        let way = scenes::round_the_block();
        let mut contact = Contact::default();
        for seed in 0..self.config.runs {
            let mut rng = ChaCha8Rng::seed_from_u64(seed);
            let begin = rng.random_range(0.0..100.0);
            let place = way.at(begin + HUNTER_AT_M);
            let start = Goal { start: place, yaw: random_yaw(&mut rng), goal: place };
            let rollout = self.rollout(&level, seed, false);
            let mut hunter = begin;
            let watched = (&[start][..], CHASE);
            self.watch(&mut contact, (&level, &rollout), watched, |world, decision, errands| {
                let feet = feet(world, 0).unwrap_or(place);
                hunter += way.towards(hunter, feet).clamp(-1.0, 1.0) * RUNNER_SPEED * DECISION_SECONDS;
                let danger = Danger { at: way.at(hunter), distance: FLEE_M, hides };
                let is_safe = |place: Vec3| danger.spares(world.map(), place);
                if decision > 0 && decision % LOOK == 0 && !is_safe(feet) && !is_safe(errands[0].goal) {
                    errands[0].goal = danger.refuge(world, NpcSlot(0), &mut rng).unwrap_or(errands[0].goal);
                }
                let near = Danger { distance: DANGER_M, ..danger };
                // Safety is contact with itself, and danger is far from it.
                vec![if near.spares(world.map(), feet) { feet } else { Vec3::INFINITY }]
            });
        }
        let sight = if hides { " and out of its sight" } else { "" };
        let about = format!("an NPC that keeps {FLEE_M} m from a hunter at {RUNNER_SPEED} m/s round a block{sight}");
        let target = if hides { "no deaths" } else { "farther than 5 m for 95 %" };
        Ok(contact.report(about, target, None))
    }

    /// Two chasers of a runner that is faster than they are and goes round a block.
    pub(super) fn cut_off(&self) -> Result<SceneReport, EvalError> {
        let level = self.level(scenes::block())?;
        let way = scenes::round_the_block();
        let (two, two_s) = self.catches(&level, &way, 2);
        let (one, one_s) = self.catches(&level, &way, 1);
        let runs = self.config.runs as usize;
        let about = format!("two NPCs, one of them ahead, after a runner at {CUT_OFF_SPEED} m/s round a block");
        Ok(SceneReport {
            name: String::new(),
            about,
            target: "caught in all runs".to_owned(),
            runs: self.config.runs,
            success: Rate::of(two, runs),
            ends: BTreeMap::new(),
            deadlocks: None,
            seconds_mean: two_s,
            seconds_last: two_s,
            runs_complete: two as u64,
            reference: Some(("one NPC".to_owned(), Rate::of(one, runs).rate, one_s)),
            cpu_ratio: None,
        })
    }

    /// Runs in which `count` chasers catch the runner, and the mean time until then, s.
    fn catches(&self, level: &Level, way: &Way, count: usize) -> (usize, f64) {
        let (mut caught, mut time) = (0, 0);
        for seed in 0..self.config.runs {
            let mut rng = ChaCha8Rng::seed_from_u64(seed);
            let begin = rng.random_range(0.0..100.0);
            let mut start = |behind: f32| {
                let [start, goal] = [begin - behind, begin].map(|run| way.at(run));
                Goal { start, yaw: random_yaw(&mut rng), goal }
            };
            let starts: Vec<Goal> = BEHIND_M.into_iter().take(count).map(&mut start).collect();
            let rollout = self.rollout(level, seed, false);
            let (mut first, mut former) = (None, Vec::new());
            self.chase(&rollout, level, CHASE).run(&starts, |world, decision, errands| {
                let runner = way.at(begin + CUT_OFF_SPEED * decision as f32 * DECISION_SECONDS);
                errands.iter_mut().for_each(|errand| errand.goal = runner);
                let apart: Vec<Vec3> = (0..count).filter_map(|idx| Some(feet(world, idx)? - runner)).collect();
                let is_caught = apart
                    .iter()
                    .zip(&former)
                    .any(|(now, before)| distance_to_segment(Vec3::ZERO, *before, *now) <= CATCH_M);
                first = first.or(is_caught.then_some(decision));
                former = apart;
            });
            caught += usize::from(first.is_some());
            time += first.unwrap_or(0);
        }
        (caught, f64::from(time) / caught.max(1) as f64 * f64::from(DECISION_SECONDS))
    }
}

/// A player that walks to and fro between a floor and a deck, and rides a lift between them.
#[derive(Default)]
struct Rider {
    /// Distance from its place on the floor, m.
    run: f32,
    is_back: bool,
    /// Decisions for which it has waited at the end of its way.
    waited: u32,
}

impl Rider {
    /// Where the player is before a decision, m. It orders the lift where it waits for it.
    fn step(&mut self, world: &mut World) -> Vec3 {
        let stride = RUNNER_SPEED * DECISION_SECONDS;
        let [below, on_lift, above] = scenes::LIFT_STOPS;
        let (waits, end) = if self.is_back {
            ([(above, 1), (on_lift, 0)], 0.0)
        } else {
            ([(below, 0), (on_lift, 1)], scenes::LIFT_WAY)
        };
        let is_at = |run: f32| (self.run - run).abs() < 0.5 * stride;
        let lift = world.movers()[0];
        let awaited = waits.into_iter().find(|(run, stop)| is_at(*run) && lift.at() != Some(StopIdx(*stop)));
        if let Some((_, stop)) = awaited {
            order(world, 0, stop);
        } else if !is_at(end) {
            self.run += if self.is_back { -stride } else { stride };
        } else if self.waited < LIFT_DWELL {
            self.waited += 1;
        } else {
            (self.waited, self.is_back) = (0, !self.is_back);
        }
        scenes::on_the_lift_way(self.run, lift.pose(&world.map().movers()[0]).offset.y)
    }
}

fn order(world: &mut World, mover: usize, stop: u8) {
    if world.movers()[mover].bound_for() != StopIdx(stop) {
        world.order(MoverId(mover as u16), MoverOrder::GoTo(StopIdx(stop)));
    }
}

/// Where an NPC is, m; `None` before it is spawned.
fn feet(world: &World, idx: usize) -> Option<Vec3> {
    world.npc(NpcSlot(idx as u32)).map(|npc| npc.body.feet)
}

/// Distances of the NPCs from their targets, m.
fn gaps<'a>(world: &'a World, targets: &'a [Vec3]) -> impl Iterator<Item = f32> + 'a {
    targets.iter().enumerate().filter_map(|(idx, target)| Some(feet(world, idx)?.distance(*target)))
}
