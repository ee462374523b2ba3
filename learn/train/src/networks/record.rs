//! Modules as bytes: burn's records, in burnpack files.

use burn::module::Module;
use burn::store::{ModuleRecord, RecordError};
use burn::tensor::{Bytes, DType};
use surefoot_policy::CheckpointError;

/// Serializes a module's parameters.
pub fn module_bytes<M: Module>(module: &M) -> Result<Vec<u8>, CheckpointError> {
    module.valid().into_record().into_bytes().map(|bytes| bytes.to_vec()).map_err(decode)
}

/// Loads parameters into a module of the same shape.
///
/// # Errors
/// If the bytes cannot be decoded, or the shapes or types of numbers differ.
pub fn load_module<M: Module>(module: M, bytes: &[u8]) -> Result<M, CheckpointError> {
    check_types(bytes).map_err(CheckpointError::Decode)?;
    let record = ModuleRecord::from_bytes(Bytes::from_bytes_vec(bytes.to_vec())).map_err(decode)?;
    module.try_load_record(record).map_err(decode)
}

/// Checks that all tensors hold `f32`: burn panics on types that are none of a module's.
fn check_types(bytes: &[u8]) -> Result<(), String> {
    let file =
        burn_pack::Reader::from_bytes(Bytes::from_bytes_vec(bytes.to_vec())).map_err(|error| error.to_string())?;
    for tensor in file.into_tensors().map_err(|error| error.to_string())? {
        if tensor.dtype != DType::F32 {
            return Err(format!("tensor {} is of type {:?}, expected F32", tensor.name, tensor.dtype));
        }
    }
    Ok(())
}

fn decode(error: RecordError) -> CheckpointError {
    CheckpointError::Decode(error.to_string())
}
