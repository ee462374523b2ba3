//! The `surefoot` command: argument parsing and wiring only.

mod commands;
mod render;
mod terminal;

use clap::{Parser, Subcommand};
use commands::{eval, map, train};

/// Game NPCs that get there: worlds, NPC workers, a planner whose every edge is proved.
#[derive(Parser)]
#[command(version, propagate_version = true, max_term_width = 110)]
struct Cli {
    #[command(subcommand)]
    command: Option<Command>,
}

#[derive(Subcommand)]
enum Command {
    /// Train the reactive SAC agent, resumable.
    Train(train::Args),
    /// Measure success on maps by the paper's protocol.
    Eval(eval::Args),
    /// Look at maps.
    #[command(subcommand)]
    Map(map::Command),
}

fn main() -> std::process::ExitCode {
    terminal::start_logging();
    let command = Cli::parse().command.unwrap_or_else(|| todo!());
    let result = match command {
        Command::Train(args) => train::run(args),
        Command::Eval(args) => eval::run(&args),
        Command::Map(command) => map::run(&command),
    };
    match result {
        Ok(()) => std::process::ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("error: {error:#}");
            std::process::ExitCode::FAILURE
        }
    }
}
