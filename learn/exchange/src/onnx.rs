//! An actor as an ONNX model, for engines with an ONNX runtime.
//!
//! The model uses only common operators of opset 13 (`MatMul`, `Add`, `Relu`, `Sigmoid`, `Tanh`, `Mul`, `Slice`,
//! `Concat`, `Clip`, `Identity`) and takes any number of rows:
//!
//! | tensor | shape | meaning |
//! |---|---|---|
//! | in `observations` | rows, 369 or 461 | as in `surefoot_world::sense`; 461 for policies that see others |
//! | in `hidden_in`, `cell_in` | rows, memory | recurrent agents: zeros, then the last `hidden_out`, `cell_out` |
//! | out `action` | rows, 4 | the most likely action: forward, strafe, turn, jump in \[-1, 1\] |
//! | out `mean`, `log_std` | rows, 4 | the Gaussian before tanh, for acting with noise |
//! | out `hidden_out`, `cell_out` | rows, memory | recurrent agents: inputs of the next decision |

use crate::proto::attribute_proto::AttributeType;
use crate::proto::tensor_proto::DataType;
use crate::proto::tensor_shape_proto::Dimension;
use crate::proto::tensor_shape_proto::dimension::Value as Size;
use crate::proto::type_proto::{self, Tensor};
use crate::proto::{
    AttributeProto, GraphProto, ModelProto, NodeProto, OperatorSetIdProto, StringStringEntryProto, TensorProto,
    TensorShapeProto, TypeProto, ValueInfoProto,
};
use prost::Message;
use surefoot_policy::config::{LOG_STD_RANGE, RAY_LEN};
use surefoot_policy::{Manifest, Parameter, Weights};
use surefoot_world::character::ACTION_LEN;

const IR_VERSION: i64 = 8;
const OPSET: i64 = 13;

/// Encodes the weights of the actor that `manifest` describes as the contents of an `.onnx` file.
pub fn to_onnx(weights: &Weights, manifest: &Manifest) -> Vec<u8> {
    let mut graph = Builder { weights, graph: GraphProto::default() };
    graph.graph.name = manifest.name.clone();
    let observation_len = manifest.actor.observation_len();
    graph.input("observations", observation_len);
    let rays = graph.slice("observations", 0, RAY_LEN);
    let state = graph.slice("observations", RAY_LEN, observation_len);
    let rays = graph.dense(&rays, "trunk.rays");
    let rays = graph.node("Relu", &[&rays], &[]);
    let sensed = graph.concat(&[&rays, &state]);
    let inputs = match manifest.actor.memory {
        Some(size) => {
            let hidden = graph.lstm_step(&sensed, size.get());
            graph.concat(&[&sensed, &hidden])
        }
        None => sensed,
    };
    let first = graph.dense(&inputs, "trunk.first");
    let first = graph.node("Relu", &[&first], &[]);
    let second = graph.dense(&first, "trunk.second");
    let second = graph.node("Relu", &[&second], &[]);
    let head = graph.dense(&second, "head");
    let mean = graph.slice(&head, 0, ACTION_LEN);
    let log_std = graph.slice(&head, ACTION_LEN, 2 * ACTION_LEN);
    let (low, high) = (graph.scalar(LOG_STD_RANGE.0), graph.scalar(LOG_STD_RANGE.1));
    let log_std = graph.node("Clip", &[&log_std, &low, &high], &[]);
    let action = graph.node("Tanh", &[&mean], &[]);
    for (name, value) in [("action", &action), ("mean", &mean), ("log_std", &log_std)] {
        graph.output(name, value, ACTION_LEN);
    }
    let property = |key: &str, value: String| StringStringEntryProto { key: key.to_owned(), value };
    let model = ModelProto {
        ir_version: IR_VERSION,
        producer_name: "surefoot".to_owned(),
        producer_version: env!("CARGO_PKG_VERSION").to_owned(),
        graph: Some(graph.graph),
        opset_import: vec![OperatorSetIdProto { domain: String::new(), version: OPSET }],
        metadata_props: vec![
            property("kind", manifest.kind.clone()),
            property("observation_version", manifest.observation_version.to_string()),
            property("weights_hash", manifest.weights_hash.clone()),
        ],
    };
    model.encode_to_vec()
}

/// A graph under construction, in which names identify values.
struct Builder<'a> {
    weights: &'a Weights,
    graph: GraphProto,
}

impl Builder<'_> {
    fn input(&mut self, name: &str, width: usize) {
        self.graph.input.push(rows(name, width));
    }

    /// Exposes a value as an output of the model.
    fn output(&mut self, name: &str, value: &str, width: usize) {
        let node = NodeProto {
            input: vec![value.to_owned()],
            output: vec![name.to_owned()],
            name: name.to_owned(),
            op_type: "Identity".to_owned(),
            attribute: Vec::new(),
        };
        self.graph.node.push(node);
        self.graph.output.push(rows(name, width));
    }

    fn node(&mut self, op_type: &str, inputs: &[&str], attribute: &[AttributeProto]) -> String {
        let name = format!("{}_{}", op_type.to_lowercase(), self.graph.node.len());
        self.graph.node.push(NodeProto {
            input: inputs.iter().map(|&input| input.to_owned()).collect(),
            output: vec![name.clone()],
            name: name.clone(),
            op_type: op_type.to_owned(),
            attribute: attribute.to_vec(),
        });
        name
    }

    fn constant(&mut self, tensor: TensorProto) -> String {
        let name = tensor.name.clone();
        if self.graph.initializer.iter().all(|known| known.name != name) {
            self.graph.initializer.push(tensor);
        }
        name
    }

    fn scalar(&mut self, value: f32) -> String {
        let raw_data = value.to_le_bytes().to_vec();
        self.constant(TensorProto {
            dims: Vec::new(),
            data_type: DataType::Float.into(),
            name: format!("value_{value}"),
            raw_data,
        })
    }

    fn index(&mut self, value: usize) -> String {
        let raw_data = (value as i64).to_le_bytes().to_vec();
        self.constant(TensorProto {
            dims: vec![1],
            data_type: DataType::Int64.into(),
            name: format!("index_{value}"),
            raw_data,
        })
    }

    fn weight(&mut self, path: &str) -> String {
        let Parameter { shape, values } = &self.weights.parameters()[path];
        let tensor = TensorProto {
            dims: shape.iter().map(|&dim| dim as i64).collect(),
            data_type: DataType::Float.into(),
            name: path.to_owned(),
            raw_data: values.iter().flat_map(|value| value.to_le_bytes()).collect(),
        };
        self.constant(tensor)
    }

    /// Slices columns `from..to`.
    fn slice(&mut self, value: &str, from: usize, to: usize) -> String {
        let (from, to, axis) = (self.index(from), self.index(to), self.index(1));
        self.node("Slice", &[value, &from, &to, &axis], &[])
    }

    /// Concatenates columns.
    fn concat(&mut self, values: &[&str]) -> String {
        let axis = AttributeProto { name: "axis".to_owned(), i: 1, r#type: AttributeType::Int.into() };
        self.node("Concat", values, &[axis])
    }

    fn dense(&mut self, value: &str, path: &str) -> String {
        let (weight, bias) = (self.weight(&format!("{path}.weight")), self.weight(&format!("{path}.bias")));
        let product = self.node("MatMul", &[value, &weight], &[]);
        self.node("Add", &[&product, &bias], &[])
    }

    /// Adds one step of the LSTM, with its state as inputs and outputs of the model, and returns the hidden state.
    fn lstm_step(&mut self, sensed: &str, size: usize) -> String {
        self.input("hidden_in", size);
        self.input("cell_in", size);
        let recurrent = self.weight("trunk.memory.recurrent");
        let gates = self.dense(sensed, "trunk.memory.input");
        let product = self.node("MatMul", &["hidden_in", &recurrent], &[]);
        let gates = self.node("Add", &[&gates, &product], &[]);
        let [input, forget, output] = [0, 1, 2].map(|gate| {
            let gate = self.slice(&gates, gate * size, (gate + 1) * size);
            self.node("Sigmoid", &[&gate], &[])
        });
        let candidate = self.slice(&gates, 3 * size, 4 * size);
        let candidate = self.node("Tanh", &[&candidate], &[]);
        let kept = self.node("Mul", &[&forget, "cell_in"], &[]);
        let new = self.node("Mul", &[&input, &candidate], &[]);
        let cell = self.node("Add", &[&kept, &new], &[]);
        let squashed = self.node("Tanh", &[&cell], &[]);
        let hidden = self.node("Mul", &[&output, &squashed], &[]);
        self.output("hidden_out", &hidden, size);
        self.output("cell_out", &cell, size);
        hidden
    }
}

/// A tensor of any number of rows with `width` floats each.
fn rows(name: &str, width: usize) -> ValueInfoProto {
    let dim = [Size::DimParam("rows".to_owned()), Size::DimValue(width as i64)]
        .map(|value| Dimension { value: Some(value) })
        .to_vec();
    let tensor = Tensor { elem_type: DataType::Float.into(), shape: Some(TensorShapeProto { dim }) };
    ValueInfoProto {
        name: name.to_owned(),
        r#type: Some(TypeProto { value: Some(type_proto::Value::TensorType(tensor)) }),
    }
}
