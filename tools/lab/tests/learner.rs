//! A learner that is fed from elsewhere, with real processes: by environments of servers, and by actors. Each part is
//! killed again and again; training goes on, and no transition is stored twice.

use std::path::{Path, PathBuf};
use std::time::{Instant, SystemTime};
use surefoot_policy::{ActorConfig, Policy};
use surefoot_processes::{LIMIT, Process, free_address, output, wait_for};
use surefoot_train::{CollectorConfig, SacConfig, TrainConfig};

/// Kills in each test, unless the variable `SUREFOOT_KILLS` names another number.
const KILLS: usize = 8;

fn kills() -> usize {
    std::env::var("SUREFOOT_KILLS").map_or(KILLS, |text| text.parse().expect("a number of kills"))
}

pub fn start(args: &[&str]) -> Process {
    Process::spawn_silent(surefoot_processes::surefoot(args))
}

/// A small run that learns at once, writes checkpoints all the time and does not end by itself.
fn small_run(memory: usize) -> TrainConfig {
    TrainConfig {
        total_updates: u64::MAX,
        steps_per_round: 2,
        updates_per_round: 1,
        batch: 8,
        burn_in: if memory > 0 { 2 } else { 0 },
        learn: if memory > 0 { 4 } else { 1 },
        replay_capacity: 20_000,
        validate_every: u64::MAX,
        checkpoint_every: 8,
        validation_goals: 1,
        validation_seeds: vec![1000],
        stop_after: None,
        max_staleness: 1_000_000,
        sac: SacConfig {
            network: ActorConfig {
                ray_features: 8,
                hidden: 16,
                memory: std::num::NonZeroUsize::new(memory),
                sees_others: false,
            },
            decay_updates: None,
            ..SacConfig::default()
        },
        collector: CollectorConfig {
            map_seeds: vec![0, 1],
            map_side: 60,
            world_count: 1,
            npcs_per_world: 6,
            rounds_per_map: 40,
            near_goals: (2.0, 20.0),
            far_goals: (20.0, 30.0),
            give_up_after: 6,
            redirect_chance: 0.02,
            random_decisions: 100,
            ..CollectorConfig::default()
        },
        ..TrainConfig::default()
    }
}

/// A run in a folder of its own.
struct Bench {
    folder: tempfile::TempDir,
    run: String,
    config: String,
}

impl Bench {
    fn new(config: &TrainConfig) -> Self {
        let folder = tempfile::tempdir().unwrap();
        let path = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
        let (run, file) = (path("run"), path("config.json"));
        std::fs::write(&file, serde_json::to_vec(config).unwrap()).unwrap();
        Self { run, config: file, folder }
    }

    fn state(&self) -> PathBuf {
        self.folder.path().join("run/state.bin")
    }

    fn stamp(&self) -> Option<SystemTime> {
        std::fs::metadata(self.state()).and_then(|metadata| metadata.modified()).ok()
    }

    /// Starts the learner, or continues what it has begun.
    fn learn(&self, how: &[&str]) -> Process {
        let has_begun = Path::new(&self.run).join("config.json").exists();
        let first: &[&str] = if has_begun { &["--resume"] } else { &["--config", &self.config] };
        start(&[&["train", &self.run], first, how].concat())
    }

    /// Waits for checkpoints that hold what was collected after now.
    fn until_it_goes_on(&self, learner: &mut Process) {
        for _ in 0..2 {
            let (before, since) = (self.stamp(), Instant::now());
            while self.stamp() == before {
                assert!(since.elapsed() < LIMIT, "it does not go on");
                assert!(learner.is_running(), "the learner ended");
                std::thread::yield_now();
            }
        }
    }

    /// What the replay buffers hold.
    fn census(&self) -> serde_json::Value {
        let output = output(&["train", &self.run, "--inspect"]);
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        serde_json::from_slice(&output.stdout).expect("JSON")
    }

    /// Checks the books at the end.
    fn check(&self, buffers: u64) {
        let census = self.census();
        let count = |name: &str| census[name].as_u64().expect("a count");
        assert_eq!(count("buffers"), buffers);
        assert_eq!(count("twins"), 0, "no transition is there twice: {census}");
        assert_eq!(count("rows"), count("continues") + count("terminated") + count("boundaries"));
        assert!(count("continues") > 100 && count("terminated") > 0 && count("boundaries") > 0, "{census}");
        let newest = census["versions"][1].as_u64().unwrap();
        assert!(newest > 10, "weights were updated, and came to those who act: {census}");
        Policy::load(&Path::new(&self.run).join("last")).expect("whole weights");
    }
}

#[test]
fn a_learner_over_worlds_outlives_every_kill() {
    let bench = Bench::new(&small_run(4));
    let addresses = [free_address(), free_address()];
    let serve = |idx: usize| start(&["serve", "--listen", &addresses[idx].to_string()]);
    let mut servers = [serve(0), serve(1)];
    let worlds = addresses.each_ref().map(|address| format!("http://{address}")).join(",");
    let how = ["--worlds", &worlds, "--envs", "2"];
    // Unreachable addresses are reported before anything is written.
    addresses.iter().for_each(|&address| wait_for(address));
    let mut learner = bench.learn(&how);
    bench.until_it_goes_on(&mut learner);
    for kill in 0..kills() {
        if kill % 3 == 2 {
            drop(learner);
            learner = bench.learn(&["--worlds", &worlds]);
        } else {
            servers[kill % 3].restart();
        }
        bench.until_it_goes_on(&mut learner);
    }
    learner.stop();
    bench.check(4);
}

#[test]
fn a_learner_that_actors_feed_outlives_every_kill() {
    for memory in [0, 4] {
        let bench = Bench::new(&small_run(memory));
        let address = free_address().to_string();
        let learner_uri = format!("http://{address}");
        let how = ["--listen", &address, "--actors", "2", "--weights-every", "0.01"];
        let act = || start(&["act", "--learner", &learner_uri]);
        let mut learner = bench.learn(&how);
        let mut actors = [act(), act()];
        bench.until_it_goes_on(&mut learner);
        for kill in 0..kills() / 2 {
            match kill % 3 {
                2 => {
                    drop(learner);
                    learner = bench.learn(&how);
                }
                idx => {
                    actors[idx].restart();
                }
            }
            bench.until_it_goes_on(&mut learner);
        }
        learner.stop();
        bench.check(2);
    }
}

#[test]
fn an_actor_too_many_is_told_what_to_change() {
    let bench = Bench::new(&small_run(0));
    let address = free_address().to_string();
    let learner_uri = format!("http://{address}");
    let mut learner = bench.learn(&["--listen", &address, "--actors", "1"]);
    let _only = start(&["act", "--learner", &learner_uri]);
    bench.until_it_goes_on(&mut learner);
    let refused = output(&["act", "--learner", &learner_uri]);
    let message = String::from_utf8_lossy(&refused.stderr).into_owned();
    assert!(!refused.status.success() && message.contains("--actors"), "{message}");
    learner.stop();
}

#[test]
fn runs_that_cannot_be_fed_say_what_to_change() {
    let bench = Bench::new(&small_run(0));
    let nobody = format!("http://{}", free_address());
    let refusal = |args: &[&str]| {
        let output = output(&[&["train", &bench.run, "--config", &bench.config], args].concat());
        assert!(!output.status.success() && !Path::new(&bench.run).exists(), "nothing is written");
        String::from_utf8_lossy(&output.stderr).into_owned()
    };
    let away = refusal(&["--worlds", &nobody]);
    assert!(away.contains("cannot reach a game") && away.lines().count() == 1, "{away}");
    assert!(refusal(&["--listen", "127.0.0.1:0", "--actors", "5000"]).contains("actors: must be at most 1024"));
    let exposed = refusal(&["--listen", "0.0.0.0:0"]);
    assert!(exposed.contains("--tls-cert"), "{exposed}");
    let social =
        TrainConfig { collector: CollectorConfig { solid_npcs: true, ..small_run(0).collector }, ..small_run(0) };
    let bench = Bench::new(&social);
    let output = output(&["train", &bench.run, "--config", &bench.config, "--listen", "127.0.0.1:0"]);
    assert!(String::from_utf8_lossy(&output.stderr).contains("solid_npcs"), "they do not meet there");
}
