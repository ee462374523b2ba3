//! An environment: NPCs whose actions the caller chooses, such as a remote trainer. It runs in a simulated world, or in
//! any other physics that implements [`Physics`].

mod episodes;
mod physics;

pub use episodes::{Draw, Episodes, Renewal, Route};
pub use physics::{Physics, Placement, Standing};

use crate::goals::Goal;
use episodes::{RouteAhead, places_on};
use physics::WorldPhysics;
use rand::rngs::ChaCha8Rng;
use std::ops::Range;
use std::sync::Arc;
use surefoot_world::character::{ACTION_LEN, Action};
use surefoot_world::navigable::NoGround;
use surefoot_world::{Ability, CharacterProfile, DecisionOutcome, End, Map, Vec3};

/// NPCs that the caller steps, one decision of all of them at a time.
#[derive(Debug)]
pub struct Env {
    physics: Box<dyn Physics>,
    draw: Option<Draw>,
    renewal: Renewal,
    /// Whether each NPC rests because its episode has ended and is not renewed at once.
    rests: Vec<bool>,
    /// The last place of each NPC's route, m.
    goals: Vec<Vec3>,
    observations: Vec<f32>,
    rewards: Vec<f32>,
    /// The most demanding ability that each NPC used in the last step.
    abilities: Vec<Ability>,
    routes: Vec<RouteAhead>,
}

/// An episode that ended.
#[derive(Debug, Clone, PartialEq)]
pub struct Ended {
    /// Index of the NPC.
    pub npc_idx: usize,
    /// How the episode ended.
    pub end: End,
    /// Last observation of the episode.
    pub final_observation: Vec<f32>,
}

impl Env {
    /// Spawns NPCs with the body `profile` on `map` for these episodes. Solid NPCs collide with and see each other.
    ///
    /// # Errors
    /// If no place to stand is found on the map for endless episodes.
    pub fn new(
        map: Arc<Map>,
        profile: CharacterProfile,
        solid_npcs: bool,
        episodes: Episodes,
    ) -> Result<Self, NoGround> {
        let physics = WorldPhysics::new(map.clone(), profile.clone(), solid_npcs, episodes.npc_count());
        Self::of(Box::new(physics), episodes, |rng| places_on(&map, &profile, rng))
    }

    /// Starts these episodes in any physics that has as many NPCs. `places` draws at least one place to stand, m, for
    /// endless episodes.
    ///
    /// # Errors
    /// Returns the error of `places`.
    pub fn of<E>(
        physics: Box<dyn Physics>,
        episodes: Episodes,
        places: impl FnOnce(&mut ChaCha8Rng) -> Result<Vec<Vec3>, E>,
    ) -> Result<Self, E> {
        let npc_count = episodes.npc_count();
        let (mut draw, goals) = match episodes {
            Episodes::Endless { band, seed, .. } => (Some(Draw::of(places, band, seed)?), Vec::new()),
            Episodes::Once(goals) => (None, goals),
        };
        let goals = (0..npc_count).map(|idx| draw.as_mut().map_or_else(|| goals[idx], Draw::goal)).collect::<Vec<_>>();
        let mut env = Self {
            draw,
            renewal: Renewal::AtOnce,
            rests: vec![false; npc_count],
            goals: vec![Vec3::ZERO; npc_count],
            observations: vec![0.0; npc_count * physics.observation_len()],
            physics,
            rewards: vec![0.0; npc_count],
            abilities: vec![Ability::WALK; npc_count],
            routes: vec![RouteAhead::default(); npc_count],
        };
        env.with_rows(|env, rows| env.begin(goals.into_iter().enumerate().collect(), rows));
        Ok(env)
    }

    /// Why the environment failed, in a sentence. After a failure, results are invalid.
    pub fn failure(&self) -> Option<&str> {
        self.physics.failure()
    }

    /// Changes when endless episodes are renewed.
    #[must_use]
    pub fn renewed(self, renewal: Renewal) -> Self {
        Self { renewal, ..self }
    }

    /// Number of NPCs.
    pub fn npc_count(&self) -> usize {
        self.rests.len()
    }

    /// Number of values of an observation.
    pub fn observation_len(&self) -> usize {
        self.physics.observation_len()
    }

    /// Whether each NPC rests.
    pub fn rests(&self) -> &[bool] {
        &self.rests
    }

    /// The last place of each NPC's route, also while it rests, m.
    pub fn goals(&self) -> &[Vec3] {
        &self.goals
    }

    /// Observations of the NPCs as [`new`](Self::new), [`step`](Self::step) and [`redirect`](Self::redirect) left them,
    /// one after another. Each has [`OBSERVATION_LEN`](surefoot_world::OBSERVATION_LEN) values, or
    /// [`OBSERVATION_WITH_OTHERS_LEN`](surefoot_world::OBSERVATION_WITH_OTHERS_LEN) if NPCs are solid.
    pub fn observations(&self) -> &[f32] {
        &self.observations
    }

    /// Rewards of the last step, one for each NPC.
    pub fn rewards(&self) -> &[f32] {
        &self.rewards
    }

    /// Feet of the NPCs, m.
    pub fn positions(&self) -> impl Iterator<Item = Vec3> {
        (0..self.npc_count()).map(|npc_idx| self.physics.stand(npc_idx).feet)
    }

    /// The most demanding ability that each NPC used in the last step.
    pub fn abilities(&self) -> &[Ability] {
        &self.abilities
    }

    /// How many places of its route each NPC has passed. The last place does not count: the episode ends there.
    pub fn passed(&self) -> impl Iterator<Item = u32> {
        self.routes.iter().map(|route| route.passed)
    }

    /// Gives an NPC a route instead of its goal, and wakes it if it rests. A harmed NPC stays at rest unless the route
    /// has a start.
    ///
    /// # Panics
    /// If there is no such NPC, or the route has no places.
    pub fn redirect(&mut self, Route { npc_idx, start, waypoints }: &Route) {
        let (first, rest) = waypoints.split_first().expect("a route has places");
        match *start {
            Some((start, yaw)) => {
                let goal = Goal { start, yaw, goal: *first };
                self.with_rows(|env, rows| env.begin(vec![(*npc_idx, goal)], rows));
            }
            None if self.physics.stand(*npc_idx).is_harmed => return,
            None => {
                self.physics.set_goal(*npc_idx, *first);
                self.with_rows(|env, rows| env.observe(*npc_idx, rows));
            }
        }
        self.rests[*npc_idx] = false;
        self.goals[*npc_idx] = *rest.last().unwrap_or(first);
        self.routes[*npc_idx] = RouteAhead { waypoints: rest.iter().copied().collect(), passed: 0 };
    }

    /// Starts the next episode of an NPC, even if its last one has not ended, and writes its first observation into the
    /// NPC's row of `rows`, which are laid out as [`observations`](Self::observations).
    ///
    /// # Panics
    /// If there is no such NPC, or its episodes are given ([`Episodes::Once`]).
    pub fn renew(&mut self, npc_idx: usize, rows: &mut [f32]) {
        let goal = self.draw.as_mut().expect("endless episodes").goal();
        self.routes[npc_idx] = RouteAhead::default();
        self.rests[npc_idx] = false;
        self.begin(vec![(npc_idx, goal)], rows);
    }

    /// Runs one decision of every NPC and returns the episodes that ended. An NPC that reaches a place of its route
    /// heads for the next one. With endless episodes, an NPC whose episode ended is put at a new start; otherwise it
    /// rests and ignores its actions.
    ///
    /// All NPCs observe at the end of the ticks; NPCs at new starts observe again there.
    ///
    /// # Panics
    /// If the numbers of actions and NPCs differ.
    pub fn step(&mut self, actions: &[Action]) -> Vec<Ended> {
        self.with_rows(|env, rows| env.step_into(actions, rows))
    }

    /// Like [`step`](Self::step), but writes the observations into `rows`, which are laid out as
    /// [`observations`](Self::observations). Rows of resting NPCs stay unchanged.
    ///
    /// # Panics
    /// If the numbers of actions, rows and NPCs differ.
    pub fn step_into(&mut self, actions: &[Action], rows: &mut [f32]) -> Vec<Ended> {
        assert_eq!(rows.len(), self.npc_count() * self.observation_len(), "one row for each NPC");
        assert_eq!(actions.len(), self.npc_count(), "one action for each NPC");
        let awake: Vec<usize> = (0..self.npc_count()).filter(|npc_idx| !self.rests[*npc_idx]).collect();
        let actions: Vec<Action> = awake.iter().map(|npc_idx| actions[*npc_idx]).collect();
        let outcomes = self.physics.advance(&awake, &actions);
        self.rewards.fill(0.0);
        self.abilities.fill(Ability::WALK);
        let settled = awake.into_iter().zip(outcomes);
        let ended = settled.filter_map(|(npc_idx, outcome)| self.settle(npc_idx, outcome, rows));
        let ended: Vec<Ended> = ended.collect();
        if let Some(draw) = self.draw.as_mut().filter(|_| self.renewal == Renewal::AtOnce) {
            let goals = ended.iter().map(|ended| (ended.npc_idx, draw.goal())).collect();
            self.begin(goals, rows);
        }
        ended
    }

    /// Like [`step`](Self::step) and then [`redirect`](Self::redirect) for each of `routes`, but a game gets everything
    /// in one message.
    ///
    /// # Panics
    /// As both, and if two routes are for the same NPC.
    pub fn step_and_redirect(&mut self, actions: &[Action], routes: &[Route]) -> Vec<Ended> {
        let mut ascending: Vec<&Route> = routes.iter().collect();
        ascending.sort_by_key(|route| route.npc_idx);
        assert!(ascending.windows(2).all(|pair| pair[0].npc_idx < pair[1].npc_idx), "one route for each NPC");
        let placement = |route: &Route| route.start.map(|(feet, yaw)| Placement { npc_idx: route.npc_idx, feet, yaw });
        let placements: Vec<Placement> = ascending.into_iter().filter_map(placement).collect();
        self.physics.announce(&placements);
        let ended = self.step(actions);
        routes.iter().for_each(|route| self.redirect(route));
        ended
    }

    /// Lends out the observations.
    fn with_rows<T>(&mut self, run: impl FnOnce(&mut Self, &mut [f32]) -> T) -> T {
        let mut rows = std::mem::take(&mut self.observations);
        let result = run(self, &mut rows);
        self.observations = rows;
        result
    }

    /// Processes the decision of one NPC, and returns its episode if it ended.
    fn settle(&mut self, npc_idx: usize, outcome: DecisionOutcome, rows: &mut [f32]) -> Option<Ended> {
        self.rewards[npc_idx] = outcome.reward;
        self.abilities[npc_idx] = self.physics.stand(npc_idx).ability;
        let next = (outcome.end == Some(End::Reached)).then(|| self.routes[npc_idx].pass()).flatten();
        if let Some(next) = next {
            self.physics.set_goal(npc_idx, next);
        }
        self.observe(npc_idx, rows);
        let end = outcome.end.filter(|_| next.is_none())?;
        let ended = Ended { npc_idx, end, final_observation: rows[self.row(npc_idx)].to_vec() };
        self.routes[npc_idx].waypoints.clear();
        if self.draw.is_none() || self.renewal == Renewal::OnCall {
            self.physics.clear_goal(npc_idx);
            self.rests[npc_idx] = true;
        }
        Some(ended)
    }

    /// Starts episodes of NPCs, ascending, which observe then.
    fn begin(&mut self, goals: Vec<(usize, Goal)>, rows: &mut [f32]) {
        let place = |(npc_idx, Goal { start, yaw, .. }): &(usize, Goal)| Placement {
            npc_idx: *npc_idx,
            feet: *start,
            yaw: *yaw,
        };
        self.physics.place(&goals.iter().map(place).collect::<Vec<_>>());
        for (npc_idx, goal) in &goals {
            self.physics.set_goal(*npc_idx, goal.goal);
            self.goals[*npc_idx] = goal.goal;
        }
        goals.iter().for_each(|(npc_idx, _)| self.observe(*npc_idx, rows));
    }

    /// Range of an NPC's observation in all observations.
    fn row(&self, npc_idx: usize) -> Range<usize> {
        let len = self.observation_len();
        npc_idx * len..(npc_idx + 1) * len
    }

    fn observe(&mut self, npc_idx: usize, rows: &mut [f32]) {
        let row = self.row(npc_idx);
        self.physics.observe(npc_idx, &mut rows[row]);
    }
}

/// Converts values to actions, [`ACTION_LEN`] values each.
///
/// # Errors
/// The first action with a value that is not finite; `npc_of` maps the index of an action to the NPC in the message.
pub fn actions_of(values: &[f32], npc_of: impl Fn(usize) -> u64) -> Result<Vec<Action>, String> {
    let rows = values.as_chunks::<ACTION_LEN>().0.iter().enumerate();
    rows.map(|(idx, row)| Action::from_array(*row).map_err(|error| format!("npc {}: {error}", npc_of(idx)))).collect()
}
