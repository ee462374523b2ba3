//! Whole builds on toy maps. The executor needs no policy: a rule decides which probes succeed.

use std::sync::Arc;
use std::sync::Mutex;
use std::sync::atomic::{AtomicU32, Ordering};
use surefoot_planner::probe::{Outcome, ProbeExecutor, ProbeWatch, Trial};
use surefoot_planner::{
    BuildError, BuildSettings, Builder, Built, EdgeKey, GraphId, PolicyHash, Probing, Progress, Query, Rehearsed,
    Router, Site, VertexId,
};
use surefoot_world::map::{MapSize, Placed};
use surefoot_world::mesh::{Surface, Triangle};
use surefoot_world::{Ability, Map, Vec3};

/// A floor of 60 x 60 m.
fn site() -> Site {
    floors(&[[0.0, 0.0, 60.0, 60.0]])
}

/// Level rectangles, from (x, z) to (x, z), with nothing around them.
fn floors(rectangles: &[[f32; 4]]) -> Site {
    let triangles = |&[x0, z0, x1, z1]: &[f32; 4]| {
        let [a, b, c, d] = [[x0, z0], [x0, z1], [x1, z1], [x1, z0]].map(|[x, z]| Vec3::new(x, 1.0, z));
        [[a, b, c], [a, c, d]].map(|corners| Triangle::new(corners, Surface::Ground).unwrap())
    };
    let triangles = rectangles.iter().flat_map(triangles).collect();
    Site::new(Arc::new(Map::from_parts(MapSize { width: 60, height: 20, depth: 60 }, triangles, Placed::default())))
}

/// A river at x = 30 that can be crossed only from west to east; elsewhere, probes walk 1 m per decision.
#[derive(Default)]
struct River {
    tried: Mutex<Vec<Trial>>,
}

impl ProbeExecutor for River {
    fn run(&self, trials: &[Trial], _: u64, watch: &dyn ProbeWatch) -> Option<Vec<Outcome>> {
        if watch.is_cancelled() {
            return None;
        }
        self.tried.lock().unwrap().extend(trials);
        Some(show(trials.iter().map(outcome).collect(), watch))
    }
}

/// A ford in the place of the river: all probes arrive.
#[derive(Default)]
struct Ford {
    tried: AtomicU32,
}

impl ProbeExecutor for Ford {
    fn run(&self, trials: &[Trial], _: u64, watch: &dyn ProbeWatch) -> Option<Vec<Outcome>> {
        self.tried.fetch_add(trials.len() as u32, Ordering::Relaxed);
        Some(show(trials.iter().map(|trial| Outcome { reached: true, ..outcome(trial) }).collect(), watch))
    }
}

/// A floor on which probes over more than 9 m jump, and then arrive only if `jumps`.
struct Hops {
    jumps: bool,
}

impl ProbeExecutor for Hops {
    fn run(&self, trials: &[Trial], _: u64, watch: &dyn ProbeWatch) -> Option<Vec<Outcome>> {
        let probe = |trial: &Trial| {
            let jumps = trial.start.distance(trial.goal) > 9.0;
            let ability = if jumps { Ability::JUMP } else { Ability::WALK };
            Outcome { reached: self.jumps || !jumps, ability, ..outcome(trial) }
        };
        Some(show(trials.iter().map(probe).collect(), watch))
    }
}

/// A river like the above, over which one probe in 29 gets back.
#[derive(Default)]
struct Torrent {
    returns: AtomicU32,
}

impl ProbeExecutor for Torrent {
    fn run(&self, trials: &[Trial], _: u64, watch: &dyn ProbeWatch) -> Option<Vec<Outcome>> {
        let probe = |trial: &Trial| {
            let usual = outcome(trial);
            let gets_back = !usual.reached && self.returns.fetch_add(1, Ordering::Relaxed) % 29 == 28;
            Outcome { reached: usual.reached || gets_back, ..usual }
        };
        Some(show(trials.iter().map(probe).collect(), watch))
    }
}

fn show(outcomes: Vec<Outcome>, watch: &dyn ProbeWatch) -> Vec<Outcome> {
    outcomes.iter().enumerate().for_each(|(idx, outcome)| watch.finished(idx, outcome));
    outcomes
}

fn outcome(trial: &Trial) -> Outcome {
    if let Some(via) = trial.via {
        let approach = outcome(&Trial { via: None, goal: via, ..*trial });
        let onwards = outcome(&Trial { via: None, start: via, ..*trial });
        return Outcome { approach: Some(Box::new(approach)), ..onwards };
    }
    let crosses_back = trial.start.x > 30.0 && trial.goal.x < 30.0;
    let crosses = trial.start.x < 30.0 && trial.goal.x > 30.0;
    let track = if trial.keep_track { vec![Some(trial.start), Some(trial.goal)] } else { Vec::new() };
    Outcome {
        reached: !crosses_back,
        died: false,
        decisions: trial.start.distance(trial.goal).ceil() as u32,
        ability: if crosses { Ability::JUMP } else { Ability::WALK },
        bounds: [trial.start.min(trial.goal), trial.start.max(trial.goal)],
        track,
        needs: surefoot_planner::Needs::default(),
        approach: None,
    }
}

fn settings() -> BuildSettings {
    BuildSettings::default()
        .with(|it| {
            it.vertices = 40;
            it.neighbours = 6;
            it.repeats = 1;
            it.seed = 3;
            it.special_moves = false;
            it.probing = Probing::Exhaustive;
        })
        .unwrap()
}

fn build(settings: &BuildSettings, executor: &dyn ProbeExecutor, progress: &Progress) -> Result<Built, BuildError> {
    let builder = Builder { site: &site(), settings, executor, thread_count: 2, clock: &|| 0.0, progress };
    builder.build()
}

#[test]
fn edges_are_what_the_executor_says_and_the_river_is_one_way() {
    let executor = River::default();
    let Built { graph, stats } = build(&settings(), &executor, &Progress::default()).unwrap();
    assert_eq!(stats.probes as usize, executor.tried.lock().unwrap().len());
    assert_eq!(stats.probes, 40 * 6);
    let side = |vertex| graph.position(vertex).x > 30.0;
    for edge in graph.edges() {
        assert!(!side(edge.key.from) || side(edge.key.to), "an edge leads back over the river");
        let crosses = side(edge.key.to) && !side(edge.key.from);
        assert_eq!(edge.evidence.ability, if crosses { Ability::JUMP } else { Ability::WALK });
    }
    assert!(graph.edges().any(|edge| side(edge.key.to) && !side(edge.key.from)), "nothing leads over the river");
    let router = Router::new(graph, 4096, 1);
    let find = |start, goal| router.find_path(&Query::new(start, goal));
    let (west, east) = (Vec3::new(4.0, 1.0, 30.0), Vec3::new(56.0, 1.0, 30.0));
    assert_eq!(find(west, east).no_path, None);
    assert_eq!(find(east, west).no_path, Some(surefoot_planner::NoPath::OneWay));
}

#[test]
fn a_frugal_build_finds_the_same_connections_with_fewer_probes() {
    let (all, few) = (River::default(), River::default());
    let settings = settings()
        .with(|it| {
            it.vertices = 120;
            it.neighbours = 12;
            it.repeats = 2;
        })
        .unwrap();
    let exhaustive = build(&settings, &all, &Progress::default()).unwrap();
    let frugal = build(&settings.with(|it| it.probing = Probing::Frugal).unwrap(), &few, &Progress::default()).unwrap();
    assert!(
        frugal.stats.probes * 10 < exhaustive.stats.probes * 7,
        "{} of {}",
        frugal.stats.probes,
        exhaustive.stats.probes
    );
    let connected = |built: &Built| built.graph.connected_share();
    assert!(
        (connected(&frugal) - connected(&exhaustive)).abs() < 1.0e-9,
        "{} and {}",
        connected(&frugal),
        connected(&exhaustive)
    );
}

fn build_rehearsed([executor, rehearsal]: [&dyn ProbeExecutor; 2]) -> Rehearsed {
    let settings = settings().with(|it| (it.probing, it.vertices, it.neighbours) = (Probing::Frugal, 120, 10)).unwrap();
    let (site, progress) = (site(), Progress::default());
    let builder =
        Builder { site: &site, settings: &settings, executor, thread_count: 2, clock: &|| 0.0, progress: &progress };
    builder.build_rehearsed(rehearsal).unwrap()
}

#[test]
fn what_plans_use_of_a_rehearsed_graph_is_proved_again() {
    let (river, ford) = (River::default(), Ford::default());
    let Rehearsed { built: Built { graph, stats }, of_draft } = build_rehearsed([&river, &ford]);
    let (tried, rehearsed) = (river.tried.lock().unwrap().len(), ford.tried.load(Ordering::Relaxed) as usize);
    assert_eq!(stats.probes as usize, tried + rehearsed);
    assert!(tried < rehearsed, "{tried} probes after {rehearsed} rehearsals");
    assert!(of_draft > 0 && of_draft < graph.edge_count() as u64, "{of_draft} of {} edges", graph.edge_count());
    let side = |vertex| graph.position(vertex).x > 30.0;
    assert!(graph.edges().all(|edge| !side(edge.key.from) || side(edge.key.to)), "an edge leads back over the river");
    let router = Router::new(graph, 4096, 1);
    let find = |start, goal| router.find_path(&Query::new(start, goal)).no_path;
    let (west, east) = (Vec3::new(4.0, 1.0, 30.0), Vec3::new(56.0, 1.0, 30.0));
    assert_eq!([find(west, east), find(east, west)], [None, Some(surefoot_planner::NoPath::OneWay)]);
}

#[test]
fn edges_whose_ability_does_not_work_where_they_are_proved_are_dropped_untried() {
    let longest = |jumps| {
        let graph = build_rehearsed([&Hops { jumps }, &Hops { jumps: true }]).built.graph;
        assert_eq!(graph.connected_share(), 1.0);
        let length = |key: EdgeKey| graph.position(key.from).distance(graph.position(key.to));
        graph.edges().map(|edge| length(edge.key)).fold(0.0, f32::max)
    };
    assert!(longest(true) > 9.0);
    assert!(longest(false) <= 9.0);
}

#[test]
fn a_leg_that_succeeds_rarely_stays_if_nothing_else_leads_there() {
    let frugal = settings().with(|it| (it.probing, it.repeats) = (Probing::Frugal, 2)).unwrap();
    let Built { graph, .. } = build(&frugal, &Torrent::default(), &Progress::default()).unwrap();
    assert_eq!(graph.connected_share(), 1.0);
    let side = |vertex| graph.position(vertex).x > 30.0;
    let back: Vec<_> = graph.edges().filter(|edge| side(edge.key.from) && !side(edge.key.to)).collect();
    assert_eq!(back.len(), 1, "a second way back says nothing new");
    assert!(back[0].evidence.success_rate() < frugal.threshold);
    assert!(graph.edges().all(|edge| edge.key == back[0].key || edge.evidence.proves(frugal.threshold)));
}

#[test]
fn the_graph_is_bit_for_bit_the_same_as_before() {
    let frugal = settings()
        .with(|it| {
            it.probing = Probing::Frugal;
            it.vertices = 120;
            it.neighbours = 12;
            it.repeats = 2;
        })
        .unwrap();
    let built = build(&frugal, &River::default(), &Progress::default()).unwrap();
    let bytes = surefoot_planner::store::encode_entry(&built);
    // Change this hash only together with BUILDER_VERSION: otherwise outdated graphs are loaded from caches.
    assert_eq!(
        blake3::hash(&bytes).to_hex().as_str(),
        "d6c2c14082949bad8182c4fadae62cad3adb897610d6ce8dea46a376a6cd1d2a"
    );
    let id = GraphId::of(&site(), &PolicyHash::new("0123"), &frugal);
    assert_eq!(id.to_string(), "15341e1b5def0659ff0a69cde2ece0db52af28ab0ec07fb1f640885a26ae076a");
}

/// Legs succeed if the straight way lies on one of the rectangles, or passes from one to another.
struct Straight(Vec<[f32; 4]>);

impl ProbeExecutor for Straight {
    fn run(&self, trials: &[Trial], _: u64, watch: &dyn ProbeWatch) -> Option<Vec<Outcome>> {
        let is_floor =
            |at: Vec3| self.0.iter().any(|&[x0, z0, x1, z1]| (x0..=x1).contains(&at.x) && (z0..=z1).contains(&at.z));
        let walks = |trial: &Trial| (0..=200).all(|step| is_floor(trial.start.lerp(trial.goal, step as f32 / 200.0)));
        let straight = |trial: &Trial| Outcome { reached: walks(trial), ..outcome(&Trial { via: None, ..*trial }) };
        Some(show(trials.iter().map(straight).collect(), watch))
    }
}

#[test]
fn ways_round_corners_become_vertices_where_straight_legs_lead_nowhere() {
    // A corridor of 3 m that winds over the map.
    let winding: Vec<[f32; 4]> = (0..6)
        .flat_map(|row| {
            let z = row as f32 * 10.0 + 2.0;
            let x = if row % 2 == 0 { 55.0 } else { 2.0 };
            [[2.0, z, 58.0, z + 3.0], [x, z, x + 3.0, z + 13.0]]
        })
        .take(11)
        .collect();
    let (site, executor) = (floors(&winding), Straight(winding));
    let build = |settings: &BuildSettings| {
        let progress = Progress::default();
        let builder = Builder {
            site: &site,
            settings,
            executor: &executor,
            thread_count: 2,
            clock: &|| 0.0,
            progress: &progress,
        };
        builder.build().unwrap()
    };
    let plain = settings().with(|it| (it.probing, it.vertices) = (Probing::Frugal, 20)).unwrap();
    let without = build(&plain);
    assert!(without.graph.connected_share() < 0.5, "{}", without.graph.connected_share());
    let with = build(&plain.with(|it| it.special_moves = true).unwrap());
    assert_eq!(with.graph.connected_share(), 1.0);
    assert!(with.graph.vertex_count() <= 20 + 64, "{} vertices", with.graph.vertex_count());
}

#[test]
fn only_edges_beside_a_void_are_also_probed_on_the_run() {
    let frugal = settings().with(|it| it.probing = Probing::Frugal).unwrap();
    let on_the_run = |site: &Site| {
        let (executor, progress) = (River::default(), Progress::default());
        let builder = Builder {
            site,
            settings: &frugal,
            executor: &executor,
            thread_count: 2,
            clock: &|| 0.0,
            progress: &progress,
        };
        let Built { graph, .. } = builder.build().unwrap();
        let tried = executor.tried.into_inner().unwrap();
        (graph, tried.into_iter().filter(|trial| trial.via.is_some()).collect::<Vec<_>>())
    };
    assert_eq!(on_the_run(&site()).1, [], "no body can fall from the middle of a floor");
    // A gap of 4 m with a bridge of 2 m.
    let (graph, tried) =
        on_the_run(&floors(&[[0.0, 0.0, 28.0, 60.0], [32.0, 0.0, 60.0, 60.0], [28.0, 29.0, 32.0, 31.0]]));
    assert!(!tried.is_empty());
    for Trial { start, via, goal, .. } in &tried {
        let via = via.unwrap();
        assert!(start != goal, "nobody comes back at once");
        let (low, high) = (via.x.min(goal.x) - 1.6, via.x.max(goal.x) + 1.6);
        assert!(low < 32.0 && 28.0 < high, "{via} to {goal} is far from the gap");
    }
    let crossing = graph.edges().find(|edge| {
        let [from, to] = [edge.key.from, edge.key.to].map(|vertex| graph.position(vertex).x);
        from < 28.0 && to > 32.0
    });
    assert!(crossing.unwrap().evidence.tries >= 5, "one probe at rest and four on the run");
}

#[test]
fn only_what_changed_is_probed_again() {
    let settings = settings();
    let executor = River::default();
    let Built { graph, .. } = build(&settings, &executor, &Progress::default()).unwrap();
    let (site, before) = (site(), executor.tried.lock().unwrap().len());
    let progress = Progress::default();
    let builder = Builder {
        site: &site,
        settings: &settings,
        executor: &executor,
        thread_count: 1,
        clock: &|| 0.0,
        progress: &progress,
    };
    let same = builder.update(&graph, &site.map).unwrap();
    assert_eq!((same.retried, executor.tried.lock().unwrap().len()), (0, before), "nothing has changed");
    assert_eq!(same.built.graph.to_data(), graph.to_data());
    let step = [Vec3::new(10.0, 2.0, 10.0), Vec3::new(10.0, 2.0, 14.0), Vec3::new(14.0, 2.0, 10.0)];
    let triangles = site.map.mesh().triangles().iter().copied().chain(Triangle::new(step, Surface::Ground));
    let changed = Map::from_parts(site.map.size(), triangles.collect(), Placed::default());
    let site = Site::new(Arc::new(changed));
    let builder = Builder { site: &site, ..builder };
    let old = Site::new(self::site().map);
    let updated = builder.update(&graph, &old.map).unwrap();
    assert!(updated.retried > 0 && updated.retried * 2 < 240, "{} of 240 candidates", updated.retried);
}

#[test]
fn a_cancelled_build_and_an_invalid_setting_give_errors() {
    let progress = Progress::default();
    progress.cancel.store(true, Ordering::Relaxed);
    assert_eq!(build(&settings(), &River::default(), &progress).unwrap_err(), BuildError::Cancelled);
    assert_eq!(settings().with(|it| it.vertices = 1).unwrap_err().field, "vertices");
    assert!(EdgeKey::new(1, 2).reversed() == EdgeKey { from: VertexId(2), to: VertexId(1) });
}
