//! Steps of a build at which a test ends or stops the process, as a crash or a starved machine would: `SUREFOOT_ABORT_AT` and
//! `SUREFOOT_STOP_AT` name a step. Without them, steps do nothing.

use std::process::Command;

/// Marks a step. With `SUREFOOT_STOP_AT`, the process goes on when it gets the signal CONT.
pub fn pass(step: &str) {
    let is_at = |variable: &str| std::env::var_os(variable).is_some_and(|at| at == step);
    if is_at("SUREFOOT_ABORT_AT") {
        std::process::abort();
    }
    if is_at("SUREFOOT_STOP_AT") {
        // A process that cannot stop itself fails the test that wants it to.
        let _ = Command::new("kill").args(["-STOP", &std::process::id().to_string()]).status();
    }
}
