//! The `surefoot` command: argument parsing and wiring only.

// Doc comments of arguments are printed by `--help`, not rendered as pages.
#![allow(rustdoc::broken_intra_doc_links, rustdoc::bare_urls)]

use clap::{CommandFactory, FromArgMatches, Parser, Subcommand};
use std::ffi::OsString;
use surefoot_cli::commands::fleet::{migrate, prove};
use surefoot_cli::commands::{body, graph, health, licenses, map, services, top, up};
use surefoot_cli::{config, programs, terminal};

/// Navigation for game NPCs: world servers, NPC workers, and a planner that proves every edge.
#[derive(Parser)]
#[command(
    name = "surefoot",
    version,
    propagate_version = true,
    max_term_width = 110,
    after_help = "Examples:\n  \
        surefoot                                  # the same as surefoot up\n  \
        surefoot up --maps level.glb --body unity\n  \
        surefoot graph reach level.glb\n  \
        surefoot eval --help"
)]
struct Cli {
    #[command(subcommand)]
    command: Option<Command>,
    #[command(flatten)]
    log: terminal::LogArgs,
}

#[derive(Subcommand)]
enum Command {
    /// Run all services in one process, with a crowd to watch (the default).
    Up(Box<up::Args>),
    /// Run the world server.
    Serve(services::ServeArgs),
    /// Run the planner service.
    Plan(services::PlanArgs),
    /// Run an NPC worker.
    Work(services::WorkArgs),
    /// Run a prover: run jobs that planners and evaluations send over NATS.
    Prove(prove::Args),
    /// Prepare what the processes of a fleet share.
    #[command(
        subcommand,
        after_help = "Examples:\n  \
            surefoot fleet migrate --store postgres://surefoot_owner:PASSWORD@127.0.0.1/surefoot --role surefoot"
    )]
    Fleet(migrate::Command),
    /// Build, check, edit and export graphs.
    #[command(
        subcommand,
        after_help = "Examples:\n  \
            surefoot graph show 2000 --png graph.png --tracks 24\n  \
            surefoot graph reach level.glb --body unity\n  \
            surefoot graph export level.glb --format json --out graph.json"
    )]
    Graph(graph::Command),
    /// Fit bodies to the characters of games.
    #[command(
        subcommand,
        after_help = "Examples:\n  \
            surefoot body fit level.glb --world tcp://127.0.0.1:7701 --out mine.toml"
    )]
    Body(body::Command),
    /// Check whether a service is serving.
    Health(health::Args),
    /// Print the licences of Surefoot and of all crates in its programs.
    Licenses(licenses::Args),
    /// Watch a running world server.
    Top(top::Args),
    /// Generate, show, import, export and replay maps.
    #[command(
        subcommand,
        after_help = "Examples:\n  \
            surefoot map show 7 --features all --stats\n  \
            surefoot map import level.glb --out level.sfmap\n  \
            surefoot map export 7 --out seven.glb"
    )]
    Map(map::Command),
    #[command(flatten)]
    Lab(Lab),
}

// Commands that `surefoot-lab` runs. A doc comment here would replace the description of the program.
#[derive(Subcommand)]
enum Lab {
    /// Train a reactive or recurrent policy with SAC.
    Train(LabArgs),
    /// Collect experience for a learner in another process.
    Act(LabArgs),
    /// Measure success on maps by the paper's protocol.
    Eval(LabArgs),
    /// Compare agents and planners of any origin on the same goals.
    Challenge(LabArgs),
    /// Write a model as ONNX or safetensors.
    Export(LabArgs),
    /// Convert a safetensors file to a model.
    Import(LabArgs),
    /// Measure speed on this machine.
    Bench(LabArgs),
}

/// Arguments of a command of `surefoot-lab`, which are passed on as they are.
#[derive(clap::Args)]
#[command(
    disable_help_flag = true,
    disable_version_flag = true,
    after_help = "`--help` after the command lists its flags and has examples."
)]
struct LabArgs {
    #[arg(trailing_var_arg = true, allow_hyphen_values = true, value_name = "ARGUMENTS")]
    _arguments: Vec<OsString>,
}

fn main() -> std::process::ExitCode {
    surefoot_cli::main(run)
}

fn run() -> anyhow::Result<()> {
    let Some(matches) = config::read(Cli::command())? else { return Ok(()) };
    let cli = Cli::from_arg_matches(&matches).unwrap_or_else(|error| error.exit());
    let logging = terminal::Logging::start(&cli.log)?;
    let result = execute(cli.command.expect("`up` is the default subcommand"));
    logging.finish();
    result
}

fn execute(command: Command) -> anyhow::Result<()> {
    match command {
        Command::Up(args) => up::run(&args),
        Command::Serve(args) => services::serve(&args),
        Command::Plan(args) => services::plan(&args),
        Command::Work(args) if args.inference != services::Inference::Cpu => programs::hand_over_to_lab(),
        Command::Work(args) => services::run_worker(&args, Ok),
        Command::Prove(args) => prove::run(&args),
        Command::Fleet(command) => migrate::run(&command),
        Command::Graph(command) => graph::run(&command),
        Command::Body(command) => body::run(&command),
        Command::Health(args) => health::run(&args),
        Command::Licenses(args) => licenses::run(&args),
        Command::Top(args) => top::run(&args),
        Command::Map(command) => map::run(&command),
        Command::Lab(_) => programs::hand_over_to_lab(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_help_of_every_command_has_examples() {
        let missing = surefoot_cli::without_examples(&Cli::command());
        // The commands of `surefoot-lab` have theirs there.
        let missing: Vec<String> =
            missing.into_iter().filter(|name| !Lab::has_subcommand(&name["surefoot ".len()..])).collect();
        assert_eq!(missing, Vec::<String>::new());
    }
}
