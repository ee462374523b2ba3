//! Writes the curves of a run to MLflow's file store: `mlflow ui --backend-store-uri RUN/mlruns` shows them.

use std::fs::{File, OpenOptions};
use std::io::{self, Write};
use std::path::{Path, PathBuf};
use std::time::{SystemTime, UNIX_EPOCH};

/// The only experiment of a run's folder.
const EXPERIMENT: &str = "0";
/// The only run of the experiment; a resumed run appends to it.
const RUN: &str = "00000000000000000000000000000001";

/// Appends curves to a file store.
#[derive(Debug)]
pub struct FileStore {
    metrics: PathBuf,
}

impl FileStore {
    /// Opens or creates the store in `folder`, for a run of this name with these parameters.
    pub fn open(folder: &Path, name: &str, parameters: &serde_json::Value) -> io::Result<Self> {
        let experiment = folder.join(EXPERIMENT);
        let run = experiment.join(RUN);
        let metrics = run.join("metrics");
        if !metrics.exists() {
            for part in ["metrics", "params", "tags", "artifacts"] {
                std::fs::create_dir_all(run.join(part))?;
            }
            let (now, artifacts) = (now_ms(), run.join("artifacts"));
            let text = |value: &str| serde_json::to_string(value).expect("a string is JSON, which YAML contains");
            let meta = format!(
                "artifact_location: {}\ncreation_time: {now}\nexperiment_id: '{EXPERIMENT}'\nlast_update_time: {now}\n\
                 lifecycle_stage: active\nname: Surefoot\n",
                text(&experiment.display().to_string()),
            );
            std::fs::write(experiment.join("meta.yaml"), meta)?;
            let meta = format!(
                "artifact_uri: {}\nend_time: null\nentry_point_name: ''\nexperiment_id: '{EXPERIMENT}'\n\
                 lifecycle_stage: active\nrun_id: {text_id}\nrun_name: {}\nrun_uuid: {text_id}\nsource_name: ''\n\
                 source_type: 4\nsource_version: ''\nstart_time: {now}\nstatus: 1\ntags: []\nuser_id: ''\n",
                text(&artifacts.display().to_string()),
                text(name),
                text_id = text(RUN),
            );
            std::fs::write(run.join("meta.yaml"), meta)?;
            std::fs::write(run.join("tags/mlflow.runName"), name)?;
            write_parameters(&run.join("params"), "", parameters)?;
        }
        Ok(Self { metrics })
    }

    /// Appends scalars at `step`; values that are not finite are omitted.
    pub fn scalars(&self, step: u64, values: &[(&str, f32)]) -> io::Result<()> {
        let now = now_ms();
        for (name, value) in values.iter().filter(|(_, value)| value.is_finite()) {
            let path = self.metrics.join(name);
            if let Some(folder) = path.parent() {
                std::fs::create_dir_all(folder)?;
            }
            let mut file: File = OpenOptions::new().create(true).append(true).open(path)?;
            writeln!(file, "{now} {value} {step}")?;
        }
        Ok(())
    }
}

/// Writes one file for each number, text or truth value, named by its path; lists are left out.
fn write_parameters(folder: &Path, prefix: &str, value: &serde_json::Value) -> io::Result<()> {
    let serde_json::Value::Object(fields) = value else {
        let text = value.as_str().map_or_else(|| value.to_string(), str::to_owned);
        return if value.is_array() { Ok(()) } else { std::fs::write(folder.join(prefix), text) };
    };
    for (name, value) in fields {
        let path = if prefix.is_empty() { name.clone() } else { format!("{prefix}.{name}") };
        write_parameters(folder, &path, value)?;
    }
    Ok(())
}

fn now_ms() -> u128 {
    SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default().as_millis()
}
