//! Compiles the sidecar's contracts with protox, so that protoc need not be installed.

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let files = ["sdk.proto", "beta.proto"];
    println!("cargo::rerun-if-changed=proto");
    let mut compiler = protox::Compiler::new(["proto"])?;
    // Without comments: those of the originals are not written for rustdoc.
    compiler.include_source_info(false).include_imports(true).open_files(files)?;
    tonic_prost_build::configure().compile_fds(compiler.file_descriptor_set())?;
    Ok(())
}
