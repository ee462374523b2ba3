//! The third-party packages in a release, as reported by cargo and by npm's lock file.

use crate::source::root;
use std::collections::{BTreeMap, BTreeSet};
use std::path::PathBuf;
use std::process::Command;

/// A third-party crate, or package of npm.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord)]
pub struct Package {
    /// Name of the crate or package.
    pub name: String,
    /// Version of the crate or package.
    pub version: String,
    /// Licence as an SPDX expression.
    pub license: String,
}

impl Package {
    /// Line of the package in the third-party notices.
    pub fn heading(&self) -> String {
        format!("{} {} ({})", self.name, self.version, self.license)
    }
}

/// Features of the image.
pub const IMAGE: &str = "surefoot-cli/agones,surefoot-cli/fleet,surefoot-lab/fleet";

/// Arguments of cargo that select the shipped programs, with the features of the image.
pub const PROGRAMS: &[&str] = &["--package", "surefoot-cli", "--package", "surefoot-lab", "--features", IMAGE];
/// Arguments of cargo that select libsurefoot.
pub const LIBRARY: &[&str] = &["--package", "surefoot-capi"];
/// Arguments of cargo that select the native module of the Python package.
pub const PYTHON: &[&str] = &["--package", "surefoot-python"];

/// The lists of the third-party notices by heading. Each leaves out what the lists before it have.
///
/// # Panics
/// If cargo fails, or Studio's lock file cannot be read.
pub fn lists() -> [(&'static str, BTreeSet<Package>); 3] {
    let programs = linked(PROGRAMS);
    let python = linked(PYTHON).difference(&programs).cloned().collect();
    [("In the programs", programs), ("Only in the Python package", python), ("In Studio", bundled())]
}

/// Every third-party crate that is linked on Linux into the packages which `selection` names: [`PROGRAMS`] or another.
///
/// # Panics
/// If cargo fails.
pub fn linked(selection: &[&str]) -> BTreeSet<Package> {
    let about = [selection, &["--edges", "normal", "--target", "x86_64-unknown-linux-gnu"]].concat();
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

/// Every package of npm that Studio's page is bundled from, as its lock file says.
fn bundled() -> BTreeSet<Package> {
    let lock = std::fs::read_to_string(page().join("package-lock.json")).expect("Studio's lock file");
    let lock: serde_json::Value = serde_json::from_str(&lock).expect("the lock file is JSON");
    let packages = lock["packages"].as_object().expect("packages").iter();
    packages
        .filter(|(path, package)| !path.is_empty() && package["dev"] != true)
        .map(|(path, package)| Package {
            name: path.trim_start_matches("node_modules/").to_owned(),
            version: text(&package["version"]),
            license: text(&package["license"]),
        })
        .collect()
}

fn page() -> PathBuf {
    root().join("studio/page")
}

fn text(value: &serde_json::Value) -> String {
    value.as_str().expect("a text").to_owned()
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

/// Folder with the sources of each crate, and of each package in Studio, by name and version.
///
/// # Panics
/// If cargo fails.
pub fn folders() -> BTreeMap<(String, String), PathBuf> {
    let metadata = ["metadata", "--format-version", "1", "--filter-platform", "x86_64-unknown-linux-gnu"];
    let metadata = cargo(&[&metadata[..], &["--features", IMAGE]].concat());
    let metadata: serde_json::Value = serde_json::from_str(&metadata).expect("metadata is JSON");
    let packages = metadata["packages"].as_array().expect("packages").iter();
    let crates = packages.map(|package| {
        let manifest = PathBuf::from(text(&package["manifest_path"]));
        let folder = manifest.parent().expect("a folder").to_owned();
        ((text(&package["name"]), text(&package["version"])), folder)
    });
    let modules = page().join("node_modules");
    crates.chain(bundled().into_iter().map(|it| ((it.name.clone(), it.version), modules.join(it.name)))).collect()
}

fn cargo(arguments: &[&str]) -> String {
    let manifest = root().join("Cargo.toml");
    let mut command = Command::new(env!("CARGO"));
    let output = command.args(arguments).arg("--locked").arg("--manifest-path").arg(manifest).output();
    let output = output.expect("cargo runs");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    String::from_utf8(output.stdout).expect("cargo writes UTF-8")
}
