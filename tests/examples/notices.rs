//! Writes the notices of all crates that the program is linked with: `cargo run -p e2e --example notices`.
//!
//! `surefoot licenses` prints the file, and the container image includes it. A test compares its headings with the
//! linked crates.

use e2e::packages::{folders, linked};
use e2e::source::root;
use std::collections::BTreeMap;
use std::fmt::Write;

fn main() {
    let (packages, folders) = (linked(), folders());
    // Many crates have identical texts; each text is written once.
    let mut texts: BTreeMap<String, Vec<String>> = BTreeMap::new();
    for package in &packages {
        let entries =
            std::fs::read_dir(&folders[&(package.name.clone(), package.version.clone())]).expect("the crate's sources");
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
        "# Crates that surefoot is linked from\n\n\
         Surefoot itself is licensed under MIT or Apache-2.0, as you like.\n\n",
    );
    for package in &packages {
        writeln!(file, "- {}", package.heading()).expect("a String takes everything");
    }
    for (text, users) in &texts {
        write!(file, "\n## {}\n\n{text}\n", users.join(", ")).expect("a String takes everything");
    }
    let path = root().join("cli/THIRD_PARTY_NOTICES.md");
    std::fs::write(&path, &file).expect("the file can be written");
    println!("{}: {} crates, {} texts, {} KB", path.display(), packages.len(), texts.len(), file.len() / 1000);
}
