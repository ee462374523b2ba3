//! Probes as jobs: a job is one chunk of trials. Here are both ends: the executor of a build ([`QueuedProvers`]) and
//! the work of a prover ([`prove`]).

use super::dispatch::{Dispatcher, Threads, Work};
use super::job::{Job, JobKind, Opened, Refusal, decode, encode};
use super::map_cache::{MapCache, MapRef};
use crate::blobs::Blobs;
use parking_lot::Mutex;
use serde::{Deserialize, Serialize};
use surefoot_net::levels::BaseMap;
use surefoot_planner::needs::{Need, Needs};
use surefoot_planner::probe::{Outcome, ProbeExecutor, ProbeWatch, Trial};
use surefoot_planner_service::provers::{BuildProbes, Embedded, ProbeWork, Provers};
use surefoot_policy::Policy;
use surefoot_rollout::probe::{MAX_CHUNK, ProbeContext, chunks, in_order};
use surefoot_world::map::Mover;
use surefoot_world::{Ability, CharacterProfile, Map, MoverAt, MoverId, StopIdx, Vec3};
use tracing::warn;

/// Distance from the map within which positions of trials may lie, m: bodies fall out of maps.
const MARGIN_M: f32 = 1000.0;

/// A chunk of trials, with everything that their outcomes depend on.
#[derive(Debug, Clone, Serialize, Deserialize)]
struct Probes {
    map: MapRef,
    profile: CharacterProfile,
    policy: String,
    senses_transports: bool,
    seed: u64,
    trials: Vec<Trial>,
}

/// An outcome without its approach.
#[derive(Debug, Clone, Serialize, Deserialize)]
struct Leg {
    reached: bool,
    died: bool,
    decisions: u32,
    ability: Ability,
    bounds: [Vec3; 2],
    track: Vec<Option<Vec3>>,
    needs: Needs,
}

/// An outcome as it is sent. There is at most one approach, which has none itself.
#[derive(Debug, Clone, Serialize, Deserialize)]
struct Reported {
    leg: Leg,
    approach: Option<Leg>,
}

impl Leg {
    fn of(outcome: &Outcome) -> Self {
        let Outcome { reached, died, decisions, ability, bounds, needs, .. } = *outcome;
        Self { reached, died, decisions, ability, bounds, track: outcome.track.clone(), needs }
    }

    /// Returns the reported outcome, if it is possible for this trial.
    fn checked(self, trial: &Trial, map: &Map) -> Option<Outcome> {
        let Self { reached, died, decisions, ability, bounds, track, needs } = self;
        let is_known = |need: Need| {
            let mover = map.movers().get(need.mover.idx());
            mover.is_some_and(|mover| need.stops.difference(mover.all_stops()).is_empty())
        };
        let is_possible = bounds.iter().chain(track.iter().flatten()).all(|corner| corner.is_finite())
            && bounds[0].cmple(bounds[1]).all()
            && needs.iter().all(is_known)
            && needs.are_possible()
            && needs.ride == trial.ride
            && (trial.keep_track || track.is_empty());
        is_possible.then_some(Outcome { reached, died, decisions, ability, bounds, track, needs, approach: None })
    }
}

impl Reported {
    fn of(outcome: &Outcome) -> Self {
        Self { leg: Leg::of(outcome), approach: outcome.approach.as_deref().map(Leg::of) }
    }

    fn checked(self, trial: &Trial, map: &Map) -> Option<Outcome> {
        let approach = self.approach.map(|leg| leg.checked(trial, map));
        if approach.is_some() && trial.via.is_none() {
            return None;
        }
        let mut outcome = self.leg.checked(trial, map)?;
        outcome.approach = match approach {
            None => None,
            Some(approach) => Some(Box::new(approach?)),
        };
        Some(outcome)
    }
}

/// Never cancels.
struct Unwatched;

impl ProbeWatch for Unwatched {
    fn finished(&self, _: usize, _: &Outcome) {}

    fn is_cancelled(&self) -> bool {
        false
    }
}

/// Runs the probes of a job with this policy. Returns their encoded outcomes and their number.
pub fn prove(job: &Opened, policy: &Policy, maps: &MapCache) -> Result<(Vec<u8>, usize), Refusal> {
    let probes: Probes = job.body().map_err(Refusal::impossible)?;
    if probes.policy != policy.weights_hash() {
        return Err(Refusal::unable("this prover has another policy"));
    }
    let policy = if probes.senses_transports { policy.clone() } else { policy.clone().without_transports() };
    let map = maps.map(&probes.map)?;
    probes.check(&map).map_err(Refusal::impossible)?;
    let context = ProbeContext { map, profile: probes.profile, policy };
    let outcomes = context.run_chunk(&probes.trials, probes.seed, &Unwatched).expect("Unwatched never cancels");
    let reports: Vec<Reported> = outcomes.iter().map(Reported::of).collect();
    Ok((encode(&reports), reports.len()))
}

impl Probes {
    /// Checks that the trials can be run on their map.
    fn check(&self, map: &Map) -> Result<(), String> {
        let Some(first) = self.trials.first() else { return Err("no trials".to_owned()) };
        if self.trials.len() > MAX_CHUNK {
            return Err(format!("{} trials, at most {MAX_CHUNK} are allowed", self.trials.len()));
        }
        let (low, high) = (Vec3::splat(-MARGIN_M), map.extent() + MARGIN_M);
        let is_near = |point: Vec3| point.is_finite() && point.cmpge(low).all() && point.cmple(high).all();
        let mover = |id: MoverId| map.movers().get(id.idx());
        let has = |mover: &Mover, stop: StopIdx| stop.idx() < mover.stops.len();
        for (idx, trial) in self.trials.iter().enumerate() {
            let points = [Some(trial.start), trial.via, Some(trial.goal)];
            let is_held = trial
                .held
                .is_none_or(|MoverAt { mover: held, stop }| mover(held).is_some_and(|mover| has(mover, stop)));
            let rides = trial
                .ride
                .is_none_or(|ride| mover(ride.mover).is_some_and(|mover| has(mover, ride.from) && has(mover, ride.to)));
            if trial.held != first.held || !is_held || !rides || !points.into_iter().flatten().all(is_near) {
                return Err(format!("trial {idx} cannot be run on this map"));
            }
        }
        Ok(())
    }
}

/// Runs the probes of builds on provers, and on threads of this process.
#[derive(Debug, Clone)]
pub struct QueuedProvers {
    /// Sends the jobs.
    pub dispatcher: Dispatcher,
    /// Stores imported levels for provers. Without it, their probes are run in this process.
    pub blobs: Option<Blobs>,
    /// Number of threads of this process while provers answer; otherwise, all threads of the build.
    pub beside_provers: usize,
}

impl Provers for QueuedProvers {
    fn enlist(&self, work: ProbeWork) -> Box<dyn BuildProbes> {
        let runtime = &self.dispatcher.queue().runtime;
        let name = match work.source.base() {
            _ if !work.source.pieces().is_empty() => None,
            BaseMap::Spec(spec) => Some(MapRef::Spec(*spec)),
            BaseMap::Level(level) => match runtime.block_on(MapRef::save(&level.map, self.blobs.as_ref())) {
                Ok(name) => Some(name),
                Err(error) => {
                    warn!(%error, "planner: cannot store a level for provers; this process runs its probes");
                    None
                }
            },
        };
        match name {
            Some(map) => Box::new(self.probes(work.context, map, work.thread_count)),
            None => Embedded.enlist(work),
        }
    }

    fn metrics(&self) -> String {
        self.dispatcher.metrics()
    }
}

impl QueuedProvers {
    /// Returns the probes of a build on a map.
    pub fn probes(&self, context: ProbeContext, map: MapRef, thread_count: usize) -> QueuedProbes {
        let threads = Threads { beside_provers: self.beside_provers.min(thread_count), alone: thread_count };
        QueuedProbes { dispatcher: self.dispatcher.clone(), context, map, threads, failure: Mutex::default() }
    }
}

/// The probes of one build.
#[derive(Debug)]
pub struct QueuedProbes {
    dispatcher: Dispatcher,
    context: ProbeContext,
    map: MapRef,
    threads: Threads,
    failure: Mutex<Option<String>>,
}

impl BuildProbes for QueuedProbes {
    fn failure(&self) -> Option<String> {
        self.failure.lock().clone()
    }
}

impl ProbeExecutor for QueuedProbes {
    fn run(&self, trials: &[Trial], seed: u64, watch: &dyn ProbeWatch) -> Option<Vec<Outcome>> {
        let chunks = chunks(trials);
        let chunk = |chunk: &Vec<usize>| chunk.iter().map(|&idx| trials[idx]).collect::<Vec<Trial>>();
        let work =
            Run { context: &self.context, chunks: &chunks, trials: chunks.iter().map(chunk).collect(), seed, watch };
        let jobs = self.jobs(&work);
        match self.dispatcher.run(jobs, &work, self.threads) {
            Ok(outcomes) => Some(in_order(&chunks, outcomes?)),
            Err(error) => {
                *self.failure.lock() = Some(error.to_string());
                None
            }
        }
    }
}

impl QueuedProbes {
    fn jobs(&self, work: &Run<'_>) -> Vec<Job> {
        let ProbeContext { profile, policy, .. } = &self.context;
        let job = |(place, trials): (u32, &Vec<Trial>)| {
            let probes = Probes {
                map: self.map.clone(),
                profile: profile.clone(),
                policy: policy.weights_hash().to_owned(),
                senses_transports: policy.senses_transports(),
                seed: work.seed,
                trials: trials.clone(),
            };
            Job::new(JobKind::Probes, place, &probes)
        };
        (0..).zip(&work.trials).map(job).collect()
    }

    /// Returns the size of the jobs of these trials, bytes.
    pub fn job_bytes(&self, trials: &[Trial], seed: u64) -> usize {
        let chunks = chunks(trials);
        let chunk = |chunk: &Vec<usize>| chunk.iter().map(|&idx| trials[idx]).collect::<Vec<Trial>>();
        let trials = chunks.iter().map(chunk).collect();
        let work = Run { context: &self.context, chunks: &chunks, trials, seed, watch: &Unwatched };
        self.jobs(&work).iter().map(|job| job.bytes.len()).sum()
    }
}

/// Returns the size of the results of these outcomes, bytes.
pub fn result_bytes(outcomes: &[Outcome]) -> usize {
    encode(&outcomes.iter().map(Reported::of).collect::<Vec<_>>()).len()
}

/// The trials of one call of the executor.
struct Run<'a> {
    context: &'a ProbeContext,
    /// Indices of the trials of each chunk.
    chunks: &'a [Vec<usize>],
    /// The trials of each chunk.
    trials: Vec<Vec<Trial>>,
    seed: u64,
    watch: &'a dyn ProbeWatch,
}

/// Stops a chunk when a prover has settled it. Outcomes are reported when the chunk is settled, each once.
struct Until<'a> {
    is_settled: &'a (dyn Fn() -> bool + Sync),
}

impl ProbeWatch for Until<'_> {
    fn finished(&self, _: usize, _: &Outcome) {}

    fn is_cancelled(&self) -> bool {
        (self.is_settled)()
    }
}

impl Work for Run<'_> {
    type Output = Vec<Outcome>;

    fn run_locally(&self, idx: usize, is_settled: &(dyn Fn() -> bool + Sync)) -> Option<Result<Vec<Outcome>, String>> {
        self.context.run_chunk(&self.trials[idx], self.seed, &Until { is_settled }).map(Ok)
    }

    fn read(&self, idx: usize, result: &[u8]) -> Result<Vec<Outcome>, String> {
        let reports: Vec<Reported> = decode(result).map_err(|damage| damage.to_string())?;
        let trials = &self.trials[idx];
        if reports.len() != trials.len() {
            return Err(format!("{} outcomes of {} trials", reports.len(), trials.len()));
        }
        let checked = |(report, trial): (Reported, &Trial)| report.checked(trial, &self.context.map);
        let outcomes: Option<Vec<Outcome>> = reports.into_iter().zip(trials).map(checked).collect();
        outcomes.ok_or_else(|| "an outcome that cannot be".to_owned())
    }

    fn settled(&self, idx: usize, outcomes: &Vec<Outcome>) {
        for (&trial, outcome) in self.chunks[idx].iter().zip(outcomes) {
            self.watch.finished(trial, outcome);
        }
    }

    fn is_cancelled(&self) -> bool {
        self.watch.is_cancelled()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use surefoot_planner::Ride;
    use surefoot_world::{MapSpec, StopSet};

    fn probes(policy: &Policy, change: impl FnOnce(&mut Probes)) -> Opened {
        let spec = MapSpec::with_side(7, 50).unwrap();
        let trial = Trial::walk(Vec3::new(10.0, 40.0, 10.0), Vec3::new(14.0, 40.0, 10.0), 1);
        let mut probes = Probes {
            map: MapRef::Spec(spec),
            profile: CharacterProfile::default(),
            policy: policy.weights_hash().to_owned(),
            senses_transports: true,
            seed: 0,
            trials: vec![trial; 3],
        };
        change(&mut probes);
        Job::open(&Job::new(JobKind::Probes, 0, &probes).bytes).unwrap()
    }

    #[tokio::test]
    async fn probes_that_cannot_be_run_are_refused() {
        let policy = Policy::shipped().unwrap();
        let maps = MapCache::new(None);
        let (result, count) = prove(&probes(&policy, |_| {}), &policy, &maps).unwrap();
        let reports: Vec<Reported> = decode(&result).unwrap();
        assert_eq!((count, reports.len()), (3, 3));
        type Change = fn(&mut Probes);
        let changes: [(&str, bool, Change); 9] = [
            ("another policy", false, |it| it.policy.clear()),
            ("no store", false, |it| it.map = MapRef::Saved { map: [1; 32], blob: [2; 32] }),
            ("no trials", true, |it| it.trials.clear()),
            ("too many trials", true, |it| it.trials = vec![it.trials[0]; MAX_CHUNK + 1]),
            ("nowhere", true, |it| it.trials[1].goal.x = f32::NAN),
            ("far away", true, |it| it.trials[2].start.y = 1.0e30),
            ("by a far place", true, |it| it.trials[0].via = Some(Vec3::INFINITY)),
            ("a mover that is not there", true, |it| {
                it.trials.iter_mut().for_each(|it| it.held = Some(MoverAt { mover: MoverId(3), stop: StopIdx(0) }))
            }),
            ("a ride on it", true, |it| {
                it.trials[0].ride = Some(Ride { mover: MoverId(0), from: StopIdx(0), to: StopIdx(1) })
            }),
        ];
        for (what, is_final, change) in changes {
            let refusal = prove(&probes(&policy, change), &policy, &maps).unwrap_err();
            assert_eq!(refusal.is_final, is_final, "{what}: {}", refusal.reason);
        }
    }

    #[test]
    fn outcomes_that_cannot_be_are_refused() {
        let map = surefoot_generate::generate(&MapSpec::with_side(7, 50).unwrap());
        let start = Vec3::new(10.0, 40.0, 10.0);
        let trial = |via| Trial { via, ..Trial::walk(start, start, 0) };
        let mut outcome = Outcome { reached: true, decisions: 7, ..Outcome::begin(start) };
        let checked = |outcome: &Outcome, trial: &Trial| {
            let reported: Reported = decode(&encode(&Reported::of(outcome))).unwrap();
            reported.checked(trial, &map)
        };
        assert_eq!(checked(&outcome, &trial(None)).as_ref(), Some(&outcome));
        outcome.approach = Some(Box::new(Outcome::begin(start)));
        assert_eq!(checked(&outcome, &trial(Some(start))).as_ref(), Some(&outcome));
        assert_eq!(checked(&outcome, &trial(None)), None, "no approach was to be made");
        outcome.approach = None;
        let wrong: [fn(&mut Outcome); 4] = [
            |it| it.bounds[0].y = f32::NAN,
            |it| it.bounds[0].x = it.bounds[1].x + 1.0,
            |it| it.track.push(None),
            |it| it.needs.add(Need { mover: MoverId(0), stops: StopSet(1) }),
        ];
        for change in wrong {
            let mut changed = outcome.clone();
            change(&mut changed);
            assert_eq!(checked(&changed, &trial(None)), None, "{changed:?}");
        }
    }
}
