//! Maps on the wire: meshes, features and surveys.

use crate::geometry::TileMesh;
use crate::worlds::maps::Survey;
use surefoot_proto::convert::{self, WireEnum};
use surefoot_proto::world::v1 as wire;
use surefoot_world::Map;
use surefoot_world::map::{Liquid, Outline, Spot};

/// Most bodies in one survey.
pub const MAX_SURVEYED: f64 = 8.0;
/// Most places that a survey lists.
pub const MAX_CUT_OFF: f64 = 10_000.0;

pub fn survey_to_wire(survey: &Survey) -> wire::Survey {
    wire::Survey {
        body: Some(convert::body_to_wire(&survey.body)),
        places: survey.places as u32,
        islands: survey.islands as u32,
        connected_on_foot: survey.connected_on_foot as f32,
        connected: survey.connected as f32,
        cut_off_places: survey.cut_off_places as u32,
        cut_off: survey.cut_off.iter().copied().map(convert::to_wire).collect(),
    }
}

/// Converts one of `tile_count` tiles.
pub fn tile_to_wire(tile: &TileMesh, tile_count: usize) -> wire::GetMeshResponse {
    let [tile_x, tile_z] = tile.place;
    wire::GetMeshResponse {
        tile_x,
        tile_z,
        tile_count: tile_count as u32,
        positions: convert::pack(tile.positions.iter().flat_map(|point| point.to_array())),
        indices: tile.indices.iter().flat_map(|index| index.to_le_bytes()).collect(),
        surfaces: tile.surfaces.iter().map(|&surface| surface.to_wire() as u8).collect(),
    }
}

pub fn features_to_wire(map: &Map) -> wire::GetFeaturesResponse {
    let placed = map.placed();
    let line = |from, to, two_way| wire::LineFeature {
        from: Some(convert::to_wire(from)),
        to: Some(convert::to_wire(to)),
        two_way,
    };
    let pools = placed.pools.iter().map(|pool| {
        let (half_x, half_z) = pool.outline.half_extents();
        wire::PoolFeature {
            centre: Some(convert::to_wire(pool.centre)),
            half_x,
            half_z,
            round: matches!(pool.outline, Outline::Round { .. }),
            depth: pool.depth,
            lava: pool.liquid == Liquid::Lava,
        }
    });
    let pads =
        placed.pads.iter().map(|pad| wire::PadFeature { centre: Some(convert::to_wire(pad.centre)), speed: pad.speed });
    wire::GetFeaturesResponse {
        size: Some(map.size().into()),
        pools: pools.collect(),
        pads: pads.collect(),
        zip_lines: placed.zip_lines.iter().map(|it| line(it.from, it.to, false)).collect(),
        teleporters: placed.teleporters.iter().map(|it| line(it.from, it.to, it.two_way)).collect(),
        jetpacks: placed.jetpacks.iter().map(|it| convert::to_wire(it.centre)).collect(),
        spots: placed.spots.iter().map(spot_to_wire).collect(),
    }
}

fn spot_to_wire(spot: &Spot) -> wire::SpotFeature {
    wire::SpotFeature {
        tag: spot.tag.clone(),
        from: Some(convert::to_wire(spot.from)),
        to: spot.to.map(convert::to_wire),
        two_way: spot.two_way,
    }
}
