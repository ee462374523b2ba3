//! Weights for other programs: ONNX export, safetensors export and import.

mod onnx;
mod proto {
    include!(concat!(env!("OUT_DIR"), "/onnx.rs"));
}
mod safetensors;

pub use self::onnx::to_onnx;
pub use self::safetensors::{from_safetensors, to_safetensors};
