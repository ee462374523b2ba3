//! Maps to generate as jobs: a prover stores the map as a blob and answers with its name.

use super::dispatch::{Dispatcher, Threads, Work};
use super::job::{Job, JobKind, Opened, Refusal, decode, encode};
use super::map_cache::MapCache;
use crate::blobs::BlobId;
use crate::error::FleetError;
use surefoot_world::MapSpec;

/// Generates the map of a job, stores it, and returns the name of the blob.
pub fn generate(job: &Opened, maps: &MapCache) -> Result<Vec<u8>, Refusal> {
    let spec: MapSpec = job.body().map_err(Refusal::impossible)?;
    let blobs = maps.blobs().ok_or_else(|| Refusal::unable("this process has no --blobs"))?;
    let map = surefoot_generate::generate_with(&spec, 1, |_| {});
    let saved = maps.runtime().block_on(blobs.put(surefoot_levels::encode(&map))).map_err(Refusal::unable)?;
    Ok(encode(&saved.0))
}

/// Maps to generate.
struct Maps<'a> {
    specs: &'a [MapSpec],
    maps: &'a MapCache,
    is_made: &'a (dyn Fn(usize) + Sync),
}

impl Work for Maps<'_> {
    /// The encoded map.
    type Output = Vec<u8>;

    fn run_locally(&self, idx: usize, _: &(dyn Fn() -> bool + Sync)) -> Option<Result<Vec<u8>, String>> {
        Some(Ok(surefoot_levels::encode(&surefoot_generate::generate_with(&self.specs[idx], 1, |_| {}))))
    }

    fn read(&self, idx: usize, result: &[u8]) -> Result<Vec<u8>, String> {
        let blob: [u8; 32] = decode(result).map_err(|damage| damage.to_string())?;
        let bytes = self.maps.fetch(BlobId(blob)).map_err(|refusal| refusal.reason)?;
        let map = surefoot_levels::decode(&bytes).map_err(|error| error.to_string())?;
        if map.spec() != Some(&self.specs[idx]) {
            return Err("the map of another spec".to_owned());
        }
        Ok(bytes)
    }

    fn settled(&self, idx: usize, _: &Vec<u8>) {
        (self.is_made)(idx);
    }
}

/// Generates maps on provers and on `threads` of this process. Returns them encoded, in order. `is_made` is called for
/// each finished map. Call this from a thread that may block.
pub fn generate_all(
    dispatcher: &Dispatcher,
    maps: &MapCache,
    specs: &[MapSpec],
    threads: Threads,
    is_made: &(dyn Fn(usize) + Sync),
) -> Result<Vec<Vec<u8>>, FleetError> {
    let jobs = (0..).zip(specs).map(|(place, spec)| Job::new(JobKind::Map, place, spec)).collect();
    let made = dispatcher.run(jobs, &Maps { specs, maps, is_made }, threads)?;
    Ok(made.expect("maps are never cancelled"))
}
