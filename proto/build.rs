//! Compiles the contracts with protox, so that protoc need not be installed.

use std::path::PathBuf;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let files = [
        "surefoot/world/v1/world.proto",
        "surefoot/world/v1/env.proto",
        "surefoot/world/v1/directory.proto",
        "surefoot/world/v1/maps.proto",
        "surefoot/planner/v1/planner.proto",
        "surefoot/learn/v1/learn.proto",
    ];
    for file in files.iter().chain(&[
        "surefoot/world/v1/map.proto",
        "surefoot/world/v1/body.proto",
        "surefoot/world/v1/living.proto",
        "surefoot/world/v1/movement.proto",
        "surefoot/world/v1/piece.proto",
        "surefoot/world/v1/route.proto",
        "surefoot/world/v1/zone.proto",
    ]) {
        println!("cargo::rerun-if-changed={file}");
    }
    let mut compiler = protox::Compiler::new(["."])?;
    compiler.include_source_info(true).include_imports(true).open_files(files)?;
    let out = PathBuf::from(std::env::var("OUT_DIR")?);
    std::fs::write(out.join("descriptors.bin"), compiler.encode_file_descriptor_set())?;
    tonic_prost_build::configure().compile_fds(compiler.file_descriptor_set())?;
    Ok(())
}
