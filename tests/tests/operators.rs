//! The pages for operators agree with the programs: they list every metric and every alert, and nothing else.

use e2e::source::root;
use e2e::{create_world, metrics, start_planner, start_server, world_client};
use std::collections::{BTreeMap, BTreeSet};
use surefoot_planner_service::PlannerConfig;
use surefoot_proto::world::v1::TimeMode;
use surefoot_server::ServerConfig;

fn read(path: &str) -> String {
    std::fs::read_to_string(root().join(path)).unwrap_or_else(|error| panic!("{path}: {error}"))
}

/// Metrics in a section of the page, each with the text of its entry.
fn listed(page: &str, section: &str) -> BTreeMap<String, String> {
    let (_, rest) = page.split_once(&format!("\n## {section}\n")).unwrap_or_else(|| panic!("no section {section}"));
    let section = rest.split("\n## ").next().unwrap_or_default();
    let entries = section.lines().filter_map(|line| line.strip_prefix("- `")?.split_once("`: "));
    entries.map(|(name, text)| (name.to_owned(), text.to_owned())).collect()
}

fn names(metrics: &BTreeMap<String, String>) -> BTreeSet<String> {
    metrics.keys().cloned().collect()
}

/// Metrics of a response of `GET /metrics`, with their types.
fn exported(text: &str) -> BTreeMap<String, String> {
    let types = text.lines().filter_map(|line| line.strip_prefix("# TYPE ")?.split_once(' '));
    types.map(|(name, kind)| (name.to_owned(), kind.to_owned())).collect()
}

/// Metrics that a source file renders: its services do not run in this test.
fn declared(path: &str) -> BTreeSet<String> {
    let source = read(path);
    let is_part = |letter: char| letter.is_ascii_lowercase() || letter == '_';
    let texts = source.split('"').map(|text| text.strip_prefix("surefoot_").unwrap_or(text));
    let names = texts.filter(|text| text.chars().all(is_part));
    let names = names.filter(|name| name.ends_with("_total") || name.ends_with("_connected"));
    names.map(|name| format!("surefoot_{name}")).collect()
}

/// Names of the labels of all samples.
fn labels(text: &str) -> BTreeSet<&str> {
    let samples = text.lines().filter(|line| line.starts_with("surefoot_"));
    let sets = samples.filter_map(|line| line.split_once('{')?.1.split_once('}'));
    sets.flat_map(|(set, _)| set.split(',')).filter_map(|label| Some(label.split_once('=')?.0)).collect()
}

#[tokio::test(flavor = "multi_thread")]
async fn the_page_of_metrics_lists_those_that_are_exported() {
    let page = read("docs/reference/metrics.md");
    let section = |name| listed(&page, name);
    let of_all = names(&section("All services"));
    let cache = tempfile::tempdir().unwrap();
    let (server, planner) =
        (start_server(ServerConfig::default()), start_planner(cache.path(), PlannerConfig::default()));
    create_world(&mut world_client(&server).await, 3, TimeMode::Realtime).await;
    let (of_server, of_planner) = (metrics(&server, "").await, metrics(&planner, "").await);
    let (server_types, planner_types) = (exported(&of_server), exported(&of_planner));

    assert_eq!(&names(&section("World server")) | &of_all, names(&server_types));
    let of_queue = declared("operate/fleet/src/work/queue.rs");
    let over_nats = &declared("operate/fleet/src/work/dispatch.rs") | &of_queue;
    assert_eq!(&names(&section("Planner")) | &of_all, &names(&planner_types) | &over_nats);
    let of_prover = &declared("operate/fleet/src/work/prover.rs") | &declared("cli/src/commands/fleet/units.rs");
    assert_eq!(names(&section("Prover")), &of_prover | &of_queue);

    for (name, kind) in server_types.iter().chain(&planner_types) {
        let by_name = match name.as_str() {
            "surefoot_tick_seconds" => "histogram",
            name if name.ends_with("_total") => "counter",
            _ => "gauge",
        };
        assert_eq!(kind, by_name, "the page says that {name} is a {by_name}");
    }
    // Buckets of histograms are not labels of ours.
    for label in labels(&of_server).into_iter().filter(|label| *label != "le") {
        assert!(page.contains(&format!("`{label}`")), "the page does not explain the label {label}");
    }
    planner.stop().await;
    server.stop().await;
}

#[test]
fn every_alert_has_its_section_in_the_runbook() {
    let (alerts, runbook) = (read("operate/deploy/monitoring/alerts.yml"), read("docs/guides/runbook.md"));
    let alerts: Vec<&str> = alerts.lines().filter_map(|line| line.trim().strip_prefix("- alert: ")).collect();
    let sections: Vec<&str> = runbook.lines().filter_map(|line| line.strip_prefix("## ")).collect();
    assert_eq!(sections, alerts);
}
