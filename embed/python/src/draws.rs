//! Starts and goals of environments, drawn by one generator for each world or for each environment. Knows nothing of
//! Python.

use crate::environments::{Seeds, Setup};
use crate::threads::on_threads;
use surefoot_rollout::Goal;
use surefoot_rollout::env::Draw;
use surefoot_world::navigable::NoGround;

/// The generators of environments.
#[derive(Debug)]
pub struct Draws {
    draws: Vec<Draw>,
    /// Index of the generator of each environment.
    draw_of: Vec<usize>,
}

impl Draws {
    /// The generators of environments with these seeds.
    ///
    /// # Errors
    /// If a level has nowhere to stand.
    pub fn on(setup: &Setup, seeds: &Seeds, thread_count: usize) -> Result<Self, NoGround> {
        let counts = setup.counts();
        let worlds = || counts.iter().enumerate().flat_map(|(world, count)| std::iter::repeat_n(world, *count));
        let (draw_of, jobs): (Vec<usize>, Vec<(usize, u64)>) = match seeds {
            Seeds::Worlds(seed) => {
                (worlds().collect(), (0..counts.len()).map(|world| (world, seed.wrapping_add(world as u64))).collect())
            }
            Seeds::Envs(seeds) => ((0..seeds.len()).collect(), worlds().zip(seeds.iter().copied()).collect()),
        };
        let draw = |(world, seed): (usize, u64)| Draw::on(setup.level(world), &setup.body, setup.band, seed);
        let draws = on_threads(jobs, thread_count, draw).into_iter().collect::<Result<_, _>>()?;
        Ok(Self { draws, draw_of })
    }

    /// Draws the next episode of an environment.
    pub fn goal(&mut self, env: usize) -> Goal {
        self.draws[self.draw_of[env]].goal()
    }
}
