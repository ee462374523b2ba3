//! The crates that the program is linked with, as reported by cargo.

use crate::source::root;
use std::collections::{BTreeMap, BTreeSet};
use std::path::PathBuf;
use std::process::Command;

/// A third-party crate.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord)]
pub struct Package {
    /// Name of the crate.
    pub name: String,
    /// Version of the crate.
    pub version: String,
    /// Licence as an SPDX expression.
    pub license: String,
}

impl Package {
    /// Heading of the crate in the third-party notices.
    pub fn heading(&self) -> String {
        format!("{} {} ({})", self.name, self.version, self.license)
    }
}

/// Features of the image.
pub const IMAGE: &str = "surefoot-cli/agones,surefoot-cli/fleet,surefoot-lab/fleet";

/// Every third-party crate of the shipped programs: on Linux, with the features of the image.
///
/// # Panics
/// If cargo fails.
pub fn linked() -> BTreeSet<Package> {
    let program = ["--package", "surefoot-cli", "--package", "surefoot-lab", "--features", IMAGE];
    let about = [&program[..], &["--edges", "normal", "--target", "x86_64-unknown-linux-gnu"]].concat();
    let tree = cargo(&[&["tree", "--prefix", "none", "--format", "{p}|{l}|"], &about[..]].concat());
    let lines = tree.lines().filter(|line| !line.is_empty() && !line.contains(" (/") && !line.contains(":\\"));
    lines
        .map(|line| {
            let [package, license, _] = line.split('|').collect::<Vec<_>>()[..] else {
                panic!("a package and its licence")
            };
            let (name, version) = package.split_once(" v").expect("a name and a version");
            let version = version.trim_end_matches(" (proc-macro)");
            Package { name: name.to_owned(), version: version.to_owned(), license: license.to_owned() }
        })
        .collect()
}

/// The sets of features that each crate is built with, by name and version, for the arguments `about` of `cargo tree`.
///
/// # Panics
/// If cargo fails.
pub fn features(about: &[&str]) -> BTreeMap<String, BTreeSet<String>> {
    let format = ["--target", "x86_64-unknown-linux-gnu", "--prefix", "none", "--format", "{p}|{f}|"];
    let mut found: BTreeMap<String, BTreeSet<String>> = BTreeMap::new();
    for line in cargo(&[&["tree"], about, &format].concat()).lines() {
        if let [package, features, _] = line.split('|').collect::<Vec<_>>()[..] {
            found.entry(package.to_owned()).or_default().insert(features.to_owned());
        }
    }
    found
}

/// Folder with the sources of each crate, by name and version.
///
/// # Panics
/// If cargo fails.
pub fn folders() -> BTreeMap<(String, String), PathBuf> {
    let metadata = ["metadata", "--format-version", "1", "--filter-platform", "x86_64-unknown-linux-gnu"];
    let metadata = cargo(&[&metadata[..], &["--features", IMAGE]].concat());
    let metadata: serde_json::Value = serde_json::from_str(&metadata).expect("metadata is JSON");
    let text = |value: &serde_json::Value| value.as_str().expect("a text").to_owned();
    let packages = metadata["packages"].as_array().expect("packages").iter();
    packages
        .map(|package| {
            let manifest = PathBuf::from(text(&package["manifest_path"]));
            let folder = manifest.parent().expect("a folder").to_owned();
            ((text(&package["name"]), text(&package["version"])), folder)
        })
        .collect()
}

fn cargo(arguments: &[&str]) -> String {
    let manifest = root().join("Cargo.toml");
    let mut command = Command::new(env!("CARGO"));
    let output = command.args(arguments).arg("--locked").arg("--manifest-path").arg(manifest).output();
    let output = output.expect("cargo runs");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    String::from_utf8(output.stdout).expect("cargo writes UTF-8")
}
