//! The laboratory's commands, run through `surefoot` in real processes.

mod challenge;
mod commands;
mod kills;
mod learner;
mod tables;

use std::path::Path;
use std::process::Command;

/// `surefoot`, which lies beside `surefoot-lab`: `cargo test` of the whole workspace builds both.
fn surefoot() -> Command {
    let name = format!("surefoot{}", std::env::consts::EXE_SUFFIX);
    let program = Path::new(env!("CARGO_BIN_EXE_surefoot-lab")).with_file_name(name);
    assert!(program.exists(), "{} is missing: build the package surefoot-cli first", program.display());
    Command::new(program)
}
