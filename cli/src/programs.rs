//! The two programs, `surefoot` and `surefoot-lab`, which lie in one folder and start each other.

use anyhow::{Context, ensure};
use std::path::PathBuf;
use std::process::Command;

/// The program of that name beside the running one.
pub fn beside(name: &str) -> anyhow::Result<PathBuf> {
    let own = std::env::current_exe().context("the system does not report the path of this program")?;
    let program = own.with_file_name(format!("{name}{}", std::env::consts::EXE_SUFFIX));
    ensure!(
        program.is_file(),
        "{} is missing: cargo build --release builds it beside {}",
        program.display(),
        own.display()
    );
    Ok(program)
}

/// Lets `surefoot-lab` run this command line in place of this program. Returns only if that fails.
pub fn hand_over_to_lab() -> anyhow::Result<()> {
    let program = beside("surefoot-lab")?;
    let mut command = Command::new(&program);
    command.args(std::env::args_os().skip(1));
    let error = run_in_place(&mut command);
    Err(error).with_context(|| format!("cannot start {}", program.display()))
}

/// Replaces this process, which keeps its id, so that signals and exit codes pass through.
#[cfg(unix)]
fn run_in_place(command: &mut Command) -> std::io::Error {
    use std::os::unix::process::CommandExt;
    // Help and errors name the command that was typed.
    command.arg0("surefoot").exec()
}

/// Waits for the program and exits with its code. Ctrl-C reaches both.
#[cfg(not(unix))]
fn run_in_place(command: &mut Command) -> std::io::Error {
    match command.status() {
        Ok(status) => std::process::exit(status.code().unwrap_or(1)),
        Err(error) => error,
    }
}
