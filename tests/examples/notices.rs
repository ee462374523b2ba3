//! Writes the notices of all third-party packages in a release: `cargo run -p e2e --example notices`. Needs Studio's
//! packages in `studio/page/node_modules`, where `npm ci` or a build of Studio puts them.
//!
//! `surefoot licenses` prints the file, and every package of a release includes it. A test compares its lists with what
//! the packages are made of.

use e2e::packages::{Package, folders, lists};
use e2e::source::root;
use std::collections::BTreeMap;
use std::fmt::Write;

fn main() {
    let (lists, folders) = (lists(), folders());
    // Many packages have identical texts; each text is written once.
    let mut texts: BTreeMap<String, Vec<String>> = BTreeMap::new();
    for package in lists.iter().flat_map(|(_, packages)| packages) {
        let folder = &folders[&(package.name.clone(), package.version.clone())];
        let entries = std::fs::read_dir(folder).unwrap_or_else(|error| panic!("{}: {error}", folder.display()));
        let mut paths: Vec<_> =
            entries.filter_map(|entry| Some(entry.ok()?.path())).filter(|path| path.is_file()).collect();
        paths.sort();
        for path in paths {
            let name = path.file_name().unwrap_or_default().to_string_lossy().to_uppercase();
            let is_notice =
                ["LICENSE", "LICENCE", "COPYING", "NOTICE", "UNLICENSE"].iter().any(|start| name.starts_with(start));
            let Some(text) = is_notice.then(|| std::fs::read_to_string(&path).ok()).flatten() else { continue };
            let text = text.lines().map(str::trim_end).collect::<Vec<_>>().join("\n").trim().to_owned();
            let users = texts.entry(text).or_default();
            let user = format!("{} {}", package.name, package.version);
            if users.last() != Some(&user) {
                users.push(user);
            }
        }
    }
    let mut file = String::from(
        "# Third-party software in Surefoot\n\n\
         Surefoot itself is licensed under MIT or Apache-2.0, as you like.\n\
         libsurefoot and the plugins for engines contain some of the crates in the programs.\n",
    );
    for (heading, packages) in &lists {
        write!(file, "\n## {heading}\n\n").expect("a String takes everything");
        for line in packages.iter().map(Package::heading) {
            writeln!(file, "- {line}").expect("a String takes everything");
        }
    }
    for (text, users) in &texts {
        write!(file, "\n## {}\n\n{text}\n", users.join(", ")).expect("a String takes everything");
    }
    let path = root().join("cli/THIRD_PARTY_NOTICES.md");
    std::fs::write(&path, &file).expect("the file can be written");
    let count: usize = lists.iter().map(|(_, packages)| packages.len()).sum();
    println!("{}: {count} packages, {} texts, {} KB", path.display(), texts.len(), file.len() / 1000);
}
