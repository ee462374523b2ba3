//! The commands of `surefoot`, and the flags, terminal output and configuration that it shares with `surefoot-lab`.

// Doc comments of arguments are printed by `--help`, not rendered as pages.
#![allow(rustdoc::broken_intra_doc_links, rustdoc::bare_urls)]

pub mod commands;
pub mod config;
#[cfg(feature = "otel")]
mod otel;
mod priority;
pub mod programs;
pub mod signals;
pub mod terminal;

use std::process::ExitCode;

/// Exit code of programs that a closed pipe ends: 128 + SIGPIPE.
const PIPE_CLOSED: i32 = 141;

/// Ends the program quietly when its output is closed early, as `head` does. Printing panics then.
fn end_quietly_with_the_reader() {
    let usual = std::panic::take_hook();
    std::panic::set_hook(Box::new(move |panic| {
        let message = panic.payload().downcast_ref::<String>();
        if message.is_some_and(|it| it.starts_with("failed printing to std") && it.contains("Broken pipe")) {
            std::process::exit(PIPE_CLOSED);
        }
        usual(panic);
    }));
}

/// Runs a program to its end; an error is printed in one line.
pub fn main(run: impl FnOnce() -> anyhow::Result<()>) -> ExitCode {
    end_quietly_with_the_reader();
    match run() {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("error: {error:#}");
            ExitCode::FAILURE
        }
    }
}

/// Names of the commands below `command`, itself included, whose help has no examples; for tests.
#[doc(hidden)]
pub fn without_examples(command: &clap::Command) -> Vec<String> {
    let help = command.get_after_help().map(ToString::to_string).unwrap_or_default();
    let name = command.get_name();
    let example = if name.starts_with("surefoot") { "\n  surefoot".to_owned() } else { format!(" {name}") };
    let has_examples =
        help.split_once("Examples:\n").is_some_and(|(_, examples)| format!("\n{examples}").contains(&example));
    let own = (!has_examples).then(|| name.to_owned());
    let below = command.get_subcommands().flat_map(without_examples);
    own.into_iter().chain(below.map(|below| format!("{name} {below}"))).collect()
}
