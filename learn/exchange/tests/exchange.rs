//! Exchange of weights: an ONNX model computes the same actions as the policy, safetensors are read back unchanged.

use prost::Message;
use rand::rngs::ChaCha8Rng;
use rand::{RngExt, SeedableRng};
use safetensors::tensor::{Dtype, TensorView};
use std::collections::HashMap;
use surefoot_exchange::{from_safetensors, to_onnx, to_safetensors};
use surefoot_policy::{ActorConfig, Batch, CheckpointError, Manifest, Parameter, Policy, Scratch, Weights};

const ROWS: usize = 6;

/// A policy of `memory` LSTM units; one with a memory also sees others.
fn policy(memory: usize) -> (Policy, Weights) {
    let config = ActorConfig {
        ray_features: 12,
        hidden: 20,
        memory: std::num::NonZeroUsize::new(memory),
        sees_others: memory > 0,
    };
    let mut rng = ChaCha8Rng::seed_from_u64(9);
    let parameters = config.parameter_shapes().into_iter().map(|(name, shape)| {
        let values = (0..shape.iter().product()).map(|_| rng.random_range(-0.3..0.3)).collect();
        (name, Parameter { shape, values })
    });
    let weights = Weights::new(&config, parameters.collect()).unwrap();
    let bytes = weights.to_burnpack();
    let manifest = Manifest::new("exchanged", config, &bytes, serde_json::json!({ "seed": 9 }));
    (Policy::from_bytes(manifest, &bytes).unwrap(), weights)
}

fn observations(policy: &Policy, rng: &mut ChaCha8Rng) -> Vec<f32> {
    (0..ROWS * policy.observation_len()).map(|_| rng.random_range(-1.0..1.0)).collect()
}

fn act(policy: &Policy, observations: &[f32], memory: &mut [f32]) -> Vec<f32> {
    let mut actions = Vec::new();
    policy.act(Batch { observations, memory, noise: &[] }, &mut Scratch::default(), &mut actions);
    actions.iter().flat_map(|action| action.to_array()).collect()
}

#[test]
fn an_onnx_model_decides_as_the_policy_does_step_after_step() {
    for memory in [0, 7] {
        let (policy, weights) = policy(memory);
        let model = OnnxModel::decode(to_onnx(&weights, policy.manifest()).as_slice()).unwrap();
        let graph = model.graph.unwrap();
        let mut rng = ChaCha8Rng::seed_from_u64(1);
        let mut ours = vec![0.0; ROWS * policy.memory_len()];
        let mut theirs = HashMap::from([
            ("hidden_in".to_owned(), Matrix::zeros(ROWS, memory)),
            ("cell_in".to_owned(), Matrix::zeros(ROWS, memory)),
        ]);
        for _ in 0..5 {
            let observations = observations(&policy, &mut rng);
            let expected = act(&policy, &observations, &mut ours);
            let mut inputs = theirs.clone();
            inputs
                .insert("observations".to_owned(), Matrix { columns: policy.observation_len(), values: observations });
            let outputs = evaluate(&graph, inputs);
            for (onnx, expected) in outputs["action"].values.iter().zip(&expected) {
                assert!((onnx - expected).abs() < 1.0e-5, "{onnx} instead of {expected}");
            }
            if memory > 0 {
                theirs.insert("hidden_in".to_owned(), outputs["hidden_out"].clone());
                theirs.insert("cell_in".to_owned(), outputs["cell_out"].clone());
            }
        }
        let names = |values: &[OnnxNamed]| values.iter().map(|value| value.name.clone()).collect::<Vec<_>>();
        assert_eq!(names(&graph.input).len(), if memory > 0 { 3 } else { 1 });
        assert!(names(&graph.output).contains(&"log_std".to_owned()));
    }
}

#[test]
fn safetensors_are_read_back_unchanged() {
    for memory in [0, 7] {
        let (policy, weights) = policy(memory);
        let bytes = to_safetensors(&weights, policy.manifest()).unwrap();
        let (read, config, manifest) = from_safetensors(&bytes).unwrap();
        assert_eq!(config, policy.manifest().actor);
        assert_eq!(manifest.as_ref(), Some(policy.manifest()));
        assert_eq!(read, weights);
    }
}

#[test]
fn foreign_safetensors_are_refused_with_what_differs() {
    let refusal = |edit: &dyn Fn(&str) -> String| {
        let (policy, weights) = policy(0);
        let bytes = to_safetensors(&weights, policy.manifest()).unwrap();
        let header_len = u64::from_le_bytes(bytes[..8].try_into().unwrap()) as usize;
        let header = edit(std::str::from_utf8(&bytes[8..8 + header_len]).unwrap());
        let mut edited = (header.len() as u64).to_le_bytes().to_vec();
        edited.extend(header.as_bytes());
        edited.extend(&bytes[8 + header_len..]);
        from_safetensors(&edited).unwrap_err().to_string()
    };
    let renamed = refusal(&|header| header.replace("trunk.first.bias", "trunk.third.bias"));
    assert!(renamed.contains("no trunk.first.bias"), "{renamed}");
    let reshaped = refusal(&|header| header.replace("[20,20]", "[40,10]"));
    assert!(reshaped.contains("head.weight: [20, 8]"), "{reshaped}");
    let retyped = refusal(&|header| header.replacen("\"F32\"", "\"I32\"", 1));
    assert!(retyped.contains("I32"), "{retyped}");
    let older = refusal(&|header| header.replace("\\\"observation_version\\\":", "\\\"observation_version\\\":9"));
    assert!(older.contains("observation") && older.contains("version 9"), "{older}");
    let (policy, weights) = policy(0);
    for bytes in [&b""[..], &[255; 40], &to_safetensors(&weights, policy.manifest()).unwrap()[..900]] {
        assert!(matches!(from_safetensors(bytes), Err(CheckpointError::Decode(_))));
    }
}

#[test]
fn shapes_that_do_not_fit_each_other_are_refused() {
    // All parameters are present, but nearly without rows: 30 kB that once took a gigabyte before they were rejected.
    let shapes: [(&str, &[usize]); 11] = [
        ("head.bias", &[8]),
        ("head.weight", &[1, 8]),
        ("trunk.first.bias", &[1]),
        ("trunk.first.weight", &[1, 1]),
        ("trunk.memory.input.bias", &[1]),
        ("trunk.memory.input.weight", &[1, 1]),
        ("trunk.memory.recurrent", &[0, 16384]),
        ("trunk.rays.bias", &[1]),
        ("trunk.rays.weight", &[0, 4096]),
        ("trunk.second.bias", &[1]),
        ("trunk.second.weight", &[1, 4096]),
    ];
    let values = vec![0u8; 4 * 4096];
    let views = shapes.map(|(name, shape)| {
        let len = 4 * shape.iter().product::<usize>();
        (name, TensorView::new(Dtype::F32, shape.to_vec(), &values[..len]).unwrap())
    });
    let bytes = safetensors::serialize(views, None).unwrap();
    let message = from_safetensors(&bytes).unwrap_err().to_string();
    assert!(message.contains("head.weight: [4096, 8]"), "{message}");
}

// An independent reader and evaluator of ONNX models, for the operators that the export uses.

#[derive(Clone, Debug)]
struct Matrix {
    columns: usize,
    values: Vec<f32>,
}

impl Matrix {
    fn zeros(rows: usize, columns: usize) -> Self {
        Self { columns, values: vec![0.0; rows * columns] }
    }

    fn map(&self, change: impl Fn(f32) -> f32) -> Self {
        Self { columns: self.columns, values: self.values.iter().map(|&value| change(value)).collect() }
    }

    /// Combines values pairwise; a shorter `other`, such as a bias, is repeated.
    fn zip(&self, other: &Matrix, change: impl Fn(f32, f32) -> f32) -> Self {
        let values = self.values.iter().zip(other.values.iter().cycle());
        Self { columns: self.columns, values: values.map(|(&a, &b)| change(a, b)).collect() }
    }

    fn row_count(&self) -> usize {
        self.values.len() / self.columns.max(1)
    }

    fn times(&self, other: &Matrix) -> Self {
        let mut product = Matrix::zeros(self.row_count(), other.columns);
        for (row, out) in self.values.chunks(self.columns).zip(product.values.chunks_mut(other.columns)) {
            for (value, weights) in row.iter().zip(other.values.chunks(other.columns)) {
                out.iter_mut().zip(weights).for_each(|(sum, weight)| *sum += value * weight);
            }
        }
        product
    }

    fn columns_of(&self, from: usize, to: usize) -> Self {
        let values = self.values.chunks(self.columns).flat_map(|row| &row[from..to]).copied().collect();
        Matrix { columns: to - from, values }
    }
}

fn evaluate(graph: &OnnxGraph, mut known: HashMap<String, Matrix>) -> HashMap<String, Matrix> {
    let mut indices = HashMap::new();
    for tensor in &graph.initializer {
        if tensor.data_type == 7 {
            let value = i64::from_le_bytes(tensor.raw_data[..8].try_into().unwrap());
            indices.insert(tensor.name.clone(), value as usize);
            continue;
        }
        let values = tensor.raw_data.chunks_exact(4).map(|bytes| f32::from_le_bytes(bytes.try_into().unwrap()));
        let columns = tensor.dims.last().map_or(1, |&dim| dim as usize);
        known.insert(tensor.name.clone(), Matrix { columns, values: values.collect() });
    }
    for node in &graph.node {
        let input = |idx: usize| &known[&node.input[idx]];
        let result = match node.op_type.as_str() {
            "Identity" => input(0).clone(),
            "MatMul" => input(0).times(input(1)),
            "Add" => input(0).zip(input(1), |a, b| a + b),
            "Mul" => input(0).zip(input(1), |a, b| a * b),
            "Relu" => input(0).map(|value| value.max(0.0)),
            "Tanh" => input(0).map(f32::tanh),
            "Sigmoid" => input(0).map(|value| 1.0 / (1.0 + (-value).exp())),
            "Clip" => input(0).map(|value| value.clamp(input(1).values[0], input(2).values[0])),
            "Slice" => input(0).columns_of(indices[&node.input[1]], indices[&node.input[2]]),
            "Concat" => {
                let parts: Vec<&Matrix> = (0..node.input.len()).map(input).collect();
                let rows = 0..parts[0].row_count();
                let row =
                    |row: usize, part: &Matrix| part.values[row * part.columns..(row + 1) * part.columns].to_vec();
                Matrix {
                    columns: parts.iter().map(|part| part.columns).sum(),
                    values: rows.flat_map(|idx| parts.iter().flat_map(move |part| row(idx, part))).collect(),
                }
            }
            other => panic!("the export must not use operator {other}"),
        };
        known.insert(node.output[0].clone(), result);
    }
    known
}

#[derive(Clone, PartialEq, Message)]
struct OnnxModel {
    #[prost(message, optional, tag = "7")]
    graph: Option<OnnxGraph>,
}

#[derive(Clone, PartialEq, Message)]
struct OnnxGraph {
    #[prost(message, repeated, tag = "1")]
    node: Vec<OnnxNode>,
    #[prost(message, repeated, tag = "5")]
    initializer: Vec<OnnxTensor>,
    #[prost(message, repeated, tag = "11")]
    input: Vec<OnnxNamed>,
    #[prost(message, repeated, tag = "12")]
    output: Vec<OnnxNamed>,
}

#[derive(Clone, PartialEq, Message)]
struct OnnxNode {
    #[prost(string, repeated, tag = "1")]
    input: Vec<String>,
    #[prost(string, repeated, tag = "2")]
    output: Vec<String>,
    #[prost(string, tag = "4")]
    op_type: String,
}

#[derive(Clone, PartialEq, Message)]
struct OnnxTensor {
    #[prost(int64, repeated, tag = "1")]
    dims: Vec<i64>,
    #[prost(int32, tag = "2")]
    data_type: i32,
    #[prost(string, tag = "8")]
    name: String,
    #[prost(bytes = "vec", tag = "9")]
    raw_data: Vec<u8>,
}

#[derive(Clone, PartialEq, Message)]
struct OnnxNamed {
    #[prost(string, tag = "1")]
    name: String,
}
