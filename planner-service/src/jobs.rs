//! Builds as those see them who start, watch, list and cancel them: operations with an id, which go on when nobody watches.

use crate::error::PlannerError;
use crate::hosted::Figures;
use crate::locks::POISON;
use std::collections::BTreeMap;
use std::fmt;
use std::sync::atomic::Ordering;
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant, SystemTime};
use surefoot_net::levels::MapSource;
use surefoot_planner::{BuildError, BuildSettings, GraphId, Progress};
use tokio::sync::watch;

/// How long a build is listed after it has ended.
const KEPT_FOR: Duration = Duration::from_secs(600);
/// Ended builds that are listed at most; the oldest are forgotten first.
const MAX_ENDED: usize = 256;

/// A build on this service.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct BuildId(u64);

impl BuildId {
    /// The id that [`Display`](fmt::Display) wrote.
    pub fn parse(text: &str) -> Option<Self> {
        let is_ours = text.len() == 16 && text.bytes().all(|digit| matches!(digit, b'0'..=b'9' | b'a'..=b'f'));
        u64::from_str_radix(text, 16).ok().filter(|_| is_ours).map(Self)
    }
}

impl fmt::Display for BuildId {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{:016x}", self.0)
    }
}

/// Where a build stands.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Stage {
    /// Waiting for its turn.
    Queued,
    /// Generating the map.
    Map,
    /// Placing vertices.
    Vertices,
    /// Running the policy along candidate edges.
    Probes,
    /// Storing the graph and preparing the search.
    Index,
    /// The graph is ready.
    Done,
    /// It failed.
    Failed,
    /// It was cancelled.
    Cancelled,
}

impl Stage {
    /// Whether nothing follows.
    pub fn is_end(self) -> bool {
        self >= Stage::Done
    }
}

/// What a build made.
#[derive(Debug, Clone)]
pub struct Made {
    /// The graph.
    pub graph: GraphId,
    /// Its figures when it was ready.
    pub figures: Figures,
}

#[derive(Debug, Clone)]
struct State {
    /// All stages up to now.
    stages: Vec<Stage>,
    end: Option<(Instant, Result<Made, PlannerError>)>,
}

/// A build.
#[derive(Debug)]
pub struct Job {
    /// Its id.
    pub id: BuildId,
    /// Where the map comes from.
    pub source: MapSource,
    /// What is built.
    pub settings: BuildSettings,
    /// When it was started.
    pub started: SystemTime,
    /// Probes done and to be done.
    pub progress: Progress,
    state: watch::Sender<State>,
}

impl Job {
    /// The stages that it has been in, the present one last.
    pub fn stages(&self) -> Vec<Stage> {
        let mut stages = self.state.borrow().stages.clone();
        self.note_probes(&mut stages);
        stages
    }

    /// Adds the stage of probes once they have begun: they are counted where they are run, which knows no stages.
    fn note_probes(&self, stages: &mut Vec<Stage>) {
        if stages.last() == Some(&Stage::Vertices) && self.progress.total.load(Ordering::Relaxed) > 0 {
            stages.push(Stage::Probes);
        }
    }

    /// How it ended, if it has.
    pub fn end(&self) -> Option<Result<Made, PlannerError>> {
        self.state.borrow().end.as_ref().map(|(_, end)| end.clone())
    }

    /// Resolves at the next change of stage.
    pub fn changes(&self) -> impl Future<Output = ()> + Send + 'static {
        let mut changes = self.state.subscribe();
        async move {
            // A job that is gone changes no more; it says so by its end.
            let _ = changes.changed().await;
        }
    }

    /// Resolves when it has been cancelled.
    pub(crate) async fn cancelled(&self) {
        let mut changes = self.state.subscribe();
        while !self.is_cancelled() {
            if changes.changed().await.is_err() {
                return;
            }
        }
    }

    /// Whether it is to stop.
    pub(crate) fn is_cancelled(&self) -> bool {
        self.progress.cancel.load(Ordering::Relaxed)
    }

    /// Asks it to stop.
    pub fn cancel(&self) {
        self.progress.cancel.store(true, Ordering::Relaxed);
        self.state.send_modify(|_| {});
    }

    pub(crate) fn enter(&self, stage: Stage) {
        self.state.send_modify(|state| {
            self.note_probes(&mut state.stages);
            state.stages.push(stage);
        });
    }

    pub(crate) fn finish(&self, end: Result<Made, PlannerError>) {
        let stage = match &end {
            Ok(_) => Stage::Done,
            Err(PlannerError::Build(BuildError::Cancelled)) => Stage::Cancelled,
            Err(_) => Stage::Failed,
        };
        self.state.send_modify(|state| {
            self.note_probes(&mut state.stages);
            state.stages.push(stage);
            state.end = Some((Instant::now(), end));
        });
    }

    fn has_ended(&self) -> bool {
        self.state.borrow().end.is_some()
    }

    fn key(&self) -> String {
        format!("{} {:?}", self.source.key(), self.settings)
    }
}

/// All builds of a service: those that run or wait, and those that ended lately.
#[derive(Debug, Default)]
pub struct Jobs {
    jobs: Mutex<BTreeMap<BuildId, Arc<Job>>>,
}

impl Jobs {
    /// The build of this graph that runs or waits, or a new one, of which the second value says so.
    ///
    /// # Errors
    /// If `limit` builds run or wait already.
    pub(crate) fn join(
        &self,
        source: MapSource,
        settings: BuildSettings,
        limit: usize,
    ) -> Result<(Arc<Job>, bool), PlannerError> {
        let mut jobs = self.jobs.lock().expect(POISON);
        forget_old(&mut jobs);
        let started = SystemTime::now();
        let since = started.duration_since(SystemTime::UNIX_EPOCH).unwrap_or_default();
        let last = jobs.last_key_value().map_or(0, |(id, _)| id.0);
        let job = Job {
            id: BuildId((since.as_micros() as u64).max(last + 1)),
            source,
            settings,
            started,
            progress: Progress::default(),
            state: watch::Sender::new(State { stages: vec![Stage::Queued], end: None }),
        };
        let open = || jobs.values().filter(|other| !other.has_ended());
        if let Some(same) = open().find(|other| !other.is_cancelled() && other.key() == job.key()) {
            return Ok((same.clone(), false));
        }
        if open().count() >= limit {
            return Err(PlannerError::TooManyBuilds(limit));
        }
        let job = Arc::new(job);
        jobs.insert(job.id, job.clone());
        Ok((job, true))
    }

    /// A build.
    ///
    /// # Errors
    /// If there is none of that id, or it ended too long ago.
    pub fn find(&self, id: &str) -> Result<Arc<Job>, PlannerError> {
        let found = BuildId::parse(id).and_then(|id| self.jobs.lock().expect(POISON).get(&id).cloned());
        found.ok_or_else(|| PlannerError::UnknownBuild(id.to_owned()))
    }

    /// All builds, the latest first.
    pub fn all(&self) -> Vec<Arc<Job>> {
        let mut jobs = self.jobs.lock().expect(POISON);
        forget_old(&mut jobs);
        jobs.values().rev().cloned().collect()
    }

    /// Builds that run or wait.
    pub fn open_count(&self) -> usize {
        self.jobs.lock().expect(POISON).values().filter(|job| !job.has_ended()).count()
    }
}

fn forget_old(jobs: &mut BTreeMap<BuildId, Arc<Job>>) {
    let ended_at = |job: &Job| job.state.borrow().end.as_ref().map(|(at, _)| *at);
    jobs.retain(|_, job| ended_at(job).is_none_or(|at| at.elapsed() < KEPT_FOR));
    let ended: Vec<BuildId> = jobs.values().filter(|job| job.has_ended()).map(|job| job.id).collect();
    for id in ended.iter().take(ended.len().saturating_sub(MAX_ENDED)) {
        jobs.remove(id);
    }
}
