//! Environments of this process, stepped on several threads. Knows nothing of Python.

use crate::environments::{Autoreset, EnvError, Environments, Finished, Outputs, Setup, check_actions};
use surefoot_rollout::env::{Ended, Env, Episodes, Renewal, Route, actions_of};
use surefoot_world::Vec3;
use surefoot_world::character::ACTION_LEN;
use surefoot_world::navigable::NoGround;

/// Opens a world of `npc_count` environments.
///
/// # Errors
/// If its level has nowhere to stand.
pub fn open_world(setup: &Setup, world: usize, npc_count: usize, seed: u64) -> Result<Env, NoGround> {
    let map = setup.levels[world % setup.levels.len()].clone();
    let episodes = Episodes::Endless { npc_count, band: setup.band, seed: seed.wrapping_add(world as u64) };
    let renewal = if setup.autoreset == Autoreset::SameStep { Renewal::AtOnce } else { Renewal::OnCall };
    Ok(Env::new(map, setup.body.clone(), setup.solid, episodes)?.renewed(renewal))
}

/// Environments of this process.
#[derive(Debug)]
pub struct LocalWorlds {
    setup: Setup,
    envs: Vec<Env>,
    thread_count: usize,
}

/// The step of one world.
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

impl LocalWorlds {
    /// Opens the worlds with the seeds `seed`, `seed + 1` and so on.
    ///
    /// # Errors
    /// If a level has nowhere to stand.
    pub fn open(setup: Setup, seed: u64, thread_count: usize) -> Result<Self, NoGround> {
        let jobs: Vec<_> = setup.counts().into_iter().enumerate().collect();
        let open = |(world, count): (usize, usize)| open_world(&setup, world, count, seed);
        let envs = on_threads(jobs, thread_count, open).into_iter().collect::<Result<_, _>>()?;
        Ok(Self { envs, setup, thread_count })
    }
}

impl Environments for LocalWorlds {
    fn reseed(&mut self, seed: u64) -> Result<(), EnvError> {
        *self = Self::open(self.setup.clone(), seed, self.thread_count)?;
        Ok(())
    }

    fn observations(&self, rows: &mut [f32]) {
        let mut rest = rows;
        for env in &self.envs {
            let (own, more) = rest.split_at_mut(env.observations().len());
            own.copy_from_slice(env.observations());
            rest = more;
        }
    }

    fn renew(&mut self, mask: &[bool], rows: &mut [f32]) -> Result<(), EnvError> {
        let len = self.setup.observation_len();
        let (mut rest, mut masks) = (rows, mask);
        for env in &mut self.envs {
            let (own, more) = rest.split_at_mut(env.npc_count() * len);
            let (mask, next) = masks.split_at(env.npc_count());
            let wanted = mask.iter().enumerate().filter(|(_, wanted)| **wanted);
            wanted.for_each(|(npc_idx, _)| env.renew(npc_idx, own));
            (rest, masks) = (more, next);
        }
        Ok(())
    }

    fn step(
        &mut self,
        actions: &[f32],
        out: Outputs<'_>,
        _goes_on: &dyn Fn() -> bool,
    ) -> Result<Vec<Finished>, EnvError> {
        check_actions(actions)?;
        let len = self.setup.observation_len();
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

    fn positions(&self) -> Vec<Vec3> {
        self.envs.iter().flat_map(Env::positions).collect()
    }

    fn goals(&self) -> Option<Vec<Vec3>> {
        Some(self.envs.iter().flat_map(|env| env.goals().iter().copied()).collect())
    }

    fn rests(&self) -> Option<Vec<bool>> {
        Some(self.envs.iter().flat_map(|env| env.rests().iter().copied()).collect())
    }

    fn redirect(&mut self, route: &Route, row: &mut [f32]) -> Result<(), EnvError> {
        let (mut npc_idx, mut world) = (route.npc_idx, 0);
        while npc_idx >= self.envs[world].npc_count() {
            npc_idx -= self.envs[world].npc_count();
            world += 1;
        }
        let env = &mut self.envs[world];
        env.redirect(&Route { npc_idx, ..route.clone() });
        let len = row.len();
        row.copy_from_slice(&env.observations()[npc_idx * len..][..len]);
        Ok(())
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
