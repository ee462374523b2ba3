//! The `surefoot-lab` program: training, evaluation, benches and exchange of models. `surefoot` hands these commands
//! over to it.

// Doc comments of arguments are printed by `--help`, not rendered as pages.
#![allow(rustdoc::broken_intra_doc_links, rustdoc::bare_urls)]

mod act;
mod bench;
mod challenge;
mod eval;
mod export;
mod processes;
mod provenance;
mod train;

use clap::{CommandFactory, FromArgMatches, Parser, Subcommand};
use surefoot_cli::commands::services::{self, Inference};
use surefoot_cli::{config, terminal};
use surefoot_train::Processor;
use surefoot_train::networks::with_burn;

/// Training, evaluation and benches of Surefoot. `surefoot` starts this program for these commands.
#[derive(Parser)]
#[command(
    name = "surefoot-lab",
    version,
    propagate_version = true,
    max_term_width = 110,
    after_help = "Examples:\n  surefoot train runs/first\n  surefoot eval --help"
)]
struct Cli {
    #[command(subcommand)]
    command: Command,
    #[command(flatten)]
    log: terminal::LogArgs,
}

#[derive(Subcommand)]
enum Command {
    /// Train a reactive or recurrent policy with SAC.
    Train(Box<train::Args>),
    /// Collect experience for a learner in another process.
    Act(act::Args),
    /// Measure success on maps by the paper's protocol.
    Eval(Box<eval::Args>),
    /// Compare agents and planners of any origin on the same goals.
    #[command(
        subcommand,
        after_help = "Examples:\n  \
            surefoot challenge record paper-like --out surefoot.json.gz\n  \
            surefoot challenge score surefoot.json.gz"
    )]
    Challenge(challenge::Command),
    /// Write a model as ONNX or safetensors.
    Export(export::ExportArgs),
    /// Convert a safetensors file to a model.
    Import(export::ImportArgs),
    /// Measure speed on this machine.
    Bench(bench::Args),
    /// Run an NPC worker; unlike `surefoot`, this program can evaluate the policy with burn.
    Work(Box<services::WorkArgs>),
}

fn main() -> std::process::ExitCode {
    surefoot_cli::main(run)
}

fn run() -> anyhow::Result<()> {
    let Some(matches) = config::read(Cli::command())? else { return Ok(()) };
    let cli = Cli::from_arg_matches(&matches).unwrap_or_else(|error| error.exit());
    let logging = terminal::Logging::start(&cli.log)?;
    let result = execute(cli.command);
    logging.finish();
    result
}

fn execute(command: Command) -> anyhow::Result<()> {
    match command {
        Command::Train(args) => train::run(*args),
        Command::Act(args) => act::run(args),
        Command::Eval(args) => eval::run(&args),
        Command::Challenge(command) => challenge::run(&command),
        Command::Export(args) => export::export(&args),
        Command::Import(args) => export::import(&args),
        Command::Bench(args) => bench::run(&args),
        Command::Work(args) => work(&args),
    }
}

/// Runs an NPC worker whose policy is evaluated as `--inference` says.
fn work(args: &services::WorkArgs) -> anyhow::Result<()> {
    let processor = match args.inference {
        Inference::Cpu => None,
        Inference::Burn => Some(Processor::Cpu),
        Inference::BurnCuda => Some(Processor::Cuda),
    };
    services::run_worker(args, |policy| match processor {
        Some(processor) => Ok(with_burn(policy, processor)?),
        None => Ok(policy),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_help_of_every_command_has_examples() {
        assert_eq!(surefoot_cli::without_examples(&Cli::command()), Vec::<String>::new());
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
        let page = concat!(env!("CARGO_MANIFEST_DIR"), "/../../docs/guides/training.md");
        let page = std::fs::read_to_string(page).expect("the page exists");
        assert!(page.contains(&format!("`surefoot bench {}`", names.join("|"))), "the page lists other benches");
    }
}
