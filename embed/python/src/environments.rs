//! Environments in several worlds, of this process or of a server. Knows nothing of Python.

use std::sync::Arc;
use surefoot_game_client::GameError;
use surefoot_rollout::env::Route;
use surefoot_world::character::ACTION_LEN;
use surefoot_world::navigable::NoGround;
use surefoot_world::sense::observation_len;
use surefoot_world::{CharacterProfile, Map, Vec3};

/// Seeds of starts and goals.
#[derive(Debug, Clone)]
pub enum Seeds {
    /// World k draws with this seed plus k.
    Worlds(u64),
    /// Each environment draws with its own seed, and so gets the episodes that it would get alone in a world.
    Envs(Vec<u64>),
}

/// Environments that are stepped together.
pub trait Environments: Send {
    /// Starts again with other seeds.
    ///
    /// # Errors
    /// If a level has nowhere to stand, the server refuses, or these environments cannot do it.
    fn reseed(&mut self, seeds: Seeds) -> Result<(), EnvError>;

    /// Writes the current observations.
    fn observations(&self, rows: &mut [f32]);

    /// Starts the next episodes of the environments that `mask` names, and writes their first observations.
    ///
    /// # Errors
    /// If these environments cannot do it.
    fn renew(&mut self, mask: &[bool], rows: &mut [f32]) -> Result<(), EnvError>;

    /// Runs one decision of every environment, and returns the episodes that ended. While it waits for a server, it
    /// calls `goes_on` and stops if that returns false.
    ///
    /// # Errors
    /// If an action is not finite; then nothing has moved. If a lost server does not return in time; the next step
    /// tries again.
    fn step(
        &mut self,
        actions: &[f32],
        out: Outputs<'_>,
        goes_on: &dyn Fn() -> bool,
    ) -> Result<Vec<Finished>, EnvError>;

    /// Feet of the bodies, m.
    fn positions(&self) -> Vec<Vec3>;

    /// Places where the episodes end, m; `None` if a server drew them.
    fn goals(&self) -> Option<Vec<Vec3>>;

    /// Whether each environment waits for a reset; `None` for environments of a server.
    fn rests(&self) -> Option<Vec<bool>> {
        None
    }

    /// Gives an environment a route instead of its goal, and writes its observation.
    ///
    /// # Errors
    /// If these environments cannot do it.
    fn redirect(&mut self, route: &Route, row: &mut [f32]) -> Result<(), EnvError>;
}

/// Why environments cannot do something.
#[derive(Debug, thiserror::Error)]
pub enum EnvError {
    /// The server cannot be reached, or refuses.
    #[error(transparent)]
    Game(#[from] GameError),
    /// A level has nowhere to stand.
    #[error(transparent)]
    NoGround(#[from] NoGround),
    /// An argument is wrong.
    #[error("{0}")]
    Argument(String),
    /// The caller was interrupted while it waited.
    #[error("interrupted")]
    Interrupted,
}

/// Reset of an environment after its episode has ended, in Gymnasium's terms.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Autoreset {
    /// The next step resets it and ignores the action.
    NextStep,
    /// The same step resets it.
    SameStep,
    /// It waits until it is reset.
    Disabled,
}

/// Arguments that all environments share.
#[derive(Debug, Clone)]
pub struct Setup {
    /// Levels of the worlds, in turn.
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
    /// Level of a world.
    pub fn level(&self, world: usize) -> &Arc<Map> {
        &self.levels[world % self.levels.len()]
    }

    /// Length of an observation.
    pub fn observation_len(&self) -> usize {
        observation_len(self.solid)
    }

    /// Number of environments in each world, which differ by one at most.
    pub fn counts(&self) -> Vec<usize> {
        let (each, more) = (self.env_count / self.world_count, self.env_count % self.world_count);
        (0..self.world_count).map(|world| each + usize::from(world < more)).collect()
    }
}

/// Outputs of a step: for each environment an observation, a reward, and whether its episode ended.
#[derive(Debug)]
pub struct Outputs<'a> {
    pub observations: &'a mut [f32],
    pub rewards: &'a mut [f32],
    pub terminated: &'a mut [bool],
    pub truncated: &'a mut [bool],
}

impl<'a> Outputs<'a> {
    /// Lends out the same outputs.
    pub fn reborrow(&mut self) -> Outputs<'_> {
        Outputs {
            observations: &mut *self.observations,
            rewards: &mut *self.rewards,
            terminated: &mut *self.terminated,
            truncated: &mut *self.truncated,
        }
    }

    /// Splits off the outputs of the first `count` environments.
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

/// Refuses values that are not finite.
pub fn check_actions(values: &[f32]) -> Result<(), EnvError> {
    let rows = values.as_chunks::<ACTION_LEN>().0.iter();
    match rows.flatten().position(|value| !value.is_finite()) {
        None => Ok(()),
        Some(idx) => Err(EnvError::Argument(format!(
            "actions[{}, {}] is {}, but must be a finite number (values outside -1 to 1 are clamped)",
            idx / ACTION_LEN,
            idx % ACTION_LEN,
            values[idx]
        ))),
    }
}
