//! The stages of training behind a model: a run that starts from other weights copies their training into its own
//! manifest.

use serde_json::{Map, Value, json};
use std::path::Path;
use surefoot_policy::Manifest;

/// File in a run's folder with the stages of the weights that the run started from.
pub(super) const STAGES_FILE: &str = "started_from.json";

/// Figures that are summed over stages.
const FIGURES: [&str; 3] = ["updates", "decisions", "hours"];

/// The stages of a model: its training, with the name and the hash of the weights that it produced.
pub(super) fn stages(manifest: &Manifest) -> Value {
    let mut stage = manifest.training.as_object().cloned().unwrap_or_default();
    stage.remove("total");
    stage.insert("name".into(), manifest.name.clone().into());
    stage.insert("weights_hash".into(), manifest.weights_hash.clone().into());
    Value::Object(stage)
}

/// Sums of a stage and of all stages before it. `decisions` and `updates` stay whole numbers.
pub fn total(training: &Value) -> Value {
    let chain = || std::iter::successors(Some(training), |stage| stage.get("started_from"));
    let sum = |figure: &str| {
        let whole = chain().try_fold(0_u64, |sum, stage| sum.checked_add(stage[figure].as_u64()?));
        let real = || chain().map(|stage| stage[figure].as_f64()).sum::<Option<f64>>();
        whole.map_or_else(|| json!(real()), Value::from)
    };
    Value::Object(FIGURES.iter().map(|figure| ((*figure).to_owned(), sum(figure))).collect::<Map<_, _>>())
}

/// Whether the second path is the first folder or inside it.
pub(super) fn holds(folder: &Path, other: &Path) -> bool {
    let real = |path: &Path| path.canonicalize().ok();
    real(folder).zip(real(other)).is_some_and(|(folder, other)| other.starts_with(folder))
}
