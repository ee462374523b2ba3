//! Proves candidate edges: short point-goal episodes of the policy, many at a time.

use crate::candidates::Candidate;
use crate::graph::{Ability, Evidence};
use rand::rngs::ChaCha8Rng;
use rand::{RngExt, SeedableRng};
use std::collections::VecDeque;
use std::sync::Arc;
use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, AtomicU64, AtomicUsize, Ordering};
use surefoot_policy::{Memories, Policy};
use surefoot_world::{CharacterProfile, End, Map, NpcSlot, OBSERVATION_LEN, TaskConfig, Vec3, World};

/// Candidates handed to a thread at a time: also the batch of the policy.
const CHUNK: usize = 192;
/// Decisions without progress after which a probe has failed.
const GIVE_UP_AFTER: u32 = 30;
/// Share of the policy's exploration noise that probes act with; the same as NPCs on their way.
pub const NOISE_SHARE: f32 = 0.5;

/// What a probe runs with.
#[derive(Debug, Clone)]
pub struct ProbeContext {
    /// On this map.
    pub map: Arc<Map>,
    /// As this character.
    pub profile: CharacterProfile,
    /// With this policy.
    pub policy: Policy,
}

/// Runs probes somewhere: here on all cores, or later on workers.
pub trait ProbeExecutor {
    /// Tries each candidate `repeats` times and returns one evidence per candidate, in their order.
    ///
    /// `progress` counts finished probes; when `cancel` is set, the rest is skipped.
    fn probe(&self, task: &ProbeTask<'_>, progress: &AtomicU64, cancel: &AtomicBool) -> Vec<Evidence>;
}

/// What to probe.
#[derive(Debug, Clone, Copy)]
pub struct ProbeTask<'a> {
    /// Positions of the vertices.
    pub vertices: &'a [Vec3],
    /// Pairs to try.
    pub candidates: &'a [Candidate],
    /// Tries for each.
    pub repeats: u32,
    /// Seed of headings and noise.
    pub seed: u64,
}

/// Probes in this process on all cores; equal results for any number of them.
#[derive(Debug, Clone)]
pub struct InProcess {
    /// What to run.
    pub context: ProbeContext,
    /// Threads to use.
    pub thread_count: usize,
}

impl ProbeExecutor for InProcess {
    fn probe(&self, task: &ProbeTask<'_>, progress: &AtomicU64, cancel: &AtomicBool) -> Vec<Evidence> {
        let chunks: Vec<&[Candidate]> = task.candidates.chunks(CHUNK).collect();
        let next = AtomicUsize::new(0);
        let results: Mutex<Vec<Option<Vec<Evidence>>>> = Mutex::new(vec![None; chunks.len()]);
        std::thread::scope(|scope| {
            for _ in 0..self.thread_count.max(1) {
                scope.spawn(|| {
                    loop {
                        let chunk_idx = next.fetch_add(1, Ordering::Relaxed);
                        let Some(chunk) = chunks.get(chunk_idx) else { return };
                        let evidence = probe_chunk(&self.context, task, chunk_idx, chunk, progress, cancel);
                        results.lock().expect("no probe panics")[chunk_idx] = Some(evidence);
                    }
                });
            }
        });
        let results = results.into_inner().expect("no probe panics");
        results.into_iter().flat_map(|evidence| evidence.expect("every chunk is probed")).collect()
    }
}

/// One running probe.
struct Running {
    slot: NpcSlot,
    candidate_idx: usize,
    ability: Ability,
}

fn probe_chunk(
    context: &ProbeContext,
    task: &ProbeTask<'_>,
    chunk_idx: usize,
    chunk: &[Candidate],
    progress: &AtomicU64,
    cancel: &AtomicBool,
) -> Vec<Evidence> {
    let mut rng = ChaCha8Rng::seed_from_u64(task.seed);
    rng.set_stream(chunk_idx as u64 + 1);
    let mut world = World::new(context.map.clone(), context.profile.clone(), TaskConfig::default());
    let mut evidence = vec![Evidence::default(); chunk.len()];
    let mut waiting: VecDeque<usize> = (0..task.repeats).flat_map(|_| 0..chunk.len()).collect();
    let mut running: Vec<Running> = Vec::new();
    let (mut observations, mut actions) = (Vec::new(), Vec::new());
    let mut memories = Memories::new(&context.policy);
    loop {
        while running.len() < CHUNK
            && let Some(candidate_idx) = waiting.pop_front()
        {
            let (from, to) = chunk[candidate_idx];
            let yaw = rng.random_range(-std::f32::consts::PI..std::f32::consts::PI);
            let slot = world.spawn(task.vertices[from as usize], yaw);
            world.set_goal(slot, task.vertices[to as usize]);
            memories.forget(slot.0 as usize);
            running.push(Running { slot, candidate_idx, ability: Ability::Walk });
        }
        if running.is_empty() || cancel.load(Ordering::Relaxed) {
            return evidence;
        }
        observations.resize(running.len() * OBSERVATION_LEN, 0.0);
        for (probe, row) in running.iter().zip(observations.chunks_exact_mut(OBSERVATION_LEN)) {
            world.observe(probe.slot, row);
        }
        let who = running.iter().map(|probe| probe.slot.0 as usize);
        memories.act(&context.policy, who, &observations, NOISE_SHARE, &mut rng, &mut actions);
        for (probe, action) in running.iter().zip(&actions) {
            world.decide(probe.slot, *action);
        }
        world.tick_decision();
        running.retain_mut(|probe| {
            let outcome = world.close_decision(probe.slot).expect("a probe has an episode");
            let npc = world.npc(probe.slot).expect("a probe has an NPC");
            probe.ability = probe.ability.max(Ability::used(npc.events));
            let episode = npc.episode.expect("a probe has an episode");
            let gave_up = (episode.stalled_decisions >= GIVE_UP_AFTER).then_some(End::NoProgress);
            let Some(end) = outcome.end.or(gave_up) else { return true };
            evidence[probe.candidate_idx].note(end == End::Reached, episode.decisions, probe.ability);
            progress.fetch_add(1, Ordering::Relaxed);
            world.despawn(probe.slot);
            false
        });
    }
}
