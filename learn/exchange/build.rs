//! Compiles the messages of ONNX with protox, so that protoc need not be installed.

fn main() -> Result<(), Box<dyn std::error::Error>> {
    println!("cargo::rerun-if-changed=onnx.proto");
    prost_build::compile_fds(protox::compile(["onnx.proto"], ["."])?)?;
    Ok(())
}
