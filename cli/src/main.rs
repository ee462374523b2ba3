//! The `surefoot` command: argument parsing and wiring only.

// Doc comments of arguments are printed by `--help`, not rendered as pages.
#![allow(rustdoc::broken_intra_doc_links, rustdoc::bare_urls)]

mod commands;
mod config;
#[cfg(feature = "otel")]
mod otel;
mod signals;
mod terminal;

use clap::{CommandFactory, FromArgMatches, Parser, Subcommand};
use commands::fleet::prove;
use commands::{act, bench, challenge, eval, export, graph, health, licenses, map, services, top, train, up};

/// Game NPCs that reach their goals: worlds, NPC workers, and a planner whose every edge is proved.
#[derive(Parser)]
#[command(name = "surefoot", version, propagate_version = true, max_term_width = 110)]
struct Cli {
    #[command(subcommand)]
    command: Option<Command>,
    #[command(flatten)]
    log: terminal::LogArgs,
}

#[derive(Subcommand)]
enum Command {
    /// Run everything in one process, with a crowd to watch (the default).
    Up(Box<up::Args>),
    /// Run the world server.
    Serve(services::ServeArgs),
    /// Run the planner service.
    Plan(services::PlanArgs),
    /// Run an NPC worker.
    Work(services::WorkArgs),
    /// Run a prover: do jobs that planners and evaluations send over NATS.
    Prove(prove::Args),
    /// Train a reactive or recurrent SAC agent.
    Train(train::Args),
    /// Feed a learner that runs elsewhere.
    Act(act::Args),
    /// Measure success on maps by the paper's protocol.
    Eval(eval::Args),
    /// Compare agents and planners of any origin on the same goals.
    #[command(subcommand)]
    Challenge(challenge::Command),
    /// Write a model as ONNX or safetensors.
    Export(export::ExportArgs),
    /// Make a model from a safetensors file.
    Import(export::ImportArgs),
    /// Build, show, check, edit and export graphs.
    #[command(subcommand)]
    Graph(graph::Command),
    /// Measure speed.
    Bench(bench::Args),
    /// Ask a service whether it is serving.
    Health(health::Args),
    /// Print the licences of surefoot and of all crates that it is linked with.
    Licenses(licenses::Args),
    /// Watch a running world server.
    Top(top::Args),
    /// Generate, show, exchange and replay maps.
    #[command(subcommand)]
    Map(map::Command),
}

/// Exit code of programs that a closed pipe ends: 128 + SIGPIPE.
const PIPE_CLOSED: i32 = 141;

/// Lets the program end quietly when whoever reads its output has seen enough, as `head` does: printing panics then.
fn end_quietly_with_the_reader() {
    let usual = std::panic::take_hook();
    std::panic::set_hook(Box::new(move |panic| {
        let said = panic.payload().downcast_ref::<String>();
        if said.is_some_and(|it| it.starts_with("failed printing to std") && it.contains("Broken pipe")) {
            std::process::exit(PIPE_CLOSED);
        }
        usual(panic);
    }));
}

fn main() -> std::process::ExitCode {
    end_quietly_with_the_reader();
    match run() {
        Ok(()) => std::process::ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("error: {error:#}");
            std::process::ExitCode::FAILURE
        }
    }
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
        Command::Work(args) => services::run_worker(&args),
        Command::Prove(args) => prove::run(&args),
        Command::Train(args) => train::run(args),
        Command::Act(args) => act::run(args),
        Command::Eval(args) => eval::run(&args),
        Command::Challenge(command) => challenge::run(&command),
        Command::Export(args) => export::export(&args),
        Command::Import(args) => export::import(&args),
        Command::Graph(command) => graph::run(&command),
        Command::Bench(args) => bench::run(&args),
        Command::Health(args) => health::run(&args),
        Command::Licenses(args) => licenses::run(&args),
        Command::Top(args) => top::run(&args),
        Command::Map(command) => map::run(&command),
    }
}
