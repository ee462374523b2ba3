//! A discrete-event simulation of a fleet: ticks wait for cores, batches for workers, plans for planners, saves for the
//! database. Durations are drawn from the recorded load; a seed fixes the draws.

use super::load::Load;
use super::model::{DECISIONS_PER_S, Fleet, Model, TICKS_PER_S};
use super::record_load::RecordLoad;
use rand::rngs::ChaCha8Rng;
use rand::{RngExt, SeedableRng};
use std::cmp::{Ordering, Reverse};
use std::collections::{BinaryHeap, VecDeque};

/// Length of a simulation after its warm-up, s.
const SPAN_S: f64 = 60.0;
/// Warm-up of a simulation, which does not count, s.
const WARM_UP_S: f64 = 2.0;
const SEED: u64 = 1;
/// Ticks between two batches of observations of the same NPCs. A decision that arrives later is missed.
const ANSWER_WITHIN_S: f64 = 1.0 / DECISIONS_PER_S;
/// Delay from a server to a worker, or back, s.
const HOP_S: f64 = 0.0005;

/// Simulates a minute of a fleet.
pub fn play(fleet: Fleet, model: &Model, load: &Load) -> Played {
    let shape = Shape::of(load, fleet.npcs);
    Simulation::new(fleet, model, shape).run()
}

/// The result of a simulation.
#[derive(Debug, Clone, Copy)]
pub struct Played {
    /// Median and 99th percentile of the time from the due time of a tick to its end, ms.
    pub tick_p50_ms: f64,
    pub tick_p99_ms: f64,
    /// Share of ticks that were not done when the next one was due.
    pub late_share: f64,
    /// Share of decisions that were answered before the next observation.
    pub on_time_share: f64,
    /// Utilisation of the cores of each part. Where all parts share cores, the first value is for all of them.
    pub server_share: f64,
    pub worker_share: f64,
    pub planner_share: f64,
    pub record_share: f64,
}

/// The distribution of tick durations: equally likely multiples of their mean, ascending.
#[derive(Debug, Clone)]
struct Shape(Vec<f64>);

impl Shape {
    /// The distribution of the recorded number of NPCs nearest to `npcs`. The longer half of the ticks also waited for
    /// cores, so the spread is slightly exaggerated.
    fn of(load: &Load, npcs: usize) -> Self {
        let nearest = load.rungs.iter().min_by_key(|rung| rung.npcs.abs_diff(npcs)).expect("a load has rungs");
        let times: Vec<f64> = nearest.tick_quantiles_us.iter().map(|&us| f64::from(us)).collect();
        let mean = times.iter().sum::<f64>() / times.len().max(1) as f64;
        Self(times.into_iter().map(|time| time / mean).collect())
    }

    fn draw(&self, rng: &mut ChaCha8Rng) -> f64 {
        self.0[rng.random_range(0..self.0.len())]
    }
}

/// An event.
#[derive(Debug, Clone, Copy)]
enum Event {
    /// A tick of a world is due.
    Due { world: usize },
    /// A batch arrives at a worker, with observations of its NPCs as of `since`.
    Batch { worker: usize, since: f64 },
    /// An NPC needs a plan.
    Plan,
    /// A world is saved, a lease renewed, or events are written; repeats after `every`.
    Write { every: f64 },
    /// A job of a pool is done.
    Done { pool: usize, job: Job },
}

/// What a pool works on.
#[derive(Debug, Clone, Copy)]
enum Job {
    Tick { world: usize, due: f64 },
    Decisions { since: f64 },
    Other,
}

#[derive(Debug, Clone, Copy)]
struct At(f64, u64, Event);

impl PartialEq for At {
    fn eq(&self, other: &Self) -> bool {
        self.cmp(other) == Ordering::Equal
    }
}

impl Eq for At {}

impl PartialOrd for At {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl Ord for At {
    fn cmp(&self, other: &Self) -> Ordering {
        self.0.total_cmp(&other.0).then(self.1.cmp(&other.1))
    }
}

/// Cores that serve jobs in the order of arrival.
#[derive(Debug, Default)]
struct Pool {
    cores: usize,
    busy: usize,
    waiting: VecDeque<(f64, Job)>,
    used_s: f64,
}

struct Simulation<'a> {
    fleet: Fleet,
    model: &'a Model,
    shape: Shape,
    rng: ChaCha8Rng,
    now: f64,
    count: u64,
    events: BinaryHeap<Reverse<At>>,
    /// Pools of the servers, the workers, the planners and the database. Where all share cores, only the first has
    /// some.
    pools: Vec<Pool>,
    ticks_us: Vec<f64>,
    late: u64,
    on_time: u64,
    missed: u64,
}

impl<'a> Simulation<'a> {
    fn new(fleet: Fleet, model: &'a Model, shape: Shape) -> Self {
        let pool = |cores| Pool { cores, ..Pool::default() };
        let servers = (0..fleet.servers).map(|_| pool(fleet.server_cores));
        let workers = (0..fleet.workers).map(|_| pool(1));
        let pools = servers.chain(workers).chain([pool(fleet.planners), pool(fleet.record_cores)]).collect();
        let mut it = Self {
            fleet,
            model,
            shape,
            rng: ChaCha8Rng::seed_from_u64(SEED),
            now: 0.0,
            count: 0,
            events: BinaryHeap::new(),
            pools,
            ticks_us: Vec::new(),
            late: 0,
            on_time: 0,
            missed: 0,
        };
        let worlds = fleet.servers * model.worlds;
        let RecordLoad { save_every_s, renew_every_s, notes_per_s, .. } = model.record;
        for world in 0..worlds {
            // Worlds of a server share its time evenly.
            let phase = (world % model.worlds) as f64 / model.worlds as f64 / TICKS_PER_S;
            it.at(phase, Event::Due { world });
            if !fleet.shares_cores {
                let first = it.rng.random_range(0.0..save_every_s);
                it.at(first, Event::Write { every: save_every_s });
            }
        }
        for _ in 0..if fleet.shares_cores { 0 } else { fleet.servers + fleet.planners } {
            let first = it.rng.random_range(0.0..renew_every_s);
            it.at(first, Event::Write { every: renew_every_s });
        }
        for _ in 0..if fleet.shares_cores { 0 } else { fleet.servers } {
            let every = 1.0 / notes_per_s.max(1e-3);
            let first = it.rng.random_range(0.0..every);
            it.at(first, Event::Write { every });
        }
        it.at(0.0, Event::Plan);
        it
    }

    fn at(&mut self, time: f64, event: Event) {
        self.count += 1;
        self.events.push(Reverse(At(time, self.count, event)));
    }

    fn is_counted(&self) -> bool {
        self.now >= WARM_UP_S
    }

    /// A draw from the exponential distribution with this mean.
    fn exponential(&mut self, mean: f64) -> f64 {
        -mean * (1.0 - self.rng.random::<f64>()).ln()
    }

    fn submit(&mut self, pool: usize, takes_s: f64, job: Job) {
        let pool = if self.fleet.shares_cores { 0 } else { pool };
        let counted = self.is_counted();
        let entry = &mut self.pools[pool];
        if counted {
            entry.used_s += takes_s;
        }
        if entry.busy == entry.cores {
            entry.waiting.push_back((takes_s, job));
            return;
        }
        entry.busy += 1;
        self.at(self.now + takes_s, Event::Done { pool, job });
    }

    fn run(mut self) -> Played {
        while let Some(Reverse(At(time, _, event))) = self.events.pop() {
            if time > WARM_UP_S + SPAN_S {
                break;
            }
            self.now = time;
            self.handle(event);
        }
        self.ticks_us.sort_unstable_by(f64::total_cmp);
        let quantile = |share: f64| {
            let idx = (self.ticks_us.len() as f64 * share) as usize;
            self.ticks_us.get(idx.min(self.ticks_us.len().saturating_sub(1))).map_or(0.0, |us| us / 1000.0)
        };
        let share = |pools: &[Pool]| {
            let cores: usize = pools.iter().map(|pool| pool.cores).sum();
            pools.iter().map(|pool| pool.used_s).sum::<f64>() / (cores as f64 * SPAN_S)
        };
        let (servers, rest) = self.pools.split_at(self.fleet.servers);
        let (workers, shared) = rest.split_at(self.fleet.workers);
        Played {
            tick_p50_ms: quantile(0.5),
            tick_p99_ms: quantile(0.99),
            late_share: self.late as f64 / self.ticks_us.len().max(1) as f64,
            on_time_share: self.on_time as f64 / (self.on_time + self.missed).max(1) as f64,
            server_share: share(servers),
            worker_share: share(workers),
            planner_share: share(&shared[..1]),
            record_share: share(&shared[1..]),
        }
    }

    fn handle(&mut self, event: Event) {
        let Fleet { servers, workers, npcs, .. } = self.fleet;
        match event {
            Event::Due { world } => {
                let mean_us = self.model.tick_us.at(npcs as f64 / self.model.worlds as f64);
                let takes_s = 1e-6 * mean_us * self.shape.draw(&mut self.rng);
                self.submit(world / self.model.worlds, takes_s, Job::Tick { world, due: self.now });
            }
            Event::Batch { worker, since } => {
                // A tenth of a world's NPCs decides at every tick.
                let batch = npcs as f64 / self.model.worlds as f64 * DECISIONS_PER_S / TICKS_PER_S;
                self.submit(servers + worker, 1e-6 * batch * self.model.decision_us, Job::Decisions { since });
            }
            Event::Plan => {
                let mean_s = 1.0 / (self.model.plans_per_s * (servers * npcs) as f64);
                let (next, takes_s) =
                    (self.now + self.exponential(mean_s), self.exponential(1e-6 * self.model.plan_us));
                self.at(next, Event::Plan);
                self.submit(servers + workers, takes_s, Job::Other);
            }
            Event::Write { every } => {
                let takes_s = self.exponential(1e-6 * self.model.record.cpu_us_per_write);
                self.at(self.now + every, Event::Write { every });
                self.submit(servers + workers + 1, takes_s, Job::Other);
            }
            Event::Done { pool, job } => {
                let entry = &mut self.pools[pool];
                match entry.waiting.pop_front() {
                    Some((takes_s, next)) => self.at(self.now + takes_s, Event::Done { pool, job: next }),
                    None => entry.busy -= 1,
                }
                self.done(job);
            }
        }
    }

    fn done(&mut self, job: Job) {
        match job {
            Job::Tick { world, due } => {
                let period = 1.0 / TICKS_PER_S;
                if self.is_counted() {
                    self.ticks_us.push(1e6 * (self.now - due));
                    self.late += u64::from(self.now > due + period);
                }
                // A world runs one tick at a time.
                self.at((due + period).max(self.now), Event::Due { world });
                let worker = world % self.fleet.workers;
                self.at(self.now + HOP_S, Event::Batch { worker, since: self.now });
            }
            Job::Decisions { since } if self.is_counted() => {
                let is_on_time = self.now + HOP_S <= since + ANSWER_WITHIN_S;
                *(if is_on_time { &mut self.on_time } else { &mut self.missed }) += 1;
            }
            Job::Decisions { .. } | Job::Other => {}
        }
    }
}
