//! Builds as clients see them: operations with an id that clients start, watch, list and cancel. A build continues
//! when no client watches it.

use crate::config::PlannerConfig;
use crate::error::PlannerError;
use crate::figures::Figures;
use parking_lot::Mutex;
use std::collections::{BTreeMap, BTreeSet};
use std::fmt;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant, SystemTime};
use surefoot_net::levels::MapSource;
use surefoot_net::serving::Caller;
use surefoot_planner::{BuildError, BuildSettings, GraphId, Progress};
use surefoot_world::CharacterProfile;
use tokio::sync::watch;

/// Time for which a build is listed after it has ended.
const KEPT_FOR: Duration = Duration::from_secs(600);
/// Maximum number of ended builds that are listed; the oldest are removed first.
const MAX_ENDED: usize = 256;

/// Longest wait for a new build to be posted to other planners.
const KNOWN_WITHIN: Duration = Duration::from_secs(1);
/// Bits of a build id that identify the planner.
const SITE_BITS: u32 = 12;

/// Id of a build, unique among planners that share a store.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct BuildId(u64);

impl BuildId {
    /// Returns the id as a number.
    pub fn bits(self) -> u64 {
        self.0
    }

    /// Returns the id with this number.
    pub fn of_bits(bits: u64) -> Self {
        Self(bits)
    }

    /// Parses 16 lower-case hexadecimal digits, as [`Display`](fmt::Display) writes them; `None` for any other text.
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

/// Phase of a build.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum BuildPhase {
    /// Waiting for another build to end.
    Queued,
    /// Generating the map.
    Map,
    /// Placing vertices.
    Vertices,
    /// Running the policy along candidate edges.
    Probes,
    /// Storing the graph, applying layers and preparing the search.
    Index,
    /// The graph is ready.
    Done,
    /// The build failed.
    Failed,
    /// The build was cancelled.
    Cancelled,
}

impl BuildPhase {
    /// Returns whether this is a final phase.
    pub fn is_end(self) -> bool {
        self >= BuildPhase::Done
    }
}

#[derive(Debug, Clone)]
pub struct BuildResult {
    pub graph: GraphId,
    pub figures: Figures,
}

#[derive(Debug)]
pub(crate) struct State {
    /// All phases so far, the current one last.
    phases: Vec<BuildPhase>,
    /// Whether the build is posted to other planners, or need not be.
    is_known: bool,
    /// The graph, once plans can be made on it.
    usable: Option<GraphId>,
    /// When and how the build ended.
    end: Option<(Instant, Result<BuildResult, PlannerError>)>,
}

/// A build that is waiting, running or ended.
#[derive(Debug)]
pub struct Job {
    pub id: BuildId,
    pub source: MapSource,
    pub body: CharacterProfile,
    pub settings: BuildSettings,
    pub started: SystemTime,
    /// Probes that are done and to be done, and the request to cancel.
    pub progress: Arc<Progress>,
    /// Whether this planner runs the build; otherwise it follows the build of another planner.
    pub(crate) is_ours: AtomicBool,
    /// Whether the end of the build is posted to other planners.
    pub(crate) is_end_posted: AtomicBool,
    requesters: Mutex<Requesters>,
    state: watch::Sender<State>,
}

/// Name of this service among the requesters: builds that plans and edits need.
pub(crate) const SERVICE: &str = "";

/// The clients that wait for a build.
#[derive(Debug, Default)]
struct Requesters {
    names: BTreeSet<String>,
    /// Number of withdrawals through other planners that have been applied.
    noted: usize,
}

impl Job {
    fn new(
        id: BuildId,
        (source, body, settings): (MapSource, CharacterProfile, BuildSettings),
        started: SystemTime,
    ) -> Self {
        let state = State { phases: vec![BuildPhase::Queued], is_known: false, usable: None, end: None };
        Self {
            id,
            source,
            body,
            settings,
            started,
            progress: Arc::default(),
            is_ours: AtomicBool::new(false),
            is_end_posted: AtomicBool::new(false),
            requesters: Mutex::default(),
            state: watch::Sender::new(state),
        }
    }

    /// Returns all phases so far, the current one last.
    pub fn phases(&self) -> Vec<BuildPhase> {
        let mut phases = self.state.borrow().phases.clone();
        self.note_probes(&mut phases);
        phases
    }

    /// Adds [`BuildPhase::Probes`] once probes have begun. The builder counts probes and knows no phases.
    fn note_probes(&self, phases: &mut Vec<BuildPhase>) {
        if phases.last() == Some(&BuildPhase::Vertices) && self.progress.total.load(Ordering::Relaxed) > 0 {
            phases.push(BuildPhase::Probes);
        }
    }

    /// Returns the result; `None` while the build is running or waiting.
    pub fn end(&self) -> Option<Result<BuildResult, PlannerError>> {
        self.state.borrow().end.as_ref().map(|(_, end)| end.clone())
    }

    /// Returns the graph as soon as plans can be made on it, before the build has ended.
    pub fn usable(&self) -> Option<GraphId> {
        self.state.borrow().usable
    }

    /// Announces every change of phase after this call.
    pub(crate) fn changes(&self) -> watch::Receiver<State> {
        self.state.subscribe()
    }

    /// Resolves when the build is posted to other planners, or need not be.
    pub(crate) async fn known(&self) {
        let mut changes = self.state.subscribe();
        // An error means that the job was dropped. While the store is unavailable, the build is posted later.
        let _ = tokio::time::timeout(KNOWN_WITHIN, changes.wait_for(|state| state.is_known)).await;
    }

    /// Notes that the build is posted, or need not be.
    pub(crate) fn note_known(&self) {
        self.state.send_modify(|state| state.is_known = true);
    }

    /// Resolves when the build has ended.
    pub(crate) async fn ended(&self) {
        let mut changes = self.state.subscribe();
        // An error means that the job was dropped.
        let _ = changes.wait_for(|state| state.end.is_some()).await;
    }

    /// Resolves when the build has been cancelled.
    pub(crate) async fn cancelled(&self) {
        let mut changes = self.state.subscribe();
        // An error means that the job was dropped.
        let _ = changes.wait_for(|_| self.is_cancelled()).await;
    }

    /// Whether the build has been cancelled. It may take a moment to stop.
    pub(crate) fn is_cancelled(&self) -> bool {
        self.progress.cancel.load(Ordering::Relaxed)
    }

    /// Cancels the build; does nothing if it has ended.
    pub fn cancel(&self) {
        self.progress.cancel.store(true, Ordering::Relaxed);
        self.state.send_modify(|_| {});
    }

    /// Notes that a client waits for the build.
    pub(crate) fn add_requester(&self, client: &str) {
        self.requesters.lock().names.insert(client.to_owned());
    }

    /// Takes over the requesters of a build of another planner, and the number of its withdrawals.
    pub(crate) fn take_requesters(&self, names: &[String], withdrawn_count: usize) {
        let names = names.iter().cloned().collect();
        *self.requesters.lock() = Requesters { names, noted: withdrawn_count };
    }

    /// Returns the clients that wait for the build.
    pub(crate) fn requesters(&self) -> Vec<String> {
        self.requesters.lock().names.iter().cloned().collect()
    }

    /// Removes the requesters that `caller` may speak for. If none is left, the build is cancelled.
    pub(crate) fn withdraw(&self, caller: &Caller) -> Result<(), PlannerError> {
        let is_last = {
            let names = &mut self.requesters.lock().names;
            let count = names.len();
            names.retain(|name| !caller.may_change(name));
            if names.len() == count && !caller.may_change(SERVICE) {
                return Err(PlannerError::NotRequester(self.id.to_string()));
            }
            names.is_empty()
        };
        if is_last {
            self.cancel();
        }
        Ok(())
    }

    /// Applies the withdrawals through other planners, in their order.
    pub(crate) fn note_withdrawn(&self, withdrawn: &[String]) {
        let is_last = {
            let Requesters { names, noted } = &mut *self.requesters.lock();
            let new = withdrawn.get(*noted..).unwrap_or_default();
            names.retain(|name| !new.contains(name));
            *noted = withdrawn.len();
            !new.is_empty() && names.is_empty()
        };
        if is_last {
            self.cancel();
        }
    }

    pub(crate) fn enter(&self, phase: BuildPhase) {
        self.state.send_modify(|state| {
            self.note_probes(&mut state.phases);
            state.phases.push(phase);
        });
    }

    /// Enters a phase, unless the build has been in it already.
    pub(crate) fn reach(&self, phase: BuildPhase) {
        if self.phases().last().is_none_or(|latest| *latest < phase) {
            self.enter(phase);
        }
    }

    /// Restarts the count of probes, since the work of another planner is lost. The phase remains.
    pub(crate) fn forget_probes(&self) {
        self.state.send_modify(|state| self.note_probes(&mut state.phases));
        self.progress.done.store(0, Ordering::Relaxed);
        self.progress.total.store(0, Ordering::Relaxed);
    }

    /// Notes that plans can be made on the interim graph.
    pub(crate) fn note_usable(&self, graph: GraphId) {
        self.state.send_modify(|state| state.usable = Some(graph));
    }

    pub(crate) fn finish(&self, end: Result<BuildResult, PlannerError>) {
        let phase = match &end {
            Ok(_) => BuildPhase::Done,
            Err(PlannerError::Build(BuildError::Cancelled)) => BuildPhase::Cancelled,
            Err(_) => BuildPhase::Failed,
        };
        self.state.send_modify(|state| {
            self.note_probes(&mut state.phases);
            state.phases.push(phase);
            state.end = Some((Instant::now(), end));
        });
    }

    fn has_ended(&self) -> bool {
        self.state.borrow().end.is_some()
    }

    fn key(&self) -> String {
        format!("{} {:?} {:?}", self.source.key(), self.body, self.settings)
    }
}

/// All builds of a service: those that are running or waiting, and those that ended recently.
#[derive(Debug)]
pub struct Jobs {
    /// Distinguishes ids of planners that share a store.
    site: u64,
    jobs: Mutex<BTreeMap<BuildId, Arc<Job>>>,
}

impl Jobs {
    /// Creates an empty list. Ids contain `site`.
    pub fn new(site: u64) -> Self {
        Self { site: site & ((1 << SITE_BITS) - 1), jobs: Mutex::default() }
    }

    /// Returns the open build of this graph, or adds one. The second value says whether the build is new.
    pub(crate) fn find_or_add(
        &self,
        (source, body, settings): (MapSource, CharacterProfile, BuildSettings),
        client: &str,
        limits: &PlannerConfig,
    ) -> Result<(Arc<Job>, bool), PlannerError> {
        let mut jobs = self.jobs.lock();
        remove_ended(&mut jobs);
        let started = SystemTime::now();
        let since = started.duration_since(SystemTime::UNIX_EPOCH).unwrap_or_default();
        let last = jobs.last_key_value().map_or(0, |(id, _)| id.0);
        let now = (since.as_micros() as u64).max((last >> SITE_BITS) + 1);
        let id = BuildId((now << SITE_BITS) | self.site);
        let job = Job::new(id, (source, body, settings), started);
        let open = || jobs.values().filter(|other| !other.has_ended());
        if let Some(same) = open().find(|other| !other.is_cancelled() && other.key() == job.key()) {
            same.add_requester(client);
            return Ok((same.clone(), false));
        }
        if open().count() >= limits.max_builds {
            return Err(PlannerError::TooManyBuilds(limits.max_builds));
        }
        let is_own = |other: &&Arc<Job>| other.requesters.lock().names.contains(client);
        if client != SERVICE && open().filter(is_own).count() >= limits.max_builds_per_client {
            return Err(PlannerError::TooManyBuildsOfClient(limits.max_builds_per_client));
        }
        job.add_requester(client);
        let job = Arc::new(job);
        jobs.insert(job.id, job.clone());
        Ok((job, true))
    }

    /// Adds a build of another planner, or returns the one with this id. The second value says whether the build is
    /// new.
    pub(crate) fn follow(
        &self,
        id: BuildId,
        wanted: (MapSource, CharacterProfile, BuildSettings),
        started: SystemTime,
    ) -> (Arc<Job>, bool) {
        let mut jobs = self.jobs.lock();
        if let Some(job) = jobs.get(&id) {
            return (job.clone(), false);
        }
        let job = Arc::new(Job::new(id, wanted, started));
        jobs.insert(id, job.clone());
        (job, true)
    }

    /// Returns a build by its id.
    pub fn find(&self, id: &str) -> Result<Arc<Job>, PlannerError> {
        if id.is_empty() {
            return Err(PlannerError::NoBuildId);
        }
        let mut jobs = self.jobs.lock();
        remove_ended(&mut jobs);
        let found = BuildId::parse(id).and_then(|id| jobs.get(&id).cloned());
        found.ok_or_else(|| PlannerError::UnknownBuild(id.to_owned()))
    }

    /// Returns all builds, the latest first.
    pub fn all(&self) -> Vec<Arc<Job>> {
        let mut jobs = self.jobs.lock();
        remove_ended(&mut jobs);
        jobs.values().rev().cloned().collect()
    }

    /// Returns the number of builds that are running or waiting.
    pub fn open_count(&self) -> usize {
        self.jobs.lock().values().filter(|job| !job.has_ended()).count()
    }
}

/// Removes builds that ended too long ago, and the oldest ended ones beyond [`MAX_ENDED`].
fn remove_ended(jobs: &mut BTreeMap<BuildId, Arc<Job>>) {
    let ended_at = |job: &Job| job.state.borrow().end.as_ref().map(|(at, _)| *at);
    jobs.retain(|_, job| ended_at(job).is_none_or(|at| at.elapsed() < KEPT_FOR));
    let ended: Vec<BuildId> = jobs.values().filter(|job| job.has_ended()).map(|job| job.id).collect();
    for id in ended.iter().take(ended.len().saturating_sub(MAX_ENDED)) {
        jobs.remove(id);
    }
}
