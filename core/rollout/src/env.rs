//! An environment: NPCs whose actions the caller chooses, such as a remote trainer, or somebody whose agent is scored; in our world, or in any
//! other physics that implements [`Physics`].

use crate::decision::{DecisionLoop, Lane, Stage};
use crate::goals::{Goal, goal_in_band, random_point, random_yaw};
use rand::SeedableRng;
use rand::rngs::ChaCha8Rng;
use std::collections::VecDeque;
use std::ops::Range;
use std::sync::Arc;
use surefoot_world::character::{ACTION_LEN, Action};
use surefoot_world::navigable::{self, NoGround};
use surefoot_world::sense::observation_len;
use surefoot_world::{Ability, CharacterProfile, DecisionOutcome, End, Map, TaskConfig, Vec3, World, WorldConfig};

/// Number of places from which starts and goals are drawn.
const PLACES: usize = 1000;
/// Draws for a goal at the wanted distance before the nearest miss is used.
const GOAL_DRAWS: usize = 64;

/// The episodes of an environment.
#[derive(Debug, Clone, PartialEq)]
pub enum Episodes {
    /// Every NPC always has a goal, and a new episode begins as soon as one ends.
    Endless {
        /// Number of NPCs.
        npc_count: usize,
        /// Wanted distance of goals from their starts, m.
        band: (f32, f32),
        /// Seed of starts and goals.
        seed: u64,
    },
    /// One NPC for each of these, and one episode for each NPC, which rests when it has ended.
    Once(Vec<Goal>),
}

impl Episodes {
    /// Number of NPCs.
    pub fn npc_count(&self) -> usize {
        match self {
            Self::Endless { npc_count, .. } => *npc_count,
            Self::Once(goals) => goals.len(),
        }
    }
}

/// An NPC that is put somewhere.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Placement {
    /// Index of the NPC.
    pub npc_idx: usize,
    /// Where its feet are put, m.
    pub feet: Vec3,
    /// Heading, rad.
    pub yaw: f32,
}

/// When an NPC with endless episodes begins its next one.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Renewal {
    /// In the step that ended the last one.
    #[default]
    AtOnce,
    /// When [`Env::renew`] is called; until then it rests.
    OnCall,
}

/// The physics of an environment: our world, or a game. NPCs count from 0.
pub trait Physics: Send + std::fmt::Debug {
    /// Number of values of an observation.
    fn observation_len(&self) -> usize;

    /// Puts NPCs there, ascending and each at most once, at rest and unharmed, without an episode.
    fn place(&mut self, placements: &[Placement]);

    /// Announces placements that will follow the next call of [`advance`](Self::advance), ascending, so that they can go to a game with it.
    fn announce(&mut self, _placements: &[Placement]) {}

    /// Why the physics cannot go on, in a sentence, once it cannot: what it says from then on is worth nothing.
    fn failure(&self) -> Option<&str> {
        None
    }

    /// Starts an episode towards `goal`, m; the body keeps its motion.
    fn set_goal(&mut self, npc_idx: usize, goal: Vec3);

    /// Ends the episode of an NPC, which comes to rest.
    fn clear_goal(&mut self, npc_idx: usize);

    /// Runs ten ticks, in which these NPCs, ascending, carry out their actions and all others rest. Returns how the decisions of these
    /// NPCs went, in order. All of them have episodes.
    fn advance(&mut self, npcs: &[usize], actions: &[Action]) -> Vec<DecisionOutcome>;

    /// Writes the observation of an NPC, which has an episode.
    fn observe(&mut self, npc_idx: usize, row: &mut [f32]);

    /// Where an NPC is.
    fn stand(&self, npc_idx: usize) -> Standing;
}

/// Where an NPC is, and what it did last.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Standing {
    /// Position of the feet, m.
    pub feet: Vec3,
    /// The most demanding ability of its last decision.
    pub ability: Ability,
    /// Whether it came to harm.
    pub is_harmed: bool,
}

/// A world of ours.
#[derive(Debug)]
struct Ours {
    worlds: [World; 1],
    lanes: Vec<Lane>,
    decisions: DecisionLoop,
    observation_len: usize,
}

impl Ours {
    fn new(map: Arc<Map>, profile: CharacterProfile, solid_npcs: bool, npc_count: usize) -> Self {
        let observation_len = observation_len(solid_npcs);
        let mut world = World::with_config(map, WorldConfig::new(profile, TaskConfig::default(), solid_npcs));
        let lanes = (0..npc_count).map(|_| Lane::of(world.spawn(Vec3::ZERO, 0.0))).collect();
        Self { worlds: [world], lanes, decisions: DecisionLoop::of_lens(observation_len, 0), observation_len }
    }
}

impl Physics for Ours {
    fn observation_len(&self) -> usize {
        self.observation_len
    }

    fn place(&mut self, placements: &[Placement]) {
        for Placement { npc_idx, feet, yaw } in placements {
            self.worlds[0].teleport(self.lanes[*npc_idx].slot, *feet, *yaw);
        }
    }

    fn set_goal(&mut self, npc_idx: usize, goal: Vec3) {
        self.worlds[0].set_waypoint(self.lanes[npc_idx].slot, goal);
    }

    fn clear_goal(&mut self, npc_idx: usize) {
        self.worlds[0].clear_waypoint(self.lanes[npc_idx].slot);
    }

    fn advance(&mut self, npcs: &[usize], actions: &[Action]) -> Vec<DecisionOutcome> {
        let lanes: Vec<Lane> = npcs.iter().map(|npc_idx| self.lanes[*npc_idx]).collect();
        self.decisions.advance(&mut Stage { worlds: &mut self.worlds, lanes: &lanes }, actions).to_vec()
    }

    fn observe(&mut self, npc_idx: usize, row: &mut [f32]) {
        self.worlds[0].observe(self.lanes[npc_idx].slot, row);
    }

    fn stand(&self, npc_idx: usize) -> Standing {
        let npc = self.worlds[0].npc(self.lanes[npc_idx].slot).expect("an NPC in every lane");
        Standing { feet: npc.body.feet, ability: npc.used_abilities.most_demanding(), is_harmed: npc.harm.is_some() }
    }
}

/// NPCs that the caller steps, one decision of all of them at a time.
#[derive(Debug)]
pub struct Env {
    physics: Box<dyn Physics>,
    draw: Option<Draw>,
    renewal: Renewal,
    /// Whether each NPC rests, since its only episode, or one that is not renewed at once, has ended.
    rests: Vec<bool>,
    /// The last place for which each NPC heads, m.
    goals: Vec<Vec3>,
    observations: Vec<f32>,
    rewards: Vec<f32>,
    /// The most demanding ability that each NPC used in the last step.
    abilities: Vec<Ability>,
    routes: Vec<Rest>,
}

/// What is left of a route.
#[derive(Debug, Clone, Default)]
struct Rest {
    /// Places after the one for which the NPC heads, m.
    waypoints: VecDeque<Vec3>,
    passed: u32,
}

/// Places for which an NPC heads one after another.
#[derive(Debug, Clone, PartialEq)]
pub struct Route {
    /// Index of the NPC.
    pub npc_idx: usize,
    /// Where the feet are put first, m, and the heading, rad; `None` if the NPC goes on from where it is.
    pub start: Option<(Vec3, f32)>,
    /// The places, m, at least one.
    pub waypoints: Vec<Vec3>,
}

/// Where endless episodes come from.
#[derive(Debug)]
pub struct Draw {
    places: Vec<Vec3>,
    /// Wanted distance of goals from their starts, m.
    band: (f32, f32),
    rng: ChaCha8Rng,
}

impl Draw {
    /// The draw of an environment of our worlds with these arguments.
    ///
    /// # Errors
    /// If no place to stand is found on the map.
    pub fn on(map: &Map, profile: &CharacterProfile, band: (f32, f32), seed: u64) -> Result<Self, NoGround> {
        Self::of(|rng| places_on(map, profile, rng), band, seed)
    }

    fn of<E>(
        places: impl FnOnce(&mut ChaCha8Rng) -> Result<Vec<Vec3>, E>,
        band: (f32, f32),
        seed: u64,
    ) -> Result<Self, E> {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        Ok(Self { places: places(&mut rng)?, band, rng })
    }

    /// Draws the next episode.
    pub fn goal(&mut self) -> Goal {
        let Self { places, band, rng } = self;
        let start = random_point(places, rng);
        let yaw = random_yaw(rng);
        Goal { start, yaw, goal: goal_in_band(places, start, *band, GOAL_DRAWS, rng) }
    }
}

/// Draws places to stand on a map.
fn places_on(map: &Map, profile: &CharacterProfile, rng: &mut ChaCha8Rng) -> Result<Vec<Vec3>, NoGround> {
    navigable::sample_many(map, profile, PLACES, rng)
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
    /// Spawns NPCs with the body `profile` on `map` for these episodes. Solid NPCs get in each other's way and see each other.
    ///
    /// # Errors
    /// If no place to stand is found on the map for endless episodes.
    pub fn new(
        map: Arc<Map>,
        profile: CharacterProfile,
        solid_npcs: bool,
        episodes: Episodes,
    ) -> Result<Self, NoGround> {
        let physics = Ours::new(map.clone(), profile.clone(), solid_npcs, episodes.npc_count());
        Self::of(Box::new(physics), episodes, |rng| places_on(&map, &profile, rng))
    }

    /// Starts these episodes in any physics that has as many NPCs. `places` draws at least one place to stand, m, for endless episodes.
    ///
    /// # Errors
    /// That of `places`.
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
            abilities: vec![Ability::Walk; npc_count],
            routes: vec![Rest::default(); npc_count],
        };
        env.with_rows(|env, rows| env.begin(goals.into_iter().enumerate().collect(), rows));
        Ok(env)
    }

    /// Why the environment cannot go on, in a sentence, once it cannot: its results are then worth nothing.
    pub fn failure(&self) -> Option<&str> {
        self.physics.failure()
    }

    /// The same environment with endless episodes that are renewed at another time.
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

    /// The last place for which each NPC heads, or headed before it rested, m.
    pub fn goals(&self) -> &[Vec3] {
        &self.goals
    }

    /// Observations of the NPCs as [`new`](Self::new), [`step`](Self::step) and [`redirect`](Self::redirect) left them, one after another: [`OBSERVATION_LEN`](surefoot_world::OBSERVATION_LEN) values each, or
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

    /// How many places of its route each NPC has passed. The last one is not passed: the episode ends there.
    pub fn passed(&self) -> impl Iterator<Item = u32> {
        self.routes.iter().map(|route| route.passed)
    }

    /// Gives an NPC a route instead of its goal, and wakes it if it rests. One that came to harm rests on if the route has no start.
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
        self.routes[*npc_idx] = Rest { waypoints: rest.iter().copied().collect(), passed: 0 };
    }

    /// Starts the next episode of an NPC, even if its last one has not ended, and writes its first observation into the NPC's row of
    /// `rows`, which are laid out as [`observations`](Self::observations).
    ///
    /// # Panics
    /// If there is no such NPC, or its episodes are given ([`Episodes::Once`]).
    pub fn renew(&mut self, npc_idx: usize, rows: &mut [f32]) {
        let goal = self.draw.as_mut().expect("endless episodes").goal();
        self.routes[npc_idx] = Rest::default();
        self.rests[npc_idx] = false;
        self.begin(vec![(npc_idx, goal)], rows);
    }

    /// Runs one decision of every NPC and returns the episodes that ended. An NPC that reaches a place of its route heads for the next
    /// one. With endless episodes NPCs whose episode ended are at a new start; others rest from then on, whatever their actions are.
    ///
    /// All NPCs observe where the ticks end; those at new starts observe again there.
    ///
    /// # Panics
    /// If the numbers of actions and NPCs differ.
    pub fn step(&mut self, actions: &[Action]) -> Vec<Ended> {
        self.with_rows(|env, rows| env.step_into(actions, rows))
    }

    /// Does what [`step`](Self::step) does, and writes the observations into `rows`, which are laid out as
    /// [`observations`](Self::observations). Rows of NPCs that rest are left as they are.
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
        self.abilities.fill(Ability::Walk);
        let settled = awake.into_iter().zip(outcomes);
        let ended = settled.filter_map(|(npc_idx, outcome)| self.settle(npc_idx, outcome, rows));
        let ended: Vec<Ended> = ended.collect();
        if let Some(draw) = self.draw.as_mut().filter(|_| self.renewal == Renewal::AtOnce) {
            let goals = ended.iter().map(|ended| (ended.npc_idx, draw.goal())).collect();
            self.begin(goals, rows);
        }
        ended
    }

    /// As [`step`](Self::step) and then [`redirect`](Self::redirect) for each of `routes`, but a game hears of all of it at once.
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

    /// Where the observation of an NPC is among those of all.
    fn row(&self, npc_idx: usize) -> Range<usize> {
        let len = self.observation_len();
        npc_idx * len..(npc_idx + 1) * len
    }

    fn observe(&mut self, npc_idx: usize, rows: &mut [f32]) {
        let row = self.row(npc_idx);
        self.physics.observe(npc_idx, &mut rows[row]);
    }
}

impl Rest {
    /// Passes the place for which the NPC heads, if another one comes after it, and returns that.
    fn pass(&mut self) -> Option<Vec3> {
        let next = self.waypoints.pop_front()?;
        self.passed += 1;
        Some(next)
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
