//! The laboratory's commands, run through `surefoot` in real processes.

mod challenge;
mod commands;
mod kills;
mod learner;
mod tables;

use std::process::Command;

fn surefoot() -> Command {
    surefoot_processes::surefoot(&[])
}
