//! Edits of a map: the time from the request to the first plan on the unaffected part of the graph, and to the graph
//! whose affected part has been probed again.

use super::{Figure, median};
use anyhow::Context;
use std::time::Instant;
use surefoot_proto::convert;
use surefoot_proto::pieces::piece_to_wire;
use surefoot_proto::planner::v1 as wire;
use surefoot_proto::planner::v1::planner_service_client::PlannerServiceClient;
use surefoot_world::Vec3;
use surefoot_world::map::{Piece, PieceShape};
use tonic::transport::Channel;

/// Number of blocks that are added to the map, one after another.
const BLOCKS: usize = 20;
/// Half of the side of a block, and its height, m.
const HALF_M: f32 = 5.0;
const HEIGHT_M: f32 = 6.0;

/// Adds blocks to the map of `request`, whose graph the planner has built.
pub(super) async fn edits(
    client: &mut PlannerServiceClient<Channel>,
    request: wire::StartBuildRequest,
    places: &[Vec3],
) -> anyhow::Result<Vec<Figure>> {
    let (mut usable, mut settled) = (Vec::new(), Vec::new());
    let mut pieces = Vec::new();
    for (idx, &foot) in places.iter().take(BLOCKS).enumerate() {
        let shape = PieceShape::Block { foot, half: [HALF_M; 2], height: HEIGHT_M, yaw: idx as f32 };
        pieces.push(piece_to_wire(&Piece { name: format!("block {idx}"), shape }));
        let request = wire::StartBuildRequest { pieces: pieces.clone(), ..request.clone() };
        let started = Instant::now();
        let build = client.start_build(request).await?.into_inner().build.unwrap_or_default();
        let watch = wire::WatchBuildRequest { build_id: build.build_id };
        let mut stages = client.watch_build(watch).await?.into_inner();
        let mut first = None;
        let mut last = wire::Build::default();
        while let Some(stage) = stages.message().await? {
            last = stage.build.unwrap_or_default();
            if first.is_none() && !(last.interim_graph_id.is_empty() && last.graph_id.is_empty()) {
                let id = if last.graph_id.is_empty() { &last.interim_graph_id } else { &last.graph_id };
                let [start, goal] = [places[BLOCKS], places[BLOCKS + 1]].map(|place| Some(convert::to_wire(place)));
                let query = Some(wire::PathQuery { start, goal, ..Default::default() });
                client.find_path(wire::FindPathRequest { graph_id: id.clone(), query, ..Default::default() }).await?;
                first = Some(started.elapsed().as_secs_f64());
            }
        }
        anyhow::ensure!(last.stage() == wire::BuildStage::Done, "an edit failed: {:?}", last.failure);
        settled.push(started.elapsed().as_secs_f64());
        usable.push(first.context("the edit produced no graph")?);
    }
    let slowest = |times: &[f64]| times.iter().copied().fold(0.0, f64::max);
    Ok(vec![
        Figure::new("edit_usable_ms", 1.0e3 * median(usable.clone()), "ms").at_most(100.0),
        Figure::new("edit_usable_ms_slowest", 1.0e3 * slowest(&usable), "ms"),
        Figure::new("edit_settled_s", median(settled.clone()), "s").at_most(1.0),
        Figure::new("edit_settled_s_slowest", slowest(&settled), "s"),
    ])
}
