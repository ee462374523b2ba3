//! The parameters of an actor as plain arrays, and the burnpack files that hold them.
//!
//! A burnpack file is how burn records a module: a header, CBOR metadata with the name, type, shape and place of each
//! tensor, and the tensors at multiples of 256 bytes (<https://docs.rs/burn-pack>). This reader needs no part of burn.

use crate::config::ActorConfig;
use crate::manifest::CheckpointError;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// "BURN" as a little-endian number.
const MAGIC: [u8; 4] = *b"NRUB";
const VERSION: u16 = 1;
/// Length of magic, version and the metadata's length.
const HEADER_LEN: usize = 10;
const ALIGNMENT: usize = 256;
const F32: &str = "F32";

/// One parameter: its values in row-major order.
#[derive(Debug, Clone, PartialEq)]
pub struct Parameter {
    /// `[inputs, outputs]` of a matrix, `[outputs]` of a bias.
    pub shape: Vec<usize>,
    /// As many values as the shape says.
    pub values: Vec<f32>,
}

/// All parameters of an actor by path, such as `trunk.rays.weight`. Names and shapes fit the actor's sizes.
#[derive(Debug, Clone, PartialEq)]
pub struct Weights(BTreeMap<String, Parameter>);

#[derive(Serialize, Deserialize)]
struct Metadata {
    tensors: BTreeMap<String, Tensor>,
}

#[derive(Serialize, Deserialize)]
struct Tensor {
    dtype: String,
    shape: Vec<u64>,
    /// Begin and end, counted from the first tensor's begin.
    data_offsets: (u64, u64),
}

impl Weights {
    /// Checks that names and shapes are those of an actor of these sizes.
    ///
    /// # Errors
    /// Names the parameter that is missing, unknown, or of another shape.
    pub fn new(config: &ActorConfig, parameters: BTreeMap<String, Parameter>) -> Result<Self, CheckpointError> {
        let mismatch = |found, expected| CheckpointError::Mismatch { field: "a parameter", found, expected };
        let expected = config.parameter_shapes();
        for (name, shape) in &expected {
            match parameters.get(name) {
                None => return Err(mismatch(format!("no {name}"), name.clone())),
                Some(found) if found.shape != *shape => {
                    return Err(mismatch(format!("{name}: {:?}", found.shape), format!("{name}: {shape:?}")));
                }
                Some(_) => {}
            }
        }
        match parameters.keys().find(|name| !expected.contains_key(*name)) {
            Some(name) => Err(mismatch(name.clone(), format!("no {name}"))),
            None => Ok(Self(parameters)),
        }
    }

    /// All parameters by path.
    pub fn parameters(&self) -> &BTreeMap<String, Parameter> {
        &self.0
    }

    pub(crate) fn take(&mut self, name: &str) -> Vec<f32> {
        self.0.remove(name).expect("names were checked").values
    }

    /// Reads the parameters of an actor of these sizes from the contents of a burnpack file.
    ///
    /// # Errors
    /// If the bytes are not a burnpack file of `f32` tensors, or do not fit the sizes.
    pub fn from_burnpack(config: &ActorConfig, bytes: &[u8]) -> Result<Self, CheckpointError> {
        let decode = |reason: &str| CheckpointError::Decode(reason.to_owned());
        let (header, rest) = bytes.split_at_checked(HEADER_LEN).ok_or_else(|| decode("the file has no header"))?;
        let (magic, rest_of_header) = header.split_at(MAGIC.len());
        let version = u16::from_le_bytes([rest_of_header[0], rest_of_header[1]]);
        if magic != MAGIC || version != VERSION {
            return Err(decode("the file is not a burnpack file of version 1"));
        }
        let metadata_len = u32::from_le_bytes(std::array::from_fn(|idx| rest_of_header[2 + idx])) as usize;
        let metadata = rest.get(..metadata_len).ok_or_else(|| decode("the metadata is cut off"))?;
        let metadata: Metadata =
            ciborium::from_reader(metadata).map_err(|error| decode(&format!("the metadata is damaged: {error}")))?;
        let data = bytes.get((HEADER_LEN + metadata_len).next_multiple_of(ALIGNMENT)..).unwrap_or_default();
        let read = |(name, tensor): (String, Tensor)| {
            let parameter = tensor.read(&name, data).map_err(|reason| decode(&format!("tensor {name}: {reason}")))?;
            Ok((name, parameter))
        };
        Self::new(config, metadata.tensors.into_iter().map(read).collect::<Result<_, CheckpointError>>()?)
    }

    /// Writes the contents of a burnpack file.
    pub fn to_burnpack(&self) -> Vec<u8> {
        let mut data = Vec::new();
        let mut tensors = BTreeMap::new();
        for (name, Parameter { shape, values }) in &self.0 {
            data.resize(data.len().next_multiple_of(ALIGNMENT), 0);
            let start = data.len() as u64;
            data.extend(values.iter().flat_map(|value| value.to_le_bytes()));
            // Burn's layers have a dimension of members, of which an actor has one, and their biases one of rows.
            let leading = std::iter::repeat_n(1, 3 - shape.len());
            let shape = leading.chain(shape.iter().map(|&dim| dim as u64)).collect();
            let tensor = Tensor { dtype: F32.to_owned(), shape, data_offsets: (start, data.len() as u64) };
            tensors.insert(name.clone(), tensor);
        }
        let mut metadata = Vec::new();
        ciborium::into_writer(&Metadata { tensors }, &mut metadata).expect("metadata is plain data");
        let mut bytes = MAGIC.to_vec();
        bytes.extend(VERSION.to_le_bytes());
        bytes.extend((metadata.len() as u32).to_le_bytes());
        bytes.extend(metadata);
        bytes.resize(bytes.len().next_multiple_of(ALIGNMENT), 0);
        bytes.extend(data);
        bytes
    }
}

impl Tensor {
    fn read(&self, name: &str, data: &[u8]) -> Result<Parameter, String> {
        if self.dtype != F32 {
            return Err(format!("its type is {}, expected {F32}", self.dtype));
        }
        let leading = if name.ends_with(".bias") { 2 } else { 1 };
        let shape = match self.shape.split_at_checked(leading) {
            Some((ones, shape)) if ones.iter().all(|&dim| dim == 1) => shape,
            _ => return Err(format!("its shape is {:?}, expected {leading} leading 1", self.shape)),
        };
        let len = shape.iter().try_fold(4_u64, |len, &dim| len.checked_mul(dim));
        let (start, end) = self.data_offsets;
        if end.checked_sub(start) != len {
            return Err(format!("bytes {start} to {end} do not hold the shape {:?}", self.shape));
        }
        let bytes = data.get(start as usize..end as usize).ok_or("it is cut off")?;
        let values = bytes.as_chunks::<4>().0.iter().map(|bytes| f32::from_le_bytes(*bytes)).collect();
        Ok(Parameter { shape: shape.iter().map(|&dim| dim as usize).collect(), values })
    }
}
