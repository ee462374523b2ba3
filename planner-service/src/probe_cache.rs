//! What edits of the vertices of a graph have proved: where characters stand, and the evidence of candidate edges. A
//! further edit costs only its own probes, and none if it adds and moves no vertices.

use crate::origin::Origin;
use parking_lot::Mutex;
use std::collections::HashMap;
use std::sync::{Arc, OnceLock};
use surefoot_planner::Progress;
use surefoot_planner::candidates::Candidate;
use surefoot_planner::edits::{MapTerrain, Terrain};
use surefoot_planner::evidence::Evidence;
use surefoot_rollout::graphs;
use surefoot_rollout::probe::ProbeContext;
use surefoot_world::Vec3;

/// Maximum number of entries. Then those that the latest edit does not need are dropped.
const MAX_ENTRIES: usize = 1 << 17;

/// A position by its bits.
type Place = [u32; 3];

/// Results of earlier edits of one graph.
#[derive(Debug, Default)]
pub struct ProbeCache {
    evidence: Mutex<HashMap<(Candidate, Place, Place), Evidence>>,
    standing: Mutex<HashMap<Place, Option<Vec3>>>,
}

impl ProbeCache {
    /// Returns the map of a graph as edits need it. Cancelling `progress` ends its probes.
    pub fn terrain<'a>(&'a self, origin: &'a Origin, progress: &'a Arc<Progress>) -> impl Terrain + use<'a> {
        LazyTerrain { origin, progress, cache: self, terrain: OnceLock::new() }
    }
}

/// The map of a graph, generated when an edit needs a result that is not cached.
struct LazyTerrain<'a> {
    origin: &'a Origin,
    progress: &'a Arc<Progress>,
    cache: &'a ProbeCache,
    terrain: OnceLock<MapTerrain>,
}

impl LazyTerrain<'_> {
    fn terrain(&self) -> &MapTerrain {
        self.terrain.get_or_init(|| {
            let Origin { source, body, policy, settings, thread_count, .. } = self.origin;
            let context = ProbeContext { map: source.map(), profile: body.clone(), policy: policy.clone() };
            let terrain = graphs::terrain(&context, *settings, *thread_count);
            MapTerrain { progress: self.progress.clone(), ..terrain }
        })
    }
}

impl Terrain for LazyTerrain<'_> {
    fn stand(&self, place: Vec3) -> Option<Vec3> {
        let key = bits(place);
        if let Some(known) = self.cache.standing.lock().get(&key) {
            return *known;
        }
        let feet = self.terrain().stand(place);
        let mut standing = self.cache.standing.lock();
        if standing.len() >= MAX_ENTRIES {
            standing.clear();
        }
        standing.insert(key, feet);
        feet
    }

    fn prove(&self, vertices: &[Vec3], candidates: &[Candidate]) -> Option<Vec<Evidence>> {
        let key = |candidate: &Candidate| {
            (*candidate, bits(vertices[candidate.from.idx()]), bits(vertices[candidate.to.idx()]))
        };
        let known: Vec<Option<Evidence>> = {
            let evidence = self.cache.evidence.lock();
            candidates.iter().map(|candidate| evidence.get(&key(candidate)).copied()).collect()
        };
        let is_new = |(candidate, known): (&Candidate, &Option<Evidence>)| known.is_none().then_some(*candidate);
        let new: Vec<Candidate> = candidates.iter().zip(&known).filter_map(is_new).collect();
        let proved = if new.is_empty() { Vec::new() } else { self.terrain().prove(vertices, &new)? };
        let mut proved = proved.into_iter();
        let all: Vec<Evidence> = known
            .into_iter()
            .map(|known| known.unwrap_or_else(|| proved.next().expect("evidence for each candidate")))
            .collect();
        let mut evidence = self.cache.evidence.lock();
        if evidence.len() + new.len() > MAX_ENTRIES {
            evidence.clear();
        }
        evidence.extend(candidates.iter().map(key).zip(all.iter().copied()));
        Some(all)
    }
}

fn bits(place: Vec3) -> Place {
    place.to_array().map(f32::to_bits)
}
