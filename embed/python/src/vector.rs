//! Environments in several worlds, stepped together on several threads. Knows nothing of Python.

use std::sync::Arc;
use surefoot_rollout::env::{Ended, Env, Episodes, Renewal, Route, actions_of};
use surefoot_world::character::ACTION_LEN;
use surefoot_world::navigable::NoGround;
use surefoot_world::{CharacterProfile, Map, Vec3};

/// What happens to an environment after its episode has ended, in Gymnasium's words.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Autoreset {
    /// The step after it is reset, whatever its action is.
    NextStep,
    /// It is reset at once.
    SameStep,
    /// It rests until it is reset.
    Disabled,
}

/// What the worlds are made of.
#[derive(Debug, Clone)]
pub struct Setup {
    /// The worlds are on these in turn.
    pub levels: Vec<Arc<Map>>,
    pub body: CharacterProfile,
    pub solid: bool,
    /// Distance of goals from starts, m.
    pub band: (f32, f32),
    pub env_count: usize,
    pub world_count: usize,
    pub autoreset: Autoreset,
}

impl Setup {
    /// Number of environments in each world, which differ by one at most.
    pub fn counts(&self) -> Vec<usize> {
        let (each, more) = (self.env_count / self.world_count, self.env_count % self.world_count);
        (0..self.world_count).map(|world| each + usize::from(world < more)).collect()
    }

    /// Opens a world.
    ///
    /// # Errors
    /// If its level has nowhere to stand.
    pub fn open(&self, world: usize, npc_count: usize, seed: u64) -> Result<Env, NoGround> {
        let map = self.levels[world % self.levels.len()].clone();
        let episodes = Episodes::Endless { npc_count, band: self.band, seed: seed.wrapping_add(world as u64) };
        let renewal = if self.autoreset == Autoreset::SameStep { Renewal::AtOnce } else { Renewal::OnCall };
        Ok(Env::new(map, self.body.clone(), self.solid, episodes)?.renewed(renewal))
    }
}

/// What a step writes: for each environment an observation, a reward, and whether its episode ended.
#[derive(Debug)]
pub struct Outputs<'a> {
    pub observations: &'a mut [f32],
    pub rewards: &'a mut [f32],
    pub terminated: &'a mut [bool],
    pub truncated: &'a mut [bool],
}

impl<'a> Outputs<'a> {
    /// Splits off what the first `count` environments write.
    pub fn split(self, count: usize, observation_len: usize) -> (Self, Self) {
        let (observations, more_observations) = self.observations.split_at_mut(count * observation_len);
        let (rewards, more_rewards) = self.rewards.split_at_mut(count);
        let (terminated, more_terminated) = self.terminated.split_at_mut(count);
        let (truncated, more_truncated) = self.truncated.split_at_mut(count);
        let more = Self {
            observations: more_observations,
            rewards: more_rewards,
            terminated: more_terminated,
            truncated: more_truncated,
        };
        (Self { observations, rewards, terminated, truncated }, more)
    }
}

/// An episode that ended.
#[derive(Debug)]
pub struct Finished {
    /// Number of the environment.
    pub env: usize,
    pub outcome: &'static str,
    /// Last observation.
    pub last: Vec<f32>,
}

/// Environments in worlds.
#[derive(Debug)]
pub struct Worlds {
    setup: Setup,
    envs: Vec<Env>,
    thread_count: usize,
}

/// What a thread does for one world in one step.
struct Job<'a> {
    env: &'a mut Env,
    first: usize,
    actions: &'a [f32],
    out: Outputs<'a>,
}

impl Job<'_> {
    fn run(self, autoreset: Autoreset) -> Vec<Finished> {
        let Self { env, first, actions, out } = self;
        let actions = actions_of(actions, |_| 0).expect("checked actions");
        let renewed: Vec<usize> = match autoreset {
            Autoreset::NextStep => (0..env.npc_count()).filter(|npc_idx| env.rests()[*npc_idx]).collect(),
            Autoreset::SameStep | Autoreset::Disabled => Vec::new(),
        };
        let ended = env.step_into(&actions, out.observations);
        out.rewards.copy_from_slice(env.rewards());
        out.terminated.fill(false);
        out.truncated.fill(false);
        let finish = |Ended { npc_idx, end, final_observation }: Ended| {
            let flag = if end.is_truncation() { &mut *out.truncated } else { &mut *out.terminated };
            flag[npc_idx] = true;
            Finished { env: first + npc_idx, outcome: end.name(), last: final_observation }
        };
        let finished = ended.into_iter().map(finish).collect();
        renewed.into_iter().for_each(|npc_idx| env.renew(npc_idx, out.observations));
        finished
    }
}

impl Worlds {
    /// Opens the worlds, the first with `seed`, each other one with the next.
    ///
    /// # Errors
    /// If a level has nowhere to stand.
    pub fn open(setup: Setup, seed: u64, thread_count: usize) -> Result<Self, NoGround> {
        let jobs: Vec<_> = setup.counts().into_iter().enumerate().collect();
        let open = |(world, count): (usize, usize)| setup.open(world, count, seed);
        let envs = on_threads(jobs, thread_count, open).into_iter().collect::<Result<_, _>>()?;
        Ok(Self { envs, setup, thread_count })
    }

    /// Opens them anew with another seed.
    ///
    /// # Errors
    /// As [`open`](Self::open).
    pub fn reseed(&mut self, seed: u64) -> Result<(), NoGround> {
        *self = Self::open(self.setup.clone(), seed, self.thread_count)?;
        Ok(())
    }

    pub fn observation_len(&self) -> usize {
        self.envs[0].observation_len()
    }

    /// Writes all observations as they were when the worlds were opened.
    pub fn first_observations(&self, observations: &mut [f32]) {
        let mut rest = observations;
        for env in &self.envs {
            let (rows, more) = rest.split_at_mut(env.observations().len());
            rows.copy_from_slice(env.observations());
            rest = more;
        }
    }

    /// Starts the next episodes of the environments that `mask` names, and writes their first observations.
    pub fn renew(&mut self, mask: &[bool], observations: &mut [f32]) {
        let len = self.observation_len();
        let (mut rest, mut masks) = (observations, mask);
        for env in &mut self.envs {
            let (rows, more) = rest.split_at_mut(env.npc_count() * len);
            let (mask, next) = masks.split_at(env.npc_count());
            let wanted = mask.iter().enumerate().filter(|(_, wanted)| **wanted);
            wanted.for_each(|(npc_idx, _)| env.renew(npc_idx, rows));
            (rest, masks) = (more, next);
        }
    }

    /// Runs one decision of every environment, and returns the episodes that ended.
    ///
    /// # Errors
    /// The first action with a value that is not finite; then nothing has moved.
    pub fn step(&mut self, actions: &[f32], out: Outputs<'_>) -> Result<Vec<Finished>, String> {
        check_actions(actions)?;
        let len = self.observation_len();
        let (mut jobs, mut first) = (Vec::with_capacity(self.envs.len()), 0);
        let (mut rest, mut actions) = (out, actions);
        for env in &mut self.envs {
            let count = env.npc_count();
            let (out, more) = rest.split(count, len);
            let (own, more_actions) = actions.split_at(count * ACTION_LEN);
            jobs.push(Job { env, first, actions: own, out });
            (rest, actions, first) = (more, more_actions, first + count);
        }
        let autoreset = self.setup.autoreset;
        Ok(on_threads(jobs, self.thread_count, |job| job.run(autoreset)).into_iter().flatten().collect())
    }

    /// Gives an environment a route instead of its goal.
    pub fn redirect(&mut self, route: &Route, row: &mut [f32]) {
        let (mut npc_idx, mut world) = (route.npc_idx, 0);
        while npc_idx >= self.envs[world].npc_count() {
            npc_idx -= self.envs[world].npc_count();
            world += 1;
        }
        let env = &mut self.envs[world];
        env.redirect(&Route { npc_idx, ..route.clone() });
        let len = row.len();
        row.copy_from_slice(&env.observations()[npc_idx * len..][..len]);
    }

    /// Feet of the bodies, m.
    pub fn positions(&self) -> impl Iterator<Item = Vec3> {
        self.envs.iter().flat_map(Env::positions)
    }

    /// Places where the episodes end, m.
    pub fn goals(&self) -> impl Iterator<Item = Vec3> {
        self.envs.iter().flat_map(|env| env.goals().iter().copied())
    }

    /// Whether each environment rests.
    pub fn rests(&self) -> impl Iterator<Item = bool> {
        self.envs.iter().flat_map(|env| env.rests().iter().copied())
    }
}

/// Refuses values that are not finite.
pub fn check_actions(values: &[f32]) -> Result<(), String> {
    let rows = values.as_chunks::<ACTION_LEN>().0.iter();
    match rows.flatten().position(|value| !value.is_finite()) {
        None => Ok(()),
        Some(idx) => Err(format!(
            "actions[{}, {}] is {}, but must be a finite number (values outside -1 to 1 are clamped)",
            idx / ACTION_LEN,
            idx % ACTION_LEN,
            values[idx]
        )),
    }
}

/// Runs jobs on up to `thread_count` threads, and returns their results in order.
fn on_threads<J: Send, T: Send>(jobs: Vec<J>, thread_count: usize, run: impl Fn(J) -> T + Sync) -> Vec<T> {
    if thread_count <= 1 || jobs.len() <= 1 {
        return jobs.into_iter().map(run).collect();
    }
    let per_thread = jobs.len().div_ceil(thread_count);
    let mut jobs = jobs.into_iter();
    let parts: Vec<Vec<J>> =
        std::iter::from_fn(|| Some(jobs.by_ref().take(per_thread).collect::<Vec<_>>()).filter(|it| !it.is_empty()))
            .collect();
    let run = &run;
    std::thread::scope(|scope| {
        let spawn = |part: Vec<J>| scope.spawn(move || part.into_iter().map(run).collect::<Vec<T>>());
        let handles: Vec<_> = parts.into_iter().map(spawn).collect();
        handles.into_iter().flat_map(|handle| handle.join().expect("a step does not panic")).collect()
    })
}
