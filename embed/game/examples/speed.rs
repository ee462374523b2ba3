//! Measures the throughput between Surefoot and a game: decisions per second of 128 characters that do nothing. It
//! measures the games at the given addresses, and a game in this process that serves environments directly.
//!
//!   cargo run --release -p surefoot-game --example speed -- level.obj tcp://127.0.0.1:7701 unix:/run/game.sock

use anyhow::{Context, bail};
use std::net::{SocketAddr, TcpStream};
use std::sync::Arc;
use std::time::{Duration, Instant};
use surefoot_game::{
    Action, BodyState, Bridge, CharacterProfile, Command, GameWorld, Hit, Level, Vec3, is_batch_address,
};
use surefoot_game_client::{Game, Level as Geometry};
use surefoot_levels::ImportOptions;
use surefoot_net::client::Credentials;
use surefoot_rollout::Goal;
use surefoot_world::sense::RAY_COUNT;

/// Characters of the environment.
const NPCS: usize = 128;
/// How long each game is measured.
const TIME: Duration = Duration::from_secs(5);
/// Where the game in this process listens.
const OWN: ([u8; 4], u16) = ([127, 0, 0, 1], 7699);

/// Characters that stay where they are and see nothing.
struct Still(Vec<BodyState>);

impl GameWorld for Still {
    fn place(&mut self, character: usize, feet: Vec3, yaw: f32) {
        self.0[character] = BodyState { feet, yaw, is_grounded: true, can_jump: true, ..BodyState::default() };
    }

    fn tick(&mut self, _: &[(usize, Command)]) {}

    fn state(&self, character: usize) -> BodyState {
        self.0[character]
    }

    fn cast(&self, _: Vec3, _: &[Vec3; RAY_COUNT], _: f32) -> [Hit; RAY_COUNT] {
        [None; RAY_COUNT]
    }
}

struct Nowhere;

impl Level for Nowhere {
    fn open(&self, _: &CharacterProfile, count: usize) -> Result<Box<dyn GameWorld>, String> {
        Ok(Box::new(Still(vec![BodyState::default(); count])))
    }
}

fn main() -> anyhow::Result<()> {
    let mut args = std::env::args().skip(1);
    let Some(level) = args.next() else { bail!("usage: speed LEVEL.obj [ADDRESS]...") };
    let options = ImportOptions::default();
    let map = surefoot_levels::import_obj(&std::fs::read(&level)?, None, &options).context("cannot use the level")?.map;
    let geometry = Geometry { map: Arc::new(map), body: CharacterProfile::default(), solid_npcs: false };
    let own = SocketAddr::from(OWN);
    std::thread::spawn(move || surefoot_game::serve_blocking(Nowhere, own, 1));
    while TcpStream::connect(own).is_err() {
        std::thread::yield_now();
    }
    for uri in std::iter::once(format!("http://{own}")).chain(args) {
        println!("{uri}: {:.0} decisions/s", measure(&uri, &geometry)?);
    }
    Ok(())
}

fn connect(uri: &str) -> anyhow::Result<Game> {
    if !is_batch_address(uri) {
        return Ok(Game::connect(uri, &Credentials::default())?);
    }
    let bridge = Bridge::start(uri)?;
    Ok(Game::connect(bridge.uri(), &Credentials::default())?.behind(uri, bridge))
}

fn measure(uri: &str, geometry: &Geometry) -> anyhow::Result<f64> {
    let goal = Goal { start: Vec3::new(10.0, 2.0, 10.0), yaw: 0.0, goal: Vec3::new(70.0, 2.0, 70.0) };
    let actions = vec![Action::from_array([0.0; 4])?; NPCS];
    let mut env = connect(uri)?.open(geometry, &[goal; NPCS])?;
    let (started, mut steps) = (Instant::now(), 0);
    while started.elapsed() < TIME {
        env.step(&actions, &[])?;
        // A character without progress for 300 decisions rests.
        steps += 1;
        if steps % 250 == 0 {
            let wake = |npc_idx| surefoot_rollout::env::Route {
                npc_idx,
                start: Some((goal.start, 0.0)),
                waypoints: vec![goal.goal],
            };
            env.step(&actions, &(0..NPCS).map(wake).collect::<Vec<_>>())?;
        }
    }
    Ok(f64::from(steps) * NPCS as f64 / started.elapsed().as_secs_f64())
}
