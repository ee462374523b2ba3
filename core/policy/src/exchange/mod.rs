//! Exchange of weights with other programs: ONNX export, safetensors export and import.

mod onnx;
mod safetensors;

pub use self::onnx::to_onnx;
pub use self::safetensors::{from_safetensors, to_safetensors};

use crate::Actor;
use burn::module::{Module, ModuleVisitor, Param};
use burn::tensor::Tensor;
use std::collections::BTreeMap;

/// One parameter as a shape and its values in row-major order.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Weights {
    pub shape: Vec<usize>,
    pub values: Vec<f32>,
}

/// All parameters of an actor by path, such as `trunk.rays.weight`; matrices are `[input, output]`.
pub(crate) fn named_weights(actor: &Actor) -> BTreeMap<String, Weights> {
    let mut names = Names::default();
    actor.visit(&mut names);
    names.found
}

#[derive(Default)]
struct Names {
    path: Vec<String>,
    found: BTreeMap<String, Weights>,
}

impl ModuleVisitor for Names {
    fn visit_float<const D: usize>(&mut self, param: &Param<Tensor<D>>) {
        let data = param.val().into_data();
        // An actor has one member, so the first dimension is dropped; so is a bias's row dimension.
        let mut shape = data.shape().iter().copied().skip(1).collect::<Vec<usize>>();
        if self.path.last().is_some_and(|name| name == "bias") {
            shape.remove(0);
        }
        let values = data.try_into_vec().expect("f32 weights");
        self.found.insert(self.path.join("."), Weights { shape, values });
    }

    fn enter_module(&mut self, name: &str, _: &str) {
        self.path.push(name.to_owned());
    }

    fn exit_module(&mut self, _: &str, _: &str) {
        self.path.pop();
    }
}
