//! Every third-party package in a release has a notice.

use e2e::packages::{LIBRARY, PROGRAMS, Package, linked, lists};
use e2e::source::root;

#[test]
fn the_notices_name_exactly_the_packages_in_a_release() {
    let file = std::fs::read_to_string(root().join("cli/THIRD_PARTY_NOTICES.md")).expect("the notices");
    for (heading, packages) in lists() {
        let (_, rest) = file.split_once(&format!("\n## {heading}\n")).unwrap_or_else(|| panic!("a list '{heading}'"));
        let list = rest.split("\n## ").next().unwrap_or_default();
        let found: Vec<&str> = list.lines().filter_map(|line| line.strip_prefix("- ")).collect();
        let expected: Vec<String> = packages.iter().map(Package::heading).collect();
        assert_eq!(found, expected, "{heading}: regenerate the notices: cargo run -p e2e --example notices");
    }
}

#[test]
fn the_c_library_has_no_crate_besides_those_of_the_programs() {
    let (library, programs) = (linked(LIBRARY), linked(PROGRAMS));
    assert!(!library.is_empty());
    let others: Vec<&Package> = library.difference(&programs).collect();
    assert!(others.is_empty(), "the notices lack {others:?}");
}
