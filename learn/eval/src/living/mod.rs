//! The living suite: crowds, doors, lifts, platforms, floors that vanish, players, and chases.
//!
//! Every NPC that does not arrive counts as a failure. In chases, every decision in which an NPC is not with its target
//! counts as one, and of NPCs that flee, every decision in danger. The levels are made for the suite, and nothing was
//! trained on them; their graphs are built as usual.

mod chases;
mod scenes;

use super::config::EvalError;
use super::report::Rate;
use rand::rngs::ChaCha8Rng;
use rand::{RngExt, SeedableRng};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::f32::consts::TAU;
use std::sync::Arc;
use surefoot_planner::search::DEFAULT_LABEL_LIMIT;
use surefoot_planner::{BuildSettings, Progress, Router};
use surefoot_policy::Policy;
use surefoot_rollout::attempts::{AttemptResult, Rollout};
use surefoot_rollout::goals::Goal;
use surefoot_rollout::graphs::build;
use surefoot_rollout::probe::ProbeContext;
use surefoot_world::{
    Body, CharacterProfile, DECISION_SECONDS, End, Map, MapSpec, MoverId, MoverOrder, Player, PlayerContact, StopIdx,
    TaskConfig, Vec3, World, navigable,
};

/// Seed of the validation map on which crowds head for random goals.
const CROWD_MAP: u64 = 1000;
/// NPCs of that crowd.
const CROWD: usize = 1024;
/// Decisions between two changes of a door that opens and shuts at random: 3 to 8 s.
const DOOR_DECISIONS: std::ops::Range<u32> = 18..48;

/// Names of all scenes.
pub const SCENES: [&str; 22] = [
    "door",
    "corridor",
    "crowd",
    "doors",
    "lift",
    "called lift",
    "ferry",
    "vanishing bridge",
    "players",
    "chase, 2 Hz",
    "chase, 2 Hz with velocity",
    "chase, 10 Hz",
    "chase, 60 Hz",
    "chase, 6 m/s",
    "chase, 10 m/s",
    "chase through doors",
    "chase by lift",
    "column",
    "wedge",
    "cut off",
    "flee",
    "flee out of sight",
];

/// Settings of a run.
#[derive(Debug, Clone)]
pub struct LivingConfig {
    /// The scenes that are run, of [`SCENES`]; empty: all of them.
    pub scenes: Vec<String>,
    /// Runs of each scene with few NPCs, each with another seed.
    pub runs: u64,
    /// Threads for building graphs.
    pub thread_count: usize,
    /// Settings of the graphs.
    pub settings: BuildSettings,
}

/// The results of all scenes.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct LivingReport {
    /// `living`.
    pub suite: String,
    /// Hash of the policy's weights.
    pub model: String,
    /// The scenes.
    pub scenes: Vec<SceneReport>,
}

/// The result of one scene.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct SceneReport {
    /// Name of the scene.
    pub name: String,
    /// What happens in it.
    pub about: String,
    /// The target.
    pub target: String,
    /// Runs, each with another seed.
    pub runs: u64,
    /// NPCs that arrived; in chases, decisions within 3 m of the target, of those since the first contact; of NPCs that
    /// flee, decisions in safety, of those since they were first safe.
    pub success: Rate,
    /// Number of attempts by their end; in chases, NPCs that had contact and NPCs that died.
    pub ends: BTreeMap<String, u64>,
    /// In crowds of solid NPCs, attempts that ended without progress: every deadlock is one of them.
    pub deadlocks: Option<u64>,
    /// Time until an NPC arrived or had contact, s: mean, and mean over the runs of the last one.
    pub seconds_mean: f64,
    /// See above.
    pub seconds_last: f64,
    /// Runs in which all NPCs arrived; in chases, runs in which none died.
    pub runs_complete: u64,
    /// The same scene without what makes it hard, where there is one: what that is, share of success, and time of the
    /// last one, s.
    pub reference: Option<(String, f64, f64)>,
    /// In chases, time that a decision takes in relation to one on the way to a goal that does not move.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub cpu_ratio: Option<f64>,
}

/// Runs the scenes; `begun` is called with the name of each.
///
/// # Errors
/// If a graph cannot be built.
pub fn run(policy: &Policy, config: &LivingConfig, mut begun: impl FnMut(&str)) -> Result<LivingReport, EvalError> {
    let suite = Suite { policy, config };
    let mut scenes = Vec::new();
    type Run<'a> = fn(&Suite<'a>) -> Result<SceneReport, EvalError>;
    let all: [Run<'_>; SCENES.len()] = [
        Suite::door,
        Suite::corridor,
        Suite::crowd,
        Suite::doors,
        |suite| suite.lift(true),
        |suite| suite.lift(false),
        Suite::ferry,
        Suite::bridge,
        |suite| Ok(suite.players()),
        |suite| suite.pursuit(3.0, 2.0, false),
        |suite| suite.pursuit(3.0, 2.0, true),
        |suite| suite.pursuit(3.0, 10.0, false),
        |suite| suite.pursuit(3.0, 60.0, false),
        |suite| suite.pursuit(6.0, 10.0, false),
        |suite| suite.pursuit(10.0, 10.0, false),
        Suite::pursuit_through_doors,
        Suite::pursuit_onto_a_lift,
        Suite::column,
        Suite::wedge,
        Suite::cut_off,
        |suite| suite.flight(false),
        |suite| suite.flight(true),
    ];
    let is_wanted = |name: &str| config.scenes.is_empty() || config.scenes.iter().any(|wanted| wanted == name);
    for (name, scene) in SCENES.into_iter().zip(all).filter(|(name, _)| is_wanted(name)) {
        begun(name);
        scenes.push(SceneReport { name: name.to_owned(), ..scene(&suite)? });
    }
    Ok(LivingReport { suite: "living".to_owned(), model: policy.weights_hash().to_owned(), scenes })
}

struct Suite<'a> {
    policy: &'a Policy,
    config: &'a LivingConfig,
}

/// A level with its graph.
struct Level {
    map: Arc<Map>,
    router: Router,
}

/// Results of the runs of a scene so far.
#[derive(Default)]
struct Tally {
    attempts: Vec<AttemptResult>,
    runs: u64,
    complete: u64,
    last_s: f64,
}

impl Tally {
    fn add(&mut self, attempts: Vec<AttemptResult>) {
        self.runs += 1;
        self.complete += u64::from(attempts.iter().all(|attempt| attempt.end == End::Reached));
        self.last_s += attempts.iter().map(seconds).fold(0.0, f64::max);
        self.attempts.extend(attempts);
    }

    fn rate(&self) -> Rate {
        let arrived = self.attempts.iter().filter(|attempt| attempt.end == End::Reached).count();
        Rate::of(arrived, self.attempts.len())
    }

    fn report(&self, about: &str, target: &str, reference: Option<(String, f64, f64)>) -> SceneReport {
        let mut ends = BTreeMap::new();
        for attempt in &self.attempts {
            *ends.entry(attempt.end.name().to_owned()).or_insert(0) += 1;
        }
        let arrived: Vec<f64> =
            self.attempts.iter().filter(|attempt| attempt.end == End::Reached).map(seconds).collect();
        SceneReport {
            name: String::new(),
            about: about.to_owned(),
            target: target.to_owned(),
            runs: self.runs,
            success: self.rate(),
            ends,
            deadlocks: None,
            seconds_mean: arrived.iter().sum::<f64>() / arrived.len().max(1) as f64,
            seconds_last: self.last_s / self.runs.max(1) as f64,
            runs_complete: self.complete,
            reference,
            cpu_ratio: None,
        }
    }

    /// The report of a crowd of solid NPCs.
    fn report_crowd(&self, about: &str, target: &str, reference: (String, f64, f64)) -> SceneReport {
        let stuck = self.attempts.iter().filter(|attempt| attempt.end == End::NoProgress).count();
        SceneReport { deadlocks: Some(stuck as u64), ..self.report(about, target, Some(reference)) }
    }

    fn last_s(&self) -> f64 {
        self.last_s / self.runs.max(1) as f64
    }
}

fn seconds(attempt: &AttemptResult) -> f64 {
    f64::from(attempt.decisions) * f64::from(DECISION_SECONDS)
}

impl Suite<'_> {
    fn level(&self, map: Map) -> Result<Level, EvalError> {
        let map = Arc::new(map);
        let context = ProbeContext::new(map.clone(), self.policy.clone());
        let threads = self.config.thread_count;
        let built = build(&context, &self.config.settings, threads, &Progress::default())?;
        Ok(Level { map, router: Router::new(built.graph, DEFAULT_LABEL_LIMIT, threads) })
    }

    fn run(
        &self,
        level: &Level,
        goals: &[Goal],
        seed: u64,
        solid: bool,
        stir: impl FnMut(&mut World, u32),
    ) -> Vec<AttemptResult> {
        let mut rollout = Rollout::new(level.map.clone(), CharacterProfile::default(), TaskConfig::default());
        (rollout.seed, rollout.solid) = (seed, solid);
        rollout.live(self.policy, &level.router, goals, stir)
    }

    /// Runs a scene with new goals in each run, and no changes from outside.
    fn repeat(&self, level: &Level, solid: bool, goals: impl Fn(u64) -> Vec<Goal>) -> Tally {
        let mut tally = Tally::default();
        for seed in 0..self.config.runs {
            tally.add(self.run(level, &goals(seed), seed, solid, |_, _| {}));
        }
        tally
    }

    fn door(&self) -> Result<SceneReport, EvalError> {
        let level = self.level(scenes::two_rooms())?;
        let tally = self.repeat(&level, true, scenes::through_the_door);
        let ghosts = self.repeat(&level, false, scenes::through_the_door);
        let reference = ("ghosts".to_owned(), ghosts.rate().rate, ghosts.last_s());
        Ok(tally.report_crowd("64 solid NPCs through one door of 1.2 m", "all arrive, no deadlock", reference))
    }

    fn corridor(&self) -> Result<SceneReport, EvalError> {
        let level = self.level(scenes::corridor())?;
        let tally = self.repeat(&level, true, |seed| scenes::streams(seed, true));
        let single = self.repeat(&level, true, |seed| scenes::streams(seed, false));
        let reference = ("one stream".to_owned(), single.rate().rate, single.last_s());
        let about = "two streams of 64 solid NPCs in a corridor of 4 m";
        Ok(tally.report_crowd(about, "all arrive, <= 1.3 x the time of one stream", reference))
    }

    fn crowd(&self) -> Result<SceneReport, EvalError> {
        let level =
            self.level(surefoot_generate::generate(&MapSpec::with_side(CROWD_MAP, 250).expect("a valid side")))?;
        let mut rng = ChaCha8Rng::seed_from_u64(CROWD_MAP);
        let points = navigable::sample_many(&level.map, &CharacterProfile::default(), 4 * CROWD, &mut rng)?;
        let goals = Goal::draw(&points, 2.0..f32::INFINITY, CROWD, &mut rng);
        let (mut tally, mut ghosts) = (Tally::default(), Tally::default());
        tally.add(self.run(&level, &goals, 0, true, |_, _| {}));
        ghosts.add(self.run(&level, &goals, 0, false, |_, _| {}));
        let reference = ("ghosts".to_owned(), ghosts.rate().rate, ghosts.last_s());
        let about = "1,024 solid NPCs with random goals on a map of 250 m";
        Ok(tally.report_crowd(about, "within 1 point of ghosts", reference))
    }

    fn doors(&self) -> Result<SceneReport, EvalError> {
        let level = self.level(scenes::rooms())?;
        let door_count = level.map.movers().len();
        let mut tally = Tally::default();
        for seed in 0..self.config.runs {
            let mut rng = ChaCha8Rng::seed_from_u64(1000 + seed);
            // Every second door opens and shuts at random times.
            let mut due: Vec<u32> = (0..door_count).map(|_| rng.random_range(0..DOOR_DECISIONS.end)).collect();
            let restless: Vec<bool> = (0..door_count).map(|_| rng.random_bool(0.5)).collect();
            let stir = |world: &mut World, decision: u32| {
                for door in (0..door_count).filter(|door| restless[*door]) {
                    if decision >= due[door] {
                        due[door] = decision + rng.random_range(DOOR_DECISIONS);
                        let opens = world.movers()[door].bound_for() == StopIdx(0);
                        world.order(MoverId(door as u16), MoverOrder::GoTo(StopIdx(u8::from(opens))));
                    }
                }
            };
            tally.add(self.run(&level, &scenes::between_rooms(64, seed), seed, false, stir));
        }
        Ok(tally.report("64 NPCs in 16 rooms; half of the 24 doors open and shut at random", ">= 98 %", None))
    }

    fn lift(&self, cycles: bool) -> Result<SceneReport, EvalError> {
        let level = self.level(scenes::deck_with_lift(cycles))?;
        let (floor, deck) = (([4.0, 4.0], [17.0, 40.0], 0.0), ([24.0, 14.0], [36.0, 30.0], 9.0));
        let tally = self.repeat(&level, false, |seed| scenes::to_and_fro(floor, deck, 32, seed));
        let about =
            if cycles { "a lift that cycles is the only way up" } else { "a lift that is called is the only way up" };
        Ok(tally.report(about, ">= 98 %", None))
    }

    fn ferry(&self) -> Result<SceneReport, EvalError> {
        let level = self.level(scenes::ferry())?;
        let (here, there) = (([4.0, 4.0], [30.0, 30.0], 0.0), ([64.0, 4.0], [90.0, 30.0], 0.0));
        let tally = self.repeat(&level, false, |seed| scenes::to_and_fro(here, there, 32, seed));
        Ok(tally.report("a platform over a void is the only way to the other island", ">= 98 %", None))
    }

    fn bridge(&self) -> Result<SceneReport, EvalError> {
        let level = self.level(scenes::vanishing_bridge())?;
        let (here, there) = (([4.0, 4.0], [30.0, 30.0], 0.0), ([46.0, 4.0], [72.0, 30.0], 0.0));
        let tally = self.repeat(&level, false, |seed| scenes::to_and_fro(here, there, 32, seed));
        let about = "a bridge of three floors that vanish and come back is the only way over a void";
        Ok(tally.report(about, ">= 97 %, died <= 1 %", None))
    }

    /// NPCs that stand beside a ledge while players walk into them from anywhere.
    fn players(&self) -> SceneReport {
        const ENCOUNTERS: usize = 1000;
        let map = Arc::new(scenes::ferry());
        let mut world = World::new(map, CharacterProfile::default(), TaskConfig::default());
        let mut rng = ChaCha8Rng::seed_from_u64(20);
        let (mut stood, mut moved) = (0, 0);
        for encounter in 0..ENCOUNTERS {
            let along = rng.random_range(4.0..30.0);
            let place = Vec3::new(2.0 + rng.random_range(0.3..1.5), 10.0, along);
            let slot = world.spawn(place, rng.random_range(0.0..TAU));
            let way = Body::at(place, rng.random_range(0.0..TAU)).facing();
            let contact = if encounter % 4 == 0 { PlayerContact::Block } else { PlayerContact::Push };
            let start = place - way * 2.0;
            let (radius, height) = (0.4, 1.8);
            let player = world.spawn_player(Player { feet: start, velocity: Vec3::ZERO, radius, height, contact });
            let velocity = way * rng.random_range(1.0..9.0);
            for tick in 0..60 {
                world.move_player(player, start + velocity * (tick as f32 / 60.0), velocity);
                world.tick();
            }
            let npc = world.npc(slot).expect("just spawned");
            stood += usize::from(npc.harm.is_none() && npc.body.feet.y > 9.9);
            moved += u64::from(npc.body.feet.distance(place) > 0.2);
            world.despawn(slot);
            world.remove_player(player);
        }
        SceneReport {
            name: "players".to_owned(),
            about: "1,000 NPCs beside a ledge, each with a player that walks into it".to_owned(),
            target: "0 pushed off".to_owned(),
            runs: 1,
            success: Rate::of(stood, ENCOUNTERS),
            ends: BTreeMap::from([
                ("pushed aside".to_owned(), moved),
                ("fell".to_owned(), (ENCOUNTERS - stood) as u64),
            ]),
            seconds_mean: 0.0,
            seconds_last: 0.0,
            deadlocks: None,
            runs_complete: u64::from(stood == ENCOUNTERS),
            reference: None,
            cpu_ratio: None,
        }
    }
}

impl LivingReport {
    /// The results as a Markdown table.
    pub fn markdown(&self) -> String {
        let mut text = String::from(
            "| scene | target | arrived or near | deadlocks | runs without failures | last one, s | beside \
             |\n|---|---|---|---|---|---|---|\n",
        );
        for scene in &self.scenes {
            let beside = scene
                .reference
                .as_ref()
                .map_or(String::new(), |(what, rate, last)| format!("{what}: {:.2} %, {last:.1} s", 100.0 * rate));
            let Rate { rate, n, .. } = scene.success;
            let arrived = (rate * n as f64).round();
            let beside = scene
                .cpu_ratio
                .map_or(beside, |ratio| format!("CPU per decision {ratio:.2} x that of a standing goal"));
            text.push_str(&format!(
                "| {}: {} | {} | {arrived} of {n} ({:.2} %) | {} | {} of {} | {:.1} | {beside} |\n",
                scene.name,
                scene.about,
                scene.target,
                100.0 * rate,
                scene.deadlocks.map_or_else(|| "-".to_owned(), |count| count.to_string()),
                scene.runs_complete,
                scene.runs,
                scene.seconds_last,
            ));
        }
        text
    }
}
