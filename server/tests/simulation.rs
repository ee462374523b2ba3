//! A simulated network between hosted worlds and their workers: connections that delay, stall and break, workers that
//! fall silent and die, servers that restart. Everything follows from a seed; a failing seed is printed, and
//! `SUREFOOT_SEED=N` runs it alone.

use rand::rngs::ChaCha8Rng;
use rand::{RngExt, SeedableRng};
use std::collections::{BTreeMap, BTreeSet, VecDeque};
use std::sync::Arc;
use surefoot_server::hosted::{EventKind, HostedWorld, NpcError, SavedMap, SpawnOrder, TimeMode};
use surefoot_server::ids::{NpcId, WorkerId, WorldId};
use surefoot_server::messages::{Answer, Decision, Hello, ToWorker};
use surefoot_server::quota::Quota;
use surefoot_server::registry::Registry;
use surefoot_world::map::{MapSize, Placed};
use surefoot_world::mesh::{Surface, Triangle};
use surefoot_world::{Action, Arrival, End, Map, TICKS_PER_SECOND, Vec3};
use tokio::sync::mpsc::{Receiver, channel};

const SEEDS: u64 = 1000;
/// Ticks with faults, then ticks without.
const STORM: u64 = 8 * TICKS_PER_SECOND as u64;
const CALM: u64 = 6 * TICKS_PER_SECOND as u64;
/// Ticks that an NPC may be without a worker while one has room.
const MAX_ORPHANED: u64 = 2 * TICKS_PER_SECOND as u64;
const MAX_NPCS: usize = 6;

/// A floor of 50 x 20 m.
fn floor() -> Arc<Map> {
    let [a, b, c, d] = [[0.0, 0.0], [0.0, 20.0], [50.0, 20.0], [50.0, 0.0]].map(|[x, z]| Vec3::new(x, 1.0, z));
    let triangles = [[a, b, c], [a, c, d]].into_iter().filter_map(|t| Triangle::new(t, Surface::Ground)).collect();
    Arc::new(Map::from_parts(MapSize { width: 50, height: 10, depth: 20 }, triangles, Placed::default()))
}

/// One direction of a connection: messages arrive in order, each not before its tick.
struct Wire<T> {
    under_way: VecDeque<(u64, T)>,
}

impl<T> Wire<T> {
    fn new() -> Self {
        Self { under_way: VecDeque::new() }
    }

    fn send(&mut self, arrival: u64, message: T) {
        let latest = self.under_way.back().map_or(0, |(tick, _)| *tick);
        self.under_way.push_back((arrival.max(latest), message));
    }

    fn arrived(&mut self, tick: u64) -> Vec<T> {
        let count = self.under_way.iter().take_while(|(arrival, _)| *arrival <= tick).count();
        self.under_way.drain(..count).map(|(_, message)| message).collect()
    }
}

/// A worker as a process: its state comes from messages only.
struct Worker {
    queue: Receiver<ToWorker>,
    to_worker: Wire<ToWorker>,
    to_server: Wire<(WorldId, Answer)>,
    npcs: BTreeMap<WorldId, BTreeSet<NpcId>>,
    /// Until this tick it answers nothing, although its connection is alive.
    silent_until: u64,
    /// Until this tick its connection carries nothing.
    cut_until: u64,
}

/// What the events have said of an NPC.
#[derive(Default)]
struct Story {
    /// The attempt that is under way.
    open: Option<u32>,
    latest: u32,
}

struct Simulation {
    rng: ChaCha8Rng,
    tick: u64,
    map: Arc<Map>,
    registry: Arc<Registry>,
    quota: Arc<Quota>,
    worlds: BTreeMap<WorldId, HostedWorld>,
    seen_events: BTreeMap<WorldId, u64>,
    workers: BTreeMap<WorkerId, Worker>,
    stories: BTreeMap<NpcId, Story>,
    orphaned_since: BTreeMap<NpcId, u64>,
}

impl Simulation {
    fn new(seed: u64, map: Arc<Map>) -> Self {
        let mut simulation = Self {
            rng: ChaCha8Rng::seed_from_u64(seed),
            tick: 0,
            map,
            registry: Arc::default(),
            quota: Quota::new(1000, "NPCs"),
            worlds: BTreeMap::new(),
            seen_events: BTreeMap::new(),
            workers: BTreeMap::new(),
            stories: BTreeMap::new(),
            orphaned_since: BTreeMap::new(),
        };
        for id in 1..=simulation.rng.random_range(1..=2) {
            let world =
                HostedWorld::new(WorldId(id), simulation.map.clone(), TimeMode::Realtime, simulation.registry.clone());
            simulation.worlds.insert(WorldId(id), world);
        }
        (0..simulation.rng.random_range(1..=3)).for_each(|_| simulation.join());
        simulation
    }

    fn chance(&mut self, one_in: u32) -> bool {
        self.rng.random_range(0..one_in) == 0
    }

    fn place(&mut self) -> Vec3 {
        Vec3::new(self.rng.random_range(2.0..48.0), 1.0, self.rng.random_range(2.0..18.0))
    }

    // --- faults ---

    fn join(&mut self) {
        let capacity = self.rng.random_range(2..=12);
        self.join_with(capacity);
    }

    fn join_with(&mut self, capacity: u32) {
        let (sender, queue) = channel(4096);
        let id = self.registry.join(Hello::new("simulated", "none", capacity), sender).id;
        let worker = Worker {
            queue,
            to_worker: Wire::new(),
            to_server: Wire::new(),
            npcs: BTreeMap::new(),
            silent_until: 0,
            cut_until: 0,
        };
        self.workers.insert(id, worker);
        self.worlds.values_mut().for_each(HostedWorld::rebalance);
    }

    fn leave(&mut self, id: WorkerId) {
        self.workers.remove(&id);
        self.registry.leave(id);
        self.worlds.values_mut().for_each(|world| world.lose_worker(id));
    }

    fn any_worker(&mut self) -> Option<WorkerId> {
        let ids: Vec<WorkerId> = self.workers.keys().copied().collect();
        (!ids.is_empty()).then(|| ids[self.rng.random_range(0..ids.len())])
    }

    /// The server ends with every connection, and begins again with what it saved.
    fn restart(&mut self) {
        // The log of events ends with the process.
        self.check();
        self.registry = Arc::default();
        self.quota = Quota::new(1000, "NPCs");
        self.workers.clear();
        let worlds = std::mem::take(&mut self.worlds);
        for (id, world) in worlds {
            let saved = world.save("client", SavedMap::File(String::new(), Vec::new()));
            let world = HostedWorld::restore(&saved, self.map.clone(), self.registry.clone(), &self.quota);
            self.worlds.insert(id, world);
        }
        self.seen_events.clear();
        (0..self.rng.random_range(1..=2)).for_each(|_| self.join());
    }

    fn strike(&mut self) {
        if self.chance(240) {
            self.join();
        }
        if self.chance(300)
            && let Some(id) = self.any_worker()
        {
            self.leave(id);
        }
        if self.chance(200)
            && let Some(id) = self.any_worker()
        {
            let until = self.tick + self.rng.random_range(10..200);
            self.workers.get_mut(&id).expect("it is there").silent_until = until;
        }
        if self.chance(200)
            && let Some(id) = self.any_worker()
        {
            let until = self.tick + self.rng.random_range(5..150);
            self.workers.get_mut(&id).expect("it is there").cut_until = until;
        }
        if self.chance(900) {
            self.restart();
        }
    }

    // --- clients ---

    fn play(&mut self) {
        let world_id = WorldId(self.rng.random_range(1..=self.worlds.len() as u64));
        let (place, goal) = (self.place(), self.place());
        let world = self.worlds.get_mut(&world_id).expect("it is there");
        let npcs: Vec<NpcId> = world.npcs().map(|npc| npc.id).collect();
        let pick = |rng: &mut ChaCha8Rng| (!npcs.is_empty()).then(|| npcs[rng.random_range(0..npcs.len())]);
        match self.rng.random_range(0..40) {
            0 | 1 if npcs.len() < MAX_NPCS => {
                let order = SpawnOrder {
                    position: place,
                    yaw: 0.0,
                    goal: Some(goal),
                    body: None,
                    tags: Default::default(),
                    gait: Default::default(),
                };
                world.spawn_to(order, MAX_NPCS, self.quota.grant("client")).expect("there is room");
            }
            2 | 3 => {
                if let Some(npc) = pick(&mut self.rng) {
                    match world.set_goal(npc, goal) {
                        Ok(_) => {}
                        // It has walked off the floor.
                        Err(NpcError::Down(_)) => world.teleport(npc, place, 0.0).expect("it is there"),
                        Err(error) => panic!("{error}"),
                    }
                }
            }
            4 => {
                if let Some(npc) = pick(&mut self.rng) {
                    world.teleport(npc, place, 0.0).expect("it is there");
                }
            }
            5 if npcs.len() > 2 => {
                if let Some(npc) = pick(&mut self.rng) {
                    world.despawn(npc).expect("it is there");
                }
            }
            _ => {}
        }
    }

    // --- the network and the workers ---

    fn deliver(&mut self) {
        let (tick, rng) = (self.tick, &mut self.rng);
        for (&id, worker) in &mut self.workers {
            while let Ok(message) = worker.queue.try_recv() {
                worker.to_worker.send(tick + rng.random_range(0..8), message);
            }
            if tick < worker.cut_until {
                continue;
            }
            for message in worker.to_worker.arrived(tick) {
                if let Some(answer) = worker.hear(message, tick, rng) {
                    worker.to_server.send(tick + rng.random_range(0..8), answer);
                }
            }
            for (world, answer) in worker.to_server.arrived(tick) {
                if let Some(world) = self.worlds.get_mut(&world) {
                    world.answer(id, answer);
                }
            }
        }
    }

    // --- what must hold ---

    fn check(&mut self) {
        for (&id, world) in &self.worlds {
            let seen = self.seen_events.entry(id).or_default();
            // At most some events a tick: none is forgotten before it is read.
            for event in world.events().after(*seen, usize::MAX).expect("all are kept") {
                *seen = event.sequence;
                let story = self.stories.entry(event.npc).or_default();
                match event.kind {
                    EventKind::AttemptBegan { attempt, .. } => {
                        assert_eq!(story.open, None, "{}: an attempt began before the last one ended", event.npc);
                        assert_eq!(attempt, story.latest + 1, "{}: attempts are counted", event.npc);
                        (story.open, story.latest) = (Some(attempt), attempt);
                    }
                    EventKind::AttemptEnded { attempt, .. } => {
                        assert_eq!(story.open.take(), Some(attempt), "{}: an attempt ended twice", event.npc);
                    }
                    EventKind::Removed => {
                        assert_eq!(story.open, None, "{}: removed before its attempt ended", event.npc);
                        self.orphaned_since.remove(&event.npc);
                    }
                    _ => {}
                }
            }
            for npc in world.npcs() {
                let story = &self.stories[&npc.id];
                assert_eq!(npc.goal.is_some(), story.open.is_some(), "{}: events and state agree", npc.id);
                assert_eq!(npc.attempts_begun, story.latest);
                if let Some(waypoint) = npc.waypoint {
                    assert_eq!(waypoint.x, mark_of(npc.attempts_begun), "{}: another attempt's waypoint", npc.id);
                }
            }
        }
        let has_room = self.registry.load().iter().any(|worker| worker.npc_count < worker.capacity);
        for npc in self.worlds.values().flat_map(HostedWorld::npcs) {
            let is_orphaned = npc.worker.is_none_or(|worker| !self.workers.contains_key(&worker));
            if !is_orphaned || !has_room {
                self.orphaned_since.remove(&npc.id);
                continue;
            }
            let since = *self.orphaned_since.entry(npc.id).or_insert(self.tick);
            assert!(self.tick - since <= MAX_ORPHANED, "{}: no worker for two seconds", npc.id);
        }
    }

    /// In the end every worker that is left carries what the server thinks, and all places come back.
    fn check_end(mut self) {
        let mut of_server: BTreeMap<WorkerId, BTreeSet<NpcId>> = BTreeMap::new();
        for npc in self.worlds.values().flat_map(HostedWorld::npcs) {
            of_server.entry(npc.worker.expect("there is room for all")).or_default().insert(npc.id);
        }
        for (id, worker) in &self.workers {
            let own: BTreeSet<NpcId> = worker.npcs.values().flatten().copied().collect();
            assert_eq!(own, of_server.remove(id).unwrap_or_default(), "worker {}", id.0);
            let counted = self.registry.load().into_iter().find(|load| load.id == *id).expect("it is connected");
            assert_eq!(counted.npc_count as usize, own.len(), "worker {}: places are counted", id.0);
        }
        assert!(of_server.is_empty(), "NPCs of workers that are gone: {of_server:?}");
        let open = self.stories.values().filter(|story| story.open.is_some()).count();
        assert_eq!(open, 0, "every attempt ends");
        self.worlds.values_mut().for_each(HostedWorld::release_all);
        assert!(self.registry.load().iter().all(|worker| worker.npc_count == 0), "every place comes back");
    }

    fn run(mut self) {
        while self.tick < STORM {
            self.play();
            self.strike();
            self.step();
        }
        // A worker with room for all, and no more faults: everything must end well.
        for worker in self.workers.values_mut() {
            (worker.silent_until, worker.cut_until) = (0, 0);
        }
        self.join_with(2 * MAX_NPCS as u32);
        let end = self.tick + CALM;
        while self.tick < end {
            self.step();
        }
        // Those that seek on for lack of patience are stopped; the messages about it arrive.
        let npcs: Vec<NpcId> = self.worlds.values().flat_map(HostedWorld::npcs).map(|npc| npc.id).collect();
        for npc in npcs {
            let place = self.place();
            self.worlds.get_mut(&npc.world()).expect("its world").teleport(npc, place, 0.0).expect("it is there");
        }
        let end = self.tick + 40;
        while self.tick < end {
            self.step();
        }
        self.check_end();
    }

    fn step(&mut self) {
        self.tick += 1;
        self.deliver();
        for world in self.worlds.values_mut() {
            world.step();
        }
        self.check();
    }
}

/// A waypoint's x for an attempt: tells to which attempt it belongs.
fn mark_of(attempt: u32) -> f32 {
    1.0 + (attempt % 48) as f32
}

impl Worker {
    fn hear(&mut self, message: ToWorker, tick: u64, rng: &mut ChaCha8Rng) -> Option<(WorldId, Answer)> {
        match message {
            ToWorker::Assignment(assignment) => self.npcs.entry(assignment.world).or_default().extend(assignment.npcs),
            ToWorker::Release(world, npcs) => {
                let own = self.npcs.entry(world).or_default();
                npcs.iter().for_each(|npc| assert!(own.remove(npc), "released without an assignment"));
            }
            ToWorker::Edited(..) | ToWorker::ZonesChanged { .. } => {}
            ToWorker::Over(world) => assert!(self.npcs.remove(&world).is_none_or(|npcs| npcs.is_empty())),
            ToWorker::Observations(batch) => {
                let own = &self.npcs[&batch.world];
                assert!(batch.npcs.iter().all(|npc| own.contains(npc)), "observations of others' NPCs");
                if tick < self.silent_until {
                    return None;
                }
                let mut answer = Answer { tick: batch.tick, ..Answer::default() };
                for (&npc, &attempt) in batch.npcs.iter().zip(&batch.attempts) {
                    let action = Action { forward: 1.0, turn: rng.random_range(-1.0..1.0), ..Action::default() };
                    answer.decisions.push(Decision { npc, attempt, action: Some(action), standing: None });
                    match rng.random_range(0..20) {
                        0 => answer.waypoints.push((
                            npc,
                            attempt,
                            (Vec3::new(mark_of(attempt), 1.0, 10.0), Arrival::Pass),
                        )),
                        1 => answer.gave_up.push((npc, attempt, End::NoProgress)),
                        _ => {}
                    }
                }
                return Some((batch.world, answer));
            }
            ToWorker::Welcome(_) | ToWorker::Ended(..) | ToWorker::Goodbye(_) => {}
        }
        None
    }
}

#[test]
fn whatever_the_network_and_the_processes_do_attempts_end_once_and_npcs_find_workers() {
    let map = floor();
    let seeds: Vec<u64> = match std::env::var("SUREFOOT_SEED") {
        Ok(seed) => vec![seed.parse().expect("a number")],
        Err(_) => (0..SEEDS).collect(),
    };
    let thread_count = std::thread::available_parallelism().map_or(1, usize::from);
    std::thread::scope(|scope| {
        for share in seeds.chunks(seeds.len().div_ceil(thread_count)) {
            let map = &map;
            scope.spawn(move || {
                for &seed in share {
                    let run = || Simulation::new(seed, map.clone()).run();
                    let result = std::panic::catch_unwind(std::panic::AssertUnwindSafe(run));
                    assert!(result.is_ok(), "seed {seed} fails: run it alone with SUREFOOT_SEED={seed}");
                }
            });
        }
    });
}
