//! Weights as safetensors: every parameter by path, matrices as `[input, output]`, and the manifest as metadata.

use safetensors::tensor::{Dtype, SafeTensors, TensorView};
use std::collections::{BTreeMap, HashMap};
use std::num::NonZeroUsize;
use surefoot_policy::{ActorConfig, CheckpointError, Manifest, Parameter, Weights};
use surefoot_world::sense::OBSERVATION_VERSION;

/// Key of the manifest in the file's metadata.
const MANIFEST_KEY: &str = "surefoot_manifest";

/// Encodes the weights of the actor that `manifest` describes as the contents of a `.safetensors` file.
///
/// # Errors
/// If the safetensors library cannot encode the weights.
pub fn to_safetensors(weights: &Weights, manifest: &Manifest) -> Result<Vec<u8>, CheckpointError> {
    let decode = |error: &dyn std::fmt::Display| CheckpointError::Decode(error.to_string());
    let weights: Vec<(&String, &Vec<usize>, Vec<u8>)> = weights
        .parameters()
        .iter()
        .map(|(name, Parameter { shape, values })| {
            (name, shape, values.iter().flat_map(|value| value.to_le_bytes()).collect())
        })
        .collect();
    let mut views = Vec::with_capacity(weights.len());
    for (name, shape, bytes) in &weights {
        views.push((name, TensorView::new(Dtype::F32, (*shape).clone(), bytes).map_err(|error| decode(&error))?));
    }
    let text = serde_json::to_string(manifest).expect("a manifest is plain data");
    let metadata = HashMap::from([(MANIFEST_KEY.to_owned(), text)]);
    safetensors::serialize(views, Some(metadata)).map_err(|error| decode(&error))
}

/// Decodes the weights of an actor from the contents of a `.safetensors` file. Its sizes follow from the shapes. The
/// manifest is the one in the file's metadata, if any.
///
/// # Errors
/// If the bytes are not safetensors, the manifest is for another observation, or a parameter is missing, unknown, or of
/// a shape or type that this program's network does not have. The error names the parameter.
pub fn from_safetensors(bytes: &[u8]) -> Result<(Weights, ActorConfig, Option<Manifest>), CheckpointError> {
    let decode = |error: &dyn std::fmt::Display| CheckpointError::Decode(error.to_string());
    let (_, metadata) = SafeTensors::read_metadata(bytes).map_err(|error| decode(&error))?;
    let manifest = metadata
        .metadata()
        .as_ref()
        .and_then(|entries| entries.get(MANIFEST_KEY))
        .map(|text| serde_json::from_str::<Manifest>(text).map_err(|error| decode(&error)))
        .transpose()?;
    let file = SafeTensors::deserialize(bytes).map_err(|error| decode(&error))?;
    let mut found = BTreeMap::new();
    for (name, view) in file.tensors() {
        if view.dtype() != Dtype::F32 {
            return Err(mismatch(format!("{name}: {:?}", view.dtype()), format!("{name}: F32")));
        }
        let values = view.data().as_chunks::<4>().0.iter().map(|bytes| f32::from_le_bytes(*bytes)).collect();
        found.insert(name, Parameter { shape: view.shape().to_vec(), values });
    }
    let config = sizes(&found)?;
    if let Some(manifest) = &manifest {
        let len = config.observation_len();
        if (manifest.observation_len, manifest.observation_version) != (len, OBSERVATION_VERSION) {
            return Err(CheckpointError::Mismatch {
                field: "observation",
                found: format!("{} values of version {}", manifest.observation_len, manifest.observation_version),
                expected: format!("{len} values of version {OBSERVATION_VERSION}"),
            });
        }
    }
    Ok((Weights::new(&config, found)?, config, manifest))
}

fn mismatch(found: String, expected: String) -> CheckpointError {
    CheckpointError::Mismatch { field: "a parameter", found, expected }
}

/// Infers the layer sizes from the shapes.
fn sizes(found: &BTreeMap<String, Parameter>) -> Result<ActorConfig, CheckpointError> {
    let shape = |name: &str| match found.get(name).map(|parameter| parameter.shape.as_slice()) {
        Some(&[inputs, outputs]) => Ok((inputs, outputs)),
        Some(shape) => Err(mismatch(format!("{name}: {shape:?}"), format!("{name}: a matrix"))),
        None => Err(mismatch("no ".to_owned() + name, name.to_owned())),
    };
    let has_memory = found.contains_key("trunk.memory.recurrent");
    let memory = if has_memory { shape("trunk.memory.recurrent")?.1 / 4 } else { 0 };
    let config = ActorConfig {
        ray_features: shape("trunk.rays.weight")?.1,
        hidden: shape("trunk.second.weight")?.1,
        memory: NonZeroUsize::new(memory),
        sees_others: false,
    };
    if !config.is_sound() {
        return Err(CheckpointError::Sizes(config));
    }
    // Only the first hidden layer tells the length of the observation.
    let seeing = ActorConfig { sees_others: true, ..config };
    let (inputs, _) = shape("trunk.first.weight")?;
    Ok(if inputs == seeing.sensed_len() + memory { seeing } else { config })
}
