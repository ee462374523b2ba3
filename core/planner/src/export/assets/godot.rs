//! A Godot 4 scene whose nodes are `NavigationLink3D`.

use super::formats::{About, Hint};
use super::{Axes, Link, LinkSet};
use crate::export::FrameFields;
use std::fmt::Write;
use surefoot_world::Vec3;

/// Writes the scene: a `Node3D` named `SurefootLinks` with a link below it for each of `set`.
pub(super) fn scene(set: &LinkSet) -> String {
    let mut text = "[gd_scene format=3]\n\n[node name=\"SurefootLinks\" type=\"Node3D\"]\n".to_owned();
    field(&mut text, "metadata/connected_without", set.connected.without);
    field(&mut text, "metadata/connected_with", set.connected.with);
    let FrameFields { origin, scale, up } = FrameFields::of(set.frame, |origin| vector(origin.to_array()));
    let quoted = up.map(|up| format!("\"{up}\""));
    let frame = [("origin", origin), ("scale", scale.map(|scale| scale.to_string())), ("up", quoted)];
    for (name, value) in frame {
        value.into_iter().for_each(|value| field(&mut text, &format!("metadata/{name}"), value));
    }
    for (idx, link) in set.links.iter().enumerate() {
        node(&mut text, idx, link, set);
    }
    text
}

fn node(text: &mut String, idx: usize, link: &Link, set: &LinkSet) {
    let (about, speed) = (About::of(set, link, Axes::Ours), set.speed);
    let (start, end) = (link.passage.start, link.passage.end);
    // Godot adds the cost of entering to the length times the cost of travelling.
    let (cost, length) = (link.cost_metres(speed), start.distance(end));
    let travel_cost = link.cost_ratio(speed).min(1.0);
    writeln!(text, "\n[node name=\"Link{idx}\" type=\"NavigationLink3D\" parent=\".\"]").expect("a String takes all");
    field(text, "bidirectional", false);
    field(text, "start_position", vector(start.to_array()));
    field(text, "end_position", vector(end.to_array()));
    field(text, "enter_cost", (cost - travel_cost * length).max(0.0));
    field(text, "travel_cost", travel_cost);
    field(text, "metadata/ability", format_args!("\"{}\"", about.ability));
    field(text, "metadata/apex", vector(apex(link).to_array()));
    field(text, "metadata/chance", about.chance);
    field(text, "metadata/driven", about.driven);
    field(text, "metadata/edge", about.edge);
    field(text, "metadata/leaps", leaps(&about.leaps));
    field(text, "metadata/seconds", about.seconds);
}

/// The highest place of a link.
fn apex(link: &Link) -> Vec3 {
    let ends = [link.passage.start, link.passage.end];
    let places = link.passage.leaps.iter().map(|leap| leap.apex).chain(ends);
    places.max_by(|one, other| one.y.total_cmp(&other.y)).expect("a link has ends")
}

/// An array of dictionaries with the fields of the JSON formats.
fn leaps(leaps: &[Hint<'_>]) -> String {
    let leaps = leaps.iter().map(|leap| {
        let [take_off, apex, landing] = [leap.take_off, leap.apex, leap.landing].map(vector);
        let second_jump = leap.second_jump.map_or(String::new(), |it| format!(", \"second_jump\": {it}"));
        // JSON's strings are Godot's.
        let animation =
            leap.animation.map_or(String::new(), |it| format!(", \"animation\": {}", serde_json::json!(it)));
        format!(
            "{{\"ability\": \"{}\", \"take_off\": {take_off}, \"apex\": {apex}, \"landing\": {landing}, \
             \"seconds\": {}, \"speed\": {}{second_jump}{animation}}}",
            leap.ability, leap.seconds, leap.speed
        )
    });
    format!("[{}]", leaps.collect::<Vec<_>>().join(", "))
}

fn vector([x, y, z]: [impl std::fmt::Display; 3]) -> String {
    format!("Vector3({x}, {y}, {z})")
}

fn field(text: &mut String, name: &str, value: impl std::fmt::Display) {
    writeln!(text, "{name} = {value}").expect("a String takes all");
}
