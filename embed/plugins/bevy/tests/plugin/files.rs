//! Files that cannot be used.

use crate::stage;
use bevy::math::Vec3;
use bevy_surefoot::{
    AgentPlan, AgentStatus, Failure, Goal, LevelFormat, SurefootAgent, SurefootGraph, SurefootLevel, SurefootPolicy,
};
use std::path::Path;
use surefoot_planner::{EdgeKey, Query};

fn model(file: &str) -> Vec<u8> {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../models/general-reactive").join(file);
    std::fs::read(path).unwrap()
}

#[test]
fn damaged_policies_are_rejected_in_one_line() {
    let (manifest, weights) = (model("manifest.json"), model("weights.bpk"));
    assert!(SurefootPolicy::from_bytes(&manifest, &weights).unwrap().label().starts_with("general-reactive"));
    let cut_off = SurefootPolicy::from_bytes(&manifest, &weights[..weights.len() / 2]).unwrap_err().to_string();
    let no_manifest = SurefootPolicy::from_bytes(&weights, &weights).unwrap_err().to_string();
    let missing = SurefootPolicy::load("no/such/folder").unwrap_err().to_string();
    let unknown = SurefootPolicy::shipped("general").unwrap_err().to_string();
    for (message, part) in
        [(cut_off, "weights"), (no_manifest, "manifest.json"), (missing, "no/such/folder"), (unknown, "general-lstm")]
    {
        assert!(message.contains(part) && !message.contains('\n'), "{message}");
    }
}

#[test]
fn damaged_graphs_and_levels_are_rejected() {
    let cut_off = stage::export("2", &["--size", "50"]);
    let message = SurefootGraph::from_json(&cut_off[..cut_off.len() / 2]).unwrap_err().to_string();
    assert!(message.contains("graph export --format json"), "{message}");
    let missing = SurefootGraph::load("no_such_graph.json").unwrap_err().to_string();
    assert!(missing.contains("no_such_graph.json"), "{missing}");
    assert!(SurefootLevel::from_bytes(b"v 0 0", LevelFormat::Obj).is_err());
    assert!(SurefootLevel::load("level.blend").unwrap_err().to_string().contains(".glb"));
}

#[test]
fn a_graph_of_another_level_is_rejected() {
    let elsewhere = SurefootGraph::from_json(&stage::export("2", &["--size", "50"])).unwrap();
    let message = elsewhere.aligned_to(&stage::level()).unwrap_err().to_string();
    assert!(message.contains("nowhere to stand"), "{message}");
}

#[test]
fn a_graph_of_another_body_fails_the_attempt() {
    let mut app = stage::app();
    let body = SurefootAgent::default().body.with(|body| body.radius = 0.5).unwrap();
    let agent = SurefootAgent { body, ..SurefootAgent::default() };
    let spawned = app.world_mut().spawn((agent, Goal(Vec3::ZERO), stage::graph())).id();
    for _ in 0..2 {
        app.update();
    }
    let status = app.world().get::<AgentPlan>(spawned).unwrap().status;
    assert_eq!(status, AgentStatus::Failed(Failure::OtherBody));
    assert!(Failure::OtherBody.to_string().contains("--body"));
}

#[test]
fn a_goal_that_is_no_place_fails_the_attempt() {
    let mut app = stage::app();
    let spawned = app.world_mut().spawn((SurefootAgent::default(), Goal(Vec3::NAN))).id();
    for _ in 0..2 {
        app.update();
    }
    assert_eq!(app.world().get::<AgentPlan>(spawned).unwrap().status, AgentStatus::Failed(Failure::BadGoal));
}

#[test]
fn closed_edges_are_left_out_of_plans_until_they_are_opened() {
    let graph = stage::graph();
    let vertices = graph.vertices();
    let query = Query::new(vertices[0], vertices[vertices.len() - 1]);
    let before = graph.find_path(&query);
    let closed: Vec<EdgeKey> = before.legs.iter().filter_map(|leg| leg.key.edge()).collect();
    assert!(!closed.is_empty());
    graph.clone().set_open(&closed, false).unwrap();
    let meanwhile = graph.find_path(&query);
    assert!(meanwhile.legs.iter().all(|leg| leg.key.edge().is_none_or(|edge| !closed.contains(&edge))));
    graph.set_open(&closed, true).unwrap();
    assert_eq!(graph.find_path(&query), before);
    let message = graph.set_open(&[EdgeKey::new(0, 100_000)], false).unwrap_err().to_string();
    assert!(message.contains("100000"), "{message}");
}
