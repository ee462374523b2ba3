//! Environments of a server, with the meaning of those of this process. Knows nothing of Python.
//!
//! With [`Autoreset::SameStep`] the server draws starts and goals. Otherwise the client draws them in the same way and
//! sends them as routes. If the connection to the server is lost, the client connects again, creates new environments,
//! and ends the running episodes as [`LOST`].

use crate::draws::Draws;
use crate::environments::{Autoreset, EnvError, Environments, Finished, Outputs, Seeds, Setup, check_actions};
use crate::threads::core_count;
use std::time::{Duration, Instant};
use surefoot_game_client::{Game, GameEnv, GameError, Level};
use surefoot_net::client::Credentials;
use surefoot_rollout::Goal;
use surefoot_rollout::env::{Route, actions_of};
use surefoot_world::character::ACTION_LEN;
use surefoot_world::{End, Vec3};

/// End of an episode whose server was lost.
pub const LOST: &str = "lost";
/// Pause between attempts to reach a lost server.
const PAUSE: Duration = Duration::from_millis(200);

/// A server, and the data to connect again.
#[derive(Debug, Clone)]
pub struct ServerLink {
    pub uri: String,
    pub credentials: Credentials,
    /// Longest time to try to reach a lost server.
    pub patience: Duration,
    pub game: Game,
}

/// Environments on a server.
#[derive(Debug)]
pub struct RemoteWorlds {
    server: ServerLink,
    setup: Setup,
    worlds: Vec<RemoteWorld>,
    /// Draws starts and goals, unless the server does.
    draws: Option<Draws>,
    /// Seed of the episodes that the server draws.
    seed: u64,
    /// Number of resets without a seed.
    resets: u64,
}

/// One world.
#[derive(Debug)]
struct RemoteWorld {
    level: Level,
    count: usize,
    /// Number of its first environment.
    first: usize,
    seed: u64,
    /// `None` after the server was lost.
    env: Option<GameEnv>,
    rests: Vec<bool>,
    goals: Vec<Vec3>,
    /// Whether the next step only returns the first observations of new environments.
    is_fresh: bool,
    renewed: Vec<usize>,
}

impl RemoteWorld {
    /// Creates the environment on the server with the next episodes.
    fn open(&mut self, game: &Game, band: (f32, f32), draws: Option<&mut Draws>) -> Result<(), GameError> {
        self.env = None;
        if self.level.map.spec().is_none() {
            game.keep(&self.level.map)?;
        }
        let goals: Option<Vec<Goal>> =
            draws.map(|draws| (0..self.count).map(|npc_idx| draws.goal(self.first + npc_idx)).collect());
        self.env = Some(match &goals {
            Some(goals) => game.open(&self.level, goals)?,
            None => game.open_endless(&self.level, self.count, band, self.seed)?,
        });
        self.goals = goals.unwrap_or_default().iter().map(|goal| goal.goal).collect();
        self.rests = vec![false; self.count];
        Ok(())
    }

    /// Sends a step; with [`Autoreset::NextStep`], environments whose episode has ended start the next one.
    fn send(&mut self, actions: &[f32], autoreset: Autoreset, draws: Option<&mut Draws>) -> Result<(), GameError> {
        self.renewed.clear();
        let Some(env) = self.env.as_mut().filter(|_| !self.is_fresh) else { return Ok(()) };
        let mut routes = Vec::new();
        if let (Autoreset::NextStep, Some(draws)) = (autoreset, draws) {
            self.renewed.extend((0..self.count).filter(|npc_idx| self.rests[*npc_idx]));
            for &npc_idx in &self.renewed {
                let Goal { start, yaw, goal } = draws.goal(self.first + npc_idx);
                self.goals[npc_idx] = goal;
                routes.push(Route { npc_idx, start: Some((start, yaw)), waypoints: vec![goal] });
            }
        }
        env.send(&actions_of(actions, |_| 0).expect("checked actions"), &routes)
    }

    /// Waits for the results of a step.
    fn receive(&mut self, out: &mut Outputs<'_>, is_endless: bool) -> Result<Vec<Finished>, GameError> {
        out.rewards.fill(0.0);
        out.terminated.fill(false);
        out.truncated.fill(false);
        let Some(env) = &mut self.env else { return Ok(Vec::new()) };
        if std::mem::take(&mut self.is_fresh) {
            out.observations.copy_from_slice(&env.state().observations);
            self.rests.fill(false);
            return Ok(Vec::new());
        }
        let state = env.receive()?;
        out.observations.copy_from_slice(&state.observations);
        out.rewards.copy_from_slice(&state.rewards);
        self.renewed.drain(..).for_each(|npc_idx| self.rests[npc_idx] = false);
        let mut finished = Vec::new();
        for (npc_idx, last) in &state.finals {
            let end = state.ended[*npc_idx].unwrap_or(End::NoProgress);
            let flag = if end.is_truncation() { &mut *out.truncated } else { &mut *out.terminated };
            flag[*npc_idx] = true;
            self.rests[*npc_idx] = !is_endless;
            finished.push(Finished { env: self.first + npc_idx, outcome: end.name(), last: last.clone() });
        }
        Ok(finished)
    }
}

impl RemoteWorlds {
    /// Opens the worlds on a server.
    ///
    /// # Errors
    /// If the server refuses, or a level has nowhere to stand.
    pub fn open(server: ServerLink, setup: Setup, seed: u64) -> Result<Self, EnvError> {
        let mut far = Self { server, setup, worlds: Vec::new(), draws: None, seed, resets: 0 };
        far.reseed(Seeds::Worlds(seed))?;
        Ok(far)
    }

    /// Waits until a lost server is back, and opens a world on it.
    fn recover(&mut self, idx: usize, goes_on: &dyn Fn() -> bool) -> Result<(), EnvError> {
        let started = Instant::now();
        self.resets += 1;
        let seed = other_seed(self.seed, self.resets);
        loop {
            let world = &mut self.worlds[idx];
            world.seed = seed.wrapping_add(idx as u64);
            let error = match Game::connect(&self.server.uri, &self.server.credentials) {
                Ok(game) => {
                    self.server.game = game;
                    match world.open(&self.server.game, self.setup.band, self.draws.as_mut()) {
                        Ok(()) => return Ok(()),
                        Err(error) => error,
                    }
                }
                Err(error) => error,
            };
            let is_final = !matches!(error, GameError::Unreachable { .. } | GameError::Gone { .. });
            if is_final || started.elapsed() >= self.server.patience {
                return Err(error.into());
            }
            if !goes_on() {
                return Err(EnvError::Interrupted);
            }
            std::thread::sleep(PAUSE);
        }
    }

    /// Ends the episodes of a world that was lost and opened again.
    fn lose(&mut self, idx: usize, out: &mut Outputs<'_>) -> Vec<Finished> {
        let (len, autoreset) = (self.setup.observation_len(), self.setup.autoreset);
        let world = &mut self.worlds[idx];
        out.rewards.fill(0.0);
        out.terminated.fill(false);
        out.truncated.fill(true);
        let last = |row: usize| out.observations[row * len..][..len].to_vec();
        let end = |row: usize| Finished { env: world.first + row, outcome: LOST, last: last(row) };
        let finished = (0..world.count).map(end).collect();
        match autoreset {
            Autoreset::SameStep => {
                let env = world.env.as_ref().expect("a world that was opened again");
                out.observations.copy_from_slice(&env.state().observations);
            }
            Autoreset::NextStep => world.is_fresh = true,
            Autoreset::Disabled => world.rests.fill(true),
        }
        finished
    }
}

impl Environments for RemoteWorlds {
    fn reseed(&mut self, seeds: Seeds) -> Result<(), EnvError> {
        self.draws = match (self.setup.autoreset, &seeds) {
            (Autoreset::SameStep, Seeds::Worlds(_)) => None,
            (Autoreset::SameStep, Seeds::Envs(_)) => {
                let text = "a server draws the episodes of SAME_STEP with one seed: give one, or use NEXT_STEP";
                return Err(EnvError::Argument(text.to_owned()));
            }
            (Autoreset::NextStep | Autoreset::Disabled, seeds) => Some(Draws::on(&self.setup, seeds, core_count())?),
        };
        if let Seeds::Worlds(seed) = seeds {
            self.seed = seed;
        }
        self.resets = 0;
        self.worlds.clear();
        let mut first = 0;
        for (idx, count) in self.setup.counts().into_iter().enumerate() {
            let (map, body) = (self.setup.level(idx).clone(), self.setup.body.clone());
            self.worlds.push(RemoteWorld {
                level: Level { map, body, solid_npcs: self.setup.solid },
                count,
                first,
                seed: self.seed.wrapping_add(idx as u64),
                env: None,
                rests: Vec::new(),
                goals: Vec::new(),
                is_fresh: false,
                renewed: Vec::new(),
            });
            first += count;
        }
        let mut open = |world: &mut RemoteWorld| world.open(&self.server.game, self.setup.band, self.draws.as_mut());
        self.worlds.iter_mut().try_for_each(&mut open).map_err(EnvError::from)
    }

    fn renew(&mut self, mask: &[bool], rows: &mut [f32]) -> Result<(), EnvError> {
        if !mask.iter().all(|reset| *reset) {
            let text = "a server resets all environments or none: leave the reset_mask out";
            return Err(EnvError::Argument(text.to_owned()));
        }
        self.resets += 1;
        let seed = other_seed(self.seed, self.resets);
        for (idx, world) in self.worlds.iter_mut().enumerate() {
            // If the server draws the episodes, the new environment needs another seed.
            world.seed = seed.wrapping_add(idx as u64);
            world.is_fresh = false;
            world.open(&self.server.game, self.setup.band, self.draws.as_mut())?;
        }
        self.observations(rows);
        Ok(())
    }

    fn observations(&self, observations: &mut [f32]) {
        let len = self.setup.observation_len();
        for RemoteWorld { first, env, .. } in &self.worlds {
            let Some(env) = env else { continue };
            let rows = &env.state().observations;
            observations[first * len..][..rows.len()].copy_from_slice(rows);
        }
    }

    fn step(
        &mut self,
        actions: &[f32],
        out: Outputs<'_>,
        goes_on: &dyn Fn() -> bool,
    ) -> Result<Vec<Finished>, EnvError> {
        check_actions(actions)?;
        let autoreset = self.setup.autoreset;
        for world in &mut self.worlds {
            let own = &actions[world.first * ACTION_LEN..][..world.count * ACTION_LEN];
            if world.send(own, autoreset, self.draws.as_mut()).is_err() {
                // `recover` reports the cause.
                world.env = None;
            }
        }
        let (len, mut finished, mut rest) = (self.setup.observation_len(), Vec::new(), out);
        for idx in 0..self.worlds.len() {
            let world = &mut self.worlds[idx];
            let (mut own, more) = rest.split(world.count, len);
            match world.receive(&mut own, autoreset == Autoreset::SameStep) {
                Ok(ends) => finished.extend(ends),
                Err(_) => world.env = None,
            }
            if world.env.is_none() {
                self.recover(idx, goes_on)?;
                finished.extend(self.lose(idx, &mut own));
            }
            rest = more;
        }
        Ok(finished)
    }

    fn positions(&self) -> Vec<Vec3> {
        let envs = self.worlds.iter().flat_map(|world| &world.env);
        envs.flat_map(|env| env.state().positions.iter().copied()).collect()
    }

    fn goals(&self) -> Option<Vec<Vec3>> {
        (self.setup.autoreset != Autoreset::SameStep)
            .then(|| self.worlds.iter().flat_map(|world| world.goals.iter().copied()).collect())
    }

    fn redirect(&mut self, _route: &Route, _row: &mut [f32]) -> Result<(), EnvError> {
        Err(EnvError::Argument("redirect needs environments of this process: leave the server out".to_owned()))
    }
}

/// The seed of later episodes of environments that were created with `seed`.
fn other_seed(seed: u64, resets: u64) -> u64 {
    seed.wrapping_add(resets.wrapping_mul(0x9E37_79B9_7F4A_7C15))
}
