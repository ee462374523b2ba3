//! Environments of this process, stepped on several threads. Knows nothing of Python.
//!
//! NPCs that cannot meet are stepped in parts of their world, so that one world uses several threads. The parts share
//! the generator of starts and goals, so results do not depend on them.

use crate::draws::Draws;
use crate::environments::{Autoreset, EnvError, Environments, Finished, Outputs, Seeds, Setup, check_actions};
use crate::threads::on_threads;
use surefoot_rollout::Goal;
use surefoot_rollout::env::{Ended, Env, Episodes, Route, actions_of};
use surefoot_world::Vec3;
use surefoot_world::character::ACTION_LEN;
use surefoot_world::navigable::NoGround;

/// Fewest environments of a part of a world: with fewer, starting a thread takes longer than it saves.
const PART: usize = 32;
/// Most parts of a world for each thread, which takes the next part when it is free.
const PARTS_PER_THREAD: usize = 4;

/// Opens a world with these episodes.
///
/// # Errors
/// If its level has nowhere to stand.
pub fn open_world(setup: &Setup, world: usize, episodes: Episodes) -> Result<Env, NoGround> {
    Env::new(setup.level(world).clone(), setup.body.clone(), setup.solid, episodes)
}

/// Environments of this process.
#[derive(Debug)]
pub struct LocalWorlds {
    setup: Setup,
    /// `None` if the worlds draw: NPCs that see one another begin together in the step that ended their episodes.
    draws: Option<Draws>,
    parts: Vec<Part>,
    thread_count: usize,
}

/// A world, or a part of one.
#[derive(Debug)]
struct Part {
    env: Env,
    /// Number of its first environment.
    first: usize,
}

/// The step of a part.
struct Job<'a> {
    part: &'a mut Part,
    actions: &'a [f32],
    out: Outputs<'a>,
}

impl Job<'_> {
    fn run(self) -> Vec<Finished> {
        let Self { part: Part { env, first }, actions, out } = self;
        let actions = actions_of(actions, |_| 0).expect("checked actions");
        let ended = env.step_into(&actions, out.observations);
        out.rewards.copy_from_slice(env.rewards());
        out.terminated.fill(false);
        out.truncated.fill(false);
        let finish = |Ended { npc_idx, end, final_observation }: Ended| {
            let flag = if end.is_truncation() { &mut *out.truncated } else { &mut *out.terminated };
            flag[npc_idx] = true;
            Finished { env: *first + npc_idx, outcome: end.name(), last: final_observation }
        };
        ended.into_iter().map(finish).collect()
    }
}

/// First environments and numbers of environments of the parts of each world.
fn parts_of(setup: &Setup, thread_count: usize) -> Vec<(usize, usize, usize)> {
    let (mut parts, mut first) = (Vec::new(), 0);
    for (world, count) in setup.counts().into_iter().enumerate() {
        // Movers react to all NPCs of their world.
        let is_whole = thread_count == 1 || setup.solid || !setup.level(world).movers().is_empty();
        let part_count = if is_whole { 1 } else { (count / PART).clamp(1, PARTS_PER_THREAD * thread_count) };
        for part in 0..part_count {
            let own = count / part_count + usize::from(part < count % part_count);
            parts.push((world, first, own));
            first += own;
        }
    }
    parts
}

impl LocalWorlds {
    /// Opens the worlds.
    ///
    /// # Errors
    /// If a level has nowhere to stand.
    pub fn open(setup: Setup, seeds: &Seeds, thread_count: usize) -> Result<Self, NoGround> {
        let own_seed = match seeds {
            Seeds::Worlds(seed) if setup.solid && setup.autoreset == Autoreset::SameStep => Some(*seed),
            _ => None,
        };
        let mut draws = own_seed.is_none().then(|| Draws::on(&setup, seeds, thread_count)).transpose()?;
        let goals: Vec<Goal> =
            draws.iter_mut().flat_map(|draws| (0..setup.env_count).map(|env| draws.goal(env))).collect();
        let open = |(world, first, npc_count): (usize, usize, usize)| {
            let episodes = match own_seed {
                Some(seed) => Episodes::Endless { npc_count, band: setup.band, seed: seed.wrapping_add(world as u64) },
                None => Episodes::Once(goals[first..][..npc_count].to_vec()),
            };
            Ok(Part { env: open_world(&setup, world, episodes)?, first })
        };
        let parts = on_threads(parts_of(&setup, thread_count), thread_count, open);
        Ok(Self { parts: parts.into_iter().collect::<Result<_, _>>()?, setup, draws, thread_count })
    }

    /// Starts the next episodes of these environments, ascending, and writes their first observations.
    fn begin(&mut self, envs: &[usize], rows: &mut [f32]) {
        let len = self.setup.observation_len();
        let (mut jobs, mut rest, mut envs) = (Vec::new(), rows, envs);
        for part in &mut self.parts {
            let (own, more) = std::mem::take(&mut rest).split_at_mut(part.env.npc_count() * len);
            let (mine, others) = envs.split_at(envs.partition_point(|env| *env < part.first + part.env.npc_count()));
            if !mine.is_empty() {
                let goal = |env: &usize| (*env, self.draws.as_mut().map(|draws| draws.goal(*env)));
                let goals: Vec<(usize, Option<Goal>)> = mine.iter().map(goal).collect();
                jobs.push((part, goals, own));
            }
            (rest, envs) = (more, others);
        }
        on_threads(jobs, self.thread_count, |(Part { env, first }, goals, rows)| {
            for (number, goal) in goals {
                let npc_idx = number - *first;
                let Some(Goal { start, yaw, goal }) = goal else {
                    env.renew(npc_idx, rows);
                    continue;
                };
                env.redirect(&Route { npc_idx, start: Some((start, yaw)), waypoints: vec![goal] });
                let row = npc_idx * len..(npc_idx + 1) * len;
                rows[row.clone()].copy_from_slice(&env.observations()[row]);
            }
        });
    }

    fn steps<'a>(&'a mut self, actions: &'a [f32], out: Outputs<'a>) -> Vec<Job<'a>> {
        let len = self.setup.observation_len();
        let (mut jobs, mut rest) = (Vec::with_capacity(self.parts.len()), out);
        for part in &mut self.parts {
            let count = part.env.npc_count();
            let (out, more) = rest.split(count, len);
            let actions = &actions[part.first * ACTION_LEN..][..count * ACTION_LEN];
            jobs.push(Job { part, actions, out });
            rest = more;
        }
        jobs
    }
}

impl Environments for LocalWorlds {
    fn reseed(&mut self, seeds: Seeds) -> Result<(), EnvError> {
        *self = Self::open(self.setup.clone(), &seeds, self.thread_count)?;
        Ok(())
    }

    fn observations(&self, rows: &mut [f32]) {
        let mut rest = rows;
        for Part { env, .. } in &self.parts {
            let (own, more) = rest.split_at_mut(env.observations().len());
            own.copy_from_slice(env.observations());
            rest = more;
        }
    }

    fn renew(&mut self, mask: &[bool], rows: &mut [f32]) -> Result<(), EnvError> {
        let wanted: Vec<usize> = (0..mask.len()).filter(|env| mask[*env]).collect();
        self.begin(&wanted, rows);
        Ok(())
    }

    fn step(
        &mut self,
        actions: &[f32],
        mut out: Outputs<'_>,
        _goes_on: &dyn Fn() -> bool,
    ) -> Result<Vec<Finished>, EnvError> {
        check_actions(actions)?;
        let rests = self.rests().unwrap_or_default();
        let rested: Vec<usize> = (0..rests.len()).filter(|env| rests[*env]).collect();
        let thread_count = self.thread_count;
        let finished = on_threads(self.steps(actions, out.reborrow()), thread_count, Job::run);
        let finished: Vec<Finished> = finished.into_iter().flatten().collect();
        match self.setup.autoreset {
            Autoreset::NextStep => self.begin(&rested, out.observations),
            Autoreset::SameStep if self.draws.is_some() => {
                let ended: Vec<usize> = finished.iter().map(|end| end.env).collect();
                self.begin(&ended, out.observations);
            }
            Autoreset::SameStep | Autoreset::Disabled => (),
        }
        Ok(finished)
    }

    fn positions(&self) -> Vec<Vec3> {
        self.parts.iter().flat_map(|part| part.env.positions()).collect()
    }

    fn goals(&self) -> Option<Vec<Vec3>> {
        Some(self.parts.iter().flat_map(|part| part.env.goals().iter().copied()).collect())
    }

    fn rests(&self) -> Option<Vec<bool>> {
        Some(self.parts.iter().flat_map(|part| part.env.rests().iter().copied()).collect())
    }

    fn redirect(&mut self, route: &Route, row: &mut [f32]) -> Result<(), EnvError> {
        let part = self.parts.partition_point(|part| part.first <= route.npc_idx) - 1;
        let Part { env, first } = &mut self.parts[part];
        let npc_idx = route.npc_idx - *first;
        env.redirect(&Route { npc_idx, ..route.clone() });
        let len = row.len();
        row.copy_from_slice(&env.observations()[npc_idx * len..][..len]);
        Ok(())
    }
}
