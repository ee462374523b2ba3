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
#[command(
    name = "surefoot",
    version,
    propagate_version = true,
    max_term_width = 110,
    after_help = "Examples:\n  surefoot                                  # the same as surefoot up\n  surefoot up --maps level.glb --body unity\n  surefoot graph reach level.glb\n  surefoot eval --help"
)]
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
    #[command(
        subcommand,
        after_help = "Examples:\n  surefoot challenge record paper-like --out surefoot.json.gz\n  surefoot challenge score surefoot.json.gz"
    )]
    Challenge(challenge::Command),
    /// Write a model as ONNX or safetensors.
    Export(export::ExportArgs),
    /// Make a model from a safetensors file.
    Import(export::ImportArgs),
    /// Build, show, check, edit and export graphs.
    #[command(
        subcommand,
        after_help = "Examples:\n  surefoot graph show 2000 --png graph.png --tracks 24\n  surefoot graph reach level.glb --body unity\n  surefoot graph export level.glb --format json --out graph.json"
    )]
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
    #[command(
        subcommand,
        after_help = "Examples:\n  surefoot map show 7 --features all --stats\n  surefoot map import level.glb --out level.sfmap\n  surefoot map export 7 --out seven.glb"
    )]
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

#[cfg(test)]
mod tests {
    use super::*;

    /// Names of the commands below `command`, itself included, whose help has no examples.
    fn without_examples(command: &clap::Command) -> Vec<String> {
        let help = command.get_after_help().map(ToString::to_string).unwrap_or_default();
        let name = command.get_name();
        let example = if name == "surefoot" { "\n  surefoot".to_owned() } else { format!(" {name}") };
        let has_examples =
            help.split_once("Examples:\n").is_some_and(|(_, examples)| format!("\n{examples}").contains(&example));
        let own = (!has_examples).then(|| name.to_owned());
        let below = command.get_subcommands().flat_map(without_examples);
        own.into_iter().chain(below.map(|below| format!("{name} {below}"))).collect()
    }

    #[test]
    fn the_help_of_every_command_has_examples() {
        assert_eq!(without_examples(&Cli::command()), Vec::<String>::new());
    }

    #[test]
    fn every_bench_has_an_example() {
        let command = Cli::command();
        let bench = command.find_subcommand("bench").expect("there are benches");
        let help = bench.get_after_help().map(ToString::to_string).unwrap_or_default();
        let what = bench.get_arguments().find(|it| it.get_id() == "what").expect("a bench is named");
        for name in what.get_possible_values().iter().map(clap::builder::PossibleValue::get_name) {
            assert!(help.contains(&format!("surefoot bench {name}")), "bench {name}");
        }
        let names: Vec<String> = what.get_possible_values().iter().map(|it| it.get_name().to_owned()).collect();
        let page = concat!(env!("CARGO_MANIFEST_DIR"), "/../docs/training-and-models.md");
        let page = std::fs::read_to_string(page).expect("the page exists");
        assert!(page.contains(&format!("`surefoot bench {}`", names.join("|"))), "the page lists other benches");
    }
}
