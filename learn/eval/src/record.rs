//! Records: the attempts behind a table, one line for each unit, kept so that anyone can derive the table from them
//! again and make parts of them again.

use super::unit::{Batch, Unit};
use flate2::Compression;
use flate2::read::GzDecoder;
use flate2::write::GzEncoder;
use parking_lot::{Mutex, MutexGuard};
use rand::rngs::ChaCha8Rng;
use rand::{RngExt, SeedableRng};
use serde::{Deserialize, Serialize};
use std::collections::{BTreeMap, BTreeSet};
use std::io::{BufRead, BufReader, Read, Write};
use surefoot_planner::settings::BUILDER_VERSION;
use surefoot_policy::Policy;
use surefoot_rollout::AttemptResult;
use surefoot_world::End;

/// Most bytes that a record may have when it is unpacked.
const MAX_BYTES: u64 = 4 << 30;
/// Probability below which a difference counts as significant.
const SIGNIFICANT: f64 = 0.01;

/// A unit with the key of everything that determines its result.
#[derive(Serialize, Deserialize)]
struct Line {
    key: String,
    unit: Unit,
}

/// The units of a table: written while it is made, or read to check it.
#[derive(Debug)]
pub struct Record {
    /// Version of the builder of the units' graphs.
    builder: u32,
    units: Mutex<BTreeMap<String, Unit>>,
    /// Share of batches to repeat, and the seed of the choice; `None` while a table is made.
    sample: Option<(f64, u64)>,
    comparison: Mutex<Comparison>,
    models: Mutex<BTreeSet<Model>>,
}

/// A model that a table was made with.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
pub struct Model {
    /// Name.
    pub name: String,
    /// Hash of the weights.
    pub weights: String,
}

/// Repeated attempts, compared with the recorded ones.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Comparison {
    /// Number of units that the table is made of.
    pub units: usize,
    /// Number of repeated batches.
    pub batches: usize,
    /// Number of their attempts.
    pub attempts: usize,
    /// Attempts that equal the recorded ones in every field.
    pub identical: usize,
    /// Attempts that succeeded when recorded and failed now.
    pub lost: usize,
    /// Attempts that failed when recorded and succeeded now.
    pub gained: usize,
}

impl Comparison {
    /// Probability of a difference in success as large as this one or larger, if either outcome of attempts that differ
    /// was equally likely (the exact test of McNemar).
    pub fn chance(&self) -> f64 {
        let (few, n) = (self.lost.min(self.gained), self.lost + self.gained);
        // Sum of the binomial coefficients up to `few`, over 2^n.
        let mut term = 0.5f64.powi(n as i32);
        let mut sum = 0.0;
        for idx in 0..=few {
            sum += term;
            term *= (n - idx) as f64 / (idx + 1) as f64;
        }
        (2.0 * sum).min(1.0)
    }

    /// Whether what was made again agrees with the record: the same attempts, or others by chance, as on a processor
    /// that rounds otherwise.
    pub fn agrees(&self) -> bool {
        self.chance() >= SIGNIFICANT
    }

    fn add(&mut self, recorded: &[AttemptResult], again: &[AttemptResult]) {
        self.batches += 1;
        for (recorded, again) in recorded.iter().zip(again) {
            let [was, is] = [recorded, again].map(|it| it.end == End::Reached);
            self.attempts += 1;
            self.identical += usize::from(recorded == again);
            self.lost += usize::from(was && !is);
            self.gained += usize::from(is && !was);
        }
    }
}

/// Why a record cannot be read, or lacks units of a table.
#[derive(Debug, thiserror::Error)]
pub enum RecordError {
    /// The file is not a record.
    #[error("the record of attempts is damaged at line {line}")]
    Damaged {
        /// Number of the line, from 1.
        line: usize,
        /// What is wrong with it.
        #[source]
        source: std::io::Error,
    },
    /// A unit of the table is not recorded.
    #[error(
        "the record has no unit {0}: other weights, maps, settings or a builder of another version made this table"
    )]
    Missing(String),
}

impl Default for Record {
    fn default() -> Self {
        Self::new()
    }
}

impl Record {
    /// A record for the units of a new table.
    pub fn new() -> Self {
        Self {
            builder: BUILDER_VERSION,
            units: Mutex::default(),
            sample: None,
            comparison: Mutex::default(),
            models: Mutex::default(),
        }
    }

    /// Version of the builder of the units' graphs.
    pub fn builder(&self) -> u32 {
        self.builder
    }

    /// Reads a record to check it, whose graphs are of this version of the builder: `share` of its batches (0 to 1),
    /// chosen with `seed`, are repeated.
    ///
    /// # Errors
    /// If `file` is not a record.
    pub fn read(file: impl Read, share: f64, seed: u64, builder: u32) -> Result<Self, RecordError> {
        let mut units = BTreeMap::new();
        let lines = BufReader::new(GzDecoder::new(file).take(MAX_BYTES)).lines();
        for (idx, line) in lines.enumerate() {
            let damaged = |source| RecordError::Damaged { line: idx + 1, source };
            let Line { key, unit } = serde_json::from_str(&line.map_err(damaged)?).map_err(|it| damaged(it.into()))?;
            units.insert(key, unit);
        }
        Ok(Self { builder, units: Mutex::new(units), sample: Some((share, seed)), ..Self::new() })
    }

    /// Writes all units, in the order of their keys.
    ///
    /// # Errors
    /// If `file` cannot be written.
    pub fn write(&self, file: impl Write) -> std::io::Result<()> {
        let mut packed = GzEncoder::new(file, Compression::best());
        for (key, unit) in self.units().iter() {
            serde_json::to_writer(&mut packed, &Line { key: key.clone(), unit: unit.clone() })?;
            packed.write_all(b"\n")?;
        }
        packed.finish()?.flush()
    }

    /// The comparison so far.
    pub fn comparison(&self) -> Comparison {
        self.comparison.lock().clone()
    }

    /// Number of units.
    pub fn len(&self) -> usize {
        self.units().len()
    }

    /// Whether there are no units.
    pub fn is_empty(&self) -> bool {
        self.units().is_empty()
    }

    /// Whether tables are derived from this record instead of new attempts.
    pub fn is_checked(&self) -> bool {
        self.sample.is_some()
    }

    /// The models of the added units, in the order of their names.
    pub fn models(&self) -> Vec<Model> {
        self.models.lock().iter().cloned().collect()
    }

    pub(super) fn add(&self, policy: &Policy, key: &str, unit: &Unit) {
        let model = Model { name: policy.manifest().name.clone(), weights: policy.weights_hash().to_owned() };
        self.models.lock().insert(model);
        self.units().insert(key.to_owned(), unit.clone());
    }

    /// The recorded unit, and the batches of it to repeat.
    pub(super) fn look_up(&self, key: &str) -> Result<(Unit, Vec<Batch>), RecordError> {
        let unit = self.units().get(key).cloned().ok_or_else(|| RecordError::Missing(key.to_owned()))?;
        let (share, seed) = self.sample.unwrap_or_default();
        let hash = blake3::hash(format!("{seed} {key}").as_bytes());
        let mut rng = ChaCha8Rng::from_seed(*hash.as_bytes());
        let batches = Batch::all(unit.attempts.len()).filter(|_| rng.random_bool(share)).collect();
        self.comparison.lock().units += 1;
        Ok((unit, batches))
    }

    /// Compares a repeated batch with the recorded one.
    pub(super) fn compare(&self, unit: &Unit, batch: Batch, again: &[AttemptResult]) {
        let recorded: Vec<AttemptResult> = batch.indices(unit.attempts.len()).map(|idx| unit.attempts[idx]).collect();
        // The repeated attempts go through the same text as the recorded ones.
        let text = serde_json::to_vec(again).expect("attempts are plain data");
        let again: Vec<AttemptResult> = serde_json::from_slice(&text).expect("it was written as such");
        self.comparison.lock().add(&recorded, &again);
    }

    fn units(&self) -> MutexGuard<'_, BTreeMap<String, Unit>> {
        self.units.lock()
    }
}
