//! Feeding a learner: how decisions per second grow with the number of worlds or actors, whose cost is injected.
//!
//! A game that sleeps for a fixed time at every decision stands for a machine of its own, so that many fit on one: what
//! is measured is how well the learner keeps them busy, not how fast they are.

use super::Figure;
use super::link::Link;
use crate::processes::free_address;
use std::net::{Ipv4Addr, SocketAddr};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};
use surefoot_game::{BodyState, CharacterProfile, Command, GameWorld, Hit, Level, Vec3};
use surefoot_game_client::Game;
use surefoot_net::client::Credentials;
use surefoot_net::serving::Endpoint;
use surefoot_train::actors::Listener;
use surefoot_train::actors::actor::{ActorConfig, act};
use surefoot_train::worlds::Connect;
use surefoot_train::{self, CollectorConfig, RunArgs, TrainConfig};
use surefoot_world::TICKS_PER_DECISION;
use surefoot_world::sense::RAY_COUNT;

/// Time that a world takes for a tick of all its NPCs: 50 ms for a decision.
const TICK_COST: Duration = Duration::from_millis(5);
/// NPCs of an environment.
const NPCS: usize = 32;
/// Numbers of worlds, and of actors.
const COUNTS: [usize; 4] = [1, 2, 4, 8];
/// Progress lines between which decisions are counted, after the first.
const LINES: usize = 2;
/// Delay in each direction and rate, bit/s, of the slow link.
const FAR: (Duration, f64) = (Duration::from_millis(10), 100.0e6);
/// Environments of each world.
const ENVS: usize = 2;
/// Least share of the rate that the injected cost allows.
const TARGET: f64 = 0.8;

/// All figures of `bench feed`.
pub fn figures() -> anyhow::Result<Vec<Figure>> {
    let mut figures = Vec::new();
    for (what, envs, feed) in [("worlds", ENVS, feed_by_worlds as Feed), ("actors", 1, feed_by_actors as Feed)] {
        let most =
            |count: usize| (count * envs * NPCS) as f64 / (f64::from(TICKS_PER_DECISION) * TICK_COST.as_secs_f64());
        let figure = |name: String, rate, count| {
            Figure::new(name, rate, "1/s").with_reference("nothing but the injected cost", most(count), true)
        };
        for count in COUNTS {
            let name = format!("{what}_{count}_decisions_s");
            figures.push(figure(name, feed(count, None)?, count).at_least(TARGET * most(count)));
        }
        let far = Link::new(FAR.0, FAR.1);
        figures.push(figure(format!("{what}_8_far_decisions_s"), feed(8, Some(&far))?, 8));
    }
    Ok(figures)
}

/// Decisions per second with a number of worlds or actors, at the other end of a link if there is one.
type Feed = fn(usize, Option<&Link>) -> anyhow::Result<f64>;

/// A game in which nothing moves, and every tick takes [`TICK_COST`].
struct Sleeping(Vec<BodyState>);

struct SleepingLevel;

impl Level for SleepingLevel {
    fn open(&self, _body: &CharacterProfile, count: usize) -> Result<Box<dyn GameWorld>, String> {
        Ok(Box::new(Sleeping(vec![BodyState { is_grounded: true, ..BodyState::default() }; count])))
    }
}

impl GameWorld for Sleeping {
    fn place(&mut self, character: usize, feet: Vec3, yaw: f32) {
        (self.0[character].feet, self.0[character].yaw) = (feet, yaw);
    }

    fn tick(&mut self, _commands: &[(usize, Command)]) {
        std::thread::sleep(TICK_COST);
    }

    fn state(&self, character: usize) -> BodyState {
        self.0[character]
    }

    fn cast(&self, _origin: Vec3, _directions: &[Vec3; RAY_COUNT], _range: f32) -> [Hit; RAY_COUNT] {
        [None; RAY_COUNT]
    }
}

/// Starts games, which run until the process ends, and returns their addresses once they serve.
fn games(count: usize) -> anyhow::Result<Vec<SocketAddr>> {
    let mut addresses = Vec::new();
    for _ in 0..count {
        let address = free_address()?;
        std::thread::spawn(move || surefoot_game::serve_blocking(SleepingLevel, address, 64));
        let since = Instant::now();
        while std::net::TcpStream::connect(address).is_err() {
            anyhow::ensure!(since.elapsed() < Duration::from_secs(10), "no game at {address}");
        }
        addresses.push(address);
    }
    Ok(addresses)
}

/// A run with as few updates as possible.
fn config() -> TrainConfig {
    TrainConfig {
        total_updates: u64::MAX,
        steps_per_round: 1,
        updates_per_round: 1,
        batch: 64,
        replay_capacity: 100_000,
        validate_every: u64::MAX,
        checkpoint_every: u64::MAX,
        validation_goals: 1,
        validation_seeds: vec![1000],
        stop_after: None,
        collector: CollectorConfig {
            map_seeds: vec![0],
            map_side: 60,
            world_count: 1,
            npcs_per_world: NPCS,
            random_decisions: 0,
            ..CollectorConfig::default()
        },
        ..TrainConfig::default()
    }
}

fn connect() -> Connect {
    Arc::new(|uri| Game::connect(uri, &Credentials::default()))
}

/// The address as seen from the other end of a link.
fn over(link: Option<&Link>, address: SocketAddr) -> std::io::Result<String> {
    let seen = link.map_or(Ok(address), |link| link.relay(address))?;
    Ok(format!("http://{seen}"))
}

fn feed_by_worlds(count: usize, link: Option<&Link>) -> anyhow::Result<f64> {
    let worlds = games(count)?.into_iter().map(|address| over(link, address)).collect::<Result<_, _>>()?;
    let config = TrainConfig { worlds, envs_per_world: ENVS, ..config() };
    rate_of(config, None, &AtomicBool::new(false))
}

fn feed_by_actors(count: usize, link: Option<&Link>) -> anyhow::Result<f64> {
    let runtime = tokio::runtime::Builder::new_multi_thread().worker_threads(1).enable_all().build()?;
    let endpoint = {
        let _inside = runtime.enter();
        Endpoint::bind((Ipv4Addr::LOCALHOST, 0).into())?
    };
    let learner = over(link, endpoint.address())?;
    let stop = Arc::new(AtomicBool::new(false));
    for (idx, world) in games(count)?.into_iter().enumerate() {
        let (stop, learner) = (stop.clone(), learner.clone());
        let config = ActorConfig {
            learner,
            credentials: Credentials::default(),
            actor_id: idx.to_string(),
            seed: idx as u64,
            levels: Vec::new(),
            world: Some(over(None, world)?),
            connect: connect(),
        };
        std::thread::spawn(move || act(config, &stop, |_| {}));
    }
    let listener = Listener { endpoint, runtime, weights_every: Duration::from_secs(2) };
    rate_of(TrainConfig { actors: count, ..config() }, Some(listener), &stop)
}

/// Decisions per second of a run after its start.
fn rate_of(config: TrainConfig, listener: Option<Listener>, stop: &AtomicBool) -> anyhow::Result<f64> {
    let folder = tempfile::tempdir()?;
    let run = folder.path().join("run");
    let run_args = RunArgs { connect: connect(), listener, ..RunArgs::here(&run, false) };
    let lines: Mutex<Vec<(Instant, u64)>> = Mutex::default();
    surefoot_train::run(config, run_args, stop, |line| {
        let Some(decisions) = line.split_whitespace().nth(3).filter(|_| line.starts_with("updates ")) else { return };
        let mut lines = lines.lock().expect("no holder panics");
        lines.push((Instant::now(), decisions.parse().unwrap_or(0)));
        stop.store(lines.len() > LINES, Ordering::Relaxed);
    })?;
    let lines = lines.into_inner().expect("no holder panics");
    let ((began, before), (ended, after)) = (lines[0], lines[lines.len() - 1]);
    Ok((after - before) as f64 / (ended - began).as_secs_f64())
}
