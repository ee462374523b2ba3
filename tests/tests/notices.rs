//! Every crate that the program is linked with has a notice.

use e2e::packages::{Package, linked};
use e2e::source::root;

#[test]
fn the_notices_name_exactly_the_crates_that_are_linked() {
    let file = std::fs::read_to_string(root().join("cli/THIRD_PARTY_NOTICES.md")).expect("the notices");
    let (list, _) = file.split_once("\n## ").expect("a list, then the texts");
    let found: Vec<&str> = list.lines().filter_map(|line| line.strip_prefix("- ")).collect();
    let expected: Vec<String> = linked().iter().map(Package::heading).collect();
    assert_eq!(found, expected, "regenerate the notices: cargo run -p e2e --example notices");
}
