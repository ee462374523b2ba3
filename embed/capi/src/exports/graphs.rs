//! Graphs and plans.

use super::{destroy, export, read};
use crate::abi;
use crate::checks;
use crate::error::{Fault, Status};
use crate::graphs::{self, Graph, MAX_PLANS};
use crate::memory::{self, fill, growing, hand_out, reference, slice, slice_mut, write, write_growing};
use std::ffi::{c_char, c_void};
use std::sync::{RwLock, RwLockReadGuard, RwLockWriteGuard};
use surefoot_planner::Query;

/// State that many threads read or one thread changes; calls wait for each other.
pub type Shared<T> = RwLock<T>;

destroy!(sf_graph_destroy Shared<Graph>);

export! {
    fn sf_graph_load(path: *const c_char, graph: *mut *mut Shared<Graph>) {
        hand_out(graph, "graph", RwLock::new(parse(&read(path)?)?))
    }

    fn sf_graph_load_memory(bytes: *const c_void, size: usize, graph: *mut *mut Shared<Graph>) {
        hand_out(graph, "graph", RwLock::new(parse(slice(bytes.cast::<u8>(), size, "bytes")?)?))
    }

    fn sf_graph_describe(graph: *const Shared<Graph>, info: *mut abi::GraphInfo) {
        let shared = view(graph)?;
        let graph = shared.graph();
        let (vertex_count, edge_count) = (graph.vertex_count() as u32, graph.edge_count() as u32);
        let found = abi::GraphInfo { struct_size: 0, vertex_count, edge_count, island_count: graph.island_count() };
        write_growing(info, "info", found)
    }

    fn sf_graph_vertices(graph: *const Shared<Graph>, vertices: *mut abi::Vec3, capacity: usize, count: *mut usize) {
        let shared = view(graph)?;
        let (graph, frame) = (shared.graph(), shared.frame_of_places());
        let place = |vertex| abi::Vec3::of_map(graph.position(vertex), frame);
        let places: Vec<abi::Vec3> = graph.vertices().map(place).collect();
        fill(vertices, capacity, count, "vertices", &places)
    }

    fn sf_graph_edges(graph: *const Shared<Graph>, edges: *mut abi::Edge, capacity: usize, count: *mut usize) {
        fill(edges, capacity, count, "edges", &view(graph)?.edges())
    }

    fn sf_graph_frame(graph: *const Shared<Graph>, frame: *mut abi::Frame) {
        write(frame, "frame", view(graph)?.frame()?.into())
    }

    fn sf_graph_ability(graph: *const Shared<Graph>, ability: i32, info: *mut abi::AbilityInfo) {
        let ability = checks::ability(ability)?;
        let moves = if graph.is_null() { Default::default() } else { view(graph)?.graph().moves().clone() };
        write_growing(info, "info", graphs::describe_ability(&moves, ability)?)
    }

    fn sf_graph_set_coordinates(graph: *mut Shared<Graph>, coordinates: i32) {
        change(graph)?.set_coordinates(coordinates)
    }

    fn sf_graph_set_edge_open(graph: *mut Shared<Graph>, from: u32, to: u32, is_open: i32) {
        change(graph)?.set_open(from, to, is_open != 0)
    }

    fn sf_graph_set_edge_price(graph: *mut Shared<Graph>, from: u32, to: u32, factor: f32) {
        change(graph)?.set_price(from, to, factor)
    }

    fn sf_graph_edit(graph: *mut Shared<Graph>, edits: *const abi::Edit, count: usize) {
        let edits = slice(edits, count, "edits")?;
        change(graph)?.edit(edits)
    }

    fn sf_graph_note_traversals(graph: *mut Shared<Graph>, traversals: *const abi::Traversal, count: usize) {
        let traversals = slice(traversals, count, "traversals")?;
        let mut graph = change(graph)?;
        traversals.iter().try_for_each(|traversal| graph.note(traversal))
    }

    fn sf_graph_find_path(
        graph: *const Shared<Graph>,
        query: *const abi::Query,
        legs: *mut abi::Leg,
        capacity: usize,
        count: *mut usize,
        plan: *mut abi::Plan,
    ) {
        let graph = view(graph)?;
        let found = graph.find(&read_query(query, &graph)?);
        if !plan.is_null() {
            write(plan, "plan", graphs::summary(&found, 0))?;
        }
        write(count, "count", found.legs.len())?;
        let room = slice_mut(legs, capacity, "legs")?;
        if found.legs.len() > room.len() {
            return Err(too_many_legs(capacity, found.legs.len()));
        }
        room.iter_mut().zip(graphs::legs(&found, graph.frame_of_places())).for_each(|(to, leg)| *to = leg);
        Ok(())
    }

    fn sf_graph_find_alternatives(
        graph: *const Shared<Graph>,
        query: *const abi::Query,
        plans: *mut abi::Plan,
        plan_capacity: usize,
        plan_count: *mut usize,
        legs: *mut abi::Leg,
        leg_capacity: usize,
        leg_count: *mut usize,
    ) {
        let graph = view(graph)?;
        let query = read_query(query, &graph)?;
        if !(1..=MAX_PLANS).contains(&plan_capacity) {
            return Err(Fault::argument(format!("plan_capacity is {plan_capacity}, but must be 1 to {MAX_PLANS}")));
        }
        let found = graph.find_several(&query, plan_capacity);
        let mut all = Vec::new();
        let summaries: Vec<abi::Plan> = found
            .iter()
            .map(|plan| {
                let first_leg = all.len();
                all.extend(graphs::legs(plan, graph.frame_of_places()));
                graphs::summary(plan, first_leg)
            })
            .collect();
        fill(plans, plan_capacity, plan_count, "plans", &summaries)?;
        fill(legs, leg_capacity, leg_count, "legs", &all)
    }
}

fn too_many_legs(capacity: usize, count: usize) -> Fault {
    let message = format!("legs has room for {capacity}, but the plan has {count}: make it larger");
    Fault::new(Status::BufferTooSmall, message)
}

fn parse(bytes: &[u8]) -> Result<Graph, Fault> {
    let text = std::str::from_utf8(bytes).map_err(|error| Fault::file(format!("a graph is JSON in UTF-8: {error}")))?;
    Graph::parse(text)
}

/// # Safety
/// As for [`reference`].
pub(super) unsafe fn view<'a>(graph: *const Shared<Graph>) -> Result<RwLockReadGuard<'a, Graph>, Fault> {
    // SAFETY: passed on.
    unsafe { reference(graph, "graph") }?.read().map_err(|_| memory::spoilt("graph"))
}

/// # Safety
/// As for [`reference`].
unsafe fn change<'a>(graph: *mut Shared<Graph>) -> Result<RwLockWriteGuard<'a, Graph>, Fault> {
    // SAFETY: passed on.
    unsafe { reference(graph, "graph") }?.write().map_err(|_| memory::spoilt("graph"))
}

/// # Safety
/// As for [`growing`], and `avoid` of the query as for [`slice`].
unsafe fn read_query(query: *const abi::Query, graph: &Graph) -> Result<Query, Fault> {
    // SAFETY: passed on.
    unsafe {
        let query = growing(query, "query")?;
        graph.query(&query, slice(query.avoid, query.avoid_count as usize, "query.avoid")?)
    }
}
