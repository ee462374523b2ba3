//! One module per subcommand.

mod agones;
pub mod body;
pub mod endpoint;
pub mod fleet;
pub mod game;
pub mod graph;
pub mod health;
pub mod licenses;
pub mod map;
pub mod services;
pub mod top;
pub mod up;

use anyhow::Context;
use std::path::Path;
use std::str::FromStr;
use surefoot_policy::Policy;

/// Loads the model in a folder, or the shipped model of that name; without a name, the shipped reactive model.
pub fn load_policy(model: Option<&Path>) -> anyhow::Result<Policy> {
    let shipped = |model: &Path| model.to_str().filter(|_| !model.exists()).and_then(Policy::shipped_named);
    match model {
        Some(model) => shipped(model)
            .unwrap_or_else(|| Policy::load(model))
            .with_context(|| format!("cannot use the model in {}", model.display())),
        None => Policy::shipped().context("cannot use the shipped model"),
    }
}

/// Default number of threads: one per core.
pub fn core_count() -> usize {
    std::thread::available_parallelism().map_or(1, usize::from)
}

/// The processors of this machine, for reports of measurements.
pub fn machine() -> String {
    let cpu = std::fs::read_to_string("/proc/cpuinfo").unwrap_or_default();
    let model = cpu
        .lines()
        .find_map(|line| line.strip_prefix("model name"))
        .map(|rest| rest.trim_start_matches([' ', '\t', ':']));
    format!("{} x {}", core_count(), model.unwrap_or(std::env::consts::ARCH))
}

/// Commit of the checkout that the program runs in, followed by `+` if there are changes.
pub fn revision() -> Option<String> {
    let git = |arguments: &[&str]| {
        let output =
            std::process::Command::new("git").args(arguments).output().ok().filter(|it| it.status.success())?;
        String::from_utf8(output.stdout).ok()
    };
    let head = git(&["rev-parse", "HEAD"])?;
    let changes = git(&["status", "--porcelain", "--untracked-files=no"])?;
    Some(format!("{}{}", head.trim(), if changes.is_empty() { "" } else { "+" }))
}

/// A share from 0 to 1.
pub fn parse_share<T: FromStr + PartialOrd + From<u8>>(text: &str) -> Result<T, String> {
    let share = text.parse().ok().filter(|share| (T::from(0)..=T::from(1)).contains(share));
    share.ok_or_else(|| "must be a share from 0 to 1, such as 0.98 for 98 %".to_owned())
}

/// A duration, s.
pub fn parse_seconds(text: &str) -> Result<f64, String> {
    let seconds: f64 = text.parse().map_err(|_| "not a number".to_owned())?;
    if (0.001..=86_400.0).contains(&seconds) { Ok(seconds) } else { Err("allowed are 0.001 to 86400".to_owned()) }
}
