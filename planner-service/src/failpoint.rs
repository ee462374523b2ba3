//! Steps of a build at which a test ends or stops the process, as a crash or a starved machine would:
//! `SUREFOOT_ABORT_AT` and `SUREFOOT_STOP_AT` name a step. Without the feature `failpoints`, which only tests of
//! fleets enable, steps do nothing.

/// Marks a step. After `SUREFOOT_STOP_AT`, the signal CONT resumes the process.
#[cfg(feature = "failpoints")]
pub fn failpoint(step: &str) {
    use std::ffi::OsString;
    use std::sync::LazyLock;
    static STEPS: LazyLock<[Option<OsString>; 2]> =
        LazyLock::new(|| ["SUREFOOT_ABORT_AT", "SUREFOOT_STOP_AT"].map(std::env::var_os));
    let [is_abort, is_stop] = STEPS.each_ref().map(|at| at.as_ref().is_some_and(|at| at == step));
    if is_abort {
        std::process::abort();
    }
    if is_stop {
        // A process that cannot stop itself fails the test that wants it to.
        let _ = std::process::Command::new("kill").args(["-STOP", &std::process::id().to_string()]).status();
    }
}

/// Marks a step.
#[cfg(not(feature = "failpoints"))]
pub fn failpoint(_: &str) {}
